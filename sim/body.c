/*
 * sim/body.c: the viewer's truth: head, wand, markers, and what the viewer's own body hides from a camera. The body is
 * a sphere for the head and an upright capsule for the torso. Metres, room space.
 */
#include "sim/world_impl.h"

#include <math.h>

/* From the eyes' midpoint, in head space: a head's centre is behind and a little below the eyes. */
static const struct bb_vec3 head_centre = { 0, -0.02, 0.09 };
#define HEAD_RADIUS_M 0.095
#define HEAD_RADIUS_LEAST_M 0.05
#define MARKER_CLEAR_M 0.005 /* glasses sit on the head, so their markers stick out of it */
#define TORSO_TOP_M 0.32     /* ends of the capsule's axis below the head's centre */
#define TORSO_BOTTOM_M 0.95
#define TORSO_RADIUS_M 0.16

static const struct bb_vec3 loose = { 0.6, 0.8, 0 }; /* where a marker that came off hangs, in head space */

/* However the markers were measured, the head must not swallow those of the glasses. */
static double head_radius_m(const struct bb_room *room)
{
	double radius_m = HEAD_RADIUS_M;

	if (!room->n_bodies)
		return radius_m;
	const struct bb_body *glasses = &room->bodies[0];
	const struct bb_vec3 centre = bb_vec3_add(glasses->eye_centre, head_centre);
	for (size_t i = 0; i < glasses->n_markers; i++) {
		const double clear = bb_vec3_norm(bb_vec3_sub(glasses->marker[i], centre)) - MARKER_CLEAR_M;
		if (clear < radius_m)
			radius_m = clear;
	}
	return radius_m < HEAD_RADIUS_LEAST_M ? HEAD_RADIUS_LEAST_M : radius_m;
}

void sim_body_init(struct sim_world *w)
{
	w->head_radius_m = head_radius_m(w->room);
}

struct sim_viewer_shape sim_viewer_shape(const struct bb_room *room)
{
	return (struct sim_viewer_shape){ head_centre, head_radius_m(room), TORSO_TOP_M, TORSO_BOTTOM_M,
		                          TORSO_RADIUS_M };
}

void sim_world_set_head_fn(struct sim_world *w, struct bb_pose (*head)(void *ctx, int64_t t_ns), void *ctx)
{
	w->head_fn = head;
	w->head_ctx = ctx;
	w->memo.valid = false;
}

struct bb_pose sim_world_head(const struct sim_world *w, int64_t at_ns)
{
	struct sim_world *own = (struct sim_world *)w; /* the memo does not change what is answered */
	const int64_t t_ns = at_ns - w->scene_start_ns;

	if (w->memo.valid && w->memo.at_ns == at_ns)
		return w->memo.pose;
	own->memo.pose = w->head_fn     ? w->head_fn(w->head_ctx, t_ns)
	                 : w->head_path ? bb_path_at(w->head_path, t_ns)
	                                : (struct bb_pose){ w->room->neutral, BB_QUAT_IDENTITY };
	own->memo.at_ns = at_ns;
	own->memo.valid = true;
	return w->memo.pose;
}

static bool present(const struct sim_world *w, size_t body)
{
	return !w->viewer.left && (body == 0 || (body == 1 && w->wand_path));
}

struct bb_pose sim_world_body(const struct sim_world *w, size_t body, int64_t at_ns)
{
	if (body >= w->room->n_bodies)
		return BB_POSE_IDENTITY;
	if (body == 1 && w->wand_path)
		return bb_path_at(w->wand_path, at_ns - w->scene_start_ns);
	const struct bb_pose head = sim_world_head(w, at_ns);
	const struct bb_vec3 eye = bb_quat_rotate(head.q, w->room->bodies[body].eye_centre);
	return (struct bb_pose){ bb_vec3_sub(head.p, eye), head.q };
}

size_t sim_world_markers(const struct sim_world *w, int64_t at_ns, struct bb_vec3 *out, size_t cap)
{
	size_t n = 0;

	for (size_t b = 0; b < w->room->n_bodies; b++) {
		if (!present(w, b))
			continue;
		const struct bb_body *body = &w->room->bodies[b];
		const struct bb_pose pose = sim_world_body(w, b, at_ns);
		for (size_t i = 0; i < body->n_markers && n < cap; i++) {
			if (b == 1 && w->viewer.gripped[i])
				continue;
			const double off_m = b ? 0 : (double)w->viewer.loose_nm[i] * 1e-9;
			const struct bb_vec3 at = bb_vec3_add(body->marker[i], bb_vec3_scale(loose, off_m));
			out[n++] = bb_pose_apply(&pose, at);
		}
	}
	return n;
}

static double clamp01(double t)
{
	return t < 0 ? 0 : t > 1 ? 1 : t;
}

