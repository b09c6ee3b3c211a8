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

bool sim_world_visible(const struct sim_world *w, struct bb_vec3 camera, struct bb_vec3 marker, int64_t at_ns)
{
	if (w->viewer.left)
		return true;
	const struct bb_pose head = sim_world_head(w, at_ns);
	const struct bb_vec3 centre = bb_pose_apply(&head, head_centre);
	const struct bb_vec3 top = { centre.x, centre.y - TORSO_TOP_M, centre.z };
	const struct bb_vec3 bottom = { centre.x, centre.y - TORSO_BOTTOM_M, centre.z };

	return point_segment(centre, camera, marker) >= w->head_radius_m &&
	       segment_segment(camera, marker, top, bottom) >= TORSO_RADIUS_M;
}
