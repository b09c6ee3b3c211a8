#include "bench/loop/lock.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/remote.h"
#include "sync/framelock/framelock.h"
#include "sync/lock_proof.h"

_Static_assert(sizeof(struct bb_message) > BB_LOCK_MESSAGE_MAX, "bb_lock_hear tells them apart by length");

#define PLAN_AHEAD 8   /* frames from a timed plan's telling to its first flip */
#define PLAN_FRAMES 64 /* made anew: vblanks and the head's clock drift apart */
#define PHASE_PART 100 /* of a refresh: vblanks of one group lie closer together */
#define GUARD 32       /* part of a refresh: more than clocks and vblanks drift apart while a plan holds */
#define DRAWN_NS (5 * BB_NS_PER_S) /* posix: all nodes draw in this one process, one after another */

struct bb_lock_node {
	struct bb_frame_loop *loop;
	uint16_t index;
	struct bb_framelock *lock; /* NULL: draws nothing and is not the head */
	struct bb_timer step;
};

struct bb_loop_lock {
	struct bb_lock_node *nodes; /* by room node */
	uint64_t planned;           /* first frame of the newest plan */
};

static bool dead(const struct bb_frame_loop *l, unsigned node, int64_t now_ns)
{
	return l->world && sim_world_node_dead(l->world, (uint16_t)node, now_ns);
}

static void send(void *ctx, uint16_t to, const void *bytes, size_t n)
{
	struct bb_lock_node *node = ctx;
	struct bb_frame_loop *l = node->loop;

	if (!dead(l, node->index, bb_clock_now_ns(l->clk)) && bb_link_send(l->rig->link, node->index, to, bytes, n) != BB_OK)
		bb_result_count(l->result, "messages_refused", 1);
}

/* Nodes of this process: the head can see who drew last. */
static unsigned last_drawn(const struct bb_frame_loop *l, const struct bb_frame *f)
{
	unsigned last = BB_NOBODY;

	for (unsigned i = 0; i < l->room->n_nodes; i++)
		if ((l->drawing_nodes & ~f->missing_nodes) >> i & 1 && f->node[i].ready_ns &&
		    (last == BB_NOBODY || f->node[i].ready_ns >= f->node[last].ready_ns))
			last = i;
	for (unsigned i = 0; i < l->room->n_nodes; i++)
		if (f->missing_nodes >> i & 1)
			last = i;
	return last;
}

static void head_released(struct bb_lock_node *n, const struct bb_lock_release *r, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;
	struct bb_frame *f = bb_loop_frame(l, r->frame);
	struct bb_release told = { .frame = r->frame, .missing = r->missing.bits[0] & l->drawing_nodes };
	const uint64_t waited = bb_framelock_members(n->lock)->bits[0] | told.missing;

	if (f)
		f->missing_nodes = told.missing;
	told.last = f ? last_drawn(l, f) : BB_NOBODY;
	if (r->timed)
		bb_result_count(l->result, "flips_timed", 1);
	bb_head_note_release(l, &told, waited, now_ns);
}

static void released(void *ctx, const struct bb_lock_release *r)
{
	struct bb_lock_node *n = ctx;
	struct bb_frame_loop *l = n->loop;
	const struct bb_message m = { .kind = BB_MESSAGE_RELEASE, .frame = r->frame };
	const int64_t now_ns = bb_clock_now_ns(l->clk);
	const bool head = n->index == bb_loop_head(l);

	if (head)
		head_released(n, r, now_ns);
	if (l->drawing_nodes >> n->index & 1)
		bb_node_hear(&l->nodes[n->index], &m, now_ns);
	if (head)
		bb_head_begin_next(l, now_ns);
}

static void stepped(struct bb_lock_node *n, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;
	const int64_t wake_ns = bb_framelock_step(n->lock, now_ns);

	if (wake_ns == BB_NEVER)
		bb_clock_disarm(l->clk, &n->step);
	else if (bb_clock_arm(l->clk, &n->step, wake_ns > now_ns ? wake_ns : now_ns) != BB_OK)
		bb_clock_stop(l->clk);
}

static int64_t on_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_lock_node *n = bb_container_of(timer, struct bb_lock_node, step);

	(void)scheduled_ns;
	if (dead(n->loop, n->index, now_ns))
		return now_ns + n->loop->frame_ns;
	stepped(n, now_ns);
	return BB_NEVER;
}

/* ---- what the loop calls ---- */

/* Timed: frame f + PLAN_AHEAD flips just before the vblank it is meant for: what is drawn later is late anyway. */
static void plan(struct bb_frame_loop *l, const struct bb_frame *f, int64_t now_ns)
{
	struct bb_lock_node *head = &l->lock->nodes[bb_loop_head(l)];

	if (l->lock->planned && f->frame + PLAN_AHEAD < l->lock->planned + PLAN_FRAMES)
		return;
	for (unsigned i = 0; i < l->room->n_nodes; i++) {
		struct bb_framelock *lock = l->lock->nodes[i].lock;
		if (lock && bb_framelock_state(lock) == BB_LOCK_IN && !bb_framelock_synchronised(lock, now_ns, NULL))
			return;
	}
	l->lock->planned = f->frame + PLAN_AHEAD;
	bb_framelock_plan(head->lock, l->lock->planned,
	                  f->start_ns + bb_rate_frame_ns(l->frame_rate, PLAN_AHEAD) + l->refresh_ns - l->refresh_ns / GUARD, 1);
}

void bb_lock_begun(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns)
{
	const unsigned head = bb_loop_head(l);

	if (l->room->barrier == BB_LOCK_TIMED)
		plan(l, f, now_ns);
	if (!(l->drawing_nodes >> head & 1))
		bb_lock_ready(l, head, f->frame, now_ns);
}

