/*
 * hal/lc_guard.h: no DC on a liquid-crystal cell: a bias of one or two seconds can destroy it. A cell is driven (dark)
 * while the other eye sees, and its driver turns the polarity over with every closing; so unequal closings add up, and a
 * cell that stays closed keeps its bias. The balance of both cells of a shutter, from its edges. Pure. One thread.
 */
#ifndef BB_HAL_LC_GUARD_H
#define BB_HAL_LC_GUARD_H

#include "hal/shutter.h"

#define BB_LC_STILL_NS INT64_C(250000000)   /* closed at a stretch at most: nothing runs below 2 Hz */
#define BB_LC_BALANCE_NS INT64_C(500000000) /* of driven time at most, half of what is said to do harm */

struct bb_lc_cell {
	int64_t balance_ns;   /* time driven one way less time driven the other way, closed stretches only */
	int64_t closed_ns;    /* since when it is closed */
	bool closed, turned;  /* turned: this stretch is the other polarity */
};

struct bb_lc_guard {
	struct bb_lc_cell cell[2]; /* left, right */
};

void bb_lc_init(struct bb_lc_guard *g);
/* From at_ns on this eye sees and the other one's cell is driven; BB_EYE_NONE: both see, neither is driven, and what
 * there was of a bias is let go. */
void bb_lc_edge(struct bb_lc_guard *g, enum bb_eye sees, int64_t at_ns);
/* The worst bias of the two cells now, ns of driven time, never negative; beyond which of the two bounds it is. */
int64_t bb_lc_bias_ns(const struct bb_lc_guard *g, int64_t now_ns);
bool bb_lc_harmed(const struct bb_lc_guard *g, int64_t now_ns);

#endif
