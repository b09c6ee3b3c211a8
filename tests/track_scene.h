/*
 * tests/track_scene.h: a room of 2.4 m with cameras on its top edges, glasses, a wand and a walker, made for the
 * tracker's tests only. Its projector is written apart from sync/track/lens.c, so that one mistake cannot cancel
 * itself. Metres.
 */
#ifndef BB_TESTS_TRACK_SCENE_H
#define BB_TESTS_TRACK_SCENE_H

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "hal/room.h"
#include "sync/track/tracker.h"

#define PI 3.14159265358979323846
#define SCENE_CAMERAS_MAX 24

struct scene_rng {
	uint64_t s;
	bool spare;
	double value;
};

static inline uint64_t scene_u64(struct scene_rng *r)
{
	uint64_t z = r->s += 0x9e3779b97f4a7c15u;

	z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
	z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
	return z ^ (z >> 31);
}

static inline double scene_uniform(struct scene_rng *r, double low, double high)
{
	return low + (high - low) * (double)(scene_u64(r) >> 11) * 0x1p-53;
}

static inline double scene_normal(struct scene_rng *r)
{
	if (r->spare) {
		r->spare = false;
		return r->value;
	}
	const double radius = sqrt(-2 * log(scene_uniform(r, 1e-18, 1))), turn = scene_uniform(r, 0, 2 * PI);
	r->spare = true;
	r->value = radius * sin(turn);
	return radius * cos(turn);
}

static inline struct bb_quat scene_any_turn(struct scene_rng *r)
{
	return bb_quat_unit((struct bb_quat){ scene_normal(r), scene_normal(r), scene_normal(r), scene_normal(r) });
}

struct scene {
	struct bb_camera_config cameras[SCENE_CAMERAS_MAX];
	size_t n_cameras;
	struct bb_body bodies[2];
	size_t n_bodies;
	struct bb_pose pose[2]; /* truth of the moment */
	double noise_px;
	bool occlude;               /* by the wearer's head and torso */
	unsigned hidden_markers[2]; /* bit per marker: covered for every camera */
	unsigned dark_cameras;      /* bit per camera */
	bool patchy;                /* every camera misses a quarter of the markers, each its own */
	double merge_px;            /* images nearer than this are one blob half way between */
	size_t strays;              /* per frame */
	struct scene_rng rng;
};

static inline struct bb_camera_config scene_camera(struct bb_vec3 at, struct bb_vec3 target, int64_t width,
						   int64_t height, double fov_deg, double k1, double k2)
{
	struct bb_camera_config c = { .width_px = width, .height_px = height, .fov_deg = fov_deg, .k1 = k1, .k2 = k2 };
	/* look_at gives -Z forward, +Y up; a camera has +Z forward, +Y down: half a turn about x. */
	const struct bb_pose look = bb_pose_look_at(at, target, (struct bb_vec3){ 0, 1, 0 });

	c.pose.p = at;
	c.pose.q = bb_quat_unit(bb_quat_mul(look.q, (struct bb_quat){ 1, 0, 0, 0 }));
	c.fx_px = c.fy_px = (double)width / 2 / tan(fov_deg * PI / 360);
	c.cx_px = ((double)width - 1) / 2;
	c.cy_px = ((double)height - 1) / 2;
	return c;
}

static const struct bb_body scene_glasses = {
	.id = "glasses",
	.n_markers = 5,
	.eye_centre = { 0.0705, 0.0, 0.01 },
	.marker = { { 0, 0, 0 },
		    { 0.141, 0.004, -0.008 },
		    { 0.070, 0.032, 0.005 },
		    { 0.018, 0.025, -0.030 },
		    { 0.120, 0.027, -0.034 } },
};
static const struct bb_body scene_wand = {
	.id = "wand",
	.n_markers = 4,
	.marker = { { 0, 0, 0 }, { 0.055, 0.010, 0.012 }, { -0.030, 0.048, 0.020 }, { 0.012, -0.020, 0.095 } },
};

/* n cameras around the top edges of the room: corners first, then along the edges. */
static inline void scene_room(struct scene *s, size_t n, double noise_px)
{
	static const double spot[24][2] = { { -1, -1 },  { 1, -1 },    { 1, 1 },    { -1, 1 },   { 0, -1 },
					    { 1, 0 },    { 0, 1 },     { -1, 0 },   { -.5, -1 }, { .5, -1 },
					    { 1, -.5 },  { 1, .5 },    { .5, 1 },   { -.5, 1 },  { -1, .5 },
					    { -1, -.5 }, { -.25, -1 }, { .25, -1 }, { 1, -.25 }, { 1, .25 },
					    { .25, 1 },  { -.25, 1 },  { -1, .25 }, { -1, -.25 } };

	memset(s, 0, sizeof(*s));
	s->n_cameras = n;
	for (size_t i = 0; i < n; i++) {
		const double fov = 75 + 15.0 * (double)(i % 4) / 3;
		s->cameras[i] = scene_camera((struct bb_vec3){ 1.15 * spot[i][0], 2.35, 1.15 * spot[i][1] },
					     (struct bb_vec3){ 0.1 * spot[i][1], 1.45, 0.1 * spot[i][0] }, 640, 480,
					     fov, -0.12, 0.015);
		snprintf(s->cameras[i].id, sizeof(s->cameras[i].id), "c%zu", i);
	}
	s->bodies[0] = scene_glasses;
	s->bodies[1] = scene_wand;
	s->n_bodies = 1;
	s->pose[0] = s->pose[1] = BB_POSE_IDENTITY;
	s->noise_px = noise_px;
	s->rng.s = 1;
}

