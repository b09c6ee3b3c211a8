/*
 * tests/test_calibration.c: the calibration picture measured like a person would: with a ruler and by its colours.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "render/renderer.h"

#define WIDTH 1400
#define HEIGHT 1050

static const struct bb_corners wall = { { -1.5, 0, -1.5 }, { 1.5, 0, -1.5 }, { -1.5, 2.25, -1.5 } };
static const struct bb_vec3 eye = { 0.2, 1.7, 0.4 };

static struct bb_image picture(const struct bb_corners *corners, int is_left, const struct bb_vec3 *cursor)
{
	const struct bb_view view = bb_view_make(corners, eye, eye, 0.05, 50);
	struct bb_image image;

	assert_int_equal(bb_image_create(WIDTH, HEIGHT, &image), BB_OK);
	assert_int_equal(bb_calibration_draw(&view, "front", is_left, cursor, &image), BB_OK);
	return image;
}

static const uint8_t *pixel(const struct bb_image *image, uint32_t x, uint32_t y)
{
	return image->rgba + ((size_t)y * image->width + x) * 4;
}

static int brightness(const struct bb_image *image, uint32_t x, uint32_t y)
{
	const uint8_t *p = pixel(image, x, y);

	return p[0] + p[1] + p[2];
}

static void grid_is_ten_centimetres(void **ctx)
{
	struct bb_image image = picture(&wall, 1, NULL);
	const uint32_t row = 900; /* below everything else, between two horizontal lines */
	int n = 0;

	(void)ctx;
	for (int k = 1; k < 30; k++) {
		const uint32_t x = (uint32_t)floor(k * WIDTH / 30.0 + 1e-9);
		const int line = brightness(&image, x, row), beside = brightness(&image, x + 20, row);
		n += line > beside + 60;
	}
	assert_int_equal(n, 29);
	/* Whole metres of the room stand out: x = -1 m is a third of the way between -1.5 and 0. */
	assert_true(brightness(&image, WIDTH / 6, row) > brightness(&image, WIDTH / 6 + 47, row) + 100);
	bb_image_release(&image);
}

/* Two tiles side by side: the same room line at the seam's distance on both. */
static void grid_runs_on_across_tiles(void **ctx)
{
	const struct bb_corners a = { { 0.03, 0, -1 }, { 0.63, 0, -1 }, { 0.03, 0.4, -1 } };
	const struct bb_corners b = { { 0.63, 0, -1 }, { 1.23, 0, -1 }, { 0.63, 0.4, -1 } };
	struct bb_image pa = picture(&a, 1, NULL), pb = picture(&b, 1, NULL);
	const double px_per_m = WIDTH / 0.6;
	const uint32_t xa = (uint32_t)(0.57 * px_per_m), xb = (uint32_t)(0.07 * px_per_m); /* room x = 0.6 and 0.7 */

	(void)ctx;
	assert_true(brightness(&pa, xa, 700) > brightness(&pa, xa + 30, 700) + 60);
	assert_true(brightness(&pb, xb, 700) > brightness(&pb, xb + 30, 700) + 60);
	bb_image_release(&pa);
	bb_image_release(&pb);
}

static void border_reaches_the_last_pixel(void **ctx)
{
	struct bb_image image = picture(&wall, 0, NULL);

	(void)ctx;
	for (uint32_t x = 0; x < WIDTH; x++)
		assert_true(brightness(&image, x, 0) > 600 && brightness(&image, x, HEIGHT - 1) > 600);
	for (uint32_t y = 0; y < HEIGHT; y++)
		assert_true(brightness(&image, 0, y) > 600 && brightness(&image, WIDTH - 1, y) > 600);
	bb_image_release(&image);
}

/* Blue pixels only for the left eye, orange only for the right; and the shapes differ: a disc has empty corners. */
static void eyes_cannot_be_confused(void **ctx)
{
	struct bb_image left = picture(&wall, 1, NULL), right = picture(&wall, 0, NULL);
	size_t blue[2] = { 0, 0 }, orange[2] = { 0, 0 };

	(void)ctx;
	for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++)
		for (int k = 0; k < 2; k++) {
			const uint8_t *p = (k ? right : left).rgba + i * 4;
			blue[k] += p[2] > 200 && p[0] < 120;
			orange[k] += p[0] > 200 && p[2] < 120;
		}
	assert_true(blue[0] > 2000 && orange[0] == 0);
	assert_true(orange[1] > 2000 && blue[1] == 0);
	/* From the middle of the shape along the diagonal: the square's corner is lit, the circle's is not. */
	const uint32_t half = (uint32_t)(4.6 * 0.92 * HEIGHT * 4 / 3 / 64);
	assert_true(pixel(&right, (uint32_t)(WIDTH * 0.73) - half, HEIGHT / 2 - half)[0] > 200);
	assert_true(pixel(&left, (uint32_t)(WIDTH * 0.27) - half, HEIGHT / 2 - half)[2] < 200);
	bb_image_release(&left);
	bb_image_release(&right);
}

