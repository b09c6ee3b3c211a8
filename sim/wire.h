/*
 * sim/wire.h: puts peers on wires that other programs can open: a TCP listener or a pty, one poll loop, one thread.
 * Whoever dials is hostile: at most SIM_WIRE_SESSIONS_MAX sessions, bounded queues, a time limit for an unfinished
 * frame and for silence. What is said may be said later, or byte by byte: faults need that. Times are ns of the clock
 * given, which is the posix one. Linux.
 */
#ifndef BB_SIM_WIRE_H
#define BB_SIM_WIRE_H

#include "hal/clock.h"

#define SIM_WIRE_SESSIONS_MAX 64
#define SIM_WIRE_ENDPOINTS_MAX 128
#define SIM_WIRE_SAY_MAX 320        /* bytes of one say */
#define SIM_WIRE_QUEUE 16           /* sayings under way in one session */
#define SIM_WIRE_TOKEN_MOST 256
#define SIM_WIRE_WATCHED_MAX 16

struct sim_wire;
struct sim_wire_line;               /* one session's way out */

struct sim_wire_protocol {
	const char *name;           /* "modbus-tcp" */
	size_t session_bytes;       /* zeroed memory for each session; at most 1024 */
	/* Takes all n bytes. Answers with sim_wire_say. false: hang up (a pty only forgets). */
	bool (*take)(void *peer, void *session, struct sim_wire_line *line, const uint8_t *bytes, size_t n, int64_t now_ns);
	/* Is a frame begun and not ended? Such a session has frame_ns to end it, others have idle_ns. */
	bool (*unfinished)(const void *session);
	int64_t frame_ns, idle_ns;
	/* Not NULL: a client that may speak is the peer's own from then on, with the socket (to be closed) and what it has
	 * said already; nothing above is asked. */
	void (*adopt)(void *peer, int fd, const uint8_t *bytes, size_t n);
};

BB_MUST_CHECK enum bb_status sim_wire_create(struct bb_clock *clk, struct sim_wire **out);
void sim_wire_destroy(struct sim_wire *w);

struct sim_wire_listen {
	const char *address;        /* numeric; IPv4 or IPv6 */
	uint16_t port;              /* 0: the kernel chooses */
	const char *token;          /* NULL: none; otherwise the first line a client must send within a second */
};
/* port_out: where it listens. BB_ERR_IO with errno's text in err (1571). */
BB_MUST_CHECK enum bb_status sim_wire_tcp(struct sim_wire *w, const struct sim_wire_listen *at,
                                          const struct sim_wire_protocol *protocol, void *peer, uint16_t *port_out,
                                          struct bb_error *err);
/* path_out: the terminal a client opens. */
BB_MUST_CHECK enum bb_status sim_wire_pty(struct sim_wire *w, const struct sim_wire_protocol *protocol, void *peer,
                                          char *path_out, size_t cap, struct bb_error *err);

/* An open file that ends the wait when it becomes readable: a signalfd, another wire's socket. false: too many. */
bool sim_wire_watch(struct sim_wire *w, int fd);
/* Waits until something is to be done, most_ns at most; touches no peer. true: a watched file is readable. */
bool sim_wire_wait(struct sim_wire *w, int64_t most_ns);
/* Does it: accepts, reads, answers, hangs up. */
void sim_wire_serve(struct sim_wire *w);
size_t sim_wire_sessions(const struct sim_wire *w);
uint64_t sim_wire_refused(const struct sim_wire *w); /* sessions turned away or ended by a limit */

/* Copies the bytes; they leave at at_ns, all at once (gap_ns 0) or one by one. false: too many, hang up. */
bool sim_wire_say(struct sim_wire_line *line, const uint8_t *bytes, size_t n, int64_t at_ns, int64_t gap_ns);

/* A way out without a wire, for who tests a protocol by itself (free it with free), and its oldest saying: how many of
 * its bytes were copied, 0 when nothing was said. */
struct sim_wire_line *sim_wire_line_create(void);
size_t sim_wire_line_next(struct sim_wire_line *line, uint8_t *out, size_t cap);

/* Is it an address of this machine alone? false also for what is no address. */
bool sim_wire_loopback(const char *address);

#endif
