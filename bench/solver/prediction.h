/*
 * bench/solver/prediction.h: what prediction buys: a viewer walks under a room's simulated cameras; after every solution
 * the pose of the eyes is asked for later times, and compared with where they then really were, and with what showing
 * the last solution as it is would give. Times count from mid-exposure; a path of 40 ms is the horizon of 40 ms.
 */
#ifndef BB_BENCH_SOLVER_PREDICTION_H
#define BB_BENCH_SOLVER_PREDICTION_H

#include <stdio.h>

#include <jansson.h>

#include "bench/solver/walk.h"

#define BB_PREDICTION_HORIZONS 21 /* 0, 5, .. 100 ms */
#define BB_PREDICTION_PATH_MS 40.0

struct bb_prediction_point {
	double horizon_ms;
	double rms_mm[2], p99_mm[2], rms_deg[2], p99_deg[2]; /* [0] with prediction, [1] without */
	double stated_mm, stated_deg;                        /* rms of what the tracker says of its prediction */
	struct bb_walk_share inside_mm, inside_deg;          /* squared Mahalanobis distances under the 95 % point */
};

struct bb_prediction {
	const char *room, *path;
	uint64_t seed;
	size_t n; /* solutions */
	double rate_hz, predict_ns; /* cost of one prediction on this machine */
	struct bb_prediction_point point[BB_PREDICTION_HORIZONS];
};

struct bb_prediction_config {
	const char *room, *path;
	uint64_t seed;
	size_t n_frames; /* most; the walk may end before */
};

BB_MUST_CHECK enum bb_status bb_prediction_measure(const struct bb_prediction_config *config, struct bb_prediction *out,
						   struct bb_error *err);
const struct bb_prediction_point *bb_prediction_at(const struct bb_prediction *p, double horizon_ms); /* the nearest */
void bb_prediction_print(const struct bb_prediction *p, FILE *f);
json_t *bb_prediction_json(const struct bb_prediction *p);
BB_MUST_CHECK enum bb_status bb_prediction_plot(const struct bb_prediction *p, const char *path, struct bb_error *err);

#endif
