#include "render/gl/cells.h"

#include <string.h>

#define MARGIN 8 /* 65535ths: more than one entry of the table */
#define SHADE (65536 / BB_GL_SHADES)
#define PLACE_X_MOST 16
#define PLACE_MOST 512
#define ROW_BYTES 64 /* rows of a texture begin at multiples of this */
#define JUMP_MOST 4
#define ALL_PARTS UINT32_MAX

void bb_gl_sight_make(const struct bb_transfer *tf, struct bb_gl_sight *out)
{
	out->before[0] = 0;
	for (int i = 0; i < BB_GL_SHADES; i++) {
		const double least = (i * SHADE - MARGIN) / 65535.0, most = ((i + 1) * SHADE + MARGIN) / 65535.0;
		out->before[i + 1] = (uint16_t)(out->before[i] + (bb_transfer_most_opacity(tf, least, most) > 0));
	}
}

static bool seen(const struct bb_gl_sight *s, struct bb_atlas_range r)
{
	return s->before[r.most / SHADE + 1] > s->before[r.least / SHADE];
}

/* ---- where slots lie ---- */

bool bb_gl_layout_make(uint32_t n_slots, uint32_t stored, size_t voxel_bytes, uint32_t most, struct bb_gl_layout *out)
{
	const uint32_t n = n_slots ? n_slots : 1, along = most / stored < PLACE_MOST ? most / stored : PLACE_MOST;
	uint64_t best = UINT64_MAX;

	for (uint32_t x = 1; along && x <= PLACE_X_MOST && x <= along; x++) {
		const uint32_t columns = (n + along - 1) / along, y = (columns + x - 1) / x, z = (n + x * y - 1) / (x * y);
		const uint64_t row = (x * stored * voxel_bytes + ROW_BYTES - 1) / ROW_BYTES * ROW_BYTES, bytes = row * y * z;
		if (y > along || bytes >= best)
			continue;
		best = bytes;
		*out = (struct bb_gl_layout){ { x, y, z } };
	}
	return best < UINT64_MAX;
}

void bb_gl_layout_at(const struct bb_gl_layout *l, uint32_t slot, uint32_t at[3])
{
	const uint32_t column = slot / l->across[2];

	at[0] = column % l->across[0];
	at[1] = column / l->across[0];
	at[2] = slot % l->across[2];
}

/* ---- what of a cell can be seen ---- */

uint32_t bb_gl_parts(uint32_t edge)
{
	const uint32_t n = edge / BB_ATLAS_BLOCK;

	if (edge % BB_ATLAS_BLOCK || edge % (n < 4 ? n : 4))
		return 1;
	return n < 4 ? n : 4;
}

struct span { /* blocks of a brick along one axis */
	uint32_t from, to;
};

/* Those of a brick `up` levels above the leaves that a part of a cell of it needs. */
static struct span blocks_of(const struct bb_atlas *atlas, uint32_t cell, uint32_t up, uint32_t part, uint32_t parts)
{
	const uint32_t wide = atlas->edge / parts;
	const uint64_t from = (uint64_t)(cell & ((UINT32_C(1) << up) - 1)) * atlas->edge + (uint64_t)part * wide;

	return (struct span){ (uint32_t)(from >> up) / BB_ATLAS_BLOCK,
			      (uint32_t)((from + wide - 1) >> up) / BB_ATLAS_BLOCK };
}

static void widen(struct bb_atlas_range *r, struct bb_atlas_range by)
{
	r->least = by.least < r->least ? by.least : r->least;
	r->most = by.most > r->most ? by.most : r->most;
}

static void add_brick(const struct bb_atlas *atlas, const struct bb_atlas_cell *c, const uint32_t at[3],
		      const uint32_t part[3], uint32_t parts, struct bb_atlas_range *r)
{
	const uint32_t n = atlas->blocks;
	const struct bb_atlas_range *range = atlas->range + (size_t)c->slot * n * n * n;
	const struct span x = blocks_of(atlas, at[0], c->up, part[0], parts),
			  y = blocks_of(atlas, at[1], c->up, part[1], parts),
			  z = blocks_of(atlas, at[2], c->up, part[2], parts);

	for (uint32_t k = z.from; k <= z.to; k++)
		for (uint32_t j = y.from; j <= y.to; j++)
			for (uint32_t i = x.from; i <= x.to; i++)
				widen(r, range[((size_t)k * n + j) * n + i]);
}

static uint16_t whole(float value)
{
	return (uint16_t)(value > 0 ? (value < 1 ? value * 65535 : 65535) : 0);
}

