/* tests/test_volume_tables.c: what the tables of selectors rest on: pictures of a choice, a sequence played, ranks. */
#include "bench/volume/look.h"
#include "bench/volume/play.h"
#include "bench/volume/rank.h"
#include "tests/brick_rig.h"

static struct bb_transfer upper_half(void)
{
	struct bb_transfer tf = { .n = 3, .least_visible = 0.5 };

	tf.point[0] = (struct bb_transfer_point){ 0, 0.2, 0.4, 0.6, 0 };
	tf.point[1] = (struct bb_transfer_point){ 0.5, 0.2, 0.4, 0.6, 0 };
	tf.point[2] = (struct bb_transfer_point){ 1, 1, 0.6, 0.2, 0.5 };
	return tf;
}

/* Pixel x, y of a picture along z, voxel by voxel, from the source. */
static double red_of(const struct brick_rig *r, const struct bb_bricks *b, const struct bb_transfer *tf, uint32_t x,
		     uint32_t y, uint32_t step)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	double red = 0, left = 1;

	for (uint32_t z = 0; z < r->dim[2]; z++) {
		double rgba[4];
		const double v = (double)r->voxels[((step * (size_t)r->dim[2] + z) * r->dim[1] + y) * r->dim[0] + x];
		bb_transfer_at(tf, (v - h->least) / (h->most - h->least), rgba);
		red += left * rgba[3] * rgba[0];
		left *= 1 - rgba[3];
	}
	return red;
}

static void a_picture_of_all_leaves_is_that_of_the_data(void **state)
{
	static const uint32_t dims[3][3] = { { 30, 26, 12 }, { 12, 30, 26 }, { 30, 12, 26 } };
	const struct bb_transfer tf = upper_half();
	struct bb_error err = { 0 };
	(void)state;

	for (int axis = 0; axis < 3; axis++) {
		struct brick_rig r;
		struct bb_look l;
		static struct bb_choice c[512];
		rig_begin(&r, dims[axis][0], dims[axis][1], dims[axis][2], 3, 8);
		struct bb_bricks *b = rig_build(&r);
		assert_int_equal(bb_look_begin(&l, b, &err), BB_OK);
		assert_int_equal(l.axis, axis == 0 ? 2 : axis - 1);
		const size_t n = bb_choose_uniform(&bb_bricks_header(b)->tree, 1, UINT32_MAX, c);
		assert_int_equal(bb_look_fill(&l, c, n, &err), BB_OK);
		const struct bb_bricks_header *h = bb_bricks_header(b);
		for (size_t i = 0; i < rig_voxels(&r); i++) {
			const double v = ((double)r.voxels[rig_voxels(&r) + i] - h->least) / (h->most - h->least);
			assert_true(fabs((double)l.voxels[i] - v) < 1e-6);
		}
		float(*picture)[4] = calloc(bb_look_pixels(&l), sizeof(*picture));
		assert_non_null(picture);
		bb_look_cast(&l, &tf, picture);
		for (uint32_t y = 0; l.axis == 2 && y < l.height; y++)
			for (uint32_t x = 0; x < l.width; x++)
				assert_true(fabs((double)picture[y * l.width + x][0] - red_of(&r, b, &tf, x, y, 1)) <
					    2e-3);
		const struct bb_look_difference d =
			bb_look_compare((const float(*)[4])picture, (const float(*)[4])picture, bb_look_pixels(&l));
		assert_true(d.luv <= 0 && d.psnr_db >= 200 && d.n_pixels > 0);
		free(picture);
		bb_look_end(&l);
		bb_bricks_close(b);
		rig_end(&r);
	}
}

/* A level above the data: between its voxels, which rig_truth knows; flat: the mean. */
static void coarse_bricks_are_interpolated(void **state)
{
	struct brick_rig r;
	struct bb_look l;
	struct bb_error err = { 0 };
	(void)state;

	rig_begin(&r, 16, 16, 16, 1, 8);
	struct bb_bricks *b = rig_build(&r);
	const struct bb_bricks_header *h = bb_bricks_header(b);
	assert_int_equal(h->tree.n_levels, 2);
	struct bb_choice root = { 0 };
	assert_int_equal(bb_look_begin(&l, b, &err), BB_OK);
	assert_int_equal(bb_look_fill(&l, &root, 1, &err), BB_OK);
	const struct bb_tree_span s = bb_tree_span(&h->tree, 0);
	/* Voxel 5 lies a quarter before coarse voxel 2's end: 3/4 of coarse voxel 2 and 1/4 of 3. */
	double want = 0;
	for (uint32_t k = 0; k < 8; k++) {
		const double w = (k & 1 ? 0.25 : 0.75) * (k & 2 ? 0.25 : 0.75) * (k & 4 ? 0.25 : 0.75);
		want += w * rig_truth(&r, &h->tree, 0, &s, 2 + (k & 1), 2 + (k >> 1 & 1), 2 + (k >> 2));
	}
	assert_true(fabs((double)l.voxels[(5 * 16 + 5) * 16 + 5] - (want - h->least) / (h->most - h->least)) < 1e-5);
	root.flat = true;
	assert_int_equal(bb_look_fill(&l, &root, 1, &err), BB_OK);
	const double mean = ((double)bb_bricks_moments(b)[0].mean - h->least) / (h->most - h->least);
	for (size_t i = 0; i < rig_voxels(&r); i++)
		assert_true(fabs((double)l.voxels[i] - mean) < 1e-6);
	bb_look_end(&l);
	bb_bricks_close(b);
	rig_end(&r);
}

