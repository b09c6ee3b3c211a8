/*
 * render/cpu/cast_space.c: which parts of a volume a ray can leap over, and which it can cross in one go. Cells whose
 * bricks have not changed since the last picture are not looked at again.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "render/cpu/cast.h"
#include "render/parallel.h"

#define FAR 1e9F /* voxels: beyond everything */
#define BUCKETS 4096
#define BUCKET 16            /* 65535ths */
#define PARALLEL_LEAST 65536 /* blocks; fewer are done sooner than a thread is there */

void bb_cast_space_release(struct bb_cast_space *s)
{
	free(s->cell);
	free(s->empty);
	for (int a = 0; a < 3; a++)
		free(s->wall[a]);
	free(s->seen[0]);
	free(s->seen[1]);
	memset(s, 0, sizeof(*s));
}

/* ---- a volume's own numbers ---- */

static bool make_walls(struct bb_cast_space *s, const struct bb_atlas *atlas)
{
	for (int a = 0; a < 3; a++) {
		float *w = malloc((s->n_blocks[a] + 1) * sizeof(*w));
		if (!w)
			return false;
		for (uint32_t i = 0; i < s->n_blocks[a]; i++) {
			const uint32_t cell = i / atlas->blocks, block = i % atlas->blocks;
			w[i] = (float)(cell * atlas->edge + block * BB_ATLAS_BLOCK);
		}
		w[0] = -FAR;
		w[s->n_blocks[a]] = FAR;
		s->wall[a] = w;
	}
	return true;
}

static bool make(struct bb_cast_space *s, const struct bb_atlas *atlas)
{
	bb_cast_space_release(s);
	s->n_cells = s->n_all = 1;
	for (int a = 0; a < 3; a++) {
		s->n_blocks[a] = atlas->grid[a] * atlas->blocks;
		s->n_cells *= atlas->grid[a];
		s->n_all *= s->n_blocks[a];
	}
	s->cell = calloc(s->n_cells, sizeof(*s->cell));
	s->seen[0] = calloc(s->n_cells, sizeof(*s->seen[0]));
	s->seen[1] = calloc(s->n_cells, sizeof(*s->seen[1]));
	s->empty = malloc(4 * s->n_all);
	if (!s->cell || !s->seen[0] || !s->seen[1] || !s->empty || !make_walls(s, atlas)) {
		bb_cast_space_release(s);
		return false;
	}
	s->clear = s->empty + s->n_all;
	s->spare[0] = s->clear + s->n_all;
	s->spare[1] = s->spare[0] + s->n_all;
	return true;
}

static bool same_shape(const struct bb_atlas *a, const struct bb_atlas *b)
{
	return !memcmp(a->dim, b->dim, sizeof(a->dim)) && a->edge == b->edge && a->pad == b->pad &&
	       a->type == b->type && a->range == b->range && a->slot_generation == b->slot_generation;
}

/* ---- what can be seen ---- */

static void find_visible(struct bb_cast_space *s, const struct bb_transfer *tf)
{
	s->visible[BUCKETS] = BUCKETS;
	for (int b = BUCKETS; b-- > 0;) {
		const double from = (b * BUCKET - 1) / 65535.0, to = (b * BUCKET + BUCKET) / 65535.0;
		s->visible[b] = bb_transfer_most_opacity(tf, from, to) > 0 ? (uint16_t)b : s->visible[b + 1];
	}
}

static bool can_be_seen(const struct bb_cast_space *s, struct bb_atlas_range r)
{
	return s->visible[r.least / BUCKET] <= r.most / BUCKET;
}

