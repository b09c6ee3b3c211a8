#include "render/bricks/selector.h"

#include <stdlib.h>
#include <string.h>

const char *bb_selector_needs_text(enum bb_selector_needs needs)
{
	static const char *const text[] = { "nothing", "moments", "histograms", "voxels" };

	return text[needs];
}

/* ---- ratings ---- */

static enum bb_status rate_nothing(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r,
				   struct bb_error *err)
{
	(void)b;
	(void)tf;
	(void)r;
	(void)err;
	return BB_OK;
}

#define SCALAR(name, guard)                                                                                       \
	static enum bb_status name(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r, \
				   struct bb_error *err)                                                          \
	{                                                                                                         \
		(void)tf;                                                                                         \
		(void)err;                                                                                        \
		bb_metric_rate_scalar(b, guard, r->space, r->time);                                               \
		return BB_OK;                                                                                     \
	}
SCALAR(rate_scalar, BB_SCALAR_GUARDED)
SCALAR(rate_scalar_sand, BB_SCALAR_SAND)
SCALAR(rate_scalar_bare, BB_SCALAR_BARE)

struct tables { /* too large for a small stack */
	struct bb_metric_colours colours;
	struct bb_metric_table table;
	struct bb_metric_times times;
};

static enum bb_status rate_colours(const struct bb_bricks *b, const struct bb_transfer *tf, enum bb_metric_form form,
				   bool local, struct bb_ratings *r, struct bb_error *err)
{
	struct tables *t = malloc(sizeof(*t));

	if (!t)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "tables of colours");
	bb_metric_colours(tf, &t->colours);
	bb_metric_table_of(&t->colours, form, &t->table);
	if (local) {
		bb_metric_times(&t->table, &t->times);
		bb_metric_rate_local(b, &t->table, &t->times, r->space, r->time);
	} else {
		bb_metric_rate(b, &t->table, r->space, r->time);
	}
	free(t);
	return BB_OK;
}

static enum bb_status rate_colour(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r,
				  struct bb_error *err)
{
	return rate_colours(b, tf, BB_METRIC_RATIO, false, r, err);
}

static enum bb_status rate_colour_local(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r,
					struct bb_error *err)
{
	return rate_colours(b, tf, BB_METRIC_RATIO, true, r, err);
}

static enum bb_status rate_colour_deviation(const struct bb_bricks *b, const struct bb_transfer *tf,
					    struct bb_ratings *r, struct bb_error *err)
{
	return rate_colours(b, tf, BB_METRIC_DEVIATION, true, r, err);
}

/* In time as colour-local. */
static enum bb_status rate_histograms(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r,
				      struct bb_error *err)
{
	struct bb_metric_colours *c = malloc(sizeof(*c));
	enum bb_status status = c ? rate_colours(b, tf, BB_METRIC_RATIO, true, r, err)
				  : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "colours");

	if (!status) {
		bb_metric_colours(tf, c);
		status = bb_metric_rate_histograms(b, c, r->space, err);
	}
	free(c);
	return status;
}

static enum bb_status rate_reference(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r,
				     struct bb_error *err)
{
	struct bb_metric_colours *c = malloc(sizeof(*c));

	if (!c)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "colours");
	bb_metric_colours(tf, c);
	const enum bb_status status = bb_metric_rate_reference(b, c, r->space, r->time, err);
	free(c);
	return status;
}

#define GAIN(name, method, colour)                                                                                \
	static enum bb_status name(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r, \
				   struct bb_error *err)                                                          \
	{                                                                                                         \
		struct bb_gain_weights w;                                                                         \
		bb_gain_weights_of(tf, colour, &w);                                                               \
		return bb_gain_points(b, &w, method, r->space, r->time, r->work, err);                            \
	}
GAIN(rate_opacity, BB_GAIN_OPACITY, BB_GAIN_RGB)
GAIN(rate_leaf, BB_GAIN_LEAF, BB_GAIN_RGB)
GAIN(rate_child, BB_GAIN_CHILD, BB_GAIN_RGB)
GAIN(rate_far, BB_GAIN_FAR, BB_GAIN_RGB)
GAIN(rate_opacity_lab, BB_GAIN_OPACITY, BB_GAIN_LAB)
GAIN(rate_leaf_lab, BB_GAIN_LEAF, BB_GAIN_LAB)
GAIN(rate_child_lab, BB_GAIN_CHILD, BB_GAIN_LAB)
GAIN(rate_far_lab, BB_GAIN_FAR, BB_GAIN_LAB)

static enum bb_status rate_leaf_on(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r,
				   struct bb_error *err)
{
	const enum bb_status status = rate_leaf(b, tf, r, err);

