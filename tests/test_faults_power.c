/*
 * tests/test_faults_power.c: rows P1 to P6 of the fault matrix, injected at the far end of the wire: noticed in time,
 * named, recovered from, and nobody who asks ever waits. libmodbus owns its waits, so this is real time: the budgets of
 * the matrix shrink with the time-outs (P1 3 s to poll + 200 ms, P4 3 s to 600 ms + one time-out), are printed, and
 * asserted at five times their length as a guard against a busy machine.
 */
#include "tests/fault_table.h"
#include "tests/modbus_rig.h"

#define OPTIONS "&timeout_least_ms=60&timeout_most_ms=200&poll_ms=40&half_open_ms=600&relay_ms=20"
#define POLL_MS 40
#define MOST_MS 200
#define HALF_OPEN_MS 600
#define GUARD 5
#define LONG_CALL_MS 50
#define LONG_CALLS_MOST 1 /* calls take microseconds; the scheduler may take one away, a wait inside would show each time */

struct bed {
	struct modbus_rig *rig;
	struct bb_power_config config;
	struct bb_power *p;
	int n_long_calls;
};

static struct bb_power_config strip(void)
{
	return (struct bb_power_config){
		.id = "pdu1",
		.n_outlets = 2,
		.outlet = { { 1, "a", 2.0, 2.0, 0 }, { 3, "b", 0.5, 0.5, 0 } },
		.safety = { .outlet_least_off_s = 0, .outlet_least_on_s = 0, .outlet_cycles_per_hour = 8,
		            .outlet_stagger_ms = 0 },
	};
}

static struct power_modbus_report report(struct bed *b)
{
	struct power_modbus_report r;

	power_modbus_report(b->p, &r);
	return r;
}

static struct bb_outlet_state look(struct bed *b, size_t i)
{
	struct bb_outlet_state s;
	const int64_t begun_ns = bb_clock_now_ns(b->rig->clk);

	assert_int_equal(bb_power_read(b->p, i, &s), BB_OK);
	b->n_long_calls += bb_clock_now_ns(b->rig->clk) - begun_ns > LONG_CALL_MS * WIRE_MS;
	return s;
}

static void begin_on(struct bed *b, bool rtu, bool foreign)
{
	*b = (struct bed){ .config = strip() };
	b->rig = modbus_rig_create(&b->config, rtu);
	if (foreign)
		modbus_rig_fault(b->rig, "foreign", NULL, NULL, true);
	assert_int_equal(modbus_rig_open(b->rig, &b->config, OPTIONS, &b->p), BB_OK);
	if (!foreign)
		modbus_rig_pass(b->rig, 400 * WIRE_MS); /* enough replies to have learned a time-out */
}

static void begin(struct bed *b)
{
	begin_on(b, false, false);
}

static void end(struct bed *b)
{
	assert_true(b->n_long_calls <= LONG_CALLS_MOST);
	bb_power_close(b->p);
	modbus_rig_destroy(b->rig);
}

/* ms until a fault was counted once more than `before`; fails after GUARD budgets. */
static double noticed(struct bed *b, enum power_modbus_fault fault, uint64_t before, int64_t budget_ms)
{
	const int64_t begun_ns = bb_clock_now_ns(b->rig->clk);

	while (report(b).count[fault] <= before) {
		look(b, 0);
		modbus_rig_pass(b->rig, WIRE_MS);
		if (bb_clock_now_ns(b->rig->clk) - begun_ns > GUARD * budget_ms * WIRE_MS)
			fail_msg("%s was not noticed", power_modbus_fault_text(fault));
	}
	return (double)(bb_clock_now_ns(b->rig->clk) - begun_ns) / 1e6;
}

