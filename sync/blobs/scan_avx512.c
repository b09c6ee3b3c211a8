/* sync/blobs/scan_avx512.c: 256 pixels a turn, and no tail but a masked one. */
#include "sync/blobs/blobs_private.h"

#ifdef __AVX512BW__
#include <immintrin.h>

size_t bb_blobs_scan_avx512(const uint8_t *p, size_t from, size_t n, int low)
{
	const __m512i least = _mm512_set1_epi8((char)low);
	size_t i = from;

	for (; n - i >= 256; i += 256) {
		const __m512i a = _mm512_max_epu8(_mm512_loadu_si512(p + i), _mm512_loadu_si512(p + i + 64));
		const __m512i b = _mm512_max_epu8(_mm512_loadu_si512(p + i + 128), _mm512_loadu_si512(p + i + 192));
		if (_mm512_cmpge_epu8_mask(_mm512_max_epu8(a, b), least))
			break;
	}
	for (; i < n; i += 64) {
		const __mmask64 in = n - i >= 64 ? UINT64_MAX : (UINT64_C(1) << (n - i)) - 1;
		const __mmask64 hit = _mm512_mask_cmpge_epu8_mask(in, _mm512_maskz_loadu_epi8(in, p + i), least);
		if (hit)
			return i + (size_t)__builtin_ctzll(hit);
	}
	return n;
}
#else
size_t bb_blobs_scan_avx512(const uint8_t *p, size_t from, size_t n, int low)
{
	return bb_blobs_scan_portable(p, from, n, low); /* never chosen here */
}
#endif
