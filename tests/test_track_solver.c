/*
 * tests/test_track_solver.c: what the tracker promises over the room's own cameras and walk: accuracy, labels, honest sigmas,
 * prediction; six bodies that cross, swapped labels, floods; and that a set's work has a ceiling.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>

#include <cmocka.h>

#include "bench/solver/cost.h"
#include "bench/solver/prediction.h"
#include "bench/solver/walk.h"
#include "sync/track/filter.h"
#include "tests/track_scene.h"

#define DEG (180 / PI)
#define FRAME_NS 8333333

/* The interval of a share: what is known of series whose memory is known. */
static void shares_count_independent_frames(void **state)
{
	enum { N = 20000 };
	static bool inside[N];
	struct scene_rng r = { .s = 31 };

	(void)state;
	for (int i = 0; i < N; i++)
		inside[i] = scene_uniform(&r, 0, 1) < 0.95;
	struct bb_walk_share s = bb_walk_share_of(inside, N);
	assert_true(fabs(s.share - 0.95) < 0.006 && s.n_eff > 0.85 * N && s.n_eff < 1.15 * N);
	assert_true(fabs((s.high - s.low) / 2 - 1.96 * sqrt(0.95 * 0.05 / N)) < 4e-4);
	for (int i = 0; i < N; i++) /* each value ten times in a row: a tenth of it counts */
		inside[i] = i % 10 ? inside[i - 1] : scene_uniform(&r, 0, 1) < 0.95;
	s = bb_walk_share_of(inside, N);
	printf("[ note ] ten of a kind: %.0f of %d independent\n", s.n_eff, N);
	assert_true(s.n_eff > 0.07 * N && s.n_eff < 0.14 * N);
	memset(inside, 1, sizeof(inside));
	s = bb_walk_share_of(inside, N);
	assert_true(s.share == 1 && s.low == 1 && s.high == 1);
}

/* Lenses covered ten seconds in: found again at once. `bench track --walk --frames 100000` is the long form. */
static void the_walk_holds(void **state)
{
	const struct bb_walk_config config = { "rooms/cabin.yaml", "scenes/walk.path", 1, 5000, 7, 0.3 };
	struct bb_error err = { 0 };
	struct bb_walk w;

	(void)state;
	assert_int_equal(bb_walk_measure(&config, &w, &err), BB_OK);
	bb_walk_print(&w, stdout);
	assert_int_equal(w.n_frames, 5000);
	assert_true(w.n_possible > 4700 && w.n_solved == w.n_possible && w.n_good > 4700);
	assert_true(w.n_labels > 20 * w.n_good);
	assert_int_equal(w.n_wrong_labels, 0);
	assert_int_equal(w.n_wrong_poses, 0);
	assert_true(w.n_losses >= 3 && w.most_frames_back >= 1 && w.most_frames_back <= 3);
	assert_true(w.rms_mm < 0.3 && w.rms_deg < 0.2);
	assert_true(w.position.share > 0.93 && w.position.share < 0.97);
	assert_true(w.angle.share > 0.93 && w.angle.share < 0.97);
}

static void walks_that_cannot_be_are_refused(void **state)
{
	struct bb_walk_config config = { "rooms/nowhere.yaml", "scenes/walk.path", 1, 100, 7, 0 };
	struct bb_cost_config cost = { "rooms/deck.yaml", 73, 6, 0, 10, 1, 7 };
	struct bb_error err = { 0 };
	struct bb_cost c;
	struct bb_walk w;

	(void)state;
	assert_int_not_equal(bb_walk_measure(&config, &w, &err), BB_OK);
	assert_int_equal(err.number, 1001);
	config.room = "rooms/cabin.yaml";
	config.path = "scenes/nowhere.path";
	err = (struct bb_error){ 0 };
	assert_int_not_equal(bb_walk_measure(&config, &w, &err), BB_OK);
	assert_int_equal(err.number, 1001);
	err = (struct bb_error){ 0 };
	assert_int_equal(bb_cost_measure(&cost, &c, &err), BB_ERR_USAGE);
	assert_int_equal(err.number, 1721);
}

