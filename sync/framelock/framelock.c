/* sync/framelock/framelock.c: one node's part: messages in and out, frames released, what is due next. */
#include "sync/framelock/framelock_impl.h"

#include <stdlib.h>
#include <string.h>

void bb_lock_config_times(struct bb_lock_config *c, int64_t frame_ns)
{
	c->retry_ns = frame_ns / 8;
	c->stall_ns = frame_ns;
	c->give_up_ns = frame_ns * 5 / 2;
	c->master_ns = frame_ns * 3;
	c->ping_ns = frame_ns;
}

static bool possible(const struct bb_lock_config *c)
{
	return c->n_nodes >= 1 && c->n_nodes <= BB_LOCK_NODES_MAX && c->self < c->n_nodes && c->master < c->n_nodes &&
	       c->method >= BB_LOCK_CENTRAL && c->method < BB_LOCK_METHODS && c->send && c->released && c->rate.num &&
	       c->rate.den && c->retry_ns > 0 && c->stall_ns > 0 && c->give_up_ns > 0 && c->master_ns > 0 &&
	       (c->method != BB_LOCK_TIMED || c->ping_ns > 0);
}

static const struct bb_lock_ops *const methods[BB_LOCK_METHODS] = {
	[BB_LOCK_CENTRAL] = &bb_lock_central,
	[BB_LOCK_TREE] = &bb_lock_tree,
	[BB_LOCK_DISSEMINATION] = &bb_lock_dissemination,
	[BB_LOCK_TIMED] = &bb_lock_central, /* until there is a plan */
};

enum bb_status bb_framelock_create(const struct bb_lock_config *config, struct bb_framelock **out)
{
	*out = NULL;
	if (!possible(config))
		return BB_ERR_USAGE;
	struct bb_framelock *f = calloc(1, sizeof(*f));
	if (!f)
		return BB_ERR_NOMEM;
	f->c = *config;
	f->c.version = config->version ? config->version : BB_LOCK_VERSION;
	f->c.window = config->window ? config->window : BB_CLOCKFIT_WINDOW_DEFAULT;
	f->ops = methods[config->method];
	f->order = calloc(config->n_nodes, sizeof(*f->order));
	f->came = calloc(config->n_nodes, sizeof(*f->came));
	f->came_ns = calloc(config->n_nodes, sizeof(*f->came_ns));
	if (config->method == BB_LOCK_TIMED)
		f->fit = calloc(1, sizeof(*f->fit));
	if (!f->order || !f->came || !f->came_ns || (config->method == BB_LOCK_TIMED && !f->fit)) {
		bb_framelock_destroy(f);
		return BB_ERR_NOMEM;
	}
	bb_framelock_restart(f);
	if (bb_lock_set_has(&config->members, config->self)) {
		f->state = BB_LOCK_IN;
		f->epoch = 1;
		f->members = config->members;
		lock_begin_epoch(f, 0);
	}
	*out = f;
	return BB_OK;
}

void bb_framelock_destroy(struct bb_framelock *f)
{
	if (!f)
		return;
	free(f->order);
	free(f->came);
	free(f->came_ns);
	free(f->fit);
	free(f);
}

void bb_framelock_restart(struct bb_framelock *f)
{
	const struct bb_framelock keep = *f;

	memset(f, 0, sizeof(*f));
	f->c = keep.c;
	f->ops = keep.ops;
	f->counts = keep.counts;
	f->order = keep.order;
	f->came = keep.came;
	f->came_ns = keep.came_ns;
	f->fit = keep.fit;
	f->state = BB_LOCK_OUT;
	f->master = f->join_to = f->c.master;
	f->opened_ns = BB_NEVER;
	f->join_ns = f->ping_ns = f->beacon_ns = INT64_MIN; /* at once */
	f->master_ns = BB_NEVER;
	if (f->fit)
		bb_clockfit_init(f->fit, f->c.window);
}

/* ---- messages ---- */

void lock_send_message(struct bb_framelock *f, uint16_t to, struct bb_lock_message *m)
{
	uint8_t bytes[BB_LOCK_MESSAGE_MAX];

	m->master = f->master;
	m->n_nodes = f->c.n_nodes;
	f->counts.sent++;
	f->c.send(f->c.ctx, to, bytes, bb_lock_write(m, bytes));
}

void lock_send(struct bb_framelock *f, uint16_t to, enum bb_lock_kind kind, uint64_t frame, unsigned round)
{
	struct bb_lock_message m = { .kind = kind, .round = (uint8_t)round, .epoch = f->epoch, .frame = frame };

	lock_send_message(f, to, &m);
}

