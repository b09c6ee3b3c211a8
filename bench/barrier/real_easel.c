/* bench/barrier/real_easel.c: a picture to cast between barriers: a made volume of 32^3, seen by one eye. */
#include "bench/barrier/real_impl.h"

#include <stdio.h>
#include <stdlib.h>

#include "bench/data.h"
#include "render/renderer.h"
#include "render/stream/stream.h"

#define VOXELS 32

struct real_easel {
	struct bb_bricks *bricks;
	struct bb_transfer transfer;
	struct bb_stream *stream;
	struct bb_view view;
	struct bb_renderer *renderer;
	struct bb_image image;
};

enum bb_status real_easel_create(struct real_easel **out, struct bb_error *err)
{
	struct real_easel *e = calloc(1, sizeof(*e));
	struct bb_scene scene = { .data = { .generate = "cme", .edge_voxels = VOXELS, .steps = 1, .brick_voxels = 8 } };
	const struct bb_corners wall = { { -1, -1, -1 }, { 1, -1, -1 }, { -1, 1, -1 } };

	*out = e;
	if (!e)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "something to draw");
	e->transfer = (struct bb_transfer){ .n = 2, .point = { { 0, 0, 0, 0, 0 }, { 1, 1, 1, 1, 0.2 } } };
	e->view = bb_view_make(&wall, (struct bb_vec3){ 0, 0, 1 }, (struct bb_vec3){ 0, 0, 1 }, 0.05, 60);
	enum bb_status status = bb_data_open(&scene, &e->bricks, err);
	const struct bb_stream_config config = { .bricks = e->bricks, .transfer = &e->transfer, .no_prediction = true,
		                                 .placement = { .size_m = { 2, 2, 2 }, .pose = BB_POSE_IDENTITY } };
	if (status == BB_OK)
		status = bb_stream_create(&config, &e->stream, err);
	if (status != BB_OK)
		return status;
	const struct bb_stream_frame frame = { .views = &e->view, .n_views = 1, .width_px = 64, .height_px = 64,
		                               .bricks_most = UINT32_MAX, .step_voxels = 0.5 };
	bb_stream_settle(e->stream, &frame);
	return BB_OK;
}

void real_easel_destroy(struct real_easel *e)
{
	if (!e)
		return;
	bb_renderer_destroy(e->renderer);
	bb_image_release(&e->image);
	bb_stream_destroy(e->stream);
	bb_bricks_close(e->bricks);
	free(e);
}

bool real_easel_take(struct real_easel *e, uint32_t edge_px)
{
	return bb_image_create(edge_px, edge_px, &e->image) == BB_OK &&
	       bb_renderer_cpu_create("auto", 1, &e->renderer, NULL) == BB_OK;
}

void real_easel_draw(struct real_easel *e)
{
	const struct bb_layer layer = bb_stream_layer(e->stream);
	const struct bb_draw draw = { .view = &e->view, .layers = &layer, .n_layers = 1, .step_voxels = 0.5 };

	if (bb_renderer_draw(e->renderer, &draw, &e->image, NULL) != BB_OK)
		exit(1);
}