static double recovered(struct bed *b, int64_t budget_ms)
{
	const int64_t begun_ns = bb_clock_now_ns(b->rig->clk);

	while (report(b).health != BB_HEALTH_OK || !look(b, 0).known) {
		modbus_rig_pass(b->rig, WIRE_MS);
		if (bb_clock_now_ns(b->rig->clk) - begun_ns > GUARD * budget_ms * WIRE_MS)
			fail_msg("did not recover: %s", report(b).text);
	}
	return (double)(bb_clock_now_ns(b->rig->clk) - begun_ns) / 1e6;
}

static void row(const char *name, const char *injected, enum power_modbus_fault fault, double detected_ms,
                int64_t budget_ms, double recovered_ms)
{
	fault_row(name, injected, power_modbus_fault_text(fault), (int64_t)(detected_ms * 1e6), budget_ms * WIRE_MS,
	          (int64_t)(recovered_ms * 1e6));
}

struct simple { /* a fault that is set, noticed, cleared and recovered from */
	const char *row, *verb, *key, *value;
	enum power_modbus_fault fault;
	bool unknown;            /* the outlets' state is not known meanwhile */
	int64_t budget_ms;
};

static const struct simple simples[] = {
	{ "P1", "silent", NULL, NULL, POWER_MODBUS_TIMEOUT, true, POLL_MS + MOST_MS },
	{ "P2", "late", "ms", "150", POWER_MODBUS_SKEW, false, 150 + POLL_MS + MOST_MS },
	{ "P3", "exception", "code", "2", POWER_MODBUS_EXCEPTION, true, POLL_MS + MOST_MS },
	{ "P4", "half_open", NULL, NULL, POWER_MODBUS_HALF_OPEN, true, POLL_MS + HALF_OPEN_MS + MOST_MS },
	{ "P5", "length", "by", "3", POWER_MODBUS_PROTO, true, POLL_MS + MOST_MS },
	{ "P5", "length", "by", "-1", POWER_MODBUS_PROTO, true, POLL_MS + MOST_MS },
	{ "P5", "length", "by", "60000", POWER_MODBUS_PROTO, true, POLL_MS + MOST_MS },
	{ "P5", "garbage", NULL, NULL, POWER_MODBUS_PROTO, true, POLL_MS + MOST_MS },
	{ "P5", "dribble", "ms", "50", POWER_MODBUS_PROTO, true, POLL_MS + MOST_MS },
};

static void run_simple(const struct simple *f, bool rtu)
{
	struct bed b;
	char injected[64];

	begin_on(&b, rtu, false);
	const uint64_t before = report(&b).count[f->fault];
	modbus_rig_fault(b.rig, f->verb, f->key, f->value, true);
	const double detected_ms = noticed(&b, f->fault, before, f->budget_ms);
	assert_string_equal(power_modbus_fault_text(f->fault), power_modbus_fault_text(report(&b).fault));
	/* What is wrong may have been noticed behind the contacts of the same reading: then the next one tells. */
	for (int i = 0; f->unknown && look(&b, 0).known && i < GUARD * (POLL_MS + MOST_MS); i++)
		modbus_rig_pass(b.rig, WIRE_MS);
	if (f->unknown) {
		assert_false(look(&b, 0).known);
		assert_non_null(strstr(bb_power_device(b.p)->last_error.detail, power_modbus_fault_text(f->fault)));
	}
	modbus_rig_fault(b.rig, f->verb, f->key, f->value ? f->value : "", false);
	const double recovered_ms = recovered(&b, 3000);
	assert_true(look(&b, 0).closed);
	snprintf(injected, sizeof(injected), "%s%s %s%s%s", rtu ? "rtu " : "", f->verb, f->key ? f->key : "",
	         f->key ? "=" : "", f->value ? f->value : "");
	row(f->row, injected, f->fault, detected_ms, f->budget_ms, recovered_ms);
	end(&b);
}

static void test_rows_over_tcp(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(simples); i++)
		run_simple(&simples[i], false);
}

