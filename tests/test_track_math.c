/*
 * tests/test_track_math.c: the parts below the tracker: small algebra, lens, triangulation, rigid fit, one camera's
 * perspective, least squares.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "sync/track/lens.h"
#include "sync/track/linalg.h"
#include "sync/track/p3p.h"
#include "sync/track/polish.h"
#include "sync/track/rigid.h"
#include "sync/track/triangulate.h"
#include "tests/track_scene.h"

#define DEG (180 / PI)

static struct bb_vec3 any_point(struct scene_rng *r, double size)
{
	return (struct bb_vec3){ scene_uniform(r, -size, size), scene_uniform(r, -size, size),
				 scene_uniform(r, -size, size) };
}

static struct bb_vec3 shaken(struct scene_rng *r, struct bb_vec3 p, double sigma)
{
	return bb_vec3_add(
		p, (struct bb_vec3){ sigma * scene_normal(r), sigma * scene_normal(r), sigma * scene_normal(r) });
}

static void eigen_rebuilds_the_matrix(void **state)
{
	struct scene_rng r = { .s = 5 };

	(void)state;
	for (int round = 0; round < 1000; round++) {
		const int n = 2 + round % 3;
		double a[16], keep[16], values[4], v[16];
		for (int i = 0; i < n; i++)
			for (int j = 0; j <= i; j++)
				a[i * n + j] = a[j * n + i] = scene_uniform(&r, -1, 1) * (round % 7 ? 1 : 1e-9);
		memcpy(keep, a, sizeof(keep));
		bb_sym_eigen(n, a, values, v);
		for (int i = 0; i < n; i++)
			for (int j = 0; j < n; j++) {
				double sum = 0;
				for (int k = 0; k < n; k++)
					sum += values[k] * v[i * n + k] * v[j * n + k];
				assert_true(fabs(sum - keep[i * n + j]) < 1e-13);
			}
		for (int k = 1; k < n; k++)
			assert_true(values[k - 1] >= values[k]);
	}
}

static void cholesky_solves_and_refuses(void **state)
{
	struct scene_rng r = { .s = 6 };
	double a[6][6], l[6][6], inverse[6][6];

	(void)state;
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < 6; j++)
			l[i][j] = scene_uniform(&r, -1, 1);
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < 6; j++) {
			a[i][j] = i == j;
			for (int k = 0; k < 6; k++)
				a[i][j] += l[i][k] * l[j][k];
		}
	memcpy(l, a, sizeof(l));
	assert_true(bb_chol6_factor(l));
	bb_chol6_inverse((const double(*)[6])l, inverse);
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < 6; j++) {
			double sum = 0;
			for (int k = 0; k < 6; k++)
				sum += a[i][k] * inverse[k][j];
			assert_true(fabs(sum - (i == j)) < 1e-12);
		}
	memset(l, 0, sizeof(l));
	assert_false(bb_chol6_factor(l));
	l[0][0] = (double)NAN;
	assert_false(bb_chol6_factor(l));
}

static void rotation_vectors_are_exact_when_small(void **state)
{
	(void)state;
	for (double angle = 1e-12; angle < 3.14; angle *= 3) {
		const struct bb_vec3 v = { 0.6 * angle, 0, -0.8 * angle };
		const struct bb_vec3 back = bb_quat_log(bb_quat_exp(v));
		assert_true(fabs(back.x - v.x) < 1e-9 * angle && fabs(back.z - v.z) < 1e-9 * angle);
	}
}

/* Our lens against the fixture's own projector, and pixel to ray and back. */
static void lens_agrees_with_the_fixture(void **state)
{
	struct scene_rng r = { .s = 7 };
	struct scene s;
	double worst_px = 0, worst_rad = 0, worst_jac = 0;

	(void)state;
	scene_room(&s, 8, 0);
	for (int round = 0; round < 20000; round++) {
		const struct bb_camera_config *c = &s.cameras[round % 8];
		const struct bb_vec3 p = { scene_uniform(&r, -1.2, 1.2), scene_uniform(&r, 0, 2.2),
					   scene_uniform(&r, -1.2, 1.2) };
		struct bb_lens lens;
		struct bb_ray ray;
		double truth[2], px[2], ahead[2], jac[2][3];
		assert_true(bb_lens_init(&lens, c));
		if (!scene_pixel(c, p, truth))
			continue;
		assert_true(bb_lens_derive(&lens, p, px, jac));
		assert_true(bb_lens_project(&lens, bb_vec3_add(p, (struct bb_vec3){ 1e-6, 0, 0 }), ahead));
		worst_jac = fmax(worst_jac, fabs((ahead[0] - px[0]) * 1e6 - jac[0][0]) / (1 + fabs(jac[0][0])));
		worst_px = fmax(worst_px, hypot(px[0] - truth[0], px[1] - truth[1]));
		assert_true(bb_lens_ray(&lens, truth[0], truth[1], &ray));
		const struct bb_vec3 d = bb_vec3_unit(bb_vec3_sub(p, c->pose.p), p);
		worst_rad = fmax(worst_rad, bb_vec3_norm(bb_vec3_cross(d, ray.d)));
	}
	printf("[ note ] lens: %.1e px, %.1e rad, jacobian %.1e\n", worst_px, worst_rad, worst_jac);
	assert_true(worst_px < 1e-9 && worst_rad < 1e-12 && worst_jac < 1e-3);
}

