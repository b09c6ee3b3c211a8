/* tests/test_plan.c: the phase plan against light stepped through time, brute force, and what cannot be. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "tests/plan_brute.h"
#include "sim/world.h"
#include "sync/plan/tokens.h"
#include "sync/plan/wave.h"

static struct bb_plan plan;

static struct bb_room *room(const char *file)
{
	struct bb_error err = { 0 };
	struct bb_room *r;

	assert_int_equal(bb_room_load(file, &r, &err), BB_OK);
	return r;
}

static void solve(const struct bb_room *r, double limit_percent)
{
	struct bb_error err = { 0 };

	assert_int_equal(bb_plan_room(r, limit_percent, &plan, &err), BB_OK);
}

/* --- waves -------------------------------------------------------------------------------------------------------- */

static void a_mean_is_the_integral(void **state)
{
	struct sim_rng rng;
	(void)state;

	sim_rng_seed(&rng, 1, "plan", "waves");
	for (int round = 0; round < 200; round++) {
		struct bb_wave a, b;
		double sum = 0;
		const int n = 40000;

		bb_wave_cell(&a, 100, sim_rng_uniform(&rng) * 300 - 100, sim_rng_uniform(&rng) * 110, sim_rng_uniform(&rng) * 60,
		             round % 5 ? sim_rng_uniform(&rng) * 60 : 0, 0.01, 0.7);
		bb_wave_cell(&b, 100, sim_rng_uniform(&rng) * 100, 50, sim_rng_uniform(&rng) * 20, sim_rng_uniform(&rng) * 20, 0, 1);
		bb_wave_blank(&b, -sim_rng_uniform(&rng) * 10, sim_rng_uniform(&rng) * 10);
		bb_wave_blank(&b, 45, 45 + sim_rng_uniform(&rng) * 10);
		for (int i = 0; i < n; i++)
			sum += bb_wave_at(&a, (i + 0.5) * 100 / n) * bb_wave_at(&b, (i + 0.5) * 100 / n);
		assert_true(fabs(sum / n - bb_wave_mean(&a, &b)) < 5e-5);
	}
}

/* --- strips of displays ------------------------------------------------------------------------------------------- */

static struct bb_display_config some_display(struct sim_rng *rng, int round)
{
	struct bb_display_config d = { .kind = (enum bb_display_kind)(round % 3), .stereo = BB_STEREO_FRAME_SEQUENTIAL,
		                       .rate = { 120, 1 }, .genlock = true };

	d.scan = (enum bb_scan)(round / 3 % 3);
	d.vblank_us = 200 + 4000 * sim_rng_uniform(rng);
	d.pixel_rise_us = round % 4 ? 3000 * sim_rng_uniform(rng) : 0;
	d.pixel_fall_us = round % 4 ? 3000 * sim_rng_uniform(rng) : 10;
	d.dark_us = d.kind == BB_DISPLAY_DLP ? d.vblank_us * sim_rng_uniform(rng) : 0;
	d.strobe_at_us = 8000 * sim_rng_uniform(rng);
	d.strobe_us = 100 + 3000 * sim_rng_uniform(rng);
	return d;
}

/* One strip seen at one timing, by the stepped oracle. */
static struct bb_plan_light stepped(const struct brute_grid *g, size_t b, const struct bb_shutter_config *chain,
                                    const struct bb_plan_timing *t)
{
	const struct bb_cell *c = &chain->glasses;
	double *x = calloc(g->n, sizeof(*x)), own = 0, other = 0;

	brute_follow(g, t->glasses_at_us, t->glasses_open_us, c->open_us, c->close_us, 1, x);
	for (size_t i = 0; i < g->n; i++) {
		const double seen = (1 / c->contrast + (1 - 1 / c->contrast) * x[i]) * c->transmission_percent;

		own += seen * g->own[b][i] / (double)g->n;
		other += seen * g->other[b][i] / (double)g->n;
	}
	free(x);
	return (struct bb_plan_light){ own, 100 * other / own };
}

