/*
 * render/cpu/cast_layers.c: pictures of several layers and meshes (layers.h): prepares them, deals tiles to threads,
 * and merges what the layers and meshes of a ray hand out. A pixel depends on nothing but its own ray, so the picture is
 * the same for any number of threads.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/cpu/layers.h"
#include "render/parallel.h"

#define TILE 16
#define OPAQUE (1.0F / 16384)

struct tiles { /* of one picture; constant but for the counts */
	const struct bb_draw *draw;
	const struct bb_layer_ready *layer;
	const struct bb_mesh_scene *meshes; /* or NULL */
	struct bb_image *image;
	struct {
		uint64_t rays, samples, alone[6]; /* a line of the cache for each thread */
	} counts[BB_PARALLEL_MOST];
};

struct pixel {
	struct bb_layer_walk walk[BB_LAYERS_MOST];
	size_t n_layers;
	struct bb_mesh_fragments fragments;
	size_t next_fragment;
	bb_layer_rgba sum; /* premultiplied */
};

static double distance(const struct bb_layer_walk *w, uint32_t at)
{
	return w->ray.enter_m + (w->number[at] + 0.5) * w->layer->rays->step_m;
}

/* How many of the batch lie before limit_m (at it, too: ties). */
static uint32_t before(const struct bb_layer_walk *w, double limit_m, bool ties)
{
	uint32_t end = w->at;

	if (limit_m == HUGE_VAL)
		return w->n;
	for (; end < w->n; end++) {
		const double m = distance(w, end);
		if (m > limit_m || (m == limit_m && !ties))
			break;
	}
	return end;
}

static void add_samples(struct pixel *px, struct bb_layer_walk *w, uint32_t end)
{
	bb_layer_rgba sum = px->sum;

	for (; w->at < end; w->at++) {
		const float entry = w->value[w->at] * BB_LAYER_TABLE;
		const int k = (int)entry;
		const bb_layer_rgba *t = &w->layer->table[w->up[w->at]][k];
		sum += (t[0] + (t[1] - t[0]) * (entry - (float)k)) * (1 - sum[3]);
	}
	px->sum = sum;
}

static void add_fragment(struct pixel *px)
{
	const double *rgba = px->fragments.at[px->next_fragment++].rgba;
	const float weight = (1 - px->sum[3]) * (float)rgba[3];

	px->sum += (bb_layer_rgba){ (float)rgba[0], (float)rgba[1], (float)rgba[2], 1 } * weight;
}

/* The distance of what a layer, or the meshes (n_layers), come with next. */
static double head_of(struct pixel *px, size_t k)
{
	if (k == px->n_layers)
		return px->next_fragment < px->fragments.n ? px->fragments.at[px->next_fragment].at_m : HUGE_VAL;
	struct bb_layer_walk *w = &px->walk[k];
	return w->at < w->n || bb_layer_walk_on(w) ? distance(w, w->at) : HUGE_VAL;
}

/* Who comes next, and until which distance nobody else does. A layer of a lower number comes before others at the same
 * distance, a mesh after all of them. */
static size_t next_of(const double *head_m, size_t n, double *limit_m, bool *ties)
{
	size_t best = 0, second = 0;

	*limit_m = HUGE_VAL;
	for (size_t k = 1; k < n; k++) {
		const size_t later = head_m[k] < head_m[best] ? best : k;
		best = head_m[k] < head_m[best] ? k : best;
		if (head_m[later] < *limit_m) {
			second = later;
			*limit_m = head_m[later];
		}
	}
	*ties = best < second;
	return best;
}

