/*
 * render/stream/stream.c: one frame of streaming: commit what has been read, plan, map what is here, ask for what is
 * missing within the budget. All memory is taken at creation; a frame allocates nothing and waits for nothing.
 */
#include "render/stream/stream_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define VIEWS_USUAL 16
#define SETTLE_FRAMES 256 /* more than the tree has levels, in space and in time, many times over */

/* ---- what has been read ---- */

void bb_stream_commit(struct bb_stream *s, size_t most, int64_t now_ns, struct bb_stream_counts *counts)
{
	const size_t n = s->loader->collect(s->loader, s->done, most < s->slots.n ? most : s->slots.n, now_ns);

	for (size_t i = 0; i < n; i++) {
		const struct bb_load *load = &s->done[i];
		bb_slots_commit(&s->slots, load->slot, load->failed);
		s->n_odd += load->n_odd;
		if (load->failed) {
			s->bad[load->brick / 64] |= UINT64_C(1) << load->brick % 64;
			s->n_failed++;
			counts->failed++;
			continue;
		}
		s->slot_generation[load->slot] = ++s->atlas.generation;
		counts->arrived++;
	}
}

/* The loader of the virtual clock: what is asked for in one frame is there in the next. */
static void submit_now(struct bb_loader *loader, const struct bb_load *loads, size_t n, int64_t now_ns)
{
	struct bb_stream *s = bb_container_of(loader, struct bb_stream, now);
	struct bb_load *ready = s->ready + s->n_ready;

	(void)now_ns;
	memcpy(ready, loads, n * sizeof(*loads));
	for (size_t i = 0; i < n; i += BB_READ_MOST)
		bb_stream_read(s, ready + i, n - i < BB_READ_MOST ? n - i : BB_READ_MOST, &s->error);
	s->n_ready += n;
}

static size_t collect_now(struct bb_loader *loader, struct bb_load *done, size_t cap, int64_t now_ns)
{
	struct bb_stream *s = bb_container_of(loader, struct bb_stream, now);
	const size_t n = s->n_ready < cap ? s->n_ready : cap;

	(void)now_ns;
	memcpy(done, s->ready, n * sizeof(*done));
	memmove(s->ready, s->ready + n, (s->n_ready - n) * sizeof(*s->ready));
	s->n_ready -= n;
	return n;
}

/* ---- a frame ---- */

static void look(struct bb_stream *s, const struct bb_stream_frame *f)
{
	const struct bb_bricks_header *h = bb_bricks_header(s->config.bricks);
	const size_t n = f->n_views < s->config.views_most ? f->n_views : s->config.views_most;

	for (size_t i = 0; i < n; i++)
		s->view[i] = (struct bb_sight_view){ &f->views[i], f->width_px, f->height_px };
	bb_sight_prepare(s->tree, h->grid, h->extent, &s->config.placement.pose, s->config.placement.size_m, s->view, n,
			 s->hide.seen, s->frustum, &s->sight);
}

struct bb_stream_counts bb_stream_frame(struct bb_stream *s, const struct bb_stream_frame *f)
{
	struct bb_stream_counts counts = { 0 };

	s->slots.frame++;
	bb_stream_commit(s, bb_budget_of(s, f), f->now_ns, &counts);
	bb_slots_touch(&s->slots, s->root);
	bb_plan_steps(s, f);
	look(s, f);
	bb_plan_make(s);
	bb_wish(s);
	bb_show_keep(s);
	bb_ask(s, f, &counts);
	bb_show(s, f->step, &counts);
	if (s->hide.seen)
		bb_hide(s, f);
	for (size_t i = 0; i < f->n_views; i++)
		bb_count_rays(s, &f->views[i], f, &counts);
	return counts;
}

void bb_stream_settle(struct bb_stream *s, const struct bb_stream_frame *f)
{
	const uint32_t most = SETTLE_FRAMES + (s->config.bricks_per_frame ? 2 * s->slots.n / s->config.bricks_per_frame : 0);

	for (uint32_t n = 0; n < most && (bb_stream_frame(s, f).loaded || s->slots.n_pending); n++)
		;
}

/* ---- creation ---- */

static bool is_sound(const struct bb_stream_config *c)
{
	const struct bb_vec3 e = c->placement.size_m, p = c->placement.pose.p;

	return c->bricks && c->transfer && e.x > 0 && e.y > 0 && e.z > 0 && isfinite(e.x + e.y + e.z + p.x + p.y + p.z);
}

static enum bb_status rate_all(struct bb_stream *s, struct bb_error *err)
{
	struct bb_gain_weights w;

	if (s->complete)
		return BB_OK;
	float *work = malloc(s->tree->n_bricks * sizeof(*work));
	if (!work)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "ratings");
	bb_hide_edit(s);
	bb_gain_weights(s->config.transfer, &w);
	const enum bb_status status = bb_gain_points(s->config.bricks, &w, s->config.gain, s->space, s->time, work, err);
	if (!status && s->config.gain == BB_GAIN_LEAF)
		bb_gain_press_on(work, s->tree->n_bricks, s->space, s->time);
	free(work);
	return status;
}

/* The one brick that is always there. */
static enum bb_status load_root(struct bb_stream *s, struct bb_error *err)
{
	struct bb_stream_counts counts;
	bool evicted;
	struct bb_load load = { .brick = 0 };

