#include "sync/barrier.h"

#include <string.h>

void bb_barrier_init(struct bb_barrier *b, unsigned n_nodes, int64_t timeout_ns, unsigned drop_after)
{
	memset(b, 0, sizeof(*b));
	b->n_nodes = n_nodes < BB_BARRIER_NODES_MAX ? n_nodes : BB_BARRIER_NODES_MAX;
	b->timeout_ns = timeout_ns;
	b->drop_after = drop_after;
}

void bb_barrier_open(struct bb_barrier *b, uint64_t frame, uint64_t nodes, int64_t now_ns)
{
	b->open = true;
	b->frame = frame;
	b->opened_ns = now_ns;
	b->deadline_ns = now_ns + b->timeout_ns;
	b->waited = nodes & ~b->dropped;
	b->arrived = 0;
}

void bb_barrier_arrive(struct bb_barrier *b, unsigned node, uint64_t frame, int64_t now_ns)
{
	if (node >= b->n_nodes)
		return;
	const uint64_t bit = UINT64_C(1) << node;
	b->dropped &= ~bit;
	if (!b->open || frame != b->frame || (b->arrived & bit))
		return;
	b->arrived |= bit;
	b->arrived_ns[node] = now_ns;
}

void bb_barrier_drop(struct bb_barrier *b, unsigned node)
{
	if (node < b->n_nodes)
		b->dropped |= UINT64_C(1) << node;
}

static void count_misses(struct bb_barrier *b, uint64_t missing)
{
	for (unsigned i = 0; i < b->n_nodes; i++) {
		const uint64_t bit = UINT64_C(1) << i;
		if (!(b->waited & bit))
			continue;
		b->misses[i] = missing & bit ? b->misses[i] + 1 : 0;
		if (b->misses[i] >= b->drop_after)
			b->dropped |= bit;
	}
}

bool bb_barrier_step(struct bb_barrier *b, int64_t now_ns, struct bb_release *out)
{
	const uint64_t missing = b->waited & ~b->arrived;

	if (!b->open || ((missing & ~b->dropped) && now_ns < b->deadline_ns))
		return false;
	*out = (struct bb_release){ .frame = b->frame, .missing = missing, .last_ns = b->opened_ns, .first_ns = now_ns };
	for (unsigned i = 0; i < b->n_nodes; i++) {
		const uint64_t bit = UINT64_C(1) << i;
		if ((b->arrived & bit) && !missing && b->arrived_ns[i] >= out->last_ns) {
			out->last = i;
			out->last_ns = b->arrived_ns[i];
		}
		if ((b->arrived & bit) && b->arrived_ns[i] < out->first_ns)
			out->first_ns = b->arrived_ns[i];
		if (missing & bit) {
			out->last = i;
			out->last_ns = now_ns;
		}
	}
	count_misses(b, missing);
	b->open = false;
	return true;
}
