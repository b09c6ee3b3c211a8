/* tests/contract_power.c: what every power back end must do, and what the simulated one does besides. */
#include "tests/sim_rig.h"

#include "sim/sim_power.h"

#include <math.h>

static const struct backend {
	const char *name;
	const struct bb_power_driver *driver;
	int fidelity;
} backends[] = { { "sim, fidelity 0", &sim_power_driver, 0 }, { "sim, fidelity 1", &sim_power_driver, 1 } };

static struct bb_power_config config(void)
{
	return (struct bb_power_config){
		.id = "pdu1",
		.n_outlets = 2,
		.outlet = { { 1, "front-a", 2.0, 12.0, 80 }, { 4, "front-b", 0.5, 0.5, 0 } },
		.safety = { .outlet_least_off_s = 180, .outlet_least_on_s = 60, .outlet_cycles_per_hour = 4,
		            .outlet_stagger_ms = 500 },
	};
}

struct bench {
	struct rig *rig;
	struct bb_power *p;
};

static struct bench begin(const struct backend *b)
{
	struct bench t = { rig_create(7, b->fidelity), NULL };
	const struct bb_power_config c = config();

	print_message("%s\n", b->name);
	assert_int_equal(bb_power_open(b->driver, &c, &t.rig->open, &t.p), BB_OK);
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

static void switching_is_read_back(struct bench *t)
{
	struct bb_outlet_state s = settled(t, 0);

	if (!s.closed)
		assert_int_equal(bb_power_set(t->p, 0, true), BB_OK);
	rig_pass(t->rig, 61 * RIG_S);
	assert_int_equal(bb_power_set(t->p, 0, false), BB_OK);
	s = settled(t, 0);
	assert_true(s.known && !s.closed && !s.commanded);
	assert_true(s.current_a <= bb_power_limits(t->p)->current_error_a);
	rig_pass(t->rig, 181 * RIG_S);
	assert_int_equal(bb_power_set(t->p, 0, true), BB_OK);
	s = settled(t, 0);
	assert_true(s.known && s.closed && s.commanded);
	rig_pass(t->rig, RIG_S);
	s = settled(t, 0);
	assert_true(fabs(s.current_a - config().outlet[0].load_a) <= bb_power_limits(t->p)->current_error_a);
	assert_int_equal(s.at_ns, rig_now(t->rig));
}

static void bad_calls_are_refused(struct bench *t)
{
	struct bb_outlet_state s;

	assert_int_equal(bb_power_set(t->p, 2, true), BB_ERR_USAGE);
	assert_int_equal(bb_power_read(t->p, 2, &s), BB_ERR_USAGE);
	assert_false(s.known);
	assert_int_equal(bb_power_read(t->p, 0, NULL), BB_ERR_USAGE);
	bb_power_close(NULL);
}

static void times_are_kept(struct bench *t)
{
	rig_pass(t->rig, 100 * RIG_S);
	assert_int_equal(bb_power_set(t->p, 0, false), BB_OK);
	rig_pass(t->rig, 179 * RIG_S);
	assert_int_equal(bb_power_set(t->p, 0, true), BB_ERR_REFUSED);
	assert_non_null(strstr(bb_power_device(t->p)->last_error.detail, "least off time"));
	const int64_t wait_ns = bb_power_wait_ns(t->p, 0, true);
	assert_true(wait_ns > 0 && wait_ns <= RIG_S + bb_power_limits(t->p)->settle_ns);
	rig_pass(t->rig, wait_ns);
	assert_int_equal(bb_power_set(t->p, 0, true), BB_OK);
	rig_pass(t->rig, 59 * RIG_S);
	assert_int_equal(bb_power_set(t->p, 0, false), BB_ERR_REFUSED);
	assert_non_null(strstr(bb_power_device(t->p)->last_error.detail, "least on time"));
}

static void for_all(void (*check)(struct bench *))
{
	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		struct bench t = begin(&backends[i]);
		check(&t);
		end(&t);
	}
}

static void test_switching(void **state)
{
	(void)state;
	for_all(switching_is_read_back);
}

static void test_bad_calls(void **state)
{
	(void)state;
	for_all(bad_calls_are_refused);
}

static void test_times(void **state)
{
	(void)state;
	for_all(times_are_kept);
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
	struct bench t = begin(&backends[1]);
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
	struct bench t = begin(&backends[1]);
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
	struct bench t = begin(&backends[1]);
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
	struct bench t = begin(&backends[1]);

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
		cmocka_unit_test(test_no_ceilings_no_strip),
		cmocka_unit_test(test_sim_inrush_and_settle),
		cmocka_unit_test(test_sim_stick),
		cmocka_unit_test(test_sim_timeout_and_drop),
		cmocka_unit_test(test_sim_verbs),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
