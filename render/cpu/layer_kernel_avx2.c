/* render/cpu/layer_kernel_avx2.c: the samples of layers for processors with AVX2 and FMA (its flags: see the Makefile).
 */
#ifdef __AVX2__
#include <immintrin.h>
#include <stdint.h>

#define WIDTH 8
#define NAME "avx2"
#define KERNEL bb_layer_kernel_avx2

typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));

static inline vi gather32(const void *base, vi byte_offset)
{
	return (vi)_mm256_i32gather_epi32(base, (__m256i)byte_offset, 1);
}

#include "render/cpu/layer_kernel.inc"
#else
#include "render/cpu/layers.h"

const struct bb_layer_kernel bb_layer_kernel_avx2; /* not for this processor */
#endif
