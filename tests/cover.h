/*
 * tests/cover.h: an atlas without a streamer: every cell of it drawn from a brick as many levels above the leaves as the
 * test says, for one time. And bricks of a volume in memory.
 */
#ifndef BB_TESTS_COVER_H
#define BB_TESTS_COVER_H

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "render/atlas.h"
#include "render/bricks/bricks.h"
#include "render/bricks/build.h"

struct cover {
	struct bb_atlas atlas;
	uint8_t *bricks;
	struct bb_atlas_range *range;
	uint64_t *generation;
	struct bb_atlas_cell *map[2];
};

/* How many levels above the leaves a cell is drawn; beyond the root: the root. */
typedef uint32_t cover_up(const uint32_t cell[3], void *ctx);

static inline uint32_t cover_leaves(const uint32_t cell[3], void *ctx)
{
	(void)cell;
	(void)ctx;
	return 0;
}

static inline struct bb_bricks *cover_build(const struct bb_steps *steps, struct bb_build_config c)
{
	char path[64];
	struct bb_build_report report;
	struct bb_error err = { 0 };
	struct bb_bricks *b = NULL;

	snprintf(path, sizeof(path), "/tmp/bb-cover-%d.bricks", (int)getpid());
	c.steps = steps;
	c.path = path;
	c.memory_bytes = c.memory_bytes ? c.memory_bytes : UINT64_C(1) << 28;
	c.threads = 1;
	if (bb_bricks_build(&c, &report, &err) != BB_OK || bb_bricks_open(path, &b, &err) != BB_OK) {
		fprintf(stderr, "%s\n", err.text);
		abort();
	}
	unlink(path);
	return b;
}

/* Bricks of a volume: edge, pad and type are the caller's, the range 0..1 of what the volume calls its range. */
static inline struct bb_bricks *cover_bricks(const struct bb_volume *v, uint32_t edge, uint32_t pad, enum bb_brick_type type)
{
	const struct bb_build_config c = { .edge = edge, .pad = pad, .type = type, .has_range = true, .least = v->least,
					   .most = v->most };
	struct bb_steps *steps;
	struct bb_error err;

	if (bb_steps_of_volume(v, &steps, &err) != BB_OK)
		abort();
	struct bb_bricks *b = cover_build(steps, c);
	bb_steps_close(steps);
	return b;
}

static inline struct bb_tree_place cover_place(const struct bb_tree *t, const uint32_t cell[3], uint32_t up)
{
	const uint32_t most = t->n_levels - 1, k = up < most ? up : most;

	return (struct bb_tree_place){ most - k, { cell[0] >> k, cell[1] >> k, cell[2] >> k } };
}

static inline void cover_free(struct cover *c)
{
	free(c->bricks);
	free(c->range);
	free(c->generation);
	free(c->map[0]);
	free(c->map[1]);
	free(c);
}

static inline void cover_fill(struct cover *c, const struct bb_bricks *b, unsigned shown, uint32_t step, cover_up *up,
			      void *ctx, int32_t *slot_of)
{
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	struct bb_atlas *a = &c->atlas;
	const uint32_t tau = bb_tree_leaf_time(t, step), blocks = a->blocks * a->blocks * a->blocks;
	struct bb_error err = { 0 };
	size_t i = 0;
	uint32_t cell[3];

	for (uint32_t n = 0; n < t->n_nodes; n++)
		slot_of[n] = -1;
	for (cell[2] = 0; cell[2] < a->grid[2]; cell[2]++)
		for (cell[1] = 0; cell[1] < a->grid[1]; cell[1]++)
			for (cell[0] = 0; cell[0] < a->grid[0]; cell[0]++, i++) {
				const struct bb_tree_place p = cover_place(t, cell, up(cell, ctx));
				const uint32_t node = bb_tree_node(t, &p);
				if (slot_of[node] < 0) {
					uint8_t *to = c->bricks + a->n_slots * a->slot_bytes;
					if (bb_bricks_read(b, (uint64_t)tau * t->n_nodes + node, to, &err) != BB_OK)
						abort();
					(void)bb_atlas_accept(a, to, c->range + (size_t)a->n_slots * blocks);
					c->generation[a->n_slots] = ++a->generation;
					slot_of[node] = (int32_t)a->n_slots++;
				}
				c->map[shown][i] = (struct bb_atlas_cell){ slot_of[node], t->n_levels - 1 - p.level, 0 };
			}
}

static inline struct cover *cover_make(const struct bb_bricks *b, double time, cover_up *up, void *ctx)
{
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	struct cover *c = calloc(1, sizeof(*c));
	int32_t *slot_of = calloc(t->n_nodes, sizeof(*slot_of));

	if (!c || !slot_of)
		abort();
	struct bb_atlas *a = &c->atlas;
	bb_atlas_describe(a, bb_bricks_header(b));
	const size_t n_cells = (size_t)a->grid[0] * a->grid[1] * a->grid[2], n_slots = 2 * n_cells;
	c->bricks = calloc(1, n_slots * a->slot_bytes + bb_atlas_slack_bytes(a));
	c->range = calloc(n_slots * a->blocks * a->blocks * a->blocks, sizeof(*c->range));
	c->generation = calloc(n_slots, sizeof(*c->generation));
	const uint32_t step = (uint32_t)time;
	a->time = time;
	a->n_shown = time > step ? 2 : 1;
	a->mix = (float)(time - step);
	for (unsigned k = 0; k < 2; k++) {
		c->map[k] = calloc(n_cells, sizeof(*c->map[k]));
		if (!c->bricks || !c->range || !c->generation || !c->map[k])
			abort();
		if (k < a->n_shown)
			cover_fill(c, b, k, step + k, up, ctx, slot_of);
		else
			memcpy(c->map[1], c->map[0], n_cells * sizeof(*c->map[0]));
		a->map[k] = c->map[k];
	}
	a->bricks = c->bricks;
	a->range = c->range;
	a->slot_generation = c->generation;
	a->map_generation = 1;
	free(slot_of);
	return c;
}

#endif
