/*
 * tests/test_faults_monitor.c: every fault row of a monitor on its wires (D1-D9), injected in the simulated display,
 * found by the driver within its budget, named, and recovered from. Times are on the virtual clock.
 */
#include "drivers/monitor_ddc.h"
#include "drivers/vcp_capabilities.h"
#include "tests/fault_table.h"
#include "sim/bus_sim_i2c.h"
#include "tests/monitor_numbers.h"
#include "tests/sim_rig.h"

#include <stdio.h>

struct bench {
	struct rig *rig;
	struct peer_ddcci *peer;
	struct bb_monitor *m;
	struct bb_i2c_bus *bus;
	const struct monitor_ddc_report *report;
};

static struct bench begin(void)
{
	const struct bb_monitor_config c = { .id = "m1",
					     .node = "front",
					     .device = "i2c:",
					     .edid = "S27A850D",
					     .outlet = "pdu1/2",
					     .width_px = 2560,
					     .height_px = 1440,
					     .rate = { 60, 1 },
					     .input = 0x0F };
	struct bench t = { .rig = rig_create(11, 1) };

	assert_int_equal(peer_ddcci_create(&c, t.rig->world, 11, 0, &t.peer), BB_OK);
	assert_int_equal(bus_sim_i2c_create(t.rig->clk, t.peer, NULL, &t.bus), BB_OK);
	assert_int_equal(monitor_ddc_open_on(t.bus, &c, &t.rig->open, &t.m), BB_OK);
	t.report = monitor_ddc_report(t.m);
	return t;
}

static void end(struct bench *t)
{
	/* Whatever happened, nothing was saved and no message came inside a wait. */
	assert_int_equal(peer_ddcci_counts(t->peer)->saves, 0);
	assert_int_equal(peer_ddcci_counts(t->peer)->too_early, 0);
	assert_int_equal(peer_ddcci_counts(t->peer)->damaged, 0);
	bb_monitor_close(t->m);
	peer_ddcci_destroy(t->peer);
	rig_destroy(t->rig);
}

static void submit(struct bench *t, enum bb_monitor_request_kind kind, uint8_t code, uint16_t value)
{
	const struct bb_monitor_request request = { kind, code, value };

	assert_int_equal(bb_monitor_submit(t->m, &request), BB_OK);
}

static struct bb_monitor_reply take(struct bench *t)
{
	struct bb_monitor_reply reply;
	const int64_t end_ns = rig_now(t->rig) + 10 * RIG_S;

	while (bb_monitor_poll(t->m, &reply) == BB_TIMEOUT) {
		assert_true(rig_now(t->rig) < end_ns);
		rig_pass(t->rig, RIG_MS);
	}
	return reply;
}

static struct bb_monitor_reply ask(struct bench *t, enum bb_monitor_request_kind kind, uint8_t code, uint16_t value)
{
	submit(t, kind, code, value);
	return take(t);
}

/* Of the thing, or of its wires. */
static void inject(struct bench *t, const char *verb, bool on)
{
	const struct sim_verb *v = peer_ddcci_wire_verbs;

	while (v->name && strcmp(v->name, verb))
		v++;
	assert_int_equal(rig_fault(t->rig, v->name ? "ddc" : "monitor", "m1", verb, "", on), BB_OK);
}

/* Lets time pass in steps of 1 ms until health (and fault, unless NONE) is this. Returns how long that took, ms. */
static double until(struct bench *t, enum bb_health health, enum ddc_fault fault, double most_ms)
{
	const int64_t start_ns = rig_now(t->rig);

	for (;;) {
		const struct ddc_health *h = &monitor_ddc_report(t->m)->health;
		const double ms = (double)(rig_now(t->rig) - start_ns) / 1e6;
		if (h->health == health && (fault == DDC_FAULT_NONE || h->fault == fault))
			return ms;
		if (ms > most_ms)
			fail_msg("after %.0f ms: %s, %s", ms, bb_health_text(h->health), ddc_fault_text(h->fault));
		rig_pass(t->rig, RIG_MS);
	}
}

