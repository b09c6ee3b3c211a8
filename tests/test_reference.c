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

#include "render/bricks/truth.h"
#include "tests/drawing.h"

#define WIDTH 96
#define HEIGHT 72

static void picture(const struct bb_layer *layer, const struct bb_view *view, double step_voxels, unsigned threads,
		    struct bb_image *image, struct bb_draw_stats *stats)
{
	const struct bb_draw draw = { .view = view, .layers = layer, .n_layers = 1, .step_voxels = step_voxels };
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
	struct drawing d = drawing_of(v, &tf, 16, BB_BRICK_U16, 0.3, cover_leaves, NULL);

	(void)ctx;
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		const struct bb_view view = drawing_view(i);
		struct bb_image one, many;
		struct bb_draw_stats a, b;
		picture(&d.layer, &view, 1, 1, &one, &a);
		picture(&d.layer, &view, 1, 7, &many, &b);
		assert_memory_equal(one.rgba, many.rgba, (size_t)WIDTH * HEIGHT * 4);
		assert_true(a.samples == b.samples && a.rays == b.rays && a.rays > 0 && a.samples > a.rays);
		bb_image_release(&one);
		bb_image_release(&many);
	}
	drawing_done(&d);
	drawing_free(v);
}

/* A slab of one value seen head-on: 1 - (1 - opacity)^length whatever the step, when steps divide the length. */
static void a_uniform_slab_has_its_closed_form(void **ctx)
{
	static const struct bb_transfer_point grey[] = { { 0, 1, 0.5, 0.25, 0.04 }, { 1, 1, 0.5, 0.25, 0.04 } };
	static const double steps[] = { 2, 1, 0.5, 0.25 };
	const struct bb_transfer tf = drawing_transfer(2, grey);
	struct bb_volume *v = drawing_volume(32, 32, 32, 1);
	struct drawing d = drawing_of(v, &tf, 16, BB_BRICK_U16, 0, cover_leaves, NULL);
	const struct bb_corners wall = { { -1e-3, 1 - 1e-3, -2 }, { 1e-3, 1 - 1e-3, -2 }, { -1e-3, 1 + 1e-3, -2 } };
	const struct bb_view view = bb_view_make(&wall, (struct bb_vec3){ 0, 1, 3 }, wall.lower_left, 0.05, 50);
	const double alpha = 1 - pow(0.96, 32);

	(void)ctx;
	d.layer.placement = (struct bb_placement){ { { 0, 1, -1 }, BB_QUAT_IDENTITY }, { 1, 1, 1 } };
	for (size_t i = 0; i < BB_ARRAY_LEN(steps); i++) {
		struct bb_image image;
		struct bb_draw_stats stats;
		picture(&d.layer, &view, steps[i], 2, &image, &stats);
		const uint8_t *px = image.rgba + ((size_t)HEIGHT / 2 * WIDTH + WIDTH / 2) * 4;
		assert_int_equal(px[0], (int)floor(alpha * 255 + 0.5));
		assert_int_equal(px[1], (int)floor(alpha * 0.5 * 255 + 0.5));
		assert_int_equal(px[2], (int)floor(alpha * 0.25 * 255 + 0.5));
		assert_int_equal(px[3], px[0]);
		assert_true(stats.rays == WIDTH * HEIGHT);
		assert_true(fabs((double)stats.samples / (WIDTH * HEIGHT) - 32 / steps[i]) < 0.01);
		bb_image_release(&image);
	}
	drawing_done(&d);
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
	struct drawing d = drawing_of(v, &tf, 16, BB_BRICK_U16, 0, cover_leaves, NULL);
	const struct bb_placement p = drawing_placement(v);
	const struct bb_vec3 at = { (3.5 / 20 - 0.5) * p.size_m.x, (13.5 / 18 - 0.5) * p.size_m.y,
				    (12.5 / 16 - 0.5) * p.size_m.z };
	const struct bb_view view = drawing_view(0);
	double ndc[3], w, x = 0, y = 0, mass = 0;
	bb_view_project(&view, bb_pose_apply(&p.pose, at), ndc, &w);
	picture(&d.layer, &view, 0.25, 2, &image, NULL);
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
	drawing_done(&d);
	drawing_free(v);
}

static void twice_the_samples_change_little(void **ctx)
{
	struct bb_volume *v = drawing_volume(70, 50, 37, 3);
	const struct bb_transfer tf = drawing_smooth();
	struct drawing d = drawing_of(v, &tf, 16, BB_BRICK_U16, 1.4, cover_leaves, NULL);

	(void)ctx;
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		const struct bb_view view = drawing_view(i);
		struct bb_image once, twice;
		struct bb_image_difference diff;
		picture(&d.layer, &view, 0.5, 2, &once, NULL);
		picture(&d.layer, &view, 0.25, 2, &twice, NULL);
		assert_int_equal(bb_image_compare(&once, &twice, &diff), BB_OK);
		printf("view %d: twice the samples: most %u/255, %.1f dB\n", i, diff.most, diff.psnr_db);
		assert_true(diff.n_pixels > 300 && diff.most <= 2);
		bb_image_release(&once);
		bb_image_release(&twice);
	}
	drawing_done(&d);
	drawing_free(v);
}

static enum bb_status drawn(struct bb_renderer *r, const struct bb_layer *layer, size_t n_layers, double step_voxels,
			    struct bb_image *image)
{
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = {
		.view = &view, .layers = layer, .n_layers = n_layers, .step_voxels = step_voxels
	};

