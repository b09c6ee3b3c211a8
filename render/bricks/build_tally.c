/*
 * render/bricks/build_tally.c: what a unit's bricks say of their voxels. All time nodes of a brick are counted together
 * (errors.h), two planes by two rows at a time, which become one row of the next level. A piece of work is the bricks
 * of one row of parents, so that no two threads meet in a parent.
 */
#include "render/bricks/build_private.h"

#include <string.h>

static struct bb_build_node *node_of(const struct bb_build *b, uint32_t tau, const struct bb_build_brick *k)
{
	return &b->node[(size_t)tau * b->n_here + k->here];
}

/* ---- voxels ---- */

static void count_voxels(const struct bb_build *b, const struct bb_build_brick *k, struct bb_errors *e)
{
	struct bb_errors_quad q = { .values = bb_build_row(b, 0, k->from[2], k->from[1]) + k->from[0],
				    .per_time = b->slab.per_time,
				    .n = k->to[0] - k->from[0],
				    .leaves = bb_build_at_leaves(b),
				    .half_per_time = b->h.tree.edge / 2 * bb_build_half_plane(b) };
	const float *first = q.values;

	for (uint32_t step = 0; step < b->times.n_steps; step++)
		bb_moment_lanes_begin(&e->lanes[step], first[b->times.leaf[step] * q.per_time]);
	for (uint32_t z = k->from[2]; z < k->to[2]; z += 2)
		for (uint32_t y = k->from[1]; y < k->to[1]; y += 2) {
			q.values = bb_build_row(b, 0, z, y) + k->from[0];
			q.n_rows = 0;
			for (uint32_t dz = 0; dz < 2 && z + dz < k->to[2]; dz++)
				for (uint32_t dy = 0; dy < 2 && y + dy < k->to[1]; dy++)
					q.row[q.n_rows++] =
						(size_t)(bb_build_row(b, 0, z + dz, y + dy) - bb_build_row(b, 0, z, y));
			if (b->level)
				q.half = b->half + (z - k->from[2]) / 2 * bb_build_half_plane(b) +
					 (y - b->y * b->h.tree.edge) / 2 * bb_build_half_row(b) + k->from[0] / 2;
			bb_errors_add(e, &q);
		}
}

/* ---- moments and values ---- */

static void step_moments(const struct bb_build *b, const struct bb_build_brick *k, const struct bb_errors *e)
{
	for (uint32_t step = 0; step < b->times.n_steps; step++) {
		struct bb_build_node *node = node_of(b, b->times.leaf[step], k);
		uint32_t *counts = e->counts + (size_t)step * (BB_STATS_BINS + 1);
		bb_moment_lanes_close(&e->lanes[step], &node->moments);
		counts[BB_STATS_BINS - 1] += counts[BB_STATS_BINS]; /* the largest value is in the last bin */
		bb_counts_close(counts, node->moments.n, node->values);
	}
}

/* Of time nodes from their children, at the leaves. */
static void merge_times(const struct bb_build *b, const struct bb_build_brick *k, const struct bb_errors *e)
{
	for (uint32_t tau = b->times.n_times; tau-- > 0;) {
		if (bb_tree_is_step(&b->span[tau]))
			continue;
		struct bb_build_node *node = node_of(b, tau, k);
		const struct bb_build_node *first = node_of(b, b->span[tau].child[0], k),
					   *second = node_of(b, b->span[tau].child[1], k);
		bb_histogram_merge(first->values, first->moments.n, second->values, second->moments.n, node->values);
		node->moments = first->moments;
		bb_moments_merge(&node->moments, &second->moments);
		const double voxels = node->moments.n / (b->span[tau].to - b->span[tau].from);
		node->moments.time_dev = bb_errors_sum(e, tau, BB_ERRORS_DEVIATION) / voxels;
		node->moments.time_cov = bb_errors_sum(e, tau, BB_ERRORS_VARIATION) / voxels;
	}
}

/* ---- errors ---- */

/* What the parent in space gets of a brick. */
static void give_space(struct bb_build *b, const struct bb_build_brick *k, const struct bb_errors *e)
{
	const struct bb_tree *t = &b->h.tree;
	const uint32_t parent = bb_tree_parent(t, t->first[b->level] + k->here) - t->first[b->level - 1];

	for (uint32_t tau = 0; tau < b->times.n_times; tau++) {
		struct bb_build_space *to = &b->space_above[(size_t)tau * b->n_above + parent];
		struct bb_bin_sums sums = { 0 };
		bb_errors_space(e, tau, &sums);
		for (size_t i = 0; i <= BB_STATS_BINS; i++) {
			to->part[i] += (int32_t)sums.at[i].part;
			to->below[i] += (int32_t)sums.at[i].below;
		}
	}
}

/* Against its spatial children: a child voxel each; eight of them make one of ours. */
static void space_errors(const struct bb_build *b, uint32_t tau, const struct bb_build_brick *k,
			 uint16_t out[BB_STATS_BINS])
{
	const struct bb_build_space *from = &b->space[(size_t)tau * b->n_here + k->here];
	const uint32_t *fine = b->h.tree.voxels[b->level + 1];
	struct bb_bin_sums sums;
	double many = 1;

	for (int a = 0; a < 3; a++) {
		const uint32_t begin = 2 * k->from[a], end = begin + 2 * b->h.tree.edge;
		many *= (end < fine[a] ? end : fine[a]) - begin;
	}
	for (size_t i = 0; i <= BB_STATS_BINS; i++) {
		sums.at[i].part = from->part[i];
		sums.at[i].below = from->below[i];
	}
	bb_bins_close(&sums, many, out);
}

