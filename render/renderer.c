/*
 * render/renderer.c: the checks and the clockwork around every back end, so that none repeats them.
 */
#include "render/renderer.h"

#include "hal/clock.h"
#include "render/renderer_driver.h"

void bb_renderer_destroy(struct bb_renderer *r)
{
	if (r)
		r->ops->destroy(r);
}

const char *bb_renderer_description(const struct bb_renderer *r)
{
	return r->description;
}

const struct bb_error *bb_renderer_last_error(const struct bb_renderer *r)
{
	return &r->last_error;
}

void bb_renderer_forget(struct bb_renderer *r)
{
	r->ops->forget(r);
}

static enum bb_status check(const struct bb_draw *draw, const struct bb_image *image, struct bb_rays *rays)
{
	enum bb_status st = BB_OK;

	if (!draw->view || !image->rgba || !draw->layers)
		return BB_ERR_USAGE;
	if (draw->n_layers < 1 || draw->n_layers > BB_LAYERS_MOST)
		return BB_ERR_RANGE;
	for (size_t i = 0; i < draw->n_layers && st == BB_OK; i++)
		st = bb_rays_make(draw->view, &draw->layers[i], draw->step_voxels, image->width, image->height, &rays[i]);
	return st;
}

enum bb_status bb_renderer_draw(struct bb_renderer *r, const struct bb_draw *draw, struct bb_image *image,
				struct bb_draw_stats *stats)
{
	const int64_t begin_ns = bb_clock_stopwatch_ns();
	struct bb_draw_stats own = { 0 };
	struct bb_rays rays[BB_LAYERS_MOST];

	if (stats)
		*stats = own;
	r->last_error = (struct bb_error){ 0 };
	enum bb_status st = check(draw, image, rays);
	if (st == BB_OK)
		st = r->ops->draw(r, draw, rays, image, &own);
	own.elapsed_ns = bb_clock_stopwatch_ns() - begin_ns;
	if (stats)
		*stats = own;
	return st;
}
