/*
 * tests/test_lens.c: both lenses of hal/camera.h: against numbers worked out by hand, against the simulation's own
 * projection, there and back, derivatives, what a ray is worth, hostile coefficients, and the room file's keys.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "sim/sim_camera.h"
#include "sync/track/lens.h"
#include "tests/room_text.h"
#include "tests/track_scene.h"

/* A camera anywhere, with a lens like real ones: wide and tele, barrel and pincushion, a bit askew. */
static struct bb_camera_config any_camera(struct scene_rng *r, bool fisheye)
{
	struct bb_camera_config c = { .width_px = 832, .height_px = 640, .lens = fisheye ? BB_LENS_FISHEYE : BB_LENS_BROWN };

	c.pose.p = (struct bb_vec3){ scene_uniform(r, -5, 5), scene_uniform(r, 0, 3), scene_uniform(r, -5, 5) };
	c.pose.q = scene_any_turn(r);
	c.fx_px = scene_uniform(r, 380, 900);
	c.fy_px = c.fx_px * scene_uniform(r, 0.98, 1.02);
	c.cx_px = scene_uniform(r, 396, 436);
	c.cy_px = scene_uniform(r, 300, 340);
	c.k1 = scene_uniform(r, -0.15, 0.1);
	c.k2 = scene_uniform(r, 0, 0.05);
	c.k3 = scene_uniform(r, -0.002, 0.01);
	if (fisheye)
		c.k4 = scene_uniform(r, -0.002, 0.002);
	else if (scene_u64(r) & 1) {
		c.p1 = scene_uniform(r, -0.002, 0.002);
		c.p2 = scene_uniform(r, -0.002, 0.002);
	}
	return c;
}

/* One point, X/Z = 0.6, Y/Z = -0.8, r = 1: sums of decimals for Brown-Conrady; pi/4 for the fisheye. */
static void numbers_by_hand(void **state)
{
	struct bb_camera_config c = { .pose = BB_POSE_IDENTITY, .width_px = 1000, .height_px = 1000, .fx_px = 100,
		                      .fy_px = 200, .cx_px = 500, .cy_px = 400, .k1 = 0.01, .k2 = 0.02, .k3 = 0.03,
		                      .p1 = 0.001, .p2 = 0.002 };
	const struct bb_vec3 p = { 1.2, -1.6, 2 };
	struct bb_lens lens;
	double px[2];

	(void)state;
	assert_true(bb_lens_init(&lens, &c) && bb_lens_project(&lens, p, px));
	/* x: 0.6 * 1.06 + 2 * 0.001 * -0.48 + 0.002 * (1 + 0.72); y: -0.8 * 1.06 + 0.001 * (1 + 1.28) + 2 * 0.002 * -0.48 */
	assert_true(fabs(px[0] - (500 + 100 * 0.63848)) < 1e-9);
	assert_true(fabs(px[1] - (400 + 200 * -0.84764)) < 1e-9);
	assert_true(sim_camera_pixel(&c, p, px));
	assert_true(fabs(px[0] - (500 + 100 * 0.63848)) < 1e-9 && fabs(px[1] - (400 + 200 * -0.84764)) < 1e-9);
	c.lens = BB_LENS_FISHEYE;
	c.k1 = c.k2 = c.k3 = 0;
	c.k4 = 0.1; /* the tangential coefficients say nothing here */
	const double q = PI / 4, d = q * (1 + 0.1 * pow(q, 8));
	assert_true(bb_lens_init(&lens, &c) && bb_lens_project(&lens, p, px));
	assert_true(fabs(px[0] - (500 + 100 * 0.6 * d)) < 1e-9 && fabs(px[1] - (400 - 200 * 0.8 * d)) < 1e-9);
}

