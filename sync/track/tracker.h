/*
 * sync/track/tracker.h: head and wand poses from camera blobs.
 *
 * Blobs of cameras that exposed together (mid-exposures within group_ns) form one set: undistort, rays, matching and
 * triangulation weighted by ray angle, labelling by marker distances, Kabsch/Horn with reflection fix and eigen-gap
 * test, then a least-squares polish of the pose on the pixels of all cameras; occlusion down to 3 visible markers; with
 * a single camera a pose from 4 or more markers by the pixels alone. A constant-velocity filter predicts to any time.
 * Algorithms only: no clock, no devices; times are host ns given by the caller. All memory is taken at creation. One
 * thread. Deterministic.
 */
#ifndef BB_SYNC_TRACK_TRACKER_H
#define BB_SYNC_TRACK_TRACKER_H

#include "hal/room.h"

struct bb_tracker_config {
	const struct bb_camera_config *cameras; /* borrowed: calibrated poses and lenses */
	size_t n_cameras;
	const struct bb_body *bodies;           /* borrowed */
	size_t n_bodies;
	double blob_sigma_px;                   /* > 0 */
	int64_t group_ns;                       /* exposures closer than this belong together */
	int64_t freeze_ns;                      /* predict at most this far past the last solution, then freeze (K4: 100 ms) */
	struct bb_vec3 room_min, room_max;      /* solutions outside (by more than 0.5 m) are rejected */
	struct bb_pose neutral;                 /* pose of bodies[0]'s eyes when nothing is known */
};

enum bb_track_flags {
	BB_TRACK_FRESH = 1,      /* solved from the newest set */
	BB_TRACK_PREDICTED = 2,  /* older: carried forward by the filter */
	BB_TRACK_FROZEN = 4,     /* past freeze_ns */
	BB_TRACK_NEVER = 8,      /* no solution yet: neutral */
	BB_TRACK_COLLINEAR = 16, /* eigen gap too small: roll about the marker line held from before */
	BB_TRACK_ONE_CAMERA = 32,
	BB_TRACK_SWAP = 64       /* K5: in this set the labels of before were contradicted, by residuals or bare markers */
};

struct bb_track_solution { /* unpredicted, at mid-exposure */
	int64_t at_ns;
	struct bb_pose body;         /* body space to room */
	struct bb_vec3 centroid;     /* mean of the body's markers (all of them) under that pose */
	double position_sigma_mm, angle_sigma_deg; /* roots of the traces below; the angle's with the held roll */
	double covariance_mm2[6];    /* of the centroid, room axes: xx xy xz yy yz zz */
	double covariance_deg2[6];   /* of the rotation vector, room axes, the same order; without a held roll */
	double residual_px;          /* rms */
	uint16_t n_markers, n_cameras; /* labelled markers; cameras that see at least 3 of them */
	uint16_t n_blobs;
	unsigned flags;
};

struct bb_track_pose { /* predicted */
	struct bb_pose body, eyes;   /* eyes: at the body's eye_centre, same orientation */
	int64_t solved_ns;           /* mid-exposure of the newest solution used; 0 with NEVER */
	double position_sigma_mm;    /* of the centroid; grows with the prediction */
	double angle_sigma_deg;
	double covariance_mm2[6];    /* of the eyes' midpoint, room axes: xx xy xz yy yz zz */
	double covariance_deg2[6];   /* of the rotation vector, the same order */
	unsigned flags;
};

struct bb_tracker;
BB_MUST_CHECK enum bb_status bb_tracker_create(const struct bb_tracker_config *config, struct bb_tracker **out);
void bb_tracker_destroy(struct bb_tracker *tr);

/* One camera's frame. Frames may come in any order of cameras; a frame of a newer set closes older ones. */
void bb_tracker_frame(struct bb_tracker *tr, size_t camera, int64_t mid_exposure_ns, const struct bb_blob *blobs,
                      size_t n);
/* Solve every closed set, and the open one when all cameras delivered or `flush`. Solutions (bodies[body], oldest
 * first) since the last call are counted in the return value; the newest cap are copied. */
size_t bb_tracker_solve(struct bb_tracker *tr, bool flush, size_t body, struct bb_track_solution *out, size_t cap);
/* Pose predicted to a time (normally the photon's). */
struct bb_track_pose bb_tracker_pose(const struct bb_tracker *tr, size_t body, int64_t at_ns);
/* Per camera, counted since creation: blobs that belonged to a labelled marker, blobs expected but missing, frames. */
struct bb_track_camera_stats {
	uint64_t frames, used, missing, stray;
	uint64_t floods;    /* K6: frames of as many blobs as fit, or more: nearest to the predictions are kept */
	double residual_px; /* rms over the last solutions, decaying */
};
struct bb_track_camera_stats bb_tracker_camera(const struct bb_tracker *tr, size_t camera);

/* Which blob was which marker in the newest set, when that solved the body (else 0). Pixels as the camera sent them.
 * Returns how many there are; cap are copied, by camera. */
struct bb_track_label {
	uint16_t camera;
	uint8_t marker;
	double x_px, y_px;
};
size_t bb_tracker_labels(const struct bb_tracker *tr, size_t body, struct bb_track_label *out, size_t cap);

/* Work, which has a ceiling for each set whatever the cameras send (track.h). */
struct bb_track_work {
	uint32_t pairs;  /* pairs of rays tried against each other */
	uint32_t points; /* pairs that met and were shown to the other cameras */
	uint32_t poses;  /* poses made from three labelled points or bearings */
};
struct bb_track_stats {
	uint64_t sets, cold_starts, swaps, refused; /* refused: cold starts that found something and did not believe it */
	uint64_t floods;                            /* sets in which a camera was flooded */
	struct bb_track_work last, most;            /* of the newest set; the most of any set */
};
struct bb_track_stats bb_tracker_stats(const struct bb_tracker *tr);

#endif
