/*
 * render/bricks/build.h: from the steps of a volume to a brick file (format.h), out of core: memory stays under a cap
 * whatever the data's size.
 *
 * Level by level, from the data's own voxels up. A level is walked in slabs of one row of bricks, of all time nodes at
 * once; each slab's bricks are written with their statistics, and it is halved into the next level's voxels, which wait
 * in a scratch file. A coarser voxel is the mean of the (up to eight) it stands for, a time node's voxel the mean over
 * its steps. Errors against leaves are counted exactly at the finest level, above it from some voxels of the data,
 * 512 to 4096 of each step for a brick that lies in the volume as a whole, fewer from 2054 steps on.
 */
#ifndef BB_RENDER_BRICKS_BUILD_H
#define BB_RENDER_BRICKS_BUILD_H

#include "render/bricks/format.h"
#include "render/volume/steps.h"

struct bb_build_report {
	uint64_t bytes_read, bytes_written; /* all of them: data, scratch, result */
	uint64_t result_bytes, peak_bytes;  /* peak: what was asked of the allocator at most */
	uint64_t n_bricks, n_nonfinite;
	bool resumed;
};

struct bb_build_config {
	const struct bb_steps *steps;
	const char *path; /* NAME.bricks; beside it, while it is made: .part, .part.state, .part.0, .part.1 */
	uint32_t edge, pad;
	enum bb_brick_type type;
	enum bb_brick_codec codec;
	enum bb_brick_grid grid; /* with its extent; Cartesian: as the steps have it */
	double extent[6];
	bool has_range; /* least and most are known: the data is read once, not twice */
	double least, most;
	uint64_t memory_bytes;     /* the cap */
	uint64_t checkpoint_bytes; /* the state is kept after so many bytes written; 0: never */
	unsigned threads; /* at most: no more than a quarter of the memory is enough for */
	/* Called between slabs: done of total bricks. False: stop; what is done is kept and goes on at the next call.
	 */
	bool (*progress)(void *ctx, uint64_t done, uint64_t total);
	void *ctx;
};

/* BB_SKIPPED: progress said stop. 1447: the cap is too small, and how large it must be. Other errors leave no result.
 */
BB_MUST_CHECK enum bb_status bb_bricks_build(const struct bb_build_config *config, struct bb_build_report *report,
					     struct bb_error *err);

#endif