static void prediction_buys_what_it_says(void **state)
{
	const struct bb_prediction_config config = { "rooms/cabin.yaml", "scenes/walk.path", 7, 7300 };
	struct bb_error err = { 0 };
	struct bb_prediction p;

	(void)state;
	assert_int_equal(bb_prediction_measure(&config, &p, &err), BB_OK);
	const struct bb_prediction_point *path = bb_prediction_at(&p, 40);
	printf("[ note ] +40 ms: %.2f mm (stated %.2f, still %.2f), %.2f deg (stated %.2f, still %.2f), %.1f and %.1f %%\n",
	       path->rms_mm[0], path->stated_mm, path->rms_mm[1], path->rms_deg[0], path->stated_deg, path->rms_deg[1],
	       100 * path->inside_mm.share, 100 * path->inside_deg.share);
	assert_true(p.n > 7000 && path->horizon_ms == 40);
	assert_true(3 * path->rms_mm[0] < path->rms_mm[1] && 3 * path->rms_deg[0] < path->rms_deg[1]);
	for (int h = 0; h < BB_PREDICTION_HORIZONS; h++) {
		const struct bb_prediction_point *q = &p.point[h];
		assert_true(q->rms_mm[0] < q->rms_mm[1] && q->rms_deg[0] < q->rms_deg[1]);
		assert_true(q->p99_mm[0] > q->rms_mm[0] && q->p99_deg[0] > q->rms_deg[0]);
		/* it never claims to know better than it does, nor 1.4 times worse */
		assert_true(q->stated_mm > 0.95 * q->rms_mm[0] && q->stated_mm < 1.4 * q->rms_mm[0]);
		assert_true(q->stated_deg > 0.95 * q->rms_deg[0] && q->stated_deg < 1.4 * q->rms_deg[0]);
		assert_true(q->inside_mm.share > 0.94 && q->inside_deg.share > 0.94);
	}
}

/* The filter alone, on poses with known noise: innovations in their own covariance have 6 on average, walking, standing
 * and after one begins to walk; and what is not measured does not spin on. */
static void innovations_are_as_large_as_stated(void **state)
{
	static const struct gait {
		const char *what;
		double speed;
	} gaits[] = { { "walking", 1 }, { "slowly", 0.3 }, { "standing", 0 } };
	const double mm = 1e-4, rad = 2e-3;
	double noise[6][6] = { { 0 } };

	(void)state;
	for (int i = 0; i < 6; i++)
		noise[i][i] = i < 3 ? rad * rad : mm * mm;
	for (size_t g = 0; g < BB_ARRAY_LEN(gaits); g++) {
		struct scene_rng r = { .s = 33 };
		struct bb_filter f;
		double sum = 0, sum_mm2 = 0;
		const int n = 6000;
		for (int i = 0; i < n; i++) {
			const struct bb_pose truth = scene_walk(gaits[g].speed * i * 1e-9 * FRAME_NS);
			const struct bb_vec3 p = bb_vec3_add(
				truth.p, (struct bb_vec3){ mm * scene_normal(&r), mm * scene_normal(&r), mm * scene_normal(&r) });
			const struct bb_vec3 turn = { rad * scene_normal(&r), rad * scene_normal(&r), rad * scene_normal(&r) };
			const struct bb_quat q = bb_quat_mul(bb_quat_axis_angle(turn, bb_vec3_norm(turn)), truth.q);
			if (!i)
				bb_filter_start(&f, 0, p, q, (const double(*)[6])noise);
			else
				bb_filter_update(&f, (int64_t)i * FRAME_NS, p, q, (const double(*)[6])noise, (struct bb_vec3){ 0 });
			if (i >= 600) {
				sum += f.innovation2;
				sum_mm2 += pow(1e3 * bb_vec3_norm(bb_vec3_sub(f.p, truth.p)), 2);
			}
		}
		printf("[ note ] %s: innovations %.2f of 6, filtered to %.3f mm (measured to %.3f)\n", gaits[g].what,
		       sum / (n - 600), sqrt(sum_mm2 / (n - 600)), 1e3 * mm * sqrt(3));
		assert_true(sum / (n - 600) > 0.5 * 6 && sum / (n - 600) < 1.1 * 6);
		assert_true(sqrt(sum_mm2 / (n - 600)) < 1e3 * mm * sqrt(3));
	}
}

