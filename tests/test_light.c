/*
 * tests/test_light.c: the light of walls as it is reckoned and as it is drawn agree within 2 % of white, for the pattern,
 * the patch, fades and open, running and half open shutters; what a scene will do is foreseen.
 */
#include "bench/loop/light.h"
#include "tests/fixture_room.h"

#define WHITE_PART 0.02

static void load(struct bb_room **room, struct bb_scene **scene, const char *room_path, const char *text)
{
	char path[] = "/tmp/bb_light_XXXXXX.yaml";
	struct bb_error err = { 0 };
	FILE *f = fdopen(mkstemps(path, 5), "w");

	assert_non_null(f);
	fprintf(f, "scene: light\ntechnique: calibration\nduration_s: 10\nneeds: {shutters: 1, displays: 1}\n%s", text);
	fclose(f);
	if (bb_room_load(room_path, room, &err) != BB_OK || bb_scene_load(path, scene, &err) != BB_OK)
		fail_msg("%s", err.text);
	remove(path);
}

static struct bb_light *light_of(const struct bb_room *room, const struct bb_scene *scene, bool drawn)
{
	const struct bb_light_config c = { .room = room, .scene = scene, .viewer = room->neutral, .drawn = drawn };
	struct bb_light *l;

	assert_int_equal(bb_light_create(&c, &l), BB_OK);
	bb_light_skip(l, MS);
	return l;
}

/* Draws what the run would draw, but for the cursor, and shows it to the meter that looks at pixels. */
static void draw(struct bb_light *l, const struct bb_room *room, const struct bb_scene *scene, double t_s, double fade)
{
	for (uint16_t s = 0; s < room->n_screens; s++)
		for (unsigned e = 0; e < 2; e++) {
			const struct bb_screen *screen = &room->screens[s];
			const struct bb_view view = bb_view_make(&screen->corners, room->neutral, room->neutral, 0.05, 60);
			struct bb_image image;
			assert_int_equal(bb_image_create((uint32_t)screen->display.width_px, (uint32_t)screen->display.height_px, &image),
			                 BB_OK);
			assert_int_equal(bb_calibration_draw(&view, screen->id, e == 0, NULL, &image), BB_OK);
			bb_patch_draw(room, scene, s, t_s, &image);
			if (fade < 1)
				bb_light_fade(&image, fade);
			bb_light_pixels(l, s, e, &image);
			bb_image_release(&image);
		}
}

static double worst_difference(const struct bb_light *reckoned, const struct bb_light *drawn, size_t n_walls, double fade)
{
	double worst = 0;

	for (unsigned w = 0; w < n_walls; w++)
		for (unsigned e = 0; e < 2; e++)
			for (int i = 0; i < BB_FLASH_CELLS; i++) {
				const double a = bb_flash_luminance(bb_light_grid(reckoned, w, e)->rgb[i]) * bb_light_seen(reckoned, w, e) * fade;
				const double b = bb_flash_luminance(bb_light_grid(drawn, w, e)->rgb[i]) * bb_light_seen(drawn, w, e);
				worst = fmax(worst, fabs(a - b));
			}
	return worst;
}

/* One cycle of the chain from at_ns on: left, right, left. */
static void cycle(struct bb_light *l, const struct bb_room *room, int64_t at_ns)
{
	for (int k = 0; k < 3; k++)
		for (int s = -1; s < room->chain.n_stages; s++) {
			const struct bb_shutter_edge e = { .at_ns = at_ns + k * BB_NS_PER_S / 120, .seq = (uint32_t)k,
				                           .eye = k % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT,
				                           .stage = s < 0 ? BB_STAGE_EMITTER : (uint8_t)s };
			bb_light_edge(l, &e);
		}
}

static void agree(const char *room_path, const char *scene_text)
{
	struct bb_room *room;
	struct bb_scene *scene;
	double worst = 0;

	load(&room, &scene, room_path, scene_text);
	for (int k = 0; k < 6; k++) {
		const double t_s = 0.31 * k, fade = k < 2 ? 1 : 0.2 * k - 0.3;
		struct bb_light *l[2] = { light_of(room, scene, false), light_of(room, scene, true) };
		for (int i = 0; i < 2; i++) {
			if (k % 3)
				cycle(l[i], room, 10 * MS);
			if (k % 3 == 2)
				bb_light_screen(l[i], 1, 0);
		}
		draw(l[1], room, scene, t_s, fade);
		bb_light_patch(l[0], t_s);
		bb_light_frame(l[0], 28 * MS, fade);
		bb_light_frame(l[1], 28 * MS, fade);
		worst = fmax(worst, worst_difference(l[0], l[1], room->n_walls, fade));
		bb_light_destroy(l[0]);
		bb_light_destroy(l[1]);
	}
	printf("light: %s, %s: reckoned and drawn differ by %.2f %% of white at most\n", room_path, *scene_text ? scene_text : "pattern",
	       100 * worst);
	assert_true(worst <= WHITE_PART);
	bb_scene_free(scene);
	bb_room_free(room);
}

