/* sync/calibrate/bundle.c: see bundle.h. */
#include "sync/calibrate/bundle.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sync/calibrate/dense.h"
#include "sync/track/lens.h"
#include "sync/track/linalg.h"

#define NC BB_BUNDLE_CAMERA
#define NR BB_BUNDLE_ROD
#define BLIND_PX 1e3 /* what an observation costs that cannot be projected */
#define LAMBDA_MOST 1e10
#define TIE 1e-4 /* of a prior's deviations: what one lens may differ from itself by */

struct link { /* what one camera saw of one rod */
	uint32_t rod;
	uint16_t camera;
	double w[NC][NR];
};

struct rod_block {
	double v[NR][NR], g[NR]; /* V and its gradient; after elimination the inverse of the damped V */
	size_t first_link, n_links;
};

struct work {
	struct bb_lens *lenses;
	struct link *links;
	struct rod_block *rods;
	double (*u)[NC][NC], (*g)[NC]; /* per camera */
	double *s, *x;                 /* dense system, n_cameras * NC */
	struct bb_camera_config *try_cameras;
	struct bb_rod *try_rods;
};

/* The unknowns */

static void tangents(struct bb_vec3 u, struct bb_vec3 *e1, struct bb_vec3 *e2)
{
	const struct bb_vec3 side = fabs(u.x) < 0.6 ? (struct bb_vec3){ 1, 0, 0 } : (struct bb_vec3){ 0, 1, 0 };

	*e1 = bb_vec3_unit(bb_vec3_cross(u, side), side);
	*e2 = bb_vec3_cross(u, *e1);
}

void bb_bundle_move_rod(struct bb_rod *rod, const double d[NR])
{
	struct bb_vec3 e1, e2;

	tangents(rod->u, &e1, &e2);
	rod->p = bb_vec3_add(rod->p, (struct bb_vec3){ d[0], d[1], d[2] });
	rod->u = bb_vec3_add(rod->u, bb_vec3_add(bb_vec3_scale(e1, d[3]), bb_vec3_scale(e2, d[4])));
	rod->u = bb_vec3_unit(rod->u, e1);
}

void bb_bundle_move_camera(struct bb_camera_config *c, const double d[NC])
{
	c->fx_px += d[0];
	c->fy_px = c->fx_px;
	c->cx_px += d[1];
	c->cy_px += d[2];
	c->k1 += d[3];
	c->k2 += d[4];
	/* p_camera turns by d: the pose, which is its inverse, by -d on the camera's side */
	c->pose.q = bb_quat_unit(bb_quat_mul(c->pose.q, bb_quat_exp((struct bb_vec3){ -d[5], -d[6], -d[7] })));
	c->pose.p = bb_vec3_add(c->pose.p, (struct bb_vec3){ d[8], d[9], d[10] });
}

/* Room point of a rod's marker. */
static struct bb_vec3 marker_of(const struct bb_bundle *b, const struct bb_rod *rod, unsigned marker)
{
	return bb_vec3_add(rod->p, bb_vec3_scale(rod->u, b->along_m[marker]));
}

/* Derivatives */

/* What k1 and k2 do to the distorted place: r^2 and r^4 times it, or theta^3 and theta^5 along it. */
static void by_lens(const struct bb_lens *lens, double x, double y, double d[2][2])
{
	const double s = x * x + y * y, r = sqrt(s), t = lens->fisheye ? atan(r) : r;
	const double f = r > 0 ? t / r : 1;

	for (int i = 0; i < 2; i++) {
		const double a = i ? y : x;
		d[i][0] = a * f * t * t;
		d[i][1] = d[i][0] * t * t;
	}
}

