/*
 * tests/test_seams.c: where bricks of different levels meet: how far values jump across their faces, drawn brick by
 * brick and with levels blended, what pictures make of it and what it costs.
 */
#include "tests/layers_scenes.h"

#include "render/cpu/layers.h"

#define ASIDE 1e-7 /* voxels from a face */

static double drawn_number(uint32_t *state)
{
	*state = *state * 1664525U + 1013904223U;
	return *state / 4294967296.0;
}

struct jumps {
	uint64_t n;
	double mean, most;
};

static void add_jump(struct jumps *j, double jump)
{
	j->n++;
	j->mean += (jump - j->mean) / (double)j->n;
	j->most = fmax(j->most, jump);
}

static const struct bb_atlas_cell *cell_at(const struct bb_atlas *a, const uint32_t c[3])
{
	return &a->map[0][((size_t)c[2] * a->grid[1] + c[1]) * a->grid[0] + c[0]];
}

/* Points on the face between a cell and the next one along an axis. */
static void add_face(const struct bb_atlas *a, const uint32_t cell[3], int axis, bool blend, uint32_t *state,
		     struct jumps *j)
{
	for (int i = 0; i < 8; i++) {
		double low[3], high[3];
		bool within = true;
		for (int k = 0; k < 3; k++) {
			low[k] = high[k] = (cell[k] + drawn_number(state)) * a->edge;
			within &= k == axis || low[k] < a->dim[k];
		}
		low[axis] = (cell[axis] + 1.0) * a->edge - ASIDE;
		high[axis] = low[axis] + 2 * ASIDE;
		if (bb_layer_around(a) && axis == 2 && cell[2] + 1 == a->grid[2]) {
			low[2] = a->dim[2] - ASIDE;
			high[2] = ASIDE;
		}
		if (within)
			add_jump(j, fabs(bb_layer_value(a, low, blend) - bb_layer_value(a, high, blend)));
	}
}

/* All faces where the level changes; or all where it does not. */
static struct jumps jumps_of(const struct bb_atlas *a, bool changing, bool blend)
{
	struct jumps j = { 0 };
	uint32_t state = 21, c[3];

	for (c[2] = 0; c[2] < a->grid[2]; c[2]++)
		for (c[1] = 0; c[1] < a->grid[1]; c[1]++)
			for (c[0] = 0; c[0] < a->grid[0]; c[0]++)
				for (int axis = 0; axis < 3; axis++) {
					uint32_t next[3] = { c[0], c[1], c[2] };
					next[axis]++;
					if (bb_layer_around(a) && next[2] == a->grid[2])
						next[2] = 0;
					if (next[axis] < a->grid[axis] &&
					    (cell_at(a, c)->up != cell_at(a, next)->up) == changing)
						add_face(a, c, axis, blend, &state, &j);
				}
	return j;
}

/* Pairs of points next to each other, most of them near edges and corners of cells. */
static struct jumps jumps_anywhere(const struct bb_atlas *a, bool blend)
{
	struct jumps j = { 0 };
	uint32_t state = 4;

	for (int i = 0; i < 200000; i++) {
		double p[3], q[3];
		for (int k = 0; k < 3; k++) {
			const double near = floor(drawn_number(&state) * a->grid[k]) * a->edge;
			const double off = (drawn_number(&state) - 0.5) * (i % 3 ? 1e-5 : a->edge);
			p[k] = fmin(fmax(near + off, 0), a->dim[k]);
			q[k] = fmin(fmax(p[k] + 1e-5 * (drawn_number(&state) - 0.5), 0), a->dim[k]);
		}
		add_jump(&j, fabs(bb_layer_value(a, p, blend) - bb_layer_value(a, q, blend)));
	}
	return j;
}

static struct scene *scene_of(struct bb_volume *v, uint32_t edge, uint32_t pad, double time)
{
	const struct bb_build_config config = { .edge = edge, .pad = pad, .type = BB_BRICK_F32, .has_range = true,
						.most = 1 };
	struct scene *s = scene_make();
	const struct bb_placement here = drawing_placement(v);

	scene_add(s, v, &config, time, &here, scene_levels, NULL);
	return s;
}

static void report(const char *what, const struct bb_atlas *a, struct jumps j[2])
{
	for (int blend = 0; blend < 2; blend++) {
		j[blend] = jumps_of(a, true, blend);
		printf("%s, %s: %lu points on faces where the level changes: jump %.2e in the mean, %.2e at most\n", what,
		       blend ? "blended " : "by brick", (unsigned long)j[blend].n, j[blend].mean, j[blend].most);
	}
}

