/*
 * bench/track/cloud.h: part of a room as a shaded cloud: a field of 0..1 over a grid, marched along the rays of a
 * picture, lit by its gradient, and the shadow it throws on the floor. Pictures for cairo, premultiplied, the same bytes
 * for any number of threads. Metres, room axes.
 */
#ifndef BB_BENCH_TRACK_CLOUD_H
#define BB_BENCH_TRACK_CLOUD_H

#include <cairo.h>

#include "hal/geometry.h"
#include "hal/status.h"
#include "sync/coverage/coverage.h"

struct bb_eyepoint { /* where a picture is taken from; pixels grow right and down */
	struct bb_vec3 eye, right, up, forward;
	double focal_px, x_px, y_px; /* of the point straight ahead */
};

/* Sees a whole box from outside, as large as fits width x height with a margin. */
struct bb_eyepoint bb_eyepoint_of_box(struct bb_vec3 min, struct bb_vec3 max, double azimuth_deg, double elevation_deg,
				      double width, double height, double margin);
void bb_eyepoint_project(const struct bb_eyepoint *e, struct bb_vec3 p, double *x, double *y);

struct bb_cloud {
	const struct bb_coverage_grid *grid;
	float *field; /* gradient x, y, z and value, a voxel; owned */
	float *above; /* what of it stands above each place of the floor; owned */
};
/* From a value a voxel, 0 or 1, x fastest, then z, then y; smoothed. */
BB_MUST_CHECK enum bb_status bb_cloud_init(struct bb_cloud *c, const struct bb_coverage_grid *grid, const float *value);
void bb_cloud_fini(struct bb_cloud *c);
/* The cloud, and what it darkens of the floor at height floor_m; NULL: out of memory. `sharper` pixels a point. */
cairo_surface_t *bb_cloud_picture(const struct bb_cloud *c, const struct bb_eyepoint *e, double width, double height,
				  double sharper, unsigned threads);
cairo_surface_t *bb_cloud_shadow(const struct bb_cloud *c, const struct bb_eyepoint *e, double floor_m, double width,
				 double height, double sharper, unsigned threads);

#endif
