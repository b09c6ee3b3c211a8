/* tests/test_flash_meter.c: thresholds, windows and areas of the three rules, each from both sides; solid angles. */
#include <setjmp.h>
#include <stdarg.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sim/sim.h"
#include "sync/flash_meter.h"

#define MS INT64_C(1000000)
#define PI 3.14159265358979323846

/* A cube of 2 m around the origin, as seen from inside. */
static const struct bb_corners cube[6] = {
	{ { -1, -1, -1 }, { 1, -1, -1 }, { -1, 1, -1 } }, { { 1, -1, 1 }, { -1, -1, 1 }, { 1, 1, 1 } },
	{ { -1, -1, 1 }, { -1, -1, -1 }, { -1, 1, 1 } },  { { 1, -1, -1 }, { 1, -1, 1 }, { 1, 1, -1 } },
	{ { -1, -1, 1 }, { 1, -1, 1 }, { -1, -1, -1 } },  { { -1, 1, -1 }, { 1, 1, -1 }, { -1, 1, 1 } },
};

static struct bb_flash_meter *meter(const struct bb_corners *walls, size_t n)
{
	const struct bb_safety limits = bb_safety_ceilings();
	struct bb_flash_meter *m;

	assert_int_equal(bb_flash_create(walls, n, (struct bb_vec3){ 0, 0, 0 }, &limits, &m), BB_OK);
	return m;
}

static void fill(struct bb_flash_grid *g, float r, float gr, float b)
{
	g->generation++;
	for (int i = 0; i < BB_FLASH_CELLS; i++) {
		g->rgb[i][0] = r;
		g->rgb[i][1] = gr;
		g->rgb[i][2] = b;
	}
}

/* n half periods of a wall between two lights, `half` apart; the worst. */
static double blink(double low, double high, int n, int64_t half_ns)
{
	struct bb_flash_meter *m = meter(cube, 1);
	struct bb_flash_grid g = { 0 };

	fill(&g, 1, 1, 1);
	for (int i = 0; i <= n; i++)
		bb_flash_frame(m, 0, 0, i * half_ns, &g, i % 2 ? high : low);
	const double worst = bb_flash_worst(m).flashes;
	bb_flash_destroy(m);
	return worst;
}

static void cells_tile_the_sphere(void **state)
{
	struct bb_flash_meter *m = meter(cube, 6);
	double sum = 0, most = 0, least = 1;

	(void)state;
	for (unsigned w = 0; w < 6; w++)
		for (unsigned i = 0; i < BB_FLASH_CELLS; i++) {
			const double sr = bb_flash_cell_sr(m, w, i);
			sum += sr;
			most = fmax(most, sr);
			least = fmin(least, sr);
		}
	assert_true(fabs(sum - 4 * PI) < 1e-9);
	assert_true(most > 0.0264 && most < 4.0 / 144 && least > 4.0 / 144 / 5.2 - 1e-3);
	bb_flash_destroy(m);
	assert_true(fabs(bb_solid_angle((struct bb_vec3){ 1, 0, 0 }, (struct bb_vec3){ 0, 1, 0 }, (struct bb_vec3){ 0, 0, 1 }) -
	                 PI / 2) < 1e-12);
}

static void ten_percent_and_eighty(void **state)
{
	(void)state;
	assert_true(blink(0.5, 0.60, 8, 50 * MS) == 4);
	assert_true(blink(0.5, 0.599, 8, 50 * MS) == 0);
	assert_true(blink(0.799, 0.9, 8, 50 * MS) == 4);
	assert_true(blink(0.80, 1.0, 8, 50 * MS) == 0); /* the darker end is bright enough; BT.1702 says the same at 200 cd/m2 */
}

static void three_flashes_a_second(void **state)
{
	(void)state;
	assert_true(blink(0, 1, 6, 100 * MS) == 3);
	assert_true(blink(0, 1, 7, 100 * MS) == 3.5);
	assert_true(blink(0, 1, 100, 167 * MS) == 3);   /* 2.99 Hz for ever */
	assert_true(blink(0, 1, 100, 166 * MS) == 3.5); /* 3.01 Hz: seven changes within 996 ms */
	assert_true(blink(0, 1, 60, INT64_C(500000000) / 3 + 1) == 3); /* 3 Hz */
	assert_true(blink(0, 1, 400, 8 * MS) == BB_FLASH_MOST / 2.0);
	assert_true(blink(0, 1, 2, 5000 * MS) == 0.5);  /* far apart, they are not a pair of one second */
}

/* A change is made of whatever leads there: slow ramps count, ripples below a tenth do not, and do not hide one. */
static void ramps_and_ripples(void **state)
{
	struct bb_flash_meter *m = meter(cube, 1);
	struct bb_flash_grid g = { 0 };

	(void)state;
	fill(&g, 1, 1, 1);
	for (int i = 0; i < 900; i++) /* a triangle of 4 Hz with a ripple of 8 % on it */
		bb_flash_frame(m, 0, 0, i * 5 * MS, &g,
		               0.3 + 0.4 * fabs(fmod(i / 50.0, 1) * 2 - 1) + (i % 2 ? 0.04 : -0.04));
	assert_true(bb_flash_worst(m).flashes == 4);
	bb_flash_destroy(m);
}

