/* sync/framelock/framelock_impl.h: the inside of struct bb_framelock, for sync/framelock/ only. One thread. */
#ifndef BB_SYNC_FRAMELOCK_IMPL_H
#define BB_SYNC_FRAMELOCK_IMPL_H

#include "sync/exchange.h"
#include "sync/framelock/framelock.h"

#define LOCK_SIGNALS 16 /* rounds of 512 nodes, children of a tree's node */
#define LOCK_PLANS 2
#define LOCK_RADIX 2u
#define LOCK_JOIN_AHEAD 3u /* frames from a new member's epoch being told to its first frame */

struct lock_plan {
	uint64_t frame; /* the first */
	int64_t at_ns;  /* the master's clock */
	int64_t every;  /* refreshes; 0: no plan */
};

struct bb_lock_ops { /* what an algorithm does; frame is f->frame, members and rank are those of the epoch */
	void (*arrive)(struct bb_framelock *f, int64_t now_ns);   /* this node is ready, or the epoch began anew */
	void (*hear)(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns); /* ARRIVE, NUDGE */
	void (*retry)(struct bb_framelock *f);                    /* ready for retry_ns, and still here */
	void (*passed)(struct bb_framelock *f);                   /* tell who waits for me that the frame is released */
};
extern const struct bb_lock_ops bb_lock_central, bb_lock_tree, bb_lock_dissemination;

struct bb_framelock {
	struct bb_lock_config c;
	const struct bb_lock_ops *ops;
	struct bb_lock_counts counts;
	enum bb_lock_state state;

	uint32_t epoch;
	uint16_t master;
	struct bb_lock_set members;
	uint16_t *order, n_members; /* members by rank, the master first, then by index */
	uint16_t rank;
	struct { /* an epoch that begins later */
		bool any;
		uint32_t epoch;
		uint16_t master;
		uint64_t from;
		struct bb_lock_set members;
	} next;
	struct bb_lock_set wanted;  /* master: have asked to join */
	struct bb_lock_set missing; /* master: dropped since the last release */
	uint64_t epoch_from;

	uint64_t frame;             /* the next to be released */
	bool ready;                 /* this node has drawn it */
	uint64_t drawn;             /* newest frame + 1 that it has drawn, whether anybody asked or not */
	int64_t ready_ns, sent_ns, rolled_ns;
	unsigned round;             /* dissemination: signals waited for */
	uint64_t signal[LOCK_SIGNALS]; /* newest frame + 1 signalled: by round, or by child */
	bool told;                  /* tree: the parent has been told */

	uint64_t *came;             /* by node: newest frame + 1 it has drawn, as far as this node heard */
	int64_t *came_ns;
	unsigned n_came;            /* members with came > frame; kept by who keeps the roll */
	int64_t opened_ns;          /* the first of them came; BB_NEVER: none yet */
	unsigned attempt;           /* how many masters have been given up in vain */
	int64_t master_ns;          /* when the present one will be */
	int64_t join_ns, beacon_ns; /* when to ask, to tell again */
	uint16_t join_to;

	struct lock_plan plan[LOCK_PLANS]; /* timed: newest last */
	struct bb_clockfit *fit;    /* timed, and not the master: its clock */
	int64_t ping_ns;            /* next question */
};

/* framelock.c */
void lock_send(struct bb_framelock *f, uint16_t to, enum bb_lock_kind kind, uint64_t frame, unsigned round);
void lock_send_message(struct bb_framelock *f, uint16_t to, struct bb_lock_message *m);
void lock_release(struct bb_framelock *f, uint64_t frame, int64_t now_ns);
/* The same, but nobody else is told, and the epoch stays. */
void lock_move_on(struct bb_framelock *f, uint64_t frame, int64_t now_ns, const struct bb_lock_set *missing);
void lock_begin_epoch(struct bb_framelock *f, int64_t now_ns); /* after members, master or frame changed */
void lock_note(struct bb_framelock *f, uint16_t node, uint64_t frame, int64_t now_ns); /* node has drawn frame */
void lock_recount(struct bb_framelock *f);
bool lock_waits(const struct bb_framelock *f); /* for others: a member, ready, and not on a plan */

/* epoch.c: roll call, drops, joins, another master */
uint16_t lock_roll_master(const struct bb_framelock *f);
void lock_roll_step(struct bb_framelock *f, int64_t now_ns);
int64_t lock_roll_wake(const struct bb_framelock *f);
void lock_send_epoch(struct bb_framelock *f, uint16_t to);
void lock_hear_epoch(struct bb_framelock *f, const struct bb_lock_message *m, int64_t now_ns);
void lock_hear_join(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns);
void lock_hear_refuse(struct bb_framelock *f, const struct bb_lock_message *m);
void lock_admit(struct bb_framelock *f);     /* master, between two frames: those who asked */
void lock_epoch_due(struct bb_framelock *f, int64_t now_ns); /* between two frames: the next epoch begins */
/* Goes on as master with the members of `with` from `from` on, where they are the majority; freezes otherwise. */
void lock_go_on(struct bb_framelock *f, const struct bb_lock_set *with, uint64_t from, int64_t now_ns);

/* timed.c */
bool lock_planned(const struct bb_framelock *f, uint64_t frame);
void lock_time_hear(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns);
void lock_time_step(struct bb_framelock *f, int64_t now_ns);
int64_t lock_time_wake(const struct bb_framelock *f);

#endif
