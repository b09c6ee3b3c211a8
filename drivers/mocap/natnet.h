/*
 * drivers/mocap/natnet.h: NatNet 3.0 messages as structs, both ways (layout: natnet_wire.h). Pure: no sockets, no clock,
 * nothing allocated. Metres, Y up, quaternions x y z w; stamps count ticks of the clock that server info tells.
 *
 * Reading is bounded and exact: a message that is longer than it says, or holds more than the arrays below, is refused.
 * Skeletons, force plates and devices are walked over and counted only, so such a frame cannot be written again.
 */
#ifndef BB_NATNET_H
#define BB_NATNET_H

#include "drivers/mocap/natnet_wire.h"
#include "hal/rate.h"

#define NATNET_NAME_MOST 64      /* with its NUL */
#define NATNET_SETS_MOST 16
#define NATNET_SET_MARKERS_MOST 64
#define NATNET_BODIES_MOST 32
#define NATNET_MARKERS_MOST 256  /* labelled, and unlabelled */
#define NATNET_MODELS_MOST 32
#define NATNET_MODEL_MARKERS_MOST 64
#define NATNET_RAW_MOST 512

struct natnet_hello { /* CONNECT */
	char name[256];          /* all of it is kept: what stands behind the NUL is whatever lay in the sender's memory */
	uint8_t version[4], natnet_version[4];
};

struct natnet_server_info {
	struct natnet_hello hello;
	uint64_t clock_hz;
	uint16_t data_port;
	uint8_t multicast, address[4];
};

struct natnet_marker_set {
	char name[NATNET_NAME_MOST];
	int32_t n;
	float at[NATNET_SET_MARKERS_MOST][3];
};

struct natnet_rigid_body {
	int32_t id;
	float at[3], q[4], error; /* error: mean of its markers, metres */
	int16_t params;
};

struct natnet_marker {
	int32_t id;              /* body << 16 | marker, both from 1 */
	float at[3], size;
	int16_t params;
	float residual;          /* metres in what Motive 2.1 sends */
};

struct natnet_frame {
	int32_t number;
	int32_t n_sets, n_unlabelled, n_bodies, n_skeletons, n_markers, n_plates, n_devices;
	struct natnet_marker_set set[NATNET_SETS_MOST];
	float unlabelled[NATNET_MARKERS_MOST][3];
	struct natnet_rigid_body body[NATNET_BODIES_MOST];
	struct natnet_marker marker[NATNET_MARKERS_MOST];
	uint32_t timecode, timecode_sub;
	double timestamp_s;
	uint64_t mid_exposure, received, transmitted; /* ticks */
	uint16_t params;
	bool has_end;            /* senders end with an i32 that no description has */
	uint32_t end;
};

struct natnet_model {
	int32_t kind;            /* enum natnet_model_kind; others are counted only */
	char name[NATNET_NAME_MOST];
	int32_t id, parent, n_markers;
	float offset[3];
	float at[NATNET_MODEL_MARKERS_MOST][3];
	int32_t label[NATNET_MODEL_MARKERS_MOST];
	char marker[NATNET_MODEL_MARKERS_MOST][NATNET_NAME_MOST]; /* of a marker set */
};

struct natnet_models {
	int32_t n, n_others;     /* n: marker sets and rigid bodies */
	struct natnet_model model[NATNET_MODELS_MOST];
};

struct natnet_message {
	uint16_t id;
	bool bare;               /* CONNECT as some clients send it, without name and versions or with more: raw */
	union {
		struct natnet_hello hello;
		struct natnet_server_info server;
		struct natnet_models models;
		struct natnet_frame frame;
		struct { uint64_t sent, received; } echo; /* received: of the response */
		struct { uint16_t n; uint8_t bytes[NATNET_RAW_MOST]; } raw; /* of every other message */
	};
};

/* A datagram into a message; false: it is none, *why says what is wrong (static text). */
BB_MUST_CHECK bool natnet_read(const uint8_t *bytes, size_t n, struct natnet_message *out, const char **why);
/* A message into a datagram; 0: it does not fit cap, holds more than the arrays, or something that is counted only. */
size_t natnet_write(const struct natnet_message *m, uint8_t *out, size_t cap);

#endif
