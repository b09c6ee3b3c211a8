/* tests/test_ledger.c: exact statistics, bounded memory, and what happens past the capacity. */
#include "bench/ledger.h"
#include "bench/stats.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

static void sample(struct bb_ledger *l, enum bb_metric metric, double value, uint64_t frame)
{
	const struct bb_sample s = { value, 0.5, frame, (int64_t)frame * 1000, 0, BB_STAGE_DRAW };

	bb_ledger_sample(l, metric, &s);
}

static void near(double got, double want, double tolerance)
{
	if (!(fabs(got - want) <= tolerance))
		fail_msg("got %.12g, want %.12g", got, want);
}

static void test_nearest_rank(void **state)
{
	double v[100];

	(void)state;
	for (int i = 0; i < 100; i++)
		v[i] = i + 1;
	near(bb_stats_nearest_rank(v, 100, 0.99), 99, 0);
	near(bb_stats_nearest_rank(v, 100, 0.50), 50, 0);
	near(bb_stats_nearest_rank(v, 100, 1), 100, 0);
	near(bb_stats_nearest_rank(v, 1, 0.99), 1, 0);
	near(bb_stats_nearest_rank(v, 3, 0.5), 2, 0);
	near(bb_stats_nearest_rank(v, 7, 0.99), 7, 0);
	assert_true(isnan(bb_stats_nearest_rank(v, 0, 0.5)));
}

/* Every n and p against the definition, counted out. */
static void test_nearest_rank_by_definition(void **state)
{
	static const double shares[] = { 0.01, 0.05, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 0.999 };
	double v[2000];

	(void)state;
	for (int i = 0; i < 2000; i++)
		v[i] = i;
	for (size_t n = 1; n <= 2000; n++)
		for (size_t k = 0; k < sizeof(shares) / sizeof(shares[0]); k++) {
			size_t rank = 1;
			while ((double)rank < shares[k] * (double)n - 1e-6)
				rank++;
			near(bb_stats_nearest_rank(v, n, shares[k]), (double)rank - 1, 0);
		}
}

static void test_metric_summary(void **state)
{
	struct bb_ledger *l;
	struct bb_summary s;

	(void)state;
	assert_int_equal(bb_ledger_create(1000, 2, &l), BB_OK);
	for (uint64_t i = 0; i < 1000; i++)
		sample(l, BB_METRIC_PHASE, i == 500 ? -2000 : (double)(i % 100), i);
	s = bb_ledger_metric(l, BB_METRIC_PHASE);
	assert_int_equal(s.n, 1000);
	near(s.min, -2000, 0);
	near(s.max, 99, 0);
	near(s.max_abs, 2000, 0);
	near(s.p50, 49, 0);
	near(s.p99, 98, 0);
	near(s.mean, (49500 - 2000) / 1000.0, 1e-12);
	assert_int_equal(s.worst.frame, 500);
	near(s.uncertainty, 0.5, 0);
	near(bb_summary_stat(&s, BB_STAT_MAX_ABS), 2000, 0);
	near(bb_summary_stat(&s, BB_STAT_RMS), s.rms, 0);
	assert_int_equal(bb_ledger_dropped(l), 0);
	bb_ledger_destroy(l);
}

static void test_lower_limit_is_worst_when_small(void **state)
{
	struct bb_ledger *l;

	(void)state;
	assert_int_equal(bb_ledger_create(10, 1, &l), BB_OK);
	sample(l, BB_METRIC_PSNR, 40, 1);
	sample(l, BB_METRIC_PSNR, 31, 2);
	sample(l, BB_METRIC_PSNR, 45, 3);
	assert_int_equal(bb_ledger_metric(l, BB_METRIC_PSNR).worst.frame, 2);
	bb_ledger_destroy(l);
}

static void test_empty(void **state)
{
	struct bb_ledger *l;
	struct bb_summary s;

	(void)state;
	assert_int_equal(bb_ledger_create(0, 0, &l), BB_OK);
	s = bb_ledger_metric(l, BB_METRIC_FRAME);
	assert_int_equal(s.n, 0);
	assert_true(isnan(s.p99) && isnan(s.max) && isnan(s.mean) && isnan(s.max_abs));
	assert_int_equal(bb_ledger_stage(l, BB_STAGE_DRAW, 0xFFFF).n, 0);
	bb_ledger_destroy(l);
	bb_ledger_destroy(NULL);
}

