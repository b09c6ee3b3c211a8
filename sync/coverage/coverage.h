/*
 * sync/coverage/coverage.h: how many cameras see a marker at a point of the room, and how well they place it.
 *
 * A camera sees a marker when its image, lens distortion included, lies in the picture and is large enough, the marker
 * is neither too near nor too far, no wall stands between, and the viewer who wears it does not: an upright head (a
 * sphere) over a torso (an upright capsule) that turns through evenly spaced headings about the marker.
 *
 * Expected error: each camera adds J^T J / sigma^2 to the information about the point, J = d px / d room; the inverse
 * of the sum is the covariance of the best unbiased position (the Cramer-Rao bound), which
 * sync/track/triangulate.h reaches to first order. No two rays at BB_RAY_ANGLE_MIN_RAD or more: no position.
 *
 * Metres, room axes. Pure after creation: any threads, and the same answer for a point whoever asks.
 */
#ifndef BB_SYNC_COVERAGE_COVERAGE_H
#define BB_SYNC_COVERAGE_COVERAGE_H

#include "hal/room.h"

#define BB_COVERAGE_CAMERAS_MAX 256
#define BB_COVERAGE_HEADINGS_MAX 64
#define BB_COVERAGE_VOXELS_MAX 20000000u

/* The viewer's body in the way: not at all; over all headings, on average; at the worst heading. */
enum bb_coverage_body { BB_COVERAGE_NONE, BB_COVERAGE_MEAN, BB_COVERAGE_WORST, BB_COVERAGE_BODIES };

struct bb_viewer_shape {
	struct bb_vec3 head; /* from the marker to the head's centre, of a viewer who faces -Z */
	double head_radius_m;
	double torso_top_m, torso_bottom_m; /* ends of the capsule's axis below the head's centre */
	double torso_radius_m;
};

struct bb_coverage_config {
	const struct bb_room *room;             /* borrowed: its walls */
	const struct bb_camera_config *cameras; /* borrowed */
	size_t n_cameras;
	struct bb_viewer_shape viewer;
	unsigned headings;
	double marker_m, least_px; /* diameter; of its image, at the marker's distance */
	double near_m, far_m;
	double noise_px; /* of a blob's centre, each axis; 0: as each camera has it, at least 0.001 */
};

struct bb_coverage_voxel { /* indices: enum bb_coverage_body */
	bool inside; /* the room; else the rest is 0 */
	float lost;  /* share of headings at which there is no position */
	/* Cameras that see it. Standard error, the square root of the covariance's trace, and along its worst axis;
	 * INFINITY: no position. On average: root mean square over the headings that have a position. */
	float n[BB_COVERAGE_BODIES], error_m[BB_COVERAGE_BODIES], worst_m[BB_COVERAGE_BODIES];
};

struct bb_coverage_look { /* one point, one heading */
	size_t n;
	uint16_t camera[BB_COVERAGE_CAMERAS_MAX];
	bool placed;
	double covariance_m2[6]; /* xx xy xz yy yz zz */
	double error_m, worst_m;
};

struct bb_coverage;
/* BB_ERR_CONFIG: a camera that is none, or a number out of range; *bad is then the camera's index or n_cameras. */
BB_MUST_CHECK enum bb_status bb_coverage_create(const struct bb_coverage_config *config, struct bb_coverage **out,
						size_t *bad);
void bb_coverage_destroy(struct bb_coverage *c);

void bb_coverage_at(const struct bb_coverage *c, struct bb_vec3 p, struct bb_coverage_voxel *out);
/* heading < 0: without the viewer. The point need not lie inside the room. */
void bb_coverage_look(const struct bb_coverage *c, struct bb_vec3 p, int heading, struct bb_coverage_look *out);

/* Cubes from a corner on; x runs fastest, then z, then y. A row is all x of one (y, z). */
struct bb_coverage_grid {
	struct bb_vec3 min;
	double step_m;
	size_t n[3]; /* x y z */
};
/* As many whole cubes as cover the box, centred on it. false: none, or more than BB_COVERAGE_VOXELS_MAX. */
bool bb_coverage_grid_over(struct bb_vec3 min, struct bb_vec3 max, double step_m, struct bb_coverage_grid *out);
size_t bb_coverage_rows(const struct bb_coverage_grid *g);
struct bb_vec3 bb_coverage_centre(const struct bb_coverage_grid *g, size_t x, size_t y, size_t z);
void bb_coverage_row(const struct bb_coverage *c, const struct bb_coverage_grid *g, size_t row,
		     struct bb_coverage_voxel *out);

#endif
