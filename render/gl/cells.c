#include "render/gl/cells.h"

#include <string.h>

#define MARGIN 8 /* 65535ths: more than one entry of the table */
#define SHADE 16 /* 65536 / SHADES */
#define ACROSS_MOST 8
#define ROW_BYTES 64 /* rows of a texture begin at multiples of this */
#define JUMP_MOST 15

_Static_assert(SHADE * BB_GL_SHADES == 65536, "shades are all of a range");

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

/* As few slots beside each other as keep the rows' ends from being more than 0.8 of the rows: what lies between two planes
 * of a brick costs a processor's cache more than what is left over does. */
bool bb_gl_layout_make(uint32_t n_slots, uint32_t stored, size_t voxel_bytes, uint32_t most, struct bb_gl_layout *out)
{
	const uint32_t n = n_slots ? n_slots : 1, along = most / stored;

	if (!along)
		return false;
	for (uint32_t x = 1; x <= ACROSS_MOST && x <= along; x++) {
		const size_t row = x * stored * voxel_bytes, whole = (row + ROW_BYTES - 1) / ROW_BYTES * ROW_BYTES;
		const uint32_t columns = (n - 1) / along + 1, y = (columns - 1) / x + 1;
		if ((whole * 10 > row * 18 && x < ACROSS_MOST && x < n) || (y > along && x < ACROSS_MOST && x < along))
			continue;
		*out = (struct bb_gl_layout){ { x, y, (n - 1) / (x * y) + 1 } };
		return y <= along;
	}
	return false;
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

static uint64_t parts_seen(const struct bb_atlas *atlas, const struct bb_gl_sight *sight, size_t cell, const uint32_t at[3],
			   uint32_t parts)
{
	uint32_t part[3];
	uint64_t mask = 0;

	for (part[2] = 0; part[2] < parts; part[2]++)
		for (part[1] = 0; part[1] < parts; part[1]++)
			for (part[0] = 0; part[0] < parts; part[0]++)
				if (part_seen(atlas, sight, cell, at, part, parts))
					mask |= UINT64_C(1) << (part[0] + 4 * part[1] + 16 * part[2]);
	return mask;
}

/* ---- a cell ---- */

static struct bb_gl_place place_of(const struct bb_atlas *atlas, const struct bb_gl_layout *l, const double texel[3],
				   const struct bb_atlas_cell *c, const uint32_t at[3])
{
	const double shrink = 1.0 / (double)(UINT32_C(1) << c->up);
	struct bb_gl_place out = { .shrink = (float)shrink };
	uint32_t slot[3];

	if (c->slot < 0)
		return (struct bb_gl_place){ { c->value > 0 ? (c->value < 1 ? c->value : 1) : 0, 0, 0 }, 0 };
	bb_gl_layout_at(l, (uint32_t)c->slot, slot);
	for (int a = 0; a < 3; a++)
		out.at[a] = (float)(((double)slot[a] * atlas->stored - (double)(at[a] >> c->up) * atlas->edge + atlas->pad) *
				    texel[a]);
	return out;
}

static uint64_t all_parts(uint32_t parts)
{
	const uint64_t row = (UINT64_C(1) << parts) - 1;
	uint64_t plane = 0, all = 0;

	for (uint32_t i = 0; i < parts; i++)
		plane |= row << 4 * i;
	for (uint32_t i = 0; i < parts; i++)
		all |= plane << 16 * i;
	return all;
}

/* Of the finer one of the bricks; cells of one value have none. */
static uint32_t up_of(const struct bb_atlas_cell *a, const struct bb_atlas_cell *b)
{
	if (a->slot < 0)
		return b->slot < 0 ? 0 : b->up;
	return b->slot < 0 || a->up < b->up ? a->up : b->up;
}

static void fill_cell(const struct bb_atlas *atlas, const struct bb_gl_layout *l, const double texel[3],
		      const struct bb_gl_sight *sight, size_t i, const uint32_t at[3], struct bb_gl_cells *out)
{
	const uint32_t parts = bb_gl_parts(atlas->edge);
	const struct bb_atlas_cell *a = &atlas->map[0][i], *b = &atlas->map[atlas->n_shown > 1][i];
	const uint32_t up = up_of(a, b);
	const uint64_t mask = parts_seen(atlas, sight, i, at, parts);

	out->sign[i] = (struct bb_gl_sign){ .parts = { (uint32_t)mask, (uint32_t)(mask >> 32) } };
	out->place[0][i] = place_of(atlas, l, texel, a, at);
	out->place[1][i] = atlas->n_shown > 1 ? place_of(atlas, l, texel, b, at) : (struct bb_gl_place){ .shrink = 0 };
	if (!mask)
		return;
	out->any_flat |= a->slot < 0 || b->slot < 0;
	out->sign[i].word = up << 4 | BB_GL_SIGN_SEEN | (mask == all_parts(parts) ? 0 : BB_GL_SIGN_PARTLY) |
			    (a->slot < 0 && b->slot < 0 ? BB_GL_SIGN_FLAT : 0);
}

/* ---- how far a ray may go ---- */

struct joining {
	const struct bb_gl_cells *cells;
	const uint32_t *n;
};

static size_t index_of(const struct joining *j, uint32_t x, uint32_t y, uint32_t z)
{
	return ((size_t)z * j->n[1] + y) * j->n[0] + x;
}

static bool same_level(const struct bb_gl_place *a, const struct bb_gl_place *b)
{
	return a->shrink == b->shrink && (a->shrink > 0 || a->at[0] == b->at[0]);
}

/* Cells that show nothing are alike, and so are cells of bricks of one level, whichever they are: a brick's padding knows
 * its neighbours of the same level. Of one value: those of the same. */
static bool alike(const struct joining *j, size_t a, size_t b)
{
	const struct bb_gl_cells *c = j->cells;

	return c->sign[a].word == c->sign[b].word &&
	       (!(c->sign[a].word & BB_GL_SIGN_SEEN) ||
		(same_level(&c->place[0][a], &c->place[0][b]) && same_level(&c->place[1][a], &c->place[1][b])));
}

static uint32_t end_of(uint32_t from, uint32_t wide, uint32_t most)
{
	return from + wide < most ? from + wide : most;
}

/* The cells of a cube of 2^k cells, of which cubes half as wide are done; what lies outside the volume is like anything. */
static void join(const struct joining *j, const uint32_t from[3], uint32_t k)
{
	const uint32_t wide = UINT32_C(1) << k, half = wide / 2, *n = j->n;
	const size_t first = index_of(j, from[0], from[1], from[2]);
	const uint32_t to[3] = { end_of(from[0], wide, n[0]), end_of(from[1], wide, n[1]), end_of(from[2], wide, n[2]) };

	if ((j->cells->sign[first].word & 15) != k - 1 || j->cells->sign[first].word & BB_GL_SIGN_PARTLY)
		return;
	for (uint32_t z = from[2]; z < to[2]; z += half)
		for (uint32_t y = from[1]; y < to[1]; y += half)
			for (uint32_t x = from[0]; x < to[0]; x += half)
				if (!alike(j, index_of(j, x, y, z), first))
					return;
	for (uint32_t z = from[2]; z < to[2]; z++)
		for (uint32_t y = from[1]; y < to[1]; y++)
			for (uint32_t x = from[0]; x < to[0]; x++)
				j->cells->sign[index_of(j, x, y, z)].word += 1;
}

void bb_gl_cells_fill(const struct bb_atlas *atlas, const struct bb_gl_layout *l, const double texel[3],
		      const struct bb_gl_sight *sight, struct bb_gl_cells *out)
{
	const uint32_t *n = atlas->grid, xy = n[0] > n[1] ? n[0] : n[1], most = xy > n[2] ? xy : n[2];
	const struct joining j = { out, n };
	uint32_t at[3];
	size_t i = 0;

	out->any_flat = false;
	for (at[2] = 0; at[2] < n[2]; at[2]++)
		for (at[1] = 0; at[1] < n[1]; at[1]++)
			for (at[0] = 0; at[0] < n[0]; at[0]++)
				fill_cell(atlas, l, texel, sight, i++, at, out);
	for (uint32_t k = 1; k <= JUMP_MOST && UINT32_C(1) << (k - 1) < most; k++)
		for (at[2] = 0; at[2] < n[2]; at[2] += UINT32_C(1) << k)
			for (at[1] = 0; at[1] < n[1]; at[1] += UINT32_C(1) << k)
				for (at[0] = 0; at[0] < n[0]; at[0] += UINT32_C(1) << k)
					join(&j, at, k);
}
