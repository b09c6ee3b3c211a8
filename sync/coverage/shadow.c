/*
 * sync/coverage/shadow.c: the viewer between a marker and a camera. The marker is the origin here: the sight is the
 * segment from 0 to distance * to, the head a sphere about `head`, the torso's axis runs straight down below it.
 */
#include <math.h>

#include "sync/coverage/coverage_private.h"

static double clamp(double v, double low, double high)
{
	return v < low ? low : v > high ? high : v;
}

static bool head_hides(const struct bb_viewer_shape *v, struct bb_vec3 head, const struct bb_coverage_sight *s)
{
	const double t = clamp(bb_vec3_dot(head, s->to), 0, s->distance_m);
	const struct bb_vec3 off = bb_vec3_sub(head, bb_vec3_scale(s->to, t));

	return bb_vec3_dot(off, off) < v->head_radius_m * v->head_radius_m;
}

/* Squared distance of the sight's point at t from the axis x = z = 0, low..high. */
static double from_axis(const struct bb_coverage_sight *s, struct bb_vec3 top, double low, double t)
{
	const double x = s->to.x * t - top.x, z = s->to.z * t - top.z, y = s->to.y * t;
	const double dy = y - clamp(y, low, top.y);

	return x * x + dy * dy + z * z;
}

/*
 * The squared distance is convex and smooth along the sight, and a parabola in each of its three parts (beside the axis,
 * above it, below it): its least is at one of their vertices, held within the sight.
 */
static bool torso_hides(const struct bb_viewer_shape *v, struct bb_vec3 head, const struct bb_coverage_sight *s)
{
	const struct bb_vec3 top = { head.x, head.y - v->torso_top_m, head.z }, u = s->to;
	const double low = head.y - v->torso_bottom_m, rr = v->torso_radius_m * v->torso_radius_m;
	const double flat = u.x * u.x + u.z * u.z, along = u.x * top.x + u.z * top.z;
	const double across = u.x * top.z - u.z * top.x;

	if (across * across >= rr * flat && flat > 0) /* it passes the axis's whole line at more than the radius */
		return false;
	const double at[] = { flat > 0 ? along / flat : 0, along + u.y * top.y, along + u.y * low };
	for (size_t i = 0; i < BB_ARRAY_LEN(at); i++)
		if (from_axis(s, top, low, clamp(at[i], 0, s->distance_m)) < rr)
			return true;
	return false;
}

bool bb_viewer_hides(const struct bb_viewer_shape *v, struct bb_vec3 head, const struct bb_coverage_sight *s)
{
	return head_hides(v, head, s) || torso_hides(v, head, s);
}
