/*
 * bench/trade/play.c: a sequence under one setting: through the streamer, or, for selectors that know nothing of streams,
 * from choices that are read as a whole when the step changes.
 */
#include "bench/trade/trade_private.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "bench/stats.h"
#include "bench/trade/still.h"
#include "hal/clock.h"
#include "render/stream/io.h"

#define TIMES_MOST (BB_TRADE_DRAWN_MOST * BB_TRADE_TIMED_MOST)

struct play {
	struct bb_trade *t;
	const struct bb_trade_setting *s;
	struct bb_trade_point *p;
	const struct bb_bricks *bricks;
	double squares, n_pixels; /* of all pictures: squared error a channel */
	unsigned n_judged;
	double draw_ms[TIMES_MOST], stream_ms[TIMES_MOST], frame_ms[TIMES_MOST], cpu_ms[TIMES_MOST];
	size_t n_times;
	uint64_t bricks_sum, bytes_sum, missing, drawn;
};

/* Processor time of this process: for people, nothing decides by it. */
static double cpu_now_ms(void)
{
	struct rusage u;

	if (getrusage(RUSAGE_SELF, &u))
		return BB_UNKNOWN;
	return (double)(u.ru_utime.tv_sec + u.ru_stime.tv_sec) * 1e3 +
	       (double)(u.ru_utime.tv_usec + u.ru_stime.tv_usec) * 1e-3;
}

struct spent { /* selecting and reading, or drawing */
	double ms, cpu_ms;
};

static struct spent begin(void)
{
	return (struct spent){ (double)bb_clock_stopwatch_ns() * 1e-6, cpu_now_ms() };
}

static struct spent since(const struct spent *from)
{
	const struct spent now = begin();

	return (struct spent){ now.ms - from->ms, now.cpu_ms - from->cpu_ms };
}

/* ---- pictures ---- */

static void judge(struct play *y, unsigned k)
{
	struct bb_trade *t = y->t;
	struct bb_trade_point *p = y->p;
	struct bb_image_difference d = { 0 };
	struct bb_image_quality q = { .ssim = 1 };
	const struct bb_stream_counts c = bb_trade_count(t, k, y->s->step_voxels);

	p->rays += c.rays;
	p->samples += c.samples;
	if (bb_image_compare(&t->image, &t->picture[k], &d) || bb_image_quality(&t->image, &t->picture[k], &q))
		return;
	if (!d.n_pixels)
		return;
	y->n_judged++;
	y->n_pixels += (double)d.n_pixels;
	y->squares += d.identical ? 0 : (double)d.n_pixels * 255 * 255 * pow(10, -d.psnr_db / 10);
	p->psnr_least_db = fmin(p->psnr_least_db, d.psnr_db);
	p->ssim += q.ssim;
	p->luv += q.luv_mean;
}

static enum bb_status draw(struct play *y, const struct bb_layer *layer, const struct bb_view *view, struct spent *out,
			   struct bb_error *err)
{
	const struct bb_trade_config *c = &y->t->config;
	const struct bb_draw d = { .view = view, .layers = layer, .n_layers = 1, .step_voxels = y->s->step_voxels };
	const struct spent from = begin();
	const enum bb_status status = bb_renderer_draw(c->renderer, &d, &y->t->image, NULL);
	const struct bb_error *why = bb_renderer_last_error(c->renderer);

	*out = since(&from);
	if (status)
		return bb_fail(err, status, 1480, NULL, "%s", why && why->number ? why->text : bb_status_text(status));
	return BB_OK;
}

/* Frame i has been selected, which took `streamed`: draws it if it, or one soon after it, is a picture. The first of
 * these brings what is in memory to the renderer and is not timed. */
static enum bb_status show(struct play *y, unsigned i, const struct bb_layer *layer, const struct bb_view *view,
			   const struct spent *streamed, struct bb_error *err)
{
	const struct bb_trade_config *c = &y->t->config;
	struct spent drawn;

	for (unsigned k = 0; k < c->n_drawn; k++) {
		const unsigned at = y->t->drawn[k];
		if (i > at || i + c->n_timed < at)
			continue;
		const enum bb_status status = draw(y, layer, view, &drawn, err);
		if (status)
			return status;
		if (i + c->n_timed > at && y->n_times < TIMES_MOST) {
			y->draw_ms[y->n_times] = drawn.ms;
			y->stream_ms[y->n_times] = streamed->ms;
			y->cpu_ms[y->n_times] = drawn.cpu_ms + streamed->cpu_ms;
			y->frame_ms[y->n_times++] = drawn.ms + streamed->ms;
		}
		if (i == at)
			judge(y, k);
		return BB_OK;
	}
	return BB_OK;
}

