/*
 * render/cpu/reference.c: the judge: double precision, full resolution, straight from the volume, one sample after the
 * other and nothing clever. Rows are dealt to threads by number and a pixel depends on nothing but its own ray, so the
 * picture and the counts are the same for any number of threads.
 */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>

#include "render/mesh.h"
#include "render/renderer_driver.h"

#define THREADS_MOST 64
#define OPAQUE 1e-6 /* transmittance below which nothing behind can be seen: 1/4000 of a grey level */

struct reference {
	struct bb_renderer base;
	unsigned threads;
};

struct share { /* of one thread */
	pthread_t thread;
	bool started;
	const struct bb_draw *draw;
	const struct bb_rays *rays;
	const struct bb_mesh_tree *meshes; /* or NULL */
	struct bb_image *image;
	uint32_t first_row, row_stride;
	uint64_t n_rays, n_samples;
};

static uint8_t quantise(double c)
{
	const double level = floor(c * 255 + 0.5);

	return level <= 0 ? 0 : level >= 255 ? 255 : (uint8_t)level;
}

/* Something behind what is there; sum is premultiplied, rgba is not. */
static void add_behind(const double rgba[4], double opacity, double sum[4])
{
	const double weight = (1 - sum[3]) * opacity;

	for (int c = 0; c < 3; c++)
		sum[c] += weight * rgba[c];
	sum[3] += weight;
}

static void add_sample(const struct share *sh, const struct bb_layer *layer, struct bb_vec3 at, double sum[4])
{
	double rgba[4];

	if (layer->atlas->kind == BB_BRICK_SPHERICAL) {
		struct bb_spherical ball;
		bb_spherical_of(layer->atlas->dim, layer->atlas->extent, &ball);
		if (!bb_spherical_at(&ball, at, &at))
			return;
	}
	const double p[3] = { at.x - 0.5, at.y - 0.5, at.z - 0.5 };
	bb_transfer_at(layer->transfer, bb_volume_sample(layer->volume, p, layer->atlas->time), rgba);
	if (rgba[3] > 0)
		add_behind(rgba, bb_transfer_opacity_for_step(rgba[3], sh->draw->step_voxels), sum);
}

/* What of a pixel has been drawn. */
struct pixel {
	struct bb_ray ray[BB_LAYERS_MOST];
	uint32_t next[BB_LAYERS_MOST];
	struct bb_mesh_fragments fragments;
	size_t next_fragment;
};

/* The layer whose next sample is nearest to the eye, n_layers: a mesh's surface is, n_layers + 1: nothing is left. */
static size_t nearest(const struct share *sh, const struct pixel *px)
{
	const size_t n = sh->draw->n_layers;
	double best_m = HUGE_VAL;
	size_t best = n + 1;

	for (size_t k = 0; k < n; k++) {
		const double m = px->ray[k].enter_m + (px->next[k] + 0.5) * sh->rays[k].step_m;
		if (px->next[k] < px->ray[k].n && m < best_m) {
			best = k;
			best_m = m;
		}
	}
	if (px->next_fragment < px->fragments.n && px->fragments.at[px->next_fragment].at_m < best_m)
		return n;
	return best;
}

static void add_next(struct share *sh, struct pixel *px, size_t k, double sum[4])
{
	if (k == sh->draw->n_layers) {
		const struct bb_mesh_fragment *f = &px->fragments.at[px->next_fragment++];
		add_behind(f->rgba, f->rgba[3], sum);
		return;
	}
	const struct bb_ray *ray = &px->ray[k];
	const double i = px->next[k]++;
	const struct bb_vec3 at = { ray->first.x + i * ray->stride.x, ray->first.y + i * ray->stride.y,
				    ray->first.z + i * ray->stride.z };
	add_sample(sh, &sh->draw->layers[k], at, sum);
	sh->n_samples++;
}

