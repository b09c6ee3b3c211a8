/* tests/test_optics.c: simulated light against closed forms, and the analyser against what was true. */
#include "tests/optics_scene.h"

#include "hal/room.h"
#include "sync/plan.h"

#define CASES_PER_SCENE 9
#define SCENES 3

static struct bb_room *load(const char *file)
{
	struct bb_error err = { 0 };
	struct bb_room *room;

	if (bb_room_load(file, &room, &err))
		fail_msg("%s", err.text);
	return room;
}

static struct sim_diode_config clean(void)
{
	struct sim_diode_config c = sim_diode_default();

	c.read_v = c.shot_v = c.hum_v = c.offset_v = 0;
	c.bits = 31;
	return c;
}

static bool pair_of(const struct bb_room *room)
{
	return room->screens[0].display.stereo == BB_STEREO_DUAL_PROJECTOR;
}

/* ---- the light itself ---- */

static struct bb_plan_light integrate(const struct bb_room *room, const struct bb_plan_timing *t, double height)
{
	const struct sim_look look = { .n_heights = 1, .height = { height }, .spread = 0.005, .lanes = 2 };
	const double edge_ns = 1e9 / bb_rate_hz(room->chain.rate);
	const size_t screen = 0;
	struct sim_optics *o;
	double signal = 0, leak = 0;
	const int first = 12, last = 16; /* edges: the steady state is there long before */

	assert_int_equal(sim_optics_create(room, &screen, 1, &look, &o), BB_OK);
	sim_optics_set_open(o, t->glasses_open_us, t->shutter_open_us);
	sim_optics_show(o, 0, BB_PATTERN_WHITE_BLACK);
	sim_optics_show(o, 1, BB_PATTERN_BLACK_WHITE);
	sim_optics_step(o, 0);
	for (int n = 0; n < last; n++) {
		const enum bb_eye eye = n % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT;
		const struct bb_shutter_edge lens = { llround(n * edge_ns + t->glasses_at_us * 1e3), (uint32_t)n, (uint8_t)eye,
			                              BB_STAGE_EMITTER };
		const struct bb_shutter_edge stage = { llround(n * edge_ns + t->shutter_at_us * 1e3), (uint32_t)n,
			                               (uint8_t)eye, 0 };
		sim_optics_edge(o, &lens);
		sim_optics_edge(o, &stage);
		if (!pair_of(room) || n % 2 == 0)
			sim_optics_frame(o, 0, llround(n * edge_ns), pair_of(room) ? BB_EYE_NONE : eye);
		for (int64_t at = llround(n * edge_ns); at < llround((n + 1) * edge_ns);) {
			const int64_t to = at + 2000 < llround((n + 1) * edge_ns) ? at + 2000 : llround((n + 1) * edge_ns);
			sim_optics_step(o, to);
			if (n >= first) {
				const double through = sim_optics_lens(o, BB_EYE_LEFT) * (double)(to - at);
				signal += sim_optics_bare(o, 0, 0, 0) * through;
				leak += sim_optics_bare(o, 0, 0, 1) * through;
			}
			at = to;
		}
	}
	sim_optics_destroy(o);
	const double span = (last - first) * edge_ns;
	return (struct bb_plan_light){ 100 * signal / span, 100 * leak / signal };
}

