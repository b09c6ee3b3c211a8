/*
 * bench/loop/streaming.c: what every node asked of its disk, what of it came, and what that cost its frames. A frame is
 * late because of its bricks when it took longer than it may and would not have without them.
 */
#include "bench/loop/loop.h"

#include "bench/file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define STALL_NS (BB_NS_PER_S / 4) /* for so long nothing has come of what was asked for: a person should know */

/* The tightest limit on a frame's time that room or scene set, or the time to the next frame. */
static double limit_ms(const struct bb_frame_loop *l)
{
	double ms = (double)l->frame_ns * 1e-6;

	for (size_t i = 0; i < l->room->n_budgets; i++)
		if (l->room->budgets[i].metric == BB_METRIC_FRAME)
			ms = fmin(ms, l->room->budgets[i].limit);
	for (size_t i = 0; i < l->scene->n_budgets; i++)
		if (l->scene->budgets[i].metric == BB_METRIC_FRAME)
			ms = fmin(ms, l->scene->budgets[i].limit);
	return ms;
}

void bb_streaming_begin(struct bb_frame_loop *l)
{
	struct bb_stream_result *r = &l->result->streaming;

	if (!l->bricks)
		return;
	const struct bb_bricks_header *h = bb_bricks_header(l->bricks);
	const struct bb_tree *t = &h->tree;
	r->limit_ms = limit_ms(l); /* node.c paces by it, whatever is told */
	r->nodes = calloc(l->room->n_nodes, sizeof(*r->nodes));
	if (!r->nodes)
		return;
	r->n_nodes = l->room->n_nodes;
	r->measured = l->draw_everything;
	r->leaf_cells = t->first[t->n_levels] - t->first[t->n_levels - 1];
	r->brick_bytes = bb_bricks_brick_bytes(h);
	r->leaf_bytes = r->leaf_cells * t->n_steps * r->brick_bytes;
	r->data_bytes = (uint64_t)t->dim[0] * t->dim[1] * t->dim[2] * t->n_steps * bb_brick_type_bytes(h->type);
}

static void add(struct bb_stream_total *t, uint64_t v)
{
	t->sum += v;
	t->most = v > t->most ? v : t->most;
}

static struct bb_stream_node *result_of(struct bb_node_machine *n)
{
	struct bb_stream_result *r = &n->loop->result->streaming;

	return n->index < r->n_nodes ? &r->nodes[n->index] : NULL;
}

/* A disk that gives nothing is no failure, frames go on without it: a warning, until something comes. */
static void watch_disk(struct bb_node_machine *n, const struct bb_stream_counts *c, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;
	const uint64_t came = (uint64_t)c->arrived + c->failed;

	if (came || !n->waiting)
		n->arrived_ns = now_ns;
	n->waiting -= came < n->waiting ? came : n->waiting;
	if (n->stall && came) {
		bb_watch_over(l->watch, n->stall - 1, now_ns);
		n->stall = 0;
	} else if (!n->stall && n->waiting && now_ns - n->arrived_ns >= STALL_NS) {
		n->stall = 1 + bb_watch_warn(l->watch, l->node_slot[n->index], n->arrived_ns,
		                             "its disk gives nothing: %llu bricks are waited for, coarser ones are drawn",
		                             (unsigned long long)n->waiting);
	}
	n->waiting += c->loaded;
}

static void tell_failure(struct bb_node_machine *n, int64_t now_ns)
{
	const struct bb_error *e = bb_stream_error(n->stream);

	if (n->failure_told || !e->number)
		return;
	n->failure_told = true;
	bb_watch_warn(n->loop->watch, n->loop->node_slot[n->index], now_ns, "coarser bricks for %.120s", e->text);
}

void bb_streaming_frame(struct bb_node_machine *n, const struct bb_stream_counts *c, int64_t now_ns)
{
	struct bb_stream_node *r = result_of(n);
	const uint64_t held = bb_stream_memory_bytes(n->stream);

	n->counts = *c;
	watch_disk(n, c, now_ns);
	tell_failure(n, now_ns);
	if (!r)
		return;
	r->frames++;
	r->held_bytes = held > r->held_bytes ? held : r->held_bytes;
	add(&r->loaded, c->loaded);
	add(&r->bytes, c->bytes);
	add(&r->drawn, c->drawn);
	add(&r->missing, c->missing);
	add(&r->deficit, c->deficit);
	r->evicted += c->evicted;
	r->prefetched += c->prefetched;
}

/* The frame is drawn. Was it late, and would it have been in time without its bricks? */
bool bb_streaming_ready(struct bb_node_machine *n, int64_t received_ns, int64_t ready_ns)
{
	struct bb_stream_node *r = result_of(n);

	if (!r || !n->stream)
		return false;
	const double limit = n->loop->result->streaming.limit_ms;
	const struct bb_stream_load load = { .frame = n->frame, .at_ns = received_ns - n->loop->scene_start_ns,
		                             .bricks = n->counts.arrived,
		                             .bytes = n->counts.arrived * n->loop->result->streaming.brick_bytes,
		                             .ms = (double)n->load_ns * 1e-6,
		                             .frame_ms = (double)(ready_ns - received_ns) * 1e-6 };
	r->load_sum_ms += load.ms;
	if (load.ms > r->most.ms)
		r->most = load;
	if (!(load.frame_ms > limit && load.frame_ms - load.ms <= limit))
		return false;
	r->late++;
	if (load.frame_ms > r->worst.frame_ms)
		r->worst = load;
	return true;
}

void bb_streaming_gather(const struct bb_frame_loop *l)
{
	for (size_t i = 0; i < l->result->streaming.n_nodes; i++) {
		struct bb_stream_node *r = &l->result->streaming.nodes[i];
		const struct bb_stream *s = l->nodes[i].stream;
		if (!s)
			continue;
		const struct bb_stream_config *c = bb_stream_config(s);
		const struct bb_error *e = bb_stream_error(s);
		r->budget_bytes = c->memory_bytes;
		r->budget_bricks = c->bricks_per_frame;
		r->failed = bb_stream_failures(s, &r->odd);
		r->error = e->number;
		if (e->number)
			bb_text_clean(r->error_text, sizeof(r->error_text), e->text);
	}
}
