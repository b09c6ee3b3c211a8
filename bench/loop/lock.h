/*
 * bench/loop/lock.h: the swap barrier of a room that asks for another than the central one (`framelock: {barrier: ...}`): one
 * sync/framelock per drawing node and one for the head, speaking over the link beside the loop's own messages. All nodes
 * of one process. Without it (l->lock is NULL) the head keeps sync/barrier.h.
 */
#ifndef BB_BENCH_LOCK_H
#define BB_BENCH_LOCK_H

#include "bench/loop/loop.h"

/* l->lock stays NULL where the room wants the central barrier; 1662, 1702. */
BB_MUST_CHECK enum bb_status bb_lock_create(struct bb_frame_loop *l, struct bb_error *err);
void bb_lock_destroy(struct bb_frame_loop *l);
/* The head has begun a frame (and has drawn it already, when it has nothing to draw). */
void bb_lock_begun(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns);
/* A node has drawn. */
void bb_lock_ready(struct bb_frame_loop *l, unsigned node, uint64_t frame, int64_t now_ns);
/* A packet for a node: true when it was the lock's. */
bool bb_lock_hear(struct bb_frame_loop *l, unsigned node, const struct bb_link_message *packet, int64_t now_ns);

/* At the end, whatever the barrier: are the genlocked displays locked? A fact of the result. */
void bb_lock_prove(struct bb_frame_loop *l);

#endif