/* Against a count of turning points by their definition: maxima and minima at least a tenth apart. */
static unsigned turns_of(const double *y, int n, int from, int to)
{
	unsigned turns = 0;
	double low = y[0], high = y[0];
	int way = 0;

	for (int i = 1; i < n; i++) {
		const bool up = way <= 0 && y[i] >= low + 0.1 && low < 0.8, down = way >= 0 && y[i] <= high - 0.1 && y[i] < 0.8;
		if (up || down) {
			way = up ? 1 : -1;
			low = high = y[i];
			turns += i > from && i <= to;
		}
		low = fmin(low, y[i]);
		high = fmax(high, y[i]);
	}
	return turns;
}

static void random_light_is_counted_right(void **state)
{
	struct sim_rng r;
	double y[200];

	(void)state;
	sim_rng_seed(&r, 3, "test", "flash");
	for (int k = 0; k < 300; k++) {
		struct bb_flash_meter *m = meter(cube, 1);
		struct bb_flash_grid g = { 0 };
		unsigned worst = 0;

		fill(&g, 1, 1, 1);
		y[0] = 0.5;
		for (int i = 1; i < 200; i++)
			y[i] = fmin(1, fmax(0, y[i - 1] + 0.04 * (sim_rng_normal(&r) + (k % 3) * sin(i * 0.2))));
		for (int i = 0; i < 200; i++)
			bb_flash_frame(m, 0, 0, i * 16 * MS, &g, round(y[i] * 256) / 256);
		for (int i = 0; i < 200; i++)
			y[i] = round(y[i] * 256) / 256;
		for (int i = 0; i < 200; i++) {
			const unsigned n = turns_of(y, 200, i - 63, i); /* 62 steps of 16 ms are within a second */
			worst = n > worst ? n : worst;
		}
		assert_true(bb_flash_worst(m).flashes == worst / 2.0);
		bb_flash_destroy(m);
	}
}

/* A screen far away whose 144 cells have `sr` in all; a block in the middle of it blinks. */
static struct bb_flash_worst patch(double width_m, double away_m, int columns, int rows)
{
	const struct bb_corners far = { { -width_m / 2, -width_m * 9 / 32, -away_m },
		                        { width_m / 2, -width_m * 9 / 32, -away_m },
		                        { -width_m / 2, width_m * 9 / 32, -away_m } };
	struct bb_flash_meter *m = meter(&far, 1);
	struct bb_flash_grid g = { 0 };

	for (int k = 0; k < 12; k++) {
		fill(&g, 0.3f, 0.3f, 0.3f);
		for (int i = 0; i < columns * rows && k % 2; i++)
			g.rgb[((9 - rows) / 2 + i / columns) * BB_FLASH_COLUMNS + (16 - columns) / 2 + i % columns][1] = 1;
		bb_flash_frame(m, 0, 1, k * 60 * MS, &g, 1);
	}
	const struct bb_flash_worst w = bb_flash_worst(m);
	bb_flash_destroy(m);
	return w;
}

static void small_areas_do_not_count(void **state)
{
	(void)state;
	/* A cell of 1.6 m over 16 columns at 10 m is 10 x 10 cm: 1e-4 sr; 0.006 sr are 60 of them. */
	assert_true(patch(1.6, 10, 16, 3).flashes == 5.5); /* 48 cells are 0.0048 sr, and a third of the screen: BT.1702 */
	assert_int_equal(patch(1.6, 10, 16, 3).rule, BB_FLASH_BT1702);
	assert_true(patch(1.6, 10, 9, 4).flashes == 0);    /* 36: exactly a quarter is not more than a quarter */
	assert_true(patch(1.6, 10, 13, 5).flashes == 5.5); /* 65 */
	assert_int_equal(patch(1.6, 10, 13, 5).rule, BB_FLASH_GENERAL);
	assert_true(patch(1.6, 10, 13, 5).area > 0.006 && patch(1.6, 10, 13, 5).area < 0.0066);
	assert_int_equal(patch(1.6, 10, 13, 5).eye, 1);
	/* A wall that surrounds: one cell is enough. 23 x 23 cm at 3 m is the largest patch that may blink. */
	assert_true(patch(16 * 0.24, 3, 1, 1).flashes == 5.5);
	assert_true(patch(16 * 0.225, 3, 1, 1).flashes == 0);
}

