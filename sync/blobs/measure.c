/*
 * sync/blobs/measure.c: what a finished part is: centre, moments, gates, and the one step of least squares.
 *
 * The step: with g the Gaussian of the spot's own width at its centroid and A its amplitude above the background B, the
 * shift that explains the residual best is sum (I - B - A g) x g / (A / sigma^2 sum x^2 g^2). Taking A g away first is what
 * keeps narrow spots unbiased: sampled at whole pixels the products with g alone would not cancel. The part that is
 * even in x (amplitude, width, background) hardly moves a centre that is a few hundredths off.
 */
#include "sync/blobs/blobs_private.h"

#include <math.h>

#define HALF_MAX 10           /* of a window, px: larger spots keep their centroid */
#define MARGIN_PX 2           /* around a spot's box: its background */
#define LEAST_SIGMA_PX 0.7    /* below, a picture samples too coarsely for a Gaussian to be one */
#define MOST_SIGMA_PX 4.0
#define MOST_STEP_PX 0.5      /* the centroid is not as wrong as that: it is no Gaussian */
#define TURN 6.283185307179586

/* The width of a round Gaussian of which so much area and light stand above a level `step` over its background: with
 * a = A / step, area = 2 pi sigma^2 ln a and light / (area step) = (a - 1) / ln a - 1, solved for a by Newton. */
static double width_of(double area, double light, double step)
{
	const double r = light / (area * step);
	double a = 2 + 2 * r;

	if (!(step > 0) || !(r > 0))
		return 0;
	for (int i = 0; i < 8; i++) {
		const double l = log(a), f = (a - 1) / l - 1 - r;
		a = fmax(a - f / ((l - 1 + 1 / a) / (l * l)), 1.05);
	}
	return sqrt(area / (TURN * log(a)));
}

struct window { /* square, around a whole pixel */
	uint32_t x, y; /* its upper left */
	int side;
	double background;
};

/* Inside the picture, nothing in it but this part, and dark all around. */
static bool place_window(const struct bb_blobs_config *c, const struct bb_blobs_picture *pic,
                         const struct bb_blobs_part *part, struct window *w)
{
	const uint32_t wide = part->x1 - part->x0, high = part->y1 - part->y0;
	const uint32_t half = (wide > high ? wide + 1 : high + 1) / 2 + MARGIN_PX;
	const uint32_t cx = (part->x0 + part->x1) / 2, cy = (part->y0 + part->y1) / 2;
	const uint32_t side = 2 * half + 1;
	uint64_t bright = 0, rim = 0;

	if (half > HALF_MAX || cx < half || cy < half || cx + half >= pic->width || cy + half >= pic->height)
		return false;
	*w = (struct window){ .x = cx - half, .y = cy - half, .side = (int)side };
	for (uint32_t j = 0; j < side; j++) {
		const uint8_t *row = pic->grey + (w->y + j) * pic->stride_bytes + w->x;
		const bool edge = j == 0 || j == side - 1;
		unsigned all = 0, sum = 0;
		for (uint32_t i = 0; i < side; i++) {
			all += row[i] >= c->low;
			sum += row[i];
		}
		bright += all;
		rim += edge ? sum : (unsigned)(row[0] + row[side - 1]);
	}
	w->background = (double)rim / (4.0 * (double)(side - 1));
	return bright == part->area && w->background < c->low;
}

struct axis { /* the Gaussian along one axis of the window */
	double at[2 * HALF_MAX + 1], g[2 * HALF_MAX + 1]; /* distance from the centre, weight */
	double g0, g1, q0, q1, q2;                       /* sums of g, x g, g^2, x g^2, x^2 g^2 */
};

static void lay_axis(struct axis *a, double first, int side, double sigma)
{
	const double k = -0.5 / (sigma * sigma);

	*a = (struct axis){ .g0 = 0 };
	for (int i = 0; i < side; i++) {
		const double x = first + i, g = exp(k * x * x);
		a->at[i] = x;
		a->g[i] = g;
		a->g0 += g;
		a->g1 += x * g;
		a->q0 += g * g;
		a->q1 += x * g * g;
		a->q2 += x * x * g * g;
	}
}

