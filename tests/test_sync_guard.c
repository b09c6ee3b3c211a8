/* tests/test_sync_guard.c: what the guard makes of edges that are missing, late or wrong at several stages at once. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sync/sync_guard.h"

#define STAGES 3
#define ROWS (STAGES + 1) /* the glasses are last */
#define T0 (INT64_C(1) << 40)

struct chain {
	struct bb_phase phase;
	struct bb_sync_guard guard;
	int64_t period_ns;
	uint32_t seq;
	bool still[ROWS], swapped[ROWS];
	int64_t off_ns[ROWS];
	enum bb_show show;
	int64_t opened_ns;      /* since it runs; 0: not yet */
	bool runs, asleep;      /* the shutters; who looks at them */
};

static int64_t sync_ns(const struct chain *c, uint32_t seq)
{
	return T0 + seq * c->period_ns;
}

static void step(struct chain *c, int64_t now_ns)
{
	if (c->asleep)
		return;
	c->show = bb_guard_step(&c->guard, &c->phase, false, c->runs, now_ns);
	if (c->show == BB_SHOW_OPEN && !c->opened_ns)
		c->opened_ns = now_ns;
}

static void edge(struct chain *c, unsigned row, int64_t at_ns)
{
	const bool left = (c->seq % 2 == 0) != c->swapped[row];
	const struct bb_shutter_edge e = { .at_ns = at_ns + c->off_ns[row], .seq = c->seq,
		                           .eye = left ? BB_EYE_LEFT : BB_EYE_RIGHT,
		                           .stage = row == STAGES ? BB_STAGE_EMITTER : (uint8_t)row };

	bb_phase_edge(&c->phase, &e);
	bb_guard_edge(&c->guard, &c->phase, &e);
}

/* n periods, with two steps in each: after the stages' edges and after those of the glasses, 3 ms later. */
static void run(struct chain *c, unsigned n)
{
	for (; n; n--, c->seq++) {
		const int64_t at_ns = sync_ns(c, c->seq);
		for (unsigned i = 0; i < STAGES; i++)
			if (!c->still[i])
				edge(c, i, at_ns + 35000 * i);
		step(c, at_ns + c->period_ns / 4);
		if (!c->still[STAGES])
			edge(c, STAGES, at_ns + 3000000);
		step(c, at_ns + c->period_ns * 3 / 4);
	}
}

static struct chain begin(void)
{
	const struct bb_rate rate = { 120, 1 };
	struct chain c = { .period_ns = bb_rate_period_ns(rate), .runs = true };
	const struct bb_guard_config config = { .safety = bb_safety_ceilings(), .n_stages = STAGES, .coast_ns = 20 * BB_NS_PER_S };

	bb_phase_init(&c.phase, rate, STAGES);
	bb_guard_init(&c.guard, &config, T0);
	run(&c, 600); /* known for 5 s: a silence may be coasted over for longer than a test takes */
	assert_int_equal(c.guard.state, BB_GUARD_GOOD);
	assert_int_equal(c.opened_ns, 0);
	return c;
}

/* Opened within a period and a half of where the trouble was, for this reason. */
static void opened_for(const struct chain *c, enum bb_guard_cause cause, uint32_t seq)
{
	assert_int_equal(c->guard.cause, cause);
	assert_true(c->opened_ns >= sync_ns(c, seq));
	assert_true(c->opened_ns <= sync_ns(c, seq) + c->period_ns * 3 / 2);
}

static void a_silence_is_coasted_over(void **state)
{
	struct chain c = begin();

	(void)state;
	for (unsigned row = 0; row < ROWS; row++) { /* each by itself, */
		c.still[row] = true;
		run(&c, 30);
		assert_int_equal(c.guard.state, BB_GUARD_HOLDOVER);
		c.still[row] = false;
		run(&c, 300);
		assert_int_equal(c.guard.state, BB_GUARD_GOOD);
	}
	memset(c.still, 1, sizeof(c.still)); /* and all of them, which is one silence */
	run(&c, 30);
	memset(c.still, 0, sizeof(c.still));
	run(&c, 300);
	assert_int_equal(c.guard.state, BB_GUARD_GOOD);
	assert_int_equal(c.opened_ns, 0);
}

/* The soak's seeds 4529 and 9930: one wall stands still while the glasses go wrong. */
static void a_silence_hides_nobody_else(void **state)
{
	(void)state;
	for (int wrong = 0; wrong < 3; wrong++) {
		struct chain c = begin();
		c.still[1] = true;
		run(&c, 10);
		assert_int_equal(c.opened_ns, 0);
		const uint32_t seq = c.seq;
		c.swapped[STAGES] = wrong == 0;
		c.off_ns[STAGES] = wrong == 1 ? c.period_ns / 10 : 0;
		c.still[STAGES] = wrong == 2;
		run(&c, wrong == 2 ? 1 : 2);
		c.still[STAGES] = false;
		run(&c, 2);
		opened_for(&c, BB_GUARD_FLAPS, wrong == 2 ? seq + 1 : seq);
	}
}

