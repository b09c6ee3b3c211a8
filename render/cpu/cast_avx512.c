#include "render/cpu/cast.h"
void bb_cast_row_avx512(const struct bb_cast *c, uint32_t row, struct bb_cast_counts *counts)
{ (void)c; (void)row; (void)counts; }
#if 0
/* render/cpu/cast_avx512.c: the ray caster for processors with AVX-512 F, DQ and VL (see the Makefile for its flags).
 */
#ifdef __AVX512F__
#include <immintrin.h>
#include <stdbool.h>
#include <stdint.h>

#define WIDTH 16
#define KERNEL bb_cast_row_avx512

typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));

static inline vi gather32(const void *base, vi byte_offset)
{
	return (vi)_mm512_i32gather_epi32((__m512i)byte_offset, base, 1);
}

static inline void gather64(const uint64_t *table, vi index, vi *low, vi *high)
{
	const __m512i a = _mm512_i32gather_epi64(_mm512_castsi512_si256((__m512i)index), table, 8);
	const __m512i b = _mm512_i32gather_epi64(_mm512_extracti64x4_epi64((__m512i)index, 1), table, 8);
	const __m512i even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
	const __m512i odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);

	*low = (vi)_mm512_permutex2var_epi32(a, even, b);
	*high = (vi)_mm512_permutex2var_epi32(a, odd, b);
}

static inline bool any(vi mask)
{
	return _mm512_test_epi32_mask((__m512i)mask, (__m512i)mask) != 0;
}

#include "render/cpu/cast_kernel.inc"
#else
#include "render/cpu/cast.h"

void bb_cast_row_avx512(const struct bb_cast *c, uint32_t row, struct bb_cast_counts *counts)
{
	bb_cast_row_portable(c, row, counts);
}
#endif
#endif
