/*
 * render/bricks/build_private.h: what the parts of the builder share. Time nodes are tau, octree nodes of the level
 * under way are numbered from 0 within it. Planes and rows are voxel coordinates of that level.
 */
#ifndef BB_RENDER_BRICKS_BUILD_PRIVATE_H
#define BB_RENDER_BRICKS_BUILD_PRIVATE_H

#include "render/bricks/build.h"
#include "render/bricks/errors.h"
#include "render/bricks/stats.h"

struct bb_build_node { /* of a brick of the level under way: what its parent is made from */
	struct bb_moments moments;
	uint16_t values[BB_STATS_BINS];
};

struct bb_build_space { /* errors against spatial children so far; as sums of signs they fit (errors.h) */
	int32_t part[BB_STATS_BINS + 1], below[BB_STATS_BINS + 1];
};

struct bb_build_slab {              /* planes of all time nodes, as a ring over z */
	uint32_t n_planes, n_rows;  /* of a ring */
	uint32_t n_across;          /* planes across the seam of an angle, after the ring's: the last ones, the first */
	bool has_across;            /* and they are those of y_from .. y_to */
	uint32_t y_from, y_to;      /* rows it holds now */
	uint32_t z_from, z_to;      /* planes it holds now */
	size_t per_plane, per_time; /* floats from one to the next: apart by more than they have */
	float *values;              /* [tau][n_planes + n_across][n_rows][nx] */
};

struct bb_build_brick {          /* of the unit */
	uint32_t here;           /* its octree node, from 0 in the level */
	uint32_t at;             /* from 0 in the unit */
	uint32_t from[3], to[3]; /* its voxels that lie in the volume */
};

struct bb_build {
	const struct bb_build_config *config;
	struct bb_build_report *report;
	struct bb_bricks_header h;
	struct bb_error *err;
	_Atomic enum bb_status status; /* the first failure of any thread */
	unsigned threads;              /* as many as were asked for, or as there is memory for */
	char part[BB_PATH_MAX_BYTES], state[BB_PATH_MAX_BYTES + 8], spill_path[2][BB_PATH_MAX_BYTES + 8];
	int fd, spill[2]; /* spill[level % 2]: the voxels of a level above the leaves, [tau][z][y][x] */
	uint64_t append;  /* where the result ended when the work was begun or gone on with */
	uint64_t held_bytes, since_checkpoint, done; /* done: bricks */
	struct bb_tree_span *span;                   /* [tau] */
	uint32_t *leaf;                              /* [step] its time node */
	struct bb_bricks_record *index;              /* [brick] */
	struct bb_bricks_moments *moments;
	uint32_t cell, n_cells[3]; /* samples: one voxel of the data for each cell of that edge */
	float *samples;            /* [z][y][x][step] */
	uint32_t *depth;           /* [tau] in the time tree */
	struct bb_errors_tree times;

	/* the level under way */
	uint32_t level, n_here, n_above; /* nodes of it and of the next */
	uint32_t tile, y, z;             /* brick rows of a unit along y; where the unit under way begins, in bricks */
	struct bb_build_node *node;      /* [tau][n_here] */
	struct bb_build_space *space;    /* [tau][n_here]: NULL at the leaves */
	struct bb_build_space *space_above; /* [tau][n_above]: being filled */
	struct bb_build_slab slab;
	struct bb_build_work *work; /* [threads] */
	float *half;                /* of the unit, for the next level: [tau][edge / 2][rows / 2][x / 2] */
	uint8_t *histograms;        /* of the unit: [tau][brick][BB_BUILD_HISTOGRAMS_MOST] */
	struct bb_build_output *output;
};

#define BB_BUILD_HISTOGRAMS_MOST ((size_t)BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST)

struct bb_build_work { /* of one thread */
	struct bb_errors errors;
	void *errors_memory;
	float *voxels;   /* a row of bricks, padded; the next two: NULL when that is what is stored */
	uint8_t *stored; /* a brick as the file has it, before it is packed */
	uint8_t *packed; /* a row of bricks as it goes to the file */
	uint16_t (*histograms)[BB_HIST_KINDS][BB_STATS_BINS]; /* [tau] of a brick */
};

/* build_means.c */
void bb_build_fail(struct bb_build *b, enum bb_status status, int number, const char *what); /* by any thread */
/* Counted; zeroed; over the cap is 1447. */
void *bb_build_alloc(struct bb_build *b, size_t n, size_t bytes, const char *what);
void bb_build_release(struct bb_build *b, void *p, size_t n, size_t bytes);
bool bb_build_pread(struct bb_build *b, int fd, void *buf, size_t n, uint64_t at);
bool bb_build_data(struct bb_build *b, uint32_t step, uint32_t z, uint32_t y, uint32_t n, float *out);
bool bb_build_pwrite(struct bb_build *b, int fd, const void *buf, size_t n, uint64_t at);
/* Whether a file is written past the page cache from now on; false: that was so already, or cannot be. */
bool bb_build_past_cache(int fd, bool yes);

