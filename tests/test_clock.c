/* tests/test_clock.c: hal/clock.c: order of timers, re-arming, stopping, both clocks. */
#include "tests/fixture_room.h"

struct probe {
	struct bb_timer timer;
	int id;
	int64_t again_ns;    /* period; 0: once */
	int64_t scheduled_ns, now_ns;
	int runs;
};

static int order[64];
static size_t n_order;

static int64_t note(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct probe *p = bb_container_of(timer, struct probe, timer);

	p->scheduled_ns = scheduled_ns;
	p->now_ns = now_ns;
	p->runs++;
	if (n_order < BB_ARRAY_LEN(order))
		order[n_order++] = p->id;
	return p->again_ns ? scheduled_ns + p->again_ns : BB_NEVER;
}

static void arm(struct bb_clock *clk, struct probe *p, int id, uint8_t rank, int64_t at_ns)
{
	p->id = id;
	p->timer.step = note;
	p->timer.rank = rank;
	assert_int_equal(bb_clock_arm(clk, &p->timer, at_ns), BB_OK);
}

static int setup(void **state)
{
	struct bb_clock *clk;

	if (bb_clock_virtual_create(&clk) != BB_OK)
		return -1;
	*state = clk;
	n_order = 0;
	return 0;
}

static int teardown(void **state)
{
	bb_clock_destroy(*state);
	return 0;
}

static void equal_times_run_by_rank_then_arming(void **state)
{
	struct probe p[6] = { 0 };
	static const int want[] = { 5, 1, 4, 2, 0, 3 };

	arm(*state, &p[0], 0, 3, 100);
	arm(*state, &p[1], 1, 1, 100);
	arm(*state, &p[2], 2, 2, 100);
	arm(*state, &p[3], 3, 3, 100);
	arm(*state, &p[4], 4, 1, 100);
	arm(*state, &p[5], 5, 3, 99);
	bb_clock_run_until(*state, 1000);
	assert_int_equal(n_order, 6);
	for (size_t i = 0; i < 6; i++)
		assert_int_equal(order[i], want[i]);
	assert_int_equal(bb_clock_now_ns(*state), 1000);
	assert_int_equal(bb_clock_steps(*state), 6);
}

static void rearming_moves_to_the_back_of_its_rank(void **state)
{
	struct probe p[3] = { 0 };

	for (int i = 0; i < 3; i++)
		arm(*state, &p[i], i, 1, 50);
	assert_int_equal(bb_clock_arm(*state, &p[1].timer, 50), BB_OK);
	bb_clock_run_until(*state, 50);
	assert_int_equal(order[0], 0);
	assert_int_equal(order[1], 2);
	assert_int_equal(order[2], 1);
}

static void a_periodic_step_keeps_its_schedule(void **state)
{
	struct probe p = { .again_ns = 7 };

	arm(*state, &p, 0, 1, 7);
	bb_clock_run_until(*state, 70);
	assert_int_equal(p.runs, 10);
	assert_int_equal(p.scheduled_ns, 70);
	assert_int_equal(p.now_ns, 70);
}

static void the_past_runs_next_and_time_never_goes_back(void **state)
{
	struct probe p = { 0 };

	bb_clock_run_until(*state, 500);
	arm(*state, &p, 0, 1, 100);
	bb_clock_run_until(*state, 500);
	assert_int_equal(p.runs, 1);
	assert_int_equal(p.scheduled_ns, 100);
	assert_int_equal(p.now_ns, 500);
	bb_clock_run_until(*state, 400);
	assert_int_equal(bb_clock_now_ns(*state), 500);
}