static void there_and_back_and_as_the_simulation(void **state)
{
	struct scene_rng r = { .s = 11 };
	double worst_px = 0, worst_sim_px = 0;
	int used = 0;

	(void)state;
	for (int round = 0; round < 40000; round++) {
		const struct bb_camera_config c = any_camera(&r, round & 1);
		const double x = scene_uniform(&r, 0, 831), y = scene_uniform(&r, 0, 639), far = scene_uniform(&r, 0.3, 9);
		struct bb_lens lens;
		struct bb_ray ray;
		double px[2], sim_px[2];

		assert_true(bb_lens_init(&lens, &c));
		if (!bb_lens_ray(&lens, x, y, &ray))
			continue;
		const struct bb_vec3 p = bb_vec3_add(c.pose.p, bb_vec3_scale(ray.d, far));
		assert_true(fabs(bb_vec3_norm(ray.d) - 1) < 1e-12);
		assert_true(bb_lens_project(&lens, p, px));
		assert_true(sim_camera_pixel(&c, bb_pose_inverse_apply(&c.pose, p), sim_px));
		worst_px = fmax(worst_px, hypot(px[0] - x, px[1] - y));
		worst_sim_px = fmax(worst_sim_px, hypot(px[0] - sim_px[0], px[1] - sim_px[1]));
		used++;
	}
	print_message("[ note ] %d of 40000: there and back %.1e px, the simulation %.1e px\n", used, worst_px, worst_sim_px);
	assert_true(used > 38000 && worst_px < 1e-9 && worst_sim_px < 1e-9);
}

static void derivatives_are_differences(void **state)
{
	struct scene_rng r = { .s = 12 };
	double worst = 0;

	(void)state;
	for (int round = 0; round < 4000; round++) {
		const struct bb_camera_config c = any_camera(&r, round & 1);
		struct bb_lens lens;
		struct bb_ray ray;
		double px[2], jac[2][3];

		assert_true(bb_lens_init(&lens, &c));
		/* the axis itself, too, where a fisheye's formula is 0 / 0 */
		const bool axis = round % 100 < 2;
		if (!bb_lens_ray(&lens, axis ? c.cx_px : scene_uniform(&r, 9, 822), axis ? c.cy_px : scene_uniform(&r, 9, 630),
		                 &ray))
			continue;
		const struct bb_vec3 p = bb_vec3_add(c.pose.p, bb_vec3_scale(ray.d, scene_uniform(&r, 0.5, 6)));
		assert_true(bb_lens_derive(&lens, p, px, jac));
		for (int k = 0; k < 3; k++) {
			const double h = 1e-5;
			const struct bb_vec3 step = { k == 0 ? h : 0, k == 1 ? h : 0, k == 2 ? h : 0 };
			double ahead[2], behind[2];
			if (!bb_lens_project(&lens, bb_vec3_add(p, step), ahead) ||
			    !bb_lens_project(&lens, bb_vec3_sub(p, step), behind))
				continue;
			for (int i = 0; i < 2; i++)
				worst = fmax(worst, fabs((ahead[i] - behind[i]) / (2 * h) - jac[i][k]) / (1 + fabs(jac[i][k])));
		}
	}
	print_message("[ note ] worst relative difference %.1e\n", worst);
	assert_true(worst < 1e-6);
}

/* sigma_rad against the farthest of 64 rays 1e-4 px around. */
static void a_ray_says_what_a_pixel_is_worth(void **state)
{
	struct scene_rng r = { .s = 13 };
	double worst = 0;

	(void)state;
	for (int round = 0; round < 500; round++) {
		struct bb_camera_config c = any_camera(&r, round & 1);
		const double x = scene_uniform(&r, 9, 822), y = scene_uniform(&r, 9, 630);
		struct bb_lens lens;
		struct bb_ray ray, beside;
		double most = 0;

		c.fy_px = c.fx_px; /* else the smaller of them is taken for both */
		assert_true(bb_lens_init(&lens, &c));
		if (!bb_lens_ray(&lens, x, y, &ray))
			continue;
		for (int i = 0; i < 64; i++)
			if (bb_lens_ray(&lens, x + 1e-4 * cos(i * PI / 32), y + 1e-4 * sin(i * PI / 32), &beside))
				most = fmax(most, bb_vec3_norm(bb_vec3_sub(beside.d, ray.d)) / 1e-4);
		worst = fmax(worst, fabs(most / ray.sigma_rad - 1));
	}
	print_message("[ note ] worst relative difference %.1e\n", worst);
	assert_true(worst < 2e-3);
}

