/* bench/volume/budgets.c: the gains of budget-driven selection at middle budgets: error left, and how it looks. */
#include "bench/volume/tables.h"

#include <stdlib.h>
#include <string.h>

static const char *const names[] = { "opacity",  "leaf",      "child",   "far",    "opacity-lab",
				     "leaf-lab", "child-lab", "far-lab", "uniform" };

struct budgets {
	struct bb_tables *t;
	float *cost; /* leaf error in RGB, of every brick */
	float (*reference)[4];
	uint32_t step;
};

/* Error of the chosen bricks for their voxels in the one step: a span's is shared by its steps. */
static double step_cost_of(const struct budgets *g, size_t n)
{
	const struct bb_tree *tree = &bb_bricks_header(g->t->b)->tree;
	double sum = 0;

	for (size_t i = 0; i < n; i++) {
		const struct bb_tree_span s = bb_tree_span(tree, g->t->out[i].tau);
		sum += (double)g->cost[(uint64_t)g->t->out[i].tau * tree->n_nodes + g->t->out[i].node] /
		       (s.to - s.from);
	}
	return sum;
}

static enum bb_status measure(struct budgets *g, const struct bb_selector *selector, bool streaming, uint32_t part,
			      json_t *row, struct bb_error *err)
{
	struct bb_tables *t = g->t;
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	const uint32_t leaves = (uint32_t)bb_choose_most(tree), most = leaves / part ? leaves / part : 1;
	const struct bb_selector_ask ask = { .step = g->step,
					     .budget = { .memory_bricks = streaming ? leaves : most,
							 .stream_bricks = streaming ? most : 0 } };
	const size_t n = selector->choose(tree, &t->ratings, &ask, t->heap, t->out);
	const enum bb_status status = bb_look_fill(&t->look, t->out, n, err);

	if (status)
		return status;
	bb_look_cast(&t->look, t->tf, t->picture);
	const struct bb_look_difference d = bb_look_compare((const float(*)[4])t->picture,
							    (const float(*)[4])g->reference, bb_look_pixels(&t->look));
	const double all = (double)g->cost[0] / tree->n_steps;
	json_array_append_new(
		row, json_pack("{s:s, s:i, s:i, s:I, s:f, s:f, s:f}", "budget", streaming ? "stream" : "memory", "part",
			       (int)part, "bricks", (int)most, "chosen", (json_int_t)n, "cost",
			       all > 0 ? 100 * step_cost_of(g, n) / all : 0, "luv", d.luv, "psnr_db", d.psnr_db));
	return BB_OK;
}

static enum bb_status measure_selector(struct budgets *g, const char *name, json_t *rows, struct bb_error *err)
{
	static const uint32_t parts[] = { 16, 8, 4, 2 };
	const struct bb_selector *selector = bb_selector_find(name);
	json_t *row = json_array();
	enum bb_status status = selector->rate(g->t->b, g->t->tf, &g->t->ratings, err);

	if (g->t->progress)
		g->t->progress(name);
	for (int streaming = 0; streaming < 2; streaming++)
		for (size_t i = 0; i < BB_ARRAY_LEN(parts) && !status; i++)
			if (!streaming || strcmp(name, "uniform"))
				status = measure(g, selector, streaming, parts[i], row, err);
	json_array_append_new(rows, json_pack("{s:s, s:o}", "selector", name, "budgets", row));
	return status;
}

static enum bb_status begin(struct budgets *g, struct bb_error *err)
{
	struct bb_tables *t = g->t;
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	enum bb_status status = bb_selector_find("leaf")->rate(t->b, t->tf, &t->ratings, err);

	if (status)
		return status;
	memcpy(g->cost, t->ratings.work, tree->n_bricks * sizeof(*g->cost));
	const size_t n = bb_choose_uniform(tree, g->step, UINT32_MAX, t->out);
	status = bb_look_fill(&t->look, t->out, n, err);
	if (!status)
		bb_look_cast(&t->look, t->tf, g->reference);
	return status;
}

enum bb_status bb_tables_budgets(struct bb_tables *t, json_t **out, struct bb_error *err)
{
	const struct bb_tree *tree = &bb_bricks_header(t->b)->tree;
	struct budgets g = { .t = t, .step = tree->n_steps / 2 };
	json_t *rows = json_array();
	enum bb_status status;

	g.cost = calloc(tree->n_bricks, sizeof(*g.cost));
	g.reference = calloc(bb_look_pixels(&t->look), sizeof(*g.reference));
	status = g.cost && g.reference && rows ? begin(&g, err) : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "budgets");
	for (size_t i = 0; i < BB_ARRAY_LEN(names) && !status; i++)
		status = measure_selector(&g, names[i], rows, err);
	free(g.cost);
	free(g.reference);
	if (status) {
		json_decref(rows);
		return status;
	}
	*out = json_pack("{s:i, s:i, s:o}", "leaves", (int)bb_choose_most(tree), "step", (int)g.step, "rows", rows);
	return BB_OK;
}
