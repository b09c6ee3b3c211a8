/*
 * tests/test_track_oracles.c: degenerate inputs of tracking, each against what geometry says: markers near a line, too few
 * or doubled ones, mirrors, rays that hardly cross, a head inside a wall, small angles, turns by half a circle. What is
 * answered has an honest covariance; the rest is refused.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>

#include <cmocka.h>

#include "bench/solver/walk.h"
#include "sync/track/rigid.h"
#include "sync/track/triangulate.h"
#include "tests/track_scene.h"

#define DEG (180 / PI)
#define FRAME_NS 8333333

static struct bb_vec3 any_point(struct scene_rng *r, double size)
{
	return (struct bb_vec3){ scene_uniform(r, -size, size), scene_uniform(r, -size, size),
				 scene_uniform(r, -size, size) };
}

/* ---- nQ1, nQ2 ---- */

static void small_angles_are_right_to_four_ulp(void **state)
{
	(void)state;
	for (int i = 0; 1e-9 * pow(1.37, i) < PI; i++) {
		const double angle = 1e-9 * pow(1.37, i);
		const struct bb_quat q = { sin(angle / 2), 0, 0, cos(angle / 2) }, minus = { -q.x, 0, 0, -q.w };
		const double ulp = nextafter(angle, 4) - angle;
		assert_true(fabs(bb_quat_angle(BB_QUAT_IDENTITY, q) - angle) <= 4 * ulp);
		assert_true(fabs(bb_quat_angle(BB_QUAT_IDENTITY, minus) - angle) <= 4 * ulp);
	}
}

static double norm2_off(struct bb_quat q)
{
	return fabs(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w - 1);
}

/* Between orientations any way apart, half a turn and signs included: unit length, the same path for q and -q, and steps
 * no larger than their share of the way. */
static void slerp_takes_even_steps_whatever_the_signs(void **state)
{
	static const double apart[] = { 0, 1e-12, 1e-7, 1e-4, 1, 3, PI - 1e-9, PI };
	struct scene_rng r = { .s = 21 };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(apart); i++)
		for (int round = 0; round < 50; round++) {
			const struct bb_quat a = scene_any_turn(&r);
			const struct bb_quat b = bb_quat_mul(bb_quat_axis_angle(any_point(&r, 1), apart[i]), a);
			const struct bb_quat c = { -b.x, -b.y, -b.z, -b.w };
			struct bb_quat before = a;
			const bool half = fabs(apart[i] - PI) < 1e-8; /* either way is the short one */
			for (int k = 0; k <= 100; k++) {
				const struct bb_quat q = bb_quat_slerp(a, b, k / 100.0), m = bb_quat_slerp(a, c, k / 100.0);
				assert_true(norm2_off(q) < 8 * 2.3e-16);
				assert_true(half || bb_quat_angle(q, m) < 1e-14);
				assert_true(bb_quat_angle(before, q) < apart[i] / 100 + 1e-9);
				before = q;
			}
		}
	assert_true(norm2_off(bb_quat_slerp((struct bb_quat){ 0 }, (struct bb_quat){ 0 }, 0.5)) < 1e-15);
}

/* ---- nT2 ---- */

static bool cross(struct scene_rng *r, double angle_deg, double least_rad, double *z, double *sigma_m)
{
	const double depth = 3, delta = 0.2e-3, base = depth * tan(angle_deg / 2 / DEG);
	struct bb_sight s[2];
	struct bb_triangulated t;

	for (int k = 0; k < 2; k++) {
		s[k].o = (struct bb_vec3){ k ? base : -base, 0, 0 };
		const struct bb_vec3 d = bb_vec3_unit(bb_vec3_sub((struct bb_vec3){ 0, 0, depth }, s[k].o), s[k].o);
		s[k].d = bb_vec3_unit(bb_vec3_add(d, (struct bb_vec3){ delta * scene_normal(r), delta * scene_normal(r),
								       delta * scene_normal(r) }),
				      d);
		s[k].sigma_rad = delta;
	}
	if (!bb_triangulate(s, 2, least_rad, &t))
		return false;
	*z = t.p.z - depth;
	*sigma_m = t.sigma_m;
	return true;
}

/* Depth error within 15 % of z d sqrt(2) / (2 tan(angle / 2)) down to 0.3 degrees where asked for, its sigma honest; and
 * with the limit that the tracker uses nothing at all below it, and never a point behind. */
