#include "sync/track/filter.h"

#include <math.h>

#include "sync/track/linalg.h"

/* Spectral densities of the acceleration, 2 a^2 tau: a walking head with about 1 m/s^2 and 3 rad/s^2 for 0.1 s at a
 * time. Tuned on a walk at +8 to +40 ms; ten times more or less costs a third in angle and nothing in position. */
#define ACCEL_M2_S3 0.2
#define ACCEL_RAD2_S3 2.0
#define START_SPEED_M_S 1.0
#define START_RATE_RAD_S 2.0

double bb_seconds_between(int64_t a_ns, int64_t b_ns)
{
	int64_t d;

	if (__builtin_sub_overflow(a_ns, b_ns, &d))
		return a_ns > b_ns ? 9.3e9 : -9.3e9;
	return 1e-9 * (double)d;
}

static struct bb_filter_axis carry(struct bb_filter_axis a, double dt, double density)
{
	const double t = fabs(dt); /* backwards is as uncertain as forwards */

	return (struct bb_filter_axis){ a.pp + 2 * dt * a.pv + dt * dt * a.vv + density * t * t * t / 3,
					a.pv + dt * a.vv + density * dt * t / 2, a.vv + density * t };
}

static double sigma_after(const struct bb_filter_axis axis[3], double dt, double density)
{
	double sum = 0;

	for (int i = 0; i < 3; i++)
		sum += carry(axis[i], dt, density).pp;
	return sqrt(fmax(sum, 0));
}

struct bb_filter_state bb_filter_predict(const struct bb_filter *f, double dt_s)
{
	struct bb_filter_state s;

	s.v = f->v;
	s.w = f->w;
	s.p = bb_vec3_add(f->p, bb_vec3_scale(f->v, dt_s));
	s.q = bb_quat_unit(bb_quat_mul(bb_quat_exp(bb_vec3_scale(f->w, dt_s)), f->q));
	s.position_sigma_m = sigma_after(f->position, dt_s, ACCEL_M2_S3);
	s.angle_sigma_rad = sigma_after(f->angle, dt_s, ACCEL_RAD2_S3);
	return s;
}

void bb_filter_start(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q, const double var_m2[3],
		     const double var_rad2[3])
{
	*f = (struct bb_filter){ .live = true, .at_ns = at_ns, .p = p, .q = q };
	for (int i = 0; i < 3; i++) {
		f->position[i] = (struct bb_filter_axis){ var_m2[i], 0, START_SPEED_M_S * START_SPEED_M_S };
		f->angle[i] = (struct bb_filter_axis){ var_rad2[i], 0, START_RATE_RAD_S * START_RATE_RAD_S };
	}
}

/* One axis of the Kalman update; innovation is measured minus predicted. Returns the correction of the value. */
static double correct(struct bb_filter_axis *a, double innovation, double variance, double *rate)
{
	const double s = a->pp + variance, kp = a->pp / s, kv = a->pv / s;

	*rate += kv * innovation;
	a->vv -= kv * a->pv;
	a->pv *= 1 - kp;
	a->pp *= 1 - kp;
	return kp * innovation;
}

static struct bb_vec3 without(struct bb_vec3 v, struct bb_vec3 axis)
{
	return bb_vec3_sub(v, bb_vec3_scale(axis, bb_vec3_dot(v, axis)));
}

void bb_filter_update(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q, const double var_m2[3],
		      const double var_rad2[3], struct bb_vec3 hold)
{
	const double dt = bb_seconds_between(at_ns, f->at_ns);
	const struct bb_filter_state s = bb_filter_predict(f, dt);
	const struct bb_vec3 turn = bb_quat_log(bb_quat_mul(q, bb_quat_conj(s.q))), off = bb_vec3_sub(p, s.p);
	const double ip[3] = { off.x, off.y, off.z }, iq[3] = { turn.x, turn.y, turn.z };
	double v[3] = { f->v.x, f->v.y, f->v.z }, w[3] = { f->w.x, f->w.y, f->w.z }, dp[3], dq[3];

	for (int i = 0; i < 3; i++) {
		f->position[i] = carry(f->position[i], dt, ACCEL_M2_S3);
		f->angle[i] = carry(f->angle[i], dt, ACCEL_RAD2_S3);
		dp[i] = correct(&f->position[i], ip[i], fmax(var_m2[i], 1e-16), &v[i]);
		dq[i] = correct(&f->angle[i], iq[i], fmax(var_rad2[i], 1e-16), &w[i]);
	}
	f->at_ns = at_ns;
	f->p = bb_vec3_add(s.p, (struct bb_vec3){ dp[0], dp[1], dp[2] });
	f->q = bb_quat_unit(bb_quat_mul(bb_quat_exp((struct bb_vec3){ dq[0], dq[1], dq[2] }), s.q));
	f->v = (struct bb_vec3){ v[0], v[1], v[2] };
	/* What nobody measures must not spin on. */
	f->w = without((struct bb_vec3){ w[0], w[1], w[2] }, hold);
}