/* Black shines through as well: C with black removed and C without differ by about 0.1 points and 0.1 % of the signal. */
static void agrees_with_the_closed_form(void **state)
{
	static const char *const rooms[] = { "rooms/cabin.yaml", "rooms/cabin120.yaml", "rooms/lcd120.yaml" };
	(void)state;

	for (size_t r = 0; r < BB_ARRAY_LEN(rooms); r++) {
		struct bb_room *room = load(rooms[r]);
		struct sim_rng rng;
		sim_rng_seed(&rng, 5, "timing", rooms[r]);
		for (int i = 0; i < 8; i++) {
			const double period_us = 1e6 / bb_rate_hz(room->chain.rate);
			const struct bb_plan_timing t = { sim_rng_uniform(&rng) * 3000,
				                          period_us * (0.5 + 0.45 * sim_rng_uniform(&rng)),
				                          sim_rng_uniform(&rng) * 3000,
				                          period_us * (0.5 + 0.45 * sim_rng_uniform(&rng)) };
			const double height = i % 3 / 2.0, top = height * 0.995;
			const struct bb_plan_light want = bb_plan_strip(&room->screens[0].display, &room->chain, &t, top, top + 0.005);
			const struct bb_plan_light got = integrate(room, &t, height);
			/* Without black: leak / signal = (c + b) / (1 + b), b = 0.001 (1 + c) of the signal. */
			const double c = want.crosstalk_percent / 100, b = 1e-3 * (1 + c) / (1 - 1e-3);
			const double expected = 100 * (c + b) / (1 + b);
			if (!(fabs(got.crosstalk_percent - expected) < 0.02 + 0.002 * expected) ||
			    !(fabs(got.light_percent - want.light_percent * (1 + b) * (1 - 1e-3)) < 0.003 * want.light_percent))
				fail_msg("%s timing %d: light %.4f %% crosstalk %.4f %%, closed form %.4f and %.4f", rooms[r], i,
				         got.light_percent, got.crosstalk_percent, want.light_percent, expected);
		}
		bb_room_free(room);
	}
}

/* ---- recovery ---- */

struct score {
	size_t n, inside;
	double squares, worst;
};

static void score(struct score *s, double error, double sigma)
{
	s->n++;
	s->inside += fabs(error) <= 1.96 * sigma;
	s->squares += error * error / (sigma * sigma);
	s->worst = fmax(s->worst, fabs(error));
}

/* Crosstalk of the clean light by plain means over whole cycles. */
static double true_crosstalk(const struct optics_scene *s, size_t channel, int eye)
{
	const int64_t cycle_ns = 2 * bb_rate_period_ns(s->room->chain.rate);
	double mean[BB_PATTERN_COUNT] = { 0 };

	for (int p = 0; p < BB_PATTERN_COUNT; p++) {
		const struct bb_showing *show = &s->recording.show[p];
		double sum = 0, n = 0;
		for (size_t i = 0; i < s->n_rows; i++)
			if (s->at_ns[i] >= show->from_ns + 3 * cycle_ns && s->at_ns[i] < show->from_ns + 12 * cycle_ns) {
				sum += s->volts[i * s->recording.n_channels + channel];
				n++;
			}
		mean[p] = sum / n;
	}
	const double black = mean[BB_PATTERN_BLACK_BLACK];
	const double own = mean[eye ? BB_PATTERN_BLACK_WHITE : BB_PATTERN_WHITE_BLACK] - black;
	const double other = mean[eye ? BB_PATTERN_WHITE_BLACK : BB_PATTERN_BLACK_WHITE] - black;
	return 100 * other / own;
}

static struct optics_scene *with_noise(const struct optics_scene *from, double noise, uint64_t seed)
{
	struct optics_scene *s = calloc(1, sizeof(*s));
	const size_t n = from->n_rows * from->recording.n_channels;
	struct sim_diode_config c = sim_diode_default();
	struct sim_rng rng;

	assert_non_null(s);
	*s = *from;
	s->at_ns = malloc(from->n_rows * sizeof(*s->at_ns));
	s->volts = malloc(n * sizeof(*s->volts));
	assert_non_null(s->at_ns);
	assert_non_null(s->volts);
	memcpy(s->at_ns, from->at_ns, from->n_rows * sizeof(*s->at_ns));
	sim_rng_seed(&rng, seed, "noise", "case");
	c.read_v *= noise;
	c.shot_v *= noise;
	c.hum_v *= noise;
	for (size_t i = 0; i < n; i++) {
		const size_t row = i / from->recording.n_channels;
		s->volts[i] = sim_diode_volts(&c, &rng, from->volts[i] / c.full_v, (double)from->at_ns[row] * 1e-9);
	}
	return s;
}

