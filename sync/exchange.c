#include "sync/exchange.h"

#include <math.h>
#include <string.h>

#include "hal/dev_time.h"

#define RATE_STEPS 26 /* halvings of 2e-3: to 3e-11 */
#define OUTLIERS_IN_ROW 8
#define GATE 4.0
#define LIKELY 1.5        /* lines down to e^-3 of the best one's likelihood count */
#define RESOLUTION_NS 1.0 /* stamps are whole ns */
#define ROUND_TRIP_MAX_NS (60 * INT64_C(1000000000))

/* One side of a window: the lower convex hull of its bounds, which alone decide; those from below upside down. */
struct hull {
	unsigned n;
	double sum_at, sum_bound;
	double at[BB_CLOCKFIT_WINDOW_MAX], bound[BB_CLOCKFIT_WINDOW_MAX];
};

struct bounds {
	unsigned n;               /* exchanges */
	struct hull above, below; /* by requests, at the time they left; by answers, at the time they came, negative */
};

struct fit { /* the best line of a given rate */
	double offset_ns, margin_ns;
	double slope; /* how the margin changes with the rate */
};

void bb_clockfit_init(struct bb_clockfit *f, unsigned window)
{
	memset(f, 0, sizeof(*f));
	f->window = window < 1 ? 1 : window > BB_CLOCKFIT_WINDOW_MAX ? BB_CLOCKFIT_WINDOW_MAX : window;
}

/* Times come in order but for answers that overtake one another: those count at one time, wrong by a part of a round
 * trip times the rate. */
static void hull_add(struct hull *h, double at, double bound)
{
	h->sum_at += at;
	h->sum_bound += bound;
	if (h->n && at <= h->at[h->n - 1]) {
		h->bound[h->n - 1] = fmin(h->bound[h->n - 1], bound);
		at = h->at[h->n - 1];
		bound = h->bound[h->n - 1];
		h->n--;
	}
	while (h->n > 1 && (h->bound[h->n - 1] - h->bound[h->n - 2]) * (at - h->at[h->n - 2]) >=
				   (bound - h->bound[h->n - 2]) * (h->at[h->n - 1] - h->at[h->n - 2]))
		h->n--;
	h->at[h->n] = at;
	h->bound[h->n++] = bound;
}

/* The least of bound - rate * at. */
static double hull_least(const struct hull *h, double rate, double *at)
{
	double least = (double)INFINITY;

	for (unsigned i = 0; i < h->n; i++) {
		const double value = h->bound[i] - rate * h->at[i];
		if (value >= least)
			break; /* convex: it only grows from here */
		least = value;
		*at = h->at[i];
	}
	return least;
}

/* One way: what the line stays off the mean of its bounds, negative; of the offset the least delay is still missing. */
static struct fit fit_below(const struct hull *below, unsigned n, double rate)
{
	const double mean_at = below->sum_at / n;
	double y = 0;
	const double bottom = -hull_least(below, -rate, &y);

	return (struct fit){ .offset_ns = bottom, .margin_ns = -(bottom + rate * mean_at), .slope = y - mean_at };
}

static struct fit fit_rate(const struct bounds *b, double rate)
{
	double x = 0, y = 0;

	if (!b->above.n)
		return fit_below(&b->below, b->n, rate);
	const double top = hull_least(&b->above, rate, &x), bottom = -hull_least(&b->below, -rate, &y);

	return (struct fit){ .offset_ns = (top + bottom) / 2, .margin_ns = (top - bottom) / 2, .slope = (y - x) / 2 };
}

/* The margin is a concave function of the rate. */
static double widest_rate(const struct bounds *b)
{
	double low = -BB_CLOCKFIT_RATE_MAX, high = BB_CLOCKFIT_RATE_MAX;

	for (int k = 0; k < RATE_STEPS; k++) {
		const double middle = (low + high) / 2;
		if (fit_rate(b, middle).slope > 0)
			low = middle;
		else
			high = middle;
	}
	return (low + high) / 2;
}

/* The rate between `inside` and `outside` at which the margin falls to `level`; outside itself when it never does. */
static double rate_at_level(const struct bounds *b, double inside, double outside, double level)
{
	if (fit_rate(b, outside).margin_ns >= level)
		return outside;
	for (int k = 0; k < RATE_STEPS; k++) {
		const double middle = (inside + outside) / 2;
		if (fit_rate(b, middle).margin_ns >= level)
			inside = middle;
		else
			outside = middle;
	}
	return inside;
}

static double mean_excess_ns(const struct bounds *b, double rate, double margin_ns)
{
	if (!b->above.n) /* a line took two of the n */
		return (b->below.sum_bound - b->n * margin_ns) / (b->n - 2);
	const double sum_ns = b->above.sum_bound - rate * b->above.sum_at + b->below.sum_bound + rate * b->below.sum_at;

	/* A line and a margin fitted to the least of them took three of the 2 n. */
	return (sum_ns - 2 * b->n * margin_ns) / (2 * b->n - 3);
}

