/* sim/bus_sim_i2c.c: see sim/bus_sim_i2c.h. */
#include "sim/bus_sim_i2c.h"

#include <stdlib.h>

#define MAINS_LOOK_NS INT64_C(100000000)
#define HELD_NS INT64_C(2000000) /* until an adapter gives up on a line that stays low */

struct bus_sim {
	struct bb_i2c_bus base;
	struct peer_ddcci *peer;
	struct bus_sim_adapter *adapter, own;
	struct bb_timer mains;
};

static enum bb_status of_wire(enum peer_wire wire)
{
	switch (wire) {
	case PEER_ACK:
		return BB_OK;
	case PEER_NO_ACK:
		return BB_ERR_LOST;
	case PEER_ERROR:
	case PEER_HELD:
		return BB_ERR_IO;
	}
	return BB_ERR_INTERNAL;
}

/* Returns when the message is over on the wire. */
static int64_t one_message(struct bus_sim *b, const struct bb_i2c_message *m, int64_t at_ns, enum peer_wire *wire)
{
	const int64_t end_ns = at_ns + (1 + m->n_bytes) * BUS_SIM_I2C_BYTE_NS;

	*wire = m->read ? peer_ddcci_read(b->peer, m->address, m->bytes, m->n_bytes, at_ns)
			: peer_ddcci_write(b->peer, m->address, m->bytes, m->n_bytes, at_ns, end_ns);
	if (*wire == PEER_HELD)
		return at_ns + HELD_NS;
	return *wire == PEER_ACK ? end_ns : at_ns + BUS_SIM_I2C_BYTE_NS;
}

static enum bb_status transfer(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n)
{
	struct bus_sim *b = bb_container_of(bus, struct bus_sim, base);
	struct bus_sim_adapter *a = b->adapter;
	int64_t at_ns = bb_clock_now_ns(bus->clk);
	enum peer_wire wire = PEER_ACK;

	bus->free_ns = a->free_ns;
	if (at_ns < a->free_ns)
		return BB_ERR_BUSY;
	if (a->mux && a->selected != bus)
		at_ns += 2 * BUS_SIM_I2C_BYTE_NS;
	a->selected = bus;
	a->transfers++;
	for (size_t i = 0; i < n && wire == PEER_ACK; i++)
		at_ns = one_message(b, &messages[i], at_ns, &wire);
	peer_ddcci_stop(b->peer);
	bus->free_ns = a->free_ns = at_ns;
	return of_wire(wire);
}

static int64_t look_at_mains(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	(void)now_ns;
	peer_ddcci_look(bb_container_of(timer, struct bus_sim, mains)->peer, scheduled_ns);
	return scheduled_ns + MAINS_LOOK_NS;
}

static void close_bus(struct bb_i2c_bus *bus)
{
	struct bus_sim *b = bb_container_of(bus, struct bus_sim, base);

	bb_clock_disarm(bus->clk, &b->mains);
	free(b);
}

static const struct bb_i2c_ops ops = { transfer, close_bus };

enum bb_status bus_sim_i2c_create(struct bb_clock *clk, struct peer_ddcci *peer, struct bus_sim_adapter *adapter,
				  struct bb_i2c_bus **out)
{
	struct bus_sim *b = calloc(1, sizeof(*b));

	*out = NULL;
	if (!b)
		return BB_ERR_NOMEM;
	b->base = (struct bb_i2c_bus){ .ops = &ops, .clk = clk };
	b->peer = peer;
	b->adapter = adapter ? adapter : &b->own;
	b->mains = (struct bb_timer){ .step = look_at_mains, .rank = 1 };
	/* The world does not call back when mains go; a monitor on an outlet has to look. */
	if (peer_ddcci_on_outlet(peer) && bb_clock_arm(clk, &b->mains, bb_clock_now_ns(clk) + MAINS_LOOK_NS) != BB_OK) {
		free(b);
		return BB_ERR_NOMEM;
	}
	*out = &b->base;
	return BB_OK;
}