/* A message of another epoch: who is behind is told, or asks. */
static void hear_foreign(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m)
{
	f->counts.foreign++;
	if (f->state != BB_LOCK_IN)
		return;
	if (m->epoch <= f->epoch) /* the same: a stranger who thinks he is a member */
		lock_send_epoch(f, from);
	else if (!f->next.any || m->epoch > f->next.epoch)
		lock_send(f, from, BB_LOCK_ROLL, f->frame, 0);
	else if (m->kind == BB_LOCK_ROLL) /* waits for an epoch that has yet to begin: I am here */
		lock_send_epoch(f, from);
}

/* Whoever is at a later frame of the same epoch has seen this one released. */
static void hear_progress(struct bb_framelock *f, const struct bb_lock_message *m, int64_t now_ns)
{
	const uint64_t released = m->frame + (m->kind == BB_LOCK_RELEASE); /* all below */

	if (released > f->frame && !lock_planned(f, f->frame))
		lock_release(f, released - 1, now_ns);
}

static void hear_member(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns)
{
	if (from == f->master && f->c.master_ns != BB_NEVER)
		f->master_ns = now_ns + f->c.master_ns;
	hear_progress(f, m, now_ns);
	if (m->kind == BB_LOCK_RELEASE)
		return;
	if (m->kind != BB_LOCK_NUDGE)
		lock_note(f, from, m->frame, now_ns);
	if (m->kind == BB_LOCK_ROLL && m->frame < f->frame)
		lock_send(f, from, BB_LOCK_RELEASE, f->frame - 1, 0);
	else if (m->kind != BB_LOCK_ROLL)
		f->ops->hear(f, from, m, now_ns);
}

void bb_framelock_hear(struct bb_framelock *f, uint16_t from, const void *bytes, size_t n, int64_t now_ns)
{
	struct bb_lock_message m;

	f->counts.heard++;
	if (!bb_lock_read(bytes, n, &m) || m.n_nodes != f->c.n_nodes || from >= f->c.n_nodes || from == f->c.self) {
		f->counts.bad++;
		return;
	}
	switch (m.kind) {
	case BB_LOCK_PING:
	case BB_LOCK_PONG:
		lock_time_hear(f, from, &m, now_ns);
		break;
	case BB_LOCK_EPOCH:
		lock_hear_epoch(f, &m, now_ns);
		break;
	case BB_LOCK_JOIN:
		lock_hear_join(f, from, &m, now_ns);
		break;
	case BB_LOCK_REFUSE:
		lock_hear_refuse(f, &m);
		break;
	case BB_LOCK_ARRIVE:
	case BB_LOCK_RELEASE:
	case BB_LOCK_NUDGE:
	case BB_LOCK_ROLL:
		if (f->state != BB_LOCK_IN || m.epoch != f->epoch || m.master != f->master || !bb_lock_set_has(&f->members, from))
			hear_foreign(f, from, &m);
		else
			hear_member(f, from, &m, now_ns);
		break;
	}
}

/* ---- frames ---- */

bool lock_waits(const struct bb_framelock *f)
{
	return f->state == BB_LOCK_IN && f->ready && !lock_planned(f, f->frame);
}

void lock_note(struct bb_framelock *f, uint16_t node, uint64_t frame, int64_t now_ns)
{
	if (f->came[node] > frame)
		return;
	const bool first = f->came[node] <= f->frame && frame >= f->frame;
	f->came[node] = frame + 1;
	f->came_ns[node] = now_ns;
	if (!first || !bb_lock_set_has(&f->members, node))
		return;
	f->n_came++;
	if (f->opened_ns == BB_NEVER)
		f->opened_ns = now_ns;
}

/* After the frame moved on: those who are ahead have come already. */
void lock_recount(struct bb_framelock *f)
{
	f->n_came = 0;
	f->opened_ns = BB_NEVER;
	if (lock_roll_master(f) != f->c.self)
		return;
	for (unsigned i = 0; i < f->n_members; i++) {
		const uint16_t node = f->order[i];
		if (f->came[node] <= f->frame)
			continue;
		f->n_came++;
		f->opened_ns = f->came_ns[node] < f->opened_ns ? f->came_ns[node] : f->opened_ns;
	}
}

/* At the master: who came when, and who was last. */
static void name_last(const struct bb_framelock *f, struct bb_lock_release *r)
{
	bool any = false;

	for (unsigned i = 0; i < f->n_members; i++) {
		const uint16_t node = f->order[i];
		if (f->came[node] <= r->frame)
			continue;
		if (!any || f->came_ns[node] >= r->last_ns) {
			r->last = node;
			r->last_ns = f->came_ns[node];
		}
		if (!any || f->came_ns[node] < r->first_ns)
			r->first_ns = f->came_ns[node];
		any = true;
	}
	for (uint16_t i = 0; i < f->c.n_nodes; i++)
		if (bb_lock_set_has(&r->missing, i)) {
			r->last = i;
			r->last_ns = r->at_ns;
		}
}

