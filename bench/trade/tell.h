/*
 * bench/trade/tell.h: the points of a trade for people and programs: a table, JSON, CSV, and plots (SVG or PNG) of quality
 * against frame time and against bytes streamed with both fronts marked.
 */
#ifndef BB_BENCH_TRADE_TELL_H
#define BB_BENCH_TRADE_TELL_H

#include <jansson.h>

#include "bench/trade/trade.h"

struct bb_trade_told {
	struct bb_trade_point *point;
	size_t n;
	const char *name;      /* of the scene or the data */
	const char *reference; /* what pictures were compared with */
	const char *data;      /* "87 x 87 x 87 voxels, 5 steps" */
	uint32_t width_px, height_px;
	unsigned n_frames, n_drawn;
	bool full;             /* all combinations: names say everything */
	double frame_ms, psnr_db, ssim; /* the questions; NAN: not asked */
};

/* Marks both fronts: PSNR against frame time, PSNR against bytes streamed a frame. */
void bb_trade_mark(struct bb_trade_point *p, size_t n);

struct bb_trade_answer {
	bool asked;
	size_t point; /* SIZE_MAX: none does */
};
struct bb_trade_answers {
	struct bb_trade_answer within_ms;             /* the best PSNR within a frame time */
	struct bb_trade_answer psnr_ms, psnr_bytes;   /* the least frame time, the fewest bytes that reach a PSNR */
	struct bb_trade_answer ssim_ms, ssim_bytes;
};
struct bb_trade_answers bb_trade_ask(const struct bb_trade_told *t);
bool bb_trade_answered(const struct bb_trade_answers *a); /* was there a setting for each question? */

void bb_trade_print(const struct bb_trade_told *t, FILE *out);
json_t *bb_trade_json(const struct bb_trade_told *t);
/* 1901. */
BB_MUST_CHECK enum bb_status bb_trade_csv(const struct bb_trade_told *t, const char *path, struct bb_error *err);
/* 1001, 1850, 1901. */
BB_MUST_CHECK enum bb_status bb_trade_plot(const struct bb_trade_told *t, const char *path, struct bb_error *err);

#endif
