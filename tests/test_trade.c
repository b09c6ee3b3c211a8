/*
 * tests/test_trade.c: fronts and answers of a list made by hand; grids; choices as atlases; and a small scene played, twice
 * with the same counters.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/trade/front.h"
#include "bench/trade/grid.h"
#include "bench/trade/still.h"
#include "bench/trade/tell.h"
#include "tests/drawing.h"

#define NONE ((double)NAN)

static void front_by_hand(void **ctx)
{
	struct bb_front_point p[] = {
		{ 30, 5, false },    /* 0: beaten by 1, which is as good and cheaper */
		{ 30, 4, false },    /* 1: on it */
		{ 40, 8, false },    /* 2: on it */
		{ 40, 8, false },    /* 3: the same again: neither beats the other */
		{ 39, 9, false },    /* 4: worse and dearer */
		{ NONE, 1, false },  /* 5, 6: not measured */
		{ 50, NONE, false },
		{ 10, 1, false },    /* 7: the cheapest */
		{ 41, 100, false },  /* 8: the best */
		{ 10, 1.5, false },  /* 9: as good as the cheapest, but dearer */
		{ 20, 4, false },    /* 10: as dear as 1, but worse */
	};
	static const bool expected[] = { false, true, true, true, false, false, false, true, true, false,
					 false };

	(void)ctx;
	bb_front_mark(p, BB_ARRAY_LEN(p));
	for (size_t i = 0; i < BB_ARRAY_LEN(p); i++)
		assert_int_equal(p[i].on_front, expected[i]);
	assert_int_equal(bb_front_best(p, BB_ARRAY_LEN(p), 8), 2);
	assert_int_equal(bb_front_best(p, BB_ARRAY_LEN(p), 7.9), 1);
	assert_int_equal(bb_front_best(p, BB_ARRAY_LEN(p), 1e9), 8);
	assert_int_equal(bb_front_best(p, BB_ARRAY_LEN(p), 0.5), BB_FRONT_NONE);
	assert_int_equal(bb_front_cheapest(p, BB_ARRAY_LEN(p), 30), 1);
	assert_int_equal(bb_front_cheapest(p, BB_ARRAY_LEN(p), 30.1), 2);
	assert_int_equal(bb_front_cheapest(p, BB_ARRAY_LEN(p), 0), 7);
	assert_int_equal(bb_front_cheapest(p, BB_ARRAY_LEN(p), 41.5), BB_FRONT_NONE);
	assert_int_equal(bb_front_best(p, 0, 1), BB_FRONT_NONE);
}

/* Against the definition, on many random lists with ties. */
static void front_by_definition(void **ctx)
{
	struct bb_front_point p[40];
	uint32_t state = 5;

	(void)ctx;
	for (int round = 0; round < 500; round++) {
		const size_t n = (size_t)round % 40 + 1;
		for (size_t i = 0; i < n; i++) {
			state = state * 1664525U + 1013904223U;
			p[i] = (struct bb_front_point){ (state >> 8) % 12, (state >> 16) % 12, false };
		}
		bb_front_mark(p, n);
		for (size_t i = 0; i < n; i++) {
			/* On the front: it is what one gets for its own cost, and for no less. */
			const double most = p[bb_front_best(p, n, p[i].cost)].quality;
			const double least = p[bb_front_cheapest(p, n, p[i].quality)].cost;
			assert_int_equal(p[i].on_front, !(most > p[i].quality) && !(least < p[i].cost));
		}
	}
}

static struct bb_trade_setting own(void)
{
	return (struct bb_trade_setting){ .memory_mib = 1, .bricks_per_frame = 8, .selector = bb_selector_find("leaf"),
					  .tolerance = 0.1, .step_voxels = 1, .brick = 16, .type = BB_BRICK_U16 };
}

