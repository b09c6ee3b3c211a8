/*
 * sync/blobs/finder.c: runs and parts in one pass over the rows. Only the runs of two rows and the parts that reach into
 * the newest are kept: a part that no run of a row continues is complete, is measured, and its place is free again.
 */
#include "sync/blobs/blobs_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PARTS_LEAST 64

struct run {
	uint32_t begin, end; /* columns, half open */
	uint32_t part;
};

struct row {
	struct run *run;
	size_t n;
};

struct bb_blob_finder {
	struct bb_blobs_config config;
	const char *kernel;
	bb_blobs_scan_fn *scan;
	uint32_t width, height;
	struct row row[2];             /* this one and the one above, in turn */
	struct bb_blobs_part *part;
	uint32_t *spare, n_spare;      /* places no part holds */
	uint32_t *swallowed, n_swallowed; /* by others in this row: free when its runs know */
	uint32_t n_parts;
	/* of the picture at hand */
	struct bb_blobs_picture pic;
	struct bb_spot *out;
	size_t cap;
	struct bb_blobs_found found;
};

static const struct kernel {
	const char *name;
	bb_blobs_scan_fn *scan;
} kernels[] = { { "avx512", bb_blobs_scan_avx512 },
	        { "avx2", bb_blobs_scan_avx2 },
	        { "portable", bb_blobs_scan_portable } };

static bool processor_has(const char *name)
{
#ifdef __x86_64__
	if (!strcmp(name, "avx512"))
		return __builtin_cpu_supports("avx512bw");
	if (!strcmp(name, "avx2"))
		return __builtin_cpu_supports("avx2");
#endif
	return !strcmp(name, "portable");
}

struct bb_blobs_config bb_blobs_usual(void)
{
	return (struct bb_blobs_config){ .low = 14, .high = 28, .black = 4, .least_area_px = 3, .most_area_px = 2000,
		                         .least_roundness = 0.5, .most_spots = BB_CAMERA_BLOBS_MAX, .most_runs = 16384,
		                         .refine = true };
}

struct bb_blobs_config bb_blobs_above(double black, double noise)
{
	struct bb_blobs_config c = bb_blobs_usual();

	c.black = black;
	c.low = (int)ceil(fmin(black + fmax(10, 3 * noise), 256));
	c.high = (int)ceil(fmin(black + fmax(24, 6 * noise), 256));
	return c;
}

static bool in(double value, double least, double most)
{
	return value >= least && value <= most; /* false for NaN */
}

static bool config_holds(const struct bb_blobs_config *c)
{
	return in(c->low, 1, 255) && in(c->high, c->low, 255) && in(c->black, 0, c->low - 0.5) &&
	       in(c->least_area_px, 0, 1e6) && in(c->most_area_px, c->least_area_px, 1e6) &&
	       in(c->least_roundness, 0, 1) && c->most_spots >= 1 && c->most_spots <= 65536 && c->most_runs >= 1;
}

static bool take_memory(struct bb_blob_finder *f)
{
	const size_t runs = f->width / 2 + 1; /* of a row; there is a dark pixel between two */

	/* As many parts may be under way as spots are wanted, and one more in each gap between them. */
	f->n_parts = (uint32_t)(f->config.most_spots < PARTS_LEAST ? PARTS_LEAST : 2 * f->config.most_spots);
	f->row[0].run = calloc(runs, sizeof(struct run));
	f->row[1].run = calloc(runs, sizeof(struct run));
	f->part = calloc(f->n_parts, sizeof(*f->part));
	f->spare = calloc(f->n_parts, sizeof(*f->spare));
	f->swallowed = calloc(f->n_parts, sizeof(*f->swallowed));
	return f->row[0].run && f->row[1].run && f->part && f->spare && f->swallowed;
}

enum bb_status bb_blob_finder_create(const struct bb_blobs_config *config, int64_t width_px, int64_t height_px,
                                     struct bb_blob_finder **out)
{
	const struct kernel *k = NULL;