static double any_coefficient(struct scene_rng *r)
{
	static const double evil[] = { 0, -0.0, 1e-300, 1e9, -1e9, 1e8, -1e-9, 1e300, -1e308 };
	const unsigned kind = (unsigned)(scene_u64(r) % 40);

	if (kind < BB_ARRAY_LEN(evil))
		return evil[kind];
	if (kind == 30)
		return kind & 1 ? (double)NAN : (double)INFINITY;
	return scene_normal(r) * pow(10, scene_uniform(r, -6, 2));
}

/* Whatever the coefficients: what is projected comes back as the same direction, and nothing is not finite. */
static void trust_ends_where_the_lens_folds(void **state)
{
	struct scene_rng r = { .s = 14 };
	int cameras = 0, points = 0, odd = 0;
	double worst = 0;

	(void)state;
	for (int round = 0; round < 20000; round++) {
		struct bb_camera_config c = any_camera(&r, round & 1);
		struct bb_lens lens;

		c.pose = BB_POSE_IDENTITY;
		c.k1 = any_coefficient(&r);
		c.k2 = any_coefficient(&r);
		c.k3 = any_coefficient(&r);
		c.k4 = any_coefficient(&r);
		c.p1 = scene_u64(&r) & 1 ? any_coefficient(&r) : 0;
		c.p2 = scene_u64(&r) & 1 ? any_coefficient(&r) : 0;
		if (!bb_lens_init(&lens, &c))
			continue;
		cameras++;
		assert_true(lens.radius_max > 0 && lens.radius_max < 20);
		for (int i = 0; i < 20; i++) {
			const double at = lens.radius_max * scene_uniform(&r, 0, 1.5), turn = scene_uniform(&r, 0, 2 * PI);
			const struct bb_vec3 p = { at * cos(turn), at * sin(turn), 1 };
			struct bb_ray ray;
			double px[2], jac[2][3];
			const bool seen = bb_lens_derive(&lens, p, px, jac);
			assert_int_equal(seen, at <= lens.radius_max);
			if (!seen)
				continue;
			assert_true(isfinite(px[0] + px[1] + jac[0][0] + jac[1][2]));
			points++;
			if (!bb_lens_ray(&lens, px[0], px[1], &ray)) {
				odd++;
				continue;
			}
			assert_true(isfinite(ray.sigma_rad) && ray.sigma_rad > 0);
			/* as many digits as the lens leaves: pixels there are worth sigma_rad */
			const double lost = bb_vec3_norm(bb_vec3_cross(ray.d, bb_vec3_unit(p, p)));
			worst = fmax(worst, lost / (1e-9 + 1e-9 * ray.sigma_rad * (1 + hypot(px[0], px[1]))));
		}
	}
	print_message("[ note ] %d cameras, %d points, %d refused, %.2g of the tolerance\n", cameras, points, odd, worst);
	assert_true(cameras > 5000 && odd == 0 && worst < 1e-3);
}

static void tangential_distortion_has_its_own_limit(void **state)
{
	struct bb_camera_config c =
		scene_camera((struct bb_vec3){ 0, 0, 0 }, (struct bb_vec3){ 0, 0, 1 }, 640, 480, 90, 0, 0);
	struct bb_lens lens;
	struct bb_ray ray;

	(void)state;
	c.pose = BB_POSE_IDENTITY;
	c.p2 = 0.1; /* x + 0.3 x^2 along the axis turns back at x = -1 / 0.6 */
	assert_true(bb_lens_init(&lens, &c));
	assert_true(fabs(lens.radius_max - 0.999 / 0.6) < 1e-9);
	const double turn = -1 / 0.6 + 0.3 / 0.36;
	assert_true(bb_lens_ray(&lens, c.cx_px + c.fx_px * (turn + 0.001), c.cy_px, &ray));
	assert_false(bb_lens_ray(&lens, c.cx_px + c.fx_px * (turn - 0.001), c.cy_px, &ray));
}

