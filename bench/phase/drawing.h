/*
 * bench/phase/drawing.h: one stereo cycle on one page, all tracks under one time axis: scan-out row by row, external
 * shutters, lenses, tokens, strobes, and when each row band shows one eye alone; and the curve of crosstalk against light.
 */
#ifndef BB_BENCH_PHASE_DRAWING_H
#define BB_BENCH_PHASE_DRAWING_H

#include "bench/phase/edges.h"
#include "bench/phase/tell.h"

/* To .svg or .png by the file's name; measured NULL: the plan alone. 1001, 1850, 1901. */
BB_MUST_CHECK enum bb_status bb_phase_draw(const struct bb_room *room, const struct bb_plan *plan,
                                           const struct bb_phase_edges *measured, const char *file,
                                           struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_phase_draw_trade(const struct bb_room *room, const struct bb_phase_trade *trade,
                                                 const char *file, struct bb_error *err);

#endif
