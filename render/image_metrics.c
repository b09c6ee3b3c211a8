#include "render/image_metrics.h"

#include <math.h>
#include <stdlib.h>

#define REACH 5 /* of a window, from its middle */
#define SIDE (2 * REACH + 1)
#define SIGMA 1.5

/* ---- SSIM ---- */

struct planes {
	const float *a, *b;
	uint32_t width, height;
	double c1, c2;
	double weight[SIDE]; /* of a row or column; not normalised */
};

struct window {                  /* what of it lies in the picture */
	uint32_t x0, x1, y0, y1; /* x1, y1: one past it */
	const double *wx, *wy;   /* of x0, y0 */
	double norm;
};

static struct window window_at(const struct planes *p, uint32_t x, uint32_t y)
{
	struct window w = { .x0 = x > REACH ? x - REACH : 0, .y0 = y > REACH ? y - REACH : 0 };
	double sum_x = 0, sum_y = 0;

	w.x1 = p->width - x > REACH + 1 ? x + REACH + 1 : p->width;
	w.y1 = p->height - y > REACH + 1 ? y + REACH + 1 : p->height;
	w.wx = p->weight + (w.x0 + REACH - x);
	w.wy = p->weight + (w.y0 + REACH - y);
	for (uint32_t i = 0; i < w.x1 - w.x0; i++)
		sum_x += w.wx[i];
	for (uint32_t i = 0; i < w.y1 - w.y0; i++)
		sum_y += w.wy[i];
	w.norm = 1 / (sum_x * sum_y);
	return w;
}

static double ssim_of(const struct planes *p, const struct window *w)
{
	double mean_a = 0, mean_b = 0, var_a = 0, var_b = 0, both = 0;

	for (uint32_t y = w->y0; y < w->y1; y++) {
		const float *a = p->a + (size_t)y * p->width, *b = p->b + (size_t)y * p->width;
		double row_a = 0, row_b = 0;
		for (uint32_t x = w->x0; x < w->x1; x++) {
			row_a += w->wx[x - w->x0] * (double)a[x];
			row_b += w->wx[x - w->x0] * (double)b[x];
		}
		mean_a += w->wy[y - w->y0] * row_a;
		mean_b += w->wy[y - w->y0] * row_b;
	}
	mean_a *= w->norm;
	mean_b *= w->norm;
	for (uint32_t y = w->y0; y < w->y1; y++) {
		const float *a = p->a + (size_t)y * p->width, *b = p->b + (size_t)y * p->width;
		double row_a = 0, row_b = 0, row_both = 0;
		for (uint32_t x = w->x0; x < w->x1; x++) {
			const double da = (double)a[x] - mean_a, db = (double)b[x] - mean_b, k = w->wx[x - w->x0];
			row_a += k * da * da;
			row_b += k * db * db;
			row_both += k * da * db;
		}
		var_a += w->wy[y - w->y0] * row_a;
		var_b += w->wy[y - w->y0] * row_b;
		both += w->wy[y - w->y0] * row_both;
	}
	return (2 * mean_a * mean_b + p->c1) * (2 * both * w->norm + p->c2) /
	       ((mean_a * mean_a + mean_b * mean_b + p->c1) * ((var_a + var_b) * w->norm + p->c2));
}

enum bb_status bb_ssim(const float *a, const float *b, uint32_t width, uint32_t height, double range,
		       const uint8_t *covered, double *out)
{
	struct planes p = { a, b, width, height, 0.01 * range * 0.01 * range, 0.03 * range * 0.03 * range, { 0 } };
	const size_t n = (size_t)width * height;
	double sum = 0;
	size_t many = 0;

	*out = 1;
	if (!(range > 0 && p.c1 > 0 && isfinite(p.c2)))
		return BB_ERR_RANGE;
	for (size_t i = 0; i < n; i++)
		if (!isfinite(a[i]) || !isfinite(b[i]))
			return BB_ERR_RANGE;
	for (int i = 0; i < SIDE; i++)
		p.weight[i] = exp(-(i - REACH) * (i - REACH) / (2 * SIGMA * SIGMA));
	for (uint32_t y = 0; y < height; y++)
		for (uint32_t x = 0; x < width; x++) {
			if (covered && !covered[(size_t)y * width + x])
				continue;
			const struct window w = window_at(&p, x, y);
			sum += ssim_of(&p, &w);
			many++;
		}
	if (many)
		*out = sum / (double)many;
	return BB_OK;
}

