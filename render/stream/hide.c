/*
 * render/stream/hide.c: which parts of the volume the eyes' light still reached in the last frames. A few rays of each
 * view walk through what is on show, other ones in every frame; a cell remembers the largest share of light that came to
 * it, and forgets slowly, so that what comes out from behind something is not thought hidden for long.
 */
#include "render/renderer_driver.h"
#include "render/stream/stream_private.h"

#include <math.h>
#include <string.h>

#define COLUMNS 16
#define ROWS 12
#define PHASES 16         /* frames until the same rays come again: a lattice of 4 x 4 in each one's place */
#define STEP_VOXELS 8.0   /* of the data */
#define FORGETS 0.93F     /* of "no light came here", in a frame */
#define DARK 0.01

static double opacity_of(const struct bb_stream *s, struct bb_atlas_range r)
{
	const unsigned entry = ((unsigned)r.least + r.most) / 2 * (BB_HIDE_ENTRIES - 1) / 65535;

	return (double)s->hide.opacity[entry];
}

static struct bb_atlas_range range_in(const struct bb_atlas *a, const struct bb_atlas_cell *c, const uint32_t cell[3],
				      const double at[3])
{
	uint32_t block[3];

	for (int k = 0; k < 3; k++) {
		const double in = at[k] / (double)(1U << c->up) - (double)((cell[k] >> c->up) * a->edge);
		const uint32_t b = in > 0 ? (uint32_t)in / BB_ATLAS_BLOCK : 0;
		block[k] = b < a->blocks ? b : a->blocks - 1;
	}
	const size_t n = (size_t)a->blocks * a->blocks * a->blocks;
	return a->range[(size_t)c->slot * n + (block[2] * a->blocks + block[1]) * a->blocks + block[0]];
}

static void walk(struct bb_stream *s, const struct bb_ray *ray, const struct bb_spherical *ball)
{
	const struct bb_atlas *a = &s->atlas;
	double light = 1;

	for (uint32_t i = 0; i < ray->n; i++) {
		struct bb_vec3 p = { ray->first.x + i * ray->stride.x, ray->first.y + i * ray->stride.y,
				     ray->first.z + i * ray->stride.z };
		uint32_t cell[3];
		if (ball && !bb_spherical_at(ball, p, &p))
			continue;
		const double at[3] = { p.x, p.y, p.z };
		for (int k = 0; k < 3; k++) {
			const double c = at[k] > 0 ? at[k] / a->edge : 0;
			cell[k] = c < a->grid[k] ? (uint32_t)c : a->grid[k] - 1;
		}
		const size_t index = ((size_t)cell[2] * a->grid[1] + cell[1]) * a->grid[0] + cell[0];
		float *seen = &s->hide.light[index];
		*seen = (float)light > *seen ? (float)light : *seen;
		if (light < DARK)
			return;
		const struct bb_atlas_cell *c = &a->map[0][index];
		if (c->slot >= 0)
			light *= 1 - opacity_of(s, range_in(a, c, cell, at));
	}
}

void bb_hide_edit(struct bb_stream *s)
{
	for (size_t i = 0; i < BB_HIDE_ENTRIES; i++) {
		double rgba[4];
		bb_transfer_at(s->config.transfer, (double)i / (BB_HIDE_ENTRIES - 1), rgba);
		s->hide.opacity[i] = (float)bb_transfer_opacity_for_step(rgba[3], STEP_VOXELS);
	}
}

/* Cells to nodes: a leaf's number is its cell's, after all nodes above. */
static void tell_nodes(struct bb_stream *s)
{
	const struct bb_tree *t = s->tree;
	const uint32_t first = t->first[t->n_levels - 1];

	memcpy(s->hide.seen + first, s->hide.light, (t->n_nodes - first) * sizeof(float));
	bb_sight_seen(t, s->hide.seen);
}

void bb_hide(struct bb_stream *s, const struct bb_stream_frame *f)
{
	const struct bb_layer layer = bb_stream_layer(s);
	const bool is_ball = s->atlas.kind == BB_BRICK_SPHERICAL;
	const uint32_t phase = (uint32_t)(s->slots.frame * 5 % PHASES);
	const uint32_t n = s->tree->n_nodes - s->tree->first[s->tree->n_levels - 1];
	struct bb_spherical ball;
	struct bb_rays rays;

	if (is_ball)
		bb_spherical_of(s->atlas.dim, s->atlas.extent, &ball);
	for (uint32_t i = 0; i < n; i++)
		s->hide.light[i] *= FORGETS;
	for (size_t v = 0; v < f->n_views; v++) {
		if (bb_rays_make(&f->views[v], &layer, STEP_VOXELS, COLUMNS * 4, ROWS * 4, &rays) != BB_OK)
			continue;
		for (uint32_t y = 0; y < ROWS; y++)
			for (uint32_t x = 0; x < COLUMNS; x++) {
				const struct bb_ray ray = bb_rays_at(&rays, x * 4 + phase % 4, y * 4 + phase / 4);
				walk(s, &ray, is_ball ? &ball : NULL);
			}
	}
	tell_nodes(s);
}
