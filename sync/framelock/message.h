/*
 * sync/framelock/message.h: what the nodes of a framelock say to each other, as bytes: little endian, of one length per
 * kind. Pure; bytes from a wire are hostile until bb_lock_read took them. Who sent them, and that nobody else did, is
 * the link's affair.
 *
 *   0 'L' 'K'   2 kind   3 round   4 epoch u32   8 frame u64   16 master u16   18 nodes u16   20..31 zero   32 body
 *   body   ping, pong: four i64 times    pong, plan: first frame, its time    join: version, hash    epoch: members
 */
#ifndef BB_SYNC_FRAMELOCK_MESSAGE_H
#define BB_SYNC_FRAMELOCK_MESSAGE_H

#include "sync/framelock/set.h"

#define BB_LOCK_MESSAGE_MAX 104
#define BB_LOCK_HASH 32

enum bb_lock_kind {
	BB_LOCK_ARRIVE = 1, /* drawn, and so is all that arrived through me; round: of a dissemination, or 1: again */
	BB_LOCK_RELEASE,    /* everybody has drawn this frame */
	BB_LOCK_NUDGE,      /* your signal of this round did not come */
	BB_LOCK_ROLL,       /* to who keeps the roll: I have drawn this frame and nothing happens */
	BB_LOCK_EPOCH,      /* who takes part from frame `from` on; frames before `frame` are released */
	BB_LOCK_JOIN,       /* take me in; round 1: not yet, but who is the master? */
	BB_LOCK_REFUSE,     /* no: another version or configuration */
	BB_LOCK_PING,       /* what does your clock show? */
	BB_LOCK_PONG,       /* this, and flips are planned so */
};

struct bb_lock_message {
	enum bb_lock_kind kind;
	uint8_t round;
	uint32_t epoch;
	uint64_t frame;
	uint16_t master, n_nodes;
	union {
		struct {
			int64_t t1_ns, t2_ns, t3_ns; /* request left (its clock), came, answer leaves (the master's) */
			uint64_t plan_frame;         /* flips at plan_ns of the master's clock; PONG only, 0 and 0: no plan */
			int64_t plan_ns;
			int64_t plan_every;          /* refreshes a frame, >= 1 */
		} time;
		struct {
			uint64_t from;
			struct bb_lock_set members;
		} epoch;
		struct {
			uint32_t version;
			uint8_t hash[BB_LOCK_HASH];
		} join;
	} u;
};

/* Returns the number of bytes, at most BB_LOCK_MESSAGE_MAX. */
size_t bb_lock_write(const struct bb_lock_message *m, uint8_t *bytes);
/* False, and nothing written to *m that matters, for what bb_lock_write did not make. */
bool bb_lock_read(const void *bytes, size_t n, struct bb_lock_message *m);

#endif
