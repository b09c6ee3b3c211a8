/*
 * tests/test_cpu.c: the native ray caster, each kernel that this processor has: against the reference, against the
 * words of atlas.h (atlas_oracle.h) where bricks of all levels and flat cells lie beside each other, against itself.
 */
#include "tests/drawing.h"

#include "render/cpu/options.h"
#include "tests/atlas_oracle.h"

#define WIDTH 96
#define HEIGHT 72
#define VIEWS 10

static const char *const kernels[] = { "avx512", "avx2", "portable" };

static struct {
	struct bb_renderer *reference, *cpu; /* cpu: the kernel under test */
	const char *kernel;
	struct bb_volume *volume;
	struct bb_transfer smooth, sharp;
} fixture;

static bool need_kernel(void)
{
	if (fixture.cpu)
		return true;
	printf("SKIP: %s: this processor does not have it\n", fixture.kernel);
	skip();
	return false;
}

static uint32_t random_next(uint32_t *state)
{
	*state = *state * 1664525U + 1013904223U;
	return *state >> 8;
}

/* From all around, near and far, along an axis, and (the last three) with the head inside. */
static struct bb_view view_of(int i)
{
	static const struct bb_corners wall = { { -1.5, 0.2, -1.5 }, { 1.5, 0.2, -1.5 }, { -1.5, 2.6, -1.5 } };
	static const struct bb_vec3 eyes[VIEWS] = { { 0.3, 1.6, 1.4 },  { 1.6, 2.2, 0.5 },    { -1.2, 0.4, 0.7 },
						    { 0.1, 1.4, 2.5 },  { 0.1, 1.4, 0.4 },    { 3, 1, 4 },
						    { -0.6, 2.0, 1 },   { 0.15, 1.45, -0.2 }, { 0, 1.2, -0.45 },
						    { 0.45, 1.6, -0.1 } };

	return bb_view_make(&wall, eyes[i], eyes[0], 0.05, 50);
}

static struct bb_image new_image(void)
{
	struct bb_image image;

	assert_int_equal(bb_image_create(WIDTH, HEIGHT, &image), BB_OK);
	return image;
}

static struct bb_image picture(struct bb_renderer *r, const struct bb_draw *draw, struct bb_draw_stats *stats)
{
	struct bb_image image = new_image();

	assert_int_equal(bb_renderer_draw(r, draw, &image, stats), BB_OK);
	return image;
}

/* Compares and releases both. */
static struct bb_image_difference compare(const char *name, struct bb_image *a, struct bb_image *b)
{
	struct bb_image_difference d;

	assert_int_equal(bb_image_compare(a, b, &d), BB_OK);
	printf("%s, %s: %.1f dB over %lu pixels, most %u/255\n", fixture.kernel, name, d.psnr_db,
	       (unsigned long)d.n_pixels, d.most);
	bb_image_release(a);
	bb_image_release(b);
	return d;
}

static void against_reference(const char *name, const struct bb_layer *layer, int view, double step_voxels,
			      double least_db)
{
	const struct bb_view v = view_of(view);
	const struct bb_draw draw = { .view = &v, .layers = layer, .n_layers = 1, .step_voxels = step_voxels };
	struct bb_draw_stats own, theirs;
	struct bb_image a = picture(fixture.cpu, &draw, &own), b = picture(fixture.reference, &draw, &theirs);
	char text[80];

	snprintf(text, sizeof(text), "%s, view %d at step %.2f", name, view, layer->atlas->time);
	assert_int_equal(own.rays, theirs.rays);
	assert_true(own.samples <= theirs.samples);
	const struct bb_image_difference d = compare(text, &a, &b);
	assert_true(d.n_pixels > 100);
	assert_true(d.psnr_db >= least_db);
	bb_renderer_forget(fixture.cpu);
}

static void agrees_with_the_reference(void **ctx)
{
	static const struct {
		enum bb_brick_type type;
		uint32_t edge;
		double time, least_db;
	} rows[] = { { BB_BRICK_F32, 16, 1, 60 },  { BB_BRICK_F32, 8, 1.35, 60 }, { BB_BRICK_U16, 8, 0.5, 58 },
		     { BB_BRICK_U16, 32, 2, 58 },  { BB_BRICK_F16, 12, 0.7, 50 }, { BB_BRICK_U8, 64, 1, 42 },
		     { BB_BRICK_F32, 4, 0.25, 60 } };

	(void)ctx;
	need_kernel();
	for (size_t k = 0; k < BB_ARRAY_LEN(rows); k++) {
		struct drawing d = drawing_of(fixture.volume, &fixture.smooth, rows[k].edge, rows[k].type, rows[k].time,
					      cover_leaves, NULL);
		for (int i = 0; i < VIEWS; i++)
			against_reference(bb_brick_type_text(rows[k].type), &d.layer, i, 0.5, rows[k].least_db);
		drawing_done(&d);
	}
}

