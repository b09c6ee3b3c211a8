/* drivers/edge_lock.c: see drivers/edge_lock.h. All shares below are of the period. */
#include "drivers/edge_lock.h"

#include <math.h>
#include <string.h>

#define BOUNCE 0.25     /* an edge this soon after another is none */
#define SILENT 1.5
#define STRAY 0.35      /* this far from every place is no frame's edge */
#define GOOD 0.02
#define MOST_MISSED 2   /* frames; more is a loss of sync */
#define GOOD_EDGES 8
#define AGREEING 10
#define OTHER_RATE 0.1025 /* mean of 4 intervals: jitter of +-20 % cannot move it by more than 10 % */
#define SAME_INTERVAL 0.10
#define OFF_RATE 0.01
#define LEAST_PERIOD 0.1 /* of the configured one */
#define MOST_PERIOD 10
#define HOLDOVER_SHARE 0.1
#define FAST_ALPHA 0.5
#define FAST_BETA 0.1
#define ALPHA 0.1
#define BETA 0.005
#define OUTLIER_GAIN 0.125
#define GATE_SIGMAS 4
#define SPAN_NS BB_NS_PER_S

const char *bb_sync_fault_text(enum bb_sync_fault fault)
{
	static const char *const text[] = {
#define X(name, word) word,
		BB_SYNC_FAULTS(X)
#undef X
	};
	return (unsigned)fault < BB_ARRAY_LEN(text) ? text[fault] : "unknown";
}

void bb_edge_lock_raise(struct bb_edge_lock *l, enum bb_sync_fault fault, uint64_t n, int64_t now_ns)
{
	struct bb_sync_fault_state *f = &l->fault[fault];

	if (!f->set)
		f->set_ns = now_ns;
	f->set = true;
	f->n += n;
	l->news |= 1u << fault;
}

void bb_edge_lock_clear(struct bb_edge_lock *l, enum bb_sync_fault fault, int64_t now_ns)
{
	struct bb_sync_fault_state *f = &l->fault[fault];

	if (f->set)
		f->cleared_ns = now_ns;
	f->set = false;
}

void bb_edge_lock_init(struct bb_edge_lock *l, struct bb_rate rate, double holdover_ppm, int64_t now_ns)
{
	memset(l, 0, sizeof(*l));
	l->nominal_ns = bb_rate_period_ns(rate);
	l->period_ns = (double)l->nominal_ns;
	l->holdover_ppm = holdover_ppm;
	l->raw_ns = now_ns;
	l->second = now_ns / BB_NS_PER_S;
}

/* ---- glitches a minute ---- */

static void turn_minute(struct bb_edge_lock *l, int64_t now_ns)
{
	const int64_t second = now_ns / BB_NS_PER_S;

	if (second - l->second >= BB_LOCK_SECONDS) {
		memset(l->glitch_in, 0, sizeof(l->glitch_in));
		memset(l->edge_in, 0, sizeof(l->edge_in));
		l->glitches_min = l->edges_min = 0;
		l->second = second;
	}
	while (l->second < second) {
		const size_t i = (size_t)(++l->second % BB_LOCK_SECONDS);
		l->glitches_min -= l->glitch_in[i];
		l->edges_min -= l->edge_in[i];
		l->glitch_in[i] = l->edge_in[i] = 0;
	}
}

static void count(uint16_t *bin, uint32_t *sum)
{
	if (*bin == UINT16_MAX)
		return;
	++*bin;
	++*sum;
}

static bool often(const struct bb_edge_lock *l)
{
	return l->glitches_min * 100 > l->edges_min && l->glitches_min > 1;
}

static void glitch(struct bb_edge_lock *l, int64_t now_ns)
{
	struct bb_sync_fault_state *f = &l->fault[BB_SYNC_GLITCH];

	turn_minute(l, now_ns);
	count(&l->glitch_in[l->second % BB_LOCK_SECONDS], &l->glitches_min);
	bb_edge_lock_raise(l, BB_SYNC_GLITCH, 1, now_ns);
	if (!often(l)) { /* dropped and done with */
		f->set = false;
		f->cleared_ns = now_ns;
	}
}

/* ---- the loop ---- */

static double period_share(const struct bb_edge_lock *l, double share)
{
	return share * l->period_ns;
}

static void begin_loop(struct bb_edge_lock *l, const struct bb_line_event *e, double period_ns)
{
	const double steps = l->any ? (double)(e->at_ns - l->ref_ns) / l->period_ns : 0;

	l->tick += l->any ? (uint32_t)(int64_t)fmin(fmax(round(steps), 1), 1e9) : 0;
	l->period_ns = period_ns;
	l->ref_ns = e->at_ns;
	l->sigma_ns = 0;
	l->fresh = l->good = l->strays = 0;
	l->n_intervals = l->n_innovations = 0;
	l->locked = l->span_any = l->drift_known = false;
	l->parity_known = l->parity_before = false;
	l->alternating = l->against = 0;
	l->any = true;
}

