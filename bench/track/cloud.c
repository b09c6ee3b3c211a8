#include "bench/track/cloud.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "render/parallel.h"

#define SAMPLES 2          /* along each axis of a pixel */
#define STEP_VOXELS 0.5
#define ENOUGH 0.985       /* opacity at which a ray is done */
#define SMOOTHINGS 3
#define BODY_PER_M 2.2     /* how fast the inside fades what lies behind */
#define SKIN 5.0           /* opacity per unit of change of the field */
#define RAD_PER_DEG (3.14159265358979323846 / 180.0)

/* ---- the eye ---- */

static void shift_into(struct bb_eyepoint *e, const struct bb_vec3 corner[8], double width, double height, double margin)
{
	double low[2] = { HUGE_VAL, HUGE_VAL }, high[2] = { -HUGE_VAL, -HUGE_VAL }, at[2];

	e->focal_px = 1;
	e->x_px = e->y_px = 0;
	for (int i = 0; i < 8; i++) {
		bb_eyepoint_project(e, corner[i], &at[0], &at[1]);
		for (int a = 0; a < 2; a++) {
			low[a] = fmin(low[a], at[a]);
			high[a] = fmax(high[a], at[a]);
		}
	}
	e->focal_px = fmin((width - 2 * margin) / (high[0] - low[0]), (height - 2 * margin) / (high[1] - low[1]));
	e->x_px = width / 2 - e->focal_px * (low[0] + high[0]) / 2;
	e->y_px = height / 2 - e->focal_px * (low[1] + high[1]) / 2;
}

struct bb_eyepoint bb_eyepoint_of_box(struct bb_vec3 min, struct bb_vec3 max, double azimuth_deg, double elevation_deg,
				      double width, double height, double margin)
{
	const struct bb_vec3 middle = bb_vec3_lerp(min, max, 0.5);
	const double size = bb_vec3_norm(bb_vec3_sub(max, min));
	const double a = azimuth_deg * RAD_PER_DEG, b = elevation_deg * RAD_PER_DEG;
	const struct bb_vec3 away = { sin(a) * cos(b), sin(b), cos(a) * cos(b) };
	struct bb_eyepoint e = { .eye = bb_vec3_add(middle, bb_vec3_scale(away, 2.1 * size)),
				 .forward = bb_vec3_scale(away, -1),
				 .right = { cos(a), 0, -sin(a) } };
	struct bb_vec3 corner[8];

	e.up = bb_vec3_cross(e.right, e.forward);
	for (int i = 0; i < 8; i++)
		corner[i] = (struct bb_vec3){ i & 1 ? max.x : min.x, i & 2 ? max.y : min.y, i & 4 ? max.z : min.z };
	shift_into(&e, corner, width, height, margin);
	return e;
}

void bb_eyepoint_project(const struct bb_eyepoint *e, struct bb_vec3 p, double *x, double *y)
{
	const struct bb_vec3 d = bb_vec3_sub(p, e->eye);
	const double depth = fmax(bb_vec3_dot(d, e->forward), 1e-3);

	*x = e->x_px + e->focal_px * bb_vec3_dot(d, e->right) / depth;
	*y = e->y_px - e->focal_px * bb_vec3_dot(d, e->up) / depth;
}

static struct bb_vec3 direction(const struct bb_eyepoint *e, double x, double y)
{
	const struct bb_vec3 d = bb_vec3_add(e->forward, bb_vec3_add(bb_vec3_scale(e->right, (x - e->x_px) / e->focal_px),
								      bb_vec3_scale(e->up, (e->y_px - y) / e->focal_px)));

	return bb_vec3_unit(d, e->forward);
}

/* ---- the field ---- */

static size_t index_of(const struct bb_coverage_grid *g, size_t x, size_t y, size_t z)
{
	return (y * g->n[2] + z) * g->n[0] + x;
}

