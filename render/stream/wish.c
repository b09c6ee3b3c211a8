/*
 * render/stream/wish.c: which bricks to ask for. What is on show and missing comes first, most missed first; then the
 * steps ahead, no faster than they have to come. A brick that is much finer than what stands in for it is reached over
 * one in between, so that a cold start grows sharp evenly.
 */
#include "render/stream/stream_private.h"

#include <string.h>

#define STONE 2 /* levels at once */

static bool is_bad(const struct bb_stream *s, uint64_t brick)
{
	return s->bad[brick / 64] >> brick % 64 & 1;
}

/* A float that is not negative keeps its order as a whole number. */
static uint32_t as_rank(float v)
{
	uint32_t bits;

	memcpy(&bits, &v, 4);
	return bits;
}

/* What to read for a target that is not here: itself, or a stone on the way to it. */
static uint64_t next_brick(const struct bb_stream *s, const struct bb_target *t)
{
	uint32_t node = t->node, level, have;

	(void)bb_show_best(s, node, t->tau, &have);
	level = bb_tree_place(s->tree, node).level;
	if (level - have <= STONE || s->complete)
		return bb_stream_brick(s, node, t->tau);
	for (; level > have + STONE; level--)
		node = bb_tree_parent(s->tree, node);
	const uint64_t stone = bb_stream_brick(s, node, t->tau);
	return is_bad(s, stone) ? bb_stream_brick(s, t->node, t->tau) : stone;
}

static uint32_t due_of(const struct bb_plan *p, uint8_t steps)
{
	uint32_t due = UINT32_MAX;

	for (uint32_t i = 0; i < p->n_steps; i++)
		if (steps >> i & 1 && p->due[i] < due)
			due = p->due[i];
	return due;
}

void bb_wish(struct bb_stream *s)
{
	const struct bb_plan *p = &s->plan;

	s->n_wishes = 0;
	for (uint32_t i = 0; i < p->n_targets; i++) {
		const struct bb_target *t = &p->target[i];
		const uint64_t id = bb_stream_brick(s, t->node, t->tau);
		const uint32_t slot = bb_slots_find(&s->slots, id);
		if (slot != BB_NO_SLOT)
			bb_slots_touch(&s->slots, slot);
		else if (!is_bad(s, id))
			s->wish[s->n_wishes++] = (struct bb_wish){ (uint64_t)as_rank(t->rank) << 32 | (UINT32_MAX - i),
								   next_brick(s, t), due_of(p, t->steps) };
	}
}

static bool sooner(const struct bb_wish *a, const struct bb_wish *b)
{
	return a->due != b->due ? a->due < b->due : a->key > b->key;
}

/* The last first: a heap has its greatest on top. */
static void sift_down(struct bb_wish *w, uint32_t n, uint32_t i)
{
	const struct bb_wish moving = w[i];

	for (uint32_t child; (child = 2 * i + 1) < n; i = child) {
		if (child + 1 < n && sooner(&w[child], &w[child + 1]))
			child++;
		if (!sooner(&moving, &w[child]))
			break;
		w[i] = w[child];
	}
	w[i] = moving;
}

/* The soonest first, of those the one that is missed most. qsort would take memory. */
static void sort(struct bb_wish *w, uint32_t n)
{
	for (uint32_t i = n / 2; i-- > 0;)
		sift_down(w, n, i);
	for (uint32_t i = n; i-- > 1;) {
		const struct bb_wish last = w[0];
		w[0] = w[i];
		w[i] = last;
		sift_down(w, i, 0);
	}
}

/*
 * How many bricks to ask for now, so that all are here when their step is on show and no frame has more to do than
 * another: the steepest line from here to any date. No date is nearer than a quarter of a step: for so long what is on
 * show may be a little coarser. Under a streaming budget what is on show and missing is not paced: the budget does that.
 */
static uint32_t pace(const struct bb_stream *s)
{
	uint32_t most = 0, shown = 0;

	if (!s->plan.n_ahead)
		return UINT32_MAX;
	for (uint32_t i = 0; i < s->n_wishes; i++) {
		const uint32_t due = s->wish[i].due > s->plan.grace ? s->wish[i].due : s->plan.grace;
		shown += !s->wish[i].due;
		if (i + 1 < s->n_wishes && s->wish[i + 1].due == s->wish[i].due)
			continue;
		const uint32_t each = (i + due) / due;
		most = each > most ? each : most;
	}
	return s->config.bricks_per_frame && shown > most ? shown : most;
}

static bool ask(struct bb_stream *s, uint64_t brick, uint32_t *n_loads, struct bb_stream_counts *counts)
{
	bool evicted = false;
	uint32_t slot = bb_slots_find(&s->slots, brick);

	if (slot != BB_NO_SLOT) { /* a stone of several targets, or on its way */
		bb_slots_touch(&s->slots, slot);
		return true;
	}
	slot = bb_slots_reserve(&s->slots, brick, &evicted);
	if (slot == BB_NO_SLOT)
		return false;
	counts->evicted += evicted;
	s->load[(*n_loads)++] = (struct bb_load){ .brick = brick, .slot = slot };
	return true;
}

uint32_t bb_budget_of(const struct bb_stream *s, const struct bb_stream_frame *f)
{
	const uint32_t most = s->config.bricks_per_frame ? s->config.bricks_per_frame : UINT32_MAX;

	return f->bricks_most < most ? f->bricks_most : most;
}

void bb_ask(struct bb_stream *s, const struct bb_stream_frame *f, struct bb_stream_counts *counts)
{
	uint32_t budget = bb_budget_of(s, f), n = 0;

	sort(s->wish, s->n_wishes);
	const uint32_t paced = pace(s);
	budget = paced < budget ? paced : budget;
	for (uint32_t i = 0; i < s->n_wishes && n < budget; i++) {
		const uint32_t before = n;
		if (!ask(s, s->wish[i].brick, &n, counts))
			break;
		counts->prefetched += s->wish[i].due ? n - before : 0;
	}
	counts->loaded = n;
	counts->bytes = (uint64_t)n * s->atlas.slot_bytes;
	if (n)
		s->loader->submit(s->loader, s->load, n, f->now_ns);
}