static void reckoned_and_drawn_agree(void **state)
{
	(void)state;
	agree("rooms/cabin.yaml", "");
	agree("rooms/cabin120.yaml", "patch: {hz: 1, size_m: 0.7, low_percent: 5, high_percent: 90}");
	agree("rooms/cabin.yaml", "patch: {hz: 1.5, size_m: 0, low_percent: 20, high_percent: 40}");
}

static void shutters_take_their_share(void **state)
{
	struct bb_room *room;
	struct bb_scene *scene;

	(void)state;
	for (int k = 0; k < 2; k++) {
		load(&room, &scene, k ? "rooms/cabin120.yaml" : "rooms/cabin.yaml", "");
		struct bb_light *l = light_of(room, scene, false);
		bb_light_frame(l, 9 * MS, 1);
		assert_true(bb_light_seen(l, 0, 0) >= 1 && bb_light_seen(l, 4, 1) >= 1); /* open */
		cycle(l, room, 10 * MS);
		bb_light_frame(l, 28 * MS, 1);
		assert_true(fabs(bb_light_seen(l, 0, 0) - bb_light_dim(room)) < 1e-9); /* running */
		assert_true(fabs(bb_light_seen(l, 3, 1) - bb_light_dim(room)) < 1e-9);
		bb_light_frame(l, 60 * MS, 1); /* it stands, with the left eye open */
		assert_true(bb_light_seen(l, 0, 0) > 1.9 * bb_light_dim(room) && bb_light_seen(l, 0, 1) < 0.1);
		bb_light_frame(l, 200 * MS, 1);
		bb_light_frame(l, 250 * MS, 1); /* and has opened by itself */
		assert_true(bb_light_seen(l, 0, 0) >= 1 - 1e-9 && bb_light_seen(l, 0, 1) >= 1 - 1e-9);
		bb_light_destroy(l);
		bb_scene_free(scene);
		bb_room_free(room);
	}
}

static double foreseen(const char *scene_text, double fade)
{
	struct bb_room *room;
	struct bb_scene *scene;
	struct bb_flash_worst worst;

	load(&room, &scene, "rooms/cabin.yaml", scene_text);
	assert_int_equal(bb_light_foresee(room, scene, NULL, 0, fade, &worst), BB_OK);
	bb_scene_free(scene);
	bb_room_free(room);
	return worst.flashes;
}

static void a_scene_is_foreseen(void **state)
{
	(void)state;
	assert_true(foreseen("", 1) <= 0);
	assert_true(foreseen("patch: {hz: 2.9, size_m: 1}", 1) <= 3);
	assert_true(foreseen("patch: {hz: 3, size_m: 1}", 1) > 3);
	assert_true(foreseen("patch: {hz: 10, size_m: 1}", 1) > 6);
	assert_true(foreseen("patch: {hz: 56.5, size_m: 1}", 1) > 3); /* four a second of it on a display of 60 Hz */
	assert_true(foreseen("patch: {hz: 60, size_m: 1}", 1) > 3);
	assert_true(foreseen("patch: {hz: 10, size_m: 1}", 0.09) <= 0);                                  /* dimmed */
	assert_true(foreseen("patch: {hz: 10, size_m: 1, low_percent: 50, high_percent: 59}", 1) <= 0);  /* low contrast */
	assert_true(foreseen("patch: {hz: 10, size_m: 0.08}", 1) <= 0);                                  /* small */
}

static void steps_are_foreseen(void **state)
{
	const float means[2][3] = { { 0, 0, 0 }, { 0.5f, 0.5f, 0.5f } };
	struct bb_room *room;
	struct bb_scene *scene;
	struct bb_flash_worst worst;

	(void)state;
	load(&room, &scene, "rooms/cabin.yaml", "");
	scene->data.loop = BB_LOOP_PING_PONG;
	scene->data.seconds_per_step = 0.5; /* 1 Hz there and back */
	assert_int_equal(bb_light_foresee(room, scene, means, 2, 1, &worst), BB_OK);
	assert_true(worst.flashes > 0 && worst.flashes <= 1.5);
	scene->data.seconds_per_step = 0.1;
	assert_int_equal(bb_light_foresee(room, scene, means, 2, 1, &worst), BB_OK);
	assert_true(worst.flashes > 3);
	float late[300][3] = { 0 }; /* a film that flickers at its end only, after 24 s */
	for (int i = 240; i < 300; i += 2)
		late[i][1] = 1;
	scene->duration_s = 60;
	assert_int_equal(bb_light_foresee(room, scene, late, 300, 1, &worst), BB_OK);
	assert_true(worst.flashes > 3 && worst.at_ns > 24 * BB_NS_PER_S * 9 / 10);
	bb_scene_free(scene);
	bb_room_free(room);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(reckoned_and_drawn_agree),
		cmocka_unit_test(shutters_take_their_share),
		cmocka_unit_test(a_scene_is_foreseen),
		cmocka_unit_test(steps_are_foreseen),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
