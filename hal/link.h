/*
 * hal/link.h: node-to-node messages for scene state and barriers: unreliable datagrams with order not kept, as a
 * network gives them. One handle is the whole network as seen from this process.
 */
#ifndef BB_HAL_LINK_H
#define BB_HAL_LINK_H

#include "hal/device.h"

#define BB_LINK_MESSAGE_MAX 512
#define BB_LINK_NODES_MAX 64       /* of a room */
#define BB_LINK_ENDPOINTS_MAX 512  /* a simulated network may be larger than any room */
#define BB_LINK_ALL 0xFFFF /* to: every other node */

/* Several processes: who plays which node, and what all of them must agree on. */
#define BB_LINK_ANY 0xFFFF /* process: the next one that is free */
struct bb_link_group {
	uint16_t process, n_processes;                   /* 0 is the head's */
	uint16_t home[BB_LINK_NODES_MAX];                /* by node: its process */
	uint8_t secret[32];                              /* all keys are made from it; zeros: none */
	uint8_t version_sha256[32], config_sha256[32];   /* of the program; of everything a run depends on */
};

/* Of what a delay is longer than the least: the absolute value of a normal (jitter_us is its sd; at most 4 of them), or an
 * exponential (jitter_us is its mean; 1 % are longer than 4.6 of them). */
enum bb_link_spread { BB_LINK_HALF_NORMAL, BB_LINK_EXPONENTIAL };
#define BB_LINK_SPREAD_WORDS "half_normal|exponential"

struct bb_link_config {
	char id[BB_ID_MAX];  /* "net" */
	char device[160];
	int64_t n_nodes;
	double delay_us, jitter_us, loss_ppm;
	const struct bb_link_group *group; /* NULL: all nodes live in this process */
	int spread;          /* enum bb_link_spread */
	double duplicate_ppm;
	double send_us;      /* a sender is busy with each datagram for so long */
};

/* How nodes flip together over a link: sync/framelock/framelock.h. */
enum bb_lock_method { BB_LOCK_CENTRAL, BB_LOCK_TREE, BB_LOCK_DISSEMINATION, BB_LOCK_TIMED, BB_LOCK_METHODS };
#define BB_LOCK_METHOD_WORDS "central|tree|dissemination|timed"

struct bb_link_limits {
	size_t most_bytes;
	int64_t least_delay_ns;
};

struct bb_link_message {
	uint16_t from, to;
	int64_t sent_ns, arrived_ns;
	size_t n_bytes;
	uint8_t bytes[BB_LINK_MESSAGE_MAX];
};

struct bb_link;
struct bb_link_driver;

BB_MUST_CHECK enum bb_status bb_link_open(const struct bb_link_driver *driver, const struct bb_link_config *config,
                                          const struct bb_open *open, struct bb_link **out);
void bb_link_close(struct bb_link *l);
const struct bb_link_limits *bb_link_limits(const struct bb_link *l);
/* Copies the bytes. BB_ERR_RANGE for too many bytes or an unknown node. A lost message is BB_OK here. */
BB_MUST_CHECK enum bb_status bb_link_send(struct bb_link *l, uint16_t from, uint16_t to, const void *bytes, size_t n);
/* The oldest message that has arrived at this node; BB_TIMEOUT when there is none. */
BB_MUST_CHECK enum bb_status bb_link_receive(struct bb_link *l, uint16_t node, struct bb_link_message *out);
/* A node asks to be woken when a message arrives for it: the timer is armed for the arrival. NULL forgets it. */
BB_MUST_CHECK enum bb_status bb_link_notify(struct bb_link *l, uint16_t node, struct bb_timer *timer);
struct bb_device *bb_link_device(struct bb_link *l);

#endif
