#include "render/bricks/build_private.h"

#include <string.h>

#define SAMPLES_MOST 4096 /* of a brick and a step: of data that are quiet but for a front, fewer tell its size badly */

struct bb_build_brick bb_build_brick_at(const struct bb_build *b, uint32_t i)
{
	const struct bb_tree *t = &b->h.tree;
	const uint32_t *grid = t->grid[b->level], *v = t->voxels[b->level];
	const uint32_t at[3] = { i % grid[0], b->y + i / grid[0], b->z };
	struct bb_build_brick k = { .here = (at[2] * grid[1] + at[1]) * grid[0] + at[0], .at = i };

	for (int a = 0; a < 3; a++) {
		k.from[a] = at[a] * t->edge;
		k.to[a] = k.from[a] + t->edge < v[a] ? k.from[a] + t->edge : v[a];
	}
	return k;
}

static uint32_t spread(uint32_t h) /* a finaliser of MurmurHash3's kind: all bits of h in all of the result */
{
	h = (h ^ h >> 16) * 0x7FEB352Du;
	h = (h ^ h >> 15) * 0x846CA68Bu;
	return h ^ h >> 16;
}

/* Which voxel of a cell stands for it: any, but always the same. */
static bool sample_of(const struct bb_build *b, const uint32_t cell[3], uint32_t at[3])
{
	uint32_t h = 1;

	for (int a = 0; a < 3; a++) {
		h = spread(h + cell[a]);
		at[a] = cell[a] * b->cell + h % b->cell;
		if (at[a] >= b->h.tree.dim[a])
			return false;
	}
	return true;
}

static float *samples_of(const struct bb_build *b, const uint32_t cell[3])
{
	return b->samples + (((size_t)cell[2] * b->n_cells[1] + cell[1]) * b->n_cells[0] + cell[0]) * b->times.n_steps;
}

/* Cells that begin within the brick. */
static void cells_of(const struct bb_build *b, const struct bb_build_brick *k, uint32_t from[3], uint32_t to[3])
{
	const uint32_t shift = b->h.tree.n_levels - 1 - b->level;

	for (int a = 0; a < 3; a++) {
		const uint64_t end = ((uint64_t)k->to[a] << shift) + b->cell - 1;
		from[a] = (uint32_t)(((uint64_t)k->from[a] << shift) / b->cell);
		to[a] = (uint32_t)(end / b->cell < b->n_cells[a] ? end / b->cell : b->n_cells[a]);
	}
}

void bb_build_samples_keep(struct bb_build *b, const struct bb_build_brick *k)
{
	const uint32_t n_steps = b->times.n_steps;
	uint32_t from[3], to[3], at[3], cell[3];

	cells_of(b, k, from, to);
	for (cell[2] = from[2]; cell[2] < to[2]; cell[2]++)
		for (cell[1] = from[1]; cell[1] < to[1]; cell[1]++)
			for (cell[0] = from[0]; cell[0] < to[0]; cell[0]++) {
				if (!sample_of(b, cell, at))
					continue;
				float *out = samples_of(b, cell);
				for (uint32_t step = 0; step < n_steps; step++)
					out[step] = bb_build_row(b, b->times.leaf[step], at[2], at[1])[at[0]];
			}
}

/* The i-th place of a block: what each time node shows there, and the data's steps. */
static void put(const struct bb_build *b, const uint32_t cell[3], const uint32_t at[3], struct bb_errors *e, uint32_t i)
{
	const uint32_t shift = b->h.tree.n_levels - 1 - b->level;
	const float *shown = bb_build_row(b, 0, at[2] >> shift, at[1] >> shift) + (at[0] >> shift);
	const float *sample = samples_of(b, cell);

	for (uint32_t tau = 0; tau < b->times.n_times; tau++)
		e->values[tau * 4 * BB_ERRORS_WIDTH + i] = shown[tau * b->slab.per_time];
	for (uint32_t step = 0; step < b->times.n_steps; step++)
		e->values[(b->times.leaf[step] * 4 + 1) * BB_ERRORS_WIDTH + i] = sample[step];
}

/* So many cells stand for one that no more than `most` of a brick are asked; along its longest sides. */
static void strides_of(const uint32_t n[3], uint64_t most, uint32_t stride[3])
{
	uint64_t all = 1;

	for (int a = 0; a < 3; a++) {
		stride[a] = 1;
		all *= n[a];
	}
	while (all > most) {
		int longest = 0;
		for (int a = 1; a < 3; a++)
			longest = n[a] / stride[a] > n[longest] / stride[longest] ? a : longest;
		stride[longest] *= 2;
		all = 1;
		for (int a = 0; a < 3; a++)
			all *= (n[a] + stride[a] - 1) / stride[a];
	}
}

/* Which cell of those that begin at `cell`: any, but always the same. */
static void pick(const uint32_t stride[3], uint32_t cell[3])
{
	uint32_t h = 3;

	for (int a = 0; a < 3; a++) {
		h = spread(h + cell[a]);
		cell[a] += h % stride[a];
	}
}

uint32_t bb_build_samples_count(const struct bb_build *b, const struct bb_build_brick *k, struct bb_errors *e)
{
	const uint64_t hold = BB_ERRORS_MOST / (b->times.n_steps + 1); /* of many steps, what the bins hold */
	uint32_t from[3], to[3], at[3], stride[3], n = 0;

	cells_of(b, k, from, to);
	strides_of((const uint32_t[]){ to[0] - from[0], to[1] - from[1], to[2] - from[2] },
		   hold < SAMPLES_MOST ? hold : SAMPLES_MOST, stride);
	for (uint32_t z = from[2]; z < to[2]; z += stride[2])
		for (uint32_t y = from[1]; y < to[1]; y += stride[1])
			for (uint32_t x = from[0]; x < to[0]; x += stride[0]) {
				uint32_t cell[3] = { x, y, z };
				pick(stride, cell);
				const bool in = cell[0] < to[0] && cell[1] < to[1] && cell[2] < to[2];
				if (!in || !sample_of(b, cell, at))
					continue;
				put(b, cell, at, e, n % BB_ERRORS_WIDTH);
				if (++n % BB_ERRORS_WIDTH == 0)
					bb_errors_sample(e, BB_ERRORS_WIDTH);
			}
	if (n % BB_ERRORS_WIDTH)
		bb_errors_sample(e, n % BB_ERRORS_WIDTH);
	return n;
}
