#include "hal/geometry.h"

#include <math.h>
#include <string.h>

#define RAD_PER_DEG (3.14159265358979323846 / 180.0)

struct bb_vec3 bb_vec3_add(struct bb_vec3 a, struct bb_vec3 b)
{
	return (struct bb_vec3){ a.x + b.x, a.y + b.y, a.z + b.z };
}

struct bb_vec3 bb_vec3_sub(struct bb_vec3 a, struct bb_vec3 b)
{
	return (struct bb_vec3){ a.x - b.x, a.y - b.y, a.z - b.z };
}

struct bb_vec3 bb_vec3_scale(struct bb_vec3 a, double s)
{
	return (struct bb_vec3){ a.x * s, a.y * s, a.z * s };
}

struct bb_vec3 bb_vec3_cross(struct bb_vec3 a, struct bb_vec3 b)
{
	return (struct bb_vec3){ a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x };
}

double bb_vec3_dot(struct bb_vec3 a, struct bb_vec3 b)
{
	return a.x * b.x + a.y * b.y + a.z * b.z;
}

double bb_vec3_norm(struct bb_vec3 a)
{
	return sqrt(bb_vec3_dot(a, a));
}

struct bb_vec3 bb_vec3_unit(struct bb_vec3 a, struct bb_vec3 fallback)
{
	const double n = bb_vec3_norm(a);

	return n > 1e-300 ? bb_vec3_scale(a, 1 / n) : fallback;
}

struct bb_vec3 bb_vec3_lerp(struct bb_vec3 a, struct bb_vec3 b, double t)
{
	return bb_vec3_add(a, bb_vec3_scale(bb_vec3_sub(b, a), t));
}

struct bb_quat bb_quat_mul(struct bb_quat a, struct bb_quat b)
{
	return (struct bb_quat){ a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
		                 a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
		                 a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
		                 a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z };
}

struct bb_quat bb_quat_conj(struct bb_quat q)
{
	return (struct bb_quat){ -q.x, -q.y, -q.z, q.w };
}

struct bb_quat bb_quat_unit(struct bb_quat q)
{
	const double n = sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);

	if (!(n > 1e-300))
		return BB_QUAT_IDENTITY;
	return (struct bb_quat){ q.x / n, q.y / n, q.z / n, q.w / n };
}

struct bb_quat bb_quat_axis_angle(struct bb_vec3 axis, double angle_rad)
{
	const struct bb_vec3 u = bb_vec3_unit(axis, (struct bb_vec3){ 0, 1, 0 });
	const double s = sin(angle_rad / 2);

	return (struct bb_quat){ u.x * s, u.y * s, u.z * s, cos(angle_rad / 2) };
}

struct bb_quat bb_quat_euler_deg(double yaw_deg, double pitch_deg, double roll_deg)
{
	const struct bb_quat yaw = bb_quat_axis_angle((struct bb_vec3){ 0, 1, 0 }, yaw_deg * RAD_PER_DEG);
	const struct bb_quat pitch = bb_quat_axis_angle((struct bb_vec3){ 1, 0, 0 }, pitch_deg * RAD_PER_DEG);
	const struct bb_quat roll = bb_quat_axis_angle((struct bb_vec3){ 0, 0, 1 }, roll_deg * RAD_PER_DEG);

	return bb_quat_mul(yaw, bb_quat_mul(pitch, roll));
}

struct bb_quat bb_quat_slerp(struct bb_quat a, struct bb_quat b, double t)
{
	const double dot = a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;

	if (dot < 0) { /* q and -q are one orientation: take the short way */
		b = (struct bb_quat){ -b.x, -b.y, -b.z, -b.w };
	}
	const double angle = bb_quat_angle(a, b) / 2;
	const double s = sin(angle);
	const double wa = s < 1e-6 ? 1 - t : sin((1 - t) * angle) / s;
	const double wb = s < 1e-6 ? t : sin(t * angle) / s;

	return bb_quat_unit((struct bb_quat){ wa * a.x + wb * b.x, wa * a.y + wb * b.y, wa * a.z + wb * b.z,
	                                      wa * a.w + wb * b.w });
}

struct bb_vec3 bb_quat_rotate(struct bb_quat q, struct bb_vec3 v)
{
	const struct bb_vec3 u = { q.x, q.y, q.z };
	const struct bb_vec3 t = bb_vec3_scale(bb_vec3_cross(u, v), 2);

	return bb_vec3_add(bb_vec3_add(v, bb_vec3_scale(t, q.w)), bb_vec3_cross(u, t));
}

double bb_quat_angle(struct bb_quat a, struct bb_quat b)
{
	const double dot = a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w;
	const double s = dot < 0 ? -1 : 1;
	const double d[4] = { a.x - s * b.x, a.y - s * b.y, a.z - s * b.z, a.w - s * b.w };
	const double e[4] = { a.x + s * b.x, a.y + s * b.y, a.z + s * b.z, a.w + s * b.w };
	double dd = 0, ee = 0;

	for (int i = 0; i < 4; i++) {
		dd += d[i] * d[i];
		ee += e[i] * e[i];
	}
	/* |p - q| = 2 sin(a/4), |p + q| = 2 cos(a/4) for a rotation by a between them. */
	return 4 * atan2(sqrt(dd), sqrt(ee));
}

struct bb_quat bb_quat_from_matrix(const double r[3][3])
{
	const double trace = r[0][0] + r[1][1] + r[2][2];
	struct bb_quat q;