/* Distance of a point from the segment a-b. */
static double point_segment(struct bb_vec3 p, struct bb_vec3 a, struct bb_vec3 b)
{
	const struct bb_vec3 d = bb_vec3_sub(b, a);
	const double dd = bb_vec3_dot(d, d);
	const double t = dd > 0 ? clamp01(bb_vec3_dot(bb_vec3_sub(p, a), d) / dd) : 0;

	return bb_vec3_norm(bb_vec3_sub(p, bb_vec3_lerp(a, b, t)));
}

/* Distance between the segments a-b and c-d: inside both lines' common perpendicular, or at one of the four ends. */
static double segment_segment(struct bb_vec3 a, struct bb_vec3 b, struct bb_vec3 c, struct bb_vec3 d)
{
	const struct bb_vec3 u = bb_vec3_sub(b, a), v = bb_vec3_sub(d, c), r = bb_vec3_sub(a, c);
	const double uu = bb_vec3_dot(u, u), vv = bb_vec3_dot(v, v), uv = bb_vec3_dot(u, v);
	const double det = uu * vv - uv * uv;
	double best = fmin(fmin(point_segment(a, c, d), point_segment(b, c, d)),
	                   fmin(point_segment(c, a, b), point_segment(d, a, b)));

	if (det > 1e-12 * uu * vv) {
		const double s = (uv * bb_vec3_dot(v, r) - vv * bb_vec3_dot(u, r)) / det;
		const double t = (uu * bb_vec3_dot(v, r) - uv * bb_vec3_dot(u, r)) / det;
		if (s >= 0 && s <= 1 && t >= 0 && t <= 1)
			best = fmin(best, bb_vec3_norm(bb_vec3_sub(bb_vec3_lerp(a, b, s), bb_vec3_lerp(c, d, t))));
	}
	return best;
}

/* The part of a wall that swings, hinged at its left edge. */
static struct bb_corners door_leaf(const struct bb_wall *wall, double deg)
{
	const double u0 = (double)wall->door_column / (double)wall->columns, v0 = (double)wall->door_row / (double)wall->rows;
	const double u1 = u0 + (double)wall->door_columns / (double)wall->columns;
	const double v1 = v0 + (double)wall->door_rows / (double)wall->rows;
	const struct bb_vec3 hinge = bb_corners_at(&wall->corners, u0, v0), top = bb_corners_at(&wall->corners, u0, v1);
	const struct bb_vec3 across = bb_vec3_sub(bb_corners_at(&wall->corners, u1, v0), hinge);
	const struct bb_vec3 up = bb_vec3_unit(bb_vec3_sub(top, hinge), (struct bb_vec3){ 0, 1, 0 });
	const struct bb_quat turn = bb_quat_axis_angle(up, -deg * 3.14159265358979323846 / 180); /* right x up is into the room */

	return (struct bb_corners){ hinge, bb_vec3_add(hinge, bb_quat_rotate(turn, across)), top };
}

/* Does the way from a to b go through a rectangle? */
static bool crosses(const struct bb_corners *c, struct bb_vec3 a, struct bb_vec3 b)
{
	const struct bb_vec3 right = bb_vec3_sub(c->lower_right, c->lower_left), up = bb_vec3_sub(c->upper_left, c->lower_left);
	const struct bb_vec3 normal = bb_vec3_cross(right, up);
	const double da = bb_vec3_dot(bb_vec3_sub(a, c->lower_left), normal), db = bb_vec3_dot(bb_vec3_sub(b, c->lower_left), normal);

	if (!(da * db < 0))
		return false;
	const struct bb_vec3 at = bb_vec3_sub(bb_vec3_lerp(a, b, da / (da - db)), c->lower_left);
	const double u = bb_vec3_dot(at, right) / bb_vec3_dot(right, right), v = bb_vec3_dot(at, up) / bb_vec3_dot(up, up);
	return u >= 0 && u <= 1 && v >= 0 && v <= 1;
}

static bool door_hides(const struct sim_world *w, struct bb_vec3 a, struct bb_vec3 b)
{
	for (size_t i = 0; w->viewer.door_mdeg && i < w->room->n_walls; i++) {
		if (!w->room->walls[i].door_columns)
			continue;
		const struct bb_corners leaf = door_leaf(&w->room->walls[i], (double)w->viewer.door_mdeg * 1e-3);
		if (crosses(&leaf, a, b))
			return true;
	}
	return false;
}

bool sim_world_visible(const struct sim_world *w, struct bb_vec3 camera, struct bb_vec3 marker, int64_t at_ns)
{
	if (door_hides(w, camera, marker))
		return false;
	if (w->viewer.left)
		return true;
	const struct bb_pose head = sim_world_head(w, at_ns);
	const struct bb_vec3 centre = bb_pose_apply(&head, head_centre);
	const struct bb_vec3 top = { centre.x, centre.y - TORSO_TOP_M, centre.z };
	const struct bb_vec3 bottom = { centre.x, centre.y - TORSO_BOTTOM_M, centre.z };

	return point_segment(centre, camera, marker) >= w->head_radius_m &&
	       segment_segment(camera, marker, top, bottom) >= TORSO_RADIUS_M;
}
