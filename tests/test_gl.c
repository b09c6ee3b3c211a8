/*
 * tests/test_gl.c: the GLSL picture against the reference, OSMesa against EGL, and what is sent to the GL and when.
 * One process can use one kind of OpenGL: the EGL pictures are made in a child before this process touches any.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/drawing.h"

#define WIDTH DRAWING_WIDTH
#define HEIGHT DRAWING_HEIGHT
#define PICTURE_BYTES ((size_t)WIDTH * HEIGHT * 4)

static struct {
	struct bb_renderer *gl, *reference;
	struct bb_volume *volume;
	struct bb_transfer transfer;
	struct bb_stream *stream;
	uint8_t *by_egl; /* [DRAWING_VIEWS] pictures; NULL when there is no EGL */
} fixture;

static struct bb_image_difference against_reference(const struct bb_stream *s, int view, double time, double step_voxels)
{
	return drawing_against(fixture.gl, fixture.reference, "gl", s, view, time, step_voxels);
}

static void need_gl(void)
{
	if (fixture.gl)
		return;
	printf("skipped: no OSMesa on this machine\n");
	skip();
}

static void agrees_with_the_reference(void **ctx)
{
	(void)ctx;
	need_gl();
	for (int i = 0; i < DRAWING_VIEWS * 2; i++) {
		const struct bb_image_difference d =
			against_reference(fixture.stream, i % DRAWING_VIEWS, i < DRAWING_VIEWS ? 1 : 1.35, 0.5);
		assert_true(d.n_pixels > 1000 && d.psnr_db >= 55);
	}
}

/* Noise shows every misplaced voxel, border and seam; several sizes, some just past a whole brick. */
static void agrees_on_noise(void **ctx)
{
	static const uint32_t sizes[][3] = { { 33, 16, 17 }, { 32, 32, 32 }, { 5, 40, 3 } };
	uint32_t state = 1;

	(void)ctx;
	need_gl();
	for (size_t k = 0; k < BB_ARRAY_LEN(sizes); k++) {
		struct bb_volume *v = drawing_noise(sizes[k], 2, &state);
		struct bb_stream *s = drawing_stream(v, &fixture.transfer);
		for (int i = 0; i < DRAWING_VIEWS; i++)
			assert_true(against_reference(s, i, 0.5, 0.7).psnr_db >= 55);
		bb_renderer_forget(fixture.gl);
		bb_stream_destroy(s);
		drawing_free(v);
	}
}

static void agrees_on_a_sharp_transfer_function(void **ctx)
{
	const struct bb_transfer tf = drawing_sharp();
	struct bb_stream *s = drawing_stream(fixture.volume, &tf);

	(void)ctx;
	need_gl();
	for (int i = 0; i < DRAWING_VIEWS; i++)
		assert_true(against_reference(s, i, 0.8, 0.5).psnr_db >= 45);
	bb_renderer_forget(fixture.gl);
	bb_stream_destroy(s);
}

static void twice_the_samples_change_little(void **ctx)
{
	(void)ctx;
	need_gl();
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		struct bb_image once = drawing_picture(fixture.gl, fixture.stream, i, 0.4, 0.5, NULL);
		struct bb_image twice = drawing_picture(fixture.gl, fixture.stream, i, 0.4, 0.25, NULL);
		struct bb_image_difference d;
		assert_int_equal(bb_image_compare(&once, &twice, &d), BB_OK);
		assert_true(d.n_pixels > 1000 && d.most <= 2);
		bb_image_release(&once);
		bb_image_release(&twice);
	}
}

/* Half-way between two steps that show nothing there is something to see. */
static void sees_between_two_invisible_steps(void **ctx)
{
	static const struct bb_transfer_point band[] = {
		{ 0, 1, 1, 1, 0 }, { 0.4, 1, 1, 1, 0 }, { 0.5, 1, 1, 1, 0.1 }, { 0.6, 1, 1, 1, 0 }, { 1, 1, 1, 1, 0 }
	};
	const struct bb_transfer tf = drawing_transfer(BB_ARRAY_LEN(band), band);
	struct bb_volume *v = drawing_volume(40, 20, 20, 2);
	const size_t n = 40 * 20 * 20;

	(void)ctx;
	need_gl();
	for (size_t i = 0; i < n; i++) {
		v->voxels[i] = 6000;
		v->voxels[n + i] = 59000;
	}
	struct bb_stream *s = drawing_stream(v, &tf);
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		const struct bb_image_difference d = against_reference(s, i, 0.5, 1);
		assert_true(d.n_pixels > 500 && d.psnr_db >= 55);
	}
	bb_renderer_forget(fixture.gl);
	bb_stream_destroy(s);
	drawing_free(v);
}