static void count(struct play *y, uint64_t bricks, uint64_t bytes)
{
	y->bricks_sum += bricks;
	y->bytes_sum += bytes;
	y->p->bricks_most = fmax(y->p->bricks_most, (double)bricks);
	y->p->bytes_most = fmax(y->p->bytes_most, (double)bytes);
}

static double median(double *v, size_t n)
{
	bb_stats_sort(v, n);
	return bb_stats_nearest_rank(v, n, 0.5);
}

static void finish(struct play *y)
{
	const struct bb_trade_config *c = &y->t->config;
	struct bb_trade_point *p = y->p;
	const double n = y->n_judged ? y->n_judged : 1;

	p->psnr_db = y->squares > 0 ? fmin(200, 10 * log10(255.0 * 255 * y->n_pixels / y->squares)) : 200;
	p->ssim /= n;
	p->luv /= n;
	if (!y->n_judged)
		p->psnr_db = p->ssim = p->luv = p->psnr_least_db = BB_UNKNOWN; /* nothing is to be seen */
	p->rays /= c->n_drawn;
	p->samples /= c->n_drawn;
	p->bytes_mean = (double)y->bytes_sum / c->n_frames;
	p->bricks_mean = (double)y->bricks_sum / c->n_frames;
	p->missing_share = y->drawn ? (double)y->missing / (double)y->drawn : 0;
	p->draw_ms = median(y->draw_ms, y->n_times);
	p->draw_low_ms = bb_stats_nearest_rank(y->draw_ms, y->n_times, 0.1);
	p->draw_high_ms = bb_stats_nearest_rank(y->draw_ms, y->n_times, 0.9);
	p->stream_ms = median(y->stream_ms, y->n_times);
	p->frame_ms = median(y->frame_ms, y->n_times);
	p->cpu_ms = median(y->cpu_ms, y->n_times);
}

static enum bb_status cannot(struct bb_trade_point *p, const char *why)
{
	p->failed = true;
	snprintf(p->why, sizeof(p->why), "%.180s", why);
	p->psnr_db = p->psnr_least_db = p->ssim = p->luv = p->frame_ms = p->draw_ms = p->stream_ms = BB_UNKNOWN;
	p->draw_low_ms = p->draw_high_ms = p->cpu_ms = BB_UNKNOWN;
	return BB_OK;
}

/* ---- through the streamer ---- */

static enum bb_status stream_on(struct play *y, struct bb_stream *stream, struct bb_error *err)
{
	const struct bb_trade_config *c = &y->t->config;
	enum bb_status status = BB_OK;

	for (unsigned i = 0; i < c->n_frames && !status; i++) {
		struct bb_trade_frame f;
		bb_trade_frame_at(y->t, i, y->s->step_voxels, &f);
		if (c->settled) {
			bb_trade_rest(&f);
			bb_stream_settle(stream, &f.frame);
		}
		const struct spent from = begin();
		const struct bb_stream_counts n = bb_stream_frame(stream, &f.frame);
		const struct spent spent = since(&from);
		count(y, n.loaded, n.bytes);
		y->missing += n.missing;
		y->drawn += n.drawn;
		const struct bb_layer layer = bb_stream_layer(stream);
		status = show(y, i, &layer, &f.view, &spent, err);
	}
	y->p->memory_bytes = bb_stream_memory_bytes(stream);
	y->p->atlas_bricks = bb_stream_atlas(stream)->n_slots;
	return status;
}

