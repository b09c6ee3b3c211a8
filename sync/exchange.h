/*
 * sync/exchange.h: two-way time transfer: what a remote clock shows at a local time, from exchanges of four stamps.
 *
 * Delays only ever add: every request bounds the offset (remote - local) from above and every answer from below. The
 * fit over a window is the line that keeps the greatest distance from both bounds, which for equal least delays in both
 * directions and exponential queueing is the line of maximum likelihood; its rate is the middle of the rates that are
 * about as likely, and the spread of those lines is the uncertainty. An unequal least delay cannot be seen from inside:
 * `asymmetry_ns` says how unequal it may be and is part of every uncertainty.
 *
 * Stamps may lie anywhere in int64, also across its end: only differences are used. Stamps from the other side are
 * believed as far as they are possible: see bb_clockfit_add. Algorithm only: no clock, no allocation. One thread.
 */
#ifndef BB_SYNC_EXCHANGE_H
#define BB_SYNC_EXCHANGE_H

#include "hal/base.h"

#define BB_CLOCKFIT_WINDOW_MAX 512
#define BB_CLOCKFIT_RATE_LEAST 16 /* fewer exchanges give an offset within half the round trip and no rate */
#define BB_CLOCKFIT_WINDOW_DEFAULT 64
#define BB_CLOCKFIT_RATE_MAX 1e-3 /* two oscillators differ by less */

struct bb_exchange {
	int64_t t1_ns; /* request leaves: local clock */
	int64_t t2_ns; /* request arrives: remote clock */
	int64_t t3_ns; /* answer leaves: remote clock */
	int64_t t4_ns; /* answer arrives: local clock */
};

enum bb_clockfit_verdict {
	BB_CLOCKFIT_TAKEN,
	BB_CLOCKFIT_REFUSED, /* impossible: time runs backwards, repeats, or the answer took longer than the round trip
			      */
	BB_CLOCKFIT_OUTLIER, /* contradicts the fit by more than four times its uncertainty; not used */
	BB_CLOCKFIT_RESTARTED, /* the eighth outlier in a row: one of the clocks was set, the fit begins again with it
				*/
};

struct bb_clockfit_line { /* offset_ns + rate * (local - ref) */
	double offset_ns, rate;
};

struct bb_clockfit {
	unsigned window;
	bool one_way; /* stamps that arrive, with a known least delay: cameras, CAN nodes */
	int64_t least_ns;
	int64_t asymmetry_ns; /* the offset may be wrong by so much more; set after init, 0 at first */
	struct bb_exchange held[BB_CLOCKFIT_WINDOW_MAX]; /* a ring */
	unsigned n, next;
	unsigned outliers_in_row;
	uint64_t n_refused, n_outliers, n_restarts;

	int64_t ref_ns, base_ns;                 /* local time and offset from which the lines count */
	struct bb_clockfit_line line, low, high; /* the fit; the slowest and the fastest line about as likely */
	double delay_ns;                         /* least one-way delay, the mean of both directions */
	double spread_ns;                        /* what remains uncertain when the rate is known */
};

/* A window outside its limits is brought within them. */
void bb_clockfit_init(struct bb_clockfit *f, unsigned window);
enum bb_clockfit_verdict bb_clockfit_add(struct bb_clockfit *f, const struct bb_exchange *x);

/*
 * The same line where nobody can be asked back (no run uses it yet: cameras are mapped by hal/dev_time.h, without a rate): a device stamps (remote clock, unwrapped) and the stamp arrives
 * least_ns or more later. Then the line is the one that every arrival bounds from below and that stays nearest to them.
 * A stamp from the future is an outlier; a device clock set back looks like long delays until the window has seen
 * enough.
 */
void bb_clockfit_init_one_way(struct bb_clockfit *f, unsigned window, int64_t least_ns);
enum bb_clockfit_verdict bb_clockfit_add_one_way(struct bb_clockfit *f, int64_t stamp_ns, int64_t arrived_ns);

/* The remote clock at a local time, and back. *uncertainty_ns (may be NULL) holds in more than 95 % of the cases and
 * grows with the distance from the window; no exchange yet: the time itself, INT64_MAX. */
int64_t bb_clockfit_remote_ns(const struct bb_clockfit *f, int64_t local_ns, int64_t *uncertainty_ns);
int64_t bb_clockfit_local_ns(const struct bb_clockfit *f, int64_t remote_ns, int64_t *uncertainty_ns);

/* How much faster the remote clock runs; *uncertainty (may be NULL) is BB_CLOCKFIT_RATE_MAX while the rate is unknown.
 */
double bb_clockfit_rate(const struct bb_clockfit *f, double *uncertainty);

#endif
