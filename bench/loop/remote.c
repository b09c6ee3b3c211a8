#include "bench/loop/remote.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/follow.h"
#include "bench/stats.h"

#define READY_WITHIN_NS (120 * BB_NS_PER_S)
#define SILENT_NS (5 * BB_NS_PER_S) /* a head not heard of for so long is gone */
#define FLOOR_WAKES 600
#define FLOOR_WAKES_BUSY 100 /* the others take a head that is silent for long for dead */

enum told { TOLD_READY = 0x6301, TOLD_START, TOLD_DREW, TOLD_RELEASED, TOLD_FLIPPED };

struct told_message { /* native layout: all processes are of one version */
	uint32_t kind, node;
	uint64_t frame;
	int64_t at_ns;          /* START: when the scene begins; RELEASED: when it was */
	int64_t late_ns;        /* DREW: the latest wake-up since the last told; -1: none */
	int64_t received_ns, selected_ns, ready_ns, load_ns;
	uint64_t held_bytes;
	struct bb_stream_counts counts;
	struct bb_flip flip;
	uint32_t screen, view_flags;
};
_Static_assert(sizeof(struct told_message) <= BB_LINK_MESSAGE_MAX && sizeof(struct told_message) != sizeof(struct bb_message),
               "one packet, and told apart by its length");

bool bb_remote_plays(const struct bb_frame_loop *l, size_t node)
{
	const struct bb_link_group *g = l->room->link.group;

	return !g || g->home[node] == g->process;
}

bool bb_remote_only_plays(const struct bb_frame_loop *l)
{
	const struct bb_link_group *g = l->room->link.group;

	return g && g->process;
}

static void send(struct bb_frame_loop *l, unsigned from, unsigned to, const struct told_message *m)
{
	if (bb_link_send(l->rig->link, (uint16_t)from, (uint16_t)to, m, sizeof(*m)) != BB_OK)
		bb_result_count(l->result, "messages_refused", 1);
}

static void tell_head(struct bb_frame_loop *l, unsigned node, struct told_message *m)
{
	m->node = node;
	send(l, node, bb_loop_head(l), m);
}

/* ---- how late a process wakes ---- */

static void sample_late(struct bb_frame_loop *l, uint16_t node, uint64_t frame, int64_t at_ns, int64_t late_ns)
{
	const struct bb_sample s = { .value = (double)late_ns * 1e-3, .frame = frame, .at_ns = at_ns, .node = node,
		                     .stage = BB_STAGE_COUNT };

	bb_ledger_sample(l->ledger, BB_METRIC_WAKE_LATE, &s);
}

void bb_remote_woke(struct bb_frame_loop *l, int64_t scheduled_ns, int64_t now_ns)
{
	if (l->processes)
		sample_late(l, (uint16_t)bb_loop_head(l), l->n_frames, scheduled_ns, now_ns - scheduled_ns);
}

/* Another process: a quarter of a frame after it was released, when it has nothing else to do. */
static int64_t beat(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = bb_container_of(timer, struct bb_frame_loop, beat);

	l->late_ns = now_ns - scheduled_ns > l->late_ns ? now_ns - scheduled_ns : l->late_ns;
	return BB_NEVER;
}

static void tell_late(struct bb_frame_loop *l, const char *key, bool heads)
{
	const struct bb_sample *s;
	const size_t n = bb_ledger_samples(l->ledger, BB_METRIC_WAKE_LATE, &s);
	double *late_us = calloc(n + 1, sizeof(*late_us));
	size_t count = 0;

	for (size_t i = 0; late_us && i < n; i++)
		if ((s[i].node == bb_loop_head(l)) == heads)
			late_us[count++] = s[i].value;
	if (count) {
		bb_stats_sort(late_us, count);
		bb_result_fact(l->result, key, "%zu wakes: p50 %.1f, p90 %.1f, p99 %.1f, p99.9 %.1f, max %.1f", count,
		               bb_stats_nearest_rank(late_us, count, 0.5), bb_stats_nearest_rank(late_us, count, 0.9),
		               bb_stats_nearest_rank(late_us, count, 0.99), bb_stats_nearest_rank(late_us, count, 0.999),
		               late_us[count - 1]);
	}
	free(late_us);
}

