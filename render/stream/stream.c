/*
 * render/stream/stream.c: one frame of streaming: commit what has been read, rank what the views want, keep the nearest
 * that fit, ask for what is missing within the budget, and use what is left of it for the step that comes next. All
 * memory is taken at creation; a frame allocates nothing and waits for nothing.
 */
#include "render/stream/stream_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void unlink_slot(struct bb_stream *s, uint32_t i)
{
	struct bb_slot *slot = &s->slots[i];

	if (slot->older == BB_NO_SLOT)
		s->oldest = slot->newer;
	else
		s->slots[slot->older].newer = slot->newer;
	if (slot->newer == BB_NO_SLOT)
		s->newest = slot->older;
	else
		s->slots[slot->newer].older = slot->older;
}

static void append_slot(struct bb_stream *s, uint32_t i)
{
	s->slots[i].older = s->newest;
	s->slots[i].newer = BB_NO_SLOT;
	if (s->newest == BB_NO_SLOT)
		s->oldest = i;
	else
		s->slots[s->newest].newer = i;
	s->newest = i;
}

static void touch(struct bb_stream *s, uint32_t i)
{
	if (s->slots[i].used_frame == s->frame)
		return;
	s->slots[i].used_frame = s->frame;
	unlink_slot(s, i);
	append_slot(s, i);
}

/* The slot unused for longest; never one of this frame, never one that is being read. */
static uint32_t find_victim(const struct bb_stream *s)
{
	uint32_t i = s->oldest;

	while (i != BB_NO_SLOT && s->slots[i].pending)
		i = s->slots[i].newer;
	return i != BB_NO_SLOT && s->slots[i].used_frame < s->frame ? i : BB_NO_SLOT;
}

static void reserve(struct bb_stream *s, uint32_t i, uint32_t gid, struct bb_stream_counts *counts)
{
	struct bb_slot *slot = &s->slots[i];

	if (slot->gid != BB_NO_BRICK) {
		s->slot[slot->gid] = s->where[slot->gid] = -1;
		counts->evicted++;
	}
	slot->gid = gid;
	slot->pending = true;
	s->where[gid] = (int32_t)i;
	touch(s, i);
}

void bb_stream_commit(struct bb_stream *s)
{
	const size_t n = s->loader->collect(s->loader, s->done, s->atlas.n_slots);

	for (size_t i = 0; i < n; i++) {
		const struct bb_load load = s->done[i];
		s->slots[load.slot].pending = false;
		s->slot[load.gid] = (int32_t)load.slot;
		s->slot_generation[load.slot] = ++s->atlas.generation;
	}
}

/* Keeps the best `keep` of n ranked bricks and asks for those that are missing. Returns how many it asked for. */
static uint32_t want(struct bb_stream *s, uint64_t *ranked, size_t n, size_t keep, uint32_t budget,
                     struct bb_stream_counts *counts)
{
	uint32_t n_loads = 0, n_asked = 0;

	bb_heap_make(ranked, n);
	for (size_t i = 0; i < n && i < keep; i++) {
		const uint32_t gid = (uint32_t)bb_heap_pop(ranked, n - i);
		if (s->where[gid] >= 0)
			touch(s, (uint32_t)s->where[gid]);
		else if (n_loads < budget)
			s->loads[n_loads++].gid = gid;
	}
	/* Only now, when all that stays has been touched, is it known what may go. */
	for (; n_asked < n_loads; n_asked++) {
		const uint32_t slot = find_victim(s);
		if (slot == BB_NO_SLOT)
			break;
		s->loads[n_asked].slot = slot;
		reserve(s, slot, s->loads[n_asked].gid, counts);
	}
	if (n_asked)
		s->loader->submit(s->loader, s->loads, n_asked);
	return n_asked;
}

/* The steps on show at a time: one, or two neighbours between which it lies. */
static size_t steps_at(const struct bb_stream *s, double time, uint32_t out[2])
{
	const double last = (double)s->atlas.n_steps - 1;
	const double t = time > 0 ? (time < last ? time : last) : 0; /* NaN is 0 */

	out[0] = out[1] = (uint32_t)t;
	if (t == (double)out[0])
		return 1;
	out[1] = out[0] + 1;
	return 2;
}