static inline struct bb_tracker_config scene_config(const struct scene *s)
{
	return (struct bb_tracker_config){ .cameras = s->cameras,
					   .n_cameras = s->n_cameras,
					   .bodies = s->bodies,
					   .n_bodies = s->n_bodies,
					   .blob_sigma_px = s->noise_px > 0 ? s->noise_px : 0.002,
					   .group_ns = 1000000,
					   .freeze_ns = 100000000,
					   .room_min = { -1.2, 0, -1.2 },
					   .room_max = { 1.2, 2.4, 1.2 },
					   .neutral = { { 0, 1.6, 0 }, BB_QUAT_IDENTITY } };
}

static inline struct bb_vec3 scene_centroid(const struct bb_body *b, const struct bb_pose *pose)
{
	struct bb_vec3 sum = { 0, 0, 0 };

	for (size_t i = 0; i < b->n_markers; i++)
		sum = bb_vec3_add(sum, bb_pose_apply(pose, b->marker[i]));
	return bb_vec3_scale(sum, 1 / (double)b->n_markers);
}

/* Makes body 0 one whose markers 0, 1, 2 are isosceles, their own twin half a turn about the bisector: returns the pose in
 * which these three look the same as at `pose`. */
static inline struct bb_pose scene_twin(struct scene *s, const struct bb_pose *pose)
{
	const struct bb_vec3 *m = s->bodies[0].marker;

	s->bodies[0].marker[2] = (struct bb_vec3){ 0.0705, 0.062, 0.026 };
	const struct bb_vec3 mid = bb_vec3_lerp(m[0], m[1], 0.5);
	const struct bb_quat half = bb_quat_axis_angle(bb_vec3_sub(m[2], mid), PI);
	const struct bb_pose turn = { bb_vec3_sub(mid, bb_quat_rotate(half, mid)), half };

	return bb_pose_mul(pose, &turn);
}

static inline bool scene_hits_sphere(struct bb_vec3 a, struct bb_vec3 b, struct bb_vec3 centre, double radius)
{
	const struct bb_vec3 d = bb_vec3_sub(b, a), v = bb_vec3_sub(centre, a);
	const double t = fmin(1, fmax(0, bb_vec3_dot(v, d) / bb_vec3_dot(d, d)));

	return bb_vec3_norm(bb_vec3_sub(v, bb_vec3_scale(d, t))) < radius;
}

/* The wearer: a head behind the glasses, shoulders and chest below it. */
static inline bool scene_blocked(const struct scene *s, struct bb_vec3 camera, struct bb_vec3 marker)
{
	const struct bb_vec3 head = bb_pose_apply(&s->pose[0], (struct bb_vec3){ 0.0705, 0.01, 0.125 });

	if (!s->occlude)
		return false;
	if (scene_hits_sphere(camera, marker, head, 0.095))
		return true;
	for (int i = 0; i < 3; i++) {
		const struct bb_vec3 chest = { head.x, head.y - 0.32 - 0.2 * i, head.z };
		if (scene_hits_sphere(camera, marker, chest, 0.2))
			return true;
	}
	return false;
}

/* Exact pixel of a room point: pinhole, then r (1 + k1 r^2 + k2 r^4). */
static inline bool scene_pixel(const struct bb_camera_config *c, struct bb_vec3 p, double px[2])
{
	const struct bb_vec3 q = bb_pose_inverse_apply(&c->pose, p);

	if (q.z < 0.05)
		return false;
	const double r = hypot(q.x, q.y) / q.z, along = atan2(q.y, q.x);
	const double rd = r * (1 + c->k1 * pow(r, 2) + c->k2 * pow(r, 4));
	px[0] = c->cx_px + c->fx_px * rd * cos(along);
	px[1] = c->cy_px + c->fy_px * rd * sin(along);
	return px[0] > 0 && px[1] > 0 && px[0] < (double)c->width_px - 1 && px[1] < (double)c->height_px - 1;
}

