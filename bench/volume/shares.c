/* bench/volume/shares.c: tables 3 to 5: selectors by tolerance at no, a slight and a moderate error of the picture. */
#include "bench/volume/play.h"
#include "bench/volume/tables.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PICTURES 3   /* steps that are looked at */
#define HALVINGS 8   /* of the range of quantiles where a tolerance is looked for */
#define READ_MOST 64 /* bricks, to know what loading one takes */

struct dial { /* the errors there are, sorted: a tolerance is one of them */
	float *error;
	size_t n;
};

struct shares {
	struct bb_tables *t;
	const struct bb_selector *selector;
	float (*reference[PICTURES])[4];
	uint32_t step[PICTURES];
	struct dial space, time;
	double load_us;
};

static int by_value(const void *a, const void *b)
{
	const float *x = a, *y = b;

	return (*x > *y) - (*x < *y);
}

static void fill_dial(struct dial *d, const float *error, uint64_t n)
{
	d->n = 0;
	for (uint64_t i = 0; i < n; i++)
		if (error[i] > 0)
			d->error[d->n++] = error[i];
	qsort(d->error, d->n, sizeof(*d->error), by_value);
}

static double tolerance_at(const struct dial *d, double quantile)
{
	return quantile > 0 && d->n ? (double)d->error[(size_t)((double)(d->n - 1) * quantile)] : 0;
}

/* How far the pictures are from those of the data, on average. */
static enum bb_status look(struct shares *s, double space_most, double time_most, struct bb_look_difference *out,
			   struct bb_error *err)
{
	struct bb_tables *t = s->t;
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;

	*out = (struct bb_look_difference){ 0 };
	for (int k = 0; k < PICTURES; k++) {
		const struct bb_selector_ask ask = { .step = s->step[k],
						     .space_most = space_most,
						     .time_most = time_most };
		const size_t n = s->selector->choose(tree, &t->ratings, &ask, t->heap, t->out);
		const enum bb_status status = bb_look_fill(&t->look, t->out, n, err);
		if (status)
			return status;
		bb_look_cast(&t->look, t->tf, t->picture);
		const struct bb_look_difference d = bb_look_compare(
			(const float(*)[4])t->picture, (const float(*)[4])s->reference[k], bb_look_pixels(&t->look));
		out->luv += d.luv / PICTURES;
		out->psnr_db += d.psnr_db / PICTURES;
		out->n_pixels += d.n_pixels;
	}
	return BB_OK;
}

/* The largest tolerance, as a quantile of the errors, that stays within a distance; the other one is held. */
static enum bb_status reach(struct shares *s, bool in_time, double held, double luv, double *out, struct bb_error *err)
{
	const struct dial *d = in_time ? &s->time : &s->space;
	double low = 0, high = 1, at = 1;

	for (int k = 0; k <= HALVINGS; k++) {
		struct bb_look_difference here;
		const double tolerance = tolerance_at(d, at);
		const enum bb_status status =
			look(s, in_time ? held : tolerance, in_time ? tolerance : held, &here, err);
		if (status)
			return status;
		*(here.luv <= luv ? &low : &high) = at;
		if (low >= high)
			break;
		at = (low + high) / 2;
	}
	*out = tolerance_at(d, low);
	return BB_OK;
}

static json_t *row_of(const struct shares *s, const char *error, double space, double time,
		      const struct bb_look_difference *d, const struct bb_play *p)
{
	return json_pack("{s:s, s:s, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}",
			 "selector", s->selector->name, "error", error, "space_most", space, "time_most", time, "luv",
			 d->luv, "psnr_db", d->psnr_db, "not_rendered", 100 * p->hidden, "untextured",
			 100 * p->untextured, "reused", 100 * p->reused, "loaded", 100 * p->loaded, "load_bricks",
			 p->load_bricks, "load_mib", p->load_bytes / 1048576, "load_ms",
			 p->load_bricks * s->load_us * 1e-3, "again_bricks", p->again_bricks, "again_mib",
			 p->again_bytes / 1048576, "again_ms", p->again_bricks * s->load_us * 1e-3, "kept_mib",
			 (double)p->kept_bytes / 1048576);
}

static enum bb_status measure(struct shares *s, const char *error, double luv, json_t *rows, struct bb_error *err)
{
	struct bb_tables *t = s->t;
	double space = 0, time = 0;
	struct bb_look_difference d;
	struct bb_play p;
	enum bb_status status = BB_OK;

