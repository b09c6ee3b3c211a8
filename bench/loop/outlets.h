/*
 * bench/loop/outlets.h: where a run's tracking goes besides its own pictures: into a recording (bench/track_record/) and
 * to programs of other people (drivers/mocap/). Without either nothing here costs anything.
 */
#ifndef BB_BENCH_OUTLETS_H
#define BB_BENCH_OUTLETS_H

#include "bench/loop/loop.h"

/* As the run's options say. 1760, 1761, 1766, 1901. */
BB_MUST_CHECK enum bb_status bb_outlets_open(struct bb_frame_loop *l, struct bb_error *err);
/* A turn of the loop: l->reads[0..n_reads) went to the tracker in this order, and these are the glasses' solutions. */
void bb_outlets_turn(struct bb_frame_loop *l, size_t n_reads, const struct bb_track_solution *solutions, size_t n,
                     int64_t now_ns);
/* The recording is whole: give it its name. */
BB_MUST_CHECK enum bb_status bb_outlets_commit(struct bb_frame_loop *l, struct bb_error *err);
void bb_outlets_close(struct bb_frame_loop *l); /* a recording that was not committed is gone */

#endif
