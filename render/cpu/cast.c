/*
 * render/cpu/cast.c: the native ray caster as a renderer: prepares what its kernels read, and deals rows of packets to
 * threads. A pixel depends on nothing but its own ray, so the picture is the same for any number of threads.
 */
#include "render/cpu/cast.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/half.h"
#include "render/parallel.h"

struct caster {
	struct bb_renderer base;
	bb_cast_row_fn *row;
	unsigned threads;
	uint64_t *table; /* [BB_CAST_TABLE], of what comes next: */
	struct bb_transfer transfer;
	double step_voxels;
	uint8_t *empty; /* [n_cells] */
	size_t n_cells;
};

static const struct kernel {
	const char *name;
	bb_cast_row_fn *row;
} kernels[] = { { "avx512", bb_cast_row_avx512 }, { "avx2", bb_cast_row_avx2 }, { "portable", bb_cast_row_portable } };

static bool processor_has(const char *name)
{
#ifdef __x86_64__
	if (!strcmp(name, "avx512"))
		return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
		       __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("fma");
	if (!strcmp(name, "avx2"))
		return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif
	return !strcmp(name, "portable");
}

static bool same_transfer(const struct bb_transfer *a, const struct bb_transfer *b)
{
	return a->n == b->n && !memcmp(a->point, b->point, a->n * sizeof(a->point[0]));
}

static void fill_table(struct caster *c, const struct bb_transfer *tf, double step_voxels)
{
	if (step_voxels == c->step_voxels && same_transfer(&c->transfer, tf))
		return;
	for (size_t i = 0; i < BB_CAST_TABLE; i++) {
		double rgba[4];
		bb_transfer_at(tf, (double)i / (BB_CAST_TABLE - 1), rgba);
		const double opacity = bb_transfer_opacity_for_step(rgba[3], step_voxels);
		c->table[i] = 0;
		for (int k = 0; k < 4; k++) {
			const float v = (float)(k < 3 ? rgba[k] * opacity : opacity) * BB_CAST_SCALE;
			/* A denormal would be one as a float, too, and those are slow. */
			c->table[i] |= (uint64_t)(v < 0x1p-14F ? 0 : bb_to_half(v)) << 16 * k;
		}
	}
	c->transfer = *tf;
	c->step_voxels = step_voxels;
}

/* What cannot be seen at this time: the flags look ahead to the neighbouring steps. */
static enum bb_status fill_empty(struct caster *c, const struct bb_atlas *atlas, uint32_t first, uint32_t next)
{
	const size_t n = (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2];

	if (n != c->n_cells) {
		free(c->empty);
		c->empty = malloc(n);
		c->n_cells = c->empty ? n : 0;
		if (!c->empty)
			return bb_fail(&c->base.last_error, BB_ERR_NOMEM, 1702, NULL, "the map of empty bricks");
	}
	for (size_t i = 0; i < n; i++)
		c->empty[i] = atlas->empty[first * n + i] && atlas->empty[next * n + i];
	return BB_OK;
}

struct job {
	const struct caster *caster;
	struct bb_cast cast;
	struct bb_cast_counts counts[BB_PARALLEL_MOST];
};

static void draw_row(void *ctx, size_t i, unsigned thread)
{
	struct job *job = ctx;

	job->caster->row(&job->cast, (uint32_t)i, &job->counts[thread]);
}

static void prepare(struct bb_cast *cast, const struct bb_atlas *atlas, double time)
{
	const size_t n_cells = (size_t)atlas->grid[0] * atlas->grid[1] * atlas->grid[2];
	const size_t n_coarse = (size_t)atlas->coarse_dim[0] * atlas->coarse_dim[1] * atlas->coarse_dim[2];
	const uint32_t first = (uint32_t)time, next = first + 1 < atlas->n_steps ? first + 1 : first;
	const uint32_t steps[2] = { first, next };

	cast->bricks = atlas->bricks;
	cast->n_steps = time <= first || next == first ? 1 : 2;
	cast->mix = (float)(time - first);
	for (int k = 0; k < 2; k++)
		cast->step[k] =
			(struct bb_cast_step){ atlas->slot + steps[k] * n_cells, atlas->coarse + steps[k] * n_coarse };
	for (int a = 0; a < 3; a++) {
		cast->grid[a] = atlas->grid[a];
		cast->coarse_dim[a] = atlas->coarse_dim[a];
		cast->coarse_most[a] = (float)(atlas->coarse_dim[a] - 1);
	}
}

static enum bb_status cpu_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
			       struct bb_image *image, struct bb_draw_stats *stats)
{
	struct caster *c = bb_container_of(r, struct caster, base);
	const struct bb_atlas *atlas = bb_stream_atlas(draw->stream);
	struct job job = { .caster = c, .cast = { .rays = rays, .image = image, .table = c->table } };

	prepare(&job.cast, atlas, rays->time);
	job.cast.most[0] = (float)rays->dim.x - 1;
	job.cast.most[1] = (float)rays->dim.y - 1;
	job.cast.most[2] = (float)rays->dim.z - 1;
	const uint32_t first = (uint32_t)rays->time;
	const enum bb_status status = fill_empty(c, atlas, first, first + (job.cast.n_steps == 2));
	if (status)
		return status;
	job.cast.empty = c->empty;
	fill_table(c, bb_stream_config(draw->stream)->transfer, draw->step_voxels);
	bb_parallel(c->threads, (image->height + BB_CAST_SIDE - 1) / BB_CAST_SIDE, draw_row, &job);
	for (unsigned i = 0; i < c->threads; i++) {
		stats->rays += job.counts[i].rays;
		stats->samples += job.counts[i].samples;
	}
	return BB_OK;
}

static void cpu_forget(struct bb_renderer *r)
{
	(void)r; /* it reads the atlas where it is */
}

static void cpu_destroy(struct bb_renderer *r)
{
	struct caster *c = bb_container_of(r, struct caster, base);

	free(c->table);
	free(c->empty);
	free(c);
}

static const struct bb_renderer_ops cpu_ops = { .draw = cpu_draw, .forget = cpu_forget, .destroy = cpu_destroy };

enum bb_status bb_renderer_cpu_create(const char *kernel, unsigned threads, struct bb_renderer **out,
				      struct bb_error *err)
{
	const struct kernel *k = NULL;

	*out = NULL;
	if (!threads || threads > BB_PARALLEL_MOST)
		return BB_ERR_RANGE;
	for (size_t i = BB_ARRAY_LEN(kernels); i-- > 0;)
		if (processor_has(kernels[i].name) && (!strcmp(kernel, "auto") || !strcmp(kernel, kernels[i].name)))
			k = &kernels[i];
	if (!k)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1801, NULL, "no kernel '%.16s' for this processor", kernel);
	struct caster *c = calloc(1, sizeof(*c));
	if (c)
		c->table = malloc(BB_CAST_TABLE * sizeof(*c->table));
	if (!c || !c->table) {
		free(c);
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a caster");
	}
	c->base.ops = &cpu_ops;
	c->row = k->row;
	c->threads = threads;
	snprintf(c->base.description, sizeof(c->base.description), "cpu, %s, %u thread%s", k->name, threads,
		 threads == 1 ? "" : "s");
	*out = &c->base;
	return BB_OK;
}
