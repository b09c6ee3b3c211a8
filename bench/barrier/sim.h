/*
 * bench/barrier/sim.h: a troupe of nodes on the virtual clock: simulated network, a drifting clock each, frames that are
 * drawn and flipped together by sync/framelock. Counts what a flip cost and how far apart the nodes were. Also what the
 * tests break: a node dies, slows down, is cut off. True time is the virtual clock's; vblank k is at k / rate of it
 * (genlocked); a node only knows its own clock. Same configuration, same numbers. One thread.
 */
#ifndef BB_BENCH_BARRIER_SIM_H
#define BB_BENCH_BARRIER_SIM_H

#include "bench/stats.h"
#include "hal/clock.h"
#include "sync/framelock/framelock.h"

struct bb_troupe_config {
	enum bb_lock_method method;
	unsigned n_nodes;
	struct bb_rate rate;
	struct bb_link_config link;     /* delay, jitter, spread, loss, duplicates, send time */
	double drift_ppm;               /* each clock within +- that, and somewhere within a second */
	int64_t zero_ns;                /* clocks begin there */
	double draw_least, draw_most;   /* of a period; a node draws between, evenly */
	unsigned window;                /* exchanges of a clock estimate; 0: default */
	uint64_t seed;
	unsigned settle_frames, frames; /* not counted; counted */
	bool starts_empty;              /* nobody but node 0 is a member: all others join */
	void (*released)(void *ctx, unsigned node, int64_t true_ns, const struct bb_lock_release *r);
	void *ctx;
};

struct bb_spread { /* us */
	double p50, p99, max;
};

struct bb_troupe_result {
	struct bb_spread skew;    /* last minus first release of a frame */
	struct bb_spread cost;    /* last release minus last ready (timed: or the planned time, if later) */
	double frames_lost;       /* vblanks a frame between the last ready and the last flip, beyond the next one */
	double torn;              /* share of frames not flipped at one vblank by all */
	double late;              /* share of frames with a node that had not drawn at its planned time */
	double messages;          /* a frame, sent */
	double resent;
	uint64_t frames;          /* counted: those that some member left out are not; 0: the others above are not numbers */
	uint64_t epochs;
};

struct bb_troupe;

/* 6 nodes, 60 Hz, 100 us + exponential with p99 100 us, 100 ppm, 3 us a send, draws of 0.4 to 0.8 periods. */
struct bb_troupe_config bb_troupe_usual(void);
BB_MUST_CHECK enum bb_status bb_troupe_create(const struct bb_troupe_config *config, struct bb_troupe **out);
void bb_troupe_destroy(struct bb_troupe *w);
/* Until every member has flipped this frame or a later one, at most so long; false: it took longer. */
bool bb_troupe_run(struct bb_troupe *w, uint64_t frame, int64_t most_ns);
void bb_troupe_run_for(struct bb_troupe *w, int64_t ns);
struct bb_troupe_result bb_troupe_result(struct bb_troupe *w);

void bb_troupe_kill(struct bb_troupe *w, unsigned node);             /* neither sends nor hears nor draws */
void bb_troupe_revive(struct bb_troupe *w, unsigned node);           /* starts anew */
void bb_troupe_slow(struct bb_troupe *w, unsigned node, double factor); /* its draws take so many times as long */
void bb_troupe_quality(struct bb_troupe *w, unsigned node, double quality);
int64_t bb_troupe_took_ns(const struct bb_troupe *w, unsigned node); /* its newest draw; of one that goes on: so far */
void bb_troupe_cut(struct bb_troupe *w, unsigned node, unsigned side);  /* nodes of different sides do not hear each other */
void bb_troupe_loss(struct bb_troupe *w, double share);              /* of all messages, beside the link's own */
void bb_troupe_configure(struct bb_troupe *w, unsigned node, uint32_t version, uint8_t hash0); /* of its next start */
void bb_troupe_every(struct bb_troupe *w, unsigned every);           /* timed: refreshes a frame, from the next plan on */
struct bb_framelock *bb_troupe_lock(struct bb_troupe *w, unsigned node);
struct bb_clock *bb_troupe_clock(struct bb_troupe *w);
int64_t bb_troupe_now_ns(const struct bb_troupe *w);
int64_t bb_troupe_local_ns(const struct bb_troupe *w, unsigned node, int64_t true_ns);

#endif