	s->slots.frame++;
	load.slot = s->root = bb_slots_reserve(&s->slots, 0, &evicted);
	bb_stream_read(s, &load, 1, err);
	if (load.failed)
		return BB_ERR_FORMAT;
	bb_slots_commit(&s->slots, s->root, false);
	s->slot_generation[s->root] = ++s->atlas.generation;
	s->plan.step[0] = 0;
	s->plan.n_steps = s->plan.n_shown = 1;
	s->plan.n_targets = 1;
	s->plan.target[0] = (struct bb_target){ .steps = 1 };
	bb_show(s, 0, &counts);
	return BB_OK;
}

static enum bb_status begin(struct bb_stream *s, struct bb_error *err)
{
	const uint64_t n = s->tree->n_bricks;

	s->bad = calloc(n / 64 + 1, sizeof(*s->bad));
	if (!s->complete) {
		s->space = malloc(n * sizeof(*s->space));
		s->time = malloc(n * sizeof(*s->time));
	}
	if (!s->complete && s->config.occlusion) {
		const uint32_t n_cells = s->tree->n_nodes - s->tree->first[s->tree->n_levels - 1];
		s->hide.light = calloc(n_cells, sizeof(*s->hide.light));
		s->hide.seen = calloc(s->tree->n_nodes, sizeof(*s->hide.seen));
		if (!s->hide.light || !s->hide.seen)
			return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the light of %u nodes", s->tree->n_nodes);
		for (uint32_t i = 0; i < n_cells; i++) /* until a ray says otherwise */
			s->hide.light[i] = 1;
		for (uint32_t i = 0; i < s->tree->n_nodes; i++)
			s->hide.seen[i] = 1;
	}
	if (!s->bad || (!s->complete && (!s->space || !s->time)))
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "ratings of %llu bricks", (unsigned long long)n);
	enum bb_status status = bb_stream_take(s, err);
	if (!status)
		status = rate_all(s, err);
	return status ? status : load_root(s, err);
}

enum bb_status bb_stream_create(const struct bb_stream_config *config, struct bb_stream **out, struct bb_error *err)
{
	*out = NULL;
	if (!is_sound(config))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "a stream without bricks, transfer function or size");
	const struct bb_bricks_header *h = bb_bricks_header(config->bricks);
	if (!h->pad)
		return bb_fail(err, BB_ERR_FORMAT, 1471, NULL, "%s", h->name);
	struct bb_stream *s = calloc(1, sizeof(*s));
	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a stream");
	s->config = *config;
	s->config.views_most = config->views_most ? config->views_most : VIEWS_USUAL;
	s->complete = !config->memory_bytes;
	s->tree = &h->tree;
	s->now = (struct bb_loader){ submit_now, collect_now };
	s->loader = &s->now;
	bb_atlas_describe(&s->atlas, h);
	const enum bb_status status = begin(s, err);
	if (status) {
		bb_stream_destroy(s);
		return status;
	}
	*out = s;
	return BB_OK;
}

void bb_stream_destroy(struct bb_stream *s)
{
	if (!s)
		return;
	bb_stream_give(s);
	free(s->space);
	free(s->time);
	free(s->bad);
	free(s->hide.light);
	free(s->hide.seen);
	free(s);
}

enum bb_status bb_stream_set_transfer(struct bb_stream *s, const struct bb_transfer *tf, struct bb_error *err)
{
	s->config.transfer = tf;
	return rate_all(s, err);
}

/* Both at once would be more than either budget: what there was goes first. */
static enum bb_status begin_anew(struct bb_stream *s, uint64_t memory_bytes, struct bb_error *err)
{
	s->config.memory_bytes = memory_bytes;
	bb_stream_give(s);
	const enum bb_status status = bb_stream_take(s, err);
	return status ? status : load_root(s, err);
}

enum bb_status bb_stream_set_budget(struct bb_stream *s, uint64_t memory_bytes, uint32_t bricks_per_frame,
				    struct bb_error *err)
{
	const uint64_t before = s->config.memory_bytes;

	if (memory_bytes == before) {
		s->config.bricks_per_frame = bricks_per_frame;
		return BB_OK;
	}
	if (!memory_bytes || s->complete || s->loader != &s->now)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL,
			       "a memory budget can be changed, not given up, and not while a thread reads");
	const enum bb_status status = begin_anew(s, memory_bytes, err);
	if (!status) {
		s->config.bricks_per_frame = bricks_per_frame;
		return BB_OK;
	}
	struct bb_error again = { 0 };
	const enum bb_status back = begin_anew(s, before, &again);
	if (back)
		*err = again;
	return back ? back : status;
}

const struct bb_atlas *bb_stream_atlas(const struct bb_stream *s)
{
	return &s->atlas;
}

struct bb_layer bb_stream_layer(const struct bb_stream *s)
{
	return (struct bb_layer){ &s->atlas, s->config.transfer, s->config.placement, s->config.volume };
}

const struct bb_stream_config *bb_stream_config(const struct bb_stream *s)
{
	return &s->config;
}

uint64_t bb_stream_memory_bytes(const struct bb_stream *s)
{
	return s->held_bytes;
}

const struct bb_error *bb_stream_error(const struct bb_stream *s)
{
	return &s->error;
}

uint64_t bb_stream_failures(const struct bb_stream *s, uint64_t *n_odd)
{
	*n_odd = s->n_odd;
	return s->n_failed;
}
