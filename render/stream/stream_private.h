/*
 * render/stream/stream_private.h: what the parts of the streamer share. A brick has the number the file gives it (tree.h).
 * A frame: plan.c says which bricks should stand for the steps on show and those ahead, as if all of them were here;
 * stream.c asks for those that are not; show.c maps every cell to the best that is. slots.c keeps what is in memory.
 */
#ifndef BB_RENDER_STREAM_PRIVATE_H
#define BB_RENDER_STREAM_PRIVATE_H

#include "render/bricks/sight.h"
#include "render/stream/stream.h"

#define BB_NO_BRICK UINT64_MAX
#define BB_NO_SLOT UINT32_MAX
#define BB_HIDE_ENTRIES 1024
#define BB_STEPS_MOST (2 + BB_STREAM_AHEAD_MOST) /* two on show, those ahead */

struct bb_load { /* put this brick into that slot */
	uint64_t brick;
	uint32_t slot;
	bool failed;
	size_t n_odd; /* values that could not be */
};

/* The seam between selecting and reading. Neither call waits. What was collected is committed by the stream at the
 * beginning of the next frame: only then may it be drawn. */
struct bb_loader {
	void (*submit)(struct bb_loader *loader, const struct bb_load *loads, size_t n, int64_t now_ns);
	size_t (*collect)(struct bb_loader *loader, struct bb_load *done, size_t cap, int64_t now_ns);
};

struct bb_slot {
	uint64_t brick;        /* what it holds or waits for; BB_NO_BRICK: nothing */
	uint32_t older, newer; /* list in order of use */
	bool pending;          /* being read: its memory belongs to the loader */
	uint64_t used_frame;
};

struct bb_slots { /* which brick is where */
	struct bb_slot *slot;
	uint32_t n, oldest, newest, n_pending;
	uint32_t *hash; /* [n_hash] slot + 1; 0: nothing. Open addressing, linear */
	uint32_t n_hash;
	uint64_t frame;
};

struct bb_target { /* a brick that should stand for part of the volume in some of the planned steps */
	uint32_t node, tau;
	float points;  /* of the split that would make it finer; on the heap */
	float rank;    /* of the split that it came from: how much is lost without it */
	uint8_t steps; /* bits: of bb_plan.step */
	uint8_t closed; /* ways of splitting it that do not fit, and which is worth more */
};

struct bb_plan {
	uint32_t step[BB_STEPS_MOST], n_steps, n_shown, n_ahead;
	uint32_t due[BB_STEPS_MOST]; /* frames until a step is on show */
	float weight[BB_STEPS_MOST];
	uint32_t target_most;
	struct bb_target *heap, *target; /* [n_slots + 8] each */
	uint32_t n_heap, n_targets;
	uint32_t grace; /* frames a brick may be late */
	double stream[BB_STEPS_MOST], stream_most[BB_STEPS_MOST]; /* to be read by then; may be at most */
};

struct bb_wish { /* a brick to ask for */
	uint64_t key; /* rank and number: the greatest first */
	uint64_t brick;
	uint32_t due;
};

struct bb_stream {
	struct bb_stream_config config;
	struct bb_atlas atlas; /* the public face; points into what follows */
	const struct bb_tree *tree;
	bool complete;         /* memory_bytes 0: everything on show, at full resolution */
	uint8_t *bricks;
	struct bb_atlas_range *range;
	uint64_t *slot_generation;
	struct bb_atlas_cell *map[2];
	struct bb_slots slots;
	uint32_t root;         /* slot of brick 0, which is always there */
	uint32_t kept; /* slots for bricks that stand in for missing ones, times RETURN_FRAMES of show.c */
	struct bb_plan plan;
	struct bb_wish *wish;  /* [n_slots + 8] */
	uint32_t n_wishes;
	struct bb_load *load, *done; /* [n_slots] asked for; come, in this frame */
	struct bb_load *ready; /* [n_slots] of the loader that reads at once */
	size_t n_ready;
	struct bb_bricks_reader *reader;
	struct bb_loader now;  /* that loader */
	struct bb_loader *loader;
	struct bb_sight sight;
	struct bb_sight_view *view; /* [config.views_most] */
	struct bb_sight_frustum *frustum;
	struct {
		float opacity[BB_HIDE_ENTRIES]; /* of a step, by value */
		float *light;                   /* [cells] the largest share that came here lately */
		float *seen;                    /* [n_nodes] for the sight */
	} hide;
	float *space, *time;   /* [n_bricks] points */
	uint64_t held_bytes;   /* under the memory budget */
	uint64_t n_failed, n_odd; /* bricks that could not be read; values that were out of range */
	uint64_t *bad;         /* bits: bricks that are not asked for again */
	struct bb_error error; /* of the last one */
};