/* The blocks of a brick (its own, of its level) that a block of a cell lies in. */
static void own_blocks(const struct bb_atlas *atlas, uint32_t cell, uint32_t up, uint32_t block, uint32_t *from,
		       uint32_t *to)
{
	const uint64_t first = (uint64_t)(cell & ((1U << up) - 1)) * atlas->edge + (uint64_t)block * BB_ATLAS_BLOCK;
	const uint64_t end = (uint64_t)block * BB_ATLAS_BLOCK + BB_ATLAS_BLOCK;
	const uint64_t width = (end < atlas->edge ? end : atlas->edge) - (uint64_t)block * BB_ATLAS_BLOCK;

	*from = (uint32_t)((first >> up) / BB_ATLAS_BLOCK);
	*to = (uint32_t)(((first + width - 1) >> up) / BB_ATLAS_BLOCK);
}

static void widen(struct bb_atlas_range *r, struct bb_atlas_range by)
{
	r->least = by.least < r->least ? by.least : r->least;
	r->most = by.most > r->most ? by.most : r->most;
}

static void widen_by_brick(const struct bb_atlas *atlas, int32_t slot, uint32_t up, const uint32_t at[3],
			   const uint32_t block[3], struct bb_atlas_range *r)
{
	const uint32_t n = atlas->blocks;
	const struct bb_atlas_range *all = atlas->range + (size_t)slot * n * n * n;
	uint32_t from[3], to[3];

	for (int a = 0; a < 3; a++)
		own_blocks(atlas, at[a], up, block[a], &from[a], &to[a]);
	for (uint32_t z = from[2]; z <= to[2]; z++)
		for (uint32_t y = from[1]; y <= to[1]; y++)
			for (uint32_t x = from[0]; x <= to[0]; x++)
				widen(r, all[(z * n + y) * n + x]);
}

static bool block_clear(const struct bb_cast_space *s, const struct bb_atlas *atlas, const struct bb_cast_cell *c,
			const uint32_t at[3], const uint32_t block[3])
{
	struct bb_atlas_range r = { 65535, 0 };

	for (uint32_t k = 0; k < atlas->n_shown; k++)
		if (c->slot[k] < 0)
			widen(&r, (struct bb_atlas_range){ (uint16_t)(c->value[k] * 65535),
							   (uint16_t)ceilf(c->value[k] * 65535) });
		else
			widen_by_brick(atlas, c->slot[k], c->up[k], at, block, &r);
	return !can_be_seen(s, r);
}

/* Returns whether nothing in the cell is clear. */
static bool fill_blocks(struct bb_cast_space *s, const struct bb_atlas *atlas, const struct bb_cast_cell *c,
			const uint32_t at[3])
{
	const uint32_t n = atlas->blocks;
	bool whole = true;
	uint32_t b[3];

	for (b[2] = 0; b[2] < n; b[2]++)
		for (b[1] = 0; b[1] < n; b[1]++)
			for (b[0] = 0; b[0] < n; b[0]++) {
				const bool clear = s->skipping && block_clear(s, atlas, c, at, b);
				const size_t z = at[2] * n + b[2], y = at[1] * n + b[1], x = at[0] * n + b[0];
				s->clear[(z * s->n_blocks[1] + y) * s->n_blocks[0] + x] = clear;
				whole = whole && !clear;
			}
	return whole;
}

struct sweep {
	struct bb_cast_space *s;
	const struct bb_atlas *atlas;
	bool all;
	uint8_t *changed; /* [grid z] */
};

static bool up_to_date(struct bb_cast_space *s, const struct bb_atlas *atlas, size_t i, struct bb_cast_cell *now)
{
	struct bb_cast_cell *c = &s->cell[i];
	bool same = true;

	for (uint32_t k = 0; k < atlas->n_shown; k++) {
		const struct bb_atlas_cell *m = &atlas->map[k][i];
		const uint64_t generation = m->slot >= 0 ? atlas->slot_generation[m->slot] : 0;
		now->slot[k] = m->slot;
		now->up[k] = (uint8_t)m->up;
		now->value[k] = m->slot < 0 ? m->value : 0;
		same = same && c->slot[k] == now->slot[k] && c->up[k] == now->up[k] && c->value[k] == now->value[k] &&
		       s->seen[k][i] == generation;
		s->seen[k][i] = generation;
	}
	return same;
}

