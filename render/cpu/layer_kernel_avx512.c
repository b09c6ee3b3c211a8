/* render/cpu/layer_kernel_avx512.c: the samples of layers for processors with AVX-512 F, DQ and VL (its flags: see the
 * Makefile). */
#ifdef __AVX512F__
#include <immintrin.h>
#include <stdint.h>

#define WIDTH 16
#define NAME "avx512"
#define KERNEL bb_layer_kernel_avx512

typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));

static inline vi gather32(const void *base, vi byte_offset)
{
	return (vi)_mm512_i32gather_epi32((__m512i)byte_offset, base, 1);
}

#include "render/cpu/layer_kernel.inc"
#else
#include "render/cpu/layers.h"

const struct bb_layer_kernel bb_layer_kernel_avx512; /* not for this processor */
#endif