static inline uint64_t bb_stream_brick(const struct bb_stream *s, uint32_t node, uint32_t tau)
{
	return (uint64_t)tau * s->tree->n_nodes + node;
}

static inline uint32_t bb_stream_up(const struct bb_stream *s, uint32_t level)
{
	return s->tree->n_levels - 1 - level;
}

/* slots.c */
uint32_t bb_slots_find(const struct bb_slots *s, uint64_t brick); /* BB_NO_SLOT */
void bb_slots_touch(struct bb_slots *s, uint32_t slot);
/* The slot unused for longest that is not of this frame nor being read becomes the brick's, pending; BB_NO_SLOT: none. */
uint32_t bb_slots_reserve(struct bb_slots *s, uint64_t brick, bool *evicted);
void bb_slots_commit(struct bb_slots *s, uint32_t slot, bool failed);
void bb_slots_clear(struct bb_slots *s); /* nothing is anywhere */

/* plan.c */
void bb_plan_steps(struct bb_stream *s, const struct bb_stream_frame *frame);
void bb_plan_make(struct bb_stream *s);

/* show.c. Before anything goes: what stands in for missing targets, those of the steps ahead
 * included, is kept as far as there are slots besides theirs. */
void bb_show_keep(struct bb_stream *s);
uint32_t bb_show_kept(const struct bb_stream *s);
/* After it: fills the maps from the targets and what stands in for them; counts. */
void bb_show(struct bb_stream *s, double step, struct bb_stream_counts *counts);
/* The best that is in memory for a target: itself, or an ancestor in space or time. There always is one. */
uint32_t bb_show_best(const struct bb_stream *s, uint32_t node, uint32_t tau, uint32_t *level);

/* wish.c: what the plan has and memory has not; then asks for it, as far as the budget goes. */
void bb_wish(struct bb_stream *s);
/* Bricks that may be asked for, and taken in, in this frame. */
uint32_t bb_budget_of(const struct bb_stream *s, const struct bb_stream_frame *frame);
void bb_ask(struct bb_stream *s, const struct bb_stream_frame *frame, struct bb_stream_counts *counts);

/* memory.c */
BB_MUST_CHECK enum bb_status bb_stream_take(struct bb_stream *s, struct bb_error *err);
void bb_stream_give(struct bb_stream *s);
#define BB_READ_MOST 64
/* Reads up to BB_READ_MOST bricks into their slots' memory, by the stream's one reader: one thread at a time. err: the
 * first one's. */
void bb_stream_read(struct bb_stream *s, struct bb_load *loads, size_t n, struct bb_error *err);

/* hide.c: after the maps are made; and whenever the transfer function is another one. */
void bb_hide(struct bb_stream *s, const struct bb_stream_frame *frame);
void bb_hide_edit(struct bb_stream *s);

/* count.c */
void bb_count_rays(const struct bb_stream *s, const struct bb_view *view, const struct bb_stream_frame *frame,
		   struct bb_stream_counts *counts);

/* stream.c */
/* Of what has come, at most so many. */
void bb_stream_commit(struct bb_stream *s, size_t most, int64_t now_ns, struct bb_stream_counts *counts);

#endif
