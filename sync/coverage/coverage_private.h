/* sync/coverage/coverage_private.h: what coverage.c and place.c share; contracts as in coverage.h. */
#ifndef BB_SYNC_COVERAGE_COVERAGE_PRIVATE_H
#define BB_SYNC_COVERAGE_COVERAGE_PRIVATE_H

#include "sync/coverage/coverage.h"
#include "sync/track/lens.h"

struct bb_coverage_eye { /* one camera, ready to look */
	struct bb_lens lens;
	double focal_px, sigma_px;
};

struct bb_coverage_sight { /* of one camera at one point */
	struct bb_vec3 to;  /* unit, from the marker to the camera */
	double distance_m;
	double info[6];     /* 1 / m^2: xx xy xz yy yz zz */
};

struct bb_coverage {
	struct bb_coverage_config config;
	struct bb_coverage_eye *eyes;
	struct bb_vec3 head[BB_COVERAGE_HEADINGS_MAX]; /* from the marker, by heading */
};

bool bb_coverage_eye_init(struct bb_coverage_eye *e, const struct bb_camera_config *camera, double noise_px);
/* false: this camera does not see the point, viewer or not. */
bool bb_coverage_sees(const struct bb_coverage *c, const struct bb_coverage_eye *e, struct bb_vec3 p,
		      struct bb_coverage_sight *out);
/* Does the viewer with that heading hide the marker from there? shadow.c */
bool bb_viewer_hides(const struct bb_viewer_shape *v, struct bb_vec3 head, const struct bb_coverage_sight *s);
/* Standard error and worst axis from summed information; false: not placed. */
bool bb_coverage_error(const double info[6], double *error_m, double *worst_m, double covariance_m2[6]);

#endif
