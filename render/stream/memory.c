/*
 * render/stream/memory.c: what a stream holds. Everything that grows with the budget is taken at once, so that the
 * budget is kept by arithmetic: a slot costs its voxels, ranges, place in the lists and tables; cells and slack are there
 * whatever the budget is.
 */
#include "render/stream/stream_private.h"

#include <stdlib.h>
#include <string.h>

#define SPARE 8 /* a split puts eight on a list that had one */
#define HASH_LEAST 16
#define SMALL_BYTES (UINT64_C(112) << 10) /* of staging: above it a reader takes a huge page, */
#define LARGE_BYTES (UINT64_C(3) << 20)   /* which is worth it from here on */

static size_t blocks_of(const struct bb_atlas *a)
{
	return (size_t)a->blocks * a->blocks * a->blocks;
}

static size_t cells_of(const struct bb_atlas *a)
{
	return (size_t)a->grid[0] * a->grid[1] * a->grid[2];
}

static uint32_t hash_size(uint32_t n_slots)
{
	uint32_t n = HASH_LEAST;

	while (n < n_slots + n_slots / 2)
		n *= 2;
	return n;
}

static uint64_t bytes_for(const struct bb_stream *s, uint64_t n_slots)
{
	const struct bb_atlas *a = &s->atlas;
	const uint64_t each = a->slot_bytes + blocks_of(a) * sizeof(*s->range) + sizeof(*s->slot_generation) +
			      sizeof(*s->slots.slot) + 2 * sizeof(*s->plan.heap) + sizeof(*s->wish) + 3 * sizeof(*s->load);
	const uint64_t once = bb_atlas_slack_bytes(a) + 2 * cells_of(a) * sizeof(*s->map[0]) +
			      SPARE * (2 * sizeof(*s->plan.heap) + sizeof(*s->wish)) + bb_bricks_reader_bytes(s->reader) +
			      s->config.views_most * (sizeof(*s->view) + sizeof(*s->frustum));

	return each * n_slots + once + hash_size((uint32_t)n_slots) * sizeof(*s->slots.hash);
}

/* As many as fit; 0: none. */
static uint32_t slots_that_fit(const struct bb_stream *s, uint64_t memory_bytes)
{
	uint64_t low = 0, high = s->tree->n_bricks < INT32_MAX / 2 ? s->tree->n_bricks : INT32_MAX / 2;

	if (bytes_for(s, high) <= memory_bytes)
		return (uint32_t)high;
	while (low + 1 < high) {
		const uint64_t middle = (low + high) / 2;
		if (bytes_for(s, middle) <= memory_bytes)
			low = middle;
		else
			high = middle;
	}
	return (uint32_t)low;
}

/* All or nothing is not needed: what is NULL is given back as well. */
static void *take(struct bb_stream *s, size_t n, size_t size, bool *ok)
{
	size_t bytes;
	void *memory = NULL;

	if (!__builtin_mul_overflow(n ? n : 1, size, &bytes))
		memory = calloc(1, bytes);
	if (memory)
		s->held_bytes += bytes;
	else
		*ok = false;
	return memory;
}

/* Staging takes no more than a sixteenth of the budget, if one brick does not. */
static enum bb_status take_reader(struct bb_stream *s, struct bb_error *err)
{
	uint64_t share = s->config.memory_bytes / 16;
	if (share < LARGE_BYTES && share > SMALL_BYTES)
		share = SMALL_BYTES;
	share /= s->atlas.slot_bytes;
	const uint32_t most = s->complete || share > BB_READ_MOST ? BB_READ_MOST : (uint32_t)share;

	return bb_bricks_reader_create(s->config.bricks, most, BB_BRICKS_CACHED, &s->reader, err);
}

enum bb_status bb_stream_take(struct bb_stream *s, struct bb_error *err)
{
	struct bb_atlas *a = &s->atlas;
	const size_t n_cells = cells_of(a);
	const enum bb_status status = take_reader(s, err);