static bool derive(const struct bb_bundle *b, const struct bb_lens *lens, const struct bb_rod *rod, unsigned marker,
                   double px[2], double jc[2][NC], double jr[2][NR])
{
	const struct bb_vec3 p = marker_of(b, rod, marker), q = bb_vec3_sub(p, lens->o);
	double jac[2][3], k[2][2], c[3];
	struct bb_vec3 e1, e2;

	if (!bb_lens_derive(lens, p, px, jac))
		return false;
	tangents(rod->u, &e1, &e2);
	for (int i = 0; i < 3; i++)
		c[i] = lens->r[i][0] * q.x + lens->r[i][1] * q.y + lens->r[i][2] * q.z;
	by_lens(lens, c[0] / c[2], c[1] / c[2], k);
	const double centre[2] = { lens->cx_px, lens->cy_px }, f = lens->fx_px, at = b->along_m[marker];
	for (int i = 0; i < 2; i++) {
		double a[3]; /* by the point in camera axes */
		for (int j = 0; j < 3; j++)
			a[j] = jac[i][0] * lens->r[j][0] + jac[i][1] * lens->r[j][1] + jac[i][2] * lens->r[j][2];
		jc[i][0] = (px[i] - centre[i]) / f;
		jc[i][1] = i == 0;
		jc[i][2] = i == 1;
		jc[i][3] = f * k[i][0];
		jc[i][4] = f * k[i][1];
		jc[i][5] = a[2] * c[1] - a[1] * c[2]; /* turn d: the point moves by d x c */
		jc[i][6] = a[0] * c[2] - a[2] * c[0];
		jc[i][7] = a[1] * c[0] - a[0] * c[1];
		for (int j = 0; j < 3; j++) {
			jc[i][8 + j] = -jac[i][j];
			jr[i][j] = jac[i][j];
		}
		jr[i][3] = at * (jac[i][0] * e1.x + jac[i][1] * e1.y + jac[i][2] * e1.z);
		jr[i][4] = at * (jac[i][0] * e2.x + jac[i][1] * e2.y + jac[i][2] * e2.z);
	}
	return true;
}

bool bb_bundle_derive(const struct bb_bundle *b, size_t camera, const struct bb_rod *rod, unsigned marker, double px[2],
                      double by_camera[2][NC], double by_rod[2][NR])
{
	struct bb_lens lens;

	return bb_lens_init(&lens, &b->cameras[camera]) && derive(b, &lens, rod, marker, px, by_camera, by_rod);
}

/* Cost */

static double loss(const struct bb_bundle *b, double square)
{
	const double c2 = b->cauchy_px * b->cauchy_px;

	return c2 > 0 ? c2 * log1p(square / c2) : square;
}

/* Deviation from the prior in its standard deviations, for the first five unknowns. */
static void prior_of(const struct bb_camera_config *c, const struct bb_camera_config *from, double sigma[5], double off[5])
{
	const double wide = 0.05 * (double)from->width_px;
	const double s[5] = { 0.1 * from->fx_px, wide, wide, 0.2, 0.2 };
	const double d[5] = { c->fx_px - from->fx_px, c->cx_px - from->cx_px, c->cy_px - from->cy_px, c->k1 - from->k1,
		              c->k2 - from->k2 };

	for (int i = 0; i < 5; i++) {
		sigma[i] = s[i];
		off[i] = d[i] / s[i];
	}
}

/* Whose lens camera i has: its own, or an earlier one's that hung elsewhere. */
static size_t lens_of(const struct bb_bundle *b, size_t i)
{
	return b->lens_of ? b->lens_of[i] : i;
}

/* The same for camera i of a bundle: pulled to its prior, or tied to the camera whose lens it has. */
static void pull_of(const struct bb_bundle *b, const struct bb_camera_config *cameras, size_t i, double sigma[5], double off[5])
{
	const size_t t = lens_of(b, i);

	prior_of(&cameras[i], t == i ? &b->prior[i] : &cameras[t], sigma, off);
	for (int k = 0; t != i && k < 5; k++) {
		sigma[k] *= TIE;
		off[k] /= TIE;
	}
}

static double prior_cost(const struct bb_bundle *b, const struct bb_camera_config *cameras)
{
	double sum = 0, sigma[5], off[5];

	for (size_t i = 0; i < b->n_cameras; i++) {
		pull_of(b, cameras, i, sigma, off);
		for (int k = 0; k < 5; k++)
			sum += off[k] * off[k];
	}
	return sum;
}

static bool set_lenses(struct bb_lens *lenses, const struct bb_camera_config *cameras, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (!bb_lens_init(&lenses[i], &cameras[i]))
			return false;
	return true;
}