static inline size_t scene_merge(const struct scene *s, struct bb_blob *blobs, size_t n)
{
	for (size_t i = 0; i < n; i++)
		for (size_t k = i + 1; k < n; k++) {
			if (hypot((double)(blobs[i].x_px - blobs[k].x_px), (double)(blobs[i].y_px - blobs[k].y_px)) >=
			    s->merge_px)
				continue;
			blobs[i].x_px = (blobs[i].x_px + blobs[k].x_px) / 2;
			blobs[i].y_px = (blobs[i].y_px + blobs[k].y_px) / 2;
			blobs[k] = blobs[--n];
			k = i;
		}
	return n;
}

/* One camera's frame in a shuffled order; returns how many blobs; visible gets a bit per marker of each body. */
static inline size_t scene_frame(struct scene *s, size_t camera, struct bb_blob *blobs, unsigned visible[2])
{
	const struct bb_camera_config *c = &s->cameras[camera];
	size_t n = 0;

	visible[0] = visible[1] = 0;
	for (size_t b = 0; b < s->n_bodies && !(s->dark_cameras >> camera & 1); b++)
		for (size_t m = 0; m < s->bodies[b].n_markers; m++) {
			const struct bb_vec3 p = bb_pose_apply(&s->pose[b], s->bodies[b].marker[m]);
			double px[2];
			if ((s->hidden_markers[b] >> m & 1) || !scene_pixel(c, p, px) || scene_blocked(s, c->pose.p, p))
				continue;
			if (s->patchy && scene_u64(&s->rng) % 4 == 0)
				continue;
			visible[b] |= 1u << m;
			blobs[n++] = (struct bb_blob){ (float)(px[0] + s->noise_px * scene_normal(&s->rng)),
						       (float)(px[1] + s->noise_px * scene_normal(&s->rng)), 6 };
		}
	n = scene_merge(s, blobs, n);
	for (size_t i = 0; i < s->strays && n < BB_CAMERA_BLOBS_MAX; i++)
		blobs[n++] = (struct bb_blob){ (float)scene_uniform(&s->rng, 0, (double)c->width_px),
					       (float)scene_uniform(&s->rng, 0, (double)c->height_px), 6 };
	for (size_t i = n; i > 1; i--) {
		const size_t k = scene_u64(&s->rng) % i;
		const struct bb_blob keep = blobs[i - 1];
		blobs[i - 1] = blobs[k];
		blobs[k] = keep;
	}
	return n;
}

/* Frames of all cameras at one time; returns how many cameras see at least 3 markers of body 0. */
static inline size_t scene_expose(struct scene *s, struct bb_tracker *tr, int64_t at_ns)
{
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	size_t seeing = 0;

	for (size_t i = 0; i < s->n_cameras; i++) {
		unsigned visible[2];
		const size_t n = scene_frame(s, i, blobs, visible);
		bb_tracker_frame(tr, i, at_ns, blobs, n);
		seeing += __builtin_popcount(visible[0]) >= 3;
	}
	return seeing;
}

/* A walk: slow loops through the room, turns of the head, a crouch, and sway of 1 to 3 Hz. rms 0.45 m/s and 45 deg/s.
 */
static inline struct bb_pose scene_walk(double t)
{
	const double w = 2 * PI, g = 0.90, h = 0.91;
	const double x = 0.55 * sin(w * 0.13 * t) + 0.014 * sin(w * 1.1 * t + 1), z = 0.45 * sin(w * 0.17 * t + 0.5);
	const double y = 1.55 - 0.35 * pow(sin(w * 0.045 * t), 8) + 0.013 * sin(w * 1.9 * t) + 0.002 * sin(w * 3 * t);
	const double yaw = 70 * sin(w * 0.11 * t) + 4 * sin(w * 1.3 * t + 2) + 10 * sin(w * 0.43 * t);
	const double pitch = 9 * sin(w * 0.3 * t) + 1.2 * sin(w * 1.9 * t),
		     roll = 4 * sin(w * 0.23 * t) + 0.8 * sin(w * 3 * t);

	return (struct bb_pose){ { g * x, y, g * z + 0.01 * sin(w * 1.4 * t) },
				 bb_quat_euler_deg(h * yaw, h * pitch, h * roll) };
}

static inline struct bb_pose scene_wave(double t) /* the wand, in front of the walker */
{
	const struct bb_pose head = scene_walk(t);
	const struct bb_vec3 hand = { 0.25 + 0.1 * sin(2 * PI * 0.7 * t), -0.3 + 0.1 * sin(2 * PI * 0.9 * t), -0.35 };

	return (struct bb_pose){ bb_pose_apply(&head, hand),
				 bb_quat_mul(head.q, bb_quat_euler_deg(40 * sin(2 * PI * 0.5 * t),
								       30 * sin(2 * PI * 0.8 * t), 20)) };
}

static inline double scene_cpu_us(void)
{
	struct timespec t;

	clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
	return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

#endif
