/*
 * tests/test_gl.c: the GLSL picture against the reference and, where levels and cells of one value mix, against what
 * atlas.h says in double (atlas_oracle.h); OSMesa against EGL; what is sent to the GL and when. One process can use one
 * kind of OpenGL: the EGL pictures are made in a child before this process touches any.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "render/gl/cells.h"
#include "tests/atlas_oracle.h"
#include "tests/layers_scenes.h"

#define WIDTH DRAWING_WIDTH
#define HEIGHT DRAWING_HEIGHT
#define PICTURE_BYTES ((size_t)WIDTH * HEIGHT * 4)
#define EGL_PICTURES 6

static struct {
	struct bb_renderer *gl, *reference;
	struct bb_volume *volume;
	struct bb_transfer transfer;
	struct drawing drawing; /* of u16 at step 1.35 */
	struct scene *scene;    /* two volumes and meshes */
	uint8_t *by_egl;        /* [EGL_PICTURES] pictures; NULL when there is no EGL */
} fixture;

static void need_gl(void)
{
	if (fixture.gl)
		return;
	printf("SKIP: no OSMesa on this machine\n");
	skip();
}

static struct bb_image_difference against_reference(const struct bb_layer *layer, int view, double step_voxels)
{
	return drawing_against(fixture.gl, fixture.reference, "gl", layer, 1, view, step_voxels);
}

static void all_views_agree(const struct bb_layer *layer, double step_voxels, double least_db)
{
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		const struct bb_image_difference d = against_reference(layer, i, step_voxels);
		assert_true(d.n_pixels > 500 && d.psnr_db >= least_db);
	}
	bb_renderer_forget(fixture.gl);
}

/* ---- one volume ---- */

static void agrees_with_the_reference(void **ctx)
{
	static const struct {
		uint32_t edge;
		enum bb_brick_type type;
		double time, least_db;
	} rows[] = { { 16, BB_BRICK_U16, 1, 55 },  { 16, BB_BRICK_U16, 1.35, 55 }, { 8, BB_BRICK_F32, 1.35, 55 },
		     { 32, BB_BRICK_F32, 1, 55 },  { 64, BB_BRICK_F32, 0.5, 55 },  { 12, BB_BRICK_F16, 1, 55 },
		     { 24, BB_BRICK_F16, 0.9, 55 }, { 40, BB_BRICK_U8, 1, 45 } };

	(void)ctx;
	need_gl();
	for (size_t k = 0; k < BB_ARRAY_LEN(rows); k++) {
		struct drawing d = drawing_of(fixture.volume, &fixture.transfer, rows[k].edge, rows[k].type, rows[k].time,
					      cover_leaves, NULL);
		all_views_agree(&d.layer, 0.5, rows[k].least_db);
		drawing_done(&d);
	}
}

/* Noise shows every misplaced voxel, border and seam; several sizes, some just past a whole brick. */
static void agrees_on_noise(void **ctx)
{
	static const uint32_t sizes[][3] = { { 33, 16, 17 }, { 32, 32, 32 }, { 5, 40, 3 }, { 48, 2, 20 } };
	static const double steps[] = { 0.5, 0.7, 0.25, 1 };
	uint32_t state = 1;

	(void)ctx;
	need_gl();
	for (size_t k = 0; k < BB_ARRAY_LEN(sizes); k++) {
		struct bb_volume *v = drawing_noise(sizes[k], 2, &state);
		for (uint32_t edge = 8; edge <= 16; edge += 8) {
			struct drawing d = drawing_of(v, &fixture.transfer, edge, edge == 8 ? BB_BRICK_F32 : BB_BRICK_U16, 0.5,
						      cover_leaves, NULL);
			for (int i = 0; i < DRAWING_VIEWS; i++)
				assert_true(against_reference(&d.layer, i, steps[k]).psnr_db >= 55);
			bb_renderer_forget(fixture.gl);
			drawing_done(&d);
		}
		drawing_free(v);
	}
}

