/*
 * tests/test_view.c: the off-axis view keeps its corners, its parallax and its promises about bad heads.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>

#include "render/view.h"

#define N_HEADS 100000
#define NEAR_M 0.05
#define FAR_M 50.0

static uint64_t state = 20240607;

static double uniform(double lo, double hi)
{
	state = state * 6364136223846793005ULL + 1442695040888963407ULL;
	return lo + (hi - lo) * ((double)(state >> 11) / 9007199254740992.0);
}

/* A wall of a box room of up to 10 m anywhere near the origin, turned by any angle about Y, and sometimes leaning. */
static struct bb_corners random_wall(double *width_m, double *height_m, double *room_m)
{
	const struct bb_quat turn =
		bb_quat_euler_deg(uniform(-180, 180), uniform(0, 1) < 0.5 ? 0 : uniform(-90, 90), 0);
	const struct bb_vec3 at = { uniform(-10, 10), uniform(-3, 3), uniform(-10, 10) };

	*width_m = uniform(1, 10);
	*height_m = uniform(1, 10);
	*room_m = uniform(1, 10);
	const struct bb_vec3 right = bb_quat_rotate(turn, (struct bb_vec3){ *width_m, 0, 0 });
	const struct bb_vec3 up = bb_quat_rotate(turn, (struct bb_vec3){ 0, *height_m, 0 });

	return (struct bb_corners){ at, bb_vec3_add(at, right), bb_vec3_add(at, up) };
}

static struct bb_vec3 inside(const struct bb_corners *c, double u, double v, double distance_m)
{
	const struct bb_vec3 across = bb_vec3_sub(c->lower_right, c->lower_left);
	const struct bb_vec3 rise = bb_vec3_sub(c->upper_left, c->lower_left);
	const struct bb_vec3 n = bb_vec3_unit(bb_vec3_cross(across, rise), (struct bb_vec3){ 0, 0, 1 });

	return bb_vec3_add(bb_vec3_add(c->lower_left, bb_vec3_scale(n, distance_m)),
			   bb_vec3_add(bb_vec3_scale(across, u), bb_vec3_scale(rise, v)));
}

static double worst_by_matrix(const struct bb_view *v, struct bb_vec3 p, double x, double y)
{
	const struct bb_mat4 m = bb_mat4_mul(&v->projection, &v->view);
	const double at[4] = { p.x, p.y, p.z, 1 };
	double clip[4];

	bb_mat4_apply(&m, at, clip);
	return fmax(fabs(clip[0] / clip[3] - x), fabs(clip[1] / clip[3] - y));
}

static void check_corners(const struct bb_view *v, const struct bb_corners *c, double *worst, double *worst_float,
			  double *worst_matrix)
{
	const struct bb_vec3 upper_right = bb_vec3_add(c->lower_right, bb_vec3_sub(c->upper_left, c->lower_left));
	const struct bb_vec3 p[4] = { c->lower_left, c->lower_right, c->upper_left, upper_right };
	const double x[4] = { -1, 1, -1, 1 }, y[4] = { -1, -1, 1, 1 };

	for (int i = 0; i < 4; i++) {
		double ndc[3], w;
		float near_ndc[3], near_w;
		bb_view_project(v, p[i], ndc, &w);
		bb_view_project_float(v, p[i], near_ndc, &near_w);
		*worst = fmax(*worst, fmax(fabs(ndc[0] - x[i]), fabs(ndc[1] - y[i])));
		*worst_float =
			fmax(*worst_float, fmax(fabs((double)near_ndc[0] - x[i]), fabs((double)near_ndc[1] - y[i])));
		*worst_matrix = fmax(*worst_matrix, worst_by_matrix(v, p[i], x[i], y[i]));
	}
}

static void corners_map_to_one(void **ctx)
{
	double worst = 0, worst_float = 0, worst_matrix = 0;

	(void)ctx;
	for (int i = 0; i < N_HEADS; i++) {
		double width_m, height_m, room_m;
		const struct bb_corners c = random_wall(&width_m, &height_m, &room_m);
		const struct bb_vec3 eye = inside(&c, uniform(0, 1), uniform(0, 1), uniform(0.05 + 1e-6, room_m));
		const struct bb_view v = bb_view_make(&c, eye, eye, NEAR_M, FAR_M);
		assert_int_equal(v.flags, 0);
		check_corners(&v, &c, &worst, &worst_float, &worst_matrix);
	}
	printf("%d heads: corners off by %.3g (double), %.3g (matrix product), %.3g (float)\n", N_HEADS, worst,
	       worst_matrix, worst_float);
	assert_true(worst <= 1e-12);
	assert_true(worst_matrix <= 1e-12);
	assert_true(worst_float <= 1e-5);
}

