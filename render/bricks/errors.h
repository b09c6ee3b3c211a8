/*
 * render/bricks/errors.h: counting how wrong a brick is, for all time nodes at once, while its voxels are in the first
 * cache. The histograms are those of stats.h, to the last bit; what is saved is work.
 *
 * A stretch from place a to place b raises the bins below the higher end and lowers those below the lower one. Each
 * voxel's place therefore goes into one word of bins with a sign, +1 where it is the higher end of a stretch and -1
 * where it is the lower one, and what it is compared with goes there with the sum of the opposite signs. A step's voxel
 * is compared with all nodes above it in time and with its parent in space, always at the same place: so bins hold
 * several numbers, lanes, that are added to together.
 *
 * Lanes of a time node's bins:
 *   0        against the parent in space; of samples: of a step, against what is shown of it
 *   1 + d    of a step: against its time node of depth d
 *   1, 2, 3  of a node with children: against its parent in time; its own share of the comparisons with its children,
 *            and with its steps
 * Four lanes are a group: four sums of signs, then the four sums of sign * part of a bin (256ths).
 */
#ifndef BB_RENDER_BRICKS_ERRORS_H
#define BB_RENDER_BRICKS_ERRORS_H

#include "render/bricks/stats.h"
#include "render/bricks/tree.h"

#define BB_ERRORS_WIDTH 8                /* voxels of a row at a time */
#define BB_ERRORS_MOST (INT32_MAX / 255) /* signs that a lane holds, at most */

enum bb_errors_way { BB_ERRORS_PORTABLE, BB_ERRORS_AVX2, BB_ERRORS_AVX512, BB_ERRORS_WAYS };

struct bb_errors_kernel;

struct bb_errors_tree { /* of time; shared by threads */
	uint32_t n_times, n_steps, n_groups;
	const struct bb_tree_span *span; /* [tau] */
	const uint32_t *leaf;            /* [step] its time node */
	const uint32_t *depth;           /* [tau] */
};

struct bb_errors { /* of one brick at a time, by one thread; empty between two */
	const struct bb_errors_tree *t;
	const struct bb_errors_kernel *kernel;
	struct bb_bin_scale scale;
	double floor;                  /* |mean| is at least that in a coefficient of variation */
	uint64_t n_added, n_waiting;   /* signs; and those in bins */
	int32_t *bins;                 /* [tau][BB_STATS_BINS + 1][group][8] */
	int64_t *wide;                 /* the same, what would run over there; NULL: nothing can */
	uint32_t *counts;              /* [step][BB_STATS_BINS + 1] of values */
	double *sums;                  /* [tau][enum bb_errors_sum][8] */
	struct bb_moment_lanes *lanes; /* [step] */
	/* up to four rows of eight voxels that are being counted, [tau][row][8] */
	float *values;
	int32_t *places;
	int32_t *above, *above_signs; /* [tau][8]: places of their parents, each twice; sums of signs */
	int32_t *own;                 /* [tau][2][8]: lanes 2 and 3 */
	int32_t *signs;               /* [x % 4][tau][group][x / 4][4] */
};

/* Sums over voxels: of |deviation| from the mean over time and over steps; of one voxel's deviation over time; of that
 * over its mean. */
enum bb_errors_sum { BB_ERRORS_APART, BB_ERRORS_DEVIATION, BB_ERRORS_VARIATION, BB_ERRORS_SUMS };

struct bb_errors_quad {      /* up to two by two rows that become one of the next level; the first is row 0 */
	const float *values; /* of time node 0 */
	size_t per_time;     /* floats from one time node to the next */
	size_t row[4];       /* where they begin */
	uint32_t n_rows, n;  /* 1, 2 or 4; voxels of each, any number */
	bool leaves;         /* they are the data's own: all that a step is compared with */
	float *half;         /* out: (n + 1) / 2 means of up to eight voxels; NULL at the root */
	size_t half_per_time;
};

/*
 * Bytes for bricks of so many voxels, or of as many samples: where that many times (n_steps + 1) is more than
 * BB_ERRORS_MOST, wider bins lie behind the others, and no more may be added without them. b lies in memory, which is
 * the caller's and zeroed.
 */
size_t bb_errors_bytes(const struct bb_errors_tree *t, uint64_t brick_voxels);
void bb_errors_init(struct bb_errors *b, const struct bb_errors_tree *t, uint64_t brick_voxels,
		    struct bb_bin_scale scale, double range, enum bb_errors_way way, void *memory);
bool bb_errors_has(enum bb_errors_way way);
enum bb_errors_way bb_errors_best(void);

void bb_errors_clear(struct bb_errors *b);
/* Values, errors in space and time, moments of steps at the leaves: b->lanes must have been begun (stats.h). */
void bb_errors_add(struct bb_errors *b, const struct bb_errors_quad *q);
/* n <= 8 samples: values[tau][0][] are what is shown, values[leaf of a step][1][] the data's. */
void bb_errors_sample(struct bb_errors *b, uint32_t n);

/* What was counted, added to the sums. */
void bb_errors_space(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums);
void bb_errors_time(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums);
void bb_errors_leaf(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums);
void bb_errors_sampled(const struct bb_errors *b, uint32_t tau, struct bb_bin_sums *sums);
double bb_errors_sum(const struct bb_errors *b, uint32_t tau, enum bb_errors_sum which);

struct bb_errors_kernel { /* errors_kernel.inc */
	const char *name;
	void (*add)(struct bb_errors *b, const struct bb_errors_quad *q, uint32_t x, uint32_t n);
	void (*sample)(struct bb_errors *b, uint32_t n);
};
extern const struct bb_errors_kernel bb_errors_portable, bb_errors_avx2, bb_errors_avx512;

#endif
