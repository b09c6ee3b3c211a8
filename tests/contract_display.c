/*
 * tests/contract_display.c: what every display must do, over every back end, with tolerances from its limits; then what
 * only the simulated one can be told.
 */
#include "tests/fixture_room.h"
#include "sim/sim_display.h"

static const struct backend {
	const char *name;
	const struct bb_display_driver *driver;
	int fidelity;
	size_t screen; /* 0 genlocked 120 Hz, 2 free 59.94 Hz */
} backends[] = {
	{ "display: sim, fidelity 0, genlock", &sim_display_driver, 0, 0 },
	{ "display: sim, fidelity 1, genlock", &sim_display_driver, 1, 0 },
	{ "display: sim, fidelity 0, free", &sim_display_driver, 0, 2 },
	{ "display: sim, fidelity 1, free", &sim_display_driver, 1, 2 },
	{ "display: sim, fidelity 2, genlock", &sim_display_driver, 2, 0 },
};
static const struct backend *backend;

struct bench {
	struct rig rig;
	struct bb_display *d;
	char target[48];
};

static int setup(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));

	if (!b)
		return -1;
	rig_init(&b->rig, 2, backend->fidelity); /* seed 1 draws a crystal within 0.05 ppm of the generator */
	const struct bb_display_config *c = &b->rig.fix.screens[backend->screen].display;
	const struct bb_open open = rig_open(&b->rig);
	assert_int_equal(bb_display_open(backend->driver, c, &open, &b->d), BB_OK);
	snprintf(b->target, sizeof(b->target), "display/%s", c->id);
	rig_run(&b->rig, 100 * MS); /* past the first vblank */
	*state = b;
	return 0;
}

static int teardown(void **state)
{
	struct bench *b = *state;

	bb_display_close(b->d);
	rig_done(&b->rig);
	free(b);
	return 0;
}

static struct bb_vblank vblank(struct bench *b)
{
	struct bb_vblank v;

	assert_int_equal(bb_display_vblank(b->d, &v), BB_OK);
	return v;
}

static void vblanks_count_at_the_rate(void **state)
{
	struct bench *b = *state;
	const struct bb_display_limits *l = bb_display_limits(b->d);
	const struct bb_vblank first = vblank(b);
	struct bb_vblank last = first;

	assert_true(l->period_ns == bb_rate_period_ns(b->rig.fix.screens[backend->screen].display.rate));
	assert_true(l->vblank_ns > 0 && l->vblank_ns < l->period_ns && l->most_queued > 0);
	for (int i = 0; i < 5000; i++) {
		rig_run(&b->rig, MS);
		const struct bb_vblank v = vblank(b);
		const int64_t now_ns = bb_clock_now_ns(b->rig.clk);
		assert_true(v.at_ns <= now_ns && v.at_ns > now_ns - l->period_ns - l->stamp_error_ns - 10 * US);
		assert_true(v.seq - last.seq <= 1);
		if (v.seq != last.seq)
			assert_true(llabs(v.at_ns - last.at_ns - l->period_ns) <= 2 * l->stamp_error_ns + US);
		last = v;
	}
	const double ideal_ns = (double)(last.seq - first.seq) * (double)l->period_ns;
	assert_true(fabs((double)(last.at_ns - first.at_ns) / ideal_ns - 1) < 50e-6);
}

static bool next_flip(struct bench *b, struct bb_flip *flip, int64_t within_ns)
{
	const int64_t end_ns = bb_clock_now_ns(b->rig.clk) + within_ns;
	size_t n;

	for (;;) {
		if (bb_display_flips(b->d, flip, 1, &n) == BB_OK)
			return true;
		assert_int_equal(n, 0);
		if (bb_clock_now_ns(b->rig.clk) >= end_ns)
			return false;
		rig_run(&b->rig, 500 * US);
	}
}

static void images_flip_at_their_target(void **state)
{
	struct bench *b = *state;
	const struct bb_display_limits *l = bb_display_limits(b->d);

	for (uint64_t frame = 0; frame < 200; frame++) {
		const struct bb_vblank v = vblank(b);
		const uint32_t target = v.seq + 1 + (uint32_t)(frame % 4);
		struct bb_flip flip;
		assert_int_equal(bb_display_present(b->d, frame, frame % 2 ? BB_EYE_LEFT : BB_EYE_RIGHT, target),
		                 BB_OK);
		assert_true(next_flip(b, &flip, 10 * l->period_ns));
		assert_int_equal(flip.frame, frame);
		assert_int_equal(flip.seq, target);
		assert_int_equal(flip.target_seq, target);
		assert_int_equal(flip.eye, frame % 2 ? BB_EYE_LEFT : BB_EYE_RIGHT);
		const int64_t want_ns = v.at_ns + (int64_t)(target - v.seq) * l->period_ns;
		assert_true(llabs(flip.at_ns - want_ns) <= 2 * l->stamp_error_ns + 5 * US);
		assert_true(flip.at_ns <= bb_clock_now_ns(b->rig.clk));
		assert_int_equal(vblank(b).seq, flip.seq);
		assert_int_equal(vblank(b).at_ns, flip.at_ns);
	}
}