static void agrees_on_a_sharp_transfer_function(void **ctx)
{
	const struct bb_transfer tf = drawing_sharp();
	struct drawing d = drawing_of(fixture.volume, &tf, 16, BB_BRICK_F32, 0.8, cover_leaves, NULL);

	(void)ctx;
	if (fixture.gl)
		for (int i = 0; i < DRAWING_VIEWS; i++)
			assert_true(against_reference(&d.layer, i, 0.5).psnr_db >= 45);
	drawing_done(&d);
	need_gl();
	bb_renderer_forget(fixture.gl);
}

static void twice_the_samples_change_little(void **ctx)
{
	(void)ctx;
	need_gl();
	for (int i = 0; i < DRAWING_VIEWS; i++) {
		struct bb_image once = drawing_picture(fixture.gl, &fixture.drawing.layer, 1, i, 0.5, NULL);
		struct bb_image twice = drawing_picture(fixture.gl, &fixture.drawing.layer, 1, i, 0.25, NULL);
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
	struct drawing d = drawing_of(v, &tf, 16, BB_BRICK_U16, 0.5, cover_leaves, NULL);
	all_views_agree(&d.layer, 1, 55);
	drawing_done(&d);
	drawing_free(v);
}

/* The same colours with an opacity nobody can see where there was none: no brick is empty any more. Which three samples
 * go together changes, and with it how a coordinate is rounded: a pixel or two may fall on the other side of a level. */
static void skipping_empty_bricks_changes_nothing(void **ctx)
{
	static const struct bb_transfer_point points[] = {
		{ 0, 1, 1, 1, 0 }, { 0.3, 1, 1, 1, 0 }, { 0.6, 1, 0.6, 0, 0.2 }, { 1, 1, 1, 1, 0.4 }
	};
	static const uint32_t edges[] = { 8, 16, 32, 20 };
	const struct bb_transfer sparse = drawing_transfer(BB_ARRAY_LEN(points), points);
	struct bb_transfer filled = sparse;
	struct bb_image_difference diff;

	(void)ctx;
	need_gl();
	filled.point[0].opacity = filled.point[1].opacity = 1e-9;
	filled.least_visible = 0;
	for (size_t k = 0; k < BB_ARRAY_LEN(edges); k++) {
		struct drawing d =
			drawing_of(fixture.volume, &sparse, edges[k], BB_BRICK_U16, 0, cover_leaves, NULL);
		struct bb_layer full = d.layer;
		full.transfer = &filled;
		for (int i = 0; i < DRAWING_VIEWS; i++) {
			struct bb_image a = drawing_picture(fixture.gl, &d.layer, 1, i, 0.5, NULL),
					b = drawing_picture(fixture.gl, &full, 1, i, 0.5, NULL);
			assert_int_equal(bb_image_compare(&a, &b, &diff), BB_OK);
			assert_true(diff.n_pixels > 100);
			assert_true(diff.most <= 1 && diff.n_differ <= 2 + diff.n_pixels / 500);
			bb_image_release(&a);
			bb_image_release(&b);
		}
		bb_renderer_forget(fixture.gl);
		drawing_done(&d);
	}
}

/* ---- what can be skipped, without any GL ---- */

static size_t seen_cells(const struct bb_atlas *atlas, const struct bb_gl_cells *cells, size_t *partly, uint32_t *widest)
{
	size_t seen = 0;

	*partly = 0;
	*widest = 0;
	for (size_t i = 0; i < (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2]; i++) {
		const uint32_t word = cells->sign[i].word;
		seen += (word & BB_GL_SIGN_SEEN) != 0;
		*partly += (word & BB_GL_SIGN_PARTLY) != 0;
		*widest = (word & 15) > *widest ? word & 15 : *widest;
	}
	return seen;
}

/* Bricks that show nothing, parts of a brick that do not, and how far a ray may go where all is alike. */
static void signs_say_what_can_be_skipped(void **ctx)
{
	static const struct bb_transfer_point points[] = { { 0, 1, 1, 1, 0 }, { 0.3, 1, 1, 1, 0 }, { 1, 1, 1, 1, 0.4 } };
	const struct bb_transfer sparse = drawing_transfer(BB_ARRAY_LEN(points), points), full = drawing_transfer(1, points + 2);
	struct drawing d = drawing_of(fixture.volume, &sparse, 16, BB_BRICK_F32, 0, cover_leaves, NULL);
	const struct bb_atlas *atlas = d.layer.atlas;
	const size_t n = (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2];
	const double texel[3] = { 1, 1, 1 };
	struct bb_gl_cells cells = { { calloc(n, sizeof(*cells.place[0])), calloc(n, sizeof(*cells.place[0])) },
				     calloc(n, sizeof(*cells.sign)), false };
	struct bb_gl_layout layout;
	struct bb_gl_sight *sight = malloc(sizeof(*sight));
	size_t partly;
	uint32_t widest;

	(void)ctx;
	assert_true(bb_gl_layout_make(atlas->n_slots, atlas->stored, 4, 2048, &layout));
	bb_gl_sight_make(&sparse, sight);
	bb_gl_cells_fill(atlas, &layout, texel, sight, &cells);
	const size_t seen = seen_cells(atlas, &cells, &partly, &widest);
	printf("%zu cells, %zu seen, %zu of them in part\n", n, seen, partly);
	assert_true(n == 60 && seen > 10 && seen < 50 && partly > 5 && !cells.any_flat);
	bb_gl_sight_make(&full, sight);
	bb_gl_cells_fill(atlas, &layout, texel, sight, &cells);
	assert_int_equal(seen_cells(atlas, &cells, &partly, &widest), n);
	assert_true(partly == 0 && widest == 3); /* 5 x 4 x 3 cells: a cube of 8 holds them all */
	free(sight);
	free(cells.place[0]);
	free(cells.place[1]);
	free(cells.sign);
	drawing_done(&d);
}

/* Every slot has a place of its own, and the texture is not much larger than they are. */
static void slots_have_places(void **ctx)
{
	struct bb_gl_layout l;
	uint32_t a[3], b[3];

	(void)ctx;
	for (uint32_t n = 1; n < 20000; n = n * 3 + 1)
		for (uint32_t stored = 10; stored <= 66; stored += 8) {
			if (!bb_gl_layout_make(n, stored, 4, 2048, &l))
				continue;
			assert_true((uint64_t)l.across[0] * l.across[1] * l.across[2] >= n);
			assert_true(l.across[0] * stored <= 2048 && l.across[1] * stored <= 2048 && l.across[2] * stored <= 2048);
			for (uint32_t s = 0; s < n; s += 1 + n / 50) {
				bb_gl_layout_at(&l, s, a);
				assert_true(a[0] < l.across[0] && a[1] < l.across[1] && a[2] < l.across[2]);
				bb_gl_layout_at(&l, s + 1, b);
				assert_true(memcmp(a, b, sizeof(a)) != 0);
			}
		}
	assert_false(bb_gl_layout_make(1U << 31, 66, 4, 2048, &l));
	assert_false(bb_gl_layout_make(1, 66, 4, 64, &l));
}

/* ---- levels and cells of one value ---- */

static uint32_t mixed(const uint32_t cell[3], void *ctx)
{
	const uint32_t block = cell[0] / 2 + 3 * (cell[1] / 2) + 5 * (cell[2] / 2);

	(void)ctx;
	return block % 4 == 3 ? (cell[0] + cell[1] + cell[2]) % 3 : block % 3;
}

static void flatten(struct cover *c)
{
	const uint32_t *g = c->atlas.grid;

	for (uint32_t i = 0; i < g[0] * g[1] * g[2]; i++)
		for (uint32_t k = 0; k < 2; k++)
			if (i % 7 < 2 && (k == 0 || i % 7 == 0 || c->atlas.n_shown == 1))
				c->map[k][i] = (struct bb_atlas_cell){ BB_ATLAS_FLAT, 0, (float)(i % 5) / 4 };
	c->atlas.map_generation++;
}

static double against_oracle(const struct bb_layer *layer, int view, double step_voxels, bool by_level)
{
	const struct bb_view v = drawing_view(view);
	const struct bb_draw draw = {
		.view = &v, .layers = layer, .n_layers = 1, .step_voxels = step_voxels, .steps_by_level = by_level
	};
	struct bb_image_difference d;
	struct bb_image a, b;

	assert_int_equal(bb_image_create(WIDTH, HEIGHT, &a), BB_OK);
	assert_int_equal(bb_image_create(WIDTH, HEIGHT, &b), BB_OK);
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &a, NULL), BB_OK);
	oracle_draw(&draw, &b);
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	assert_true(d.n_pixels > 500);
	printf("edge %u, %s, step %.1f of %.2f voxels%s, view %d: %.1f dB, most %u/255\n", layer->atlas->edge,
	       bb_brick_type_text(layer->atlas->type), layer->atlas->time, step_voxels, by_level ? " by level" : "", view,
	       d.psnr_db, d.most);
	bb_image_release(&a);
	bb_image_release(&b);
	return d.psnr_db;
}

