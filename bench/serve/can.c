/*
 * bench/serve/can.c: the shutter chain of a room on a CAN interface, as controllers of docs/shutter-od.md. A CAN has no
 * addresses of machines, so there is nothing to keep out; what must not be is that simulated controllers meet real
 * ones: an interface with a cable is refused unless it was said that it is meant.
 */
#include "bench/serve/serve.h"

#include <stdio.h>
#include <stdlib.h>

#include "sim/can_link.h"
#include "sim/peer_shutter.h"

#define BITRATE 1000000
#define NODE 1

struct chain {
	struct sim_can *can;
	struct sim_can_link *link;
	struct sim_chain *chain;
};

static enum bb_status put_chain(struct bb_serve *s, struct chain *c, struct bb_error *err)
{
	const struct bb_shutter_config *config = &s->room->chain;
	const struct sim_chain_config sim = { .chain = config, .node = NODE, .duty_ppm = 1000000, .watchdog_ms = 100,
		                              .fidelity = 1, .seed = 1 };
	enum bb_status status = sim_chain_create(&sim, c->can, s->world, NULL, &c->chain);

	if (status == BB_OK)
		status = sim_world_register(s->world, "can", config->id, c->chain, sim_chain_can_verbs);
	if (status == BB_OK)
		status = sim_world_register(s->world, "shutter", config->id, c->chain, sim_chain_shutter_verbs);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1702, NULL, "shutter/%s", config->id);
}

static enum bb_status attach(struct bb_serve *s, void **state, struct bb_error *err)
{
	const char *interface = bb_cli_get(s->cli, "can", NULL);
	struct chain *c = NULL;

	if (!interface)
		return BB_OK;
	if (!s->room->has_chain || !bb_serve_simulated(s->room->chain.device))
		return bb_fail(err, BB_ERR_CONFIG, 1573, NULL, "--can, but %s has no simulated shutter chain",
		               s->room->path);
	*state = c = calloc(1, sizeof(*c));
	if (!c || sim_can_create(s->clk, BITRATE, 1, &c->can) != BB_OK)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "--can %.20s", interface);
	enum bb_status status = sim_can_link_open(interface, c->can, s->clk, &c->link, err);
	if (status != BB_OK)
		return status;
	if (!bb_cli_has(s->cli, "can-hardware") && !sim_can_link_is_virtual(interface))
		return bb_fail(err, BB_ERR_USAGE, 1578, NULL, "%s", interface);
	status = put_chain(s, c, err);
	if (status != BB_OK)
		return status;
	struct bb_serve_row *row = bb_serve_add(s, "can", "shutter", s->room->chain.id, err);
	if (!row || !sim_wire_watch(s->wire, sim_can_link_fd(c->link)))
		return row ? bb_fail(err, BB_ERR_INTERNAL, 1571, NULL, "too many wires") : BB_ERR_RANGE;
	snprintf(row->where, sizeof(row->where), "%s", interface);
	snprintf(row->attach, sizeof(row->attach), "can:%s?node=%d", interface, NODE);
	return BB_OK;
}

/* What the controllers say goes out by their own timers. */
static int64_t step(struct bb_serve *s, void *state, int64_t now_ns)
{
	const struct chain *c = state;

	(void)s;
	(void)now_ns;
	if (c)
		sim_can_link_serve(c->link);
	return BB_NEVER;
}

static void detach(struct bb_serve *s, void *state)
{
	struct chain *c = state;

	for (int twice = 0; c && c->chain && twice < 2; twice++)
		sim_world_unregister(s->world, c->chain);
	if (c) {
		sim_chain_destroy(c->chain);
		sim_can_link_close(c->link);
		sim_can_destroy(c->can);
	}
	free(c);
}

const struct bb_serve_kind bb_serve_can = { "can", attach, step, detach };
