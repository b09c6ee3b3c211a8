/*
 * render/bricks/build_emit.c: the bricks of a unit with their statistics. First the moments and values of single steps,
 * then time nodes from their children, then errors and bytes of each time node, several at a time; what is ready goes
 * to the file in order, so that it is the same whatever the number of threads.
 */
#include "render/bricks/build_private.h"
#include "render/bricks/values.h"
#include "render/parallel.h"

#include <math.h>
#include <string.h>

struct brick {                   /* of the unit */
	uint32_t tau, here;      /* its octree node, from 0 in the level */
	uint32_t from[3], to[3]; /* its voxels that lie in the volume */
};

static struct brick brick_at(const struct bb_build *b, uint32_t tau, uint32_t i)
{
	const struct bb_tree *t = &b->h.tree;
	const uint32_t *grid = t->grid[b->level], *v = t->voxels[b->level];
	const uint32_t at[3] = { i % grid[0], b->y + i / grid[0], b->z };
	struct brick k = { .tau = tau, .here = (at[2] * grid[1] + at[1]) * grid[0] + at[0] };

	for (int a = 0; a < 3; a++) {
		k.from[a] = at[a] * t->edge;
		k.to[a] = k.from[a] + t->edge < v[a] ? k.from[a] + t->edge : v[a];
	}
	return k;
}

static uint32_t bricks_of_unit(const struct bb_build *b)
{
	const uint32_t *grid = b->h.tree.grid[b->level];
	const uint32_t rows = b->y + b->tile < grid[1] ? b->tile : grid[1] - b->y;

	return rows * grid[0];
}

static struct bb_build_node *node_of(const struct bb_build *b, const struct brick *k)
{
	return &b->node[(size_t)k->tau * b->n_here + k->here];
}

/* ---- single steps, at the leaves ---- */

static uint32_t spread(uint32_t h) /* a finaliser of MurmurHash3's kind: all bits of h in all of the result */
{
	h = (h ^ h >> 16) * 0x7FEB352Du;
	h = (h ^ h >> 15) * 0x846CA68Bu;
	return h ^ h >> 16;
}

/* Which voxel of a cell stands for it: any, but always the same. */
static bool sample_of(const struct bb_build *b, const uint32_t cell[3], uint32_t at[3])
{
	uint32_t h = 1;

	for (int a = 0; a < 3; a++) {
		h = spread(h + cell[a]);
		at[a] = cell[a] * b->cell + h % b->cell;
		if (at[a] >= b->h.tree.dim[a])
			return false;
	}
	return true;
}

static float *sample_slot(const struct bb_build *b, uint32_t step, const uint32_t cell[3])
{
	return b->samples + (((size_t)step * b->n_cells[2] + cell[2]) * b->n_cells[1] + cell[1]) * b->n_cells[0] +
	       cell[0];
}

/* Cells that begin within from .. to of level-`level` voxels. */
static void cells_of(const struct bb_build *b, const struct brick *k, uint32_t from[3], uint32_t to[3])
{
	const uint32_t shift = b->h.tree.n_levels - 1 - b->level;

	for (int a = 0; a < 3; a++) {
		const uint64_t end = ((uint64_t)k->to[a] << shift) + b->cell - 1;
		from[a] = (uint32_t)(((uint64_t)k->from[a] << shift) / b->cell);
		to[a] = (uint32_t)(end / b->cell < b->n_cells[a] ? end / b->cell : b->n_cells[a]);
	}
}

static void keep_samples(const struct bb_build *b, const struct brick *k, uint32_t step)
{
	uint32_t from[3], to[3], at[3], cell[3];

	cells_of(b, k, from, to);
	for (cell[2] = from[2]; cell[2] < to[2]; cell[2]++)
		for (cell[1] = from[1]; cell[1] < to[1]; cell[1]++)
			for (cell[0] = from[0]; cell[0] < to[0]; cell[0]++)
				if (sample_of(b, cell, at))
					*sample_slot(b, step, cell) = bb_build_row(b, k->tau, at[2], at[1])[at[0]];
}

static void step_statistics(void *ctx, size_t step, unsigned thread)
{
	struct bb_build *b = ctx;
	const uint32_t tau = b->leaf[step], n = bricks_of_unit(b);
	struct bb_build_work *w = &b->work[thread];

	for (uint32_t i = 0; i < n; i++) {
		const struct brick k = brick_at(b, tau, i);
		struct bb_build_node *node = node_of(b, &k);
		const size_t nx = k.to[0] - k.from[0];
		size_t count = 0;
		for (uint32_t z = k.from[2]; z < k.to[2]; z++)
			for (uint32_t y = k.from[1]; y < k.to[1]; y++, count += nx)
				memcpy(w->voxels + count, bb_build_row(b, tau, z, y) + k.from[0], nx * sizeof(float));
		bb_moments_of(w->voxels, count, &node->moments);
		uint32_t counts[BB_STATS_BINS] = { 0 };
		for (size_t v = 0; v < count; v++)
			bb_bins_count(counts, bb_bin_place(&b->scale, w->voxels[v]));
		bb_counts_close(counts, (double)count, node->values);
		keep_samples(b, &k, (uint32_t)step);
	}
}

