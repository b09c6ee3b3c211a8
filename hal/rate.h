/*
 * hal/rate.h: rates are fractions, frame times are computed from frame numbers and never summed: summing the rounded
 * period of 60000/1001 Hz is 12 ms early after a week.
 */
#ifndef BB_HAL_RATE_H
#define BB_HAL_RATE_H

#include "hal/base.h"

struct bb_rate { /* 59.94 Hz is { 60000, 1001 }; num and den are > 0 */
	uint32_t num, den;
};

#define BB_NS_PER_S INT64_C(1000000000)
#define BB_NEVER INT64_MAX /* "no wake-up wanted" wherever a time in ns is asked for */

/* Start of a frame (any sign) after frame 0, ns, rounded down; no overflow within 290 years. */
static inline int64_t bb_rate_frame_ns(struct bb_rate r, int64_t frame)
{
	const int64_t ns = BB_NS_PER_S * r.den;
	int64_t whole = frame / r.num, part = frame % r.num;

	if (part < 0) {
		part += r.num;
		whole--;
	}
	/* part * ns fits for every customary rate, and is some ten times faster so. */
	if ((uint64_t)r.num * r.den < UINT64_C(9000000000))
		return whole * ns + part * ns / r.num;
	return whole * ns + (int64_t)((__int128)part * ns / r.num);
}

static inline int64_t bb_rate_period_ns(struct bb_rate r)
{
	return (BB_NS_PER_S * r.den + r.num / 2) / r.num;
}

static inline double bb_rate_hz(struct bb_rate r)
{
	return (double)r.num / (double)r.den;
}

/* The nearest fraction with den <= 1001 for a rate written as a decimal; { 0, 0 } if hz is not in (0, 1e6]. */
struct bb_rate bb_rate_from_hz(double hz);

#endif
