/* tests/test_gesture.c: what a wand points at in the cabin, and a marker that is held. */
#include "tests/fixture_room.h"

#include "sync/track/gesture.h"

static struct bb_room *cabin(void)
{
	struct bb_error err = { 0 };
	struct bb_room *room;

	if (bb_room_load("rooms/cabin.yaml", &room, &err) != BB_OK)
		fail_msg("%s", err.text);
	return room;
}

static struct bb_pose at(double x, double y, double z, double yaw, double pitch)
{
	return (struct bb_pose){ { x, y, z }, bb_quat_euler_deg(yaw, pitch, 0) };
}

/* Every pixel that is tried is found again, from several places, on every wall. */
static void points_at_the_pixel(void **state)
{
	static const struct bb_vec3 from[] = { { 0, 1.2, 0 }, { 0.4, 1.5, -0.3 }, { -0.5, 0.8, 0.6 } };
	struct bb_room *room = cabin();

	(void)state;
	for (uint16_t s = 0; s < room->n_screens; s++)
		for (size_t i = 0; i < BB_ARRAY_LEN(from); i++)
			for (int px = 0; px < 1400; px += 199) {
				const int py = (px * 7 + 31) % 1050;
				const struct bb_vec3 target = bb_corners_at(&room->screens[s].corners, (px + 0.5) / 1400,
				                                            1 - (py + 0.5) / 1050);
				const struct bb_vec3 d = bb_vec3_sub(target, from[i]);
				struct bb_pose wand = at(0, 0, 0, atan2(-d.x, -d.z) * 180 / M_PI,
				                         atan2(d.y, hypot(d.x, d.z)) * 180 / M_PI);
				wand.p = from[i];
				const struct bb_pointing p = bb_gesture_point(room, &wand);
				assert_true(p.hit && p.screen == s);
				assert_true(fabs(p.x_px - px) < 1e-6 && fabs(p.y_px - py) < 1e-6);
				assert_true(fabs(p.distance_m - bb_vec3_norm(d)) < 1e-9);
			}
	bb_room_free(room);
}

static void points_at_nothing(void **state)
{
	struct bb_room *room = cabin();
	struct bb_pose up = at(0, 1.2, 0, 0, 89), outside = at(0, 1.2, -3, 180, 0), along = at(0, 0, 0, 0, 0), bad = at(0, 1, 0, 0, 0);

	(void)state;
	assert_false(bb_gesture_point(room, &up).hit);      /* there is no ceiling */
	const struct bb_pointing p = bb_gesture_point(room, &outside); /* through the front wall's back */
	assert_true(p.hit && !strcmp(room->screens[p.screen].id, "back"));
	assert_true(bb_gesture_point(room, &along).screen != 4); /* along the floor: not on it */
	bad.p.x = (double)NAN;
	assert_false(bb_gesture_point(room, &bad).hit);
	bad = at(0, 1, 0, 0, 0);
	bad.q.w = (double)INFINITY;
	assert_false(bb_gesture_point(room, &bad).hit);
	bb_room_free(room);
}

static void grabs_after_so_many(void **state)
{
	struct bb_grab g;
	int64_t t = 1000;

	(void)state;
	bb_grab_init(&g, 3, 6);
	for (int i = 0; i < 20; i++)
		assert_int_equal(bb_grab_solution(&g, t += 8 * MS, 0xF), BB_GRAB_NONE);
	for (int i = 0; i < 5; i++)
		assert_int_equal(bb_grab_solution(&g, t += 8 * MS, 0x7), BB_GRAB_NONE);
	assert_int_equal(bb_grab_solution(&g, t += 8 * MS, 0xF), BB_GRAB_NONE); /* a glimpse begins it anew */
	for (int i = 0; i < 5; i++)
		assert_int_equal(bb_grab_solution(&g, t += 8 * MS, 0x7), BB_GRAB_NONE);
	assert_int_equal(bb_grab_solution(&g, t, 0x7), BB_GRAB_NONE); /* the same solution does not count twice */
	assert_int_equal(bb_grab_solution(&g, t += 8 * MS, 0x7), BB_GRAB_TAKEN);
	assert_int_equal(bb_grab_wait(&g, t + 250 * MS), BB_GRAB_NONE);
	for (int i = 0; i < 5; i++)
		assert_int_equal(bb_grab_solution(&g, t += 8 * MS, 0xF), BB_GRAB_NONE);
	assert_int_equal(bb_grab_solution(&g, t += 8 * MS, 0xF), BB_GRAB_LET_GO);
	assert_false(g.held);
}

static void a_wand_that_is_gone_holds_nothing(void **state)
{
	struct bb_grab g;

	(void)state;
	bb_grab_init(&g, 0, 1);
	assert_int_equal(bb_grab_solution(&g, 5 * MS, 0xE), BB_GRAB_TAKEN);
	assert_int_equal(bb_grab_wait(&g, 255 * MS), BB_GRAB_NONE);
	assert_int_equal(bb_grab_wait(&g, 256 * MS), BB_GRAB_LET_GO);
	assert_int_equal(bb_grab_wait(&g, INT64_MAX), BB_GRAB_NONE);
	assert_int_equal(bb_grab_wait(&g, INT64_MIN), BB_GRAB_NONE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(points_at_the_pixel), cmocka_unit_test(points_at_nothing), cmocka_unit_test(grabs_after_so_many),
		cmocka_unit_test(a_wand_that_is_gone_holds_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
