/*
 * sync/framelock/straggler.h: who is too slow, and what is done about it: first the slow node alone draws coarser, then, when
 * it can draw no coarser, everybody flips every k-th refresh. Both are taken back after RECOVER frames that would have fitted.
 * Fed once a frame with what each node took; decides by frames, knows no time. No allocation. One thread.
 */
#ifndef BB_SYNC_FRAMELOCK_STRAGGLER_H
#define BB_SYNC_FRAMELOCK_STRAGGLER_H

#include "sync/framelock/set.h"

#define BB_STRAGGLER_LATE 3          /* late frames of the last FRAMES make a straggler */
#define BB_STRAGGLER_FRAMES 4
#define BB_STRAGGLER_RECOVER 60
#define BB_STRAGGLER_QUALITY_LEAST 0.25
#define BB_STRAGGLER_EVERY_MOST 4

struct bb_straggler_node {
	double quality;              /* 1: all; the share of the work that is to be done */
	int64_t took_ns[BB_STRAGGLER_FRAMES]; /* newest last */
	unsigned n, wait;            /* of those; frames until a new quality shows */
	unsigned good;               /* frames in a row that would have fitted a little more */
	int64_t most_ns;             /* of those */
	double was_quality;          /* before the last time it was lowered, and what a frame took then; 0: never */
	int64_t was_ns;
};

struct bb_straggler {
	unsigned n_nodes, every;     /* refreshes a frame */
	int64_t refresh_ns;
	unsigned good;               /* frames in a row in which everybody would have fitted one refresh less */
	struct bb_straggler_node node[BB_LOCK_NODES_MAX];
};

enum bb_straggler_change { BB_STRAGGLER_NONE, BB_STRAGGLER_LOWER, BB_STRAGGLER_RAISE, BB_STRAGGLER_SLOWER, BB_STRAGGLER_FASTER };

struct bb_straggler_verdict {
	enum bb_straggler_change change; /* the last one of this frame; SLOWER and FASTER are everybody's */
	unsigned node;                   /* whose, or because of whom */
};

void bb_straggler_init(struct bb_straggler *s, unsigned n_nodes, int64_t refresh_ns);
/* From the frame's begin to drawn; negative values and those of strangers are ignored. */
void bb_straggler_note(struct bb_straggler *s, unsigned node, int64_t took_ns);
/* Once a frame, after its notes. */
struct bb_straggler_verdict bb_straggler_decide(struct bb_straggler *s);

#endif
