/*
 * sync/plan/solve.h: the search for the timing of lenses, and what would have to change where there is none. Within
 * sync/plan/ only.
 */
#ifndef BB_SYNC_PLAN_SOLVE_H
#define BB_SYNC_PLAN_SOLVE_H

#include "sync/plan/optics.h"

#define PLAN_DISPLAYS_MAX 16 /* kinds of displays in a room */

/* A room without what does not matter here: its kinds of displays, and the bands of each. */
struct plan_task {
	struct bb_shutter_config chain;
	double period_us, limit_percent;
	double gap_least_us;  /* of the glasses' protocol */
	bool paired;          /* ... which has no gap at all */
	double edges_least_hz;/* no fewer edges a second than that: people would see them */
	size_t n_displays;
	struct bb_display_config display[PLAN_DISPLAYS_MAX];
	struct plan_band band[PLAN_DISPLAYS_MAX][BB_PLAN_BANDS];
};

/* From the upper edge of the picture. */
extern const double plan_band_top[BB_PLAN_BANDS], plan_band_bottom[BB_PLAN_BANDS];

/* Makes period and bands follow display and chain. */
void plan_task_refresh(struct plan_task *t);
/* Least light and most crosstalk of all bands. */
struct bb_plan_light plan_task_light(const struct plan_task *t, const struct bb_plan_timing *timing);
/* The brightest timing within the limit; false: none, and *out is what comes nearest to it. */
bool plan_solve(const struct plan_task *t, struct bb_plan_timing *out);
/* What each part alone would have to be; returns the part nearest to what it would take. */
enum bb_plan_part plan_needs(const struct plan_task *t, struct bb_plan_need need[BB_PLAN_PARTS]);

#endif
