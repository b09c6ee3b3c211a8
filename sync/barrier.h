/*
 * sync/barrier.h: the software swap barrier, head side: every node arrives with its frame, all are released together,
 * and a time-out names who was late. A node that misses `drop_after` barriers in a row is no longer waited for until it
 * arrives again (row N1). Algorithm only: stepped with now_ns, no clock, no link, no allocation. One thread.
 */
#ifndef BB_SYNC_BARRIER_H
#define BB_SYNC_BARRIER_H

#include "hal/base.h"

#define BB_BARRIER_NODES_MAX 64

struct bb_barrier {
	unsigned n_nodes;
	int64_t timeout_ns;       /* from open to giving up on a node */
	unsigned drop_after;      /* misses in a row */
	bool open;
	uint64_t frame;
	int64_t opened_ns, deadline_ns;
	uint64_t waited, arrived; /* bit per node: waited for in this frame; has arrived */
	uint64_t dropped;         /* bit per node: given up */
	unsigned misses[BB_BARRIER_NODES_MAX];
	int64_t arrived_ns[BB_BARRIER_NODES_MAX];
};

struct bb_release {
	uint64_t frame;
	uint64_t missing;         /* bit per node that was waited for and did not come */
	unsigned last;            /* the node that came last (or a missing one): who cost the others their time */
	int64_t last_ns, first_ns;
};

void bb_barrier_init(struct bb_barrier *b, unsigned n_nodes, int64_t timeout_ns, unsigned drop_after);
/* Wait for the nodes of `nodes` (bits) at this frame. */
void bb_barrier_open(struct bb_barrier *b, uint64_t frame, uint64_t nodes, int64_t now_ns);
/* An arrival for another frame than the open one is ignored, but a dropped node that talks again is taken back. */
void bb_barrier_arrive(struct bb_barrier *b, unsigned node, uint64_t frame, int64_t now_ns);
/* A node that is known to be gone is waited for no longer, until it arrives again. */
void bb_barrier_drop(struct bb_barrier *b, unsigned node);
/* True once per barrier: all are there, or the deadline passed. */
bool bb_barrier_step(struct bb_barrier *b, int64_t now_ns, struct bb_release *out);

#endif