static void gather(struct bb_clockfit *f, const struct bb_exchange *newest, struct bounds *b)
{
	const unsigned oldest = f->n < f->window ? 0 : f->next;

	f->ref_ns = newest->t4_ns;
	f->base_ns = bb_ns_since(newest->t3_ns, newest->t4_ns);
	b->n = f->n;
	b->above.n = b->below.n = 0;
	b->above.sum_at = b->above.sum_bound = b->below.sum_at = b->below.sum_bound = 0;
	for (unsigned i = 0; i < f->n; i++) {
		const struct bb_exchange *e = &f->held[(oldest + i) % f->window];
		const int64_t above_ns = bb_ns_since(bb_ns_since(e->t2_ns, e->t1_ns), f->base_ns);
		const int64_t below_ns = bb_ns_since(bb_ns_since(e->t3_ns, e->t4_ns), f->base_ns);
		if (!f->one_way)
			hull_add(&b->above, (double)bb_ns_since(e->t1_ns, f->ref_ns), (double)above_ns);
		hull_add(&b->below, (double)bb_ns_since(e->t4_ns, f->ref_ns), -(double)below_ns);
	}
}

static struct bb_clockfit_line line_of(const struct bb_clockfit *f, const struct bounds *b, double rate)
{
	return (struct bb_clockfit_line){ .offset_ns = fit_rate(b, rate).offset_ns + (double)f->least_ns,
					  .rate = rate };
}

/* Too few for a rate: any offset within the bounds is possible, at any rate. */
static void solve_offset(struct bb_clockfit *f, const struct bounds *b)
{
	const struct fit flat = fit_rate(b, 0);

	/* One way nothing bounds the delay from above: another least delay, and what the arrivals differ by. */
	const double excess_ns = f->one_way ? b->below.sum_bound / b->n - flat.margin_ns : 0;
	f->delay_ns = f->one_way ? (double)f->least_ns : flat.margin_ns;
	f->spread_ns = f->one_way ? (double)f->least_ns + 2 * excess_ns + RESOLUTION_NS : fabs(flat.margin_ns);
	f->line = line_of(f, b, 0);
	f->low = (struct bb_clockfit_line){ f->line.offset_ns, -BB_CLOCKFIT_RATE_MAX };
	f->high = (struct bb_clockfit_line){ f->line.offset_ns, BB_CLOCKFIT_RATE_MAX };
}

static void solve(struct bb_clockfit *f, const struct bb_exchange *newest)
{
	struct bounds b;

	gather(f, newest, &b);
	if (f->n < BB_CLOCKFIT_RATE_LEAST) {
		solve_offset(f, &b);
		return;
	}
	const double widest = widest_rate(&b), margin_ns = fit_rate(&b, widest).margin_ns;
	/* The least delay of each direction lies mean / n above the true least; a margin that is smaller by x is
	 * exp(-2 n x / mean) as likely. */
	const double spread_ns = fmax(mean_excess_ns(&b, widest, margin_ns), 0) / f->n + RESOLUTION_NS;
	const double level_ns = margin_ns - (f->one_way ? 2 : 1) * LIKELY * spread_ns; /* n bounds instead of 2 n */
	f->low = line_of(f, &b, rate_at_level(&b, widest, -BB_CLOCKFIT_RATE_MAX, level_ns));
	f->high = line_of(f, &b, rate_at_level(&b, widest, BB_CLOCKFIT_RATE_MAX, level_ns));
	f->line = line_of(f, &b, (f->low.rate + f->high.rate) / 2);
	f->delay_ns = f->one_way ? (double)f->least_ns : fit_rate(&b, f->line.rate).margin_ns;
	f->spread_ns = (f->one_way ? 4 : 2) * spread_ns;
}

static double line_ns(const struct bb_clockfit_line *l, double since_ref_ns)
{
	return l->offset_ns + l->rate * since_ref_ns;
}

static double uncertainty_ns(const struct bb_clockfit *f, double since_ref_ns)
{
	const double at_ns = line_ns(&f->line, since_ref_ns);
	const double low_ns = fabs(line_ns(&f->low, since_ref_ns) - at_ns);
	const double high_ns = fabs(line_ns(&f->high, since_ref_ns) - at_ns);

	return fmax(low_ns, high_ns) + f->spread_ns + (double)f->asymmetry_ns;
}

