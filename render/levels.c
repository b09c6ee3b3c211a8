#include "render/levels.h"

#include <math.h>
#include <string.h>

#include "render/half.h"
#include "render/renderer_driver.h"

#define STEP_VOXELS 1.0
#define DENSER 3.0 /* than the volume itself, so that thin haze can be told apart */

static const uint8_t colour[BB_LEVELS_COLOURS][3] = { { 46, 160, 67 },  { 240, 205, 40 }, { 240, 140, 40 },
						      { 215, 50, 47 }, { 140, 70, 170 }, { 110, 120, 150 } };
const char *const bb_levels_colour[BB_LEVELS_COLOURS] = { "#2ea043", "#f0cd28", "#f08c28", "#d7322f", "#8c46aa", "#6e7896" };

static double stored_value(const struct bb_atlas *a, const uint8_t *brick, size_t i)
{
	uint16_t half;
	float v;

	if (a->type == BB_BRICK_U8)
		return (double)a->scale * brick[i];
	if (a->type == BB_BRICK_F32) {
		memcpy(&v, brick + 4 * i, 4);
		return (double)v;
	}
	memcpy(&half, brick + 2 * i, 2);
	return a->type == BB_BRICK_U16 ? (double)a->scale * half : (double)bb_from_half(half);
}

/* The nearest voxel of the brick that stands for a point of corner coordinates, at the step that counts for more. */
static double value_at(const struct bb_atlas *a, struct bb_vec3 p, uint32_t *up)
{
	const double at[3] = { p.x, p.y, p.z };
	uint32_t cell[3];
	size_t in[3];

	for (int k = 0; k < 3; k++) {
		const double c = at[k] > 0 ? at[k] / a->edge : 0;
		cell[k] = c < a->grid[k] ? (uint32_t)c : a->grid[k] - 1;
	}
	const struct bb_atlas_cell *c = &a->map[a->mix > 0.5F][((size_t)cell[2] * a->grid[1] + cell[1]) * a->grid[0] + cell[0]];
	*up = c->up;
	if (c->slot < 0)
		return (double)c->value;
	for (int k = 0; k < 3; k++) {
		const double q = at[k] / (double)(1U << c->up) - (double)((cell[k] >> c->up) * a->edge) + a->pad;
		in[k] = q > 0 ? (q < a->stored ? (size_t)q : a->stored - 1) : 0;
	}
	return stored_value(a, a->bricks + (size_t)c->slot * a->slot_bytes, (in[2] * a->stored + in[1]) * a->stored + in[0]);
}

static void draw_pixel(const struct bb_rays *rays, const struct bb_layer *layer, const struct bb_spherical *ball, uint32_t x,
		       uint32_t y, uint8_t px[4])
{
	const struct bb_ray ray = bb_rays_at(rays, x, y);
	double sum[4] = { 0 };

	for (uint32_t i = 0; i < ray.n && sum[3] < 0.99; i++) {
		struct bb_vec3 at = { ray.first.x + i * ray.stride.x, ray.first.y + i * ray.stride.y,
				      ray.first.z + i * ray.stride.z };
		double rgba[4];
		uint32_t up;
		if (ball && !bb_spherical_at(ball, at, &at))
			continue;
		bb_transfer_at(layer->transfer, value_at(layer->atlas, at, &up), rgba);
		const double weight = (1 - sum[3]) * bb_transfer_opacity_for_step(rgba[3], STEP_VOXELS * DENSER);
		const uint8_t *c = colour[up < BB_LEVELS_COLOURS ? up : BB_LEVELS_COLOURS - 1];
		for (int k = 0; k < 3; k++)
			sum[k] += weight * c[k];
		sum[3] += weight;
	}
	for (int k = 0; k < 3; k++)
		px[k] = (uint8_t)(sum[k] + 0.5);
	px[3] = (uint8_t)(sum[3] * 255 + 0.5);
}

enum bb_status bb_levels_draw(const struct bb_view *view, const struct bb_layer *layer, struct bb_image *image)
{
	struct bb_spherical ball;
	struct bb_rays rays;
	const bool is_ball = layer->atlas->kind == BB_BRICK_SPHERICAL;
	const enum bb_status status = bb_rays_make(view, layer, STEP_VOXELS, image->width, image->height, &rays);

	if (status)
		return status;
	if (is_ball)
		bb_spherical_of(layer->atlas->dim, layer->atlas->extent, &ball);
	for (uint32_t y = 0; y < image->height; y++)
		for (uint32_t x = 0; x < image->width; x++)
			draw_pixel(&rays, layer, is_ball ? &ball : NULL, x, y,
				   image->rgba + ((size_t)y * image->width + x) * 4);
	return BB_OK;
}
