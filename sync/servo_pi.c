#include "sync/servo_private.h"

#include <math.h>

static double gain(double scale, double exponent, double most, double t_s)
{
	return fmin(scale * pow(t_s, exponent), most / t_s);
}

static void start(struct bb_servo *s, const struct bb_servo_fit *fit)
{
	s->offset_ns = fit->offset_ns;
	s->drift_ppb = -fit->rate_ppb;
	s->phase_ppb = 0;
	s->offset_sigma_ns = fit->offset_sigma_ns;
	s->rate_sigma_ppb = fit->rate_sigma_ppb;
}

static void update(struct bb_servo *s, const struct bb_servo_input *in)
{
	/* After silence the offset is the work of a long time: it says little about the rate of the next interval. */
	const double t_s = fmax(in->dt_s, in->interval_s);
	const double kp = gain(s->config.kp_scale, -0.3, 0.7, t_s), ki = gain(s->config.ki_scale, 0.4, 0.3, t_s);
	const double drift_ppb = s->drift_ppb - ki * in->offset_ns;
	const double phase_ppb = -kp * in->offset_ns;

	/* What the output cannot follow is not integrated, unless it leads out of saturation. */
	if (fabs(drift_ppb + phase_ppb) <= s->config.max_ppb || fabs(drift_ppb) < fabs(s->drift_ppb))
		s->drift_ppb = drift_ppb;
	s->offset_ns = in->offset_ns;
	s->phase_ppb = phase_ppb;
	s->offset_sigma_ns = s->noise_ns;
	/* White noise through the loop in the steady state; before that, what the loop is just correcting. */
	const double now_ppb = fmax(s->noise_ns * sqrt(ki * kp / 2), ki * fabs(in->offset_ns));
	s->rate_sigma_ppb +=
		(now_ppb - s->rate_sigma_ppb) * (now_ppb > s->rate_sigma_ppb ? 1 : fmin(1, ki / kp * in->dt_s));
}

const struct bb_servo_ops bb_servo_pi_ops = { start, update };