/* A tile of a large wall, seen from anywhere in the room. */
static void tile_corners_map_to_one(void **ctx)
{
	double worst = 0, worst_float = 0, worst_matrix = 0;

	(void)ctx;
	for (int i = 0; i < N_HEADS / 10; i++) {
		double width_m, height_m, room_m;
		const struct bb_corners wall = random_wall(&width_m, &height_m, &room_m);
		const double u = uniform(0, 0.9), s = uniform(0, 0.9);
		const struct bb_corners c = { inside(&wall, u, s, 0), inside(&wall, u + 0.06, s, 0),
					      inside(&wall, u, s + 0.1, 0) };
		const struct bb_vec3 eye = inside(&wall, uniform(0, 1), uniform(0, 1), uniform(0.2, room_m));
		const struct bb_view v = bb_view_make(&c, eye, eye, NEAR_M, FAR_M);
		check_corners(&v, &c, &worst, &worst_float, &worst_matrix);
	}
	printf("tiles: corners off by %.3g (double), %.3g (matrix product), %.3g (float)\n", worst, worst_matrix,
	       worst_float);
	assert_true(worst <= 1e-12);
	assert_true(worst_float <= 1e-5);
}

static void projection_agrees_with_matrix(void **ctx)
{
	double worst = 0;

	(void)ctx;
	for (int i = 0; i < 10000; i++) {
		double width_m, height_m, room_m;
		const struct bb_corners c = random_wall(&width_m, &height_m, &room_m);
		const struct bb_vec3 eye = inside(&c, uniform(0, 1), uniform(0, 1), 2);
		const struct bb_vec3 p = inside(&c, uniform(-1, 2), uniform(-1, 2), uniform(-5, 1.5));
		const struct bb_view v = bb_view_make(&c, eye, eye, NEAR_M, FAR_M);
		const double at[4] = { p.x, p.y, p.z, 1 };
		const struct bb_mat4 m = bb_mat4_mul(&v.projection, &v.view);
		double ndc[3], w, clip[4];
		bb_view_project(&v, p, ndc, &w);
		bb_mat4_apply(&m, at, clip);
		for (int k = 0; k < 3; k++)
			worst = fmax(worst, fabs(clip[k] / clip[3] - ndc[k]));
		worst = fmax(worst, fabs(clip[3] - w));
	}
	assert_true(worst < 1e-10);
}

static void near_and_far_are_the_ends_of_depth(void **ctx)
{
	const struct bb_corners c = { { -1, 0, -2 }, { 1, 0, -2 }, { -1, 2, -2 } };
	const struct bb_view v = bb_view_make(&c, (struct bb_vec3){ 0, 1, 0 }, (struct bb_vec3){ 0, 0, 0 }, 0.1, 10);
	double ndc[3], w;

	(void)ctx;
	bb_view_project(&v, (struct bb_vec3){ 0, 1, -0.1 }, ndc, &w);
	assert_true(fabs(ndc[2] + 1) < 1e-12 && fabs(w - 0.1) < 1e-12);
	bb_view_project(&v, (struct bb_vec3){ 0, 1, -10 }, ndc, &w);
	assert_true(fabs(ndc[2] - 1) < 1e-12);
	assert_true(fabs(v.normal.z - 1) < 1e-15 && fabs(v.right.x - 1) < 1e-15 && fabs(v.up.y - 1) < 1e-15);
}

static void a_leaning_wall_keeps_its_corners(void **ctx)
{
	const struct bb_corners c = { { -1, 0, -2 }, { 1, 0.01, -2 }, { -0.97, 2, -2.03 } };
	const struct bb_view v =
		bb_view_make(&c, (struct bb_vec3){ 0.3, 1.7, 0.4 }, (struct bb_vec3){ 0, 0, 0 }, 0.1, 10);
	double worst = 0, worst_float = 0, worst_matrix = 0;

	(void)ctx;
	check_corners(&v, &c, &worst, &worst_float, &worst_matrix);
	assert_true(worst < 1e-12 && worst_matrix < 1e-12 && worst_float < 1e-5);
}

/* x on the wall for either eye, in ndc; both eyes of a head that looks at the wall. */
static double parallax(const struct bb_corners *c, const struct bb_pose *head, struct bb_vec3 p)
{
	struct bb_vec3 left, right;
	double ndc_left[3], ndc_right[3], w;

	bb_view_eyes(head, 0.065, &left, &right);
	const struct bb_view l = bb_view_make(c, left, left, NEAR_M, FAR_M),
			     r = bb_view_make(c, right, right, NEAR_M, FAR_M);
	bb_view_project(&l, p, ndc_left, &w);
	bb_view_project(&r, p, ndc_right, &w);
	return ndc_right[0] - ndc_left[0];
}

static void parallax_has_the_right_sign(void **ctx)
{
	const struct bb_corners c = { { -1.5, 0, -1.5 }, { 1.5, 0, -1.5 }, { -1.5, 2.4, -1.5 } };
	const struct bb_pose head = { { 0.2, 1.7, 0.3 }, bb_quat_euler_deg(20, -5, 3) };

	(void)ctx;
	for (int i = 0; i < 1000; i++) {
		const double u = uniform(0, 1), s = uniform(0, 1);
		assert_true(fabs(parallax(&c, &head, inside(&c, u, s, 0))) < 1e-12);
		assert_true(parallax(&c, &head, inside(&c, u, s, 0.5)) <
			    -1e-3); /* in front: crossed, the right eye's image left */
		assert_true(parallax(&c, &head, inside(&c, u, s, -1)) > 1e-3);
	}
}