	return bb_renderer_draw(r, &draw, image, NULL);
}

static void bad_calls_are_refused(void **ctx)
{
	static const double steps[] = { 0, (double)NAN, 1e9, -1, 1.0 / 65, 65 };
	static const double sizes[] = { 0, -1, (double)NAN, HUGE_VAL };
	struct bb_volume *v = drawing_volume(20, 18, 16, 2);
	const struct bb_transfer tf = drawing_smooth();
	struct drawing d = drawing_of(v, &tf, 16, BB_BRICK_U16, 0, cover_leaves, NULL);
	const struct bb_layer layers[BB_LAYERS_MOST + 1] = { d.layer, d.layer, d.layer, d.layer, d.layer };
	struct bb_layer odd = d.layer;
	struct bb_renderer *r = NULL;
	struct bb_image image;

	(void)ctx;
	assert_int_equal(bb_renderer_reference_create(0, &r), BB_ERR_RANGE);
	assert_int_equal(bb_renderer_reference_create(100000, &r), BB_ERR_RANGE);
	assert_null(r);
	assert_int_equal(bb_renderer_reference_create(1, &r), BB_OK);
	assert_int_equal(bb_image_create(4, 4, &image), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(steps); i++)
		assert_int_equal(drawn(r, layers, 1, steps[i], &image), BB_ERR_RANGE);
	assert_int_equal(drawn(r, layers, 0, 1, &image), BB_ERR_RANGE);
	assert_int_equal(drawn(r, layers, BB_LAYERS_MOST + 1, 1, &image), BB_ERR_RANGE);
	assert_int_equal(drawn(r, layers, BB_LAYERS_MOST, 1, &image), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(sizes); i++) {
		odd.placement.size_m.y = sizes[i];
		assert_int_equal(drawn(r, &odd, 1, 1, &image), BB_ERR_RANGE);
	}
	odd = d.layer;
	odd.volume = NULL;
	assert_int_equal(drawn(r, &odd, 1, 1, &image), BB_ERR_UNSUPPORTED);
	assert_int_equal(bb_renderer_last_error(r)->number, 1808);
	const struct bb_draw blind = { .layers = layers, .n_layers = 1, .step_voxels = 1 };
	assert_int_equal(bb_renderer_draw(r, &blind, &image, NULL), BB_ERR_USAGE);
	bb_image_release(&image);
	bb_renderer_destroy(r);
	bb_renderer_destroy(NULL);
	drawing_done(&d);
	drawing_free(v);
}

/* Every type of a file put together again: its volume is the data, to what the type can hold. */
static void a_file_is_its_own_truth(void **ctx)
{
	static const double within[BB_BRICK_TYPES] = { 0.5 / 255, 0.5 / 65535, 0x1p-12, 1e-7 };
	uint32_t state = 5;
	struct bb_volume *v = drawing_noise((const uint32_t[]){ 19, 33, 10 }, 5, &state), *truth;

	(void)ctx;
	v->least = -3;
	v->most = 7;
	for (enum bb_brick_type type = 0; type < BB_BRICK_TYPES; type++) {
		struct bb_bricks *b = cover_bricks(v, 8, 1 + type % 2, type);
		double worst = 0;
		assert_int_equal(bb_volume_of_bricks(b, 2, 3, UINT64_C(1) << 20, &truth, NULL), BB_OK);
		assert_true(truth->n_steps == 3 && truth->least == -3 && truth->most == 7 && !truth->around);
		for (uint32_t t = 0; t < 3; t++)
			for (uint32_t z = 0; z < 10; z++)
				for (uint32_t y = 0; y < 33; y++)
					for (uint32_t x = 0; x < 19; x++)
						worst = fmax(worst, fabs(bb_volume_voxel(truth, x, y, z, t) -
									 bb_volume_voxel(v, x, y, z, t + 2)));
		printf("%s: most %.2e off\n", bb_brick_type_text(type), worst);
		/* u16 and f32 hold what a volume has as it is. */
		assert_true(worst <= within[type] + 1e-7 && (type % 2 || worst > within[type] / 4));
		bb_volume_free(truth);
		bb_bricks_close(b);
	}
	drawing_free(v);
}

static void the_truth_has_a_cap(void **ctx)
{
	static const uint32_t odd[][2] = { { 0, 0 }, { 2, 1 }, { 0, 3 }, { 1, UINT32_MAX } };
	const uint64_t need = 19 * 18 * 16 * 4 + 10 * 10 * 10 * 2;
	struct bb_volume *v = drawing_volume(19, 18, 16, 2), *truth = v;
	struct bb_bricks *b = cover_bricks(v, 8, 1, BB_BRICK_U16);
	struct bb_error err = { 0 };

	(void)ctx;
	assert_int_equal(bb_volume_of_bricks(b, 0, 1, need - 1, &truth, &err), BB_ERR_FORMAT);
	assert_true(err.number == 1405 && !truth);
	assert_int_equal(bb_volume_of_bricks(b, 0, 1, need, &truth, NULL), BB_OK);
	bb_volume_free(truth);
	for (size_t i = 0; i < BB_ARRAY_LEN(odd); i++)
		assert_int_equal(bb_volume_of_bricks(b, odd[i][0], odd[i][1], UINT64_MAX, &truth, NULL), BB_ERR_RANGE);
	bb_bricks_close(b);
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
		cmocka_unit_test(a_file_is_its_own_truth),
		cmocka_unit_test(the_truth_has_a_cap),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
