/*
 * tests/test_plan_collide.c: exposures against tokens, walls against each other, edges against the plan: what the
 * arithmetic says and what counting every event of a virtual hour says.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/phase/edges.h"
#include "sim/sim_display.h"
#include "sim/world.h"
#include "tests/sim_rig.h"
#include "sync/plan/collide.h"

static const struct bb_rate edges_120 = { 120, 1 };

static size_t spans_of(const char *protocol, struct bb_light_span spans[BB_TOKENS])
{
	return bb_ir_spans(bb_ir_protocol(protocol), 1e6 / 120, 3000, 1e6 / 120 - 1000, spans);
}

/* Exposures in 2^-20 us from a start, `ppm` fast, each against every token it could meet; integers only. */
struct counted {
	uint64_t exposures, hits;
};

static struct counted count(const struct bb_light_span *spans, size_t n, struct bb_rate rate, double ppm,
                            double exposure_us, double start_us, double seconds)
{
	const double unit = 1048576;
	const int64_t exposure = llround(exposure_us * unit);
	struct counted c = { 0, 0 };

	/* cycle k begins at k * 2e6 / 120 us, exposure k at start + k * step: both from their numbers, never summed */
	for (uint64_t k = 0;; k++) {
		const double ideal = (double)k * 1e6 * rate.den / rate.num;
		const int64_t at = (int64_t)((__int128)k * 1000000 * 1048576 * rate.den / rate.num -
		                             (__int128)llround(ideal * ppm * 1e-6 * unit)) + llround(start_us * unit);
		const int64_t cycle = (int64_t)((__int128)at * 120 / ((__int128)2000000 * 1048576));
		bool hit = false;

		if (ideal > seconds * 1e6)
			return c;
		for (int64_t q = cycle - 1; q <= cycle + 1; q++)
			for (size_t i = 0; i < n; i++) {
				const int64_t from = (int64_t)((__int128)q * 2000000 * 1048576 / 120) +
						     llround(spans[i].from * unit);
				const int64_t to = from + llround((spans[i].to - spans[i].from) * unit);
				hit |= at < to && at + exposure > from;
			}
		c.exposures++;
		c.hits += hit;
	}
}

static double percent(struct counted c)
{
	return 100.0 * (double)c.hits / (double)c.exposures;
}

static void tokens_are_data_that_can_be(void **state)
{
	struct bb_light_span spans[BB_TOKENS];
	size_t known = 0;
	(void)state;

	for (size_t i = 0; bb_ir_protocol_nth(i); i++) {
		const struct bb_ir_protocol *p = bb_ir_protocol_nth(i);

		assert_ptr_equal(bb_ir_protocol(p->name), p);
		if (!bb_ir_known(p)) {
			assert_false(p->verified);
			assert_int_equal(bb_ir_spans(p, 8333, 0, 8000, spans), 0);
			continue;
		}
		known++;
		assert_true(p->paired || bb_ir_least_gap_us(p) > 0);
		const double gap = bb_ir_least_gap_us(p);
		const size_t n = bb_ir_spans(p, 8333, 5000, 8333 - gap, spans);
		assert_int_equal(n, p->paired ? 2 : 4);
		for (size_t k = 0; k + 1 < n; k++) /* with the least gap no two tokens meet */
			assert_true(spans[k + 1].from - spans[k].to >= BB_TOKEN_SPACING_US - 1e-6);
	}
	assert_int_equal(known, 7);
	assert_true(bb_token_us(bb_ir_protocol("3d-vision"), BB_TOKEN_CLOSE_RIGHT) == 141);
	assert_true(bb_ir_least_gap_us(bb_ir_protocol("3d-vision")) == 130);
	assert_null(bb_ir_protocol("3d-vision "));
}

