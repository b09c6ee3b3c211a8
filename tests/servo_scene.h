/*
 * tests/servo_scene.h: a clock, its oscillator, a reference and a noisy way of comparing them, driven by a servo: what
 * the suites of chrony (clknetsim) and linuxptp simulate, in one process. Times in s and ns since the scene began; the
 * axes of the three clocks may begin anywhere in int64.
 */
#ifndef BB_TESTS_SERVO_SCENE_H
#define BB_TESTS_SERVO_SCENE_H

#include "tests/fixture_room.h"

#include "hal/dev_time.h"
#include "hal/hash.h"
#include "sync/servo.h"

enum servo_jitter {
	JITTER_NORMAL,
	JITTER_DELAY,
	JITTER_FLAT
}; /* sd; mean of each way's exponential delay; half width */

struct servo_scene {
	const char *name;
	enum bb_servo_kind kind;
	double interval_s, duration_s;
	double rate, wander_ppb; /* of the oscillator against the reference; random walk within 1 s */
	double jitter_s;
	enum servo_jitter jitter;
	double offset_s;          /* at the beginning */
	double event_s;           /* from here on: */
	double step_s, rate_step; /* the reference steps, the oscillator's rate jumps */
	double rate_step_s;       /* for so long; 0: for good */
	double set_s;             /* somebody sets the steered clock */
	double outage_s, burst_s; /* nothing is measured; jitter is burst_times as large */
	double burst_times;
	double loss_percent;
	double max_ppb; /* of the servo; 0: default */
	double kp, ki;  /* 0: default */
	bool never_step;
	double sync_s, settle_s; /* bars hold from sync_s on, and from settle_s after the event is over */
	double max_s, rms_s;     /* bars on the clock's true error */
	double overshoot;        /* bar: furthest on the other side after the event, of the furthest; 0: none */
};

struct servo_outcome {
	double max_ns, rms_ns; /* of the true error, where the bars hold */
	double honest;         /* share of LOCKED and HOLDOVER time in which it was within the uncertainty */
	double overshoot;
	double out_of_lock_s; /* after sync_s */
	double first_out_s;
	uint64_t outliers, steps, sets;
	enum bb_servo_state at_end;
	bool finite;
	char hash[BB_HASH_HEX]; /* of every answer */
};

struct servo_axes { /* what the monotonic and the steered clock show when the scene begins */
	int64_t monotonic_ns, local_ns;
};

struct servo_play {
	const struct servo_scene *c;
	struct sim_rng rng;
	double true_ns;                   /* = of the reference, without its steps */
	double rate;                      /* of the oscillator, now */
	double own_ns;                    /* oscillator */
	double steered_ns;                /* own + adjustments, without steps */
	int64_t stepped_ns, reference_ns; /* steps of the steered clock and of the reference */
	double adjust_ppb;
	double least_ns, most_ns; /* error since the event */
};

static inline void servo_play_on(struct servo_play *p, double dt_s)
{
	const double own_ns = dt_s * 1e9 * (1 + p->rate);

	p->true_ns += dt_s * 1e9;
	p->own_ns += own_ns;
	p->steered_ns += own_ns * (1 + p->adjust_ppb * 1e-9);
	p->rate += p->c->wander_ppb * 1e-9 * sqrt(dt_s) * sim_rng_normal(&p->rng);
}

static inline double servo_exponential(struct sim_rng *rng, double mean)
{
	return -mean * log(1 - sim_rng_uniform(rng));
}

static inline double servo_noise_ns(struct servo_play *p, bool burst)
{
	const double scale_ns = p->c->jitter_s * 1e9 * (burst ? p->c->burst_times : 1);

	switch (p->c->jitter) {
	case JITTER_NORMAL:
		return scale_ns * sim_rng_normal(&p->rng);
	case JITTER_DELAY:
		return (servo_exponential(&p->rng, scale_ns) - servo_exponential(&p->rng, scale_ns)) / 2;
	case JITTER_FLAT:
	default:
		return scale_ns * (2 * sim_rng_uniform(&p->rng) - 1);
	}
}

/* Steered less reference: the whole steps are exact, the rest is small. */
static inline double servo_error_ns(const struct servo_play *p)
{
	return (double)(p->stepped_ns - p->reference_ns) + (p->steered_ns - p->true_ns);
}

static inline void servo_event(struct servo_play *p)
{
	p->reference_ns += llrint(p->c->step_s * 1e9);
	p->stepped_ns += llrint(p->c->set_s * 1e9);
	p->rate += p->c->rate_step;
}

