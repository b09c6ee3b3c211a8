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

static enum bb_status cpu_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
			       struct bb_image *image, struct bb_draw_stats *stats)
{ (void)r; (void)draw; (void)rays; (void)image; (void)stats; (void)fill_table; return BB_ERR_UNSUPPORTED; }

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
