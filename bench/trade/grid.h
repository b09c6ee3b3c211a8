/*
 * bench/trade/grid.h: which settings to play: the scene's own and what differs from it in one thing, or all combinations.
 */
#ifndef BB_BENCH_TRADE_GRID_H
#define BB_BENCH_TRADE_GRID_H

#include "bench/trade/trade.h"

#define BB_GRID_VALUES_MOST 16
#define BB_GRID_POINTS_MOST 20000

struct bb_trade_grid { /* values of each knob; those of the own setting may be among them */
	struct bb_trade_setting own;
	double memory_mib[BB_GRID_VALUES_MOST], step[BB_GRID_VALUES_MOST], tolerance[BB_GRID_VALUES_MOST];
	uint32_t stream[BB_GRID_VALUES_MOST], brick[BB_GRID_VALUES_MOST];
	enum bb_brick_type type[BB_GRID_VALUES_MOST];
	const struct bb_selector *selector[BB_GRID_VALUES_MOST];
	bool at_once[BB_GRID_VALUES_MOST]; /* "leaf!" */
	size_t n[BB_KNOBS];
};

/* Halves and doubles of the scene's budgets, every gain, a uniform level and a tolerance, steps, brick sizes and types.
 * rebuilds: sizes and types can be chosen. complete_mib: what both steps on show take at full resolution. */
void bb_trade_grid_usual(struct bb_trade_grid *g, const struct bb_trade_setting *own, bool rebuilds, double complete_mib);
/* "1,2,all" in place of a knob's values: numbers ("all": no budget), selectors, types. 1481: a word that is none, or out
 * of range. */
BB_MUST_CHECK enum bb_status bb_trade_grid_read(struct bb_trade_grid *g, enum bb_trade_knob knob, const char *text,
						struct bb_error *err);
struct bb_trade_item {
	struct bb_trade_setting setting;
	enum bb_trade_knob knob;
};
/* The own setting first, no setting twice. The caller frees *out. 1481: more than BB_GRID_POINTS_MOST; 1702. */
BB_MUST_CHECK enum bb_status bb_trade_grid_make(const struct bb_trade_grid *g, bool full, struct bb_trade_item **out,
						size_t *n, struct bb_error *err);

#endif
