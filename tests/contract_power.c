/* tests/contract_power.c: the power contract over every back end, and what the simulated one does besides. */
#include "tests/modbus_rig.h"
#include "tests/power_contract.h"
#include "tests/sim_rig.h"

#include "sim/sim_power.h"

#include <math.h>

/* Safety times as of a room; a wire waits for them in real time, so there they are 600 times shorter. */
static struct bb_power_config config_scaled(double scale)
{
	return (struct bb_power_config){
		.id = "pdu1",
		.n_outlets = 2,
		.outlet = { { 1, "front-a", 2.0, 12.0, 80 }, { 4, "front-b", 0.5, 0.5, 0 } },
		.safety = { .outlet_least_off_s = 180 * scale, .outlet_least_on_s = 60 * scale,
		            .outlet_cycles_per_hour = 4, .outlet_stagger_ms = 500 * scale },
	};
}

static struct bb_power_config config(void)
{
	return config_scaled(1);
}

struct backend {
	const char *name;
	void (*open)(const struct backend *b, struct power_bench *t);
	void (*close)(struct power_bench *t);
	int fidelity;
	double scale, early;
	const char *wire; /* what the driver talks over; NULL: it is the simulated strip */
};

static void open_sim(const struct backend *b, struct power_bench *t)
{
	struct rig *rig = rig_create(7, b->fidelity);

	t->impl = rig;
	t->clk = rig->clk;
	assert_int_equal(bb_power_open(&sim_power_driver, t->config, &rig->open, &t->p), BB_OK);
}

static void close_sim(struct power_bench *t)
{
	bb_power_close(t->p);
	rig_destroy(t->impl);
}

static void open_wire(struct power_bench *t, bool rtu)
{
	struct modbus_rig *wire = modbus_rig_create(t->config, rtu);

	t->impl = wire;
	t->clk = wire->clk;
	assert_int_equal(modbus_rig_open(wire, t->config, "&timeout_most_ms=200&poll_ms=50&relay_ms=30", &t->p), BB_OK);
	t->age_ns = bb_power_limits(t->p)->settle_ns;
}

static void open_tcp(const struct backend *b, struct power_bench *t)
{
	(void)b;
	open_wire(t, false);
}

static void open_rtu(const struct backend *b, struct power_bench *t)
{
	(void)b;
	open_wire(t, true);
}

static void close_wire(struct power_bench *t)
{
	bb_power_close(t->p);
	modbus_rig_destroy(t->impl);
}

static const struct backend backends[] = {
	{ "sim, fidelity 0", open_sim, close_sim, 0, 1, 179.0 / 180, NULL },
	{ "sim, fidelity 1", open_sim, close_sim, 1, 1, 179.0 / 180, NULL },
	{ "driver and peer, Modbus TCP on loopback", open_tcp, close_wire, 1, 1.0 / 600, 0.5, "TCP" },
	{ "driver and peer, Modbus RTU on a pty", open_rtu, close_wire, 1, 1.0 / 600, 0.5, "RTU" },
};

static void for_all(void (*check)(struct power_bench *))
{
	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		const struct bb_power_config c = config_scaled(backends[i].scale);
		struct power_bench t = { .config = &c, .early = backends[i].early };
		print_message("%s\n", backends[i].name);
		backends[i].open(&backends[i], &t);
		check(&t);
		backends[i].close(&t);
	}
}

static void test_switching(void **state)
{
	(void)state;
	for_all(power_switching_is_read_back);
}

static void test_bad_calls(void **state)
{
	(void)state;
	for_all(power_bad_calls_are_refused);
}

static void test_times(void **state)
{
	(void)state;
	for_all(power_times_are_kept);
}

/* The guest's TCP stack and terminals are the kernel-virtual devices of this class: there the wires are its rows. */
static void test_fidelity(void **state)
{
	(void)state;
	const struct bb_power_config c = config_scaled(1.0 / 600);
	const char *far = getenv("BB_KERNEL") ? "kernel" : "peer";
	const struct fid_log *logs[BB_ARRAY_LEN(backends)];
	static char name[BB_ARRAY_LEN(backends)][32];
	size_t n = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		struct power_bench t = { .config = &c, .early = 0.5 };
		if (!backends[i].fidelity)
			continue;
		struct fid_log *log = calloc(1, sizeof(*log));
		assert_non_null(log);
		snprintf(name[n], sizeof(name[n]), backends[i].wire ? "driver + %s, %s" : "sim", far, backends[i].wire);
		log->rung = name[n];
		backends[i].open(&backends[i], &t);
		power_script(&t, log);
		backends[i].close(&t);
		logs[n++] = log;
	}
	const int apart = fid_table("power", logs, n);
	for (size_t i = 0; i < n; i++)
		free((void *)(uintptr_t)logs[i]);
	assert_int_equal(apart, 0);
}

/* ---- the simulated one ---- */

struct bench {
	struct rig *rig;
	struct bb_power *p;
};

static struct bench begin(void)
{
	struct bench t = { rig_create(7, 1), NULL };
	const struct bb_power_config c = config();

	assert_int_equal(bb_power_open(&sim_power_driver, &c, &t.rig->open, &t.p), BB_OK);
	return t;
}

static void end(struct bench *t)
{
	bb_power_close(t->p);
	rig_destroy(t->rig);
}

static struct bb_outlet_state settled(struct bench *t, size_t index)
{
	struct bb_outlet_state s;

	rig_pass(t->rig, bb_power_limits(t->p)->settle_ns);
	assert_int_equal(bb_power_read(t->p, index, &s), BB_OK);
	return s;
}

