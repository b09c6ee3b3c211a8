/*
 * tests/fuzz/deep_peer_canopen.c: any frames into the simulated controllers, which `serve` puts on a wire that other
 * programs write to. Input: one byte (1: they have ids), then records of 12 bytes: id low, id high, length, 100 us
 * units to wait, 8 data bytes; the kind in the id's high byte makes most of them SDO, NMT or LSS requests.
 */
#include "sim/peer_shutter.h"
#include "sim/world.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void feed(struct sim_can *can, struct bb_clock *clk, const uint8_t *d)
{
	static const uint32_t ids[] = { 0x605, 0x605, 0x606, 0x606, 0x000, 0x7e5, 0x080, 0x77f };
	struct bb_can_frame f = { .id = (uint32_t)d[0] | (uint32_t)(d[1] & 7) << 8, .n_bytes = d[2] % 9 };

	if (d[1] & 0x80) {
		f.id = ids[d[1] >> 3 & 7];
		f.n_bytes = f.id == 0 ? 2 : f.id == 0x77f ? 1 : f.id == 0x080 ? d[2] & 1 : 8;
	}
	memcpy(f.bytes, d + 4, 8);
	sim_can_inject(can, &f);
	bb_clock_run_until(clk, bb_clock_now_ns(clk) + (1 + d[3] % 64) * INT64_C(100000));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_node node = { .id = "head", .head = true };
	struct bb_room room = { .has_chain = true, .n_nodes = 1, .nodes = &node, .eye_separation_m = 0.063 };
	struct bb_clock *clk;
	struct sim_world *world = NULL;
	struct sim_can *can = NULL;
	struct sim_chain *chain = NULL;

	room.chain = (struct bb_shutter_config){ .id = "chain", .rate = { 120, 1 }, .n_stages = 1, .stage = { "front" },
		                                 .stage_delay_us = 35, .emitter_offset_us = 3000 };
	const struct sim_chain_config c = { .chain = &room.chain, .node = size && data[0] & 1 ? 5 : CO_NODE_NONE,
		                            .duty_ppm = 1000000, .watchdog_ms = 100, .fidelity = 0, .seed = 1 };
	if (bb_clock_virtual_create(&clk) != BB_OK)
		return 0;
	if (sim_world_create(&room, NULL, NULL, clk, NULL, 1, &world) == BB_OK &&
	    sim_can_create(clk, 1000000, 1, &can) == BB_OK && sim_chain_create(&c, can, world, NULL, &chain) == BB_OK)
		for (size_t at = 1; at + 12 <= size && at < 12 * 128; at += 12)
			feed(can, clk, data + at);
	sim_chain_destroy(chain);
	sim_can_destroy(can);
	sim_world_destroy(world);
	bb_clock_destroy(clk);
	return 0;
}