static void grids(void **ctx)
{
	const struct bb_trade_setting o = own();
	struct bb_trade_grid g;
	struct bb_trade_item *item;
	struct bb_error err = { 0 };
	size_t n;

	(void)ctx;
	bb_trade_grid_usual(&g, &o, true, 8);
	assert_int_equal(bb_trade_grid_make(&g, false, &item, &n, &err), BB_OK);
	assert_int_equal(item[0].knob, BB_KNOB_NONE);
	/* 5 budgets each, 5 selectors, 4 tolerances, 4 steps, 3 bricks, 4 types; four of them are the scene's own. */
	assert_int_equal(n, 1 + 5 + 5 + 4 + 4 + 3 + 2 + 3);
	for (size_t i = 1; i < n; i++)
		assert_int_not_equal(item[i].knob, BB_KNOB_NONE);
	free(item);
	assert_int_equal(bb_trade_grid_read(&g, BB_KNOB_MEMORY, "0.5,1,all", &err), BB_OK);
	assert_int_equal(bb_trade_grid_read(&g, BB_KNOB_STREAM, "8,all", &err), BB_OK);
	assert_int_equal(bb_trade_grid_read(&g, BB_KNOB_SELECTOR, "leaf,leaf!,uniform,scalar", &err), BB_OK);
	assert_int_equal(bb_trade_grid_read(&g, BB_KNOB_TOLERANCE, "0.1,0.2", &err), BB_OK);
	assert_int_equal(bb_trade_grid_read(&g, BB_KNOB_STEP, "1,2", &err), BB_OK);
	assert_int_equal(bb_trade_grid_read(&g, BB_KNOB_BRICK, "8", &err), BB_OK);
	assert_int_equal(bb_trade_grid_read(&g, BB_KNOB_TYPE, "u8,f32", &err), BB_OK);
	assert_int_equal(bb_trade_grid_make(&g, true, &item, &n, &err), BB_OK);
	/* What a selector does not know of makes no settings: scalar has tolerances, uniform memory only. */
	assert_int_equal(n, 1 + (3 * 2 + 3 * 2 + 3 + 2) * 2 * 2);
	free(item);
	assert_int_equal(err.number, 0);
}

static void grids_refuse(void **ctx)
{
	static const struct {
		enum bb_trade_knob knob;
		const char *text;
	} bad[] = { { BB_KNOB_MEMORY, "" },         { BB_KNOB_MEMORY, "1,,2" },  { BB_KNOB_MEMORY, "0" },
		    { BB_KNOB_MEMORY, "nan" },      { BB_KNOB_STREAM, "-1" },    { BB_KNOB_STREAM, "1 2" },
		    { BB_KNOB_SELECTOR, "leafs" },  { BB_KNOB_SELECTOR, "!" },   { BB_KNOB_TOLERANCE, "all" },
		    { BB_KNOB_STEP, "0" },          { BB_KNOB_STEP, "0x1" },     { BB_KNOB_BRICK, "7" },
		    { BB_KNOB_BRICK, "66" },        { BB_KNOB_TYPE, "u9" },      { BB_KNOB_TYPE, "u8," },
		    { BB_KNOB_STEP, "1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1" },
		    { BB_KNOB_SELECTOR, "leafleafleafleafleafleafleafleafleafleafleafleaf" } };
	struct bb_trade_grid g = { 0 };

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_error err = { 0 };
		assert_int_equal(bb_trade_grid_read(&g, bad[i].knob, bad[i].text, &err), BB_ERR_USAGE);
		assert_int_equal(err.number, 1481);
	}
}

/* ---- choices as atlases ---- */