static void draw_ray(struct pixel *px)
{
	const size_t n = px->n_layers + (px->fragments.n > 0);
	double head_m[BB_LAYERS_MOST + 1] = { HUGE_VAL }, limit_m;
	bool ties;

	for (size_t k = 0; k < n; k++)
		head_m[k] = head_of(px, k);
	while (1 - px->sum[3] >= OPAQUE) {
		const size_t k = next_of(head_m, n, &limit_m, &ties);
		if (k >= n || head_m[k] == HUGE_VAL)
			return;
		if (k == px->n_layers)
			add_fragment(px);
		else
			add_samples(px, &px->walk[k], before(&px->walk[k], limit_m, ties));
		head_m[k] = head_of(px, k);
	}
}

static uint8_t level(float v)
{
	return (uint8_t)(v < 1 ? v * 255 + 0.5F : 255);
}

static void draw_pixel(struct tiles *t, uint32_t column, uint32_t row, unsigned thread)
{
	uint8_t *out = t->image->rgba + ((size_t)row * t->image->width + column) * 4;
	struct pixel px;

	px.n_layers = t->draw->n_layers;
	px.sum = (bb_layer_rgba){ 0 };
	px.fragments.n = px.next_fragment = 0;
	for (size_t k = 0; k < px.n_layers; k++) {
		bb_layer_walk_begin(&px.walk[k], &t->layer[k], column, row);
		t->counts[thread].rays += px.walk[k].ray.n > 0;
	}
	if (t->meshes) {
		const struct bb_mesh_ray ray =
			bb_mesh_ray_at(t->draw->view, t->image->width, t->image->height, column, row);
		bb_mesh_scene_meets(t->meshes, &ray, &px.fragments);
	}
	draw_ray(&px);
	for (size_t k = 0; k < px.n_layers; k++)
		t->counts[thread].samples += px.walk[k].samples;
	for (int c = 0; c < 4; c++)
		out[c] = level(px.sum[c]);
}

static void draw_tile(void *ctx, size_t i, unsigned thread)
{
	struct tiles *t = ctx;
	const uint32_t across = (t->image->width + TILE - 1) / TILE;
	const uint32_t x0 = (uint32_t)(i % across) * TILE, y0 = (uint32_t)(i / across) * TILE;

	for (uint32_t y = y0; y < y0 + TILE && y < t->image->height; y++)
		for (uint32_t x = x0; x < x0 + TILE && x < t->image->width; x++)
			draw_pixel(t, x, y, thread);
}

static void draw_tiles(struct tiles *t, unsigned threads, struct bb_draw_stats *stats)
{
	const size_t across = (t->image->width + TILE - 1) / TILE, down = (t->image->height + TILE - 1) / TILE;

	bb_parallel(threads, across * down, draw_tile, t);
	for (unsigned i = 0; i < BB_PARALLEL_MOST; i++) {
		stats->rays += t->counts[i].rays;
		stats->samples += t->counts[i].samples;
	}
}

/* ---- what is kept from picture to picture ---- */

static enum bb_status take_meshes(struct bb_layers_caster *c, const struct bb_draw *draw, struct bb_error *err)
{
	if (c->meshes && bb_mesh_scene_is_of(c->meshes, draw->meshes, draw->n_meshes))
		return BB_OK;
	bb_mesh_scene_destroy(c->meshes);
	c->meshes = NULL;
	if (!draw->n_meshes)
		return BB_OK;
	return bb_mesh_scene_create(draw->meshes, draw->n_meshes, c->without_embree, &c->meshes, err);
}

enum bb_status bb_layers_caster_draw(struct bb_layers_caster *c, const struct bb_draw *draw, const struct bb_rays *rays,
				     struct bb_image *image, struct bb_draw_stats *stats, struct bb_error *err)
{
	struct bb_layer_ready ready[BB_LAYERS_MOST];
	struct tiles tiles = { .draw = draw, .layer = ready, .image = image };
	size_t n = 0;