/* The same for a fault that does not last: until it was seen once. */
static double until_seen(struct bench *t, enum ddc_fault fault, double most_ms)
{
	const int64_t start_ns = rig_now(t->rig);

	while (!monitor_ddc_report(t->m)->health.count[fault]) {
		rig_pass(t->rig, RIG_MS);
		if ((double)(rig_now(t->rig) - start_ns) / 1e6 > most_ms)
			fail_msg("after %.0f ms: no %s", most_ms, ddc_fault_text(fault));
	}
	return (double)(rig_now(t->rig) - start_ns) / 1e6;
}

static void check_named(struct bench *t, const char *name)
{
	const struct bb_last_error *e = &bb_monitor_device(t->m)->last_error;

	if (strncmp(e->detail, name, strlen(name)))
		fail_msg("\"%s\" does not begin with %s", e->detail, name);
}

static void row(const char *name, const char *injected, double detected_ms, double budget_ms, const char *report,
		double recovered_ms)
{
	fault_row(name, injected, report, (int64_t)(detected_ms * 1e6), (int64_t)(budget_ms * 1e6),
	          recovered_ms < 0 ? BB_NEVER : (int64_t)(recovered_ms * 1e6));
	assert_true(detected_ms <= budget_ms);
}

/* ---- the rows ---- */

#define TRY_MS 45 /* one exchange at 100 kHz with its wait */

/* Faults that spoil every exchange: found in the first, the request gives up or waits, and all is well afterwards. */
static void spoils(const char *name, const char *verb, enum bb_health health, enum ddc_fault fault, double budget_ms,
		   enum bb_status status)
{
	struct bench t = begin();

	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_CONTRAST, 0).status, BB_OK);
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	rig_pass(t.rig, 100 * RIG_MS);
	inject(&t, verb, true);
	submit(&t, BB_MONITOR_GET, BB_VCP_RED_GAIN, 0);
	const double found_ms = until(&t, health, fault, budget_ms);
	check_named(&t, ddc_fault_text(fault));
	const struct bb_monitor_reply r = take(&t);
	assert_int_equal(r.status, status);
	assert_true(r.tries <= 10);
	/* The loop is never held: between requests the machine runs by itself. */
	inject(&t, verb, false);
	const double well_ms = until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 6000);
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_RED_GAIN, 0).status, BB_OK);
	row(name, verb, found_ms, budget_ms, ddc_fault_text(fault), well_ms);
	end(&t);
}

static void test_d1(void **state)
{
	(void)state;
	spoils("D1", "silent", BB_HEALTH_DEGRADED, DDC_FAULT_NAK, TRY_MS, BB_ERR_LOST);
	spoils("D1", "bus_error", BB_HEALTH_DEGRADED, DDC_FAULT_EIO, TRY_MS, BB_ERR_IO);
	spoils("D1", "unplug", BB_HEALTH_DEGRADED, DDC_FAULT_NAK, TRY_MS, BB_ERR_LOST);
	/* A try that fails costs its back-off and no more: the request itself succeeds. */
	struct bench t = begin();
	inject(&t, "bus_error", true);
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	rig_pass(t.rig, 120 * RIG_MS);
	inject(&t, "bus_error", false);
	const struct bb_monitor_reply r = take(&t);
	assert_int_equal(r.status, BB_OK);
	assert_true(r.tries >= 2 && r.tries <= 4);
	assert_int_equal(monitor_ddc_report(t.m)->tries[r.tries], 1);
	end(&t);
}

