/* bench/volume/rank.h: do two ratings put things into the same order? */
#ifndef BB_BENCH_VOLUME_RANK_H
#define BB_BENCH_VOLUME_RANK_H

#include "hal/status.h"

/* Spearman's correlation of ranks, equal values sharing theirs; 1 when both have one value only, 0 when one has. */
BB_MUST_CHECK enum bb_status bb_rank_correlation(const float *a, const float *b, size_t n, double *out,
						 struct bb_error *err);

#endif