static void lens_refuses_what_it_cannot_invert(void **state)
{
	struct bb_camera_config c =
		scene_camera((struct bb_vec3){ 0, 0, 0 }, (struct bb_vec3){ 0, 0, -1 }, 640, 480, 90, -0.3, 0);
	struct bb_lens lens;
	struct bb_ray ray;
	double px[2];

	(void)state;
	assert_true(bb_lens_init(&lens, &c));
	/* r (1 - 0.3 r^2) peaks at r = 1.054 with 0.703: 225 px from the centre no ray can arrive */
	assert_true(bb_lens_ray(&lens, c.cx_px + 0.70 * c.fx_px, c.cy_px, &ray));
	assert_false(bb_lens_ray(&lens, c.cx_px + 0.71 * c.fx_px, c.cy_px, &ray));
	assert_false(bb_lens_ray(&lens, (double)NAN, 3, &ray));
	assert_false(bb_lens_project(&lens, (struct bb_vec3){ 2, 0, -1 }, px));
	assert_false(bb_lens_project(&lens, (struct bb_vec3){ 0, 0, 1 }, px));
	c.fx_px = 0;
	assert_false(bb_lens_init(&lens, &c));
	c.fx_px = 300;
	c.k1 = (double)NAN;
	assert_false(bb_lens_init(&lens, &c));
}

/* Depth error of two rays against z d sqrt(2) / (2 tan(angle / 2)), down to 0.3 degrees; below the limit no answer. */
static void depth_error_is_what_geometry_says(void **state)
{
	struct scene_rng r = { .s = 8 };
	const double z = 3, delta = 0.2e-3;

	(void)state;
	for (double angle_deg = 20; angle_deg >= 0.3; angle_deg /= 1.7) {
		const double half = angle_deg / 2 / DEG, base = z * tan(half);
		double sum = 0, sigma = 0;
		const int n = 4000;
		for (int i = 0; i < n; i++) {
			struct bb_sight s[2];
			struct bb_triangulated t;
			for (int k = 0; k < 2; k++) {
				s[k].o = (struct bb_vec3){ k ? base : -base, 0, 0 };
				const struct bb_vec3 d =
					bb_vec3_unit(bb_vec3_sub((struct bb_vec3){ 0, 0, z }, s[k].o), s[k].o);
				s[k].d = bb_vec3_unit(shaken(&r, d, delta), d);
				s[k].sigma_rad = delta;
			}
			if (!bb_triangulate(s, 2, 0.1 / DEG, &t))
				continue;
			sum += pow(t.p.z - z, 2);
			sigma += t.sigma_m * t.sigma_m;
		}
		const double rms = sqrt(sum / n), want = z * delta * sqrt(2) / (2 * tan(half));
		printf("[ note ] rays at %.2f deg: depth %.2f mm rms, geometry %.2f mm, stated %.2f mm\n", angle_deg,
		       1e3 * rms, 1e3 * want, 1e3 * sqrt(sigma / n));
		assert_true(fabs(rms / want - 1) < 0.15 && fabs(sqrt(sigma / n) / want - 1) < 0.15);
	}
}

