#include "sync/track/polish.h"

#include <math.h>
#include <string.h>

#include "sync/track/linalg.h"
#include "sync/track/rigid.h"

#define DONE 1e-6       /* a step of a thousandth of a sigma changes nothing */
#define LINE_RATIO 0.05 /* least over middle rotational information: below, the markers lie on a line */

struct normal { /* weighted normal equations at one pose, in units of sigma */
	double n[6][6], g[6], cost, chi2, chi2_own;
};

static void add_row(struct normal *eq, const double j[6], double residual, double w)
{
	for (int r = 0; r < 6; r++) {
		const double wj = w * j[r];
		for (int c = 0; c <= r; c++)
			eq->n[r][c] += wj * j[c];
		eq->g[r] += wj * residual;
	}
}

/* Marker positions relative to the pivot, in room axes. */
static void spread(const struct bb_polish *p, const struct bb_pose *pose, struct bb_vec3 arm[8], size_t n)
{
	for (size_t i = 0; i < n; i++)
		arm[i] = bb_quat_rotate(pose->q, bb_vec3_sub(p->markers[i], p->centroid));
}

struct seen { /* an observation at one pose, px */
	double r[2], row[2][6];
};

static bool look(const struct bb_polish *p, const struct bb_track_obs *o, struct bb_vec3 pivot, struct bb_vec3 arm,
		 struct seen *s)
{
	const struct bb_vec3 moved =
		bb_vec3_scale(bb_vec3_add(p->velocity, bb_vec3_cross(p->spin, arm)), (double)o->dt_s);
	double px[2], jac[2][3];

	if (!bb_lens_derive(&p->lenses[o->camera], bb_vec3_add(bb_vec3_add(pivot, arm), moved), px, jac))
		return false;
	s->r[0] = o->x_px - px[0];
	s->r[1] = o->y_px - px[1];
	for (int k = 0; k < 2; k++) {
		const double a = jac[k][0], b = jac[k][1], c = jac[k][2];
		/* a rotation by t moves the point by t x arm; its row is arm x (a, b, c) */
		const double row[6] = { arm.y * c - arm.z * b, arm.z * a - arm.x * c, arm.x * b - arm.y * a, a, b, c };
		memcpy(s->row[k], row, sizeof(row));
	}
	return true;
}

/* One over the variance of an observation's coordinates, px^-2. */
static double weight_of(const struct bb_polish *p, const struct bb_track_obs *o)
{
	const double sigma_px = p->sigma_px * (o->worse > 0 ? o->worse : 1);

	return 1 / (sigma_px * sigma_px);
}

static bool add_obs(const struct bb_polish *p, const struct bb_track_obs *o, struct bb_vec3 pivot, struct bb_vec3 arm,
		    struct normal *eq)
{
	struct seen s;

	if (!look(p, o, pivot, arm, &s))
		return false;
	const double weight = weight_of(p, o), px2 = s.r[0] * s.r[0] + s.r[1] * s.r[1], r2 = px2 * weight;
	const double h2 = p->huber_px * p->huber_px * weight;
	const bool far = h2 > 0 && r2 > h2;
	const double w = far ? sqrt(h2 / r2) : 1;

	eq->chi2 += px2 / (p->sigma_px * p->sigma_px);
	eq->chi2_own += r2;
	eq->cost += far ? 2 * sqrt(h2 * r2) - h2 : r2;
	for (int k = 0; k < 2; k++)
		add_row(eq, s.row[k], s.r[k], w * weight);
	return true;
}

bool bb_polish_residual(const struct bb_polish *p, const struct bb_track_obs *o, double *square_px2, double *left)
{
	const struct bb_vec3 arm = bb_quat_rotate(p->pose.q, bb_vec3_sub(p->markers[o->marker], p->centroid));
	struct seen s;

	if (!look(p, o, bb_pose_apply(&p->pose, p->centroid), arm, &s))
		return false;
	*square_px2 = s.r[0] * s.r[0] + s.r[1] * s.r[1];
	*left = 2;
	for (int k = 0; k < 2; k++)
		for (int a = 0; a < 6; a++)
			for (int b = 0; b < 6; b++)
				*left -= weight_of(p, o) * s.row[k][a] * p->covariance[a][b] * s.row[k][b];
	return true;
}

static bool evaluate(const struct bb_polish *p, const struct bb_pose *pose, size_t n_markers, struct normal *eq)
{
	const struct bb_vec3 pivot = bb_pose_apply(pose, p->centroid);
	struct bb_vec3 arm[8];

	memset(eq, 0, sizeof(*eq));
	spread(p, pose, arm, n_markers);
	for (size_t i = 0; i < p->n_obs; i++)
		if (!add_obs(p, &p->obs[i], pivot, arm[p->obs[i].marker], eq))
			return false;
	for (int r = 0; r < 6; r++)
		for (int c = r + 1; c < 6; c++)
			eq->n[r][c] = eq->n[c][r];
	return isfinite(eq->cost);
}