static void note_interval(struct bb_edge_lock *l, int64_t at_ns)
{
	if (l->any)
		l->interval_ns[l->n_intervals++ % BB_LOCK_INTERVALS] = at_ns - l->raw_ns;
	if (l->n_intervals == 2 * BB_LOCK_INTERVALS)
		l->n_intervals = BB_LOCK_INTERVALS;
	l->raw_ns = at_ns;
	l->silent = false;
}

/* Do the last intervals agree with each other, and not with the period? Then *period_ns is theirs. */
static bool other_rate(const struct bb_edge_lock *l, double *period_ns)
{
	int64_t least = INT64_MAX, most = 0, sum = 0;

	if (l->n_intervals < BB_LOCK_INTERVALS)
		return false;
	for (int i = 0; i < BB_LOCK_INTERVALS; i++) {
		least = l->interval_ns[i] < least ? l->interval_ns[i] : least;
		most = l->interval_ns[i] > most ? l->interval_ns[i] : most;
		sum += l->interval_ns[i];
	}
	const double mean_ns = (double)sum / BB_LOCK_INTERVALS;
	*period_ns = mean_ns;
	if (mean_ns < LEAST_PERIOD * (double)l->nominal_ns || mean_ns > MOST_PERIOD * (double)l->nominal_ns)
		return false; /* no sync signal at all */
	return (double)(most - least) <= SAME_INTERVAL * mean_ns &&
	       fabs(mean_ns - l->period_ns) > OTHER_RATE * l->period_ns;
}

bool bb_edge_lock_off_rate(const struct bb_edge_lock *l)
{
	return fabs(l->period_ns / (double)l->nominal_ns - 1) > OFF_RATE;
}

double bb_edge_lock_jitter_ns(const struct bb_edge_lock *l)
{
	return l->sigma_ns;
}

static void judge_jitter(struct bb_edge_lock *l, double innovation_ns, int64_t now_ns)
{
	const unsigned most = BB_ARRAY_LEN(l->innovation_ns);
	double square = 0;

	l->innovation_ns[l->n_innovations++ % most] = innovation_ns;
	if (l->n_innovations == 2 * most)
		l->n_innovations = most;
	if (!l->locked || l->n_innovations < most)
		return;
	for (unsigned i = 0; i < most; i++)
		square += l->innovation_ns[i] * l->innovation_ns[i];
	if (sqrt(square / most) > period_share(l, GOOD))
		bb_edge_lock_raise(l, BB_SYNC_JITTER, 1, now_ns);
}

/* Moves phase and period by an innovation; an outlier moves them less. */
static void follow(struct bb_edge_lock *l, const struct bb_line_event *e, double innovation_ns, double steps)
{
	const bool fast = l->fresh < GOOD_EDGES;
	const double gate_ns = fmax(GATE_SIGMAS * l->sigma_ns, period_share(l, GOOD));
	const double trust = !fast && fabs(innovation_ns) > gate_ns ? OUTLIER_GAIN : 1;
	const double inside_ns = fmin(fabs(innovation_ns), gate_ns);

	l->ref_ns = e->at_ns - (int64_t)llround((1 - trust * (fast ? FAST_ALPHA : ALPHA)) * innovation_ns);
	l->period_ns += trust * (fast ? FAST_BETA : BETA) * innovation_ns / steps;
	l->period_ns = fmin(fmax(l->period_ns, LEAST_PERIOD * (double)l->nominal_ns), MOST_PERIOD * (double)l->nominal_ns);
	l->sigma_ns = sqrt(l->sigma_ns * l->sigma_ns * 63 / 64 + inside_ns * inside_ns / 64);
	l->good = fabs(innovation_ns) <= period_share(l, GOOD) ? l->good + 1 : 0;
	if (l->fresh < GOOD_EDGES)
		l->fresh++;
}

/* Over the filtered places: they carry a fifth of the edges' jitter. */
static void measure_drift(struct bb_edge_lock *l)
{
	const int64_t span_ns = l->ref_ns - l->span_ns;

	if (l->span_any && span_ns < SPAN_NS)
		return;
	if (l->span_any) {
		const double ideal_ns = (double)(uint32_t)(l->tick - l->span_tick) * (double)l->nominal_ns;
		l->drift_ppm = (ideal_ns / (double)span_ns - 1) * 1e6; /* of the rate: fast is positive */
		l->drift_known = true;
	}
	l->span_any = true;
	l->span_ns = l->ref_ns;
	l->span_tick = l->tick;
}

