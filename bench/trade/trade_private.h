/* bench/trade/trade_private.h: what the parts of a trade share: trade.c prepares and judges, play.c plays. */
#ifndef BB_BENCH_TRADE_PRIVATE_H
#define BB_BENCH_TRADE_PRIVATE_H

#include "bench/trade/trade.h"
#include "render/stream/stream.h"
#include "render/volume/steps.h"

#define BB_TRADE_VARIANTS_MOST 16

struct bb_trade_variant { /* the data as bricks of one size and type */
	uint32_t edge;
	enum bb_brick_type type;
	struct bb_bricks *bricks;
};

struct bb_trade {
	struct bb_trade_config config;
	char dir[BB_PATH_MAX_BYTES];
	struct bb_steps *steps; /* NULL: the data is a brick file, variant[0] */
	struct bb_trade_variant variant[BB_TRADE_VARIANTS_MOST];
	size_t n_variants;
	struct bb_placement placement;
	struct bb_stream *full;
	double full_step;                         /* of its last frame */
	unsigned drawn[BB_TRADE_DRAWN_MOST];      /* frames */
	struct bb_image picture[BB_TRADE_DRAWN_MOST]; /* reference */
	struct bb_image image;
	char reference[160];
	struct bb_ratings ratings; /* of the last selector and bricks: many settings share theirs */
	const struct bb_selector *rated_by;
	const struct bb_bricks *rated;
};

/* One frame of a play, its memory the caller's. */
struct bb_trade_frame {
	struct bb_view view;
	double ahead[4];
	struct bb_stream_frame frame;
};
void bb_trade_frame_at(const struct bb_trade *t, unsigned i, double step_voxels, struct bb_trade_frame *out);
void bb_trade_rest(struct bb_trade_frame *f); /* time stands still there */
/* Bricks of that size and type; built when asked for the first time. */
BB_MUST_CHECK enum bb_status bb_trade_bricks(struct bb_trade *t, uint32_t edge, enum bb_brick_type type,
					     const struct bb_bricks **out, struct bb_error *err);
/* Rays and samples of a picture's frame, counted without drawing. */
struct bb_stream_counts bb_trade_count(struct bb_trade *t, unsigned picture, double step_voxels);
void bb_trade_forget_ratings(struct bb_trade *t);

#endif
