/* tests/test_scene.c: the committed scenes, defaults, units, needs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "hal/profile.h"
#include "hal/scene.h"

static struct bb_scene *load(const char *path)
{
	struct bb_error err = { 0 };
	struct bb_scene *scene = NULL;

	if (bb_scene_load(path, &scene, &err))
		print_error("%s\n", err.text);
	assert_non_null(scene);
	return scene;
}

static void epi_is_as_committed(void **state)
{
	struct bb_scene *s = load("scenes/epi.yaml");

	(void)state;
	assert_string_equal(s->name, "epi");
	assert_int_equal(s->technique, BB_TECHNIQUE_VOLUME);
	assert_string_equal(s->data.file, "build/data/example4d.nii.gz");
	assert_int_equal(s->data.loop, BB_LOOP_PING_PONG);
	assert_true(s->data.seconds_per_step == 0.5 && s->memory_mib == 1 && s->stream_bricks_per_frame == 8);
	assert_true(s->duration_s == 10 && s->pictures.n_at == 3 && s->pictures.at_s[2] == 10);
	assert_true(s->pictures.all_walls && s->pictures.eyes == 3);
	for (int i = 0; i < BB_CLASS_COUNT; i++)
		assert_int_equal(s->needs[i], 1);
	assert_int_equal(s->n_budgets, 1);
	assert_true(s->budgets[0].metric == BB_METRIC_FRAME && s->budgets[0].stat == BB_STAT_P99 && s->budgets[0].limit == 8.33);
	assert_string_equal(s->budgets[0].where.file, "scenes/epi.yaml");
	bb_scene_free(s);
}

static void all_scenes_load_with_their_paths(void **state)
{
	static const char *const paths[] = { "scenes/epi.yaml", "scenes/cme.yaml", "scenes/calibration.yaml", "scenes/desk.yaml",
		                             "scenes/wind.yaml" };
	struct bb_error err = { 0 };
	struct bb_path *head;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(paths); i++) {
		struct bb_scene *s = load(paths[i]);
		assert_int_equal(bb_path_load(s->head_path, &head, &err), BB_OK);
		assert_true((double)bb_path_duration_ns(head) >= s->duration_s * 1e9);
		bb_path_free(head);
		bb_scene_free(s);
	}
}

/* Its values are four times what a node may hold. */
static void the_wind_is_four_times_its_memory(void **state)
{
	struct bb_scene *s = load("scenes/wind.yaml");
	const double voxels = (double)s->data.dim[0] * s->data.dim[1] * s->data.dim[2] * (double)s->data.steps;

	(void)state;
	assert_true(s->data.dim[0] == 64 && s->data.dim[1] == 64 && s->data.dim[2] == 128);
	assert_true(s->data.brick_voxels == 8 && s->data.values == 1 && s->data.predict && s->pictures.levels);
	assert_true(voxels * 2 >= 4 * s->memory_mib * 1048576);
	bb_scene_free(s);
}

static void what_is_not_needed_is_not_needed(void **state)
{
	struct bb_scene *s = load("scenes/calibration.yaml");

	(void)state;
	assert_int_equal(s->needs[BB_CLASS_POWER], BB_NOT_NEEDED);
	assert_int_equal(s->needs[BB_CLASS_GAMEPADS], BB_NOT_NEEDED);
	assert_int_equal(s->needs[BB_CLASS_CAMERAS], 1);
	assert_int_equal(s->technique, BB_TECHNIQUE_CALIBRATION);
	assert_int_equal(s->memory_mib, 0);
	bb_scene_free(s);
}

static void one_byte_changes_the_hash(void **state)
{
	static const char text[] = "scene: a\ntechnique: calibration\nduration_s: 1\n";
	struct bb_scene *scene[2];
	char name[] = "/tmp/bb-scene-XXXXXX";
	struct bb_error err = { 0 };

	(void)state;
	close(mkstemp(name));
	for (int i = 0; i < 2; i++) {
		FILE *f = fopen(name, "w");
		assert_non_null(f);
		fprintf(f, "%s%s", text, i ? "#\n" : "");
		fclose(f);
		assert_int_equal(bb_scene_load(name, &scene[i], &err), BB_OK);
	}
	assert_memory_not_equal(scene[0]->sha256, scene[1]->sha256, 32);
	bb_scene_free(scene[0]);
	bb_scene_free(scene[1]);
	unlink(name);
}

/* Two views of 1400 x 1050, a volume over half of each picture, 100 samples a ray: 4 to 6 ms on the desktop GPU. */
static void the_desktop_gpu_is_fast(void **state)
{
	const uint64_t rays = 2 * 1400 * 1050 / 2;
	struct bb_profile p;
	struct bb_error err = { 0 };

	(void)state;
	assert_int_equal(bb_profile_load("rooms/profiles/desktop-gpu.yaml", &p, &err), BB_OK);
	const int64_t ns = bb_profile_draw_ns(&p, 2, rays, 100 * rays, 8, 8 * 11664);
	print_message("two views: %.2f ms\n", (double)ns * 1e-6);
	assert_in_range(ns, 4000000, 6000000);
	assert_in_range(bb_profile_draw_ns(&p, 2, 0, 0, 0, 0), 1, 1000000);
	assert_int_equal(bb_profile_draw_ns(&p, 0, 0, UINT64_MAX, UINT64_MAX, UINT64_MAX) > 0, 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(epi_is_as_committed),
		cmocka_unit_test(all_scenes_load_with_their_paths),
		cmocka_unit_test(the_wind_is_four_times_its_memory),
		cmocka_unit_test(what_is_not_needed_is_not_needed),
		cmocka_unit_test(one_byte_changes_the_hash),
		cmocka_unit_test(the_desktop_gpu_is_fast),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