typedef void lanes_of(const struct bb_errors *e, uint32_t tau, struct bb_bin_sums *sums);

static void lane_errors(const struct bb_errors *e, uint32_t tau, lanes_of *lanes, double many,
			uint16_t out[BB_STATS_BINS])
{
	struct bb_bin_sums sums = { 0 };

	lanes(e, tau, &sums);
	bb_bins_close(&sums, many, out);
}

typedef uint16_t histograms[BB_HIST_KINDS][BB_STATS_BINS];

/* From the voxels of the level: all but the errors against leaves, which above the leaves are sampled. */
static void voxel_histograms(const struct bb_build *b, const struct bb_build_brick *k, const struct bb_errors *e,
			     uint32_t tau, histograms h)
{
	const struct bb_tree_span *s = &b->span[tau];
	double voxels = 1;

	for (int a = 0; a < 3; a++)
		voxels *= k->to[a] - k->from[a];
	memcpy(h[BB_HIST_VALUE], node_of(b, tau, k)->values, sizeof(h[BB_HIST_VALUE]));
	if (b->space)
		space_errors(b, tau, k, h[BB_HIST_SPACE]);
	if (bb_tree_is_step(&b->span[tau]))
		return;
	lane_errors(e, tau, bb_errors_time, 2 * voxels, h[BB_HIST_TIME]);
	if (bb_build_at_leaves(b))
		lane_errors(e, tau, bb_errors_leaf, voxels * (s->to - s->from), h[BB_HIST_LEAF]);
}

static void code(struct bb_build *b, const struct bb_build_brick *k, uint32_t tau, histograms h)
{
	const uint64_t id = (uint64_t)tau * b->h.tree.n_nodes + b->h.tree.first[b->level] + k->here;
	uint8_t *out = b->histograms + ((size_t)tau * bb_build_unit_bricks(b) + k->at) * BB_BUILD_HISTOGRAMS_MOST;
	const struct bb_moments *m = &node_of(b, tau, k)->moments;
	size_t n = 0;

	for (int kind = 0; kind < BB_HIST_KINDS; kind++)
		n += bb_histogram_encode(h[kind], out + n);
	b->moments[id] = (struct bb_bricks_moments){ .mean = (float)m->mean,
						     .deviation = (float)bb_moments_deviation(m),
						     .least = m->least,
						     .most = m->most,
						     .time_dev = (float)m->time_dev,
						     .time_cov = (float)m->time_cov,
						     .leaf_error = b->moments[id].leaf_error,
						     .histograms = { 0, (uint32_t)n, bb_crc32c(0, out, n) } };
}

/* ---- a brick ---- */

static void tally_brick(struct bb_build *b, uint32_t i, struct bb_build_work *w)
{
	const struct bb_build_brick k = bb_build_brick_at(b, i);
	const uint64_t first = b->h.tree.first[b->level] + k.here;
	const bool leaves = bb_build_at_leaves(b);
	struct bb_errors *e = &w->errors;
	double many = 0;

	count_voxels(b, &k, e);
	if (leaves) {
		bb_build_samples_keep(b, &k);
		step_moments(b, &k, e);
		merge_times(b, &k, e);
	}
	memset(w->histograms, 0, b->times.n_times * sizeof(*w->histograms));
	for (uint32_t tau = 0; tau < b->times.n_times; tau++)
		voxel_histograms(b, &k, e, tau, w->histograms[tau]);
	if (b->level)
		give_space(b, &k, e);
	if (!leaves) {
		bb_errors_clear(e);
		many = bb_build_samples_count(b, &k, e);
	}
	for (uint32_t tau = 0; tau < b->times.n_times; tau++) {
		const double steps = b->span[tau].to - b->span[tau].from,
			     n = leaves ? node_of(b, tau, &k)->moments.n : many * steps;
		if (!leaves)
			lane_errors(e, tau, bb_errors_sampled, n, w->histograms[tau][BB_HIST_LEAF]);
		b->moments[tau * (uint64_t)b->h.tree.n_nodes + first].leaf_error =
			n > 0 ? (float)(bb_errors_sum(e, tau, BB_ERRORS_APART) / n) : 0;
		code(b, &k, tau, w->histograms[tau]);
	}
	bb_errors_clear(e);
}

uint32_t bb_build_tally_pieces(const struct bb_build *b)
{
	return (b->y + bb_build_unit_rows(b) - 1) / 2 - b->y / 2 + 1;
}

void bb_build_tally(struct bb_build *b, uint32_t piece, unsigned thread)
{
	const uint32_t across = b->h.tree.grid[b->level][0], rows = bb_build_unit_rows(b);
	const uint32_t first = 2 * (b->y / 2 + piece); /* of the two rows with one row of parents */

	for (uint32_t y = first; y < first + 2 && !b->status; y++)
		for (uint32_t x = 0; x < across && y >= b->y && y - b->y < rows; x++)
			tally_brick(b, (y - b->y) * across + x, &b->work[thread]);
}