/* The same wake-ups by a bare sleep, before anything else runs and after: what the machine itself adds. */
static void tell_floor(struct bb_frame_loop *l, const char *key, double most)
{
	const double s = l->options->duration_s > 0 ? l->options->duration_s : l->scene->duration_s;
	const size_t n = (size_t)fmin(most, fmax(30, s * bb_rate_hz(l->frame_rate) / 100));
	double late_us[FLOOR_WAKES];

	bb_clock_floor_us(l->frame_ns, late_us, n);
	bb_stats_sort(late_us, n);
	bb_result_fact(l->result, key, "%zu wakes: p50 %.1f, p90 %.1f, p99 %.1f, max %.1f", n,
	               bb_stats_nearest_rank(late_us, n, 0.5), bb_stats_nearest_rank(late_us, n, 0.9),
	               bb_stats_nearest_rank(late_us, n, 0.99), late_us[n - 1]);
}

void bb_remote_tell(struct bb_frame_loop *l)
{
	const struct link_counts c = link_counts(l->rig->link);

	if (!l->processes)
		return;
	bb_result_fact(l->result, "processes", "%u over %.*s", bb_nodes_count(l->processes),
	               (int)strcspn(link_address(l->rig->link), ":"), link_address(l->rig->link));
	bb_follow_tell(l->follow, l->result);
	tell_late(l, "wake_late_head_us", true);
	tell_late(l, "wake_late_nodes_us", false);
	tell_floor(l, "timer_floor_busy_us", FLOOR_WAKES_BUSY); /* the others still run */
	bb_result_count(l->result, "packets_sent", c.sent);
	bb_result_count(l->result, "packets_received", c.received);
	bb_result_count(l->result, "packets_missed", c.missed);
	bb_result_count(l->result, "packets_refused", c.truncated + c.malformed + c.forged + c.replayed + c.stale +
	                                                      c.refused_version + c.refused_config + c.refused_place);
}

/* ---- the head's side ---- */

static uint16_t process_of(const struct bb_frame_loop *l, unsigned node)
{
	return bb_nodes_home(l->processes, node);
}

/* Nobody waits for nodes whose process is gone; the report says since when, and why. */
static void miss(struct bb_frame_loop *l, const struct bb_node_loss *loss, int64_t now_ns)
{
	bb_result_count(l->result, "processes_lost", 1);
	l->ready_processes &= ~(UINT64_C(1) << loss->process);
	for (unsigned i = 0; i < l->room->n_nodes; i++)
		if (process_of(l, i) == loss->process) {
			bb_watch_bad(l->watch, l->gone_slot[i], now_ns, BB_HEALTH_LOST, "%s", loss->what);
			bb_barrier_drop(&l->barrier, i);
		}
}

static int64_t look_after(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = bb_container_of(timer, struct bb_frame_loop, look_after);
	struct bb_node_loss loss;

	(void)scheduled_ns;
	while (bb_nodes_lost(l->processes, &loss)) {
		miss(l, &loss, now_ns);
		bb_head_step_barrier(l, now_ns);
	}
	if (bb_head_stopped(l, now_ns))
		bb_clock_stop(l->clk);
	return now_ns + l->frame_ns;
}

enum bb_status bb_remote_gather(struct bb_frame_loop *l, struct bb_error *err)
{
	const uint16_t n = bb_nodes_count(l->processes);
	const uint64_t all = (n < 64 ? (UINT64_C(1) << n) - 1 : UINT64_MAX) & ~UINT64_C(1);
	const int64_t end_ns = bb_clock_now_ns(l->clk) + READY_WITHIN_NS;
	struct bb_node_loss loss;
	const enum bb_status status = bb_link_notify(l->rig->link, (uint16_t)bb_loop_head(l), &l->head_inbox);

	if (status != BB_OK)
		return bb_fail(err, status, 1503, NULL, "the link between the processes");
	while ((l->ready_processes & all) != all) {
		if (bb_nodes_lost(l->processes, &loss))
			return bb_fail(err, BB_ERR_LOST, 1679, NULL, "%s", loss.what);
		if (bb_clock_now_ns(l->clk) > end_ns || bb_loop_interrupted(l))
			return bb_fail(err, BB_ERR_LOST, 1679, NULL, "%d of %u are", __builtin_popcountll(l->ready_processes), n - 1U);
		bb_clock_run_until(l->clk, bb_clock_now_ns(l->clk) + BB_NS_PER_S / 100);
	}
	tell_floor(l, "timer_floor_us", FLOOR_WAKES);
	return BB_OK;
}