/* Over RTU there is no transaction and no header's length to lie about. */
static void test_rows_over_rtu(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(simples); i++)
		if (strcmp(simples[i].verb, "late") != 0 && strcmp(simples[i].verb, "length") != 0)
			run_simple(&simples[i], true);
}

/* Every code, named with its number. */
static void test_every_exception(void **state)
{
	(void)state;
	for (int code = 1; code <= MODBUS_EX_MOST; code++) {
		struct bed b;
		char value[8], text[32];
		begin(&b);
		snprintf(value, sizeof(value), "%d", code);
		snprintf(text, sizeof(text), "exception %02X", (unsigned)code);
		modbus_rig_fault(b.rig, "exception", "code", value, true);
		const double detected_ms = noticed(&b, POWER_MODBUS_EXCEPTION, 0, POLL_MS + MOST_MS);
		assert_non_null(strstr(report(&b).text, text));
		fault_row("P3", text, "EXCEPTION", (int64_t)(detected_ms * 1e6), (POLL_MS + MOST_MS) * WIRE_MS, 0);
		end(&b);
	}
}

static void test_one_late_reply_is_discarded_and_the_link_stays(void **state)
{
	struct bed b;

	(void)state;
	begin(&b);
	const struct power_modbus_report before = report(&b);
	const struct sim_fault_args once = { .n = 2, .arg = { { "ms", "120" }, { "count", "1" } } };
	for (const struct sim_verb *v = peer_modbus_verbs; v->name; v++)
		if (!strcmp(v->name, "late")) {
			pthread_mutex_lock(&b.rig->lock);
			assert_int_equal(v->apply(&b.rig->handle, &once, true, NULL), BB_OK);
			pthread_mutex_unlock(&b.rig->lock);
		}
	const double detected_ms = noticed(&b, POWER_MODBUS_SKEW, before.count[POWER_MODBUS_SKEW], 120 + MOST_MS);
	const double recovered_ms = recovered(&b, 1000);
	row("P2", "late ms=120 count=1", POWER_MODBUS_SKEW, detected_ms, 120 + MOST_MS, recovered_ms);
	assert_int_equal(report(&b).connects, before.connects);
	assert_true(report(&b).timeout_ns >= 2 * 100 * WIRE_MS || report(&b).timeout_ns == MOST_MS * WIRE_MS); /* learned */
	end(&b);
}

static void test_late_for_ever_reconnects(void **state)
{
	struct bed b;

	(void)state;
	begin(&b);
	const uint64_t connects = report(&b).connects;
	modbus_rig_fault(b.rig, "late", "ms", "330", true); /* later than the longest time-out */
	const double detected_ms = noticed(&b, POWER_MODBUS_SKEW, report(&b).count[POWER_MODBUS_SKEW], 330 + 3 * MOST_MS);
	for (int i = 0; i < 3000 && report(&b).connects == connects; i++)
		modbus_rig_pass(b.rig, WIRE_MS);
	assert_true(report(&b).connects > connects);
	modbus_rig_fault(b.rig, "late", "ms", "330", false);
	row("P2", "late ms=330, three in a row", POWER_MODBUS_SKEW, detected_ms, 330 + 3 * MOST_MS, recovered(&b, 3000));
	end(&b);
}

static uint64_t writes(struct bed *b)
{
	pthread_mutex_lock(&b->rig->lock);
	const uint64_t n = b->rig->peer.n_writes;
	pthread_mutex_unlock(&b->rig->lock);
	return n;
}

