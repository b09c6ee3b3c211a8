/*
 * drivers/mocap/natnet_wire.h: NatNet 3.0 as OptiTrack's Motive 2 speaks it: numbers only. Everything is little-endian; a
 * datagram is a message: u16 id, u16 payload bytes, payload.
 */
#ifndef BB_NATNET_WIRE_H
#define BB_NATNET_WIRE_H

#define NATNET_COMMAND_PORT 1510
#define NATNET_DATA_PORT 1511
#define NATNET_MULTICAST "239.255.42.99"
#define NATNET_HEADER_BYTES 4
#define NATNET_DATAGRAM_MOST 65507

enum natnet_id {
	NATNET_CONNECT = 0,
	NATNET_SERVER_INFO = 1,
	NATNET_REQUEST = 2,
	NATNET_RESPONSE = 3,
	NATNET_REQUEST_MODELS = 4,
	NATNET_MODELS = 5,
	NATNET_REQUEST_FRAME = 6,
	NATNET_FRAME = 7,
	NATNET_MESSAGE = 8,
	NATNET_DISCONNECT = 9,
	NATNET_KEEPALIVE = 10,
	NATNET_DISCONNECT_TIMEOUT = 11,
	NATNET_ECHO_REQUEST = 12,
	NATNET_ECHO_RESPONSE = 13,
	NATNET_DISCOVERY = 14,
	NATNET_UNRECOGNIZED = 0x100
};

#define NATNET_TRACKED 1 /* params of a rigid body */
enum natnet_marker_params { /* of a labelled marker */
	NATNET_OCCLUDED = 1,
	NATNET_CLOUD_SOLVED = 2,
	NATNET_MODEL_SOLVED = 4,
	NATNET_HAS_MODEL = 8,
	NATNET_UNLABELLED = 16,
	NATNET_ACTIVE = 32
};
enum natnet_frame_params { NATNET_RECORDING = 1, NATNET_MODELS_CHANGED = 2 };
enum natnet_model_kind { NATNET_MARKER_SET = 0, NATNET_RIGID_BODY = 1, NATNET_SKELETON = 2 };

#endif
