/*
 * bench/stats.c: tallies and nearest-rank percentiles. Pure; no thread, no unit of its own.
 */
#include "bench/stats.h"

#include <stdlib.h>

/* A running sum that keeps what each addition rounds away (Neumaier), so a mean over days of frames stays exact. */
static void sum_add(struct bb_tally *t, double v)
{
	const double sum = t->sum + v;

	t->sum_low += fabs(t->sum) >= fabs(v) ? (t->sum - sum) + v : (v - sum) + t->sum;
	t->sum = sum;
}

void bb_tally_add(struct bb_tally *t, double v)
{
	t->min = t->n ? fmin(t->min, v) : v;
	t->max = t->n ? fmax(t->max, v) : v;
	t->n++;
	sum_add(t, v);
	t->sum_sq += v * v;
}

void bb_tally_merge(struct bb_tally *t, const struct bb_tally *other)
{
	if (!other->n)
		return;
	t->min = t->n ? fmin(t->min, other->min) : other->min;
	t->max = t->n ? fmax(t->max, other->max) : other->max;
	t->n += other->n;
	sum_add(t, other->sum);
	t->sum_low += other->sum_low;
	t->sum_sq += other->sum_sq;
}

double bb_tally_mean(const struct bb_tally *t)
{
	return t->n ? (t->sum + t->sum_low) / (double)t->n : BB_UNKNOWN;
}

static int by_value(const void *a, const void *b)
{
	const double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

void bb_stats_sort(double *v, size_t n)
{
	if (n > 1)
		qsort(v, n, sizeof(*v), by_value);
}

double bb_stats_nearest_rank(const double *sorted, size_t n, double p)
{
	if (!n)
		return BB_UNKNOWN;
	/* The small subtraction keeps 0.99 * 100 at rank 99 although the product may round up. */
	const double rank = ceil(p * (double)n - 1e-9 * (double)n);

	if (rank <= 1)
		return sorted[0];
	return rank >= (double)n ? sorted[n - 1] : sorted[(size_t)rank - 1];
}

struct bb_summary bb_stats_summary(const struct bb_tally *t, double *stored, size_t n)
{
	struct bb_summary s = { .n = t->n,
		                .min = BB_UNKNOWN,
		                .p50 = BB_UNKNOWN,
		                .p99 = BB_UNKNOWN,
		                .max = BB_UNKNOWN,
		                .mean = BB_UNKNOWN,
		                .rms = BB_UNKNOWN,
		                .max_abs = BB_UNKNOWN,
		                .uncertainty = BB_UNKNOWN };

	s.worst.stage = BB_STAGE_COUNT;
	s.worst.node = UINT16_MAX;
	s.worst.value = BB_UNKNOWN;
	if (!t->n)
		return s;
	bb_stats_sort(stored, n);
	s.min = t->min;
	s.max = t->max;
	s.p50 = bb_stats_nearest_rank(stored, n, 0.50);
	s.p99 = bb_stats_nearest_rank(stored, n, 0.99);
	s.mean = bb_tally_mean(t);
	s.rms = sqrt(t->sum_sq / (double)t->n);
	s.max_abs = fmax(fabs(t->min), fabs(t->max));
	return s;
}