static void levels_and_flat_cells_are_drawn_as_the_map_says(void **ctx)
{
	static const struct {
		uint32_t edge;
		enum bb_brick_type type;
		double time, step_voxels;
		bool flats, by_level;
	} rows[] = { { 8, BB_BRICK_F32, 0, 0.7, false, false },  { 8, BB_BRICK_F32, 0.4, 0.7, true, false },
		     { 16, BB_BRICK_U16, 1, 1, true, false },    { 16, BB_BRICK_F16, 0, 0.5, false, true },
		     { 8, BB_BRICK_F32, 0.6, 0.25, true, true }, { 8, BB_BRICK_F32, 0, 0.5, true, false },
		     { 16, BB_BRICK_F32, 0.4, 0.5, false, false } };

	(void)ctx;
	need_gl();
	for (size_t k = 0; k < BB_ARRAY_LEN(rows); k++) {
		struct drawing d = drawing_of(fixture.volume, &fixture.transfer, rows[k].edge, rows[k].type, rows[k].time, mixed,
					      NULL);
		if (rows[k].flats)
			flatten(d.cover);
		for (int i = 0; i < DRAWING_VIEWS; i++)
			assert_true(against_oracle(&d.layer, i, rows[k].step_voxels, rows[k].by_level) >= 50);
		bb_renderer_forget(fixture.gl);
		drawing_done(&d);
	}
}

