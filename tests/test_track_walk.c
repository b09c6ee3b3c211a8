/*
 * tests/test_track_walk.c: the tracker over a walk: accuracy, honest sigmas, prediction, two bodies, occlusion, cost.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>

#include <cmocka.h>

#include "tests/track_scene.h"

#define FRAME_NS 8333333
#define DEG (180 / PI)

struct sums {
	size_t n, inside_mm, inside_deg;
	double mm2, deg2, sigma_mm2, sigma_deg2, worst_mm, worst_deg;
};

static void add_error(struct sums *s, double mm, double deg, double sigma_mm, double sigma_deg)
{
	s->n++;
	s->mm2 += mm * mm;
	s->deg2 += deg * deg;
	s->sigma_mm2 += sigma_mm * sigma_mm;
	s->sigma_deg2 += sigma_deg * sigma_deg;
	s->inside_mm += mm < 2 * sigma_mm;
	s->inside_deg += deg < 2 * sigma_deg;
	s->worst_mm = fmax(s->worst_mm, mm);
	s->worst_deg = fmax(s->worst_deg, deg);
}

static double rms(double sum, size_t n)
{
	return n ? sqrt(sum / (double)n) : 0;
}

static void add_solution(struct sums *s, const struct scene *sc, size_t body, const struct bb_track_solution *sol)
{
	const struct bb_vec3 truth = scene_centroid(&sc->bodies[body], &sc->pose[body]);

	add_error(s, 1e3 * bb_vec3_norm(bb_vec3_sub(sol->centroid, truth)),
		  DEG * bb_quat_angle(sol->body.q, sc->pose[body].q), sol->position_sigma_mm, sol->angle_sigma_deg);
}

static void print_sums(const char *what, const struct sums *s)
{
	printf("[ note ] %s: n %zu, %.3f mm rms (sigma %.3f, worst %.2f), %.3f deg rms (sigma %.3f, worst %.2f), "
	       "inside 2 sigma %.1f %% and %.1f %%\n",
	       what, s->n, rms(s->mm2, s->n), rms(s->sigma_mm2, s->n), s->worst_mm, rms(s->deg2, s->n),
	       rms(s->sigma_deg2, s->n), s->worst_deg, 100.0 * (double)s->inside_mm / (double)s->n,
	       100.0 * (double)s->inside_deg / (double)s->n);
}

static struct bb_tracker *make(const struct scene *s)
{
	const struct bb_tracker_config config = scene_config(s);
	struct bb_tracker *tr;

	assert_int_equal(bb_tracker_create(&config, &tr), BB_OK);
	return tr;
}

static void walk_has_the_speed_it_claims(void **state)
{
	double v2 = 0, w2 = 0;
	const double dt = 1e-3;

	(void)state;
	for (int i = 0; i < 60000; i++) {
		const struct bb_pose a = scene_walk(i * dt), b = scene_walk((i + 1) * dt);
		v2 += pow(bb_vec3_norm(bb_vec3_sub(b.p, a.p)) / dt, 2);
		w2 += pow(DEG * bb_quat_angle(a.q, b.q) / dt, 2);
	}
	printf("[ note ] walk: %.3f m/s rms, %.1f deg/s rms\n", sqrt(v2 / 60000), sqrt(w2 / 60000));
	assert_true(fabs(sqrt(v2 / 60000) - 0.45) < 0.05);
	assert_true(fabs(sqrt(w2 / 60000) - 45) < 5);
}

/* The accuracy of the room, where 4 or more cameras see at least 3 markers. */
static void walk_accuracy(void **state)
{
	struct scene s;
	struct sums good = { 0 }, poor = { 0 };
	size_t missed = 0, frames = 0, possible = 0;

	(void)state;
	scene_room(&s, 8, 0.05);
	s.occlude = true;
	s.merge_px = 2.5;
	struct bb_tracker *tr = make(&s);
	for (int i = 0; i < 60 * 120; i++) {
		struct bb_track_solution sol;
		s.pose[0] = scene_walk(i * 1e-9 * FRAME_NS);
		const size_t seeing = scene_expose(&s, tr, (int64_t)i * FRAME_NS);
		frames++;
		possible += seeing >= 2;
		if (bb_tracker_solve(tr, true, 0, &sol, 1) != 1) {
			missed += seeing >= 2;
			continue;
		}
		add_solution(seeing >= 4 ? &good : &poor, &s, 0, &sol);
	}
	print_sums("walk, >= 4 cameras", &good);
	if (poor.n)
		print_sums("walk, fewer", &poor);
	printf("[ note ] %zu frames, %zu possible, %zu missed\n", frames, possible, missed);
	assert_true(good.n > frames / 2);
	assert_true(rms(good.mm2, good.n) < 0.25 && rms(good.deg2, good.n) < 0.3);
	assert_true(missed * 200 < possible);
	/* honest: what it says it knows is what it knows */
	assert_true((double)good.inside_mm > 0.95 * (double)good.n && (double)good.inside_deg > 0.95 * (double)good.n);
	assert_true(rms(good.sigma_mm2, good.n) < 1.25 * rms(good.mm2, good.n));
	assert_true(rms(good.sigma_deg2, good.n) < 1.25 * rms(good.deg2, good.n));
	bb_tracker_destroy(tr);
}

