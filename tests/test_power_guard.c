/*
 * tests/test_power_guard.c: 10^5 random commands, sent at random and at exactly chosen times over a line that loses
 * commands and answers, never make a contact break a safety time. The judge watches contacts only; it knows nothing of
 * the guard.
 */
#include "tests/sim_rig.h"

#include "sim/sim_power.h"

#define OUTLETS 3
#define COMMANDS 100000

static const struct bb_safety safety = { .outlet_least_off_s = 180, .outlet_least_on_s = 60,
	                                 .outlet_cycles_per_hour = 4, .outlet_stagger_ms = 500 };

struct judge {
	bool closed[OUTLETS + 1], moved[OUTLETS + 1];
	int64_t at_ns[OUTLETS + 1];
	int64_t on_ns[OUTLETS + 1][5]; /* the last switch-ons */
	int64_t last_on_ns;
	bool any_on;
	long moves, worst_cycles;
};

static void judge_contact(struct judge *j, int64_t outlet, bool closed, int64_t at_ns)
{
	assert_true(outlet >= 1 && outlet <= OUTLETS);
	const int64_t least_ns = (int64_t)(closed ? safety.outlet_least_off_s : safety.outlet_least_on_s) * RIG_S;
	if (j->moved[outlet])
		assert_true(at_ns - j->at_ns[outlet] >= least_ns);
	j->moved[outlet] = true;
	j->at_ns[outlet] = at_ns;
	j->closed[outlet] = closed;
	j->moves++;
	if (!closed)
		return;
	if (j->any_on)
		assert_true(at_ns - j->last_on_ns >= 500 * RIG_MS);
	j->any_on = true;
	j->last_on_ns = at_ns;
	/* Five within an hour is one too many. */
	int64_t *on = j->on_ns[outlet];
	memmove(on, on + 1, 4 * sizeof(*on));
	on[4] = at_ns;
	assert_true(on[0] == INT64_MIN || on[4] - on[0] >= 3600 * RIG_S);
}

static void judge_init(struct judge *j)
{
	memset(j, 0, sizeof(*j));
	for (int o = 0; o <= OUTLETS; o++)
		for (int i = 0; i < 5; i++)
			j->on_ns[o][i] = INT64_MIN;
}

static void judge_event(void *ctx, const struct bb_event *e)
{
	if (e->kind == BB_EV_OUTLET)
		judge_contact(ctx, e->a, e->b != 0, e->at_ns);
}

/* A strip at the end of a bad line: a command may arrive or not, its answer may arrive or not, and so may a read. */
struct flaky {
	struct bb_power base;
	struct sim_rng rng;
	bool closed[OUTLETS];
};

static enum bb_status flaky_open(struct bb_power *p, const struct bb_open *open)
{
	struct flaky *f = bb_container_of(p, struct flaky, base);

	sim_rng_seed(&f->rng, open->seed, "power", "flaky");
	return BB_OK;
}

static void flaky_close(struct bb_power *p)
{
	(void)p;
}

static enum bb_status flaky_set(struct bb_power *p, size_t index, bool on)
{
	struct flaky *f = bb_container_of(p, struct flaky, base);

	if (sim_rng_uniform(&f->rng) < 0.25)
		return BB_ERR_IO;
	if (f->closed[index] != on)
		bb_device_event(&p->dev, BB_EV_OUTLET, bb_clock_now_ns(p->dev.clk), (int64_t)index + 1, on);
	f->closed[index] = on;
	return sim_rng_uniform(&f->rng) < 0.25 ? BB_ERR_IO : BB_OK;
}

static enum bb_status flaky_read(struct bb_power *p, size_t index, struct bb_outlet_state *out)
{
	struct flaky *f = bb_container_of(p, struct flaky, base);

	out->at_ns = bb_clock_now_ns(p->dev.clk);
	out->known = sim_rng_uniform(&f->rng) < 0.75;
	out->closed = out->known && f->closed[index];
	return BB_OK;
}

static const struct bb_power_ops flaky_ops = { flaky_open, flaky_close, flaky_set, flaky_read };
static const struct bb_power_driver flaky_driver = { "flaky", sizeof(struct flaky), &flaky_ops };

/* Mostly impatient, sometimes patient, and often to the nanosecond. */
static int64_t pause_ns(struct sim_rng *rng, const struct bb_power *p, size_t index, bool on)
{
	const int64_t wait_ns = bb_power_wait_ns(p, index, on);

	switch (sim_rng_u64(rng) % 8) {
	case 0:
		return wait_ns;
	case 1:
		return wait_ns ? wait_ns - 1 : 0;
	case 2:
		return (int64_t)(sim_rng_uniform(rng) * 400e9);
	case 3:
	case 4:
		return (int64_t)(sim_rng_uniform(rng) * 20e9);
	default:
		return (int64_t)(sim_rng_uniform(rng) * 0.6e9);
	}
}

