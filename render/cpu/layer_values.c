/*
 * render/cpu/layer_values.c: the value of an atlas at one point, and how bricks of different levels are joined.
 *
 * Each level's bricks make one continuous function, for their padding has true neighbours; it is known half a voxel of
 * that level beyond the level's own cells. A level's share is 1 in its own cells and falls to 0 over that half voxel
 * (at most half a cell); the coarsest level lies on top of the next finer one, and so on down to the point's own:
 * shares and functions are continuous, so what is put together is, at faces, edges and corners alike. A cell farther
 * away than half a cell does not matter: seven neighbours at most. Flat cells come on top of the bricks of their level.
 */
#include <math.h>
#include <string.h>

#include "render/cpu/layers.h"
#include "render/half.h"

#define FLAT_LAST 1 /* in a rank: twice the level, and this when the cell is flat */

/* No NaN here; the library's calls would take longer than the rest. */
static double least_of(double a, double b)
{
	return a < b ? a : b;
}

static double most_of(double a, double b)
{
	return a > b ? a : b;
}

struct spot { /* a point, and the cell it lies in */
	double at[3];
	int64_t cell[3];
	double to_face[3]; /* voxels to the nearer face of each axis */
	int side[3];       /* where that is: -1, 1 */
};

struct share {
	uint32_t rank;
	double part; /* 1: nothing of what lies below is seen */
	const struct bb_atlas_cell *entry;
	int64_t cell[3];
	double at[3]; /* the point, as this cell's brick counts it */
};

bool bb_layer_around(const struct bb_atlas *atlas)
{
	struct bb_spherical s;

	if (atlas->kind != BB_BRICK_SPHERICAL)
		return false;
	bb_spherical_of(atlas->dim, atlas->extent, &s);
	return s.around;
}

static double voxel(const struct bb_atlas *atlas, const uint8_t *brick, size_t i)
{
	uint16_t wide;
	float v;

	switch (atlas->type) {
	case BB_BRICK_U8:
		return brick[i] * (double)atlas->scale;
	case BB_BRICK_U16:
		memcpy(&wide, brick + 2 * i, 2);
		return wide * (double)atlas->scale;
	case BB_BRICK_F16:
		memcpy(&wide, brick + 2 * i, 2);
		return (double)bb_from_half(wide);
	case BB_BRICK_F32:
	case BB_BRICK_TYPES:
	default:
		memcpy(&v, brick + 4 * i, 4);
		return (double)v;
	}
}

static double trilinear(const struct bb_atlas *atlas, const uint8_t *brick, const double p[3])
{
	const size_t n = atlas->stored;
	double f[3], plane[2];
	size_t i[3];

	for (int a = 0; a < 3; a++) {
		const double most = atlas->stored - 1.25, inside = p[a] > 0 ? (p[a] < most ? p[a] : most) : 0;
		i[a] = (size_t)inside;
		f[a] = inside - (double)i[a];
	}
	for (size_t z = 0; z < 2; z++) {
		double row[2];
		for (size_t y = 0; y < 2; y++) {
			const size_t at = ((i[2] + z) * n + i[1] + y) * n + i[0];
			const double v0 = voxel(atlas, brick, at), v1 = voxel(atlas, brick, at + 1);
			row[y] = v0 + (v1 - v0) * f[0];
		}
		plane[z] = row[0] + (row[1] - row[0]) * f[1];
	}
	return plane[0] + (plane[1] - plane[0]) * f[2];
}

/* The value that the brick of a cell has at a point, which may lie a little beside the cell. */
static double value_by(const struct bb_atlas *atlas, const struct bb_atlas_cell *entry, const int64_t cell[3],
		       const double at[3])
{
	const double per_leaf = 1.0 / (double)(1U << entry->up);
	double p[3];

	if (entry->slot < 0)
		return (double)entry->value;
	for (int a = 0; a < 3; a++)
		p[a] = at[a] * per_leaf - (double)((cell[a] >> entry->up) * atlas->edge) + atlas->pad - 0.5;
	return trilinear(atlas, atlas->bricks + (size_t)entry->slot * atlas->slot_bytes, p);
}

static size_t index_of(const struct bb_atlas *atlas, const int64_t cell[3])
{
	return (size_t)((cell[2] * atlas->grid[1] + cell[1]) * atlas->grid[0] + cell[0]);
}

static uint32_t rank_of(const struct bb_atlas_cell *entry)
{
	return 2 * entry->up + (entry->slot < 0 ? FLAT_LAST : 0);
}

/* How far into finer cells a level reaches, in voxels of the leaves. */
static double reach_of(const struct bb_atlas *atlas, uint32_t up)
{
	return least_of((double)(1U << up) / 2, atlas->edge / 2.0);
}

static struct spot spot_at(const struct bb_atlas *atlas, const double at[3], bool around)
{
	struct spot s;

	for (int a = 0; a < 3; a++) {
		const double edge = atlas->edge, cell = floor(at[a] / edge), last = atlas->grid[a] - 1.0;
		const double low = least_of(most_of(cell, 0), last) * edge, high = a == 2 && around ? least_of(low + edge, atlas->dim[2])
											     : low + edge;
		s.at[a] = at[a];
		s.cell[a] = (int64_t)(low / edge);
		s.side[a] = at[a] - low < high - at[a] ? -1 : 1;
		s.to_face[a] = most_of(0, s.side[a] < 0 ? at[a] - low : high - at[a]);
	}
	return s;
}

