#include "sync/track/triangulate.h"

#include <math.h>

#include "sync/track/linalg.h"

bool bb_triangulate_pair(const struct bb_sight *a, const struct bb_sight *b, double min_angle_rad, struct bb_vec3 *mid,
			 double *gap_sigmas, double *sigma_m)
{
	const struct bb_vec3 w = bb_vec3_sub(b->o, a->o), n = bb_vec3_cross(a->d, b->d);
	const double sin2 = bb_vec3_dot(n, n), c = bb_vec3_dot(a->d, b->d);

	if (!(sin2 > min_angle_rad * min_angle_rad))
		return false;
	const double wa = bb_vec3_dot(w, a->d), wb = bb_vec3_dot(w, b->d);
	const double ta = (wa - c * wb) / sin2, tb = (c * wa - wb) / sin2;
	if (!(ta > 0) || !(tb > 0))
		return false;
	const double sa = a->sigma_rad * ta, sb = b->sigma_rad * tb, both = sqrt(sa * sa + sb * sb);
	*gap_sigmas = fabs(bb_vec3_dot(w, n)) / sqrt(sin2) / both;
	*sigma_m = both / sqrt(sin2);
	*mid = bb_vec3_lerp(bb_vec3_add(a->o, bb_vec3_scale(a->d, ta)), bb_vec3_add(b->o, bb_vec3_scale(b->d, tb)),
			    sa * sa / (both * both));
	return true;
}

static double widest_sin2(const struct bb_sight *sights, size_t n)
{
	double most = 0;

	for (size_t i = 0; i < n; i++)
		for (size_t j = i + 1; j < n; j++) {
			const struct bb_vec3 c = bb_vec3_cross(sights[i].d, sights[j].d);
			most = fmax(most, bb_vec3_dot(c, c));
		}
	return most;
}

static bool solve3(const double m[3][3], const double b[3], struct bb_vec3 *x)
{
	const struct bb_vec3 r0 = { m[0][0], m[0][1], m[0][2] }, r1 = { m[1][0], m[1][1], m[1][2] },
			     r2 = { m[2][0], m[2][1], m[2][2] };
	const struct bb_vec3 c12 = bb_vec3_cross(r1, r2), c20 = bb_vec3_cross(r2, r0), c01 = bb_vec3_cross(r0, r1);
	const double det = bb_vec3_dot(r0, c12);

	if (!(fabs(det) > 0) || !isfinite(det))
		return false;
	*x = bb_vec3_scale(
		bb_vec3_add(bb_vec3_add(bb_vec3_scale(c12, b[0]), bb_vec3_scale(c20, b[1])), bb_vec3_scale(c01, b[2])),
		1 / det);
	return true;
}

/* Normal equations about `from` (small numbers: no cancellation far from the origin), weights at the depths of p. */
static void accumulate(const struct bb_sight *sights, size_t n, struct bb_vec3 from, struct bb_vec3 p, double m[3][3],
		       double b[3])
{
	for (size_t i = 0; i < n; i++) {
		const struct bb_sight *s = &sights[i];
		const struct bb_vec3 o = bb_vec3_sub(s->o, from);
		const double depth = fmax(1e-3, bb_vec3_dot(bb_vec3_sub(p, s->o), s->d));
		const double w = 1 / (s->sigma_rad * s->sigma_rad * depth * depth), od = bb_vec3_dot(o, s->d);
		const double d[3] = { s->d.x, s->d.y, s->d.z }, oo[3] = { o.x, o.y, o.z };
		for (int r = 0; r < 3; r++) {
			for (int c = 0; c < 3; c++)
				m[r][c] += w * ((r == c) - d[r] * d[c]);
			b[r] += w * (oo[r] - d[r] * od);
		}
	}
}

static bool measure(const struct bb_sight *sights, size_t n, double m[3][3], struct bb_triangulated *out)
{
	double values[3], vectors[9];

	out->chi2 = 0;
	for (size_t i = 0; i < n; i++) {
		const struct bb_vec3 v = bb_vec3_sub(out->p, sights[i].o);
		const double depth = bb_vec3_dot(v, sights[i].d);
		if (!(depth > 0))
			return false;
		const struct bb_vec3 off = bb_vec3_sub(v, bb_vec3_scale(sights[i].d, depth));
		const double s = sights[i].sigma_rad * depth;
		out->chi2 += bb_vec3_dot(off, off) / (s * s);
	}
	bb_sym_eigen(3, &m[0][0], values, vectors);
	if (!(values[2] > 0))
		return false;
	out->sigma_m = 1 / sqrt(values[2]);
	return isfinite(out->chi2);
}

bool bb_triangulate(const struct bb_sight *sights, size_t n, double min_angle_rad, struct bb_triangulated *out)
{
	if (n < 2 || !(widest_sin2(sights, n) > min_angle_rad * min_angle_rad))
		return false;
	const struct bb_vec3 from = sights[0].o;
	struct bb_vec3 p = bb_vec3_add(from, sights[0].d), x;
	/* Depths enter the weights: the second round has them right to the noise. */
	for (int round = 0; round < 3; round++) {
		double m[3][3] = { { 0 } }, b[3] = { 0 };
		accumulate(sights, n, from, p, m, b);
		if (!solve3(m, b, &x))
			return false;
		out->p = p = bb_vec3_add(from, x);
		if (round == 2)
			return measure(sights, n, m, out);
	}
	return false;
}
