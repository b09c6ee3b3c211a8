/*
 * sync/calibrate/touch.h: where the tracker's space stands in the room, from corners of walls that were touched with a
 * tracked tip. Metres. Pure.
 */
#ifndef BB_SYNC_CALIBRATE_TOUCH_H
#define BB_SYNC_CALIBRATE_TOUCH_H

#include "hal/geometry.h"

#define BB_TOUCHES_MAX 64
#define BB_TOUCH_SIGMA_M 0.002 /* how well a hand finds a corner, each axis; what is assumed at least */

struct bb_touch_fit {
	struct bb_pose pose;         /* tracker to room */
	double off_m[BB_TOUCHES_MAX]; /* what is left over of every point */
	size_t worst;
	double rms_m;                /* per coordinate, corrected for the 6 that were fitted */
	double sigma_m;              /* of the fit's place, at the points' middle, each axis */
	double sigma_deg;            /* of its orientation, about the axis known worst */
};

/* false: fewer than three, more than BB_TOUCHES_MAX, or on a line. */
bool bb_touch_fit(const struct bb_vec3 *tracker, const struct bb_vec3 *room, size_t n, struct bb_touch_fit *out);

#endif