/* 100 Hz running free beside 120 Hz glasses: five phases, so the start phase decides, and nothing else. */
static void a_free_camera_meets_five_phases(void **state)
{
	const struct bb_rate rate = { 100, 1 };
	struct bb_light_span spans[BB_TOKENS];
	const size_t n = spans_of("3d-vision", spans);
	struct bb_collisions c;
	(void)state;

	for (int tried = 0; tried < 4; tried++) {
		const double exposure = 100 + 300 * tried;
		double swept = 0, hit = 0, most = 0;
		const int starts = 400;

		bb_collisions(spans, n, edges_120, rate, exposure, &c);
		assert_int_equal(c.phases, 5);
		assert_true(fabs(c.fold_us - 2e6 / 120 / 5) < 1e-6);
		for (int i = 0; i < starts; i++) {
			const double start = c.fold_us * (i + 0.5) / starts;
			const double arithmetic = bb_collisions_at(spans, n, &c, exposure, start);

			assert_true(fabs(arithmetic - percent(count(spans, n, rate, 0, exposure, start, 0.9999))) < 1e-9);
			assert_true(fabs(arithmetic / 20 - round(arithmetic / 20)) < 1e-9); /* k of five */
			swept += arithmetic / starts;
			hit += arithmetic > 0 ? 100.0 / starts : 0;
			most = fmax(most, arithmetic);
		}
		printf("100 Hz beside 120, %4.0f us: %.1f %% of start phases collide, at worst %.0f %%, mean %.3f %%\n", exposure,
		       c.hit_percent, c.most_percent, c.mean_percent);
		assert_true(fabs(hit - c.hit_percent) < 1 && fabs(swept - c.mean_percent) < 0.2 && most == c.most_percent);
	}
}

/* A crystal 50 ppm off sweeps through all phases: after a virtual hour the mean is the arithmetic's, whatever the start. */
static void drift_sweeps_to_the_mean(void **state)
{
	const struct bb_rate rate = { 100, 1 };
	struct bb_light_span spans[BB_TOKENS];
	const size_t n = spans_of("3d-vision", spans);
	struct bb_collisions c;
	(void)state;

	bb_collisions(spans, n, edges_120, rate, 400, &c);
	for (int tried = 0; tried < 3; tried++) {
		const double start = 1400 * tried;
		const struct counted hour = count(spans, n, rate, 50, 400, start, 3600);

		assert_int_equal(hour.exposures, 360001);
		printf("an hour at +50 ppm from %4.0f us: %.3f %% collide, %.3f %% by arithmetic\n", start, percent(hour),
		       c.mean_percent);
		assert_true(fabs(percent(hour) / c.mean_percent - 1) < 0.01);
	}
}

static struct bb_room *room(const char *file)
{
	struct bb_error err = { 0 };
	struct bb_room *r;

	assert_int_equal(bb_room_load(file, &r, &err), BB_OK);
	return r;
}

/* Locked at 60 Hz with the planned offset: none in a virtual hour; half a margin more and there are. */
static void a_locked_camera_meets_none(void **state)
{
	static struct bb_plan plan;
	struct bb_room *r = room("rooms/cabin120.yaml");
	struct bb_light_span spans[BB_TOKENS];
	struct bb_error err = { 0 };
	(void)state;

	for (size_t i = 0; i < r->n_cameras; i++)
		r->cameras[i].rate = (struct bb_rate){ 100, 1 }; /* the most it can do */
	assert_int_equal(bb_plan_room(r, 2, &plan, &err), BB_OK);
	const struct bb_plan_camera *c = &plan.camera[0];
	assert_int_equal(plan.n_cameras, 1);
	assert_int_equal(c->divider, 2);
	assert_true(c->rate_hz == 60 && c->margin_us > 3000 && c->n == 8);
	const size_t n = bb_ir_spans(plan.tokens, plan.period_us, plan.timing.glasses_at_us, plan.timing.glasses_open_us,
	                             spans);
	const struct bb_rate rate = { 60, 1 };
	assert_int_equal(count(spans, n, rate, 0, c->exposure_us, c->offset_us, 3600).hits, 0);
	assert_int_equal(count(spans, n, rate, 0, c->exposure_us, c->offset_us + 0.95 * c->margin_us, 60).hits, 0);
	assert_int_equal(count(spans, n, rate, 0, c->exposure_us, c->offset_us - 0.95 * c->margin_us, 60).hits, 0);
	assert_true(count(spans, n, rate, 0, c->exposure_us, c->offset_us + 1.05 * c->margin_us, 60).hits > 0);
	bb_room_free(r);
}