/* Information about the rotation alone, the position having been solved for: S = Nrr - Nrt Ntt^-1 Ntr. */
static bool rotation_information(const double n[6][6], double s[9])
{
	double padded[6][6] = { { 0 } };

	for (int r = 0; r < 3; r++) {
		for (int c = 0; c < 3; c++)
			padded[r][c] = n[3 + r][3 + c];
		padded[3 + r][3 + r] = 1;
	}
	if (!bb_chol6_factor(padded))
		return false;
	for (int c = 0; c < 3; c++) {
		double b[6] = { n[3][c], n[4][c], n[5][c], 0, 0, 0 }, x[6];
		bb_chol6_solve(padded, b, x);
		for (int r = 0; r < 3; r++)
			s[r * 3 + c] = n[r][c] - (n[r][3] * x[0] + n[r][4] * x[1] + n[r][5] * x[2]);
	}
	return true;
}

/* Markers on a line say nothing about the roll about it: make that direction stiff, so that no step turns it. */
static bool hold_roll(struct bb_polish *p, struct normal *eq)
{
	double s[9], values[3], v[9];

	if (!rotation_information(eq->n, s))
		return false;
	for (int r = 0; r < 3; r++)
		for (int c = 0; c < r; c++)
			s[r * 3 + c] = s[c * 3 + r] = 0.5 * (s[r * 3 + c] + s[c * 3 + r]);
	bb_sym_eigen(3, s, values, v);
	p->roll_sigma_rad = values[2] > 0 ? fmin(1 / sqrt(values[2]), 1.8) : 1.8;
	p->roll_axis = (struct bb_vec3){ v[2], v[5], v[8] };
	p->roll_held = p->roll_sigma_rad > BB_ROLL_SIGMA_MAX_RAD && values[2] < LINE_RATIO * values[1];
	for (int r = 0; p->roll_held && r < 3; r++) {
		for (int c = 0; c < 3; c++)
			eq->n[r][c] += 1e6 * values[0] * v[r * 3 + 2] * v[c * 3 + 2];
	}
	return true;
}

static struct bb_pose step_from(const struct bb_polish *p, const double d[6])
{
	const struct bb_vec3 pivot =
		bb_vec3_add(bb_pose_apply(&p->pose, p->centroid), (struct bb_vec3){ d[3], d[4], d[5] });
	struct bb_pose next;

	next.q = bb_quat_unit(bb_quat_mul(bb_quat_exp((struct bb_vec3){ d[0], d[1], d[2] }), p->pose.q));
	next.p = bb_vec3_sub(pivot, bb_quat_rotate(next.q, p->centroid));
	return next;
}

static bool damped_step(const struct normal *eq, double damping, double d[6])
{
	double l[6][6];

	memcpy(l, eq->n, sizeof(l));
	for (int i = 0; i < 6; i++)
		l[i][i] *= 1 + damping;
	if (!bb_chol6_factor(l))
		return false;
	bb_chol6_solve(l, eq->g, d);
	return true;
}

static bool finish(struct bb_polish *p, const struct normal *eq)
{
	double l[6][6];

	memcpy(l, eq->n, sizeof(l));
	if (!bb_chol6_factor(l))
		return false;
	bb_chol6_inverse(l, p->covariance);
	p->chi2 = eq->chi2;
	p->chi2_own = eq->chi2_own;
	return true;
}

static size_t markers_named(const struct bb_polish *p)
{
	size_t n = 0;

	for (size_t i = 0; i < p->n_obs; i++)
		if (p->obs[i].marker >= n)
			n = p->obs[i].marker + 1u;
	return n;
}

bool bb_polish_run(struct bb_polish *p, int most_steps)
{
	const size_t n_markers = markers_named(p);
	struct normal eq, trial;
	double damping = 0;

	if (n_markers > 8 || !evaluate(p, &p->pose, n_markers, &eq) || !hold_roll(p, &eq))
		return false;
	for (int step = 0; step < most_steps; step++) {
		double d[6], gain = 0;
		if (!damped_step(&eq, damping, d)) {
			damping = fmax(10 * damping, 1e-4);
			continue;
		}
		const struct bb_pose next = step_from(p, d);
		for (int i = 0; i < 6; i++)
			gain += d[i] * eq.g[i];
		if (gain < DONE) { /* too short to be worth a look at where it ends */
			p->pose = next;
			break;
		}
		if (!evaluate(p, &next, n_markers, &trial) || trial.cost > eq.cost) {
			damping = fmax(10 * damping, 1e-4);
			continue;
		}
		p->pose = next;
		eq = trial;
		damping *= 0.1;
		if (!hold_roll(p, &eq))
			return false;
	}
	return finish(p, &eq);
}
