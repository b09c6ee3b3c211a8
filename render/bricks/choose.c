#include "render/bricks/choose.h"

#include <math.h>
#include <stdlib.h>

size_t bb_choose_most(const struct bb_tree *t)
{
	return t->n_nodes - t->first[t->n_levels - 1];
}

static uint64_t id_of(const struct bb_tree *t, const struct bb_choice *c)
{
	return (uint64_t)c->tau * t->n_nodes + c->node;
}

/* ---- greedy, by budget ---- */

struct greedy {
	const struct bb_tree *t;
	const float *space, *time;
	uint32_t step;
	struct bb_choice *heap; /* flat: may be split in time only */
	size_t n_heap;
	struct bb_choice *out;
	size_t n_out;
	bool time_is_free;
	const float *weight;
};

static float points(const struct greedy *g, const struct bb_choice *c)
{
	const uint64_t id = id_of(g->t, c);
	const float own = c->flat || g->time[id] >= g->space[id] ? g->time[id] : g->space[id];

	return g->weight ? own * g->weight[c->node] : own;
}

/* Does a come before b? */
static bool before(const struct greedy *g, const struct bb_choice *a, const struct bb_choice *b)
{
	const float p = points(g, a), q = points(g, b);

	return p > q || (!(p < q) && a->node < b->node);
}

static void swap(struct bb_choice *a, struct bb_choice *b)
{
	const struct bb_choice keep = *a;

	*a = *b;
	*b = keep;
}

/* Into that half of its time that has the step. */
static uint32_t half_of(const struct greedy *g, uint32_t tau)
{
	const struct bb_tree_span s = bb_tree_span(g->t, tau);

	return s.child[g->step >= bb_tree_span(g->t, s.child[1]).from];
}

/* Onto the heap while there is something to split it into, else it is chosen. */
static void push(struct greedy *g, struct bb_choice c)
{
	size_t i = g->n_heap;

	while (g->time_is_free && g->time[id_of(g->t, &c)] > 0 && (!g->weight || g->weight[c.node] > 0))
		c.tau = half_of(g, c.tau);
	if (!(points(g, &c) > 0)) {
		c.flat = false;
		g->out[g->n_out++] = c;
		return;
	}
	g->heap[g->n_heap++] = c;
	for (; i && before(g, &g->heap[i], &g->heap[(i - 1) / 2]); i = (i - 1) / 2)
		swap(&g->heap[i], &g->heap[(i - 1) / 2]);
}

static struct bb_choice pop(struct greedy *g)
{
	const struct bb_choice top = g->heap[0];

	g->heap[0] = g->heap[--g->n_heap];
	for (size_t i = 0;;) {
		size_t best = i;
		for (size_t k = 2 * i + 1; k <= 2 * i + 2 && k < g->n_heap; k++)
			if (before(g, &g->heap[k], &g->heap[best]))
				best = k;
		if (best == i)
			return top;
		swap(&g->heap[i], &g->heap[best]);
		i = best;
	}
}

/* How often such a brick is loaded while the whole sequence is played. */
static double loads(const struct bb_tree *t, const struct bb_tree_span *s)
{
	return (double)t->n_steps / (s->to - s->from);
}

