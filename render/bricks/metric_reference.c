/*
 * render/bricks/metric_reference.c: the reference metrics of a whole file in one pass over its leaves. Equations 9 and
 * 12 need the mean before the distances from it; multiplied out, they need sums only, and sums of a node are those of
 * its children, in either tree. A histogram of values gives the same sums, but for what is within a bin.
 */
#include "render/bricks/metric.h"
#include "render/bricks/values.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEAST_VARIANCE 1e-13 /* below it is rounding: two neighbouring entries in 10^7 voxels are 1e-12 */

enum { SUM_R, SUM_G, SUM_B, SUM_A, SUM_AR, SUM_AG, SUM_AB, SUM_ARGB2, SUM_A2, SUMS };

struct sums {
	double n, of[SUMS];
};

static double square(double v)
{
	return v * v;
}

static void add(struct sums *to, const struct sums *from)
{
	to->n += from->n;
	for (int k = 0; k < SUMS; k++)
		to->of[k] += from->of[k];
}

/* Equation 10 (and 11 to 13 for a voxel); 0 where nothing is seen. */
static double error_of(const struct sums *s)
{
	double m[SUMS];

	for (int k = 0; k < SUMS; k++)
		m[k] = s->of[k] / s->n;
	const double rgb2 = square(m[SUM_R]) + square(m[SUM_G]) + square(m[SUM_B]);
	const double cross = m[SUM_R] * m[SUM_AR] + m[SUM_G] * m[SUM_AG] + m[SUM_B] * m[SUM_AB];
	const double variance = m[SUM_ARGB2] - 2 * cross + m[SUM_A] * rgb2 + m[SUM_A2] - square(m[SUM_A]);
	const double mu = sqrt(m[SUM_A] * rgb2 + square(m[SUM_A]));

	return mu > 0 && variance > LEAST_VARIANCE ? sqrt(variance) / mu : 0;
}

struct work {
	const struct bb_bricks *b;
	const struct bb_tree *t;
	double entry[BB_METRIC_COLOURS][SUMS];
	struct sums *all;          /* [n_bricks] */
	double *over_time;         /* [n_bricks]: sums of the errors of voxels */
	struct bb_tree_span *span; /* [n_times] */
	uint8_t *stored, *entries; /* a brick; [n_steps][edge^3] entries of a leaf */
	float *values;
	struct sums *voxel; /* [n_times] */
};

static void entries_of(const struct bb_metric_colours *c, double entry[BB_METRIC_COLOURS][SUMS])
{
	for (int j = 0; j < BB_METRIC_COLOURS; j++) {
		double *e = entry[j];
		for (int k = 0; k < 4; k++)
			e[k] = (double)c->rgba[j][k];
		for (int k = 0; k < 3; k++)
			e[SUM_AR + k] = e[SUM_A] * e[k];
		e[SUM_ARGB2] = e[SUM_A] * (square(e[0]) + square(e[1]) + square(e[2]));
		e[SUM_A2] = square(e[SUM_A]);
	}
}

static uint8_t entry_of(double v)
{
	return (uint8_t)(v > 0 ? (v < 1 ? v * BB_METRIC_COLOURS : BB_METRIC_COLOURS - 1) : 0);
}

/* The voxels of a leaf that lie in the volume, in one step; returns how many. */
static enum bb_status read_entries(struct work *w, uint32_t node, uint32_t step, size_t *n, struct bb_error *err)
{
	const struct bb_bricks_header *h = bb_bricks_header(w->b);
	const struct bb_tree_place p = bb_tree_place(w->t, node);
	const uint32_t edge = w->t->edge, side = edge + 2 * h->pad;
	const double per = h->most > h->least ? 1 / (h->most - h->least) : 0;
	const uint64_t id = (uint64_t)bb_tree_leaf_time(w->t, step) * w->t->n_nodes + node;
	const enum bb_status status = bb_bricks_read(w->b, id, w->stored, err);
	uint8_t *out = w->entries + (size_t)step * edge * edge * edge;
	uint32_t many[3];

