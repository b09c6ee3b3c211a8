/*
 * tests/atlas_oracle.h: what a picture of one Cartesian layer must be, straight from the words of atlas.h and
 * renderer.h: double precision, each sample from the brick that the map names, one after the other.
 */
#ifndef BB_TESTS_ATLAS_ORACLE_H
#define BB_TESTS_ATLAS_ORACLE_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "render/half.h"
#include "render/renderer_driver.h"

static inline double oracle_stored(const struct bb_atlas *a, int32_t slot, const uint32_t at[3])
{
	const size_t i = ((size_t)at[2] * a->stored + at[1]) * a->stored + at[0];
	const uint8_t *brick = a->bricks + (size_t)slot * a->slot_bytes;
	uint16_t u;
	float f;

	switch (a->type) {
	case BB_BRICK_U8:
		return brick[i] / 255.0;
	case BB_BRICK_U16:
		memcpy(&u, brick + 2 * i, 2);
		return u / 65535.0;
	case BB_BRICK_F16:
		memcpy(&u, brick + 2 * i, 2);
		return (double)bb_from_half(u);
	case BB_BRICK_F32:
	case BB_BRICK_TYPES:
	default:
		memcpy(&f, brick + 4 * i, 4);
		return (double)f;
	}
}

static inline double oracle_brick(const struct bb_atlas *a, const struct bb_atlas_cell *m, const uint32_t cell[3],
				  const double p[3])
{
	uint32_t low[3];
	double part[3], sum = 0;

	for (int k = 0; k < 3; k++) {
		const double at = ldexp(p[k], -(int)m->up) - (double)(cell[k] >> m->up) * a->edge + a->pad - 0.5;
		low[k] = (uint32_t)floor(at);
		part[k] = at - low[k];
	}
	for (unsigned c = 0; c < 8; c++) {
		const uint32_t at[3] = { low[0] + (c & 1), low[1] + (c >> 1 & 1), low[2] + (c >> 2) };
		const double weight = (c & 1 ? part[0] : 1 - part[0]) * (c & 2 ? part[1] : 1 - part[1]) *
				      (c & 4 ? part[2] : 1 - part[2]);
		if (weight > 0)
			sum += weight * oracle_stored(a, m->slot, at);
	}
	return sum;
}

/* The value at a point, and how many levels above the leaves it was taken. */
static inline double oracle_value(const struct bb_atlas *a, const double p[3], uint32_t *up)
{
	double v[2] = { 0 };
	uint32_t cell[3];

	for (int k = 0; k < 3; k++) {
		const double c = fmax(0, floor(p[k] / a->edge));
		cell[k] = c < a->grid[k] ? (uint32_t)c : a->grid[k] - 1;
	}
	*up = UINT32_MAX;
	for (uint32_t k = 0; k < a->n_shown; k++) {
		const struct bb_atlas_cell *m =
			&a->map[k][((size_t)cell[2] * a->grid[1] + cell[1]) * a->grid[0] + cell[0]];
		v[k] = m->slot == BB_ATLAS_FLAT ? (double)m->value : oracle_brick(a, m, cell, p);
		if (m->slot != BB_ATLAS_FLAT && m->up < *up)
			*up = m->up;
	}
	*up = *up == UINT32_MAX ? 0 : *up;
	return a->n_shown == 2 ? v[0] + (v[1] - v[0]) * (double)a->mix : v[0];
}

static inline void oracle_pixel(const struct bb_draw *draw, const struct bb_rays *rays, uint32_t column, uint32_t row,
				uint8_t *px)
{
	const struct bb_layer *layer = draw->layers;
	const struct bb_ray ray = bb_rays_at(rays, column, row);
	double sum[4] = { 0 }, rgba[4];
	uint32_t up;

	for (uint32_t i = 0; i < ray.n; i++) {
		const double p[3] = { ray.first.x + i * ray.stride.x, ray.first.y + i * ray.stride.y,
				      ray.first.z + i * ray.stride.z };
		bb_transfer_at(layer->transfer, oracle_value(layer->atlas, p, &up), rgba);
		up = draw->steps_by_level ? up : 0;
		if (i % (1U << up) != (1U << up) / 2)
			continue;
		const double opacity = bb_transfer_opacity_for_step(rgba[3], ldexp(draw->step_voxels, (int)up));
		const double weight = (1 - sum[3]) * opacity;
		for (int c = 0; c < 3; c++)
			sum[c] += weight * rgba[c];
		sum[3] += weight;
	}
	for (int c = 0; c < 4; c++)
		px[c] = (uint8_t)fmin(255, floor(sum[c] * 255 + 0.5));
}

static inline void oracle_draw(const struct bb_draw *draw, struct bb_image *image)
{
	struct bb_rays rays;

	if (bb_rays_make(draw->view, draw->layers, draw->step_voxels, image->width, image->height, &rays) != BB_OK)
		abort();
	for (uint32_t y = 0; y < image->height; y++)
		for (uint32_t x = 0; x < image->width; x++)
			oracle_pixel(draw, &rays, x, y, image->rgba + ((size_t)y * image->width + x) * 4);
}

#endif
