/*
 * sync/framelock/framelock.h: nodes that flip together. One `struct bb_framelock` is one node's part; they talk through
 * `send` and bb_framelock_hear in messages of sync/framelock/message.h, over a link that may lose, repeat and reorder.
 *
 *   central        everybody tells the master, the master tells everybody: n - 1 sends in a row
 *   tree           up and down a tree: ceil(log2 n) steps each way
 *   dissemination  in round k everybody tells the one 2^k further on: ceil(log2 n) rounds, nobody is special
 *                  (Hensgen, Finkel, Manber 1988; Mellor-Crummey and Scott 1991)
 *   timed          flips at times agreed on beforehand, on the master's clock as sync/exchange.h knows it; nothing is
 *                  waited for. A barrier (central) until all clocks are known and bb_framelock_plan was called.
 *
 * A frame that does not come together is settled by roll call: who waits for longer than `stall_ns` reports to the
 * master; `give_up_ns` after the first has come, the master goes on with those who came: a new epoch, which releases the
 * frame when they are all there. So a dead node stops the others for give_up_ns once, whatever the algorithm. A side
 * without the majority of the epoch (or half of it and the master) freezes instead. A master that is not heard from is
 * replaced by the next in the epoch's order after `master_ns`. A node that comes back asks to join, with version and
 * configuration hash, and takes part from an epoch that begins some frames ahead, so that nobody waits for it.
 *
 * Algorithms only: stepped with now_ns of the node's own clock, which need not agree with anybody's. Allocates at
 * creation only. One thread; `send` and `released` are called from within ready, hear and step and must not call back
 * into the same framelock, except bb_framelock_plan.
 */
#ifndef BB_SYNC_FRAMELOCK_H
#define BB_SYNC_FRAMELOCK_H

#include "hal/link.h"
#include "sync/framelock/message.h"

#define BB_LOCK_VERSION 1
#define BB_LOCK_NOBODY 0xFFFF

enum bb_lock_state {
	BB_LOCK_OUT,     /* not a member: has asked to join, or will */
	BB_LOCK_IN,
	BB_LOCK_FROZEN,  /* the others are elsewhere: hold the image, then black */
	BB_LOCK_REFUSED, /* version or configuration differ */
};

struct bb_lock_release {
	uint64_t frame;           /* flip it; earlier ones that were not released before are gone */
	int64_t at_ns;            /* now, or the planned time that has come: the node's own clock */
	bool skipped;             /* this node had not drawn it: nothing to flip */
	bool timed;               /* at the planned time, whoever is ready */
	bool late;                /* timed: drawn after the planned time */
	struct bb_lock_set missing;  /* at the master: went on without them */
	uint16_t last;            /* at the master: who came last, or is missing; NOBODY: not known */
	int64_t first_ns, last_ns;/* at the master: when the first and last it knows of came */
};

struct bb_lock_config {
	enum bb_lock_method method;
	uint16_t n_nodes, self, master; /* n_nodes at most BB_LOCK_NODES_MAX; the first master */
	struct bb_lock_set members;        /* of epoch 1; self not in it: it has to join */
	struct bb_rate rate;            /* of refreshes: what plans count in */
	int64_t retry_ns;               /* what has had no effect for this long is sent again */
	int64_t stall_ns;               /* waited for so long: report to the master (roll call) */
	int64_t give_up_ns;             /* the master's patience with a frame */
	int64_t master_ns;              /* everybody's with the master; BB_NEVER: nobody else can be it, and it never freezes */
	int64_t ping_ns;                /* timed: between questions for the master's clock */
	unsigned window;                /* timed: exchanges the clock is estimated from; 0: as sync/exchange.h */
	uint32_t version;               /* 0: BB_LOCK_VERSION */
	uint8_t hash[BB_LOCK_HASH];     /* of the configuration all must share */
	void (*send)(void *ctx, uint16_t to, const void *bytes, size_t n);
	void (*released)(void *ctx, const struct bb_lock_release *r);
	void *ctx;
};

struct bb_lock_counts {
	uint64_t sent, resent, heard, bad, foreign; /* bad: no message; foreign: of another epoch or a stranger */
	uint64_t stalls, epochs, joins, refused;
};

struct bb_framelock;

/* Times from the period of a frame, as rooms use them: retry T/8, stall T, give up 2.5 T, master 3 T, ping T. */
void bb_lock_config_times(struct bb_lock_config *c, int64_t frame_ns);
BB_MUST_CHECK enum bb_status bb_framelock_create(const struct bb_lock_config *config, struct bb_framelock **out);
void bb_framelock_destroy(struct bb_framelock *f);

/* The node has drawn this frame. One that was released meanwhile is ignored. */
void bb_framelock_ready(struct bb_framelock *f, uint64_t frame, int64_t now_ns);
void bb_framelock_hear(struct bb_framelock *f, uint16_t from, const void *bytes, size_t n, int64_t now_ns);
/* Does what is due; returns when it wants to be stepped again at the latest. Call it after ready and hear as well. */
int64_t bb_framelock_step(struct bb_framelock *f, int64_t now_ns);
/* Master, timed: from `frame` on flip at_ns + (frame - first) * every / rate. Announced with every answer to a ping: keep
 * `frame` some frames ahead. A new plan replaces the old one from its first frame on. */
void bb_framelock_plan(struct bb_framelock *f, uint64_t frame, int64_t at_ns, unsigned every);
/* Forget where the lock stood, as a program that starts anew. */
void bb_framelock_restart(struct bb_framelock *f);

enum bb_lock_state bb_framelock_state(const struct bb_framelock *f);
uint64_t bb_framelock_frame(const struct bb_framelock *f); /* the next to be released */
/* The frame to draw now: the next to be released, or on a plan the first whose flip has not passed. */
uint64_t bb_framelock_next(const struct bb_framelock *f, int64_t now_ns);
uint32_t bb_framelock_epoch(const struct bb_framelock *f);
uint16_t bb_framelock_master(const struct bb_framelock *f);
const struct bb_lock_set *bb_framelock_members(const struct bb_framelock *f);
struct bb_lock_counts bb_framelock_counts(const struct bb_framelock *f);
/* Timed: is the master's clock known from a full window? The master's own is; *uncertainty_ns may be NULL. */
bool bb_framelock_synchronised(const struct bb_framelock *f, int64_t now_ns, int64_t *uncertainty_ns);
/* Timed: when this frame flips, on this node's clock; BB_NEVER without a plan for it. */
int64_t bb_framelock_flip_ns(const struct bb_framelock *f, uint64_t frame);

#endif
