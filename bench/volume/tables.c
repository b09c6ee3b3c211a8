#include "bench/volume/tables.h"
#include "bench/volume/rank.h"
#include "render/bricks/build.h"
#include "render/parallel.h"

#include <math.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <unistd.h>

#define REPEATS 5

const struct bb_tables_set bb_tables_sets[] = {
	{ "small-delta", "delta", "delta", { 111, 126, 51 }, 30, 0 },
	{ "large-delta", "delta", "delta", { 222, 253, 103 }, 12, 0 },
	{ "f18", "wing", "wing", { 402, 135, 103 }, 12, 0 },
	{ "shock", "shock", "shock", { 512, 64, 64 }, 25, 0 },
	{ "enlil", "enlil", "enlil", { 256, 256, 256 }, 8, 8 },
	{ NULL, NULL, NULL, { 0 }, 0, 0 },
};

static uint32_t scaled(uint32_t n, double scale, uint32_t least)
{
	const double of = rint(n * scale / 100);

	return of > least ? (uint32_t)of : least;
}

enum bb_status bb_tables_build(const struct bb_tables_set *set, double scale, uint32_t brick, const char *path,
			       struct bb_error *err)
{
	const uint32_t dim[3] = { scaled(set->dim[0], scale, 8), scaled(set->dim[1], scale, 8),
				  scaled(set->dim[2], scale, 8) };
	struct bb_build_config config = { .path = path,
					  .edge = brick,
					  .pad = 1,
					  .type = BB_BRICK_U8, /* as theirs */
					  .memory_bytes = UINT64_C(512) << 20,
					  .threads = bb_parallel_processors() };
	struct bb_build_report report;
	struct bb_steps *steps = NULL;
	enum bb_status status = bb_steps_generate(set->kind, dim, scaled(set->n_steps, scale, 4), &steps, err);

	config.steps = steps;
	if (!status)
		status = bb_bricks_build(&config, &report, err);
	bb_steps_close(steps);
	return status;
}

enum bb_status bb_tables_begin(struct bb_tables *t, const char *path, const struct bb_transfer *tf,
			       struct bb_clock *clk, struct bb_error *err)
{
	*t = (struct bb_tables){ .tf = tf, .clk = clk };
	enum bb_status status = bb_bricks_open(path, &t->b, err);
	if (!status)
		status = bb_look_begin(&t->look, t->b, err);
	if (status)
		return status;
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	t->ratings = (struct bb_ratings){ calloc(tree->n_bricks, sizeof(float)), calloc(tree->n_bricks, sizeof(float)),
					  calloc(tree->n_bricks, sizeof(float)) };
	t->heap = calloc(bb_choose_most(tree), sizeof(*t->heap));
	t->out = calloc(bb_choose_most(tree), sizeof(*t->out));
	t->picture = calloc(bb_look_pixels(&t->look), sizeof(*t->picture));
	if (t->ratings.space && t->ratings.time && t->ratings.work && t->heap && t->out && t->picture)
		return BB_OK;
	return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "ratings of %llu bricks", (unsigned long long)tree->n_bricks);
}

void bb_tables_end(struct bb_tables *t)
{
	bb_look_end(&t->look);
	bb_bricks_close(t->b);
	free(t->ratings.space);
	free(t->ratings.time);
	free(t->ratings.work);
	free(t->heap);
	free(t->out);
	free(t->picture);
	*t = (struct bb_tables){ 0 };
}

/* ---- edits of a transfer function ---- */

struct edit { /* ms of this thread, the least of some repeats */
	double all, local, histogram, bound;
};

/* Time the process ran, not what others took of its core. */
static double ran_ms(void)
{
	struct rusage u;

	if (getrusage(RUSAGE_SELF, &u))
		return 0;
	return (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) * 1e3 +
	       (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec) * 1e-3;
}

static enum bb_status once(struct bb_tables *t, const char *selector, uint64_t *scratch, uint32_t *order, double *ms,
			   struct bb_error *err)
{
	const uint32_t n = (uint32_t)bb_bricks_header(t->b)->tree.n_bricks;
	const double from_ms = ran_ms();
	const enum bb_status status = bb_selector_find(selector)->rate(t->b, t->tf, &t->ratings, err);

	bb_metric_order(t->ratings.space, n, scratch, order);
	*ms = fmin(*ms, (ran_ms() - from_ms));
	return status;
}