/* The neighbour of a spot's cell across the faces in `across` (bits); false: there is none. */
static bool neighbour(const struct bb_atlas *atlas, const struct spot *s, unsigned across, bool around, struct share *out)
{
	for (int a = 0; a < 3; a++) {
		int64_t c = s->cell[a] + (across >> a & 1 ? s->side[a] : 0);
		out->at[a] = s->at[a];
		if (a == 2 && around && (c < 0 || c >= atlas->grid[2])) {
			out->at[2] += c < 0 ? (double)atlas->dim[2] : -(double)atlas->dim[2];
			c = c < 0 ? atlas->grid[2] - 1 : 0;
		}
		if (c < 0 || c >= atlas->grid[a])
			return false;
		out->cell[a] = c;
	}
	return true;
}

/* Neighbours that lie on top of the spot's own cell, and how far they cover it; lowest first. */
static unsigned shares_of(const struct bb_atlas *atlas, const struct bb_atlas_cell *map, const struct spot *s,
			  double reach_most, bool around, struct share out[7])
{
	const uint32_t own = rank_of(&map[index_of(atlas, s->cell)]);
	unsigned n = 0, out_of_reach = 0;

	for (int a = 0; a < 3; a++)
		out_of_reach |= s->to_face[a] < reach_most ? 0 : 1U << a;

	for (unsigned across = 1; across < 8; across++) {
		struct share k;
		if (across & out_of_reach || !neighbour(atlas, s, across, around, &k))
			continue;
		k.entry = &map[index_of(atlas, k.cell)];
		k.rank = rank_of(k.entry);
		const double reach = reach_of(atlas, k.entry->up);
		k.part = 1;
		for (int a = 0; a < 3; a++)
			if (across >> a & 1)
				k.part *= most_of(0, 1 - s->to_face[a] / reach);
		if (k.part <= 0 || k.rank < own || (k.rank == own && k.entry->slot >= 0))
			continue;
		unsigned i = n++;
		for (; i > 0 && out[i - 1].rank > k.rank; i--)
			out[i] = out[i - 1];
		out[i] = k;
	}
	return n;
}

/* All of one rank: bricks are one function, taken from the nearest; flat cells are weighed against each other. */
static double put_over(const struct bb_atlas *atlas, const struct share *k, unsigned n, bool own, double below)
{
	double most = 0, sum = own ? below : 0, parts = own ? 1 : 0;
	unsigned best = 0;

	for (unsigned i = 0; i < n; i++) {
		best = k[i].part > k[best].part ? i : best;
		most = most_of(most, k[i].part);
		sum += k[i].part * (double)k[i].entry->value;
		parts += k[i].part;
	}
	const double value = k[0].entry->slot < 0 ? sum / parts : value_by(atlas, k[best].entry, k[best].cell, k[best].at);
	return own ? value : below + (value - below) * most;
}

static double map_value(const struct bb_atlas *atlas, unsigned shown, const double at[3], double reach, bool around)
{
	const struct spot s = spot_at(atlas, at, around);
	const struct bb_atlas_cell *map = atlas->map[shown], *entry = &map[index_of(atlas, s.cell)];
	double value = value_by(atlas, entry, s.cell, s.at);
	struct share k[7];

	if (!(reach > 0))
		return value;
	const unsigned n = shares_of(atlas, map, &s, reach, around, k);
	for (unsigned i = 0, end; i < n; i = end) {
		for (end = i + 1; end < n && k[end].rank == k[i].rank; end++)
			;
		value = put_over(atlas, k + i, end - i, k[i].rank == rank_of(entry), value);
	}
	return value;
}

double bb_layer_value_within(const struct bb_atlas *atlas, const double at[3], double reach)
{
	const bool around = bb_layer_around(atlas);
	const double first = map_value(atlas, 0, at, reach, around);

	if (atlas->n_shown < 2)
		return first;
	return first + (map_value(atlas, 1, at, reach, around) - first) * (double)atlas->mix;
}

double bb_layer_value(const struct bb_atlas *atlas, const double at[3], bool blend)
{
	return bb_layer_value_within(atlas, at, blend ? HUGE_VAL : 0);
}

/* ---- which cells are concerned ---- */

static void add_seam(const struct bb_atlas *atlas, const struct bb_atlas_cell *map, const int64_t cell[3], bool around,
		     struct bb_layer_seam *seam)
{
	const uint32_t own = rank_of(&map[index_of(atlas, cell)]);

	for (int i = 0; i < 27; i++) {
		const int off[3] = { i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1 };
		int64_t c[3] = { cell[0] + off[0], cell[1] + off[1], cell[2] + off[2] };
		if (around)
			c[2] = (c[2] + atlas->grid[2]) % atlas->grid[2];
		bool there = i != 13;
		for (int a = 0; a < 3; a++)
			there &= c[a] >= 0 && c[a] < atlas->grid[a];
		const struct bb_atlas_cell *e = there ? &map[index_of(atlas, c)] : NULL;
		if (!e || rank_of(e) < own || (rank_of(e) == own && e->slot >= 0))
			continue;
		seam->up_most = (uint8_t)(e->up + 1 > seam->up_most ? e->up + 1 : seam->up_most);
		for (int a = 0; a < 3; a++)
			seam->sides |= (uint8_t)(off[a] ? 1 << (2 * a + (off[a] > 0)) : 0);
	}
}

void bb_layer_seams(const struct bb_atlas *atlas, uint32_t plane, struct bb_layer_seam *seam)
{
	const bool around = bb_layer_around(atlas);

	for (uint32_t y = 0; y < atlas->grid[1]; y++)
		for (uint32_t x = 0; x < atlas->grid[0]; x++, seam++) {
			const int64_t c[3] = { x, y, plane };
			*seam = (struct bb_layer_seam){ 0, 0 };
			for (unsigned shown = 0; shown < atlas->n_shown; shown++)
				add_seam(atlas, atlas->map[shown], c, around, seam);
		}
}
