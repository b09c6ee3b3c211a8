/* tests/test_path.c: head paths: exactness at keys, no overshoot, the committed walk's speed, turning and bounds. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "hal/scene.h"

static struct bb_path *load_text(const char *text)
{
	char name[] = "/tmp/bb-path-XXXXXX";
	struct bb_error err = { 0 };
	struct bb_path *path = NULL;
	const int fd = mkstemp(name);
	FILE *f = fdopen(fd, "w");

	assert_non_null(f);
	fputs(text, f);
	fclose(f);
	if (bb_path_load(name, &path, &err))
		print_error("%s\n", err.text);
	unlink(name);
	assert_non_null(path);
	return path;
}

static void keys_are_met(void **state)
{
	struct bb_path *p = load_text("0 0 1 0 0 0 0 # at rest\n1 1 1.5 -1 90 10 0\n\n3 0 1 0 0 0 0\n");
	const struct bb_pose mid = bb_path_at(p, 1000000000), before = bb_path_at(p, -5), after = bb_path_at(p, INT64_MAX);

	(void)state;
	assert_true(fabs(mid.p.x - 1) < 1e-12 && fabs(mid.p.y - 1.5) < 1e-12 && fabs(mid.p.z + 1) < 1e-12);
	assert_true(bb_quat_angle(mid.q, bb_quat_euler_deg(90, 10, 0)) < 1e-12);
	assert_true(before.p.x == 0 && fabs(after.p.x) < 1e-12);
	assert_int_equal(bb_path_duration_ns(p), 3000000000);
	bb_path_free(p);
}

/* Steps 0 0 1 1: Catmull-Rom would undershoot by 2/27. */
static void never_overshoots(void **state)
{
	struct bb_path *p = load_text("0 0 0 0 0 0 0\n1 0 0 0 0 0 0\n2 1 0 0 0 0 0\n3 1 0 0 0 0 0\n4 0.2 0 0 0 0 0\n");
	double last = 0;

	(void)state;
	for (int64_t t = 0; t <= 3000000000; t += 1000000) {
		const double x = bb_path_at(p, t).p.x;
		assert_true(x >= last - 1e-15 && x <= 1);
		last = x;
	}
	bb_path_free(p);
}

static void yaw_takes_the_short_way(void **state)
{
	struct bb_path *p = load_text("0 0 0 0 170 0 0\n1 0 0 0 -170 0 0\n2 0 0 0 -150 0 0\n");
	const struct bb_quat half = bb_path_at(p, 500000000).q;

	(void)state;
	assert_true(bb_quat_angle(half, bb_quat_euler_deg(180, 0, 0)) < 0.1);
	bb_path_free(p);
}

static void speed_is_continuous(void **state)
{
	struct bb_error err = { 0 };
	struct bb_path *p;
	struct bb_vec3 last = { 0, 0, 0 };
	const int64_t dt = 1000000;

	(void)state;
	assert_int_equal(bb_path_load("scenes/walk.path", &p, &err), BB_OK);
	for (int64_t t = 0; t < 20000000000; t += dt) {
		const struct bb_vec3 v = bb_vec3_scale(bb_vec3_sub(bb_path_at(p, t + dt).p, bb_path_at(p, t).p), 1e9 / (double)dt);
		if (t)
			assert_true(bb_vec3_norm(bb_vec3_sub(v, last)) < 0.05); /* 50 m/s2 at most between two ms */
		last = v;
	}
	bb_path_free(p);
}

static void measure(const struct bb_path *p, int64_t from_ns, int64_t to_ns, double *speed, double *turn)
{
	const int64_t dt = 1000000;
	double v2 = 0, w2 = 0, n = 0;

	for (int64_t t = from_ns; t + dt <= to_ns; t += dt, n++) {
		const struct bb_pose a = bb_path_at(p, t), b = bb_path_at(p, t + dt);
		v2 += pow(bb_vec3_norm(bb_vec3_sub(b.p, a.p)) * 1e9 / (double)dt, 2);
		w2 += pow(bb_quat_angle(a.q, b.q) * 57.29577951308232 * 1e9 / (double)dt, 2);
	}
	*speed = sqrt(v2 / n);
	*turn = sqrt(w2 / n);
}

static void the_walk_is_lively_and_stays_inside(void **state)
{
	struct bb_error err = { 0 };
	double speed, turn, low = 9, high = 0, out = 0;
	struct bb_path *p;

	(void)state;
	assert_int_equal(bb_path_load("scenes/walk.path", &p, &err), BB_OK);
	for (int64_t t = 0; t <= bb_path_duration_ns(p); t += 1000000) {
		const struct bb_vec3 at = bb_path_at(p, t).p;
		low = fmin(low, at.y);
		high = fmax(high, at.y);
		out = fmax(out, fmax(fabs(at.x), fabs(at.z)));
	}
	measure(p, 0, 10000000000, &speed, &turn);
	print_message("first 10 s: %.2f m/s, %.1f deg/s rms\n", speed, turn);
	assert_true(speed >= 0.4 && turn >= 40);
	measure(p, 0, bb_path_duration_ns(p), &speed, &turn);
	print_message("all %.0f s: %.2f m/s, %.1f deg/s rms; |x|,|z| <= %.3f, y %.3f .. %.3f\n",
	              (double)bb_path_duration_ns(p) * 1e-9, speed, turn, out, low, high);
	assert_true(speed >= 0.4 && turn >= 40);
	assert_true(out <= 0.55 && low >= 1.1 && high <= 1.8);
	assert_true(high - low > 0.3); /* the crouch */
	bb_path_free(p);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(keys_are_met),          cmocka_unit_test(never_overshoots),
		cmocka_unit_test(yaw_takes_the_short_way), cmocka_unit_test(speed_is_continuous),
		cmocka_unit_test(the_walk_is_lively_and_stays_inside),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
