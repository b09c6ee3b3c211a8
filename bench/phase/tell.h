/*
 * bench/phase/tell.h: a phase plan as a table and as JSON.
 */
#ifndef BB_BENCH_PHASE_TELL_H
#define BB_BENCH_PHASE_TELL_H

#include <stdio.h>

#include <jansson.h>

#include "sync/plan.h"

/* now: the same room with the timing its file has. */
void bb_phase_print(const struct bb_room *room, const struct bb_plan *plan, const struct bb_plan *now, FILE *out);
/* A new reference, NULL: out of memory. */
json_t *bb_phase_json(const struct bb_room *room, const struct bb_plan *plan, const struct bb_plan *now);
/* Do tokens and exposures stay apart, as far as tokens are known? */
bool bb_phase_clear(const struct bb_plan *plan);

/* Would one drawing do for both? */
bool bb_phase_alike(const struct bb_plan_wall *a, const struct bb_plan_wall *b);
extern const char *const bb_phase_band[BB_PLAN_BANDS]; /* "top", "middle", "bottom" */

/* Crosstalk against light: the best there is for one limit after the other. */
struct bb_phase_trade {
	size_t n;
	struct bb_phase_trade_point {
		double limit_percent;
		struct bb_plan_light light;
		struct bb_plan_timing timing;
	} point[25];
	double least_percent;  /* crosstalk below which nothing goes */
};
BB_MUST_CHECK enum bb_status bb_phase_trade(const struct bb_room *room, struct bb_phase_trade *out,
                                            struct bb_error *err);
void bb_phase_trade_print(const struct bb_phase_trade *t, FILE *out);
json_t *bb_phase_trade_json(const struct bb_phase_trade *t);

#endif