static void depth_is_as_good_as_the_angle_of_its_rays(void **state)
{
	static const double angle_deg[] = { 10, 1, 0.3, 0.1, 0.01 };
	struct scene_rng r = { .s = 22 };
	const int n = 6000;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(angle_deg); i++) {
		const double want = 3 * 0.2e-3 * sqrt(2) / (2 * tan(angle_deg[i] / 2 / DEG));
		double sum = 0, z = 0, sigma = 0;
		int found = 0, inside = 0, usual = 0;
		for (int k = 0; k < n; k++) {
			if (cross(&r, angle_deg[i], 1e-5, &z, &sigma)) {
				found++;
				sum += z * z;
				inside += fabs(z) < 2 * sigma;
				assert_true(z > -3);
			}
			usual += cross(&r, angle_deg[i], BB_RAY_ANGLE_MIN_RAD, &z, &sigma);
		}
		printf("[ note ] %.2f deg: %d of %d, depth %.1f mm rms, geometry %.1f mm, inside 2 sigma %.1f %%; at the "
		       "usual limit %d\n",
		       angle_deg[i], found, n, 1e3 * sqrt(sum / found), 1e3 * want, 100.0 * inside / found, usual);
		assert_int_equal(usual, angle_deg[i] > 1.5 ? n : 0);
		if (angle_deg[i] < 0.3)
			continue;
		assert_true(fabs(sqrt(sum / found) / want - 1) < 0.15);
		assert_true(inside > 0.93 * found);
	}
}

/* ---- nT1 ---- */

/* Markers along 200 mm that leave the line by less and less: what the fit says of its roll is right within a fifth, or
 * the roll is held; what it says is what comes out, not what was there. */
static void doubled_and_too_few_markers(void **state)
{
	const struct bb_vec3 body[4] = { { 0, 0, 0 }, { 0.1, 0, 0 }, { 0, 0, 0 }, { 0.1, 0, 0 } };
	struct bb_rigid fit;
	struct bb_vec3 room[4];
	const struct bb_pose truth = { { 1, 2, 3 }, bb_quat_axis_angle((struct bb_vec3){ 1, 2, 2 }, 0.7) };

	(void)state;
	for (int i = 0; i < 4; i++)
		room[i] = bb_pose_apply(&truth, body[i]);
	assert_false(bb_rigid_fit(body, room, 2, 2e-4, BB_QUAT_IDENTITY, &fit));
	/* two places, four markers: no more than a line */
	assert_true(bb_rigid_fit(body, room, 4, 2e-4, BB_QUAT_IDENTITY, &fit));
	assert_true(fit.collinear && fit.roll_sigma_rad > 1);
	assert_true(bb_vec3_norm(bb_vec3_sub(bb_pose_apply(&fit.pose, body[1]), room[1])) < 1e-12);
}

/* Coplanar markers and their mirror image differ by nothing that distances tell: the rotation is proper all the same. */
static void coplanar_sets_give_rotations(void **state)
{
	struct scene_rng r = { .s = 23 };

	(void)state;
	for (int round = 0; round < 3000; round++) {
		const struct bb_pose truth = { any_point(&r, 2), scene_any_turn(&r) };
		struct bb_vec3 body[5], room[5];
		struct bb_rigid fit;
		for (int i = 0; i < 5; i++) {
			body[i] = any_point(&r, 0.1);
			body[i].z = 0;
			room[i] = bb_vec3_add(bb_pose_apply(&truth, body[i]), any_point(&r, 2e-4));
		}
		assert_true(bb_rigid_fit(body, room, 5, 2e-4, BB_QUAT_IDENTITY, &fit));
		const struct bb_vec3 x = bb_quat_rotate(fit.pose.q, (struct bb_vec3){ 1, 0, 0 }),
				     y = bb_quat_rotate(fit.pose.q, (struct bb_vec3){ 0, 1, 0 }),
				     z = bb_quat_rotate(fit.pose.q, (struct bb_vec3){ 0, 0, 1 });
		assert_true(bb_vec3_dot(bb_vec3_cross(x, y), z) > 0.999999);
		assert_true(fit.collinear || bb_quat_angle(fit.pose.q, truth.q) < 0.5);
	}
}

/* ---- whole solutions ---- */

static struct bb_tracker *make(const struct scene *s)
{
	const struct bb_tracker_config config = scene_config(s);
	struct bb_tracker *tr;

	assert_int_equal(bb_tracker_create(&config, &tr), BB_OK);
	return tr;
}

struct honest {
	size_t asked, solved, n_position, n_angle; /* squared Mahalanobis distances under the 95 % point */
	double mm2, deg2, sigma_mm2, sigma_deg2;
};