static void strips_are_as_when_stepped_through_time(void **state)
{
	static const double tops[] = { 0, 0.45, 0.9 };
	struct bb_room *r = room("rooms/cabin120.yaml");
	struct sim_rng rng;
	double worst_light = 0, worst_crosstalk = 0;
	(void)state;

	sim_rng_seed(&rng, 2, "plan", "strips");
	for (int round = 0; round < 18; round++) {
		const struct bb_display_config d = some_display(&rng, round);
		struct bb_shutter_config chain = r->chain;
		struct brute_grid g;

		chain.glasses.open_us = 2000 * sim_rng_uniform(&rng);
		chain.glasses.close_us = round % 2 ? 400 * sim_rng_uniform(&rng) : 0;
		brute_init(&g, 1e6 / 120, BB_PLAN_BANDS);
		brute_display(&g, &d);
		brute_other(&g);
		for (size_t b = 0; b < BB_PLAN_BANDS; b++) {
			const struct bb_plan_timing t = { .glasses_at_us = 16000 * sim_rng_uniform(&rng),
				                          .glasses_open_us = 1000 + 7000 * sim_rng_uniform(&rng) };
			const struct bb_plan_light want = stepped(&g, b, &chain, &t);
			const struct bb_plan_light got = bb_plan_strip(&d, &chain, &t, tops[b], tops[b] + 0.1);

			worst_light = fmax(worst_light, fabs(got.light_percent - want.light_percent));
			/* where leakage is the larger, its inverse is what is exact */
			worst_crosstalk = fmax(worst_crosstalk, fabs(got.crosstalk_percent - want.crosstalk_percent) /
			                                                fmax(1, want.crosstalk_percent));
		}
		brute_free(&g);
	}
	printf("closed form less time steps, 54 strips: light %.4f percentage points, crosstalk %.4f\n", worst_light,
	       worst_crosstalk);
	assert_true(worst_light < 0.01);
	assert_true(worst_crosstalk < 0.05); /* a tenth of a screen in four rows, where lens and pixel jump */
	bb_room_free(r);
}

/* More opening, more light; a lens that does not let go, more crosstalk; a better pixel, less. */
static void what_must_grow_grows(void **state)
{
	struct bb_room *r = room("rooms/lcd120.yaml");
	struct bb_display_config d = r->screens[0].display;
	struct bb_plan_timing t = { .glasses_at_us = 9000 };
	double last_light = 0, last_crosstalk = 0;
	(void)state;

	for (int i = 2; i < 83; i++) {
		t.glasses_open_us = 100 * i;
		const struct bb_plan_light l = bb_plan_strip(&d, &r->chain, &t, 0.9, 1);
		assert_true(l.light_percent > last_light);
		last_light = l.light_percent;
	}
	t.glasses_open_us = 3000;
	for (int i = 0; i < 16; i++) {
		d.pixel_fall_us = 500 * i;
		const struct bb_plan_light l = bb_plan_strip(&d, &r->chain, &t, 0.9, 1);
		assert_true(l.crosstalk_percent > last_crosstalk);
		last_crosstalk = l.crosstalk_percent;
	}
	bb_room_free(r);
}

/* --- the solver --------------------------------------------------------------------------------------------------- */

static void compare(const char *what, const struct brute_grid *g, const struct bb_cell *cell, double most_us,
                    double limit_percent, size_t stride)
{
	const struct brute_best b = brute_search(g, cell, most_us, limit_percent, stride);

	printf("%-28s limit %5.2f %%: solver %.4f %% light, brute force %.4f of %llu tried (%.0f us for %.0f us)\n", what,
	       limit_percent, plan.worst.light_percent, b.light_percent, (unsigned long long)b.tried, b.at_us, b.open_us);
	assert_true(plan.possible && b.light_percent > 0);
	assert_true(plan.worst.crosstalk_percent <= limit_percent + 1e-9);
	assert_true(fabs(plan.worst.light_percent / b.light_percent - 1) < 0.01);
}

static void for_pictures(const char *what, const struct bb_room *r, double limit_percent, size_t stride)
{
	const bool global = r->screens[0].display.scan == BB_SCAN_GLOBAL;
	struct brute_grid g;

	solve(r, limit_percent);
	brute_init(&g, plan.period_us, global ? 1 : BB_PLAN_BANDS);
	brute_display(&g, &r->screens[0].display);
	brute_other(&g);
	compare(what, &g, &r->chain.glasses, plan.period_us - 130, limit_percent, stride); /* 3D Vision's least gap */
	brute_free(&g);
}

static void for_shutters(const struct bb_room *r, double limit_percent, size_t stride)
{
	const struct bb_cell *c = &r->chain.glasses;
	struct brute_grid g;

	solve(r, limit_percent);
	brute_init(&g, plan.period_us, 1);
	brute_follow(&g, plan.timing.glasses_at_us, plan.timing.glasses_open_us, c->open_us, c->close_us, 1, g.own[0]);
	for (size_t i = 0; i < g.n; i++)
		g.own[0][i] = (1 / c->contrast + (1 - 1 / c->contrast) * g.own[0][i]) * c->transmission_percent / 100;
	brute_other(&g);
	compare("cabin: shutters", &g, &r->chain.cell, plan.period_us, limit_percent, stride);
	brute_free(&g);
}

