/*
 * render/bricks/build_slab.c: the voxels of a slab: read or taken from the scratch file, averaged over time; and
 * what the next level gets of them.
 */
#include "render/bricks/build_private.h"
#include "render/parallel.h"

#include <float.h>
#include <math.h>
#include <pthread.h>

static pthread_mutex_t range_lock = PTHREAD_MUTEX_INITIALIZER;

/* ---- the range of the data ---- */

enum { LANES = 16 }; /* side by side, so that the compiler has vectors of them */

struct ranges {
	float least[LANES], most[LANES];
	uint32_t bad[LANES];
};

static inline void widen(struct ranges *r, const float *v, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		const bool good = fabsf(v[i]) <= FLT_MAX; /* no NaN */
		const float low = good ? v[i] : FLT_MAX, high = good ? v[i] : -FLT_MAX;
		r->least[i] = low < r->least[i] ? low : r->least[i];
		r->most[i] = high > r->most[i] ? high : r->most[i];
		r->bad[i] += !good;
	}
}

static void range_of_plane(void *ctx, size_t i, unsigned thread)
{
	struct bb_build *b = ctx;
	const uint32_t *dim = b->h.tree.dim;
	const size_t n = (size_t)dim[0] * dim[1];
	float *plane = b->slab.values + thread * n;
	struct ranges r = { .bad = { 0 } };

	if (b->status || !bb_build_data(b, (uint32_t)(i / dim[2]), (uint32_t)(i % dim[2]), 0, dim[1], plane))
		return;
	for (size_t k = 0; k < LANES; k++) {
		r.least[k] = FLT_MAX;
		r.most[k] = -FLT_MAX;
	}
	for (size_t k = 0; k + LANES <= n; k += LANES)
		widen(&r, plane + k, LANES);
	widen(&r, plane + n / LANES * LANES, n % LANES);
	pthread_mutex_lock(&range_lock);
	for (size_t k = 0; k < LANES; k++) {
		b->h.n_nonfinite += r.bad[k];
		b->h.least = fmin(b->h.least, (double)r.least[k]);
		b->h.most = fmax(b->h.most, (double)r.most[k]);
	}
	pthread_mutex_unlock(&range_lock);
}

void bb_build_range(struct bb_build *b)
{
	const struct bb_tree *t = &b->h.tree;
	const size_t n = (size_t)t->dim[0] * t->dim[1];

	b->h.least = DBL_MAX;
	b->h.most = -DBL_MAX;
	b->slab.values = bb_build_alloc(b, b->threads * n, sizeof(float), "a plane for each thread");
	if (b->slab.values)
		bb_parallel(b->threads, (size_t)t->n_steps * t->dim[2], range_of_plane, b);
	bb_build_release(b, b->slab.values, b->threads * n, sizeof(float));
	b->slab.values = NULL;
	if (b->h.least > b->h.most) /* nothing but NaN */
		b->h.least = b->h.most = 0;
}

/* ---- filling ---- */

struct filling {
	struct bb_build *b;
	uint32_t z_from, z_to; /* planes to add */
};

/* Which plane of the level a plane of the slab holds. */
static uint32_t plane_of(const struct bb_build *b, uint32_t z)
{
	const uint32_t n = b->h.tree.voxels[b->level][2], pad = b->h.pad;

	if (z < BB_BUILD_ACROSS)
		return z;
	const uint32_t k = z - BB_BUILD_ACROSS; /* the last pad ones, then the first; a level may have fewer */
	return k < pad ? (n - (pad - k) % n) % n : (k - pad) % n;
}

static uint64_t mend(float *v, size_t n, float least)
{
	enum { AT_A_TIME = 4096 }; /* what 32 bits count */
	uint64_t bad = 0;

	for (size_t from = 0; from < n; from += AT_A_TIME) {
		const size_t few = n - from < AT_A_TIME ? n - from : AT_A_TIME;
		uint32_t here = 0;
		for (size_t i = from; i < from + few; i++) {
			const bool good = fabsf(v[i]) <= FLT_MAX;
			v[i] = good ? v[i] : least;
			here += !good;
		}
		bad += here;
	}
	return bad;
}

static void read_step(void *ctx, size_t i, unsigned thread)
{
	const struct filling *f = ctx;
	struct bb_build *b = f->b;
	const uint32_t tau = b->leaf[i], rows = b->slab.y_to - b->slab.y_from;
	uint64_t bad = 0;
	(void)thread;

	for (uint32_t z = f->z_from; z < f->z_to && !b->status; z++) {
		float *to = bb_build_row(b, tau, z, b->slab.y_from);
		if (!bb_build_data(b, (uint32_t)i, plane_of(b, z), b->slab.y_from, rows, to))
			return;
		const size_t nx = bb_build_row_floats(b), before = (b->y * b->h.tree.edge - b->slab.y_from) * nx;
		const uint32_t core = b->tile * b->h.tree.edge, here = rows - (uint32_t)(before / nx);
		const size_t own = (core < here ? core : here) * nx; /* the others are counted with a neighbour */
		(void)mend(to, before, (float)b->h.least);
		const uint64_t here_bad = mend(to + before, own, (float)b->h.least);
		/* Planes below were met by the unit before; after a stop they are read again. */
		const bool met = z >= BB_BUILD_ACROSS || (b->z && z < b->z * b->h.tree.edge + b->h.pad);
		bad += met ? 0 : here_bad;
		(void)mend(to + before + own, rows * nx - before - own, (float)b->h.least);
	}
	if (b->config->has_range) /* else bb_build_range has counted them */
		__atomic_fetch_add(&b->h.n_nonfinite, bad, __ATOMIC_RELAXED);
}