static void parallel_rays_and_points_behind_are_refused(void **state)
{
	const struct bb_vec3 forward = { 0, 0, 1 };
	struct bb_sight s[2] = { { { -0.01, 0, 0 }, forward, 1e-4 }, { { 0.01, 0, 0 }, forward, 1e-4 } };
	struct bb_triangulated t;
	struct bb_vec3 mid;
	double gap, sigma;

	(void)state;
	assert_false(bb_triangulate(s, 2, BB_RAY_ANGLE_MIN_RAD, &t));
	s[1].d = bb_vec3_unit((struct bb_vec3){ -0.02, 0, 1 }, forward); /* 1.15 degrees */
	assert_false(bb_triangulate(s, 2, BB_RAY_ANGLE_MIN_RAD, &t));
	assert_false(bb_triangulate_pair(&s[0], &s[1], BB_RAY_ANGLE_MIN_RAD, &mid, &gap, &sigma));
	s[1].d = bb_vec3_unit((struct bb_vec3){ 0.2, 0, 1 }, forward); /* they met behind the cameras */
	assert_false(bb_triangulate(s, 2, BB_RAY_ANGLE_MIN_RAD, &t));
	assert_false(bb_triangulate_pair(&s[0], &s[1], BB_RAY_ANGLE_MIN_RAD, &mid, &gap, &sigma));
	assert_false(bb_triangulate(s, 1, BB_RAY_ANGLE_MIN_RAD, &t));
}

/* A nearly parallel third ray must not spoil what two good ones know. */
static void a_poor_ray_does_no_harm(void **state)
{
	struct scene_rng r = { .s = 9 };
	const struct bb_vec3 p = { 0.1, 0.2, 3 };
	const struct bb_vec3 o[3] = { { -1, 0, 0 }, { 1, 0, 0 }, { -0.99, 0, 0 } };
	double two = 0, three = 0;

	(void)state;
	for (int i = 0; i < 3000; i++) {
		struct bb_sight s[3];
		struct bb_triangulated t;
		for (int k = 0; k < 3; k++) {
			const struct bb_vec3 d = bb_vec3_unit(bb_vec3_sub(p, o[k]), p);
			s[k] = (struct bb_sight){ o[k], bb_vec3_unit(shaken(&r, d, 2e-4), d), 2e-4 };
		}
		assert_true(bb_triangulate(s, 2, BB_RAY_ANGLE_MIN_RAD, &t));
		two += pow(bb_vec3_norm(bb_vec3_sub(t.p, p)), 2);
		assert_true(bb_triangulate(s, 3, BB_RAY_ANGLE_MIN_RAD, &t));
		three += pow(bb_vec3_norm(bb_vec3_sub(t.p, p)), 2);
	}
	assert_true(three < two);
}

static void rigid_fit_is_exact_and_proper(void **state)
{
	struct scene_rng r = { .s = 10 };

	(void)state;
	for (int round = 0; round < 10000; round++) {
		const size_t n = 3 + (size_t)round % 4;
		const struct bb_pose truth = { any_point(&r, 3), scene_any_turn(&r) };
		struct bb_vec3 body[6], room[6];
		struct bb_rigid fit;
		for (size_t i = 0; i < n; i++) {
			body[i] = any_point(&r, 0.1);
			body[i].z *= round % 3 ? 1 : 0; /* coplanar: the mirror image is as near as the truth */
			room[i] = bb_pose_apply(&truth, body[i]);
		}
		assert_true(bb_rigid_fit(body, room, n, 1e-6, BB_QUAT_IDENTITY, &fit));
		if (fit.collinear)
			continue;
		assert_false(fit.mirrored);
		assert_true(fit.rms_m < 1e-12 && bb_quat_angle(fit.pose.q, truth.q) < 1e-7);
	}
}

