#include "sync/track/lens.h"

#include <math.h>

#define NEAR_M 0.02     /* nothing is tracked nearer than this to a lens */
#define RADIUS_CAP 20.0 /* 87 degrees off the axis */

/* The radial part of both kinds is t (1 + k1 t^2 + ... + k4 t^8), of the radius (k4 = 0) or of the angle. */
static double gain(const struct bb_lens *lens, double tt)
{
	return 1 + tt * (lens->k[0] + tt * (lens->k[1] + tt * (lens->k[2] + tt * lens->k[3])));
}

static double slope(const struct bb_lens *lens, double tt)
{
	return 1 + tt * (3 * lens->k[0] + tt * (5 * lens->k[1] + tt * (7 * lens->k[2] + tt * 9 * lens->k[3])));
}

/* Trust: where does a polynomial first reach 0? */

#define DEGREE_MAX 8

static double polynomial(const double *c, int degree, double x)
{
	double sum = c[degree];

	for (int i = degree - 1; i >= 0; i--)
		sum = sum * x + c[i];
	return sum;
}

/* The root between two places of different sign, to the last bit or so. */
static double bisect(const double *c, int degree, double low, double high)
{
	const bool rises = polynomial(c, degree, low) < 0;

	for (int i = 0; i < 80; i++) {
		const double mid = 0.5 * (low + high);
		if ((polynomial(c, degree, mid) < 0) == rises)
			low = mid;
		else
			high = mid;
	}
	return low;
}

/* All places in (0, most) where a polynomial changes its sign, ascending: between two turning points there is at most
 * one, and the turning points are those places of its derivative. */
static int sign_changes(const double *c, int degree, double most, double *out)
{
	double slope_of[DEGREE_MAX], turn[DEGREE_MAX + 1];
	int n = 0, n_turns = 0;

	if (degree < 1)
		return 0;
	for (int i = 0; i < degree; i++)
		slope_of[i] = (i + 1) * c[i + 1];
	n_turns = sign_changes(slope_of, degree - 1, most, turn); /* at most 8 deep */
	turn[n_turns] = most;
	for (int i = 0; i <= n_turns; i++) {
		const double low = i ? turn[i - 1] : 0;
		if ((polynomial(c, degree, low) < 0) != (polynomial(c, degree, turn[i]) < 0))
			out[n++] = bisect(c, degree, low, turn[i]);
	}
	return n;
}

static double positive_up_to(const double *c, double most)
{
	double place[DEGREE_MAX];

	return sign_changes(c, DEGREE_MAX, most, place) ? place[0] : most;
}

/*
 * Distortion is the gradient of a potential, so its derivative is a symmetric matrix, and where that is positive definite
 * in a disc no two points of the disc share an image. Its radial part has the eigenvalues slope (outwards) and gain
 * (around); the tangential part adds at least -6 |p| r (towards -(p2, p1)).
 */
static double trusted_radius(const struct bb_lens *lens)
{
	const double *k = lens->k, bend = -6 * hypot(lens->p1, lens->p2);
	const double most = lens->fisheye ? atan(RADIUS_CAP) : RADIUS_CAP;
	const double outwards[DEGREE_MAX + 1] = { 1, bend, 3 * k[0], 0, 5 * k[1], 0, 7 * k[2], 0, 9 * k[3] };
	const double around[DEGREE_MAX + 1] = { 1, bend, k[0], 0, k[1], 0, k[2], 0, k[3] };
	const double t = fmin(positive_up_to(outwards, most), positive_up_to(around, most));

	return 0.999 * (lens->fisheye ? tan(t) : t);
}

static bool config_is_finite(const struct bb_camera_config *c)
{
	const double v[] = { c->pose.p.x, c->pose.p.y, c->pose.p.z, c->pose.q.x, c->pose.q.y, c->pose.q.z, c->pose.q.w,
			     c->fx_px,    c->fy_px,    c->cx_px,    c->cy_px,    c->k1,       c->k2,       c->k3,
			     c->k4,       c->p1,       c->p2 };

	for (size_t i = 0; i < BB_ARRAY_LEN(v); i++)
		if (!isfinite(v[i]) || fabs(v[i]) > 1e9)
			return false;
	return true;
}