/* Past the capacity values are counted as dropped and still move minimum, maximum and mean. */
static void test_capacity(void **state)
{
	const struct bb_sample *kept;
	struct bb_ledger *l;
	struct bb_summary s;
	size_t n;

	(void)state;
	assert_int_equal(bb_ledger_create(0, 0, &l), BB_OK);
	for (uint64_t i = 0; i < 5000; i++)
		sample(l, BB_METRIC_FRAME, (double)i, i);
	n = bb_ledger_samples(l, BB_METRIC_FRAME, &kept);
	assert_true(n < 5000 && n >= 1024);
	assert_int_equal(bb_ledger_dropped(l), 5000 - n);
	s = bb_ledger_metric(l, BB_METRIC_FRAME);
	assert_int_equal(s.n, 5000);
	near(s.max, 4999, 0);
	near(s.mean, 2499.5, 1e-9);
	assert_int_equal(s.worst.frame, 4999);
	near(s.p99, ceil(0.99 * (double)n) - 1, 0);
	bb_ledger_destroy(l);

	assert_int_equal(bb_ledger_create(0, 1, &l), BB_OK);
	for (int i = 1; i <= 5000; i++) {
		const struct bb_frame_row row = { .frame = (uint64_t)i };
		bb_ledger_span(l, (uint64_t)i, BB_STAGE_DRAW, 0, 0, 0, (int64_t)i * 1000000);
		bb_ledger_mark(l, BB_TRACK_VSYNC, 0, i, 0, 0);
		bb_ledger_row(l, &row);
	}
	const struct bb_span *span;
	const struct bb_mark *mark;
	const struct bb_frame_row *row;
	const size_t left = bb_ledger_spans(l, &span) + bb_ledger_marks(l, &mark) + bb_ledger_rows(l, &row);
	assert_true(left < 15000);
	assert_int_equal(bb_ledger_dropped(l), 15000 - left);
	near(bb_ledger_stage(l, BB_STAGE_DRAW, 0xFFFF).max, 5000, 1e-9);
	near(bb_ledger_stage(l, BB_STAGE_DRAW, 0).mean, 2500.5, 1e-9);
	bb_ledger_destroy(l);
}

static void test_not_a_number(void **state)
{
	struct bb_ledger *l;

	(void)state;
	assert_int_equal(bb_ledger_create(10, 1, &l), BB_OK);
	sample(l, BB_METRIC_FRAME, (double)NAN, 0);
	sample(l, BB_METRIC_FRAME, (double)INFINITY, 1);
	sample(l, BB_METRIC_FRAME, 3, 2);
	assert_int_equal(bb_ledger_metric(l, BB_METRIC_FRAME).n, 1);
	assert_int_equal(bb_ledger_dropped(l), 2);
	bb_ledger_destroy(l);
}

static void test_stages(void **state)
{
	const struct bb_span *span;
	struct bb_ledger *l;
	struct bb_summary s;

	(void)state;
	assert_int_equal(bb_ledger_create(10, 2, &l), BB_OK);
	bb_ledger_span(l, 1, BB_STAGE_DRAW, 0, 0, 1000000, 3000000);
	bb_ledger_span(l, 1, BB_STAGE_DRAW, 1, 0, 1000000, 8000000);
	bb_ledger_span(l, 2, BB_STAGE_DRAW, 1, 0, 9000000, 12000000);
	bb_ledger_span(l, 1, BB_STAGE_WAIT, 0xFFFF, 0, 0, 500000);
	bb_ledger_span(l, 1, BB_STAGE_DRAW, 7, 0, 0, 1); /* no such node */
	assert_int_equal(bb_ledger_dropped(l), 1);
	s = bb_ledger_stage(l, BB_STAGE_DRAW, 0xFFFF);
	assert_int_equal(s.n, 3);
	near(s.max, 7, 1e-12);
	near(s.p50, 3, 1e-12);
	assert_int_equal(s.worst.node, 1);
	assert_int_equal(s.worst.frame, 1);
	near(bb_ledger_stage(l, BB_STAGE_DRAW, 0).max, 2, 1e-12);
	near(bb_ledger_stage(l, BB_STAGE_WAIT, 0xFFFF).p50, 0.5, 1e-12);
	assert_int_equal(bb_ledger_spans(l, &span), 4);
	bb_ledger_destroy(l);
}

static void test_absurd_sizes(void **state)
{
	struct bb_ledger *l;

	(void)state;
	assert_int_equal(bb_ledger_create(SIZE_MAX, 100000, &l), BB_ERR_RANGE);
	assert_null(l);
	assert_int_equal(bb_ledger_create(SIZE_MAX / 2, 18, &l), BB_OK); /* saturates: a soak of any length */
	bb_ledger_destroy(l);
}

/* One part in 1e16 added a million times: a naive sum loses all of it. */
static void test_mean_is_exact(void **state)
{
	struct bb_tally t = { 0 };

	(void)state;
	bb_tally_add(&t, 1e16);
	for (int i = 0; i < 1000000; i++)
		bb_tally_add(&t, 1);
	near(bb_tally_mean(&t) * 1000001, 1e16 + 1e6, 4);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_nearest_rank),      cmocka_unit_test(test_nearest_rank_by_definition),
		cmocka_unit_test(test_metric_summary),    cmocka_unit_test(test_lower_limit_is_worst_when_small),
		cmocka_unit_test(test_empty),             cmocka_unit_test(test_capacity),
		cmocka_unit_test(test_not_a_number),      cmocka_unit_test(test_stages),
		cmocka_unit_test(test_absurd_sizes),      cmocka_unit_test(test_mean_is_exact),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
