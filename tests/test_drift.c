/*
 * tests/test_drift.c: row K9: a knocked camera is told after 2 s, it alone, by how many pixels and which way; what is not
 * a knock (nothing, occlusion, strays, bent glasses, a covered lens) is not told.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>

#include "sync/calibrate/drift.h"
#include "tests/track_scene.h"

#define MS INT64_C(1000000)
#define FRAME_NS (8 * MS)
#define KNOCK_S 6.0

struct rig {
	struct scene scene;
	struct bb_camera_config known[SCENE_CAMERAS_MAX]; /* as calibrated */
	struct bb_body body;                              /* as measured */
	struct bb_tracker *tracker;
	struct bb_drift *drift;
	int64_t now_ns;
	uint64_t fed;
};

static void set_up(struct rig *r, size_t n, const double *baseline_px)
{
	memset(r, 0, sizeof(*r));
	scene_room(&r->scene, n, 0.1);
	r->scene.occlude = true;
	memcpy(r->known, r->scene.cameras, sizeof(r->known));
	struct bb_tracker_config config = scene_config(&r->scene);
	r->body = r->scene.bodies[0];
	config.cameras = r->known;
	config.bodies = &r->body;
	assert_int_equal(bb_tracker_create(&config, &r->tracker), BB_OK);
	const struct bb_drift_config watch = {
		.cameras = r->known, .n_cameras = n, .noise_px = 0.05, .baseline_px = baseline_px
	};
	assert_int_equal(bb_drift_create(&watch, &r->drift), BB_OK);
}

static void tear_down(struct rig *r)
{
	bb_tracker_destroy(r->tracker);
	bb_drift_destroy(r->drift);
}

/* As a loop would: what has drifted goes to the watch only. */
static void run_until(struct rig *r, double s)
{
	static struct bb_blob blobs[SCENE_CAMERAS_MAX][BB_CAMERA_BLOBS_MAX];
	size_t n[SCENE_CAMERAS_MAX];

	for (; (double)r->now_ns < s * 1e9; r->now_ns += FRAME_NS) {
		r->scene.pose[0] = scene_walk((double)r->now_ns * 1e-9);
		for (size_t i = 0; i < r->scene.n_cameras; i++) {
			unsigned visible[2];
			n[i] = scene_frame(&r->scene, i, blobs[i], visible);
			bb_tracker_frame(r->tracker, i, r->now_ns + FRAME_NS, blobs[i],
			                 bb_drift_weight(r->drift, i) > 0 ? n[i] : 0);
		}
		bb_tracker_solve(r->tracker, true, 0, NULL, 0);
		const struct bb_track_pose pose = bb_tracker_pose(r->tracker, 0, r->now_ns + FRAME_NS);
		if (!(pose.flags & BB_TRACK_FRESH))
			continue;
		r->fed++;
		for (size_t i = 0; i < r->scene.n_cameras; i++)
			bb_drift_frame(r->drift, i, r->now_ns + FRAME_NS, &pose.body, &r->body, blobs[i], n[i]);
	}
}

static void turn(struct rig *r, size_t camera, double deg)
{
	const struct bb_quat by = bb_quat_axis_angle((struct bb_vec3){ 0, 1, 0 }, deg * PI / 180); /* camera space: a pan */

	r->scene.cameras[camera].pose.q = bb_quat_mul(r->known[camera].pose.q, by);
}

static size_t accused(const struct rig *r)
{
	size_t n = 0;

	for (size_t i = 0; i < r->scene.n_cameras; i++)
		n += bb_drift_state(r->drift, i).drifted;
	return n;
}

static void a_knock_is_told_after_two_seconds(void **state)
{
	static const double knock_deg[] = { 0.08, -0.3, 1, -2, 5 };

	(void)state;
	for (size_t k = 0; k < BB_ARRAY_LEN(knock_deg); k++) {
		const size_t camera = 1 + k;
		struct rig r;

		set_up(&r, 8, NULL);
		run_until(&r, KNOCK_S);
		assert_int_equal(accused(&r), 0);
		turn(&r, camera, knock_deg[k]);
		run_until(&r, KNOCK_S + 6);
		const struct bb_drift_state s = bb_drift_state(r.drift, camera);
		const double told_s = (double)s.drifted_ns * 1e-9 - KNOCK_S;
		/* turned by a degree to the right, everything moves left by f times it, more or less, by the lens */
		const double want_px = -r.known[camera].fx_px * knock_deg[k] * PI / 180;
		print_message("[ note ] %5.2f deg: told after %.2f s, %.2f px (baseline %.3f), shift %.2f %.2f px, %.2f foreseen\n",
		              knock_deg[k], told_s, s.rms_px, s.baseline_px, s.shift_px[0], s.shift_px[1], want_px);
		assert_true(s.drifted && bb_drift_weight(r.drift, camera) == 0);
		assert_true(told_s > 1.99 && told_s < 2.5);
		assert_true(s.shift_px[0] / want_px > 0.6 && s.shift_px[0] / want_px < 1.4);
		assert_int_equal(accused(&r), 1);
		tear_down(&r);
	}
}

