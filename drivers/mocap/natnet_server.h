/*
 * drivers/mocap/natnet_server.h: who is served and what is answered: a state machine over datagrams that come in and
 * go out by somebody else's sockets. Nothing allocated but itself; times are the caller's; one thread.
 *
 * A client is an address that said CONNECT or KEEPALIVE; it is sent every frame until it says DISCONNECT or nothing for
 * NATNET_SILENCE_NS. Whoever may spoof an address could have frames sent there: so who opens sockets to others than
 * this machine names whom (mocap_port.h). Answers come at NATNET_ANSWERS_PER_S at most, whoever asks; what is beyond
 * that, malformed or not for a server is counted and not answered.
 */
#ifndef BB_NATNET_SERVER_H
#define BB_NATNET_SERVER_H

#include "drivers/mocap/mocap.h"
#include "drivers/mocap/natnet.h"

#define NATNET_CLIENTS_MAX 16
#define NATNET_SILENCE_NS (10 * BB_NS_PER_S)
#define NATNET_ANSWERS_PER_S 200
#define NATNET_ANSWERS_BURST 50

struct natnet_address {
	uint32_t ip;             /* network order, as the port */
	uint16_t port;
	uint8_t way;             /* which of the server's sockets it speaks to */
};

struct natnet_server_config {
	struct mocap_model model;
	uint16_t data_port;
	bool multicast;          /* frames go to the group once, to no client */
};

struct natnet_counts {
	uint64_t heard, malformed, answered, beyond_rate, refused_clients, timed_out;
};

struct natnet_server;
BB_MUST_CHECK bool natnet_server_create(const struct natnet_server_config *config, struct natnet_server **out);
void natnet_server_begin(struct natnet_server *s, const struct natnet_server_config *config); /* as if just created */
void natnet_server_destroy(struct natnet_server *s); /* NULL is allowed */

/* A datagram; returns the bytes of the answer in out[cap], 0 for none. */
size_t natnet_server_hear(struct natnet_server *s, const struct natnet_address *from, const uint8_t *bytes, size_t n,
                          int64_t now_ns, uint8_t *out, size_t cap);
/* The frame as bytes, kept for REQUEST_FRAME; they are the server's until the next call. */
size_t natnet_server_frame(struct natnet_server *s, const struct mocap_frame *frame, const uint8_t **bytes);
/* A client that is to get it; NULL past the end. */
const struct natnet_address *natnet_server_client(const struct natnet_server *s, size_t i);
/* A client that has been silent for too long: it is one no more, and who it was and what it is told come back. */
size_t natnet_server_expire(struct natnet_server *s, int64_t now_ns, struct natnet_address *who, uint8_t *out, size_t cap);
const struct natnet_counts *natnet_server_counts(const struct natnet_server *s);

#endif
