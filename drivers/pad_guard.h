/*
 * drivers/pad_guard.h: the fault states of a gamepad, for pad_core.c only: what each row of the fault matrix is
 * detected by and what ends it. Time is the device clock's. One thread.
 */
#ifndef BB_DRIVERS_PAD_GUARD_H
#define BB_DRIVERS_PAD_GUARD_H

#include "drivers/pad_core.h"

#define BB_PAD_DEAD_ZONE 0.15               /* what a consumer takes for neutral */
#define BB_PAD_DRIFT_NS INT64_C(9000000000) /* an axis that looks wrong that long is reported (budget: 10 s) */

void bb_pad_guard_forget(struct bb_pad_core *core); /* what the axes did so far */
void bb_pad_guard_state(struct bb_pad_core *core, enum bb_health health);
/* core->sample is new: it may be held back to neutral or recentred. */
void bb_pad_guard_good(struct bb_pad_core *core, int64_t at_ns);
void bb_pad_guard_bad(struct bb_pad_core *core, const char *what);
void bb_pad_guard_idle(struct bb_pad_core *core); /* after the bus was emptied */
void bb_pad_guard_lost(struct bb_pad_core *core, const char *op, const char *what);
bool bb_pad_guard_may_reopen(struct bb_pad_core *core);
void bb_pad_guard_reopened(struct bb_pad_core *core, enum bb_status status);

#endif
