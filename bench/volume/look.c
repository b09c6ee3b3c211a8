#include "bench/volume/look.h"
#include "render/bricks/perceived.h"
#include "render/bricks/values.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define COLOURS 4096
#define COVERED (1.0 / 255)

size_t bb_look_pixels(const struct bb_look *l)
{
	return (size_t)l->width * l->height;
}

enum bb_status bb_look_begin(struct bb_look *l, const struct bb_bricks *b, struct bb_error *err)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const uint32_t *dim = h->tree.dim;
	const size_t side = h->tree.edge + 2 * h->pad;

	*l = (struct bb_look){ .b = b };
	for (int a = 1; a < 3; a++)
		l->axis = dim[a] <= dim[l->axis] ? a : l->axis;
	l->width = l->axis == 0 ? dim[1] : dim[0];
	l->height = l->axis == 2 ? dim[1] : dim[2];
	l->voxels = malloc((size_t)dim[0] * dim[1] * dim[2] * sizeof(*l->voxels));
	l->stored = malloc(bb_bricks_brick_bytes(h));
	l->values = malloc(side * side * side * sizeof(*l->values));
	if (l->voxels && l->stored && l->values)
		return BB_OK;
	bb_look_end(l);
	return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a volume of %u x %u x %u", dim[0], dim[1], dim[2]);
}

void bb_look_end(struct bb_look *l)
{
	free(l->voxels);
	free(l->stored);
	free(l->values);
	*l = (struct bb_look){ 0 };
}

/* ---- the volume ---- */

struct part { /* of the volume that a brick stands for, and of the brick */
	uint32_t from[3], to[3];
	uint32_t up, side;
	double origin[3]; /* brick coordinates of voxel 0 */
};

static struct part part_of(const struct bb_bricks_header *h, uint32_t node)
{
	const struct bb_tree *t = &h->tree;
	const struct bb_tree_place p = bb_tree_place(t, node);
	struct part out = { .up = t->n_levels - 1 - p.level, .side = t->edge + 2 * h->pad };

	for (int a = 0; a < 3; a++) {
		const uint64_t reach = (uint64_t)t->edge << out.up, to = (p.at[a] + 1) * reach;
		out.from[a] = (uint32_t)(p.at[a] * reach);
		out.to[a] = to < t->dim[a] ? (uint32_t)to : t->dim[a];
		out.origin[a] = ldexp(0.5, -(int)out.up) - 0.5 - (double)p.at[a] * t->edge + h->pad;
	}
	return out;
}

/* Between the voxels around, held within what is stored (a brick without padding ends at its own). */
static float between(const float *values, const struct part *p, const double at[3])
{
	const double most = p->side - 1.0;
	size_t i[3][2];
	float f[3], sum = 0;

	for (int a = 0; a < 3; a++) {
		const double x = fmin(fmax(at[a], 0), most);
		i[a][0] = (size_t)x;
		i[a][1] = i[a][0] + 1 < p->side ? i[a][0] + 1 : i[a][0];
		f[a] = (float)(x - (double)i[a][0]);
	}
	for (int k = 0; k < 8; k++) {
		const int x = k & 1, y = k >> 1 & 1, z = k >> 2;
		const float w = (x ? f[0] : 1 - f[0]) * (y ? f[1] : 1 - f[1]) * (z ? f[2] : 1 - f[2]);
		sum += w * values[(i[2][z] * p->side + i[1][y]) * p->side + i[0][x]];
	}
	return sum;
}

static void fill_row(const struct bb_look *l, const struct part *p, uint32_t y, uint32_t z, float *row)
{
	const double scale = ldexp(1, -(int)p->up);
	const double at_y = p->origin[1] + y * scale, at_z = p->origin[2] + z * scale;

	if (!p->up) {
		const size_t line = ((size_t)(at_z + 0.5) * p->side + (size_t)(at_y + 0.5)) * p->side;
		memcpy(row + p->from[0], l->values + line + (size_t)(p->origin[0] + p->from[0] + 0.5),
		       (p->to[0] - p->from[0]) * sizeof(*row));
		return;
	}
	for (uint32_t x = p->from[0]; x < p->to[0]; x++)
		row[x] = between(l->values, p, (const double[]){ p->origin[0] + x * scale, at_y, at_z });
}