static void start_node(struct bb_frame_loop *l, unsigned node)
{
	const struct told_message m = { .kind = TOLD_START, .node = node, .at_ns = l->scene_start_ns };

	send(l, bb_loop_head(l), node, &m);
}

enum bb_status bb_remote_start(struct bb_frame_loop *l)
{
	for (unsigned i = 0; i < l->room->n_nodes; i++)
		if (!bb_remote_plays(l, i))
			start_node(l, i);
	if (l->options->processes.tell)
		fprintf(stderr, "%u processes are ready: the scene begins\n", bb_nodes_count(l->processes));
	l->look_after = (struct bb_timer){ .step = look_after, .rank = 4 };
	return bb_clock_arm(l->clk, &l->look_after, l->scene_start_ns);
}

void bb_remote_end(struct bb_frame_loop *l)
{
	const struct bb_message m = { .kind = BB_MESSAGE_OVER };

	for (unsigned i = 0; l->processes && i < l->room->n_nodes; i++)
		if (!bb_remote_plays(l, i))
			bb_loop_say(l, bb_loop_head(l), i, &m);
}

static void hear_ready(struct bb_frame_loop *l, const struct told_message *m)
{
	l->ready_processes |= UINT64_C(1) << process_of(l, m->node);
	if (!l->scene_start_ns)
		return;
	bb_result_count(l->result, "nodes_rejoined", 1);
	if (l->options->processes.tell)
		fprintf(stderr, "node %s is back\n", l->room->nodes[m->node].id);
	start_node(l, m->node); /* back in the middle of the scene */
}

static void hear_drew(struct bb_frame_loop *l, const struct told_message *m, int64_t now_ns)
{
	struct bb_node_machine *n = &l->nodes[m->node];
	struct bb_frame *f = bb_loop_frame(l, m->frame);
	const struct bb_message arrived = { .kind = BB_MESSAGE_ARRIVE, .frame = m->frame };

	n->frame = m->frame;
	n->load_ns = m->load_ns;
	n->held_bytes = m->held_bytes;
	bb_watch_good(l->watch, l->gone_slot[m->node], now_ns);
	if (m->late_ns >= 0) /* of the nodes of one process the first tells */
		sample_late(l, n->index, m->frame, now_ns, m->late_ns);
	if (f) {
		f->node[n->index].received_ns = m->received_ns;
		f->node[n->index].selected_ns = m->selected_ns;
		l->usual_ns = now_ns - f->start_ns > l->usual_ns ? now_ns - f->start_ns : l->usual_ns;
		f->load_ns = m->load_ns > f->load_ns ? m->load_ns : f->load_ns;
		f->view_flags |= m->view_flags;
		bb_node_book(n, f, &m->counts, m->received_ns);
		bb_node_drawn(n, f, m->ready_ns, now_ns);
	}
	bb_head_hear(l, m->node, &arrived, now_ns);
}

static void hear_shown(struct bb_frame_loop *l, const struct told_message *m)
{
	struct bb_frame *f = bb_loop_frame(l, m->frame);

	if (m->kind == TOLD_RELEASED && f)
		f->node[m->node].released_ns = m->at_ns;
	else if (m->kind == TOLD_FLIPPED && m->screen < l->room->n_screens &&
	         l->room->screens[m->screen].node == m->node && l->rig->displays[m->screen])
		bb_node_note_flip(l, (uint16_t)m->screen, &m->flip);
}

/* ---- the others' side ---- */

void bb_remote_drew(struct bb_node_machine *n, const struct bb_frame *f)
{
	const struct bb_node_times *t = &f->node[n->index];
	struct told_message m = { .kind = TOLD_DREW, .frame = f->frame, .late_ns = n->loop->late_ns,
		                  .received_ns = t->received_ns, .selected_ns = t->selected_ns, .ready_ns = t->ready_ns,
		                  .load_ns = n->load_ns, .counts = n->counts, .view_flags = f->view_flags,
		                  .held_bytes = n->stream ? bb_stream_memory_bytes(n->stream) : 0 };

	n->loop->late_ns = -1;
	tell_head(n->loop, n->index, &m);
}

void bb_remote_released(struct bb_node_machine *n, const struct bb_frame *f)
{
	struct told_message m = { .kind = TOLD_RELEASED, .frame = f->frame, .at_ns = f->node[n->index].released_ns };

	tell_head(n->loop, n->index, &m);
	if (!n->loop->beat.slot && bb_clock_arm(n->loop->clk, &n->loop->beat, m.at_ns + n->loop->frame_ns / 4) != BB_OK)
		bb_clock_stop(n->loop->clk);
}