/* One pass of 1 2 1 along an axis; outside is nothing, so that the cloud is closed at the walls. */
static void smooth(const struct bb_coverage_grid *g, const float *in, float *out, int axis)
{
	const size_t stride[3] = { 1, g->n[0] * g->n[2], g->n[0] };
	size_t at[3];

	for (at[1] = 0; at[1] < g->n[1]; at[1]++)
		for (at[2] = 0; at[2] < g->n[2]; at[2]++)
			for (at[0] = 0; at[0] < g->n[0]; at[0]++) {
				const size_t i = index_of(g, at[0], at[1], at[2]);
				const float a = at[axis] ? in[i - stride[axis]] : 0;
				const float b = at[axis] + 1 < g->n[axis] ? in[i + stride[axis]] : 0;
				out[i] = 0.25f * (a + b) + 0.5f * in[i];
			}
}

static float value_at(const struct bb_coverage_grid *g, const float *v, const size_t at[3], int axis, int step)
{
	const size_t k = at[axis] + (size_t)step; /* wraps below zero: beyond the end as well */
	size_t to[3] = { at[0], at[1], at[2] };

	to[axis] = k;
	return k < g->n[axis] ? v[index_of(g, to[0], to[1], to[2])] : 0;
}

static void fill(struct bb_cloud *c, const float *v)
{
	const struct bb_coverage_grid *g = c->grid;
	size_t at[3];

	for (at[1] = 0; at[1] < g->n[1]; at[1]++)
		for (at[2] = 0; at[2] < g->n[2]; at[2]++)
			for (at[0] = 0; at[0] < g->n[0]; at[0]++) {
				const size_t i = index_of(g, at[0], at[1], at[2]);
				for (int a = 0; a < 3; a++)
					c->field[4 * i + (size_t)a] =
						0.5f * (value_at(g, v, at, a, 1) - value_at(g, v, at, a, -1));
				c->field[4 * i + 3] = v[i];
				c->above[at[2] * g->n[0] + at[0]] += v[i] * (float)g->step_m;
			}
}

enum bb_status bb_cloud_init(struct bb_cloud *c, const struct bb_coverage_grid *g, const float *value)
{
	const size_t n = g->n[0] * g->n[1] * g->n[2];
	float *a = malloc(n * sizeof(*a)), *b = malloc(n * sizeof(*b));

	*c = (struct bb_cloud){ .grid = g,
				.field = calloc(n * 4, sizeof(float)),
				.above = calloc(g->n[0] * g->n[2], sizeof(float)) };
	if (a && b && c->field && c->above) {
		memcpy(a, value, n * sizeof(*a));
		for (int i = 0; i < 3 * SMOOTHINGS; i++) {
			smooth(g, a, b, i % 3);
			float *keep = a;
			a = b;
			b = keep;
		}
		fill(c, a);
	}
	const bool ok = a && b && c->field && c->above;
	free(a);
	free(b);
	if (!ok)
		bb_cloud_fini(c);
	return ok ? BB_OK : BB_ERR_NOMEM;
}

void bb_cloud_fini(struct bb_cloud *c)
{
	free(c->field);
	free(c->above);
	*c = (struct bb_cloud){ 0 };
}

/* Gradient and value between voxels' centres; zero outside. p in voxels, the first centre at 0. */
static void sample(const struct bb_cloud *c, const double p[3], float out[4])
{
	const struct bb_coverage_grid *g = c->grid;
	size_t at[3];
	float t[3];

	memset(out, 0, 4 * sizeof(*out));
	for (int a = 0; a < 3; a++) {
		const double q = fmin(fmax(p[a], 0), (double)g->n[a] - 1);
		at[a] = (size_t)q < g->n[a] - 1 ? (size_t)q : g->n[a] > 1 ? g->n[a] - 2 : 0;
		t[a] = (float)(q - (double)at[a]);
	}
	for (int corner = 0; corner < 8; corner++) {
		const size_t x = at[0] + (corner & 1), y = at[1] + (corner >> 1 & 1), z = at[2] + (corner >> 2 & 1);
		if (x >= g->n[0] || y >= g->n[1] || z >= g->n[2])
			continue;
		const float *v = &c->field[4 * index_of(g, x, y, z)];
		const float w = (corner & 1 ? t[0] : 1 - t[0]) * (corner & 2 ? t[1] : 1 - t[1]) *
				(corner & 4 ? t[2] : 1 - t[2]);
		for (int k = 0; k < 4; k++)
			out[k] += w * v[k];
	}
}