static void check_still(const struct bb_bricks *b, const struct bb_atlas *a, unsigned k, const struct bb_choice *c, size_t n)
{
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	uint8_t *brick = malloc(a->slot_bytes);
	struct bb_error err;

	assert_non_null(brick);
	for (size_t i = 0; i < n; i++) {
		const struct bb_tree_place p = bb_tree_place(t, c[i].node);
		const uint32_t up = t->n_levels - 1 - p.level;
		const size_t at = ((size_t)(p.at[2] << up) * a->grid[1] + (p.at[1] << up)) * a->grid[0] + (p.at[0] << up);
		const struct bb_atlas_cell *cell = &a->map[k][at];
		assert_int_equal(cell->up, up);
		if (c[i].flat) {
			assert_int_equal(cell->slot, BB_ATLAS_FLAT);
			continue;
		}
		assert_in_range(cell->slot, 0, a->n_slots - 1);
		assert_int_equal(bb_bricks_read(b, (uint64_t)c[i].tau * t->n_nodes + c[i].node, brick, &err), BB_OK);
		assert_memory_equal(brick, a->bricks + (size_t)cell->slot * a->slot_bytes, a->slot_bytes);
	}
	free(brick);
}

/* Any choices one after another in as little room as they need: what is on show is right, and what stays is not read. */
static void stills(void **ctx)
{
	struct bb_volume *v = drawing_volume(41, 26, 19, 4);
	struct bb_bricks *b = cover_bricks(v, 8, 1, BB_BRICK_U16);
	const struct bb_tree *t = &bb_bricks_header(b)->tree;
	struct bb_choice *c[4];
	size_t n[4], most = 0;
	struct bb_still *s;
	struct bb_still_counts counts;
	struct bb_error err = { 0 };

	(void)ctx;
	for (uint32_t i = 0; i < 4; i++) {
		c[i] = calloc(bb_choose_most(t), sizeof(*c[i]));
		assert_non_null(c[i]);
		n[i] = bb_choose_uniform(t, i, i == 2 ? 3 : 1000, c[i]);
		c[i][0].flat = i == 3;
		most = i && n[i] + n[i - 1] > most ? n[i] + n[i - 1] : most;
	}
	assert_int_equal(bb_still_create(b, most, &s, &err), BB_OK);
	static const double steps[] = { 0, 0.5, 1, 1, 1.25, 1.75, 2, 2.5, 3, 2.5, 2, 1.5, 0 };
	for (size_t i = 0; i < BB_ARRAY_LEN(steps); i++) {
		const uint32_t from = (uint32_t)steps[i], to = (uint32_t)ceil(steps[i]);
		assert_int_equal(bb_still_show(s, steps[i], (const struct bb_choice *const[]){ c[from], c[to] },
					       (const size_t[]){ n[from], n[to] }, &counts, &err), BB_OK);
		check_still(b, bb_still_atlas(s), 0, c[from], n[from]);
		check_still(b, bb_still_atlas(s), 1, c[to], n[to]);
		assert_true(counts.bricks <= counts.in_use || !counts.in_use);
		if (i == 1)
			assert_int_equal(counts.bricks, n[1]); /* step 0 is there */
		if (i == 2 || i == 3)
			assert_int_equal(counts.bricks, 0);
	}
	bb_still_destroy(s);
	for (int i = 0; i < 4; i++)
		free(c[i]);
	bb_bricks_close(b);
	drawing_free(v);
}

/* ---- a small scene ---- */

static struct bb_scene small_scene(void)
{
	struct bb_scene s = { .technique = BB_TECHNIQUE_VOLUME, .name = "small" };

	s.data.seconds_per_step = 0.1;
	s.data.loop = BB_LOOP_PING_PONG;
	s.data.width_m = 1.2;
	s.data.centre_m = (struct bb_vec3){ 0, 1.2, -0.8 };
	s.data.step_voxels = 1;
	s.data.brick_voxels = 8;
	s.data.values = BB_BRICK_U16;
	s.data.gain = BB_GAIN_LEAF;
	s.data.predict = true;
	return s;
}

static void same_counters(const struct bb_trade_point *a, const struct bb_trade_point *b)
{
	assert_true(!(fabs(a->psnr_db - b->psnr_db) > 0) && !(fabs(a->ssim - b->ssim) > 0) && !(fabs(a->luv - b->luv) > 0));
	assert_int_equal(a->samples, b->samples);
	assert_int_equal(a->memory_bytes, b->memory_bytes);
	assert_true(!(fabs(a->bytes_mean - b->bytes_mean) > 0) && !(fabs(a->missing_share - b->missing_share) > 0));
}

