/*
 * sim/camera/picture.c: see sim/camera/picture.h. Most of a picture is dark, and there noise is one draw of 16 bits
 * against a table of thresholds; light is summed in floating point in boxes around the spots, and drawn pixel by pixel.
 */
#include "sim/camera/picture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define REACH 4.0          /* sds of blur beyond a disc's edge that are drawn */
#define LEAST_GREY 0.02f   /* of light in a pixel that is drawn for itself */
#define STRIPS 12          /* of a disc */
#define STEPS_MAX 16       /* positions along a spot's way */
#define STEP_PX 0.25
#define SPOT_PX_MAX 96     /* half a box: larger spots are cut */
#define CHUNK 1024
#define THRESHOLDS_MAX 255

struct sim_picture {
	struct sim_sensor sensor;
	int64_t width, height;
	float *light;              /* levels above black; 0 between two pictures */
	unsigned n_thresholds, dark; /* a dark pixel is `dark` + the thresholds its 16 bits reach */
	uint16_t threshold[THRESHOLDS_MAX];
};

static double normal_cdf(double x)
{
	return 0.5 * erfc(-x * 0.70710678118654752);
}

/* P(rounded level > k) as 16 bits: draws from there on up reach threshold k. */
static void lay_thresholds(struct sim_picture *p)
{
	const struct sim_sensor *s = &p->sensor;
	bool first = true;

	for (unsigned k = 0; k < 255; k++) {
		const double at = k + 0.5 - s->black;
		const double below = s->read_noise > 0 ? normal_cdf(at / s->read_noise) : at > 0;
		const double t = rint(below * 65536);
		if (t < 1 && first)
			p->dark = k + 1;
		if (t >= 1 && t <= 65535)
			p->threshold[p->n_thresholds++] = (uint16_t)t;
		first = first && t < 1;
	}
}

enum bb_status sim_picture_create(const struct sim_sensor *sensor, int64_t width_px, int64_t height_px,
                                  struct sim_picture **out)
{
	*out = NULL;
	if (width_px < 1 || height_px < 1 || width_px > 16384 || height_px > 16384 || !(sensor->psf_px > 0) ||
	    !(sensor->read_noise >= 0) || !(sensor->full_well_e > 0) || !(sensor->black >= 0 && sensor->black < 255))
		return BB_ERR_RANGE;
	struct sim_picture *p = calloc(1, sizeof(*p));
	if (!p)
		return BB_ERR_NOMEM;
	p->sensor = *sensor;
	p->width = width_px;
	p->height = height_px;
	p->light = calloc((size_t)(width_px * height_px), sizeof(*p->light));
	if (!p->light) {
		free(p);
		return BB_ERR_NOMEM;
	}
	lay_thresholds(p);
	*out = p;
	return BB_OK;
}

void sim_picture_destroy(struct sim_picture *p)
{
	if (!p)
		return;
	free(p->light);
	free(p);
}

/* The dark */

static void draw_dark(const struct sim_picture *p, struct sim_rng *rng, uint8_t *grey)
{
	const size_t n = (size_t)(p->width * p->height);
	uint64_t draw[CHUNK / 4];
	uint16_t bits[CHUNK], level[CHUNK];

	for (size_t at = 0; at < n; at += CHUNK) {
		const size_t now = n - at < CHUNK ? n - at : CHUNK;
		for (size_t i = 0; i < (now + 3) / 4; i++)
			draw[i] = sim_rng_u64(rng);
		memcpy(bits, draw, sizeof(bits)); /* the tail of the last chunk is old, and not used */
		for (size_t i = 0; i < CHUNK; i++)
			level[i] = (uint16_t)p->dark;
		for (unsigned k = 0; k < p->n_thresholds; k++) {
			const uint16_t t = p->threshold[k];
			for (size_t i = 0; i < CHUNK; i++)
				level[i] = (uint16_t)(level[i] + (bits[i] >= t));
		}
		for (size_t i = 0; i < now; i++)
			grey[at + i] = (uint8_t)level[i];
	}
}