static enum bb_status fill(struct bb_look *l, const struct bb_choice *c, struct bb_error *err)
{
	const struct bb_bricks_header *h = bb_bricks_header(l->b);
	const uint64_t id = (uint64_t)c->tau * h->tree.n_nodes + c->node;
	const double per = h->most > h->least ? 1 / (h->most - h->least) : 0;
	const struct part p = part_of(h, c->node);
	const size_t n = (size_t)p.side * p.side * p.side;
	float mean = bb_bricks_moments(l->b)[id].mean;

	/* As a voxel of that value would be stored: or what is one value anyway would look different. */
	bb_values_store(h, &mean, 1, l->stored);
	bb_values_load(h, l->stored, 1, &mean);
	mean = (float)(((double)mean - h->least) * per);
	if (!c->flat) {
		const enum bb_status status = bb_bricks_read(l->b, id, l->stored, err);
		if (status)
			return status;
		bb_values_load(h, l->stored, n, l->values);
		for (size_t i = 0; i < n; i++)
			l->values[i] = (float)(((double)l->values[i] - h->least) * per);
	}
	for (uint32_t z = p.from[2]; z < p.to[2]; z++)
		for (uint32_t y = p.from[1]; y < p.to[1]; y++) {
			float *row = l->voxels + ((size_t)z * h->tree.dim[1] + y) * h->tree.dim[0];
			for (uint32_t x = p.from[0]; c->flat && x < p.to[0]; x++)
				row[x] = mean;
			if (!c->flat)
				fill_row(l, &p, y, z, row);
		}
	return BB_OK;
}

enum bb_status bb_look_fill(struct bb_look *l, const struct bb_choice *c, size_t n, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < n && !status; i++)
		status = fill(l, &c[i], err);
	return status;
}

/* ---- the picture ---- */

/* In the order of memory every pixel's voxels come front to back, along any axis. */
void bb_look_cast(const struct bb_look *l, const struct bb_transfer *tf, float (*picture)[4])
{
	const uint32_t *dim = bb_bricks_header(l->b)->tree.dim;
	const size_t step[3] = { l->axis == 0 ? 0 : 1,
				 l->axis == 1   ? 0
				 : l->axis == 0 ? 1
						: l->width,
				 l->axis == 2 ? 0 : l->width };
	static float colour[COLOURS][4]; /* one thread: the bench's */

	for (int i = 0; i < COLOURS; i++) {
		double rgba[4];
		bb_transfer_at(tf, i / (COLOURS - 1.0), rgba);
		for (int k = 0; k < 3; k++)
			colour[i][k] = (float)(rgba[k] * rgba[3]);
		colour[i][3] = (float)rgba[3];
	}
	memset(picture, 0, bb_look_pixels(l) * sizeof(*picture));
	const float *v = l->voxels;
	for (uint32_t z = 0; z < dim[2]; z++)
		for (uint32_t y = 0; y < dim[1]; y++) {
			float(*pixel)[4] = picture + z * step[2] + y * step[1];
			for (uint32_t x = 0; x < dim[0]; x++, v++, pixel += step[0]) {
				const float at = fminf(fmaxf(*v, 0), 1) * (COLOURS - 1) + 0.5f;
				const float *c = colour[(int)at];
				const float left = 1 - (*pixel)[3];
				for (int k = 0; k < 4; k++)
					(*pixel)[k] += left * c[k];
			}
		}
}

static bool is_same(const float a[4], const float b[4])
{
	for (int k = 0; k < 4; k++)
		if (a[k] < b[k] || a[k] > b[k])
			return false;
	return true;
}

struct bb_look_difference bb_look_compare(const float (*picture)[4], const float (*reference)[4], size_t n)
{
	struct bb_look_difference d = { .psnr_db = 200 };
	double squares = 0;

	for (size_t i = 0; i < n; i++) {
		double a[3], b[3], luv[2][3];
		if (!((double)reference[i][3] > COVERED))
			continue;
		d.n_pixels++;
		if (is_same(picture[i], reference[i]))
			continue;
		for (int k = 0; k < 3; k++) {
			a[k] = (double)picture[i][k];
			b[k] = (double)reference[i][k];
			const double apart = rint(fmin(a[k], 1) * 255) - rint(fmin(b[k], 1) * 255);
			squares += apart * apart;
		}
		bb_perceived_luv(a, luv[0]);
		bb_perceived_luv(b, luv[1]);
		d.luv += bb_perceived_distance(luv[0], luv[1]);
	}
	d.luv = d.n_pixels ? d.luv / (double)d.n_pixels : 0;
	if (squares > 0)
		d.psnr_db = fmin(200, 10 * log10(255.0 * 255 * 3 * (double)d.n_pixels / squares));
	return d;
}