static void test_d2(void **state)
{
	(void)state;
	spoils("D2", "bad_checksum", BB_HEALTH_DEGRADED, DDC_FAULT_DATA, TRY_MS, BB_ERR_FORMAT);
	spoils("D2", "wrong_opcode", BB_HEALTH_DEGRADED, DDC_FAULT_DATA, TRY_MS, BB_ERR_FORMAT);
	struct bench t = begin(); /* the answer to the question before: seen by its code, and asked again */
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_CONTRAST, 0).status, BB_OK);
	rig_pass(t.rig, 100 * RIG_MS);
	inject(&t, "stale", true);
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	const double found_ms = until(&t, BB_HEALTH_DEGRADED, DDC_FAULT_DATA, TRY_MS);
	check_named(&t, "DDC_DATA");
	struct bb_monitor_reply r = take(&t);
	assert_int_equal(r.status, BB_OK);
	assert_int_equal(r.current, 75);
	inject(&t, "stale", false);
	row("D2", "stale", found_ms, TRY_MS, "DDC_DATA", until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 6000));
	end(&t);
}

/* The same Null, told apart. */
static void test_d3(void **state)
{
	(void)state;
	struct bench t = begin();

	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	peer_ddcci_quirks(t.peer)->null_for_unsupported = true;
	rig_pass(t.rig, 100 * RIG_MS);
	int64_t start_ns = rig_now(t.rig);
	submit(&t, BB_MONITOR_GET, 0x59, 0);
	const double found_ms = until_seen(&t, DDC_FAULT_NULL, TRY_MS);
	check_named(&t, "NULL 1");
	struct bb_monitor_reply r = take(&t);
	assert_int_equal(r.status, BB_ERR_UNSUPPORTED);
	const double learned_ms = (double)(r.done_ns - start_ns) / 1e6;
	assert_int_equal(monitor_ddc_report(t.m)->null_means, DDC_NULL_UNSUPPORTED);
	row("D3", "Null for an unknown code", found_ms, TRY_MS, "NULL n", learned_ms);
	/* What was learned persists: the next unknown code is found out sooner. */
	rig_pass(t.rig, 100 * RIG_MS);
	start_ns = rig_now(t.rig);
	r = ask(&t, BB_MONITOR_GET, 0x5A, 0);
	assert_int_equal(r.status, BB_ERR_UNSUPPORTED);
	assert_true((double)(r.done_ns - start_ns) / 1e6 < learned_ms - 100);
	/* A code that has answered before is busy when it says Null, and is asked until it answers. */
	peer_ddcci_quirks(t.peer)->busy_percent = 60;
	for (int i = 0; i < 50; i++) {
		r = ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
		assert_true(r.status == BB_OK || (r.status == BB_ERR_BUSY && r.tries == 10));
	}
	end(&t);
	/* A display that uses the flag: Null is busy. */
	t = begin();
	assert_int_equal(ask(&t, BB_MONITOR_GET, 0x59, 0).status, BB_ERR_UNSUPPORTED);
	assert_int_equal(monitor_ddc_report(t.m)->null_means, DDC_NULL_BUSY);
	inject(&t, "busy", true);
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	rig_pass(t.rig, 600 * RIG_MS);
	inject(&t, "busy", false);
	r = take(&t);
	assert_int_equal(r.status, BB_OK);
	assert_true(r.tries > 3);
	end(&t);
}

static void test_d4(void **state)
{
	(void)state;
	spoils("D4", "zero", BB_HEALTH_DEGRADED, DDC_FAULT_ZERO, TRY_MS, BB_ERR_IO);
	struct bench t = begin(); /* zeros for what it does not have */
	peer_ddcci_quirks(t.peer)->zero_for_unsupported = true;
	const struct bb_monitor_reply r = ask(&t, BB_MONITOR_GET, 0x59, 0);
	assert_int_equal(r.status, BB_ERR_UNSUPPORTED);
	assert_int_equal(r.tries, 3);
	end(&t);
}

