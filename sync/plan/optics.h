/*
 * sync/plan/optics.h: what sync/plan/ shares: rows of displays as waves, light and crosstalk of a set of them through
 * lenses of one timing, and windows. Nobody else includes it.
 */
#ifndef BB_SYNC_PLAN_OPTICS_H
#define BB_SYNC_PLAN_OPTICS_H

#include "sync/plan.h"
#include "sync/plan/wave.h"

#define PLAN_ROWS 4 /* Gauss-Legendre over a band: 1e-4 of the band's light with the fastest lenses there are */

/* A band of one display. Frame-sequential: light of n rows, this eye's picture and the other's. External shutters: n = 0,
 * both come from the shutter's wave; share is the projector's mean light. */
struct plan_band {
	unsigned n;
	bool external;
	double share;
	double weight[PLAN_ROWS];
	struct bb_wave own[PLAN_ROWS], other[PLAN_ROWS];
};

struct plan_lenses {
	struct bb_wave glasses, own_shutter, other_shutter;
};

void plan_band_init(struct plan_band *b, const struct bb_display_config *display, double period_us, double top,
                    double bottom);
void plan_lenses_init(struct plan_lenses *l, const struct bb_shutter_config *chain, double period_us,
                      const struct bb_plan_timing *timing);
struct bb_plan_light plan_band_light(const struct plan_band *b, const struct plan_lenses *l);
/* Time an exponential with this 10-90 % time takes to come within the limit. */
double plan_settle_us(double us_10_90, double limit_percent);
/* Fills in window and margins of a band that has top and bottom. */
void plan_window(struct bb_plan_band *b, const struct bb_display_config *display, const struct bb_shutter_config *chain,
                 const struct bb_plan_timing *timing, double limit_percent);

static inline bool plan_external(const struct bb_display_config *display)
{
	return display->stereo == BB_STEREO_DUAL_PROJECTOR;
}

static inline double plan_period_us(const struct bb_shutter_config *chain)
{
	return 1e6 / bb_rate_hz(chain->rate);
}

#endif
