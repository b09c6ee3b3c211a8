/*
 * tests/test_safety.c: the ceilings, the outputs' state machine and the guard of the LC cells, to the last branch and
 * constant: tests/safety-coverage.sh and tests/safety-mutants.py run this program over hal/safety.c, hal/safe_state.c
 * and hal/lc_guard.c.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "hal/lc_guard.h"
#include "hal/safe_state.h"

#define MS INT64_C(1000000)

/* ---- ceilings ---- */

static void the_ceilings_are_these(void **state)
{
	const struct bb_safety s = bb_safety_ceilings();
	const struct bb_safety want = { 3, 500, 2, 50, 900, 200, 180, 60, 4, 500, false, false };

	(void)state;
	assert_memory_equal(&s, &want, offsetof(struct bb_safety, allow_ddc_power_off));
	assert_false(s.allow_ddc_power_off || s.allow_ddc_save);
}

static const struct {
	const char *key;
	double ceiling, far; /* the last value that is taken on the stricter side */
	bool at_most;
	size_t offset;
} keys[] = {
	{ "flashes_per_s", 3, 0, true, offsetof(struct bb_safety, flashes_per_s) },
	{ "fade_ms", 500, 60e3, false, offsetof(struct bb_safety, fade_ms) },
	{ "transition_gap_s", 2, 3600, false, offsetof(struct bb_safety, transition_gap_s) },
	{ "shutter_least_hz", 50, 1000, false, offsetof(struct bb_safety, shutter_least_hz) },
	{ "holdover_most_s", 900, 0, true, offsetof(struct bb_safety, holdover_most_s) },
	{ "white_cd_m2", 200, 10e3, false, offsetof(struct bb_safety, white_cd_m2) },
	{ "outlet_least_off_s", 180, 86400, false, offsetof(struct bb_safety, outlet_least_off_s) },
	{ "outlet_least_on_s", 60, 86400, false, offsetof(struct bb_safety, outlet_least_on_s) },
	{ "outlet_cycles_per_hour", 4, 0, true, offsetof(struct bb_safety, outlet_cycles_per_hour) },
	{ "outlet_stagger_ms", 500, 600e3, false, offsetof(struct bb_safety, outlet_stagger_ms) },
};

static double member(const struct bb_safety *s, size_t offset)
{
	double v;

	memcpy(&v, (const char *)s + offset, sizeof(v));
	return v;
}

static void refused(struct bb_safety *s, const char *key, double value, const char *words)
{
	const struct bb_safety before = *s;
	struct bb_error err = { 0 };

	assert_int_equal(bb_safety_tighten(s, key, value, NULL, &err), BB_ERR_REFUSED);
	assert_int_equal(err.number, 1120);
	if (!strstr(err.text, words))
		fail_msg("%s = %g: %s", key, value, err.text);
	assert_memory_equal(s, &before, sizeof(before));
}

static void a_room_can_only_be_stricter(void **state)
{
	const double nobody[] = { (double)NAN, (double)INFINITY, -(double)INFINITY };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(keys); i++) {
		const double c = keys[i].ceiling, sign = keys[i].at_most ? -1 : 1;
		struct bb_safety s = bb_safety_ceilings();

		for (size_t k = 0; k < BB_ARRAY_LEN(nobody); k++)
			refused(&s, keys[i].key, nobody[k], keys[i].key);
		refused(&s, keys[i].key, c - sign * 1e-9, keys[i].at_most ? "at most" : "at least");
		refused(&s, keys[i].key, keys[i].far + sign * 1e-9, keys[i].at_most ? "at least" : "at most");
		assert_int_equal(bb_safety_tighten(&s, keys[i].key, c, NULL, NULL), BB_OK);
		assert_int_equal(bb_safety_tighten(&s, keys[i].key, c + sign * 0.5, NULL, NULL), BB_OK);
		assert_true(member(&s, keys[i].offset) == c + sign * 0.5);
		refused(&s, keys[i].key, c, "at"); /* what was tightened stays tightened */
		assert_int_equal(bb_safety_tighten(&s, keys[i].key, keys[i].far, NULL, NULL), BB_OK);
		assert_true(member(&s, keys[i].offset) == keys[i].far);
	}
}

