#include "sync/track/filter.h"

#include <math.h>
#include <string.h>

#include "sync/track/linalg.h"

/* Spectral densities of the acceleration to begin with, 2 a^2 tau: a walking head; and how far they may go from there,
 * somebody who stands still and somebody who shakes the head. */
#define ACCEL_RAD2_S3 1.0
#define ACCEL_M2_S3 0.05
#define DENSITY_RANGE 300.0
#define HORIZON_S 0.04
#define HORIZON_LEAST_S 0.01
#define LEARN_S 0.4   /* about so long until the densities are those of another gait */
#define SURPRISE 9.0  /* one wild prediction counts for no more than three sigmas */
#define START_SPEED_M_S 1.0
#define START_RATE_RAD_S 2.0

double bb_seconds_between(int64_t a_ns, int64_t b_ns)
{
	int64_t d;

	if (__builtin_sub_overflow(a_ns, b_ns, &d))
		return a_ns > b_ns ? 9.3e9 : -9.3e9;
	return 1e-9 * (double)d;
}

static double sum3(const double m[6][6], int from)
{
	return m[from][from] + m[from + 1][from + 1] + m[from + 2][from + 2];
}

/* Pose covariance after dt. That errors of rotation turn with the body (by w dt, a few degrees) is left out. */
static void carry_pose(const struct bb_filter *f, double dt, double out[6][6])
{
	const double t = fabs(dt); /* backwards is as uncertain as forwards */

	for (int r = 0; r < 6; r++) {
		for (int c = 0; c < 6; c++)
			out[r][c] = f->pose[r][c] + dt * (f->cross[r][c] + f->cross[c][r]) + dt * dt * f->rate[r][c];
		out[r][r] += f->density[r / 3] * t * t * t / 3;
	}
}

struct bb_filter_state bb_filter_predict(const struct bb_filter *f, double dt_s)
{
	struct bb_filter_state s;

	s.v = f->v;
	s.w = f->w;
	s.p = bb_vec3_add(f->p, bb_vec3_scale(f->v, dt_s));
	s.q = bb_quat_unit(bb_quat_mul(bb_quat_exp(bb_vec3_scale(f->w, dt_s)), f->q));
	carry_pose(f, dt_s, s.covariance);
	/* Beyond the horizon of learn() errors go with t^2 rather than t^1.5: a person's acceleration lasts. */
	const double t = fabs(dt_s), lasting = fmax(t / HORIZON_S - 1, 0);
	for (int i = 0; i < 6; i++)
		s.covariance[i][i] += lasting * f->density[i / 3] * t * t * t / 3;
	s.angle_sigma_rad = sqrt(fmax(sum3(s.covariance, 0), 0));
	s.position_sigma_m = sqrt(fmax(sum3(s.covariance, 3), 0));
	return s;
}

void bb_filter_start(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q,
		     const double covariance[6][6])
{
	*f = (struct bb_filter){
		.live = true, .at_ns = at_ns, .p = p, .q = q, .density = { ACCEL_RAD2_S3, ACCEL_M2_S3 }
	};
	memcpy(f->pose, covariance, sizeof(f->pose));
	for (int i = 0; i < 6; i++)
		f->rate[i][i] = i < 3 ? START_RATE_RAD_S * START_RATE_RAD_S : START_SPEED_M_S * START_SPEED_M_S;
}

static void carry(struct bb_filter *f, double dt)
{
	double pose[6][6];

	carry_pose(f, dt, pose);
	memcpy(f->pose, pose, sizeof(pose));
	for (int r = 0; r < 6; r++) {
		for (int c = 0; c < 6; c++)
			f->cross[r][c] += dt * f->rate[r][c];
		f->cross[r][r] += f->density[r / 3] * dt * dt / 2;
		f->rate[r][r] += f->density[r / 3] * dt;
	}
}

/* The Kalman update by an innovation of covariance s; change is that of (rotation, position), then of their rates. */
static bool correct(struct bb_filter *f, const double s[6][6], const double innovation[6], double change[12])
{
	double l[6][6], inverse[6][6], gain[12][6], before[12][6];

	memcpy(l, s, sizeof(l));
	if (!bb_chol6_factor(l))
		return false;
	bb_chol6_inverse((const double(*)[6])l, inverse);
	for (int r = 0; r < 6; r++)
		for (int c = 0; c < 6; c++) {
			before[r][c] = f->pose[r][c];
			before[6 + r][c] = f->cross[c][r];
		}
	memset(change, 0, 12 * sizeof(*change));
	f->innovation2 = 0;
	for (int r = 0; r < 12; r++)
		for (int c = 0; c < 6; c++) {
			gain[r][c] = 0;
			for (int k = 0; k < 6; k++)
				gain[r][c] += before[r][k] * inverse[k][c];
			change[r] += gain[r][c] * innovation[c];
		}
	for (int r = 0; r < 6; r++)
		for (int c = 0; c < 6; c++) {
			f->innovation2 += innovation[r] * inverse[r][c] * innovation[c];
			for (int k = 0; k < 6; k++) {
				f->pose[r][c] -= gain[r][k] * before[c][k];
				f->cross[r][c] -= gain[r][k] * before[6 + c][k];
				f->rate[r][c] -= gain[6 + r][k] * before[6 + c][k];
			}
		}
	for (int r = 0; r < 6; r++) /* rounding must not build up a skew part */
		for (int c = 0; c < r; c++) {
			f->pose[r][c] = f->pose[c][r];
			f->rate[r][c] = f->rate[c][r];
		}
	return true;
}