static void test_d5(void **state)
{
	(void)state;
	struct bench t = begin();
	uint64_t tries = 0, n = 300;

	inject(&t, "slow", true);
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	const double found_ms = until_seen(&t, DDC_FAULT_SLOW, 1000);
	check_named(&t, "DDC_SLOW");
	struct bb_monitor_reply r = take(&t);
	assert_int_equal(r.status, BB_OK);
	assert_true(r.tries <= 4); /* three retries */
	for (uint64_t i = 0; i < n; i++) {
		r = ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
		assert_int_equal(r.status, BB_OK);
		tries += r.tries;
	}
	const double mean = (double)tries / (double)n, gap = monitor_ddc_report(t.m)->gap.permille / 1e3;
	assert_true(mean <= 1.4);
	assert_true(gap >= 1.5 && gap <= 2.0);
	inject(&t, "slow", false);
	int healed = 0;
	while (monitor_ddc_report(t.m)->gap.slow && healed++ < 20000)
		assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	print_message("     slow: %.2f tries a request at a gap of %.2f; back to 1.00 after %d requests\n", mean, gap,
		      healed);
	assert_false(monitor_ddc_report(t.m)->gap.slow);
	row("D5", "replies after 65 ms (3 retries)", found_ms, 1000, "DDC_SLOW", 0);
	end(&t);
}

static void asleep(const char *verb, const char *injected, bool no_ack)
{
	struct bench t = begin();
	const struct peer_counts *counts = peer_ddcci_counts(t.peer);

	peer_ddcci_quirks(t.peer)->no_ack_asleep = no_ack;
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	rig_pass(t.rig, 100 * RIG_MS);
	inject(&t, verb, true);
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	const double found_ms = until(&t, BB_HEALTH_DEGRADED, DDC_FAULT_STANDBY, 1000);
	check_named(&t, "DISP_STANDBY");
	assert_int_equal(take(&t).status, no_ack ? BB_ERR_LOST : BB_ERR_BUSY);
	/* Asleep, not missing: EDID answers. Told to change something it is asked first, and nothing is written. */
	assert_int_equal(ask(&t, BB_MONITOR_EDID, 0, 0).status, BB_OK);
	for (int i = 0; i < 5; i++)
		assert_int_not_equal(ask(&t, BB_MONITOR_SET, BB_VCP_LUMINANCE, 30).status, BB_OK);
	assert_int_equal(counts->writes_asleep, 0);
	const uint64_t before = counts->requests;
	rig_pass(t.rig, 20 * RIG_S); /* looks every 2 s */
	if (!no_ack)
		assert_in_range(counts->requests - before, 8, 11);
	inject(&t, verb, false);
	const double well_ms = until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 7000);
	assert_int_equal(ask(&t, BB_MONITOR_SET, BB_VCP_LUMINANCE, 30).status, BB_OK);
	row("D6", injected, found_ms, 1000, "DISP_STANDBY", well_ms);
	end(&t);
}

static void test_d6(void **state)
{
	(void)state;
	asleep("standby", "asleep, answers Null", false);
	asleep("off", "off, no acknowledge", true);
}

static void test_d7(void **state)
{
	(void)state;
	struct bench t = begin(), other = begin();

	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	rig_pass(t.rig, 100 * RIG_MS);
	inject(&t, "stuck", true);
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	const double found_ms = until(&t, BB_HEALTH_QUARANTINED, DDC_FAULT_STUCK, 100);
	check_named(&t, "I2C_STUCK");
	assert_int_equal(take(&t).status, BB_ERR_IO);
	assert_int_equal(ask(&other, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	const uint64_t transfers = monitor_ddc_report(t.m)->transfers;
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0); /* at once, and the wire is left alone */
	struct bb_monitor_reply r;
	assert_int_equal(bb_monitor_poll(t.m, &r), BB_OK);
	assert_int_equal(r.status, BB_ERR_IO);
	assert_int_equal(monitor_ddc_report(t.m)->transfers, transfers);
	inject(&t, "stuck", false);
	const double well_ms = until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 6500);
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	row("D7", "SDA stuck low, freed", found_ms, 100, "I2C_STUCK", well_ms);
	/* Three probes in vain, and only a hand lifts it. */
	rig_pass(t.rig, 100 * RIG_MS);
	inject(&t, "stuck", true);
	submit(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	const double again_ms = until(&t, BB_HEALTH_QUARANTINED, DDC_FAULT_STUCK, 100);
	take(&t);
	const uint64_t then = monitor_ddc_report(t.m)->transfers;
	rig_pass(t.rig, 60 * RIG_S);
	assert_int_equal(monitor_ddc_report(t.m)->transfers, then + 3);
	inject(&t, "stuck", false);
	rig_pass(t.rig, 60 * RIG_S);
	assert_int_equal(monitor_ddc_report(t.m)->health.health, BB_HEALTH_QUARANTINED);
	monitor_ddc_release(t.m);
	until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 1000);
	row("D7", "SDA stuck low for a minute", again_ms, 100, "I2C_STUCK", -1);
	end(&t);
	end(&other);
}

