#include "render/bricks/gain.h"
#include "render/bricks/perceived.h"

#include <math.h>

const char *bb_gain_method_text(enum bb_gain_method method)
{
	static const char *const text[BB_GAIN_METHODS] = { "opacity", "leaf", "child" };

	return text[method];
}

const char *bb_gain_colour_text(enum bb_gain_colour colour)
{
	static const char *const text[BB_GAIN_COLOURS] = { "rgb", "lab" };

	return text[colour];
}

void bb_gain_weights(const struct bb_transfer *tf, struct bb_gain_weights *out)
{
	for (int i = 0; i < BB_STATS_BINS; i++) {
		double from[4], here[4], to[4], sum = 0;
		bb_transfer_at(tf, (double)i / BB_STATS_BINS, from);
		bb_transfer_at(tf, (i + 0.5) / BB_STATS_BINS, here);
		bb_transfer_at(tf, (i + 1.0) / BB_STATS_BINS, to);
		for (int k = 0; k < 4; k++)
			sum += (to[k] - from[k]) * (to[k] - from[k]);
		out->opacity[i] = (float)here[3];
		out->change[i] = (float)(sqrt(sum) * BB_STATS_BINS * here[3]);
	}
}

/* A slab over black as it is seen. */
static void look_of(const struct bb_transfer *tf, double v, double lab[3])
{
	double rgba[4], over[3];

	bb_transfer_at(tf, v, rgba);
	const double opacity = bb_transfer_opacity_for_step(rgba[3], BB_GAIN_SLAB_VOXELS);
	for (int k = 0; k < 3; k++)
		over[k] = rgba[k] * opacity;
	bb_perceived_lab(over, lab);
}

void bb_gain_weights_of(const struct bb_transfer *tf, enum bb_gain_colour colour, struct bb_gain_weights *out)
{
	static const double black[3];

	if (colour == BB_GAIN_RGB) {
		bb_gain_weights(tf, out);
		return;
	}
	for (int i = 0; i < BB_STATS_BINS; i++) {
		double from[3], here[3], to[3];
		look_of(tf, (double)i / BB_STATS_BINS, from);
		look_of(tf, (i + 0.5) / BB_STATS_BINS, here);
		look_of(tf, (i + 1.0) / BB_STATS_BINS, to);
		/* Through the middle: a peak within the bin would else be no change. */
		const double way = bb_perceived_distance(from, here) + bb_perceived_distance(here, to);
		out->opacity[i] = (float)(bb_perceived_distance(here, black) / 100);
		out->change[i] = (float)(way / 100 * BB_STATS_BINS);
	}
}

static double weighted(const uint16_t h[BB_STATS_BINS], const float w[BB_STATS_BINS])
{
	float sum = 0;

	for (int i = 0; i < BB_STATS_BINS; i++)
		sum += w[i] * h[i];
	return (double)sum / 65535;
}

static uint64_t voxels_at(const struct bb_tree *t, const struct bb_tree_place *p, uint32_t level)
{
	const uint32_t reach = t->edge << (level - p->level);
	uint64_t n = 1;

	for (int a = 0; a < 3; a++) {
		const uint32_t left = t->voxels[level][a] - p->at[a] * reach;
		n *= left < reach ? left : reach;
	}
	return n;
}

struct brick {
	uint32_t node, tau;
	struct bb_tree_place place;
	struct bb_tree_span span;
	bool splits[2]; /* in space, in time */
};

static struct brick brick_of(const struct bb_tree *t, uint64_t id)
{
	struct brick k = { .node = (uint32_t)(id % t->n_nodes), .tau = (uint32_t)(id / t->n_nodes) };

	k.place = bb_tree_place(t, k.node);
	k.span = bb_tree_span(t, k.tau);
	k.splits[0] = k.place.level + 1 < t->n_levels;
	k.splits[1] = k.span.to - k.span.from > 1;
	return k;
}

/* Points of one brick by what its own histograms say; for leaf errors, the error itself goes to work. */
static enum bb_status own_points(const struct bb_bricks *b, uint64_t id, const struct brick *k,
				 const struct bb_gain_weights *w, enum bb_gain_method method, float *space, float *time,
				 float *work, struct bb_error *err)
{
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];
	const enum bb_status status = bb_bricks_histograms(b, id, h, err);
	const double covered = (double)bb_tree_covered(t, k->node) * (k->span.to - k->span.from);

	if (status)
		return status;
	if (method == BB_GAIN_OPACITY) {
		space[id] = (float)(weighted(h[BB_HIST_VALUE], w->opacity) * covered / 8);
		time[id] = (float)(weighted(h[BB_HIST_VALUE], w->opacity) * covered / 2);
	} else if (method == BB_GAIN_CHILD) {
		const double finer = k->splits[0] ? (double)voxels_at(t, &k->place, k->place.level + 1) : 0;
		const double own = (double)voxels_at(t, &k->place, k->place.level);
		space[id] = (float)(weighted(h[BB_HIST_SPACE], w->change) * finer / 8);
		time[id] = (float)(weighted(h[BB_HIST_TIME], w->change) * 2 * own / 2);
	} else {
		work[id] = (float)(weighted(h[BB_HIST_LEAF], w->change) * covered);
	}
	return BB_OK;
}

static void leaf_points(const struct bb_tree *t, uint64_t id, const struct brick *k, float *space, float *time,
			const float *work)
{
	const uint64_t row = (uint64_t)k->tau * t->n_nodes;
	uint32_t child[8];
	const uint32_t n = bb_tree_children(t, k->node, child);
	double left = (double)work[id];

	for (uint32_t c = 0; c < n; c++)
		left -= (double)work[row + child[c]];
	space[id] = (float)(fmax(left, 0) / 8);
	if (!k->splits[1])
		return;
	left = (double)work[id] - (double)work[(uint64_t)k->span.child[0] * t->n_nodes + k->node] -
	       (double)work[(uint64_t)k->span.child[1] * t->n_nodes + k->node];
	time[id] = (float)(fmax(left, 0) / 2);
}

enum bb_status bb_gain_points(const struct bb_bricks *b, const struct bb_gain_weights *w, enum bb_gain_method method,
			      float *space, float *time, float *work, struct bb_error *err)
{
	const struct bb_tree *t = &bb_bricks_header(b)->tree;

	for (uint64_t id = 0; id < t->n_bricks; id++) {
		const struct brick k = brick_of(t, id);
		const enum bb_status status = own_points(b, id, &k, w, method, space, time, work, err);
		if (status)
			return status;
	}
	for (uint64_t id = 0; id < t->n_bricks; id++) {
		const struct brick k = brick_of(t, id);
		if (method == BB_GAIN_LEAF)
			leaf_points(t, id, &k, space, time, work);
		space[id] = k.splits[0] ? space[id] : -1;
		time[id] = k.splits[1] ? time[id] : -1;
	}
	return BB_OK;
}