/* ---- time nodes from their children, at the leaves ---- */

static void merge_times(void *ctx, size_t i, unsigned thread)
{
	struct bb_build *b = ctx;
	(void)thread;

	for (uint32_t tau = b->h.tree.n_times; tau-- > 0;) {
		const struct brick k = brick_at(b, tau, (uint32_t)i);
		struct bb_build_node *node = node_of(b, &k);
		if (b->span[tau].child[0] == BB_TREE_NONE)
			continue;
		const struct bb_build_node *first = &b->node[(size_t)b->span[tau].child[0] * b->n_here + k.here];
		const struct bb_build_node *second = &b->node[(size_t)b->span[tau].child[1] * b->n_here + k.here];
		bb_histogram_merge(first->values, first->moments.n, second->values, second->moments.n, node->values);
		node->moments = first->moments;
		bb_moments_merge(&node->moments, &second->moments);
	}
}

/* ---- errors ---- */

/* n more stretches are in the bins: they go to the sums before a word of them could run over. */
static void have_added(struct bb_bins bins[2], struct bb_bin_sums *sums, uint32_t *waiting, uint32_t n)
{
	*waiting += n;
	if (*waiting <= BB_BINS_MOST / 2)
		return;
	bb_bins_spill(bins, 2, sums);
	*waiting = 0;
}

/* Over all steps of a time node, at the leaves: each voxel's deviation from its mean over time, and how far that is
 * wrong. */
static double leaf_errors(const struct bb_build *b, const struct brick *k, struct bb_bins bins[2],
			  struct bb_bin_sums *sums, struct bb_moments *m)
{
	const struct bb_tree_span *s = &b->span[k->tau];
	const double steps = s->to - s->from, floor = 1e-3 * (b->h.most - b->h.least);
	double apart = 0, dev = 0, cov = 0;
	uint32_t waiting = 0;

	if (steps <= 1) /* a leaf is never wrong */
		return 0;
	for (uint32_t z = k->from[2]; z < k->to[2]; z++)
		for (uint32_t y = k->from[1]; y < k->to[1]; y++) {
			double square[64] = { 0 }, away[64] = { 0 };
			const float *mean = bb_build_row(b, k->tau, z, y) + k->from[0];
			const uint16_t *here = bb_build_places(b, k->tau, z, y) + k->from[0];
			const uint32_t nx = k->to[0] - k->from[0];
			for (uint32_t step = s->from; step < s->to; step++) {
				const uint32_t tau = b->leaf[step];
				const float *v = bb_build_row(b, tau, z, y) + k->from[0];
				const uint16_t *there = bb_build_places(b, tau, z, y) + k->from[0];
				for (uint32_t x = 0; x < nx; x++) {
					const double d = (double)v[x] - (double)mean[x];
					square[x] += d * d;
					away[x] += fabs(d);
				}
				bb_bins_spans(bins, here, there, nx);
			}
			have_added(bins, sums, &waiting, nx * (s->to - s->from));
			for (uint32_t x = 0; x < nx; x++) {
				const double sigma = sqrt(square[x] / steps),
					     level = fmax(fabs((double)mean[x]), floor);
				apart += away[x];
				dev += sigma;
				cov += sigma > 0 && level > 0 ? sigma / level : 0;
			}
		}
	const double voxels = m->n / steps;
	m->time_dev = dev / voxels;
	m->time_cov = cov / voxels;
	return apart / m->n;
}

/* Above the leaves, from the voxels of the data that were kept. */
static double sampled_errors(const struct bb_build *b, const struct brick *k, struct bb_bins bins[2],
			     struct bb_bin_sums *sums, double *n)
{
	const uint32_t shift = b->h.tree.n_levels - 1 - b->level;
	const struct bb_tree_span *s = &b->span[k->tau];
	uint32_t from[3], to[3], at[3], cell[3];
	double apart = 0;
	uint32_t waiting = 0;

	cells_of(b, k, from, to);
	for (cell[2] = from[2]; cell[2] < to[2]; cell[2]++)
		for (cell[1] = from[1]; cell[1] < to[1]; cell[1]++)
			for (cell[0] = from[0]; cell[0] < to[0]; cell[0]++) {
				if (!sample_of(b, cell, at))
					continue;
				const float shown =
					bb_build_row(b, k->tau, at[2] >> shift, at[1] >> shift)[at[0] >> shift];
				const uint16_t place = bb_bin_place(&b->scale, shown);
				for (uint32_t step = s->from; step < s->to; step++) {
					const float v = *sample_slot(b, step, cell);
					bb_bins_span(&bins[step % 2], place, bb_bin_place(&b->scale, v));
					apart += fabs((double)v - (double)shown);
				}
				*n += s->to - s->from;
				have_added(bins, sums, &waiting, s->to - s->from);
			}
	return *n > 0 ? apart / *n : 0;
}

