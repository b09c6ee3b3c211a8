/*
 * drivers/mocap/mocap_port.h: NatNet and VRPN servers on sockets of this machine: what natnet_server.h and vrpn.h decide,
 * put on UDP and TCP. Nothing blocks: a client that does not read loses frames. One thread; times are the caller's.
 *
 * 127.0.0.1 unless told otherwise. Neither protocol has a secret, so another address wants the addresses of those who may
 * speak to it; nobody else is heard. UDP sources can be forged: then frames go to somebody on that list, no farther.
 */
#ifndef BB_MOCAP_PORT_H
#define BB_MOCAP_PORT_H

#include "drivers/mocap/mocap.h"
#include "hal/status.h"

#define MOCAP_ALLOW_MAX 16
#define MOCAP_VRPN_MAX 8     /* connections */

struct bb_mocap_config {
	struct mocap_model model;
	bool natnet, vrpn;
	uint16_t command_port, data_port, vrpn_port; /* 0: any free one */
	const char *bind;            /* NULL: 127.0.0.1; numeric IPv4 */
	const char *allow[MOCAP_ALLOW_MAX];
	size_t n_allow;
	const char *multicast;       /* NatNet frames to 239.255.42.99, out of the interface with this address; NULL: unicast */
};

struct bb_mocap_ports {
	uint16_t command, data, vrpn; /* as they are now; 0: not served */
};

struct bb_mocap_counts {
	uint64_t frames, natnet_sent, natnet_heard, natnet_refused;
	uint64_t vrpn_poses, vrpn_dropped, vrpn_connections, vrpn_refused; /* connections: ever */
};

struct bb_mocap;
/* 1760: an address or port cannot be had; 1761: it would be open to everybody. */
BB_MUST_CHECK enum bb_status bb_mocap_open(const struct bb_mocap_config *config, struct bb_mocap **out,
                                           struct bb_error *err);
void bb_mocap_close(struct bb_mocap *m); /* NULL is allowed */
struct bb_mocap_ports bb_mocap_ports(const struct bb_mocap *m);
/* Hears and answers whoever has something to say. */
void bb_mocap_step(struct bb_mocap *m, int64_t now_ns);
/* A frame to everybody. sent_ns is set to now_ns. */
void bb_mocap_frame(struct bb_mocap *m, const struct mocap_frame *frame, int64_t now_ns);
/* Waits until somebody says something or other_fd is readable (true), most_ns at most; other_fd -1: none. */
bool bb_mocap_wait(struct bb_mocap *m, int64_t most_ns, int other_fd);
struct bb_mocap_counts bb_mocap_counts(const struct bb_mocap *m);

#endif