struct tally {
	long ok, refused, failed;
};

static void one_command(struct rig *rig, struct bb_power *p, struct sim_rng *rng, struct tally *n)
{
	const size_t index = sim_rng_u64(rng) % OUTLETS;
	const bool on = sim_rng_u64(rng) & 1;
	struct bb_outlet_state s;

	rig_pass(rig, pause_ns(rng, p, index, on));
	if (sim_rng_u64(rng) % 3 == 0)
		assert_int_equal(bb_power_read(p, sim_rng_u64(rng) % OUTLETS, &s), BB_OK);
	const int64_t wait_ns = bb_power_wait_ns(p, index, on);
	const enum bb_status status = bb_power_set(p, index, on);
	assert_int_equal(status == BB_ERR_REFUSED, wait_ns > 0);
	n->ok += status == BB_OK;
	n->refused += status == BB_ERR_REFUSED;
	n->failed += status == BB_ERR_IO;
}

static void campaign(const struct bb_power_driver *driver, int fidelity, bool silences)
{
	struct rig *rig = rig_create(42, fidelity);
	struct bb_power_config c = { .id = "pdu", .n_outlets = OUTLETS, .safety = safety };
	struct bb_power *p;
	struct sim_rng rng;
	struct judge judge;
	struct tally n = { 0 };

	for (int i = 0; i < OUTLETS; i++)
		c.outlet[i].outlet = i + 1;
	judge_init(&judge);
	rig->on_event = judge_event;
	rig->ctx = &judge;
	sim_rng_seed(&rng, 1, "test", "guard");
	assert_int_equal(bb_power_open(driver, &c, &rig->open, &p), BB_OK);
	for (long i = 0; i < COMMANDS; i++) {
		if (silences && i % 50 == 0)
			sim_power_world_silence(p, sim_rng_u64(&rng) % 4 == 0);
		one_command(rig, p, &rng, &n);
		bb_eventlog_flush(rig->events);
	}
	print_message("%ld accepted, %ld refused, %ld lost, %ld contacts moved in %lld h\n", n.ok, n.refused, n.failed,
	              judge.moves, (long long)(rig_now(rig) / (3600 * RIG_S)));
	/* The campaign must have reached both sides of the fence, or it proves nothing. */
	assert_true(n.ok > COMMANDS / 20 && n.refused > COMMANDS / 20 && judge.moves > COMMANDS / 50);
	bb_power_close(p);
	rig_destroy(rig);
}

static void test_sim_ideal(void **state)
{
	(void)state;
	campaign(&sim_power_driver, 0, false);
}

static void test_sim_with_silences(void **state)
{
	(void)state;
	campaign(&sim_power_driver, 1, true);
}

static void test_bad_line(void **state)
{
	(void)state;
	campaign(&flaky_driver, 1, false);
}

static void test_tighter_cycles(void **state)
{
	(void)state;
	struct rig *rig = rig_create(1, 1);
	struct bb_power_config c = { .id = "pdu", .n_outlets = 1, .outlet = { { .outlet = 1 } }, .safety = safety };
	struct bb_power *p;

	c.safety.outlet_cycles_per_hour = 0.5;
	assert_int_equal(bb_power_open(&sim_power_driver, &c, &rig->open, &p), BB_OK);
	assert_int_equal(bb_power_set(p, 0, false), BB_OK);
	rig_pass(rig, 200 * RIG_S);
	assert_int_equal(bb_power_set(p, 0, true), BB_OK);
	rig_pass(rig, 200 * RIG_S);
	assert_int_equal(bb_power_set(p, 0, false), BB_OK);
	rig_pass(rig, 3600 * RIG_S);
	assert_int_equal(bb_power_set(p, 0, true), BB_ERR_REFUSED);
	rig_pass(rig, bb_power_wait_ns(p, 0, true));
	assert_int_equal(rig_now(rig), (200 + 7200) * RIG_S);
	assert_int_equal(bb_power_set(p, 0, true), BB_OK);
	bb_power_close(p);
	rig_destroy(rig);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_sim_ideal),
		cmocka_unit_test(test_sim_with_silences),
		cmocka_unit_test(test_bad_line),
		cmocka_unit_test(test_tighter_cycles),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
