#include "sync/track/rigid.h"

#include <math.h>

#include "sync/track/linalg.h"

static struct bb_vec3 mean(const struct bb_vec3 *v, size_t n)
{
	struct bb_vec3 sum = { 0, 0, 0 };

	for (size_t i = 0; i < n; i++)
		sum = bb_vec3_add(sum, v[i]);
	return bb_vec3_scale(sum, 1 / (double)n);
}

static void outer_add(double h[3][3], struct bb_vec3 a, struct bb_vec3 b)
{
	const double av[3] = { a.x, a.y, a.z }, bv[3] = { b.x, b.y, b.z };

	for (int r = 0; r < 3; r++)
		for (int c = 0; c < 3; c++)
			h[r][c] += av[r] * bv[c];
}

/* Horn's matrix for quaternions ordered (w, x, y, z). */
static void horn(const double h[3][3], double n[16])
{
	const double xx = h[0][0], yy = h[1][1], zz = h[2][2];
	const double zy = h[1][2] - h[2][1], xz = h[2][0] - h[0][2], yx = h[0][1] - h[1][0];
	const double xy = h[0][1] + h[1][0], zx = h[2][0] + h[0][2], yz = h[1][2] + h[2][1];
	const double m[16] = { xx + yy + zz, zy, xz,           yx, zy, xx - yy - zz, xy, zx,
			       xz,           xy, yy - xx - zz, yz, yx, zx,           yz, zz - xx - yy };

	for (int i = 0; i < 16; i++)
		n[i] = m[i];
}

static struct bb_vec3 main_axis(const struct bb_vec3 *v, struct bb_vec3 centre, size_t n)
{
	double s[3][3] = { { 0 } }, values[3], vectors[9];

	for (size_t i = 0; i < n; i++) {
		const struct bb_vec3 d = bb_vec3_sub(v[i], centre);
		outer_add(s, d, d);
	}
	bb_sym_eigen(3, &s[0][0], values, vectors);
	return (struct bb_vec3){ vectors[0], vectors[3], vectors[6] };
}

/* Points on a line: take `hold` and turn it by the least that brings the body's line onto the room's. */
static struct bb_quat turn_onto_line(const struct bb_vec3 *body, const struct bb_vec3 *room, size_t n,
				     struct bb_vec3 cb, struct bb_vec3 cr, struct bb_quat hold)
{
	const struct bb_vec3 a = main_axis(body, cb, n);
	struct bb_vec3 b = main_axis(room, cr, n);
	double along = 0;

	for (size_t i = 0; i < n; i++)
		along += bb_vec3_dot(bb_vec3_sub(body[i], cb), a) * bb_vec3_dot(bb_vec3_sub(room[i], cr), b);
	if (along < 0)
		b = bb_vec3_scale(b, -1);
	return bb_quat_unit(bb_quat_mul(bb_quat_between(bb_quat_rotate(hold, a), b), hold));
}

bool bb_rigid_fit(const struct bb_vec3 *body, const struct bb_vec3 *room, size_t n, double sigma_m, struct bb_quat hold,
		  struct bb_rigid *out)
{
	double h[3][3] = { { 0 } }, horn4[16], values[4], vectors[16], sum = 0;

	if (n < 3)
		return false;
	const struct bb_vec3 cb = mean(body, n), cr = mean(room, n);
	for (size_t i = 0; i < n; i++)
		outer_add(h, bb_vec3_sub(body[i], cb), bb_vec3_sub(room[i], cr));
	horn(h, horn4);
	bb_sym_eigen(4, horn4, values, vectors);
	/* Singular values of the correlation; the third carries the sign of its determinant. */
	const double s1 = (values[0] + values[1]) / 2, s2 = (values[0] + values[2]) / 2,
		     s3 = (values[0] + values[3]) / 2;
	if (!(s1 > 1e-12) || sigma_m * sigma_m > 0.01 * s1)
		return false;
	out->pose.q = bb_quat_unit((struct bb_quat){ vectors[4], vectors[8], vectors[12], vectors[0] });
	out->roll_sigma_rad = fmin(sigma_m / sqrt(fmax(s2 + s3, 1e-18)), 1.8); /* all round is 1.8 rad rms */
	out->collinear = out->roll_sigma_rad > BB_ROLL_SIGMA_MAX_RAD || s2 + s3 < 1e-10 * s1;
	/* Turning a mirror image into place costs 4 |s3| in squared distance; 36 sigma^2 is beyond noise. */
	out->mirrored = -4 * s3 > fmax(36 * sigma_m * sigma_m, 1e-9 * s1);
	if (out->collinear)
		out->pose.q = turn_onto_line(body, room, n, cb, cr, hold);
	out->pose.p = bb_vec3_sub(cr, bb_quat_rotate(out->pose.q, cb));
	for (size_t i = 0; i < n; i++) {
		const struct bb_vec3 d = bb_vec3_sub(bb_pose_apply(&out->pose, body[i]), room[i]);
		sum += bb_vec3_dot(d, d);
	}
	out->rms_m = sqrt(sum / (double)n);
	return isfinite(out->rms_m);
}
