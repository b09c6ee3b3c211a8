/* tests/test_facility.c: what the facility says of a monitor on its wires: each fault in its own words, none by another's. */
#include "bench/facility.h"
#include "bench/rig.h"
#include "drivers/monitor_ddc.h"
#include "sim/bus_sim_i2c.h"
#include "tests/sim_rig.h"

struct bench {
	struct rig *rig;
	struct bb_monitor_config config;
	struct peer_ddcci *peer;
	struct bb_monitor *m;
	struct bb_rig devices;
	struct bb_watch *watch;
	struct bb_facility *facility;
};

static struct bench *begin(void)
{
	struct bench *t = calloc(1, sizeof(*t));
	struct bb_i2c_bus *bus;

	assert_non_null(t);
	t->rig = rig_create(3, 1);
	t->config = (struct bb_monitor_config){ .id = "m1", .edid = "S27A850D", .input = 0x0F, .n_settings = 1,
		                                .setting = { { BB_VCP_LUMINANCE, 60 } } };
	t->rig->room.n_monitors = 1;
	t->rig->room.monitors = &t->config;
	assert_int_equal(peer_ddcci_create(&t->config, t->rig->world, 3, 0, &t->peer), BB_OK);
	assert_int_equal(bus_sim_i2c_create(t->rig->clk, t->peer, NULL, &bus), BB_OK);
	assert_int_equal(monitor_ddc_open_on(bus, &t->config, &t->rig->open, &t->m), BB_OK);
	t->devices = (struct bb_rig){ .room = &t->rig->room, .monitors = &t->m };
	assert_int_equal(bb_watch_create(4, NULL, 500 * RIG_MS, &t->watch), BB_OK);
	assert_int_equal(bb_facility_create(&t->devices, t->rig->clk, t->watch, &t->facility), BB_OK);
	return t;
}

static void end(struct bench *t)
{
	bb_facility_destroy(t->facility);
	bb_watch_destroy(t->watch);
	bb_monitor_close(t->m);
	peer_ddcci_destroy(t->peer);
	rig_destroy(t->rig);
	free(t);
}

/* Bring-up and patrol for so long. */
static void run(struct bench *t, int64_t seconds)
{
	assert_int_equal(bb_facility_start(t->facility), BB_OK);
	rig_pass(t->rig, seconds * RIG_S);
	assert_true(bb_facility_ready(t->facility));
	bb_watch_finish(t->watch, rig_now(t->rig));
}

static void inject(struct bench *t, const char *class_name, const char *verb)
{
	assert_int_equal(rig_fault(t->rig, class_name, "m1", verb, "", true), BB_OK);
}

/* One incident, and its words hold these. */
static void check_said(struct bench *t, const char *health, const char *words)
{
	const struct bb_incident *in;

	assert_int_equal(bb_watch_incidents(t->watch, &in), 1);
	assert_string_equal(in[0].culprit, "monitor/m1");
	assert_string_equal(in[0].state, health);
	if (!strstr(in[0].what, words))
		fail_msg("\"%s\" does not say \"%s\"", in[0].what, words);
}

static void a_good_monitor_is_set_and_left_alone(void **state)
{
	struct bench *t = begin();
	const struct bb_incident *in;
	uint16_t value;
	(void)state;

	run(t, 10);
	assert_int_equal(bb_watch_incidents(t->watch, &in), 0);
	assert_true(peer_ddcci_value(t->peer, BB_VCP_LUMINANCE, &value));
	assert_int_equal(value, 60);
	assert_int_equal(peer_ddcci_counts(t->peer)->writes, 1);
	end(t);
}

static void each_fault_has_its_own_words(void **state)
{
	static const struct {
		const char *class_name, *verb, *health, *words;
	} rows[] = {
		{ "monitor", "ignore_write", "DEGRADED", "VCP 10 was set to 60 and acknowledged, but reads back 75" },
		{ "monitor", "corrupt_edid", "DEGRADED", "EDID is broken" },
		{ "monitor", "standby", "DEGRADED", "DISP_STANDBY" },
		{ "monitor", "unplug", "LOST", "DDC_NAK" },
		{ "ddc", "stuck", "LOST", "I2C_STUCK" },
		{ "ddc", "bad_checksum", "LOST", "DDC_DATA" },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		struct bench *t = begin();
		inject(t, rows[i].class_name, rows[i].verb);
		run(t, 60);
		check_said(t, rows[i].health, rows[i].words);
		end(t);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_good_monitor_is_set_and_left_alone),
		cmocka_unit_test(each_fault_has_its_own_words),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
