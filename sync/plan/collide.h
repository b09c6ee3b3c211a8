/*
 * sync/plan/collide.h: exposures against the emitter's tokens. Tokens repeat with a cycle of two periods, exposures with
 * their own step; because both rates are fractions the exposures meet only so many phases of the cycle before they
 * repeat, a multiple of cycle / phases apart, and everything follows from folding the times that hurt into that
 * remainder. Times in us. No state; any thread.
 */
#ifndef BB_SYNC_PLAN_COLLIDE_H
#define BB_SYNC_PLAN_COLLIDE_H

#include "hal/rate.h"
#include "sync/plan/tokens.h"

struct bb_collisions {
	double cycle_us;
	uint64_t phases;        /* exposures until the same phase comes again */
	double fold_us;         /* cycle / phases: start phases this far apart meet the same tokens */
	double hit_percent;     /* start phases of which at least one exposure collides */
	double most_percent;    /* exposures that collide, at the worst start phase ... */
	double mean_percent;    /* ... and in the mean over all of them: what drift sweeps through */
	double free_us;         /* middle of the widest stretch of start phases without a collision, in [0, fold) ... */
	double margin_us;       /* ... and half its width; below 0: every start phase collides, by so much at best */
};

/* edges: of the chain; exposures: per second. An exposure collides when it and a token shine at one instant. */
void bb_collisions(const struct bb_light_span *spans, size_t n, struct bb_rate edges, struct bb_rate exposures,
                   double exposure_us, struct bb_collisions *out);
/* Share of exposures that collide when the first begins at start_us after the left eye's edge, percent. */
double bb_collisions_at(const struct bb_light_span *spans, size_t n, const struct bb_collisions *c, double exposure_us,
                        double start_us);

#endif