/* ---- the eyes ---- */

static void parity_lost(struct bb_edge_lock *l)
{
	l->parity_before = l->parity_before || l->parity_known;
	l->parity_known = false;
	l->alternating = l->against = 0;
}

/* The levels go against the numbers: the source has changed its mind about left and right. */
static void swapped(struct bb_edge_lock *l, bool even_level, int64_t now_ns)
{
	l->even_level = even_level;
	l->against = l->agreeing = 0;
	bb_edge_lock_raise(l, BB_SYNC_SWAP, 1, now_ns);
}

static bool learn_parity(struct bb_edge_lock *l, bool even_level, int64_t now_ns)
{
	if (!l->alternating)
		return false;
	if (l->parity_before && l->even_level != even_level)
		swapped(l, even_level, now_ns);
	l->even_level = even_level;
	l->parity_known = l->parity_before = true;
	bb_edge_lock_clear(l, BB_SYNC_OVERRUN, now_ns);
	return true;
}

/* Is the eye of this accepted edge certain? */
static bool certain(struct bb_edge_lock *l, const struct bb_line_event *e, int64_t now_ns)
{
	const bool even_level = e->level ^ (l->tick & 1);

	if (!l->parity_known)
		return learn_parity(l, even_level, now_ns);
	if (even_level == l->even_level) {
		l->against = 0;
		if (++l->agreeing >= AGREEING)
			bb_edge_lock_clear(l, BB_SYNC_SWAP, now_ns);
		return true;
	}
	l->unmatched++;
	l->agreeing = 0;
	if (++l->against < 2 || !l->alternating)
		return false; /* one alone may be a level that was read late */
	swapped(l, even_level, now_ns);
	return true;
}

/* ---- events ---- */

static void recovered(struct bb_edge_lock *l, int64_t now_ns)
{
	if (l->good < GOOD_EDGES)
		return;
	l->locked = true;
	bb_edge_lock_clear(l, BB_SYNC_LOST, now_ns);
	bb_edge_lock_clear(l, BB_SYNC_JITTER, now_ns);
	bb_edge_lock_clear(l, BB_SYNC_RATE, now_ns);
}

/* Frames without an edge before this one: missed, or lost with the events the bus owned up to. */
static void note_gap(struct bb_edge_lock *l, const struct bb_line_event *e, int64_t missing, int64_t now_ns)
{
	struct bb_sync_fault_state *m = &l->fault[BB_SYNC_MISSED];
	const bool inferred = !l->numbered && (missing > 0 || e->level == l->level);

	if (inferred && !e->overflow) {
		bb_edge_lock_raise(l, BB_SYNC_OVERRUN, 1, now_ns);
		parity_lost(l);
	} else if (!e->overflow && missing > 0 && missing <= MOST_MISSED) {
		bb_edge_lock_raise(l, BB_SYNC_MISSED, (uint64_t)missing, now_ns);
		m->set_ns = l->fault[BB_SYNC_LOST].set ? l->fault[BB_SYNC_LOST].set_ns : now_ns;
		m->set = false;
		m->cleared_ns = now_ns;
	}
	if (missing > MOST_MISSED)
		l->good = l->n_innovations = 0;
	else if (missing > 0 && l->good >= GOOD_EDGES) /* it was a short silence of a good signal */
		bb_edge_lock_clear(l, BB_SYNC_LOST, now_ns);
}

static void accept(struct bb_edge_lock *l, const struct bb_line_event *e, int64_t now_ns, struct bb_shutter_edge *out)
{
	l->edges++;
	turn_minute(l, now_ns);
	count(&l->edge_in[l->second % BB_LOCK_SECONDS], &l->edges_min);
	if (!often(l))
		bb_edge_lock_clear(l, BB_SYNC_GLITCH, now_ns);
	*out = (struct bb_shutter_edge){ .at_ns = e->at_ns, .seq = l->tick, .eye = BB_EYE_NONE };
	if (certain(l, e, now_ns))
		out->eye = e->level ? BB_EYE_LEFT : BB_EYE_RIGHT;
	l->edge_ns = e->at_ns;
	l->level = e->level;
	l->lost = false;
}

/* Starts over at this edge, with a period if it is known. */
static void restart(struct bb_edge_lock *l, const struct bb_line_event *e, double period_ns, int64_t now_ns,
                    struct bb_shutter_edge *out)
{
	begin_loop(l, e, period_ns);
	bb_edge_lock_clear(l, BB_SYNC_JITTER, now_ns);
	accept(l, e, now_ns, out);
}