/* Every protocol, exposure and rate: where the plan sees room there is none hit, where it sees none all phases are. */
static void margins_mean_what_they_say(void **state)
{
	static const struct bb_rate rates[] = { { 60, 1 }, { 120, 1 }, { 240, 1 }, { 40, 1 } };
	struct sim_rng rng;
	int with = 0, without = 0;
	(void)state;

	sim_rng_seed(&rng, 3, "plan", "margins");
	for (int round = 0; round < 400; round++) {
		const struct bb_ir_protocol *p = bb_ir_protocol_nth((size_t)round % 7);
		const struct bb_rate rate = rates[round % 4];
		const double exposure = 100 + sim_rng_uniform(&rng) * (0.98e6 / bb_rate_hz(rate) - 100);
		struct bb_light_span spans[BB_TOKENS];
		struct bb_collisions c;
		const size_t n = bb_ir_spans(p, 1e6 / 120, sim_rng_uniform(&rng) * 8000,
		                             1e6 / 120 - (p->paired ? 0 : 600 + 2000 * sim_rng_uniform(&rng)), spans);

		bb_collisions(spans, n, edges_120, rate, exposure, &c);
		if (c.margin_us >= 0) {
			with++;
			assert_true(bb_collisions_at(spans, n, &c, exposure, c.free_us) == 0);
			assert_true(bb_collisions_at(spans, n, &c, exposure, c.free_us + 0.99 * c.margin_us) == 0);
		} else { /* shorter by twice what is lacking it fits */
			without++;
			assert_true(fabs(c.hit_percent - 100) < 1e-6);
			bb_collisions(spans, n, edges_120, rate, exposure + 2 * c.margin_us - 1, &c);
			assert_true(c.margin_us >= 0);
		}
	}
	printf("%d with room, %d without\n", with, without);
	assert_true(with > 50 && without > 50);
}

/* --- drift of walls ----------------------------------------------------------------------------------------------- */

static const struct bb_plan_drift *drift_of(const struct bb_room *r)
{
	static struct bb_plan plan;
	struct bb_error err = { 0 };

	assert_int_equal(bb_plan_room(r, 2, &plan, &err), BB_OK);
	if (plan.n_drifts == 0)
		return NULL;
	assert_int_equal(plan.n_drifts, 1);
	printf("%s at %.3f Hz, %s at %.3f Hz: a frame in %.2f s\n", plan.drift[0].a, plan.drift[0].a_hz, plan.drift[0].b,
	       plan.drift[0].b_hz, plan.drift[0].frame_s);
	assert_string_equal(plan.drift[0].a, "front");
	assert_string_equal(plan.drift[0].b, "left");
	return &plan.drift[0];
}

/* How long two simulated displays take until one has shown a whole frame less. */
static double seen_s(struct bb_rate a_rate, struct bb_rate b_rate)
{
	struct rig *rig = rig_create(5, 0);
	struct bb_display_config a = rig->screen.display, b = a;
	struct bb_display *da, *db;
	double s = 0;

	a.rate = a_rate;
	b.rate = b_rate;
	a.rate_error_ppm = b.rate_error_ppm = 0;
	snprintf(b.id, sizeof(b.id), "left");
	assert_int_equal(bb_display_open(&sim_display_driver, &a, &rig->open, &da), BB_OK);
	assert_int_equal(bb_display_open(&sim_display_driver, &b, &rig->open, &db), BB_OK);
	const int64_t lag_ns = sim_display_vblank_ns(db, 100) - sim_display_vblank_ns(da, 100);
	for (int64_t k = 100; k < 10000 && s == 0; k++) {
		const int64_t now_ns = sim_display_vblank_ns(db, k);
		if (now_ns - sim_display_vblank_ns(da, k) - lag_ns >= bb_rate_period_ns(a_rate))
			s = (double)(now_ns - sim_display_vblank_ns(db, 100)) * 1e-9;
	}
	bb_display_close(da);
	bb_display_close(db);
	rig_destroy(rig);
	return s;
}

/* Two walls that both say 120 Hz: their modes do not, and one slips a whole frame behind the other in 13.7 s (13.59 with
 * all digits of the two pixel clocks). */
