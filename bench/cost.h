/*
 * bench/cost.h: what drawing costs on the virtual clock: a model over counters that need no pixels. The coefficients
 * are a node's profile file, whose hash is an input of the run.
 */
#ifndef BB_BENCH_COST_H
#define BB_BENCH_COST_H

#include "hal/profile.h"
#include "render/stream/stream.h"

/* Selecting and uploading a frame's bricks, ns. */
int64_t bb_cost_select_ns(const struct bb_profile *p, const struct bb_stream_counts *c);
/* Drawing n_views views with those counters, ns. */
int64_t bb_cost_draw_ns(const struct bb_profile *p, const struct bb_stream_counts *c, size_t n_views);

#endif