/* INFINITY when a camera is none. */
static double cost_of(const struct bb_bundle *b, struct work *w, const struct bb_camera_config *cameras,
                      const struct bb_rod *rods)
{
	double sum = prior_cost(b, cameras), px[2];

	if (!set_lenses(w->lenses, cameras, b->n_cameras))
		return (double)INFINITY;
	for (size_t i = 0; i < b->n_obs; i++) {
		const struct bb_bundle_obs *o = &b->obs[i];
		double square = BLIND_PX * BLIND_PX;
		if (o->out)
			continue;
		if (bb_lens_project(&w->lenses[o->camera], marker_of(b, &rods[o->rod], o->marker), px))
			square = (px[0] - o->px[0]) * (px[0] - o->px[0]) + (px[1] - o->px[1]) * (px[1] - o->px[1]);
		sum += loss(b, square);
	}
	return sum;
}

/* Normal equations */

static void add_obs(const struct bb_bundle *b, struct work *w, const struct bb_bundle_obs *o, struct rod_block *rod,
                    struct link *link)
{
	double px[2], jc[2][NC], jr[2][NR];
	double (*u)[NC] = w->u[o->camera], *g = w->g[o->camera];

	if (!derive(b, &w->lenses[o->camera], &b->rods[o->rod], o->marker, px, jc, jr))
		return;
	const double off[2] = { o->px[0] - px[0], o->px[1] - px[1] };
	const double square = off[0] * off[0] + off[1] * off[1];
	const double weight = b->cauchy_px > 0 ? 1 / (1 + square / (b->cauchy_px * b->cauchy_px)) : 1;
	for (int k = 0; k < 2; k++) {
		for (int i = 0; i < NC; i++) {
			const double a = weight * jc[k][i];
			g[i] += a * off[k];
			for (int j = 0; j <= i; j++)
				u[i][j] += a * jc[k][j];
			for (int j = 0; j < NR; j++)
				link->w[i][j] += a * jr[k][j];
		}
		for (int i = 0; i < NR; i++) {
			const double a = weight * jr[k][i];
			rod->g[i] += a * off[k];
			for (int j = 0; j < NR; j++)
				rod->v[i][j] += a * jr[k][j];
		}
	}
}

/* Everything but the damping, at the bundle's own state. */
static void linearise(const struct bb_bundle *b, struct work *w)
{
	size_t n_links = 0;
	double sigma[5], off[5];

	set_lenses(w->lenses, b->cameras, b->n_cameras);
	memset(w->u, 0, b->n_cameras * sizeof(*w->u));
	memset(w->g, 0, b->n_cameras * sizeof(*w->g));
	memset(w->rods, 0, b->n_rods * sizeof(*w->rods));
	for (size_t i = 0; i < b->n_cameras; i++) {
		const size_t t = lens_of(b, i);
		pull_of(b, b->cameras, i, sigma, off);
		for (int k = 0; k < 5; k++) {
			w->u[i][k][k] += 1 / (sigma[k] * sigma[k]);
			w->g[i][k] -= off[k] / sigma[k];
			if (t == i)
				continue;
			w->u[t][k][k] += 1 / (sigma[k] * sigma[k]);
			w->g[t][k] += off[k] / sigma[k];
		}
	}
	for (size_t i = 0; i < b->n_obs; i++) {
		const struct bb_bundle_obs *o = &b->obs[i];
		struct rod_block *rod = &w->rods[o->rod];
		if (o->out)
			continue;
		if (!rod->n_links)
			rod->first_link = n_links;
		if (!rod->n_links || w->links[n_links - 1].camera != o->camera) {
			w->links[n_links] = (struct link){ .rod = o->rod, .camera = o->camera };
			n_links++;
			rod->n_links++;
		}
		add_obs(b, w, o, rod, &w->links[n_links - 1]);
	}
}

/* Inverse of a symmetric positive definite 5 x 5; false: it is not. */
static bool invert(const double a[NR][NR], double out[NR][NR])
{
	double l[NR][NR] = { { 0 } }, inv[NR][NR] = { { 0 } };

	for (int i = 0; i < NR; i++)
		for (int j = 0; j <= i; j++) {
			double sum = a[i][j];
			for (int k = 0; k < j; k++)
				sum -= l[i][k] * l[j][k];
			if (i == j && !(sum > 0))
				return false;
			l[i][j] = i == j ? sqrt(sum) : sum / l[j][j];
		}
	for (int i = 0; i < NR; i++) { /* of the triangle */
		inv[i][i] = 1 / l[i][i];
		for (int j = 0; j < i; j++) {
			double sum = 0;
			for (int k = j; k < i; k++)
				sum -= l[i][k] * inv[k][j];
			inv[i][j] = sum / l[i][i];
		}
	}
	for (int i = 0; i < NR; i++)
		for (int j = 0; j < NR; j++) {
			out[i][j] = 0;
			for (int k = i > j ? i : j; k < NR; k++)
				out[i][j] += inv[k][i] * inv[k][j];
		}
	return true;
}

