/*
 * sync/servo.h: steers a clock to a reference from measured offsets. Two ways: PI (cheap, follows at once) and linear
 * regression over the last samples (knows its own accuracy, best where offsets are noisy).
 *
 * offset = steered clock - reference. Intervals are counted on now_ns, a monotonic clock nobody steers. The answer says
 * what to do: add step_ns to the steered clock once, and let it run adjust_ppb faster than its own oscillator. Between
 * samples bb_servo_step gives the rate for now: a phase correction ends after one interval, so that silence leaves the
 * bare frequency (holdover). Stamps may lie anywhere in int64 and pass its end: only differences are used, and where
 * the axis begins changes no bit of an answer. Algorithm only: no clock, no allocation. One thread.
 *
 * A process on another machine than the head's steers its clock by it (bench/loop/follow.c). No device class has a clock that
 * can be set. tests/test_servo.c is what holds it.
 *
 * Gains and limits of the PI servo are those of linuxptp 3.1.1 (pi.c, config.c): kp = kp_scale T^-0.3 <= 0.7/T,
 * ki = ki_scale T^0.4 <= 0.3/T, with T the interval in seconds and offsets in ns giving ppb.
 */
#ifndef BB_SYNC_SERVO_H
#define BB_SYNC_SERVO_H

#include "hal/rate.h"

#define BB_SERVO_RING 64
#define BB_SERVO_START 8 /* samples before the servo acts, and outliers in a row before they are believed */
#define BB_SERVO_FITS 5  /* linear regression over the last 4, 8, 16, 32, 64 */

enum bb_servo_kind { BB_SERVO_PI, BB_SERVO_LINREG };
enum bb_servo_state { BB_SERVO_UNLOCKED, BB_SERVO_LOCKED, BB_SERVO_HOLDOVER };
enum bb_servo_verdict {
	BB_SERVO_USED,
	BB_SERVO_EARLY,   /* no time passed since the last sample, or less than min_dt_ns: ignored */
	BB_SERVO_OUTLIER, /* further than 4 sigma from what was expected: not used */
	BB_SERVO_STEPPED, /* step_ns is to be added to the steered clock */
	BB_SERVO_SET,     /* somebody else set the steered clock: begun again; step_ns as well */
};

struct bb_servo_config { /* bb_servo_defaults(interval) is a sane one */
	enum bb_servo_kind kind;
	int64_t interval_ns;       /* between samples, nominally */
	int64_t min_dt_ns;         /* closer samples are ignored */
	int64_t first_step_ns;     /* when it begins, a larger offset is stepped and not slewed */
	int64_t step_ns;           /* later: a shift at least so large is stepped as well; 0: never again */
	int64_t holdover_after_ns; /* without a usable sample */
	double max_ppb;            /* of the answer */
	double kp_scale, ki_scale;
	double sanity_ppb; /* the steered clock may run that much beside now_ns before it counts as set */
	double wander_ppb; /* random walk of the oscillator's frequency within 1 s: only for the uncertainty */
};

struct bb_servo_sample {
	int64_t now_ns;    /* monotonic */
	int64_t local_ns;  /* the steered clock at that moment */
	int64_t offset_ns; /* steered - reference */
};

struct bb_servo_answer {
	enum bb_servo_verdict verdict;
	int64_t step_ns;
	double adjust_ppb;
};

struct bb_servo_fit { /* a line through the last n samples, at the newest: sigma are one standard deviation */
	double offset_ns, rate_ppb;
	double residual_ns, offset_sigma_ns, rate_sigma_ppb;
};

struct bb_servo_ops;

struct bb_servo {
	struct bb_servo_config config;
	const struct bb_servo_ops *ops;
	enum bb_servo_state state;
	uint64_t n_used, n_outliers, n_steps, n_sets, n_early;

	/* Where the clock stands. */
	unsigned n;                  /* samples since it began, up to BB_SERVO_START */
	unsigned good;               /* used in a row since it was lost */
	int64_t sample_ns;           /* now_ns of the last used sample */
	int64_t heard_ns, local_ns;  /* now_ns of the last sample of any kind, the steered clock then and what it was
					stepped since */
	double offset_ns;            /* estimated at sample_ns */
	double moved_ns;             /* what the answered rates moved the clock by since sample_ns, */
	double moved_heard_ns;       /* and since heard_ns */
	double drift_ppb, phase_ppb; /* frequency and phase correction; the latter ends at phase_until_ns */
	int64_t phase_until_ns;
	double given_ppb; /* answered last, */
	int64_t given_ns; /* and counted until here */

	/* What it knows of the noise. */
	double noise_ns;                        /* rms of offset - expected */
	double offset_sigma_ns, rate_sigma_ppb; /* of the estimate at sample_ns */
	unsigned strays;                        /* outliers in a row, */
	double stray_sum_ns, stray_sum_sq_ns2;  /* and how far from expected */

	/* The last samples, as if every correction until now had been made before them: a line with the oscillator's
	 * rate. */
	unsigned n_ring, ring_next;
	int64_t ring_ns[BB_SERVO_RING];
	double ring_offset_ns[BB_SERVO_RING];

	struct {                            /* linear regression: one for each length */
		double offset_ns, rate_ppb; /* at sample_ns */
		double error_ns2;           /* mean square of what it foretold - what came, */
		unsigned n;                 /* so many times; */
		bool drawn;                 /* since the servo began */
	} line[BB_SERVO_FITS];
};

struct bb_servo_config bb_servo_defaults(enum bb_servo_kind kind, int64_t interval_ns);
/* What is out of range is brought into it. */
void bb_servo_init(struct bb_servo *s, const struct bb_servo_config *config);
struct bb_servo_answer bb_servo_sample(struct bb_servo *s, const struct bb_servo_sample *x);
/* The rate from now on, and the state: call it at least once an interval. */
double bb_servo_step(struct bb_servo *s, int64_t now_ns);

/* How far the steered clock may be from the reference, three sigma; INT64_MAX before it is locked. Grows in holdover.
 */
int64_t bb_servo_uncertainty_ns(const struct bb_servo *s, int64_t now_ns);
/* How long from now the clock may run without samples until its uncertainty exceeds a limit; 0: it does already. */
int64_t bb_servo_holdover_left_ns(const struct bb_servo *s, int64_t limit_ns, int64_t now_ns);

/* Is a clock that is estimated to be off by offset_ns, +- uncertainty_ns, within a limit? */
enum bb_within { BB_WITHIN, BB_BEYOND, BB_WITHIN_UNKNOWN };
enum bb_within bb_servo_within(int64_t offset_ns, int64_t uncertainty_ns, int64_t limit_ns);

#endif
