/*
 * bench/trade/trade.h: one scene played under many settings, and what each gave and took: quality against a picture of
 * all leaf bricks, frame time, bytes streamed, memory held.
 *
 * A play: n_frames at 60 Hz of the scene's own time, one eye on the head path, one wall. It begins settled, as a run does
 * after bring-up. Some of the frames are drawn and compared. Bricks come by the model of a disk, or are there in the next
 * frame; the clock is the play's own, so all that is counted is the same on every machine. Only times are measured.
 */
#ifndef BB_BENCH_TRADE_H
#define BB_BENCH_TRADE_H

#include "hal/scene.h"
#include "render/bricks/selector.h"
#include "render/image_metrics.h"
#include "render/renderer.h"

#define BB_TRADE_RATE_HZ 60
#define BB_TRADE_DRAWN_MOST 16
#define BB_TRADE_TIMED_MOST 8 /* frames timed before each picture */

enum bb_trade_knob { BB_KNOB_MEMORY, BB_KNOB_STREAM, BB_KNOB_SELECTOR, BB_KNOB_TOLERANCE, BB_KNOB_STEP, BB_KNOB_BRICK,
                     BB_KNOB_TYPE, BB_KNOBS, BB_KNOB_NONE = BB_KNOBS };
const char *bb_trade_knob_text(enum bb_trade_knob knob); /* "scene" of NONE: the scene's own setting */

struct bb_trade_setting {
	double memory_mib;                  /* 0: all */
	uint32_t memory_bricks;             /* of choices read at once: at most so many a step, instead; 0: by memory_mib */
	uint32_t bricks_per_frame;          /* 0: no limit */
	const struct bb_selector *selector; /* opacity, leaf, child and far stream; others are read at once and complete, */
	bool at_once;                       /* and so are these when it is said */
	double tolerance;                   /* of selectors by tolerance, for space and for time */
	double step_voxels;
	uint32_t brick;
	enum bb_brick_type type;
};
/* "leaf, 4 MiB, 8 bricks a frame, step 1, 16^3 u16" */
const char *bb_trade_setting_text(const struct bb_trade_setting *s, char *out, size_t cap);

struct bb_trade_point {
	struct bb_trade_setting setting;
	enum bb_trade_knob knob; /* what differs from the scene's own */
	bool failed;             /* not playable (the budget is too small, the tree too large); why says it */
	char why[200];
	/* quality over all pictures: PSNR of all their covered pixels, SSIM and distance as means */
	double psnr_db, psnr_least_db, ssim, luv;
	/* counted */
	uint64_t rays, samples;         /* geometric, of one frame, mean over the pictures */
	double bytes_mean, bytes_most;  /* streamed, of a frame */
	double bricks_mean, bricks_most;
	double missing_share;           /* of the bricks drawn, those an ancestor stood in for; 0 when nothing streams */
	uint64_t memory_bytes, atlas_bricks;
	/* measured, ms: medians; spread from the 10th to the 90th percentile */
	double draw_ms, draw_low_ms, draw_high_ms, stream_ms, frame_ms;
	double cpu_ms; /* of a frame, all threads: what stays the same on a busy machine */
	bool on_time_front, on_bytes_front;
};

struct bb_trade_config {
	const struct bb_scene *scene;
	const char *generate; /* instead of the scene's own data, with dim, steps and seed; NULL: none */
	uint32_t dim[3], n_steps, seed;
	const struct bb_transfer *transfer;
	struct bb_path *head;           /* NULL: the eye stands at `eye` */
	struct bb_vec3 eye;
	bool inside;                    /* the eye inside the volume, whatever the path says: */
	struct bb_vec3 within;          /* parts of the edges from its middle */
	uint32_t width_px, height_px;
	unsigned n_frames, n_drawn, n_timed;
	bool settled; /* pictures are drawn when all that was selected has been read, at rest: what a selection is worth */
	double disk_read_ns, disk_byte_ns; /* both 0: there in the next frame */
	double reference_step;
	uint32_t reference_brick; /* 0: 32. Data that can be rebuilt is f32 for the reference */
	struct bb_renderer *renderer;   /* borrowed */
	struct bb_clock *clk;           /* borrowed; for times only */
};

struct bb_trade;
/* Builds what the pictures are judged by, and draws those. 10xx, 13xx, 14xx, 1702. All of config is borrowed. */
BB_MUST_CHECK enum bb_status bb_trade_create(const struct bb_trade_config *config, struct bb_trade **out,
					     struct bb_error *err);
void bb_trade_destroy(struct bb_trade *t); /* NULL is allowed */
/* Other pictures: the eye inside, or not. */
BB_MUST_CHECK enum bb_status bb_trade_turn(struct bb_trade *t, bool inside, struct bb_error *err);
/* Can brick sizes and value types be chosen? Not when the scene's data is a brick file. */
bool bb_trade_rebuilds(const struct bb_trade *t);
/* The brick size and type there are, of the scene's own setting. */
struct bb_trade_setting bb_trade_own(const struct bb_trade *t);
const struct bb_bricks_header *bb_trade_header(const struct bb_trade *t);
/* "all leaf bricks of 32^3 f32 at steps of 0.5 voxels, by cpu avx2" */
const char *bb_trade_reference(const struct bb_trade *t);
/* Plays one. A setting that cannot be played is a point that says so, not an error. */
BB_MUST_CHECK enum bb_status bb_trade_play(struct bb_trade *t, const struct bb_trade_setting *s,
					   struct bb_trade_point *out, struct bb_error *err);

#endif