static void a_disarmed_timer_does_not_run(void **state)
{
	struct probe p[200] = { 0 };

	for (int i = 0; i < 200; i++)
		arm(*state, &p[i], i, 1, 1000 - 3 * i);
	for (int i = 0; i < 200; i += 2)
		bb_clock_disarm(*state, &p[i].timer);
	bb_clock_disarm(*state, &p[0].timer); /* twice does nothing */
	bb_clock_run_until(*state, 1000);
	for (int i = 0; i < 200; i++)
		assert_int_equal(p[i].runs, i % 2);
	for (size_t i = 1; i < n_order; i++)
		assert_true(order[i] < order[i - 1]); /* armed backwards, so the last one is due first */
}

static struct bb_clock *stop_me;

static int64_t stop_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	(void)timer;
	(void)now_ns;
	bb_clock_stop(stop_me);
	return scheduled_ns + 10;
}

static void stop_leaves_the_rest_for_later(void **state)
{
	struct bb_timer stopper = { .step = stop_step };
	struct probe p = { 0 };

	stop_me = *state;
	assert_int_equal(bb_clock_arm(*state, &stopper, 10), BB_OK);
	arm(*state, &p, 0, 1, 15);
	bb_clock_run_until(*state, 100);
	assert_int_equal(bb_clock_now_ns(*state), 10);
	assert_int_equal(p.runs, 0);
	bb_clock_run_until(*state, 17);
	assert_int_equal(p.runs, 1);
	bb_clock_disarm(*state, &stopper);
}

/* Against a sorted list, with arming, re-arming and disarming at random. */
static void the_next_timer_is_known(void **state)
{
	struct probe p[2] = { 0 };

	assert_true(bb_clock_next_ns(*state) == BB_NEVER);
	arm(*state, &p[0], 0, 0, 300);
	arm(*state, &p[1], 1, 0, 200);
	assert_int_equal(bb_clock_next_ns(*state), 200);
	bb_clock_disarm(*state, &p[1].timer);
	assert_int_equal(bb_clock_next_ns(*state), 300);
	bb_clock_run_until(*state, 400);
	assert_true(bb_clock_next_ns(*state) == BB_NEVER);
}

static void a_random_heap_is_in_order(void **state)
{
	static struct probe p[500];
	struct sim_rng r;
	int64_t last = 0;

	memset(p, 0, sizeof(p));
	sim_rng_seed(&r, 3, "test", "heap");
	for (int i = 0; i < 5000; i++) {
		struct probe *q = &p[sim_rng_u64(&r) % BB_ARRAY_LEN(p)];
		if (sim_rng_u64(&r) % 4)
			arm(*state, q, 0, (uint8_t)(sim_rng_u64(&r) % 3), (int64_t)(sim_rng_u64(&r) % 100000));
		else
			bb_clock_disarm(*state, &q->timer);
	}
	for (int64_t end = 0; end <= 100000; end += 10) {
		bb_clock_run_until(*state, end);
		for (size_t i = 0; i < BB_ARRAY_LEN(p); i++) {
			if (p[i].timer.slot)
				assert_true(p[i].timer.at_ns > end);
			else if (p[i].runs)
				assert_true(p[i].scheduled_ns <= end &&
				            (p[i].scheduled_ns > last || p[i].now_ns <= last));
		}
		last = end;
	}
}

static void destroy_forgets_armed_timers(void **state)
{
	struct bb_clock *clk;
	struct probe p = { 0 };

	(void)state;
	assert_int_equal(bb_clock_virtual_create(&clk), BB_OK);
	arm(clk, &p, 0, 1, 10);
	bb_clock_destroy(clk);
	assert_int_equal(p.timer.slot, 0);
	bb_clock_destroy(NULL);
}

