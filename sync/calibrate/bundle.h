/*
 * sync/calibrate/bundle.h: bundle adjustment of cameras and wands (Triggs et al. 2000).
 *
 * Unknowns: 11 a camera (focal length, centre, k1, k2, orientation, position; other coefficients are held) and 5 a wand
 * (its middle and its direction). A wand as a rod, not as three points with distances between them: its lengths hold
 * exactly, no weight between metres and pixels has to be chosen, and the block that is eliminated is 5 x 5 instead of
 * 9 x 9. Levenberg-Marquardt; wands are eliminated by the Schur complement, cameras are one dense system (dense.h). Where
 * the whole picture stands in the room nothing here says: six directions are free, and the damping keeps them still.
 *
 * Loss of an observation that is r pixels off, as a vector: Cauchy, c^2 log(1 + r^2 / c^2), or r^2. Weak priors (f 10 %,
 * centre 5 % of the width, k1 and k2 0.2; each worth a single observation) keep cameras that saw little from running off.
 * Pure but for its own memory. One thread. Deterministic.
 */
#ifndef BB_SYNC_CALIBRATE_BUNDLE_H
#define BB_SYNC_CALIBRATE_BUNDLE_H

#include "hal/camera.h"

#define BB_BUNDLE_CAMERA 11
#define BB_BUNDLE_ROD 5

struct bb_rod {
	struct bb_vec3 p, u; /* middle of its three markers; unit vector along it */
};

struct bb_bundle_obs {
	uint32_t rod;
	uint16_t camera;
	uint8_t marker;
	bool out;           /* not used */
	double px[2];
	uint32_t source;    /* the caller's: which blob of which picture */
	float off_px[2];    /* out, of bb_bundle_residuals: observed minus projected; NAN when it cannot be projected */
};

struct bb_bundle {
	struct bb_camera_config *cameras; /* in and out; borrowed */
	size_t n_cameras;
	struct bb_rod *rods; /* in and out; borrowed */
	size_t n_rods;
	struct bb_bundle_obs *obs; /* sorted by rod, then camera; borrowed */
	size_t n_obs;
	double along_m[3];         /* where its markers are on a rod, from its middle; their sum is 0 */
	double cauchy_px;          /* 0: squares */
	const struct bb_camera_config *prior; /* borrowed: where the weak priors pull */
	const uint16_t *lens_of;   /* borrowed; NULL: every camera has a lens of its own; else the camera whose it is, i or less */

	double cost;               /* out */
	unsigned steps;            /* out: accepted */
};

/* At most most_steps accepted steps, or until the cost falls by less than the tolerance, relative. BB_ERR_NOMEM;
 * BB_ERR_CONFIG when a camera is none. */
BB_MUST_CHECK enum bb_status bb_bundle_run(struct bb_bundle *b, unsigned most_steps, double tolerance);
/* Fills off_px of every observation, those that are out, too. */
BB_MUST_CHECK enum bb_status bb_bundle_residuals(struct bb_bundle *b);

/* For tests: projection and its derivatives by the camera's 11 (f, cx, cy, k1, k2, turn in camera axes, position) and the
 * rod's 5 unknowns. false: it cannot be projected. */
bool bb_bundle_derive(const struct bb_bundle *b, size_t camera, const struct bb_rod *rod, unsigned marker, double px[2],
                      double by_camera[2][BB_BUNDLE_CAMERA], double by_rod[2][BB_BUNDLE_ROD]);
/* For tests: the same unknowns, moved. */
void bb_bundle_move_camera(struct bb_camera_config *c, const double d[BB_BUNDLE_CAMERA]);
void bb_bundle_move_rod(struct bb_rod *rod, const double d[BB_BUNDLE_ROD]);

#endif
