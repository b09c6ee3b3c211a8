/*
 * tests/gamepad_contract.h: what every gamepad back end must do, as checks on an open pad. Which back end it is, and
 * whether time passes or is waited for, is the business of whoever opens the bench: tests/contract_gamepad.c for sims and
 * wires, tests/hw_gamepad.h for a room, where perhaps nobody touches the pad.
 */
#ifndef BB_TESTS_GAMEPAD_CONTRACT_H
#define BB_TESTS_GAMEPAD_CONTRACT_H

#include "hal/gamepad.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

struct gamepad_bench {
	struct bb_gamepad *g;
	struct bb_clock *clk;
	int64_t look_ns; /* how often reports are asked for */
	void *impl;
};

static inline bool gamepad_deflected(const struct bb_pad_report *r)
{
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (fabsf(r->axis[i]) > 0)
			return true;
	return false;
}

static inline void gamepad_check_report(const struct gamepad_bench *t, const struct bb_pad_report *r,
                                        const struct bb_pad_report *before)
{
	const struct bb_gamepad_limits *l = bb_gamepad_limits(t->g);

	assert_true(r->at_ns <= bb_clock_now_ns(t->clk));
	for (size_t i = 0; i < BB_PAD_AXES; i++) {
		const double steps = (double)r->axis[i] / l->axis_step;
		assert_true(fabsf(r->axis[i]) <= 1);
		assert_true(fabs(steps - round(steps)) < 0.01);
	}
	if (l->has_battery && !isnan(r->battery)) /* one that is not known yet is not said */
		assert_true(r->battery >= 0 && r->battery <= 1);
	if (!before->at_ns)
		return;
	assert_int_equal(r->seq, before->seq + 1);
	assert_true(r->at_ns > before->at_ns);
	if (gamepad_deflected(before)) /* the promise that makes silence a fault */
		assert_true(r->at_ns - before->at_ns <= l->most_report_gap_ns);
}

/* Plays for a while, reading often, and checks each report. Returns how many there were. */
static inline long gamepad_play(struct gamepad_bench *t, int64_t for_ns, struct bb_pad_report *last)
{
	const int64_t end_ns = bb_clock_now_ns(t->clk) + for_ns;
	struct bb_pad_report reports[16];
	long count = 0;
	size_t n;

	while (bb_clock_now_ns(t->clk) < end_ns) {
		bb_clock_run_until(t->clk, bb_clock_now_ns(t->clk) + t->look_ns);
		while (bb_gamepad_read(t->g, reports, BB_ARRAY_LEN(reports), &n) == BB_OK)
			for (size_t i = 0; i < n; i++, count++) {
				gamepad_check_report(t, &reports[i], last);
				*last = reports[i];
			}
		assert_int_equal(n, 0);
	}
	return count;
}

static inline void gamepad_bad_calls_are_refused(struct gamepad_bench *t)
{
	struct bb_pad_report one;
	size_t n = 9;

	assert_true(bb_gamepad_limits(t->g)->axis_step > 0 && bb_gamepad_limits(t->g)->most_report_gap_ns > 0);
	assert_int_equal(bb_gamepad_read(t->g, NULL, 1, &n), BB_ERR_USAGE);
	assert_int_equal(bb_gamepad_read(t->g, &one, 0, &n), BB_ERR_USAGE);
	assert_int_equal(bb_gamepad_rumble(t->g, 2, 0), BB_ERR_RANGE);
	assert_int_equal(bb_gamepad_rumble(t->g, NAN, 0), BB_ERR_RANGE);
	bb_gamepad_close(NULL);
}

/* Leaves the motors still. */
static inline void gamepad_rumbles_if_it_says_so(struct gamepad_bench *t)
{
	const enum bb_status want = bb_gamepad_limits(t->g)->has_rumble ? BB_OK : BB_ERR_UNSUPPORTED;
	struct bb_pad_report last = { 0 };

	assert_int_equal(bb_gamepad_rumble(t->g, 0.5f, 1), want);
	(void)gamepad_play(t, 200000000, &last);
	assert_int_equal(bb_gamepad_rumble(t->g, 0, 0), want);
}

#endif