/* One rod out of the system: S -= W V^-1 W^T, x -= W V^-1 g. */
static void eliminate(const struct bb_bundle *b, struct work *w, const struct rod_block *rod, const double inverse[NR][NR])
{
	const size_t n = b->n_cameras * NC;
	double y[NC][NR];

	for (size_t i = 0; i < rod->n_links; i++) {
		const struct link *a = &w->links[rod->first_link + i];
		for (int r = 0; r < NC; r++)
			for (int k = 0; k < NR; k++) {
				y[r][k] = 0;
				for (int j = 0; j < NR; j++)
					y[r][k] += a->w[r][j] * inverse[j][k];
			}
		for (int r = 0; r < NC; r++)
			for (int k = 0; k < NR; k++)
				w->x[a->camera * NC + (size_t)r] -= y[r][k] * rod->g[k];
		for (size_t j = 0; j <= i; j++) { /* links ascend by camera: this is the lower half */
			const struct link *c = &w->links[rod->first_link + j];
			double *to = &w->s[a->camera * NC * n + c->camera * NC];
			for (size_t r = 0; r < NC; r++)
				for (size_t q = 0; q < NC; q++)
					to[r * n + q] -= y[r][0] * c->w[q][0] + y[r][1] * c->w[q][1] + y[r][2] * c->w[q][2] +
					                 y[r][3] * c->w[q][3] + y[r][4] * c->w[q][4];
		}
	}
}

/* Cameras that share a lens: the lower half, since it is an earlier one's. */
static void tie(const struct bb_bundle *b, struct work *w)
{
	const size_t n = b->n_cameras * NC;
	double sigma[5], off[5];

	for (size_t i = 0; i < b->n_cameras; i++) {
		const size_t t = lens_of(b, i);
		pull_of(b, b->cameras, i, sigma, off);
		for (size_t k = 0; t != i && k < 5; k++)
			w->s[(i * NC + k) * n + t * NC + k] -= 1 / (sigma[k] * sigma[k]);
	}
}

/* A step from the linearised system under a damping, into try_cameras and try_rods; false: none. */
static bool step(const struct bb_bundle *b, struct work *w, double lambda)
{
	const size_t n = b->n_cameras * NC;
	double inverse[NR][NR], damped[NR][NR];

	memset(w->s, 0, n * n * sizeof(*w->s));
	for (size_t i = 0; i < b->n_cameras; i++)
		for (size_t r = 0; r < NC; r++) {
			for (size_t q = 0; q <= r; q++)
				w->s[(i * NC + r) * n + i * NC + q] = w->u[i][r][q];
			w->s[(i * NC + r) * (n + 1)] += lambda * w->u[i][r][r] + 1e-12;
			w->x[i * NC + r] = w->g[i][r];
		}
	tie(b, w);
	for (size_t i = 0; i < b->n_rods; i++) {
		struct rod_block *rod = &w->rods[i];
		memcpy(damped, rod->v, sizeof(damped));
		for (int k = 0; k < NR; k++)
			damped[k][k] += lambda * rod->v[k][k] + 1e-12;
		if (rod->n_links && !invert((const double(*)[NR])damped, inverse))
			return false;
		if (rod->n_links)
			eliminate(b, w, rod, (const double(*)[NR])inverse);
	}
	if (!bb_dense_solve(w->s, w->x, n))
		return false;
	for (size_t i = 0; i < b->n_cameras; i++) {
		w->try_cameras[i] = b->cameras[i];
		bb_bundle_move_camera(&w->try_cameras[i], &w->x[i * NC]);
	}
	for (size_t i = 0; i < b->n_rods; i++) {
		const struct rod_block *rod = &w->rods[i];
		double rest[NR], d[NR] = { 0 };
		memcpy(rest, rod->g, sizeof(rest));
		memcpy(damped, rod->v, sizeof(damped));
		for (int k = 0; k < NR; k++)
			damped[k][k] += lambda * rod->v[k][k] + 1e-12;
		for (size_t j = 0; j < rod->n_links; j++) {
			const struct link *a = &w->links[rod->first_link + j];
			for (int r = 0; r < NC; r++)
				for (int k = 0; k < NR; k++)
					rest[k] -= a->w[r][k] * w->x[a->camera * NC + (size_t)r];
		}
		if (rod->n_links && invert((const double(*)[NR])damped, inverse))
			for (int k = 0; k < NR; k++)
				for (int j = 0; j < NR; j++)
					d[k] += inverse[k][j] * rest[j];
		w->try_rods[i] = b->rods[i];
		bb_bundle_move_rod(&w->try_rods[i], d);
	}
	return true;
}