/* The same colours with an opacity nobody can see where there was none: no brick is empty any more. */
static void skipping_empty_bricks_changes_nothing(void **ctx)
{
	static const struct bb_transfer_point points[] = {
		{ 0, 1, 1, 1, 0 }, { 0.55, 1, 1, 1, 0 }, { 0.7, 1, 0.6, 0, 0.2 }, { 1, 1, 1, 1, 0.4 }
	};
	const struct bb_transfer sparse = drawing_transfer(BB_ARRAY_LEN(points), points);
	struct bb_transfer filled = sparse;

	(void)ctx;
	need_gl();
	filled.point[0].opacity = filled.point[1].opacity = 1e-9;
	filled.least_visible = 0;
	struct bb_stream *s = drawing_stream(fixture.volume, &sparse), *f = drawing_stream(fixture.volume, &filled);
	const struct bb_atlas *atlas = bb_stream_atlas(s);
	size_t n_empty = 0;
	for (uint32_t i = 0; i < atlas->grid[0] * atlas->grid[1] * atlas->grid[2]; i++)
		n_empty += atlas->empty[i];
	assert_true(n_empty > 0);
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		struct bb_image_difference d;
		struct bb_image a = drawing_picture(fixture.gl, s, i, 0, 0.5, NULL),
				b = drawing_picture(fixture.gl, f, i, 0, 0.5, NULL);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		assert_int_equal(d.n_differ, 0);
		bb_image_release(&a);
		bb_image_release(&b);
	}
	bb_renderer_forget(fixture.gl);
	bb_stream_destroy(s);
	bb_stream_destroy(f);
}

static void only_what_changed_is_sent(void **ctx)
{
	const struct bb_stream_config config = { .volume = fixture.volume,
						 .transfer = &fixture.transfer,
						 .placement = drawing_placement(fixture.volume),
						 .memory_bytes = 40 * BB_BRICK_BYTES,
						 .bricks_per_frame = 3 };
	const struct bb_view view = drawing_view(0);
	const uint64_t map_bytes = 5 * 4 * 3 * 8;
	struct bb_stream *s = NULL;
	struct bb_draw_stats stats;

	(void)ctx;
	need_gl();
	assert_int_equal(bb_stream_create(&config, &s), BB_OK);
	struct bb_image image = drawing_picture(fixture.gl, s, 0, 0, 1, &stats);
	assert_true(stats.upload_bytes > map_bytes);
	bb_image_release(&image);
	image = drawing_picture(fixture.gl, s, 0, 0, 1, &stats);
	assert_int_equal(stats.upload_bytes, 0);
	bb_image_release(&image);
	for (int frame = 0; frame < 5; frame++) {
		const struct bb_stream_counts n = bb_stream_frame(s, &view, 1, WIDTH, HEIGHT, 0, 0, 1);
		assert_int_equal(n.loaded, 3);
		image = drawing_picture(fixture.gl, s, 0, 0, 1, &stats);
		assert_int_equal(stats.upload_bytes, n.bytes + map_bytes);
		bb_image_release(&image);
	}
	bb_renderer_forget(fixture.gl);
	bb_stream_destroy(s);
}

/* Bricks that are not there are drawn coarse: a recognisable picture at once, and the exact one when all have come. */
static void the_picture_grows_sharp_with_streaming(void **ctx)
{
	const struct bb_stream_config config = { .volume = fixture.volume,
						 .transfer = &fixture.transfer,
						 .placement = drawing_placement(fixture.volume),
						 .memory_bytes = 400 * BB_BRICK_BYTES,
						 .bricks_per_frame = 4 };
	const struct bb_view view = drawing_view(0);
	struct bb_stream *s = NULL;
	struct bb_stream_counts n = { .missing = 1 };

	(void)ctx;
	need_gl();
	assert_int_equal(bb_stream_create(&config, &s), BB_OK);
	const double coarse_db = against_reference(s, 0, 0.5, 0.5).psnr_db;
	for (int frame = 0; frame < 100 && n.missing; frame++)
		n = bb_stream_frame(s, &view, 1, WIDTH, HEIGHT, 0.5, 0.5, 0.5);
	assert_int_equal(n.missing, 0);
	const double sharp_db = against_reference(s, 0, 0.5, 0.5).psnr_db;
	assert_true(coarse_db > 25 && coarse_db < 55);
	assert_true(sharp_db >= 55);
	bb_renderer_forget(fixture.gl);
	bb_stream_destroy(s);
}