static enum bb_status play_stream(struct play *y, enum bb_gain_method gain, struct bb_error *err)
{
	const struct bb_trade_config *c = &y->t->config;
	const struct bb_stream_config config = { .bricks = y->bricks,
						 .transfer = c->transfer,
						 .placement = y->t->placement,
						 .memory_bytes = (uint64_t)(y->s->memory_mib * 1048576),
						 .bricks_per_frame = y->s->bricks_per_frame,
						 .gain = gain,
						 .occlusion = c->scene->data.occlusion,
						 .no_prediction = !c->scene->data.predict };
	struct bb_stream_disk *disk = NULL;
	struct bb_error why = { 0 };
	struct bb_trade_frame f;
	struct bb_stream *stream;
	enum bb_status status = bb_stream_create(&config, &stream, &why);

	if (status && why.number == 1470)
		return cannot(y->p, why.text);
	if (status) {
		*err = why;
		return status;
	}
	bb_trade_frame_at(y->t, 0, y->s->step_voxels, &f);
	bb_trade_rest(&f); /* as after bring-up */
	bb_stream_settle(stream, &f.frame);
	if (c->disk_read_ns > 0 || c->disk_byte_ns > 0)
		status = bb_stream_disk_start(stream, c->disk_read_ns, c->disk_byte_ns, &disk);
	if (status)
		bb_fail(err, status, 1702, NULL, "the model of a disk");
	else
		status = stream_on(y, stream, err);
	bb_renderer_forget(c->renderer);
	bb_stream_disk_stop(disk);
	bb_stream_destroy(stream);
	return status;
}

/* ---- from choices ---- */

struct choices {
	const struct bb_tree *tree;
	struct bb_choice *heap, *out;
	struct bb_choice **of; /* [n_steps] */
	double *ms;            /* [n_steps] choosing took */
	size_t *n, most;       /* most: of two steps side by side */
};

static void drop(struct choices *c)
{
	free(c->heap);
	free(c->out);
	for (uint32_t i = 0; c->of && i < c->tree->n_steps; i++)
		free(c->of[i]);
	free(c->of);
	free(c->ms);
	free(c->n);
}

static enum bb_status take(struct choices *c, const struct bb_tree *tree, struct bb_error *err)
{
	const size_t most = bb_choose_most(tree);

	*c = (struct choices){ .tree = tree };
	c->heap = calloc(most, sizeof(*c->heap));
	c->out = calloc(most, sizeof(*c->out));
	c->of = calloc(tree->n_steps, sizeof(struct bb_choice *));
	c->ms = calloc(tree->n_steps, sizeof(*c->ms));
	c->n = calloc(tree->n_steps, sizeof(*c->n));
	if (c->heap && c->out && c->of && c->ms && c->n)
		return BB_OK;
	return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "choices of %zu bricks", most);
}

void bb_trade_forget_ratings(struct bb_trade *t)
{
	free(t->ratings.space);
	free(t->ratings.time);
	free(t->ratings.work);
	t->ratings = (struct bb_ratings){ 0 };
	t->rated = NULL;
}

static enum bb_status rate(struct play *y, struct bb_error *err)
{
	struct bb_trade *t = y->t;
	const size_t n = (size_t)bb_bricks_header(y->bricks)->tree.n_bricks;

	if (t->rated == y->bricks && t->rated_by == y->s->selector)
		return BB_OK;
	bb_trade_forget_ratings(t);
	t->ratings = (struct bb_ratings){ calloc(n, sizeof(float)), calloc(n, sizeof(float)), calloc(n, sizeof(float)) };
	if (!t->ratings.space || !t->ratings.time || !t->ratings.work)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "ratings of %zu bricks", n);
	const enum bb_status status = y->s->selector->rate(y->bricks, t->config.transfer, &t->ratings, err);
	t->rated = status ? NULL : y->bricks;
	t->rated_by = y->s->selector;
	return status;
}

/* Half of the memory for each of the two steps on show. */
static uint32_t bricks_that_fit(const struct play *y)
{
	const double each = (double)bb_bricks_brick_bytes(bb_bricks_header(y->bricks));
	const double n = y->s->memory_mib * 1048576 / each / 2;

	if (y->s->memory_bricks)
		return y->s->memory_bricks;
	return y->s->memory_mib > 0 && n < UINT32_MAX ? (uint32_t)n : UINT32_MAX;
}

static enum bb_status choose_all(struct play *y, struct choices *c, struct bb_error *err)
{
	const struct bb_trade_setting *s = y->s;
	const enum bb_status status = rate(y, err);

