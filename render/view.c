/*
 * render/view.c: three corners and an eye to a view and a projection. Pure functions, any thread; metres.
 *
 * Everything is taken from the lower left corner of the wall rather than from the room's origin: the corners then have
 * small exact coordinates, and the only long differences (eye against corner) are formed once.
 */
#include "render/view.h"

#include <math.h>

#define LEAST_EDGE_M 1e-6
#define MOST_M 1e6 /* beyond this a coordinate is as good as not finite: its square must stay far from overflow */

struct wall_frame { /* the wall's own plane: x along right, y along up, from the lower left corner */
	double width_m, height_m;
	double skew_m; /* how far the upper left corner lies to the right: 0 for a rectangle */
	double eye_x_m, eye_y_m, eye_distance_m;
};

static bool usable(struct bb_vec3 p)
{
	return fabs(p.x) < MOST_M && fabs(p.y) < MOST_M && fabs(p.z) < MOST_M;
}

static bool spans_area(const struct bb_corners *c)
{
	if (!usable(c->lower_left) || !usable(c->lower_right) || !usable(c->upper_left))
		return false;
	const struct bb_vec3 across = bb_vec3_sub(c->lower_right, c->lower_left);
	const struct bb_vec3 rise = bb_vec3_sub(c->upper_left, c->lower_left);
	const double width_m = bb_vec3_norm(across);

	return width_m > LEAST_EDGE_M && bb_vec3_norm(bb_vec3_cross(across, rise)) > LEAST_EDGE_M * width_m;
}

static struct bb_corners stand_in(const struct bb_corners *c)
{
	const struct bb_vec3 at = usable(c->lower_left) ? c->lower_left : (struct bb_vec3){ 0, 0, 0 };

	return (struct bb_corners){ at, { at.x + 1, at.y, at.z }, { at.x, at.y + 1, at.z } };
}

static struct wall_frame wall_frame_of(const struct bb_view *v)
{
	const struct bb_vec3 across = bb_vec3_sub(v->corners.lower_right, v->corners.lower_left);
	const struct bb_vec3 rise = bb_vec3_sub(v->corners.upper_left, v->corners.lower_left);
	const struct bb_vec3 eye = bb_vec3_sub(v->eye, v->corners.lower_left);

	return (struct wall_frame){ bb_vec3_dot(across, v->right), bb_vec3_dot(rise, v->up),
				    bb_vec3_dot(rise, v->right),   bb_vec3_dot(eye, v->right),
				    bb_vec3_dot(eye, v->up),       bb_vec3_dot(eye, v->normal) };
}

static void set_axes(struct bb_view *v)
{
	const struct bb_vec3 across = bb_vec3_sub(v->corners.lower_right, v->corners.lower_left);
	const struct bb_vec3 rise = bb_vec3_sub(v->corners.upper_left, v->corners.lower_left);

	v->right = bb_vec3_unit(across, (struct bb_vec3){ 1, 0, 0 });
	v->normal = bb_vec3_unit(bb_vec3_cross(v->right, rise), (struct bb_vec3){ 0, 0, 1 });
	v->up = bb_vec3_cross(v->normal, v->right);
}

static void set_eye(struct bb_view *v, struct bb_vec3 eye, struct bb_vec3 fallback)
{
	const struct bb_corners *c = &v->corners;
	const struct bb_vec3 middle = bb_vec3_lerp(c->lower_right, c->upper_left, 0.5);

	if (!usable(eye)) {
		v->flags |= BB_VIEW_HELD;
		eye = usable(fallback) ? fallback : bb_vec3_add(middle, v->normal);
	}
	const double distance_m = bb_vec3_dot(bb_vec3_sub(eye, c->lower_left), v->normal);

	/* A nanometre of slack, so that an eye put at 5 cm is told of whichever way its position was rounded. */
	if (distance_m < BB_VIEW_LEAST_DISTANCE_M + 1e-9) {
		v->flags |= BB_VIEW_CLAMPED;
		eye = bb_vec3_add(eye, bb_vec3_scale(v->normal, BB_VIEW_LEAST_DISTANCE_M - distance_m));
	}
	v->eye = eye;
}

static struct bb_mat4 room_to_eye(const struct bb_view *v)
{
	const struct bb_vec3 x = v->right, y = v->up, z = v->normal, e = v->eye;

	return (struct bb_mat4){ { x.x, y.x, z.x, 0, x.y, y.y, z.y, 0, x.z, y.z, z.z, 0, -bb_vec3_dot(x, e),
				   -bb_vec3_dot(y, e), -bb_vec3_dot(z, e), 1 } };
}