/* Averages of a ramp are the ramp: with nothing resident the picture is still right in place and in time, but for the
 * volume's faces, where an average reaches less far. */
static void coarse_bricks_sit_in_the_right_place(void **ctx)
{
	struct bb_volume *v = drawing_volume(64, 64, 64, 3);
	const struct bb_stream_config config = { .volume = v,
						 .transfer = &fixture.transfer,
						 .placement = drawing_placement(v),
						 .memory_bytes = BB_BRICK_BYTES };
	static const double scale[] = { 120, 330, 60 };
	struct bb_stream *s = NULL;

	(void)ctx;
	need_gl();
	for (uint32_t i = 0; i < 3 * 64 * 64 * 64; i++)
		v->voxels[i] =
			(uint16_t)(20000 + scale[i >> 18] * ((i & 63) + (i >> 6 & 63) / 2.0 + (i >> 12 & 63) / 3.0));
	assert_int_equal(bb_stream_create(&config, &s), BB_OK);
	for (int i = 0; i < 4; i++)
		assert_true(against_reference(s, 0, 0.3 + 0.5 * i, 1).psnr_db >= 48);
	bb_renderer_forget(fixture.gl);
	bb_stream_destroy(s);
	drawing_free(v);
}

static void two_renderers_take_turns(void **ctx)
{
	struct bb_renderer *other = NULL;
	struct bb_volume *v = drawing_volume(20, 20, 20, 1);

	(void)ctx;
	need_gl();
	struct bb_stream *s = drawing_stream(v, &fixture.transfer);
	struct bb_image before = drawing_picture(fixture.gl, fixture.stream, 0, 0, 1, NULL);
	assert_int_equal(bb_renderer_gl_create("auto", &other, NULL), BB_OK);
	struct bb_image image = drawing_picture(other, s, 1, 0, 1, NULL);
	struct bb_image after = drawing_picture(fixture.gl, fixture.stream, 0, 0, 1, NULL);
	assert_memory_equal(before.rgba, after.rgba, PICTURE_BYTES);
	assert_memory_not_equal(image.rgba, after.rgba, PICTURE_BYTES);
	bb_renderer_destroy(other);
	bb_image_release(&after);
	after = drawing_picture(fixture.gl, fixture.stream, 0, 0, 1, NULL);
	assert_memory_equal(before.rgba, after.rgba, PICTURE_BYTES);
	bb_image_release(&before);
	bb_image_release(&image);
	bb_image_release(&after);
	bb_stream_destroy(s);
	drawing_free(v);
}

static void sizes_may_change(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = { &view, fixture.stream, 0, 1 };
	struct bb_image_difference d;

	(void)ctx;
	need_gl();
	for (uint32_t width = 1; width < 400; width = width * 3 + 2) {
		struct bb_image a, b;
		assert_int_equal(bb_image_create(width, 37, &a), BB_OK);
		assert_int_equal(bb_image_create(width, 37, &b), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &a, NULL), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.reference, &draw, &b, NULL), BB_OK);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		assert_true(d.psnr_db >= 45);
		bb_image_release(&a);
		bb_image_release(&b);
	}
}

static void too_large_a_picture_is_an_error(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = { &view, fixture.stream, 0, 1 };
	struct bb_image image;

	(void)ctx;
	need_gl();
	assert_int_equal(bb_image_create(32768, 1, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, NULL), BB_ERR_RANGE);
	assert_int_equal(bb_renderer_last_error(fixture.gl)->number, 1805);
	bb_image_release(&image);
	image = drawing_picture(fixture.gl, fixture.stream, 0, 0, 1, NULL); /* and it goes on */
	assert_int_equal(bb_renderer_last_error(fixture.gl)->number, 0);
	bb_image_release(&image);
}