/* Noise shows every misplaced voxel, border and seam; several sizes, some just past a whole brick, some one voxel thin.
 */
static void agrees_on_noise(void **ctx)
{
	static const uint32_t sizes[][3] = { { 33, 16, 17 }, { 32, 32, 32 }, { 5, 40, 3 }, { 48, 2, 20 }, { 2, 2, 2 } };
	uint32_t state = 1;

	(void)ctx;
	need_kernel();
	for (size_t k = 0; k < BB_ARRAY_LEN(sizes); k++) {
		struct bb_volume *v = drawing_noise(sizes[k], 2, &state);
		struct drawing d = drawing_of(v, &fixture.smooth, k % 2 ? 8 : 16, k % 2 ? BB_BRICK_U16 : BB_BRICK_F32,
					      0.5, cover_leaves, NULL);
		for (int i = 0; i < VIEWS; i++)
			against_reference("noise", &d.layer, i, 0.7, 54);
		drawing_done(&d);
		drawing_free(v);
	}
}

static void agrees_on_a_sharp_transfer_function(void **ctx)
{
	struct drawing d = drawing_of(fixture.volume, &fixture.sharp, 8, BB_BRICK_F32, 0.8, cover_leaves, NULL);

	(void)ctx;
	if (fixture.cpu)
		for (int i = 0; i < VIEWS; i++)
			against_reference("sharp", &d.layer, i, 0.5, 50);
	drawing_done(&d);
	need_kernel();
}

/* Mist of an opacity that eight bits could not hold, a thousand samples deep. */
static void thin_mist_adds_up(void **ctx)
{
	static const struct bb_transfer_point mist[] = { { 0, 1, 1, 1, 2e-3 }, { 1, 1, 0.5, 0.5, 3e-3 } };
	const struct bb_transfer tf = drawing_transfer(BB_ARRAY_LEN(mist), mist);
	struct drawing d = drawing_of(fixture.volume, &tf, 16, BB_BRICK_F32, 0.3, cover_leaves, NULL);

	(void)ctx;
	if (fixture.cpu)
		against_reference("mist", &d.layer, 0, 1.0 / 16, 50);
	drawing_done(&d);
	need_kernel();
}

/* Lumps of several colours far apart in one brick, which is drawn block by block: the near ones hide the far ones. */
static void blocks_hide_each_other(void **ctx)
{
	static const struct bb_transfer_point lumps[] = {
		{ 0, 0, 0, 0, 0 }, { 0.3, 1, 0, 0, 0 }, { 0.5, 1, 0, 0, 0.9 }, { 0.7, 0, 1, 0, 0.9 }, { 1, 0, 0, 1, 0.9 }
	};
	const struct bb_transfer tf = drawing_transfer(BB_ARRAY_LEN(lumps), lumps);
	struct bb_volume *v = drawing_volume(64, 64, 64, 1);

	(void)ctx;
	need_kernel();
	for (uint32_t i = 0; i < 64 * 64 * 64; i++) { /* three in eleven blocks: too few to be drawn as one */
		const uint32_t at[3] = { i % 64, i / 64 % 64, i / 4096 }, x = at[0] / 8, y = at[1] / 8, z = at[2] / 8;
		const uint32_t h = (x + 3 * y + 5 * z) % 11;
		const bool in = at[0] % 8 - 2 < 4 && at[1] % 8 - 2 < 4 && at[2] % 8 - 2 < 4;
		v->voxels[i] = h < 3 && in ? (uint16_t)(65535 / 4 * (2 + h)) : 0;
	}
	for (uint32_t edge = 32; edge <= 64; edge += 32) {
		struct drawing d = drawing_of(v, &tf, edge, BB_BRICK_U16, 0, cover_leaves, NULL);
		for (int i = 0; i < VIEWS; i++)
			against_reference("lumps", &d.layer, i, 0.5, 50);
		drawing_done(&d);
	}
	drawing_free(v);
}

/* ---- bricks of all levels beside each other ---- */