static void posix_time_flows_and_steps_are_never_early(void **state)
{
	struct probe p = { .again_ns = 2 * MS };
	struct bb_clock *clk;

	(void)state;
	assert_int_equal(bb_clock_posix_create(&clk), BB_OK);
	assert_false(bb_clock_is_virtual(clk));
	const int64_t start_ns = bb_clock_now_ns(clk);
	assert_true(start_ns >= 0 && start_ns < BB_NS_PER_S);
	arm(clk, &p, 0, 1, start_ns + 2 * MS);
	const int64_t watch_ns = bb_clock_stopwatch_ns();
	bb_clock_run_until(clk, start_ns + 20 * MS);
	assert_true(bb_clock_stopwatch_ns() - watch_ns >= 15 * MS); /* it really slept */
	assert_int_equal(p.runs, 10);
	assert_true(p.now_ns >= p.scheduled_ns);
	assert_int_equal(p.scheduled_ns, start_ns + 20 * MS);
	assert_true(bb_clock_now_ns(clk) >= start_ns + 20 * MS);
	bb_clock_destroy(clk);
}

struct readings { /* a clock's time, and real time before and after it was read */
	int64_t before_ns, now_ns, after_ns;
};

static struct readings read_both(const struct bb_clock *clk)
{
	struct readings r = { .before_ns = bb_clock_stopwatch_ns() };

	r.now_ns = bb_clock_now_ns(clk);
	r.after_ns = bb_clock_stopwatch_ns();
	return r;
}

static void passed_at_rate(const struct readings *a, const struct readings *b, double rate)
{
	const double passed_ns = (double)(b->now_ns - a->now_ns);

	assert_true(passed_ns >= rate * (double)(b->before_ns - a->after_ns) - 100);
	assert_true(passed_ns <= rate * (double)(b->after_ns - a->before_ns) + 100);
}

/* A crystal 1 % too fast, steered by what it is wrong: now runs like the kernel's clock, waits end when they should, and
 * nothing jumps. */
static void posix_clock_is_steered(void **state)
{
	struct bb_clock *clk;
	struct probe p = { 0 };

	(void)state;
	assert_int_equal(bb_clock_posix_create(&clk), BB_OK);
	bb_clock_plant_crystal(clk, 1e7);
	const struct readings start = read_both(clk);
	arm(clk, &p, 1, 0, start.now_ns + 50000000);
	bb_clock_run_until(clk, start.now_ns + 50000000);
	const struct readings middle = read_both(clk);
	assert_int_equal(p.runs, 1);
	assert_true(p.now_ns >= p.scheduled_ns);
	passed_at_rate(&start, &middle, 1.01);
	bb_clock_steer(clk, -1e7 / 1.01);
	const struct readings steered = read_both(clk);
	passed_at_rate(&middle, &steered, 1.01);
	bb_clock_run_until(clk, steered.now_ns + 50000000);
	const struct readings end = read_both(clk);
	assert_true(end.now_ns >= steered.now_ns + 50000000);
	passed_at_rate(&steered, &end, 1);
	const struct readings own[2] = { { steered.before_ns, bb_clock_own_ns(clk, steered.now_ns), steered.after_ns },
		                         { end.before_ns, bb_clock_own_ns(clk, end.now_ns), end.after_ns } };
	passed_at_rate(&own[0], &own[1], 1.01);
	bb_clock_destroy(clk);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(equal_times_run_by_rank_then_arming, setup, teardown),
		cmocka_unit_test_setup_teardown(rearming_moves_to_the_back_of_its_rank, setup, teardown),
		cmocka_unit_test_setup_teardown(a_periodic_step_keeps_its_schedule, setup, teardown),
		cmocka_unit_test_setup_teardown(the_past_runs_next_and_time_never_goes_back, setup, teardown),
		cmocka_unit_test_setup_teardown(a_disarmed_timer_does_not_run, setup, teardown),
		cmocka_unit_test_setup_teardown(stop_leaves_the_rest_for_later, setup, teardown),
		cmocka_unit_test_setup_teardown(the_next_timer_is_known, setup, teardown),
		cmocka_unit_test_setup_teardown(a_random_heap_is_in_order, setup, teardown),
		cmocka_unit_test(destroy_forgets_armed_timers),
		cmocka_unit_test(posix_time_flows_and_steps_are_never_early),
		cmocka_unit_test(posix_clock_is_steered),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
