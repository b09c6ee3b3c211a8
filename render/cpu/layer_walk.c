/*
 * render/cpu/layer_walk.c: the samples of one ray in one layer, batch by batch, what shows nothing left out. Sample
 * numbers are those of rays.c whatever is left out: what a brick is decides which memory is read and never where.
 */
#include "render/cpu/layers.h"

#include <math.h>

struct box { /* corner coordinates */
	double low[3], high[3];
};

/* No NaN here; the library's calls would take longer than the rest. */
static double least(double a, double b)
{
	return a < b ? a : b;
}

static double most(double a, double b)
{
	return a > b ? a : b;
}

static double part(const struct bb_vec3 *v, int axis)
{
	return axis == 0 ? v->x : axis == 1 ? v->y : v->z;
}

static void position(const struct bb_layer_walk *w, double i, double out[3])
{
	for (int a = 0; a < 3; a++)
		out[a] = part(&w->ray.first, a) + i * part(&w->ray.stride, a);
}

static uint32_t cell_of(const struct bb_atlas *atlas, int axis, double at)
{
	const double c = at / atlas->edge, last = atlas->grid[axis] - 1.0;

	return (uint32_t)(c > 0 ? (c < last ? c : last) : 0);
}

static size_t index_of(const struct bb_atlas *atlas, const uint32_t cell[3])
{
	return ((size_t)cell[2] * atlas->grid[1] + cell[1]) * atlas->grid[0] + cell[0];
}

/* The first sample after i beyond a box that sample i is in. */
static double beyond(const struct bb_layer_walk *w, double i, const struct box *b)
{
	double last = w->end;

	for (int a = 0; a < 3; a++) {
		const double s = part(&w->ray.stride, a), face = s > 0 ? b->high[a] : b->low[a];
		if (s != 0)
			last = least(last, ceil((face - part(&w->ray.first, a)) / s));
	}
	return most(last, i + 1);
}

/* A cell as far as the ray is concerned: the outermost ones have no end outwards. */
static struct box cell_box(const struct bb_atlas *atlas, const uint32_t cell[3])
{
	struct box b;

	for (int a = 0; a < 3; a++) {
		b.low[a] = cell[a] ? (double)cell[a] * atlas->edge : -HUGE_VAL;
		b.high[a] = cell[a] + 1 < atlas->grid[a] ? (cell[a] + 1.0) * atlas->edge : HUGE_VAL;
	}
	return b;
}

/* ---- blocks of a cell ---- */

/* Narrows the box to the block that a point is in, and widens the range by its own. */
static void take_block(const struct bb_atlas *atlas, const struct bb_atlas_cell *e, const uint32_t cell[3],
		       const double at[3], struct box *box, struct bb_atlas_range *range)
{
	const double wide = (double)((uint64_t)BB_ATLAS_BLOCK << e->up);
	struct bb_atlas_range r;
	size_t index = 0;

	for (int a = 2; a >= 0; a--) {
		const double origin = (double)(cell[a] >> e->up << e->up) * atlas->edge;
		const double block = floor((at[a] - origin) / wide), last = atlas->blocks - 1.0;
		const double k = block > 0 ? (block < last ? block : last) : 0;
		box->low[a] = most(box->low[a], k > 0 ? origin + k * wide : -HUGE_VAL);
		box->high[a] = least(box->high[a], k < last ? origin + (k + 1) * wide : HUGE_VAL);
		index = index * atlas->blocks + (size_t)k;
	}
	r = atlas->range[(size_t)e->slot * atlas->blocks * atlas->blocks * atlas->blocks + index];
	range->least = r.least < range->least ? r.least : range->least;
	range->most = r.most > range->most ? r.most : range->most;
}

static void take_flat(float value, struct bb_atlas_range *range)
{
	const float v = value > 0 ? (value < 1 ? value : 1) : 0;
	const uint16_t low = (uint16_t)(v * 65535), high = (uint16_t)ceilf(v * 65535);

	range->least = low < range->least ? low : range->least;
	range->most = high > range->most ? high : range->most;
}