static uint32_t any_level(const uint32_t cell[3], void *ctx)
{
	const uint32_t *salt = ctx;
	/* By coarse blocks, so that there are whole coarse bricks as well as broken ones. */
	uint32_t h =
		(cell[0] / 4 * 73856093U) ^ (cell[1] / 4 * 19349663U) ^ (cell[2] / 4 * 83492791U) ^ *salt * 2654435761U;

	if (h >> 7 & 1)
		h ^= cell[0] * 40503U + cell[1] * 30011U + cell[2] * 977U;
	return (h >> 12) % 4;
}

/* Some cells flat, alone and beside each other, in one of the steps or in both. */
static void flatten(struct cover *c, uint32_t *state)
{
	const uint32_t *g = c->atlas.grid;

	for (uint32_t i = 0; i < g[0] * g[1] * g[2]; i++)
		for (uint32_t k = 0; k < c->atlas.n_shown; k++)
			if (random_next(state) % 5 == 0) {
				const float value = (float)(random_next(state) % 4) / 4;
				c->map[k][i] = (struct bb_atlas_cell){ BB_ATLAS_FLAT, random_next(state) % 3, value };
				if (i % 2)
					c->map[k][i - 1] = c->map[k][i];
			}
	if (c->atlas.n_shown == 1)
		memcpy(c->map[1], c->map[0], (size_t)g[0] * g[1] * g[2] * sizeof(*c->map[0]));
	c->atlas.map_generation++;
}

static uint64_t against_oracle(struct bb_renderer *r, const char *name, const struct bb_draw *draw, double least_db)
{
	struct bb_image a = picture(r, draw, NULL), b = new_image();

	oracle_draw(draw, &b);
	const struct bb_image_difference d = compare(name, &a, &b);
	assert_true(!d.n_pixels || d.psnr_db >= least_db); /* a sharp edge may not be found in a coarse brick at all */
	return d.n_pixels;
}

static void draws_what_the_map_names(void **ctx)
{
	static const uint32_t edges[] = { 8, 16, 10, 4 }, sizes[][3] = { { 70, 60, 44 }, { 33, 90, 21 } };
	uint64_t n_pixels = 0;
	uint32_t state = 5;

	(void)ctx;
	need_kernel();
	for (uint32_t k = 0; k < 16; k++) {
		struct bb_volume *v = k & 1 ? drawing_noise(sizes[k / 8], 3, &state) : drawing_volume(70, 60, 44, 3);
		const double time = k % 3 ? 1 : 0.4;
		struct drawing d = drawing_of(v, k & 2 ? &fixture.sharp : &fixture.smooth, edges[k % 4],
					      (enum bb_brick_type)(k / 2 % BB_BRICK_TYPES), time, any_level, &k);
		if (k & 4)
			flatten(d.cover, &state);
		for (int i = (int)k % 2; i < VIEWS; i += 3) {
			const struct bb_view view = view_of(i);
			const struct bb_draw draw = { .view = &view,
						      .layers = &d.layer,
						      .n_layers = 1,
						      .step_voxels = 0.5,
						      .steps_by_level = k % 5 < 2 };
			char name[80];
			snprintf(name, sizeof(name), "levels: %s, edge %u, view %d%s%s%s",
				 bb_brick_type_text(d.layer.atlas->type), edges[k % 4], i,
				 time < 1 ? ", between steps" : "", k & 4 ? ", flat ones" : "",
				 draw.steps_by_level ? ", steps by level" : "");
			n_pixels += against_oracle(fixture.cpu, name, &draw, k & 2 ? 50 : 54);
		}
		bb_renderer_forget(fixture.cpu);
		drawing_done(&d);
		drawing_free(v);
	}
	assert_true(n_pixels > 50000);
}

/* ---- against itself ---- */

