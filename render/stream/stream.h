/*
 * render/stream/stream.h: bricks of 16^3 voxels under a memory and a streaming budget.
 *
 * Each time step is cut into a grid of bricks (the last ones reach past the volume and are clamped). A brick lives in
 * the atlas with a border of true neighbours, 18^3 u16. A coarse copy of the whole volume (every 4th voxel, averaged)
 * is always resident and is what a brick that is not resident is drawn from. Per frame: want = bricks whose values can
 * be seen through the transfer function and that meet a view's frustum, for the step(s) on show, nearest first; when
 * more are wanted than fit, the nearest n_slots of them are kept (a resident one counts as an eighth nearer); then
 * prefetch for the next step; load at most `bricks_per_frame`, evicting least recently used ones that are not kept.
 * Pure function of (frames so far, views, time): the same counters on every machine. One thread, but see stream/io.h.
 */
#ifndef BB_RENDER_STREAM_STREAM_H
#define BB_RENDER_STREAM_STREAM_H

#include "render/transfer.h"
#include "render/view.h"
#include "render/volume/volume.h"

#define BB_BRICK_EDGE 16
#define BB_BRICK_STORED 18 /* edge + a voxel of border on either side */
#define BB_BRICK_BYTES (BB_BRICK_STORED * BB_BRICK_STORED * BB_BRICK_STORED * 2)
#define BB_COARSE_FACTOR 4

/* Where the volume stands in the room. Its faces lie half a voxel outside the outermost voxel centres: a point p of
 * volume space is voxel coordinate (p / size + 0.5) * dim - 0.5 on each axis. */
struct bb_placement {
	struct bb_pose pose;          /* volume space (metres, centred) to room */
	struct bb_vec3 size_m;        /* edge lengths in the room */
};

struct bb_stream_config {
	const struct bb_volume *volume;     /* borrowed */
	const struct bb_transfer *transfer; /* borrowed */
	struct bb_placement placement;
	uint64_t memory_bytes;        /* atlas slots = memory_bytes / BB_BRICK_BYTES; 0: every brick resident from the start */
	uint32_t bricks_per_frame;    /* 0: no limit */
};

struct bb_stream_counts {         /* of one frame */
	uint32_t wanted, resident, missing; /* bricks on show; of them in the atlas; drawn coarse instead */
	uint32_t loaded, evicted, prefetched; /* asked for in this frame, the prefetched ones included; of them prefetched */
	uint64_t bytes;               /* loaded * BB_BRICK_BYTES */
	uint64_t rays, samples;       /* geometric: rays that meet the volume's box, and their length / step, all views;
	                              * from 32 x 24 rays a view, scaled to its pixels */
};

struct bb_stream;
BB_MUST_CHECK enum bb_status bb_stream_create(const struct bb_stream_config *config, struct bb_stream **out);
void bb_stream_destroy(struct bb_stream *s);
/* Select and load for one frame. step: time in steps (0 .. n_steps - 1), its two neighbours are on show. n_views may
 * be 0 (nothing wanted). step_voxels and the views' pixel sizes feed the geometric counters. */
struct bb_stream_counts bb_stream_frame(struct bb_stream *s, const struct bb_view *views, size_t n_views,
                                        uint32_t width_px, uint32_t height_px, double step, double next_step,
                                        double step_voxels);

/* What a renderer needs: slot of each brick (-1: coarse), the atlas, the coarse volume, and which slots changed. */
struct bb_atlas {
	uint32_t grid[3], n_steps;     /* bricks per axis */
	uint32_t n_slots;
	const int32_t *slot;           /* [n_steps][grid z][y][x] */
	const uint16_t *bricks;        /* [n_slots][18][18][18], and a plane, a row and a voxel more */
	uint64_t generation;           /* grows with every load */
	const uint64_t *slot_generation; /* [n_slots] generation of a slot's content */
	uint32_t coarse_dim[3];        /* per step */
	const uint16_t *coarse;        /* [n_steps][z][y][x], and a plane, a row and a voxel more */
	const uint8_t *empty;          /* [n_steps][grid...]: 1 = invisible at this step and on the way to its neighbours */
};
const struct bb_atlas *bb_stream_atlas(const struct bb_stream *s);
const struct bb_stream_config *bb_stream_config(const struct bb_stream *s);
uint64_t bb_stream_memory_bytes(const struct bb_stream *s); /* atlas + coarse + maps: what is really held */

#endif
