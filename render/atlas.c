#include "render/atlas.h"

#include <math.h>
#include <string.h>

#include "render/bricks/values.h"
#include "render/half.h"

void bb_atlas_describe(struct bb_atlas *atlas, const struct bb_bricks_header *h)
{
	const uint32_t last = h->tree.n_levels - 1;
	const double range = h->most - h->least;

	atlas->n_steps = h->tree.n_steps;
	atlas->edge = h->tree.edge;
	atlas->pad = h->pad;
	atlas->stored = h->tree.edge + 2 * h->pad;
	atlas->type = h->type;
	atlas->kind = h->grid;
	atlas->slot_bytes = bb_bricks_brick_bytes(h);
	atlas->blocks = (h->tree.edge + BB_ATLAS_BLOCK - 1) / BB_ATLAS_BLOCK;
	memcpy(atlas->dim, h->tree.dim, sizeof(atlas->dim));
	memcpy(atlas->grid, h->tree.grid[last], sizeof(atlas->grid));
	memcpy(atlas->extent, h->extent, sizeof(atlas->extent));
	atlas->scale = h->type == BB_BRICK_U8 ? 1 / 255.0F : h->type == BB_BRICK_U16 ? 1 / 65535.0F : 1;
	atlas->least = (float)h->least;
	atlas->parts = range > 0 ? (float)(1 / range) : 0;
}

size_t bb_atlas_slack_bytes(const struct bb_atlas *atlas)
{
	return ((size_t)atlas->stored * atlas->stored + atlas->stored) * bb_brick_type_bytes(atlas->type) + 64;
}

/* ---- what has come ---- */

/* Whole numbers have no values out of range; their ranges are exact. */
#define RANGE_OF(name, type)                                                                                       \
	static void name(const type *v, uint32_t stored, uint32_t n[3], type *least, type *most)                    \
	{                                                                                                            \
		type lo = v[0], hi = v[0];                                                                          \
		for (uint32_t z = 0; z < n[2]; z++)                                                                 \
			for (uint32_t y = 0; y < n[1]; y++) {                                                       \
				const type *row = v + ((size_t)z * stored + y) * stored;                            \
				for (uint32_t x = 0; x < n[0]; x++) {                                               \
					lo = row[x] < lo ? row[x] : lo;                                             \
					hi = row[x] > hi ? row[x] : hi;                                             \
				}                                                                                   \
			}                                                                                           \
		*least = lo;                                                                                        \
		*most = hi;                                                                                         \
	}
RANGE_OF(range_u8, uint8_t)
RANGE_OF(range_u16, uint16_t)
RANGE_OF(range_f32, float)

static struct bb_atlas_range range_at(const struct bb_atlas *atlas, const uint8_t *first, uint32_t n[3])
{
	struct bb_atlas_range r;
	uint16_t low, high;
	uint8_t low8, high8;
	float low32, high32;

	switch (atlas->type) {
	case BB_BRICK_U8:
		range_u8(first, atlas->stored, n, &low8, &high8);
		return (struct bb_atlas_range){ (uint16_t)(low8 * 257), (uint16_t)(high8 * 257) };
	case BB_BRICK_U16:
		range_u16((const uint16_t *)(const void *)first, atlas->stored, n, &r.least, &r.most);
		return r;
	case BB_BRICK_F16: /* not negative: their bits are in their order */
		range_u16((const uint16_t *)(const void *)first, atlas->stored, n, &low, &high);
		low32 = bb_from_half(low);
		high32 = bb_from_half(high);
		break;
	case BB_BRICK_F32:
	case BB_BRICK_TYPES:
	default:
		range_f32((const float *)(const void *)first, atlas->stored, n, &low32, &high32);
	}
	return (struct bb_atlas_range){ (uint16_t)(low32 * 65535), (uint16_t)ceilf(high32 * 65535) };
}

static size_t accept_halves(uint16_t *v, size_t n)
{
	size_t odd = 0;

	for (size_t i = 0; i < n; i++) {
		if (v[i] <= 0x3C00) /* 1 */
			continue;
		v[i] = v[i] & 0x8000 || v[i] > 0x7C00 ? 0 : 0x3C00;
		odd++;
	}
	return odd;
}

static size_t accept_floats(const struct bb_atlas *atlas, float *v, size_t n)
{
	const float least = atlas->least, parts = atlas->parts;
	size_t odd = 0;

	for (size_t i = 0; i < n; i++) {
		const float part = (v[i] - least) * parts;
		odd += !(part >= 0 && part <= 1 + 1e-6F);
		v[i] = part >= 0 ? (part <= 1 ? part : 1) : 0;
	}
	return odd;
}

/* A block reaches from the voxel before its first to the one behind its last, as far as any is stored. */
static void reach(const struct bb_atlas *atlas, uint32_t block, uint32_t *from, uint32_t *n)
{
	const uint32_t first = block * BB_ATLAS_BLOCK + atlas->pad - 1, end = first + BB_ATLAS_BLOCK + 2;

	*from = first;
	*n = (end < atlas->stored ? end : atlas->stored) - first;
}

size_t bb_atlas_accept(const struct bb_atlas *atlas, uint8_t *brick, struct bb_atlas_range *out)
{
	const size_t n_voxels = (size_t)atlas->stored * atlas->stored * atlas->stored;
	uint32_t from[3], n[3];
	size_t odd = 0;

	if (atlas->type == BB_BRICK_F16)
		odd = accept_halves((uint16_t *)(void *)brick, n_voxels);
	if (atlas->type == BB_BRICK_F32)
		odd = accept_floats(atlas, (float *)(void *)brick, n_voxels);
	for (uint32_t z = 0; z < atlas->blocks; z++)
		for (uint32_t y = 0; y < atlas->blocks; y++)
			for (uint32_t x = 0; x < atlas->blocks; x++) {
				reach(atlas, x, &from[0], &n[0]);
				reach(atlas, y, &from[1], &n[1]);
				reach(atlas, z, &from[2], &n[2]);
				const size_t at = ((size_t)from[2] * atlas->stored + from[1]) * atlas->stored + from[0];
				*out++ = range_at(atlas, brick + at * bb_brick_type_bytes(atlas->type), n);
			}
	return odd;
}