static void a_late_image_flips_at_the_next_vblank(void **state)
{
	struct bench *b = *state;
	const struct bb_vblank v = vblank(b);
	struct bb_flip flip;

	assert_int_equal(bb_display_present(b->d, 1, BB_EYE_NONE, v.seq - 3), BB_OK);
	assert_true(next_flip(b, &flip, BB_NS_PER_S));
	assert_int_equal(flip.seq, v.seq + 1);
	assert_int_equal(flip.target_seq, v.seq - 3);
	/* The vblank that began just now has passed as well. */
	assert_int_equal(bb_display_present(b->d, 2, BB_EYE_NONE, flip.seq), BB_OK);
	assert_true(next_flip(b, &flip, BB_NS_PER_S));
	assert_int_equal(flip.seq, v.seq + 2);
}

static void the_queue_is_bounded_and_in_order(void **state)
{
	struct bench *b = *state;
	const uint32_t most = bb_display_limits(b->d)->most_queued;
	const uint32_t seq = vblank(b).seq;
	struct bb_flip flip;

	for (uint32_t i = 0; i < most; i++) /* all for the same vblank: one image each */
		assert_int_equal(bb_display_present(b->d, i, BB_EYE_NONE, seq + 1), BB_OK);
	assert_int_equal(bb_display_present(b->d, most, BB_EYE_NONE, seq + 1), BB_ERR_BUSY);
	for (uint32_t i = 0; i < most; i++) {
		assert_true(next_flip(b, &flip, BB_NS_PER_S));
		assert_int_equal(flip.frame, i);
		assert_int_equal(flip.seq, seq + 1 + i);
	}
	assert_int_equal(bb_display_present(b->d, most, BB_EYE_NONE, 0), BB_OK);
}

static void arguments_are_checked(void **state)
{
	struct bench *b = *state;
	struct bb_flip flip;
	size_t n;

	assert_int_equal(bb_display_vblank(b->d, NULL), BB_ERR_USAGE);
	assert_int_equal(bb_display_flips(b->d, NULL, 1, &n), BB_ERR_USAGE);
	assert_int_equal(bb_display_flips(b->d, &flip, 0, &n), BB_ERR_USAGE);
	assert_int_equal(bb_display_flips(b->d, &flip, 1, &n), BB_TIMEOUT);
}

static void the_swap_group_counts_alike_or_not_at_all(void **state)
{
	struct bench *b = *state;
	const struct bb_open open = rig_open(&b->rig);
	struct bb_display *other;
	uint64_t mine, theirs;

	assert_int_equal(bb_display_open(backend->driver, &b->rig.fix.screens[1].display, &open, &other), BB_OK);
	if (!b->rig.fix.screens[backend->screen].display.genlock) {
		assert_int_equal(bb_display_swap_counter(b->d, &mine), BB_ERR_UNSUPPORTED);
		bb_display_close(other);
		return;
	}
	for (int i = 0; i < 100; i++) {
		rig_run(&b->rig, bb_display_limits(b->d)->period_ns);
		assert_int_equal(bb_display_swap_counter(b->d, &mine), BB_OK);
		assert_int_equal(bb_display_swap_counter(other, &theirs), BB_OK);
		assert_int_equal(mine, theirs);
	}
	bb_display_close(other);
}

/* What follows needs the simulated world. */

