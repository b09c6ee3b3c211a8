/*
 * drivers/mocap/mocap.h: what a tracking server tells its clients, whatever the protocol: which bodies there are, and a
 * frame of their poses. Metres, Y up, right-handed, in the room's space; stamps are host ns.
 */
#ifndef BB_MOCAP_H
#define BB_MOCAP_H

#include "hal/geometry.h"

#define MOCAP_BODIES_MAX 16
#define MOCAP_BODY_MARKERS_MAX 8

struct mocap_model {
	size_t n_bodies;
	struct {
		char name[BB_ID_MAX];
		size_t n_markers;
		struct bb_vec3 marker[MOCAP_BODY_MARKERS_MAX]; /* body space */
	} body[MOCAP_BODIES_MAX];
	double rate_hz;          /* of frames, as near as is known */
};

struct mocap_pose {
	bool valid;              /* tracked now; false: the pose is where it was last, or where nobody knows */
	struct bb_pose pose;     /* body space to room */
	double error_m;          /* one sigma of the position */
};

struct mocap_frame {
	int32_t number;
	int64_t mid_exposure_ns, received_ns, sent_ns; /* received: the last camera's bytes; 0: not known */
	struct mocap_pose body[MOCAP_BODIES_MAX];      /* as many as the model has */
	bool recorded;           /* a replay */
};

#endif
