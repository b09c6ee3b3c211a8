/*
 * sync/servo_private.h: what a way of steering fills in, and the lines through the last samples that both use.
 */
#ifndef BB_SYNC_SERVO_PRIVATE_H
#define BB_SYNC_SERVO_PRIVATE_H

#include "sync/servo.h"

struct bb_servo_input {
	double offset_ns;  /* measured */
	double moved_ns;   /* by the servo, since the last used sample */
	double dt_s;       /* since the last used sample */
	double interval_s; /* until the next, nominally */
};

struct bb_servo_ops { /* both set offset_ns, drift_ppb, phase_ppb, offset_sigma_ns and rate_sigma_ppb of the servo */
	void (*start)(struct bb_servo *s, const struct bb_servo_fit *fit);
	void (*update)(struct bb_servo *s, const struct bb_servo_input *in);
};

extern const struct bb_servo_ops bb_servo_pi_ops, bb_servo_linreg_ops;

/* Least squares over the last n samples, 3 <= n <= s->n_ring. */
struct bb_servo_fit bb_servo_fit(const struct bb_servo *s, unsigned n);

#endif
