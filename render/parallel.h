/*
 * render/parallel.h: independent pieces of work on a few threads. Pieces are handed out in order; which thread takes
 * which is not fixed, so a piece must not depend on another.
 */
#ifndef BB_RENDER_PARALLEL_H
#define BB_RENDER_PARALLEL_H

#include "hal/base.h"

#define BB_PARALLEL_MOST 64

/* each(ctx, i, thread) for i = 0 .. n - 1; thread < threads. Returns when all are done. Where threads cannot be had,
 * the caller's own does the work. */
void bb_parallel(unsigned threads, size_t n, void (*each)(void *ctx, size_t i, unsigned thread), void *ctx);

/* As many as this machine has processors, at most BB_PARALLEL_MOST. */
unsigned bb_parallel_processors(void);

#endif