	if (status)
		return status;
	bb_values_load(h, w->stored, (size_t)side * side * side, w->values);
	for (int a = 0; a < 3; a++) {
		const uint32_t left = w->t->dim[a] - p.at[a] * edge;
		many[a] = left < edge ? left : edge;
	}
	*n = 0;
	for (uint32_t z = 0; z < many[2]; z++)
		for (uint32_t y = 0; y < many[1]; y++) {
			const float *row = w->values + ((size_t)(z + h->pad) * side + y + h->pad) * side + h->pad;
			for (uint32_t x = 0; x < many[0]; x++)
				out[(*n)++] = entry_of(((double)row[x] - h->least) * per);
		}
	return BB_OK;
}

static void sum_space(struct work *w, uint32_t node, size_t n)
{
	const size_t cube = (size_t)w->t->edge * w->t->edge * w->t->edge;

	for (uint32_t tau = w->t->n_times; tau-- > 0;) {
		struct sums *s = &w->all[(uint64_t)tau * w->t->n_nodes + node];
		const struct bb_tree_span *span = &w->span[tau];
		if (!bb_tree_is_step(span)) {
			*s = w->all[(uint64_t)span->child[0] * w->t->n_nodes + node];
			add(s, &w->all[(uint64_t)span->child[1] * w->t->n_nodes + node]);
			continue;
		}
		uint32_t count[BB_METRIC_COLOURS] = { 0 };
		for (size_t i = 0; i < n; i++)
			count[w->entries[span->from * cube + i]]++;
		*s = (struct sums){ .n = (double)n };
		for (int j = 0; j < BB_METRIC_COLOURS; j++)
			for (int k = 0; k < SUMS && count[j]; k++)
				s->of[k] += count[j] * w->entry[j][k];
	}
}

/* A voxel that is one entry all the time is never wrong: most are. */
static bool moves(const struct work *w, size_t i, size_t cube)
{
	for (uint32_t step = 1; step < w->t->n_steps; step++)
		if (w->entries[step * cube + i] != w->entries[i])
			return true;
	return false;
}

static void sum_time(struct work *w, uint32_t node, size_t n)
{
	const size_t cube = (size_t)w->t->edge * w->t->edge * w->t->edge;

	for (size_t i = 0; i < n; i++) {
		if (!moves(w, i, cube))
			continue;
		for (uint32_t tau = w->t->n_times; tau-- > 0;) {
			const struct bb_tree_span *span = &w->span[tau];
			struct sums *s = &w->voxel[tau];
			if (bb_tree_is_step(span)) {
				s->n = 1;
				memcpy(s->of, w->entry[w->entries[span->from * cube + i]], sizeof(s->of));
				continue;
			}
			*s = w->voxel[span->child[0]];
			add(s, &w->voxel[span->child[1]]);
			w->over_time[(uint64_t)tau * w->t->n_nodes + node] += error_of(s);
		}
	}
}

static void sum_parents(struct work *w)
{
	for (uint32_t node = w->t->n_nodes; node-- > 1;) { /* children come after their parents */
		const uint32_t parent = bb_tree_parent(w->t, node);
		for (uint32_t tau = 0; tau < w->t->n_times; tau++) {
			const uint64_t row = (uint64_t)tau * w->t->n_nodes;
			add(&w->all[row + parent], &w->all[row + node]);
			w->over_time[row + parent] += w->over_time[row + node];
		}
	}
}