static const char *const looked_at[] = { "front.middle.bare", "front.middle.left", "front.middle.right",
	                                 "left.middle.bare",  "lamp.left",         "lamp.right", NULL };

static void judge_case(const struct optics_scene *clean_one, struct optics_scene *s, struct score *us, struct score *points)
{
	const struct bb_optics *o = &s->result;
	const struct optics_truth *t = &s->truth;
	const double edge = scene_edge_ns(s), vblank = bb_display_vblank_us(&s->room->screens[0].display) * 1e3;
	const struct bb_optics_band *b = &o->wall[0].band[BB_SPOT_MIDDLE];

	assert_int_equal(o->n_walls, 2);
	assert_string_equal(o->wall[0].id, "front");
	assert_int_equal(o->wall[0].order, BB_ORDER_RIGHT);
	assert_true(fabs(o->cycle_ns.value - 2 * edge) < 5e-6 * edge);
	for (int eye = 0; eye < 2; eye++) {
		const double lens = scene_phase_ns(s, eye * edge + t->lens_ns, 2 * edge);
		const double lit = pair_of(s->room) ? t->stage_ns[0] : t->vblank_ns[0] + vblank;
		assert_true(o->has_lens[eye] && b->white[eye].found);
		score(us, remainder(o->lens[eye].rise_ns.value - lens, 2 * edge) * 1e-3, o->lens[eye].rise_ns.sigma * 1e-3);
		score(us, remainder(b->phase_ns[eye].value - (lit - t->lens_ns), 2 * edge) * 1e-3, b->phase_ns[eye].sigma * 1e-3);
		score(points, b->crosstalk[eye].value - true_crosstalk(clean_one, 1 + (size_t)eye, eye), b->crosstalk[eye].sigma);
	}
	const double skew = pair_of(s->room) ? t->stage_ns[1] - t->stage_ns[0] : t->vblank_ns[1] - t->vblank_ns[0];
	score(us, (o->wall[1].skew_ns.value - skew) * 1e-3, o->wall[1].skew_ns.sigma * 1e-3);
}

static void recover(const char *file, struct score *us, struct score *points)
{
	static const double noise[3] = { 0.5, 1, 1.5 };
	struct bb_room *room = load(file);

	for (uint64_t scene = 0; scene < SCENES; scene++) {
		struct sim_rng rng;
		sim_rng_seed(&rng, scene, "scene", file);
		struct optics_truth t = { .rate_ppm = 400 * sim_rng_uniform(&rng) - 200, .jitter_ns = 500, .seed = scene,
			                  .diode = clean() };
		t.lens_ns = (pair_of(room) ? 2000 : 100 + 200 * (double)scene) * 1e3 + 5e4 * sim_rng_uniform(&rng);
		for (int i = 0; i < SCENE_SCREENS; i++) {
			t.stage_ns[i] = t.lens_ns - 2e5 * sim_rng_uniform(&rng);
			t.vblank_ns[i] = 5e4 * sim_rng_uniform(&rng);
		}
		struct optics_scene *s = scene_record(room, &t, looked_at);
		for (uint64_t i = 0; i < CASES_PER_SCENE; i++) {
			struct optics_scene *noisy = with_noise(s, noise[i % 3], 100 * scene + i);
			scene_analyse(noisy);
			judge_case(s, noisy, us, points);
			scene_free(noisy);
		}
		scene_free(s);
	}
	bb_room_free(room);
}

