/*
 * bench/loop/orphan.c: a node that hears nothing of the head, which died or is on the other side of a broken network (rows
 * N8 and N3). It holds its last pictures for a second, fades them to black and waits in the dark, which is the safe idle
 * scene: nothing moves, nothing flashes. When the head is back its pictures fade in, after hal/safe_state.h's pause.
 */
#include "bench/loop/remote.h"

#include <math.h>
#include <stdio.h>

#define HOLD_NS BB_NS_PER_S

static void note(struct bb_node_machine *n, int64_t now_ns)
{
	bb_eventlog_add(n->loop->events, n->source, BB_EV_ORPHAN, now_ns, n->orphan.alone, llround(1e6 * n->orphan.light));
}

static void lose(struct bb_node_machine *n, int64_t now_ns)
{
	struct bb_orphan *o = &n->orphan;
	const double ms = (double)(now_ns - o->heard_ns) * 1e-6;

	if (o->alone)
		return;
	o->alone = true;
	note(n, now_ns);
	bb_result_count(n->loop->result, "heads_lost", 1);
	bb_watch_bad(n->loop->watch, o->slot, now_ns, BB_HEALTH_HOLDOVER,
	             "MASTER_LOST: nothing of the head for %.1f ms (dead, or a partition): its walls hold their pictures", ms);
	if (bb_remote_only_plays(n->loop)) /* its report is the head's, and the head is not there */
		fprintf(stderr, "node %s: MASTER_LOST: nothing of the head for %.1f ms: its walls hold their pictures, fade and wait\n",
		        n->loop->room->nodes[n->index].id, ms);
}

static bool move(struct bb_node_machine *n, enum bb_show want, int64_t now_ns)
{
	struct bb_orphan *o = &n->orphan;
	const double was = o->light;

	o->light = bb_safe_step(&o->safe, want, now_ns).light;
	return o->light < was || o->light > was;
}

static struct bb_message dimmed(const struct bb_orphan *o, const struct bb_message *m)
{
	struct bb_message own = *m;

	own.light = (uint16_t)lround(m->light * o->light);
	return own;
}

/* A frame without the head. */
static void go_on(struct bb_node_machine *n, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;
	struct bb_orphan *o = &n->orphan;
	const bool moved = now_ns - o->heard_ns >= HOLD_NS && move(n, BB_SHOW_BLACK, now_ns);
	const struct bb_message m = dimmed(o, &o->last);

	bb_node_flips(l, n); /* or those that nobody reads push out those that matter */
	if (moved) {
		note(n, now_ns);
		bb_watch_bad(l->watch, o->slot, now_ns, BB_HEALTH_LOST, "MASTER_LOST: no word of the head: walls faded to black");
	}
	bb_node_show_again(n, &m, moved, now_ns);
	if (l->picture_frame && o->pictured != l->n_frames) {
		o->pictured = l->n_frames;
		bb_node_take_pictures(n, &m);
	}
}

static int64_t watch(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_node_machine *n = bb_container_of(timer, struct bb_node_machine, orphan.watch);
	struct bb_orphan *o = &n->orphan;

	(void)scheduled_ns;
	if (n->loop->world && sim_world_node_dead(n->loop->world, n->index, now_ns))
		o->heard_ns = now_ns; /* who is dead itself misses nobody */
	if (now_ns - o->heard_ns < o->last.silence_ns)
		return o->heard_ns + o->last.silence_ns;
	lose(n, now_ns);
	go_on(n, now_ns);
	return now_ns + n->loop->frame_ns;
}

void bb_orphan_init(struct bb_node_machine *n)
{
	n->orphan.watch = (struct bb_timer){ .step = watch, .rank = 3 };
	n->orphan.light = 1;
	n->orphan.slot = bb_watch_slot(n->loop->watch, "node", n->loop->room->nodes[n->index].id);
	bb_safe_init(&n->orphan.safe, &n->loop->room->safety, 1, BB_SHOW_STEREO, bb_clock_now_ns(n->loop->clk));
}

void bb_orphan_heard(struct bb_node_machine *n, const struct bb_message *m, int64_t now_ns)
{
	struct bb_orphan *o = &n->orphan;

	o->heard_ns = now_ns;
	if (m->kind == BB_MESSAGE_OVER)
		bb_clock_disarm(n->loop->clk, &o->watch);
	if (m->kind != BB_MESSAGE_STATE || n->index == bb_loop_head(n->loop))
		return;
	o->last = *m;
	if (!o->watch.slot && bb_clock_arm(n->loop->clk, &o->watch, now_ns + m->silence_ns) != BB_OK)
		bb_clock_stop(n->loop->clk);
}

struct bb_message bb_orphan_dim(struct bb_node_machine *n, const struct bb_message *m, int64_t now_ns)
{
	struct bb_orphan *o = &n->orphan;
	const bool moved = move(n, BB_SHOW_STEREO, now_ns), was_alone = o->alone;

	o->alone = false;
	if (moved || was_alone)
		note(n, now_ns);
	if (o->light >= 1)
		bb_watch_good(n->loop->watch, o->slot, now_ns);
	return dimmed(o, m);
}

bool bb_orphans_rest(const struct bb_frame_loop *l)
{
	for (size_t i = 0; i < l->room->n_nodes; i++)
		if (l->nodes[i].orphan.watch.slot && l->nodes[i].orphan.light > 0)
			return false;
	return true;
}