static void nothing_else_can_be_said(void **state)
{
	static const char *const never[] = { "allow_ddc_power_off", "allow_ddc_save" };
	struct bb_safety s = bb_safety_ceilings();
	const struct bb_safety before = s;
	struct bb_error err = { 0 };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(never); i++) {
		assert_int_equal(bb_safety_tighten(&s, never[i], 0, NULL, NULL), BB_OK);
		refused(&s, never[i], 1, "always 0");
		refused(&s, never[i], -1, "always 0");
	}
	assert_int_equal(bb_safety_tighten(&s, "fade", 600, NULL, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1011);
	assert_memory_equal(&s, &before, sizeof(before));
}

static void holdover_ends_a_tenth_of_a_period_off(void **state)
{
	struct bb_safety s = bb_safety_ceilings();

	(void)state;
	assert_in_range(bb_safety_holdover_ns(&s, 8333333, 100), 8333332998, 8333333001);
	assert_in_range(bb_safety_holdover_ns(&s, 8333333, 1), 833333299990, 833333300001);
	assert_int_equal(bb_safety_holdover_ns(&s, 8333333, 0.9), INT64_C(900000000000));
	assert_int_equal(bb_safety_holdover_ns(&s, 8333333, 0), INT64_C(900000000000));
	assert_int_equal(bb_safety_holdover_ns(&s, 8333333, (double)NAN), 0);
	assert_int_equal(bb_safety_holdover_ns(&s, 8333333, -1), 0);
	s.holdover_most_s = 3;
	assert_int_equal(bb_safety_holdover_ns(&s, 8333333, 100), INT64_C(3000000000));
}

/* ---- the outputs ---- */

static struct bb_safe_state begin(enum bb_show show, double dim)
{
	const struct bb_safety limits = bb_safety_ceilings();
	struct bb_safe_state s;

	bb_safe_init(&s, &limits, dim, show, 1000 * MS);
	return s;
}

static void check(const struct bb_safe_output o, bool open, double depth, double light)
{
	if (o.open != open || fabs(o.depth - depth) > 1e-9 || fabs(o.light - light) > 1e-9)
		fail_msg("open %d, depth %.12g, light %.12g; want %d, %.12g, %.12g", o.open, o.depth, o.light, open, depth,
		         light);
}

static void it_begins_where_it_is_told(void **state)
{
	static const struct {
		enum bb_show show;
		bool open;
		double depth, light;
	} row[] = { { BB_SHOW_STEREO, false, 1, 1 }, { BB_SHOW_MONO, false, 0, 1 },
		    { BB_SHOW_BLACK, false, 0, 0 }, { BB_SHOW_OPEN, true, 0, 1 } };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(row); i++) {
		struct bb_safe_state s = begin(row[i].show, 0.5);

		assert_int_equal(s.fade_ns, 500 * MS);
		assert_int_equal(s.gap_ns, 2000 * MS);
		check(s.out, row[i].open, row[i].depth, row[i].light);
		for (int k = 0; k < 5; k++) /* and stays there */
			check(bb_safe_step(&s, row[i].show, (1000 + 300 * k) * MS), row[i].open, row[i].depth, row[i].light);
		/* Free to move at once, but a step of no length moves nothing. */
		s = begin(row[i].show, 0.5);
		const enum bb_show other = i == 0 ? BB_SHOW_MONO : BB_SHOW_STEREO;
		check(bb_safe_step(&s, other, 1000 * MS), row[i].open, row[i].depth, row[i].light);
		assert_int_equal(s.show, other);
	}
}