/* From the points of the function to an order of all bricks; and reading what is read of them, once. */
static enum bb_status edit_ms(struct bb_tables *t, struct edit *out, struct bb_error *err)
{
	const struct bb_bricks_moments *m = bb_bricks_moments(t->b);
	const uint64_t n = bb_bricks_header(t->b)->tree.n_bricks;
	uint64_t *scratch = calloc(n, sizeof(*scratch));
	uint32_t *order = calloc(n, sizeof(*order));
	enum bb_status status = scratch && order ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "an order of bricks");

	*out = (struct edit){ (double)INFINITY, (double)INFINITY, (double)INFINITY, (double)INFINITY };
	for (int k = 0; k < REPEATS && !status; k++) {
		status = once(t, "colour", scratch, order, &out->all, err);
		if (!status)
			status = once(t, "colour-local", scratch, order, &out->local, err);
		if (!status)
			status = once(t, "colour-histogram", scratch, order, &out->histogram, err);
		volatile float sum = 0;
		const double from_ms = ran_ms();
		for (uint64_t i = 0; i < n; i++)
			sum += m[i].mean + m[i].deviation + m[i].least + m[i].most + m[i].time_cov;
		(void)sum;
		out->bound = fmin(out->bound, (ran_ms() - from_ms));
	}
	free(scratch);
	free(order);
	return status;
}

/* Ratings in time of what is longer than a step, side by side. */
static size_t only_spans(const struct bb_tree *t, const float *time, float *out)
{
	size_t n = 0;

	for (uint32_t tau = 0; tau < t->n_times; tau++) {
		const struct bb_tree_span s = bb_tree_span(t, tau);
		for (uint32_t node = 0; node < t->n_nodes && s.to - s.from > 1; node++)
			out[n++] = time[(uint64_t)tau * t->n_nodes + node];
	}
	return n;
}

struct ranks {
	double space, space_histogram, time, time_local, reference_s;
};

static enum bb_status compare(struct bb_tables *t, const char *selector, const float *space, const float *time,
			      float *spans, double *in_space, double *in_time, struct bb_error *err)
{
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	enum bb_status status = bb_selector_find(selector)->rate(t->b, t->tf, &t->ratings, err);

	if (!status)
		status = bb_rank_correlation(space, t->ratings.space, tree->n_bricks, in_space, err);
	const size_t n = only_spans(tree, t->ratings.time, spans);
	if (!status)
		status = bb_rank_correlation(time, spans, n, in_time, err);
	return status;
}

static enum bb_status rank(struct bb_tables *t, struct ranks *out, struct bb_error *err)
{
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	float *space = calloc(tree->n_bricks, 4), *time = calloc(tree->n_bricks, 4);
	float *spans = calloc(tree->n_bricks, 4), *all = calloc(tree->n_bricks, 4);
	struct bb_ratings reference = { space, all, NULL };
	enum bb_status status =
		space && time && spans && all ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "ratings");
	const double from_ms = ran_ms();

	if (!status)
		status = bb_selector_find("colour-reference")->rate(t->b, t->tf, &reference, err);
	out->reference_s = (ran_ms() - from_ms) * 1e-3;
	if (!status) {
		only_spans(tree, all, time);
		status = compare(t, "colour", space, time, spans, &out->space, &out->time, err);
	}
	if (!status)
		status = compare(t, "colour-local", space, time, spans, &out->space, &out->time_local, err);
	if (!status)
		status = compare(t, "colour-histogram", space, time, spans, &out->space_histogram, &out->time_local,
				 err);
	free(space);
	free(time);
	free(spans);
	free(all);
	return status;
}

enum bb_status bb_tables_edits(struct bb_tables *t, json_t **out, struct bb_error *err)
{
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	struct edit edit;
	struct ranks ranks = { 0 };
	enum bb_status status = edit_ms(t, &edit, err);

	if (!status)
		status = rank(t, &ranks, err);
	if (status)
		return status;
	*out = json_pack("{s:I, s:i, s:i, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "bricks",
			 (json_int_t)tree->n_bricks, "nodes", (int)tree->n_nodes, "leaves", (int)bb_choose_most(tree),
			 "edit_ms", edit.all, "edit_local_ms", edit.local, "edit_histogram_ms", edit.histogram,
			 "read_once_ms", edit.bound, "reference_s", ranks.reference_s, "rank_space", ranks.space,
			 "rank_space_histogram", ranks.space_histogram, "rank_time", ranks.time, "rank_time_local",
			 ranks.time_local);
	return BB_OK;
}
