/* tests/test_geometry.c: hal/geometry: identities over random poses, conventions, and nothing that makes a NaN. */
#include "tests/fixture_room.h"

#define DEG (3.14159265358979323846 / 180.0)

static struct sim_rng rng;

static double draw(double most)
{
	return (2 * sim_rng_uniform(&rng) - 1) * most;
}

static struct bb_vec3 random_vec(double most)
{
	return (struct bb_vec3){ draw(most), draw(most), draw(most) };
}

static struct bb_quat random_quat(void)
{
	return bb_quat_unit((struct bb_quat){ sim_rng_normal(&rng), sim_rng_normal(&rng), sim_rng_normal(&rng),
	                                      sim_rng_normal(&rng) });
}

static double distance(struct bb_vec3 a, struct bb_vec3 b)
{
	return bb_vec3_norm(bb_vec3_sub(a, b));
}

static int setup(void **state)
{
	(void)state;
	sim_rng_seed(&rng, 1, "test", "geometry");
	return 0;
}

static void assert_vec(struct bb_vec3 got, double x, double y, double z)
{
	assert_true(distance(got, (struct bb_vec3){ x, y, z }) < 1e-12);
}

static void conventions(void **state)
{
	const struct bb_vec3 ahead = { 0, 0, -1 }, right = { 1, 0, 0 }, up = { 0, 1, 0 };

	(void)state;
	assert_vec(bb_vec3_cross(right, up), 0, 0, 1); /* right-handed, Z towards the viewer */
	assert_vec(bb_quat_rotate(bb_quat_euler_deg(90, 0, 0), ahead), -1, 0, 0); /* heading turns left */
	assert_vec(bb_quat_rotate(bb_quat_euler_deg(0, 90, 0), ahead), 0, 1, 0);  /* pitch looks up */
	assert_vec(bb_quat_rotate(bb_quat_euler_deg(0, 0, 90), right), 0, 1, 0);  /* roll tips to the left */
	/* Yaw is outermost: heading 90, then nodding, still nods. */
	assert_vec(bb_quat_rotate(bb_quat_euler_deg(90, 90, 0), ahead), 0, 1, 0);
}

static void rotations_are_rigid(void **state)
{
	(void)state;
	for (int i = 0; i < 2000; i++) {
		const struct bb_quat a = random_quat(), b = random_quat();
		const struct bb_vec3 u = random_vec(10), v = random_vec(10);
		const struct bb_vec3 ru = bb_quat_rotate(a, u), rv = bb_quat_rotate(a, v);
		assert_true(fabs(bb_vec3_dot(ru, rv) - bb_vec3_dot(u, v)) < 1e-12 * 400);
		assert_true(distance(bb_quat_rotate(a, bb_vec3_cross(u, v)), bb_vec3_cross(ru, rv)) < 1e-11);
		assert_true(distance(bb_quat_rotate(bb_quat_mul(a, b), u), bb_quat_rotate(a, bb_quat_rotate(b, u))) <
		            1e-12 * 40);
		assert_true(distance(bb_quat_rotate(bb_quat_conj(a), ru), u) < 1e-12 * 40);
	}
}

static void poses_compose_and_invert(void **state)
{
	(void)state;
	for (int i = 0; i < 2000; i++) {
		const struct bb_pose a = { random_vec(10), random_quat() }, b = { random_vec(10), random_quat() };
		const struct bb_pose ab = bb_pose_mul(&a, &b), inverse = bb_pose_inverse(&a);
		const struct bb_vec3 v = random_vec(10), bv = bb_pose_apply(&b, v);
		const struct bb_vec3 av = bb_pose_apply(&a, v);
		assert_true(distance(bb_pose_apply(&ab, v), bb_pose_apply(&a, bv)) < 1e-11);
		assert_true(distance(bb_pose_apply(&inverse, av), v) < 1e-11);
		assert_true(distance(bb_pose_inverse_apply(&a, av), v) < 1e-11);
	}
}

static void angles_are_exact_even_when_small(void **state)
{
	static const double angle[] = { 0, 1e-12, 1e-9, 1e-6, 1e-3, 0.5, 1.5, 3.0, 3.14159265 };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(angle); i++) {
		const struct bb_quat q = random_quat();
		const struct bb_quat turned = bb_quat_mul(bb_quat_axis_angle(random_vec(1), angle[i]), q);
		const struct bb_quat minus = { -turned.x, -turned.y, -turned.z, -turned.w };
		assert_true(fabs(bb_quat_angle(q, turned) - angle[i]) < 1e-15 + 1e-12 * angle[i] + 4e-16);
		assert_true(fabs(bb_quat_angle(q, minus) - bb_quat_angle(q, turned)) < 1e-14);
	}
}

static void slerp_is_even_and_short(void **state)
{
	(void)state;
	for (int i = 0; i < 500; i++) {
		const struct bb_quat a = random_quat(), b = random_quat();
		const double whole = bb_quat_angle(a, b), t = sim_rng_uniform(&rng);
		const struct bb_quat m = bb_quat_slerp(a, b, t);
		assert_true(fabs(bb_quat_angle(a, m) - t * whole) < 1e-9);
		assert_true(fabs(bb_quat_angle(m, b) - (1 - t) * whole) < 1e-9);
	}
}

