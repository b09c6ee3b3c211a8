/* sync/blobs/scan_portable.c: eight pixels in one word, in plain C. */
#include "sync/blobs/blobs_private.h"

#include <string.h>

#define ONES UINT64_C(0x0101010101010101)
#define TOPS UINT64_C(0x8080808080808080)

static uint64_t word(const uint8_t *p)
{
	uint64_t v;

	memcpy(&v, p, sizeof(v));
	return v;
}

/* A byte is at least low where its lower seven bits plus `add` carry into the eighth, or'ed (low <= 128) or and'ed with
 * the eighth itself; no sum leaves its byte. */
size_t bb_blobs_scan_portable(const uint8_t *p, size_t from, size_t n, int low)
{
	const bool dim = low <= 128;
	const uint64_t add = ONES * (uint64_t)(dim ? 128 - low : 256 - low);
	size_t i = from;

	for (; n - i >= 32; i += 32) {
		uint64_t any = 0;
		for (size_t k = 0; k < 32; k += 8) {
			const uint64_t v = word(p + i + k), carry = (v & ~TOPS) + add;
			any |= dim ? carry | v : carry & v;
		}
		if (any & TOPS)
			break;
	}
	while (i < n && p[i] < low)
		i++;
	return i;
}
