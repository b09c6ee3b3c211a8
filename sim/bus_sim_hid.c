/* sim/bus_sim_hid.c: see sim/bus_sim_hid.h. */
#include "sim/bus_sim_hid.h"

#include <stdlib.h>
#include <string.h>

struct sim_hid_bus {
	struct bb_hid_bus base;
	struct sim_peer_pad *peer;
	uint32_t generation;
};

static struct sim_hid_bus *of(struct bb_hid_bus *bus)
{
	return bb_container_of(bus, struct sim_hid_bus, base);
}

static bool stale(const struct sim_hid_bus *b)
{
	return !sim_peer_pad_plugged(b->peer) || sim_peer_pad_generation(b->peer) != b->generation;
}

static enum bb_status sim_read(struct bb_hid_bus *bus, uint8_t *report, size_t cap, size_t *n_out, int64_t *at_ns)
{
	*n_out = 0;
	*at_ns = bb_clock_now_ns(bus->clk);
	return stale(of(bus)) ? BB_ERR_LOST : sim_peer_pad_take(of(bus)->peer, report, cap, n_out, at_ns);
}

static enum bb_status sim_write(struct bb_hid_bus *bus, const uint8_t *report, size_t n)
{
	return stale(of(bus)) ? BB_ERR_LOST : sim_peer_pad_give(of(bus)->peer, report, n);
}

static enum bb_status sim_descriptor(struct bb_hid_bus *bus, uint8_t *bytes, size_t cap, size_t *n_out)
{
	size_t n = 0;
	const uint8_t *from = sim_peer_pad_descriptor(of(bus)->peer, &n);

	*n_out = 0;
	if (stale(of(bus)))
		return BB_ERR_LOST;
	if (!from || n > cap)
		return BB_ERR_IO;
	memcpy(bytes, from, n);
	*n_out = n;
	return BB_OK;
}

static void sim_close(struct bb_hid_bus *bus)
{
	if (bus)
		free(of(bus));
}

static const struct bb_hid_ops ops = { sim_read, sim_write, sim_descriptor, sim_close };

enum bb_status sim_hid_bus_open(struct sim_peer_pad *peer, struct bb_clock *clk, struct bb_hid_bus **out)
{
	*out = NULL;
	if (!sim_peer_pad_plugged(peer))
		return BB_ERR_LOST;
	struct sim_hid_bus *b = calloc(1, sizeof(*b));
	if (!b)
		return BB_ERR_NOMEM;
	*b = (struct sim_hid_bus){ { &ops, clk }, peer, sim_peer_pad_generation(peer) };
	*out = &b->base;
	return BB_OK;
}
