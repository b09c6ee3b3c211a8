/* sync/servo.c: what both ways of steering share: begin, gate, sanity, holdover, and what is known of the noise. */
#include "sync/servo_private.h"

#include <math.h>
#include <string.h>

#include "hal/dev_time.h"

#define GATE 4.0
#define SIGMAS 3.0 /* of every uncertainty */
#define GOOD 3     /* used samples in a row that end a holdover */
#define NOISE_WEIGHT (1.0 / 32)
#define MAX_PPB 9e8
#define LEFT_MOST_S 1e9

struct bb_servo_config bb_servo_defaults(enum bb_servo_kind kind, int64_t interval_ns)
{
	return (struct bb_servo_config){ .kind = kind,
					 .interval_ns = interval_ns,
					 .min_dt_ns = interval_ns / 16,
					 .first_step_ns = 20000,
					 .step_ns = 20000,
					 .holdover_after_ns = interval_ns * 3 / 2,
					 .max_ppb = MAX_PPB,
					 .kp_scale = 0.7,
					 .ki_scale = 0.3,
					 .sanity_ppb = 2e8,
					 .wander_ppb = 1 };
}

static double within(double value, double least, double most)
{
	return value >= least ? fmin(value, most) : least; /* NAN: least */
}

void bb_servo_init(struct bb_servo *s, const struct bb_servo_config *config)
{
	struct bb_servo_config *c = &s->config;

	memset(s, 0, sizeof(*s));
	*c = *config;
	c->interval_ns = c->interval_ns > 0 ? c->interval_ns : 1;
	c->min_dt_ns = c->min_dt_ns > 0 ? c->min_dt_ns : 1;
	c->holdover_after_ns = c->holdover_after_ns > c->interval_ns ? c->holdover_after_ns : c->interval_ns;
	c->max_ppb = within(c->max_ppb, 1, MAX_PPB);
	c->kp_scale = within(c->kp_scale, 1e-6, 1);
	c->ki_scale = within(c->ki_scale, 1e-9, 1);
	c->sanity_ppb = within(c->sanity_ppb, 1e3, MAX_PPB);
	c->wander_ppb = within(c->wander_ppb, 0, MAX_PPB);
	s->ops = c->kind == BB_SERVO_LINREG ? &bb_servo_linreg_ops : &bb_servo_pi_ops;
}

static double seconds(int64_t at_ns, int64_t since_ns)
{
	return (double)bb_ns_since(at_ns, since_ns) * 1e-9;
}

/* What was answered last has moved the clock until now. */
static void advance(struct bb_servo *s, int64_t now_ns)
{
	const double moved_ns = s->given_ppb * seconds(now_ns, s->given_ns);

	s->moved_ns += moved_ns;
	s->moved_heard_ns += moved_ns;
	s->given_ns = now_ns;
}

static double give(struct bb_servo *s, int64_t now_ns)
{
	const bool phase = bb_ns_since(s->phase_until_ns, now_ns) > 0;

	s->given_ppb = within(s->drift_ppb + (phase ? s->phase_ppb : 0), -s->config.max_ppb, s->config.max_ppb);
	s->given_ns = now_ns;
	return s->given_ppb;
}

/* ---- the last samples ---- */

static void move_ring(struct bb_servo *s, double by_ns)
{
	for (unsigned i = 0; i < BB_SERVO_RING; i++)
		s->ring_offset_ns[i] += by_ns;
}

/* Every sample is kept; strays are taken out again when one comes that is none. */
static void keep(struct bb_servo *s, const struct bb_servo_sample *x)
{
	s->ring_ns[s->ring_next] = x->now_ns;
	s->ring_offset_ns[s->ring_next] = (double)x->offset_ns;
	s->ring_next = (s->ring_next + 1) % BB_SERVO_RING;
	s->n_ring += s->n_ring < BB_SERVO_RING;
}

static void forget_strays(struct bb_servo *s)
{
	const unsigned newest = (s->ring_next + BB_SERVO_RING - 1) % BB_SERVO_RING;
	const unsigned first = (newest + BB_SERVO_RING - s->strays) % BB_SERVO_RING;

	s->ring_ns[first] = s->ring_ns[newest];
	s->ring_offset_ns[first] = s->ring_offset_ns[newest];
	s->ring_next = (first + 1) % BB_SERVO_RING;
	s->n_ring -= s->strays;
	s->strays = 0;
}

/* ---- begin ---- */

static void step_clock(struct bb_servo *s, int64_t step_ns, struct bb_servo_answer *a)
{
	a->step_ns = step_ns;
	if (a->verdict == BB_SERVO_USED)
		a->verdict = BB_SERVO_STEPPED;
	s->local_ns = bb_ns_after(s->local_ns, step_ns);
	s->n_steps++;
}

