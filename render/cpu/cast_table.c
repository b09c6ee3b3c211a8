/*
 * render/cpu/cast_table.c: a transfer function as a table of samples that need no further arithmetic: premultiplied,
 * and opacity already that of a step, of each level's step.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "render/cpu/cast.h"
#include "render/half.h"

#define LEAST_ENTRIES 1024 /* 8 KiB: stays in the nearest cache */
#define MOST_ENTRIES 65536
#define PIECE_ERROR 1e-3        /* of the opacity; of a colour */
#define ERROR_MOST (1.0 / 4096) /* of a sample, by taking the nearest entry */

static bool same_transfer(const struct bb_transfer *a, const struct bb_transfer *b)
{
	return a->n == b->n && !memcmp(a->point, b->point, a->n * sizeof(a->point[0]));
}

static void premultiplied(const struct bb_transfer *tf, double v, double step_voxels, double out[4])
{
	bb_transfer_at(tf, v, out);
	out[3] = bb_transfer_opacity_for_step(out[3], step_voxels);
	for (int k = 0; k < 3; k++)
		out[k] *= out[3];
}

/* The steeper the function, the more entries. */
static size_t entries_for(const struct bb_transfer *tf, double step_voxels)
{
	double steepest = 0, a[4], b[4];
	size_t n = LEAST_ENTRIES;

	for (size_t i = 0; i + 1 < tf->n; i++) {
		const double width = tf->point[i + 1].value - tf->point[i].value;
		premultiplied(tf, tf->point[i].value, step_voxels, a);
		premultiplied(tf, tf->point[i + 1].value, step_voxels, b);
		for (int k = 0; k < 4; k++)
			steepest = fmax(steepest, fabs(b[k] - a[k]) / width);
	}
	while (n < MOST_ENTRIES && steepest / (2 * (double)n) > ERROR_MOST)
		n *= 2;
	return n;
}

static void fill(uint64_t *entry, size_t n, const struct bb_transfer *tf, double step_voxels)
{
	double rgba[4];

	for (size_t i = 0; i < n; i++) {
		premultiplied(tf, (double)i / (double)(n - 1), step_voxels, rgba);
		entry[i] = 0;
		for (int k = 0; k < 4; k++) {
			const float v = (float)rgba[k] * BB_CAST_SCALE;
			/* A denormal would be one as a float, too, and those are slow. */
			entry[i] |= (uint64_t)(v < 0x1p-14F ? 0 : bb_to_half(v)) << 16 * k;
		}
	}
	entry[n] = 0;
}

static void find_shown(struct bb_cast_table *t)
{
	size_t first = t->n, end = 0;

	for (size_t up = 0; up < t->n_levels; up++)
		for (size_t i = 0; i < t->n; i++)
			if (t->entry[up * (t->n + 1) + i] >> 48) { /* opacity; without it there is no colour either */
				first = i < first ? i : first;
				end = i + 1 > end ? i + 1 : end;
			}
	t->shown[0] = (float)first;
	t->shown[1] = (float)end;
}

/* ---- straight pieces ---- */

static void at_step(const struct bb_transfer *tf, double v, double step_voxels, double out[4])
{
	bb_transfer_at(tf, v, out);
	out[3] = bb_transfer_opacity_for_step(out[3], step_voxels);
}

static bool good_at(const struct bb_cast_pieces *p, const struct bb_transfer *tf, double v, double step_voxels)
{
	const double x = v * BB_CAST_PIECES;
	const int i = x < BB_CAST_PIECES ? (int)x : BB_CAST_PIECES - 1;
	double rgba[4];

	at_step(tf, v, step_voxels, rgba);
	for (int k = 0; k < 4; k++) {
		const double off = fabs((double)p->from[k][i] + (double)p->by[k][i] * x - rgba[k]);
		if (k == 3 ? off > PIECE_ERROR * rgba[3] + 1e-7 : off > PIECE_ERROR && rgba[3] > 0)
			return false;
	}
	return true;
}

/* Errors of neighbouring samples are alike and add up, so they must be small beside the opacity itself. */
static bool fill_pieces(struct bb_cast_pieces *p, const struct bb_transfer *tf, double step_voxels)
{
	double here[4], next[4];

	at_step(tf, 0, step_voxels, here);
	for (int i = 0; i < BB_CAST_PIECES; i++) {
		at_step(tf, (i + 1.0) / BB_CAST_PIECES, step_voxels, next);
		for (int k = 0; k < 4; k++) {
			p->by[k][i] = (float)(next[k] - here[k]);
			p->from[k][i] = (float)(here[k] - (next[k] - here[k]) * i);
		}
		memcpy(here, next, sizeof(here));
	}
	for (int i = 0; i <= BB_CAST_PIECES * 16; i++)
		if (!good_at(p, tf, i / (BB_CAST_PIECES * 16.0), step_voxels))
			return false;
	for (size_t i = 0; i < tf->n; i++)
		if (!good_at(p, tf, tf->point[i].value, step_voxels))
			return false;
	return true;
}

bool bb_cast_table_update(struct bb_cast_table *t, const struct bb_transfer *tf, double step_voxels, size_t n_levels,
			  bool *changed)
{
	const bool same_tf = t->entry && same_transfer(&t->transfer, tf);

	*changed = !same_tf;
	if (same_tf && step_voxels == t->step_voxels && n_levels <= t->n_levels)
		return true;
	const size_t n = entries_for(tf, step_voxels);
	uint64_t *entry = aligned_alloc(64, ((n + 1) * n_levels * sizeof(*entry) + 127) / 64 * 64);
	struct bb_cast_pieces *pieces = aligned_alloc(64, n_levels * sizeof(*pieces));
	if (!entry || !pieces) {
		free(entry);
		free(pieces);
		return false;
	}
	t->smooth = true;
	for (size_t up = 0; up < n_levels; up++) {
		fill(entry + up * (n + 1), n, tf, ldexp(step_voxels, (int)up));
		t->smooth = fill_pieces(&pieces[up], tf, ldexp(step_voxels, (int)up)) && t->smooth;
	}
	free(t->entry);
	free(t->pieces);
	t->entry = entry;
	t->pieces = pieces;
	t->n = n;
	t->n_levels = n_levels;
	find_shown(t);
	t->transfer = *tf;
	t->step_voxels = step_voxels;
	return true;
}

void bb_cast_table_release(struct bb_cast_table *t)
{
	free(t->entry);
	free(t->pieces);
	*t = (struct bb_cast_table){ 0 };
}
