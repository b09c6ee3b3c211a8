/*
 * render/cpu/cast.c: the native ray caster as a renderer: prepares what its kernels read, and deals tiles to threads. A
 * pixel depends on nothing but its own packet, so the picture is the same for any number of threads.
 */
#include "render/cpu/cast.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/cpu/layers.h"
#include "render/cpu/options.h"
#include "render/parallel.h"

#define OPAQUE (1.0F / 8192) /* transmittance below which nothing behind can be seen: 1/32 of a grey level */
#define NEVER (-1.0F)

struct caster {
	struct bb_renderer base;
	bb_cast_tile_fn *tile;
	struct bb_renderer_cpu_options options;
	struct bb_cast_table table;
	struct bb_cast_space space;
	struct bb_layers_caster layers; /* draws what one volume's kernels do not */
};

static const struct kernel {
	const char *name;
	bb_cast_tile_fn *tile;
} kernels[] = { { "avx512", bb_cast_tile_avx512 },
		{ "avx2", bb_cast_tile_avx2 },
		{ "portable", bb_cast_tile_portable } };

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

struct job {
	const struct caster *caster;
	const struct bb_cast *cast;
	struct bb_cast_counts counts[BB_PARALLEL_MOST]; /* by thread */
};

static void draw_tile(void *ctx, size_t i, unsigned thread)
{
	struct job *job = ctx;
	struct bb_cast_counts n = { 0 };

	job->caster->tile(job->cast, (uint32_t)i, &n);
	job->counts[thread].rays += n.rays;
	job->counts[thread].samples += n.samples;
}

static enum bb_status prepare(struct caster *c, const struct bb_draw *draw)
{
	const struct bb_layer *layer = &draw->layers[0];
	bool changed;

	if (!bb_cast_table_update(&c->table, layer->transfer, draw->step_voxels,
				  draw->steps_by_level ? c->space.up_most + 1 : 1, &changed) ||
	    !bb_cast_space_update(&c->space, layer->atlas, layer->transfer, changed, !c->options.no_skipping,
				  c->options.threads))
		return bb_fail(&c->base.last_error, BB_ERR_NOMEM, 1702, NULL, "a caster's tables");
	/* Which levels there are is known only now. */
	if (draw->steps_by_level &&
	    !bb_cast_table_update(&c->table, layer->transfer, draw->step_voxels, c->space.up_most + 1, &changed))
		return bb_fail(&c->base.last_error, BB_ERR_NOMEM, 1702, NULL, "a caster's tables");
	return BB_OK;
}

/* Where rays cross the screen, turned around: eye + z * (corner + x / z * across + y / z * down) = p. */
static void find_screen(const struct bb_rays *r, struct bb_cast *cast)
{
	const struct bb_vec3 sides = bb_vec3_cross(r->across_m, r->down_m);
	const double volume = bb_vec3_dot(r->corner_m, sides); /* not 0: bb_rays_make saw to that */
	const struct bb_vec3 by[3] = { bb_vec3_cross(r->down_m, r->corner_m), bb_vec3_cross(r->corner_m, r->across_m), sides };
	const double per_m[3] = { r->voxels_per_m.x, r->voxels_per_m.y, r->voxels_per_m.z };
	const double dim[3] = { r->dim.x, r->dim.y, r->dim.z }, eye_m[3] = { r->eye_m.x, r->eye_m.y, r->eye_m.z };

	for (int a = 0; a < 3; a++)
		cast->eye[a] = eye_m[a] * per_m[a] + dim[a] / 2;
	for (int k = 0; k < 3; k++) {
		const double row[3] = { by[k].x, by[k].y, by[k].z };
		cast->screen[k][3] = 0;
		for (int a = 0; a < 3; a++) {
			cast->screen[k][a] = row[a] / (volume * per_m[a]);
			cast->screen[k][3] -= cast->screen[k][a] * cast->eye[a];
		}
	}
}

