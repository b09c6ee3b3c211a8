/*
 * sync/track/triangulate.h: points from rays. Metres.
 *
 * The squared distance to each ray is weighted by 1 / (sigma * depth)^2. The normal matrix of that problem weighs every
 * pair of rays by sin^2 of the angle between them by itself: what two nearly parallel rays say about depth counts for
 * as little as it is worth. Pairs below min_angle are no pair at all, and a point behind a camera is none.
 */
#ifndef BB_SYNC_TRACK_TRIANGULATE_H
#define BB_SYNC_TRACK_TRIANGULATE_H

#include "hal/geometry.h"

#define BB_RAY_ANGLE_MIN_RAD 0.02618 /* 1.5 degrees: below, 0.2 mrad of noise is 0.1 m of depth at 3 m */

struct bb_sight { /* a ray with its origin */
	struct bb_vec3 o, d;
	double sigma_rad;
};

struct bb_triangulated {
	struct bb_vec3 p;
	double sigma_m; /* along the worst direction */
	double chi2;    /* sum of squared ray distances in sigmas; 2 n - 3 degrees of freedom */
};

/* Closest approach of two rays: midpoint, gap in sigmas. false: too parallel or behind. */
bool bb_triangulate_pair(const struct bb_sight *a, const struct bb_sight *b, double min_angle_rad, struct bb_vec3 *mid,
			 double *gap_sigmas, double *sigma_m);
/* n >= 2 sights; false when no pair has min_angle_rad or the point is behind one of them. */
bool bb_triangulate(const struct bb_sight *sights, size_t n, double min_angle_rad, struct bb_triangulated *out);

#endif
