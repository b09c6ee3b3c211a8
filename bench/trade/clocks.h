/*
 * bench/trade/clocks.h: exchanges per clock estimate against the skew of a timed flip: six nodes follow the head's
 * clock over a modelled network and flip at a time agreed two frames ahead; three ways to make an estimate from the
 * same exchanges. Times in us but where said; the same for the same seed, but for the cost.
 */
#ifndef BB_BENCH_TRADE_CLOCKS_H
#define BB_BENCH_TRADE_CLOCKS_H

#include <stdio.h>

#include <jansson.h>

#include "hal/status.h"

#define BB_CLOCKS_WINDOWS 8 /* 4, 8, .. 512 */

enum bb_clocks_way { BB_CLOCKS_MEAN, BB_CLOCKS_LEAST, BB_CLOCKS_LINE, BB_CLOCKS_WAYS };

struct bb_clocks_point {
	unsigned window; /* exchanges */
	double fill_s;   /* until the window is full, an exchange a frame */
	double p50_us[BB_CLOCKS_WAYS], p99_us[BB_CLOCKS_WAYS],
		max_us[BB_CLOCKS_WAYS]; /* skew of the flip, head included */
	double stated_us;               /* of the line: mean uncertainty that a node states, and */
	double inside;                  /* how often its error is within it */
	double add_ns;                  /* what an exchange costs the line, on this machine */
};

struct bb_clocks {
	uint64_t seed;
	unsigned n_nodes, n_runs, n_flips; /* flips of each run that count */
	double delay_us, p99_us, rate_ppm, frame_hz;
	struct bb_clocks_point point[BB_CLOCKS_WINDOWS];
};

void bb_clocks_measure(uint64_t seed, struct bb_clocks *out);
void bb_clocks_print(const struct bb_clocks *c, FILE *f);
json_t *bb_clocks_json(const struct bb_clocks *c);
BB_MUST_CHECK enum bb_status bb_clocks_plot(const struct bb_clocks *c, const char *path, struct bb_error *err);

#endif