static void test_wrong_device_is_never_written_to(void **state)
{
	struct bed b;
	char detail[96];

	(void)state;
	begin_on(&b, false, true);
	assert_int_equal(report(&b).health, BB_HEALTH_QUARANTINED);
	for (int i = 0; i < 200; i++)
		assert_int_equal(bb_power_set(b.p, (size_t)i % 2, i % 3 == 0), BB_ERR_REFUSED);
	snprintf(detail, sizeof(detail), "%s", bb_power_device(b.p)->last_error.detail);
	assert_non_null(strstr(detail, "ID_MISMATCH: register 0 is 1234, want 4242"));
	assert_false(look(&b, 0).known);
	modbus_rig_pass(b.rig, 200 * WIRE_MS);
	assert_int_equal(writes(&b), 0);
	row("P6", "another device at that address", POWER_MODBUS_ID, 0, 0, 0);
	print_message("     200 of 200 writes refused before the wire; an operator opens it again\n");
	end(&b);
}

/* The strip is swapped for another while it runs: the new connection is looked at before anything is written. */
static void test_swapped_device(void **state)
{
	struct bed b;

	(void)state;
	begin(&b);
	modbus_rig_fault(b.rig, "foreign", NULL, NULL, true);
	modbus_rig_fault(b.rig, "half_open", NULL, NULL, true);
	noticed(&b, POWER_MODBUS_HALF_OPEN, 0, POLL_MS + HALF_OPEN_MS + MOST_MS);
	modbus_rig_fault(b.rig, "half_open", NULL, NULL, false);
	noticed(&b, POWER_MODBUS_ID, 0, 3000);
	assert_int_equal(bb_power_set(b.p, 0, false), BB_ERR_REFUSED);
	assert_int_equal(writes(&b), 0);
	end(&b);
}

static void test_liar_is_quarantined(void **state)
{
	struct bed b;

	(void)state;
	begin(&b);
	modbus_rig_fault(b.rig, "garbage", NULL, NULL, true);
	for (int i = 0; i < 20000 && report(&b).health != BB_HEALTH_QUARANTINED; i++)
		modbus_rig_pass(b.rig, WIRE_MS);
	assert_int_equal(report(&b).health, BB_HEALTH_QUARANTINED);
	const uint64_t connects = report(&b).connects;
	modbus_rig_fault(b.rig, "garbage", NULL, NULL, false);
	modbus_rig_pass(b.rig, 500 * WIRE_MS);
	assert_int_equal(report(&b).connects, connects);
	assert_int_equal(bb_power_set(b.p, 0, false), BB_ERR_REFUSED);
	end(&b);
}

/* Exception 06: the command goes out again a second later, not sooner, and only once more. */
static void test_busy_strip_gets_the_command_again(void **state)
{
	struct bed b;

	(void)state;
	begin(&b);
	modbus_rig_fault(b.rig, "exception", "code", "6", true);
	noticed(&b, POWER_MODBUS_EXCEPTION, 0, POLL_MS + MOST_MS);
	modbus_rig_fault(b.rig, "exception", "code", "6", false);
	recovered(&b, 1500);
	pthread_mutex_lock(&b.rig->lock); /* both at once: the next request is the write */
	assert_int_equal(bb_power_set(b.p, 0, false), BB_OK);
	b.rig->peer.faults.exception = MODBUS_EX_BUSY;
	pthread_mutex_unlock(&b.rig->lock);
	noticed(&b, POWER_MODBUS_EXCEPTION, report(&b).count[POWER_MODBUS_EXCEPTION], POLL_MS + MOST_MS);
	const int64_t refused_ns = bb_clock_now_ns(b.rig->clk);
	modbus_rig_fault(b.rig, "exception", "code", "6", false);
	while (!writes(&b) && bb_clock_now_ns(b.rig->clk) - refused_ns < 10 * BB_NS_PER_S)
		modbus_rig_pass(b.rig, WIRE_MS);
	assert_int_equal(writes(&b), 1);
	assert_true(bb_clock_now_ns(b.rig->clk) - refused_ns >= 900 * WIRE_MS);
	modbus_rig_pass(b.rig, 500 * WIRE_MS);
	assert_int_equal(writes(&b), 1);
	assert_true(look(&b, 0).known && !look(&b, 0).closed);
	end(&b);
}

