/* sim/peer_canopen_lss.c: the node's LSS slave: selection by identity, fastscan, node id (CiA 305). */
#include "sim/peer_canopen.h"

#include <string.h>

static uint32_t argument(const struct bb_can_frame *f)
{
	return (uint32_t)f->bytes[1] | (uint32_t)f->bytes[2] << 8 | (uint32_t)f->bytes[3] << 16 |
	       (uint32_t)f->bytes[4] << 24;
}

static void reply(struct sim_co_node *n, uint8_t command, uint32_t value)
{
	const uint8_t bytes[8] = { command, (uint8_t)value, (uint8_t)(value >> 8), (uint8_t)(value >> 16),
		                   (uint8_t)(value >> 24), 0, 0, 0 };

	sim_co_send(n, CO_LSS_REPLY, bytes, 8);
}

static void fastscan(struct sim_co_node *n, const struct bb_can_frame *f)
{
	const uint8_t bit = f->bytes[5], sub = f->bytes[6], next = f->bytes[7];

	if (n->id != CO_NODE_NONE || n->lss.configuring)
		return; /* for those without an id only */
	if (bit == CO_LSS_RESET_SCAN) {
		n->lss.position = 0;
		reply(n, CO_LSS_FOUND, 0);
		return;
	}
	if (bit > 31 || sub > 3 || next > 3 || sub != n->lss.position)
		return;
	if ((n->identity[sub] ^ argument(f)) >> bit)
		return;
	reply(n, CO_LSS_FOUND, 0);
	n->lss.position = next;
	n->lss.configuring = !bit && next < sub;
}

static void selective(struct sim_co_node *n, const struct bb_can_frame *f)
{
	const uint8_t part = f->bytes[0] - CO_LSS_SELECT_VENDOR;

	if (part == 0)
		n->lss.selected = 0;
	if (part != n->lss.selected || argument(f) != n->identity[part]) {
		n->lss.selected = 0;
		return;
	}
	if (++n->lss.selected < 4)
		return;
	n->lss.selected = 0;
	n->lss.configuring = true;
	reply(n, CO_LSS_SELECTED, 0);
}

static void switch_global(struct sim_co_node *n, uint8_t mode)
{
	n->lss.configuring = mode == 1;
	n->lss.position = 0;
	if (mode == 0 && n->id == CO_NODE_NONE && n->pending_id != CO_NODE_NONE)
		sim_co_reset(n, bb_clock_now_ns(n->clk)); /* its first id: it boots */
}

static void configure(struct sim_co_node *n, const struct bb_can_frame *f)
{
	const uint8_t id = f->bytes[1];

	switch (f->bytes[0]) {
	case CO_LSS_SET_NODE:
		if ((id >= 1 && id <= CO_NODE_MOST) || id == CO_NODE_NONE) {
			n->pending_id = id;
			reply(n, CO_LSS_SET_NODE, 0);
		} else
			reply(n, CO_LSS_SET_NODE, 1);
		break;
	case CO_LSS_STORE:
		n->stored_id = n->pending_id;
		reply(n, CO_LSS_STORE, 0);
		break;
	case CO_LSS_NODE:
		reply(n, CO_LSS_NODE, n->id);
		break;
	default:
		if (f->bytes[0] >= CO_LSS_IDENTITY && f->bytes[0] < CO_LSS_IDENTITY + 4)
			reply(n, f->bytes[0], n->identity[f->bytes[0] - CO_LSS_IDENTITY]);
		break;
	}
}

void sim_co_lss_frame(struct sim_co_node *n, const struct bb_can_frame *f)
{
	if (f->n_bytes != 8)
		return;
	if (f->bytes[0] == CO_LSS_FASTSCAN)
		fastscan(n, f);
	else if (f->bytes[0] >= CO_LSS_SELECT_VENDOR && f->bytes[0] < CO_LSS_SELECT_VENDOR + 4)
		selective(n, f);
	else if (f->bytes[0] == CO_LSS_SWITCH)
		switch_global(n, f->bytes[1]);
	else if (n->lss.configuring)
		configure(n, f);
}
