/*
 * tests/test_reference.c: the judge itself: against integrals that can be written down, and against itself with other
 * numbers of threads and samples.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>

#include "tests/drawing.h"

#define WIDTH 96
#define HEIGHT 72

static void picture(const struct bb_stream *s, const struct bb_view *view, double time, double step_voxels,
		    unsigned threads, struct bb_image *image, struct bb_draw_stats *stats)
{
	const struct bb_draw draw = { view, s, time, step_voxels };
	struct bb_renderer *r = NULL;

	assert_int_equal(bb_renderer_reference_create(threads, &r), BB_OK);
	assert_int_equal(bb_image_create(WIDTH, HEIGHT, image), BB_OK);
	assert_int_equal(bb_renderer_draw(r, &draw, image, stats), BB_OK);
	bb_renderer_destroy(r);
}

static void threads_change_nothing(void **ctx)
{
	struct bb_volume *v = drawing_volume(40, 33, 21, 2);
	const struct bb_transfer tf = drawing_smooth();
	struct bb_stream *s = drawing_stream(v, &tf);

	(void)ctx;
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		const struct bb_view view = drawing_view(i);
		struct bb_image one, many;
		struct bb_draw_stats a, b;
		picture(s, &view, 0.3, 1, 1, &one, &a);
		picture(s, &view, 0.3, 1, 7, &many, &b);
		assert_memory_equal(one.rgba, many.rgba, (size_t)WIDTH * HEIGHT * 4);
		assert_true(a.samples == b.samples && a.rays == b.rays && a.rays > 0 && a.samples > a.rays);
		bb_image_release(&one);
		bb_image_release(&many);
	}
	bb_stream_destroy(s);
	drawing_free(v);
}

/* A slab of one value seen head-on: 1 - (1 - opacity)^length whatever the step, when steps divide the length. */
static void a_uniform_slab_has_its_closed_form(void **ctx)
{
	static const struct bb_transfer_point grey[] = { { 0, 1, 0.5, 0.25, 0.04 }, { 1, 1, 0.5, 0.25, 0.04 } };
	static const double steps[] = { 2, 1, 0.5, 0.25 };
	const struct bb_transfer tf = drawing_transfer(2, grey);
	struct bb_volume *v = drawing_volume(32, 32, 32, 1);
	const struct bb_stream_config config = { .volume = v,
						 .transfer = &tf,
						 .placement = { { { 0, 1, -1 }, BB_QUAT_IDENTITY }, { 1, 1, 1 } } };
	const struct bb_corners wall = { { -1e-3, 1 - 1e-3, -2 }, { 1e-3, 1 - 1e-3, -2 }, { -1e-3, 1 + 1e-3, -2 } };
	const struct bb_view view = bb_view_make(&wall, (struct bb_vec3){ 0, 1, 3 }, wall.lower_left, 0.05, 50);
	const double alpha = 1 - pow(0.96, 32);
	struct bb_stream *s = NULL;

	(void)ctx;
	assert_int_equal(bb_stream_create(&config, &s), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(steps); i++) {
		struct bb_image image;
		struct bb_draw_stats stats;
		picture(s, &view, 0, steps[i], 2, &image, &stats);
		const uint8_t *px = image.rgba + ((size_t)HEIGHT / 2 * WIDTH + WIDTH / 2) * 4;
		assert_int_equal(px[0], (int)floor(alpha * 255 + 0.5));
		assert_int_equal(px[1], (int)floor(alpha * 0.5 * 255 + 0.5));
		assert_int_equal(px[2], (int)floor(alpha * 0.25 * 255 + 0.5));
		assert_int_equal(px[3], px[0]);
		assert_true(stats.rays == WIDTH * HEIGHT);
		assert_true(fabs((double)stats.samples / (WIDTH * HEIGHT) - 32 / steps[i]) < 0.01);
		bb_image_release(&image);
	}
	bb_stream_destroy(s);
	drawing_free(v);
}