	if (!status)
		bb_gain_press_on(r->work, bb_bricks_header(b)->tree.n_bricks, r->space, r->time);
	return status;
}

/* ---- choices ---- */

static size_t by_tolerance(const struct bb_tree *t, const struct bb_ratings *r, const struct bb_selector_ask *ask,
			   struct bb_choice *heap, struct bb_choice *out)
{
	(void)heap;
	return bb_choose_by_tolerance(t, r->space, r->time, ask->step, ask->space_most, ask->time_most, out);
}

static size_t by_budget(const struct bb_tree *t, const struct bb_ratings *r, const struct bb_selector_ask *ask,
			struct bb_choice *heap, struct bb_choice *out)
{
	return bb_choose_by_budget(t, r->space, r->time, ask->step, &ask->budget, heap, out);
}

static size_t uniform(const struct bb_tree *t, const struct bb_ratings *r, const struct bb_selector_ask *ask,
		      struct bb_choice *heap, struct bb_choice *out)
{
	(void)r;
	(void)heap;
	return bb_choose_uniform(t, ask->step, ask->budget.memory_bricks, out);
}

static size_t optimum(const struct bb_tree *t, const struct bb_ratings *r, const struct bb_selector_ask *ask,
		      struct bb_choice *heap, struct bb_choice *out)
{
	(void)heap;
	return bb_choose_optimum(t, r->work, ask->step, ask->budget.memory_bricks, out);
}

const struct bb_selector bb_selectors[] = {
	{ "scalar", "coefficient of variation, its mean kept from zero", BB_NEEDS_MOMENTS, true, rate_scalar,
	  by_tolerance },
	{ "scalar-sand", "standard deviation (Sand 2014)", BB_NEEDS_MOMENTS, true, rate_scalar_sand, by_tolerance },
	{ "scalar-bare", "coefficient of variation as it stands (Shen et al. 1999)", BB_NEEDS_MOMENTS, true,
	  rate_scalar_bare, by_tolerance },
	{ "colour-reference", "colours of every voxel (Ellsworth et al. 2000)", BB_NEEDS_VOXELS, true, rate_reference,
	  by_tolerance },
	{ "colour", "colours by mean and deviation (Ellsworth et al. 2000)", BB_NEEDS_MOMENTS, true, rate_colour,
	  by_tolerance },
	{ "colour-local", "the same, in time by what the values there would show", BB_NEEDS_MOMENTS, true,
	  rate_colour_local, by_tolerance },
	{ "colour-histogram", "the same, in space by the histogram of values", BB_NEEDS_HISTOGRAMS, true,
	  rate_histograms, by_tolerance },
	{ "colour-deviation", "the same, divided by nothing", BB_NEEDS_MOMENTS, true, rate_colour_deviation,
	  by_tolerance },
	{ "opacity", "budget: the most visible first", BB_NEEDS_HISTOGRAMS, false, rate_opacity, by_budget },
	{ "leaf", "budget: the largest part of the error against the leaves first", BB_NEEDS_HISTOGRAMS, false,
	  rate_leaf, by_budget },
	{ "child", "budget: the largest error against the children first", BB_NEEDS_HISTOGRAMS, false, rate_child,
	  by_budget },
	{ "far", "budget: as leaf, splits so deep as gains most for each brick", BB_NEEDS_HISTOGRAMS, false, rate_far,
	  by_budget },
	{ "leaf-on", "budget: leaf, and on where children are no better than their parent", BB_NEEDS_HISTOGRAMS, false, rate_leaf_on,
	  by_budget },
	{ "opacity-lab", "opacity in CIE L*a*b*", BB_NEEDS_HISTOGRAMS, false, rate_opacity_lab, by_budget },
	{ "leaf-lab", "leaf in CIE L*a*b*", BB_NEEDS_HISTOGRAMS, false, rate_leaf_lab, by_budget },
	{ "child-lab", "child in CIE L*a*b*", BB_NEEDS_HISTOGRAMS, false, rate_child_lab, by_budget },
	{ "far-lab", "far in CIE L*a*b*", BB_NEEDS_HISTOGRAMS, false, rate_far_lab, by_budget },
	{ "uniform", "budget: the finest level that fits as a whole", BB_NEEDS_NOTHING, false, rate_nothing, uniform },
	{ "optimum", "budget: the least error against the leaves there is; small trees", BB_NEEDS_HISTOGRAMS, false,
	  rate_leaf, optimum },
	{ NULL, NULL, BB_NEEDS_NOTHING, false, NULL, NULL },
};

const struct bb_selector *bb_selector_find(const char *name)
{
	for (const struct bb_selector *s = bb_selectors; s->name; s++)
		if (!strcmp(s->name, name))
			return s;
	return NULL;
}