static void matrices_agree_with_poses(void **state)
{
	(void)state;
	for (int i = 0; i < 500; i++) {
		const struct bb_pose pose = { random_vec(5), random_quat() };
		const struct bb_mat4 m = bb_mat4_from_pose(&pose);
		const struct bb_vec3 v = random_vec(5), want = bb_pose_apply(&pose, v);
		const double in[4] = { v.x, v.y, v.z, 1 };
		double out[4], r[3][3];
		struct bb_mat4 inverse;
		bb_mat4_apply(&m, in, out);
		assert_true(distance((struct bb_vec3){ out[0], out[1], out[2] }, want) < 1e-12);
		assert_true(bb_mat4_inverse(&m, &inverse));
		const struct bb_mat4 one = bb_mat4_mul(&m, &inverse);
		for (int k = 0; k < 16; k++)
			assert_true(fabs(one.m[k] - (k % 5 == 0)) < 1e-12);
		for (int row = 0; row < 3; row++)
			for (int col = 0; col < 3; col++)
				r[row][col] = m.m[col * 4 + row];
		assert_true(bb_quat_angle(bb_quat_from_matrix(r), pose.q) < 1e-12);
	}
	const struct bb_mat4 flat = { { 1 } };
	struct bb_mat4 out = { { 42 } };
	assert_false(bb_mat4_inverse(&flat, &out));
	assert_true(out.m[0] == 42.0);
}

static void half_turns_have_quaternions(void **state)
{
	static const double turn[3][3][3] = { { { 1, 0, 0 }, { 0, -1, 0 }, { 0, 0, -1 } },
		                              { { -1, 0, 0 }, { 0, 1, 0 }, { 0, 0, -1 } },
		                              { { -1, 0, 0 }, { 0, -1, 0 }, { 0, 0, 1 } } };
	(void)state;
	for (int i = 0; i < 3; i++) {
		const struct bb_quat q = bb_quat_from_matrix(turn[i]);
		const double part[3] = { q.x, q.y, q.z };
		assert_true(fabs(fabs(part[i]) - 1) < 1e-15 && fabs(q.w) < 1e-15);
	}
}

static void look_at_looks(void **state)
{
	(void)state;
	for (int i = 0; i < 500; i++) {
		const struct bb_vec3 eye = random_vec(5), target = random_vec(5), up = { 0, 1, 0 };
		const struct bb_pose p = bb_pose_look_at(eye, target, up);
		const struct bb_vec3 local = bb_pose_inverse_apply(&p, target);
		assert_true(fabs(local.x) < 1e-9 && fabs(local.y) < 1e-9 && local.z < 0);
		assert_true(bb_quat_rotate(p.q, (struct bb_vec3){ 1, 0, 0 }).y < 1e-9); /* level */
		assert_true(bb_quat_rotate(p.q, up).y > -1e-12);
	}
}

static bool finite_quat(struct bb_quat q)
{
	return isfinite(q.x + q.y + q.z + q.w) && fabs(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w - 1) < 1e-9;
}

static void degenerate_input_makes_no_nan(void **state)
{
	const struct bb_vec3 zero = { 0, 0, 0 }, up = { 0, 1, 0 }, down = { 0, -3, 0 };
	const double none[3][3] = { { 0 } };
	const struct bb_quat q = random_quat(), minus = { -q.x, -q.y, -q.z, -q.w };

	(void)state;
	assert_true(finite_quat(bb_pose_look_at(zero, zero, up).q));
	assert_true(finite_quat(bb_pose_look_at(zero, down, up).q));
	assert_true(finite_quat(bb_pose_look_at(zero, up, zero).q));
	assert_true(finite_quat(bb_quat_unit((struct bb_quat){ 0, 0, 0, 0 })));
	assert_true(finite_quat(bb_quat_axis_angle(zero, 1)));
	assert_true(finite_quat(bb_quat_from_matrix(none)));
	assert_true(finite_quat(bb_quat_slerp(q, minus, 0.5)));
	assert_true(finite_quat(bb_quat_slerp(BB_QUAT_IDENTITY, (struct bb_quat){ 1, 0, 0, 0 }, 0.5)));
	assert_vec(bb_vec3_unit(zero, up), 0, 1, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup(conventions, setup),
		cmocka_unit_test_setup(rotations_are_rigid, setup),
		cmocka_unit_test_setup(poses_compose_and_invert, setup),
		cmocka_unit_test_setup(angles_are_exact_even_when_small, setup),
		cmocka_unit_test_setup(slerp_is_even_and_short, setup),
		cmocka_unit_test_setup(matrices_agree_with_poses, setup),
		cmocka_unit_test_setup(half_turns_have_quaternions, setup),
		cmocka_unit_test_setup(look_at_looks, setup),
		cmocka_unit_test_setup(degenerate_input_makes_no_nan, setup),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