static void two_kinds_of_120_hz_are_named(void **state)
{
	const struct bb_rate a = bb_rate_from_hz(119.982), b = bb_rate_from_hz(119.909);
	struct bb_room *r = room("rooms/cabin120.yaml");
	struct bb_display_config *front = &r->screens[0].display, *left = &r->screens[1].display;
	(void)state;

	for (size_t i = 0; i < r->n_screens; i++) {
		r->screens[i].display.width_px = 1920;
		r->screens[i].display.height_px = i == 1 ? 1200 : 1080;
	}
	assert_null(drift_of(r)); /* genlock drives them */
	front->genlock = left->genlock = false;
	const struct bb_plan_drift *d = drift_of(r);
	assert_non_null(d);
	assert_true(fabs(d->a_hz - 119.982) < 5e-4 && fabs(d->b_hz - 119.909) < 7e-4);
	assert_true(fabs(d->frame_s - 13.7) < 0.12);
	front->rate = a;
	left->rate = b;
	d = drift_of(r);
	assert_non_null(d);
	assert_true(fabs(d->frame_s - 13.7) < 0.01);
	const double s = seen_s(a, b);
	printf("seen on two simulated displays after %.3f s\n", s);
	assert_true(fabs(s - d->frame_s) < 0.01);
	bb_room_free(r);
}

/* --- measured edges ----------------------------------------------------------------------------------------------- */

static const char file[] = "build/test-plan-edges.csv";

static enum bb_status read_text(const struct bb_room *r, const struct bb_plan *p, const char *text,
                                struct bb_phase_edges *out, struct bb_error *err)
{
	FILE *f = fopen(file, "w");

	assert_non_null(f);
	fputs(text, f);
	fclose(f);
	*err = (struct bb_error){ 0 };
	return bb_phase_edges_read(file, r, p, out, err);
}

static void measured_edges_are_placed_beside_the_plan(void **state)
{
	static struct bb_plan plan;
	static struct bb_phase_edges e;
	struct bb_room *r = room("rooms/cabin120.yaml");
	struct bb_error err = { 0 };
	FILE *f = fopen(file, "w");
	(void)state;

	assert_int_equal(bb_plan_room(r, 2, &plan, &err), BB_OK);
	assert_non_null(f);
	fputs("t_ns,track,eye,event\n", f);
	for (int k = 0; k < 1000; k++) { /* 80 ppm slow, out of order, with gaps; the lens 250 us late, its stamps +-10 */
		const double cycle = 16666666.7 * 1.00008 * k + 5e9;

		if (k % 7 == 3)
			continue;
		fprintf(f, "%.0f,glasses,left,open\n", cycle + plan.timing.glasses_at_us * 1e3 + 250e3 + k % 3 * 10e3 - 10e3);
		fprintf(f, "%.0f,vblank:front,right,flip\n%.0f,vblank:front,left,flip\n", cycle + 8333e3, cycle);
		fprintf(f, "%.0f,strobe:c1,NA,mid\n%.0f,beam,NA,tick\n", cycle + 1e6, cycle + 12345.0 * k);
	}
	fclose(f);
	assert_int_equal(bb_phase_edges_read(file, r, &plan, &e, &err), BB_OK);
	assert_string_equal(e.reference, "vblank:front");
	assert_true(fabs(e.cycle_us - 16666.6667 * 1.00008) < 0.02);
	assert_int_equal(e.n_groups, 5);
	assert_string_equal(e.group[0].track, "glasses");
	assert_true(fabs(bb_phase_off_us(&e, &e.group[0]) - 250) < 0.5);
	assert_true(fabs(e.group[0].most_us - 10) < 0.5 && fabs(e.group[0].least_us + 10) < 0.5);
	assert_true(fabs(e.group[3].mean_us - 1000) < 0.5 && !bb_phase_loose(&e, &e.group[3]));
	assert_true(bb_phase_loose(&e, &e.group[4]));
	bb_room_free(r);
	remove(file);
}

/* Projectors behind shutters tell no eye by their vblanks: the glasses begin the cycle, where the plan has them. */
static void shutters_are_placed_by_the_glasses(void **state)
{
	static struct bb_plan plan;
	static struct bb_phase_edges e;
	struct bb_room *r = room("rooms/cabin.yaml");
	struct bb_error err = { 0 };
	FILE *f = fopen(file, "w");
	(void)state;

	assert_int_equal(bb_plan_room(r, 2, &plan, &err), BB_OK);
	assert_non_null(f);
	fputs("t_ns,track,eye,event\r\n", f);
	for (int k = 0; k < 50; k++) {
		const double lens = 1e9 + 1e9 / 60 * k;
		fprintf(f, "%.0f,glasses,left,open\r\n%.0f,shutter:floor,right,open\r\n%.0f,vblank:floor,NA,flip\r\n", lens,
		        lens + 8333333, lens + 1000);
	}
	fclose(f);
	assert_int_equal(bb_phase_edges_read(file, r, &plan, &e, &err), BB_OK);
	assert_string_equal(e.reference, "glasses");
	assert_true(fabs(e.group[0].mean_us - plan.timing.glasses_at_us) < 0.1);
	const double late_us = plan.timing.glasses_at_us - plan.timing.shutter_at_us;
	assert_true(late_us > 50 && fabs(bb_phase_off_us(&e, &e.group[1]) - late_us) < 0.1);
	assert_true(isnan(e.group[2].planned_us));
	bb_room_free(r);
	remove(file);
}