static double clamp(double v, double low, double high)
{
	return fmin(fmax(v, low), high);
}

static const struct bb_filter_past *remembered(const struct bb_filter *f, int64_t at_ns)
{
	const struct bb_filter_past *best = NULL;
	double off = HORIZON_S;

	for (unsigned i = 0; i < BB_FILTER_PAST && i < f->n_past; i++) {
		const double age = bb_seconds_between(at_ns, f->past[i].at_ns);
		if (age >= HORIZON_LEAST_S && fabs(age - HORIZON_S) < off) {
			off = fabs(age - HORIZON_S);
			best = &f->past[i];
		}
	}
	return best;
}

/* Stated against found: what was predicted a path's length ago for now, and what is measured now. A density that makes
 * the two agree on average makes the covariance honest where it is used, though accelerations are anything but white. */
static void learn(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q, double dt,
		  const double covariance[6][6])
{
	static const double usual[2] = { ACCEL_RAD2_S3, ACCEL_M2_S3 };
	const struct bb_filter_past *b = remembered(f, at_ns);

	if (!b)
		return;
	const double t = bb_seconds_between(at_ns, b->at_ns);
	const struct bb_quat turned = bb_quat_mul(bb_quat_exp(bb_vec3_scale(b->w, t)), b->q);
	const struct bb_vec3 off[2] = { bb_quat_log(bb_quat_mul(q, bb_quat_conj(turned))),
					bb_vec3_sub(p, bb_vec3_add(b->p, bb_vec3_scale(b->v, t))) };
	for (int k = 0; k < 2; k++) {
		const double stated = b->pose[k] + 2 * t * b->cross[k] + t * t * b->rate[k] +
				      b->density[k] * t * t * t + sum3(covariance, 3 * k);
		const double ratio = fmin(bb_vec3_dot(off[k], off[k]) / stated, SURPRISE);
		const double step = clamp(dt / LEARN_S, 0, 0.2) * (ratio - 1);
		f->density[k] = clamp(f->density[k] * exp(step), usual[k] / DENSITY_RANGE, usual[k] * DENSITY_RANGE);
	}
}

static void remember(struct bb_filter *f)
{
	struct bb_filter_past *b = &f->past[f->n_past++ % BB_FILTER_PAST];

	*b = (struct bb_filter_past){ .at_ns = f->at_ns, .p = f->p, .v = f->v, .w = f->w, .q = f->q };
	for (int k = 0; k < 2; k++) {
		b->pose[k] = sum3((const double(*)[6])f->pose, 3 * k);
		b->cross[k] = sum3((const double(*)[6])f->cross, 3 * k);
		b->rate[k] = sum3((const double(*)[6])f->rate, 3 * k);
		b->density[k] = f->density[k];
	}
}

static struct bb_vec3 without(struct bb_vec3 v, struct bb_vec3 axis)
{
	return bb_vec3_sub(v, bb_vec3_scale(axis, bb_vec3_dot(v, axis)));
}

void bb_filter_update(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q,
		      const double covariance[6][6], struct bb_vec3 hold)
{
	const double dt = bb_seconds_between(at_ns, f->at_ns);
	const struct bb_filter_state s = bb_filter_predict(f, dt);
	const struct bb_vec3 turn = bb_quat_log(bb_quat_mul(q, bb_quat_conj(s.q))), off = bb_vec3_sub(p, s.p);
	const double innovation[6] = { turn.x, turn.y, turn.z, off.x, off.y, off.z };
	double both[6][6], d[12];

	learn(f, at_ns, p, q, dt, covariance);
	carry(f, dt);
	for (int r = 0; r < 6; r++)
		for (int c = 0; c < 6; c++)
			both[r][c] = f->pose[r][c] + covariance[r][c] + (r == c ? 1e-16 : 0);
	if (!correct(f, (const double(*)[6])both, innovation, d)) {
		bb_filter_start(f, at_ns, p, q, covariance); /* no covariance any more: begin again */
		return;
	}
	f->at_ns = at_ns;
	f->q = bb_quat_unit(bb_quat_mul(bb_quat_exp((struct bb_vec3){ d[0], d[1], d[2] }), s.q));
	f->p = bb_vec3_add(s.p, (struct bb_vec3){ d[3], d[4], d[5] });
	/* What nobody measures must not spin on. */
	f->w = without(bb_vec3_add(f->w, (struct bb_vec3){ d[6], d[7], d[8] }), hold);
	f->v = bb_vec3_add(f->v, (struct bb_vec3){ d[9], d[10], d[11] });
	remember(f);
}
