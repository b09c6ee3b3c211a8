/* drivers/can_guard.c: see drivers/can_guard.h. */
#include "drivers/can_guard.h"

#include <string.h>

#define CONTRACT_DEFAULT 20 /* per second, of an id nobody has promised anything for */
#define TIMES 3
#define BURST_NS INT64_C(50000000) /* at the highest rate, so that a flood shows within 100 ms */
#define BURST_LEAST 8
#define FRAME_BITS 111
#define BITRATE_DEFAULT 1000000

void bb_can_guard_init(struct bb_can_guard *g, int64_t bitrate)
{
	memset(g, 0, sizeof(*g));
	g->load_most_per_s = (bitrate > 0 ? bitrate : BITRATE_DEFAULT) * 3 / 10 / FRAME_BITS;
	for (uint32_t i = 0; i < BB_CAN_IDS; i++)
		g->id[i].contract_per_s = CONTRACT_DEFAULT;
}

void bb_can_guard_contract(struct bb_can_guard *g, uint32_t id, uint32_t per_s)
{
	if (id < BB_CAN_IDS)
		g->id[id].contract_per_s = per_s ? per_s : 1;
}

static int64_t cost_ns(const struct bb_can_guard *g, uint32_t id)
{
	const int64_t promised = TIMES * (int64_t)g->id[id].contract_per_s;
	const int64_t most = promised < g->load_most_per_s ? promised : g->load_most_per_s;

	return BB_NS_PER_S / (most > 0 ? most : 1);
}

static int64_t depth_ns(int64_t cost)
{
	return cost * BURST_LEAST > BURST_NS ? cost * BURST_LEAST : BURST_NS;
}

enum bb_can_verdict bb_can_guard_frame(struct bb_can_guard *g, uint32_t id, int64_t at_ns)
{
	if (id >= BB_CAN_IDS)
		return BB_CAN_PASS;
	const int64_t cost = cost_ns(g, id), depth = depth_ns(cost);
	if (!g->id[id].seen)
		g->id[id].tokens_ns = depth;
	else if (at_ns > g->id[id].last_ns)
		g->id[id].tokens_ns += at_ns - g->id[id].last_ns;
	g->id[id].seen = true;
	g->id[id].last_ns = at_ns;
	if (g->id[id].tokens_ns > depth)
		g->id[id].tokens_ns = depth;
	const bool within = g->id[id].tokens_ns >= cost;
	if (within)
		g->id[id].tokens_ns -= cost;
	else
		g->id[id].excess_ns = at_ns;
	if (within && !g->id[id].babbles)
		return BB_CAN_PASS;
	g->id[id].filtered++;
	if (g->id[id].babbles)
		return BB_CAN_FILTERED;
	g->id[id].babbles = true;
	g->n_babbling++;
	return BB_CAN_BABBLE_BEGINS;
}

uint32_t bb_can_guard_poll(struct bb_can_guard *g, int64_t now_ns)
{
	for (uint32_t i = 0; g->n_babbling && i < BB_CAN_IDS; i++)
		if (g->id[i].babbles && now_ns - g->id[i].excess_ns >= BB_CAN_CALM_NS) {
			g->id[i].babbles = false;
			g->n_babbling--;
		}
	return g->n_babbling;
}

bool bb_can_queue_put(struct bb_can_queue *q, const struct bb_can_frame *frame, bool state)
{
	for (uint32_t i = 0; state && i < q->n; i++)
		if (q->state[i] && q->frame[i].id == frame->id) {
			q->frame[i] = *frame;
			return true;
		}
	if (q->n == BB_CAN_QUEUE) {
		q->dropped++;
		return false;
	}
	q->frame[q->n] = *frame;
	q->state[q->n++] = state;
	return true;
}

enum bb_status bb_can_queue_flush(struct bb_can_queue *q, struct bb_can_bus *bus)
{
	enum bb_status status = BB_OK;
	uint32_t sent = 0;

	while (sent < q->n && (status = bus->ops->send(bus, &q->frame[sent])) == BB_OK)
		sent++;
	q->n -= sent;
	q->sent += sent;
	memmove(q->frame, q->frame + sent, q->n * sizeof(q->frame[0]));
	memmove(q->state, q->state + sent, q->n * sizeof(q->state[0]));
	return status;
}
