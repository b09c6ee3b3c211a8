/*
 * bench/loop/diode.h: the latency self-test, simulated. A lamp before the cameras blinks; the patch of a scene with
 * `patch: {follows: cameras}` copies what the newest exposure saw of it; a photodiode at the middle of the first screen tells
 * when the patch lights up. What it finds stands beside the sum of the links of bench/latency.h, none of which it knows. In a
 * real room the lamp and the photodiode are real and an oscilloscope shows both. At fidelity 2, with simulated shutters and
 * displays only; one thread; allocates at creation only.
 */
#ifndef BB_BENCH_DIODE_H
#define BB_BENCH_DIODE_H

#include "bench/ledger.h"
#include "bench/rig.h"
#include "hal/scene.h"

struct bb_diode;
struct bb_latency_test; /* bench/result.h */

/* *out is NULL (and BB_OK) where there is nothing to model. */
BB_MUST_CHECK enum bb_status bb_diode_create(const struct bb_rig *rig, const struct bb_scene *scene, uint64_t seed,
                                             struct bb_diode **out);
void bb_diode_destroy(struct bb_diode *x);
/* All of them do nothing with NULL. */
void bb_diode_edge(struct bb_diode *x, const struct bb_shutter_edge *e);
void bb_diode_flip(struct bb_diode *x, uint16_t screen, const struct bb_flip *flip);
/* A frame begins whose pictures have the patch bright (or not); all edges and flips up to now have been told. */
void bb_diode_frame(struct bb_diode *x, uint64_t frame, bool bright, int64_t now_ns);
/* A frame is closed: when the lamp lit up, the exposure that saw it, and the light as the links have it. */
void bb_diode_close(struct bb_diode *x, uint64_t frame, int64_t lamp_ns, int64_t mid_exposure_ns, int64_t photon_ns);
void bb_diode_tell(const struct bb_diode *x, struct bb_latency_test *out);

#endif