static void wrong_kinds_are_refused(void **ctx)
{
	struct bb_renderer *r = NULL;
	struct bb_error err = { 0 };

	(void)ctx;
	assert_int_equal(bb_renderer_gl_create("vulkan", &r, &err), BB_ERR_USAGE);
	assert_int_equal(err.number, 1701);
	need_gl();
	err = (struct bb_error){ 0 };
	assert_int_equal(bb_renderer_gl_create("egl", &r, &err), BB_ERR_BUSY);
	assert_int_equal(err.number, 1803);
	assert_null(r);
}

static void osmesa_and_egl_draw_the_same(void **ctx)
{
	size_t n_differ = 0;

	(void)ctx;
	need_gl();
	if (!fixture.by_egl) {
		printf("skipped: no EGL on this machine\n");
		skip();
	}
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		struct bb_image image = drawing_picture(fixture.gl, fixture.stream, i, 1.35, 0.5, NULL);
		for (size_t k = 0; k < PICTURE_BYTES; k += 4)
			n_differ += memcmp(image.rgba + k, fixture.by_egl + (size_t)i * PICTURE_BYTES + k, 4) != 0;
		bb_image_release(&image);
	}
	printf("OSMesa and EGL: %zu of %d pixels differ\n", n_differ, DRAWING_VIEWS * WIDTH * HEIGHT);
	assert_int_equal(n_differ, 0);
}

static int draw_by_egl(uint8_t *out)
{
	struct bb_renderer *r = NULL;
	struct bb_error err = { 0 };

	if (bb_renderer_gl_create("egl", &r, &err) != BB_OK) {
		fprintf(stderr, "%s\n", err.text);
		return 77;
	}
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		struct bb_image image = drawing_picture(r, fixture.stream, i, 1.35, 0.5, NULL);
		memcpy(out + (size_t)i * PICTURE_BYTES, image.rgba, PICTURE_BYTES);
	}
	return 0;
}

static void make_egl_pictures(void)
{
	uint8_t *shared =
		mmap(NULL, DRAWING_VIEWS * PICTURE_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	int status = -1;

	if (shared == MAP_FAILED)
		return;
	const pid_t child = fork();
	if (child == 0)
		_exit(draw_by_egl(shared));
	if (child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0)
		fixture.by_egl = shared;
	else
		munmap(shared, DRAWING_VIEWS * PICTURE_BYTES);
	/* A child that crashes or fails a check is not a machine without EGL. */
	if (child > 0 && (!WIFEXITED(status) || (WEXITSTATUS(status) != 0 && WEXITSTATUS(status) != 77)))
		abort();
}

static int set_up(void **ctx)
{
	struct bb_error err = { 0 };

	(void)ctx;
	fixture.volume = drawing_volume(70, 50, 37, 3);
	fixture.transfer = drawing_smooth();
	fixture.stream = drawing_stream(fixture.volume, &fixture.transfer);
	make_egl_pictures();
	if (bb_renderer_reference_create(2, &fixture.reference) != BB_OK)
		return -1;
	if (bb_renderer_gl_create("osmesa", &fixture.gl, &err) != BB_OK)
		printf("%s\n", err.text);
	else
		printf("%s\n", bb_renderer_description(fixture.gl));
	return 0;
}

static int tear_down(void **ctx)
{
	(void)ctx;
	bb_renderer_destroy(fixture.gl);
	bb_renderer_destroy(fixture.reference);
	bb_stream_destroy(fixture.stream);
	drawing_free(fixture.volume);
	if (fixture.by_egl)
		munmap(fixture.by_egl, DRAWING_VIEWS * PICTURE_BYTES);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(agrees_with_the_reference),
		cmocka_unit_test(agrees_on_noise),
		cmocka_unit_test(agrees_on_a_sharp_transfer_function),
		cmocka_unit_test(twice_the_samples_change_little),
		cmocka_unit_test(sees_between_two_invisible_steps),
		cmocka_unit_test(skipping_empty_bricks_changes_nothing),
		cmocka_unit_test(only_what_changed_is_sent),
		cmocka_unit_test(the_picture_grows_sharp_with_streaming),
		cmocka_unit_test(coarse_bricks_sit_in_the_right_place),
		cmocka_unit_test(two_renderers_take_turns),
		cmocka_unit_test(sizes_may_change),
		cmocka_unit_test(too_large_a_picture_is_an_error),
		cmocka_unit_test(wrong_kinds_are_refused),
		cmocka_unit_test(osmesa_and_egl_draw_the_same),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