/* The cross is symmetric, so that the columns and rows of its own colour are centred on the projected point. */
static void cursor_stands_where_it_projects(void **ctx)
{
	static const struct bb_vec3 cursors[] = { { 0.4, 1.3, -0.6 }, { -0.7, 0.6, -1.5 }, { 0.9, 1.2, -2.5 } };

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(cursors); i++) {
		const struct bb_view view = bb_view_make(&wall, eye, eye, 0.05, 50);
		struct bb_image with = picture(&wall, 1, &cursors[i]);
		double ndc[3], w;
		bb_view_project(&view, cursors[i], ndc, &w);
		const double x = (ndc[0] + 1) / 2 * WIDTH, y = (1 - ndc[1]) / 2 * HEIGHT;
		double sum_x = 0, n = 0;
		for (uint32_t c = 0; c < WIDTH; c++) {
			const uint8_t *p = pixel(&with, c, (uint32_t)y);
			if (p[0] > 230 && p[1] > 190 && p[2] < 120) {
				sum_x += c + 0.5;
				n++;
			}
		}
		assert_true(n > 40 && fabs(sum_x / n - x) < 1);
		bb_image_release(&with);
	}
}

static void a_cursor_that_is_nowhere_is_not_drawn(void **ctx)
{
	static const struct bb_vec3 nowhere[] = { { (double)NAN, 0, 0 }, { 0, HUGE_VAL, 0 }, { 0, 1, 3 },
						  { 0.2, 1.7, 0.4 },     { 40, 1, -1.5 },    { 1e300, 1e300, -1e300 } };
	struct bb_image plain = picture(&wall, 1, NULL);

	(void)ctx;
	for (size_t i = 0; i < BB_ARRAY_LEN(nowhere); i++) {
		struct bb_image image = picture(&wall, 1, &nowhere[i]);
		assert_memory_equal(image.rgba, plain.rgba, (size_t)WIDTH * HEIGHT * 4);
		bb_image_release(&image);
	}
	bb_image_release(&plain);
}

static void odd_input_is_survived(void **ctx)
{
	const struct bb_corners vast = { { -9e5, 0, 0 }, { 9e5, 0, 0 }, { -9e5, 1, 0 } };
	const struct bb_view view = bb_view_make(&wall, eye, eye, 0.05, 50),
			     wide = bb_view_make(&vast, eye, eye, 0.05, 50);
	struct bb_image image;
	char id[500];

	(void)ctx;
	memset(id, 'W', sizeof(id));
	id[sizeof(id) - 1] = '\0';
	assert_int_equal(bb_image_create(1, 1, &image), BB_OK);
	assert_int_equal(bb_calibration_draw(&view, id, 0, &wall.lower_left, &image), BB_OK);
	bb_image_release(&image);
	assert_int_equal(bb_image_create(300, 10, &image), BB_OK);
	assert_int_equal(bb_calibration_draw(&wide, id, 1, NULL, &image), BB_OK);
	assert_int_equal(bb_calibration_draw(&view, NULL, 1, NULL, &image), BB_OK);
	assert_int_equal(bb_calibration_draw(&view, "\xff\xfe bad", 1, NULL, &image), BB_ERR_USAGE);
	bb_image_release(&image);
	assert_int_equal(bb_calibration_draw(&view, "front", 1, NULL, &image), BB_ERR_USAGE);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(grid_is_ten_centimetres),
		cmocka_unit_test(grid_runs_on_across_tiles),
		cmocka_unit_test(border_reaches_the_last_pixel),
		cmocka_unit_test(eyes_cannot_be_confused),
		cmocka_unit_test(cursor_stands_where_it_projects),
		cmocka_unit_test(a_cursor_that_is_nowhere_is_not_drawn),
		cmocka_unit_test(odd_input_is_survived),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