/* Acknowledged and not done: what counts is what is read back. */
static void test_acknowledged_and_not_done(void **state)
{
	struct bed b;

	(void)state;
	begin(&b);
	modbus_rig_fault(b.rig, "deaf", NULL, NULL, true);
	assert_int_equal(bb_power_set(b.p, 1, false), BB_OK);
	const double detected_ms = noticed(&b, POWER_MODBUS_VERIFY, 0, 20 + MOST_MS + 2 * POLL_MS);
	const struct bb_outlet_state s = look(&b, 1);
	assert_true(s.known && s.closed && !s.commanded);
	assert_non_null(strstr(bb_power_device(b.p)->last_error.detail, "outlet 3 was told off and reads on"));
	assert_int_equal(report(&b).health, BB_HEALTH_DEGRADED);
	modbus_rig_fault(b.rig, "deaf", NULL, NULL, false);
	assert_int_equal(bb_power_set(b.p, 1, false), BB_OK);
	row("D8", "a write acknowledged, not done", POWER_MODBUS_VERIFY, detected_ms, 20 + MOST_MS + 2 * POLL_MS,
	    recovered(&b, 1000));
	assert_false(look(&b, 1).closed);
	end(&b);
}

/* A command given while nobody answers is refused, or dropped when its time is over: it never comes out of the blue. */
static void test_no_command_out_of_the_blue(void **state)
{
	struct bed b;

	(void)state;
	begin(&b);
	modbus_rig_fault(b.rig, "half_open", NULL, NULL, true);
	noticed(&b, POWER_MODBUS_HALF_OPEN, 0, POLL_MS + HALF_OPEN_MS + MOST_MS);
	assert_int_equal(bb_power_set(b.p, 0, false), BB_ERR_IO);
	modbus_rig_fault(b.rig, "half_open", NULL, NULL, false);
	recovered(&b, 3000);
	modbus_rig_pass(b.rig, 300 * WIRE_MS);
	assert_int_equal(writes(&b), 0);
	assert_true(look(&b, 0).closed);
	end(&b);
}

static void test_open_without_anybody_there(void **state)
{
	struct bed b = { .config = strip() };

	(void)state;
	b.rig = modbus_rig_create(&b.config, false);
	modbus_rig_fault(b.rig, "silent", NULL, NULL, true);
	const int64_t begun_ns = bb_clock_now_ns(b.rig->clk);
	assert_true(modbus_rig_open(b.rig, &b.config, OPTIONS, &b.p) < 0);
	assert_null(b.p);
	assert_true(bb_clock_now_ns(b.rig->clk) - begun_ns < GUARD * 4 * MOST_MS * WIRE_MS);
	snprintf(b.rig->path, sizeof(b.rig->path), "tcp://127.0.0.1:1"); /* nobody listens there */
	assert_int_equal(modbus_rig_open(b.rig, &b.config, OPTIONS, &b.p), BB_ERR_LOST);
	snprintf(b.rig->path, sizeof(b.rig->path), "rtu:/dev/null");
	assert_true(modbus_rig_open(b.rig, &b.config, OPTIONS, &b.p) < 0);
	modbus_rig_destroy(b.rig);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_rows_over_tcp),
		cmocka_unit_test(test_rows_over_rtu),
		cmocka_unit_test(test_every_exception),
		cmocka_unit_test(test_one_late_reply_is_discarded_and_the_link_stays),
		cmocka_unit_test(test_late_for_ever_reconnects),
		cmocka_unit_test(test_wrong_device_is_never_written_to),
		cmocka_unit_test(test_swapped_device),
		cmocka_unit_test(test_liar_is_quarantined),
		cmocka_unit_test(test_busy_strip_gets_the_command_again),
		cmocka_unit_test(test_acknowledged_and_not_done),
		cmocka_unit_test(test_no_command_out_of_the_blue),
		cmocka_unit_test(test_open_without_anybody_there),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
