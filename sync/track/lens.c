#include "sync/track/lens.h"

#include <math.h>

#define NEAR_M 0.02     /* nothing is tracked nearer than this to a lens */
#define RADIUS_CAP 20.0 /* 87 degrees off the axis */

static double distort(const struct bb_lens *lens, double r)
{
	return r * (1 + r * r * (lens->k1 + lens->k2 * r * r));
}

static double distort_slope(const struct bb_lens *lens, double r)
{
	return 1 + r * r * (3 * lens->k1 + 5 * lens->k2 * r * r);
}

/* The first radius at which d r_d / d r reaches 0: the smaller positive root of 1 + 3 k1 s + 5 k2 s^2, s = r^2. */
static double growing_radius(double k1, double k2)
{
	const double a = 5 * k2, b = 3 * k1;
	const double disc = b * b - 4 * a;

	if (disc < 0)
		return RADIUS_CAP;
	/* c / q form: no cancellation, and a = 0 needs no case of its own. */
	const double q = -0.5 * (b + (b >= 0 ? 1 : -1) * sqrt(disc));
	const double s1 = q != 0 ? 1 / q : -1, s2 = a != 0 ? q / a : -1;
	double s = RADIUS_CAP * RADIUS_CAP;
	if (s1 > 0 && s1 < s)
		s = s1;
	if (s2 > 0 && s2 < s)
		s = s2;
	return sqrt(s);
}

static bool config_is_finite(const struct bb_camera_config *c)
{
	const double v[] = { c->pose.p.x, c->pose.p.y, c->pose.p.z, c->pose.q.x, c->pose.q.y, c->pose.q.z, c->pose.q.w,
			     c->fx_px,    c->fy_px,    c->cx_px,    c->cy_px,    c->k1,       c->k2 };

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
	lens->k1 = config->k1;
	lens->k2 = config->k2;
	lens->radius_max = 0.999 * growing_radius(config->k1, config->k2);
	lens->distorted_max = distort(lens, lens->radius_max);
	return true;
}

static struct bb_vec3 to_camera(const struct bb_lens *lens, struct bb_vec3 room)
{
	const struct bb_vec3 d = bb_vec3_sub(room, lens->o);

	return (struct bb_vec3){ lens->r[0][0] * d.x + lens->r[0][1] * d.y + lens->r[0][2] * d.z,
				 lens->r[1][0] * d.x + lens->r[1][1] * d.y + lens->r[1][2] * d.z,
				 lens->r[2][0] * d.x + lens->r[2][1] * d.y + lens->r[2][2] * d.z };
}

double bb_lens_depth(const struct bb_lens *lens, struct bb_vec3 room)
{
	return to_camera(lens, room).z;
}

bool bb_lens_project(const struct bb_lens *lens, struct bb_vec3 room, double px[2])
{
	const struct bb_vec3 c = to_camera(lens, room);

	if (!(c.z > NEAR_M))
		return false;
	const double x = c.x / c.z, y = c.y / c.z, s = x * x + y * y;
	if (s > lens->radius_max * lens->radius_max)
		return false;
	const double f = 1 + s * (lens->k1 + lens->k2 * s);
	px[0] = lens->cx_px + lens->fx_px * x * f;
	px[1] = lens->cy_px + lens->fy_px * y * f;
	return true;
}

bool bb_lens_derive(const struct bb_lens *lens, struct bb_vec3 room, double px[2], double jac[2][3])
{
	const struct bb_vec3 c = to_camera(lens, room);

	if (!(c.z > NEAR_M))
		return false;
	const double iz = 1 / c.z, x = c.x * iz, y = c.y * iz, s = x * x + y * y;
	if (s > lens->radius_max * lens->radius_max)
		return false;
	const double f = 1 + s * (lens->k1 + lens->k2 * s);
	const double g = 2 * (lens->k1 + 2 * lens->k2 * s); /* d f / d s, times 2 for d s / d x = 2 x */
	const double xx = f + g * x * x, xy = g * x * y, yy = f + g * y * y;
	px[0] = lens->cx_px + lens->fx_px * x * f;
	px[1] = lens->cy_px + lens->fy_px * y * f;
	const double u[3] = { lens->fx_px * iz * xx, lens->fx_px * iz * xy, -lens->fx_px * iz * (xx * x + xy * y) };
	const double v[3] = { lens->fy_px * iz * xy, lens->fy_px * iz * yy, -lens->fy_px * iz * (xy * x + yy * y) };
	for (int k = 0; k < 3; k++) {
		jac[0][k] = u[0] * lens->r[0][k] + u[1] * lens->r[1][k] + u[2] * lens->r[2][k];
		jac[1][k] = v[0] * lens->r[0][k] + v[1] * lens->r[1][k] + v[2] * lens->r[2][k];
	}
	return true;
}

/* Undistorted radius by Newton, kept inside the interval that still brackets the root. */
static double undistort(const struct bb_lens *lens, double rd)
{
	double low = 0, high = lens->radius_max, r = rd < high ? rd : 0.5 * high;

	for (int i = 0; i < 60; i++) {
		const double error = distort(lens, r) - rd;
		if (error > 0)
			high = r;
		else
			low = r;
		double next = r - error / distort_slope(lens, r);
		if (!(next >= low && next <= high))
			next = 0.5 * (low + high);
		if (fabs(next - r) < 1e-15 * (1 + r))
			return next;
		r = next;
	}
	return r;
}

bool bb_lens_ray(const struct bb_lens *lens, double x_px, double y_px, struct bb_ray *ray)
{
	const double xd = (x_px - lens->cx_px) / lens->fx_px, yd = (y_px - lens->cy_px) / lens->fy_px;
	const double rd = sqrt(xd * xd + yd * yd);

	if (!(rd <= lens->distorted_max))
		return false;
	const double r = undistort(lens, rd);
	const double f = rd > 1e-12 ? r / rd : 1;
	const double x = xd * f, y = yd * f, n = sqrt(1 + r * r);
	ray->d = (struct bb_vec3){ (lens->r[0][0] * x + lens->r[1][0] * y + lens->r[2][0]) / n,
				   (lens->r[0][1] * x + lens->r[1][1] * y + lens->r[2][1]) / n,
				   (lens->r[0][2] * x + lens->r[1][2] * y + lens->r[2][2]) / n };
	const double radial = 1 / ((1 + r * r) * distort_slope(lens, r)), tangential = f / n;
	ray->sigma_rad = fmax(radial, tangential) / fmin(lens->fx_px, lens->fy_px);
	return true;
}
