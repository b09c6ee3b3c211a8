/*
 * tests/test_pads.c: what a frame loop makes of a gamepad: motion that comes down within 200 ms when the pad falls silent
 * or goes (row H2), warnings by name of a stuck axis and a low battery (row H5), and samples for budgets on them.
 */
#include "tests/sim_rig.h"

#include "bench/loop/loop.h"
#include "sim/sim_gamepad.h"

#include <math.h>
#include <stdio.h>
#include <unistd.h>

#define FRAME_NS (RIG_S / 60)

struct bench {
	struct rig *rig;
	struct bb_gamepad_config config;
	struct bb_gamepad *g;
	struct bb_rig devices;
	struct bb_frame_loop loop;
	struct bb_scene scene;
	size_t slot;
};

/* The left stick forward all the time, unless the script says otherwise. */
static struct bench *begin_with(enum bb_pad_model model, const char *script)
{
	struct bench *b = calloc(1, sizeof(*b));
	char path[] = "/tmp/bb-pad-XXXXXX";
	const int fd = mkstemp(path);

	assert_true(b && fd >= 0);
	assert_int_equal(write(fd, script, strlen(script)), (ssize_t)strlen(script));
	close(fd);
	b->rig = rig_create(7, 1);
	b->config = (struct bb_gamepad_config){ .id = "pad", .model = model };
	snprintf(b->config.script, sizeof(b->config.script), "%s", path);
	assert_int_equal(bb_gamepad_open(&sim_gamepad_driver, &b->config, &b->rig->open, &b->g), BB_OK);
	unlink(path);
	b->rig->room.n_gamepads = 1;
	b->rig->room.gamepads = &b->config;
	b->devices.gamepads = &b->g;
	b->loop = (struct bb_frame_loop){ .room = &b->rig->room, .scene = &b->scene, .rig = &b->devices, .gamepad_slot = &b->slot,
		                          .navigation = { { 0, 0, 0 }, BB_QUAT_IDENTITY } };
	b->loop.pads = calloc(1, sizeof(*b->loop.pads));
	assert_int_equal(bb_ledger_create(2000, 1, &b->loop.ledger), BB_OK);
	assert_int_equal(bb_watch_create(1, b->rig->events, RIG_S / 10, &b->loop.watch), BB_OK);
	b->slot = bb_watch_slot(b->loop.watch, "gamepad", "pad");
	return b;
}

static struct bench *begin(const char *script)
{
	return begin_with(BB_PAD_RUMBLEPAD2, script);
}

static void end(struct bench *b)
{
	bb_gamepad_close(b->g);
	bb_watch_destroy(b->loop.watch);
	bb_ledger_destroy(b->loop.ledger);
	free(b->loop.pads);
	rig_destroy(b->rig);
	free(b);
}

/* One frame; returns how fast the viewer moved in it, m/s. */
static double frame(struct bench *b)
{
	const struct bb_vec3 was = b->loop.navigation.p;

	rig_pass(b->rig, FRAME_NS);
	bb_pads_read(&b->loop, rig_now(b->rig));
	b->loop.n_frames++;
	const double speed = bb_vec3_norm(bb_vec3_sub(b->loop.navigation.p, was)) * 60;
	b->loop.navigation = (struct bb_pose){ { 0, 0, 0 }, BB_QUAT_IDENTITY }; /* never at the end of the way */
	return speed;
}

static void frames(struct bench *b, int n)
{
	while (n--)
		(void)frame(b);
}

static const struct bb_incident *incident(struct bench *b, const char *what)
{
	const struct bb_incident *in;
	const size_t n = bb_watch_incidents(b->loop.watch, &in);

	for (size_t i = 0; i < n; i++)
		if (strstr(in[i].what, what))
			return &in[i];
	return NULL;
}

/* From the frame that notices it on: never faster than before, still moving after 100 ms, still after 200 ms. */
static void comes_down(struct bench *b, double full)
{
	double last = full;

	for (int i = 0; i <= 12; i++) {
		const double speed = frame(b), want = full * fmax(0, 1 - i * (double)FRAME_NS * 1e-9 / 0.2);
		assert_true(fabs(speed - want) < 1e-6 + full * 1e-3);
		assert_true(speed <= last + 1e-9);
		last = speed;
	}
	for (int i = 0; i < 60; i++)
		assert_true(frame(b) <= 0);
}

