/*
 * render/bricks/tree.h: the shape of a brick hierarchy: an octree over space and, in every node, a binary tree over
 * time (the time-space partitioning tree of Shen, Chiang and Ma 1999). Pure arithmetic on dimensions.
 *
 * Space: level n_levels - 1 has the data's own voxels, cut into bricks of edge^3; each level above has half as many
 * voxels per axis, rounded up, down to level 0 with one brick. Any dimensions: nodes at the far faces have fewer
 * children. Within a level nodes are numbered x fastest, then y, then z; levels follow each other from the root down.
 * Time: a node stands for steps from..to-1. It is split before (from + to + 1) / 2; nodes are numbered in pre-order, so
 * that a node's first child is the next one and its second follows the first one's 2 * (steps of it) - 1 nodes. A
 * brick's number is time node * n_nodes + octree node.
 */
#ifndef BB_RENDER_BRICKS_TREE_H
#define BB_RENDER_BRICKS_TREE_H

#include "hal/status.h"

#define BB_TREE_LEVELS_MAX 20
#define BB_TREE_STEPS_MAX 65536
#define BB_TREE_DIM_MAX (1u << 20)
#define BB_TREE_BRICKS_MAX (UINT64_C(1) << 31)
#define BB_TREE_NONE UINT32_MAX

struct bb_tree {
	uint32_t dim[3], n_steps, edge;
	uint32_t n_levels;
	uint32_t voxels[BB_TREE_LEVELS_MAX][3], grid[BB_TREE_LEVELS_MAX][3];
	uint32_t first[BB_TREE_LEVELS_MAX + 1]; /* number of a level's first node */
	uint32_t n_nodes;                       /* octree nodes of one time node */
	uint32_t n_times;                       /* 2 * n_steps - 1 */
	uint64_t n_bricks;
};

struct bb_tree_place { /* an octree node */
	uint32_t level, at[3];
};

struct bb_tree_span { /* a time node */
	uint32_t from, to;
	uint32_t child[2], parent; /* BB_TREE_NONE at a leaf, at the root */
};

static inline bool bb_tree_is_step(const struct bb_tree_span *s)
{
	return s->child[0] == BB_TREE_NONE;
}

/* False: an edge, a dimension or their product is out of range. edge is even, 4..64. */
bool bb_tree_init(struct bb_tree *t, const uint32_t dim[3], uint32_t n_steps, uint32_t edge);
struct bb_tree_place bb_tree_place(const struct bb_tree *t, uint32_t node);
uint32_t bb_tree_node(const struct bb_tree *t, const struct bb_tree_place *p);
/* Children of an octree node, in x, y, z order; returns how many, 0 at a leaf. */
uint32_t bb_tree_children(const struct bb_tree *t, uint32_t node, uint32_t child[8]);
uint32_t bb_tree_parent(const struct bb_tree *t, uint32_t node); /* BB_TREE_NONE: the root */
struct bb_tree_span bb_tree_span(const struct bb_tree *t, uint32_t time);
uint32_t bb_tree_leaf_time(const struct bb_tree *t, uint32_t step);
/* How many of the data's voxels an octree node stands for, in one step. */
uint64_t bb_tree_covered(const struct bb_tree *t, uint32_t node);

#endif
