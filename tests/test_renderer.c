/*
 * tests/test_renderer.c: what holds whatever the back end: a renderer that is kept while the stream behind it takes
 * another budget, views that look nowhere, and the smallest of everything.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>

#include "render/levels.h"
#include "render/stream/stream.h"
#include "tests/atlas_oracle.h"
#include "tests/drawing.h"

enum kind { CPU, GL, REFERENCE, KINDS };
static const char *const names[KINDS] = { "cpu", "gl", "reference" };

static struct {
	struct bb_renderer *renderer[KINDS]; /* NULL: not on this machine */
	struct bb_volume *volume;
	struct bb_transfer smooth;
	struct drawing drawing;
} fixture;

static struct bb_renderer *make(enum kind kind)
{
	struct bb_renderer *r = NULL;

	if (kind == CPU)
		assert_int_equal(bb_renderer_cpu_create("auto", 2, &r, NULL), BB_OK);
	if (kind == GL)
		(void)!bb_renderer_gl_create("osmesa", &r, NULL);
	if (kind == REFERENCE)
		assert_int_equal(bb_renderer_reference_create(2, &r), BB_OK);
	return r;
}

static void say_what_is_missing(void)
{
	if (fixture.renderer[GL])
		return;
	printf("SKIP: no OSMesa on this machine\n");
	skip();
}

/* ---- budgets ---- */

/* A renderer that has seen the budgets before this one draws what one draws that has not. */
static void expect_no_memory(enum kind kind, const struct bb_layer *layer, bool blend)
{
	struct bb_renderer *fresh = make(kind);
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = {
		.view = &view, .layers = layer, .n_layers = 1, .step_voxels = 0.5, .blend_levels = blend
	};
	struct bb_image a, b;
	struct bb_image_difference d;

	assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &a), BB_OK);
	assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &b), BB_OK);
	assert_int_equal(bb_renderer_draw(fixture.renderer[kind], &draw, &a, NULL), BB_OK);
	assert_int_equal(bb_renderer_draw(fresh, &draw, &b, NULL), BB_OK);
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	assert_true(d.n_pixels > 500);
	assert_memory_equal(a.rgba, b.rgba, DRAWING_WIDTH * DRAWING_HEIGHT * 4);
	bb_image_release(&a);
	bb_image_release(&b);
	bb_renderer_destroy(fresh);
}

static void budgets_may_change_under_a_renderer(void **ctx)
{
	/* More, less, one byte more (as many slots at another place, or at the same one), all there is. */
	static const uint64_t budgets[] = { 90 << 10, 300 << 10, 120 << 10, (120 << 10) + 1, (120 << 10) + 2, 8 << 20, 70 << 10 };
	struct bb_bricks *bricks = cover_bricks(fixture.volume, 8, 1, BB_BRICK_U16);
	const struct bb_stream_config config = { .bricks = bricks,
						 .transfer = &fixture.smooth,
						 .placement = drawing_placement(fixture.volume),
						 .memory_bytes = 200 << 10,
						 .gain = BB_GAIN_LEAF };
	const struct bb_view view = drawing_view(0);
	struct bb_error err;
	struct bb_stream *s;

	(void)ctx;
	assert_int_equal(bb_stream_create(&config, &s, &err), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(budgets); i++) {
		const struct bb_stream_frame f = { .views = &view, .n_views = 1, .width_px = DRAWING_WIDTH,
						   .height_px = DRAWING_HEIGHT, .step = 0.5 * (double)(i % 3), .step_voxels = 0.5,
						   .bricks_most = UINT32_MAX };
		assert_int_equal(bb_stream_set_budget(s, budgets[i], 0, &err), BB_OK);
		for (int settled = 0; settled < 2; settled++) { /* at once: the coarsest brick; later what fits */
			const struct bb_layer layer = bb_stream_layer(s);
			for (enum kind k = CPU; k <= GL; k++)
				for (int blend = 0; fixture.renderer[k] && blend <= (k == CPU); blend++)
					expect_no_memory(k, &layer, blend);
			if (!settled)
				bb_stream_settle(s, &f);
		}
	}
	for (enum kind k = CPU; k <= GL; k++)
		if (fixture.renderer[k])
			bb_renderer_forget(fixture.renderer[k]);
	bb_stream_destroy(s);
	bb_bricks_close(bricks);
	say_what_is_missing();
}

/* ---- views ---- */