void bb_remote_flipped(struct bb_node_machine *n, uint16_t screen, const struct bb_flip *flip)
{
	struct told_message m = { .kind = TOLD_FLIPPED, .frame = flip->frame, .screen = screen, .flip = *flip };

	tell_head(n->loop, n->index, &m);
}

/* The head begins a frame: this process keeps its own record of it. */
static void note_frame(struct bb_frame_loop *l, const struct bb_message *m)
{
	struct bb_frame *f = &l->frames[m->frame % BB_FRAMES_RING];

	l->left_ns = m->photon_ns;
	if (f->open && f->frame == m->frame)
		return; /* another node of this process has begun it */
	memset(f, 0, sizeof(*f));
	f->frame = m->frame;
	f->open = true;
	for (size_t i = 0; i < l->room->n_nodes; i++)
		if (bb_remote_plays(l, i))
			bb_node_flips(l, &l->nodes[i]);
}

static void hear_start(struct bb_frame_loop *l, const struct told_message *m)
{
	if (l->scene_start_ns)
		return;
	l->scene_start_ns = m->at_ns;
	if (l->world)
		sim_world_set_scene_start(l->world, m->at_ns);
}

static int64_t watch_head(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = bb_container_of(timer, struct bb_frame_loop, look_after);
	const struct link_peer head = link_peer(l->rig->link, 0);

	(void)scheduled_ns;
	const bool gone = head.state != LINK_PEER_JOINED ||
	                  now_ns - head.heard_ns > (l->scene_start_ns ? SILENT_NS : READY_WITHIN_NS);
	/* A head that died has its walls faded before the process goes: row N8. */
	if (bb_loop_interrupted(l) || head.left || (gone && bb_orphans_rest(l)))
		bb_clock_stop(l->clk);
	return now_ns + BB_NS_PER_S / 20;
}

enum bb_status bb_remote_serve(struct bb_frame_loop *l, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	l->look_after = (struct bb_timer){ .step = watch_head, .rank = 4 };
	l->beat = (struct bb_timer){ .step = beat }; /* one that joins late may hear of releases before the start */
	l->late_ns = -1;
	for (uint16_t i = 0; i < l->room->n_nodes && status == BB_OK; i++) {
		struct told_message m = { .kind = TOLD_READY };
		if (!bb_remote_plays(l, i))
			continue;
		bb_node_warm_up(&l->nodes[i]);
		status = bb_link_notify(l->rig->link, i, &l->nodes[i].inbox);
		if (status == BB_OK)
			tell_head(l, i, &m);
	}
	if (status == BB_OK)
		status = bb_clock_arm(l->clk, &l->look_after, bb_clock_now_ns(l->clk));
	if (status == BB_OK)
		status = bb_follow_begin(l->follow);
	if (status != BB_OK)
		return bb_fail(err, status, 1503, NULL, "starting the nodes: %s", bb_status_text(status));
	bb_clock_run_until(l->clk, BB_NEVER - BB_NS_PER_S);
	bb_clock_disarm(l->clk, &l->look_after);
	bb_clock_disarm(l->clk, &l->beat);
	const struct link_peer head = link_peer(l->rig->link, 0);
	if (head.left || bb_loop_interrupted(l))
		return BB_OK;
	return bb_fail(err, BB_ERR_LOST, 1674, NULL, "the head went silent");
}

bool bb_remote_hear(struct bb_frame_loop *l, const struct bb_link_message *packet, int64_t now_ns)
{
	const bool head = !bb_remote_only_plays(l);
	struct told_message m;
	struct bb_message state;

	if (bb_follow_hear(l->follow, packet, now_ns))
		return true;
	if (packet->n_bytes == sizeof(state) && !head) {
		memcpy(&state, packet->bytes, sizeof(state));
		if (state.kind == BB_MESSAGE_STATE)
			note_frame(l, &state);
		return false;
	}
	if (packet->n_bytes != sizeof(m))
		return false;
	memcpy(&m, packet->bytes, sizeof(m));
	if (!head && m.kind == TOLD_START)
		hear_start(l, &m);
	if (!head || m.node != packet->from || m.node >= l->room->n_nodes)
		return true;
	if (m.kind == TOLD_READY)
		hear_ready(l, &m);
	else if (m.kind == TOLD_DREW)
		hear_drew(l, &m, now_ns);
	else
		hear_shown(l, &m);
	return true;
}