/* ---- what is sent ---- */

static uint64_t sent_for(const struct bb_layer *layer, double step_voxels)
{
	struct bb_draw_stats stats;
	struct bb_image image = drawing_picture(fixture.gl, layer, 1, 0, step_voxels, &stats);

	bb_image_release(&image);
	return stats.upload_bytes;
}

static void only_what_changed_is_sent(void **ctx)
{
	const uint64_t table_bytes = BB_GL_TABLE_ENTRIES * 16, map_bytes = 5 * 4 * 3 * 16;
	struct bb_transfer tf = fixture.transfer;
	struct drawing d = drawing_of(fixture.volume, &tf, 16, BB_BRICK_U16, 1, cover_leaves, NULL);
	struct bb_atlas *atlas = &d.cover->atlas;

	(void)ctx;
	need_gl();
	assert_int_equal(sent_for(&d.layer, 1), atlas->n_slots * atlas->slot_bytes + 3 * map_bytes + table_bytes);
	assert_int_equal(sent_for(&d.layer, 1), 0);
	for (uint32_t s = 3; s < 9; s += s == 4 ? 3 : 1) { /* 3, 4, 7, 8: pairs beside each other */
		memset(d.cover->bricks + s * atlas->slot_bytes, 0, atlas->slot_bytes);
		d.cover->generation[s] = ++atlas->generation;
	}
	assert_int_equal(sent_for(&d.layer, 1), 4 * atlas->slot_bytes);
	d.cover->map[0][7] = d.cover->map[0][31]; /* another brick */
	assert_int_equal(sent_for(&d.layer, 1), 0);
	atlas->map_generation++;
	assert_int_equal(sent_for(&d.layer, 1), map_bytes);
	atlas->map_generation++; /* it says so, but nothing has changed */
	assert_int_equal(sent_for(&d.layer, 1), 0);
	assert_int_equal(sent_for(&d.layer, 0.5), table_bytes);
	tf.point[3].g = 0; /* edited in place */
	assert_int_equal(sent_for(&d.layer, 0.5), table_bytes);
	bb_renderer_forget(fixture.gl);
	assert_true(sent_for(&d.layer, 0.5) > atlas->n_slots * atlas->slot_bytes);
	bb_renderer_forget(fixture.gl);
	drawing_done(&d);
}