	enum bb_status st = take_meshes(c, draw, err);
	tiles.meshes = c->meshes;
	for (; st == BB_OK && n < draw->n_layers; n++) {
		st = bb_layer_make_ready(draw, n, &rays[n], c->kernel, c->threads, &ready[n], err);
		if (st != BB_OK)
			break;
	}
	if (st == BB_OK)
		draw_tiles(&tiles, c->threads, stats);
	while (n-- > 0)
		bb_layer_unready(&ready[n]);
	return st;
}

static bool processor_has(const struct bb_layer_kernel *k)
{
	if (!k->sample)
		return false; /* not built for this architecture */
#ifdef __x86_64__
	if (k == &bb_layer_kernel_avx512)
		return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
		       __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("fma");
	if (k == &bb_layer_kernel_avx2)
		return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif
	return k == &bb_layer_kernel_portable;
}

enum bb_status bb_layers_caster_init(struct bb_layers_caster *c, const char *kernel, unsigned threads,
				     struct bb_error *err)
{
	static const struct bb_layer_kernel *const kernels[] = { &bb_layer_kernel_avx512, &bb_layer_kernel_avx2,
								 &bb_layer_kernel_portable };

	*c = (struct bb_layers_caster){ .threads = threads };
	for (size_t i = BB_ARRAY_LEN(kernels); i-- > 0;)
		if (processor_has(kernels[i]) && (!strcmp(kernel, "auto") || !strcmp(kernel, kernels[i]->name)))
			c->kernel = kernels[i];
	if (!c->kernel)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1801, NULL, "no kernel '%.16s' for this processor", kernel);
	return BB_OK;
}

void bb_layers_caster_fini(struct bb_layers_caster *c)
{
	bb_mesh_scene_destroy(c->meshes);
	c->meshes = NULL;
}

enum bb_status bb_cast_layers(const struct bb_draw *draw, const struct bb_rays *rays, unsigned threads,
			      struct bb_image *image, struct bb_draw_stats *stats, struct bb_error *err)
{
	struct bb_layers_caster c;
	enum bb_status st = bb_layers_caster_init(&c, "auto", threads, err);

	if (st == BB_OK)
		st = bb_layers_caster_draw(&c, draw, rays, image, stats, err);
	bb_layers_caster_fini(&c);
	return st;
}

/* ---- a renderer of its own ---- */

struct layers_renderer {
	struct bb_renderer base;
	struct bb_layers_caster caster;
};

static enum bb_status layers_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
				  struct bb_image *image, struct bb_draw_stats *stats)
{
	struct layers_renderer *l = bb_container_of(r, struct layers_renderer, base);

	return bb_layers_caster_draw(&l->caster, draw, rays, image, stats, &r->last_error);
}

static void layers_forget(struct bb_renderer *r)
{
	bb_layers_caster_fini(&bb_container_of(r, struct layers_renderer, base)->caster);
}

static void layers_destroy(struct bb_renderer *r)
{
	struct layers_renderer *l = bb_container_of(r, struct layers_renderer, base);

	bb_layers_caster_fini(&l->caster);
	free(l);
}

static const struct bb_renderer_ops layers_ops = { .draw = layers_draw,
						   .forget = layers_forget,
						   .destroy = layers_destroy };

enum bb_status bb_renderer_layers_create(const char *kernel, unsigned threads, bool without_embree,
					 struct bb_renderer **out, struct bb_error *err)
{
	*out = NULL;
	if (!threads || threads > BB_PARALLEL_MOST)
		return BB_ERR_RANGE;
	struct layers_renderer *l = calloc(1, sizeof(*l));
	if (!l)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a caster of layers");
	const enum bb_status st = bb_layers_caster_init(&l->caster, kernel, threads, err);
	if (!l->caster.kernel) {
		free(l);
		return st;
	}
	l->caster.without_embree = without_embree;
	l->base.ops = &layers_ops;
	snprintf(l->base.description, sizeof(l->base.description), "layers, %s, %u thread%s", l->caster.kernel->name,
		 threads, threads == 1 ? "" : "s");
	*out = &l->base;
	return BB_OK;
}
