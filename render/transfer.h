/*
 * render/transfer.h: a transfer function from a text file: "value r g b opacity" a line, value ascending in 0..1 of the
 * data's range, colours 0..1, opacity 0..1 per reference step of one voxel; "#" comments; 2..1024 points, piecewise
 * linear. Refused: NaN, out of range, unsorted (1301...). Immutable after loading.
 */
#ifndef BB_RENDER_TRANSFER_H
#define BB_RENDER_TRANSFER_H

#include "hal/status.h"

#define BB_TRANSFER_POINTS_MAX 1024

struct bb_transfer {
	size_t n;
	struct bb_transfer_point {
		double value, r, g, b, opacity;
	} point[BB_TRANSFER_POINTS_MAX];
	double least_visible; /* smallest value with opacity > 0 on its right; > 1: nothing is visible */
};

BB_MUST_CHECK enum bb_status bb_transfer_load(const char *path, struct bb_transfer *out, struct bb_error *err);
/* Colour (not premultiplied) and opacity per voxel step at v (clamped to 0..1; NaN counts as 0). */
void bb_transfer_at(const struct bb_transfer *tf, double v, double rgba[4]);
/* Largest opacity anywhere in [lo, hi]: an empty brick has 0. */
double bb_transfer_most_opacity(const struct bb_transfer *tf, double lo, double hi);
/* Opacity for another step: -expm1(ratio * log1p(-opacity)), exact at both ends (row nC1). */
double bb_transfer_opacity_for_step(double opacity, double step_ratio);

#endif