	for (uint32_t i = 0; i < c->tree->n_steps && !status; i++) {
		const struct bb_selector_ask ask = { .step = i,
						     .space_most = s->tolerance,
						     .time_most = s->tolerance,
						     .budget = { .memory_bricks = bricks_that_fit(y),
								 .stream_bricks = s->bricks_per_frame } };
		const struct spent from = begin();
		c->n[i] = s->selector->choose(c->tree, &y->t->ratings, &ask, c->heap, c->out);
		c->ms[i] = since(&from).cpu_ms;
		if (!c->n[i])
			return BB_OK;
		c->of[i] = malloc(c->n[i] * sizeof(*c->out));
		if (!c->of[i])
			return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu bricks", c->n[i]);
		memcpy(c->of[i], c->out, c->n[i] * sizeof(*c->out));
		const size_t both = c->n[i] + (i ? c->n[i - 1] : 0);
		c->most = both > c->most ? both : c->most;
	}
	return status;
}

static enum bb_status still_on(struct play *y, const struct choices *c, struct bb_still *still, struct bb_error *err)
{
	const struct bb_trade_config *config = &y->t->config;
	enum bb_status status = BB_OK;
	uint64_t in_use = 0;
	uint32_t last = UINT32_MAX;

	for (unsigned i = 0; i < config->n_frames && !status; i++) {
		struct bb_still_counts n;
		struct bb_trade_frame f;
		bb_trade_frame_at(y->t, i, y->s->step_voxels, &f);
		const uint32_t a = (uint32_t)f.frame.step, b = (uint32_t)ceil(f.frame.step);
		const struct spent from = begin();
		status = bb_still_show(still, f.frame.step, (const struct bb_choice *const[]){ c->of[a], c->of[b] },
				       (const size_t[]){ c->n[a], c->n[b] }, &n, err);
		struct spent spent = since(&from);
		if (status)
			break;
		if (a != last) { /* the other step was chosen before */
			spent.ms += c->ms[a];
			spent.cpu_ms += c->ms[a];
		}
		last = a;
		in_use = n.in_use > in_use ? n.in_use : in_use;
		count(y, i ? n.bricks : 0, i ? n.bytes : 0); /* the first is bring-up */
		const struct bb_layer layer = { .atlas = bb_still_atlas(still), .transfer = config->transfer,
						.placement = y->t->placement };
		status = show(y, i, &layer, &f.view, &spent, err);
	}
	y->p->atlas_bricks = in_use;
	y->p->memory_bytes = bb_still_bytes(still, in_use);
	return status;
}

static enum bb_status play_still(struct play *y, struct bb_error *err)
{
	const struct bb_tree *tree = &bb_bricks_header(y->bricks)->tree;
	struct bb_still *still = NULL;
	struct choices c;
	enum bb_status status = take(&c, tree, err);

	if (!status)
		status = choose_all(y, &c, err);
	for (uint32_t i = 0; i < tree->n_steps && !status; i++)
		if (!c.n[i]) {
			drop(&c);
			return cannot(y->p, strcmp(y->s->selector->name, "optimum") ? "not one brick fits the memory budget"
										     : "the tree is too large");
		}
	if (!status)
		status = bb_still_create(y->bricks, c.most, &still, err);
	if (!status)
		status = still_on(y, &c, still, err);
	bb_renderer_forget(y->t->config.renderer);
	bb_still_destroy(still);
	drop(&c);
	return status;
}

enum bb_status bb_trade_play(struct bb_trade *t, const struct bb_trade_setting *s, struct bb_trade_point *out,
			     struct bb_error *err)
{
	struct play *y = calloc(1, sizeof(*y));
	enum bb_gain_method gain = 0;

	*out = (struct bb_trade_point){ .setting = *s, .knob = BB_KNOB_NONE, .psnr_least_db = 200 };
	if (!y)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a play");
	y->t = t;
	y->s = s;
	y->p = out;
	enum bb_status status = bb_trade_bricks(t, s->brick, s->type, &y->bricks, err);
	while (gain < BB_GAIN_METHODS && (s->at_once || strcmp(bb_gain_method_text(gain), s->selector->name)))
		gain++;
	if (!status)
		status = gain < BB_GAIN_METHODS ? play_stream(y, gain, err) : play_still(y, err);
	if (!status && !out->failed)
		finish(y);
	free(y);
	return status;
}
