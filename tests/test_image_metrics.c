/*
 * tests/test_image_metrics.c: SSIM and L*u*v* distance against what the papers and standards say, and the oracles nI1
 * and nI2: constant, equal, one-pixel and non-finite pictures.
 */
#include "render/image_metrics.h"
#include "tests/fixture_result.h"

#include <jansson.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#define W 64
#define H 48

static uint32_t next(uint64_t *state)
{
	*state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (uint32_t)(*state >> 33);
}

static struct bb_image picture(uint32_t width, uint32_t height, uint8_t alpha)
{
	struct bb_image img;

	assert_int_equal(bb_image_create(width, height, &img), BB_OK);
	for (size_t i = 0; i < (size_t)width * height; i++)
		img.rgba[i * 4 + 3] = alpha;
	return img;
}

/* ---- SSIM ---- */

/* The formulas of the paper, one window after the other, in long double. */
static double slow_ssim(const float *a, const float *b, uint32_t w, uint32_t h, double range)
{
	const long double c1 = 0.0001L * (long double)range * (long double)range,
			  c2 = 0.0009L * (long double)range * (long double)range;
	long double sum = 0;

	for (int64_t y = 0; y < h; y++)
		for (int64_t x = 0; x < w; x++) {
			long double k[11][11], norm = 0, ma = 0, mb = 0, va = 0, vb = 0, ab = 0;
			for (int pass = 0; pass < 3; pass++)
				for (int j = -5; j <= 5; j++)
					for (int i = -5; i <= 5; i++) {
						if (x + i < 0 || x + i >= w || y + j < 0 || y + j >= h)
							continue;
						const size_t at = (size_t)(y + j) * w + (size_t)(x + i);
						long double *weight = &k[j + 5][i + 5];
						if (!pass) {
							*weight = expl(-(i * i + j * j) / 4.5L);
							norm += *weight;
						} else if (pass == 1) {
							ma += *weight / norm * (long double)a[at];
							mb += *weight / norm * (long double)b[at];
						} else {
							va += *weight / norm * ((long double)a[at] - ma) *
							      ((long double)a[at] - ma);
							vb += *weight / norm * ((long double)b[at] - mb) *
							      ((long double)b[at] - mb);
							ab += *weight / norm * ((long double)a[at] - ma) *
							      ((long double)b[at] - mb);
						}
					}
			sum += (2 * ma * mb + c1) * (2 * ab + c2) / ((ma * ma + mb * mb + c1) * (va + vb + c2));
		}
	return (double)(sum / w / h);
}

static void ssim_is_that_of_the_paper(void **state)
{
	static const uint32_t size[][2] = { { 1, 1 }, { 5, 30 }, { 11, 11 }, { 24, 17 }, { 33, 3 } };
	uint64_t seed = 7;
	double worst = 0;
	(void)state;

	for (size_t s = 0; s < BB_ARRAY_LEN(size); s++)
		for (int noise = 1; noise <= 256; noise *= 16) {
			const uint32_t w = size[s][0], h = size[s][1];
			float a[800], b[800];
			double got;
			for (size_t i = 0; i < (size_t)w * h; i++) {
				a[i] = (float)(next(&seed) % 256);
				b[i] = a[i] + (float)(next(&seed) % (uint32_t)noise);
			}
			assert_int_equal(bb_ssim(a, b, w, h, 255, NULL, &got), BB_OK);
			worst = fmax(worst, fabs(got - slow_ssim(a, b, w, h, 255)));
		}
	print_message("SSIM: %.2g off the formulas in long double (limit 1e-12)\n", worst);
	assert_true(worst <= 1e-12);
}

/* Oracle nI1. The one-pass form is what it must not be. */
static double one_pass_variance(float v)
{
	float sum = 0, squares = 0;

	for (int i = 0; i < 121; i++) {
		sum += v * (1.0f / 121);
		squares += v * v * (1.0f / 121);
	}
	return (double)(squares - sum * sum);
}