	*out = NULL;
	if (!config_holds(config) || width_px < 1 || height_px < 1 || width_px > BB_BLOBS_EDGE_MAX ||
	    height_px > BB_BLOBS_EDGE_MAX)
		return BB_ERR_RANGE;
	for (size_t i = 0; i < BB_ARRAY_LEN(kernels) && !k; i++)
		if ((!config->kernel || !strcmp(config->kernel, kernels[i].name)) && processor_has(kernels[i].name))
			k = &kernels[i];
	if (!k)
		return BB_ERR_UNSUPPORTED;
	struct bb_blob_finder *f = calloc(1, sizeof(*f));
	if (!f)
		return BB_ERR_NOMEM;
	f->config = *config;
	f->kernel = k->name;
	f->scan = k->scan;
	f->width = (uint32_t)width_px;
	f->height = (uint32_t)height_px;
	if (!take_memory(f)) {
		bb_blob_finder_destroy(f);
		return BB_ERR_NOMEM;
	}
	*out = f;
	return BB_OK;
}

void bb_blob_finder_destroy(struct bb_blob_finder *f)
{
	if (!f)
		return;
	free(f->row[0].run);
	free(f->row[1].run);
	free(f->part);
	free(f->spare);
	free(f->swallowed);
	free(f);
}

const char *bb_blob_finder_kernel(const struct bb_blob_finder *f)
{
	return f->kernel;
}

/* Parts */

static uint32_t root(struct bb_blob_finder *f, uint32_t i)
{
	while (f->part[i].parent != i) {
		f->part[i].parent = f->part[f->part[i].parent].parent;
		i = f->part[i].parent;
	}
	return i;
}

static uint32_t least(uint32_t a, uint32_t b)
{
	return a < b ? a : b;
}

static uint32_t most(uint32_t a, uint32_t b)
{
	return a > b ? a : b;
}

/* The pixels of a run, once: sums along it in 64 bits, moved to the picture's corner. What is larger than any spot
 * only counts its pixels. */
static void add_run(struct bb_blob_finder *f, struct bb_blobs_part *p, const uint8_t *row, const struct run *r, uint32_t y)
{
	uint64_t w = 0, wk = 0, wkk = 0;
	int peak = p->peak;

	p->area += r->end - r->begin;
	p->x0 = least(p->x0, r->begin);
	p->x1 = most(p->x1, r->end - 1);
	p->y0 = least(p->y0, y);
	p->y1 = p->last_row = y;
	if ((double)p->area > f->config.most_area_px)
		return;
	for (uint32_t x = r->begin; x < r->end; x++) {
		const int level = row[x];
		const uint64_t v = (uint64_t)level - (uint64_t)f->config.low + 1, k = x - r->begin;
		w += v;
		wk += v * k;
		wkk += v * k * k;
		peak = level > peak ? level : peak;
	}
	const uint64_t b = r->begin, wx = wk + b * w;
	p->w += w;
	p->wx += wx;
	p->wy += y * w;
	p->wxx += wkk + 2 * b * wk + b * b * w;
	p->wxy += y * wx;
	p->wyy += (uint64_t)y * y * w;
	p->peak = peak;
}

static void swallow(struct bb_blob_finder *f, uint32_t into, uint32_t from)
{
	struct bb_blobs_part *a = &f->part[into], *b = &f->part[from];

	a->area += b->area;
	a->w += b->w;
	a->wx += b->wx;
	a->wy += b->wy;
	a->wxx += b->wxx;
	a->wxy += b->wxy;
	a->wyy += b->wyy;
	a->x0 = least(a->x0, b->x0);
	a->x1 = most(a->x1, b->x1);
	a->y0 = least(a->y0, b->y0);
	a->peak = b->peak > a->peak ? b->peak : a->peak;
	b->parent = into;
	f->swallowed[f->n_swallowed++] = from;
}

/* Rows */

/* A run belongs to the parts of all runs above that it touches, corners included; `above` moves along with it. False:
 * no place for a new part. */
static bool join(struct bb_blob_finder *f, const struct row *up, size_t *above, struct run *r, uint32_t y)
{
	bool has_part = false;

	while (*above < up->n && up->run[*above].end < r->begin)
		++*above;
	for (size_t i = *above; i < up->n && up->run[i].begin <= r->end; i++) {
		const uint32_t part = root(f, up->run[i].part);
		if (has_part && part != r->part)
			swallow(f, r->part, part);
		else
			r->part = part;
		has_part = true;
	}
	if (has_part)
		return true;
	if (!f->n_spare)
		return false;
	r->part = f->spare[--f->n_spare];
	f->part[r->part] = (struct bb_blobs_part){ .parent = r->part, .x0 = r->begin, .y0 = y };
	return true;
}

