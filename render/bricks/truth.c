#include "render/bricks/truth.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/half.h"

struct assembly {
	const struct bb_bricks *bricks;
	const struct bb_bricks_header *h;
	struct bb_volume *v;
	uint8_t *brick; /* as it is stored */
	uint64_t node;
	uint32_t step;
};

/* Hostile files hold what they like: whatever it is, it ends up in 0..1. */
static float part_of(double v)
{
	return v >= 0 ? (float)(v <= 1 ? v : 1) : 0;
}

static float value_at(const struct bb_bricks_header *h, const uint8_t *brick, size_t i)
{
	const double span = h->most - h->least;
	uint16_t wide;
	float v;

	switch (h->type) {
	case BB_BRICK_U8:
		return part_of(brick[i] / 255.0);
	case BB_BRICK_U16:
		memcpy(&wide, brick + 2 * i, 2);
		return part_of(wide / 65535.0);
	case BB_BRICK_F16:
		memcpy(&wide, brick + 2 * i, 2);
		return wide & 0x8000 || wide > 0x7C00 ? 0 : part_of((double)bb_from_half(wide));
	case BB_BRICK_F32:
	case BB_BRICK_TYPES:
	default:
		memcpy(&v, brick + 4 * i, 4);
		return span > 0 ? part_of(((double)v - h->least) / span) : 0;
	}
}

static uint32_t within(uint32_t from, uint32_t edge, uint32_t end)
{
	return from + edge < end ? edge : end - from;
}

/* A leaf brick's own voxels, without padding and what lies outside. */
static void put_brick(const struct assembly *a, const struct bb_tree_place *p)
{
	const uint32_t edge = a->h->tree.edge, pad = a->h->pad, *dim = a->v->dim;
	const size_t stored = edge + 2 * (size_t)pad;
	const uint32_t from[3] = { p->at[0] * edge, p->at[1] * edge, p->at[2] * edge };

	for (uint32_t z = 0; z < within(from[2], edge, dim[2]); z++)
		for (uint32_t y = 0; y < within(from[1], edge, dim[1]); y++) {
			const size_t to = (((size_t)a->step * dim[2] + from[2] + z) * dim[1] + from[1] + y) * dim[0] +
					  from[0];
			const size_t at = ((z + pad) * stored + y + pad) * stored + pad;
			for (uint32_t x = 0; x < within(from[0], edge, dim[0]); x++)
				a->v->values[to + x] = value_at(a->h, a->brick, at + x);
		}
}

static enum bb_status put_step(struct assembly *a, uint32_t first, struct bb_error *err)
{
	const struct bb_tree *t = &a->h->tree;
	const uint64_t tau = bb_tree_leaf_time(t, first + a->step);

	for (uint32_t node = t->first[t->n_levels - 1]; node < t->n_nodes; node++) {
		const struct bb_tree_place p = bb_tree_place(t, node);
		const enum bb_status st = bb_bricks_read(a->bricks, tau * t->n_nodes + node, a->brick, err);
		if (st != BB_OK)
			return st;
		put_brick(a, &p);
	}
	return BB_OK;
}

static struct bb_volume *volume_like(const struct bb_bricks_header *h, uint32_t n_steps, size_t bytes)
{
	struct bb_volume *v = calloc(1, sizeof(*v));

	if (!v)
		return NULL;
	snprintf(v->name, sizeof(v->name), "%s", h->name);
	memcpy(v->dim, h->tree.dim, sizeof(v->dim));
	memcpy(v->spacing_mm, h->spacing_mm, sizeof(v->spacing_mm));
	v->n_steps = n_steps;
	v->least = h->least;
	v->most = h->most;
	v->n_nonfinite = h->n_nonfinite;
	v->around = bb_bricks_wraps(h);
	v->values = malloc(bytes);
	if (v->values)
		return v;
	free(v);
	return NULL;
}

enum bb_status bb_volume_of_bricks(const struct bb_bricks *b, uint32_t first, uint32_t n_steps, uint64_t cap_bytes,
				   struct bb_volume **out, struct bb_error *err)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	struct assembly a = { .bricks = b, .h = h };
	uint64_t bytes = sizeof(float);
	enum bb_status st = BB_OK;

	*out = NULL;
	if (!n_steps || first >= h->tree.n_steps || n_steps > h->tree.n_steps - first)
		return BB_ERR_RANGE;
	for (int i = 0; i < 4; i++)
		if (__builtin_mul_overflow(bytes, i < 3 ? h->tree.dim[i] : n_steps, &bytes))
			bytes = UINT64_MAX;
	const uint64_t brick_bytes = bb_bricks_brick_bytes(h);
	if (bytes > SIZE_MAX / 2 || bytes > cap_bytes || brick_bytes > cap_bytes - bytes)
		return bb_fail(err, BB_ERR_FORMAT, 1405, NULL, "%llu bytes of voxels, the cap is %llu",
			       (unsigned long long)bytes, (unsigned long long)cap_bytes);
	a.v = volume_like(h, n_steps, (size_t)bytes);
	a.brick = malloc((size_t)brick_bytes);
	if (!a.v || !a.brick)
		st = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%llu bytes of voxels", (unsigned long long)bytes);
	for (; a.step < n_steps && st == BB_OK; a.step++)
		st = put_step(&a, first, err);
	free(a.brick);
	if (st == BB_OK)
		*out = a.v;
	else
		bb_volume_free(a.v);
	return st;
}
