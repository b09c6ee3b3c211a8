/*
 * bench/loop/follow.h: a process on another machine keeps its clock on the head's axis for as long as a run lasts: it asks the
 * head for the time again and again (sync/exchange.h), and a servo (sync/servo.h) steers the clock of hal/clock.h, without
 * steps. On the head's own machine both read one oscillator and nobody asks.
 */
#ifndef BB_BENCH_LOOP_FOLLOW_H
#define BB_BENCH_LOOP_FOLLOW_H

#include "bench/loop/loop.h"

struct bb_follow;

/* NULL for a run of one process. */
BB_MUST_CHECK enum bb_status bb_follow_create(struct bb_frame_loop *l, struct bb_follow **out);
void bb_follow_destroy(struct bb_follow *f);
/* Not the head: asks from now on, where the head is on another machine or this process's crystal is planted wrong. */
BB_MUST_CHECK enum bb_status bb_follow_begin(struct bb_follow *f);
/* True when the packet was of the clocks. */
bool bb_follow_hear(struct bb_follow *f, const struct bb_link_message *packet, int64_t now_ns);
/* Head, at the end: a fact a process. */
void bb_follow_tell(const struct bb_follow *f, struct bb_run_result *result);

#endif