void lock_move_on(struct bb_framelock *f, uint64_t frame, int64_t now_ns, const struct bb_lock_set *missing)
{
	struct bb_lock_release r = { .frame = frame, .at_ns = now_ns, .skipped = !f->ready || f->frame != frame,
		                     .last = BB_LOCK_NOBODY, .first_ns = now_ns, .last_ns = now_ns };

	r.missing = missing ? *missing : f->missing;
	f->missing = (struct bb_lock_set){ { 0 } };
	if (f->master == f->c.self)
		name_last(f, &r);
	if (lock_planned(f, frame)) {
		const int64_t flip_ns = bb_framelock_flip_ns(f, frame);
		r.timed = true;
		r.late = f->ready_ns > flip_ns;
		r.at_ns = r.late ? now_ns : flip_ns;
	}
	f->frame = frame + 1;
	f->ready = f->told = false;
	f->round = 0;
	f->attempt = 0;
	lock_recount(f);
	f->c.released(f->c.ctx, &r);
}

void lock_release(struct bb_framelock *f, uint64_t frame, int64_t now_ns)
{
	lock_move_on(f, frame, now_ns, NULL);
	if (!lock_planned(f, frame))
		f->ops->passed(f);
	lock_epoch_due(f, now_ns);
	lock_admit(f);
}

static void rank_members(struct bb_framelock *f)
{
	f->n_members = 0;
	f->order[f->n_members++] = f->master;
	for (uint16_t i = 0; i < f->c.n_nodes; i++)
		if (i != f->master && bb_lock_set_has(&f->members, i))
			f->order[f->n_members++] = i;
	for (uint16_t i = 0; i < f->n_members; i++)
		if (f->order[i] == f->c.self)
			f->rank = i;
}

void lock_begin_epoch(struct bb_framelock *f, int64_t now_ns)
{
	rank_members(f);
	memset(f->came, 0, f->c.n_nodes * sizeof(*f->came));
	memset(f->signal, 0, sizeof(f->signal));
	f->round = 0;
	f->told = false;
	f->attempt = 0;
	f->n_came = 0;
	f->opened_ns = BB_NEVER;
	f->epoch_from = f->frame;
	f->counts.epochs++;
	if (f->state == BB_LOCK_IN && !f->ready && f->drawn > f->frame) { /* while it was outside, or elsewhere */
		f->ready = true;
		f->ready_ns = f->rolled_ns = now_ns;
	}
	if (f->state != BB_LOCK_IN || !f->ready)
		return;
	lock_note(f, f->c.self, f->frame, now_ns);
	f->sent_ns = now_ns;
	f->ops->arrive(f, now_ns);
}

void bb_framelock_ready(struct bb_framelock *f, uint64_t frame, int64_t now_ns)
{
	f->drawn = frame + 1;
	if (f->state != BB_LOCK_IN || frame < f->frame || (f->ready && frame == f->frame))
		return;
	if (frame > f->frame) { /* frames between were never asked for */
		f->frame = frame;
		lock_recount(f);
		lock_epoch_due(f, now_ns);
	}
	f->ready = true;
	f->ready_ns = f->sent_ns = f->rolled_ns = now_ns;
	if (f->c.master_ns != BB_NEVER && !lock_planned(f, frame))
		f->master_ns = now_ns + f->c.master_ns;
	lock_note(f, f->c.self, frame, now_ns);
	f->ops->arrive(f, now_ns);
}

int64_t bb_framelock_step(struct bb_framelock *f, int64_t now_ns)
{
	int64_t wake_ns = BB_NEVER, roll_ns, time_ns;

	if (f->fit)
		lock_time_step(f, now_ns);
	if (lock_waits(f) && now_ns - f->sent_ns >= f->c.retry_ns) {
		f->sent_ns = now_ns;
		f->counts.resent++;
		f->ops->retry(f);
	}
	lock_roll_step(f, now_ns);
	if (lock_waits(f))
		wake_ns = f->sent_ns + f->c.retry_ns;
	roll_ns = lock_roll_wake(f);
	time_ns = f->fit ? lock_time_wake(f) : BB_NEVER;
	wake_ns = roll_ns < wake_ns ? roll_ns : wake_ns;
	return time_ns < wake_ns ? time_ns : wake_ns;
}

/* ---- what is asked of it ---- */

enum bb_lock_state bb_framelock_state(const struct bb_framelock *f)
{
	return f->state;
}

uint64_t bb_framelock_frame(const struct bb_framelock *f)
{
	return f->frame;
}

uint32_t bb_framelock_epoch(const struct bb_framelock *f)
{
	return f->epoch;
}

uint16_t bb_framelock_master(const struct bb_framelock *f)
{
	return f->master;
}

const struct bb_lock_set *bb_framelock_members(const struct bb_framelock *f)
{
	return &f->members;
}

struct bb_lock_counts bb_framelock_counts(const struct bb_framelock *f)
{
	return f->counts;
}
