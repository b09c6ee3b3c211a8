/*
 * bench/stats.h: the few statistics every verdict rests on: running tallies that see every value, and nearest-rank
 * percentiles of what was stored. Pure; the unit is the caller's.
 */
#ifndef BB_BENCH_STATS_H
#define BB_BENCH_STATS_H

#include "bench/ledger.h"

#include <math.h>

#define BB_UNKNOWN ((double)NAN) /* NAN itself is a float */

struct bb_tally { /* zero is empty */
	size_t n;
	double min, max, sum, sum_low, sum_sq; /* sum_low: what rounding took from sum */
};

void bb_tally_add(struct bb_tally *t, double v);
void bb_tally_merge(struct bb_tally *t, const struct bb_tally *other);
double bb_tally_mean(const struct bb_tally *t); /* NAN when empty */

void bb_stats_sort(double *v, size_t n);
/* The smallest value with at least the share p (0..1] of all values at or below it; NAN when n is 0. */
double bb_stats_nearest_rank(const double *sorted, size_t n, double p);
/* min, max, mean, rms, max_abs of every value seen; percentiles of the n stored ones, which get sorted in place. */
struct bb_summary bb_stats_summary(const struct bb_tally *t, double *stored, size_t n);

#endif