/* Predicted against true at several horizons, and what doing nothing would give. */
static void prediction_halves_the_lag(void **state)
{
	static const double horizon_ms[] = { 8, 25, 32, 40 };
	struct sums with[4] = { { 0 } }, without[4] = { { 0 } };
	struct scene s;

	(void)state;
	scene_room(&s, 8, 0.05);
	s.occlude = true;
	struct bb_tracker *tr = make(&s);
	for (int i = 0; i < 40 * 120; i++) {
		struct bb_track_solution sol;
		s.pose[0] = scene_walk(i * 1e-9 * FRAME_NS);
		scene_expose(&s, tr, (int64_t)i * FRAME_NS);
		if (bb_tracker_solve(tr, true, 0, &sol, 1) != 1 || i < 12)
			continue;
		for (int h = 0; h < 4; h++) {
			const int64_t at_ns = (int64_t)i * FRAME_NS + (int64_t)(1e6 * horizon_ms[h]);
			const struct bb_pose truth = scene_walk(1e-9 * (double)at_ns);
			const struct bb_vec3 eyes = bb_pose_apply(&truth, s.bodies[0].eye_centre);
			const struct bb_vec3 still = bb_pose_apply(&sol.body, s.bodies[0].eye_centre);
			const struct bb_track_pose p = bb_tracker_pose(tr, 0, at_ns);
			assert_int_equal(p.flags, BB_TRACK_FRESH);
			add_error(&with[h], 1e3 * bb_vec3_norm(bb_vec3_sub(p.eyes.p, eyes)),
				  DEG * bb_quat_angle(p.eyes.q, truth.q), p.position_sigma_mm, 0);
			add_error(&without[h], 1e3 * bb_vec3_norm(bb_vec3_sub(still, eyes)),
				  DEG * bb_quat_angle(sol.body.q, truth.q), 0, 0);
		}
	}
	for (int h = 0; h < 4; h++) {
		const double mm = rms(with[h].mm2, with[h].n), deg = rms(with[h].deg2, with[h].n);
		const double mm0 = rms(without[h].mm2, with[h].n), deg0 = rms(without[h].deg2, with[h].n);
		printf("[ note ] +%.0f ms: %.2f mm %.2f deg predicted (sigma %.2f mm), %.2f mm %.2f deg not\n",
		       horizon_ms[h], mm, deg, rms(with[h].sigma_mm2, with[h].n), mm0, deg0);
		assert_true(horizon_ms[h] < 25 || (mm < 0.5 * mm0 && deg < 0.5 * deg0));
		assert_true((double)with[h].inside_mm > 0.9 * (double)with[h].n);
	}
	bb_tracker_destroy(tr);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(walk_has_the_speed_it_claims),
		cmocka_unit_test(walk_accuracy),
		cmocka_unit_test(prediction_halves_the_lag),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