/* A slot's new content is drawn by the very draw that sends it, also where its old one showed nothing. */
static void new_bricks_are_drawn_at_once(void **ctx)
{
	struct drawing d = drawing_of(fixture.volume, &fixture.transfer, 16, BB_BRICK_U16, 1, cover_leaves, NULL);
	struct bb_atlas *atlas = &d.cover->atlas;
	const size_t bytes = atlas->n_slots * atlas->slot_bytes, n = atlas->blocks * atlas->blocks * atlas->blocks;
	uint8_t *kept = malloc(bytes);

	(void)ctx;
	need_gl();
	memcpy(kept, d.cover->bricks, bytes);
	memset(d.cover->bricks, 0, bytes);
	memset(d.cover->range, 0, atlas->n_slots * n * sizeof(*d.cover->range));
	struct bb_image image = drawing_picture(fixture.gl, &d.layer, 1, 0, 0.5, NULL);
	for (size_t i = 0; i < PICTURE_BYTES; i++)
		assert_int_equal(image.rgba[i], 0);
	bb_image_release(&image);
	for (uint32_t s = 0; s < atlas->n_slots; s++) {
		memcpy(d.cover->bricks + s * atlas->slot_bytes, kept + s * atlas->slot_bytes, atlas->slot_bytes);
		(void)bb_atlas_accept(atlas, d.cover->bricks + s * atlas->slot_bytes, d.cover->range + s * n);
		d.cover->generation[s] = ++atlas->generation;
	}
	assert_true(against_reference(&d.layer, 0, 0.5).psnr_db >= 55);
	bb_renderer_forget(fixture.gl);
	free(kept);
	drawing_done(&d);
}

/* The same atlas with more slots, as after a change of budgets: all of it is sent again, and drawn as before. */
static void an_atlas_may_grow(void **ctx)
{
	struct drawing d = drawing_of(fixture.volume, &fixture.transfer, 8, BB_BRICK_U16, 1, cover_leaves, NULL);
	struct bb_atlas *atlas = &d.cover->atlas;
	const uint32_t all = atlas->n_slots;

	(void)ctx;
	need_gl();
	atlas->n_slots = 100; /* none but the first hundred is there */
	for (size_t i = 0; i < (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2]; i++)
		if (d.cover->map[0][i].slot >= 100)
			d.cover->map[0][i] = (struct bb_atlas_cell){ BB_ATLAS_FLAT, 0, 0 };
	assert_true(sent_for(&d.layer, 1) > 100 * atlas->slot_bytes);
	for (size_t i = 0; i < (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2]; i++)
		d.cover->map[0][i] = (struct bb_atlas_cell){ (int32_t)i, 0, 0 };
	atlas->n_slots = all;
	atlas->map_generation++;
	assert_true(sent_for(&d.layer, 0.5) > all * atlas->slot_bytes);
	assert_true(against_reference(&d.layer, 0, 0.5).psnr_db >= 55);
	bb_renderer_forget(fixture.gl);
	drawing_done(&d);
}

static void bricks_without_padding_are_refused(void **ctx)
{
	struct bb_bricks *b = cover_bricks(fixture.volume, 16, 0, BB_BRICK_U16);
	struct bb_atlas atlas = { 0 };
	const struct bb_layer layer = { &atlas, &fixture.transfer, drawing_placement(fixture.volume), NULL };
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = { .view = &view, .layers = &layer, .n_layers = 1, .step_voxels = 1 };
	struct bb_image image;

	(void)ctx;
	need_gl();
	bb_atlas_describe(&atlas, bb_bricks_header(b));
	assert_int_equal(bb_image_create(8, 8, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, NULL), BB_ERR_UNSUPPORTED);
	assert_int_equal(bb_renderer_last_error(fixture.gl)->number, 1471);
	bb_image_release(&image);
	bb_bricks_close(b);
}