/* Both maps together: between two steps values between theirs are met. */
static bool part_seen(const struct bb_atlas *atlas, const struct bb_gl_sight *sight, size_t cell, const uint32_t at[3],
		      const uint32_t part[3], uint32_t parts)
{
	struct bb_atlas_range r = { UINT16_MAX, 0 };

	for (uint32_t k = 0; k < atlas->n_shown; k++) {
		const struct bb_atlas_cell *c = &atlas->map[k][cell];
		if (c->slot >= 0) {
			add_brick(atlas, c, at, part, parts, &r);
			continue;
		}
		const uint16_t v = whole(c->value);
		widen(&r, (struct bb_atlas_range){ v, (uint16_t)(v + (v < UINT16_MAX)) });
	}
	return seen(sight, r);
}

static void see_parts(const struct bb_atlas *atlas, const struct bb_gl_sight *sight, size_t cell, const uint32_t at[3],
		      struct bb_gl_cell *out)
{
	const uint32_t parts = bb_gl_parts(atlas->edge);
	uint32_t part[3], n = 0;
	uint64_t mask = 0;

	for (part[2] = 0; part[2] < parts; part[2]++)
		for (part[1] = 0; part[1] < parts; part[1]++)
			for (part[0] = 0; part[0] < parts; part[0]++)
				if (part_seen(atlas, sight, cell, at, part, parts)) {
					mask |= UINT64_C(1) << (part[0] + 4 * part[1] + 16 * part[2]);
					n++;
				}
	if (n == 0) { /* so that all that shows nothing is alike */
		memset(out, 0, sizeof(*out));
	} else if (n == parts * parts * parts) {
		out->word[2] = out->word[3] = ALL_PARTS;
	} else {
		out->word[0] = (out->word[0] & ~UINT32_C(15)) | BB_GL_CELL_PARTLY;
		out->word[2] = (uint32_t)mask;
		out->word[3] = (uint32_t)(mask >> 32);
	}
}

static uint32_t place_word(const struct bb_gl_layout *l, const struct bb_atlas_cell *c)
{
	uint32_t at[3], bits;

	if (c->slot < 0) {
		memcpy(&bits, &(float){ c->value > 0 ? (c->value < 1 ? c->value : 1) : 0 }, sizeof(bits));
		return UINT32_C(1) << 31 | (bits & ~UINT32_C(15));
	}
	bb_gl_layout_at(l, (uint32_t)c->slot, at);
	return c->up << 4 | at[0] << 9 | at[1] << 13 | at[2] << 22;
}

/* ---- how far a ray may go ---- */

static bool alike(const struct bb_gl_cell *a, const struct bb_gl_cell *b)
{
	return !memcmp(a, b, sizeof(*a)) && (a->word[0] & 15) != BB_GL_CELL_PARTLY;
}

static uint32_t end_of(uint32_t from, uint32_t wide, uint32_t most)
{
	return from + wide < most ? from + wide : most;
}

/* The cells of a cube of 2^k cells, of which cubes half as wide are done; what lies outside the volume is like anything. */
static void join(const uint32_t n[3], const uint32_t from[3], uint32_t k, struct bb_gl_cell *cells)
{
	const uint32_t wide = UINT32_C(1) << k, half = wide / 2;
	const struct bb_gl_cell *first = &cells[((size_t)from[2] * n[1] + from[1]) * n[0] + from[0]];
	const uint32_t to[3] = { end_of(from[0], wide, n[0]), end_of(from[1], wide, n[1]), end_of(from[2], wide, n[2]) };

	if ((first->word[0] & 15) != k - 1)
		return;
	for (uint32_t z = from[2]; z < to[2]; z += half)
		for (uint32_t y = from[1]; y < to[1]; y += half)
			for (uint32_t x = from[0]; x < to[0]; x += half)
				if (!alike(&cells[((size_t)z * n[1] + y) * n[0] + x], first))
					return;
	for (uint32_t z = from[2]; z < to[2]; z++)
		for (uint32_t y = from[1]; y < to[1]; y++)
			for (uint32_t x = from[0]; x < to[0]; x++)
				cells[((size_t)z * n[1] + y) * n[0] + x].word[0] += 1;
}

void bb_gl_cells_fill(const struct bb_atlas *atlas, const struct bb_gl_layout *l, const struct bb_gl_sight *sight,
		      struct bb_gl_cell *out)
{
	const uint32_t *n = atlas->grid;
	uint32_t at[3];
	size_t i = 0;

	for (at[2] = 0; at[2] < n[2]; at[2]++)
		for (at[1] = 0; at[1] < n[1]; at[1]++)
			for (at[0] = 0; at[0] < n[0]; at[0]++, i++) {
				out[i].word[0] = place_word(l, &atlas->map[0][i]);
				out[i].word[1] = place_word(l, &atlas->map[atlas->n_shown > 1][i]);
				see_parts(atlas, sight, i, at, &out[i]);
			}
	for (uint32_t k = 1; k <= JUMP_MOST; k++)
		for (at[2] = 0; at[2] < n[2]; at[2] += UINT32_C(1) << k)
			for (at[1] = 0; at[1] < n[1]; at[1] += UINT32_C(1) << k)
				for (at[0] = 0; at[0] < n[0]; at[0] += UINT32_C(1) << k)
					join(n, at, k, out);
}
