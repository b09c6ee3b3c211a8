/*
 * drivers/mocap/vrpn.h: one VRPN connection, the server's end: bytes in, bytes out. No sockets, no clock; nothing is
 * allocated; the caller's memory. Senders are bodies, each with a sensor 0; they get Pos_Quat and Velocity messages.
 * Everything goes over the one connection: what a client says of UDP ports and logs is read and not used.
 */
#ifndef BB_VRPN_H
#define BB_VRPN_H

#include "drivers/mocap/mocap.h"
#include "drivers/mocap/vrpn_wire.h"
#include "hal/rate.h"

#define VRPN_MESSAGE_MOST 2048   /* that a client may send */
#define VRPN_IDS_MAX 2000        /* senders, types a client may have: VRPN's own limits */
#define VRPN_OUT_BYTES 32768
#define VRPN_HANDSHAKE_NS (2 * BB_NS_PER_S)

struct vrpn_header {
	int32_t length, seconds, micros, sender, type, sequence;
};
void vrpn_put_header(uint8_t out[VRPN_HEADER_BYTES], const struct vrpn_header *h);
void vrpn_get_header(const uint8_t in[VRPN_HEADER_BYTES], struct vrpn_header *h);
void vrpn_put_cookie(uint8_t out[VRPN_COOKIE_BYTES]);
/* Payloads. Velocity: metres per second, and the turn that happens within dt_s. */
void vrpn_put_pos_quat(uint8_t out[VRPN_POS_QUAT_BYTES], int32_t sensor, const struct bb_pose *pose);
void vrpn_put_velocity(uint8_t out[VRPN_VELOCITY_BYTES], int32_t sensor, struct bb_vec3 v_m_s, struct bb_quat turn,
                       double dt_s);

struct vrpn_session {
	const struct mocap_model *model; /* borrowed */
	bool greeted;                    /* their cookie came and is one of ours */
	int64_t began_ns;
	int32_t ping;                    /* the client's id of that type; -1: not told */
	int32_t sequence;
	int8_t body_of[VRPN_IDS_MAX];    /* the client's senders: 1 + body */
	uint64_t poses, dropped;         /* dropped: they read too slowly, and the newest poses wait for nobody */
	const char *why;                 /* the connection is to be closed; static text */
	size_t n_in, n_out;
	uint8_t in[VRPN_MESSAGE_MOST], out[VRPN_OUT_BYTES]; /* out: to be sent from its beginning */
};

void vrpn_session_begin(struct vrpn_session *s, const struct mocap_model *model, int64_t now_ns);
/* What they sent. false: hang up, s->why says why. */
BB_MUST_CHECK bool vrpn_session_take(struct vrpn_session *s, const uint8_t *bytes, size_t n, int64_t now_ns);
/* Poses of a frame into out, once greeted; before is the frame before (NULL: none), for velocities. A frame that does
 * not fit whole is dropped whole. */
void vrpn_session_frame(struct vrpn_session *s, const struct mocap_frame *frame, const struct mocap_frame *before);
void vrpn_session_sent(struct vrpn_session *s, size_t n); /* of out */

/* "127.0.0.1 40123": where a client listens that wants to be called back. false: it says something else. */
BB_MUST_CHECK bool vrpn_lob_read(const uint8_t *bytes, size_t n, uint32_t *ip, uint16_t *port); /* ip: network order */

#endif
