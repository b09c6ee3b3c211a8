/*
 * render/bricks/build_private.h: what the parts of the builder share. Time nodes are tau, octree nodes of the level
 * under way are numbered from 0 within it. Planes and rows are voxel coordinates of that level.
 */
#ifndef BB_RENDER_BRICKS_BUILD_PRIVATE_H
#define BB_RENDER_BRICKS_BUILD_PRIVATE_H

#include "render/bricks/build.h"
#include "render/bricks/stats.h"

struct bb_build_node { /* of a brick of the level under way: what its parent is made from */
	struct bb_moments moments;
	uint16_t values[BB_STATS_BINS];
};

struct bb_build_slab {             /* planes of all time nodes, as a ring over z */
	uint32_t n_planes, n_rows; /* of a ring */
	uint32_t n_across;         /* planes across the seam of an angle, after the ring's: the last ones, the first */
	bool has_across;           /* and they are those of y_from .. y_to */
	uint32_t y_from, y_to;     /* rows it holds now */
	uint32_t z_from, z_to;     /* planes it holds now */
	float *values;             /* [tau][n_planes + n_across][n_rows][nx] */
	uint16_t *places;          /* the same: among the bins of histograms */
};

struct bb_build {
	const struct bb_build_config *config;
	struct bb_build_report *report;
	struct bb_bricks_header h;
	struct bb_error *err;
	enum bb_status status; /* the first failure of any thread */
	char part[BB_PATH_MAX_BYTES], state[BB_PATH_MAX_BYTES + 8], spill_path[2][BB_PATH_MAX_BYTES + 8];
	int fd, spill[2]; /* spill[level % 2]: the voxels of a level above the leaves, [tau][z][y][x] */
	uint64_t append;  /* where the result ends so far */
	uint64_t held_bytes, since_checkpoint, done; /* done: bricks */
	struct bb_tree_span *span;                   /* [tau] */
	uint32_t *leaf;                              /* [step] its time node */
	struct bb_bin_scale scale;
	struct bb_bricks_record *index; /* [brick] */
	struct bb_bricks_moments *moments;
	uint32_t cell, n_cells[3]; /* samples: one voxel of the data for each cell of that edge */
	float *samples;            /* [step][z][y][x] */

	/* the level under way */
	uint32_t level, n_here, n_above; /* nodes of it and of the next */
	uint32_t tile, y, z;             /* brick rows of a unit along y; where the unit under way begins, in bricks */
	struct bb_build_node *node;      /* [tau][n_here] */
	struct bb_bins *space;           /* [tau][n_here]: errors against spatial children; NULL at the leaves */
	struct bb_bins *space_above;     /* [tau][n_above]: being filled */
	struct bb_build_slab slab;
	struct bb_build_work *work;     /* [threads] */
	struct bb_build_output *output; /* [BB_BUILD_BATCH] of time nodes being coded */
	uint32_t batch;                 /* the first of them */
};

#define BB_BUILD_BATCH 8

struct bb_build_work {   /* of one thread */
	float *voxels;   /* a brick's own voxels, then all that is stored of it */
	float *rows;     /* a plane of the next level, as far as the slab makes one */
	uint8_t *stored; /* the same as bytes */
	struct bb_bins bins[2]; /* empty between bricks */
};

struct bb_build_output { /* of one time node in a unit */
	uint8_t *bricks; /* as they go to the file */
	size_t n_bricks;
	uint8_t *histograms;
	size_t n_histograms;
};

/* build_means.c */
void bb_build_fail(struct bb_build *b, enum bb_status status, int number, const char *what); /* by any thread */
/* Counted; zeroed; over the cap is 1447. */
void *bb_build_alloc(struct bb_build *b, size_t n, size_t bytes, const char *what);
void bb_build_release(struct bb_build *b, void *p, size_t n, size_t bytes);
bool bb_build_pread(struct bb_build *b, int fd, void *buf, size_t n, uint64_t at);
bool bb_build_data(struct bb_build *b, uint32_t step, uint32_t z, uint32_t y, uint32_t n, float *out);
bool bb_build_pwrite(struct bb_build *b, int fd, const void *buf, size_t n, uint64_t at);

static inline bool bb_build_at_leaves(const struct bb_build *b)
{
	return b->level + 1 == b->h.tree.n_levels;
}

static inline size_t bb_build_row_floats(const struct bb_build *b)
{
	return b->h.tree.voxels[b->level][0];
}

#define BB_BUILD_ACROSS 0x80000000u /* z from here on: planes across the seam */

/* A row of a time node in the slab; z and y lie in it. */
static inline size_t bb_build_offset(const struct bb_build *b, uint32_t tau, uint32_t z, uint32_t y)
{
	const struct bb_build_slab *s = &b->slab;
	const size_t planes = s->n_planes + s->n_across;
	const size_t plane = z < BB_BUILD_ACROSS ? z % s->n_planes : s->n_planes + (z - BB_BUILD_ACROSS);

	return ((tau * planes + plane) * s->n_rows + (y - s->y_from)) * bb_build_row_floats(b);
}

/* How many planes there are across the seam: pad before the first one, pad after the last one. */
static inline uint32_t bb_build_n_across(const struct bb_build *b)
{
	return bb_bricks_wraps(&b->h) ? 2 * b->h.pad : 0;
}

static inline float *bb_build_row(const struct bb_build *b, uint32_t tau, uint32_t z, uint32_t y)
{
	return b->slab.values + bb_build_offset(b, tau, z, y);
}

static inline uint16_t *bb_build_places(const struct bb_build *b, uint32_t tau, uint32_t z, uint32_t y)
{
	return b->slab.places + bb_build_offset(b, tau, z, y);
}

/* build_slab.c: fills the slab for the unit at (y, z), all time nodes; and what the next level gets from it. */
void bb_build_range(struct bb_build *b); /* least, most, n_nonfinite of the data */
void bb_build_fill(struct bb_build *b);
void bb_build_halve(struct bb_build *b);

/* build_emit.c: bricks and statistics of the unit. */
void bb_build_emit(struct bb_build *b);
size_t bb_build_brick_cap(const struct bb_build *b); /* of a packed brick, at most */

/* build_state.c */
void bb_build_keep(struct bb_build *b);   /* the state, so that the work can go on another day */
bool bb_build_resume(struct bb_build *b); /* false: there is none that fits; everything is as it was */

#endif
