/*
 * sync/track/p3p.h: poses from three bearings of one camera, up to four. Metres.
 */
#ifndef BB_SYNC_TRACK_P3P_H
#define BB_SYNC_TRACK_P3P_H

#include "hal/geometry.h"

/* Unit bearings y (camera or room axes), body points x: depths along the bearings for every pose; returns how many. */
size_t bb_p3p_depths(const struct bb_vec3 y[3], const struct bb_vec3 x[3], double depth[4][3]);

#endif