static void edges_that_cannot_be_are_refused(void **state)
{
	static const struct {
		const char *text;
		int number, line;
	} bad[] = {
		{ "t_ns,track,eye\n1,glasses,left,open\n", 1613, 1 },
		{ "t_ns,track,eye,event\n1,glasses,left\n", 1613, 2 },
		{ "t_ns,track,eye,event\n1,glasses,left,open,more\n", 1613, 2 },
		{ "t_ns,track,eye,event\n\n1,glasses,both,open\n", 1613, 3 },
		{ "t_ns,track,eye,event\nnan,glasses,left,open\n", 1613, 2 },
		{ "t_ns,track,eye,event\n,glasses,left,open\n", 1613, 2 },
		{ "t_ns,track,eye,event\n1e9,glasses,left,open\n", 1613, 2 },
		{ "t_ns,track,eye,event\n9223372036854775807,glasses,left,open\n", 1613, 2 },
		{ "t_ns,track,eye,event\n99999999999999999999,glasses,left,open\n", 1613, 2 },
		{ "t_ns,track,eye,event\n1,gla\x1b[sses,left,open\n", 1613, 2 },
		{ "t_ns,track,eye,event\n1,,left,open\n", 1613, 2 },
		{ "t_ns,track,eye,event\n1,glasses,left,anevent_of_more_than_15_letters\n", 1613, 2 },
		{ "t_ns,track,eye,event\n", 1614, 0 },
		{ "t_ns,track,eye,event\n1,glasses,left,open\n", 1614, 0 },
		{ "t_ns,track,eye,event\n1,glasses,left,open\n1,glasses,left,open\n", 1614, 0 },
		{ "t_ns,track,eye,event\n1,glasses,right,open\n2,glasses,right,open\n", 1614, 0 },
	};
	static struct bb_plan plan;
	static struct bb_phase_edges e;
	struct bb_room *r = room("rooms/cabin120.yaml");
	struct bb_error err = { 0 };
	char where[64];
	(void)state;

	assert_int_equal(bb_plan_room(r, 2, &plan, &err), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		assert_int_equal(read_text(r, &plan, bad[i].text, &e, &err), BB_ERR_CONFIG);
		assert_int_equal(err.number, bad[i].number);
		snprintf(where, sizeof(where), "%s:%d", file, bad[i].line);
		assert_true(!bad[i].line || strstr(err.text, where));
	}
	char *many = malloc(1 << 20), *at = many; /* more tracks than there are groups */
	assert_non_null(many);
	at += sprintf(at, "t_ns,track,eye,event\n");
	for (int i = 0; i < 1000; i++)
		at += sprintf(at, "%d,track%d,NA,x\n", i, i);
	assert_int_equal(read_text(r, &plan, many, &e, &err), BB_ERR_CONFIG);
	snprintf(where, sizeof(where), "%s:%d", file, BB_PHASE_GROUPS + 2);
	assert_non_null(strstr(err.text, where));
	free(many);
	bb_room_free(r);
	remove(file);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(tokens_are_data_that_can_be),
		cmocka_unit_test(a_free_camera_meets_five_phases),
		cmocka_unit_test(drift_sweeps_to_the_mean),
		cmocka_unit_test(a_locked_camera_meets_none),
		cmocka_unit_test(margins_mean_what_they_say),
		cmocka_unit_test(two_kinds_of_120_hz_are_named),
		cmocka_unit_test(measured_edges_are_placed_beside_the_plan),
		cmocka_unit_test(shutters_are_placed_by_the_glasses),
		cmocka_unit_test(edges_that_cannot_be_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