static void genlock_follows_the_reference(void **state)
{
	struct bench *b = *state;
	const struct bb_display_config *c = &b->rig.fix.screens[backend->screen].display;

	for (int i = 0; i < 300; i++) {
		rig_run(&b->rig, 33 * MS);
		const struct bb_vblank v = vblank(b);
		const int64_t lag_ns = v.at_ns - sim_world_reference_ns(b->rig.world, c->rate, v.seq);
		if (c->genlock)
			assert_true(lag_ns >= -US && lag_ns <= 5 * US);
		if (c->genlock && backend->fidelity == 0)
			assert_int_equal(lag_ns, 0);
	}
	if (c->genlock)
		return;
	/* The other one drifts by its own crystal. */
	const struct bb_vblank v = vblank(b);
	const double ppm = (double)(sim_display_vblank_ns(b->d, v.seq + 1000000) - sim_display_vblank_ns(b->d, v.seq)) /
	                   (double)bb_rate_frame_ns(c->rate, 1000000) * 1e6 - 1e6;
	assert_true(fabs(ppm) <= (backend->fidelity ? 20.001 : 1e-6));
	assert_true(!backend->fidelity || fabs(ppm) > 1e-3);
}

static void at_rest_it_costs_nothing(void **state)
{
	struct bench *b = *state;
	const uint64_t steps = bb_clock_steps(b->rig.clk);

	rig_run(&b->rig, 100 * BB_NS_PER_S);
	assert_int_equal(bb_clock_steps(b->rig.clk), steps);
	assert_true(vblank(b).seq > 5900);
}

static void a_dropped_flip_never_shows(void **state)
{
	struct bench *b = *state;
	struct bb_flip flip;

	rig_fault(&b->rig, b->target, "drop_flip n=2", true);
	for (uint64_t frame = 0; frame < 4; frame++) {
		assert_int_equal(bb_display_present(b->d, frame, BB_EYE_NONE, vblank(b).seq + 1), BB_OK);
		const bool shown = next_flip(b, &flip, 50 * MS);
		assert_int_equal(shown, frame >= 2);
		assert_true(!shown || flip.frame == frame);
	}
	assert_int_equal(sim_display_swallowed(b->d), 2);
	rig_fault(&b->rig, b->target, "drop_flip n=2", false); /* used up: nothing left to take back */
	assert_int_equal(bb_display_present(b->d, 9, BB_EYE_NONE, 0), BB_OK);
	assert_true(next_flip(b, &flip, 50 * MS));
}

static void late_flips_say_so(void **state)
{
	struct bench *b = *state;
	struct bb_flip flip;

	rig_fault(&b->rig, b->target, "late frames=2", true);
	for (uint64_t frame = 0; frame < 10; frame++) {
		const uint32_t target = vblank(b).seq + 1;
		if (frame == 5)
			rig_fault(&b->rig, b->target, "late frames=2", false);
		assert_int_equal(bb_display_present(b->d, frame, BB_EYE_NONE, target), BB_OK);
		assert_true(next_flip(b, &flip, BB_NS_PER_S));
		assert_int_equal(flip.seq - flip.target_seq, frame < 5 ? 2 : 0);
	}
}

/* Vblanks stay in order and keep their distance while the axis changes under a waiting image. */
static void watch_axis(struct bench *b, const char *fault, int64_t slack_ns)
{
	const int64_t period_ns = bb_display_limits(b->d)->period_ns;
	struct bb_vblank last = vblank(b);
	struct bb_flip flip;

	for (int i = 0; i < 6000; i++) {
		if (i == 1000 || i == 4000)
			rig_fault(&b->rig, b->target, fault, i == 1000);
		rig_run(&b->rig, MS);
		if (i % 100 == 0)
			assert_int_equal(bb_display_present(b->d, (uint64_t)i, BB_EYE_NONE, last.seq + 3), BB_OK);
		const struct bb_vblank v = vblank(b);
		assert_true(v.seq - last.seq <= 1 && v.at_ns >= last.at_ns);
		if (v.seq != last.seq)
			assert_true(v.at_ns - last.at_ns <= 2 * period_ns &&
			            v.at_ns - last.at_ns >= period_ns - slack_ns);
		last = v;
		if (i % 100 == 90) {
			assert_true(next_flip(b, &flip, 0));
			assert_true(flip.frame == (uint64_t)i - 90 && flip.seq == flip.target_seq);
		}
	}
}

static void without_genlock_it_runs_on_its_own(void **state)
{
	struct bench *b = *state;
	const struct bb_display_config *c = &b->rig.fix.screens[backend->screen].display;

	watch_axis(b, "unlock", bb_display_limits(b->d)->period_ns);
	if (!c->genlock)
		return;
	rig_fault(&b->rig, b->target, "unlock", true);
	const int64_t before_ns = vblank(b).at_ns - sim_world_sync_after(b->rig.world, vblank(b).at_ns - 10 * US);
	rig_run(&b->rig, 50 * BB_NS_PER_S);
	const int64_t after_ns = vblank(b).at_ns - sim_world_sync_after(b->rig.world, vblank(b).at_ns - 4 * MS);
	assert_true(llabs(after_ns - before_ns) > 100 * US); /* 12 ppm of the generator over 50 s, give or take */
}

