/*
 * render/bricks/selector.h: every way of choosing bricks by its name, behind one interface: what it has to know of the
 * bricks (rate, once for a file and a transfer function), and which of them it then takes for a step (choose). Pure
 * but for reading the file; any thread.
 */
#ifndef BB_RENDER_BRICKS_SELECTOR_H
#define BB_RENDER_BRICKS_SELECTOR_H

#include "render/bricks/choose.h"
#include "render/bricks/gain.h"
#include "render/bricks/metric.h"

/* What of a file is read at each edit of the transfer function, cheapest first. */
enum bb_selector_needs { BB_NEEDS_NOTHING, BB_NEEDS_MOMENTS, BB_NEEDS_HISTOGRAMS, BB_NEEDS_VOXELS };
const char *bb_selector_needs_text(enum bb_selector_needs needs);

struct bb_ratings { /* the caller's; [n_bricks] each */
	float *space, *time;
	float *work; /* of no use afterwards, but after gains by leaf error: that error, of every brick */
};

struct bb_selector_ask {
	uint32_t step;
	double space_most, time_most;   /* by tolerance */
	struct bb_choose_budget budget; /* by budget; uniform and optimum know memory only */
};

struct bb_selector {
	const char *name, *line;
	enum bb_selector_needs needs;
	bool by_tolerance;
	/* Errors as of bb_bricks_read; 1702. */
	enum bb_status (*rate)(const struct bb_bricks *b, const struct bb_transfer *tf, struct bb_ratings *r,
			       struct bb_error *err);
	/* heap and out: bb_choose_most entries. Returns how many; 0: the tree is too large for this one. */
	size_t (*choose)(const struct bb_tree *t, const struct bb_ratings *r, const struct bb_selector_ask *ask,
			 struct bb_choice *heap, struct bb_choice *out);
};

extern const struct bb_selector bb_selectors[];               /* ends with name NULL */
const struct bb_selector *bb_selector_find(const char *name); /* NULL: there is none */

#endif