/* Does anything show where this point is, and how far does that hold? */
static bool shows(const struct bb_layer_ready *l, size_t index, const uint32_t cell[3], const double at[3],
		  struct box *box)
{
	struct bb_atlas_range range = { UINT16_MAX, 0 };

	for (unsigned shown = 0; shown < l->atlas->n_shown; shown++) {
		const struct bb_atlas_cell *e = &l->atlas->map[shown][index];
		if (e->slot < 0)
			take_flat(e->value, &range);
		else
			take_block(l->atlas, e, cell, at, box, &range);
	}
	return bb_layer_range_shows(l, range);
}

/* The finer of a cell's two levels decides how long its steps are. */
static uint32_t up_of(const struct bb_layer_ready *l, size_t index)
{
	const uint32_t first = l->atlas->map[0][index].up, second = l->atlas->map[l->atlas->n_shown - 1][index].up;

	return l->steps_by_level ? (first < second ? first : second) : 0;
}

/* ---- values ---- */

static void take_brick(const struct bb_layer_walk *w, const uint32_t cell[3], const struct bb_atlas_cell *e,
		       float into[3][BB_LAYER_ROOM], uint32_t n, float *out)
{
	const struct bb_atlas *atlas = w->layer->atlas;
	const struct bb_layer_brick brick = { atlas->bricks + (size_t)e->slot * atlas->slot_bytes, atlas->type,
					      atlas->stored, atlas->scale };
	const float per_leaf = 1 / (float)(1U << e->up);
	float off[3];

	for (int a = 0; a < 3; a++) {
		const uint32_t before = (cell[a] & ((1U << e->up) - 1)) * atlas->edge;
		off[a] = (float)before * per_leaf + (float)atlas->pad - 0.5F;
	}
	w->layer->kernel->sample(&brick, into, per_leaf, off, n, out);
}

/* Values of the batch's samples from `from` on, which lie at `into` one cell, voxels of the leaves from its corner. */
static void take_values(struct bb_layer_walk *w, const uint32_t cell[3], uint32_t from,
			float into[3][BB_LAYER_ROOM])
{
	const struct bb_layer_ready *l = w->layer;
	const struct bb_atlas *atlas = l->atlas;
	const uint32_t n = w->n - from;
	const size_t index = index_of(atlas, cell);
	float value[BB_LAYER_ROOM];

	for (unsigned shown = 0; shown < atlas->n_shown; shown++) {
		const struct bb_atlas_cell *e = &atlas->map[shown][index];
		float *to = shown ? value : w->value + from;
		if (e->slot >= 0)
			take_brick(w, cell, e, into, n, to);
		else
			for (uint32_t k = 0; k < n; k++)
				to[k] = e->value > 0 ? (e->value < 1 ? e->value : 1) : 0;
	}
	for (uint32_t k = 0; k < n && atlas->n_shown > 1; k++)
		w->value[from + k] += (value[k] - w->value[from + k]) * atlas->mix;
}

/* Where other levels reach into the cell, values are put together point by point. */
static void blend_values(struct bb_layer_walk *w, const uint32_t cell[3], uint32_t from,
			 float into[3][BB_LAYER_ROOM])
{
	const struct bb_layer_ready *l = w->layer;
	const struct bb_atlas *atlas = l->atlas;
	const struct bb_layer_seam seam = l->seam ? l->seam[index_of(atlas, cell)] : (struct bb_layer_seam){ 0, 0 };
	double reach, low[3], begin[3], end[3]; /* between begin and end of an axis nothing comes from its sides */

	if (!seam.up_most)
		return;
	reach = least((double)(1U << (seam.up_most - 1)) / 2, atlas->edge / 2.0);
	for (int a = 0; a < 3; a++) {
		low[a] = (double)cell[a] * atlas->edge;
		begin[a] = seam.sides >> 2 * a & 1 ? reach : -HUGE_VAL;
		end[a] = seam.sides >> (2 * a + 1) & 1 ? least(atlas->edge, atlas->dim[a] - low[a]) - reach : HUGE_VAL;
	}
	for (uint32_t k = from; k < w->n; k++) {
		double at[3];
		bool near = false;
		for (int a = 0; a < 3; a++) {
			const double d = (double)into[a][k - from];
			at[a] = low[a] + most(0, d);
			near |= d < begin[a] || d > end[a];
		}
		if (near)
			w->value[k] = (float)bb_layer_value_within(atlas, at, reach);
	}
}