/* The adapter under it comes and goes: five times a minute is life, six is a fault, and only a hand lifts that. */
static void test_flaps(void **state)
{
	(void)state;
	struct bench t = begin();

	for (int i = 0; i < 12; i++) {
		t.bus->n_reopened++;
		assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
		rig_pass(t.rig, 12500 * RIG_MS);
	}
	for (int i = 0; i < 4; i++) {
		t.bus->n_reopened++;
		(void)ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0);
	}
	const struct ddc_health *h = &monitor_ddc_report(t.m)->health;
	assert_true(h->health == BB_HEALTH_QUARANTINED && h->fault == DDC_FAULT_FLAPS);
	fault_row("", "adapter replugged six times a minute", "BUS_FLAPS", 0, 0, BB_NEVER);
	check_named(&t, "BUS_FLAPS");
	const uint64_t then = monitor_ddc_report(t.m)->transfers;
	rig_pass(t.rig, 100 * RIG_S);
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_ERR_IO);
	assert_int_equal(monitor_ddc_report(t.m)->transfers, then);
	monitor_ddc_release(t.m);
	until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 1000);
	t.bus->n_reopened++;
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	end(&t);
}

static void test_d8(void **state)
{
	(void)state;
	struct bench t = begin();

	assert_int_equal(ask(&t, BB_MONITOR_SET, BB_VCP_LUMINANCE, 40).status, BB_OK);
	rig_pass(t.rig, 100 * RIG_MS);
	inject(&t, "ignore_write", true);
	const int64_t start_ns = rig_now(t.rig);
	const uint64_t writes = peer_ddcci_counts(t.peer)->writes;
	const struct bb_monitor_reply r = ask(&t, BB_MONITOR_SET, BB_VCP_LUMINANCE, 60);
	const double found_ms = (double)(r.done_ns - start_ns) / 1e6;
	assert_int_equal(r.status, BB_ERR_VERIFY);
	assert_true(r.current == 40 && r.tries == 2);
	assert_int_equal(peer_ddcci_counts(t.peer)->writes, writes + 2); /* once more, then the alarm */
	assert_int_equal(monitor_ddc_report(t.m)->health.fault, DDC_FAULT_VERIFY);
	check_named(&t, "VERIFY_FAIL");
	/* Plain answers do not hide it. */
	for (int i = 0; i < 5; i++)
		assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_CONTRAST, 0).status, BB_OK);
	assert_int_equal(monitor_ddc_report(t.m)->health.health, BB_HEALTH_DEGRADED);
	inject(&t, "ignore_write", false);
	assert_int_equal(ask(&t, BB_MONITOR_SET, BB_VCP_LUMINANCE, 60).status, BB_OK);
	row("D8", "write acknowledged, not applied", found_ms, 500, "VERIFY_FAIL",
	    until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 1000));
	/* A value beyond the range is the caller's fault, not the display's. */
	assert_int_equal(ask(&t, BB_MONITOR_SET, BB_VCP_LUMINANCE, 101).status, BB_ERR_RANGE);
	assert_int_equal(monitor_ddc_report(t.m)->health.health, BB_HEALTH_OK);
	end(&t);
}