static void two_silences_are_two(void **state)
{
	struct chain c = begin();

	(void)state;
	c.still[1] = true;
	run(&c, 10);
	c.still[0] = true;
	run(&c, 4);
	opened_for(&c, BB_GUARD_FLAPS, c.seq - 3); /* 2.5 periods after its last edge */
	c = begin(); /* and so are two of the same stage */
	for (int i = 0; i < 2; i++) {
		assert_int_equal(c.opened_ns, 0);
		c.still[1] = true;
		run(&c, 10);
		c.still[1] = false;
		run(&c, 1);
	}
	assert_int_equal(c.guard.cause, BB_GUARD_FLAPS);
}

/* Edges that come back may be wrong at once, so nobody waits for the next frame to look. */
static void it_is_looked_at_while_edges_are_missing(void **state)
{
	struct chain c = begin();
	const int64_t half_ns = c.period_ns / 2;

	(void)state;
	int64_t now_ns = sync_ns(&c, c.seq - 1) + c.period_ns * 3 / 4;
	assert_int_equal(bb_guard_due_ns(&c.guard, &c.phase, now_ns), sync_ns(&c, c.seq - 1) + c.period_ns * 3 / 2 + 1);
	c.still[1] = true;
	run(&c, 1);
	now_ns = sync_ns(&c, c.seq - 1) + c.period_ns * 3 / 4;
	assert_int_equal(c.guard.state, BB_GUARD_HOLDOVER);
	assert_int_equal(c.guard.n_events, 0);
	assert_int_equal(bb_guard_due_ns(&c.guard, &c.phase, now_ns), now_ns + half_ns);
}

static void open_and_try(struct chain *c)
{
	c->swapped[STAGES] = true;
	run(c, 1);
	c->swapped[STAGES] = false;
	run(c, 1);
	assert_int_equal(c->guard.state, BB_GUARD_OPEN);
	c->runs = false;
	run(c, 245); /* two seconds */
	assert_int_equal(c->guard.state, BB_GUARD_TRY);
	assert_int_equal(c->show, BB_SHOW_MONO);
	c->runs = true;
	c->opened_ns = 0;
}

static void a_try_ends_with_the_first_that_stays_away(void **state)
{
	struct chain c = begin();

	(void)state;
	open_and_try(&c);
	run(&c, 20);
	assert_int_equal(c.guard.state, BB_GUARD_GOOD);
	c = begin();
	open_and_try(&c);
	c.still[0] = true; /* never comes: it may take its time, */
	run(&c, 10);
	assert_int_equal(c.opened_ns, 0);
	c.still[STAGES] = true; /* and is no excuse for the glasses */
	run(&c, 3);
	assert_true(c.opened_ns > 0 && c.opened_ns <= sync_ns(&c, c.seq - 1));
}

/* Half a second of sleep; of its edges the last 20 periods' were kept. */
static void sleep_and_wake(struct chain *c)
{
	c->asleep = true;
	c->seq += 40;
	bb_guard_away(&c->guard);
	run(c, 10);
	c->swapped[STAGES] = !c->swapped[STAGES];
	run(c, 10);
	c->asleep = false;
	bb_guard_back(&c->guard, &c->phase, sync_ns(c, c->seq));
	bb_phase_init(&c->phase, (struct bb_rate){ 120, 1 }, STAGES);
}

static void what_is_told_of_a_gap_counts(void **state)
{
	struct chain c = begin();

	(void)state;
	sleep_and_wake(&c); /* one slip, of weight 2; the 40 edges that were lost are nothing */
	run(&c, 20);
	assert_int_equal(c.guard.state, BB_GUARD_GOOD);
	assert_int_equal(c.opened_ns, 0);
	assert_int_equal(c.guard.n_events, 1);
	sleep_and_wake(&c); /* a second one */
	run(&c, 1);
	opened_for(&c, BB_GUARD_FLAPS, c.seq - 1);
	c.runs = false; /* open shutters: nothing was seen */
	run(&c, 1);
	c.guard.n_events = 0;
	sleep_and_wake(&c);
	assert_int_equal(c.guard.n_events, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_silence_is_coasted_over),
		cmocka_unit_test(a_silence_hides_nobody_else),
		cmocka_unit_test(two_silences_are_two),
		cmocka_unit_test(it_is_looked_at_while_edges_are_missing),
		cmocka_unit_test(a_try_ends_with_the_first_that_stays_away),
		cmocka_unit_test(what_is_told_of_a_gap_counts),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
