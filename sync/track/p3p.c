#include "sync/track/p3p.h"

#include <math.h>

#include "sync/track/linalg.h"

/*
 * The depths l satisfy three conics l^T A_k l = |x_i - x_j|^2. Two differences of them are homogeneous, D1 and D2; the
 * pencil D1 + g D2 holds a degenerate conic (a pair of planes through the origin of l space) where its determinant, a
 * cubic in g, is 0. Each plane, cut with one of the conics, gives up to two solutions.
 */
struct sides {
	double b12, b13, b23; /* cosines between the bearings */
	double a12, a13, a23; /* squared distances of the points */
};

static double det3(const double m[9])
{
	return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
	       m[2] * (m[3] * m[7] - m[4] * m[6]);
}

static void pencil(const struct sides *s, double d1[9], double d2[9])
{
	const double one[9] = { s->a23, -s->a23 * s->b12, 0,      -s->a23 * s->b12, s->a23 - s->a12, s->a12 * s->b23,
				0,      s->a12 * s->b23,  -s->a12 };
	const double two[9] = {
		s->a23,         0, -s->a23 * s->b13, 0, -s->a13, s->a13 * s->b23, -s->a23 * s->b13, s->a13 * s->b23,
		s->a23 - s->a13
	};

	for (int i = 0; i < 9; i++) {
		d1[i] = one[i];
		d2[i] = two[i];
	}
}

static double cubic_at(const double c[4], double g)
{
	return ((c[3] * g + c[2]) * g + c[1]) * g + c[0];
}

/* A real root of the cubic; the scale is 1 because the entries were made so. false when it is no cubic. */
static bool cubic_root(const double c[4], double *root)
{
	const double lead = fabs(c[3]);

	if (!(lead > 1e-14 * (fabs(c[0]) + fabs(c[1]) + fabs(c[2]))))
		return false;
	const double bound = 1 + (fabs(c[0]) + fabs(c[1]) + fabs(c[2])) / lead; /* Cauchy */
	double low = -bound, high = bound, x = 0;
	const double sign = c[3] > 0 ? 1 : -1;
	for (int i = 0; i < 100; i++) {
		const double f = sign * cubic_at(c, x), slope = sign * ((3 * c[3] * x + 2 * c[2]) * x + c[1]);
		if (f > 0)
			high = x;
		else
			low = x;
		double next = x - f / slope;
		if (!(next > low && next < high))
			next = 0.5 * (low + high);
		if (fabs(next - x) <= 1e-15 * (1 + fabs(x)))
			break;
		x = next;
	}
	*root = x;
	return true;
}

/* det(D1 + g D2) by interpolation at g = -1, 0, 1 and the leading coefficient det(D2). */
static void pencil_cubic(const double d1[9], const double d2[9], double c[4])
{
	double plus[9], minus[9];

	for (int i = 0; i < 9; i++) {
		plus[i] = d1[i] + d2[i];
		minus[i] = d1[i] - d2[i];
	}
	const double p = det3(plus), m = det3(minus);
	c[0] = det3(d1);
	c[3] = det3(d2);
	c[2] = (p + m) / 2 - c[0];
	c[1] = (p - m) / 2 - c[3];
}

/* Newton on the three conics themselves: what the cubic lost to rounding comes back. */
static bool refine(const struct sides *s, double l[3])
{
	for (int i = 0; i < 4; i++) {
		const double f[3] = { l[0] * l[0] + l[1] * l[1] - 2 * s->b12 * l[0] * l[1] - s->a12,
				      l[0] * l[0] + l[2] * l[2] - 2 * s->b13 * l[0] * l[2] - s->a13,
				      l[1] * l[1] + l[2] * l[2] - 2 * s->b23 * l[1] * l[2] - s->a23 };
		const double p = 2 * (l[0] - s->b12 * l[1]), q = 2 * (l[1] - s->b12 * l[0]);
		const double r = 2 * (l[0] - s->b13 * l[2]), t = 2 * (l[2] - s->b13 * l[0]);
		const double u = 2 * (l[1] - s->b23 * l[2]), v = 2 * (l[2] - s->b23 * l[1]);
		/* rows (p q 0), (r 0 t), (0 u v) */
		const double det = -p * t * u - q * r * v;
		if (!(fabs(det) > 1e-30))
			return false;
		l[0] -= (f[0] * -t * u - q * (f[1] * v - t * f[2])) / det;
		const double l1 = (p * (f[1] * v - t * f[2]) - f[0] * r * v) / det;
		const double l2 = (p * -u * f[1] - q * r * f[2] + f[0] * r * u) / det;
		l[1] -= l1;
		l[2] -= l2;
	}
	return l[0] > 0 && l[1] > 0 && l[2] > 0 && isfinite(l[0] + l[1] + l[2]);
}