/* The frustum through the wall's edges; near cancels out of x and y, so the wall's own distance takes its place. A wall
 * that is not quite a rectangle keeps its corners on +-1: x leans by the skew. */
static struct bb_mat4 eye_to_clip(const struct bb_view *v)
{
	const struct wall_frame f = wall_frame_of(v);
	const double lean = f.skew_m / f.height_m, d = f.eye_distance_m;
	const double depth_m = v->far_m - v->near_m;
	struct bb_mat4 m = { { 0 } };

	m.m[0] = 2 * d / f.width_m;
	m.m[4] = -2 * d * lean / f.width_m;
	m.m[8] = 1 - 2 * (f.eye_x_m - lean * f.eye_y_m) / f.width_m;
	m.m[5] = 2 * d / f.height_m;
	m.m[9] = 1 - 2 * f.eye_y_m / f.height_m;
	m.m[10] = -(v->far_m + v->near_m) / depth_m;
	m.m[14] = -2 * v->far_m * v->near_m / depth_m;
	m.m[11] = -1;
	return m;
}

struct bb_view bb_view_make(const struct bb_corners *corners, struct bb_vec3 eye, struct bb_vec3 fallback,
			    double near_m, double far_m)
{
	struct bb_view v = { .corners = *corners };

	if (!spans_area(corners)) {
		v.corners = stand_in(corners);
		v.flags |= BB_VIEW_DEGENERATE;
	}
	v.near_m = near_m > 0 && near_m < MOST_M ? near_m : 0.01;
	v.far_m = far_m > v.near_m && far_m < MOST_M ? far_m : v.near_m * 1e4;
	set_axes(&v);
	set_eye(&v, eye, fallback);
	v.view = room_to_eye(&v);
	v.projection = eye_to_clip(&v);
	return v;
}

void bb_view_eyes(const struct bb_pose *eyes_midpoint, double separation_m, struct bb_vec3 *left, struct bb_vec3 *right)
{
	const struct bb_vec3 half = bb_quat_rotate(eyes_midpoint->q, (struct bb_vec3){ separation_m / 2, 0, 0 });

	*left = bb_vec3_sub(eyes_midpoint->p, half);
	*right = bb_vec3_add(eyes_midpoint->p, half);
}

/* Where the line from the eye through p meets the wall, in shares of its edges. No matrix: a product with the room's
 * origin in it would lose the digits that an eye 5 cm from a 10 m wall needs. */
void bb_view_project(const struct bb_view *v, struct bb_vec3 p, double ndc[3], double *w)
{
	const struct wall_frame f = wall_frame_of(v);
	const struct bb_vec3 q = bb_vec3_sub(p, v->corners.lower_left);
	const double x = bb_vec3_dot(q, v->right), y = bb_vec3_dot(q, v->up), height = bb_vec3_dot(q, v->normal);
	const double depth_m = v->far_m - v->near_m;

	*w = f.eye_distance_m - height;
	if (fabs(*w) < 1e-12) {
		*w = ndc[0] = ndc[1] = ndc[2] = 0;
		return;
	}
	const double hit_x = (x * f.eye_distance_m - f.eye_x_m * height) / *w;
	const double share_y = (y * f.eye_distance_m - f.eye_y_m * height) / *w / f.height_m;

	ndc[0] = 2 * (hit_x - f.skew_m * share_y) / f.width_m - 1;
	ndc[1] = 2 * share_y - 1;
	ndc[2] = (v->far_m + v->near_m) / depth_m - 2 * v->far_m * v->near_m / (depth_m * *w);
}

void bb_view_project_float(const struct bb_view *v, struct bb_vec3 p, float ndc[3], float *w)
{
	const struct bb_vec3 q = bb_vec3_sub(p, v->eye);
	const float at[4] = { (float)bb_vec3_dot(q, v->right), (float)bb_vec3_dot(q, v->up),
			      (float)bb_vec3_dot(q, v->normal), 1.0F };
	float clip[4];

	for (int r = 0; r < 4; r++) {
		clip[r] = 0;
		for (int c = 0; c < 4; c++)
			clip[r] += (float)v->projection.m[c * 4 + r] * at[c];
	}
	*w = fabsf(clip[3]) < 1e-12F ? 0 : clip[3];
	for (int i = 0; i < 3; i++)
		ndc[i] = *w != 0 ? clip[i] / *w : 0; /* 0 is exact here: set a line above */
}