static bool refine(const struct bb_blobs_picture *pic, const struct window *w, struct bb_spot *s)
{
	const double sigma = s->sigma_px, b = w->background;
	double sum = 0, sum_x = 0, sum_y = 0;
	struct axis x, y;

	lay_axis(&x, (double)w->x - s->x_px, w->side, sigma);
	lay_axis(&y, (double)w->y - s->y_px, w->side, sigma);
	for (int j = 0; j < w->side; j++) {
		const uint8_t *row = pic->grey + (w->y + (size_t)j) * pic->stride_bytes + w->x;
		double light = 0, light_x = 0;
		for (int i = 0; i < w->side; i++) {
			const double v = x.g[i] * (double)row[i];
			light += v;
			light_x += v * x.at[i];
		}
		sum += y.g[j] * light;
		sum_x += y.g[j] * light_x;
		sum_y += y.g[j] * y.at[j] * light;
	}
	const double a = (sum - b * x.g0 * y.g0) / (x.q0 * y.q0);
	const double step_x = (sum_x - b * x.g1 * y.g0 - a * x.q1 * y.q0) * sigma * sigma / (a * x.q2 * y.q0);
	const double step_y = (sum_y - b * x.g0 * y.g1 - a * x.q0 * y.q1) * sigma * sigma / (a * x.q0 * y.q2);
	if (!(a > 0) || !(fabs(step_x) < MOST_STEP_PX) || !(fabs(step_y) < MOST_STEP_PX))
		return false;
	s->x_px += step_x;
	s->y_px += step_y;
	return true;
}

static double roundness(const struct bb_spot *s)
{
	const double mean = (s->xx + s->yy) / 2, half = (s->xx - s->yy) / 2, spread = sqrt(half * half + s->xy * s->xy);

	return mean > spread && mean + spread > 0 ? sqrt((mean - spread) / (mean + spread)) : 0;
}

/* Central moments from sums about the picture's corner: of a spot whose area is gated they are exact to 1e-6 px^2. */
static void moments(const struct bb_blobs_part *p, struct bb_spot *s)
{
	const double w = (double)p->w, x = (double)p->wx / w, y = (double)p->wy / w;

	*s = (struct bb_spot){ .x_px = x, .y_px = y, .area_px = (double)p->area, .light = w, .peak = p->peak };
	/* A pixel is a square of light, not a point: 1/12, or a line of pixels would have no width at all. */
	s->xx = (double)p->wxx / w - x * x + 1.0 / 12;
	s->yy = (double)p->wyy / w - y * y + 1.0 / 12;
	s->xy = (double)p->wxy / w - x * y;
	s->roundness = roundness(s);
	s->flags = p->peak == 255 ? BB_SPOT_SATURATED : 0;
}

bool bb_blobs_measure(const struct bb_blobs_config *c, const struct bb_blobs_picture *pic,
                      const struct bb_blobs_part *part, struct bb_spot *out)
{
	struct window w;

	if (part->peak < c->high || (double)part->area < c->least_area_px || (double)part->area > c->most_area_px ||
	    !part->x0 || !part->y0 || part->x1 + 1 >= pic->width || part->y1 + 1 >= pic->height)
		return false;
	moments(part, out);
	if (out->roundness < c->least_roundness)
		return false;
	const bool alone = place_window(c, pic, part, &w);
	const double step = c->low - 0.5 - (alone ? w.background : c->black);
	out->sigma_px = width_of(out->area_px, out->light - out->area_px / 2, step);
	if (!c->refine || !alone || out->flags & BB_SPOT_SATURATED || !(out->sigma_px < MOST_SIGMA_PX))
		return true;
	out->sigma_px = fmax(out->sigma_px, LEAST_SIGMA_PX);
	if (refine(pic, &w, out))
		out->flags |= BB_SPOT_REFINED;
	return true;
}

struct bb_blob bb_spot_blob(const struct bb_spot *spot)
{
	return (struct bb_blob){ (float)spot->x_px, (float)spot->y_px, (float)spot->area_px };
}
