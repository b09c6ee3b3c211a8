#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sync/coverage/coverage_private.h"
#include "sync/track/triangulate.h"

#define LEAST_NOISE_PX 1e-3 /* a simulated camera of fidelity 0 has none at all */
#define PI 3.14159265358979323846

/* ---- one camera, one point ---- */

/* A wall hides what lies on its other side, as seen through its own rectangle. */
static bool through_wall(const struct bb_corners *w, struct bb_vec3 a, struct bb_vec3 b)
{
	const struct bb_vec3 right = bb_vec3_sub(w->lower_right, w->lower_left);
	const struct bb_vec3 up = bb_vec3_sub(w->upper_left, w->lower_left), n = bb_vec3_cross(right, up);
	const double da = bb_vec3_dot(bb_vec3_sub(a, w->lower_left), n);
	const double db = bb_vec3_dot(bb_vec3_sub(b, w->lower_left), n);

	if (!((da > 0 && db < 0) || (da < 0 && db > 0)))
		return false;
	const struct bb_vec3 hit = bb_vec3_sub(bb_vec3_lerp(a, b, da / (da - db)), w->lower_left);
	const double rr = bb_vec3_dot(right, right), uu = bb_vec3_dot(up, up), ru = bb_vec3_dot(right, up);
	const double hr = bb_vec3_dot(hit, right), hu = bb_vec3_dot(hit, up), det = rr * uu - ru * ru;
	const double s = (hr * uu - hu * ru) / det, t = (hu * rr - hr * ru) / det;
	return s >= 0 && s <= 1 && t >= 0 && t <= 1;
}

static bool walls_hide(const struct bb_room *room, struct bb_vec3 a, struct bb_vec3 b)
{
	for (size_t i = 0; i < room->n_walls; i++)
		if (through_wall(&room->walls[i].corners, a, b))
			return true;
	return false;
}

bool bb_coverage_eye_init(struct bb_coverage_eye *e, const struct bb_camera_config *camera, double noise_px)
{
	e->focal_px = fmin(camera->fx_px, camera->fy_px);
	e->sigma_px = fmax(noise_px > 0 ? noise_px : camera->noise_px, LEAST_NOISE_PX);
	return bb_lens_init(&e->lens, camera);
}

static bool in_picture(const struct bb_lens *l, const double px[2])
{
	return px[0] >= -0.5 && px[1] >= -0.5 && px[0] < l->width_px - 0.5 && px[1] < l->height_px - 0.5;
}

bool bb_coverage_sees(const struct bb_coverage *c, const struct bb_coverage_eye *e, struct bb_vec3 p,
		      struct bb_coverage_sight *out)
{
	const struct bb_coverage_config *k = &c->config;
	const struct bb_vec3 v = bb_vec3_sub(e->lens.o, p);
	double px[2], j[2][3];

	out->distance_m = bb_vec3_norm(v);
	if (!(out->distance_m >= k->near_m && out->distance_m <= k->far_m) ||
	    e->focal_px * k->marker_m < k->least_px * out->distance_m)
		return false;
	if (!bb_lens_project(&e->lens, p, px) || !in_picture(&e->lens, px) || walls_hide(k->room, e->lens.o, p) ||
	    !bb_lens_derive(&e->lens, p, px, j))
		return false;
	const double w = 1 / (e->sigma_px * e->sigma_px);
	for (int a = 0, i = 0; a < 3; a++)
		for (int b = a; b < 3; b++, i++)
			out->info[i] = w * (j[0][a] * j[0][b] + j[1][a] * j[1][b]);
	out->to = bb_vec3_scale(v, 1 / out->distance_m);
	return true;
}

/* ---- from information to error ---- */

/* Least eigenvalue of a symmetric matrix, by the cosine of a third of an angle (Smith 1961). */
static double least_eigenvalue(const double m[6])
{
	const double q = (m[0] + m[3] + m[5]) / 3, a = m[0] - q, b = m[3] - q, d = m[5] - q;
	const double off = m[1] * m[1] + m[2] * m[2] + m[4] * m[4];
	const double p = sqrt((a * a + b * b + d * d + 2 * off) / 6);

	if (!(p > 0))
		return q;
	const double det = a * (b * d - m[4] * m[4]) - m[1] * (m[1] * d - m[4] * m[2]) + m[2] * (m[1] * m[4] - b * m[2]);
	const double r = fmin(fmax(det / (2 * p * p * p), -1), 1);
	return q + 2 * p * cos(acos(r) / 3 + 2 * PI / 3);
}

bool bb_coverage_error(const double m[6], double *error_m, double *worst_m, double c[6])
{
	c[0] = m[3] * m[5] - m[4] * m[4];
	c[1] = m[2] * m[4] - m[1] * m[5];
	c[2] = m[1] * m[4] - m[2] * m[3];
	c[3] = m[0] * m[5] - m[2] * m[2];
	c[4] = m[1] * m[2] - m[0] * m[4];
	c[5] = m[0] * m[3] - m[1] * m[1];
	const double det = m[0] * c[0] + m[1] * c[1] + m[2] * c[2], least = least_eigenvalue(m);
	if (!(det > 0) || !(least > 0))
		return false;
	for (int i = 0; i < 6; i++)
		c[i] /= det;
	*error_m = sqrt(c[0] + c[3] + c[5]);
	*worst_m = 1 / sqrt(least);
	return isfinite(*error_m) && isfinite(*worst_m);
}