static void begin(struct bb_servo *s, const struct bb_servo_sample *x, struct bb_servo_answer *a)
{
	s->state = BB_SERVO_UNLOCKED;
	s->n = 1;
	s->n_ring = s->ring_next = s->good = s->strays = 0;
	s->phase_ppb = 0; /* the frequency is still the best guess there is */
	keep(s, x);
	if (x->offset_ns > s->config.first_step_ns || x->offset_ns < -s->config.first_step_ns) {
		step_clock(s, bb_ns_since(0, x->offset_ns), a);
		s->ring_offset_ns[0] = 0;
	}
}

/* Offset, rate and noise from one line through the last samples, and nothing else. limit_ns 0: never step. */
static void settle(struct bb_servo *s, int64_t now_ns, int64_t limit_ns, struct bb_servo_answer *a)
{
	const struct bb_servo_fit fit = bb_servo_fit(s, BB_SERVO_START);

	s->noise_ns = fit.residual_ns * 1.5; /* both the sample and what is expected of it are noisy */
	s->ops->start(s, &fit);
	s->sample_ns = now_ns;
	s->moved_ns = 0;
	s->strays = 0;
	if (!limit_ns || fabs(s->offset_ns) < fmax((double)limit_ns, SIGMAS * fit.offset_sigma_ns))
		return;
	const int64_t step_ns = bb_ns_since(0, llrint(within(s->offset_ns, -9e18, 9e18)));
	step_clock(s, step_ns, a);
	move_ring(s, (double)step_ns);
	s->offset_ns += (double)step_ns;
	s->state = BB_SERVO_UNLOCKED;
	s->good = 0;
}

/* ---- follow ---- */

/* How far the rate may have carried the clock since the last sample, one sigma. */
static double growth_ns(const struct bb_servo *s, double dt_s)
{
	return s->rate_sigma_ppb * dt_s + s->config.wander_ppb * dt_s * sqrt(dt_s);
}

static double expected_ns(const struct bb_servo *s, double dt_s)
{
	return s->offset_ns + s->moved_ns - s->drift_ppb * dt_s;
}

static void look_for_silence(struct bb_servo *s, int64_t now_ns)
{
	if (s->state == BB_SERVO_LOCKED && bb_ns_since(now_ns, s->sample_ns) > s->config.holdover_after_ns) {
		s->state = BB_SERVO_HOLDOVER;
		s->good = 0;
	}
}

static void use(struct bb_servo *s, const struct bb_servo_sample *x, double stray_ns, double dt_s)
{
	const struct bb_servo_input in = { .offset_ns = (double)x->offset_ns,
					   .moved_ns = s->moved_ns,
					   .dt_s = dt_s,
					   .interval_s = (double)s->config.interval_ns * 1e-9 };
	const double seen_ns =
		fmin(fabs(stray_ns), GATE * s->noise_ns); /* after a silence a stray is more than noise */

	s->noise_ns = fmax(
		sqrt(s->noise_ns * s->noise_ns + (seen_ns * seen_ns - s->noise_ns * s->noise_ns) * NOISE_WEIGHT), 1);
	s->n_used++;
	s->ops->update(s, &in);
	s->sample_ns = x->now_ns;
	s->moved_ns = 0;
	s->phase_until_ns = bb_ns_after(x->now_ns, s->config.interval_ns);
	if (++s->good >= GOOD)
		s->state = BB_SERVO_LOCKED;
}

static void count_stray(struct bb_servo *s, double stray_ns)
{
	s->n_outliers++;
	s->stray_sum_ns = s->strays ? s->stray_sum_ns + stray_ns : stray_ns;
	s->stray_sum_sq_ns2 = s->strays ? s->stray_sum_sq_ns2 + stray_ns * stray_ns : stray_ns * stray_ns;
	s->strays++;
}

static void follow(struct bb_servo *s, const struct bb_servo_sample *x, struct bb_servo_answer *a)
{
	const double dt_s = seconds(x->now_ns, s->sample_ns);
	const double stray_ns = (double)x->offset_ns - expected_ns(s, dt_s);

	keep(s, x);
	if (fabs(stray_ns) <= GATE * hypot(s->noise_ns, growth_ns(s, dt_s))) {
		if (s->strays)
			forget_strays(s);
		use(s, x, stray_ns, dt_s);
		return;
	}
	count_stray(s, stray_ns);
	if (s->strays < BB_SERVO_START) {
		a->verdict = BB_SERVO_OUTLIER;
		look_for_silence(s, x->now_ns);
		return;
	}
	/* So many in a row are no outliers. To both sides: the noise grew. To one: offset or rate is another now. */
	const double mean_ns = s->stray_sum_ns / s->strays, square_ns2 = s->stray_sum_sq_ns2 / s->strays;
	if (mean_ns * mean_ns < square_ns2 / 2) {
		s->noise_ns = sqrt(square_ns2);
		s->strays = 0;
		use(s, x, stray_ns, dt_s);
	} else {
		s->n_ring = BB_SERVO_START;
		settle(s, x->now_ns, s->config.step_ns, a);
	}
}