/* Of a time node from its two children, row by row; children have larger numbers. */
static void average_plane(void *ctx, size_t i, unsigned thread)
{
	const struct filling *f = ctx;
	const struct bb_build *b = f->b;
	const uint32_t z = f->z_from + (uint32_t)i;
	const size_t n = (size_t)(b->slab.y_to - b->slab.y_from) * bb_build_row_floats(b);
	(void)thread;

	for (uint32_t tau = b->h.tree.n_times; tau-- > 0;) {
		const struct bb_tree_span *s = &b->span[tau];
		if (bb_tree_is_step(s))
			continue;
		const float *first = bb_build_row(b, s->child[0], z, b->slab.y_from);
		const float *second = bb_build_row(b, s->child[1], z, b->slab.y_from);
		const double share = (double)(b->span[s->child[1]].to - b->span[s->child[1]].from) / (s->to - s->from);
		float *to = bb_build_row(b, tau, z, b->slab.y_from);
		for (size_t k = 0; k < n; k++)
			to[k] = (float)((double)first[k] + ((double)second[k] - (double)first[k]) *
								   share); /* equal ones stay as they are */
	}
}

static void read_spill(void *ctx, size_t i, unsigned thread)
{
	const struct filling *f = ctx;
	struct bb_build *b = f->b;
	const uint32_t *v = b->h.tree.voxels[b->level], rows = b->slab.y_to - b->slab.y_from;
	(void)thread;

	for (uint32_t z = f->z_from; z < f->z_to && !b->status; z++) {
		const uint64_t plane = (uint64_t)i * v[2] + plane_of(b, z);
		const uint64_t at = (plane * v[1] + b->slab.y_from) * v[0] * sizeof(float);
		if (!bb_build_pread(b, b->spill[b->level % 2], bb_build_row(b, (uint32_t)i, z, b->slab.y_from),
				    (size_t)rows * v[0] * sizeof(float), at))
			return;
	}
}

static void fill_planes(struct bb_build *b, uint32_t z_from, uint32_t z_to)
{
	const struct bb_tree *t = &b->h.tree;
	struct filling f = { b, z_from, z_to };

	if (!bb_build_at_leaves(b)) {
		bb_parallel(b->threads, t->n_times, read_spill, &f);
		return;
	}
	bb_parallel(b->threads, t->n_steps, read_step, &f);
	bb_parallel(b->threads, z_to - z_from, average_plane, &f);
}

/* The planes a unit needs and the ring does not have yet; a new column of units begins with an empty ring. */
void bb_build_fill(struct bb_build *b)
{
	const struct bb_tree *t = &b->h.tree;
	const uint32_t *v = t->voxels[b->level], pad = b->h.pad;
	const uint32_t z0 = b->z * t->edge, y0 = b->y * t->edge, y1 = (b->y + b->tile) * t->edge + pad;
	const uint32_t y_from = y0 > pad ? y0 - pad : 0, y_to = y1 < v[1] ? y1 : v[1];
	const uint32_t z_from = z0 > pad ? z0 - pad : 0, z1 = z0 + t->edge + pad, z_to = z1 < v[2] ? z1 : v[2];
	struct bb_build_slab *s = &b->slab;

	if (s->y_from != y_from || s->y_to != y_to || s->z_to < z_from || !b->z) {
		s->z_from = s->z_to = z_from;
		s->has_across = false;
	}
	const uint32_t z_new = s->z_to;
	s->y_from = y_from;
	s->y_to = y_to;
	s->z_from = z_from;
	s->z_to = z_to;
	fill_planes(b, z_new, z_to);
	if (!s->has_across && s->n_across)
		fill_planes(b, BB_BUILD_ACROSS, BB_BUILD_ACROSS + s->n_across);
	s->has_across = true;
}

/* ---- the next level's voxels ---- */

static void spill_time(void *ctx, size_t i, unsigned thread)
{
	struct bb_build *b = ctx;
	const uint32_t *v = b->h.tree.voxels[b->level], *w = b->h.tree.voxels[b->level - 1], edge = b->h.tree.edge;
	const uint32_t z0 = b->z * edge, z1 = z0 + edge < v[2] ? z0 + edge : v[2];
	const uint32_t y0 = b->y * edge, y1 = y0 + b->tile * edge < v[1] ? y0 + b->tile * edge : v[1];
	const size_t n = (size_t)(y1 - y0 + 1) / 2 * w[0] * sizeof(float);
	const float *from = b->half + i * (edge / 2) * bb_build_half_plane(b);
	(void)thread;

	for (uint32_t z = z0; z < z1; z += 2, from += bb_build_half_plane(b)) {
		const uint64_t at = (((uint64_t)i * w[2] + z / 2) * w[1] + y0 / 2) * w[0] * sizeof(float);
		if (!bb_build_pwrite(b, b->spill[(b->level - 1) % 2], from, n, at))
			break;
	}
}

void bb_build_spill(struct bb_build *b)
{
	if (b->level)
		bb_parallel(b->threads, b->h.tree.n_times, spill_time, b);
}