/* ---- a sequence ---- */

/* Left half dark and still, right half bright: its near part changes at step 2 of 4, its far part at every step. */
static void stage(struct brick_rig *r)
{
	rig_begin(r, 16, 16, 8, 4, 8);
	for (uint32_t s = 0; s < 4; s++)
		for (uint32_t z = 0; z < 8; z++)
			for (uint32_t y = 0; y < 16; y++)
				for (uint32_t x = 0; x < 16; x++) {
					const float bright = y < 8 ? (s < 2 ? 8.f : 10.f) : 8.f + (float)s;
					r->voxels[((s * 8 + z) * 16 + y) * 16 + x] =
						x < 8 ? 0.f : bright + (float)(x & 1);
				}
	rig_write(r);
}

static void play(const struct bb_bricks *b, const char *selector, uint64_t memory_bricks, struct bb_play *out)
{
	const struct bb_transfer tf = upper_half();
	const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
	struct bb_ratings r = { calloc(n, 4), calloc(n, 4), calloc(n, 4) };
	struct bb_error err = { 0 };

	assert_true(r.space && r.time && r.work);
	assert_int_equal(bb_selector_find(selector)->rate(b, &tf, &r, &err), BB_OK);
	const struct bb_play_config c = { .b = b,
					  .tf = &tf,
					  .selector = bb_selector_find(selector),
					  .ratings = &r,
					  .memory_bytes = memory_bricks * bb_bricks_brick_bytes(bb_bricks_header(b)) };
	assert_int_equal(bb_play(&c, out, &err), BB_OK);
	free(r.space);
	free(r.time);
	free(r.work);
}

static bool near(double a, double b)
{
	return fabs(a - b) < 1e-9;
}

static void shares_and_loads_of_a_sequence(void **state)
{
	static const char *const names[] = { "colour-reference", "colour", "scalar" };
	struct brick_rig r;
	(void)state;

	stage(&r);
	struct bb_bricks *b = rig_build(&r);
	for (size_t i = 0; i < BB_ARRAY_LEN(names); i++) {
		struct bb_play p, small;
		play(b, names[i], 100, &p);
		play(b, names[i], 4, &small);
		assert_true(near(small.again_bricks, 6 / 4.0)); /* of six in turn, four last used are never the next */
		play(b, names[i], 2, &small);
		/* A half is nothing; a quarter is new at steps 0 and 2, the other at each of four. */
		assert_true(near(p.hidden, 0.5) && near(p.untextured, 0));
		assert_true(near(p.loaded, (2 + 4) / 16.0) && near(p.reused, 2 / 16.0));
		assert_true(near(p.load_bricks, 6 / 4.0) &&
			    p.kept_bytes == 6 * bb_bricks_brick_bytes(bb_bricks_header(b)));
		assert_true(near(p.again_bricks, 0));           /* all six are kept */
		assert_true(near(small.again_bricks, 6 / 4.0)); /* two are not enough */
	}
	bb_bricks_close(b);
	rig_end(&r);
}

static void ranks_of_ratings(void **state)
{
	const float up[] = { 1, 2, 3, 4, 5 }, down[] = { 9, 7, 5, 3, 1 }, ties[] = { 1, 1, 2, 2, 2 },
		    one[] = { 3, 3, 3, 3, 3 };
	const float mixed[] = { 2, 1, 4, 3, 5 };
	const struct {
		const float *a, *b;
		double want;
	} rows[] = { { up, up, 1 },
		     { up, down, -1 },
		     { up, one, 0 },
		     { one, one, 1 },
		     { up, mixed, 0.8 },
		     { ties, ties, 1 },
		     { up, ties, 0.8660254037844386 } };
	struct bb_error err = { 0 };
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		double have;
		assert_int_equal(bb_rank_correlation(rows[i].a, rows[i].b, 5, &have, &err), BB_OK);
		if (fabs(have - rows[i].want) > 1e-12)
			fail_msg("row %zu: %.9f", i, have);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_picture_of_all_leaves_is_that_of_the_data),
		cmocka_unit_test(coarse_bricks_are_interpolated),
		cmocka_unit_test(shares_and_loads_of_a_sequence),
		cmocka_unit_test(ranks_of_ratings),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