/* ---- several volumes, meshes, balls ---- */

static double worst_of(struct scene *s, const char *name)
{
	const double db = scene_worst_db(fixture.gl, fixture.reference, s, name);

	bb_renderer_forget(fixture.gl);
	scene_free(s);
	return db;
}

static void two_volumes_agree_with_the_reference(void **ctx)
{
	(void)ctx;
	need_gl();
	assert_true(worst_of(scene_two_volumes(cover_leaves, NULL), "gl, two volumes") >= 50);
}

static void meshes_between_them_do(void **ctx)
{
	(void)ctx;
	need_gl();
	assert_true(scene_worst_db(fixture.gl, fixture.reference, fixture.scene, "gl, two volumes and meshes") >= 45);
	bb_renderer_forget(fixture.gl);
}

static void spherical_volumes_do(void **ctx)
{
	(void)ctx;
	need_gl();
	assert_true(worst_of(scene_ball(false, cover_leaves, NULL), "gl, ball") >= 50);
	assert_true(worst_of(scene_ball(true, cover_leaves, NULL), "gl, wedge") >= 50);
}

/* A ball, a box and meshes: every kind of layer beside another one. */
static void a_ball_in_a_box_does(void **ctx)
{
	struct scene *ball = scene_ball(false, cover_leaves, NULL), *all = scene_two_volumes(cover_leaves, NULL);
	const struct bb_layer layers[3] = { all->layer[0], ball->layer[0], all->layer[1] };
	const struct bb_view view = scene_view(7);

	(void)ctx;
	need_gl();
	scene_add_meshes(all);
	for (size_t n = 2; n <= 3; n++) {
		const struct bb_draw draw = { .view = &view, .layers = layers, .n_layers = n, .meshes = all->mesh,
					      .n_meshes = n - 1, .step_voxels = 0.5 };
		struct bb_image_difference d;
		struct bb_image a, b;
		assert_int_equal(bb_image_create(WIDTH, HEIGHT, &a), BB_OK);
		assert_int_equal(bb_image_create(WIDTH, HEIGHT, &b), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &a, NULL), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.reference, &draw, &b, NULL), BB_OK);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		printf("a ball among %zu layers: %.1f dB\n", n, d.psnr_db);
		assert_true(d.n_pixels > 1000 && d.psnr_db >= 45);
		bb_image_release(&a);
		bb_image_release(&b);
	}
	bb_renderer_forget(fixture.gl);
	scene_free(ball);
	scene_free(all);
}

/* Forty squares behind each other: the nearest thirty-two are drawn; and two in one place, both of them. */
static void as_many_surfaces_as_there_is_room_for(void **ctx)
{
	struct bb_mesh squares[40];
	const struct bb_transfer_point nothing[] = { { 0, 0, 0, 0, 0 }, { 1, 0, 0, 0, 0 } };
	const struct bb_transfer tf = drawing_transfer(2, nothing);
	struct bb_layer layer = fixture.drawing.layer;
	const struct bb_view view = scene_view(0);
	struct bb_image_difference d;

	(void)ctx;
	need_gl();
	layer.transfer = &tf;
	for (int i = 0; i < 40; i++) { /* from behind to the front, each faint */
		squares[i] = scene_square((struct bb_vec3){ 0.1, 1.4, -1.2 + 0.04 * (i - i % 2) }, 0.6, bb_quat_euler_deg(0, 80, 0));
		float(*rgba)[4] = (float(*)[4])(uintptr_t)squares[i].rgba;
		for (int k = 0; k < 4; k++)
			rgba[k][3] *= 0.1F;
	}
	for (size_t n = 2; n <= 40; n += 19) {
		const struct bb_draw draw = { .view = &view, .layers = &layer, .n_layers = 1, .meshes = squares, .n_meshes = n,
					      .step_voxels = 1 };
		struct bb_image a, b;
		assert_int_equal(bb_image_create(WIDTH, HEIGHT, &a), BB_OK);
		assert_int_equal(bb_image_create(WIDTH, HEIGHT, &b), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &a, NULL), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.reference, &draw, &b, NULL), BB_OK);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		printf("%zu squares: %.1f dB over %lu pixels\n", n, d.psnr_db, (unsigned long)d.n_pixels);
		assert_true(d.n_pixels > 1000 && d.psnr_db >= 45);
		bb_image_release(&a);
		bb_image_release(&b);
	}
	bb_renderer_forget(fixture.gl);
	for (int i = 0; i < 40; i++)
		scene_mesh_free(&squares[i]);
}