/* Cells in different corners of a wide screen never come into one field together. */
static void a_field_is_ten_degrees(void **state)
{
	const struct bb_corners far = { { -4, -0.05, -10 }, { 4, -0.05, -10 }, { -4, 0.05, -10 } };
	struct bb_flash_meter *m = meter(&far, 1);
	struct bb_flash_grid g = { 0 };

	(void)state;
	for (int k = 0; k < 12; k++) { /* every fourth column of 2.9 degrees: 0.0005 sr each cell row block */
		fill(&g, 0, 0, 0);
		for (int i = 0; i < BB_FLASH_CELLS && k % 2; i++)
			if (i % 4 == 0)
				g.rgb[i][1] = 1;
		bb_flash_frame(m, 0, 0, k * 60 * MS, &g, 1);
	}
	const double column_sr = 9 * bb_flash_cell_sr(m, 0, 8);
	assert_true(column_sr * 4 > 0.0015 && column_sr < 0.006);
	assert_true(bb_flash_worst(m).flashes == 0);
	bb_flash_destroy(m);
}

static double red(float r0, float g0, float b0, float r1, float g1, float b1)
{
	struct bb_flash_meter *m = meter(cube, 1);
	struct bb_flash_grid g = { 0 };

	for (int k = 0; k < 12; k++) {
		k % 2 ? fill(&g, r1, g1, b1) : fill(&g, r0, g0, b0);
		bb_flash_frame(m, 0, 0, k * 60 * MS, &g, 1);
	}
	const struct bb_flash_worst w = bb_flash_worst(m);
	bb_flash_destroy(m);
	return w.rule == BB_FLASH_RED ? w.flashes : 0;
}

static void saturated_red_counts_without_luminance(void **state)
{
	(void)state;
	assert_true(red(0.4f, 0, 0, 0.085f, 0.085f, 0.085f) == 5.5); /* grey of the same luminance */
	assert_true(red(0.4f, 0, 0, 0, 0, 0) == 5.5);
	assert_true(red(0.4f, 0, 0, 0.4f, 0.08f, 0) == 0);           /* still red, hardly moved */
	assert_true(red(0.3f, 0.15f, 0, 0.2f, 0.2f, 0.2f) == 0);     /* neither end is saturated: 0.65 */
	assert_true(red(0, 0, 0.4f, 0.04f, 0.04f, 0.04f) == 0);      /* blue is not red */
	assert_true(red(0.004f, 0, 0, 0, 0, 0) == 0);                /* too dark to have a hue */
}

/* 20 cd/m2 are more of a dim white than of a bright one; a room that says how bright it is is judged by that. */
static void candelas_depend_on_white(void **state)
{
	struct bb_safety limits = bb_safety_ceilings();
	struct bb_flash_meter *m;
	struct bb_flash_grid g = { 0 };

	(void)state;
	limits.white_cd_m2 = 400;
	assert_int_equal(bb_flash_create(cube, 1, (struct bb_vec3){ 0, 0, 0 }, &limits, &m), BB_OK);
	fill(&g, 1, 1, 1);
	for (int k = 0; k < 12; k++)
		bb_flash_frame(m, 0, 0, k * 60 * MS, &g, k % 2 ? 0.36 : 0.30); /* 24 cd/m2, and 6 % */
	assert_true(bb_flash_worst(m).flashes == 5.5);
	assert_int_equal(bb_flash_worst(m).rule, BB_FLASH_BT1702);
	bb_flash_destroy(m);
}

static void eyes_and_walls_are_counted_apart(void **state)
{
	struct bb_flash_meter *m = meter(cube, 6);
	struct bb_flash_grid g = { 0 };

	(void)state;
	fill(&g, 1, 1, 1);
	for (int k = 0; k < 48; k++) /* twelve pictures of four walls in turn; three flashes each, in no cell more */
		bb_flash_frame(m, (unsigned)k % 4, 0, k / 8 * 150 * MS + k % 8 * MS, &g, k / 4 % 2);
	assert_true(bb_flash_worst(m).flashes <= 6 && bb_flash_changes(m) > 0);
	bb_flash_destroy(m);
	m = meter(cube, 1);
	for (int k = 0; k < 12; k++) /* one eye dark, the other bright, in turn: each of them sees every change */
		bb_flash_frame(m, 0, (unsigned)k % 2, k * 60 * MS, &g, k / 2 % 2);
	assert_true(bb_flash_worst(m).flashes == 2.5);
	bb_flash_destroy(m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(cells_tile_the_sphere),
		cmocka_unit_test(ten_percent_and_eighty),
		cmocka_unit_test(three_flashes_a_second),
		cmocka_unit_test(ramps_and_ripples),
		cmocka_unit_test(random_light_is_counted_right),
		cmocka_unit_test(small_areas_do_not_count),
		cmocka_unit_test(a_field_is_ten_degrees),
		cmocka_unit_test(saturated_red_counts_without_luminance),
		cmocka_unit_test(candelas_depend_on_white),
		cmocka_unit_test(eyes_and_walls_are_counted_apart),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
