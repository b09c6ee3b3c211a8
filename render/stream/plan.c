/*
 * render/stream/plan.c: which bricks should stand for the steps on show and those ahead, if all of them were here: greedy
 * on a heap, as algorithm 1 of Carlsson and Tjernstroem 2016, for several steps and views at once. A brick of the heap
 * stands for a node and the planned steps that fall into its time; a split in space makes up to eight of it, one in time
 * parts its steps. Memory is counted in bricks; so is what must still be read, by the date of the first step it is for:
 * what cannot be here in time is not planned.
 */
#include "render/stream/stream_private.h"

#include <math.h>

#define NO_SPACE 1
#define NO_TIME 2
#define IN_TIME 4  /* the way that is worth more */
#define FAR_FRAMES 1e6 /* later than that is all the same */
#define STREAM_SHARE 0.85 /* of the streaming budget that may be planned for: the rest is for what was not foreseen */
#define HURRY 4.0 /* how fast a step gains weight as it comes nearer: 2^4 in the time of one step */

/* ---- steps ---- */

static void add_step(struct bb_plan *p, uint32_t step, uint32_t due, float weight)
{
	for (uint32_t i = 0; i < p->n_steps; i++)
		if (p->step[i] == step) {
			p->weight[i] = weight > p->weight[i] ? weight : p->weight[i];
			return;
		}
	if (p->n_steps == BB_STEPS_MOST)
		return;
	p->step[p->n_steps] = step;
	p->due[p->n_steps] = due;
	p->weight[p->n_steps++] = weight;
}

static double clamped(double t, uint32_t n_steps)
{
	const double last = (double)n_steps - 1;

	return t > 0 ? (t < last ? t : last) : 0; /* NaN is 0 */
}

/* The other step on show at a time, or about to be when it falls on one. */
static uint32_t next_to(const struct bb_stream *s, double t, int way)
{
	return (uint32_t)(t > floor(t) ? ceil(t) : clamped(t + way, s->tree->n_steps));
}

/* A step gains weight as it comes nearer and loses it as it fades, without a jump anywhere: what a plan gives up or takes
 * on from one frame to the next is little. */
static void add_ahead(struct bb_stream *s, const struct bb_stream_frame *f, double left, int way)
{
	struct bb_plan *p = &s->plan;

	for (size_t i = 0; i < f->n_ahead && i < BB_STREAM_AHEAD_MOST; i++) {
		const double t = clamped(f->ahead[i], s->tree->n_steps), units = (double)i + left;
		const uint32_t due = (uint32_t)fmin(fmax(1, units * f->ahead_frames), FAR_FRAMES);
		const float weight = (float)exp2(-HURRY * units);
		add_step(p, (uint32_t)t, due, weight);
		add_step(p, next_to(s, t, way), due, weight);
	}
}

void bb_plan_steps(struct bb_stream *s, const struct bb_stream_frame *f)
{
	struct bb_plan *p = &s->plan;
	const double now = clamped(f->step, s->tree->n_steps), part = now - floor(now), rest = 1 - part;
	const int way = f->way;

	p->n_steps = p->n_ahead = 0;
	/* The one that goes has faded to nothing before it drops out of the plan. */
	add_step(p, (uint32_t)now, 0, (float)(way > 0 ? rest * rest : 1));
	add_step(p, (uint32_t)ceil(now), 0, (float)(way < 0 && part > 0 ? part * part : 1));
	p->n_shown = p->n_steps;
	if (!way || !f->n_ahead || s->config.no_prediction)
		return;
	if (part == 0)
		add_step(p, next_to(s, now, way), 0, 1);
	p->n_ahead = (uint32_t)f->n_ahead;
	p->grace = f->ahead_frames / 4 + 1;
	add_ahead(s, f, way < 0 && part > 0 ? part : rest, way);
}

/* ---- the heap ---- */

static bool before(const struct bb_target *a, const struct bb_target *b)
{
	if (a->points != b->points)
		return a->points > b->points;
	return a->tau != b->tau ? a->tau < b->tau : a->node < b->node;
}

static float weight_of(const struct bb_plan *p, uint8_t steps)
{
	float most = 0;

	for (uint32_t i = 0; i < p->n_steps; i++)
		if (steps >> i & 1 && p->weight[i] > most)
			most = p->weight[i];
	return most;
}

static void chosen(struct bb_plan *p, const struct bb_target *t)
{
	p->target[p->n_targets++] = *t;
}

/* What its best split is worth now. */
static void rate(const struct bb_stream *s, struct bb_target *t)
{
	const uint64_t id = bb_stream_brick(s, t->node, t->tau);
	const float weight = weight_of(&s->plan, t->steps);
	const uint32_t up = bb_stream_up(s, bb_tree_place(s->tree, t->node).level);
	/* Time can be coarser than it should be where space is fine enough for a pixel. */
	const float pixels = bb_sight_pixels(&s->sight, t->node) / (float)(1U << up);
	const float space = t->closed & NO_SPACE ? -1 : s->space[id] * bb_sight_weight(&s->sight, t->node);
	const float time = t->closed & NO_TIME ? -1 : s->time[id] * pixels * pixels;

	t->closed = (uint8_t)(time >= space ? t->closed | IN_TIME : t->closed & ~IN_TIME);
	t->points = (time >= space ? time : space) * weight;
}

/* Onto the heap while there is something to split it into, else it is chosen. */
static void push(struct bb_stream *s, struct bb_target t)
{
	struct bb_plan *p = &s->plan;
	uint32_t i = p->n_heap;

	rate(s, &t);
	if (!(t.points > 0)) {
		chosen(p, &t);
		return;
	}
	for (p->n_heap++; i && before(&t, &p->heap[(i - 1) / 2]); i = (i - 1) / 2)
		p->heap[i] = p->heap[(i - 1) / 2];
	p->heap[i] = t;
}