/* ---- one point, all cameras ---- */

struct seen {
	size_t n;
	uint16_t camera[BB_COVERAGE_CAMERAS_MAX];
	struct bb_coverage_sight sight[BB_COVERAGE_CAMERAS_MAX];
};

struct mask { /* of what a struct seen holds */
	uint64_t bits[BB_COVERAGE_CAMERAS_MAX / 64];
};

static bool has(const struct mask *m, size_t i)
{
	return m->bits[i / 64] >> (i % 64) & 1;
}

static void see(const struct bb_coverage *c, struct bb_vec3 p, struct seen *s)
{
	s->n = 0;
	for (size_t i = 0; i < c->config.n_cameras; i++)
		if (bb_coverage_sees(c, &c->eyes[i], p, &s->sight[s->n]))
			s->camera[s->n++] = (uint16_t)i;
}

/* heading < 0: nobody stands there. Returns how many are left. */
static size_t mask_of(const struct bb_coverage *c, const struct seen *s, int heading, struct mask *m)
{
	size_t n = 0;

	memset(m, 0, sizeof(*m));
	for (size_t i = 0; i < s->n; i++) {
		if (heading >= 0 && bb_viewer_hides(&c->config.viewer, c->head[heading], &s->sight[i]))
			continue;
		m->bits[i / 64] |= UINT64_C(1) << (i % 64);
		n++;
	}
	return n;
}

static bool any_angle(const struct seen *s, const struct mask *m)
{
	for (size_t i = 0; i < s->n; i++)
		for (size_t j = i + 1; has(m, i) && j < s->n; j++) {
			const struct bb_vec3 x = bb_vec3_cross(s->sight[i].to, s->sight[j].to);
			if (has(m, j) && bb_vec3_dot(x, x) > BB_RAY_ANGLE_MIN_RAD * BB_RAY_ANGLE_MIN_RAD)
				return true;
		}
	return false;
}

static bool place(const struct seen *s, const struct mask *m, double *error_m, double *worst_m, double covariance_m2[6])
{
	double info[6] = { 0 };

	if (!any_angle(s, m))
		return false;
	for (size_t i = 0; i < s->n; i++)
		for (int k = 0; has(m, i) && k < 6; k++)
			info[k] += s->sight[i].info[k];
	return bb_coverage_error(info, error_m, worst_m, covariance_m2);
}

struct turn { /* sums over headings */
	double n, least_n, error2, worst2, most_error, most_worst;
	unsigned placed;
};

static void turn_round(const struct bb_coverage *c, const struct seen *s, struct turn *t)
{
	struct mask before = { { 0 } }, m;
	double error_m = 0, worst_m = 0, covariance_m2[6];
	bool placed = false;

	*t = (struct turn){ .least_n = (double)s->n };
	for (unsigned h = 0; h < c->config.headings; h++) {
		const double n = (double)mask_of(c, s, (int)h, &m);
		if (!h || memcmp(&m, &before, sizeof(m)) != 0) /* neighbours mostly agree */
			placed = place(s, &m, &error_m, &worst_m, covariance_m2);
		before = m;
		t->n += n;
		t->least_n = fmin(t->least_n, n);
		if (!placed)
			continue;
		t->placed++;
		t->error2 += error_m * error_m;
		t->worst2 += worst_m * worst_m;
		t->most_error = fmax(t->most_error, error_m);
		t->most_worst = fmax(t->most_worst, worst_m);
	}
}

void bb_coverage_at(const struct bb_coverage *c, struct bb_vec3 p, struct bb_coverage_voxel *out)
{
	const unsigned headings = c->config.headings;
	double error_m, worst_m, covariance_m2[6];
	struct seen s;
	struct mask m;
	struct turn t;

	*out = (struct bb_coverage_voxel){ .inside = bb_room_contains(c->config.room, p, 0) };
	if (!out->inside)
		return;
	see(c, p, &s);
	out->n[BB_COVERAGE_NONE] = (float)mask_of(c, &s, -1, &m);
	const bool placed = place(&s, &m, &error_m, &worst_m, covariance_m2);
	out->error_m[BB_COVERAGE_NONE] = placed ? (float)error_m : INFINITY;
	out->worst_m[BB_COVERAGE_NONE] = placed ? (float)worst_m : INFINITY;
	turn_round(c, &s, &t);
	out->lost = (float)(headings - t.placed) / (float)headings;
	out->n[BB_COVERAGE_MEAN] = (float)(t.n / headings);
	out->n[BB_COVERAGE_WORST] = (float)t.least_n;
	out->error_m[BB_COVERAGE_MEAN] = t.placed ? (float)sqrt(t.error2 / t.placed) : INFINITY;
	out->worst_m[BB_COVERAGE_MEAN] = t.placed ? (float)sqrt(t.worst2 / t.placed) : INFINITY;
	out->error_m[BB_COVERAGE_WORST] = t.placed == headings ? (float)t.most_error : INFINITY;
	out->worst_m[BB_COVERAGE_WORST] = t.placed == headings ? (float)t.most_worst : INFINITY;
}