/* What is kept from one picture to the next must not show: random edits, and a renderer that has seen none. */
static void what_changes_is_noticed(void **ctx)
{
	uint32_t state = 77, zero = 0;
	struct drawing d = drawing_of(fixture.volume, &fixture.smooth, 8, BB_BRICK_U16, 0.5, any_level, &zero);
	struct bb_atlas *a = &d.cover->atlas;
	const size_t n_cells = (size_t)a->grid[0] * a->grid[1] * a->grid[2];
	uint64_t last = 0;

	(void)ctx;
	for (int round = 0; fixture.cpu && round < 40; round++) {
		const struct bb_view view = view_of(round % VIEWS);
		const struct bb_draw draw = { .view = &view,
					      .layers = &d.layer,
					      .n_layers = 1,
					      .step_voxels = round % 7 == 3 ? 1 : 0.5,
					      .steps_by_level = round % 3 == 0 };
		struct bb_renderer *other;
		struct bb_image_difference difference;
		switch (random_next(&state) % 4) {
		case 0:
			d.layer.transfer = round % 2 ? &fixture.smooth : &fixture.sharp;
			break;
		case 1: { /* another brick comes into a slot */
			const uint32_t slot = random_next(&state) % a->n_slots, value = random_next(&state) % 65536;
			uint16_t *v = (uint16_t *)(void *)(d.cover->bricks + slot * a->slot_bytes);
			for (size_t i = 0; i < a->slot_bytes / 2; i++)
				v[i] = (uint16_t)(i % 13 ? value : 0);
			(void)bb_atlas_accept(a, (uint8_t *)v, d.cover->range + (size_t)slot);
			d.cover->generation[slot] = ++a->generation;
			break;
		}
		case 2:
			a->time = round % 4 * 0.25;
			a->mix = (float)a->time;
			break;
		default:
			for (int i = 0; i < 20; i++)
				d.cover->map[round % 2][random_next(&state) % n_cells] =
					(struct bb_atlas_cell){ BB_ATLAS_FLAT, 0, (float)(random_next(&state) % 2) };
			a->map_generation++;
		}
		assert_int_equal(bb_renderer_cpu_create(fixture.kernel, 1, &other, NULL), BB_OK);
		struct bb_image x = picture(fixture.cpu, &draw, NULL), y = picture(other, &draw, NULL);
		assert_int_equal(bb_image_compare(&x, &y, &difference), BB_OK);
		assert_memory_equal(x.rgba, y.rgba, (size_t)WIDTH * HEIGHT * 4);
		last = difference.n_pixels;
		bb_image_release(&x);
		bb_image_release(&y);
		bb_renderer_destroy(other);
	}
	if (fixture.cpu)
		bb_renderer_forget(fixture.cpu);
	drawing_done(&d);
	need_kernel();
	assert_true(last > 100);
}

static void threads_and_sizes_change_nothing(void **ctx)
{
	const struct bb_view view = view_of(1);
	struct drawing d = drawing_of(fixture.volume, &fixture.smooth, 8, BB_BRICK_U16, 0.4, cover_leaves, NULL);
	const struct bb_draw draw = { .view = &view, .layers = &d.layer, .n_layers = 1, .step_voxels = 0.5 };
	struct bb_renderer *other = NULL;

	(void)ctx;
	if (fixture.cpu)
		assert_int_equal(bb_renderer_cpu_create(fixture.kernel, 3, &other, NULL), BB_OK);
	for (uint32_t width = 1; other && width < 300; width = width * 3 + 2) {
		struct bb_image a, b;
		assert_int_equal(bb_image_create(width, 37, &a), BB_OK);
		assert_int_equal(bb_image_create(width, 37, &b), BB_OK);
		memset(a.rgba, 0x5A, (size_t)width * 37 * 4);
		assert_int_equal(bb_renderer_draw(fixture.cpu, &draw, &a, NULL), BB_OK);
		assert_int_equal(bb_renderer_draw(other, &draw, &b, NULL), BB_OK);
		assert_memory_equal(a.rgba, b.rgba, (size_t)width * 37 * 4);
		bb_image_release(&a);
		bb_image_release(&b);
	}
	bb_renderer_destroy(other);
	if (fixture.cpu)
		bb_renderer_forget(fixture.cpu);
	drawing_done(&d);
	need_kernel();
}

/* Leaving out what cannot be seen and drawing in another order show the same picture; the first takes fewer samples. */
static void switches_change_the_work_only(void **ctx)
{
	static uint32_t order[WIDTH * HEIGHT];
	struct drawing d = drawing_of(fixture.volume, &fixture.smooth, 8, BB_BRICK_F32, 0, cover_leaves, NULL);
	struct bb_renderer_cpu_options options[4] = { [0] = { 0 },
						      [1] = { .no_skipping = true },
						      [2] = { .no_skipping = true, .no_early_exit = true },
						      [3] = { .order = order, .n_order = WIDTH * HEIGHT } };
	uint64_t samples[4];
	uint32_t state = 3;

	(void)ctx;
	for (uint32_t i = 0; i < WIDTH * HEIGHT; i++) {
		const uint32_t j = random_next(&state) % (i + 1);
		order[i] = order[j];
		order[j] = i;
	}
	for (int i = 0; fixture.cpu && i < VIEWS; i++) {
		const struct bb_view view = view_of(i);
		const struct bb_draw draw = { .view = &view, .layers = &d.layer, .n_layers = 1, .step_voxels = 0.5 };
		for (size_t k = 0; k < BB_ARRAY_LEN(options); k++) {
			struct bb_renderer *r;
			struct bb_draw_stats stats;
			options[k].kernel = fixture.kernel;
			options[k].threads = 2;
			assert_int_equal(bb_renderer_cpu_create_with(&options[k], &r, NULL), BB_OK);
			struct bb_image a = picture(fixture.cpu, &draw, NULL), b = picture(r, &draw, &stats);
			const struct bb_image_difference diff = compare("switches", &a, &b);
			assert_true(diff.psnr_db >= 60);
			samples[k] = stats.samples;
			bb_renderer_destroy(r);
		}
		assert_true(samples[0] < samples[1] && samples[1] <= samples[2]);
	}
	if (fixture.cpu)
		bb_renderer_forget(fixture.cpu);
	drawing_done(&d);
	need_kernel();
}

