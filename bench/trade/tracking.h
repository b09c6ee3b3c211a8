/*
 * bench/trade/tracking.h: what cameras, their noise and the simulation's fidelity do to the tracked pose, and what
 * solving costs: a viewer walks scenes/walk.path, the body in the way, and the unpredicted pose of the glasses is held
 * against the truth. Everything but the cost is the same for the same seed.
 */
#ifndef BB_BENCH_TRADE_TRACKING_H
#define BB_BENCH_TRADE_TRACKING_H

#include <stdio.h>

#include <jansson.h>

#include "hal/status.h"

#define BB_TRACKING_POINTS_MAX 32

enum bb_tracking_knob { BB_TRACKING_CAMERAS, BB_TRACKING_DECK, BB_TRACKING_NOISE, BB_TRACKING_FIDELITY, BB_TRACKING_KNOBS };

struct bb_tracking_point {
	enum bb_tracking_knob knob; /* what differs from eight cameras of the cabin, 0.05 px, fidelity 1 */
	unsigned n_cameras;
	double noise_px; /* as configured; at fidelity 2 the pictures make their own */
	int fidelity;
	char left_out[64];               /* ids, of the cabin */
	unsigned n_frames;
	double solved, four;             /* share of frames with a pose; with four cameras that see three markers */
	double rms_mm, p95_mm, rms_deg;  /* of all poses */
	double four_mm, four_deg;        /* rms of those by four cameras or more; NAN: there were none */
	double seeing;                   /* cameras that truly see three markers, mean */
	double solve_ms, solve_p99_ms;   /* by the stopwatch on this machine; solve_ms is the median */
};

struct bb_tracking {
	uint64_t seed;
	unsigned n_frames, n_pictures; /* of a point at most, the walk may end before; of one at fidelity 2 */
	size_t n;
	struct bb_tracking_point point[BB_TRACKING_POINTS_MAX];
};

/* progress (may be NULL) is told what is measured now. Errors as bb_room_load and bb_studio_open. */
BB_MUST_CHECK enum bb_status bb_tracking_measure(struct bb_tracking *t, void (*progress)(const char *text),
						 struct bb_error *err);
void bb_tracking_print(const struct bb_tracking *t, FILE *f);
json_t *bb_tracking_json(const struct bb_tracking *t);
BB_MUST_CHECK enum bb_status bb_tracking_plot(const struct bb_tracking *t, const char *path, struct bb_error *err);

#endif