void bb_coverage_look(const struct bb_coverage *c, struct bb_vec3 p, int heading, struct bb_coverage_look *out)
{
	struct seen s;
	struct mask m;

	see(c, p, &s);
	mask_of(c, &s, heading, &m);
	out->n = 0;
	for (size_t i = 0; i < s.n; i++)
		if (has(&m, i))
			out->camera[out->n++] = s.camera[i];
	out->placed = place(&s, &m, &out->error_m, &out->worst_m, out->covariance_m2);
}

/* ---- the whole ---- */

static bool within(double v, double least, double most)
{
	return v >= least && v <= most;
}

static bool usable(const struct bb_coverage_config *k)
{
	const struct bb_viewer_shape *v = &k->viewer;

	return k->headings >= 1 && k->headings <= BB_COVERAGE_HEADINGS_MAX && k->n_cameras <= BB_COVERAGE_CAMERAS_MAX &&
	       within(k->marker_m, 1e-4, 1) && within(k->least_px, 0, 1000) && within(k->near_m, 0, 100) &&
	       within(k->far_m, k->near_m, 1000) && within(k->noise_px, 0, 100) && within(bb_vec3_norm(v->head), 0, 2) &&
	       within(v->head_radius_m, 0, 2) && within(v->torso_radius_m, 0, 2) && within(v->torso_top_m, 0, 3) &&
	       within(v->torso_bottom_m, v->torso_top_m, 3);
}

enum bb_status bb_coverage_create(const struct bb_coverage_config *config, struct bb_coverage **out, size_t *bad)
{
	*out = NULL;
	*bad = config->n_cameras;
	if (!usable(config))
		return BB_ERR_CONFIG;
	struct bb_coverage *c = calloc(1, sizeof(*c));
	if (c)
		c->eyes = calloc(config->n_cameras + 1, sizeof(*c->eyes));
	if (!c || !c->eyes) {
		bb_coverage_destroy(c);
		return BB_ERR_NOMEM;
	}
	c->config = *config;
	for (unsigned h = 0; h < config->headings; h++) {
		const struct bb_quat turn = bb_quat_euler_deg(360.0 * h / config->headings, 0, 0);
		c->head[h] = bb_quat_rotate(turn, config->viewer.head);
	}
	for (size_t i = 0; i < config->n_cameras; i++)
		if (!bb_coverage_eye_init(&c->eyes[i], &config->cameras[i], config->noise_px)) {
			*bad = i;
			bb_coverage_destroy(c);
			return BB_ERR_CONFIG;
		}
	*out = c;
	return BB_OK;
}

void bb_coverage_destroy(struct bb_coverage *c)
{
	if (!c)
		return;
	free(c->eyes);
	free(c);
}

/* ---- grids ---- */

bool bb_coverage_grid_over(struct bb_vec3 min, struct bb_vec3 max, double step_m, struct bb_coverage_grid *out)
{
	const double low[3] = { min.x, min.y, min.z }, high[3] = { max.x, max.y, max.z };
	double start[3], all = 1;

	if (!(step_m > 0) || !isfinite(step_m))
		return false;
	for (int a = 0; a < 3; a++) {
		const double n = ceil((high[a] - low[a]) / step_m - 1e-6); /* 3 m are 60 cubes of 5 cm, not 61 */
		all *= n;
		if (!(n >= 1) || !(all <= BB_COVERAGE_VOXELS_MAX))
			return false;
		out->n[a] = (size_t)n;
		start[a] = (low[a] + high[a]) / 2 - n * step_m / 2;
	}
	out->min = (struct bb_vec3){ start[0], start[1], start[2] };
	out->step_m = step_m;
	return true;
}

size_t bb_coverage_rows(const struct bb_coverage_grid *g)
{
	return g->n[1] * g->n[2];
}

struct bb_vec3 bb_coverage_centre(const struct bb_coverage_grid *g, size_t x, size_t y, size_t z)
{
	return (struct bb_vec3){ g->min.x + ((double)x + 0.5) * g->step_m, g->min.y + ((double)y + 0.5) * g->step_m,
				 g->min.z + ((double)z + 0.5) * g->step_m };
}

void bb_coverage_row(const struct bb_coverage *c, const struct bb_coverage_grid *g, size_t row,
		     struct bb_coverage_voxel *out)
{
	for (size_t x = 0; x < g->n[0]; x++)
		bb_coverage_at(c, bb_coverage_centre(g, x, row / g->n[2], row % g->n[2]), &out[x]);
}