/* Against its two temporal children, which have the same voxels. Returns the number of comparisons. */
static double time_errors(const struct bb_build *b, const struct brick *k, struct bb_bins bins[2])
{
	const struct bb_tree_span *s = &b->span[k->tau];
	double n = 0;

	for (int c = 0; c < 2 && s->child[c] != BB_TREE_NONE; c++)
		for (uint32_t z = k->from[2]; z < k->to[2]; z++)
			for (uint32_t y = k->from[1]; y < k->to[1]; y++) {
				const uint16_t *here = bb_build_places(b, k->tau, z, y) + k->from[0];
				const uint16_t *child = bb_build_places(b, s->child[c], z, y) + k->from[0];
				bb_bins_spans(bins, here, child, k->to[0] - k->from[0]);
				n += k->to[0] - k->from[0];
			}
	return n;
}

/* All four histograms of a brick, coded; and its moments as the file has them. */
static size_t statistics(struct bb_build *b, const struct brick *k, struct bb_build_work *w,
			 struct bb_bricks_moments *m, uint8_t *out)
{
	struct bb_build_node *node = node_of(b, k);
	const struct bb_tree_span *s = &b->span[k->tau];
	uint16_t leaf[BB_STATS_BINS], h[BB_STATS_BINS];
	size_t n = bb_histogram_encode(node->values, out);
	struct bb_bin_sums sums = { 0 };
	double many = 0, error;

	if (bb_build_at_leaves(b)) {
		many = node->moments.n;
		error = leaf_errors(b, k, w->bins, &sums, &node->moments);
	} else {
		error = sampled_errors(b, k, w->bins, &sums, &many);
	}
	bb_bins_spill(w->bins, 2, &sums);
	bb_bins_close(&sums, many, leaf);
	n += bb_histogram_encode(leaf, out + n);
	if (b->space) { /* a child voxel each; eight of them make one of ours */
		struct bb_bins *bins = &b->space[(size_t)k->tau * b->n_here + k->here];
		const struct bb_tree_place p = bb_tree_place(&b->h.tree, b->h.tree.first[b->level] + k->here);
		const uint32_t *fine = b->h.tree.voxels[b->level + 1];
		many = 1;
		for (int a = 0; a < 3; a++) {
			const uint32_t from = 2 * p.at[a] * b->h.tree.edge, to = from + 2 * b->h.tree.edge;
			many *= (to < fine[a] ? to : fine[a]) - from;
		}
		sums = (struct bb_bin_sums){ 0 };
		bb_bins_spill(bins, 1, &sums);
		bb_bins_close(&sums, many, h);
	} else {
		memset(h, 0, sizeof(h));
	}
	n += bb_histogram_encode(h, out + n);
	if (bb_build_at_leaves(b) && s->to - s->from <= 2) { /* its children are the leaves */
		n += bb_histogram_encode(leaf, out + n);
	} else {
		sums = (struct bb_bin_sums){ 0 };
		many = time_errors(b, k, w->bins);
		bb_bins_spill(w->bins, 2, &sums);
		bb_bins_close(&sums, many, h);
		n += bb_histogram_encode(h, out + n);
	}
	*m = (struct bb_bricks_moments){ .mean = (float)node->moments.mean,
					 .deviation = (float)bb_moments_deviation(&node->moments),
					 .least = node->moments.least,
					 .most = node->moments.most,
					 .time_dev = (float)node->moments.time_dev,
					 .time_cov = (float)node->moments.time_cov,
					 .leaf_error = (float)error };
	return n;
}

/* ---- bytes ---- */

static uint32_t held(int64_t at, uint32_t n)
{
	return at < 0 ? 0 : at >= n ? n - 1 : (uint32_t)at;
}

/* The plane of the slab that has z, which may lie outside the volume. */
static uint32_t plane_held(const struct bb_build *b, int64_t z)
{
	const int64_t n = b->h.tree.voxels[b->level][2], pad = b->h.pad;

	if (!b->slab.n_across || (z >= 0 && z < n))
		return held(z, (uint32_t)n);
	if (z < 0)
		return BB_BUILD_ACROSS + (uint32_t)(z + pad);
	return BB_BUILD_ACROSS + (uint32_t)(z < n + pad ? z - n + pad : 2 * pad - 1);
}

