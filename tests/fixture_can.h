/*
 * tests/fixture_can.h: the CAN driver over a simulated medium with a chain of simulated controllers at its far end.
 * Header only, on top of tests/fixture_room.h.
 */
#ifndef BB_TESTS_FIXTURE_CAN_H
#define BB_TESTS_FIXTURE_CAN_H

#include "drivers/shutter_can.h"
#include "sim/can_link.h"
#include "sim/peer_shutter.h"
#include "tests/fixture_room.h"

#define CAN_NODE 5

struct can_far {
	struct sim_can *can;
	struct sim_chain *chain;
	struct bb_clock *clk;
	struct sim_can_link *link; /* where the wire is an interface of the kernel's */
	struct bb_timer timer;
};

static inline void can_far_chain(struct rig *rig, struct can_far *far, uint8_t node)
{
	const struct sim_chain_config c = { .chain = &rig->fix.room.chain, .node = node, .duty_ppm = 1000000,
		                            .watchdog_ms = 100, .fidelity = rig->fidelity, .seed = rig->seed };

	assert_int_equal(sim_chain_create(&c, far->can, rig->world, rig->log, &far->chain), BB_OK);
}

static inline void can_far_wire(struct rig *rig, struct can_far *far, int64_t bitrate, uint8_t node)
{
	*far = (struct can_far){ .clk = rig->clk };
	assert_int_equal(sim_can_create(rig->clk, bitrate, rig->seed, &far->can), BB_OK);
	can_far_chain(rig, far, node);
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

/* What the host says is looked for that often; what the peers say goes out when they say it. */
static inline int64_t can_far_look(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	const struct can_far *far = bb_container_of(timer, struct can_far, timer);

	(void)scheduled_ns;
	sim_can_link_serve(far->link);
	return now_ns + 500 * US;
}

/* Both ends on an interface of this kernel: the driver's own socket, and one of the peers. Real time. */
static inline struct bb_shutter *can_far_open_on(struct rig *rig, struct can_far *far, const char *interface,
                                                 uint8_t node)
{
	struct bb_error err = { 0 };
	struct bb_shutter *sh = NULL;
	struct bb_uri uri;
	char text[64];

	*far = (struct can_far){ .clk = rig->clk };
	assert_int_equal(sim_can_create(rig->clk, 1000000, rig->seed, &far->can), BB_OK);
	if (sim_can_link_open(interface, far->can, rig->clk, &far->link, &err) != BB_OK)
		fail_msg("%s", err.text);
	far->timer = (struct bb_timer){ .step = can_far_look };
	assert_int_equal(bb_clock_arm(rig->clk, &far->timer, 0), BB_OK);
	can_far_chain(rig, far, node);
	snprintf(text, sizeof(text), "can:%s?node=%d&lss_ms=5", interface, CAN_NODE);
	assert_int_equal(bb_uri_parse(text, &uri, NULL, &err), BB_OK);
	const struct bb_open open = { .clk = rig->clk, .events = rig->log, .uri = &uri, .seed = rig->seed };
	assert_int_equal(bb_shutter_open(&bb_shutter_can_driver, &rig->fix.room.chain, &open, &sh), BB_OK);
	can_far_bring_up(rig, sh, node == CO_NODE_NONE ? 20 * BB_NS_PER_S : 2 * BB_NS_PER_S);
	return sh;
}

static inline void can_far_close(struct can_far *far)
{
	sim_chain_destroy(far->chain);
	if (far->link)
		bb_clock_disarm(far->clk, &far->timer);
	sim_can_link_close(far->link);
	sim_can_destroy(far->can);
}

#endif
