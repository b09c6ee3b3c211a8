/*
 * tests/test_image.c: pictures are written whole or not at all, and compared as the header says.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "render/image.h"

static char folder[] = "/tmp/bb_image_XXXXXX";

static int make_folder(void **ctx)
{
	(void)ctx;
	return mkdtemp(folder) ? 0 : -1;
}

static int drop_folder(void **ctx)
{
	(void)ctx;
	return rmdir(folder); /* fails when a test left a part behind */
}

static void path_of(char *out, size_t cap, const char *name)
{
	snprintf(out, cap, "%s/%s", folder, name);
}

static void sizes_are_checked(void **ctx)
{
	struct bb_image img;

	(void)ctx;
	assert_int_equal(bb_image_create(0, 4, &img), BB_ERR_RANGE);
	assert_int_equal(bb_image_create(4, 0, &img), BB_ERR_RANGE);
	assert_int_equal(bb_image_create(UINT32_MAX, UINT32_MAX, &img), BB_ERR_RANGE);
	assert_null(img.rgba);
	assert_int_equal(bb_image_create(3, 2, &img), BB_OK);
	assert_int_equal(img.rgba[23], 0);
	bb_image_release(&img);
	bb_image_release(&img);
	bb_image_release(NULL);
}

static void png_comes_back(void **ctx)
{
	char path[256];
	struct bb_image img;
	struct bb_error err = { 0 };
	png_image png = { .version = PNG_IMAGE_VERSION };
	uint8_t back[5 * 3 * 3];

	(void)ctx;
	path_of(path, sizeof(path), "a.png");
	assert_int_equal(bb_image_create(5, 3, &img), BB_OK);
	for (int i = 0; i < 60; i++)
		img.rgba[i] = (uint8_t)(i * 37);
	assert_int_equal(bb_image_write_png(&img, path, &err), BB_OK);
	assert_int_equal(bb_image_write_png(&img, path, &err), BB_OK); /* over the old one */
	assert_true(png_image_begin_read_from_file(&png, path));
	assert_int_equal(png.width, 5);
	assert_int_equal(png.height, 3);
	png.format = PNG_FORMAT_RGB;
	assert_true(png_image_finish_read(&png, NULL, back, 0, NULL));
	for (int i = 0; i < 15; i++)
		assert_memory_equal(back + i * 3, img.rgba + i * 4, 3);
	bb_image_release(&img);
	assert_int_equal(unlink(path), 0);
}

static void a_failed_write_leaves_nothing(void **ctx)
{
	char path[256], file[300];
	struct bb_image img;
	struct bb_error err = { 0 };

	(void)ctx;
	assert_int_equal(bb_image_create(2, 2, &img), BB_OK);
	path_of(path, sizeof(path), "is_a_folder");
	assert_int_equal(mkdir(path, 0755), 0);
	assert_int_equal(bb_image_write_png(&img, path, &err), BB_ERR_IO);
	assert_int_equal(err.number, 1806);
	assert_int_equal(rmdir(path), 0);

	err = (struct bb_error){ 0 };
	snprintf(file, sizeof(file), "%s/no/such/place.png", folder);
	assert_int_equal(bb_image_write_png(&img, file, &err), BB_ERR_IO);
	assert_non_null(strstr(err.text, "place.png"));

	char longer[2000];
	memset(longer, 'x', sizeof(longer));
	longer[sizeof(longer) - 1] = '\0';
	assert_int_equal(bb_image_write_png(&img, longer, NULL), BB_ERR_RANGE);
	bb_image_release(&img);
}

static void psnr_counts_the_seen_pixels(void **ctx)
{
	struct bb_image a, b;
	struct bb_image_difference d;

	(void)ctx;
	assert_int_equal(bb_image_create(4, 1, &a), BB_OK);
	assert_int_equal(bb_image_create(4, 1, &b), BB_OK);
	b.rgba[3] = 255;
	b.rgba[7] = 2;
	b.rgba[11] = 1; /* 1/255 is not more than 1/255 */
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	assert_true(d.identical && d.psnr_db == 200 && d.n_pixels == 2 && d.n_differ == 0);

	a.rgba[8] = 9; /* outside: in n_differ and most, not in the figure */
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	assert_true(d.identical && d.psnr_db == 200 && d.n_differ == 1 && d.most == 9);

	a.rgba[0] = 10; /* mse = 100 / 6 */
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	assert_true(!d.identical && d.n_differ == 2 && d.most == 10);
	assert_true(fabs(d.psnr_db - 10 * log10(65025.0 * 6 / 100)) < 1e-9);
	bb_image_release(&b);

	assert_int_equal(bb_image_create(2, 2, &b), BB_OK);
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_ERR_RANGE);
	bb_image_release(&a);
	bb_image_release(&b);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(sizes_are_checked),
		cmocka_unit_test(png_comes_back),
		cmocka_unit_test(a_failed_write_leaves_nothing),
		cmocka_unit_test(psnr_counts_the_seen_pixels),
	};

	return cmocka_run_group_tests(tests, make_folder, drop_folder);
}