static void test_d9(void **state)
{
	(void)state;
	struct bench t = begin();
	const struct bb_monitor_reply whole = ask(&t, BB_MONITOR_EDID, 0, 0);
	const double once_ms = (double)whole.done_ns / 1e6;

	assert_int_equal(whole.edid_bytes, 256);
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	inject(&t, "corrupt_edid", true);
	submit(&t, BB_MONITOR_EDID, 0, 0);
	const double found_ms = until(&t, BB_HEALTH_DEGRADED, DDC_FAULT_EDID, 100);
	check_named(&t, "EDID_BAD 1: block 0");
	const struct bb_monitor_reply bad = take(&t);
	assert_int_equal(bad.status, BB_ERR_FORMAT);
	assert_int_equal(bad.tries, 4); /* and three more */
	assert_int_equal(bad.edid_bytes, 256);
	assert_memory_not_equal(bad.edid, whole.edid, 256);
	assert_int_equal(monitor_ddc_report(t.m)->good_edid_bytes, 256);
	assert_memory_equal(monitor_ddc_report(t.m)->good_edid, whole.edid, 256);
	assert_int_equal(ask(&t, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status, BB_OK);
	assert_int_equal(monitor_ddc_report(t.m)->health.health, BB_HEALTH_DEGRADED);
	inject(&t, "corrupt_edid", false);
	const int64_t start_ns = rig_now(t.rig);
	assert_int_equal(ask(&t, BB_MONITOR_EDID, 0, 0).status, BB_OK);
	until(&t, BB_HEALTH_OK, DDC_FAULT_NONE, 1000);
	row("D9", "a byte of the EDID reads wrong", found_ms, once_ms + 5, "EDID_BAD",
	    (double)(rig_now(t.rig) - start_ns) / 1e6);
	end(&t);
}

/* ---- what the rows do not say ---- */

static void test_health(void **state)
{
	(void)state;
	struct ddc_health h = { 0 };

	assert_true(ddc_health_good(&h, 0));
	assert_int_equal(h.health, BB_HEALTH_OK);
	assert_true(ddc_health_bad(&h, BB_HEALTH_DEGRADED, DDC_FAULT_STANDBY, 1));
	/* One more failed transfer does not hide what was found out; a graver one does. */
	assert_false(ddc_health_bad(&h, BB_HEALTH_DEGRADED, DDC_FAULT_DATA, 2));
	assert_int_equal(h.fault, DDC_FAULT_STANDBY);
	assert_true(ddc_health_bad(&h, BB_HEALTH_LOST, DDC_FAULT_NAK, 3));
	assert_false(ddc_health_bad(&h, BB_HEALTH_DEGRADED, DDC_FAULT_NAK, 4));
	assert_int_equal(h.health, BB_HEALTH_LOST);
	/* Three good ones in a row, or half a second of them. */
	ddc_health_good(&h, 10 * RIG_MS);
	ddc_health_good(&h, 20 * RIG_MS);
	assert_int_equal(h.health, BB_HEALTH_RECOVERING);
	ddc_health_good(&h, 30 * RIG_MS);
	assert_int_equal(h.health, BB_HEALTH_OK);
	assert_int_equal(h.recovered_ns, 30 * RIG_MS);
	assert_true(ddc_health_bad(&h, BB_HEALTH_DEGRADED, DDC_FAULT_DATA, 40 * RIG_MS));
	ddc_health_good(&h, 50 * RIG_MS);
	ddc_health_good(&h, 550 * RIG_MS);
	assert_int_equal(h.health, BB_HEALTH_OK);
}

static void test_quirks_numbers(void **state)
{
	(void)state;
	static struct numbers v;

	numbers_head();
	for (size_t k = 0; k < BB_ARRAY_LEN(numbers_displays); k++) {
		struct bench t = begin();
		*peer_ddcci_quirks(t.peer) = numbers_displays[k].quirks;
		numbers_measure(&v, t.m, t.rig->clk, RIG_MS / 10, 400);
		numbers_print(&numbers_displays[k], &v);
		assert_int_equal(v.wrong, 0);
		assert_true(v.mean_tries <= numbers_displays[k].most_mean);
		end(&t);
	}
}

/* An EDID of five blocks: the segment pointer, and its bound. */
static void test_long_edid(void **state)
{
	(void)state;
	struct bench t = begin();
	const struct bb_monitor_reply two = ask(&t, BB_MONITOR_EDID, 0, 0);
	uint8_t big[1024];

	memset(big, 0, sizeof(big));
	memcpy(big, two.edid, 256);
	big[127] = (uint8_t)(big[127] - 3 + 0); /* three blocks more, and the sum as it was */
	big[126] = (uint8_t)(big[126] + 3);
	for (size_t block = 2; block < 5; block++) {
		big[block * 128] = 0x10;
		big[block * 128 + 5] = (uint8_t)block;
		big[block * 128 + 127] = (uint8_t)(0x100 - 0x10 - block);
	}
	assert_int_equal(peer_ddcci_set_edid(t.peer, big, 640), BB_OK);
	struct bb_monitor_reply r = ask(&t, BB_MONITOR_EDID, 0, 0);
	assert_int_equal(r.edid_bytes, 640);
	assert_memory_equal(r.edid, big, 640);
	assert_int_equal(r.tries, 1);
	/* It says five and has two: what is not there is left out and said. */
	assert_int_equal(peer_ddcci_set_edid(t.peer, big, 256), BB_OK);
	r = ask(&t, BB_MONITOR_EDID, 0, 0);
	assert_int_equal(r.status, BB_ERR_FORMAT);
	assert_int_equal(r.edid_bytes, 256);
	check_named(&t, "EDID_BAD");
	/* It says 255. */
	big[127] = (uint8_t)(big[127] + big[126] - 255);
	big[126] = 255;
	assert_int_equal(peer_ddcci_set_edid(t.peer, big, 1024), BB_OK);
	r = ask(&t, BB_MONITOR_EDID, 0, 0);
	assert_int_equal(r.status, BB_OK);
	assert_int_equal(r.edid_bytes, 1024);
	end(&t);
}

/* What was learned of one display is forgotten when another is on its bus. */
static void test_another_display(void **state)
{
	(void)state;
	struct bench t = begin();
	struct bb_monitor_reply r = ask(&t, BB_MONITOR_EDID, 0, 0);
	uint8_t edid[256];

	peer_ddcci_quirks(t.peer)->null_for_unsupported = true;
	peer_ddcci_quirks(t.peer)->doubled_source = true;
	assert_int_equal(ask(&t, BB_MONITOR_GET, 0x59, 0).status, BB_ERR_UNSUPPORTED);
	const struct monitor_ddc_report *report = monitor_ddc_report(t.m);
	assert_true(report->null_means == DDC_NULL_UNSUPPORTED && report->doubled_source);
	assert_int_equal(ask(&t, BB_MONITOR_EDID, 0, 0).status, BB_OK); /* the same: nothing is forgotten */
	assert_int_equal(monitor_ddc_report(t.m)->null_means, DDC_NULL_UNSUPPORTED);
	memcpy(edid, r.edid, sizeof(edid));
	edid[12]++; /* the serial, and the sum as it was */
	edid[127]--;
	assert_int_equal(peer_ddcci_set_edid(t.peer, edid, sizeof(edid)), BB_OK);
	assert_int_equal(ask(&t, BB_MONITOR_EDID, 0, 0).status, BB_OK);
	report = monitor_ddc_report(t.m);
	assert_true(report->null_means == DDC_NULL_UNKNOWN && !report->doubled_source);
	end(&t);
}

static void test_capabilities(void **state)
{
	(void)state;
	struct bench t = begin();
	static struct vcp_capabilities c;
	struct bb_monitor_reply r = ask(&t, BB_MONITOR_CAPABILITIES, 0, 0);

	assert_int_equal(vcp_capabilities_parse(r.text, r.text_bytes, &c), BB_OK);
	assert_false(c.unbalanced || c.noise);
	assert_string_equal(c.model, "SMS27A850");
	for (unsigned int code = 0; code < 256; code++) {
		uint16_t value;
		const bool there = peer_ddcci_value(t.peer, (uint8_t)code, &value) || code == BB_VCP_RESTORE_DEFAULTS;
		assert_int_equal(c.code[code].known, there);
	}
	assert_true(vcp_capabilities_allow(&c, BB_VCP_INPUT, 0x0F) && !vcp_capabilities_allow(&c, BB_VCP_INPUT, 0x1B));
	peer_ddcci_quirks(t.peer)->malformed_capabilities = true;
	peer_ddcci_quirks(t.peer)->doubled_source = true;
	peer_ddcci_quirks(t.peer)->busy_percent = 10;
	r = ask(&t, BB_MONITOR_CAPABILITIES, 0, 0);
	assert_int_equal(r.status, BB_OK);
	assert_true(r.tries > 1); /* at least to learn of the doubled byte */
	assert_int_equal(vcp_capabilities_parse(r.text, r.text_bytes, &c), BB_OK);
	assert_true(c.unbalanced && c.noise);
	assert_true(c.code[0x10].known && c.code[0xDF].known && c.code[0x60].n == 3 && c.code[0xAE].known);
	assert_true(c.mccs_major == 2 && c.mccs_minor == 2);
	end(&t);
}

static void test_bad_opens(void **state)
{
	(void)state;
	static const struct {
		const char *uri;
		enum bb_status status;
	} bad[] = { { "i2c:", BB_ERR_CONFIG },
		    { "i2c:/dev/null?speed=1", BB_ERR_CONFIG },
		    { "i2c:/dev/null?io=fast", BB_ERR_CONFIG },
		    { "i2c:/nonexistent/i2c-4", BB_ERR_LOST },
		    { "i2c:/dev/null", BB_ERR_UNSUPPORTED },
		    { "i2c:/dev/null?io=plain", BB_ERR_UNSUPPORTED } };
	struct rig *rig = rig_create(1, 1);
	const struct bb_monitor_config c = { .id = "m1" };

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_monitor *m;
		assert_int_equal(bb_uri_parse(bad[i].uri, &rig->uri, NULL, NULL), BB_OK);
		assert_int_equal(bb_monitor_open(&monitor_ddc_driver, &c, &rig->open, &m), bad[i].status);
		assert_null(m);
	}
	rig_destroy(rig);
}

static void test_verbs(void **state)
{
	(void)state;
	struct bench t = begin();

	rig_check_verbs(t.rig, "monitor", "m1", peer_ddcci_verbs);
	rig_check_verbs(t.rig, "ddc", "m1", peer_ddcci_wire_verbs);
	end(&t);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_d1),
		cmocka_unit_test(test_d2),
		cmocka_unit_test(test_d3),
		cmocka_unit_test(test_d4),
		cmocka_unit_test(test_d5),
		cmocka_unit_test(test_d6),
		cmocka_unit_test(test_d7),
		cmocka_unit_test(test_flaps),
		cmocka_unit_test(test_d8),
		cmocka_unit_test(test_d9),
		cmocka_unit_test(test_quirks_numbers),
		cmocka_unit_test(test_long_edid),
		cmocka_unit_test(test_another_display),
		cmocka_unit_test(test_capabilities),
		cmocka_unit_test(test_bad_opens),
		cmocka_unit_test(test_verbs),
		cmocka_unit_test(test_health),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
