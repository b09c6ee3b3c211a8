/*
 * tests/fixture_can.h: the CAN driver over a simulated medium with a chain of simulated controllers at its far end.
 * Header only, on top of tests/fixture_room.h.
 */
#ifndef BB_TESTS_FIXTURE_CAN_H
#define BB_TESTS_FIXTURE_CAN_H

#include "drivers/shutter_can.h"
#include "sim/peer_shutter.h"
#include "tests/fixture_room.h"

#define CAN_NODE 5

struct can_far {
	struct sim_can *can;
	struct sim_chain *chain;
};

static inline void can_far_wire(struct rig *rig, struct can_far *far, int64_t bitrate, uint8_t node)
{
	const struct sim_chain_config c = { .chain = &rig->fix.room.chain, .node = node, .duty_ppm = 1000000,
		                            .watchdog_ms = 100, .fidelity = rig->fidelity, .seed = rig->seed };

	assert_int_equal(sim_can_create(rig->clk, bitrate, rig->seed, &far->can), BB_OK);
	assert_int_equal(sim_chain_create(&c, far->can, rig->world, rig->log, &far->chain), BB_OK);
}

/* Opens the driver on the medium; the clock does not move. */
static inline struct bb_shutter *can_far_driver(struct rig *rig, struct can_far *far)
{
	struct bb_shutter *sh = NULL;

	rig_option(rig, "node", "5");
	rig_option(rig, "stamp_error_us", "1");
	const struct bb_open open = rig_open(rig);
	assert_int_equal(bb_shutter_can_open_on(sim_can_bus(far->can), &rig->fix.room.chain, &open, &sh), BB_OK);
	return sh;
}

/* Until every controller is configured and SYNC has settled; ns it took. */
static inline int64_t can_far_bring_up(struct rig *rig, struct bb_shutter *sh, int64_t most_ns)
{
	const int64_t from_ns = bb_clock_now_ns(rig->clk);

	while (bb_shutter_can_status(sh).health != BB_HEALTH_OK) {
		if (bb_clock_now_ns(rig->clk) - from_ns > most_ns)
			fail_msg("not ready after %lld ms: %s", (long long)(most_ns / MS),
			         bb_shutter_device(sh)->last_error.detail);
		rig_run(rig, MS);
	}
	return bb_clock_now_ns(rig->clk) - from_ns;
}

static inline struct bb_shutter *can_far_open(struct rig *rig, struct can_far *far)
{
	can_far_wire(rig, far, 1000000, CAN_NODE);
	struct bb_shutter *sh = can_far_driver(rig, far);
	can_far_bring_up(rig, sh, BB_NS_PER_S);
	return sh;
}

static inline void can_far_close(struct can_far *far)
{
	sim_chain_destroy(far->chain);
	sim_can_destroy(far->can);
}

#endif