static void constant_pictures(void **state)
{
	static const float value[] = { 0, 1e-30f, 1, 100, 200, 255, 60000 };
	static float a[W * H], b[W * H];
	double worst = 0, got;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(value); i++)
		for (size_t j = 0; j < BB_ARRAY_LEN(value); j++) {
			const double range = fmax((double)fmaxf(value[i], value[j]), 255), c1 = 1e-4 * range * range;
			const double p = (double)value[i], q = (double)value[j];
			for (size_t k = 0; k < W * H; k++) {
				a[k] = value[i];
				b[k] = value[j];
			}
			assert_int_equal(bb_ssim(a, b, W, H, range, NULL, &got), BB_OK);
			worst = fmax(worst, fabs(got - (2 * p * q + c1) / (p * p + q * q + c1)));
			if (i == j)
				assert_true(got == 1); /* exactly */
		}
	print_message(
		"nI1: constant against constant %.2g off (limit 1e-6); E[x^2] - E[x]^2 in f32 says the variance of a "
		"constant 200 is %.3g, of 60000 %.4g\n",
		worst, one_pass_variance(200), one_pass_variance(60000));
	assert_true(worst <= 1e-6);
	for (size_t k = 0; k < W * H; k++)
		a[k] = (float)(k * 7919 % 65536);
	assert_int_equal(bb_ssim(a, a, W, H, 65535, NULL, &got), BB_OK);
	assert_true(got == 1);
	assert_int_equal(bb_ssim(a, a, W, H, 0, NULL, &got), BB_ERR_RANGE);
	assert_int_equal(bb_ssim(a, a, W, H, -1, NULL, &got), BB_ERR_RANGE);
	assert_int_equal(bb_ssim(a, a, W, H, (double)NAN, NULL, &got), BB_ERR_RANGE);
	a[17] = NAN;
	assert_int_equal(bb_ssim(a, b, W, H, 255, NULL, &got), BB_ERR_RANGE);
	assert_int_equal(bb_ssim(b, a, W, H, 255, NULL, &got), BB_ERR_RANGE);
	a[17] = INFINITY;
	assert_int_equal(bb_ssim(a, b, W, H, 255, NULL, &got), BB_ERR_RANGE);
}

/* ---- L*u*v* ---- */

/* Published values of the primaries under D65, to their two places. */
static void luv_is_that_of_the_standard(void **state)
{
	static const struct {
		uint8_t rgb[3];
		double luv[3];
	} known[] = {
		{ { 255, 255, 255 }, { 100, 0, 0 } },         { { 0, 0, 0 }, { 0, 0, 0 } },
		{ { 255, 0, 0 }, { 53.24, 175.01, 37.76 } },  { { 0, 255, 0 }, { 87.73, -83.08, 107.40 } },
		{ { 0, 0, 255 }, { 32.30, -9.40, -130.35 } }, { { 128, 128, 128 }, { 53.59, 0, 0 } },
	};
	double worst = 0;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++) {
		double luv[3];
		bb_srgb_to_luv(known[i].rgb, luv);
		for (int k = 0; k < 3; k++)
			worst = fmax(worst, fabs(luv[k] - known[i].luv[k]));
	}
	print_message("L*u*v* of primaries, grey, black and white: %.3f off the published values (limit 0.06)\n",
		      worst);
	assert_true(worst <= 0.06);
}

static void distances_are_over_the_seen_pixels(void **state)
{
	struct bb_image a = picture(4, 1, 255), b = picture(4, 1, 255);
	struct bb_image_quality q;
	double red[3];
	(void)state;

	bb_srgb_to_luv((const uint8_t[]){ 255, 0, 0 }, red);
	b.rgba[11] = 1; /* the third is not covered */
	a.rgba[4] = 255;
	a.rgba[8] = 255;
	assert_int_equal(bb_image_quality(&a, &b, &q), BB_OK);
	const double far = sqrt(red[0] * red[0] + red[1] * red[1] + red[2] * red[2]);
	assert_int_equal(q.n_pixels, 3);
	assert_true(fabs(q.luv_most - far) < 1e-12 && fabs(q.luv_mean - far / 3) < 1e-12);
	assert_true(q.ssim < 1);
	for (int i = 0; i < 4; i++)
		b.rgba[i * 4 + 3] = 0;
	assert_int_equal(bb_image_quality(&a, &b, &q), BB_OK);
	assert_true(q.n_pixels == 0 && q.ssim == 1 && q.luv_mean == 0 && q.luv_most == 0);
	bb_image_release(&b);
	b = picture(2, 2, 255);
	assert_int_equal(bb_image_quality(&a, &b, &q), BB_ERR_RANGE);
	bb_image_release(&a);
	bb_image_release(&b);
}