/* A brick with its padding; outside the volume the nearest voxel, or the one across the seam. */
static void gather(const struct bb_build *b, const struct brick *k, float *out)
{
	const uint32_t *v = b->h.tree.voxels[b->level], edge = b->h.tree.edge, pad = b->h.pad;
	const uint32_t side = edge + 2 * pad,
		       before = k->from[0] < pad ? pad - k->from[0] : 0; /* columns left of the volume */
	const uint32_t first = k->from[0] + before - pad, left = v[0] - first;
	const uint32_t n = left < side - before ? left : side - before;

	for (int64_t z = -(int64_t)pad; z < (int64_t)edge + pad; z++)
		for (int64_t y = -(int64_t)pad; y < (int64_t)edge + pad; y++, out += side) {
			const float *row =
				bb_build_row(b, k->tau, plane_held(b, k->from[2] + z), held(k->from[1] + y, v[1])) +
				first;
			memcpy(out + before, row, n * sizeof(float));
			for (uint32_t x = 0; x < before; x++)
				out[x] = row[0];
			for (uint32_t x = before + n; x < side; x++)
				out[x] = row[n - 1];
		}
}

size_t bb_build_brick_cap(const struct bb_build *b)
{
	return bb_values_packed_cap(b->h.codec, bb_bricks_brick_bytes(&b->h));
}

/* Bricks, histograms and records of one time node; offsets are relative until they are appended. */
static void code_time(void *ctx, size_t i, unsigned thread)
{
	struct bb_build *b = ctx;
	const struct bb_tree *t = &b->h.tree;
	const uint32_t tau = b->batch + (uint32_t)i, n = bricks_of_unit(b);
	const size_t side = t->edge + 2 * b->h.pad;
	struct bb_build_work *w = &b->work[thread];
	struct bb_build_output *o = &b->output[i];

	o->n_bricks = o->n_histograms = 0;
	for (uint32_t j = 0; j < n && !b->status; j++) {
		const struct brick k = brick_at(b, tau, j);
		const uint64_t id = (uint64_t)tau * t->n_nodes + t->first[b->level] + k.here;
		struct bb_bricks_record *r = &b->index[id];
		struct bb_bricks_moments *m = &b->moments[id];
		uint8_t *histograms = o->histograms + o->n_histograms;
		const size_t n_histograms = statistics(b, &k, w, m, histograms);
		m->histograms = (struct bb_bricks_record){ o->n_histograms, (uint32_t)n_histograms,
							   bb_crc32c(0, histograms, n_histograms) };
		o->n_histograms += n_histograms;
		gather(b, &k, w->voxels);
		bb_values_store(&b->h, w->voxels, side * side * side, w->stored);
		const size_t packed =
			bb_values_pack(b->h.codec, w->stored, bb_bricks_brick_bytes(&b->h), o->bricks + o->n_bricks);
		if (!packed)
			bb_build_fail(b, BB_ERR_INTERNAL, 1448, "packing a brick");
		*r = (struct bb_bricks_record){ o->n_bricks, (uint32_t)packed,
						bb_crc32c(0, o->bricks + o->n_bricks, packed) };
		o->n_bricks += packed;
	}
}

static void append_time(struct bb_build *b, uint32_t tau, const struct bb_build_output *o)
{
	const struct bb_tree *t = &b->h.tree;
	const uint32_t n = bricks_of_unit(b);

	for (uint32_t j = 0; j < n; j++) {
		const struct brick k = brick_at(b, tau, j);
		const uint64_t id = (uint64_t)tau * t->n_nodes + t->first[b->level] + k.here;
		b->index[id].offset += b->append;
		b->moments[id].histograms.offset += b->append + o->n_bricks;
	}
	if (bb_build_pwrite(b, b->fd, o->bricks, o->n_bricks, b->append) &&
	    bb_build_pwrite(b, b->fd, o->histograms, o->n_histograms, b->append + o->n_bricks))
		b->append += o->n_bricks + o->n_histograms;
}

void bb_build_emit(struct bb_build *b)
{
	const uint32_t n_times = b->h.tree.n_times;

	if (bb_build_at_leaves(b)) {
		bb_parallel(b->config->threads, b->h.tree.n_steps, step_statistics, b);
		bb_parallel(b->config->threads, bricks_of_unit(b), merge_times, b);
	}
	for (uint32_t tau = 0; tau < n_times && !b->status; tau += BB_BUILD_BATCH) {
		const uint32_t n = n_times - tau < BB_BUILD_BATCH ? n_times - tau : BB_BUILD_BATCH;
		b->batch = tau;
		bb_parallel(b->config->threads, n, code_time, b);
		for (uint32_t i = 0; i < n && !b->status; i++)
			append_time(b, tau + i, &b->output[i]);
	}
	b->done += (uint64_t)bricks_of_unit(b) * n_times;
}
