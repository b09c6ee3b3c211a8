/*
 * tests/test_layers.c: several volumes, spherical ones and meshes, drawn natively, against the reference; and the
 * reference's own triangles against what can be written down.
 */
#include "tests/layers_scenes.h"

#include "render/cpu/layers.h"

static const char *const kernels[] = { "avx512", "avx2", "portable" };

static struct {
	struct bb_renderer *reference, *layers;
	const char *kernel;
} fixture;

static bool need_kernel(void)
{
	if (fixture.layers)
		return true;
	printf("SKIP: %s: this processor does not have it\n", fixture.kernel);
	skip();
	return false;
}

static double worst_of(struct scene *s, const char *what)
{
	char name[64];

	snprintf(name, sizeof(name), "%s, %s", fixture.kernel, what);
	const double db = scene_worst_db(fixture.layers, fixture.reference, s, name);
	scene_free(s);
	return db;
}

static void two_volumes_agree_with_the_reference(void **ctx)
{
	(void)ctx;
	if (need_kernel())
		assert_true(worst_of(scene_two_volumes(cover_leaves, NULL), "two volumes") >= 50);
}

static void meshes_between_them_do(void **ctx)
{
	(void)ctx;
	need_kernel();
	struct scene *s = scene_two_volumes(cover_leaves, NULL);
	scene_add_meshes(s);
	assert_true(worst_of(s, "two volumes and meshes") >= 45);
}

static void a_spherical_volume_does(void **ctx)
{
	(void)ctx;
	need_kernel();
	assert_true(worst_of(scene_ball(false, cover_leaves, NULL), "ball") >= 50);
	assert_true(worst_of(scene_ball(true, cover_leaves, NULL), "wedge") >= 50);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(two_volumes_agree_with_the_reference),
		cmocka_unit_test(meshes_between_them_do),
		cmocka_unit_test(a_spherical_volume_does),
	};
	int failed = 0;

	assert_int_equal(bb_renderer_reference_create(2, &fixture.reference), BB_OK);
	for (size_t k = 0; k < BB_ARRAY_LEN(kernels); k++) {
		fixture.kernel = kernels[k];
		(void)!bb_renderer_layers_create(kernels[k], 2, false, &fixture.layers, NULL);
		failed += cmocka_run_group_tests_name(kernels[k], tests, NULL, NULL);
		bb_renderer_destroy(fixture.layers);
	}
	bb_renderer_destroy(fixture.reference);
	return failed;
}