static size_t gather_soon(struct bb_stream *s, const uint32_t shown[2], double next_step)
{
	uint32_t next[2];
	const size_t n_next = steps_at(s, next_step, next);
	size_t n = 0;

	for (size_t i = 0; i < n_next; i++)
		if (next[i] != shown[0] && next[i] != shown[1])
			n += bb_select_gather(s, next[i], 1, s->soon + n);
	return n;
}

struct bb_stream_counts bb_stream_frame(struct bb_stream *s, const struct bb_view *views, size_t n_views,
                                        uint32_t width_px, uint32_t height_px, double step, double next_step,
                                        double step_voxels)
{
	struct bb_stream_counts counts = { 0 };
	uint32_t budget = s->config.bricks_per_frame ? s->config.bricks_per_frame : UINT32_MAX;
	uint32_t shown[2];
	size_t n = 0;

	s->frame++;
	bb_stream_commit(s);
	bb_select_seen(s, views, n_views);
	const size_t n_shown = steps_at(s, step, shown);
	const double later = n_shown == 2 ? step - shown[0] : 0;
	for (size_t i = 0; i < n_shown; i++)
		n += bb_select_gather(s, shown[i], i ? later : 1 - later, s->show + n);
	const size_t keep = n < s->atlas.n_slots ? n : s->atlas.n_slots;
	counts.loaded = want(s, s->show, n, keep, budget, &counts);
	budget -= counts.loaded;

	const size_t n_soon = gather_soon(s, shown, next_step);
	counts.prefetched = want(s, s->soon, n_soon, s->atlas.n_slots - keep, budget, &counts);
	counts.loaded += counts.prefetched;
	counts.bytes = (uint64_t)counts.loaded * BB_BRICK_BYTES;
	bb_stream_commit(s);
	counts.wanted = (uint32_t)n;
	for (size_t i = 0; i < n; i++)
		counts.resident += s->slot[(uint32_t)s->show[i]] >= 0;
	counts.missing = counts.wanted - counts.resident;
	for (size_t i = 0; i < n_views; i++)
		bb_count_rays(&s->config, &views[i], width_px, height_px, step_voxels, &counts);
	return counts;
}

/* The loader of the virtual clock: a brick is there as soon as it is asked for. */
static void submit_now(struct bb_loader *loader, const struct bb_load *loads, size_t n)
{
	struct bb_stream *s = bb_container_of(loader, struct bb_stream, now);

	for (size_t i = 0; i < n; i++) {
		bb_stream_read(s, loads[i]);
		s->done[s->n_done++] = loads[i];
	}
}

static size_t collect_now(struct bb_loader *loader, struct bb_load *done, size_t cap)
{
	struct bb_stream *s = bb_container_of(loader, struct bb_stream, now);
	const size_t n = s->n_done;

	(void)done; /* it is s->done, where they already stand */
	(void)cap;
	s->n_done = 0;
	return n;
}

/* A brick is empty at a step when nothing can be seen in it at that step nor on the way to either neighbour: a value
 * that lies between two invisible ones may be visible. */
static void find_empty(struct bb_stream *s, const uint16_t *least, const uint16_t *most)
{
	const uint32_t n_steps = s->atlas.n_steps, n = s->n_bricks;

	for (uint32_t step = 0; step < n_steps; step++)
		for (uint32_t b = 0; b < n; b++) {
			const size_t gid = (size_t)step * n + b;
			const size_t first = step ? gid - n : gid, last = step + 1 < n_steps ? gid + n : gid;
			uint16_t lo = least[gid], hi = most[gid];
			for (size_t g = first; g <= last; g += n) {
				lo = least[g] < lo ? least[g] : lo;
				hi = most[g] > hi ? most[g] : hi;
			}
			s->empty[gid] = bb_transfer_most_opacity(s->config.transfer, lo / 65535.0, hi / 65535.0) <= 0;
		}
}

