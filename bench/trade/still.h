/*
 * bench/trade/still.h: an atlas of a choice of bricks, read at once and complete: what a selector is worth when nothing
 * streams. What the last choice had and the next one has too is not read again.
 */
#ifndef BB_BENCH_TRADE_STILL_H
#define BB_BENCH_TRADE_STILL_H

#include "render/atlas.h"
#include "render/bricks/bricks.h"
#include "render/bricks/choose.h"

struct bb_still; /* holds an atlas; one thread */

/* For choices of at most so many bricks (both steps on show together). bricks: borrowed. 1450, 1471, 1702. */
BB_MUST_CHECK enum bb_status bb_still_create(const struct bb_bricks *bricks, size_t most, struct bb_still **out,
					     struct bb_error *err);
void bb_still_destroy(struct bb_still *s); /* NULL is allowed */

struct bb_still_counts {
	uint64_t bricks, bytes; /* read now */
	uint64_t in_use;        /* bricks of the choice that have voxels, each counted once */
};

/* step: between the two choices; a whole one shows the first alone, and the second is not read. */
BB_MUST_CHECK enum bb_status bb_still_show(struct bb_still *s, double step, const struct bb_choice *const choice[2],
					   const size_t n[2], struct bb_still_counts *counts, struct bb_error *err);
const struct bb_atlas *bb_still_atlas(const struct bb_still *s);
uint64_t bb_still_bytes(const struct bb_still *s, uint64_t n_bricks); /* that so many bricks and the maps take */

#endif