/* The picture of a lone voxel lies where the view projects its centre, and moves with the placement. */
static void a_lone_voxel_is_where_it_is_projected(void **ctx)
{
	static const struct bb_transfer_point ramp[] = { { 0, 1, 1, 1, 0 }, { 1, 1, 1, 1, 0.9 } };
	const struct bb_transfer tf = drawing_transfer(2, ramp);
	struct bb_volume *v = drawing_volume(20, 18, 16, 1);
	struct bb_image image;

	(void)ctx;
	memset(v->voxels, 0, 20 * 18 * 16 * sizeof(*v->voxels));
	v->voxels[(12 * 18 + 13) * 20 + 3] = 65535;
	struct bb_stream *s = drawing_stream(v, &tf);
	const struct bb_placement p = drawing_placement(v);
	const struct bb_vec3 at = { (3.5 / 20 - 0.5) * p.size_m.x, (13.5 / 18 - 0.5) * p.size_m.y,
				    (12.5 / 16 - 0.5) * p.size_m.z };
	const struct bb_view view = drawing_view(0);
	double ndc[3], w, x = 0, y = 0, mass = 0;
	bb_view_project(&view, bb_pose_apply(&p.pose, at), ndc, &w);
	picture(s, &view, 0, 0.25, 2, &image, NULL);
	for (int r = 0; r < HEIGHT; r++)
		for (int c = 0; c < WIDTH; c++) {
			const double m = image.rgba[(r * WIDTH + c) * 4 + 3];
			x += m * (c + 0.5);
			y += m * (r + 0.5);
			mass += m;
		}
	assert_true(mass > 0);
	assert_true(fabs(x / mass - (ndc[0] + 1) / 2 * WIDTH) < 0.15);
	assert_true(fabs(y / mass - (1 - ndc[1]) / 2 * HEIGHT) < 0.15);
	bb_image_release(&image);
	bb_stream_destroy(s);
	drawing_free(v);
}

static void twice_the_samples_change_little(void **ctx)
{
	struct bb_volume *v = drawing_volume(70, 50, 37, 3);
	const struct bb_transfer tf = drawing_smooth();
	struct bb_stream *s = drawing_stream(v, &tf);

	(void)ctx;
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		const struct bb_view view = drawing_view(i);
		struct bb_image once, twice;
		struct bb_image_difference d;
		picture(s, &view, 1.4, 0.5, 2, &once, NULL);
		picture(s, &view, 1.4, 0.25, 2, &twice, NULL);
		assert_int_equal(bb_image_compare(&once, &twice, &d), BB_OK);
		printf("view %d: twice the samples: most %u/255, %.1f dB\n", i, d.most, d.psnr_db);
		assert_true(d.n_pixels > 300 && d.most <= 2);
		bb_image_release(&once);
		bb_image_release(&twice);
	}
	bb_stream_destroy(s);
	drawing_free(v);
}

static void bad_calls_are_refused(void **ctx)
{
	static const double steps[][2] = { { -0.1, 1 },        { 1.01, 1 }, { (double)NAN, 1 }, { 0, 0 },
					   { 0, (double)NAN }, { 0, 1e9 },  { 0, -1 } };
	struct bb_volume *v = drawing_volume(20, 18, 16, 2);
	const struct bb_transfer tf = drawing_smooth();
	struct bb_stream *s = drawing_stream(v, &tf);
	const struct bb_view view = drawing_view(0);
	struct bb_renderer *r = NULL;
	struct bb_image image;

	(void)ctx;
	assert_int_equal(bb_renderer_reference_create(0, &r), BB_ERR_RANGE);
	assert_int_equal(bb_renderer_reference_create(100000, &r), BB_ERR_RANGE);
	assert_null(r);
	assert_int_equal(bb_renderer_reference_create(1, &r), BB_OK);
	assert_int_equal(bb_image_create(4, 4, &image), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(steps); i++) {
		const struct bb_draw draw = { &view, s, steps[i][0], steps[i][1] };
		assert_int_equal(bb_renderer_draw(r, &draw, &image, NULL), BB_ERR_RANGE);
	}
	const struct bb_draw blind = { NULL, s, 0, 1 };
	assert_int_equal(bb_renderer_draw(r, &blind, &image, NULL), BB_ERR_USAGE);
	bb_image_release(&image);
	bb_renderer_destroy(r);
	bb_renderer_destroy(NULL);
	bb_stream_destroy(s);
	drawing_free(v);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(threads_change_nothing),
		cmocka_unit_test(a_uniform_slab_has_its_closed_form),
		cmocka_unit_test(a_lone_voxel_is_where_it_is_projected),
		cmocka_unit_test(twice_the_samples_change_little),
		cmocka_unit_test(bad_calls_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