/* ---- many bodies ---- */

enum { BODIES = 6, CAMERAS = 12 };

struct crowd {
	struct scene s; /* cameras and generator */
	struct bb_body bodies[BODIES];
	struct bb_pose pose[BODIES];
	struct bb_blob blobs[CAMERAS][BODIES * 6];
	uint8_t of[CAMERAS][BODIES * 6]; /* body * 8 + marker */
	size_t n[CAMERAS];
};

/* Pairs walk through each other's place, 12 cm apart at the nearest. */
static struct bb_pose crowd_walk(size_t body, double t)
{
	const size_t pair = body / 2;
	const double a = 2 * PI * (0.1 * t + (double)pair / 3), side = body % 2 ? 1 : -1;
	const double apart = 0.06 + 0.25 * pow(sin(2 * PI * 0.15 * t), 2);

	return (struct bb_pose){ { 0.55 * cos(a) + side * apart * sin(a), 1.2 + 0.2 * (double)pair, 0.55 * sin(a) },
				 bb_quat_euler_deg(DEG * a * side, 20 * sin(t + (double)body), 10 * cos(2 * t)) };
}

static void crowd_expose(struct crowd *c, struct bb_tracker *tr, double t, int64_t at_ns)
{
	for (size_t b = 0; b < BODIES; b++)
		c->pose[b] = crowd_walk(b, t);
	for (size_t i = 0; i < CAMERAS; i++) {
		struct bb_blob *blobs = c->blobs[i];
		size_t n = 0;
		for (size_t b = 0; b < BODIES; b++)
			for (size_t m = 0; m < c->bodies[b].n_markers; m++) {
				double px[2];
				if (scene_u64(&c->s.rng) % 4 == 0 || /* something is before a quarter of them, always others */
				    !scene_pixel(&c->s.cameras[i], bb_pose_apply(&c->pose[b], c->bodies[b].marker[m]), px))
					continue;
				blobs[n] = (struct bb_blob){ (float)(px[0] + 0.05 * scene_normal(&c->s.rng)),
							     (float)(px[1] + 0.05 * scene_normal(&c->s.rng)), 6 };
				c->of[i][n++] = (uint8_t)(b * 8 + m);
			}
		c->n[i] = n;
		bb_tracker_frame(tr, i, at_ns, blobs, n);
	}
}

/* Labels whose blob is another marker's; images nearer than half a pixel could be either's. */
static size_t wrong_labels(const struct crowd *c, const struct bb_tracker *tr, size_t body, size_t *n_labels)
{
	struct bb_track_label l[CAMERAS * 6];
	const size_t n = bb_tracker_labels(tr, body, l, BB_ARRAY_LEN(l));
	size_t wrong = 0;

	assert_true(n <= BB_ARRAY_LEN(l));
	for (size_t k = 0; k < n; k++) {
		const size_t cam = l[k].camera;
		double px[2] = { 0, 0 };
		size_t i = 0;
		while (i < c->n[cam] && ((double)c->blobs[cam][i].x_px != l[k].x_px || (double)c->blobs[cam][i].y_px != l[k].y_px))
			i++;
		assert_true(i < c->n[cam]);
		assert_true(scene_pixel(&c->s.cameras[cam], bb_pose_apply(&c->pose[body], c->bodies[body].marker[l[k].marker]), px));
		wrong += c->of[cam][i] != body * 8 + l[k].marker && hypot(px[0] - l[k].x_px, px[1] - l[k].y_px) > 0.5;
	}
	*n_labels += n;
	return wrong;
}

