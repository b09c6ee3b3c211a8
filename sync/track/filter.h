/*
 * sync/track/filter.h: constant velocity and constant angular rate with covariance: predicts a body to any time.
 *
 * Position is that of the markers' centroid, rotation vectors are in room axes; the axes are filtered apart from each
 * other (the correlations are small and the price of ignoring them is a little optimality, never stability). What a
 * walking person does to the model is white acceleration noise.
 */
#ifndef BB_SYNC_TRACK_FILTER_H
#define BB_SYNC_TRACK_FILTER_H

#include "hal/geometry.h"

struct bb_filter_axis { /* covariance of (value, rate) */
	double pp, pv, vv;
};

struct bb_filter {
	bool live;
	int64_t at_ns;
	struct bb_vec3 p, v; /* m, m/s */
	struct bb_quat q;
	struct bb_vec3 w; /* rad/s */
	struct bb_filter_axis position[3], angle[3];
};

struct bb_filter_state { /* at another time */
	struct bb_vec3 p, v;
	struct bb_quat q;
	struct bb_vec3 w;
	double position_sigma_m, angle_sigma_rad; /* root of the sum over the axes */
};

/* dt_s may be negative. */
struct bb_filter_state bb_filter_predict(const struct bb_filter *f, double dt_s);
/* Start from rest with a walker's uncertainty of speed. */
void bb_filter_start(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q, const double var_m2[3],
		     const double var_rad2[3]);
/* at_ns after f->at_ns. hold: a direction about which the measurement says nothing (zero vector: none). */
void bb_filter_update(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q, const double var_m2[3],
		      const double var_rad2[3], struct bb_vec3 hold);

/* a - b without overflow, in seconds. */
double bb_seconds_between(int64_t a_ns, int64_t b_ns);

#endif