static bool stray(struct bb_edge_lock *l, const struct bb_line_event *e, int64_t now_ns, struct bb_shutter_edge *out)
{
	glitch(l, now_ns);
	if (++l->strays < 3)
		return false;
	/* Three in a row: it is the phase that moved. */
	bb_edge_lock_raise(l, BB_SYNC_LOST, 1, now_ns);
	restart(l, e, l->period_ns, now_ns, out);
	return true;
}

/* False: too soon after the last one to be more than a bounce. */
static bool plausible(struct bb_edge_lock *l, const struct bb_line_event *e, int64_t now_ns)
{
	if (!l->any || (double)(e->at_ns - l->raw_ns) >= period_share(l, BOUNCE))
		return true;
	glitch(l, now_ns);
	return false;
}

bool bb_edge_lock_event(struct bb_edge_lock *l, const struct bb_line_event *e, int64_t now_ns,
                        struct bb_shutter_edge *out)
{
	double period_ns;

	l->numbered = l->numbered || e->seq;
	if (e->overflow) {
		bb_edge_lock_raise(l, BB_SYNC_OVERRUN, 1, now_ns);
		parity_lost(l);
	}
	if (!plausible(l, e, now_ns))
		return false;
	note_interval(l, e->at_ns);
	if (!l->any || l->lost) {
		restart(l, e, l->period_ns, now_ns, out);
		return true;
	}
	if (other_rate(l, &period_ns)) {
		bb_edge_lock_raise(l, BB_SYNC_RATE, 1, now_ns);
		restart(l, e, period_ns, now_ns, out);
		return true;
	}
	const int64_t steps = llround((double)(e->at_ns - l->ref_ns) / l->period_ns);
	const double innovation_ns = (double)(e->at_ns - l->ref_ns) - (double)steps * l->period_ns;
	if (steps < 1 || fabs(innovation_ns) > period_share(l, STRAY))
		return stray(l, e, now_ns, out);
	l->strays = 0;
	l->tick += (uint32_t)steps;
	note_gap(l, e, steps - 1, now_ns);
	l->alternating = steps == 1 && e->level != l->level && !e->overflow ? l->alternating + 1 : 0;
	judge_jitter(l, innovation_ns, now_ns);
	follow(l, e, innovation_ns, (double)steps);
	recovered(l, now_ns);
	measure_drift(l);
	accept(l, e, now_ns, out);
	return true;
}

/* ---- silence ---- */

static int64_t time_box_ns(const struct bb_edge_lock *l)
{
	return (int64_t)fmin(HOLDOVER_SHARE * l->period_ns / (l->holdover_ppm * 1e-6), 1e15);
}

void bb_edge_lock_pass(struct bb_edge_lock *l, int64_t now_ns)
{
	if ((double)(now_ns - l->raw_ns) < period_share(l, SILENT))
		return;
	if (!l->silent)
		bb_edge_lock_raise(l, BB_SYNC_LOST, 1, now_ns);
	l->silent = true;
	if (!l->lost && now_ns - l->raw_ns >= time_box_ns(l)) {
		l->lost = true;
		l->locked = false;
	}
}

int64_t bb_edge_lock_wake_ns(const struct bb_edge_lock *l)
{
	if (l->lost)
		return BB_NEVER;
	return l->raw_ns + (l->silent ? time_box_ns(l) : (int64_t)ceil(period_share(l, SILENT)));
}

int64_t bb_edge_lock_holdover_ns(const struct bb_edge_lock *l, int64_t now_ns)
{
	const int64_t left_ns = l->raw_ns + time_box_ns(l) - now_ns;

	return l->lost || left_ns < 0 ? 0 : left_ns;
}

void bb_edge_lock_reopened(struct bb_edge_lock *l)
{
	l->numbered = false;
	l->good = 0;
	parity_lost(l);
}

enum bb_health bb_edge_lock_health(const struct bb_edge_lock *l)
{
	static const enum bb_sync_fault degrading[] = { BB_SYNC_GLITCH, BB_SYNC_OVERRUN, BB_SYNC_JITTER, BB_SYNC_RATE,
		                                        BB_SYNC_SWAP };

	if (l->lost)
		return BB_HEALTH_LOST;
	if (l->fault[BB_SYNC_GONE].set)
		return BB_HEALTH_HOLDOVER;
	if (l->fault[BB_SYNC_LOST].set)
		return l->silent ? BB_HEALTH_HOLDOVER : BB_HEALTH_RECOVERING;
	if (!l->locked)
		return BB_HEALTH_INIT;
	for (size_t i = 0; i < BB_ARRAY_LEN(degrading); i++)
		if (l->fault[degrading[i]].set)
			return BB_HEALTH_DEGRADED;
	return bb_edge_lock_off_rate(l) ? BB_HEALTH_DEGRADED : BB_HEALTH_OK;
}