static void draw_pixel(struct share *sh, uint32_t column, uint32_t row)
{
	uint8_t *out = sh->image->rgba + ((size_t)row * sh->image->width + column) * 4;
	struct pixel px = { .next_fragment = 0 };
	double sum[4] = { 0 };
	size_t k;

	for (k = 0; k < sh->draw->n_layers; k++) {
		px.ray[k] = bb_rays_at(&sh->rays[k], column, row);
		sh->n_rays += px.ray[k].n > 0;
	}
	if (sh->meshes) {
		const struct bb_mesh_ray ray =
			bb_mesh_ray_at(sh->draw->view, sh->image->width, sh->image->height, column, row);
		bb_mesh_tree_meets(sh->meshes, &ray, &px.fragments);
	}
	while (1 - sum[3] >= OPAQUE && (k = nearest(sh, &px)) <= sh->draw->n_layers)
		add_next(sh, &px, k, sum);
	for (int c = 0; c < 4; c++)
		out[c] = quantise(sum[c]);
}

static void *draw_share(void *arg)
{
	struct share *sh = arg;

	for (uint32_t row = sh->first_row; row < sh->image->height; row += sh->row_stride)
		for (uint32_t column = 0; column < sh->image->width; column++)
			draw_pixel(sh, column, row);
	return NULL;
}

static void draw_shares(const struct reference *ref, const struct share *all, struct bb_draw_stats *stats)
{
	struct share shares[THREADS_MOST];

	for (unsigned t = 0; t < ref->threads; t++) {
		shares[t] = *all;
		shares[t].first_row = t;
		/* The last share is the caller's own; so is one whose thread the system refuses. */
		if (t + 1 < ref->threads)
			shares[t].started = pthread_create(&shares[t].thread, NULL, draw_share, &shares[t]) == 0;
		if (!shares[t].started)
			draw_share(&shares[t]);
	}
	for (unsigned t = 0; t < ref->threads; t++) {
		if (shares[t].started)
			pthread_join(shares[t].thread, NULL);
		stats->rays += shares[t].n_rays;
		stats->samples += shares[t].n_samples;
	}
}

static enum bb_status reference_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
				     struct bb_image *image, struct bb_draw_stats *stats)
{
	const struct reference *ref = bb_container_of(r, struct reference, base);
	struct share all = { .draw = draw, .rays = rays, .image = image, .row_stride = ref->threads };
	struct bb_mesh_tree *tree = NULL;

	for (size_t k = 0; k < draw->n_layers; k++)
		if (!draw->layers[k].volume)
			return bb_fail(&r->last_error, BB_ERR_UNSUPPORTED, 1808, NULL, "layer %zu", k);
	enum bb_status st = bb_meshes_check(draw->meshes, draw->n_meshes, &r->last_error);
	if (st == BB_OK && draw->n_meshes)
		st = bb_mesh_tree_create(draw->meshes, draw->n_meshes, &tree, &r->last_error);
	if (st != BB_OK)
		return st;
	all.meshes = tree;
	draw_shares(ref, &all, stats);
	bb_mesh_tree_destroy(tree);
	return BB_OK;
}

static void reference_forget(struct bb_renderer *r)
{
	(void)r; /* it keeps nothing */
}

static void reference_destroy(struct bb_renderer *r)
{
	free(bb_container_of(r, struct reference, base));
}

static const struct bb_renderer_ops reference_ops = {
	.draw = reference_draw,
	.forget = reference_forget,
	.destroy = reference_destroy,
};

enum bb_status bb_renderer_reference_create(unsigned threads, struct bb_renderer **out)
{
	*out = NULL;
	if (!threads || threads > THREADS_MOST)
		return BB_ERR_RANGE;
	struct reference *ref = calloc(1, sizeof(*ref));
	if (!ref)
		return BB_ERR_NOMEM;
	ref->base.ops = &reference_ops;
	ref->threads = threads;
	snprintf(ref->base.description, sizeof(ref->base.description), "reference, double precision, %u thread%s",
		 threads, threads == 1 ? "" : "s");
	*out = &ref->base;
	return BB_OK;
}
