/*
 * render/stream/atlas.c: bricks cut out of the volume with a border of true neighbours, and the coarse copy. At the
 * volume's faces the border repeats the last voxel, which is what clamped sampling of the whole volume would see.
 */
#include "render/stream/stream_private.h"

#include <string.h>

static uint32_t clamp(int64_t i, uint32_t n)
{
	return i < 0 ? 0 : i >= n ? n - 1 : (uint32_t)i;
}

/* 18 voxels from x0 - 1 on, clamped. */
static void fill_row(const uint16_t *row, uint32_t n, uint32_t x0, uint16_t *out)
{
	uint32_t whole = n - x0 < BB_BRICK_EDGE + 1 ? n - x0 : BB_BRICK_EDGE + 1;

	out[0] = row[x0 ? x0 - 1 : 0];
	memcpy(out + 1, row + x0, whole * sizeof(*row));
	for (; whole < BB_BRICK_EDGE + 1; whole++)
		out[1 + whole] = row[n - 1];
}

void bb_brick_fill(const struct bb_volume *v, uint32_t step, const uint32_t brick[3], uint16_t *out)
{
	const size_t plane = (size_t)v->dim[0] * v->dim[1];
	const uint16_t *voxels = v->voxels + (size_t)step * plane * v->dim[2];

	for (int64_t z = 0; z < BB_BRICK_STORED; z++) {
		const size_t zi = clamp((int64_t)brick[2] * BB_BRICK_EDGE + z - 1, v->dim[2]);
		for (int64_t y = 0; y < BB_BRICK_STORED; y++) {
			const size_t yi = clamp((int64_t)brick[1] * BB_BRICK_EDGE + y - 1, v->dim[1]);
			fill_row(voxels + zi * plane + yi * v->dim[0], v->dim[0], brick[0] * BB_BRICK_EDGE, out);
			out += BB_BRICK_STORED;
		}
	}
}

void bb_brick_range(const uint16_t *brick, uint16_t *least, uint16_t *most)
{
	uint16_t lo = brick[0], hi = brick[0];

	for (size_t i = 1; i < BB_BRICK_VOXELS; i++) {
		lo = brick[i] < lo ? brick[i] : lo;
		hi = brick[i] > hi ? brick[i] : hi;
	}
	*least = lo;
	*most = hi;
}

/* Mean of the factor^3 voxels from c * factor on, of those that exist; rounded to nearest. */
static uint16_t box_mean(const struct bb_volume *v, uint32_t step, const uint32_t c[3])
{
	uint32_t from[3], to[3], n = 0, sum = 0;

	for (int a = 0; a < 3; a++) {
		from[a] = c[a] * BB_COARSE_FACTOR;
		to[a] = from[a] + BB_COARSE_FACTOR < v->dim[a] ? from[a] + BB_COARSE_FACTOR : v->dim[a];
	}
	for (uint32_t z = from[2]; z < to[2]; z++)
		for (uint32_t y = from[1]; y < to[1]; y++) {
			const size_t row = (((size_t)step * v->dim[2] + z) * v->dim[1] + y) * v->dim[0];
			for (uint32_t x = from[0]; x < to[0]; x++, n++)
				sum += v->voxels[row + x];
		}
	return n ? (uint16_t)((sum + n / 2) / n) : 0;
}

void bb_coarse_fill(const struct bb_volume *v, const uint32_t dim[3], uint16_t *out)
{
	uint32_t c[3];

	for (uint32_t step = 0; step < v->n_steps; step++)
		for (c[2] = 0; c[2] < dim[2]; c[2]++)
			for (c[1] = 0; c[1] < dim[1]; c[1]++)
				for (c[0] = 0; c[0] < dim[0]; c[0]++)
					*out++ = box_mean(v, step, c);
}

void bb_stream_read(const struct bb_stream *s, struct bb_load load)
{
	const uint32_t *grid = s->atlas.grid, b = load.gid % s->n_bricks;
	const uint32_t brick[3] = { b % grid[0], b / grid[0] % grid[1], b / grid[0] / grid[1] };

	bb_brick_fill(s->config.volume, load.gid / s->n_bricks, brick, s->bricks + (size_t)load.slot * BB_BRICK_VOXELS);
}