/* ---- L*u*v* ---- */

double bb_srgb_to_linear(double c)
{
	return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4);
}

static double linear(uint8_t v)
{
	return bb_srgb_to_linear(v / 255.0);
}

/* From linear RGB; white is what the matrix makes of (1, 1, 1), so greys have no colour. */
static void luv_of(const double rgb[3], double luv[3])
{
	static const double row[3][3] = { { 0.4124, 0.3576, 0.1805 },
					  { 0.2126, 0.7152, 0.0722 },
					  { 0.0193, 0.1192, 0.9505 } };
	static const double white[3] = { 0.9505, 1.0, 1.0890 };
	const double white_sum = white[0] + 15 * white[1] + 3 * white[2];
	double xyz[3];

	for (int i = 0; i < 3; i++)
		xyz[i] = row[i][0] * rgb[0] + row[i][1] * rgb[1] + row[i][2] * rgb[2];
	const double sum = xyz[0] + 15 * xyz[1] + 3 * xyz[2];
	luv[0] = xyz[1] > 216.0 / 24389 ? 116 * cbrt(xyz[1]) - 16 : xyz[1] * 24389 / 27;
	luv[1] = sum > 0 ? 13 * luv[0] * (4 * xyz[0] / sum - 4 * white[0] / white_sum) : 0;
	luv[2] = sum > 0 ? 13 * luv[0] * (9 * xyz[1] / sum - 9 * white[1] / white_sum) : 0;
}

void bb_srgb_to_luv(const uint8_t rgb[3], double luv[3])
{
	const double light[3] = { linear(rgb[0]), linear(rgb[1]), linear(rgb[2]) };

	luv_of(light, luv);
}

static double luv_distance(const double light[256], const uint8_t *p, const uint8_t *q)
{
	double a[3], b[3];

	if (p[0] == q[0] && p[1] == q[1] && p[2] == q[2])
		return 0;
	luv_of((const double[]){ light[p[0]], light[p[1]], light[p[2]] }, a);
	luv_of((const double[]){ light[q[0]], light[q[1]], light[q[2]] }, b);
	return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
}

static void compare_luv(const struct bb_image *a, const struct bb_image *reference, struct bb_image_quality *out)
{
	const size_t n = (size_t)a->width * a->height;
	double light[256], sum = 0;

	for (int i = 0; i < 256; i++)
		light[i] = linear((uint8_t)i);
	for (size_t i = 0; i < n; i++) {
		if (reference->rgba[i * 4 + 3] <= 1)
			continue;
		const double d = luv_distance(light, a->rgba + i * 4, reference->rgba + i * 4);
		sum += d;
		out->luv_most = fmax(out->luv_most, d);
		out->n_pixels++;
	}
	out->luv_mean = out->n_pixels ? sum / (double)out->n_pixels : 0;
}

static float luma(const uint8_t *p)
{
	return 0.299f * (float)p[0] + 0.587f * (float)p[1] + 0.114f * (float)p[2];
}

enum bb_status bb_image_quality(const struct bb_image *a, const struct bb_image *reference,
				struct bb_image_quality *out)
{
	const size_t n = (size_t)a->width * a->height;

	*out = (struct bb_image_quality){ .ssim = 1 };
	if (a->width != reference->width || a->height != reference->height)
		return BB_ERR_RANGE;
	float *planes = malloc((n ? n : 1) * 2 * sizeof(float));
	uint8_t *covered = malloc(n ? n : 1);
	enum bb_status status = planes && covered ? BB_OK : BB_ERR_NOMEM;
	for (size_t i = 0; i < n && !status; i++) {
		planes[i] = luma(a->rgba + i * 4);
		planes[n + i] = luma(reference->rgba + i * 4);
		covered[i] = reference->rgba[i * 4 + 3] > 1;
	}
	if (!status)
		status = bb_ssim(planes, planes + n, a->width, a->height, 255, covered, &out->ssim);
	if (!status)
		compare_luv(a, reference, out);
	free(planes);
	free(covered);
	return status;
}