/* 54 cases: two rooms, three scenes of each, three noises, three draws. */
static void recovers_phase_and_crosstalk(void **state)
{
	struct score us = { 0 }, points = { 0 };
	(void)state;

	recover("rooms/cabin.yaml", &us, &points);
	recover("rooms/cabin120.yaml", &us, &points);
	print_message("phase: %zu values, worst %.2f us, %.1f %% within 1.96 sigma, rms %.2f sigma\n", us.n, us.worst,
	              100.0 * (double)us.inside / (double)us.n, sqrt(us.squares / (double)us.n));
	print_message("crosstalk: %zu values, worst %.4f points, %.1f %% within 1.96 sigma, rms %.2f sigma\n", points.n,
	              points.worst, 100.0 * (double)points.inside / (double)points.n, sqrt(points.squares / (double)points.n));
	assert_int_equal(us.n, 2 * SCENES * CASES_PER_SCENE * 5);
	assert_true(us.worst <= 10 && points.worst <= 0.2);
	/* Honest: neither too small nor many times too large. */
	assert_true((double)us.inside >= 0.9 * (double)us.n && (double)points.inside >= 0.9 * (double)points.n);
	assert_true(us.squares >= 0.1 * (double)us.n && points.squares >= 0.1 * (double)points.n);
}

/* ---- single traits ---- */

static struct optics_truth plain(const struct bb_room *room)
{
	return (struct optics_truth){ .rate_ppm = 12, .jitter_ns = 500, .lens_ns = pair_of(room) ? 3e6 : 2e5,
		                      .stage_ns = { 2.9e6, 2.9e6 }, .diode = sim_diode_default(), .seed = 3 };
}

static void sees_swapped_eyes(void **state)
{
	static const char *const names[] = { "front.middle.bare", "front.middle.left", "front.middle.right",
		                             "front.tag.bare",    "lamp.left",         "lamp.right", NULL };
	struct bb_room *room = load("rooms/cabin120.yaml");
	struct optics_truth t = plain(room);
	(void)state;

	for (int swapped = 0; swapped < 2; swapped++) {
		t.swapped = swapped;
		struct optics_scene *s = scene_record(room, &t, names);
		scene_analyse(s);
		assert_int_equal(s->result.wall[0].order, swapped ? BB_ORDER_SWAPPED : BB_ORDER_RIGHT);
		assert_true(s->result.wall[0].tag.seen);
		assert_true(s->result.wall[0].tag.cycles > 80);
		assert_int_equal(s->result.wall[0].tag.gaps, 0);
		assert_int_equal(s->result.wall[0].tag.odd, 0);
		assert_int_equal(s->result.wall[0].tag.order, BB_ORDER_RIGHT); /* pictures and tag are the display's own */
		scene_free(s);
	}
	bb_room_free(room);
}

/* A lens that darkens where the other eye's picture is white: some LCDs do that, and it is not zero. */
static void does_not_clamp_negative_crosstalk(void **state)
{
	struct bb_room *room = load("rooms/cabin120.yaml");
	struct optics_truth t = plain(room);
	struct optics_scene *s = scene_record(room, &t, looked_at);
	(void)state;

	for (size_t i = 0; i < s->n_rows; i++)
		for (size_t k = 0; k < s->recording.n_shows; k++)
			if (s->recording.show[k].pattern == BB_PATTERN_BLACK_WHITE && s->at_ns[i] >= s->recording.show[k].from_ns &&
			    s->at_ns[i] < s->recording.show[k].to_ns)
				s->volts[i * s->recording.n_channels + 1] -= 0.01;
	scene_analyse(s);
	const struct bb_estimate c = s->result.wall[0].band[BB_SPOT_MIDDLE].crosstalk[0];
	assert_true(c.value < -2 && c.value > -6 && c.sigma < 0.2);
	scene_free(s);
	bb_room_free(room);
}

