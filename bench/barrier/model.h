/*
 * bench/barrier/model.h: what arithmetic says about flips that wait for messages of delay d + exponential of mean j, each of
 * which keeps its sender busy for s. Pure; us.
 *
 *   central        the root releases itself, then node i after i sends: skew = max (i s + d + exp)
 *   tree           a node at depth h hears after h messages: skew = max (sends on the way + h d + Erlang_h)
 *   dissemination  the last to draw needs no message; who is m ranks on hears through popcount(m) of them
 *   timed          the end of a window of N exchanges: each direction's least delay is off by an exponential of mean j / N
 *
 * The maxima are taken as if the nodes' delays were independent, which in a tree they are not quite.
 */
#ifndef BB_BENCH_BARRIER_MODEL_H
#define BB_BENCH_BARRIER_MODEL_H

#include "hal/link.h"

struct bb_barrier_network {
	double delay_us, jitter_us, send_us;
	unsigned window;
};

/* The skew that the share p of all frames stays below. */
double bb_barrier_skew_us(enum bb_lock_method method, const struct bb_barrier_network *net, unsigned n, double p);
/* From the last node's drawing to the last node's release, in the middle. */
double bb_barrier_cost_us(enum bb_lock_method method, const struct bb_barrier_network *net, unsigned n);
/* Sent in a frame in which nothing is lost; timed: a word to the master, and a question with its answer. */
double bb_barrier_messages(enum bb_lock_method method, unsigned n);

#endif