static enum bb_status cast_one(struct caster *c, const struct bb_draw *draw, const struct bb_rays *rays,
			       struct bb_image *image, struct bb_draw_stats *stats)
{
	struct bb_cast cast = { .rays = rays,
				.image = image,
				.atlas = draw->layers[0].atlas,
				.space = &c->space,
				.table = &c->table,
				.by_level = draw->steps_by_level,
				.per_edge = 1 / (float)draw->layers[0].atlas->edge,
				.opaque = c->options.no_early_exit ? NEVER : OPAQUE,
				.order = c->options.order };
	struct job job = { .caster = c, .cast = &cast };
	const size_t tiles = (size_t)bb_cast_tiles_across(image) * ((image->height + BB_CAST_TILE - 1) / BB_CAST_TILE);

	if (c->options.order && c->options.n_order != (size_t)image->width * image->height)
		return BB_ERR_RANGE;
	const enum bb_status st = prepare(c, draw);
	if (st != BB_OK)
		return st;
	cast.unit = cast.by_level ? ldexp(1, (int)c->space.up_most) : 1;
	find_screen(rays, &cast);
	bb_parallel(c->options.threads, tiles, draw_tile, &job);
	for (unsigned t = 0; t < c->options.threads; t++) {
		stats->rays += job.counts[t].rays;
		stats->samples += job.counts[t].samples;
	}
	return BB_OK;
}

static enum bb_status cpu_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
			       struct bb_image *image, struct bb_draw_stats *stats)
{
	struct caster *c = bb_container_of(r, struct caster, base);

	/* Several volumes, meshes, balls and levels that are blended are the general path's. */
	if (draw->n_layers > 1 || draw->n_meshes || draw->blend_levels ||
	    draw->layers[0].atlas->kind != BB_BRICK_CARTESIAN)
		return bb_layers_caster_draw(&c->layers, draw, rays, image, stats, &r->last_error);
	return cast_one(c, draw, rays, image, stats);
}

static void cpu_forget(struct bb_renderer *r)
{
	struct caster *c = bb_container_of(r, struct caster, base);

	bb_cast_space_release(&c->space);
	bb_layers_caster_fini(&c->layers);
}

static void cpu_destroy(struct bb_renderer *r)
{
	struct caster *c = bb_container_of(r, struct caster, base);

	bb_cast_space_release(&c->space);
	bb_cast_table_release(&c->table);
	bb_layers_caster_fini(&c->layers);
	free(c);
}

static const struct bb_renderer_ops cpu_ops = { .draw = cpu_draw, .forget = cpu_forget, .destroy = cpu_destroy };

enum bb_status bb_renderer_cpu_create_with(const struct bb_renderer_cpu_options *options, struct bb_renderer **out,
					   struct bb_error *err)
{
	const struct kernel *k = NULL;

	*out = NULL;
	if (!options->threads || options->threads > BB_PARALLEL_MOST)
		return BB_ERR_RANGE;
	for (size_t i = BB_ARRAY_LEN(kernels); i-- > 0;)
		if (processor_has(kernels[i].name) &&
		    (!strcmp(options->kernel, "auto") || !strcmp(options->kernel, kernels[i].name)))
			k = &kernels[i];
	if (!k)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1801, NULL, "no kernel '%.16s' for this processor",
			       options->kernel);
	struct caster *c = calloc(1, sizeof(*c));
	if (!c)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a caster");
	const enum bb_status st = bb_layers_caster_init(&c->layers, k->name, options->threads, err);
	if (st != BB_OK) {
		free(c);
		return st;
	}
	c->base.ops = &cpu_ops;
	c->tile = k->tile;
	c->options = *options;
	c->options.kernel = k->name;
	snprintf(c->base.description, sizeof(c->base.description), "cpu, %s, %u thread%s", k->name, options->threads,
		 options->threads == 1 ? "" : "s");
	*out = &c->base;
	return BB_OK;
}

enum bb_status bb_renderer_cpu_create(const char *kernel, unsigned threads, struct bb_renderer **out,
				      struct bb_error *err)
{
	return bb_renderer_cpu_create_with(&(struct bb_renderer_cpu_options){ .kernel = kernel, .threads = threads },
					   out, err);
}
