/*
 * render/bricks/perceived.h: colours as they are seen: CIE 1976 L*a*b* and L*u*v* of sRGB colours (IEC 61966-2-1, white
 * D65), in which a distance of one is about what an eye can tell. Pure functions.
 */
#ifndef BB_RENDER_BRICKS_PERCEIVED_H
#define BB_RENDER_BRICKS_PERCEIVED_H

#include "hal/base.h"

/* rgb: 0..1 as they are shown; what is outside is clamped, NaN is 0. L* 0..100. */
void bb_perceived_lab(const double rgb[3], double lab[3]);
void bb_perceived_luv(const double rgb[3], double luv[3]);
double bb_perceived_distance(const double a[3], const double b[3]);

#endif
