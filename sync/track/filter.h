/*
 * sync/track/filter.h: error-state filter of a body with constant velocity and turn rate; predicts it, with covariance,
 * to any time.
 *
 * Position is that of the markers' centroid; rotation vectors are in room axes. Errors are ordered (rotation, position)
 * as in polish.h, and so are the rates (turn rate, velocity): one covariance of 12 x 12 in three blocks, updated with
 * the pose's whole 6 x 6 covariance. What a walking person does to the model is white acceleration noise, of densities
 * that follow what predictions of about 40 ms, a path's length, turned out to be worth.
 */
#ifndef BB_SYNC_TRACK_FILTER_H
#define BB_SYNC_TRACK_FILTER_H

#include "hal/geometry.h"

#define BB_FILTER_PAST 16

struct bb_filter_past { /* the state as it was after an update; traces of its covariances: [0] rotation, [1] position */
	int64_t at_ns;
	struct bb_vec3 p, v, w;
	struct bb_quat q;
	double pose[2], cross[2], rate[2], density[2];
};

struct bb_filter {
	bool live;
	int64_t at_ns;
	struct bb_vec3 p, v; /* m, m/s */
	struct bb_quat q;
	struct bb_vec3 w; /* rad/s */
	double pose[6][6], cross[6][6], rate[6][6]; /* covariances: pose, pose with rate, rate */
	double density[2];                          /* rad^2/s^3, m^2/s^3 */
	double innovation2;                         /* of the last update in its own covariance: 6 on average when honest */
	struct bb_filter_past past[BB_FILTER_PAST];
	unsigned n_past; /* since the start; the ring holds the newest */
};

struct bb_filter_state { /* at another time */
	struct bb_vec3 p, v;
	struct bb_quat q;
	struct bb_vec3 w;
	double covariance[6][6];                  /* of (rotation, position) */
	double position_sigma_m, angle_sigma_rad; /* root of the sum over the axes */
};

/* dt_s may be negative. */
struct bb_filter_state bb_filter_predict(const struct bb_filter *f, double dt_s);
/* Start from rest with a walker's uncertainty of speed. */
void bb_filter_start(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q,
		     const double covariance[6][6]);
/* at_ns after f->at_ns. hold: a direction about which the measurement says nothing (zero vector: none). */
void bb_filter_update(struct bb_filter *f, int64_t at_ns, struct bb_vec3 p, struct bb_quat q,
		      const double covariance[6][6], struct bb_vec3 hold);

/* a - b without overflow, in seconds. */
double bb_seconds_between(int64_t a_ns, int64_t b_ns);

#endif