	if (status)
		return status;
	if (s->complete && n_cells > INT32_MAX / 4)
		return bb_fail(err, BB_ERR_RANGE, 1702, NULL, "%zu bricks at once; set a memory budget", 2 * n_cells);
	const uint32_t n = s->complete ? (uint32_t)(2 * n_cells + 1) : slots_that_fit(s, s->config.memory_bytes);
	bool ok = true;

	if (!n)
		return bb_fail(err, BB_ERR_CONFIG, 1470, NULL, "%llu bytes, one brick with its maps takes %llu",
			       (unsigned long long)s->config.memory_bytes, (unsigned long long)bytes_for(s, 1));
	s->held_bytes = bb_bricks_reader_bytes(s->reader);
	s->slots.n = a->n_slots = n;
	s->slots.n_hash = hash_size(n);
	s->bricks = take(s, 1, n * a->slot_bytes + bb_atlas_slack_bytes(a), &ok);
	s->range = take(s, n * blocks_of(a), sizeof(*s->range), &ok);
	s->slot_generation = take(s, n, sizeof(*s->slot_generation), &ok);
	s->map[0] = take(s, n_cells, sizeof(*s->map[0]), &ok);
	s->map[1] = take(s, n_cells, sizeof(*s->map[1]), &ok);
	s->slots.slot = take(s, n, sizeof(*s->slots.slot), &ok);
	s->slots.hash = take(s, s->slots.n_hash, sizeof(*s->slots.hash), &ok);
	s->plan.heap = take(s, n + SPARE, sizeof(*s->plan.heap), &ok);
	s->plan.target = take(s, n + SPARE, sizeof(*s->plan.target), &ok);
	s->wish = take(s, n + SPARE, sizeof(*s->wish), &ok);
	s->view = take(s, s->config.views_most, sizeof(*s->view), &ok);
	s->frustum = take(s, s->config.views_most, sizeof(*s->frustum), &ok);
	s->load = take(s, n, sizeof(*s->load), &ok);
	s->done = take(s, n, sizeof(*s->done), &ok);
	s->ready = take(s, n, sizeof(*s->ready), &ok);
	a->bricks = s->bricks;
	a->range = s->range;
	a->slot_generation = s->slot_generation;
	a->map[0] = s->map[0];
	a->map[1] = s->map[1];
	if (!ok)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%u bricks of %zu bytes", n, a->slot_bytes);
	bb_slots_clear(&s->slots);
	return BB_OK;
}

void bb_stream_give(struct bb_stream *s)
{
	void *const all[] = { s->bricks,     s->range,       s->slot_generation, s->map[0], s->map[1], s->slots.slot,
			      s->slots.hash, s->plan.heap, s->plan.target,     s->wish,   s->load,   s->done,
			      s->ready,      s->view,        s->frustum };

	for (size_t i = 0; i < BB_ARRAY_LEN(all); i++)
		free(all[i]);
	bb_bricks_reader_destroy(s->reader);
	s->reader = NULL;
	s->bricks = NULL;
	s->range = NULL;
	s->slot_generation = NULL;
	s->map[0] = s->map[1] = NULL;
	s->slots = (struct bb_slots){ 0 };
	s->plan = (struct bb_plan){ 0 };
	s->wish = NULL;
	s->view = NULL;
	s->frustum = NULL;
	s->load = s->done = s->ready = NULL;
	s->n_ready = 0;
	s->held_bytes = 0;
}

void bb_stream_read(struct bb_stream *s, struct bb_load *loads, size_t n, struct bb_error *err)
{
	struct bb_bricks_want want[BB_READ_MOST];

	for (size_t i = 0; i < n; i++)
		want[i] = (struct bb_bricks_want){ .brick = loads[i].brick,
						   .out = s->bricks + (size_t)loads[i].slot * s->atlas.slot_bytes };
	(void)bb_bricks_read_many(s->reader, want, n, err); /* each says it for itself */
	for (size_t i = 0; i < n; i++) {
		loads[i].failed = want[i].status != BB_OK;
		if (!loads[i].failed)
			loads[i].n_odd = bb_atlas_accept(&s->atlas, want[i].out,
							 s->range + loads[i].slot * blocks_of(&s->atlas));
	}
}