static void opening_is_one_step_and_is_latched(void **state)
{
	struct bb_safe_state s = begin(BB_SHOW_STEREO, 0.25);

	(void)state;
	check(bb_safe_step(&s, BB_SHOW_STEREO, 1010 * MS), false, 1, 1);
	check(bb_safe_step(&s, BB_SHOW_OPEN, 1010 * MS), true, 0, 1); /* no time has passed: immediate */
	for (int64_t t = 1010; t < 3010; t += 10)                     /* whatever is wished */
		check(bb_safe_step(&s, (enum bb_show)(t / 10 % 3), t * MS), true, 0, 1);
	check(bb_safe_step(&s, BB_SHOW_STEREO, 3010 * MS - 1), true, 0, 1);
	assert_int_equal(s.show, BB_SHOW_OPEN);
	check(bb_safe_step(&s, BB_SHOW_STEREO, 3010 * MS), true, 0, 1 - 1e-6 / 500);
	assert_int_equal(s.show, BB_SHOW_STEREO);
}

static void opening_again_does_not_move_the_latch(void **state)
{
	struct bb_safe_state s = begin(BB_SHOW_STEREO, 0.25);

	(void)state;
	bb_safe_step(&s, BB_SHOW_OPEN, 1100 * MS);
	for (int64_t t = 1110; t < 3100; t += 10)
		bb_safe_step(&s, BB_SHOW_OPEN, t * MS);
	assert_int_equal(s.moved_ns, 1100 * MS);
	bb_safe_step(&s, BB_SHOW_MONO, 3100 * MS);
	assert_int_equal(s.show, BB_SHOW_MONO);
}

static void stereo_and_mono_fade_in_half_a_second(void **state)
{
	struct bb_safe_state s = begin(BB_SHOW_STEREO, 0.5);

	(void)state;
	for (int k = 0; k <= 60; k++)
		check(bb_safe_step(&s, BB_SHOW_MONO, (1000 + 10 * k) * MS), false, fmax(0, 1 - k / 50.0), 1);
	for (int64_t t = 1600; t < 3000; t += 10) /* the next one is two seconds from the last one's beginning */
		check(bb_safe_step(&s, BB_SHOW_STEREO, t * MS), false, 0, 1);
	for (int k = 0; k <= 60; k++)
		check(bb_safe_step(&s, BB_SHOW_STEREO, (3000 + 10 * k) * MS), false, fmin(1, (k + 1) / 50.0), 1);
}

static void black_fades_and_leaves_the_shutters(void **state)
{
	struct bb_safe_state s = begin(BB_SHOW_STEREO, 0.5);

	(void)state;
	for (int k = 0; k <= 60; k++)
		check(bb_safe_step(&s, BB_SHOW_BLACK, (1000 + 10 * k) * MS), false, fmax(0, 1 - k / 50.0),
		      fmax(0, 1 - k / 50.0));
	bb_safe_step(&s, BB_SHOW_OPEN, 1610 * MS); /* even in the dark; brightness comes back as a fade */
	check(s.out, true, 0, 0.02);
	for (int k = 2; k <= 60; k++)
		check(bb_safe_step(&s, BB_SHOW_OPEN, (1600 + 10 * k) * MS), true, 0, fmin(1, k / 50.0));
	s = begin(BB_SHOW_OPEN, 0.5);
	for (int k = 0; k <= 60; k++)
		check(bb_safe_step(&s, BB_SHOW_BLACK, (1000 + 10 * k) * MS), true, 0, fmax(0, 1 - k / 50.0));
}

/* What an eye gets must not jump when the shutters begin to run. */
static void closing_keeps_the_light(void **state)
{
	(void)state;
	for (int i = 1; i <= 4; i++) {
		const double dim = i / 4.0;
		struct bb_safe_state s = begin(BB_SHOW_OPEN, dim);
		double seen = 1, least = 1;
		bool closed = false;

		for (int64_t t = 1000; t < 3000; t += 10) {
			const struct bb_safe_output o = bb_safe_step(&s, BB_SHOW_STEREO, t * MS);
			const double now = o.light * (o.open ? 1 : dim);

			assert_true(fabs(now - seen) <= 0.02 + 1e-9);
			assert_true(!o.open || o.depth <= 0);
			closed |= !o.open;
			assert_true(!closed || !o.open);
			seen = now;
			least = fmin(least, now);
		}
		assert_true(closed && fabs(seen - dim) < 1e-9 && least >= dim - 1e-9);
		check(s.out, false, 1, 1);
	}
	struct bb_safe_state s = begin(BB_SHOW_OPEN, 0.25); /* to mono: the same, and no depth follows */
	for (int64_t t = 1000; t < 3000; t += 10)
		bb_safe_step(&s, BB_SHOW_MONO, t * MS);
	check(s.out, false, 0, 1);
}