static void sweep_slice(void *ctx, size_t z, unsigned thread)
{
	const struct sweep *w = ctx;
	const uint32_t *grid = w->atlas->grid;
	size_t i = z * grid[1] * grid[0];

	(void)thread;
	for (uint32_t y = 0; y < grid[1]; y++)
		for (uint32_t x = 0; x < grid[0]; x++, i++) {
			const uint32_t at[3] = { x, y, (uint32_t)z };
			struct bb_cast_cell now = w->s->cell[i];
			if (up_to_date(w->s, w->atlas, i, &now) && !w->all)
				continue;
			now.whole = fill_blocks(w->s, w->atlas, &now, at);
			w->s->cell[i] = now;
			w->changed[z] = 1;
		}
}

/* ---- what can be crossed in one go ---- */

static bool alike(const struct bb_cast_cell *a, const struct bb_cast_cell *b, uint32_t n_shown)
{
	for (uint32_t k = 0; k < n_shown; k++)
		if (a->slot[k] != b->slot[k] || (a->slot[k] < 0 ? a->value[k] != b->value[k] : a->up[k] != b->up[k]))
			return false;
	return true;
}

struct cube {
	uint32_t from[3], to[3];
};

static struct cube cube_at(const uint32_t grid[3], uint32_t x, uint32_t y, uint32_t z, uint32_t size)
{
	const uint32_t at[3] = { x, y, z };
	struct cube c;

	for (int a = 0; a < 3; a++) {
		c.from[a] = at[a];
		c.to[a] = at[a] + size < grid[a] ? at[a] + size : grid[a];
	}
	return c;
}

/* The eight parts of a cube, each the same all through (merge == level - 1), are they one? */
static void merge_cube(struct bb_cast_space *s, const uint32_t grid[3], struct cube q, uint32_t level, uint32_t n_shown)
{
	const uint32_t half = 1U << (level - 1);
	const struct bb_cast_cell *first = &s->cell[((size_t)q.from[2] * grid[1] + q.from[1]) * grid[0] + q.from[0]];

	for (uint32_t z = q.from[2]; z < q.to[2]; z += half)
		for (uint32_t y = q.from[1]; y < q.to[1]; y += half)
			for (uint32_t x = q.from[0]; x < q.to[0]; x += half) {
				const struct bb_cast_cell *c = &s->cell[((size_t)z * grid[1] + y) * grid[0] + x];
				if (c->merge != level - 1 || c->whole != first->whole || !alike(c, first, n_shown))
					return;
			}
	for (uint32_t z = q.from[2]; z < q.to[2]; z++)
		for (uint32_t y = q.from[1]; y < q.to[1]; y++)
			for (uint32_t x = q.from[0]; x < q.to[0]; x++)
				s->cell[((size_t)z * grid[1] + y) * grid[0] + x].merge = (uint8_t)level;
}

static void merge(struct bb_cast_space *s, const struct bb_atlas *atlas)
{
	const uint32_t *grid = atlas->grid;
	uint32_t most = 0;

	s->up_most = 0;
	for (size_t i = 0; i < s->n_cells; i++) {
		struct bb_cast_cell *c = &s->cell[i];
		c->merge = 0;
		for (uint32_t k = 0; k < atlas->n_shown; k++) {
			s->up_most = c->slot[k] >= 0 && c->up[k] > s->up_most ? c->up[k] : s->up_most;
			most = c->slot[k] < 0 ? BB_CAST_LEVELS : most;
		}
	}
	most = most > s->up_most ? most : s->up_most;
	for (uint32_t level = 1; level <= most; level++) {
		const uint32_t size = 1U << level;
		if (size / 2 >= grid[0] && size / 2 >= grid[1] && size / 2 >= grid[2])
			break;
		for (uint32_t z = 0; z < grid[2]; z += size)
			for (uint32_t y = 0; y < grid[1]; y += size)
				for (uint32_t x = 0; x < grid[0]; x += size)
					merge_cube(s, grid, cube_at(grid, x, y, z, size), level, atlas->n_shown);
	}
}