static inline struct servo_outcome servo_scene_run(const struct servo_scene *c, uint64_t seed, struct servo_axes zero)
{
	const double over_s = c->event_s + fmax(fmax(c->outage_s, c->burst_s), c->rate_step_s);
	struct bb_servo_config config = bb_servo_defaults(c->kind, llrint(c->interval_s * 1e9));
	struct servo_play p = { .c = c, .rate = c->rate, .stepped_ns = llrint(c->offset_s * 1e9) };
	struct servo_outcome out = { .finite = true, .first_out_s = -1 };
	static struct bb_servo s;
	struct bb_hash hash;
	double squares = 0, counted = 0, judged = 0, honest = 0;

	assert_true(bb_hash_init(&hash));
	sim_rng_seed(&p.rng, seed, "servo", c->name);
	config.max_ppb = c->max_ppb > 0 ? c->max_ppb : config.max_ppb;
	config.kp_scale = c->kp > 0 ? c->kp : config.kp_scale;
	config.ki_scale = c->ki > 0 ? c->ki : config.ki_scale;
	config.wander_ppb = c->wander_ppb;
	config.step_ns = c->never_step ? 0 : config.step_ns;
	bb_servo_init(&s, &config);
	for (int64_t i = 1; (double)i * c->interval_s <= c->duration_s; i++) {
		const double t_s = (double)i * c->interval_s;
		const bool eventful = c->event_s > 0 && t_s >= c->event_s;
		servo_play_on(&p, c->interval_s);
		if (eventful && t_s - c->interval_s < c->event_s)
			servo_event(&p);
		if (c->rate_step_s > 0 && t_s >= over_s && t_s - c->interval_s < over_s)
			p.rate -= c->rate_step;
		const int64_t now_ns = bb_ns_after(zero.monotonic_ns, llrint(p.own_ns));
		const double noise_ns = servo_noise_ns(&p, eventful && t_s < c->event_s + c->burst_s);
		const bool lost =
			sim_rng_uniform(&p.rng) * 100 < c->loss_percent || (eventful && t_s < c->event_s + c->outage_s);
		struct bb_servo_answer a = { .verdict = BB_SERVO_USED };
		if (lost) {
			a.adjust_ppb = bb_servo_step(&s, now_ns);
		} else {
			const int64_t local_ns =
				bb_ns_after(bb_ns_after(zero.local_ns, llrint(p.steered_ns)), p.stepped_ns);
			const int64_t offset_ns =
				p.stepped_ns - p.reference_ns + llrint(p.steered_ns - p.true_ns + noise_ns);
			const struct bb_servo_sample x = { now_ns, local_ns, offset_ns };
			a = bb_servo_sample(&s, &x);
			p.stepped_ns += a.step_ns;
		}
		p.adjust_ppb = a.adjust_ppb;
		out.finite &= isfinite(a.adjust_ppb) && fabs(a.adjust_ppb) <= config.max_ppb;
		const int64_t record[] = { a.verdict, a.step_ns, s.state, bb_servo_uncertainty_ns(&s, now_ns) };
		bb_hash_update(&hash, record, sizeof(record));
		bb_hash_update(&hash, &a.adjust_ppb, sizeof(a.adjust_ppb));
		const double signed_ns = servo_error_ns(&p), error_ns = fabs(signed_ns);
		p.least_ns = eventful ? fmin(p.least_ns, signed_ns) : 0;
		p.most_ns = eventful ? fmax(p.most_ns, signed_ns) : 0;
		if (s.state != BB_SERVO_UNLOCKED) {
			judged++;
			honest += error_ns <= (double)bb_servo_uncertainty_ns(&s, now_ns);
		}
		if (t_s < c->sync_s)
			continue;
		if (s.state == BB_SERVO_UNLOCKED) {
			out.out_of_lock_s += c->interval_s;
			out.first_out_s = out.first_out_s < 0 ? t_s : out.first_out_s;
		}
		if (eventful && t_s < over_s + c->settle_s)
			continue;
		out.max_ns = fmax(out.max_ns, error_ns);
		squares += error_ns * error_ns;
		counted++;
	}
	out.overshoot = fmin(-p.least_ns, p.most_ns) / fmax(fmax(-p.least_ns, p.most_ns), 1);
	out.rms_ns = counted > 0 ? sqrt(squares / counted) : (double)NAN;
	out.honest = judged > 0 ? honest / judged : 0;
	out.outliers = s.n_outliers;
	out.steps = s.n_steps;
	out.sets = s.n_sets;
	out.at_end = s.state;
	bb_hash_final_hex(&hash, out.hash);
	return out;
}

#endif