#ifndef BRUTE_STRIDE
#define BRUTE_STRIDE 8 /* us; make bench-plan: 1 */
#endif

static void the_solver_is_as_good_as_brute_force(void **state)
{
	struct bb_room *cabin = room("rooms/cabin.yaml"), *dlp = room("rooms/cabin120.yaml");
	struct bb_room *lcd = room("rooms/lcd120.yaml");
	struct bb_display_config *d = &lcd->screens[0].display;
	(void)state;

	for_shutters(cabin, 2, BRUTE_STRIDE);
	for_shutters(cabin, 0.5, BRUTE_STRIDE);
	for_pictures("cabin120: dlp", dlp, 2, BRUTE_STRIDE);
	for_pictures("cabin120: dlp", dlp, 0.25, BRUTE_STRIDE);
	d->vblank_us = 4200; /* quick frame transport */
	for_pictures("lcd, half the frame blank", lcd, 2, BRUTE_STRIDE);
	d->kind = BB_DISPLAY_STROBED;
	d->strobe_at_us = 2500;
	d->strobe_us = 1500;
	d->scan = BB_SCAN_UP;
	for_pictures("the same, strobed, upwards", lcd, 4, BRUTE_STRIDE);
	bb_room_free(cabin);
	bb_room_free(dlp);
	bb_room_free(lcd);
}

/* Any display and lens: what is called possible holds its limit, what is not is not found on a coarse grid either, and no
 * point of the grid is brighter. */
static void no_room_is_misjudged(void **state)
{
	struct bb_room *r = room("rooms/lcd120.yaml");
	struct sim_rng rng;
	int possible = 0, missed = 0, dimmer = 0;
	(void)state;

	sim_rng_seed(&rng, 4, "plan", "rooms");
	for (int round = 0; round < 36; round++) {
		const double limit = 0.5 + 10 * sim_rng_uniform(&rng);
		struct bb_shutter_config *c = &r->chain;
		double brightest = 0;

		r->screens[0].display = some_display(&rng, round);
		c->glasses.open_us = 2500 * sim_rng_uniform(&rng);
		c->glasses.close_us = 500 * sim_rng_uniform(&rng);
		c->glasses.contrast = 50 + 1000 * sim_rng_uniform(&rng);
		snprintf(c->emitter_protocol, sizeof(c->emitter_protocol), "%s", round % 3 ? "3d-vision" : "sony");
		solve(r, limit);
		for (int k = 0; k < 50 * 24; k++) {
			const double most_us = plan.period_us - bb_ir_least_gap_us(plan.tokens);
			const struct bb_plan_timing t = { .glasses_at_us = 2 * plan.period_us * (k % 50) / 50,
				                          .glasses_open_us = most_us * (k / 50 + 1) / 24 };
			struct bb_plan_light worst = { (double)INFINITY, 0 };

			for (size_t b = 0; b < BB_PLAN_BANDS && worst.crosstalk_percent <= limit; b++) {
				const struct bb_plan_band *band = &plan.wall[0].band[b];
				const struct bb_plan_light l =
					bb_plan_strip(&r->screens[0].display, c, &t, band->top, band->bottom);
				worst.light_percent = fmin(worst.light_percent, l.light_percent);
				worst.crosstalk_percent = fmax(worst.crosstalk_percent, l.crosstalk_percent);
			}
			if (worst.crosstalk_percent <= limit)
				brightest = fmax(brightest, worst.light_percent);
		}
		possible += plan.possible;
		missed += !plan.possible && brightest > 0;
		dimmer += plan.possible && plan.worst.light_percent < brightest * (1 - 1e-6);
		assert_true(plan.possible == (plan.worst.crosstalk_percent <= limit * (1 + 1e-9)));
	}
	printf("36 rooms: %d possible, %d missed, %d dimmer than a point of the grid\n", possible, missed, dimmer);
	assert_true(possible > 6 && possible < 30 && missed == 0 && dimmer == 0);
	bb_room_free(r);
}

static void rooms_that_can(void **state)
{
	static const char *const files[] = { "rooms/cabin.yaml", "rooms/cabin120.yaml" };
	(void)state;

	for (size_t i = 0; i < 2; i++) {
		struct bb_room *r = room(files[i]);

		solve(r, bb_plan_limit(r));
		assert_true(plan.possible);
		assert_int_equal(plan.n_walls, 5);
		assert_true(plan.worst.crosstalk_percent <= 2 && plan.worst.light_percent > 1);
		for (size_t b = 0; b < BB_PLAN_BANDS; b++)
			assert_true(plan.wall[4].band[b].window_to_ns > plan.wall[4].band[b].window_from_ns);
		bb_room_free(r);
	}
}

