/*
 * render/bricks/choose.h: which bricks stand for the whole volume in one step, by one of several ways that can be
 * compared. Every choice covers each voxel once. Pure functions of their arguments; ties go to the smaller number.
 */
#ifndef BB_RENDER_BRICKS_CHOOSE_H
#define BB_RENDER_BRICKS_CHOOSE_H

#include "render/bricks/tree.h"

struct bb_choice {
	uint32_t node, tau; /* brick tau * n_nodes + node */
	bool flat;          /* by tolerance: even enough to be drawn as its mean */
};

struct bb_choose_budget {
	uint32_t memory_bricks; /* at most so many at a time */
	/* On average at most so many new ones a step, if the whole sequence were played; 0: no limit. */
	double stream_bricks;
	/* [n_nodes]: what to multiply points with (bb_sight_weights, several views at once); NULL: 1. Borrowed. */
	const float *weight;
};

/* So many choices at most, in any case. */
size_t bb_choose_most(const struct bb_tree *t);

/*
 * Greedy on a max-heap of split points (algorithm 1 of Carlsson and Tjernstroem 2016): the split with the most points
 * first, until none fits the memory; one that does not fit the streaming budget is not made. Without a streaming budget
 * a split in time costs nothing and is made before a brick is compared with others: what it shows of the step is then
 * what it is judged by. points as of gain.h. heap and out: bb_choose_most entries. Returns how many.
 */
size_t bb_choose_by_budget(const struct bb_tree *t, const float *space, const float *time, uint32_t step,
			   const struct bb_choose_budget *budget, struct bb_choice *heap, struct bb_choice *out);

/*
 * Depth first (Shen, Chiang and Ma 1999, figure 2 of Ellsworth et al. 2000): the largest bricks in space and time whose
 * errors are tolerated. space and time: errors of all bricks.
 */
size_t bb_choose_by_tolerance(const struct bb_tree *t, const float *space, const float *time, uint32_t step,
			      double space_most, double time_most, struct bb_choice *out);

/* The finest level of the step itself that fits as a whole. */
size_t bb_choose_uniform(const struct bb_tree *t, uint32_t step, uint32_t memory_bricks, struct bb_choice *out);

/*
 * The best there is, for trees of a few hundred bricks: least sum of `cost` of the chosen, at most memory_bricks of
 * them, by dynamic programming over the octree (a subtree's best for each number of bricks). Returns 0 when the tree is
 * too large, or memory too small.
 */
size_t bb_choose_optimum(const struct bb_tree *t, const float *cost, uint32_t step, uint32_t memory_bricks,
			 struct bb_choice *out);

#endif
