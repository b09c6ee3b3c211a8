#include "sync/servo_private.h"

#include <math.h>
#include <string.h>

#include "hal/dev_time.h"

#define FIT_LEAST 4u      /* samples of the shortest line */
#define ERROR_WEIGHT 0.05 /* of the newest forecast in the mean error of its line */
#define LONGER_BETTER 1.1 /* a shorter line must forecast that much better than a longer one */
#define TRIED 8           /* forecasts before a line is compared with others */
#define CORRECTED 0.7     /* of the offset within an interval */

struct bb_servo_fit bb_servo_fit(const struct bb_servo *s, unsigned n)
{
	const unsigned last = (s->ring_next + BB_SERVO_RING - 1) % BB_SERVO_RING;
	double t_mean = 0, y_mean = 0, tt = 0, ty = 0, squares = 0;

	for (unsigned i = 0; i < n; i++) {
		const unsigned at = (last + BB_SERVO_RING - i) % BB_SERVO_RING;
		t_mean += (double)bb_ns_since(s->ring_ns[at], s->ring_ns[last]) * 1e-9 / n;
		y_mean += s->ring_offset_ns[at] / n;
	}
	for (unsigned i = 0; i < n; i++) {
		const unsigned at = (last + BB_SERVO_RING - i) % BB_SERVO_RING;
		const double t = (double)bb_ns_since(s->ring_ns[at], s->ring_ns[last]) * 1e-9 - t_mean;
		tt += t * t;
		ty += t * (s->ring_offset_ns[at] - y_mean);
	}
	const double rate = tt > 0 ? ty / tt : 0;
	for (unsigned i = 0; i < n; i++) {
		const unsigned at = (last + BB_SERVO_RING - i) % BB_SERVO_RING;
		const double t = (double)bb_ns_since(s->ring_ns[at], s->ring_ns[last]) * 1e-9 - t_mean;
		const double error = s->ring_offset_ns[at] - y_mean - rate * t;
		squares += error * error;
	}
	const double residual = fmax(sqrt(squares / (n - 2)), 0.5); /* offsets are whole ns */
	return (struct bb_servo_fit){ .offset_ns = y_mean - rate * t_mean,
				      .rate_ppb = rate,
				      .residual_ns = residual,
				      .offset_sigma_ns = residual * sqrt(1.0 / n + (tt > 0 ? t_mean * t_mean / tt : 0)),
				      .rate_sigma_ppb = tt > 0 ? residual / sqrt(tt) : 0 };
}

/* How far from what the line foretold did this sample fall? */
static void note_error(struct bb_servo *s, unsigned k, const struct bb_servo_input *in)
{
	const double foretold = s->line[k].offset_ns + s->line[k].rate_ppb * in->dt_s + in->moved_ns;
	const double error = in->offset_ns - foretold;

	if (!s->line[k].drawn)
		return;
	s->line[k].n++;
	s->line[k].error_ns2 += (error * error - s->line[k].error_ns2) * fmax(ERROR_WEIGHT, 1.0 / s->line[k].n);
}

/* The longest of the lines that foretell best; while none has been tried often enough, the longest. */
static struct bb_servo_fit best_fit(struct bb_servo *s, const struct bb_servo_input *in)
{
	struct bb_servo_fit best = { 0 };
	double least_ns2 = (double)INFINITY;
	bool tried = false;

	for (unsigned k = 0; k < BB_SERVO_FITS && FIT_LEAST << k <= s->n_ring; k++) {
		const struct bb_servo_fit fit = bb_servo_fit(s, FIT_LEAST << k);
		note_error(s, k, in);
		s->line[k].offset_ns = fit.offset_ns;
		s->line[k].rate_ppb = fit.rate_ppb;
		s->line[k].drawn = true;
		if (s->line[k].n < TRIED ? tried : s->line[k].error_ns2 > least_ns2 * LONGER_BETTER)
			continue;
		best = fit;
		tried = s->line[k].n >= TRIED;
		least_ns2 = tried ? s->line[k].error_ns2 : least_ns2;
	}
	return best;
}

static void take(struct bb_servo *s, const struct bb_servo_fit *fit)
{
	s->offset_ns = fit->offset_ns;
	s->drift_ppb = -fit->rate_ppb;
	s->offset_sigma_ns = fit->offset_sigma_ns;
	s->rate_sigma_ppb = fit->rate_sigma_ppb;
}

static void start(struct bb_servo *s, const struct bb_servo_fit *fit)
{
	take(s, fit);
	s->phase_ppb = 0;
	memset(s->line, 0, sizeof(s->line));
}

static void update(struct bb_servo *s, const struct bb_servo_input *in)
{
	const struct bb_servo_fit fit = best_fit(s, in);

	take(s, &fit);
	s->phase_ppb = -CORRECTED * fit.offset_ns / in->interval_s;
}

const struct bb_servo_ops bb_servo_linreg_ops = { start, update };