static bool measure_bricks(struct bb_stream *s)
{
	const size_t n = (size_t)s->n_bricks * s->atlas.n_steps;
	uint16_t *least = malloc(n * 2 * sizeof(*least)), *scratch = malloc(BB_BRICK_BYTES);

	for (size_t gid = 0; least && scratch && gid < n; gid++) {
		const uint32_t *grid = s->atlas.grid, b = (uint32_t)(gid % s->n_bricks);
		const uint32_t brick[3] = { b % grid[0], b / grid[0] % grid[1], b / grid[0] / grid[1] };
		bb_brick_fill(s->config.volume, (uint32_t)(gid / s->n_bricks), brick, scratch);
		bb_brick_range(scratch, &least[gid], &least[n + gid]);
	}
	const bool ok = least && scratch;
	if (ok)
		find_empty(s, least, least + n);
	free(least);
	free(scratch);
	return ok;
}

static void *take(struct bb_stream *s, size_t n, size_t size)
{
	size_t bytes;

	if (__builtin_mul_overflow(n ? n : 1, size, &bytes))
		return NULL;
	void *memory = calloc(1, bytes);
	if (memory)
		s->held_bytes += bytes;
	return memory;
}

static bool take_memory(struct bb_stream *s)
{
	const size_t n = (size_t)s->n_bricks * s->atlas.n_steps, n_slots = s->atlas.n_slots;
	const size_t n_coarse = (size_t)s->atlas.coarse_dim[0] * s->atlas.coarse_dim[1] * s->atlas.coarse_dim[2];
	bool ok = true;

	ok &= (s->slot = take(s, n, sizeof(*s->slot))) != NULL;
	ok &= (s->where = take(s, n, sizeof(*s->where))) != NULL;
	/* A caster that takes eight voxels at a time looks beyond the last one, with no weight. */
	const size_t beyond = BB_BRICK_STORED * BB_BRICK_STORED + BB_BRICK_STORED + 1;
	const size_t beyond_coarse = (size_t)s->atlas.coarse_dim[0] * (s->atlas.coarse_dim[1] + 1) + 1;
	ok &= (s->bricks = take(s, n_slots * BB_BRICK_VOXELS + beyond, sizeof(*s->bricks))) != NULL;
	ok &= (s->slot_generation = take(s, n_slots, sizeof(*s->slot_generation))) != NULL;
	ok &= (s->coarse = take(s, n_coarse * s->atlas.n_steps + beyond_coarse, sizeof(*s->coarse))) != NULL;
	ok &= (s->empty = take(s, n, sizeof(*s->empty))) != NULL;
	ok &= (s->slots = take(s, n_slots, sizeof(*s->slots))) != NULL;
	ok &= (s->near_um = take(s, s->n_bricks, sizeof(*s->near_um))) != NULL;
	ok &= (s->show = take(s, (size_t)s->n_bricks * 2, sizeof(*s->show))) != NULL;
	ok &= (s->soon = take(s, (size_t)s->n_bricks * 2, sizeof(*s->soon))) != NULL;
	ok &= (s->loads = take(s, n_slots, sizeof(*s->loads))) != NULL;
	ok &= (s->done = take(s, n_slots, sizeof(*s->done))) != NULL;
	for (int a = 0; a < 3; a++) {
		ok &= (s->centre_m[a] = take(s, s->atlas.grid[a], sizeof(double))) != NULL;
		ok &= (s->half_m[a] = take(s, s->atlas.grid[a], sizeof(double))) != NULL;
	}
	return ok;
}

/* Grid and slot count; false when the bricks cannot be numbered. */
static bool plan(struct bb_stream *s)
{
	const struct bb_volume *v = s->config.volume;
	uint64_t n = 1;

	for (int a = 0; a < 3; a++) {
		s->atlas.grid[a] = (v->dim[a] - 1) / BB_BRICK_EDGE + 1;
		s->atlas.coarse_dim[a] = (v->dim[a] - 1) / BB_COARSE_FACTOR + 1;
		n *= s->atlas.grid[a]; /* dims < 2^32: each factor < 2^28, checked before the next */
		if (n > INT32_MAX)
			return false;
	}
	s->n_bricks = (uint32_t)n;
	s->atlas.n_steps = v->n_steps;
	n *= v->n_steps;
	if (n > INT32_MAX)
		return false;
	const uint64_t slots = s->config.memory_bytes / BB_BRICK_BYTES;
	s->atlas.n_slots = (uint32_t)(s->config.memory_bytes && slots < n ? slots : n);
	return true;
}