static void meshes_are_sent_when_they_change(void **ctx)
{
	struct bb_mesh mesh = scene_square((struct bb_vec3){ 0.1, 1.4, -0.3 }, 0.6, bb_quat_euler_deg(20, 35, 10));
	const struct bb_view view[2] = { scene_view(0), scene_view(1) };
	struct bb_draw draw = { .view = &view[0], .layers = &fixture.drawing.layer, .n_layers = 1, .meshes = &mesh,
				.n_meshes = 1, .step_voxels = 1 };
	struct bb_draw_stats stats;
	struct bb_image image;

	(void)ctx;
	need_gl();
	assert_int_equal(bb_image_create(WIDTH, HEIGHT, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, &stats), BB_OK);
	const uint64_t all = stats.upload_bytes;
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, &stats), BB_OK);
	assert_int_equal(stats.upload_bytes, 0);
	draw.view = &view[1]; /* tiles, but no colours */
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, &stats), BB_OK);
	const uint64_t tiles = stats.upload_bytes;
	assert_true(tiles > 0 && tiles < all);
	mesh.generation++;
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, &stats), BB_OK);
	assert_int_equal(stats.upload_bytes, tiles + 2 * 3 * 16);
	mesh.n_vertices = 3; /* a triangle names a vertex that is not there */
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, &stats), BB_ERR_RANGE);
	assert_int_equal(bb_renderer_last_error(fixture.gl)->number, 1816);
	bb_image_release(&image);
	bb_renderer_forget(fixture.gl);
	scene_mesh_free(&mesh);
}

/* ---- renderers and pictures ---- */

static void two_renderers_take_turns(void **ctx)
{
	struct bb_renderer *other = NULL;
	struct bb_volume *v = drawing_volume(20, 20, 20, 1);
	const struct bb_layer *layer = &fixture.drawing.layer;

	(void)ctx;
	need_gl();
	struct drawing d = drawing_of(v, &fixture.transfer, 8, BB_BRICK_U16, 0, cover_leaves, NULL);
	struct bb_image before = drawing_picture(fixture.gl, layer, 1, 0, 1, NULL);
	assert_int_equal(bb_renderer_gl_create("auto", &other, NULL), BB_OK);
	struct bb_image image = drawing_picture(other, &d.layer, 1, 1, 1, NULL);
	struct bb_image after = drawing_picture(fixture.gl, layer, 1, 0, 1, NULL);
	assert_memory_equal(before.rgba, after.rgba, PICTURE_BYTES);
	assert_memory_not_equal(image.rgba, after.rgba, PICTURE_BYTES);
	bb_renderer_destroy(other);
	bb_image_release(&after);
	after = drawing_picture(fixture.gl, layer, 1, 0, 1, NULL);
	assert_memory_equal(before.rgba, after.rgba, PICTURE_BYTES);
	bb_image_release(&before);
	bb_image_release(&image);
	bb_image_release(&after);
	drawing_done(&d);
	drawing_free(v);
}