static void eyes_lie_on_the_heads_own_axis(void **ctx)
{
	const struct bb_pose head = { { 1, 1.7, 2 },
				      bb_quat_euler_deg(90, 0, 0) }; /* looks along -X: its right is -Z */
	struct bb_vec3 left, right;

	(void)ctx;
	bb_view_eyes(&head, 0.06, &left, &right);
	assert_true(fabs(right.z - 1.97) < 1e-12 && fabs(left.z - 2.03) < 1e-12);
	assert_true(fabs(right.x - 1) < 1e-12 && fabs(left.y - 1.7) < 1e-12);
}

static bool all_finite(const struct bb_view *v)
{
	const double *d[] = { v->view.m, v->projection.m, &v->eye.x, &v->right.x, &v->up.x, &v->normal.x };
	const int n[] = { 16, 16, 3, 3, 3, 3 };

	for (int i = 0; i < 6; i++)
		for (int k = 0; k < n[i]; k++)
			if (!isfinite(d[i][k]))
				return false;
	return true;
}

static double distance_m(const struct bb_view *v)
{
	return bb_vec3_dot(bb_vec3_sub(v->eye, v->corners.lower_left), v->normal);
}

static void bad_heads_are_clamped_and_told(void **ctx)
{
	static const double at_m[] = { 0.05, 0.049, 0, -0.3, -500 };

	(void)ctx;
	for (int i = 0; i < 5000; i++) {
		double width_m, height_m, room_m;
		const struct bb_corners c = random_wall(&width_m, &height_m, &room_m);
		const double at = at_m[i % 5];
		const struct bb_vec3 eye = inside(&c, uniform(0, 1), uniform(0, 1), at);
		const struct bb_view v = bb_view_make(&c, eye, eye, NEAR_M, FAR_M);
		assert_int_equal(v.flags, BB_VIEW_CLAMPED);
		assert_true(fabs(distance_m(&v) - 0.05) < 1e-9);
		assert_true(all_finite(&v));
	}
}

static void lost_heads_are_held(void **ctx)
{
	const struct bb_corners c = { { -1.5, 0, -1.5 }, { 1.5, 0, -1.5 }, { -1.5, 2.4, -1.5 } };
	const struct bb_vec3 neutral = { 0, 1.7, 0 };
	const struct bb_vec3 bad[] = { { (double)NAN, 0, 0 },
				       { 0, HUGE_VAL, 0 },
				       { 0, 0, -HUGE_VAL },
				       { 1e300, 0, 0 },
				       { (double)NAN, (double)NAN, (double)NAN } };

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		const struct bb_view v = bb_view_make(&c, bad[i], neutral, NEAR_M, FAR_M);
		assert_int_equal(v.flags, BB_VIEW_HELD);
		assert_true(v.eye.x == 0 && fabs(v.eye.y - 1.7) < 1e-15 && v.eye.z == 0);
		const struct bb_view twice = bb_view_make(&c, bad[i], bad[i], NEAR_M, FAR_M);
		assert_int_equal(twice.flags, BB_VIEW_HELD);
		assert_true(all_finite(&twice) && distance_m(&twice) > 0.5);
	}
}

static void degenerate_corners_never_make_nan(void **ctx)
{
	const struct bb_vec3 o = { 1, 2, 3 }, x = { 2, 2, 3 }, n = { (double)NAN, 0, 0 }, eye = { 1, 2, 5 };
	const struct bb_corners bad[] = { { o, o, o },
					  { o, x, o },
					  { o, o, x },
					  { o, x, { 3, 2, 3 } },
					  { n, x, o },
					  { o, n, x },
					  { o, x, { 1, HUGE_VAL, 3 } },
					  { o, { 1 + 1e-200, 2, 3 }, { 1, 2 + 1e-200, 3 } } };

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		const struct bb_view v = bb_view_make(&bad[i], eye, eye, (double)NAN, -1);
		double ndc[3], w;
		assert_true(v.flags & BB_VIEW_DEGENERATE);
		assert_true(all_finite(&v));
		bb_view_project(&v, v.eye, ndc, &w);
		assert_true(w == 0 && ndc[0] == 0 && isfinite(ndc[2]));
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(corners_map_to_one),
		cmocka_unit_test(tile_corners_map_to_one),
		cmocka_unit_test(projection_agrees_with_matrix),
		cmocka_unit_test(near_and_far_are_the_ends_of_depth),
		cmocka_unit_test(a_leaning_wall_keeps_its_corners),
		cmocka_unit_test(parallax_has_the_right_sign),
		cmocka_unit_test(eyes_lie_on_the_heads_own_axis),
		cmocka_unit_test(bad_heads_are_clamped_and_told),
		cmocka_unit_test(lost_heads_are_held),
		cmocka_unit_test(degenerate_corners_never_make_nan),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