#define ROOM(camera) \
	"room: t\nnodes: [{id: a}]\nwalls:\n  - {id: w, node: a, pixels: [100, 100], corners_m: {lower_left: [-1, 0, -1], " \
	"lower_right: [1, 0, -1], upper_left: [-1, 2, -1]}}\ncameras:\n" \
	"  - {id: c, position_m: [0, 1, 1], look_at_m: [0, 1, 0], pixels: [640, 480], " camera "}\n"

static void a_room_says_what_its_lenses_are(void **state)
{
	struct bb_error err = { 0 };
	struct bb_room *room = room_from(ROOM("lens: fisheye, fov_deg: 120, k1: 0.02, k4: 0.001, centre_px: [300, 250]"), &err);

	(void)state;
	assert_non_null(room);
	const struct bb_camera_config *c = &room->cameras[0];
	assert_int_equal(c->lens, BB_LENS_FISHEYE);
	assert_true(fabs(c->fx_px - 320 / (PI / 3)) < 1e-9 && c->cx_px == 300 && c->cy_px == 250 && c->k4 == 0.001);
	/* the right edge is 339 px off the axis: 63 degrees by the angle, 45 by its tangent */
	assert_true(bb_camera_sees(c, (struct bb_vec3){ tan(PI * 60 / 180), 1, 0 }, 0));
	assert_false(bb_camera_sees(c, (struct bb_vec3){ tan(PI * 65 / 180), 1, 0 }, 0));
	bb_room_free(room);
	room = room_from(ROOM("focal_px: 500, k3: -0.01, p1: 0.001, p2: -0.002, readout_us: 2000, row_us: 8"), &err);
	assert_non_null(room);
	c = &room->cameras[0];
	assert_true(c->lens == BB_LENS_BROWN && c->fx_px == 500 && c->fy_px == 500 && c->cx_px == 319.5 && c->k3 == -0.01 && c->row_us == 8);
	assert_true(fabs(c->fov_deg - 2 * atan(0.64) * 180 / PI) < 1e-9 && c->p1 == 0.001 && c->p2 == -0.002);
	bb_room_free(room);
}

static void impossible_lenses_are_refused(void **state)
{
	static const struct {
		int number;
		const char *text;
	} cases[] = {
		{ 1110, ROOM("k4: 0.1") },
		{ 1110, ROOM("lens: fisheye, p1: 0.01") },
		{ 1110, ROOM("focal_px: 500, fov_deg: 60") },
		{ 1110, ROOM("focal_px: 2") },
		{ 1110, ROOM("centre_px: [-20, 240]") },
		{ 1110, ROOM("readout_us: 2000, row_us: 9") },
		{ 1110, ROOM("fov_deg: 100, k1: -0.4") },
		{ 1110, ROOM("fov_deg: 100, k3: -0.2") },
		{ 1110, ROOM("fov_deg: 130, p1: 0.1") },
		{ 1110, ROOM("lens: fisheye, fov_deg: 140, k1: -0.3") },
		{ 1013, ROOM("k3: 3") },
		{ 1012, ROOM("p2: nan") },
		{ 1012, ROOM("lens: pinhole") },
		{ 1019, ROOM("centre_px: 3") },
	};

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		struct bb_error err = { 0 };
		struct bb_room *room = room_from(cases[i].text, &err);
		if (room || err.number != cases[i].number)
			print_error("case %zu: want %d, got %s\n", i, cases[i].number, room ? "a room" : err.text);
		assert_null(room);
		assert_int_equal(err.number, cases[i].number);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(numbers_by_hand),
		cmocka_unit_test(there_and_back_and_as_the_simulation),
		cmocka_unit_test(derivatives_are_differences),
		cmocka_unit_test(a_ray_says_what_a_pixel_is_worth),
		cmocka_unit_test(trust_ends_where_the_lens_folds),
		cmocka_unit_test(tangential_distortion_has_its_own_limit),
		cmocka_unit_test(a_room_says_what_its_lenses_are),
		cmocka_unit_test(impossible_lenses_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
