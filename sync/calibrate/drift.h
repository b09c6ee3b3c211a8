/*
 * sync/calibrate/drift.h: has somebody knocked a camera? (fault row K9, CALIB_DRIFT)
 *
 * While a body is tracked, its markers are projected into every camera and compared with what that camera saw. A camera
 * whose distances, rms over the last quarter of a second, stay above twice its baseline for 2 s, and point the same way for
 * all markers (blobs that scatter and bent glasses do not), has drifted: its calibration is no longer true, and its weight
 * is 0 until somebody calibrates again. One camera is accused at a time, the worst; the others, which its error may have
 * pulled along, begin anew.
 *
 * How to feed it, once a frame has been tracked:
 *
 *	const struct bb_track_pose pose = bb_tracker_pose(tracker, 0, mid_ns);
 *	if (pose.flags & BB_TRACK_FRESH)                        (not from a prediction)
 *		bb_drift_frame(drift, camera, mid_ns, &pose.body, &room->bodies[0], blobs, n_blobs);
 *	if (bb_drift_state(drift, camera).drifted)              (K9: CALIB_DRIFT rms_px; leave its frames out of the tracker,
 *		...                                              but go on feeding them here: `settled` says it is back)
 *
 * Pixels of one axis: rms_px is comparable with a calibration's rms. Pure but for its own state; memory is taken at
 * creation; one thread; deterministic.
 */
#ifndef BB_SYNC_CALIBRATE_DRIFT_H
#define BB_SYNC_CALIBRATE_DRIFT_H

#include "hal/room.h"

struct bb_drift_config {
	const struct bb_camera_config *cameras; /* borrowed for the call of create only */
	size_t n_cameras;
	const double *baseline_px; /* per camera, of its calibration; NULL, or an entry 0: learned from the first frames */
	double noise_px;           /* a baseline is never below this */
	double ratio;              /* of the baseline; 0: 2 */
	int64_t hold_ns;           /* 0: 2 s */
};

struct bb_drift_state {
	bool drifted;        /* weight 0; stays until bb_drift_forgive */
	bool settled;        /* drifted, but its markers have been where they belong for hold_ns: somebody put it back */
	int64_t drifted_ns;  /* when it was accused; 0: never */
	int64_t since_ns;    /* its distances have been too large since; 0: they are not */
	double rms_px;       /* now, per axis */
	double baseline_px;  /* 0: still being learned */
	double shift_px[2];  /* mean of blob minus projection: which way it was knocked */
};

struct bb_drift;
BB_MUST_CHECK enum bb_status bb_drift_create(const struct bb_drift_config *config, struct bb_drift **out);
void bb_drift_destroy(struct bb_drift *d);
/* One frame of one camera, times of a camera never going back, and the pose of a body at its mid-exposure. */
void bb_drift_frame(struct bb_drift *d, size_t camera, int64_t mid_ns, const struct bb_pose *pose,
                    const struct bb_body *body, const struct bb_blob *blobs, size_t n);
struct bb_drift_state bb_drift_state(const struct bb_drift *d, size_t camera);
/* 0 for a drifted camera, else 1. */
double bb_drift_weight(const struct bb_drift *d, size_t camera);
/* It was calibrated again, or put back: its baseline stays. */
void bb_drift_forgive(struct bb_drift *d, size_t camera);

#endif
