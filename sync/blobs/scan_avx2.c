/* sync/blobs/scan_avx2.c: 128 pixels a turn. */
#include "sync/blobs/blobs_private.h"

#ifdef __AVX2__
#include <immintrin.h>

static __m256i load(const uint8_t *p)
{
	return _mm256_loadu_si256((const __m256i *)(const void *)p);
}

size_t bb_blobs_scan_avx2(const uint8_t *p, size_t from, size_t n, int low)
{
	const __m256i below = _mm256_set1_epi8((char)(low - 1)); /* saturating minus leaves something where it is bright */
	size_t i = from;

	for (; n - i >= 128; i += 128) {
		const __m256i a = _mm256_max_epu8(load(p + i), load(p + i + 32));
		const __m256i b = _mm256_max_epu8(load(p + i + 64), load(p + i + 96));
		const __m256i over = _mm256_subs_epu8(_mm256_max_epu8(a, b), below);
		if (!_mm256_testz_si256(over, over))
			break;
	}
	for (; n - i >= 32; i += 32) {
		const __m256i over = _mm256_subs_epu8(load(p + i), below);
		const unsigned dark = (unsigned)_mm256_movemask_epi8(_mm256_cmpeq_epi8(over, _mm256_setzero_si256()));
		if (dark != UINT32_MAX)
			return i + (size_t)__builtin_ctz(~dark);
	}
	while (i < n && p[i] < low)
		i++;
	return i;
}
#else
size_t bb_blobs_scan_avx2(const uint8_t *p, size_t from, size_t n, int low)
{
	return bb_blobs_scan_portable(p, from, n, low); /* never chosen here */
}
#endif