static void put_back_it_settles_and_is_forgiven(void **state)
{
	struct rig r;

	(void)state;
	set_up(&r, 8, NULL);
	run_until(&r, KNOCK_S);
	turn(&r, 2, 1);
	run_until(&r, KNOCK_S + 4);
	assert_true(bb_drift_state(r.drift, 2).drifted && !bb_drift_state(r.drift, 2).settled);
	turn(&r, 2, 0);
	run_until(&r, KNOCK_S + 5);
	assert_false(bb_drift_state(r.drift, 2).settled);
	run_until(&r, KNOCK_S + 8);
	assert_true(bb_drift_state(r.drift, 2).drifted && bb_drift_state(r.drift, 2).settled);
	bb_drift_forgive(r.drift, 2);
	assert_true(bb_drift_weight(r.drift, 2) == 1);
	run_until(&r, KNOCK_S + 14);
	assert_int_equal(accused(&r), 0);
	tear_down(&r);
}

static void two_knocks_are_told_one_after_the_other(void **state)
{
	struct rig r;

	(void)state;
	set_up(&r, 8, NULL);
	run_until(&r, KNOCK_S);
	turn(&r, 2, 0.5);
	turn(&r, 5, -1);
	run_until(&r, KNOCK_S + 12);
	const int64_t a = bb_drift_state(r.drift, 2).drifted_ns, b = bb_drift_state(r.drift, 5).drifted_ns;
	assert_true(a > 0 && b > 0 && llabs(a - b) >= 2000 * MS);
	assert_int_equal(accused(&r), 2);
	tear_down(&r);
}

static void a_calibration_that_was_never_true_is_told(void **state)
{
	const double baseline_px[8] = { 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1 };
	struct rig r;

	(void)state;
	set_up(&r, 8, baseline_px);
	turn(&r, 6, 0.2);
	run_until(&r, 6);
	assert_true(bb_drift_state(r.drift, 6).drifted);
	assert_int_equal(accused(&r), 1);
	tear_down(&r);
}

/* Without a tracker: cameras of which one is off by a pixel and pulls the pose so that all others are off, too. */
static void the_worst_alone_is_accused(void **state)
{
	const double baseline_px[4] = { 0.1, 0.1, 0.1, 0.1 };
	struct rig r;

	(void)state;
	set_up(&r, 4, baseline_px);
	r.scene.occlude = false;
	r.scene.pose[0] = (struct bb_pose){ { 0, 1.4, 0 }, BB_QUAT_IDENTITY };
	for (int64_t t = 0; t < 3000 * MS; t += FRAME_NS)
		for (size_t i = 0; i < 4; i++) {
			struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
			unsigned visible[2];
			const size_t n = scene_frame(&r.scene, i, blobs, visible);
			for (size_t k = 0; k < n; k++)
				blobs[k].x_px += i == 2 ? 1.0f : 0.4f;
			bb_drift_frame(r.drift, i, 1 + t, &r.scene.pose[0], &r.body, blobs, n);
		}
	assert_true(bb_drift_state(r.drift, 2).drifted);
	assert_int_equal(accused(&r), 1);
	tear_down(&r);
}

static void what_is_no_knock_is_not_told(void **state)
{
	for (int what = 0; what < 6; what++) {
		struct rig r;

		(void)state;
		set_up(&r, 8, NULL);
		run_until(&r, KNOCK_S);
		if (what == 1 || what == 5) /* 5: one that sees strays only */
			r.scene.strays = 12;
		if (what == 2 || what == 5)
			r.scene.dark_cameras = 1u << 4;
		if (what == 3) /* bent by 4 mm */
			r.scene.bodies[0].marker[2].y += 0.004;
		if (what == 4)
			r.scene.patchy = true;
		run_until(&r, KNOCK_S + 8);
		if (accused(&r))
			print_error("case %d\n", what);
		assert_int_equal(accused(&r), 0);
		assert_true(r.fed > 1000);
		tear_down(&r);
	}
}

static void nonsense_is_survived(void **state)
{
	const struct bb_blob odd[3] = { { NAN, 1, 1 }, { INFINITY, -INFINITY, 1 }, { 1e30f, 1e30f, 1 } };
	struct rig r;
	struct bb_drift *none = NULL;
	struct bb_drift_config bad = { .n_cameras = 1, .noise_px = 0.05 };
	struct bb_camera_config camera = { .fx_px = -1 };

	(void)state;
	bad.cameras = &camera;
	assert_int_equal(bb_drift_create(&bad, &none), BB_ERR_CONFIG);
	bad.noise_px = (double)NAN;
	assert_int_equal(bb_drift_create(&bad, &none), BB_ERR_USAGE);
	assert_null(none);
	bb_drift_destroy(NULL);
	set_up(&r, 4, NULL);
	run_until(&r, 1);
	for (int i = 0; i < 100; i++) {
		bb_drift_frame(r.drift, 0, r.now_ns, &BB_POSE_IDENTITY, &r.scene.bodies[0], odd, 3);
		bb_drift_frame(r.drift, 99, r.now_ns, &BB_POSE_IDENTITY, &r.scene.bodies[0], odd, 3);
		bb_drift_frame(r.drift, 0, r.now_ns - 5000 * MS, &r.scene.pose[0], &r.scene.bodies[0], NULL, 0);
	}
	run_until(&r, 6);
	assert_int_equal(accused(&r), 0);
	assert_true(isfinite(bb_drift_state(r.drift, 0).rms_px) && bb_drift_state(r.drift, 0).baseline_px > 0.05);
	tear_down(&r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_knock_is_told_after_two_seconds),
		cmocka_unit_test(put_back_it_settles_and_is_forgiven),
		cmocka_unit_test(two_knocks_are_told_one_after_the_other),
		cmocka_unit_test(a_calibration_that_was_never_true_is_told),
		cmocka_unit_test(the_worst_alone_is_accused),
		cmocka_unit_test(what_is_no_knock_is_not_told),
		cmocka_unit_test(nonsense_is_survived),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