static void a_fade_to_closed_can_be_broken_off(void **state)
{
	struct bb_safe_state s = begin(BB_SHOW_OPEN, 0.25);

	(void)state;
	for (int k = 0; k <= 10; k++)
		bb_safe_step(&s, BB_SHOW_STEREO, (1000 + 10 * k) * MS);
	check(s.out, true, 0, 0.8);
	for (int k = 1; k <= 20; k++)
		check(bb_safe_step(&s, BB_SHOW_OPEN, (1100 + 10 * k) * MS), true, 0, fmin(1, 0.8 + k / 50.0));
}

static void a_late_step_moves_no_further(void **state)
{
	struct bb_safe_state s = begin(BB_SHOW_STEREO, 0.5);

	(void)state;
	check(bb_safe_step(&s, BB_SHOW_MONO, 1025 * MS), false, 0.95, 1);
	check(bb_safe_step(&s, BB_SHOW_MONO, 1049 * MS), false, 0.902, 1); /* just below what one call may */
	check(bb_safe_step(&s, BB_SHOW_MONO, 9000 * MS), false, 0.852, 1);
	check(bb_safe_step(&s, BB_SHOW_MONO, 9000 * MS), false, 0.852, 1);
}

/* 10 Hz of wishes: the shutters move at most every two seconds, however they come. */
static void flapping_is_held(void **state)
{
	static const enum bb_show worst[] = { BB_SHOW_OPEN, BB_SHOW_STEREO, BB_SHOW_BLACK, BB_SHOW_MONO };
	struct bb_safe_state s = begin(BB_SHOW_STEREO, 0.25);
	int64_t opened = -2000;
	bool open = false;
	int n = 0;

	(void)state;
	for (int64_t t = 1000; t < 61000; t += 5) {
		const enum bb_show want = worst[t / 50 % (t < 31000 ? 2 : 4)];
		const struct bb_safe_output o = bb_safe_step(&s, want, t * MS);
		if (o.open && !open) {
			assert_true(t - opened >= 2000);
			opened = t;
			n++;
		}
		open = o.open;
	}
	assert_in_range(n, 1, 30);
}

/* ---- LC cells ---- */

static void cells_that_alternate_are_balanced(void **state)
{
	struct bb_lc_guard g;

	(void)state;
	bb_lc_init(&g);
	for (int64_t n = 0; n < 120 * 3600; n++) { /* an hour, jittered: stretches differ, their sum does not grow */
		const int64_t at_ns = n * 8333333 + (n * 7919) % 100000;
		bb_lc_edge(&g, n % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT, at_ns);
		assert_false(bb_lc_harmed(&g, at_ns + 8 * MS));
	}
	assert_true(bb_lc_bias_ns(&g, INT64_C(432000) * 8333333) < 30 * MS);
}

static void a_cell_that_stays_closed_is_told(void **state)
{
	struct bb_lc_guard g;

	(void)state;
	for (int eye = BB_EYE_LEFT; eye <= BB_EYE_RIGHT; eye++) {
		bb_lc_init(&g);
		assert_false(bb_lc_harmed(&g, BB_NEVER - 1));
		assert_int_equal(bb_lc_bias_ns(&g, 1), 0);
		bb_lc_edge(&g, (enum bb_eye)eye, 100 * MS);
		assert_false(bb_lc_harmed(&g, 350 * MS));
		assert_true(bb_lc_harmed(&g, 350 * MS + 1));
		assert_int_equal(bb_lc_bias_ns(&g, 350 * MS), 250 * MS);
		bb_lc_edge(&g, (enum bb_eye)eye, 300 * MS); /* the same eye again: not a new stretch */
		assert_true(bb_lc_harmed(&g, 350 * MS + 1));
		bb_lc_edge(&g, BB_EYE_NONE, 351 * MS);
		assert_false(bb_lc_harmed(&g, 9000 * MS));
		assert_int_equal(bb_lc_bias_ns(&g, 9000 * MS), 0);
	}
}

