/*
 * sync/track/rigid.h: the rotation and translation that best take body points to room points (Horn). Metres.
 *
 * Horn's 4 x 4 matrix yields a proper rotation always (det = +1), and its eigenvalues tell the singular values of the
 * correlation: whether the points lie on a line (rotation about it is noise) and whether they are a mirror image.
 */
#ifndef BB_SYNC_TRACK_RIGID_H
#define BB_SYNC_TRACK_RIGID_H

#include "hal/geometry.h"

#define BB_ROLL_SIGMA_MAX_RAD 0.017453 /* 1 degree: a roll known worse than this is held */

struct bb_rigid {
	struct bb_pose pose;
	double rms_m;
	double roll_sigma_rad; /* about the line the points lie closest to */
	bool collinear;        /* roll_sigma above the limit: roll about the line comes from `hold` */
	bool mirrored;         /* the mirror image fits significantly better */
};

/* n >= 3 pairs; sigma_m is the noise of a room point. false when fewer, or all in one place: no direction at all. */
bool bb_rigid_fit(const struct bb_vec3 *body, const struct bb_vec3 *room, size_t n, double sigma_m, struct bb_quat hold,
		  struct bb_rigid *out);

#endif
