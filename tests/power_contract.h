/*
 * tests/power_contract.h: what every power back end must do, as checks on an open strip of two outlets. Which back end
 * it is, and whether time passes or is waited for, is the business of whoever opens the bench: tests/contract_power.c
 * for sims and wires, tests/hw_room.c for a room. All outlets of the strip are on when a check begins, or may be put on.
 */
#ifndef BB_TESTS_POWER_CONTRACT_H
#define BB_TESTS_POWER_CONTRACT_H

#include "hal/power.h"
#include "tests/fidelity.h"

#include <setjmp.h>
#include <stdarg.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define POWER_S BB_NS_PER_S

struct power_bench {
	struct bb_power *p;
	struct bb_clock *clk;
	const struct bb_power_config *config; /* as it was opened */
	size_t index;            /* the outlet that is switched */
	int64_t age_ns;          /* a reading is at most so old */
	double early;            /* the part of a safety time after which it has surely not passed yet */
	void *impl;
};

static inline void power_pass(struct power_bench *t, int64_t for_ns)
{
	bb_clock_run_until(t->clk, bb_clock_now_ns(t->clk) + for_ns);
}

/* Until a safety time of so many seconds is over. */
static inline void power_outlast(struct power_bench *t, double seconds)
{
	power_pass(t, (int64_t)(seconds * 1.02e9) + bb_power_limits(t->p)->settle_ns);
}

/* On a wire one reading may be lost to a busy machine: the guard is five settle times. */
static inline struct bb_outlet_state power_settled(struct power_bench *t)
{
	struct bb_outlet_state s = { 0 };

	for (int i = 0; i < 5 && !s.known; i++) {
		power_pass(t, bb_power_limits(t->p)->settle_ns);
		assert_int_equal(bb_power_read(t->p, t->index, &s), BB_OK);
	}
	return s;
}

static inline void power_switching_is_read_back(struct power_bench *t)
{
	const struct bb_safety *safety = &t->config->safety;
	struct bb_outlet_state s = power_settled(t);

	if (!s.closed)
		assert_int_equal(bb_power_set(t->p, t->index, true), BB_OK);
	power_outlast(t, safety->outlet_least_on_s);
	assert_int_equal(bb_power_set(t->p, t->index, false), BB_OK);
	s = power_settled(t);
	assert_true(s.known && !s.closed && !s.commanded);
	assert_true(s.current_a <= bb_power_limits(t->p)->current_error_a);
	power_outlast(t, safety->outlet_least_off_s);
	assert_int_equal(bb_power_set(t->p, t->index, true), BB_OK);
	s = power_settled(t);
	assert_true(s.known && s.closed && s.commanded);
	power_pass(t, (int64_t)(t->config->outlet[t->index].inrush_ms * 1e6));
	s = power_settled(t);
	assert_true(fabs(s.current_a - t->config->outlet[t->index].load_a) <= bb_power_limits(t->p)->current_error_a);
	assert_in_range(bb_clock_now_ns(t->clk) - s.at_ns, 0, t->age_ns);
}

static inline void power_bad_calls_are_refused(struct power_bench *t)
{
	struct bb_outlet_state s;

	assert_int_equal(bb_power_set(t->p, t->config->n_outlets, true), BB_ERR_USAGE);
	assert_int_equal(bb_power_read(t->p, t->config->n_outlets, &s), BB_ERR_USAGE);
	assert_false(s.known);
	assert_int_equal(bb_power_read(t->p, 0, NULL), BB_ERR_USAGE);
	bb_power_close(NULL);
}