static bool take_memory(struct work *w)
{
	const struct bb_bricks_header *h = bb_bricks_header(w->b);
	const size_t side = w->t->edge + 2 * h->pad, cube = (size_t)w->t->edge * w->t->edge * w->t->edge;

	w->all = calloc(w->t->n_bricks, sizeof(*w->all));
	w->over_time = calloc(w->t->n_bricks, sizeof(*w->over_time));
	w->span = calloc(w->t->n_times, sizeof(*w->span));
	w->voxel = calloc(w->t->n_times, sizeof(*w->voxel));
	w->stored = malloc(bb_bricks_brick_bytes(h));
	w->values = malloc(side * side * side * sizeof(*w->values));
	w->entries = malloc(cube * w->t->n_steps);
	return w->all && w->over_time && w->span && w->voxel && w->stored && w->values && w->entries;
}

static void give_back(struct work *w)
{
	free(w->all);
	free(w->over_time);
	free(w->span);
	free(w->voxel);
	free(w->stored);
	free(w->values);
	free(w->entries);
}

static enum bb_status sum_leaves(struct work *w, struct bb_error *err)
{
	for (uint32_t node = w->t->first[w->t->n_levels - 1]; node < w->t->n_nodes; node++) {
		size_t n = 0;
		for (uint32_t step = 0; step < w->t->n_steps; step++) {
			const enum bb_status status = read_entries(w, node, step, &n, err);
			if (status)
				return status;
		}
		sum_space(w, node, n);
		sum_time(w, node, n);
	}
	return BB_OK;
}

enum bb_status bb_metric_rate_reference(const struct bb_bricks *b, const struct bb_metric_colours *c, float *space,
					float *time, struct bb_error *err)
{
	struct work w = { .b = b, .t = &bb_bricks_header(b)->tree };
	enum bb_status status = take_memory(&w) ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "sums of colours");

	for (uint32_t tau = 0; !status && tau < w.t->n_times; tau++)
		w.span[tau] = bb_tree_span(w.t, tau);
	if (!status) {
		entries_of(c, w.entry);
		status = sum_leaves(&w, err);
	}
	if (!status)
		sum_parents(&w);
	for (uint64_t id = 0; !status && id < w.t->n_bricks; id++) {
		const struct bb_tree_span *s = &w.span[id / w.t->n_nodes];
		space[id] = (float)error_of(&w.all[id]);
		time[id] = (float)(w.over_time[id] * (s->to - s->from) / w.all[id].n);
	}
	give_back(&w);
	return status;
}

/* ---- from histograms ---- */

#define WIDE_BINS 1.0 /* a deviation of fewer: what is within a bin is most of it */

enum bb_status bb_metric_rate_histograms(const struct bb_bricks *b, const struct bb_metric_colours *c, float *space,
					 struct bb_error *err)
{
	enum { PER_BIN = BB_METRIC_COLOURS / BB_STATS_BINS };
	const struct bb_bricks_header *header = bb_bricks_header(b);
	const double narrow = WIDE_BINS * (header->most - header->least) / BB_STATS_BINS;
	double entry[BB_METRIC_COLOURS][SUMS], bin[BB_STATS_BINS][SUMS] = { { 0 } };

	entries_of(c, entry);
	for (int j = 0; j < BB_METRIC_COLOURS; j++)
		for (int k = 0; k < SUMS; k++)
			bin[j / PER_BIN][k] += entry[j][k] / PER_BIN;
	for (uint64_t id = 0; id < header->tree.n_bricks; id++) {
		if ((double)bb_bricks_moments(b)[id].deviation < narrow)
			continue;
		uint16_t h[BB_HIST_KINDS][BB_STATS_BINS];
		const enum bb_status status = bb_bricks_histograms(b, id, h, err);
		struct sums s = { 0 };
		if (status)
			return status;
		for (int j = 0; j < BB_STATS_BINS; j++) {
			s.n += h[BB_HIST_VALUE][j];
			for (int k = 0; k < SUMS && h[BB_HIST_VALUE][j]; k++)
				s.of[k] += h[BB_HIST_VALUE][j] * bin[j][k];
		}
		space[id] = s.n > 0 ? (float)error_of(&s) : 0;
	}
	return BB_OK;
}
