/*
 * bench/blame.h: who caused a missed budget: an ill device that overlaps the bad samples and can have caused them, else
 * the node and stage that spent most in them. Fills culprit, cause and cause_ns of a budget's result; pure otherwise.
 */
#ifndef BB_BENCH_BLAME_H
#define BB_BENCH_BLAME_H

#include "bench/result.h"

#define BB_NOBODY UINT16_MAX /* node of a sample or span that belongs to the whole room */

/* limit: the budget's limit, or its marginal mark. */
void bb_blame(const struct bb_run_result *r, struct bb_budget_result *b, double limit);
/* For devices_ok: the device that was not OK for longest; one that is LOST at the end comes before all others. */
void bb_blame_device(const struct bb_run_result *r, struct bb_budget_result *b);

bool bb_budget_is_count(enum bb_metric metric); /* its value is the sum of its samples */
bool bb_budget_beyond(enum bb_metric metric, double value, double limit);
bool bb_device_in_use(const struct bb_device_result *d);
bool bb_device_lost_at_end(const struct bb_run_result *r);

#endif