/* More noise is worse by every measure; the same noise hidden where nothing is drawn is not. */
static void all_measures_agree_on_the_order(void **state)
{
	struct bb_image b = picture(W, H, 255), a = picture(W, H, 255);
	struct bb_image_quality q, last = { .ssim = 2, .luv_mean = -1 };
	struct bb_image_difference d, before = { .psnr_db = 300 };
	(void)state;

	for (size_t i = 0; i < W * H; i++)
		for (int c = 0; c < 3; c++)
			b.rgba[i * 4 + (size_t)c] = (uint8_t)(60 + (i % W + (size_t)c * 30 + i / W) % 120);
	for (uint32_t noise = 1; noise <= 61; noise += 12) {
		uint64_t seed = 9;
		for (size_t i = 0; i < W * H * 4; i++)
			a.rgba[i] = i % 4 == 3 ? 255 : (uint8_t)(b.rgba[i] + next(&seed) % noise);
		assert_int_equal(bb_image_quality(&a, &b, &q), BB_OK);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		print_message("noise of %2u levels: PSNR %6.2f dB, SSIM %.5f, L*u*v* mean %.3f, most %.2f\n", noise - 1,
			      d.psnr_db, q.ssim, q.luv_mean, q.luv_most);
		assert_true(q.ssim < last.ssim && q.luv_mean > last.luv_mean && d.psnr_db < before.psnr_db);
		last = q;
		before = d;
	}
	bb_image_release(&a);
	bb_image_release(&b);
}

/* ---- oracle nI2 ---- */

static json_t *picture_in_json(const struct bb_image_difference *d, bool measured)
{
	const struct fixture_options o = { .n_frames = 60, .picture_dir = "pictures" };
	struct fixture *x = fixture_create(&o);
	char *text;

	assert_int_equal(bb_result_judge(x->result), BB_OK);
	assert_true(x->result->n_pictures > 0);
	x->result->pictures[0].psnr_db = measured ? d->psnr_db : (double)NAN;
	x->result->pictures[0].identical = measured && d->identical;
	text = bb_result_json_text(x->result);
	assert_non_null(text);
	json_t *root = json_loads(text, JSON_REJECT_DUPLICATES, NULL);
	assert_non_null(root);
	json_t *first = json_incref(json_array_get(json_object_get(root, "pictures"), 0));
	json_decref(root);
	free(text);
	fixture_free(x);
	return first;
}

static void equal_and_nearly_equal_pictures(void **state)
{
	struct bb_image a = picture(4096, 4096, 255), b = picture(4096, 4096, 255);
	struct bb_image_difference d;
	struct bb_image_quality q;
	(void)state;

	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	assert_true(d.identical && d.psnr_db == 200);
	json_t *j = picture_in_json(&d, true);
	assert_true(json_is_true(json_object_get(j, "identical")) &&
		    json_real_value(json_object_get(j, "psnr_db")) == 200);
	json_decref(j);
	a.rgba[4000] = 1; /* one level of one channel of one pixel of 16 million */
	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	print_message("nI2: one level in 4096 x 4096 is %.2f dB, not the 200 dB of equal ones\n", d.psnr_db);
	assert_true(!d.identical && d.psnr_db < 200 && fabs(d.psnr_db - 10 * log10(65025.0 * 3 * 4096 * 4096)) < 1e-9);
	j = picture_in_json(&d, true);
	assert_true(json_is_false(json_object_get(j, "identical")) &&
		    json_real_value(json_object_get(j, "psnr_db")) < 200);
	json_decref(j);
	j = picture_in_json(&d, false); /* not measured, or not a number */
	assert_true(json_is_null(json_object_get(j, "psnr_db")) && json_is_false(json_object_get(j, "identical")));
	json_decref(j);
	bb_image_release(&a);
	bb_image_release(&b);
	a = picture(W, H, 255);
	b = picture(W, H, 255);
	assert_int_equal(bb_image_quality(&a, &b, &q), BB_OK);
	assert_true(q.ssim == 1 && q.luv_mean == 0 && q.luv_most == 0 && q.n_pixels == W * H);
	b.rgba[4 * (W * 20 + 20) + 1] = 40;
	assert_int_equal(bb_image_quality(&a, &b, &q), BB_OK);
	assert_true(q.ssim < 1 && q.ssim > 0.9 && q.luv_most > 1 && fabs(q.luv_mean * W * H - q.luv_most) < 1e-9);
	bb_image_release(&a);
	bb_image_release(&b);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(ssim_is_that_of_the_paper),       cmocka_unit_test(constant_pictures),
		cmocka_unit_test(luv_is_that_of_the_standard),     cmocka_unit_test(distances_are_over_the_seen_pixels),
		cmocka_unit_test(all_measures_agree_on_the_order), cmocka_unit_test(equal_and_nearly_equal_pictures),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
