/*
 * render/stream/show.c: what every cell is drawn from. A target that is in memory stands for itself, one that is not is
 * stood in for by the nearest ancestor that is: first the levels of the octree, and in each the times from its own up.
 */
#include "render/stream/stream_private.h"

#include <math.h>
#include <string.h>

#define RETURN_FRAMES 8 /* after so many a slot that was kept for one that stood in is free again */

static bool is_here(const struct bb_stream *s, uint32_t node, uint32_t tau, uint32_t *slot)
{
	*slot = bb_slots_find(&s->slots, bb_stream_brick(s, node, tau));
	return *slot != BB_NO_SLOT && !s->slots.slot[*slot].pending;
}

uint32_t bb_show_best(const struct bb_stream *s, uint32_t node, uint32_t tau, uint32_t *level)
{
	uint32_t slot;

	*level = bb_tree_place(s->tree, node).level;
	for (;; node = bb_tree_parent(s->tree, node), (*level)--)
		for (uint32_t t = tau; t != BB_TREE_NONE; t = bb_tree_span(s->tree, t).parent)
			if (is_here(s, node, t, &slot))
				return slot;
}

/* The cells below a node; returns how many. */
static uint32_t fill(struct bb_stream *s, struct bb_atlas_cell *map, uint32_t node, const struct bb_atlas_cell *with,
		     bool *changed)
{
	const struct bb_tree_place p = bb_tree_place(s->tree, node);
	const uint32_t up = bb_stream_up(s, p.level), *grid = s->atlas.grid;
	uint32_t from[3], to[3];

	for (int a = 0; a < 3; a++) {
		from[a] = p.at[a] << up;
		to[a] = (p.at[a] + 1) << up < grid[a] ? (p.at[a] + 1) << up : grid[a];
	}
	for (uint32_t z = from[2]; z < to[2]; z++)
		for (uint32_t y = from[1]; y < to[1]; y++) {
			struct bb_atlas_cell *row = map + ((size_t)z * grid[1] + y) * grid[0];
			for (uint32_t x = from[0]; x < to[0]; x++) {
				*changed |= row[x].slot != with->slot || row[x].up != with->up;
				row[x] = *with;
			}
		}
	return (to[0] - from[0]) * (to[1] - from[1]) * (to[2] - from[2]);
}

void bb_show_keep(struct bb_stream *s)
{
	const struct bb_plan *p = &s->plan;
	const uint32_t spare = s->slots.n > p->n_targets + 1 ? s->slots.n - p->n_targets - 1 : 0;
	uint32_t n = 0, level;

	for (uint32_t i = 0; i < p->n_targets; i++) {
		const struct bb_target *t = &p->target[i];
		const uint32_t slot = bb_show_best(s, t->node, t->tau, &level);
		if (s->slots.slot[slot].used_frame == s->slots.frame)
			continue;
		if (n++ < spare)
			bb_slots_touch(&s->slots, slot);
	}
	/* Given back slowly: a plan that grew at once would send for what it gave up a moment ago. */
	s->kept = n * RETURN_FRAMES > s->kept ? n * RETURN_FRAMES : s->kept - (s->kept > 0);
}

uint32_t bb_show_kept(const struct bb_stream *s)
{
	return (s->kept + RETURN_FRAMES - 1) / RETURN_FRAMES;
}

static bool is_shown(const struct bb_plan *p, const struct bb_target *t)
{
	return t->steps & (p->n_shown == 2 ? 3 : 1);
}

void bb_show(struct bb_stream *s, double step, struct bb_stream_counts *counts)
{
	const struct bb_plan *p = &s->plan;
	uint32_t cells, slot, level;
	bool changed = s->atlas.n_shown != p->n_shown;

	for (uint32_t i = 0; i < p->n_targets; i++) {
		const struct bb_target *t = &p->target[i];
		if (!is_shown(p, t))
			continue;
		slot = bb_show_best(s, t->node, t->tau, &level);
		const bool itself = s->slots.slot[slot].brick == bb_stream_brick(s, t->node, t->tau);
		const struct bb_atlas_cell cell = { (int32_t)slot, bb_stream_up(s, level), 0 };
		counts->drawn++;
		counts->missing += !itself;
		for (uint32_t k = 0; k < p->n_shown; k++) {
			if (!(t->steps >> k & 1))
				continue;
			cells = fill(s, s->map[k], t->node, &cell, &changed);
			counts->deficit += itself ? 0 : cells;
		}
	}
	if (p->n_shown == 1)
		memcpy(s->map[1], s->map[0],
		       (size_t)s->atlas.grid[0] * s->atlas.grid[1] * s->atlas.grid[2] * sizeof(*s->map[0]));
	s->atlas.n_shown = p->n_shown;
	s->atlas.time = p->n_shown == 2 ? step : p->step[0];
	s->atlas.mix = (float)(p->n_shown == 2 ? step - p->step[0] : 0);
	s->atlas.map_generation += changed;
}