static bool possible(const struct bb_clockfit *f, const struct bb_exchange *e)
{
	const int64_t round_trip_ns = bb_ns_since(e->t4_ns, e->t1_ns), held_ns = bb_ns_since(e->t3_ns, e->t2_ns);
	const unsigned newest = (f->next + f->window - 1) % f->window;

	if (round_trip_ns < 0 || round_trip_ns > ROUND_TRIP_MAX_NS || held_ns < 0)
		return false;
	/* What the remote clock may show at most while the local one shows the round trip. */
	if ((double)held_ns > (double)round_trip_ns * (1 + BB_CLOCKFIT_RATE_MAX) + RESOLUTION_NS)
		return false;
	return !f->n || bb_ns_since(e->t1_ns, f->held[newest].t1_ns) > 0;
}

/* A shorter way in both directions is news about the network; in one direction only it is a clock that moved. */
static bool contradicts(const struct bb_clockfit *f, const struct bb_exchange *e)
{
	const double x = (double)bb_ns_since(e->t1_ns, f->ref_ns), y = (double)bb_ns_since(e->t4_ns, f->ref_ns);
	const double above = (double)bb_ns_since(bb_ns_since(e->t2_ns, e->t1_ns), f->base_ns);
	const double below = (double)bb_ns_since(bb_ns_since(e->t3_ns, e->t4_ns), f->base_ns);
	const double up_ns = f->one_way ? 0 : line_ns(&f->line, x) + f->delay_ns - above;
	const double down_ns = below - (line_ns(&f->line, y) - f->delay_ns);
	const double more_ns = fmax(up_ns, down_ns), less_ns = fmin(up_ns, down_ns);

	return f->n >= BB_CLOCKFIT_RATE_LEAST && more_ns > GATE * uncertainty_ns(f, y) && less_ns < more_ns / 2;
}

static void restart(struct bb_clockfit *f)
{
	f->n = f->next = 0;
	f->outliers_in_row = 0;
	f->n_restarts++;
}

enum bb_clockfit_verdict bb_clockfit_add(struct bb_clockfit *f, const struct bb_exchange *x)
{
	enum bb_clockfit_verdict verdict = BB_CLOCKFIT_TAKEN;

	if (!possible(f, x)) {
		f->n_refused++;
		return BB_CLOCKFIT_REFUSED;
	}
	if (contradicts(f, x)) {
		f->n_outliers++;
		if (++f->outliers_in_row < OUTLIERS_IN_ROW)
			return BB_CLOCKFIT_OUTLIER;
		restart(f);
		verdict = BB_CLOCKFIT_RESTARTED;
	}
	f->outliers_in_row = 0;
	f->held[f->next] = *x;
	f->next = (f->next + 1) % f->window;
	f->n += f->n < f->window;
	solve(f, x);
	return verdict;
}

void bb_clockfit_init_one_way(struct bb_clockfit *f, unsigned window, int64_t least_ns)
{
	bb_clockfit_init(f, window);
	f->one_way = true;
	f->least_ns = least_ns > 0 ? least_ns : 0;
}

enum bb_clockfit_verdict bb_clockfit_add_one_way(struct bb_clockfit *f, int64_t stamp_ns, int64_t arrived_ns)
{
	/* Asked when it arrived, and answered with the stamp. */
	const struct bb_exchange x = { arrived_ns, stamp_ns, stamp_ns, arrived_ns };

	return bb_clockfit_add(f, &x);
}

static int64_t whole_ns(double ns)
{
	return ns >= 9e18 ? INT64_MAX : llrint(ns);
}

int64_t bb_clockfit_remote_ns(const struct bb_clockfit *f, int64_t local_ns, int64_t *uncertainty)
{
	const double since_ns = (double)bb_ns_since(local_ns, f->ref_ns);

	if (uncertainty)
		*uncertainty = f->n ? whole_ns(ceil(uncertainty_ns(f, since_ns))) : INT64_MAX;
	return f->n ? bb_ns_after(bb_ns_after(local_ns, f->base_ns), llrint(line_ns(&f->line, since_ns))) : local_ns;
}

int64_t bb_clockfit_local_ns(const struct bb_clockfit *f, int64_t remote_ns, int64_t *uncertainty)
{
	const int64_t near_ns = bb_ns_since(remote_ns, f->base_ns); /* right but for the line */
	const double since_ns = (double)bb_ns_since(near_ns, f->ref_ns);
	const double local_ns = (since_ns - f->line.offset_ns) / (1 + f->line.rate);

	if (uncertainty)
		*uncertainty = f->n ? whole_ns(ceil(uncertainty_ns(f, local_ns))) : INT64_MAX;
	/* since + (local - since): the small part alone is rounded. */
	return f->n ? bb_ns_after(near_ns, llrint(-line_ns(&f->line, local_ns))) : remote_ns;
}

double bb_clockfit_rate(const struct bb_clockfit *f, double *uncertainty)
{
	if (uncertainty)
		*uncertainty =
			f->n ? fmax(f->high.rate - f->line.rate, f->line.rate - f->low.rate) : BB_CLOCKFIT_RATE_MAX;
	return f->n ? f->line.rate : 0;
}