static void played(struct bb_renderer *r)
{
	static struct bb_transfer tf; /* one thread */
	const struct bb_scene scene = small_scene();
	struct bb_trade_config c = { .scene = &scene, .generate = "cme", .dim = { 40, 40, 40 }, .n_steps = 4, .seed = 1,
				     .transfer = &tf, .eye = { 0.2, 1.5, 0.6 }, .width_px = 64, .height_px = 48,
				     .n_frames = 24, .n_drawn = 2, .n_timed = 1, .reference_step = 0.5, .renderer = r };
	struct bb_trade_setting s = own();
	struct bb_trade_point p[6], again;
	struct bb_trade *t;
	struct bb_error err = { 0 };

	tf = drawing_smooth();
	assert_int_equal(bb_trade_create(&c, &t, &err), BB_OK);
	s.brick = 8;
	s.bricks_per_frame = 0;
	static const double mib[] = { 0.022, 0.1, 0.4, 4 };
	for (size_t i = 0; i < BB_ARRAY_LEN(mib); i++) {
		s.memory_mib = mib[i];
		assert_int_equal(bb_trade_play(t, &s, &p[i], &err), BB_OK);
		assert_true(p[i].memory_bytes <= (uint64_t)(mib[i] * 1048576) && p[i].samples > 0);
		assert_int_equal(bb_trade_play(t, &s, &again, &err), BB_OK);
		same_counters(&p[i], &again);
		assert_true(p[i].psnr_db >= p[i].psnr_least_db - 1e-9 && p[i].psnr_db < p[i].psnr_least_db + 20);
	}
	assert_true(p[3].psnr_db > p[0].psnr_db + 10 && p[3].ssim > p[0].ssim && p[3].luv < p[0].luv);
	s.at_once = true; /* whole choices, all of it: nothing but 16 bits and a longer step between it and the reference */
	s.memory_mib = 0;
	assert_int_equal(bb_trade_play(t, &s, &p[4], &err), BB_OK);
	assert_true(p[4].psnr_db > 45 && p[4].bytes_mean > 0);
	s.memory_mib = 1e-3;
	assert_int_equal(bb_trade_play(t, &s, &p[5], &err), BB_OK);
	s.at_once = false;
	assert_int_equal(bb_trade_play(t, &s, &again, &err), BB_OK);
	assert_true(again.failed && strstr(again.why, "BB1470"));
	bb_trade_mark(p, BB_ARRAY_LEN(p));
	const struct bb_trade_told told = { .point = p, .n = BB_ARRAY_LEN(p), .name = "small", .data = "", .reference = "",
					    .frame_ms = 1e9, .psnr_db = p[3].psnr_db, .ssim = 2 };
	const struct bb_trade_answers a = bb_trade_ask(&told);
	assert_true(p[a.within_ms.point].psnr_db >= p[3].psnr_db && p[a.psnr_ms.point].psnr_db >= p[3].psnr_db);
	assert_true(p[a.within_ms.point].on_time_front || p[a.within_ms.point].psnr_db <= p[a.psnr_ms.point].psnr_db);
	assert_true(a.ssim_ms.asked && a.ssim_ms.point == SIZE_MAX && !bb_trade_answered(&a));
	bb_trade_destroy(t);
}

static void a_small_scene(void **ctx)
{
	struct bb_renderer *r;
	struct bb_error err = { 0 };

	(void)ctx;
	assert_int_equal(bb_renderer_cpu_create("portable", 1, &r, &err), BB_OK);
	played(r);
	bb_renderer_destroy(r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(front_by_hand), cmocka_unit_test(front_by_definition), cmocka_unit_test(grids),
		cmocka_unit_test(grids_refuse),	 cmocka_unit_test(stills),		cmocka_unit_test(a_small_scene),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