static void six_bodies_cross_and_keep_their_labels(void **state)
{
	static struct crowd c;
	size_t solved[BODIES] = { 0 }, wrong = 0, labels = 0;
	const size_t frames = 2400;

	(void)state;
	scene_room(&c.s, CAMERAS, 0.05);
	bb_cost_bodies(c.bodies, BODIES);
	struct bb_tracker_config config = scene_config(&c.s);
	struct bb_tracker *tr;
	config.bodies = c.bodies;
	config.n_bodies = BODIES;
	assert_int_equal(bb_tracker_create(&config, &tr), BB_OK);
	for (size_t i = 0; i < frames; i++) {
		crowd_expose(&c, tr, (double)i / 120, (int64_t)i * FRAME_NS);
		for (size_t b = 0; b < BODIES; b++) {
			struct bb_track_solution sol;
			if (!bb_tracker_solve(tr, true, b, &sol, 1))
				continue;
			solved[b]++;
			const struct bb_vec3 off = bb_vec3_sub(sol.centroid, scene_centroid(&c.bodies[b], &c.pose[b]));
			assert_true(bb_vec3_norm(off) < 0.005);
			wrong += wrong_labels(&c, tr, b, &labels);
		}
	}
	printf("[ note ] six bodies, a quarter of all markers hidden: solved %zu %zu %zu %zu %zu %zu of %zu, %zu labels, %zu "
	       "wrong\n",
	       solved[0], solved[1], solved[2], solved[3], solved[4], solved[5], frames, labels, wrong);
	for (size_t b = 0; b < BODIES; b++)
		assert_true(solved[b] * 100 > frames * 99);
	assert_int_equal(wrong, 0);
	assert_true(labels > frames * 100);
	bb_tracker_destroy(tr);
}

/* Row K5: between two frames the body turns into what three of its markers look the same from; in the first frame that
 * shows the others the labels are found contradicted and put right. */
static void swapped_labels_are_told_in_the_first_frame(void **state)
{
	struct scene s;
	struct bb_track_solution sol;
	int64_t at_ns = 0;

	(void)state;
	scene_room(&s, 8, 0.05);
	const struct bb_pose truth = { { 0, 1.5, 0 }, bb_quat_euler_deg(20, 5, 0) }, twin = scene_twin(&s, &truth);
	struct bb_tracker_config config = scene_config(&s);
	struct bb_tracker *tr;
	assert_int_equal(bb_tracker_create(&config, &tr), BB_OK);

	for (int i = 0; i < 40; i++, at_ns += FRAME_NS) {
		s.pose[0] = twin;
		scene_expose(&s, tr, at_ns);
		assert_int_equal(bb_tracker_solve(tr, true, 0, &sol, 1), 1);
		assert_false(sol.flags & BB_TRACK_SWAP);
	}
	assert_int_equal(bb_tracker_stats(tr).swaps, 0);
	s.pose[0] = truth;
	scene_expose(&s, tr, at_ns);
	assert_int_equal(bb_tracker_solve(tr, true, 0, &sol, 1), 1);
	assert_true(sol.flags & BB_TRACK_SWAP);
	assert_int_equal(bb_tracker_stats(tr).swaps, 1);
	assert_true(DEG * bb_quat_angle(sol.body.q, truth.q) < 1);
	for (int i = 0; i < 5; i++) {
		at_ns += FRAME_NS;
		scene_expose(&s, tr, at_ns);
		assert_int_equal(bb_tracker_solve(tr, true, 0, &sol, 1), 1);
		assert_false(sol.flags & BB_TRACK_SWAP);
	}
	bb_tracker_destroy(tr);
}

/* ---- work ---- */

/* 10^4 stray blobs in every frame of the deck's 24 cameras: told, tracked through, and no set costs more than its pairs;
 * a cold start among them gives up within the same. Time is looked at as a hang guard only: 5 periods. */
