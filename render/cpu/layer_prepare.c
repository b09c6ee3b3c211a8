#include "render/cpu/layers.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "render/parallel.h"

#define PARTS 65536 /* of the data's range, as in bb_atlas_range */

/* ---- what shows ---- */

static void mark(uint32_t *visible, double from, double to)
{
	const uint32_t first = (uint32_t)floor(fmin(fmax(from, 0), 1) * (PARTS - 1));
	const uint32_t last = (uint32_t)ceil(fmin(fmax(to, 0), 1) * (PARTS - 1));

	for (uint32_t i = first; i <= last; i++)
		visible[i] = i;
}

/* Marked are all parts of the range that touch a piece of the transfer function with any opacity. */
static void find_visible(const struct bb_transfer *tf, uint32_t *visible)
{
	const struct bb_transfer_point *p = tf->point;

	for (uint32_t i = 0; i <= PARTS; i++)
		visible[i] = PARTS;
	for (size_t i = 1; i < tf->n; i++)
		if (p[i - 1].opacity > 0 || p[i].opacity > 0)
			mark(visible, p[i - 1].value, p[i].value);
	if (tf->n && p[0].opacity > 0)
		mark(visible, 0, p[0].value);
	if (tf->n && p[tf->n - 1].opacity > 0)
		mark(visible, p[tf->n - 1].value, 1);
	for (uint32_t i = PARTS; i-- > 0;)
		visible[i] = visible[i] == i ? i : visible[i + 1];
}

struct table_work {
	const struct bb_transfer *transfer;
	double step_voxels; /* of the leaves */
	bb_layer_rgba **table;
	uint32_t up[BB_LAYER_UPS];
};

static void fill_table(void *ctx, size_t i, unsigned thread)
{
	const struct table_work *w = ctx;
	const uint32_t up = w->up[i];

	(void)thread;
	for (int k = 0; k < BB_LAYER_TABLE + 2; k++) {
		double rgba[4];
		bb_transfer_at(w->transfer, fmin(1, (double)k / BB_LAYER_TABLE), rgba);
		const double opacity = bb_transfer_opacity_for_step(rgba[3], ldexp(w->step_voxels, (int)up));
		for (int c = 0; c < 4; c++)
			w->table[up][k][c] = (float)(c < 3 ? rgba[c] * opacity : opacity);
	}
}

static bool make_tables(const struct bb_draw *draw, const struct bb_layer *layer, unsigned threads,
			struct bb_layer_ready *r)
{
	struct table_work w = { .transfer = layer->transfer, .step_voxels = draw->step_voxels, .table = r->table };
	const struct bb_atlas *a = layer->atlas;
	const size_t n_cells = (size_t)a->grid[0] * a->grid[1] * a->grid[2];
	bool met[BB_LAYER_UPS] = { [0] = true };
	size_t n = 0;

	for (unsigned shown = 0; draw->steps_by_level && shown < a->n_shown; shown++)
		for (size_t i = 0; i < n_cells; i++)
			met[a->map[shown][i].up < BB_LAYER_UPS ? a->map[shown][i].up : 0] = true;
	for (uint32_t up = 0; up < BB_LAYER_UPS; up++) {
		if (!met[up])
			continue;
		r->table[up] = aligned_alloc(64, (BB_LAYER_TABLE + 4) * sizeof(*r->table[up]));
		if (!r->table[up])
			return false;
		w.up[n++] = up;
	}
	bb_parallel(threads, n, fill_table, &w);
	return true;
}

/* ---- which cells show ---- */

struct cells_work {
	struct bb_layer_ready *r;
	struct bb_atlas_range *range; /* of a cell, all of its maps */
};

static void widen(struct bb_atlas_range *r, struct bb_atlas_range by)
{
	r->least = by.least < r->least ? by.least : r->least;
	r->most = by.most > r->most ? by.most : r->most;
}

static struct bb_atlas_range flat_range(float value)
{
	const float v = value > 0 ? (value < 1 ? value : 1) : 0;

	return (struct bb_atlas_range){ (uint16_t)(v * (PARTS - 1)), (uint16_t)ceilf(v * (PARTS - 1)) };
}

/* The blocks of its brick that a cell reaches into; all: every one of them shows something. */
static struct bb_atlas_range range_of(const struct bb_layer_ready *r, const struct bb_atlas_cell *e,
				      const uint32_t cell[3], bool *all)
{
	const struct bb_atlas *a = r->atlas;
	struct bb_atlas_range out = { UINT16_MAX, 0 };
	uint32_t from[3], to[3];

	*all = true;
	if (e->slot < 0)
		return flat_range(e->value);
	for (int k = 0; k < 3; k++) {
		const uint64_t at = (uint64_t)(cell[k] & ((1U << e->up) - 1)) * a->edge; /* voxels of the leaves */
		from[k] = (uint32_t)(at >> e->up) / BB_ATLAS_BLOCK;
		to[k] = (uint32_t)((at + a->edge - 1) >> e->up) / BB_ATLAS_BLOCK;
	}
	const struct bb_atlas_range *block = a->range + (size_t)e->slot * a->blocks * a->blocks * a->blocks;
	for (uint32_t z = from[2]; z <= to[2]; z++)
		for (uint32_t y = from[1]; y <= to[1]; y++)
			for (uint32_t x = from[0]; x <= to[0]; x++) {
				const struct bb_atlas_range own = block[(z * a->blocks + y) * a->blocks + x];
				widen(&out, own);
				*all &= bb_layer_range_shows(r, own);
			}
	return out;
}