static void kernels_agree(void **ctx)
{
	struct drawing d = drawing_of(fixture.volume, &fixture.sharp, 16, BB_BRICK_F32, 0.6, cover_leaves, NULL);
	struct bb_renderer *portable;

	(void)ctx;
	assert_int_equal(bb_renderer_cpu_create("portable", 2, &portable, NULL), BB_OK);
	for (int i = 0; fixture.cpu && i < VIEWS; i++) {
		const struct bb_view view = view_of(i);
		const struct bb_draw draw = { .view = &view, .layers = &d.layer, .n_layers = 1, .step_voxels = 0.5 };
		struct bb_image a = picture(fixture.cpu, &draw, NULL), b = picture(portable, &draw, NULL);
		assert_true(compare("portable", &a, &b).psnr_db >= 50);
	}
	bb_renderer_destroy(portable);
	if (fixture.cpu)
		bb_renderer_forget(fixture.cpu);
	drawing_done(&d);
	need_kernel();
}

static void wrong_wishes_are_refused(void **ctx)
{
	static const uint32_t order[1];
	const struct bb_renderer_cpu_options bad = { .kernel = "auto", .threads = 1, .order = order, .n_order = 1 };
	const struct bb_view view = view_of(0);
	struct drawing d = drawing_of(fixture.volume, &fixture.smooth, 16, BB_BRICK_U8, 0, cover_leaves, NULL);
	const struct bb_draw draw = { .view = &view, .layers = &d.layer, .n_layers = 1, .step_voxels = 0.5 };
	struct bb_image image = new_image();
	struct bb_renderer *r;
	struct bb_error err = { 0 };

	(void)ctx;
	assert_int_equal(bb_renderer_cpu_create("avx1024", 1, &r, &err), BB_ERR_UNSUPPORTED);
	assert_int_equal(err.number, 1801);
	assert_null(r);
	assert_int_equal(bb_renderer_cpu_create("auto", 0, &r, NULL), BB_ERR_RANGE);
	assert_int_equal(bb_renderer_cpu_create_with(&bad, &r, NULL), BB_OK);
	assert_int_equal(bb_renderer_draw(r, &draw, &image, NULL), BB_ERR_RANGE);
	bb_renderer_destroy(r);
	bb_image_release(&image);
	drawing_done(&d);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(agrees_with_the_reference),
		cmocka_unit_test(agrees_on_noise),
		cmocka_unit_test(agrees_on_a_sharp_transfer_function),
		cmocka_unit_test(thin_mist_adds_up),
		cmocka_unit_test(blocks_hide_each_other),
		cmocka_unit_test(draws_what_the_map_names),
		cmocka_unit_test(what_changes_is_noticed),
		cmocka_unit_test(threads_and_sizes_change_nothing),
		cmocka_unit_test(switches_change_the_work_only),
		cmocka_unit_test(kernels_agree),
		cmocka_unit_test(wrong_wishes_are_refused),
	};
	int failed = 0;

	fixture.volume = drawing_volume(70, 60, 44, 3);
	fixture.smooth = drawing_smooth();
	fixture.sharp = drawing_sharp();
	assert_int_equal(bb_renderer_reference_create(2, &fixture.reference), BB_OK);
	for (size_t k = 0; k < BB_ARRAY_LEN(kernels); k++) {
		fixture.kernel = kernels[k];
		(void)!bb_renderer_cpu_create(kernels[k], 2, &fixture.cpu, NULL);
		failed += cmocka_run_group_tests_name(kernels[k], tests, NULL, NULL);
		bb_renderer_destroy(fixture.cpu);
	}
	bb_renderer_destroy(fixture.reference);
	drawing_free(fixture.volume);
	return failed;
}