bool bb_lens_init(struct bb_lens *lens, const struct bb_camera_config *config)
{
	static const struct bb_vec3 axes[3] = { { 1, 0, 0 }, { 0, 1, 0 }, { 0, 0, 1 } };

	if (!config_is_finite(config) || !(config->fx_px > 0) || !(config->fy_px > 0) || config->width_px < 1 ||
	    config->height_px < 1)
		return false;
	const struct bb_quat q = bb_quat_unit(config->pose.q);
	for (int i = 0; i < 3; i++) {
		const struct bb_vec3 axis = bb_quat_rotate(q, axes[i]);
		lens->r[i][0] = axis.x;
		lens->r[i][1] = axis.y;
		lens->r[i][2] = axis.z;
	}
	lens->o = config->pose.p;
	lens->fx_px = config->fx_px;
	lens->fy_px = config->fy_px;
	lens->cx_px = config->cx_px;
	lens->cy_px = config->cy_px;
	lens->width_px = (double)config->width_px;
	lens->height_px = (double)config->height_px;
	lens->row_s = 1e-6 * config->row_us;
	lens->fisheye = config->lens == BB_LENS_FISHEYE;
	lens->k[0] = config->k1;
	lens->k[1] = config->k2;
	lens->k[2] = config->k3;
	lens->k[3] = lens->fisheye ? config->k4 : 0;
	lens->p1 = lens->fisheye ? 0 : config->p1;
	lens->p2 = lens->fisheye ? 0 : config->p2;
	lens->radius_max = trusted_radius(lens);
	const double t = lens->fisheye ? atan(lens->radius_max) : lens->radius_max;
	lens->distorted_max = t * gain(lens, t * t);
	return true;
}

static struct bb_vec3 to_camera(const struct bb_lens *lens, struct bb_vec3 room)
{
	const struct bb_vec3 d = bb_vec3_sub(room, lens->o);

	return (struct bb_vec3){ lens->r[0][0] * d.x + lens->r[0][1] * d.y + lens->r[0][2] * d.z,
				 lens->r[1][0] * d.x + lens->r[1][1] * d.y + lens->r[1][2] * d.z,
				 lens->r[2][0] * d.x + lens->r[2][1] * d.y + lens->r[2][2] * d.z };
}

double bb_lens_row_s(const struct bb_lens *lens, double y_px)
{
	const double middle = (lens->height_px - 1) / 2;

	return fmin(fmax(y_px - middle, -middle), middle) * lens->row_s;
}

double bb_lens_depth(const struct bb_lens *lens, struct bb_vec3 room)
{
	return to_camera(lens, room).z;
}

/* What the distortion makes of a direction; m, when asked for, its derivative: xx, xy, yy of a symmetric matrix. */
static void distort(const struct bb_lens *lens, double x, double y, double out[2], double m[3])
{
	const double s = x * x + y * y;
	double f, g; /* factor of the radial part, and its d f / d r / r */

	if (!lens->fisheye) {
		const double *k = lens->k;
		f = 1 + s * (k[0] + s * (k[1] + s * k[2]));
		g = 2 * k[0] + s * (4 * k[1] + s * 6 * k[2]);
	} else if (s < 1e-16) { /* theta / r = 1 - r^2 / 3 */
		f = 1;
		g = 2 * (lens->k[0] - 1.0 / 3);
	} else {
		const double r = sqrt(s), t = atan(r);
		f = t * gain(lens, t * t) / r;
		g = (slope(lens, t * t) / (1 + s) - f) / s;
	}
	const double p1 = lens->p1, p2 = lens->p2;
	out[0] = x * f + 2 * p1 * x * y + p2 * (s + 2 * x * x);
	out[1] = y * f + p1 * (s + 2 * y * y) + 2 * p2 * x * y;
	if (!m)
		return;
	m[0] = f + g * x * x + 2 * p1 * y + 6 * p2 * x;
	m[1] = g * x * y + 2 * p1 * x + 2 * p2 * y;
	m[2] = f + g * y * y + 6 * p1 * y + 2 * p2 * x;
}

/* x, y = X / Z, Y / Z of a point the lens can be trusted with. */
static bool seen(const struct bb_lens *lens, struct bb_vec3 c, double *x, double *y)
{
	if (!(c.z > NEAR_M))
		return false;
	*x = c.x / c.z;
	*y = c.y / c.z;
	return *x * *x + *y * *y <= lens->radius_max * lens->radius_max;
}

bool bb_lens_project(const struct bb_lens *lens, struct bb_vec3 room, double px[2])
{
	double x, y, d[2];

	if (!seen(lens, to_camera(lens, room), &x, &y))
		return false;
	distort(lens, x, y, d, NULL);
	px[0] = lens->cx_px + lens->fx_px * d[0];
	px[1] = lens->cy_px + lens->fy_px * d[1];
	return true;
}

bool bb_lens_derive(const struct bb_lens *lens, struct bb_vec3 room, double px[2], double jac[2][3])
{
	const struct bb_vec3 c = to_camera(lens, room);
	double x, y, d[2], m[3];

	if (!seen(lens, c, &x, &y))
		return false;
	distort(lens, x, y, d, m);
	px[0] = lens->cx_px + lens->fx_px * d[0];
	px[1] = lens->cy_px + lens->fy_px * d[1];
	const double su = lens->fx_px / c.z, sv = lens->fy_px / c.z;
	const double u[3] = { su * m[0], su * m[1], -su * (m[0] * x + m[1] * y) };
	const double v[3] = { sv * m[1], sv * m[2], -sv * (m[1] * x + m[2] * y) };
	for (int k = 0; k < 3; k++) {
		jac[0][k] = u[0] * lens->r[0][k] + u[1] * lens->r[1][k] + u[2] * lens->r[2][k];
		jac[1][k] = v[0] * lens->r[0][k] + v[1] * lens->r[1][k] + v[2] * lens->r[2][k];
	}
	return true;
}

