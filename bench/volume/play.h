/*
 * bench/volume/play.h: a sequence played once through a selector by tolerance: how much of the volume is not drawn at
 * all, drawn as one colour, drawn from bricks that were there, and from bricks that had to be loaded (table 5 of
 * Ellsworth, Chiang and Shen 2000); and what is loaded when it is played again and memory keeps what was used last.
 */
#ifndef BB_BENCH_VOLUME_PLAY_H
#define BB_BENCH_VOLUME_PLAY_H

#include "render/bricks/selector.h"

struct bb_play {
	double hidden, untextured, reused, loaded; /* shares of all voxels, mean over the steps; their sum is 1 */
	double load_bricks, load_bytes;            /* a step, played for the first time */
	double again_bricks, again_bytes;          /* a step, played once more */
	uint64_t kept_bytes;                       /* of all bricks the sequence needs */
};

struct bb_play_config {
	const struct bb_bricks *b;
	const struct bb_transfer *tf;
	const struct bb_selector *selector;
	const struct bb_ratings *ratings;
	double space_most, time_most;
	uint64_t memory_bytes;
};

BB_MUST_CHECK enum bb_status bb_play(const struct bb_play_config *config, struct bb_play *out, struct bb_error *err);

#endif