static void a_crystal_fault_shifts_only_a_free_display(void **state)
{
	struct bench *b = *state;
	const bool genlock = b->rig.fix.screens[backend->screen].display.genlock;

	watch_axis(b, "rate ppm=400", 10 * US);
	const struct bb_vblank v = vblank(b);
	const int64_t before_ns = sim_display_vblank_ns(b->d, v.seq + 1000) - v.at_ns;
	rig_fault(&b->rig, b->target, "rate ppm=400", true);
	const int64_t gain_ns = before_ns - (sim_display_vblank_ns(b->d, v.seq + 1000) - v.at_ns);
	const double want_ns = genlock ? 0 : 400e-6 * (double)before_ns;
	assert_true(fabs((double)gain_ns - want_ns) < 0.01 * want_ns + 2);
}

static void unplugged_is_lost(void **state)
{
	struct bench *b = *state;
	struct bb_vblank v;
	struct bb_flip flip;
	size_t n;

	assert_int_equal(bb_display_present(b->d, 1, BB_EYE_NONE, vblank(b).seq + 2), BB_OK);
	rig_fault(&b->rig, b->target, "unplug", true);
	assert_int_equal(bb_display_vblank(b->d, &v), BB_ERR_LOST);
	assert_int_equal(bb_display_present(b->d, 2, BB_EYE_NONE, 0), BB_ERR_LOST);
	assert_int_equal(bb_display_flips(b->d, &flip, 1, &n), BB_ERR_LOST);
	rig_run(&b->rig, 100 * MS);
	rig_fault(&b->rig, b->target, "unplug", false);
	assert_false(next_flip(b, &flip, 100 * MS)); /* what waited is gone */
	assert_int_equal(bb_display_present(b->d, 3, BB_EYE_NONE, 0), BB_OK);
	assert_true(next_flip(b, &flip, 100 * MS));
	assert_int_equal(flip.frame, 3);
}

static void unread_results_lose_the_oldest(void **state)
{
	struct bench *b = *state;
	struct bb_flip flip;
	size_t n;

	for (uint64_t i = 0; i < 100; i++) {
		assert_int_equal(bb_display_present(b->d, i, BB_EYE_NONE, 0), BB_OK);
		rig_run(&b->rig, 40 * MS);
	}
	assert_int_equal(bb_display_flips(b->d, &flip, 1, &n), BB_OK);
	assert_int_equal(flip.frame, sim_display_unread(b->d));
	assert_true(flip.frame > 50);
}

static void nonsense_is_refused(void **state)
{
	struct bench *b = *state;
	struct bb_display_config c = b->rig.fix.screens[1].display;
	struct bb_open open = rig_open(&b->rig);
	struct bb_display *d;

	c.rate = (struct bb_rate){ 60, 0 };
	assert_int_equal(bb_display_open(backend->driver, &c, &open, &d), BB_ERR_RANGE);
	c = b->rig.fix.screens[1].display;
	c.rate_error_ppm = 1e9;
	assert_int_equal(bb_display_open(backend->driver, &c, &open, &d), BB_ERR_RANGE);
	c = b->rig.fix.screens[1].display;
	c.vblank_us = 1e6;
	assert_int_equal(bb_display_open(backend->driver, &c, &open, &d), BB_ERR_RANGE);
	rig_option(&b->rig, "rate_error_ppm", "x");
	assert_int_equal(bb_display_open(backend->driver, &b->rig.fix.screens[1].display, &open, &d), BB_ERR_CONFIG);
	assert_null(d);
	bb_display_close(NULL);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(vblanks_count_at_the_rate), T(images_flip_at_their_target), T(a_late_image_flips_at_the_next_vblank),
		T(the_queue_is_bounded_and_in_order), T(arguments_are_checked),
		T(the_swap_group_counts_alike_or_not_at_all), T(genlock_follows_the_reference),
		T(at_rest_it_costs_nothing), T(a_dropped_flip_never_shows), T(late_flips_say_so),
		T(without_genlock_it_runs_on_its_own), T(a_crystal_fault_shifts_only_a_free_display),
		T(unplugged_is_lost), T(unread_results_lose_the_oldest), T(nonsense_is_refused),
	};
	int failed = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		backend = &backends[i];
		failed += cmocka_run_group_tests_name(backend->name, tests, NULL, NULL);
	}
	return failed;
}