/* Against a clock nobody steers the steered one may run fast or slow, but it cannot jump. */
static bool was_set(const struct bb_servo *s, const struct bb_servo_sample *x)
{
	const double dt_ns = (double)bb_ns_since(x->now_ns, s->heard_ns);
	const double beside_ns = (double)bb_ns_since(x->local_ns, s->local_ns) - dt_ns - s->moved_heard_ns;

	return fabs(beside_ns) > dt_ns * s->config.sanity_ppb * 1e-9;
}

struct bb_servo_answer bb_servo_sample(struct bb_servo *s, const struct bb_servo_sample *x)
{
	const bool first = !s->n;
	struct bb_servo_answer a = { .verdict = BB_SERVO_USED };

	if (!first && bb_ns_since(x->now_ns, s->heard_ns) < s->config.min_dt_ns) {
		s->n_early++;
		return (struct bb_servo_answer){ .verdict = BB_SERVO_EARLY, .adjust_ppb = s->given_ppb };
	}
	if (first)
		s->given_ns = x->now_ns;
	advance(s, x->now_ns);
	const bool set = !first && was_set(s, x);
	s->heard_ns = x->now_ns;
	s->local_ns = x->local_ns;
	move_ring(s, s->moved_heard_ns);
	s->moved_heard_ns = 0;
	if (set) {
		s->n_sets++;
		a.verdict = BB_SERVO_SET;
	}
	if (first || set) {
		begin(s, x, &a);
	} else if (s->n < BB_SERVO_START) {
		keep(s, x);
		if (++s->n == BB_SERVO_START)
			settle(s, x->now_ns, s->config.first_step_ns, &a);
	} else {
		follow(s, x, &a);
	}
	a.adjust_ppb = give(s, x->now_ns);
	return a;
}

double bb_servo_step(struct bb_servo *s, int64_t now_ns)
{
	if (!s->n)
		return 0;
	advance(s, now_ns);
	look_for_silence(s, now_ns);
	return give(s, now_ns);
}

/* ---- what it is worth ---- */

static double uncertainty_ns(const struct bb_servo *s, double dt_s)
{
	return SIGMAS * (s->offset_sigma_ns + growth_ns(s, dt_s));
}

int64_t bb_servo_uncertainty_ns(const struct bb_servo *s, int64_t now_ns)
{
	const double dt_s = seconds(now_ns, s->sample_ns);
	/* Corrections made since, and what is left of the offset. */
	const double off_ns = expected_ns(s, dt_s) + s->given_ppb * seconds(now_ns, s->given_ns);
	const double stray_ns = s->strays ? s->stray_sum_ns / s->strays : 0; /* it may be they that are right */
	const double sum_ns = fabs(off_ns) + fabs(stray_ns) + uncertainty_ns(s, dt_s);

	return s->state == BB_SERVO_UNLOCKED || !(sum_ns < 9e18) ? INT64_MAX : (int64_t)ceil(sum_ns);
}

int64_t bb_servo_holdover_left_ns(const struct bb_servo *s, int64_t limit_ns, int64_t now_ns)
{
	const double dt_s = seconds(now_ns, s->sample_ns);
	const double spent_ns = (double)bb_servo_uncertainty_ns(s, now_ns) - uncertainty_ns(s, dt_s);
	double least_s = 0, most_s = LEFT_MOST_S;

	if (s->state == BB_SERVO_UNLOCKED || spent_ns + uncertainty_ns(s, dt_s) > (double)limit_ns)
		return 0;
	for (int k = 0; k < 64; k++) { /* it only grows */
		const double middle_s = (least_s + most_s) / 2;
		if (spent_ns + uncertainty_ns(s, dt_s + middle_s) <= (double)limit_ns)
			least_s = middle_s;
		else
			most_s = middle_s;
	}
	return (int64_t)(least_s * 1e9);
}

enum bb_within bb_servo_within(int64_t offset_ns, int64_t unsure_ns, int64_t limit_ns)
{
	const double off = fabs((double)offset_ns), unsure = (double)unsure_ns, limit = (double)limit_ns;

	if (off + unsure <= limit)
		return BB_WITHIN;
	return off - unsure > limit ? BB_BEYOND : BB_WITHIN_UNKNOWN;
}
