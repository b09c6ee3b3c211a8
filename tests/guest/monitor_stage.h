/*
 * tests/guest/monitor_stage.h: what the guest's monitor programs share: a farm of simulated monitors on the kernel's i2c
 * buses, our driver on one of them, a question and its answer. Real time.
 */
#ifndef BB_TESTS_GUEST_MONITOR_STAGE_H
#define BB_TESTS_GUEST_MONITOR_STAGE_H

#include "drivers/monitor_ddc.h"
#include "tests/guest/measure.h"
#include "tests/monitor_farm.h"
#include "tests/sim_rig.h"

#define STAGE_SEED 7

struct stage {
	struct rig *rig;
	struct farm *farm;
};

static inline void stage_begin(struct stage *s)
{
	struct bb_clock *clk;

	if (!vhci_there()) {
		printf("SKIP: no %sattach: modprobe vhci-hcd as root\n", VHCI);
		exit(77);
	}
	NEED(bb_clock_posix_create(&clk) == BB_OK);
	s->rig = rig_create_on(clk, STAGE_SEED, 1);
	NEED(farm_create(clk, &s->farm));
}

static inline void stage_end(struct stage *s)
{
	farm_destroy(s->farm);
	rig_destroy(s->rig);
}

/* Another monitor, of that model, not plugged in yet. */
static inline size_t stage_add(struct stage *s, const char *id, const char *edid)
{
	struct bb_monitor_config c = { .input = 0x0F };

	snprintf(c.id, sizeof(c.id), "%s", id);
	snprintf(c.edid, sizeof(c.edid), "%s", edid);
	NEED(farm_add(s->farm, &c, s->rig->world, STAGE_SEED));
	return s->farm->n - 1;
}

/* Plugs it in; bus is its node. */
static inline void stage_plug(struct stage *s, size_t i, char *bus, size_t cap)
{
	NEED(farm_plug(s->farm, i));
	NEED(farm_wait_bus(s->farm->monitor[i].usb.config.id, bus, cap));
}

static inline uint16_t stage_truth(struct stage *s, size_t i, uint8_t code, bool *has)
{
	uint16_t value = 0;

	farm_lock(s->farm);
	*has = peer_ddcci_value(s->farm->monitor[i].usb.monitor, code, &value);
	farm_unlock(s->farm);
	return value;
}

static inline struct peer_counts stage_counts(struct stage *s, size_t i)
{
	farm_lock(s->farm);
	const struct peer_counts counts = *peer_ddcci_counts(s->farm->monitor[i].usb.monitor);
	farm_unlock(s->farm);
	return counts;
}

static inline struct bb_monitor *stage_open(struct stage *s, const char *uri)
{
	const struct bb_monitor_config c = { .id = "ours" };
	struct bb_monitor *m;

	NEED(bb_uri_parse(uri, &s->rig->uri, NULL, NULL) == BB_OK);
	NEED(bb_monitor_open(&monitor_ddc_driver, &c, &s->rig->open, &m) == BB_OK);
	return m;
}

static inline struct bb_monitor *stage_open_bus(struct stage *s, const char *bus)
{
	char uri[80];

	snprintf(uri, sizeof(uri), "i2c:%s", bus);
	return stage_open(s, uri);
}

static inline struct bb_monitor_reply stage_ask(struct stage *s, struct bb_monitor *m, enum bb_monitor_request_kind kind,
						uint8_t code, uint16_t value)
{
	const struct bb_monitor_request q = { kind, code, value };
	struct bb_monitor_reply reply = { 0 };

	NEED(bb_monitor_submit(m, &q) == BB_OK);
	for (int i = 0; bb_monitor_poll(m, &reply) == BB_TIMEOUT; i++) {
		NEED(i < 100000);
		rig_pass(s->rig, 2 * RIG_MS);
	}
	return reply;
}

#endif