size_t bb_choose_by_budget(const struct bb_tree *t, const float *space, const float *time, uint32_t step,
			   const struct bb_choose_budget *budget, struct bb_choice *heap, struct bb_choice *out)
{
	struct greedy g = { t, space, time, step, heap, 0, out, 0, !(budget->stream_bricks > 0), budget->weight };
	const double stream_most = budget->stream_bricks > 0 ? budget->stream_bricks * t->n_steps : (double)INFINITY;
	double stream = 1;
	uint64_t memory = 1;
	uint32_t child[8];

	push(&g, (struct bb_choice){ 0 });
	while (g.n_heap) {
		struct bb_choice c = pop(&g);
		const uint64_t id = id_of(t, &c);
		const struct bb_tree_span s = bb_tree_span(t, c.tau);
		if (c.flat || time[id] >= space[id]) {
			const uint32_t half = half_of(&g, c.tau);
			const struct bb_tree_span to = bb_tree_span(t, half);
			const double more = loads(t, &to) - loads(t, &s);
			c.flat = false;
			if (stream + more > stream_most) {
				out[g.n_out++] = c;
				continue;
			}
			stream += more;
			push(&g, (struct bb_choice){ .node = c.node, .tau = half });
			continue;
		}
		const uint32_t n = bb_tree_children(t, c.node, child);
		const double more = loads(t, &s) * (n - 1);
		if (memory + n - 1 > budget->memory_bricks || stream + more > stream_most) {
			c.flat = true; /* in time it may still fit */
			push(&g, c);
			continue;
		}
		memory += n - 1;
		stream += more;
		for (uint32_t i = 0; i < n; i++)
			push(&g, (struct bb_choice){ .node = child[i], .tau = c.tau });
	}
	return g.n_out;
}

/* ---- by tolerance ---- */

struct tolerant {
	const struct bb_tree *t;
	const float *space, *time;
	uint32_t step;
	double space_most, time_most;
	struct bb_choice *out;
	size_t n;
};

/* The largest span around the step whose errors are tolerated; false: none, the octree must go on. */
static bool span_of(const struct tolerant *g, uint32_t node, bool leaf, struct bb_choice *out)
{
	uint32_t tau = 0;

	for (;;) {
		const struct bb_tree_span s = bb_tree_span(g->t, tau);
		const uint64_t id = (uint64_t)tau * g->t->n_nodes + node;
		const bool flat = (double)g->space[id] <= g->space_most;
		if ((double)g->time[id] <= g->time_most && (flat || leaf)) {
			*out = (struct bb_choice){ node, tau, flat };
			return true;
		}
		if (s.to - s.from == 1) {
			*out = (struct bb_choice){ node, tau, false }; /* what a leaf of the octree shows then */
			return leaf;
		}
		tau = s.child[g->step >= bb_tree_span(g->t, s.child[1]).from];
	}
}

static void descend(struct tolerant *g, uint32_t node)
{
	uint32_t child[8];
	const uint32_t n = bb_tree_children(g->t, node, child);

	if (span_of(g, node, !n, &g->out[g->n])) {
		g->n++;
		return;
	}
	for (uint32_t i = 0; i < n; i++)
		descend(g, child[i]);
}

size_t bb_choose_by_tolerance(const struct bb_tree *t, const float *space, const float *time, uint32_t step,
			      double space_most, double time_most, struct bb_choice *out)
{
	struct tolerant g = { t, space, time, step, space_most, time_most, out, 0 };

	descend(&g, 0);
	return g.n;
}

/* ---- the two ends of the scale ---- */

size_t bb_choose_uniform(const struct bb_tree *t, uint32_t step, uint32_t memory_bricks, struct bb_choice *out)
{
	uint32_t level = 0;
	size_t n = 0;

	while (level + 1 < t->n_levels && t->first[level + 2] - t->first[level + 1] <= memory_bricks)
		level++;
	for (uint32_t node = t->first[level]; node < t->first[level + 1]; node++)
		out[n++] = (struct bb_choice){ .node = node, .tau = bb_tree_leaf_time(t, step) };
	return n;
}

#define OPTIMUM_NODES_MOST 4096
#define OPTIMUM_TABLE_MOST (1u << 24)

struct optimum {
	const struct bb_tree *t;
	uint32_t cap;
	double *best;   /* [node][k]: least cost of its subtree with at most k + 1 bricks */
	uint16_t *part; /* [node][k]: of these for the child's own subtree, when children before it have the rest */
	const double *alone; /* [node]: as one brick */
	struct bb_choice *out;
	const uint32_t *tau; /* [node]: the time node that is best alone */
	size_t n;
	bool failed; /* no memory */
};

