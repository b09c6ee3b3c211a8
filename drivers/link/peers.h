/*
 * drivers/link/peers.h: a link between processes, whatever carries its packets: the head's process in the middle, every
 * other one joined to it in a session of its own. What two of the others say to each other goes through the head.
 *
 * Joining: JOIN (version, configuration, nonce) -> WELCOME (place, session) or REFUSED (reason) -> HELLO in that session,
 * which makes it the current one. Every packet carries a mark, its session and a number that only grows: forged,
 * replayed and cut ones change nothing but a counter. A process that died may join again, in a new session.
 *
 * Users (bench/): link_*() below, on a handle opened by link_shm_driver or link_zmq_driver with config.group set.
 * Without a group all nodes live in this process and nothing leaves it. One thread.
 */
#ifndef BB_DRIVERS_LINK_PEERS_H
#define BB_DRIVERS_LINK_PEERS_H

#include "drivers/link/packet.h"
#include "hal/link_driver.h"

#define LINK_PROCESSES_MAX 64
#define LINK_QUEUE 64

extern const struct bb_link_driver link_shm_driver; /* shm: processes of this machine, shared memory and a futex */
extern const struct bb_link_driver link_zmq_driver; /* zmq:tcp://127.0.0.1:5570 : machines, ZeroMQ with CURVE keys */

/* ---- for users ---- */

enum link_peer_state { LINK_PEER_ABSENT, LINK_PEER_JOINED, LINK_PEER_LOST };

struct link_peer {
	enum link_peer_state state;
	uint32_t pid;
	uint32_t joins;      /* how often it joined */
	int64_t heard_ns;    /* last packet of its session */
	int64_t lost_ns;     /* when it was found to be gone */
	bool left;           /* it said so itself */
};

struct link_counts { /* packets */
	uint64_t sent, received;
	uint64_t truncated, malformed, forged, replayed, stale; /* refused; stale: of another session */
	uint64_t refused_version, refused_config, refused_place; /* joins */
	uint64_t overflowed;  /* dropped for lack of room */
	uint64_t missed;      /* numbers that never came */
	uint64_t logged;      /* lines written about refused ones: 10 a second at most */
};

/* What the others give as config.device: "shm:/proc/1234/fd/5", "zmq:tcp://127.0.0.1:40123". */
const char *link_address(const struct bb_link *l);
struct link_counts link_counts(const struct bb_link *l);
struct link_peer link_peer(const struct bb_link *l, uint16_t process);
/* Looks after the others: tells them that this one lives, finds those that do not. Call it every frame or so. */
void link_look_after(struct bb_link *l);
/* Every other process: BB_OK once it has its place, BB_TIMEOUT before, BB_ERR_REFUSED (link_refusal says why), BB_ERR_LOST
 * when the head is gone. */
enum bb_status link_joined(struct bb_link *l);
enum link_reason link_refusal(const struct bb_link *l);
uint16_t link_process(const struct bb_link *l);
/* Where the head's time 0 lies on this process's CLOCK_MONOTONIC, and how far that may be off (0: one machine). */
int64_t link_head_zero_ns(const struct bb_link *l, int64_t *uncertainty_ns);

/* ---- for what carries the packets ---- */

struct link_address {
	uint8_t n, bytes[15];
};

struct link_peers;
struct link_wire_ops { /* every member is mandatory; of a process other than the head's, the only far end is the head */
	/* BB_ERR_LOST: nobody is there any more. BB_ERR_BUSY: no room. */
	enum bb_status (*send)(struct link_peers *l, const struct link_address *to, const uint8_t *bytes, size_t n);
	/* How many bytes the next packet has, 0: none; bytes beyond cap are cut. */
	size_t (*receive)(struct link_peers *l, struct link_address *from, uint8_t *bytes, size_t cap);
	bool (*alive)(struct link_peers *l, const struct link_address *far);
	/* Until a packet has come or CLOCK_MONOTONIC is there. */
	void (*wait)(struct link_peers *l, int64_t until_ns);
	void (*joined)(struct link_peers *l, const struct link_address *far, uint32_t pid);
};

struct link_session {
	struct link_peer peer;
	struct link_address address, next_address;
	uint64_t session, number_out, number_in;
	uint64_t next_session; /* offered, not yet taken up; 0: none */
	int64_t offered_ns;
	uint32_t next_pid;
};

struct link_queue {
	struct bb_timer *notify;
	struct bb_link_message *message; /* LINK_QUEUE, of a node of this process; NULL else */
	size_t first, n;
};

struct link_peers { /* what a back end's handle begins with */
	struct bb_link base;
	const struct link_wire_ops *wire;
	struct bb_link_group group;
	char address[128];
	uint8_t machine[16];
	struct bb_seal *seal;
	struct link_session *session; /* by process; of a process other than the head's only [0] is used */
	struct link_queue *queue;     /* by node */
	struct link_counts counts;
	uint64_t sessions;            /* given out; begins at random */
	uint64_t nonce;               /* of the JOIN under way */
	int64_t asked_ns;             /* when it was sent; 0: not yet */
	enum link_reason refusal;
	int64_t head_zero_ns, uncertainty_ns;
	int64_t log_second, log_lines;
};

/* For open() and close() of back ends. */
BB_MUST_CHECK enum bb_status link_peers_open(struct link_peers *l, const struct link_wire_ops *wire);
void link_peers_close(struct link_peers *l);
bool link_peers_is_head(const struct link_peers *l);
/* 32 secret bytes for one purpose, from the group's secret. */
void link_peers_key(const struct link_peers *l, const char *purpose, uint8_t out[32]);
/* Somebody without the secret was turned away below the packets. */
void link_peers_forged(struct link_peers *l);
enum bb_status link_peers_send(struct bb_link *l, uint16_t from, uint16_t to, const void *bytes, size_t n);
enum bb_status link_peers_receive(struct bb_link *l, uint16_t node, struct bb_link_message *out);
enum bb_status link_peers_notify(struct bb_link *l, uint16_t node, struct bb_timer *timer);

#endif
