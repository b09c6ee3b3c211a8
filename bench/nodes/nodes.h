/*
 * bench/nodes/nodes.h: one run in several processes. The head's process owns devices, tracker and report; the others
 * play the room's nodes, dealt out in the room's order, and draw their walls. `run --nodes N` starts them itself, or
 * mpirun, srun, systemd or a person do, as `blackburst node ROOM SCENE --join ADDRESS --token-file FILE`.
 *
 * No process outlives the head: the kernel ends those it started when it dies, and the others end when it is silent.
 * All must be of one version and one configuration (the hash of everything a run depends on), or are not let in.
 */
#ifndef BB_BENCH_NODES_H
#define BB_BENCH_NODES_H

#include "drivers/link/peers.h"
#include "bench/run.h"

struct bb_nodes;

/* Head: opens the link and starts the others, unless it is told to wait for them. Another process: joins, within 30 s,
 * and sets the clock to the head's time (no timer may be armed). Errors 1670 to 1679. */
BB_MUST_CHECK enum bb_status bb_nodes_open(const struct bb_run_options *o, const struct bb_room *room,
                                           const struct bb_scene *scene, struct bb_clock *clk, const struct bb_log *log,
                                           struct bb_nodes **out, struct bb_error *err);
/* Ends the others (after a while by force) and the link. NULL is allowed. */
void bb_nodes_close(struct bb_nodes *n);
struct bb_link *bb_nodes_link(const struct bb_nodes *n);
uint16_t bb_nodes_process(const struct bb_nodes *n); /* which one this is; 0 is the head's */
uint16_t bb_nodes_count(const struct bb_nodes *n);
const struct bb_link_group *bb_nodes_group(const struct bb_nodes *n); /* until bb_nodes_close */
uint16_t bb_nodes_home(const struct bb_nodes *n, size_t node);

/* Head: looks after the others, every frame or so. True once for each process that is gone, with who and how. */
struct bb_node_loss {
	uint16_t process;
	char what[120]; /* "process 2 (pid 4711) was killed by signal 9" */
};
bool bb_nodes_lost(struct bb_nodes *n, struct bb_node_loss *out);

#endif