static void mirrored_sets_are_told(void **state)
{
	struct scene_rng r = { .s = 11 };
	const struct bb_pose truth = { any_point(&r, 3), scene_any_turn(&r) };
	struct bb_vec3 room[5];
	struct bb_rigid fit;

	(void)state;
	for (int i = 0; i < 5; i++) {
		struct bb_vec3 m = scene_glasses.marker[i];
		m.x = -m.x;
		room[i] = bb_pose_apply(&truth, m);
	}
	assert_true(bb_rigid_fit(scene_glasses.marker, room, 5, 2e-4, BB_QUAT_IDENTITY, &fit));
	assert_true(fit.mirrored && fit.rms_m > 2e-3);
}

/* Row by row the measured roll of nearly collinear sets, with the stated sigma within 20 %; then held. */
static void roll_of_a_line_is_honest_and_held(void **state)
{
	static const double lateral_mm[] = { 10, 2, 0.5, 0 };
	struct scene_rng r = { .s = 12 };

	(void)state;
	for (size_t k = 0; k < BB_ARRAY_LEN(lateral_mm); k++) {
		struct bb_vec3 body[4] = { { -0.1, 0, 0 }, { -0.03, 0, 0 }, { 0.05, 0, 0 }, { 0.1, 0, 0 } };
		double sum = 0, stated = 0, tilt = 0;
		const int n = 2000;
		bool held = false;
		for (int i = 0; i < 4; i++)
			body[i].y = (i % 2 ? 1e-3 : -1e-3) * lateral_mm[k];
		for (int i = 0; i < n; i++) {
			const struct bb_quat q = scene_any_turn(&r);
			const struct bb_vec3 line = bb_quat_rotate(q, (struct bb_vec3){ 1, 0, 0 });
			struct bb_vec3 room[4];
			struct bb_rigid fit;
			for (int m = 0; m < 4; m++)
				room[m] = shaken(&r, bb_quat_rotate(q, body[m]), 0.2e-3);
			/* what came before knows the roll, and the line to 5 degrees */
			const struct bb_quat before =
				bb_quat_mul(bb_quat_exp(bb_vec3_scale(bb_vec3_cross(line, any_point(&r, 1)), 0.09)), q);
			assert_true(bb_rigid_fit(body, room, 4, 0.2e-3, before, &fit));
			sum += pow(bb_vec3_dot(bb_quat_log(bb_quat_mul(fit.pose.q, bb_quat_conj(q))), line), 2);
			tilt += pow(bb_vec3_norm(bb_vec3_cross(bb_quat_rotate(fit.pose.q, (struct bb_vec3){ 1, 0, 0 }),
							       line)),
				    2);
			stated += fit.roll_sigma_rad;
			held = fit.collinear;
		}
		printf("[ note ] spread %.1f mm: roll %.2f deg rms, stated %.2f deg, line %.3f deg, %s\n",
		       lateral_mm[k], DEG * sqrt(sum / n), DEG * stated / n, DEG * sqrt(tilt / n),
		       held ? "held" : "free");
		assert_int_equal(held, lateral_mm[k] < 5);
		assert_true(held || fabs(stated / n / sqrt(sum / n) - 1) < 0.2);
		assert_true(!held || DEG * sqrt(sum / n) < 3.0); /* as good as what came before, not 121 degrees */
		assert_true(DEG * sqrt(tilt / n) < 0.2);
	}
}

static void too_few_or_equal_points_are_refused(void **state)
{
	const struct bb_vec3 same[3] = { { 1, 2, 3 }, { 1, 2, 3 }, { 1, 2, 3 } };
	struct bb_rigid fit;

	(void)state;
	assert_false(bb_rigid_fit(scene_glasses.marker, scene_glasses.marker, 2, 1e-4, BB_QUAT_IDENTITY, &fit));
	assert_false(bb_rigid_fit(same, same, 3, 1e-4, BB_QUAT_IDENTITY, &fit));
	assert_false(bb_rigid_fit(scene_glasses.marker, same, 3, 1e-4, BB_QUAT_IDENTITY, &fit));
}