/* Every second closing is 10 ms longer: its own polarity's sum grows by that, and one of the cells is told to be biased. */
static void uneven_closings_add_up(void **state)
{
	struct bb_lc_guard g;
	int64_t at_ns = 0;
	int n = 0;

	(void)state;
	bb_lc_init(&g);
	for (; !bb_lc_harmed(&g, at_ns) && n < 1000; n++) {
		bb_lc_edge(&g, BB_EYE_LEFT, at_ns); /* the right cell is closed now, */
		at_ns += n % 2 ? 20 * MS : 10 * MS;
		bb_lc_edge(&g, BB_EYE_RIGHT, at_ns); /* and now the left one, always as long */
		at_ns += 10 * MS;
		assert_true(llabs(g.cell[0].balance_ns) <= 10 * MS);
	}
	assert_in_range(n, 98, 104);
	assert_in_range(bb_lc_bias_ns(&g, at_ns), 500 * MS + 1, 520 * MS);
	assert_int_equal(bb_lc_bias_ns(&g, at_ns) % MS, 0);
	g.cell[1].balance_ns = g.cell[0].balance_ns = 0;
	g.cell[0].closed = g.cell[1].closed = false;
	assert_int_equal(bb_lc_bias_ns(&g, at_ns), 0);
	g.cell[0].balance_ns = -500 * MS;
	assert_false(bb_lc_harmed(&g, at_ns));
	g.cell[0].balance_ns -= 1;
	assert_true(bb_lc_harmed(&g, at_ns));
	g.cell[1].balance_ns = 700 * MS;
	assert_int_equal(bb_lc_bias_ns(&g, at_ns), 700 * MS);
}

/* A pause with both eyes open lets the bias go, and the polarity goes on where it was. */
static void a_pause_lets_the_bias_go(void **state)
{
	struct bb_lc_guard g;

	(void)state;
	bb_lc_init(&g);
	bb_lc_edge(&g, BB_EYE_LEFT, 0);
	assert_true(g.cell[1].closed && !g.cell[0].closed && g.cell[1].turned && !g.cell[0].turned);
	bb_lc_edge(&g, BB_EYE_NONE, 10 * MS);
	assert_true(!g.cell[1].closed && g.cell[1].turned && !g.cell[1].balance_ns);
	bb_lc_edge(&g, BB_EYE_LEFT, 20 * MS);
	assert_true(g.cell[1].closed && !g.cell[1].turned);
	bb_lc_edge(&g, BB_EYE_RIGHT, 30 * MS);
	assert_int_equal(g.cell[1].balance_ns, 10 * MS);
	assert_int_equal(g.cell[0].closed_ns, 30 * MS);
	bb_lc_edge(&g, BB_EYE_LEFT, 37 * MS);
	bb_lc_edge(&g, BB_EYE_RIGHT, 44 * MS);
	assert_int_equal(g.cell[1].balance_ns, 3 * MS);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_ceilings_are_these),
		cmocka_unit_test(a_room_can_only_be_stricter),
		cmocka_unit_test(nothing_else_can_be_said),
		cmocka_unit_test(holdover_ends_a_tenth_of_a_period_off),
		cmocka_unit_test(it_begins_where_it_is_told),
		cmocka_unit_test(opening_is_one_step_and_is_latched),
		cmocka_unit_test(opening_again_does_not_move_the_latch),
		cmocka_unit_test(stereo_and_mono_fade_in_half_a_second),
		cmocka_unit_test(black_fades_and_leaves_the_shutters),
		cmocka_unit_test(closing_keeps_the_light),
		cmocka_unit_test(a_fade_to_closed_can_be_broken_off),
		cmocka_unit_test(a_late_step_moves_no_further),
		cmocka_unit_test(flapping_is_held),
		cmocka_unit_test(cells_that_alternate_are_balanced),
		cmocka_unit_test(a_cell_that_stays_closed_is_told),
		cmocka_unit_test(uneven_closings_add_up),
		cmocka_unit_test(a_pause_lets_the_bias_go),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