/* Light */

struct box {
	int64_t x0, y0, x1, y1; /* half open, inside the picture */
};

static struct box box_around(const struct sim_picture *p, double x, double y, double reach)
{
	struct box b = { (int64_t)floor(x - reach), (int64_t)floor(y - reach), (int64_t)ceil(x + reach) + 1,
		         (int64_t)ceil(y + reach) + 1 };

	b.x0 = b.x0 < 0 ? 0 : b.x0;
	b.y0 = b.y0 < 0 ? 0 : b.y0;
	b.x1 = b.x1 > p->width ? p->width : b.x1;
	b.y1 = b.y1 > p->height ? p->height : b.y1;
	return b;
}

/* The integral of the normal distribution from far below up to x. */
static double rise(double x)
{
	return x * normal_cdf(x) + 0.3989422804014327 * exp(-0.5 * x * x);
}

/* Share of an evenly bright line from a to b that falls, blurred, into each pixel of a row; 1 is a line as long as a
 * pixel. */
static void lay_line(double *out, int64_t first, size_t n, double a, double b, double blur)
{
	double last = 0;

	for (size_t i = 0; i <= n; i++) {
		const double edge = (double)first + (double)i - 0.5;
		const double now = blur * (rise((edge - a) / blur) - rise((edge - b) / blur));
		if (i)
			out[i - 1] = now - last;
		last = now;
	}
}

static void add_product(struct sim_picture *p, const struct box *b, const double *across, const double *down, double grey)
{
	for (int64_t y = b->y0; y < b->y1; y++) {
		float *row = p->light + y * p->width;
		const double g = grey * down[y - b->y0];
		for (int64_t x = b->x0; x < b->x1; x++)
			row[x] += (float)(g * across[x - b->x0]);
	}
}

/* The area of the unit disc's right half below y. */
static double half_disc(double y)
{
	const double t = y < -1 ? -1 : y > 1 ? 1 : y;

	return (t * sqrt(1 - t * t) + asin(t)) / 2;
}

/* A disc in strips of equal height, each as wide as gives it its area. */
static void add_disc(struct sim_picture *p, const struct box *b, double x, double y, double r, double grey)
{
	double across[2 * SPOT_PX_MAX + 4] = { 0 }, down[2 * SPOT_PX_MAX + 4] = { 0 };
	const double tall = 2 * r / STRIPS;

	for (int i = 0; i < STRIPS; i++) {
		const double low = -r + i * tall, half = r * (half_disc(low / r + 2.0 / STRIPS) - half_disc(low / r)) * STRIPS / 2;
		lay_line(across, b->x0, (size_t)(b->x1 - b->x0), x - half, x + half, p->sensor.psf_px);
		lay_line(down, b->y0, (size_t)(b->y1 - b->y0), y + low, y + low + tall, p->sensor.psf_px);
		add_product(p, b, across, down, grey);
	}
}

void sim_disc_point(unsigned i, double *x, double *y)
{
	const double r = sqrt((i + 0.5) / SIM_DISC_POINTS), turn = 2.399963229728653 * i; /* the golden angle */

	*x = r * cos(turn);
	*y = r * sin(turn);
}

/* A disc of which something hides a part: squares of its light at the points that are seen. */
static void add_points(struct sim_picture *p, const struct box *b, double cx, double cy, const struct sim_light *l, double grey)
{
	double across[2 * SPOT_PX_MAX + 4] = { 0 }, down[2 * SPOT_PX_MAX + 4] = { 0 };
	const double half = l->radius_px * sqrt(3.14159265358979323846 / SIM_DISC_POINTS) / 2;

	for (unsigned i = 0; i < SIM_DISC_POINTS; i++) {
		double x, y;
		if (l->hidden >> i & 1)
			continue;
		sim_disc_point(i, &x, &y);
		x = cx + l->radius_px * x;
		y = cy + l->radius_px * y;
		lay_line(across, b->x0, (size_t)(b->x1 - b->x0), x - half, x + half, p->sensor.psf_px);
		lay_line(down, b->y0, (size_t)(b->y1 - b->y0), y - half, y + half, p->sensor.psf_px);
		add_product(p, b, across, down, grey);
	}
}

