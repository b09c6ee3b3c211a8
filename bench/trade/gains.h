/*
 * bench/trade/gains.h: chapter 5 of Carlsson and Tjernstroem 2016 on generated data: PSNR, SSIM and frame time of the three
 * split gains and of a uniform level against the memory budget and the streaming budget (figure 5.1), of the leaf error
 * against both (figure 5.3) and at their four points (table 5.2). As there, bricks are chosen by their algorithm 1 for the
 * sixth time step, after the five before it, and read when it is drawn; nothing is weighted by what a view sees. Beside
 * their leaf error there is ours, far error, which does not stop where children are no better than their parent (gain.h).
 */
#ifndef BB_BENCH_TRADE_GAINS_H
#define BB_BENCH_TRADE_GAINS_H

#include <jansson.h>

#include "bench/trade/trade.h"

#define BB_GAINS_BUDGETS_MOST 24
#define BB_GAINS_STEP 5

enum bb_gains_selector { BB_GAINS_LEAF, BB_GAINS_FAR, BB_GAINS_OPACITY, BB_GAINS_CHILD, BB_GAINS_UNIFORM, BB_GAINS_SELECTORS };
const char *bb_gains_selector_text(enum bb_gains_selector s);

struct bb_gains_set {
	const char *name, *kind, *tf;
	uint32_t dim[3], n_steps;
	double within_x; /* where along x something is to be seen from inside at that step: parts of the edge from the middle */
	bool usual; /* of those that are measured when none is named */
};
extern const struct bb_gains_set bb_gains_sets[]; /* ends with name NULL */

struct bb_gains_value {
	double psnr_db, ssim, cpu_ms, bricks; /* processor time of choosing, reading and drawing; bricks: read for a step, mean of the last five */
};

struct bb_gains { /* of one camera */
	uint32_t leaves; /* bricks of the finest level: the largest budget */
	size_t n;
	uint32_t budget[BB_GAINS_BUDGETS_MOST];
	struct bb_gains_value memory[BB_GAINS_SELECTORS][BB_GAINS_BUDGETS_MOST]; /* no streaming budget */
	struct bb_gains_value stream[BB_GAINS_SELECTORS][BB_GAINS_BUDGETS_MOST]; /* memory for all leaves */
	size_t n_both; /* every second budget */
	uint32_t both_budget[BB_GAINS_BUDGETS_MOST];
	struct bb_gains_value both[BB_GAINS_BUDGETS_MOST][BB_GAINS_BUDGETS_MOST]; /* [memory][stream], leaf error */
	struct bb_gains_value point[4]; /* of table 5.2, budgets by their share of the leaves */
	uint32_t point_memory[4], point_stream[4];
};

/* The leaf error against another gain at middle budgets, a 256th to a quarter of the leaves. */
struct bb_gains_duel {
	unsigned n, won, lost; /* by more than 0.05 dB */
	double mean_db, least_db, most_db;
};
struct bb_gains_duel bb_gains_duel(const struct bb_gains *g, bool stream, enum bb_gains_selector other);

typedef void (*bb_gains_progress)(void *ctx, size_t done, size_t of);
/* trade: made for steps that are frames (60 Hz, seconds_per_step 1/60, BB_GAINS_STEP + 1 frames, one picture). */
BB_MUST_CHECK enum bb_status bb_gains_measure(struct bb_trade *trade, uint32_t brick, enum bb_brick_type type,
					      bb_gains_progress progress, void *ctx, struct bb_gains *out,
					      struct bb_error *err);
json_t *bb_gains_json(const struct bb_gains *g);
void bb_gains_print(const struct bb_gains *g, FILE *out); /* Markdown */
/* title: of the page. 1001, 1850, 1901. */
BB_MUST_CHECK enum bb_status bb_gains_plot(const struct bb_gains *g, const char *title, const char *path,
					   struct bb_error *err);

#endif
