/*
 * bench/trade/trade.c: the data in the bricks that are asked for, and the pictures that everything is compared with.
 */
#include "bench/trade/trade_private.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/data.h"
#include "bench/file.h"
#include "bench/loop/loop.h"

#define REFERENCE_EDGE 32
#define NEAR_M 0.05
#define FAR_M 60.0

const char *bb_trade_knob_text(enum bb_trade_knob knob)
{
	static const char *const text[] = { "memory", "stream", "selector", "tolerance", "step", "brick", "type", "scene" };

	return text[knob];
}

const char *bb_trade_setting_text(const struct bb_trade_setting *s, char *out, size_t cap)
{
	char memory[32] = "all bricks", stream[32] = "", tolerance[32] = "";

	if (s->memory_bricks)
		bb_text_format(memory, sizeof(memory), "%u bricks", s->memory_bricks);
	else if (s->memory_mib > 0)
		bb_text_format(memory, sizeof(memory), "%.4g MiB", s->memory_mib);
	if (s->selector->by_tolerance) {
		bb_text_format(tolerance, sizeof(tolerance), " %.3g", s->tolerance);
		bb_text_format(memory, sizeof(memory), "no budget");
	} else if (s->bricks_per_frame) {
		bb_text_format(stream, sizeof(stream), ", %u bricks a frame", s->bricks_per_frame);
	}
	bb_text_format(out, cap, "%s%s%s, %s%s, step %.3g, %u^3 %s", s->selector->name, s->at_once ? "!" : "", tolerance, memory, stream,
		       s->step_voxels, s->brick, bb_brick_type_text(s->type));
	return out;
}

/* ---- data ---- */

bool bb_trade_rebuilds(const struct bb_trade *t)
{
	return t->steps != NULL;
}

struct bb_trade_setting bb_trade_own(const struct bb_trade *t)
{
	const struct bb_scene *s = t->config.scene;
	struct bb_trade_setting own = { .memory_mib = s->memory_mib,
					.bricks_per_frame = (uint32_t)s->stream_bricks_per_frame,
					.selector = bb_selector_find(bb_gain_method_text((enum bb_gain_method)s->data.gain)),
					.tolerance = 0.1,
					.step_voxels = s->data.step_voxels,
					.brick = (uint32_t)s->data.brick_voxels,
					.type = (enum bb_brick_type)s->data.values };

	if (!t->steps) {
		own.brick = t->variant[0].edge;
		own.type = t->variant[0].type;
	}
	return own;
}

const struct bb_bricks_header *bb_trade_header(const struct bb_trade *t)
{
	return bb_bricks_header(t->variant[0].bricks);
}

const char *bb_trade_reference(const struct bb_trade *t)
{
	return t->reference;
}

enum bb_status bb_trade_bricks(struct bb_trade *t, uint32_t edge, enum bb_brick_type type, const struct bb_bricks **out,
			       struct bb_error *err)
{
	struct bb_trade_variant *v = t->variant;

	for (size_t i = 0; i < t->n_variants; i++)
		if (v[i].edge == edge && v[i].type == type) {
			*out = v[i].bricks;
			return BB_OK;
		}
	if (!t->steps || t->n_variants == BB_TRADE_VARIANTS_MOST)
		return bb_fail(err, BB_ERR_USAGE, 1482, NULL, "%u^3 %s of %s", edge, bb_brick_type_text(type),
			       bb_trade_header(t)->name);
	v += t->n_variants;
	const enum bb_status status = bb_data_build(t->steps, edge, type, t->dir, &v->bricks, err);
	if (status)
		return status;
	v->edge = edge;
	v->type = type;
	t->n_variants++;
	*out = v->bricks;
	return BB_OK;
}

static enum bb_status open_data(struct bb_trade *t, struct bb_error *err)
{
	const struct bb_trade_config *c = &t->config;
	const struct bb_bricks *bricks;
	enum bb_status status;

	if (!c->generate && bb_data_is_bricks(c->scene)) {
		status = bb_data_open(c->scene, &t->variant[0].bricks, err);
		if (status)
			return status;
		t->variant[0].edge = bb_bricks_header(t->variant[0].bricks)->tree.edge;
		t->variant[0].type = bb_bricks_header(t->variant[0].bricks)->type;
		t->n_variants = 1;
		return BB_OK;
	}
	status = bb_data_folder(t->dir, sizeof(t->dir), err);
	if (!status && c->generate)
		status = bb_steps_generate(c->generate, c->dim, c->n_steps, &t->steps, err);
	else if (!status)
		status = bb_data_steps(c->scene, t->dir, &t->steps, err);
	if (status)
		return status;
	if (c->generate)
		bb_steps_seed(t->steps, c->seed);
	return bb_trade_bricks(t, c->reference_brick ? c->reference_brick : REFERENCE_EDGE, BB_BRICK_F32, &bricks, err);
}

/* ---- frames ---- */

