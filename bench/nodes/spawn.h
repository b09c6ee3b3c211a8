/*
 * bench/nodes/spawn.h: processes of this very program, started to play nodes. The kernel kills them when their parent
 * dies. Posix only; one thread.
 */
#ifndef BB_BENCH_SPAWN_H
#define BB_BENCH_SPAWN_H

#include "hal/clock.h"

#define BB_TOKEN_MAX 128

struct bb_child {
	int pid;      /* 0: none */
	int last_pid; /* of the one that ended */
};

/* argv ends with NULL; secret is what the child reads from its standard input. */
BB_MUST_CHECK bool bb_child_start(struct bb_child *child, const char *const *argv, const char *secret);
/* True once, when it has ended: how, "was killed by signal 9" or "ended with code 3". Does not wait. */
bool bb_child_ended(struct bb_child *child, char *how, size_t cap);
/* Waits until end_ns of the stopwatch for it to end by itself, then ends it. */
void bb_child_end(struct bb_child *child, struct bb_clock *clk, int64_t end_stopwatch_ns);

/* A secret of 32 hexadecimal digits or more, from a file that is its owner's alone (mode 0600) or, "-", standard input.
 * Error 1671. */
BB_MUST_CHECK enum bb_status bb_token_read(const char *path, char token[BB_TOKEN_MAX], struct bb_error *err);

#endif
