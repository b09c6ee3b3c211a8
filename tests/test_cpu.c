/*
 * tests/test_cpu.c: the native ray caster against the reference, each kernel that this processor has, over the views of
 * the GLSL one's test; kernels and numbers of threads against each other.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>

#include "tests/drawing.h"

#define WIDTH DRAWING_WIDTH
#define HEIGHT DRAWING_HEIGHT

static const char *const kernels[] = { "avx512", "avx2", "portable" };

static struct {
	struct bb_renderer *reference, *cpu; /* cpu: the kernel under test */
	const char *kernel;
	struct bb_volume *volume;
	struct bb_transfer transfer;
	struct bb_stream *stream;
} fixture;

static struct bb_image_difference against_reference(const struct bb_stream *s, int view, double time, double step_voxels)
{
	return drawing_against(fixture.cpu, fixture.reference, fixture.kernel, s, view, time, step_voxels);
}

static bool need_kernel(void)
{
	if (fixture.cpu)
		return true;
	printf("SKIP: %s: this processor does not have it\n", fixture.kernel);
	skip();
	return false;
}

static void agrees_with_the_reference(void **ctx)
{
	(void)ctx;
	need_kernel();
	for (int i = 0; i < DRAWING_VIEWS * 2; i++) {
		const struct bb_image_difference d =
			against_reference(fixture.stream, i % DRAWING_VIEWS, i < DRAWING_VIEWS ? 1 : 1.35, 0.5);
		assert_true(d.n_pixels > 1000 && d.psnr_db >= 55);
	}
}

/* Noise shows every misplaced voxel, border and seam; several sizes, some just past a whole brick, some one voxel thin.
 */
static void agrees_on_noise(void **ctx)
{
	static const uint32_t sizes[][3] = { { 33, 16, 17 }, { 32, 32, 32 }, { 5, 40, 3 }, { 48, 2, 20 } };
	uint32_t state = 1;

	(void)ctx;
	need_kernel();
	for (size_t k = 0; k < BB_ARRAY_LEN(sizes); k++) {
		struct bb_volume *v = drawing_noise(sizes[k], 2, &state);
		struct bb_stream *s = drawing_stream(v, &fixture.transfer);
		for (int i = 0; i < DRAWING_VIEWS; i++)
			assert_true(against_reference(s, i, 0.5, 0.7).psnr_db >= 52);
		bb_stream_destroy(s);
		drawing_free(v);
	}
}

static void agrees_on_a_sharp_transfer_function(void **ctx)
{
	const struct bb_transfer tf = drawing_sharp();
	struct bb_stream *s = drawing_stream(fixture.volume, &tf);

	(void)ctx;
	if (fixture.cpu)
		for (int i = 0; i < DRAWING_VIEWS; i++)
			assert_true(against_reference(s, i, 0.8, 0.5).psnr_db >= 45);
	bb_stream_destroy(s);
	need_kernel();
}

/* Mist of an opacity that eight bits could not hold, a thousand samples deep. */
static void thin_mist_adds_up(void **ctx)
{
	static const struct bb_transfer_point mist[] = { { 0, 1, 1, 1, 2e-3 }, { 1, 1, 0.5, 0.5, 3e-3 } };
	const struct bb_transfer tf = drawing_transfer(BB_ARRAY_LEN(mist), mist);
	struct bb_stream *s = drawing_stream(fixture.volume, &tf);

	(void)ctx;
	if (fixture.cpu)
		assert_true(against_reference(s, 0, 0.3, 1.0 / 16).psnr_db >= 50);
	bb_stream_destroy(s);
	need_kernel();
}

/* What is not resident is drawn coarse; it grows sharp as bricks come. */
static void the_picture_grows_sharp_with_streaming(void **ctx)
{
	const struct bb_stream_config config = { .volume = fixture.volume,
						 .transfer = &fixture.transfer,
						 .placement = drawing_placement(fixture.volume),
						 .memory_bytes = 400 * BB_BRICK_BYTES,
						 .bricks_per_frame = 4 };
	const struct bb_view view = drawing_view(0);
	struct bb_stream_counts n = { .missing = 1 };
	struct bb_stream *s = NULL;

	(void)ctx;
	need_kernel();
	assert_int_equal(bb_stream_create(&config, &s), BB_OK);
	const double coarse_db = against_reference(s, 0, 0.5, 0.5).psnr_db;
	for (int frame = 0; frame < 100 && n.missing; frame++)
		n = bb_stream_frame(s, &view, 1, WIDTH, HEIGHT, 0.5, 0.5, 0.5);
	assert_int_equal(n.missing, 0);
	const double sharp_db = against_reference(s, 0, 0.5, 0.5).psnr_db;
	assert_true(coarse_db > 25 && coarse_db < 55 && sharp_db >= 55);
	bb_stream_destroy(s);
}

static void threads_and_sizes_change_nothing(void **ctx)
{
	const struct bb_view view = drawing_view(1);
	const struct bb_draw draw = { &view, fixture.stream, 0.4, 0.5 };
	struct bb_renderer *other = NULL;

	(void)ctx;
	need_kernel();
	assert_int_equal(bb_renderer_cpu_create(fixture.kernel, 3, &other, NULL), BB_OK);
	for (uint32_t width = 1; width < 300; width = width * 3 + 2) {
		struct bb_image a, b;
		assert_int_equal(bb_image_create(width, 37, &a), BB_OK);
		assert_int_equal(bb_image_create(width, 37, &b), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.cpu, &draw, &a, NULL), BB_OK);
		assert_int_equal(bb_renderer_draw(other, &draw, &b, NULL), BB_OK);
		assert_memory_equal(a.rgba, b.rgba, (size_t)width * 37 * 4);
		bb_image_release(&a);
		bb_image_release(&b);
	}
	bb_renderer_destroy(other);
}

static void wrong_kernels_are_refused(void **ctx)
{
	struct bb_renderer *r;
	struct bb_error err = { 0 };

	(void)ctx;
	assert_int_equal(bb_renderer_cpu_create("avx1024", 1, &r, &err), BB_ERR_UNSUPPORTED);
	assert_int_equal(err.number, 1801);
	assert_null(r);
	assert_int_equal(bb_renderer_cpu_create("auto", 0, &r, NULL), BB_ERR_RANGE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(agrees_with_the_reference),
		cmocka_unit_test(agrees_on_noise),
		cmocka_unit_test(agrees_on_a_sharp_transfer_function),
		cmocka_unit_test(thin_mist_adds_up),
		cmocka_unit_test(the_picture_grows_sharp_with_streaming),
		cmocka_unit_test(threads_and_sizes_change_nothing),
		cmocka_unit_test(wrong_kernels_are_refused),
	};
	int failed = 0;

	fixture.volume = drawing_volume(70, 60, 44, 3);
	fixture.transfer = drawing_smooth();
	fixture.stream = drawing_stream(fixture.volume, &fixture.transfer);
	assert_int_equal(bb_renderer_reference_create(2, &fixture.reference), BB_OK);
	for (size_t k = 0; k < BB_ARRAY_LEN(kernels); k++) {
		fixture.kernel = kernels[k];
		(void)!bb_renderer_cpu_create(kernels[k], 2, &fixture.cpu, NULL);
		failed += cmocka_run_group_tests_name(kernels[k], tests, NULL, NULL);
		if (fixture.cpu)
			bb_renderer_destroy(fixture.cpu);
	}
	bb_renderer_destroy(fixture.reference);
	bb_stream_destroy(fixture.stream);
	drawing_free(fixture.volume);
	return failed;
}