static void sizes_may_change(void **ctx)
{
	const struct bb_view view = drawing_view(0);
	const struct bb_draw draw = { .view = &view, .layers = &fixture.drawing.layer, .n_layers = 1, .step_voxels = 1 };
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
	const struct bb_draw draw = { .view = &view, .layers = &fixture.drawing.layer, .n_layers = 1, .step_voxels = 1 };
	struct bb_image image;

	(void)ctx;
	need_gl();
	assert_int_equal(bb_image_create(32768, 1, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(fixture.gl, &draw, &image, NULL), BB_ERR_RANGE);
	assert_int_equal(bb_renderer_last_error(fixture.gl)->number, 1805);
	bb_image_release(&image);
	image = drawing_picture(fixture.gl, &fixture.drawing.layer, 1, 0, 1, NULL); /* and it goes on */
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

/* ---- OSMesa and EGL ---- */

/* 0 to 2 of one volume, the others of two and meshes. */
static struct bb_image egl_picture(struct bb_renderer *r, int i)
{
	return i < 3 ? drawing_picture(r, &fixture.drawing.layer, 1, i, 0.5, NULL) :
		       scene_picture(r, fixture.scene, 3 * (i - 3), 0.5, false, NULL);
}

static void osmesa_and_egl_draw_the_same(void **ctx)
{
	size_t n_differ = 0;

	(void)ctx;
	need_gl();
	if (!fixture.by_egl) {
		printf("SKIP: no EGL on this machine\n");
		skip();
	}
	for (int i = 0; i < EGL_PICTURES; i++) {
		struct bb_image image = egl_picture(fixture.gl, i);
		for (size_t k = 0; k < PICTURE_BYTES; k += 4)
			n_differ += memcmp(image.rgba + k, fixture.by_egl + (size_t)i * PICTURE_BYTES + k, 4) != 0;
		bb_image_release(&image);
	}
	printf("OSMesa and EGL: %zu of %d pixels differ\n", n_differ, EGL_PICTURES * WIDTH * HEIGHT);
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
	for (int i = 0; i < EGL_PICTURES; i++) {
		struct bb_image image = egl_picture(r, i);
		memcpy(out + (size_t)i * PICTURE_BYTES, image.rgba, PICTURE_BYTES);
	}
	return 0;
}

static void make_egl_pictures(void)
{
	uint8_t *shared =
		mmap(NULL, EGL_PICTURES * PICTURE_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	int status = -1;

	if (shared == MAP_FAILED)
		return;
	const pid_t child = fork();
	if (child == 0)
		_exit(draw_by_egl(shared));
	if (child > 0 && waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0)
		fixture.by_egl = shared;
	else
		munmap(shared, EGL_PICTURES * PICTURE_BYTES);
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
	fixture.drawing = drawing_of(fixture.volume, &fixture.transfer, 16, BB_BRICK_U16, 1.35, cover_leaves, NULL);
	fixture.scene = scene_two_volumes(cover_leaves, NULL);
	scene_add_meshes(fixture.scene);
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
	scene_free(fixture.scene);
	drawing_done(&fixture.drawing);
	drawing_free(fixture.volume);
	if (fixture.by_egl)
		munmap(fixture.by_egl, EGL_PICTURES * PICTURE_BYTES);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(signs_say_what_can_be_skipped),
		cmocka_unit_test(slots_have_places),
		cmocka_unit_test(agrees_with_the_reference),
		cmocka_unit_test(agrees_on_noise),
		cmocka_unit_test(agrees_on_a_sharp_transfer_function),
		cmocka_unit_test(twice_the_samples_change_little),
		cmocka_unit_test(sees_between_two_invisible_steps),
		cmocka_unit_test(skipping_empty_bricks_changes_nothing),
		cmocka_unit_test(levels_and_flat_cells_are_drawn_as_the_map_says),
		cmocka_unit_test(only_what_changed_is_sent),
		cmocka_unit_test(new_bricks_are_drawn_at_once),
		cmocka_unit_test(an_atlas_may_grow),
		cmocka_unit_test(bricks_without_padding_are_refused),
		cmocka_unit_test(two_volumes_agree_with_the_reference),
		cmocka_unit_test(meshes_between_them_do),
		cmocka_unit_test(spherical_volumes_do),
		cmocka_unit_test(a_ball_in_a_box_does),
		cmocka_unit_test(as_many_surfaces_as_there_is_room_for),
		cmocka_unit_test(meshes_are_sent_when_they_change),
		cmocka_unit_test(two_renderers_take_turns),
		cmocka_unit_test(sizes_may_change),
		cmocka_unit_test(too_large_a_picture_is_an_error),
		cmocka_unit_test(wrong_kinds_are_refused),
		cmocka_unit_test(osmesa_and_egl_draw_the_same),
	};

	return cmocka_run_group_tests(tests, set_up, tear_down);
}