/* ---- light ---- */

struct light {
	double r, g, b, a; /* premultiplied */
};

static double soft_step(double low, double high, double v)
{
	const double t = fmin(fmax((v - low) / (high - low), 0), 1);

	return t * t * (3 - 2 * t);
}

/* Two lamps and a sheen: one above behind the eye's left shoulder, a weak one from below right. */
static struct light shade(const float s[4], struct bb_vec3 ray)
{
	static const double dark[3] = { 0.04, 0.13, 0.40 }, mid[3] = { 0.15, 0.43, 0.84 }, bright[3] = { 0.72, 0.88, 1.0 };
	const double k = sqrt((double)(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]));
	const struct bb_vec3 n = bb_vec3_scale((struct bb_vec3){ (double)s[0], (double)s[1], (double)s[2] },
					       k > 1e-6 ? -1 / k : 0);
	const struct bb_vec3 key = { -0.30, 0.83, 0.47 }, fill_in = { 0.86, 0.10, 0.50 };
	const double lit = 0.30 + 0.62 * fmax(0, bb_vec3_dot(n, key)) + 0.20 * fmax(0, bb_vec3_dot(n, fill_in));
	const struct bb_vec3 half = bb_vec3_unit(bb_vec3_sub(key, ray), key);
	const double sheen = 0.22 * pow(fmax(0, bb_vec3_dot(n, half)), 18);
	const double t = fmin(2 * lit, 2);
	double c[3];

	for (int i = 0; i < 3; i++) {
		c[i] = t < 1 ? dark[i] + (mid[i] - dark[i]) * t : mid[i] + (bright[i] - mid[i]) * (t - 1);
		c[i] = fmin(c[i] + sheen, 1);
	}
	return (struct light){ c[0], c[1], c[2], k };
}

/* Enters and leaves the grid's box, in metres along the ray; false: passes by. */
static bool crosses(const struct bb_coverage_grid *g, struct bb_vec3 o, struct bb_vec3 d, double *from, double *to)
{
	const double oo[3] = { o.x, o.y, o.z }, dd[3] = { d.x, d.y, d.z }, low[3] = { g->min.x, g->min.y, g->min.z };

	*from = 0;
	*to = HUGE_VAL;
	for (int a = 0; a < 3; a++) {
		const double high = low[a] + g->step_m * (double)g->n[a];
		const double t0 = (low[a] - oo[a]) / dd[a], t1 = (high - oo[a]) / dd[a];
		if (fabs(dd[a]) < 1e-12)
			continue;
		*from = fmax(*from, fmin(t0, t1));
		*to = fmin(*to, fmax(t0, t1));
	}
	return *from < *to;
}

static struct light march(const struct bb_cloud *c, struct bb_vec3 o, struct bb_vec3 d)
{
	const struct bb_coverage_grid *g = c->grid;
	const double step_m = STEP_VOXELS * g->step_m;
	struct light sum = { 0 };
	double from, to;

	if (!crosses(g, o, d, &from, &to))
		return sum;
	const size_t steps = (size_t)((to - from) / step_m + 0.5);
	for (size_t i = 0; i < steps && sum.a < ENOUGH; i++) {
		const double t = from + ((double)i + 0.5) * step_m;
		const struct bb_vec3 at = bb_vec3_sub(bb_vec3_add(o, bb_vec3_scale(d, t)), g->min);
		const double p[3] = { at.x / g->step_m - 0.5, at.y / g->step_m - 0.5, at.z / g->step_m - 0.5 };
		float s[4];
		sample(c, p, s);
		const double inside = soft_step(0.30, 0.62, (double)s[3]);
		if (!(inside > 0))
			continue;
		const struct light l = shade(s, d);
		const double a = 1 - exp(-inside * (BODY_PER_M * step_m + SKIN * STEP_VOXELS * l.a)), w = a * (1 - sum.a);
		sum.r += w * l.r;
		sum.g += w * l.g;
		sum.b += w * l.b;
		sum.a += w;
	}
	return sum;
}