static void blended_levels_have_no_seam(void **ctx)
{
	uint32_t state = 77;
	struct bb_volume *const volumes[] = { drawing_volume(100, 80, 70, 2),
					      drawing_noise((const uint32_t[]){ 75, 50, 66 }, 2, &state) };
	struct jumps j[2];

	(void)ctx;
	for (int i = 0; i < 4; i++) {
		struct bb_volume *v = volumes[i / 2];
		struct scene *s = scene_of(v, i % 2 ? 8 : 16, 1 + (uint32_t)i % 2, i % 2 ? 0 : 0.4);
		const struct bb_atlas *a = &s->cover[0]->atlas;
		char what[32];
		snprintf(what, sizeof(what), "%s, edge %u", i / 2 ? "noise" : "shells", a->edge);
		report(what, a, j);
		assert_true(j[0].n > 100 && j[0].mean > 1e-3 && j[1].most < 2e-6);
		const struct jumps same = jumps_of(a, false, true), any = jumps_anywhere(a, true);
		printf("%s: %.2e at most where it does not, %.2e anywhere (by brick %.2e)\n", what, same.most, any.most,
		       jumps_anywhere(a, false).most);
		assert_true(same.most < 2e-6 && any.most < 5e-5);
		s->volume[0] = NULL; /* the next one wants it, too */
		scene_free(s);
	}
	drawing_free(volumes[0]);
	drawing_free(volumes[1]);
}

/* Flat cells next to bricks and to each other, too. */
static void flat_cells_have_none(void **ctx)
{
	struct scene *s = scene_of(drawing_volume(100, 80, 70, 1), 16, 1, 0);
	const struct bb_atlas *a = &s->cover[0]->atlas;
	struct jumps by_brick, blended;

	(void)ctx;
	scene_flatten(s, 0);
	by_brick = jumps_of(a, false, false);
	blended = jumps_of(a, false, true);
	printf("flat cells: jump %.2e in the mean by brick, %.2e at most blended, %.2e anywhere\n", by_brick.mean,
	       blended.most, jumps_anywhere(a, true).most);
	assert_true(by_brick.mean > 1e-2 && blended.most < 2e-6 && jumps_anywhere(a, true).most < 5e-5);
	scene_free(s);
}

static void nor_has_a_ball(void **ctx)
{
	struct scene *s = scene_ball(false, scene_patches, NULL);
	struct jumps j[2];

	(void)ctx;
	report("ball", &s->cover[0]->atlas, j);
	assert_true(j[0].n > 100 && j[0].mean > 1e-4);
	scene_free(s);
}

/* How near the picture comes to the reference, and how long it takes: the shortest of some, in turns. */
static void what_it_is_worth(void **ctx)
{
	static const int views[] = { 0, 2, 5, 7 };
	struct bb_renderer *layers, *reference;
	double db[2] = { 0 }, ns[2] = { 0 };

	(void)ctx;
	struct scene *s = scene_of(drawing_volume(100, 80, 70, 1), 16, 1, 0);
	assert_int_equal(bb_renderer_layers_create("auto", 1, false, &layers, NULL), BB_OK);
	assert_int_equal(bb_renderer_reference_create(2, &reference), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(views); i++) {
		struct bb_image truth = scene_picture(reference, s, views[i], 0.5, false, NULL);
		double best[2] = { HUGE_VAL, HUGE_VAL };
		for (int k = 0; k < 10; k++) {
			struct bb_draw_stats stats;
			struct bb_image_difference d;
			struct bb_image own = scene_picture(layers, s, views[i], 0.5, k % 2, &stats);
			assert_int_equal(bb_image_compare(&own, &truth, &d), BB_OK);
			best[k % 2] = fmin(best[k % 2], (double)stats.elapsed_ns);
			db[k % 2] += k < 2 ? d.psnr_db / BB_ARRAY_LEN(views) : 0;
			bb_image_release(&own);
		}
		for (int k = 0; k < 2; k++)
			ns[k] += best[k];
		bb_image_release(&truth);
	}
	printf("mixed levels against full resolution: %.2f dB by brick, %.2f dB blended, for %.2f times the time\n", db[0],
	       db[1], ns[1] / ns[0]);
	assert_true(db[1] > db[0] - 0.1);
	bb_renderer_destroy(layers);
	bb_renderer_destroy(reference);
	scene_free(s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(blended_levels_have_no_seam),
		cmocka_unit_test(flat_cells_have_none),
		cmocka_unit_test(nor_has_a_ball),
		cmocka_unit_test(what_it_is_worth),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