	/* Shepperd's choice: divide by the largest component. */
	if (trace > r[0][0] && trace > r[1][1] && trace > r[2][2]) {
		q = (struct bb_quat){ r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1], 1 + trace };
	} else if (r[0][0] >= r[1][1] && r[0][0] >= r[2][2]) {
		q = (struct bb_quat){ 1 + 2 * r[0][0] - trace, r[0][1] + r[1][0], r[2][0] + r[0][2], r[2][1] - r[1][2] };
	} else if (r[1][1] >= r[2][2]) {
		q = (struct bb_quat){ r[0][1] + r[1][0], 1 + 2 * r[1][1] - trace, r[1][2] + r[2][1], r[0][2] - r[2][0] };
	} else {
		q = (struct bb_quat){ r[2][0] + r[0][2], r[1][2] + r[2][1], 1 + 2 * r[2][2] - trace, r[1][0] - r[0][1] };
	}
	return bb_quat_unit(q);
}

struct bb_vec3 bb_pose_apply(const struct bb_pose *pose, struct bb_vec3 v)
{
	return bb_vec3_add(bb_quat_rotate(pose->q, v), pose->p);
}

struct bb_vec3 bb_pose_inverse_apply(const struct bb_pose *pose, struct bb_vec3 v)
{
	return bb_quat_rotate(bb_quat_conj(pose->q), bb_vec3_sub(v, pose->p));
}

struct bb_pose bb_pose_mul(const struct bb_pose *a, const struct bb_pose *b)
{
	return (struct bb_pose){ bb_pose_apply(a, b->p), bb_quat_unit(bb_quat_mul(a->q, b->q)) };
}

struct bb_pose bb_pose_inverse(const struct bb_pose *pose)
{
	const struct bb_quat q = bb_quat_conj(pose->q);

	return (struct bb_pose){ bb_vec3_scale(bb_quat_rotate(q, pose->p), -1), q };
}

struct bb_pose bb_pose_look_at(struct bb_vec3 eye, struct bb_vec3 target, struct bb_vec3 up)
{
	const struct bb_vec3 back = bb_vec3_unit(bb_vec3_sub(eye, target), (struct bb_vec3){ 0, 0, 1 });
	const struct bb_vec3 spare = fabs(back.y) > 0.9 ? (struct bb_vec3){ 1, 0, 0 } : (struct bb_vec3){ 0, 1, 0 };
	const struct bb_vec3 side = bb_vec3_cross(up, back);
	const struct bb_vec3 x = bb_vec3_norm(side) > 1e-9
	                                 ? bb_vec3_unit(side, spare)
	                                 : bb_vec3_unit(bb_vec3_cross(spare, back), (struct bb_vec3){ 1, 0, 0 });
	const struct bb_vec3 y = bb_vec3_cross(back, x);
	const double r[3][3] = { { x.x, y.x, back.x }, { x.y, y.y, back.y }, { x.z, y.z, back.z } };

	return (struct bb_pose){ eye, bb_quat_from_matrix(r) };
}

struct bb_mat4 bb_mat4_mul(const struct bb_mat4 *a, const struct bb_mat4 *b)
{
	struct bb_mat4 out;

	for (int c = 0; c < 4; c++)
		for (int r = 0; r < 4; r++) {
			double sum = 0;
			for (int k = 0; k < 4; k++)
				sum += a->m[k * 4 + r] * b->m[c * 4 + k];
			out.m[c * 4 + r] = sum;
		}
	return out;
}

struct bb_mat4 bb_mat4_from_pose(const struct bb_pose *pose)
{
	const struct bb_vec3 x = bb_quat_rotate(pose->q, (struct bb_vec3){ 1, 0, 0 });
	const struct bb_vec3 y = bb_quat_rotate(pose->q, (struct bb_vec3){ 0, 1, 0 });
	const struct bb_vec3 z = bb_quat_rotate(pose->q, (struct bb_vec3){ 0, 0, 1 });

	return (struct bb_mat4){ { x.x, x.y, x.z, 0, y.x, y.y, y.z, 0, z.x, z.y, z.z, 0, pose->p.x, pose->p.y, pose->p.z,
		                   1 } };
}

void bb_mat4_apply(const struct bb_mat4 *m, const double in[4], double out[4])
{
	for (int r = 0; r < 4; r++)
		out[r] = m->m[r] * in[0] + m->m[4 + r] * in[1] + m->m[8 + r] * in[2] + m->m[12 + r] * in[3];
}

/* Gauss-Jordan with partial pivoting on [m | I]. */
bool bb_mat4_inverse(const struct bb_mat4 *m, struct bb_mat4 *out)
{
	double a[4][8];

	for (int r = 0; r < 4; r++)
		for (int c = 0; c < 4; c++) {
			a[r][c] = m->m[c * 4 + r];
			a[r][c + 4] = r == c ? 1 : 0;
		}
	for (int k = 0; k < 4; k++) {
		int pivot = k;
		for (int r = k + 1; r < 4; r++)
			if (fabs(a[r][k]) > fabs(a[pivot][k]))
				pivot = r;
		if (!(fabs(a[pivot][k]) > 1e-300))
			return false;
		for (int c = 0; c < 8; c++) {
			const double swap = a[k][c];
			a[k][c] = a[pivot][c];
			a[pivot][c] = swap;
		}
		const double scale = 1 / a[k][k];
		for (int c = 0; c < 8; c++)
			a[k][c] *= scale;
		for (int r = 0; r < 4; r++) {
			const double f = a[r][k];
			for (int c = 0; r != k && c < 8; c++)
				a[r][c] -= f * a[k][c];
		}
	}
	for (int r = 0; r < 4; r++)
		for (int c = 0; c < 4; c++)
			out->m[c * 4 + r] = a[r][c + 4];
	return true;
}