/* ---- Cartesian ---- */

static double phase_from(double i, uint32_t up)
{
	const double s = (double)(1U << up), first = up ? s / 2 : 0;

	return up ? first + ceil((i - first) / s) * s : i;
}

static void take_numbers(struct bb_layer_walk *w, const uint32_t cell[3], size_t index, double end)
{
	const struct bb_layer_ready *l = w->layer;
	const uint32_t up = up_of(l, index);
	const double s = (double)(1U << up);
	const bool look = l->shows[index] == BB_SHOWS_BLOCKS;
	double i = phase_from(w->next, up);

	while (i < end && w->n < BB_LAYER_BATCH) {
		double until = end;
		if (look) {
			struct box box = cell_box(l->atlas, cell);
			double at[3];
			position(w, i, at);
			const bool any = shows(l, index, cell, at, &box);
			until = least(end, beyond(w, i, &box));
			if (!any) {
				i = phase_from(until, up);
				continue;
			}
		}
		while (i < until && w->n < BB_LAYER_BATCH) {
			w->up[w->n] = (uint8_t)up;
			w->number[w->n++] = (int32_t)i;
			i += s;
		}
	}
	w->next = least(i, end);
}

static bool cartesian_on(struct bb_layer_walk *w)
{
	const struct bb_atlas *atlas = w->layer->atlas;
	float into[3][BB_LAYER_ROOM];

	while (w->next < w->end) {
		uint32_t cell[3];
		double at[3];
		position(w, w->next, at);
		for (int a = 0; a < 3; a++)
			cell[a] = cell_of(atlas, a, at[a]);
		const struct box box = cell_box(atlas, cell);
		const double end = beyond(w, w->next, &box);
		const size_t index = index_of(atlas, cell);
		if (!w->layer->shows[index]) {
			w->next = end;
			continue;
		}
		take_numbers(w, cell, index, end);
		if (!w->n)
			continue;
		position(w, w->number[0], at);
		float base[3], stride[3];
		for (int a = 0; a < 3; a++) {
			base[a] = (float)(at[a] - (double)cell[a] * atlas->edge);
			stride[a] = (float)part(&w->ray.stride, a);
		}
		w->layer->kernel->line(base, stride, w->number, w->n, into);
		take_values(w, cell, 0, into);
		blend_values(w, cell, 0, into);
		return true;
	}
	return false;
}

/* ---- spherical ---- */

/* Of the ray's samples those within a ball about the centre: from .. to - 1; none: to <= from. */
static void within(const struct bb_layer_walk *w, double radius, double *from, double *to)
{
	const double c = w->layer->ball.centre;
	double a = 0, b = 0, q = -radius * radius;

	for (int k = 0; k < 3; k++) {
		const double s = part(&w->ray.stride, k), p = part(&w->ray.first, k) - c;
		a += s * s;
		b += s * p;
		q += p * p;
	}
	const double root = b * b - a * q;
	*from = *to = 0;
	if (!(root > 0 && a > 0))
		return;
	*from = ceil((-b - sqrt(root)) / a);
	*to = floor((-b + sqrt(root)) / a) + 1;
}

/* The next samples' grid coordinates; returns how many there are. */
static uint32_t look_ahead(struct bb_layer_walk *w, float grid[3][BB_LAYER_ROOM], int32_t *inside)
{
	const struct bb_layer_ready *l = w->layer;
	const double i = w->next, until = i < w->hole[0] ? least(w->hole[0], w->end) : w->end;
	const uint32_t n = (uint32_t)least(until - i, BB_LAYER_BATCH);
	float first[3], stride[3];
	double at[3];

	position(w, i, at);
	for (int a = 0; a < 3; a++) {
		first[a] = (float)(at[a] - l->ball.centre);
		stride[a] = (float)part(&w->ray.stride, a);
	}
	l->kernel->spherical(&l->ball_float, first, stride, n, grid, inside);
	return n;
}

