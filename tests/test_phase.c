/* tests/test_phase.c: period, phase, parity, missed and double edges of a chain, from edges alone. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "sync/phase.h"

#define PERIOD 8333333.25 /* 120 Hz, a little slow */

static int64_t edge_ns(uint32_t n)
{
	return (int64_t)llround(PERIOD * n);
}

static struct bb_shutter_edge edge(uint32_t n, uint8_t stage, int64_t offset_ns)
{
	return (struct bb_shutter_edge){ edge_ns(n) + offset_ns, n, n % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT, stage };
}

static struct bb_phase feed(uint32_t n, int64_t stage_offset_ns)
{
	const struct bb_rate rate = { 120, 1 };
	struct bb_phase p;

	bb_phase_init(&p, rate, 2);
	for (uint32_t i = 0; i < n; i++) {
		const struct bb_shutter_edge first = edge(i, 0, 20000);
		const struct bb_shutter_edge e = edge(i, BB_STAGE_EMITTER, 0);
		const struct bb_shutter_edge second = edge(i, 1, stage_offset_ns);
		bb_phase_edge(&p, &first);
		bb_phase_edge(&p, &e);
		bb_phase_edge(&p, &second);
	}
	return p;
}

static void measures_period_and_worst_stage(void **state)
{
	const struct bb_phase p = feed(600, -900000);
	int64_t offset_ns;
	unsigned stage;
	(void)state;

	assert_true(fabs(bb_phase_period_ns(&p) - PERIOD) < 1);
	assert_true(bb_phase_worst(&p, &offset_ns, &stage));
	assert_int_equal(stage, 1);
	assert_int_equal(offset_ns, -900000);
	assert_int_equal(p.stage[0].missed + p.stage[0].doubled, 0);
	assert_true(bb_phase_jitter_ns(&p) < 2);
}

static void sees_missed_and_double_edges(void **state)
{
	struct bb_phase p = feed(10, 0);
	struct bb_shutter_edge e = edge(9, BB_STAGE_EMITTER, 300000);
	(void)state;

	bb_phase_edge(&p, &e); /* the same edge again, 0.3 ms later: bounce */
	assert_int_equal(p.emitter.doubled, 1);
	e = edge(12, BB_STAGE_EMITTER, 0); /* 10 and 11 never came */
	bb_phase_edge(&p, &e);
	assert_int_equal(p.emitter.missed, 2);
	assert_int_equal(bb_phase_eye_at(&p, e.at_ns + 1000), BB_EYE_LEFT); /* parity kept through the gap */
}

static void sees_swapped_eyes(void **state)
{
	struct bb_phase p = feed(10, 0);
	struct bb_shutter_edge e = edge(10, BB_STAGE_EMITTER, 0), s = edge(10, 1, 5000);
	(void)state;

	assert_false(p.stage[1].eye_differs);
	e.eye = e.eye == BB_EYE_LEFT ? BB_EYE_RIGHT : BB_EYE_LEFT;
	bb_phase_edge(&p, &e);
	bb_phase_edge(&p, &s);
	assert_true(p.stage[1].eye_differs);
}

static void predicts_openings(void **state)
{
	const struct bb_phase p = feed(11, 0); /* newest: edge 10, left opens */
	const int64_t at_ns = edge_ns(10) + 1000000;
	(void)state;

	assert_int_equal(bb_phase_open_ns(&p, BB_EYE_LEFT, at_ns), at_ns);
	assert_true(llabs(bb_phase_open_ns(&p, BB_EYE_RIGHT, at_ns) - edge_ns(11)) < 10);
	assert_true(llabs(bb_phase_open_ns(&p, BB_EYE_LEFT, edge_ns(13) + 5) - edge_ns(14)) < 20);
	assert_int_equal(bb_phase_eye_at(&p, edge_ns(9) + 1000), BB_EYE_RIGHT); /* backwards as well */
}

static void is_calm_without_edges(void **state)
{
	const struct bb_phase p = feed(0, 0);
	int64_t offset_ns;
	unsigned stage;
	(void)state;

	assert_false(bb_phase_worst(&p, &offset_ns, &stage));
	assert_int_equal(bb_phase_open_ns(&p, BB_EYE_LEFT, 5), 5);
	assert_int_equal(bb_phase_eye_at(&p, 5), BB_EYE_NONE);
	assert_int_equal((int64_t)bb_phase_period_ns(&p), 8333333);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(measures_period_and_worst_stage), cmocka_unit_test(sees_missed_and_double_edges),
		cmocka_unit_test(sees_swapped_eyes),               cmocka_unit_test(predicts_openings),
		cmocka_unit_test(is_calm_without_edges),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