/* The third room: no timing holds, brute force agrees, and what the plan says it would take does take it there. */
static void a_room_that_cannot_is_refused_with_the_part(void **state)
{
	struct bb_room *r = room("rooms/lcd120.yaml");
	struct brute_grid g;
	(void)state;

	solve(r, 2);
	assert_false(plan.possible);
	assert_int_equal(plan.stops, BB_PLAN_VBLANK);
	brute_init(&g, plan.period_us, BB_PLAN_BANDS);
	brute_display(&g, &r->screens[0].display);
	brute_other(&g);
	const struct brute_best b = brute_search(&g, &r->chain.glasses, plan.period_us - 130, 2, BRUTE_STRIDE);
	brute_free(&g);
	assert_true(b.light_percent == 0);
	printf("lcd120: the least crosstalk is %.2f %%, by brute force %.2f %%\n", plan.worst.crosstalk_percent,
	       b.least_percent);
	assert_true(plan.worst.crosstalk_percent < 1.001 * b.least_percent); /* on a finer grid than the search's */
	assert_true(plan.worst.crosstalk_percent > 0.99 * b.least_percent);
	for (int p = 0; p < BB_PLAN_PARTS; p++) /* a part that is ideal cannot make it worse */
		assert_true(plan.need[p].ideal_percent < 1.001 * plan.worst.crosstalk_percent);

	const double needed = plan.need[BB_PLAN_VBLANK].needed;
	assert_true(needed > plan.need[BB_PLAN_VBLANK].now);
	assert_true(isnan(plan.need[BB_PLAN_CLOSING].needed));
	r->screens[0].display.vblank_us = needed * 1.01;
	solve(r, 2);
	assert_true(plan.possible);
	r->screens[0].display.vblank_us = needed * 0.97;
	solve(r, 2);
	assert_false(plan.possible);
	bb_room_free(r);
}

/* Faster lenses, contrast and refresh each can be the part. */
static void other_parts_are_named_as_well(void **state)
{
	struct bb_room *r = room("rooms/cabin120.yaml");
	(void)state;

	for (size_t i = 0; i < r->n_screens; i++)
		r->screens[i].display.pixel_fall_us = 400;
	solve(r, 0.25);
	assert_false(plan.possible);
	printf("mirrors of 400 us: %d is what stops it, %.3g now, %.3g needed\n", plan.stops, plan.need[plan.stops].now,
	       plan.need[plan.stops].needed);
	for (size_t i = 0; i < r->n_screens; i++)
		r->screens[i].display.pixel_fall_us = 20;
	r->chain.glasses.contrast = 20;
	solve(r, 2);
	assert_false(plan.possible);
	assert_int_equal(plan.stops, BB_PLAN_CONTRAST);
	assert_true(plan.need[BB_PLAN_CONTRAST].needed > 40 && plan.need[BB_PLAN_CONTRAST].needed < 120);
	bb_room_free(r);
}

/* Glasses with one token for both lenses have no gap to choose. */
static void paired_tokens_leave_no_gap(void **state)
{
	struct bb_room *r = room("rooms/cabin120.yaml");
	(void)state;

	snprintf(r->chain.emitter_protocol, sizeof(r->chain.emitter_protocol), "xpand");
	solve(r, 2);
	assert_true(plan.possible);
	assert_true(plan.timing.glasses_open_us == plan.period_us);
	bb_room_free(r);
}

static void a_room_without_stereo_is_an_error(void **state)
{
	struct bb_room *r = room("rooms/desk.yaml");
	struct bb_error err = { 0 };
	(void)state;

	assert_int_equal(bb_plan_room(r, 2, &plan, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1610);
	bb_room_free(r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_mean_is_the_integral),
		cmocka_unit_test(strips_are_as_when_stepped_through_time),
		cmocka_unit_test(what_must_grow_grows),
		cmocka_unit_test(the_solver_is_as_good_as_brute_force),
		cmocka_unit_test(no_room_is_misjudged),
		cmocka_unit_test(rooms_that_can),
		cmocka_unit_test(a_room_that_cannot_is_refused_with_the_part),
		cmocka_unit_test(other_parts_are_named_as_well),
		cmocka_unit_test(paired_tokens_leave_no_gap),
		cmocka_unit_test(a_room_without_stereo_is_an_error),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