static struct light darken(const struct bb_cloud *c, struct bb_vec3 o, struct bb_vec3 d, double floor_m)
{
	const struct bb_coverage_grid *g = c->grid;
	const double t = fabs(d.y) > 1e-9 ? (floor_m - o.y) / d.y : -1;
	const double x = (o.x + t * d.x - g->min.x) / g->step_m - 0.5, z = (o.z + t * d.z - g->min.z) / g->step_m - 0.5;
	double sum = 0;

	if (t <= 0)
		return (struct light){ 0 };
	for (int i = 0; i < 4; i++) {
		const double cx = floor(x) + (i & 1), cz = floor(z) + (i >> 1);
		const double w = (1 - fabs(x - cx)) * (1 - fabs(z - cz));
		if (cx >= 0 && cz >= 0 && cx < (double)g->n[0] && cz < (double)g->n[2])
			sum += w * (double)c->above[(size_t)cz * g->n[0] + (size_t)cx];
	}
	const double a = 0.30 * (1 - exp(-1.6 * sum));
	return (struct light){ 0.10 * a, 0.16 * a, 0.32 * a, a };
}

/* ---- pictures ---- */

struct picture {
	const struct bb_cloud *cloud;
	const struct bb_eyepoint *eye;
	double sharper, floor_m;
	bool shadow;
	unsigned char *pixels;
	int width, stride;
};

static uint32_t byte_of(double v)
{
	return (uint32_t)lrint(255 * fmin(fmax(v, 0), 1));
}

static void paint_row(void *ctx, size_t y, unsigned thread)
{
	const struct picture *p = ctx;
	uint32_t *out = (uint32_t *)(void *)(p->pixels + y * (size_t)p->stride);

	(void)thread;
	for (int x = 0; x < p->width; x++) {
		struct light sum = { 0 };
		for (int k = 0; k < SAMPLES * SAMPLES; k++) {
			const int right = k % SAMPLES, down = k / SAMPLES;
			const double px = (x + (right + 0.5) / SAMPLES) / p->sharper;
			const double py = ((double)y + (down + 0.5) / SAMPLES) / p->sharper;
			const struct bb_vec3 d = direction(p->eye, px, py);
			const struct light l = p->shadow ? darken(p->cloud, p->eye->eye, d, p->floor_m)
							 : march(p->cloud, p->eye->eye, d);
			sum.r += l.r / (SAMPLES * SAMPLES);
			sum.g += l.g / (SAMPLES * SAMPLES);
			sum.b += l.b / (SAMPLES * SAMPLES);
			sum.a += l.a / (SAMPLES * SAMPLES);
		}
		out[x] = byte_of(sum.a) << 24 | byte_of(sum.r) << 16 | byte_of(sum.g) << 8 | byte_of(sum.b);
	}
}

static cairo_surface_t *paint(struct picture *p, double width, double height, unsigned threads)
{
	cairo_surface_t *s = cairo_image_surface_create(CAIRO_FORMAT_ARGB32, (int)ceil(width * p->sharper),
							(int)ceil(height * p->sharper));

	if (cairo_surface_status(s) != CAIRO_STATUS_SUCCESS) {
		cairo_surface_destroy(s);
		return NULL;
	}
	cairo_surface_flush(s);
	p->pixels = cairo_image_surface_get_data(s);
	p->width = cairo_image_surface_get_width(s);
	p->stride = cairo_image_surface_get_stride(s);
	bb_parallel(threads, (size_t)cairo_image_surface_get_height(s), paint_row, p);
	cairo_surface_mark_dirty(s);
	return s;
}

cairo_surface_t *bb_cloud_picture(const struct bb_cloud *c, const struct bb_eyepoint *e, double width, double height,
				  double sharper, unsigned threads)
{
	struct picture p = { .cloud = c, .eye = e, .sharper = sharper };

	return paint(&p, width, height, threads);
}

cairo_surface_t *bb_cloud_shadow(const struct bb_cloud *c, const struct bb_eyepoint *e, double floor_m, double width,
				 double height, double sharper, unsigned threads)
{
	struct picture p = { .cloud = c, .eye = e, .sharper = sharper, .floor_m = floor_m, .shadow = true };

	return paint(&p, width, height, threads);
}