static size_t keep(const struct sides *s, double l1, double l2, double l3, double depth[4][3], size_t n)
{
	double l[3] = { l1, l2, l3 };

	if (n == 4 || !(l1 > 0 && l2 > 0 && l3 > 0) || !refine(s, l))
		return n;
	for (size_t i = 0; i < n; i++)
		if (fabs(depth[i][0] - l[0]) + fabs(depth[i][1] - l[1]) + fabs(depth[i][2] - l[2]) < 1e-9)
			return n;
	for (int k = 0; k < 3; k++)
		depth[n][k] = l[k];
	return n + 1;
}

/* The solutions on one plane: the depth with the largest coefficient is a sum of the other two, and the ratio of those
 * two is a root of the quadratic that compares two of the sides. */
static size_t cut_plane(const struct sides *s, const double plane[3], double depth[4][3], size_t n)
{
	int i = 0;

	for (int k = 1; k < 3; k++)
		if (fabs(plane[k]) > fabs(plane[i]))
			i = k;
	const int j = (i + 1) % 3, k = (i + 2) % 3;
	const double u = -plane[j] / plane[i], w = -plane[k] / plane[i];
	const double b[3][3] = { { 1, s->b12, s->b13 }, { s->b12, 1, s->b23 }, { s->b13, s->b23, 1 } };
	const double a[3][3] = { { 0, s->a12, s->a13 }, { s->a12, 0, s->a23 }, { s->a13, s->a23, 0 } };
	/* with l_j = 1, l_k = r: |ij|^2 a_jk = |jk|^2 a_ij, a quadratic in r */
	const double ij2 = w * w, ij1 = 2 * u * w - 2 * b[i][j] * w, ij0 = u * u + 1 - 2 * b[i][j] * u;
	const double q2 = ij2 * a[j][k] - a[i][j], q1 = ij1 * a[j][k] + 2 * b[j][k] * a[i][j],
		     q0 = ij0 * a[j][k] - a[i][j];
	double disc = q1 * q1 - 4 * q2 * q0;
	if (disc < 0 && disc > -1e-9 * q1 * q1)
		disc = 0; /* a double root that rounding pushed apart */
	if (!(disc >= 0))
		return n;
	const double q = -0.5 * (q1 + (q1 >= 0 ? 1 : -1) * sqrt(disc));
	const double root[2] = { q2 != 0 ? q / q2 : -1, q != 0 ? q0 / q : -1 };
	for (int m = 0; m < 2; m++) {
		const double r = root[m], jk = 1 + r * r - 2 * b[j][k] * r;
		if (!(r > 0) || !(jk > 0))
			continue;
		double l[3];
		l[j] = sqrt(a[j][k] / jk);
		l[k] = r * l[j];
		l[i] = u * l[j] + w * l[k];
		n = keep(s, l[0], l[1], l[2], depth, n);
	}
	return n;
}

size_t bb_p3p_depths(const struct bb_vec3 y[3], const struct bb_vec3 x[3], double depth[4][3])
{
	const struct bb_vec3 x12 = bb_vec3_sub(x[0], x[1]), x13 = bb_vec3_sub(x[0], x[2]),
			     x23 = bb_vec3_sub(x[1], x[2]);
	const struct sides s = { bb_vec3_dot(y[0], y[1]), bb_vec3_dot(y[0], y[2]), bb_vec3_dot(y[1], y[2]),
				 bb_vec3_dot(x12, x12),   bb_vec3_dot(x13, x13),   bb_vec3_dot(x23, x23) };
	double d1[9], d2[9], c[4], g, values[3], v[9];
	size_t n = 0;

	pencil(&s, d1, d2);
	pencil_cubic(d1, d2, c);
	if (!cubic_root(c, &g))
		return 0;
	for (int i = 0; i < 9; i++)
		d1[i] += g * d2[i];
	bb_sym_eigen(3, d1, values, v);
	/* values are sorted; the middle one is the 0, the outer two have opposite signs or there is no real plane. */
	if (!(values[0] > 0) || !(values[2] < 0))
		return 0;
	const double t = sqrt(-values[2] / values[0]);
	for (int sign = -1; sign <= 1; sign += 2) {
		const double plane[3] = { v[0] + sign * t * v[2], v[3] + sign * t * v[5], v[6] + sign * t * v[8] };
		n = cut_plane(&s, plane, depth, n);
	}
	return n;
}