/* Children one after another: joined[c][k] is the best of the first c + 1 with k + 1 bricks. */
static void solve(struct optimum *o, uint32_t node)
{
	double *best = o->best + (size_t)node * o->cap;
	uint32_t child[8];
	const uint32_t n = bb_tree_children(o->t, node, child);
	double *now = calloc(o->cap, sizeof(double)), *next = calloc(o->cap, sizeof(double));

	o->failed |= !now || !next;
	for (uint32_t k = 0; k < o->cap; k++)
		best[k] = o->alone[node];
	for (uint32_t c = 0; c < n && !o->failed; c++) {
		solve(o, child[c]);
		const double *own = o->best + (size_t)child[c] * o->cap;
		uint16_t *part = o->part + (size_t)child[c] * o->cap;
		for (uint32_t k = 0; k < o->cap; k++) {
			next[k] = (double)INFINITY;
			for (uint32_t mine = c ? 0 : k; mine <= k; mine++) {
				if (c && mine == k) /* nothing is left for those before */
					break;
				const double cost = own[mine] + (c ? now[k - mine - 1] : 0);
				if (cost < next[k]) {
					next[k] = cost;
					part[k] = (uint16_t)mine;
				}
			}
		}
		double *const keep = now;
		now = next;
		next = keep;
	}
	for (uint32_t k = 0; n && !o->failed && k < o->cap; k++)
		best[k] = fmin(best[k], now[k]);
	free(now);
	free(next);
}

static void gather(struct optimum *o, uint32_t node, uint32_t k)
{
	uint32_t child[8], mine[8];
	const uint32_t n = bb_tree_children(o->t, node, child);

	if (!n || !(o->best[(size_t)node * o->cap + k] < o->alone[node])) {
		o->out[o->n++] = (struct bb_choice){ .node = node, .tau = o->tau[node] };
		return;
	}
	for (uint32_t c = n; c-- > 0;) {
		mine[c] = o->part[(size_t)child[c] * o->cap + k];
		k -= mine[c] + (c > 0);
	}
	for (uint32_t c = 0; c < n; c++)
		gather(o, child[c], mine[c]);
}

size_t bb_choose_optimum(const struct bb_tree *t, const float *cost, uint32_t step, uint32_t memory_bricks,
			 struct bb_choice *out)
{
	const uint32_t leaves = (uint32_t)bb_choose_most(t), cap = memory_bricks < leaves ? memory_bricks : leaves;
	struct optimum o = { .t = t, .cap = cap, .out = out };

	if (!cap || t->n_nodes > OPTIMUM_NODES_MOST || (uint64_t)t->n_nodes * cap > OPTIMUM_TABLE_MOST)
		return 0;
	double *alone = calloc(t->n_nodes, sizeof(*alone));
	uint32_t *tau = calloc(t->n_nodes, sizeof(*tau));
	o.best = calloc((size_t)t->n_nodes * cap, sizeof(*o.best));
	o.part = calloc((size_t)t->n_nodes * cap, sizeof(*o.part));
	o.alone = alone;
	o.tau = tau;
	for (uint32_t node = 0; node < t->n_nodes && alone && tau && o.best && o.part; node++) {
		alone[node] = (double)INFINITY;
		for (uint32_t at = 0;;) { /* all time nodes around the step */
			const struct bb_tree_span s = bb_tree_span(t, at);
			const double here = (double)cost[(uint64_t)at * t->n_nodes + node];
			if (here < alone[node]) {
				alone[node] = here;
				tau[node] = at;
			}
			if (s.to - s.from == 1)
				break;
			at = s.child[step >= bb_tree_span(t, s.child[1]).from];
		}
	}
	if (alone && tau && o.best && o.part) {
		solve(&o, 0);
		if (!o.failed)
			gather(&o, 0, cap - 1);
	}
	free(alone);
	free(tau);
	free(o.best);
	free(o.part);
	return o.n;
}