static void free_work(struct work *w)
{
	free(w->lenses);
	free(w->links);
	free(w->rods);
	free(w->u);
	free(w->g);
	free(w->s);
	free(w->x);
	free(w->try_cameras);
	free(w->try_rods);
}

static enum bb_status make_work(const struct bb_bundle *b, struct work *w)
{
	const size_t n = b->n_cameras * NC;

	*w = (struct work){ .lenses = calloc(b->n_cameras, sizeof(*w->lenses)),
		            .links = calloc(b->n_obs + 1, sizeof(*w->links)),
		            .rods = calloc(b->n_rods + 1, sizeof(*w->rods)),
		            .u = calloc(b->n_cameras, sizeof(*w->u)),
		            .g = calloc(b->n_cameras, sizeof(*w->g)),
		            .s = calloc(n * n, sizeof(*w->s)),
		            .x = calloc(n, sizeof(*w->x)),
		            .try_cameras = calloc(b->n_cameras, sizeof(*w->try_cameras)),
		            .try_rods = calloc(b->n_rods + 1, sizeof(*w->try_rods)) };
	return w->lenses && w->links && w->rods && w->u && w->g && w->s && w->x && w->try_cameras && w->try_rods ?
		       BB_OK :
		       BB_ERR_NOMEM;
}

/* One accepted step; false: none is left to take. */
static bool improve(struct bb_bundle *b, struct work *w, double *lambda)
{
	linearise(b, w);
	while (*lambda < LAMBDA_MOST) {
		const double cost = step(b, w, *lambda) ? cost_of(b, w, w->try_cameras, w->try_rods) : (double)INFINITY;
		if (!(cost < b->cost)) {
			*lambda *= 8;
			continue;
		}
		memcpy(b->cameras, w->try_cameras, b->n_cameras * sizeof(*b->cameras));
		memcpy(b->rods, w->try_rods, b->n_rods * sizeof(*b->rods));
		b->cost = cost;
		*lambda = fmax(*lambda / 5, 1e-9);
		return true;
	}
	return false;
}

enum bb_status bb_bundle_run(struct bb_bundle *b, unsigned most_steps, double tolerance)
{
	struct work w;
	double lambda = 1e-4;
	enum bb_status status = make_work(b, &w);

	b->steps = 0;
	if (!status)
		b->cost = cost_of(b, &w, b->cameras, b->rods);
	if (!status && !isfinite(b->cost))
		status = BB_ERR_CONFIG;
	while (!status && b->steps < most_steps) {
		const double before = b->cost;
		if (!improve(b, &w, &lambda))
			break;
		b->steps++;
		if (before - b->cost < tolerance * before)
			break;
	}
	free_work(&w);
	return status;
}

enum bb_status bb_bundle_residuals(struct bb_bundle *b)
{
	struct bb_lens *lenses = calloc(b->n_cameras, sizeof(*lenses));
	double px[2];

	if (!lenses)
		return BB_ERR_NOMEM;
	if (!set_lenses(lenses, b->cameras, b->n_cameras)) {
		free(lenses);
		return BB_ERR_CONFIG;
	}
	for (size_t i = 0; i < b->n_obs; i++) {
		struct bb_bundle_obs *o = &b->obs[i];
		const bool seen = bb_lens_project(&lenses[o->camera], marker_of(b, &b->rods[o->rod], o->marker), px);
		for (int k = 0; k < 2; k++)
			o->off_px[k] = seen ? (float)(o->px[k] - px[k]) : NAN;
	}
	free(lenses);
	return BB_OK;
}
