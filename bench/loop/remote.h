/*
 * bench/loop/remote.h: what changes when the room's nodes are played by several processes: the head's process keeps a
 * machine for every node, but those that others play only book what their process tells it; the others run the same
 * machines and tell. All of it over the link, in messages of their own beside those of bench/loop/loop.h.
 */
#ifndef BB_BENCH_REMOTE_H
#define BB_BENCH_REMOTE_H

#include "bench/loop/loop.h"
#include "bench/nodes/nodes.h"

/* Does this process play that node? Always when there is one process only. */
bool bb_remote_plays(const struct bb_frame_loop *l, size_t node);
/* Is this a process that only plays nodes? */
bool bb_remote_only_plays(const struct bb_frame_loop *l);

/* Head: until all processes say that they are ready; error 1679. */
BB_MUST_CHECK enum bb_status bb_remote_gather(struct bb_frame_loop *l, struct bb_error *err);
/* Head: the scene begins at l->scene_start_ns. From here on it looks after the others. */
BB_MUST_CHECK enum bb_status bb_remote_start(struct bb_frame_loop *l);
/* Head: it is over. */
void bb_remote_end(struct bb_frame_loop *l);
/* Head: a frame began that late. */
void bb_remote_woke(struct bb_frame_loop *l, int64_t scheduled_ns, int64_t now_ns);
/* Head, at the end: how late the processes woke, and what this machine's timers can do. */
void bb_remote_tell(struct bb_frame_loop *l);
/* Another process: from ready to the end of the scene or of the head. BB_ERR_LOST (1674) for the latter. */
BB_MUST_CHECK enum bb_status bb_remote_serve(struct bb_frame_loop *l, struct bb_error *err);

/* A message that only several processes exchange: true when it was one. */
bool bb_remote_hear(struct bb_frame_loop *l, const struct bb_link_message *packet, int64_t now_ns);
/* Another process: its node has drawn; was released; has flipped. */
void bb_remote_drew(struct bb_node_machine *n, const struct bb_frame *f);
void bb_remote_released(struct bb_node_machine *n, const struct bb_frame *f);
void bb_remote_flipped(struct bb_node_machine *n, uint16_t screen, const struct bb_flip *flip);

#endif
