/*
 * drivers/mocap/vrpn_wire.h: VRPN 7 as vrpn_Connection and vrpn_Tracker speak it: numbers only. Everything is big-endian.
 * A connection begins with a cookie each way; then messages: a header of 24 bytes (length of header and payload without
 * padding, seconds, microseconds, sender, type, sequence), and the payload, padded to 8 bytes.
 */
#ifndef BB_VRPN_WIRE_H
#define BB_VRPN_WIRE_H

#define VRPN_PORT 3883
#define VRPN_COOKIE_BYTES 24
#define VRPN_COOKIE "vrpn: ver. 07.38"
#define VRPN_COOKIE_MAJOR 13 /* so many bytes of it must agree: "vrpn: ver. 07" */
#define VRPN_COOKIE_LOG 18   /* where the log mode stands: '0' none, or '1' in, '2' out, '3' both */
#define VRPN_HEADER_BYTES 24
#define VRPN_ALIGN 8
#define VRPN_NAME_MOST 100   /* with its NUL */
#define VRPN_LOB_MOST 1472

enum vrpn_type { /* of the protocol's own messages; others are described first and count from 0 */
	VRPN_SENDER_DESCRIPTION = -1,
	VRPN_TYPE_DESCRIPTION = -2,
	VRPN_UDP_DESCRIPTION = -3,
	VRPN_LOG_DESCRIPTION = -4,
	VRPN_DISCONNECT = -5
};

#define VRPN_POS_QUAT "vrpn_Tracker Pos_Quat"
#define VRPN_VELOCITY "vrpn_Tracker Velocity"
#define VRPN_PING "vrpn_Base ping_message"
#define VRPN_PONG "vrpn_Base pong_message"
#define VRPN_POS_QUAT_BYTES 64
#define VRPN_VELOCITY_BYTES 72

#endif