static double way_of(const struct sim_light *l)
{
	return hypot(l->x1_px - l->x0_px, l->y1_px - l->y0_px);
}

static struct box box_of(const struct sim_picture *p, const struct sim_light *l)
{
	const double reach = l->radius_px + REACH * p->sensor.psf_px + 1 + way_of(l) / 2;

	return box_around(p, (l->x0_px + l->x1_px) / 2, (l->y0_px + l->y1_px) / 2, fmin(reach, SPOT_PX_MAX));
}

static void add_light(struct sim_picture *p, const struct sim_light *l)
{
	const double way = way_of(l);
	const int steps = way > STEP_PX * STEPS_MAX ? STEPS_MAX : 1 + (int)(way / STEP_PX);
	const struct box b = box_of(p, l);

	for (int i = 0; i < steps && b.x1 > b.x0 && b.y1 > b.y0; i++) {
		const double t = (i + 0.5) / steps;
		const double x = l->x0_px + t * (l->x1_px - l->x0_px), y = l->y0_px + t * (l->y1_px - l->y0_px);
		if (l->hidden)
			add_points(p, &b, x, y, l, l->grey / steps);
		else
			add_disc(p, &b, x, y, l->radius_px, l->grey / steps);
	}
}

static struct box add_sun(struct sim_picture *p, double grey)
{
	const struct sim_sensor *s = &p->sensor;
	const double cx = s->sun_x * (double)p->width, cy = s->sun_y * (double)p->height, k = -0.5 / (s->sun_px * s->sun_px);
	const struct box b = box_around(p, cx, cy, REACH * s->sun_px);

	for (int64_t y = b.y0; y < b.y1; y++) {
		const double g = grey * exp(k * ((double)y - cy) * ((double)y - cy));
		for (int64_t x = b.x0; x < b.x1; x++)
			p->light[y * p->width + x] += (float)(g * exp(k * ((double)x - cx) * ((double)x - cx)));
	}
	return b;
}

/* Where there is light its own noise replaces the dark's; a pixel in two boxes is drawn once. */
static void expose(struct sim_picture *p, const struct box *b, struct sim_rng *rng, uint8_t *grey)
{
	const struct sim_sensor *s = &p->sensor;
	const double per_e = (255 - s->black) / s->full_well_e, read = s->read_noise * s->read_noise;

	for (int64_t y = b->y0; y < b->y1; y++)
		for (int64_t x = b->x0; x < b->x1; x++) {
			float *const light = &p->light[y * p->width + x];
			if (*light >= LEAST_GREY) {
				const double level = (double)*light, sd = sqrt(read + level * per_e);
				const double v = s->black + level + sd * sim_rng_normal(rng) + 0.5;
				grey[y * p->width + x] = (uint8_t)(v < 0 ? 0 : v > 255 ? 255 : v);
			}
			*light = 0;
		}
}

void sim_picture_draw(struct sim_picture *p, const struct sim_light *lights, size_t n, double sun, struct sim_rng *rng,
                      uint8_t *grey)
{
	struct box b = { 0 };

	draw_dark(p, rng, grey);
	if (sun > 0)
		b = add_sun(p, sun);
	for (size_t i = 0; i < n; i++)
		add_light(p, &lights[i]);
	expose(p, &b, rng, grey);
	for (size_t i = 0; i < n; i++) {
		b = box_of(p, &lights[i]);
		expose(p, &b, rng, grey);
	}
}
