/* bench/cmd/volume_select.c: `blackburst volume select`: the bricks of a file that a selector takes for a step. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/cli.h"
#include "render/bricks/selector.h"

static const struct bb_cli_option options[] = {
	{ "tf", "FILE", "the transfer function to choose for" },
	{ "selector", "NAME", "the way to choose (default far); --selector help lists them" },
	{ "step", "N", "(default 0)" },
	{ "memory", "BRICKS", "by budget: at most so many at a time (default: an eighth of the leaves)" },
	{ "stream", "BRICKS", "by budget: at most so many new ones a step on average (default: no limit)" },
	{ "space", "ERROR", "by tolerance: in space (default 0)" },
	{ "time", "ERROR", "by tolerance: in time (default 0)" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

struct selecting {
	struct bb_bricks *b;
	struct bb_transfer tf;
	const struct bb_selector *selector;
	struct bb_selector_ask ask;
	struct bb_ratings ratings;
	struct bb_choice *heap, *out;
	size_t n;
};

static int list_selectors(void)
{
	for (const struct bb_selector *s = bb_selectors; s->name; s++)
		printf("%-18s reads %-10s  %s\n", s->name, bb_selector_needs_text(s->needs), s->line);
	return BB_EXIT_OK;
}

static enum bb_status read_ask(const struct bb_cli *cli, struct selecting *s, struct bb_error *err)
{
	const struct bb_tree *t = &bb_bricks_header(s->b)->tree;
	const double leaves = (double)bb_choose_most(t);
	double step = 0, memory = 0;
	enum bb_status status = bb_cli_whole(cli, "step", 0, 0, t->n_steps - 1.0, &step, err);

	if (!status)
		status = bb_cli_whole(cli, "memory", leaves < 8 ? 1 : leaves / 8, 1, 4e9, &memory, err);
	if (!status)
		status = bb_cli_number(cli, "stream", 0, 0, 4e9, &s->ask.budget.stream_bricks, err);
	if (!status)
		status = bb_cli_number(cli, "space", 0, 0, 1e30, &s->ask.space_most, err);
	if (!status)
		status = bb_cli_number(cli, "time", 0, 0, 1e30, &s->ask.time_most, err);
	s->ask.step = (uint32_t)step;
	s->ask.budget.memory_bricks = (uint32_t)memory;
	return status;
}

static enum bb_status choose(const struct bb_cli *cli, struct selecting *s, struct bb_error *err)
{
	const char *tf = bb_cli_get(cli, "tf", NULL);
	enum bb_status status = tf ? bb_bricks_open(cli->arg[0], &s->b, err)
				   : bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--tf FILE: a choice is for a transfer function");

	if (!status)
		status = bb_transfer_load(tf, &s->tf, err);
	if (!status)
		status = read_ask(cli, s, err);
	if (status)
		return status;
	const struct bb_tree *t = &bb_bricks_header(s->b)->tree;
	s->ratings = (struct bb_ratings){ calloc(t->n_bricks, sizeof(float)), calloc(t->n_bricks, sizeof(float)),
					  calloc(t->n_bricks, sizeof(float)) };
	s->heap = calloc(bb_choose_most(t), sizeof(*s->heap));
	s->out = calloc(bb_choose_most(t), sizeof(*s->out));
	if (!s->ratings.space || !s->ratings.time || !s->ratings.work || !s->heap || !s->out)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%llu bricks", (unsigned long long)t->n_bricks);
	status = s->selector->rate(s->b, &s->tf, &s->ratings, err);
	if (status)
		return status;
	s->n = s->selector->choose(t, &s->ratings, &s->ask, s->heap, s->out);
	return s->n ? BB_OK : bb_fail(err, BB_ERR_USAGE, 1461, NULL, "%u nodes", t->n_nodes);
}

struct level {
	json_int_t chosen, flat, steps;
	double voxels; /* share of all */
};

static struct level sum_level(const struct selecting *s, uint32_t level)
{
	const struct bb_tree *t = &bb_bricks_header(s->b)->tree;
	struct level l = { 0 };

	for (size_t i = 0; i < s->n; i++) {
		const struct bb_choice *c = &s->out[i];
		const struct bb_tree_span span = bb_tree_span(t, c->tau);
		if (bb_tree_place(t, c->node).level != level)
			continue;
		l.chosen++;
		l.flat += c->flat;
		l.steps += span.to - span.from;
		l.voxels += (double)bb_tree_covered(t, c->node) / ((double)t->dim[0] * t->dim[1] * t->dim[2]);
	}
	return l;
}

static int tell(const struct bb_cli *cli, const struct selecting *s)
{
	const struct bb_tree *t = &bb_bricks_header(s->b)->tree;
	json_t *levels = json_array();
	const bool json = bb_cli_has(cli, "json");

	if (!json)
		printf("%s, step %u: %zu bricks of %zu leaves\n\n%5s %9s %9s %14s %10s\n", s->selector->name,
		       s->ask.step, s->n, bb_choose_most(t), "level", "bricks", "flat", "steps, mean", "voxels");
	for (uint32_t l = 0; l < t->n_levels; l++) {
		const struct level at = sum_level(s, l);
		const double steps = at.chosen ? (double)at.steps / (double)at.chosen : 0;
		json_array_append_new(levels,
				      json_pack("{s:i, s:I, s:I, s:f, s:f}", "level", (int)l, "bricks", at.chosen,
						"flat", at.flat, "mean_steps", steps, "voxel_share", at.voxels));
		if (!json)
			printf("%5u %9lld %9lld %14.2f %9.1f%%\n", l, (long long)at.chosen, (long long)at.flat, steps,
			       100 * at.voxels);
	}
	json_t *root = json_pack("{s:s, s:i, s:I, s:o}", "selector", s->selector->name, "step", (int)s->ask.step,
				 "bricks", (json_int_t)s->n, "levels", levels);
	if (json)
		return bb_cli_print_json(root);
	json_decref(root);
	return BB_EXIT_OK;
}

static int command(const struct bb_cli *cli)
{
	static struct selecting s; /* a transfer function is large */
	const char *name = bb_cli_get(cli, "selector", "far");
	struct bb_error err = { 0 };

	s = (struct selecting){ .selector = bb_selector_find(name) };
	if (!strcmp(name, "help"))
		return list_selectors();
	if (!s.selector)
		return bb_cli_fail(bb_fail(&err, BB_ERR_USAGE, 1460, NULL, "'%.40s'; --selector help lists them", name),
				   &err);
	const enum bb_status status = choose(cli, &s, &err);
	const int code = status ? bb_cli_fail(status, &err) : tell(cli, &s);
	bb_bricks_close(s.b);
	free(s.ratings.space);
	free(s.ratings.time);
	free(s.ratings.work);
	free(s.heap);
	free(s.out);
	return code;
}

const struct bb_command bb_cmd_volume_select = {
	"volume select",
	"which bricks a selector takes for a step",
	"FILE --tf FILE [--selector NAME] [options]",
	options,
	1,
	1,
	command,
};