static void views_that_look_nowhere_are_refused(void **ctx)
{
	const struct bb_view good = drawing_view(0);
	struct bb_view bad[5];
	struct bb_layer far = fixture.drawing.layer;
	struct bb_image image;

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		bad[i] = good;
	bad[0].eye.y = (double)NAN;
	bad[1].corners.upper_left.x = (double)NAN;
	bad[2].eye.x = HUGE_VAL;
	bad[3].eye = good.corners.lower_right; /* in the screen */
	bad[4].corners = (struct bb_corners){ good.eye, good.eye, good.eye };
	far.placement.pose.p.z = (double)NAN;
	assert_int_equal(bb_image_create(8, 8, &image), BB_OK);
	for (enum kind k = CPU; k < KINDS; k++) {
		struct bb_draw draw = { .layers = &fixture.drawing.layer, .n_layers = 1, .step_voxels = 0.5 };
		for (size_t i = 0; fixture.renderer[k] && i < BB_ARRAY_LEN(bad); i++) {
			draw.view = &bad[i];
			assert_int_equal(bb_renderer_draw(fixture.renderer[k], &draw, &image, NULL), BB_ERR_RANGE);
			assert_int_equal(bb_levels_draw(&bad[i], draw.layers, &image), BB_ERR_RANGE);
		}
		draw.view = &good;
		draw.layers = &far;
		if (fixture.renderer[k])
			assert_int_equal(bb_renderer_draw(fixture.renderer[k], &draw, &image, NULL), BB_ERR_RANGE);
	}
	bb_image_release(&image);
	say_what_is_missing();
}

/* ---- the smallest ---- */

/* One brick is the whole volume, leaf and root, and yet it may be drawn with steps by level. */
static void one_cell_is_drawn_by_level(void **ctx)
{
	static const uint32_t sizes[][3] = { { 20, 16, 12 }, { 2, 2, 2 } };
	uint32_t state = 9;

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(sizes); i++) {
		struct bb_volume *v = drawing_noise(sizes[i], 1, &state);
		struct drawing d = drawing_of(v, &fixture.smooth, 32, BB_BRICK_F32, 0, cover_leaves, NULL);
		const struct bb_view view = drawing_view(0);
		const struct bb_draw draw = {
			.view = &view, .layers = &d.layer, .n_layers = 1, .step_voxels = 0.5, .steps_by_level = true
		};
		struct bb_image a, b;
		struct bb_image_difference diff;
		assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &a), BB_OK);
		assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &b), BB_OK);
		oracle_draw(&draw, &b);
		for (enum kind k = CPU; k <= GL; k++) {
			if (!fixture.renderer[k])
				continue;
			assert_int_equal(bb_renderer_draw(fixture.renderer[k], &draw, &a, NULL), BB_OK);
			assert_int_equal(bb_image_compare(&a, &b, &diff), BB_OK);
			printf("%s, one cell by level: %.1f dB\n", names[k], diff.psnr_db);
			assert_true(diff.n_pixels > 500 && diff.psnr_db >= 50);
			bb_renderer_forget(fixture.renderer[k]);
		}
		bb_image_release(&a);
		bb_image_release(&b);
		drawing_done(&d);
		drawing_free(v);
	}
	say_what_is_missing();
}

/* A mesh may have nothing in it, not even addresses: what it is in is drawn as without it. */
static void empty_meshes_are_no_meshes(void **ctx)
{
	const struct bb_mesh nothing[2] = { { .generation = 1 }, { .generation = 7 } };
	const struct bb_view view = drawing_view(0);
	struct bb_draw draw = { .view = &view, .layers = &fixture.drawing.layer, .n_layers = 1, .step_voxels = 0.5 };
	struct bb_image_difference d;
	struct bb_image a, b;

	(void)ctx;
	assert_int_equal(bb_image_create(40, 1, &a), BB_OK);
	assert_int_equal(bb_image_create(40, 1, &b), BB_OK);
	for (enum kind k = CPU; k < KINDS; k++) {
		if (!fixture.renderer[k])
			continue;
		draw.meshes = NULL;
		draw.n_meshes = 0;
		assert_int_equal(bb_renderer_draw(fixture.renderer[k], &draw, &a, NULL), BB_OK);
		draw.meshes = nothing;
		draw.n_meshes = 2;
		assert_int_equal(bb_renderer_draw(fixture.renderer[k], &draw, &b, NULL), BB_OK);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		assert_true(d.n_pixels > 10 && d.psnr_db >= 50); /* another path, other roundings */
		bb_renderer_forget(fixture.renderer[k]);
	}
	bb_image_release(&a);
	bb_image_release(&b);
	say_what_is_missing();
}

static int set_up(void **ctx)
{
	(void)ctx;
	fixture.volume = drawing_volume(70, 50, 37, 3);
	fixture.smooth = drawing_smooth();
	fixture.drawing = drawing_of(fixture.volume, &fixture.smooth, 16, BB_BRICK_U16, 0.5, cover_leaves, NULL);
	for (enum kind k = CPU; k < KINDS; k++)
		fixture.renderer[k] = make(k);
	return 0;
}

static int tear_down(void **ctx)
{
	(void)ctx;
	for (enum kind k = CPU; k < KINDS; k++)
		bb_renderer_destroy(fixture.renderer[k]);
	drawing_done(&fixture.drawing);
	drawing_free(fixture.volume);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(budgets_may_change_under_a_renderer),
		cmocka_unit_test(views_that_look_nowhere_are_refused),
		cmocka_unit_test(one_cell_is_drawn_by_level),
		cmocka_unit_test(empty_meshes_are_no_meshes),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
