#include "sync/track/linalg.h"

#include <math.h>

#define SWEEPS 30

/* One Jacobi rotation that zeroes a[p][q]. */
static void jacobi_rotate(int n, double *a, double *v, int p, int q)
{
	const double apq = a[p * n + q];
	const double theta = (a[q * n + q] - a[p * n + p]) / (2 * apq);
	const double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + sqrt(theta * theta + 1));
	const double c = 1 / sqrt(t * t + 1);
	const double s = t * c;

	for (int k = 0; k < n; k++) {
		const double akp = a[k * n + p], akq = a[k * n + q];
		a[k * n + p] = c * akp - s * akq;
		a[k * n + q] = s * akp + c * akq;
	}
	for (int k = 0; k < n; k++) {
		const double apk = a[p * n + k], aqk = a[q * n + k];
		a[p * n + k] = c * apk - s * aqk;
		a[q * n + k] = s * apk + c * aqk;
		const double vkp = v[k * n + p], vkq = v[k * n + q];
		v[k * n + p] = c * vkp - s * vkq;
		v[k * n + q] = s * vkp + c * vkq;
	}
}

static void swap_columns(int n, double *v, int i, int j)
{
	for (int k = 0; k < n; k++) {
		const double keep = v[k * n + i];
		v[k * n + i] = v[k * n + j];
		v[k * n + j] = keep;
	}
}

static void sort_and_sign(int n, double *values, double *v)
{
	for (int i = 0; i < n; i++) {
		int most = i;
		for (int j = i + 1; j < n; j++)
			if (values[j] > values[most])
				most = j;
		const double keep = values[i];
		values[i] = values[most];
		values[most] = keep;
		swap_columns(n, v, i, most);
		int big = 0;
		for (int k = 1; k < n; k++)
			if (fabs(v[k * n + i]) > fabs(v[big * n + i]))
				big = k;
		for (int k = 0; v[big * n + i] < 0 && k < n; k++)
			if (k != big)
				v[k * n + i] = -v[k * n + i];
		v[big * n + i] = fabs(v[big * n + i]);
	}
}

void bb_sym_eigen(int n, double *a, double *values, double *vectors)
{
	double norm = 0;

	for (int i = 0; i < n * n; i++) {
		vectors[i] = i % (n + 1) ? 0 : 1;
		norm += a[i] * a[i];
	}
	for (int sweep = 0; sweep < SWEEPS; sweep++) {
		double off = 0;
		for (int p = 0; p < n; p++)
			for (int q = p + 1; q < n; q++)
				off += a[p * n + q] * a[p * n + q];
		if (!(off > 1e-32 * norm))
			break;
		for (int p = 0; p < n; p++)
			for (int q = p + 1; q < n; q++)
				if (a[p * n + q] * a[p * n + q] > 1e-40 * norm)
					jacobi_rotate(n, a, vectors, p, q);
	}
	for (int i = 0; i < n; i++)
		values[i] = a[i * n + i];
	sort_and_sign(n, values, vectors);
}

bool bb_chol6_factor(double a[6][6])
{
	for (int j = 0; j < 6; j++) {
		double d = a[j][j];
		for (int k = 0; k < j; k++)
			d -= a[j][k] * a[j][k];
		/* Relative to the entry itself: what is left of a singular matrix is rounding. */
		if (!(d > 1e-13 * a[j][j]) || !isfinite(d))
			return false;
		a[j][j] = sqrt(d);
		for (int i = j + 1; i < 6; i++) {
			double s = a[i][j];
			for (int k = 0; k < j; k++)
				s -= a[i][k] * a[j][k];
			a[i][j] = s / a[j][j];
		}
	}
	return true;
}

void bb_chol6_solve(const double l[6][6], const double b[6], double x[6])
{
	for (int i = 0; i < 6; i++) {
		x[i] = b[i];
		for (int k = 0; k < i; k++)
			x[i] -= l[i][k] * x[k];
		x[i] /= l[i][i];
	}
	for (int i = 5; i >= 0; i--) {
		for (int k = i + 1; k < 6; k++)
			x[i] -= l[k][i] * x[k];
		x[i] /= l[i][i];
	}
}

void bb_chol6_inverse(const double l[6][6], double inverse[6][6])
{
	for (int c = 0; c < 6; c++) {
		double unit[6] = { 0 }, column[6];
		unit[c] = 1;
		bb_chol6_solve(l, unit, column);
		for (int r = 0; r < 6; r++)
			inverse[r][c] = column[r];
	}
}

struct bb_quat bb_quat_between(struct bb_vec3 a, struct bb_vec3 b)
{
	const double c = bb_vec3_dot(a, b);
	const struct bb_vec3 n = bb_vec3_cross(a, b);
	const struct bb_vec3 other = fabs(a.x) < 0.8 ? (struct bb_vec3){ 1, 0, 0 } : (struct bb_vec3){ 0, 1, 0 };

	if (c < -1 + 1e-12)
		return bb_quat_axis_angle(bb_vec3_cross(a, other), 3.14159265358979323846);
	return bb_quat_unit((struct bb_quat){ n.x, n.y, n.z, 1 + c });
}

struct bb_quat bb_quat_exp(struct bb_vec3 v)
{
	const double angle = bb_vec3_norm(v);
	const double s = angle > 1e-9 ? sin(angle / 2) / angle : 0.5;

	return bb_quat_unit((struct bb_quat){ v.x * s, v.y * s, v.z * s, cos(angle / 2) });
}

struct bb_vec3 bb_quat_log(struct bb_quat q)
{
	const struct bb_vec3 v = { q.x, q.y, q.z };
	const double n = bb_vec3_norm(v);
	const double sign = q.w < 0 ? -1 : 1; /* the short way round */

	return bb_vec3_scale(v, sign * (n > 1e-12 ? 2 * atan2(n, fabs(q.w)) / n : 2));
}