void bb_lock_ready(struct bb_frame_loop *l, unsigned node, uint64_t frame, int64_t now_ns)
{
	struct bb_lock_node *n = &l->lock->nodes[node];

	bb_eventlog_add(l->events, bb_eventlog_source(l->events, "barrier", "swap"), BB_EV_ARRIVE, now_ns, (int64_t)frame, node);
	bb_framelock_ready(n->lock, frame, now_ns);
	stepped(n, now_ns);
}

bool bb_lock_hear(struct bb_frame_loop *l, unsigned node, const struct bb_link_message *packet, int64_t now_ns)
{
	struct bb_lock_node *n = l->lock ? &l->lock->nodes[node] : NULL;

	if (!n || packet->n_bytes == sizeof(struct bb_message))
		return false;
	if (n->lock && !dead(l, node, now_ns)) {
		bb_framelock_hear(n->lock, packet->from, packet->bytes, packet->n_bytes, now_ns);
		stepped(n, now_ns);
	}
	return true;
}

/* ---- creation ---- */

static enum bb_status create_one(struct bb_frame_loop *l, uint16_t index, const struct bb_lock_set *members)
{
	struct bb_lock_node *n = &l->lock->nodes[index];
	struct bb_lock_config c = { .method = (enum bb_lock_method)l->room->barrier, .n_nodes = (uint16_t)l->room->n_nodes,
		                    .self = index, .master = (uint16_t)bb_loop_head(l), .members = *members,
		                    .rate = l->frame_rate, .send = send, .released = released, .ctx = n };

	n->loop = l;
	n->index = index;
	n->step = (struct bb_timer){ .step = on_step, .rank = 3 };
	if (!bb_lock_set_has(members, index))
		return BB_OK;
	bb_lock_config_times(&c, l->frame_ns);
	c.master_ns = BB_NEVER; /* the head owns the devices: nobody can take its place */
	if (l->draw_everything)
		c.give_up_ns = c.stall_ns = DRAWN_NS;
	enum bb_status status = bb_framelock_create(&c, &n->lock);
	return status == BB_OK ? bb_clock_arm(l->clk, &n->step, bb_clock_now_ns(l->clk)) : status;
}

enum bb_status bb_lock_create(struct bb_frame_loop *l, struct bb_error *err)
{
	struct bb_lock_set members = { .bits = { l->drawing_nodes | UINT64_C(1) << bb_loop_head(l) } };
	enum bb_status status = BB_OK;

	if (l->room->barrier == BB_LOCK_CENTRAL)
		return BB_OK;
	if (l->processes || bb_remote_only_plays(l))
		return bb_fail(err, BB_ERR_CONFIG, 1662, NULL, "nodes in several processes");
	l->lock = calloc(1, sizeof(*l->lock));
	if (l->lock)
		l->lock->nodes = calloc(l->room->n_nodes, sizeof(*l->lock->nodes));
	if (!l->lock || !l->lock->nodes)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the swap barrier");
	for (uint16_t i = 0; i < l->room->n_nodes && status == BB_OK; i++)
		status = create_one(l, i, &members);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1506, NULL, "the swap barrier: %s", bb_status_text(status));
}

void bb_lock_destroy(struct bb_frame_loop *l)
{
	for (size_t i = 0; l->lock && l->lock->nodes && i < l->room->n_nodes; i++) {
		bb_clock_disarm(l->clk, &l->lock->nodes[i].step);
		bb_framelock_destroy(l->lock->nodes[i].lock);
	}
	if (l->lock)
		free(l->lock->nodes);
	free(l->lock);
	l->lock = NULL;
}

/* ---- proof ---- */

/* Of the displays of one rate: others are locked to another reference, or to every second vblank of this one. */
static bool sample(struct bb_frame_loop *l, size_t screen, struct bb_lock_proof *p, unsigned at)
{
	const struct bb_display_config *c = &l->room->screens[screen].display;
	struct bb_display *d = l->rig->displays[screen];
	struct bb_vblank v;
	uint64_t counter;

	return d && c->genlock && (uint64_t)c->rate.num * p->rate.den == (uint64_t)p->rate.num * c->rate.den &&
	       bb_display_vblank(d, &v) == BB_OK && bb_display_swap_counter(d, &counter) == BB_OK &&
	       bb_lock_proof_add(p, at, counter, v.at_ns, bb_display_limits(d)->stamp_error_ns);
}

void bb_lock_prove(struct bb_frame_loop *l)
{
	struct bb_lock_proof p;
	size_t first = 0;
	unsigned n = 0;

	while (first < l->room->n_screens && !l->room->screens[first].display.genlock)
		first++;
	if (first == l->room->n_screens)
		return;
	const struct bb_rate rate = l->room->screens[first].display.rate;
	bb_lock_proof_init(&p, BB_LOCK_PROOF_DISPLAYS_MAX, rate, bb_rate_period_ns(rate) / PHASE_PART);
	for (size_t i = first; i < l->room->n_screens && n < BB_LOCK_PROOF_DISPLAYS_MAX; i++)
		n += sample(l, i, &p, n);
	p.n = n;
	if (n < 2)
		return;
	const struct bb_lock_finding f = bb_lock_proof_judge(&p, bb_clock_now_ns(l->clk));
	bb_result_fact(l->result, "frame_lock", "%s: %u genlocked displays, counters %lld apart, vblanks within %.1f us (+-%.1f)",
	               bb_lock_verdict_text(f.verdict), n, (long long)f.counters_apart,
	               (double)(f.phase_ns < 0 ? -f.phase_ns : f.phase_ns) * 1e-3, (double)f.uncertainty_ns * 1e-3);
}