static struct bb_target pop(struct bb_plan *p)
{
	const struct bb_target top = p->heap[0], moving = p->heap[--p->n_heap];
	uint32_t i = 0;

	for (uint32_t child; (child = 2 * i + 1) < p->n_heap; i = child) {
		if (child + 1 < p->n_heap && before(&p->heap[child + 1], &p->heap[child]))
			child++;
		if (!before(&p->heap[child], &moving))
			break;
		p->heap[i] = p->heap[child];
	}
	p->heap[i] = moving;
	return top;
}

/* ---- splits ---- */

/* The soonest of them: steps stand in the order of their dates. */
static uint32_t first_of(uint8_t steps)
{
	return (uint32_t)__builtin_ctz(steps);
}

/* Plans to read so many bricks more for these steps, if they can be here in time beside those that others need by then. */
static bool will_read(struct bb_plan *p, uint8_t steps, uint32_t n)
{
	double sum = n;

	for (uint32_t i = 0; n && i < p->n_steps; i++) {
		sum += p->stream[i];
		if (i >= first_of(steps) && sum > p->stream_most[i])
			return false;
	}
	p->stream[first_of(steps)] += n;
	return true;
}

static uint32_t missing(const struct bb_stream *s, uint32_t node, uint32_t tau)
{
	return bb_slots_find(&s->slots, bb_stream_brick(s, node, tau)) == BB_NO_SLOT;
}

static uint32_t in_use(const struct bb_plan *p)
{
	return p->n_heap + p->n_targets;
}

static bool split_space(struct bb_stream *s, const struct bb_target *t)
{
	struct bb_plan *p = &s->plan;
	uint32_t child[8], n_missing = 0;
	const uint32_t n = bb_tree_children(s->tree, t->node, child);

	for (uint32_t i = 0; i < n; i++)
		n_missing += missing(s, child[i], t->tau);
	if (in_use(p) + n > p->target_most || !will_read(p, t->steps, n_missing))
		return false;
	for (uint32_t i = 0; i < n; i++)
		push(s, (struct bb_target){ .node = child[i], .tau = t->tau, .rank = t->points, .steps = t->steps });
	return true;
}

static bool split_time(struct bb_stream *s, const struct bb_target *t)
{
	struct bb_plan *p = &s->plan;
	const struct bb_tree_span span = bb_tree_span(s->tree, t->tau);
	const uint32_t middle = bb_tree_span(s->tree, span.child[1]).from;
	uint8_t half[2] = { 0, 0 };
	uint32_t n_missing[2];

	for (uint32_t i = 0; i < p->n_steps; i++)
		if (t->steps >> i & 1)
			half[p->step[i] >= middle] |= (uint8_t)(1U << i);
	if (in_use(p) + (half[0] != 0) + (half[1] != 0) > p->target_most)
		return false;
	for (int k = 0; k < 2; k++) {
		n_missing[k] = half[k] ? missing(s, t->node, span.child[k]) : 0;
		if (!half[k] || will_read(p, half[k], n_missing[k]))
			continue;
		if (k && half[0])
			p->stream[first_of(half[0])] -= n_missing[0];
		return false;
	}
	for (int k = 0; k < 2; k++)
		if (half[k])
			push(s, (struct bb_target){ .node = t->node, .tau = span.child[k], .rank = t->points, .steps = half[k] });
	return true;
}

/* Every leaf brick of the steps on show. */
static void plan_all(struct bb_stream *s)
{
	const struct bb_tree *t = s->tree;
	struct bb_plan *p = &s->plan;

	for (uint32_t i = 0; i < p->n_shown; i++)
		for (uint32_t node = t->first[t->n_levels - 1]; node < t->n_nodes; node++)
			chosen(p, &(struct bb_target){ .node = node,
						       .tau = bb_tree_leaf_time(t, p->step[i]),
						       .steps = (uint8_t)(1U << i) });
}

/* Bricks that can be read until a step is on show, and a quarter of a step longer. At rest there is no date. */
static void plan_reading(struct bb_stream *s)
{
	struct bb_plan *p = &s->plan;

	for (uint32_t i = 0; i < p->n_steps; i++) {
		p->stream[i] = 0;
		p->stream_most[i] = (double)INFINITY;
		if (p->n_ahead && s->config.bricks_per_frame)
			p->stream_most[i] = STREAM_SHARE * s->config.bricks_per_frame * (p->due[i] + p->grace);
	}
}

/* All slots but the root's, and but those of bricks that had to stand in for others: up to an eighth, so that a plan that
 * turns to other bricks keeps what there is to show until they come. */
static uint32_t room_for(const struct bb_stream *s)
{
	const uint32_t n = s->slots.n, most = n / 8, now = bb_show_kept(s), kept = 1 + (now < most ? now : most);

	return n > kept ? n - kept : 1;
}

void bb_plan_make(struct bb_stream *s)
{
	struct bb_plan *p = &s->plan;

	p->n_heap = p->n_targets = 0;
	if (s->complete) {
		plan_all(s);
		return;
	}
	plan_reading(s);
	p->target_most = room_for(s);
	push(s, (struct bb_target){ .steps = (uint8_t)((1U << p->n_steps) - 1), .rank = INFINITY });
	while (p->n_heap) {
		struct bb_target t = pop(p);
		const bool in_time = t.closed & IN_TIME;
		if (in_time ? split_time(s, &t) : split_space(s, &t))
			continue;
		t.closed |= in_time ? NO_TIME : NO_SPACE; /* the other way it may still fit */
		push(s, t);
	}
}
