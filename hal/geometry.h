/*
 * hal/geometry.h: vectors, unit quaternions and poses in double. Right-handed, metres, Y up, the viewer looks along -Z.
 * Quaternions are (x, y, z, w). All functions are pure; none returns NaN for finite input.
 */
#ifndef BB_HAL_GEOMETRY_H
#define BB_HAL_GEOMETRY_H

#include "hal/base.h"

struct bb_vec3 {
	double x, y, z;
};
struct bb_quat {
	double x, y, z, w;
};
struct bb_pose { /* maps a point of the body's own space to the room: p_room = rotate(q, p_body) + p */
	struct bb_vec3 p;
	struct bb_quat q;
};
struct bb_mat4 { /* column-major like GL: m[column * 4 + row] */
	double m[16];
};

#define BB_QUAT_IDENTITY ((struct bb_quat){ 0, 0, 0, 1 })
#define BB_POSE_IDENTITY ((struct bb_pose){ { 0, 0, 0 }, { 0, 0, 0, 1 } })

struct bb_vec3 bb_vec3_add(struct bb_vec3 a, struct bb_vec3 b);
struct bb_vec3 bb_vec3_sub(struct bb_vec3 a, struct bb_vec3 b);
struct bb_vec3 bb_vec3_scale(struct bb_vec3 a, double s);
struct bb_vec3 bb_vec3_cross(struct bb_vec3 a, struct bb_vec3 b);
double bb_vec3_dot(struct bb_vec3 a, struct bb_vec3 b);
double bb_vec3_norm(struct bb_vec3 a);
/* A zero vector answers fallback. */
struct bb_vec3 bb_vec3_unit(struct bb_vec3 a, struct bb_vec3 fallback);
struct bb_vec3 bb_vec3_lerp(struct bb_vec3 a, struct bb_vec3 b, double t);

struct bb_quat bb_quat_mul(struct bb_quat a, struct bb_quat b); /* b first, then a */
struct bb_quat bb_quat_conj(struct bb_quat q);
struct bb_quat bb_quat_unit(struct bb_quat q); /* zero becomes the identity */
struct bb_quat bb_quat_axis_angle(struct bb_vec3 axis, double angle_rad);
/* Heading about +Y, then pitch about +X, then roll about +Z, in degrees; all 0 looks along -Z. */
struct bb_quat bb_quat_euler_deg(double yaw_deg, double pitch_deg, double roll_deg);
struct bb_quat bb_quat_slerp(struct bb_quat a, struct bb_quat b, double t); /* sign-aligned, short way round */
struct bb_vec3 bb_quat_rotate(struct bb_quat q, struct bb_vec3 v);
/* Angle between two orientations, rad, exact for small angles (2 atan2(|p-q|, |p+q|), row nQ1). */
double bb_quat_angle(struct bb_quat a, struct bb_quat b);
/* Orientation from the rows of a rotation matrix r[row][column]. */
struct bb_quat bb_quat_from_matrix(const double r[3][3]);

struct bb_vec3 bb_pose_apply(const struct bb_pose *pose, struct bb_vec3 v);
struct bb_vec3 bb_pose_inverse_apply(const struct bb_pose *pose, struct bb_vec3 v);
struct bb_pose bb_pose_mul(const struct bb_pose *a, const struct bb_pose *b); /* b first, then a */
struct bb_pose bb_pose_inverse(const struct bb_pose *pose);
/* A pose at `eye` whose -Z points at `target`, +Y as near to up as can be. */
struct bb_pose bb_pose_look_at(struct bb_vec3 eye, struct bb_vec3 target, struct bb_vec3 up);

struct bb_mat4 bb_mat4_mul(const struct bb_mat4 *a, const struct bb_mat4 *b); /* a times b */
struct bb_mat4 bb_mat4_from_pose(const struct bb_pose *pose);
void bb_mat4_apply(const struct bb_mat4 *m, const double in[4], double out[4]);
/* false when singular (out untouched). */
bool bb_mat4_inverse(const struct bb_mat4 *m, struct bb_mat4 *out);

#endif
