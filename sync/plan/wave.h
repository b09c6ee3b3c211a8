/*
 * sync/plan/wave.h: a periodic quantity made of exponentials: rest + swing exp(-rate (t - from)) from one instant to the
 * next. Cells, pixels and strobes are such waves, and so the light through two of them has a closed form. Times in one
 * unit of the caller's. No allocation; any thread.
 */
#ifndef BB_SYNC_PLAN_WAVE_H
#define BB_SYNC_PLAN_WAVE_H

#include "hal/base.h"

#define BB_WAVE_PIECES 12

struct bb_wave {
	double period;
	unsigned n;
	struct bb_wave_piece {
		double from;          /* in [0, period), rising; piece[0].from is 0; to the next one's, the last to the end */
		double rest, swing, rate;
	} piece[BB_WAVE_PIECES];
};

/* What opens at `at` (any, taken modulo the period) for `open` and follows 1 - exp(-t / tau) and exp(-t / tau), in its
 * steady state, between low and high; tau = the 10-90 % time / ln 9, both >= 0. open >= period: high for ever. */
void bb_wave_cell(struct bb_wave *w, double period, double at, double open, double rise_10_90, double fall_10_90,
                  double low, double high);
/* Zero from one instant to another, to - from < period, both taken modulo the period. */
void bb_wave_blank(struct bb_wave *w, double from, double to);
double bb_wave_at(const struct bb_wave *w, double t);
/* Mean of the product over the period, which both have in common. */
double bb_wave_mean(const struct bb_wave *a, const struct bb_wave *b);

#endif