static inline void power_times_are_kept(struct power_bench *t)
{
	const double off_s = t->config->safety.outlet_least_off_s, on_s = t->config->safety.outlet_least_on_s;
	const char *detail = bb_power_device(t->p)->last_error.detail;

	power_outlast(t, on_s);
	assert_int_equal(bb_power_set(t->p, t->index, false), BB_OK);
	power_pass(t, (int64_t)(t->early * off_s * 1e9));
	assert_int_equal(bb_power_set(t->p, t->index, true), BB_ERR_REFUSED);
	assert_non_null(strstr(detail, "least off time"));
	const int64_t wait_ns = bb_power_wait_ns(t->p, t->index, true);
	assert_true(wait_ns > 0);
	assert_true(wait_ns <= (int64_t)((1 - t->early) * off_s * 1e9) + bb_power_limits(t->p)->settle_ns + 1000);
	power_pass(t, wait_ns);
	assert_int_equal(bb_power_set(t->p, t->index, true), BB_OK);
	power_pass(t, (int64_t)(t->early * on_s * 1e9));
	assert_int_equal(bb_power_set(t->p, t->index, false), BB_ERR_REFUSED);
	assert_non_null(strstr(detail, "least on time"));
}

/* ---- the script of the class (tests/fidelity.h): on a timetable, since the times the guard wants are the rung's own ---- */

#define POWER_SCRIPT_STEP_NS (1100 * INT64_C(1000000))

/* Looks often until the script's next step is due, and notes what it sees change. */
static inline void power_script_watch(struct power_bench *t, struct fid_log *log, int64_t until_ns,
                                      struct bb_outlet_state *last)
{
	const int64_t within_ns = bb_power_limits(t->p)->settle_ns;
	struct bb_outlet_state s;

	for (; bb_clock_now_ns(t->clk) < until_ns; power_pass(t, 2000000))
		for (size_t i = 0; i < t->config->n_outlets; i++) {
			if (bb_power_read(t->p, i, &s) != BB_OK || !s.known || (last[i].known && s.closed == last[i].closed))
				continue;
			fid_note(log, bb_clock_now_ns(t->clk), within_ns, "outlet %d %s", (int)t->config->outlet[i].outlet,
			         s.closed ? "closed" : "open");
			last[i] = s;
		}
	for (size_t i = 0; i < t->config->n_outlets; i++) {
		const double load_a = last[i].closed ? t->config->outlet[i].load_a : 0;
		if (bb_power_read(t->p, i, &s) != BB_OK)
			continue;
		const bool as_it_should = fabs(s.current_a - load_a) <= bb_power_limits(t->p)->current_error_a;
		fid_note(log, until_ns, within_ns, "outlet %d draws %s", (int)t->config->outlet[i].outlet,
		         !as_it_should ? "something else" : last[i].closed ? "its load" : "nothing");
	}
}

static inline void power_script(struct power_bench *t, struct fid_log *log)
{
	static const struct {
		size_t index;
		bool on;
	} steps[] = { { 0, false }, { 0, true }, { 1, false }, { 0, false }, { 1, true }, { 0, true } };
	struct bb_outlet_state last[BB_OUTLETS_MAX] = { 0 };
	int64_t due_ns = bb_clock_now_ns(t->clk) + POWER_SCRIPT_STEP_NS;

	fid_note(log, bb_clock_now_ns(t->clk), bb_power_limits(t->p)->settle_ns, "opened");
	power_script_watch(t, log, due_ns, last);
	for (size_t i = 0; i < sizeof(steps) / sizeof(steps[0]); i++) {
		const int number = (int)t->config->outlet[steps[i].index].outlet;
		const enum bb_status status = bb_power_set(t->p, steps[i].index, steps[i].on);
		fid_note(log, due_ns, bb_power_limits(t->p)->settle_ns, "set %d %s: %s", number, steps[i].on ? "on" : "off",
		         bb_status_text(status));
		/* At once back again is what no strip may do. */
		const enum bb_status again = bb_power_set(t->p, steps[i].index, !steps[i].on);
		fid_note(log, due_ns, bb_power_limits(t->p)->settle_ns, "set %d back: %s", number, bb_status_text(again));
		due_ns += POWER_SCRIPT_STEP_NS;
		power_script_watch(t, log, due_ns, last);
	}
}

#endif