static void test_no_ceilings_no_strip(void **state)
{
	(void)state;
	struct rig *rig = rig_create(1, 1);
	struct bb_power_config c = config();
	struct bb_power *p;

	c.safety = (struct bb_safety){ 0 };
	assert_int_equal(bb_power_open(&sim_power_driver, &c, &rig->open, &p), BB_ERR_CONFIG);
	assert_null(p);
	c = config();
	c.n_outlets = BB_OUTLETS_MAX + 1;
	assert_int_equal(bb_power_open(&sim_power_driver, &c, &rig->open, &p), BB_ERR_CONFIG);
	rig_destroy(rig);
}

static void test_sim_inrush_and_settle(void **state)
{
	(void)state;
	struct bench t = begin();
	struct bb_outlet_state s;

	assert_int_equal(bb_power_set(t.p, 0, false), BB_OK);
	assert_int_equal(bb_power_read(t.p, 0, &s), BB_OK);
	assert_true(s.closed && !s.commanded); /* still settling */
	rig_pass(t.rig, 20 * RIG_MS);
	assert_false(sim_power_contact(t.p, 0));
	assert_false(sim_world_fed(t.rig->world, "pdu1/1"));
	assert_true(sim_world_fed(t.rig->world, "pdu1/4"));
	rig_pass(t.rig, 181 * RIG_S);
	assert_int_equal(bb_power_set(t.p, 0, true), BB_OK);
	rig_pass(t.rig, 20 * RIG_MS);
	assert_true(sim_world_fed(t.rig->world, "pdu1/1"));
	const int64_t on_ns = rig_now(t.rig);
	assert_true(fabs(sim_power_current(t.p, 0, on_ns) - 12.0) < 1e-9);
	assert_true(fabs(sim_power_current(t.p, 0, on_ns + 79 * RIG_MS) - 12.0) < 1e-9);
	assert_true(fabs(sim_power_current(t.p, 0, on_ns + 80 * RIG_MS) - 2.0) < 1e-9);
	end(&t);
}

static void test_sim_stick(void **state)
{
	(void)state;
	struct bench t = begin();
	struct bb_outlet_state s;

	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "stick", "outlet=4", true), BB_OK);
	assert_false(sim_world_fed(t.rig->world, "pdu1/4"));
	assert_int_equal(bb_power_set(t.p, 1, true), BB_OK);
	s = settled(&t, 1);
	assert_true(s.known && s.commanded && !s.closed);
	assert_true(fabs(s.current_a - 0) < 1e-9);
	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "stick", "outlet=4", false), BB_OK);
	assert_true(settled(&t, 1).closed);
	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "stick", "outlet=4 state=on", true), BB_OK);
	rig_pass(t.rig, 61 * RIG_S);
	assert_int_equal(bb_power_set(t.p, 1, false), BB_OK);
	assert_true(settled(&t, 1).closed);
	end(&t);
}

static void test_sim_timeout_and_drop(void **state)
{
	(void)state;
	struct bench t = begin();
	struct bb_outlet_state s;

	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "timeout", "", true), BB_OK);
	assert_int_equal(bb_power_read(t.p, 0, &s), BB_OK);
	assert_true(!s.known && !s.closed);
	assert_true(sim_world_fed(t.rig->world, "pdu1/1"));
	assert_int_equal(bb_power_set(t.p, 0, false), BB_ERR_IO);
	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "timeout", "", false), BB_OK);
	assert_true(settled(&t, 0).closed);
	assert_int_equal(bb_power_wait_ns(t.p, 0, false), 0); /* reading showed that the lost command was lost */

	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "drop", "", true), BB_OK);
	assert_false(sim_world_fed(t.rig->world, "pdu1/1"));
	assert_false(sim_world_fed(t.rig->world, "pdu1/4"));
	assert_false(settled(&t, 0).known);
	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "drop", "", false), BB_OK);
	assert_true(settled(&t, 0).closed);
	assert_true(sim_world_fed(t.rig->world, "pdu1/4"));
	end(&t);
}

static void test_sim_verbs(void **state)
{
	(void)state;
	struct bench t = begin();

	rig_check_verbs(t.rig, "power", "pdu1", sim_power_verbs);
	rig_pass(t.rig, RIG_S); /* the relay has just closed: past its inrush */
	assert_int_equal(rig_fault(t.rig, "power", "pdu1", "current", "outlet=1 a=0.05", true), BB_OK);
	assert_true(fabs(settled(&t, 0).current_a - 0.05) <= bb_power_limits(t.p)->current_error_a);
	static const char *const bad[][2] = {
		{ "stick", "" }, { "stick", "outlet=9" }, { "stick", "outlet=x" }, { "stick", "outlet=1 state=up" },
		{ "stick", "outlet=99999999999999999999" }, { "current", "outlet=1" }, { "current", "outlet=1 a=nan" },
		{ "current", "outlet=1 a=-1" }, { "drop", "outlet=1" },
	};
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		assert_int_equal(rig_fault(t.rig, "power", "pdu1", bad[i][0], bad[i][1], true), BB_ERR_CONFIG);
	end(&t);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_switching),
		cmocka_unit_test(test_bad_calls),
		cmocka_unit_test(test_times),
		cmocka_unit_test(test_fidelity),
		cmocka_unit_test(test_no_ceilings_no_strip),
		cmocka_unit_test(test_sim_inrush_and_settle),
		cmocka_unit_test(test_sim_stick),
		cmocka_unit_test(test_sim_timeout_and_drop),
		cmocka_unit_test(test_sim_verbs),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
