#include "render/bricks/gain.h"
#include "render/bricks/perceived.h"

#include <math.h>
#include <stdlib.h>

const char *bb_gain_method_text(enum bb_gain_method method)
{
	static const char *const text[BB_GAIN_METHODS] = { "opacity", "leaf", "child", "far" };

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

/* Points of one brick by what its own histograms say; for leaf and far errors, the error itself goes to work. */
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

/* ---- far ---- */

/* Of the bricks so many splits below each, what is left of its error, and how many they are. */
struct below {
	float *error, *bricks; /* [n_bricks] */
};

static void begin_below(const struct bb_tree *t, const float *work, struct below *b)
{
	for (uint64_t id = 0; id < t->n_bricks; id++) {
		b->error[id] = work[id];
		b->bricks[id] = 1;
	}
}

/* Children come after their parents, so that they still have the sums of the depth before. */
static void deeper_in_space(const struct bb_tree *t, uint32_t depth, struct below *b)
{
	const uint32_t end = t->first[t->n_levels - depth]; /* nodes below cannot be split so often */

	for (uint32_t node = 0; node < end; node++) {
		uint32_t child[8];
		const uint32_t n = bb_tree_children(t, node, child);
		for (uint32_t tau = 0; tau < t->n_times; tau++) {
			const uint64_t row = (uint64_t)tau * t->n_nodes;
			float error = 0, bricks = 0;
			for (uint32_t c = 0; c < n; c++) {
				error += b->error[row + child[c]];
				bricks += b->bricks[row + child[c]];
			}
			b->error[row + node] = error;
			b->bricks[row + node] = bricks;
		}
	}
}

/* A single step is not split any more and stays what it is. */
static bool deeper_in_time(const struct bb_tree *t, struct below *b)
{
	bool split = false;

	for (uint32_t tau = 0; tau < t->n_times; tau++) {
		const struct bb_tree_span s = bb_tree_span(t, tau);
		const uint64_t row = (uint64_t)tau * t->n_nodes;
		if (s.to - s.from == 1)
			continue;
		const float *error[2] = { b->error + (uint64_t)s.child[0] * t->n_nodes,
					  b->error + (uint64_t)s.child[1] * t->n_nodes };
		const float *bricks[2] = { b->bricks + (uint64_t)s.child[0] * t->n_nodes,
					   b->bricks + (uint64_t)s.child[1] * t->n_nodes };
		for (uint32_t node = 0; node < t->n_nodes; node++) {
			const float many = bricks[0][node] + bricks[1][node];
			split |= many > b->bricks[row + node];
			b->error[row + node] = error[0][node] + error[1][node];
			b->bricks[row + node] = many;
		}
	}
	return split;
}

/* The error that goes away for each brick at this depth, where it is more than at those before. */
static void best_so_far(const struct bb_tree *t, const float *work, const struct below *b, float *points)
{
	for (uint64_t id = 0; id < t->n_bricks; id++) {
		const float gain = (work[id] - b->error[id]) / b->bricks[id];
		if (b->bricks[id] > 1 && gain > points[id])
			points[id] = gain;
	}
}

static enum bb_status far_points(const struct bb_tree *t, const float *work, float *space, float *time,
				 struct bb_error *err)
{
	struct below b = { calloc(t->n_bricks + 1, sizeof(float)), calloc(t->n_bricks + 1, sizeof(float)) };
	const bool memory = b.error && b.bricks;

	for (uint64_t id = 0; id < t->n_bricks; id++)
		space[id] = time[id] = 0;
	if (memory) {
		begin_below(t, work, &b);
		for (uint32_t depth = 1; depth < t->n_levels; depth++) {
			deeper_in_space(t, depth, &b);
			best_so_far(t, work, &b, space);
		}
		begin_below(t, work, &b);
		while (deeper_in_time(t, &b))
			best_so_far(t, work, &b, time);
	}
	free(b.error);
	free(b.bricks);
	return memory ? BB_OK
		      : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "gains of %llu bricks", (unsigned long long)t->n_bricks);
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
	if (method == BB_GAIN_FAR) {
		const enum bb_status status = far_points(t, work, space, time, err);
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

#define LAST_RESORT 0.01F /* of its own error */

void bb_gain_press_on(const float *error, uint64_t n_bricks, float *space, float *time)
{
	for (uint64_t i = 0; i < n_bricks; i++) {
		space[i] = space[i] < 0 ? -1 : fmaxf(space[i], LAST_RESORT * error[i] / 8);
		time[i] = time[i] < 0 ? -1 : fmaxf(time[i], LAST_RESORT * error[i] / 2);
	}
}
