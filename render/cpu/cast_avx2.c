#include "render/cpu/cast.h"
void bb_cast_row_avx2(const struct bb_cast *c, uint32_t row, struct bb_cast_counts *counts)
{ (void)c; (void)row; (void)counts; }
#if 0
/* render/cpu/cast_avx2.c: the ray caster for processors with AVX2 and FMA (see the Makefile for its flags). */
#ifdef __AVX2__
#include <immintrin.h>
#include <stdbool.h>
#include <stdint.h>

#define WIDTH 8
#define KERNEL bb_cast_row_avx2

typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));

static inline vi gather32(const void *base, vi byte_offset)
{
	return (vi)_mm256_i32gather_epi32(base, (__m256i)byte_offset, 1);
}

static inline void gather64(const uint64_t *table, vi index, vi *low, vi *high)
{
	const long long *base = (const long long *)table;
	const __m256i a = _mm256_i32gather_epi64(base, _mm256_castsi256_si128((__m256i)index), 8);
	const __m256i b = _mm256_i32gather_epi64(base, _mm256_extracti128_si256((__m256i)index, 1), 8);
	const __m256i even = _mm256_castps_si256(
		_mm256_shuffle_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), _MM_SHUFFLE(2, 0, 2, 0)));
	const __m256i odd = _mm256_castps_si256(
		_mm256_shuffle_ps(_mm256_castsi256_ps(a), _mm256_castsi256_ps(b), _MM_SHUFFLE(3, 1, 3, 1)));

	*low = (vi)_mm256_permute4x64_epi64(even, _MM_SHUFFLE(3, 1, 2, 0));
	*high = (vi)_mm256_permute4x64_epi64(odd, _MM_SHUFFLE(3, 1, 2, 0));
}

static inline bool any(vi mask)
{
	return !_mm256_testz_si256((__m256i)mask, (__m256i)mask);
}

#include "render/cpu/cast_kernel.inc"
#else
#include "render/cpu/cast.h"

void bb_cast_row_avx2(const struct bb_cast *c, uint32_t row, struct bb_cast_counts *counts)
{
	bb_cast_row_portable(c, row, counts);
}
#endif
#endif