void bb_trade_frame_at(const struct bb_trade *t, unsigned i, double step_voxels, struct bb_trade_frame *out)
{
	/* The front wall of a cabin, and in it whatever the scene places there. */
	static const struct bb_corners wall = { { -1.524, 0, -1.524 }, { 1.524, 0, -1.524 }, { -1.524, 2.286, -1.524 } };
	const struct bb_trade_config *c = &t->config;
	const uint32_t n_steps = bb_trade_header(t)->tree.n_steps;
	const double t_s = (double)i / BB_TRADE_RATE_HZ, step_s = c->scene->data.seconds_per_step;
	const struct bb_vec3 size = t->placement.size_m;
	struct bb_vec3 eye = c->eye;

	if (c->inside)
		eye = bb_pose_apply(&t->placement.pose, (struct bb_vec3){ c->within.x * size.x, c->within.y * size.y, c->within.z * size.z });
	else if (c->head)
		eye = bb_path_at(c->head, (int64_t)(t_s * 1e9)).p;
	out->view = bb_view_make(&wall, eye, eye, NEAR_M, FAR_M);
	for (int k = 0; k < 4; k++)
		out->ahead[k] = bb_loop_steps_at(c->scene, n_steps, t_s + (k + 1) * step_s);
	const double step = bb_loop_steps_at(c->scene, n_steps, t_s);
	const double soon = bb_loop_steps_at(c->scene, n_steps, t_s + 1e-3 * step_s);
	out->frame = (struct bb_stream_frame){ .views = &out->view, .n_views = 1, .width_px = c->width_px,
					       .height_px = c->height_px,
					       .step = step, .way = soon > step ? 1 : soon < step ? -1 : 0,
					       .step_voxels = step_voxels, .ahead = out->ahead, .n_ahead = 4,
					       .ahead_frames = (uint32_t)(step_s * BB_TRADE_RATE_HZ) + 1,
					       .bricks_most = UINT32_MAX,
					       .now_ns = (int64_t)(t_s * 1e9) };
}

void bb_trade_rest(struct bb_trade_frame *f)
{
	f->frame.n_ahead = 0;
	f->frame.way = 0;
}

struct bb_stream_counts bb_trade_count(struct bb_trade *t, unsigned picture, double step_voxels)
{
	struct bb_trade_frame f;

	bb_trade_frame_at(t, t->drawn[picture], step_voxels, &f);
	bb_trade_rest(&f);
	f.frame.step = t->full_step; /* nothing is read for this */
	return bb_stream_frame(t->full, &f.frame);
}

/* ---- what is judged by ---- */

static enum bb_status draw_reference(struct bb_trade *t, unsigned k, struct bb_error *err)
{
	const struct bb_trade_config *c = &t->config;
	struct bb_trade_frame f;
	bb_image_release(&t->picture[k]);
	enum bb_status status = bb_image_create(c->width_px, c->height_px, &t->picture[k]);

	if (status)
		return bb_fail(err, status, 1702, NULL, "a picture of %u x %u", c->width_px, c->height_px);
	bb_trade_frame_at(t, t->drawn[k], c->reference_step, &f);
	bb_trade_rest(&f);
	bb_stream_settle(t->full, &f.frame);
	t->full_step = f.frame.step;
	const struct bb_layer layer = bb_stream_layer(t->full);
	const struct bb_draw draw = { .view = &f.view, .layers = &layer, .n_layers = 1,
				      .step_voxels = c->reference_step };
	status = bb_renderer_draw(c->renderer, &draw, &t->picture[k], NULL);
	if (!status)
		return BB_OK;
	const struct bb_error *why = bb_renderer_last_error(c->renderer);
	return bb_fail(err, status, 1480, NULL, "%s", why && why->number ? why->text : bb_status_text(status));
}

static enum bb_status make_references(struct bb_trade *t, struct bb_error *err)
{
	const struct bb_trade_config *c = &t->config;
	const struct bb_trade_variant *v = &t->variant[0];
	const struct bb_stream_config full = { .bricks = v->bricks, .transfer = c->transfer, .no_prediction = true,
					       .placement = t->placement };
	enum bb_status status = t->full ? BB_OK : bb_stream_create(&full, &t->full, err);

	for (unsigned k = 0; k < c->n_drawn && !status; k++) {
		t->drawn[k] = (k + 1) * c->n_frames / c->n_drawn - 1;
		status = draw_reference(t, k, err);
	}
	bb_renderer_forget(c->renderer);
	bb_text_format(t->reference, sizeof(t->reference), "all leaf bricks of %u^3 %s at steps of %.3g voxels, by %s", v->edge,
		       bb_brick_type_text(v->type), c->reference_step, bb_renderer_description(c->renderer));
	return status;
}

enum bb_status bb_trade_turn(struct bb_trade *t, bool inside, struct bb_error *err)
{
	t->config.inside = inside;
	return make_references(t, err);
}

enum bb_status bb_trade_create(const struct bb_trade_config *config, struct bb_trade **out, struct bb_error *err)
{
	struct bb_trade *t = calloc(1, sizeof(*t));

	*out = NULL;
	if (!t)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a trade");
	t->config = *config;
	enum bb_status status = open_data(t, err);
	if (!status) {
		t->placement = bb_loop_placement(config->scene, t->variant[0].bricks);
		status = make_references(t, err);
	}
	if (!status && bb_image_create(config->width_px, config->height_px, &t->image))
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a picture");
	if (status)
		bb_trade_destroy(t);
	else
		*out = t;
	return status;
}

void bb_trade_destroy(struct bb_trade *t)
{
	if (!t)
		return;
	bb_stream_destroy(t->full);
	bb_trade_forget_ratings(t);
	for (size_t i = 0; i < t->n_variants; i++)
		bb_bricks_close(t->variant[i].bricks);
	for (unsigned k = 0; k < BB_TRADE_DRAWN_MOST; k++)
		bb_image_release(&t->picture[k]);
	bb_image_release(&t->image);
	bb_steps_close(t->steps);
	if (t->dir[0])
		rmdir(t->dir);
	free(t);
}