static void silence_lets_the_motion_run_out(void **state)
{
	struct bench *b = begin("0.1 axis 2 -1 0\n");
	double full = 0;
	int held = 0;

	(void)state;
	frames(b, 60);
	full = frame(b);
	assert_true(fabs(full - 0.15) < 1e-3);
	assert_int_equal(rig_fault(b->rig, "gamepad", "pad", "silence", "", true), BB_OK);
	for (; rig_now(b->rig) + FRAME_NS - b->loop.pads[0].report.at_ns <= 250 * RIG_MS; held++)
		assert_true(fabs(frame(b) - full) < 1e-9);
	assert_in_range(held, 13, 15);
	comes_down(b, full);
	assert_non_null(incident(b, "silent for"));
	assert_int_equal(rig_fault(b->rig, "gamepad", "pad", "silence", "", false), BB_OK);
	frames(b, 2);
	assert_true(fabs(frame(b) - full) < 1e-9); /* any report brings it back */
	end(b);
}

static void unplug_ends_the_motion_with_the_frame(void **state)
{
	struct bench *b = begin("0.1 axis 2 -1 0\n1.5 axis 2 0 0\n");

	(void)state;
	frames(b, 60);
	assert_true(fabs(frame(b) - 0.15) < 1e-3);
	assert_int_equal(rig_fault(b->rig, "gamepad", "pad", "unplug", "", true), BB_OK);
	assert_true(frame(b) <= 0);
	assert_non_null(incident(b, "gone:"));
	/* Back, and the hand has left the stick: nothing moves, and that is in order. */
	assert_int_equal(rig_fault(b->rig, "gamepad", "pad", "unplug", "", false), BB_OK);
	for (int i = 0; i < 60; i++)
		assert_true(frame(b) <= 0);
	assert_int_equal(bb_watch_health(b->loop.watch, b->slot), BB_HEALTH_OK);
	end(b);
}

static double worst(struct bench *b, enum bb_metric metric, enum bb_stat stat)
{
	const struct bb_summary s = bb_ledger_metric(b->loop.ledger, metric);

	return bb_summary_stat(&s, stat);
}

static void a_stuck_axis_is_told_by_name(void **state)
{
	struct bench *b = begin("0.1 axis 2 -1 0\n3 axis 2 0 0\n3.5 axis 1 0.5 0.5\n4.5 axis 1 0 0.5\n");

	(void)state;
	frames(b, 60);
	assert_int_equal(rig_fault(b->rig, "gamepad", "pad", "stick_axis", "axis=3 value=0.4", true), BB_OK);
	frames(b, 9 * 60);
	assert_null(incident(b, "PAD_DRIFT"));
	frames(b, 2 * 60);
	const struct bb_incident *in = incident(b, "PAD_DRIFT axis 3");
	assert_non_null(in);
	assert_string_equal(in->state, "WARNING");
	assert_string_equal(in->culprit, "gamepad/pad");
	assert_in_range(in->from_ns, 11 * RIG_S, 11 * RIG_S + 100 * RIG_MS);
	assert_true(worst(b, BB_METRIC_PAD_STUCK, BB_STAT_MAX) >= 10.5);
	assert_int_equal(bb_watch_health(b->loop.watch, b->slot), BB_HEALTH_OK); /* a warning is no failure */
	assert_int_equal(rig_fault(b->rig, "gamepad", "pad", "stick_axis", "axis=3 value=0.4", false), BB_OK);
	frames(b, 3 * 60);
	assert_true(in->to_ns > 12 * RIG_S && in->to_ns < 12500 * RIG_MS);
	const struct bb_incident *all;
	assert_int_equal(bb_watch_incidents(b->loop.watch, &all), 1); /* told once */
	end(b);
}

/* Holding the stick for nine seconds is walking; at rest nothing is stuck however long. */
static void a_hand_is_not_a_stuck_axis(void **state)
{
	struct bench *b = begin("0.1 axis 2 -1 0\n9.1 axis 2 0 0\n");

	(void)state;
	frames(b, 30 * 60);
	assert_null(incident(b, ""));
	assert_true(worst(b, BB_METRIC_PAD_STUCK, BB_STAT_MAX) < 9.1);
	end(b);
}

static void a_low_battery_is_told_by_name(void **state)
{
	struct bench *b = begin_with(BB_PAD_XBOX360, "0 battery 0.5\n0.1 axis 2 -1 0\n2 battery 0.16\n3 battery 0.14\n4 battery 0.05\n");

	(void)state;
	frames(b, 175);
	assert_null(incident(b, "PAD_BATTERY"));
	frames(b, 120);
	assert_non_null(incident(b, "PAD_BATTERY low: 14 %"));
	assert_null(incident(b, "5 %"));
	assert_true(fabs(worst(b, BB_METRIC_PAD_BATTERY, BB_STAT_MIN) - 5) < 1e-4);
	end(b);
}