static void follows_scan_out(void **state)
{
	static const char *const names[] = { "front.top.bare", "front.middle.bare", "front.bottom.bare", "lamp.left", NULL };
	struct bb_room *room = load("rooms/lcd120.yaml");
	struct optics_truth t = plain(room);
	(void)state;

	/* One wall in this room: the scene's second one is the first again. */
	struct bb_screen *screens = calloc(2, sizeof(*screens));
	struct bb_wall *walls = calloc(2, sizeof(*walls));
	assert_true(screens && walls);
	screens[0] = screens[1] = room->screens[0];
	walls[0] = walls[1] = room->walls[0];
	walls[1].id[0] = '-';
	struct bb_room two = *room;
	two.screens = screens;
	two.walls = walls;
	two.n_screens = two.n_walls = 2;
	for (int up = 0; up < 2; up++) {
		screens[0].display.scan = up ? BB_SCAN_UP : BB_SCAN_DOWN;
		struct optics_scene *s = scene_record(&two, &t, names);
		scene_analyse(s);
		const double active_us = (1e6 / 120 - 461) * 0.995;
		const struct bb_estimate scan = s->result.wall[0].scan_ns;
		if (!(fabs(scan.value * 1e-3 - (up ? -active_us : active_us)) < 10))
			fail_msg("scan-out %.1f +- %.1f us, want %.1f", scan.value * 1e-3, scan.sigma * 1e-3, active_us);
		assert_true(fabs(s->result.wall[0].band[1].white[0].rise_tau_ns.value * 2.1972245773362196e-3 - 2000) < 40);
		scene_free(s);
	}
	free(screens);
	free(walls);
	bb_room_free(room);
}

/* 119.982 and 119.909 Hz: 608 ppm apart. */
static void tells_two_rates_apart(void **state)
{
	static const char *const names[] = { "front.middle.bare", "left.middle.bare", NULL };
	struct bb_room *room = load("rooms/cabin120.yaml");
	struct optics_truth t = plain(room);
	(void)state;

	t.vblank_ppm[0] = (119.982 / 120 - 1) * 1e6;
	t.vblank_ppm[1] = (119.909 / 120 - 1) * 1e6;
	t.rate_ppm = 0;
	struct optics_scene *s = scene_record(room, &t, names);
	scene_analyse(s);
	for (int i = 0; i < 2; i++) {
		const double hz = 2e9 / s->result.wall[i].cycle_ns.value, want = i ? 119.909 : 119.982;
		if (!(fabs(hz - want) < 0.001))
			fail_msg("wall %d: %.5f Hz, want %.3f", i, hz, want);
	}
	scene_free(s);
	bb_room_free(room);
}

static void knows_what_it_does_not_know(void **state)
{
	struct bb_room *room = load("rooms/cabin120.yaml");
	struct optics_truth t = plain(room);
	(void)state;

	t.diode.read_v *= 60;
	t.diode.range_v = 4;
	t.diode.offset_v = 1;
	struct optics_scene *s = scene_record(room, &t, looked_at);
	scene_analyse(s);
	const struct bb_estimate c = s->result.wall[0].band[BB_SPOT_MIDDLE].crosstalk[0];
	assert_true(c.sigma > 0.15);
	assert_int_equal(bb_optics_judge(c, c.value + c.sigma), BB_UNDECIDED);
	assert_int_equal(bb_optics_judge(c, c.value + 3 * c.sigma), BB_HOLDS);
	assert_int_equal(bb_optics_judge(c, c.value - 3 * c.sigma), BB_MISSES);
	assert_int_equal(bb_optics_judge((struct bb_estimate){ (double)NAN, (double)NAN }, 2), BB_UNDECIDED);
	scene_free(s);
	bb_room_free(room);
}

