/*
 * render/stream/stream.h: the bricks of a file in memory, under a memory and a streaming budget.
 *
 * Each frame plans greedily, as algorithm 1 of Carlsson and Tjernstroem 2016 does and as if everything were here: from the
 * whole sequence's one brick on, the brick whose split gains most (gain.h, weighted by what the views can see of it) is
 * split, in space or in time, as far as the memory and what can be read in time go; the two steps on show and, with
 * prediction, those that come next are planned as one. What the plan has and memory has not is asked for as far as the
 * streaming budget goes, and the nearest ancestor that is here stands in for it. So a frame never waits: every part of the
 * volume always has a brick. What is asked for in one frame may be drawn in the next one at the earliest, on any clock.
 * Bricks that nobody needs stay until their slot is wanted. A brick that cannot be read is asked for once.
 *
 * memory_bytes bounds everything that holds voxels or says where they are: atlas, maps, ranges, staging and the lists of
 * the selection. Beside it, as the file's own index, are 8 bytes of ratings for each brick of the file, 8 bytes for each
 * node with occlusion, and what a loader of io.h queues. bricks_per_frame bounds what is asked for in a frame and, after
 * a disk that was slow, what of it a frame takes in. Pure function of the frames so far: the same counters on every
 * machine. One thread, but see stream/io.h.
 */
#ifndef BB_RENDER_STREAM_STREAM_H
#define BB_RENDER_STREAM_STREAM_H

#include "render/atlas.h"
#include "render/bricks/gain.h"
#include "render/renderer.h"

#define BB_STREAM_AHEAD_MOST 4

struct bb_stream_config {
	const struct bb_bricks *bricks;     /* borrowed */
	const struct bb_transfer *transfer; /* borrowed */
	const struct bb_volume *volume;     /* borrowed; for "reference" only, may be NULL */
	struct bb_placement placement;
	uint64_t memory_bytes;     /* 0: what two steps need at full resolution, all of it */
	uint32_t bricks_per_frame; /* 0: no limit */
	enum bb_gain_method gain;
	uint32_t views_most;       /* of a frame; 0: 16. Those beyond are not looked through */
	bool no_prediction;
	bool occlusion; /* what little light reached lately is worth less: for data that hides itself */
};

struct bb_stream_frame { /* what a frame is about */
	const struct bb_view *views;
	size_t n_views; /* 0: nothing is seen; what is there stays */
	uint32_t width_px, height_px;
	double step, step_voxels; /* time in steps (0 .. n_steps - 1); its two neighbours are on show */
	int way;                  /* of time: 1 on, -1 back, 0 it stands still */
	/* Times that will be on show: ahead[i] in (i + 1) * ahead_frames, each a step or so on from the one before; those
	 * beyond BB_STREAM_AHEAD_MOST are not looked at. */
	const double *ahead;
	size_t n_ahead;
	uint32_t ahead_frames;
	uint32_t bricks_most; /* what the deadline leaves time for; UINT32_MAX: no limit but the budget */
	int64_t now_ns;       /* for loaders that model a disk */
};

struct bb_stream_counts {         /* of one frame */
	uint32_t drawn;           /* bricks that should stand for the volume at the time on show */
	uint32_t missing;         /* of them, those that are not here: something coarser stands in */
	uint32_t deficit;         /* the same in leaf cells, of both steps on show, however much each counts */
	uint32_t loaded, evicted, prefetched; /* asked for in this frame, the prefetched ones included; of them prefetched */
	uint32_t arrived;         /* read, asked for in earlier frames: from this frame on they may be drawn */
	uint32_t failed;          /* could not be read: something coarser stays on show */
	uint64_t bytes;           /* loaded, as they lie in memory */
	uint64_t rays, samples;   /* geometric: rays that meet the volume's box, and their length / step, all views;
	                           * from 32 x 24 rays a view, scaled to its pixels */
};

struct bb_stream;
/* 1470: not even the coarsest brick fits the memory budget. 1471: the file's bricks have no padding. 1450, 1702. */
BB_MUST_CHECK enum bb_status bb_stream_create(const struct bb_stream_config *config, struct bb_stream **out,
					      struct bb_error *err);
void bb_stream_destroy(struct bb_stream *s);
/* Select, evict and ask for one frame. */
struct bb_stream_counts bb_stream_frame(struct bb_stream *s, const struct bb_stream_frame *frame);
/* Frames until nothing more comes (with occlusion, until enough: it may go to and fro). Not with a reader thread of its
 * own. */
void bb_stream_settle(struct bb_stream *s, const struct bb_stream_frame *frame);
/* Another transfer function (borrowed): what is in memory stays. 1441: its ratings are of neither. */
BB_MUST_CHECK enum bb_status bb_stream_set_transfer(struct bb_stream *s, const struct bb_transfer *tf,
						    struct bb_error *err);
/* Other budgets; another memory budget begins with nothing in it. After 1470 and 1701 the old ones
 * hold; after 1702, or 1441 for the coarsest brick, only bb_stream_destroy may follow. */
BB_MUST_CHECK enum bb_status bb_stream_set_budget(struct bb_stream *s, uint64_t memory_bytes, uint32_t bricks_per_frame,
						  struct bb_error *err);

const struct bb_atlas *bb_stream_atlas(const struct bb_stream *s);
/* What a renderer draws; good until the next frame. */
struct bb_layer bb_stream_layer(const struct bb_stream *s);
const struct bb_stream_config *bb_stream_config(const struct bb_stream *s);
/* Why the last brick that failed could not be read, and how many did; values that were out of range, in all bricks read. */
const struct bb_error *bb_stream_error(const struct bb_stream *s);
uint64_t bb_stream_failures(const struct bb_stream *s, uint64_t *n_odd);
uint64_t bb_stream_memory_bytes(const struct bb_stream *s); /* held now under the memory budget */

#endif