static void three_bearings_give_the_true_pose_among_theirs(void **state)
{
	struct scene_rng r = { .s = 13 };
	size_t missed = 0, sums[5] = { 0 };
	const size_t n = 20000;

	(void)state;
	for (size_t round = 0; round < n; round++) {
		const struct bb_pose truth = { { scene_uniform(&r, -1, 1), scene_uniform(&r, -1, 1),
						 scene_uniform(&r, 0.4, 4) },
					       scene_any_turn(&r) };
		struct bb_vec3 x[3], y[3];
		double want[3], depth[4][3], best = 1;
		for (int i = 0; i < 3; i++) {
			x[i] = any_point(&r, 0.1);
			const struct bb_vec3 p = bb_pose_apply(&truth, x[i]);
			want[i] = bb_vec3_norm(p);
			y[i] = bb_vec3_scale(p, 1 / want[i]);
		}
		const size_t found = bb_p3p_depths(y, x, depth);
		sums[found]++;
		for (size_t k = 0; k < found; k++)
			best = fmin(best, fabs(depth[k][0] - want[0]) + fabs(depth[k][1] - want[1]) +
						  fabs(depth[k][2] - want[2]));
		missed += best > 1e-6;
	}
	printf("[ note ] p3p: %zu of %zu missed; 0..4 answers: %zu %zu %zu %zu %zu\n", missed, n, sums[0], sums[1],
	       sums[2], sums[3], sums[4]);
	assert_true(missed * 500 < n);
}

/* From 10 degrees and 5 cm away back to the truth, with the camera's own mid-exposure taken into account. */
static void polish_returns_from_a_rough_start(void **state)
{
	struct scene_rng r = { .s = 14 };
	struct scene s;
	struct bb_lens lenses[8];
	struct bb_track_obs obs[8 * 5];

	(void)state;
	scene_room(&s, 8, 0);
	for (int i = 0; i < 8; i++)
		assert_true(bb_lens_init(&lenses[i], &s.cameras[i]));
	for (int round = 0; round < 200; round++) {
		const struct bb_pose truth = { { scene_uniform(&r, -.4, .4), 1.4, scene_uniform(&r, -.4, .4) },
					       scene_any_turn(&r) };
		const struct bb_vec3 centroid = scene_centroid(&scene_glasses, &BB_POSE_IDENTITY),
				     speed = any_point(&r, 1);
		struct bb_polish p = { .lenses = lenses,
				       .markers = scene_glasses.marker,
				       .centroid = centroid,
				       .obs = obs,
				       .sigma_px = 0.05,
				       .velocity = speed };
		for (uint16_t c = 0; c < 8; c++)
			for (uint8_t m = 0; m < 5; m++) {
				const float dt_s = 0.0005f * (float)c;
				const struct bb_vec3 at = bb_vec3_add(bb_pose_apply(&truth, scene_glasses.marker[m]),
								      bb_vec3_scale(speed, (double)dt_s));
				double px[2];
				if (!scene_pixel(&s.cameras[c], at, px))
					continue;
				obs[p.n_obs++] = (struct bb_track_obs){ .camera = c, .marker = m, .dt_s = dt_s, .x_px = px[0], .y_px = px[1] };
			}
		p.pose = (struct bb_pose){ bb_vec3_add(truth.p, any_point(&r, 0.05)),
					   bb_quat_mul(bb_quat_exp(any_point(&r, 0.17)), truth.q) };
		assert_true(bb_polish_run(&p, 20));
		assert_true(bb_vec3_norm(bb_vec3_sub(p.pose.p, truth.p)) < 1e-7 &&
			    bb_quat_angle(p.pose.q, truth.q) < 1e-6);
		assert_true(p.chi2 < 1e-6);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(eigen_rebuilds_the_matrix),
		cmocka_unit_test(cholesky_solves_and_refuses),
		cmocka_unit_test(rotation_vectors_are_exact_when_small),
		cmocka_unit_test(lens_agrees_with_the_fixture),
		cmocka_unit_test(lens_refuses_what_it_cannot_invert),
		cmocka_unit_test(depth_error_is_what_geometry_says),
		cmocka_unit_test(parallel_rays_and_points_behind_are_refused),
		cmocka_unit_test(a_poor_ray_does_no_harm),
		cmocka_unit_test(rigid_fit_is_exact_and_proper),
		cmocka_unit_test(mirrored_sets_are_told),
		cmocka_unit_test(roll_of_a_line_is_honest_and_held),
		cmocka_unit_test(too_few_or_equal_points_are_refused),
		cmocka_unit_test(three_bearings_give_the_true_pose_among_theirs),
		cmocka_unit_test(polish_returns_from_a_rough_start),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