/* Where the viewer goes with the stick ahead, by where the head is turned: degrees; the first frame after half a second. */
static struct bb_vec3 goes(enum bb_steer by, bool space, double yaw, double pitch, double roll)
{
	struct bench *b = begin_with(space ? BB_PAD_SPACEMOUSE : BB_PAD_RUMBLEPAD2, space ? "0.1 axis 3 -1 0\n" : "0.1 axis 2 -1 0\n");

	b->scene.steer_by = (int)by;
	b->loop.steady.last = (struct bb_pose){ { 0, 1.6, 0 }, bb_quat_euler_deg(yaw, pitch, roll) };
	frames(b, 30);
	rig_pass(b->rig, FRAME_NS);
	bb_pads_read(&b->loop, rig_now(b->rig));
	const struct bb_vec3 p = b->loop.navigation.p;
	end(b);
	return bb_vec3_unit(p, (struct bb_vec3){ 0, 0, 0 });
}

static void close_to(struct bb_vec3 p, double x, double y, double z, double within)
{
	const double off = bb_vec3_norm(bb_vec3_sub(p, (struct bb_vec3){ x, y, z }));

	if (!(off <= within))
		fail_msg("goes %.3f %.3f %.3f, want %.3f %.3f %.3f", p.x, p.y, p.z, x, y, z);
}

static void the_head_steers(void **state)
{
	const double h = sqrt(0.5);

	(void)state;
	for (int space = 0; space < 2; space++) { /* both kinds of input */
		close_to(goes(BB_STEER_PAD, space, 90, 45, 20), 0, 0, -1, 1e-9); /* not asked for: the head does nothing */
		close_to(goes(BB_STEER_HEAD, space, 0, 0, 0), 0, 0, -1, 1e-9);
		close_to(goes(BB_STEER_HEAD, space, 90, 0, 0), -1, 0, 0, 1e-9);   /* to the left */
		close_to(goes(BB_STEER_HEAD, space, 180, 0, 0), 0, 0, 1, 1e-9);
		close_to(goes(BB_STEER_HEAD, space, 0, 45, 0), 0, h, -h, 1e-9);   /* looks up: climbs */
		close_to(goes(BB_STEER_HEAD, space, -90, -45, 0), h, -h, 0, 1e-9);
		close_to(goes(BB_STEER_HEAD, space, 30, 10, 40), -sin(M_PI / 6) * cos(M_PI / 18), sin(M_PI / 18),
		         -cos(M_PI / 6) * cos(M_PI / 18), 1e-9); /* tilted to the side: as without */
		close_to(goes(BB_STEER_HEAD, space, 45, -90, 0), 0, -1, 0, 1e-9); /* straight down is down, and no nan */
	}
}

/* Sideways motion keeps its heading however steep the look, and there is no jump on the way there. */
static void a_steep_look_keeps_its_heading(void **state)
{
	struct bb_vec3 last = { 0, 0, 0 };

	(void)state;
	for (int pitch = -60; pitch >= -90; pitch -= 1) {
		struct bench *b = begin("0.1 axis 1 1 0\n");
		b->scene.steer_by = BB_STEER_HEAD;
		b->loop.steady.last = (struct bb_pose){ { 0, 1.6, 0 }, bb_quat_euler_deg(90, pitch, 10) };
		frames(b, 30);
		rig_pass(b->rig, FRAME_NS);
		bb_pads_read(&b->loop, rig_now(b->rig));
		const struct bb_vec3 p = bb_vec3_unit(b->loop.navigation.p, (struct bb_vec3){ 0, 0, 0 });
		close_to(p, 0, 0, -1, 0.2); /* to the right of who looks left, but for the tilt */
		if (pitch < -60)
			assert_true(bb_vec3_norm(bb_vec3_sub(p, last)) < 0.06);
		last = p;
		end(b);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(silence_lets_the_motion_run_out), cmocka_unit_test(unplug_ends_the_motion_with_the_frame),
		cmocka_unit_test(a_stuck_axis_is_told_by_name),    cmocka_unit_test(a_hand_is_not_a_stuck_axis),
		cmocka_unit_test(a_low_battery_is_told_by_name), cmocka_unit_test(the_head_steers),
		cmocka_unit_test(a_steep_look_keeps_its_heading),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
