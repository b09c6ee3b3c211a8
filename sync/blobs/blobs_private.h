/* sync/blobs/blobs_private.h: parts as they grow, and who looks for bright pixels. For sync/blobs/ only. */
#ifndef BB_SYNC_BLOBS_PRIVATE_H
#define BB_SYNC_BLOBS_PRIVATE_H

#include "sync/blobs/blobs.h"

/* The first index from `from` on whose byte is at least low (1..255); n when there is none before n. */
typedef size_t bb_blobs_scan_fn(const uint8_t *p, size_t from, size_t n, int low);
bb_blobs_scan_fn bb_blobs_scan_portable, bb_blobs_scan_avx2, bb_blobs_scan_avx512;

struct bb_blobs_part { /* sums over its pixels; w = level - (low - 1) */
	uint32_t parent;   /* itself: a root */
	uint32_t last_row;
	uint32_t x0, x1, y0, y1; /* its box, inclusive */
	uint64_t area, w, wx, wy, wxx, wxy, wyy;
	int peak;
};

struct bb_blobs_picture {
	const uint8_t *grey;
	size_t stride_bytes;
	uint32_t width, height;
};

/* Centre, moments and gates of a part that is complete; false: it is no spot. */
bool bb_blobs_measure(const struct bb_blobs_config *c, const struct bb_blobs_picture *pic,
                      const struct bb_blobs_part *part, struct bb_spot *out);

#endif