static inline bool bb_build_at_leaves(const struct bb_build *b)
{
	return b->level + 1 == b->h.tree.n_levels;
}

static inline size_t bb_build_row_floats(const struct bb_build *b)
{
	return b->h.tree.voxels[b->level][0];
}

#define BB_BUILD_ACROSS 0x80000000u /* z from here on: planes across the seam */

static inline float *bb_build_row(const struct bb_build *b, uint32_t tau, uint32_t z, uint32_t y)
{
	const struct bb_build_slab *s = &b->slab;
	const size_t plane = z < BB_BUILD_ACROSS ? z % s->n_planes : s->n_planes + (z - BB_BUILD_ACROSS);

	return s->values + tau * s->per_time + plane * s->per_plane + (y - s->y_from) * bb_build_row_floats(b);
}

/* How many planes there are across the seam: pad before the first one, pad after the last one. */
static inline uint32_t bb_build_n_across(const struct bb_build *b)
{
	return bb_bricks_wraps(&b->h) ? 2 * b->h.pad : 0;
}

/* Brick rows of the unit under way. */
static inline uint32_t bb_build_unit_rows(const struct bb_build *b)
{
	const uint32_t n = b->h.tree.grid[b->level][1];

	return b->y + b->tile < n ? b->tile : n - b->y;
}

static inline uint32_t bb_build_unit_bricks(const struct bb_build *b)
{
	return bb_build_unit_rows(b) * b->h.tree.grid[b->level][0];
}

/* Floats of the next level's planes and of their rows in the unit. */
static inline size_t bb_build_half_row(const struct bb_build *b)
{
	return (b->h.tree.voxels[b->level][0] + 1) / 2;
}

static inline size_t bb_build_half_plane(const struct bb_build *b)
{
	return (size_t)b->tile * b->h.tree.edge / 2 * bb_build_half_row(b);
}

/* build_slab.c: fills the slab for the unit at (y, z), all time nodes; and what the next level gets from it. */
void bb_build_range(struct bb_build *b); /* least, most, n_nonfinite of the data */
void bb_build_fill(struct bb_build *b);
void bb_build_spill(struct bb_build *b); /* b->half, to the scratch file */

/* build_samples.c: the voxels of the data that the levels above the leaves are compared with. */
struct bb_build_brick bb_build_brick_at(const struct bb_build *b, uint32_t i); /* of the unit */
void bb_build_samples_keep(struct bb_build *b, const struct bb_build_brick *k);
/* Compares all time nodes; how many samples a step has. */
uint32_t bb_build_samples_count(const struct bb_build *b, const struct bb_build_brick *k, struct bb_errors *e);

/* build_tally.c: moments and histograms of the bricks of one row of parents, and their part of b->half. */
uint32_t bb_build_tally_pieces(const struct bb_build *b); /* how many such rows the unit has */
void bb_build_tally(struct bb_build *b, uint32_t piece, unsigned thread);

/* build_write.c: row i of n_times * bb_build_unit_rows of bricks goes to the file; all rows of histograms do. */
void bb_build_write_bricks(struct bb_build *b, size_t i, unsigned thread);
void bb_build_write_histograms(struct bb_build *b);
size_t bb_build_brick_cap(const struct bb_build *b); /* of a packed brick, at most */
bool bb_build_is_stored_as_it_is(const struct bb_build *b);

/*
 * build_output.c: the result's bytes, one after another. open takes the memory, for places of up to `most` bytes; start
 * begins at a place of the file. A thread takes its place at its turn (from 0 after begin) and puts it when it is full;
 * NULL: the build has failed, and all others get the same. flush: all is in the file.
 */
void bb_build_output_open(struct bb_build *b, size_t most);
void bb_build_output_start(struct bb_build *b, uint64_t at);
void bb_build_output_begin(struct bb_build *b);
uint8_t *bb_build_output_take(struct bb_build *b, size_t turn, size_t n, uint64_t *at);
void bb_build_output_put(struct bb_build *b, uint64_t at, size_t n);
void bb_build_output_fail(struct bb_build *b);
uint64_t bb_build_output_end(const struct bb_build *b);
size_t bb_build_output_most(const struct bb_build *b); /* bytes of a place */
void bb_build_output_flush(struct bb_build *b);
void bb_build_output_close(struct bb_build *b);

/* build_state.c */
void bb_build_keep(struct bb_build *b);   /* the state, so that the work can go on another day */
bool bb_build_resume(struct bb_build *b); /* false: there is none that fits; everything is as it was */

#endif