static void judge(struct honest *h, const struct scene *s, const struct bb_track_solution *sol)
{
	const struct bb_vec3 off =
		bb_vec3_scale(bb_vec3_sub(sol->centroid, scene_centroid(&s->bodies[0], &s->pose[0])), 1e3);
	const struct bb_vec3 turn = bb_walk_turn_deg(s->pose[0].q, sol->body.q);

	h->solved++;
	h->n_position += bb_walk_distance2(sol->covariance_mm2, off) < BB_CHI2_3_95;
	h->n_angle += bb_walk_distance2(sol->covariance_deg2, turn) < BB_CHI2_3_95;
	h->mm2 += bb_vec3_dot(off, off);
	h->deg2 += bb_vec3_dot(turn, turn);
	h->sigma_mm2 += pow(sol->position_sigma_mm, 2);
	h->sigma_deg2 += pow(sol->angle_sigma_deg, 2);
}

static void tell(const char *what, const struct honest *h)
{
	const double n = h->solved ? (double)h->solved : 1;

	printf("[ note ] %s: %zu of %zu, %.2f mm (stated %.2f), %.2f deg (stated %.2f), %.1f %% and %.1f %% inside\n", what,
	       h->solved, h->asked, sqrt(h->mm2 / n), sqrt(h->sigma_mm2 / n), sqrt(h->deg2 / n),
	       sqrt(h->sigma_deg2 / n), 100 * (double)h->n_position / n, 100 * (double)h->n_angle / n);
}

static void must_be_honest(const struct honest *h)
{
	assert_true(10 * h->n_position >= 9 * h->solved && 10 * h->n_angle >= 9 * h->solved);
}

/* The walk, seen as poorly as it gets: what is still answered says how poor it is. */
static void poor_views_are_honest(void **state)
{
	static const struct poor {
		const char *what;
		size_t n_cameras;
		double base_m;   /* two cameras so far apart instead of the room's; 0: those */
		unsigned hidden; /* markers */
		bool wanted;     /* it must be answered */
	} poor[] = {
		{ "two cameras", 2, 0, 0, true },	      { "two cameras, three markers", 2, 0, 0x18, true },
		{ "two cameras 1 degree apart", 2, 0.04, 0, false }, { "two cameras 0.1 degree apart", 2, 0.004, 0, false },
		{ "three cameras, three markers", 3, 0, 0x05, true }, { "two markers", 8, 0, 0x1c, false },
	};

	(void)state;
	for (size_t k = 0; k < BB_ARRAY_LEN(poor); k++) {
		struct scene s;
		struct honest h = { 0 };
		scene_room(&s, poor[k].n_cameras, 0.05);
		for (size_t i = 0; poor[k].base_m > 0 && i < 2; i++)
			s.cameras[i] = scene_camera((struct bb_vec3){ poor[k].base_m * (double)i, 1.6, -1.15 },
						    (struct bb_vec3){ poor[k].base_m * (double)i, 1.5, 1 }, 640, 480, 70, 0, 0);
		struct bb_tracker *tr = make(&s);
		for (int i = 0; i < 3000; i++) {
			struct bb_track_solution sol;
			s.pose[0] = scene_walk(i * 1e-9 * FRAME_NS);
			s.hidden_markers[0] = i < 60 ? 0 : poor[k].hidden;
			const size_t seeing = scene_expose(&s, tr, (int64_t)i * FRAME_NS);
			h.asked += seeing >= 2;
			if (bb_tracker_solve(tr, true, 0, &sol, 1) && i >= 70)
				judge(&h, &s, &sol);
		}
		tell(poor[k].what, &h);
		must_be_honest(&h);
		assert_true(!poor[k].wanted || 10 * h.solved > 9 * (h.asked - 70));
		assert_true(poor[k].hidden != 0x1c || !h.solved);
		bb_tracker_destroy(tr);
	}
}