/* Appends a sample unless nothing shows there or its brick does not want it; its cell. */
static bool wanted(struct bb_layer_walk *w, uint32_t i, const double at[3], uint32_t cell[3])
{
	const struct bb_layer_ready *l = w->layer;

	for (int a = 0; a < 3; a++)
		cell[a] = cell_of(l->atlas, a, at[a]);
	const size_t index = index_of(l->atlas, cell);
	const uint32_t up = up_of(l, index), s = 1U << up;
	struct box box = { { 0 }, { 0 } };
	if (!l->shows[index] || i % s != s / 2)
		return false;
	if (l->shows[index] == BB_SHOWS_BLOCKS && !shows(l, index, cell, at, &box))
		return false;
	w->up[w->n] = (uint8_t)up;
	return true;
}

struct group { /* samples behind each other in one cell */
	uint32_t cell[3], from;
	float into[3][BB_LAYER_ROOM];
};

static void end_group(struct bb_layer_walk *w, struct group *g)
{
	if (w->n > g->from) {
		take_values(w, g->cell, g->from, g->into);
		blend_values(w, g->cell, g->from, g->into);
	}
	g->from = w->n;
}

static bool same_cell(const uint32_t a[3], const uint32_t b[3])
{
	return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

static bool spherical_on(struct bb_layer_walk *w)
{
	const struct bb_layer_ready *l = w->layer;
	float grid[3][BB_LAYER_ROOM];
	int32_t inside[BB_LAYER_ROOM];

	while (w->next < w->end && !w->n) {
		if (w->next >= w->hole[0] && w->next < w->hole[1]) {
			w->next = w->hole[1];
			continue;
		}
		struct group g = { .from = 0 };
		const uint32_t first = (uint32_t)w->next, n = look_ahead(w, grid, inside);
		for (uint32_t k = 0; k < n; k++) {
			uint32_t cell[3];
			const double at[3] = { (double)grid[0][k], (double)grid[1][k], (double)grid[2][k] };
			if (!inside[k] || !wanted(w, first + k, at, cell))
				continue;
			if (!same_cell(cell, g.cell))
				end_group(w, &g);
			for (int a = 0; a < 3; a++) {
				g.cell[a] = cell[a];
				g.into[a][w->n - g.from] = grid[a][k] - (float)(cell[a] * l->atlas->edge);
			}
			w->number[w->n++] = (int32_t)(first + k);
		}
		end_group(w, &g);
		w->next += n;
	}
	return w->n > 0;
}

/* ---- both ---- */

void bb_layer_walk_begin(struct bb_layer_walk *w, const struct bb_layer_ready *layer, uint32_t column, uint32_t row)
{
	double from, to;

	w->layer = layer;
	w->ray = bb_rays_at(layer->rays, column, row);
	w->next = w->n = w->at = 0;
	w->end = w->ray.n;
	w->samples = 0;
	w->hole[0] = w->hole[1] = HUGE_VAL;
	if (!layer->spherical || !w->ray.n)
		return;
	/* Some samples more: the kernel decides, and the hole is smaller than the innermost shell. */
	within(w, layer->ball.from[0] + layer->ball.dim[0], &from, &to);
	w->next = least(most(0, from - 2), w->ray.n);
	w->end = least(w->ray.n, to + 2);
	within(w, layer->ball.from[0], &from, &to);
	if (to - 2 > from + 2) {
		w->hole[0] = most(0, from + 2);
		w->hole[1] = to - 2;
	}
}

bool bb_layer_walk_on(struct bb_layer_walk *w)
{
	w->n = w->at = 0;
	const bool any = w->layer->spherical ? spherical_on(w) : cartesian_on(w);
	w->samples += w->n;
	return any;
}
