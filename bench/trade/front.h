/*
 * bench/trade/front.h: of many settings, each with a quality and a cost, those that nothing beats: the Pareto front; and
 * the two questions that are asked of it. Pure; numbers that are not finite take no part.
 */
#ifndef BB_BENCH_TRADE_FRONT_H
#define BB_BENCH_TRADE_FRONT_H

#include "hal/base.h"

#define BB_FRONT_NONE SIZE_MAX

struct bb_front_point {
	double quality, cost; /* more is better; less is better */
	bool on_front;        /* out: no other has as much quality for less, or more for as little; equal ones all are */
};

void bb_front_mark(struct bb_front_point *p, size_t n);
/* Which has the most quality for a cost of at most cost_most; of equal ones the cheapest, then the first. */
size_t bb_front_best(const struct bb_front_point *p, size_t n, double cost_most);
/* Which costs least of those with at least that quality; of equal ones the best, then the first. */
size_t bb_front_cheapest(const struct bb_front_point *p, size_t n, double quality_least);

#endif