/* A thousand pictures a second, 8 bits, half of the time exposed: slower to know the same. */
static void measures_with_a_camera(void **state)
{
	struct bb_room *room = load("rooms/cabin120.yaml");
	struct optics_truth t = plain(room);
	(void)state;

	t.vblank_ns[0] = 30000;
	struct optics_scene *s = scene_film(room, &t), *diode = scene_record(room, &t, looked_at);
	scene_analyse(s);
	scene_analyse(diode);
	const struct bb_optics_wall *w = &s->result.wall[0];
	assert_int_equal(w->order, BB_ORDER_RIGHT);
	for (int b = 0; b < BB_BANDS; b++)
		for (int eye = 0; eye < 2; eye++) {
			const struct bb_estimate rise = w->band[b].white[eye].rise_ns, c = w->band[b].crosstalk[eye];
			const struct bb_estimate judge = diode->result.wall[0].band[BB_SPOT_MIDDLE].crosstalk[eye];
			const double vblank = bb_display_vblank_us(&room->screens[0].display) * 1e3, edge = scene_edge_ns(s);
			const double want = scene_phase_ns(s, eye * edge + t.vblank_ns[0] + vblank, 2 * edge);
			const double off = remainder(rise.value - want, 2 * edge);
			if (!w->band[b].white[eye].found || !(fabs(off) < 100e3) || !(fabs(off) < 4 * rise.sigma) ||
			    !(fabs(c.value - judge.value) < 0.2))
				fail_msg("band %d eye %d: rise off by %.0f +- %.0f ns, crosstalk %.3f, photodiode %.3f", b, eye, off,
				         rise.sigma, c.value, judge.value);
		}
	scene_free(s);
	scene_free(diode);
	bb_room_free(room);
}

/* Noise alone has no period; a constant has neither. */
static void finds_nothing_in_nothing(void **state)
{
	struct bb_recording r = { .rate = { 120, 1 }, .n_shows = 1, .n_channels = 1,
		                  .show = { { BB_PATTERN_WHITE_BLACK, 0, 400000000 } } };
	struct bb_analyser *a;
	struct sim_rng rng;
	(void)state;

	assert_true(bb_channel_find("front.top.bare", &r.channel[0]));
	for (int noisy = 0; noisy < 2; noisy++) {
		sim_rng_seed(&rng, 1, "nothing", "x");
		assert_int_equal(bb_analyser_create(&r, &a), BB_OK);
		for (int64_t i = 0; i < 20000; i++) {
			const double v = noisy ? sim_rng_normal(&rng) : 1;
			bb_analyser_scan(a, i * 20000, &v);
		}
		const bool found = bb_analyser_turn(a);
		if (found) {
			struct bb_optics o;
			for (int64_t i = 0; i < 20000; i++) {
				const double v = noisy ? sim_rng_normal(&rng) : 1;
				bb_analyser_fold(a, i * 20000, &v);
			}
			bb_analyser_finish(a, &o);
			assert_false(o.wall[0].band[0].white[0].found);
		}
		bb_analyser_destroy(a);
	}
	r.n_shows = 0;
	assert_int_equal(bb_analyser_create(&r, &a), BB_ERR_CONFIG);
}

static void tags_count(void **state)
{
	unsigned bits = 0;
	bool seen[BB_TAG_CYCLES] = { false };
	(void)state;

	for (uint64_t i = 0; i < BB_TAG_CYCLES + BB_TAG_BITS; i++) {
		bits = (bits << 1 | (bb_tag_light(i, BB_EYE_RIGHT) > 0.25)) & 31;
		assert_true(bb_tag_light(i, BB_EYE_LEFT) > 0.9);
		if (i < BB_TAG_BITS - 1)
			continue;
		const int place = bb_tag_place(bits);
		assert_int_equal(place, (int)((i - (BB_TAG_BITS - 1)) % BB_TAG_CYCLES));
		seen[place] = true;
	}
	for (int i = 0; i < BB_TAG_CYCLES; i++)
		assert_true(seen[i]);
	assert_int_equal(bb_tag_place(0), -1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(agrees_with_the_closed_form),       cmocka_unit_test(recovers_phase_and_crosstalk),
		cmocka_unit_test(sees_swapped_eyes),                 cmocka_unit_test(does_not_clamp_negative_crosstalk),
		cmocka_unit_test(follows_scan_out),                  cmocka_unit_test(tells_two_rates_apart),
		cmocka_unit_test(knows_what_it_does_not_know),       cmocka_unit_test(finds_nothing_in_nothing),
		cmocka_unit_test(tags_count),                        cmocka_unit_test(measures_with_a_camera),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
