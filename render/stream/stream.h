/*
 * render/stream/stream.h: the bricks of a file in memory, under a memory and a streaming budget.
 *
 * Each frame refines greedily, as algorithm 1 of Carlsson and Tjernstroem 2016 does: from the whole sequence's one brick
 * on, the brick whose split gains most (gain.h, weighted by what the views can see of it) is split, in space or in time,
 * when its children are there; children that are not are asked for as far as the streaming budget goes, and their parent
 * stands for them until they come. So a frame never waits: every part of the volume always has a brick. The two steps on
 * show and, with prediction, those that come next are refined as one. What is asked for in one frame may be drawn in the
 * next one at the earliest, on any clock. Bricks that nobody needs stay until their slot is wanted.
 *
 * memory_bytes bounds everything that holds voxels or says where they are: atlas, maps, ranges, staging. The statistics
 * (24 bytes a brick of the file) are beside it, as the file's own index is. Pure function of the frames so far: the same
 * counters on every machine. One thread, but see stream/io.h.
 */
#ifndef BB_RENDER_STREAM_STREAM_H
#define BB_RENDER_STREAM_STREAM_H

#include "render/atlas.h"
#include "render/bricks/gain.h"
#include "render/renderer.h"

struct bb_stream_config {
	const struct bb_bricks *bricks;     /* borrowed */
	const struct bb_transfer *transfer; /* borrowed */
	const struct bb_volume *volume;     /* borrowed; for "reference" only, may be NULL */
	struct bb_placement placement;
	uint64_t memory_bytes;     /* 0: as much as three steps need at full resolution */
	uint32_t bricks_per_frame; /* 0: no limit */
	enum bb_gain_method gain;
	bool no_prediction;
	bool occlusion; /* what little light reached lately is worth less: for data that hides itself */
};

struct bb_stream_frame { /* what a frame is about */
	const struct bb_view *views;
	size_t n_views; /* 0: nothing is seen; what is there stays */
	uint32_t width_px, height_px;
	double step, step_voxels; /* time in steps (0 .. n_steps - 1); its two neighbours are on show */
	int way;                  /* of time: 1 on, -1 back, 0 it stands still */
	const double *ahead;      /* steps that will be on show in so many frames: ahead[i] in (i + 1) * ahead_frames */
	size_t n_ahead;
	uint32_t ahead_frames;
	uint32_t bricks_most; /* what the deadline leaves time for; UINT32_MAX: no limit but the budget */
	int64_t now_ns;       /* for loaders that model a disk */
};

struct bb_stream_counts {         /* of one frame */
	uint32_t drawn;           /* bricks that stand for the volume at the time on show */
	uint32_t missing;         /* of them, those that would be split if their children were here */
	uint32_t deficit;         /* the same in leaf cells: how much of the volume is coarser than the memory allows */
	uint32_t loaded, evicted, prefetched; /* asked for in this frame, the prefetched ones included; of them prefetched */
	uint32_t arrived;         /* read, asked for in earlier frames: from this frame on they may be drawn */
	uint32_t failed;          /* could not be read: their parents stay on show */
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
/* Frames until nothing more comes; returns how many. Not with a reader thread of its own. */
unsigned bb_stream_settle(struct bb_stream *s, const struct bb_stream_frame *frame);
/* Another transfer function (borrowed), another budget: what is in memory stays as far as it fits. */
BB_MUST_CHECK enum bb_status bb_stream_set_transfer(struct bb_stream *s, const struct bb_transfer *tf,
						    struct bb_error *err);
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
