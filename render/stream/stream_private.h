/*
 * render/stream/stream_private.h: what the parts of the streamer share. A brick of a step has one number, gid =
 * step * n_bricks + (z * grid_y + y) * grid_x + x. Distances in um, so that ranks are whole numbers.
 */
#ifndef BB_RENDER_STREAM_PRIVATE_H
#define BB_RENDER_STREAM_PRIVATE_H

#include "render/stream/stream.h"

#define BB_NO_BRICK UINT32_MAX
#define BB_NO_SLOT UINT32_MAX
#define BB_UNSEEN UINT32_MAX
#define BB_BRICK_VOXELS (BB_BRICK_STORED * BB_BRICK_STORED * BB_BRICK_STORED)

struct bb_load { /* put this brick into that slot */
	uint32_t gid, slot;
};

/* The seam between selecting and reading. Virtual clock: submit reads at once. Posix: a thread reads, and collect hands
 * over what is ready. Neither waits. What was collected is committed by the stream: only then may it be drawn. */
struct bb_loader {
	void (*submit)(struct bb_loader *loader, const struct bb_load *loads, size_t n);
	size_t (*collect)(struct bb_loader *loader, struct bb_load *done, size_t cap);
};

struct bb_slot {
	uint32_t gid;          /* what it holds or waits for; BB_NO_BRICK: nothing */
	uint32_t older, newer; /* list in order of use */
	bool pending;          /* being read: its memory belongs to the loader */
	uint64_t used_frame;
};

struct bb_stream {
	struct bb_stream_config config;
	struct bb_atlas atlas; /* the public face; points into what follows */
	uint32_t n_bricks;     /* of one step */
	uint64_t frame;
	int32_t *slot;         /* [gid] committed; -1 */
	int32_t *where;        /* [gid] committed or on its way; -1 */
	uint16_t *bricks;
	uint64_t *slot_generation;
	uint16_t *coarse;
	uint8_t *empty;
	struct bb_slot *slots;
	uint32_t oldest, newest;
	uint32_t *near_um;     /* [n_bricks] distance to the nearest eye, BB_UNSEEN outside every frustum */
	double *centre_m[3], *half_m[3]; /* of the bricks along an axis, volume space */
	uint64_t *show, *soon; /* rank << 32 | gid of what is on show and of what comes next, 2 * n_bricks each */
	struct bb_load *loads, *done; /* [n_slots] */
	size_t n_done;         /* of the loader that reads at once */
	struct bb_loader now;  /* that loader */
	struct bb_loader *loader;
	uint64_t held_bytes;
};

/* atlas.c */
void bb_brick_fill(const struct bb_volume *v, uint32_t step, const uint32_t brick[3], uint16_t *out);
void bb_brick_range(const uint16_t *brick, uint16_t *least, uint16_t *most);
void bb_coarse_fill(const struct bb_volume *v, const uint32_t dim[3], uint16_t *out);
/* Reads brick gid into slot memory; touches nothing else, so any thread may call it. */
void bb_stream_read(const struct bb_stream *s, struct bb_load load);

/* select.c */
void bb_select_seen(struct bb_stream *s, const struct bb_view *views, size_t n_views);
/* Ranks of the visible bricks of one step, appended; returns how many. share (0..1) is how much of what is on show comes
 * from this step: a brick that counts half ranks as if it were twice as far. */
size_t bb_select_gather(const struct bb_stream *s, uint32_t step, double share, uint64_t *out);
void bb_heap_make(uint64_t *heap, size_t n);
/* The least of n is returned and put behind the n - 1 that remain. */
uint64_t bb_heap_pop(uint64_t *heap, size_t n);

/* count.c */
void bb_count_rays(const struct bb_stream_config *config, const struct bb_view *view, uint32_t width_px,
                   uint32_t height_px, double step_voxels, struct bb_stream_counts *counts);

/* stream.c */
void bb_stream_commit(struct bb_stream *s);

#endif