static void place_bricks(struct bb_stream *s)
{
	const struct bb_vec3 size = s->config.placement.size_m;
	const double edge_m[3] = { size.x, size.y, size.z };

	for (int a = 0; a < 3; a++) {
		const uint32_t dim = s->config.volume->dim[a];
		for (uint32_t i = 0; i < s->atlas.grid[a]; i++) {
			const uint32_t from = i * BB_BRICK_EDGE;
			const uint32_t to = dim - from < BB_BRICK_EDGE ? dim : from + BB_BRICK_EDGE;
			const double voxel_m = edge_m[a] / dim;
			s->centre_m[a][i] = ((double)from + (double)to) / 2 * voxel_m - edge_m[a] / 2;
			s->half_m[a][i] = ((double)to - (double)from) / 2 * voxel_m;
		}
	}
}

static void start_empty(struct bb_stream *s)
{
	const size_t n = (size_t)s->n_bricks * s->atlas.n_steps;

	memset(s->slot, 0xFF, n * sizeof(*s->slot)); /* all -1 */
	memset(s->where, 0xFF, n * sizeof(*s->where));
	s->oldest = s->newest = BB_NO_SLOT;
	for (uint32_t i = 0; i < s->atlas.n_slots; i++) {
		s->slots[i].gid = BB_NO_BRICK;
		append_slot(s, i);
	}
	s->now = (struct bb_loader){ submit_now, collect_now };
	s->loader = &s->now;
}

static void load_everything(struct bb_stream *s)
{
	struct bb_stream_counts counts = { 0 };

	s->frame++;
	for (uint32_t gid = 0; gid < s->atlas.n_slots; gid++) {
		const struct bb_load load = { gid, gid };
		reserve(s, gid, gid, &counts);
		s->loader->submit(s->loader, &load, 1);
	}
	bb_stream_commit(s);
}

static bool is_sound(const struct bb_stream_config *c)
{
	const struct bb_vec3 e = c->placement.size_m, p = c->placement.pose.p;

	return c->volume && c->transfer && c->volume->n_steps && e.x > 0 && e.y > 0 && e.z > 0 &&
	       isfinite(e.x + e.y + e.z + p.x + p.y + p.z);
}

enum bb_status bb_stream_create(const struct bb_stream_config *config, struct bb_stream **out)
{
	*out = NULL;
	if (!is_sound(config))
		return BB_ERR_USAGE;
	struct bb_stream *s = calloc(1, sizeof(*s));
	if (!s)
		return BB_ERR_NOMEM;
	s->config = *config;
	s->held_bytes = sizeof(*s);
	if (!plan(s)) {
		bb_stream_destroy(s);
		return BB_ERR_RANGE;
	}
	if (!take_memory(s) || !measure_bricks(s)) {
		bb_stream_destroy(s);
		return BB_ERR_NOMEM;
	}
	bb_coarse_fill(config->volume, s->atlas.coarse_dim, s->coarse);
	place_bricks(s);
	start_empty(s);
	s->atlas.slot = s->slot;
	s->atlas.bricks = s->bricks;
	s->atlas.slot_generation = s->slot_generation;
	s->atlas.coarse = s->coarse;
	s->atlas.empty = s->empty;
	if (!config->memory_bytes)
		load_everything(s);
	*out = s;
	return BB_OK;
}

void bb_stream_destroy(struct bb_stream *s)
{
	if (!s)
		return;
	for (int a = 0; a < 3; a++) {
		free(s->centre_m[a]);
		free(s->half_m[a]);
	}
	free(s->slot);
	free(s->where);
	free(s->bricks);
	free(s->slot_generation);
	free(s->coarse);
	free(s->empty);
	free(s->slots);
	free(s->near_um);
	free(s->show);
	free(s->soon);
	free(s->loads);
	free(s->done);
	free(s);
}

const struct bb_atlas *bb_stream_atlas(const struct bb_stream *s)
{
	return &s->atlas;
}

const struct bb_stream_config *bb_stream_config(const struct bb_stream *s)
{
	return &s->config;
}

uint64_t bb_stream_memory_bytes(const struct bb_stream *s)
{
	return s->held_bytes;
}