static void a_flood_is_told_and_has_a_ceiling(void **state)
{
	const struct bb_cost_config config = { "rooms/deck.yaml", 24, 6, 10000, 12, 3, 7 };
	struct bb_error err = { 0 };
	struct bb_cost c;

	(void)state;
	assert_int_equal(bb_cost_measure(&config, &c, &err), BB_OK);
	printf("[ note ] flood: warm %.0f us, first set %.0f us; %u and %u pairs\n", c.median_us, c.cold_median_us,
	       c.work.pairs, c.cold_work.pairs);
	assert_int_equal(c.floods, 12);
	assert_true(c.solved == 1 && c.wrong == 0);
	assert_true(c.work.pairs <= 200000 && c.cold_work.pairs > 100000 && c.cold_work.pairs <= 200000);
	assert_true(c.cold_work.points < 1000 && c.cold_work.poses < 2000);
	assert_true(c.median_us < 5 * c.period_us && c.cold_median_us < 5 * c.period_us);
}

static void the_deck_fits_into_its_period(void **state)
{
	const struct bb_cost_config config = { "rooms/deck.yaml", 24, 6, 0, 200, 20, 7 };
	struct bb_error err = { 0 };
	struct bb_cost c;

	(void)state;
	assert_int_equal(bb_cost_measure(&config, &c, &err), BB_OK);
	printf("[ note ] 24 cameras, 6 bodies: warm %.0f us (p99 %.0f), first set %.0f us\n", c.median_us, c.p99_us,
	       c.cold_median_us);
	assert_true(c.solved == 1 && c.cold_solved == 1 && c.wrong == 0 && c.floods == 0);
	assert_true(c.work.pairs < 1000 && c.cold_work.pairs < 1000); /* all bodies from one matching */
	assert_true(c.median_us < 5 * 1000);
}

/* Every start from nothing, under few cameras and many, is right or refused. */
static void first_sets_are_right_or_refused(void **state)
{
	static const size_t n_cameras[] = { 2, 3, 5, 8, 24 };
	struct bb_error err = { 0 };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(n_cameras); i++) {
		const struct bb_cost_config config = { "rooms/deck.yaml", n_cameras[i], 6, 3, 10, 40, 11 };
		struct bb_cost c;
		assert_int_equal(bb_cost_measure(&config, &c, &err), BB_OK);
		printf("[ note ] %zu cameras: %.0f %% of first sets' bodies\n", n_cameras[i], 100 * c.cold_solved);
		assert_int_equal(c.wrong, 0);
		assert_true(c.n_cameras < 24 || c.cold_solved > 0.99);
	}
}

/* Bodies of 3 to 6 markers, so different that their distances tell them apart. */
static void made_bodies_differ(void **state)
{
	struct bb_body b[BB_BODIES_MAX];
	double d[BB_BODIES_MAX * 15] = { 0 };
	size_t n = 0;

	(void)state;
	bb_cost_bodies(b, BB_BODIES_MAX);
	for (size_t i = 0; i < BB_BODIES_MAX; i++) {
		assert_true(b[i].n_markers >= 3 && b[i].n_markers <= 6);
		for (size_t m = 0; m < b[i].n_markers; m++)
			for (size_t k = 0; k < m; k++)
				d[n++] = bb_vec3_norm(bb_vec3_sub(b[i].marker[m], b[i].marker[k]));
	}
	for (size_t i = 0; i < n; i++)
		for (size_t k = 0; k < i; k++)
			assert_true(fabs(d[i] - d[k]) > 0.99e-3);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(shares_count_independent_frames),
		cmocka_unit_test(the_walk_holds),
		cmocka_unit_test(walks_that_cannot_be_are_refused),
		cmocka_unit_test(prediction_buys_what_it_says),
		cmocka_unit_test(innovations_are_as_large_as_stated),
		cmocka_unit_test(six_bodies_cross_and_keep_their_labels),
		cmocka_unit_test(swapped_labels_are_told_in_the_first_frame),
		cmocka_unit_test(a_flood_is_told_and_has_a_ceiling),
		cmocka_unit_test(the_deck_fits_into_its_period),
		cmocka_unit_test(first_sets_are_right_or_refused),
		cmocka_unit_test(made_bodies_differ),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