/* ---- leaps ---- */

/* A row is clear where those beside it are; what is outside the volume is. */
static void narrow_row(const uint8_t *in, uint8_t *out, uint32_t n)
{
	if (n < 2) {
		out[0] = in[0];
		return;
	}
	out[0] = in[0] & in[1];
	for (uint32_t i = 1; i + 1 < n; i++)
		out[i] = in[i - 1] & in[i] & in[i + 1];
	out[n - 1] = in[n - 2] & in[n - 1];
}

/* The same across rows that lie `stride` apart, `n` of them. */
static void narrow_across(const uint8_t *in, uint8_t *out, size_t stride, uint32_t n)
{
	for (uint32_t i = 0; i < n; i++) {
		const uint8_t *here = in + i * stride, *before = i ? here - stride : here;
		const uint8_t *behind = i + 1 < n ? here + stride : here;
		uint8_t *to = out + i * stride;
		for (size_t k = 0; k < stride; k++)
			to[k] = before[k] & here[k] & behind[k];
	}
}

/* Chebyshev's distance to what can be seen, in blocks: round after round, what touches it is taken away. */
static void find_leaps(struct bb_cast_space *s)
{
	const uint32_t *n = s->n_blocks;
	const size_t plane = (size_t)n[0] * n[1];
	uint8_t *a = s->spare[0], *b = s->spare[1];

	memcpy(s->empty, s->clear, s->n_all);
	memcpy(a, s->clear, s->n_all);
	for (int round = 1; round < BB_CAST_LEAP; round++) {
		uint8_t left = 0;
		for (size_t row = 0; row < (size_t)n[1] * n[2]; row++)
			narrow_row(a + row * n[0], b + row * n[0], n[0]);
		for (size_t z = 0; z < n[2]; z++)
			narrow_across(b + z * plane, a + z * plane, n[0], n[1]);
		narrow_across(a, b, plane, n[2]);
		for (size_t i = 0; i < s->n_all; i++) {
			s->empty[i] = (uint8_t)(s->empty[i] + b[i]);
			left |= b[i];
		}
		if (!left)
			return;
		uint8_t *swap = a;
		a = b;
		b = swap;
	}
}

static bool sweep(struct bb_cast_space *s, const struct bb_atlas *atlas, bool all, unsigned threads, bool *changed)
{
	uint8_t *slices = calloc(atlas->grid[2], 1);

	if (!slices)
		return false;
	bb_parallel(s->n_all < PARALLEL_LEAST ? 1 : threads, atlas->grid[2], sweep_slice,
		    &(struct sweep){ s, atlas, all, slices });
	*changed = memchr(slices, 1, atlas->grid[2]) != NULL;
	free(slices);
	return true;
}

bool bb_cast_space_update(struct bb_cast_space *s, const struct bb_atlas *atlas, const struct bb_transfer *tf,
			  bool tf_changed, bool skipping, unsigned threads)
{
	const struct bb_atlas *old = &s->atlas;
	const bool shape = s->made && same_shape(old, atlas);
	const bool all = !shape || tf_changed || skipping != s->skipping || old->n_shown != atlas->n_shown;
	bool changed;

	if (!all && old->generation == atlas->generation && old->map_generation == atlas->map_generation &&
	    old->map[0] == atlas->map[0] && old->map[1] == atlas->map[1])
		return true;
	if (!shape && !make(s, atlas))
		return false;
	if (!shape || tf_changed)
		find_visible(s, tf);
	s->skipping = skipping;
	s->made = false;
	if (!sweep(s, atlas, all, threads, &changed))
		return false;
	if (changed) {
		merge(s, atlas);
		find_leaps(s);
	}
	s->atlas = *atlas;
	s->made = true;
	return true;
}
