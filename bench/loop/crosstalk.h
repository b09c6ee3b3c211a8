/*
 * bench/loop/crosstalk.h: the light of a run at fidelity 2: what a white picture for one eye leaks into the other, on every
 * stereo wall, at three heights, in every frame, from the edges and flips as they happened. Only for simulated shutters and
 * displays; a photodiode does it in a real room (blackburst phase measure). One thread; allocates at creation only.
 */
#ifndef BB_BENCH_CROSSTALK_H
#define BB_BENCH_CROSSTALK_H

#include "bench/ledger.h"
#include "bench/rig.h"

struct bb_crosstalk;

/* *out is NULL (and BB_OK) where there is nothing to model: another fidelity, no sims, no stereo wall. */
BB_MUST_CHECK enum bb_status bb_crosstalk_create(const struct bb_rig *rig, struct bb_crosstalk **out);
void bb_crosstalk_destroy(struct bb_crosstalk *x);
/* All of them do nothing with NULL. Screens as in the room. */
void bb_crosstalk_edge(struct bb_crosstalk *x, const struct bb_shutter_edge *e);
void bb_crosstalk_flip(struct bb_crosstalk *x, uint16_t screen, const struct bb_flip *flip);
/* Once a frame, when all edges and flips up to now have been told: the light since the last call becomes a sample, the
 * worst of all walls, heights and eyes; an eye that sees nothing of its own picture counts as 10^4 percent. No sample
 * while the shutters do not run. */
void bb_crosstalk_frame(struct bb_crosstalk *x, uint64_t frame, int64_t now_ns, struct bb_ledger *ledger);

#endif
