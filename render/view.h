/*
 * render/view.h: the off-axis view of one screen for one eye: three corners and an eye make a view and a projection
 * (generalised perspective projection, Kooima 2008; seed 003 section 5.1.2). Matrices are double; OpenGL clip space.
 */
#ifndef BB_RENDER_VIEW_H
#define BB_RENDER_VIEW_H

#include "hal/room.h"

#define BB_VIEW_LEAST_DISTANCE_M 0.05

enum bb_view_flags {
	BB_VIEW_CLAMPED = 1, /* the eye was nearer than 5 cm to the wall's plane, or behind it: moved to 5 cm in front */
	BB_VIEW_HELD = 2,    /* the eye was not finite: the fallback eye was used */
	BB_VIEW_DEGENERATE = 4 /* the corners span no area or are not finite: a square of 1 m stands in for them */
};

struct bb_view {
	struct bb_vec3 eye;             /* after clamping, room */
	struct bb_corners corners;
	struct bb_vec3 right, up, normal; /* unit, room; normal points into the room */
	struct bb_mat4 view, projection;  /* room -> eye -> clip */
	double near_m, far_m;
	unsigned flags;
};

/* near_m > 0, far_m > near_m. fallback is used when eye is not finite. Never NaN. */
struct bb_view bb_view_make(const struct bb_corners *corners, struct bb_vec3 eye, struct bb_vec3 fallback, double near_m,
                            double far_m);
/* The two eyes of a head: midpoint -+ half the separation along the head's own x axis. */
void bb_view_eyes(const struct bb_pose *eyes_midpoint, double separation_m, struct bb_vec3 *left, struct bb_vec3 *right);
/* Room point to normalised device coordinates (x, y, z) and w, the distance in front of the eye (m). x and y are -1 and
 * 1 at the corners to 1e-12. A point in the eye's own plane has no image: w is 0 and ndc is all 0. */
void bb_view_project(const struct bb_view *v, struct bb_vec3 p, double ndc[3], double *w);
/* The same in float: only what is relative to the eye is rounded, so that it is good to 1e-5 anywhere in a room. */
void bb_view_project_float(const struct bb_view *v, struct bb_vec3 p, float ndc[3], float *w);

#endif