static void range_plane(void *ctx, size_t z, unsigned thread)
{
	const struct cells_work *w = ctx;
	const struct bb_atlas *a = w->r->atlas;
	size_t i = z * a->grid[1] * a->grid[0];

	(void)thread;
	for (uint32_t y = 0; y < a->grid[1]; y++)
		for (uint32_t x = 0; x < a->grid[0]; x++, i++) {
			const uint32_t cell[3] = { x, y, (uint32_t)z };
			bool all, too = false;
			w->range[i] = range_of(w->r, &a->map[0][i], cell, &all);
			if (a->n_shown > 1)
				widen(&w->range[i], range_of(w->r, &a->map[1][i], cell, &too));
			/* What shows in one step's block shows in the mix. */
			w->r->shows[i] = !bb_layer_range_shows(w->r, w->range[i]) ? BB_SHOWS_NOTHING
					 : all || too                             ? BB_SHOWS_ALL
									          : BB_SHOWS_BLOCKS;
		}
}

/* What is mixed into a cell may show although nothing of the cell's own does. */
static struct bb_atlas_range around_cell(const struct cells_work *w, const int64_t cell[3], bool around)
{
	const struct bb_atlas *a = w->r->atlas;
	struct bb_atlas_range out = { UINT16_MAX, 0 };

	for (int i = 0; i < 27; i++) {
		int64_t c[3] = { cell[0] + i % 3 - 1, cell[1] + i / 3 % 3 - 1, cell[2] + i / 9 - 1 };
		if (around)
			c[2] = (c[2] + a->grid[2]) % a->grid[2];
		bool there = true;
		for (int k = 0; k < 3; k++)
			there &= c[k] >= 0 && c[k] < a->grid[k];
		if (there)
			widen(&out, w->range[(size_t)((c[2] * a->grid[1] + c[1]) * a->grid[0] + c[0])]);
	}
	return out;
}

static void blend_plane(void *ctx, size_t z, unsigned thread)
{
	const struct cells_work *w = ctx;
	const struct bb_atlas *a = w->r->atlas;
	const bool around = bb_layer_around(a);
	size_t i = z * a->grid[1] * a->grid[0];

	(void)thread;
	bb_layer_seams(a, (uint32_t)z, w->r->seam + i);
	for (uint32_t y = 0; y < a->grid[1]; y++)
		for (uint32_t x = 0; x < a->grid[0]; x++, i++)
			if (w->r->seam[i].up_most)
				w->r->shows[i] = bb_layer_range_shows(w->r, around_cell(w, (const int64_t[]){ x, y, (int64_t)z },
											around))
							 ? BB_SHOWS_ALL
							 : BB_SHOWS_NOTHING;
}

static bool make_cells(struct bb_layer_ready *r, unsigned threads)
{
	const struct bb_atlas *a = r->atlas;
	const size_t n_cells = (size_t)a->grid[0] * a->grid[1] * a->grid[2];
	struct cells_work w = { .r = r, .range = malloc(n_cells * sizeof(*w.range)) };

	r->shows = malloc(n_cells);
	r->seam = r->blend ? malloc(n_cells * sizeof(*r->seam)) : NULL;
	if (!w.range || !r->shows || (r->blend && !r->seam)) {
		free(w.range);
		return false;
	}
	bb_parallel(threads, a->grid[2], range_plane, &w);
	if (r->blend)
		bb_parallel(threads, a->grid[2], blend_plane, &w);
	free(w.range);
	return true;
}

static void make_ball(struct bb_layer_ready *r)
{
	bb_spherical_of(r->atlas->dim, r->atlas->extent, &r->ball);
	for (int a = 0; a < 3; a++) {
		r->ball_float.from[a] = (float)r->ball.from[a];
		r->ball_float.per_unit[a] = (float)(1 / r->ball.per_voxel[a]);
		r->ball_float.most[a] = (float)r->ball.dim[a];
	}
	r->ball_float.around = r->ball.around;
}

enum bb_status bb_layer_make_ready(const struct bb_draw *draw, size_t layer, const struct bb_rays *rays,
				   const struct bb_layer_kernel *kernel, unsigned threads, struct bb_layer_ready *out,
				   struct bb_error *err)
{
	const struct bb_layer *l = &draw->layers[layer];

	*out = (struct bb_layer_ready){ .atlas = l->atlas,
					.rays = rays,
					.kernel = kernel,
					.steps_by_level = draw->steps_by_level,
					.blend = draw->blend_levels,
					.spherical = l->atlas->kind == BB_BRICK_SPHERICAL };
	if (out->spherical)
		make_ball(out);
	out->visible = malloc((PARTS + 1) * sizeof(*out->visible));
	if (!out->visible)
		goto no_memory;
	find_visible(l->transfer, out->visible);
	if (make_tables(draw, l, threads, out) && make_cells(out, threads))
		return BB_OK;
no_memory:
	bb_layer_unready(out);
	return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "what layer %zu needs to be drawn", layer);
}

void bb_layer_unready(struct bb_layer_ready *r)
{
	free(r->visible);
	free(r->shows);
	free(r->seam);
	for (int i = 0; i < BB_LAYER_UPS; i++)
		free(r->table[i]);
	*r = (struct bb_layer_ready){ 0 };
}