/* Undistorted radius by Newton within the interval that still brackets the root; a step that is not half of the last one
 * is none of Newton's that converges, and halves the interval instead. */
static double undistort_radius(const struct bb_lens *lens, double rd)
{
	double low = 0, high = lens->fisheye ? atan(lens->radius_max) : lens->radius_max;
	double t = rd < high ? rd : 0.5 * high, last = high;

	for (int i = 0; i < 120; i++) {
		const double error = t * gain(lens, t * t) - rd;
		if (error > 0)
			high = t;
		else
			low = t;
		double next = t - error / slope(lens, t * t);
		if (!(next >= low && next <= high && fabs(next - t) <= 0.5 * last))
			next = 0.5 * (low + high);
		last = fabs(next - t);
		t = next;
		if (last < 1e-15 * (1 + t))
			break;
	}
	return lens->fisheye ? tan(t) : t;
}

/*
 * Newton in two dimensions for lenses with tangential distortion. In the trusted disc the derivative is positive definite,
 * so half a step always comes nearer when a whole one does not; a step out of the disc, or none nearer, ends it.
 */
static bool undistort(const struct bb_lens *lens, const double want[2], double at[2])
{
	double d[2], m[3], error = (double)INFINITY;

	for (int i = 0; i < 40; i++) {
		distort(lens, at[0], at[1], d, m);
		const double ex = want[0] - d[0], ey = want[1] - d[1], det = m[0] * m[2] - m[1] * m[1];
		error = hypot(ex, ey);
		if (error < 1e-14 * (1 + hypot(want[0], want[1])))
			return true;
		const double step[2] = { (m[2] * ex - m[1] * ey) / det, (m[0] * ey - m[1] * ex) / det };
		double next[2] = { at[0], at[1] }, now = (double)INFINITY;
		for (int half = 0; half < 40 && !(now < error); half++) {
			next[0] = at[0] + ldexp(step[0], -half);
			next[1] = at[1] + ldexp(step[1], -half);
			if (!(hypot(next[0], next[1]) <= lens->radius_max))
				continue;
			distort(lens, next[0], next[1], d, NULL);
			now = hypot(want[0] - d[0], want[1] - d[1]);
		}
		if (!(now < error))
			break;
		at[0] = next[0];
		at[1] = next[1];
	}
	return error < 1e-13 * (1 + hypot(want[0], want[1]));
}

/* Largest change of the ray's direction for a change of the distorted place by 1: the larger singular value of the
 * derivative of one by the other, outwards (shortened by 1 + r^2) and around (by its root). */
static double spread(const double m[3], double x, double y)
{
	const double ss = x * x + y * y, r = sqrt(ss), det = m[0] * m[2] - m[1] * m[1];
	const double ux = r > 0 ? x / r : 1, uy = r > 0 ? y / r : 0;
	const double in[2][2] = { { m[2] / det, -m[1] / det }, { -m[1] / det, m[0] / det } };
	const double out = 1 / (1 + ss), around = 1 / sqrt(1 + ss);
	const double a = out * (ux * in[0][0] + uy * in[1][0]), b = out * (ux * in[0][1] + uy * in[1][1]);
	const double c = around * (-uy * in[0][0] + ux * in[1][0]), d = around * (-uy * in[0][1] + ux * in[1][1]);
	const double sum = a * a + b * b + c * c + d * d, area = 2 * (a * d - b * c);

	return sqrt(0.5 * (sum + sqrt(fmax(0, sum * sum - area * area))));
}

bool bb_lens_ray(const struct bb_lens *lens, double x_px, double y_px, struct bb_ray *ray)
{
	const double want[2] = { (x_px - lens->cx_px) / lens->fx_px, (y_px - lens->cy_px) / lens->fy_px };
	const double rd = hypot(want[0], want[1]);
	const bool bent = lens->p1 != 0 || lens->p2 != 0;

	if (!bent && !(rd <= lens->distorted_max))
		return false;
	const double r = undistort_radius(lens, fmin(rd, lens->distorted_max)), f = rd > 1e-12 ? r / rd : 1;
	double at[2] = { want[0] * f, want[1] * f }, d[2], m[3];
	if (bent && !undistort(lens, want, at))
		return false;
	distort(lens, at[0], at[1], d, m);
	const double n = sqrt(1 + at[0] * at[0] + at[1] * at[1]);
	ray->d = (struct bb_vec3){ (lens->r[0][0] * at[0] + lens->r[1][0] * at[1] + lens->r[2][0]) / n,
				   (lens->r[0][1] * at[0] + lens->r[1][1] * at[1] + lens->r[2][1]) / n,
				   (lens->r[0][2] * at[0] + lens->r[1][2] * at[1] + lens->r[2][2]) / n };
	ray->sigma_rad = spread(m, at[0], at[1]) / fmin(lens->fx_px, lens->fy_px);
	return true;
}
