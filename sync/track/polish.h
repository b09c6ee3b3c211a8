/*
 * sync/track/polish.h: least squares of a body's pose on the pixels of all cameras (Levenberg-Marquardt).
 *
 * Unknowns: a small rotation about the markers' centroid in room axes and the centroid's shift; in this choice the two
 * hardly correlate. The normal matrix is also the answer's covariance.
 */
#ifndef BB_SYNC_TRACK_POLISH_H
#define BB_SYNC_TRACK_POLISH_H

#include "sync/track/lens.h"

struct bb_track_obs { /* a blob said to be a marker */
	uint16_t camera, blob;
	uint8_t marker;
	float dt_s; /* mid-exposure of its row minus the set's */
	double x_px, y_px;
	double worse; /* its noise over sigma_px; 0: 1 */
};

struct bb_polish {
	const struct bb_lens *lenses;
	const struct bb_vec3 *markers; /* body space */
	struct bb_vec3 centroid;       /* body space: the pivot */
	const struct bb_track_obs *obs;
	size_t n_obs;
	double sigma_px;
	double huber_px;               /* residuals beyond count linearly; 0: plain squares */
	struct bb_vec3 velocity, spin; /* m/s, rad/s: moves the body to each camera's own mid-exposure */

	struct bb_pose pose; /* in and out */

	double chi2;             /* out: squared residuals in sigma_px (not the robust ones) */
	double chi2_own;         /* the same, each blob in its own sigma */
	double covariance[6][6]; /* of rotation vector (rad) and centroid (m), room axes; without the held roll */
	double roll_sigma_rad;   /* of the least known rotation */
	struct bb_vec3 roll_axis;
	bool roll_held; /* markers on a line: the start's roll about roll_axis was kept */
};

/* false when an observation cannot be projected from the start, or the pixels do not fix the pose. */
bool bb_polish_run(struct bb_polish *p, int most_steps);

/* After a run: an observation's squared residual, px^2, and how many of its two coordinates the pose did not take up
 * (2 less its leverage): over many, the ratio of the sums is the variance of a coordinate. */
bool bb_polish_residual(const struct bb_polish *p, const struct bb_track_obs *o, double *square_px2, double *left);

#endif