static bool take_row(struct bb_blob_finder *f, const struct row *up, struct row *now, uint32_t y, size_t from)
{
	const uint8_t *row = f->pic.grey + y * f->pic.stride_bytes;
	size_t above = 0;

	for (size_t x = f->scan(row, from, f->width, f->config.low); x < f->width;
	     x = f->scan(row, x, f->width, f->config.low)) {
		struct run *r = &now->run[now->n];
		r->begin = (uint32_t)x;
		while (x < f->width && row[x] >= f->config.low)
			x++;
		r->end = (uint32_t)x;
		if (f->found.runs == f->config.most_runs || !join(f, up, &above, r, y))
			return false;
		f->found.runs++;
		now->n++;
		add_run(f, &f->part[r->part], row, r, y);
	}
	return true;
}

static bool finish(struct bb_blob_finder *f, uint32_t part)
{
	struct bb_spot spot;

	f->spare[f->n_spare++] = part;
	if (!bb_blobs_measure(&f->config, &f->pic, &f->part[part], &spot)) {
		f->found.refused++;
		return true;
	}
	if (f->found.n == f->cap || f->found.n == f->config.most_spots)
		return false;
	f->out[f->found.n++] = spot;
	return true;
}

/* Parts of the row above that this one did not continue; y is this row. False: no room for a spot. */
static bool end_parts(struct bb_blob_finder *f, const struct row *up, struct row *now, uint32_t y)
{
	bool room = true;

	for (size_t i = 0; i < up->n && room; i++) {
		const uint32_t part = root(f, up->run[i].part);
		if (f->part[part].last_row == y)
			continue;
		f->part[part].last_row = y; /* once */
		room = finish(f, part);
	}
	for (size_t i = 0; i < now->n; i++)
		now->run[i].part = root(f, now->run[i].part);
	while (f->n_swallowed)
		f->spare[f->n_spare++] = f->swallowed[--f->n_swallowed];
	return room;
}

/* The next row with something in it and its first bright pixel; height when there is none. Rows without gaps are one
 * long row. */
static uint32_t skip_dark(const struct bb_blob_finder *f, uint32_t y, size_t *x)
{
	const struct bb_blobs_picture *p = &f->pic;

	if (p->stride_bytes == p->width) {
		const size_t all = (size_t)p->width * p->height;
		const size_t at = f->scan(p->grey, (size_t)y * p->width, all, f->config.low);
		*x = at % p->width;
		return (uint32_t)(at / p->width);
	}
	for (*x = p->width; y < p->height; y++) {
		*x = f->scan(p->grey + y * p->stride_bytes, 0, p->width, f->config.low);
		if (*x < p->width)
			break;
	}
	return y;
}

static void begin(struct bb_blob_finder *f, const uint8_t *grey, size_t stride_bytes, struct bb_spot *out, size_t cap)
{
	f->pic = (struct bb_blobs_picture){ grey, stride_bytes, f->width, f->height };
	f->found = (struct bb_blobs_found){ .n = 0 };
	f->out = out;
	f->cap = cap;
	f->n_swallowed = f->n_spare = 0;
	for (uint32_t i = f->n_parts; i--;)
		f->spare[f->n_spare++] = i;
	f->row[0].n = f->row[1].n = 0;
}

struct bb_blobs_found bb_blobs_find(struct bb_blob_finder *f, const uint8_t *grey, size_t stride_bytes,
                                    struct bb_spot *out, size_t cap)
{
	struct row *up = &f->row[0], *now = &f->row[1];
	bool room = true;

	begin(f, grey, stride_bytes, out, cap);
	for (uint32_t y = 0; room && y < f->height; y++) {
		size_t from = 0;
		if (!up->n)
			y = skip_dark(f, y, &from);
		if (y == f->height)
			break;
		now->n = 0;
		room = take_row(f, up, now, y, from) && end_parts(f, up, now, y);
		struct row *const was = up;
		up = now;
		now = was;
	}
	now->n = 0;
	if (room)
		room = end_parts(f, up, now, f->height);
	f->found.overflow = !room;
	return f->found;
}