/* Blobs twice and half as noisy as the room file says: the sigmas follow what the residuals show. */
static void sigmas_follow_the_noise_there_is(void **state)
{
	static const double factor[] = { 0.5, 2 };

	(void)state;
	for (size_t k = 0; k < BB_ARRAY_LEN(factor); k++) {
		struct scene s;
		struct honest h = { 0 };
		scene_room(&s, 8, 0.05);
		s.occlude = true;
		struct bb_tracker *tr = make(&s);
		s.noise_px *= factor[k];
		for (int i = 0; i < 4000; i++) {
			struct bb_track_solution sol;
			s.pose[0] = scene_walk(i * 1e-9 * FRAME_NS);
			scene_expose(&s, tr, (int64_t)i * FRAME_NS);
			h.asked++;
			if (bb_tracker_solve(tr, true, 0, &sol, 1) && i >= 400)
				judge(&h, &s, &sol);
		}
		tell(factor[k] < 1 ? "half the noise" : "twice the noise", &h);
		assert_true((double)h.n_position > 0.92 * (double)h.solved && (double)h.n_position < 0.98 * (double)h.solved);
		assert_true((double)h.n_angle > 0.92 * (double)h.solved && (double)h.n_angle < 0.98 * (double)h.solved);
		bb_tracker_destroy(tr);
	}
}

/* One camera and a flat body: its mirror twin, turned through the picture's plane, explains the pixels almost as well. */
static void the_twin_of_a_flat_body_is_refused(void **state)
{
	struct scene s;
	size_t solved = 0, wrong = 0;

	(void)state;
	scene_room(&s, 1, 0.05);
	s.cameras[0] = scene_camera((struct bb_vec3){ 0, 1.5, -1.1 }, (struct bb_vec3){ 0, 1.5, 1 }, 640, 480, 60, 0, 0);
	for (int m = 0; m < 5; m++)
		s.bodies[0].marker[m].z = 0;
	struct bb_tracker_config config = scene_config(&s);
	struct bb_tracker *tr;
	config.neutral.q = bb_quat_euler_deg(0, 0, 0);
	assert_int_equal(bb_tracker_create(&config, &tr), BB_OK);
	for (int i = 0; i < 1500; i++) {
		struct bb_track_solution sol;
		s.pose[0] = (struct bb_pose){ { scene_uniform(&s.rng, -.2, .2), scene_uniform(&s.rng, 1.3, 1.7),
						scene_uniform(&s.rng, 0, .8) },
					      bb_quat_euler_deg(scene_uniform(&s.rng, -50, 50),
								scene_uniform(&s.rng, -40, 40), 10) };
		scene_expose(&s, tr, (int64_t)i * 10000000000);
		if (!bb_tracker_solve(tr, true, 0, &sol, 1))
			continue;
		solved++;
		/* the twin faces elsewhere by twice the angle of sight: nothing a few sigmas would explain */
		wrong += DEG * bb_quat_angle(sol.body.q, s.pose[0].q) > 3 + 5 * sol.angle_sigma_deg;
	}
	printf("[ note ] flat body, one camera, from nothing: %zu of 1500 answered, %zu wrong\n", solved, wrong);
	assert_true(solved > 700);
	assert_int_equal(wrong, 0);
	bb_tracker_destroy(tr);
}

/* Half a metre inside a wall nobody stands. */
static void a_head_inside_a_wall_is_refused(void **state)
{
	struct scene s;
	struct bb_track_solution sol;

	(void)state;
	scene_room(&s, 8, 0.05);
	s.pose[0] = (struct bb_pose){ { 0.5, 1.5, 0 }, BB_QUAT_IDENTITY };
	struct bb_tracker_config config = scene_config(&s);
	struct bb_tracker *tr = make(&s);
	scene_expose(&s, tr, 0);
	assert_int_equal(bb_tracker_solve(tr, true, 0, &sol, 1), 1);
	bb_tracker_destroy(tr);

	config.room_max.x = -0.2; /* the wall stands 0.7 m and more before the head */
	assert_int_equal(bb_tracker_create(&config, &tr), BB_OK);
	for (int i = 0; i < 20; i++) {
		scene_expose(&s, tr, (int64_t)i * FRAME_NS);
		assert_int_equal(bb_tracker_solve(tr, true, 0, &sol, 1), 0);
	}
	assert_int_equal(bb_tracker_pose(tr, 0, 0).flags, BB_TRACK_NEVER);
	bb_tracker_destroy(tr);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(small_angles_are_right_to_four_ulp),
		cmocka_unit_test(slerp_takes_even_steps_whatever_the_signs),
		cmocka_unit_test(depth_is_as_good_as_the_angle_of_its_rays),
		cmocka_unit_test(doubled_and_too_few_markers),
		cmocka_unit_test(coplanar_sets_give_rotations),
		cmocka_unit_test(poor_views_are_honest),
		cmocka_unit_test(sigmas_follow_the_noise_there_is),
		cmocka_unit_test(the_twin_of_a_flat_body_is_refused),
		cmocka_unit_test(a_head_inside_a_wall_is_refused),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