	if (luv > 0) /* half of it may come from time */
		status = reach(s, true, 0, luv / 2, &time, err);
	if (!status && luv > 0)
		status = reach(s, false, time, luv, &space, err);
	if (!status)
		status = look(s, space, time, &d, err);
	if (!status)
		status = bb_play(&(struct bb_play_config){ t->b, t->tf, s->selector, &t->ratings, space, time,
							   BB_TABLES_MEMORY_BYTES },
				 &p, err);
	if (!status)
		json_array_append_new(rows, row_of(s, error, space, time, &d, &p));
	return status;
}

static enum bb_status measure_selector(struct shares *s, const char *name, json_t *rows, struct bb_error *err)
{
	const uint64_t n = bb_bricks_header(s->t->b)->tree.n_bricks;

	s->selector = bb_selector_find(name);
	if (s->t->progress)
		s->t->progress(name);
	enum bb_status status = s->selector->rate(s->t->b, s->t->tf, &s->t->ratings, err);
	if (status)
		return status;
	fill_dial(&s->space, s->t->ratings.space, n);
	fill_dial(&s->time, s->t->ratings.time, n);
	status = measure(s, "zero", 0, rows, err);
	if (!status)
		status = measure(s, "slight", BB_TABLES_SLIGHT_LUV, rows, err);
	if (!status)
		status = measure(s, "moderate", BB_TABLES_MODERATE_LUV, rows, err);
	return status;
}

/* The pictures of the data itself. */
static enum bb_status look_at_all(struct shares *s, struct bb_error *err)
{
	struct bb_tables *t = s->t;
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	enum bb_status status = BB_OK;

	for (int k = 0; k < PICTURES && !status; k++) {
		s->step[k] = (2 * (uint32_t)k + 1) * tree->n_steps / (2 * PICTURES);
		const size_t n = bb_choose_uniform(tree, s->step[k], UINT32_MAX, t->out);
		status = bb_look_fill(&t->look, t->out, n, err);
		if (!status)
			bb_look_cast(&t->look, t->tf, s->reference[k]);
	}
	return status;
}

/* A brick from the page cache into memory; the least of three rounds. */
static enum bb_status time_loads(struct shares *s, struct bb_error *err)
{
	const struct bb_tables *t = s->t;
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	const uint64_t first = tree->first[tree->n_levels - 1], left = tree->n_nodes - first;
	const uint64_t n = left < READ_MOST ? left : READ_MOST;

	s->load_us = (double)INFINITY;
	for (int k = 0; k < 3; k++) {
		const int64_t from_ns = bb_clock_now_ns(t->clk);
		for (uint64_t i = 0; i < n; i++) {
			const enum bb_status status = bb_bricks_read(t->b, first + i, t->look.stored, err);
			if (status)
				return status;
		}
		s->load_us = fmin(s->load_us, (double)(bb_clock_now_ns(t->clk) - from_ns) * 1e-3 / (double)n);
	}
	return BB_OK;
}

enum bb_status bb_tables_shares(struct bb_tables *t, json_t **out, struct bb_error *err)
{
	static const char *const names[] = { "scalar", "colour-reference", "colour", "colour-local" };
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	const double step_mib = (double)tree->dim[0] * tree->dim[1] * tree->dim[2] / 1048576;
	struct shares s = { .t = t };
	json_t *rows = json_array();
	enum bb_status status;
	bool memory;

	s.space.error = calloc(tree->n_bricks, sizeof(float));
	s.time.error = calloc(tree->n_bricks, sizeof(float));
	memory = s.space.error && s.time.error && rows;
	for (int k = 0; k < PICTURES; k++) {
		s.reference[k] = calloc(bb_look_pixels(&t->look), sizeof(*s.reference[k]));
		memory = memory && s.reference[k];
	}
	status = memory ? look_at_all(&s, err) : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "pictures");
	if (!status)
		status = time_loads(&s, err);
	for (size_t i = 0; i < BB_ARRAY_LEN(names) && !status; i++)
		status = measure_selector(&s, names[i], rows, err);
	for (int k = 0; k < PICTURES; k++)
		free(s.reference[k]);
	free(s.space.error);
	free(s.time.error);
	if (status) {
		json_decref(rows);
		return status;
	}
	*out = json_pack("{s:f, s:f, s:f, s:f, s:o}", "brick_us", s.load_us, "step_mib", step_mib, "sequence_mib",
			 step_mib * tree->n_steps, "memory_mib", (double)BB_TABLES_MEMORY_BYTES / 1048576, "rows",
			 rows);
	return BB_OK;
}
