/* sync/framelock/epoch.c: who takes part: roll call, those who are dropped or join, another master. */
#include "sync/framelock/framelock_impl.h"

#include <string.h>

#define BEACON 8 /* times a stall */

/* The master, or after it was given up the next in the epoch's order. */
uint16_t lock_roll_master(const struct bb_framelock *f)
{
	return f->attempt ? f->order[f->attempt % f->n_members] : f->master;
}

/* ---- telling ---- */

/* Frames below `frame` are released. */
static void send_epoch(struct bb_framelock *f, uint16_t to, uint32_t epoch, uint64_t frame, uint64_t from,
                       const struct bb_lock_set *members)
{
	struct bb_lock_message m = { .kind = BB_LOCK_EPOCH, .epoch = epoch, .frame = frame,
		                     .u.epoch = { .from = from, .members = *members } };

	lock_send_message(f, to, &m);
}

void lock_send_epoch(struct bb_framelock *f, uint16_t to)
{
	send_epoch(f, to, f->epoch, f->frame, f->epoch_from, &f->members);
	if (f->next.any)
		send_epoch(f, to, f->next.epoch, f->frame, f->next.from, &f->next.members);
}

static void send_join(struct bb_framelock *f, uint16_t to, enum bb_lock_kind kind, bool early)
{
	struct bb_lock_message m = { .kind = kind, .round = early, .epoch = f->epoch, .frame = f->frame };

	m.u.join.version = f->c.version;
	memcpy(m.u.join.hash, f->c.hash, sizeof(m.u.join.hash));
	lock_send_message(f, to, &m);
}

/* ---- epochs that begin ---- */

static void take_master(struct bb_framelock *f, uint16_t master)
{
	if (master != f->master && f->fit) { /* another clock, other plans */
		bb_clockfit_init(f->fit, f->c.window);
		memset(f->plan, 0, sizeof(f->plan));
		f->ping_ns = INT64_MIN;
	}
	f->master = f->join_to = master;
}

static void begin(struct bb_framelock *f, uint32_t epoch, uint16_t master, const struct bb_lock_set *members, int64_t now_ns)
{
	f->epoch = epoch;
	take_master(f, master);
	f->members = *members;
	f->state = bb_lock_set_has(members, f->c.self) ? BB_LOCK_IN : BB_LOCK_OUT;
	f->join_ns = f->beacon_ns = now_ns;
	if (f->c.master_ns != BB_NEVER)
		f->master_ns = now_ns + f->c.master_ns;
	if (f->next.any && f->next.epoch <= epoch)
		f->next.any = false;
	lock_begin_epoch(f, now_ns);
}

void lock_epoch_due(struct bb_framelock *f, int64_t now_ns)
{
	if (!f->next.any || f->frame < f->next.from)
		return;
	const struct bb_lock_set members = f->next.members;
	begin(f, f->next.epoch, f->next.master, &members, now_ns);
}

/* Goes on as master with the members of `with`; frames below `from` are released. */
static void drop(struct bb_framelock *f, const struct bb_lock_set *with, uint64_t from, int64_t now_ns)
{
	const uint32_t epoch = (f->next.any ? f->next.epoch : f->epoch) + 1;
	struct bb_lock_set missing = { { 0 } };

	take_master(f, f->c.self);
	for (uint16_t i = 0; i < f->c.n_nodes; i++) {
		const bool is_in = bb_lock_set_has(&f->members, i);
		bb_lock_set_put(&missing, i, is_in && !bb_lock_set_has(with, i));
		if (i != f->c.self && (is_in || (f->next.any && bb_lock_set_has(&f->next.members, i))))
			send_epoch(f, i, epoch, from, from, with);
	}
	f->next.any = false;
	for (size_t i = 0; i < BB_ARRAY_LEN(missing.bits); i++)
		f->missing.bits[i] |= missing.bits[i]; /* told with the next release */
	if (from > f->frame)
		lock_move_on(f, from - 1, now_ns, NULL);
	begin(f, epoch, f->c.self, with, now_ns);
}

/* Two sides may have counted on alone: of equal numbers the lower master's counts. */
static bool supersedes(const struct bb_lock_message *m, const struct bb_framelock *f)
{
	if (m->epoch != f->epoch || m->master == f->master)
		return m->epoch > f->epoch;
	return f->state != BB_LOCK_IN || m->master < f->master;
}

void lock_hear_epoch(struct bb_framelock *f, const struct bb_lock_message *m, int64_t now_ns)
{
	const bool was_in = f->state == BB_LOCK_IN, is_in = bb_lock_set_has(&m->u.epoch.members, f->c.self);

	if (!supersedes(m, f))
		return;
	if (was_in && m->frame > f->frame && !lock_planned(f, f->frame))
		lock_release(f, m->frame - 1, now_ns);
	if (!supersedes(m, f) || (f->next.any && m->epoch == f->next.epoch && m->master == f->next.master))
		return;
	if (was_in && is_in && m->u.epoch.from > f->frame) {
		f->next.any = true;
		f->next.epoch = m->epoch;
		f->next.master = m->master;
		f->next.from = m->u.epoch.from;
		f->next.members = m->u.epoch.members;
		return;
	}
	if (!was_in || !is_in) {
		const uint64_t first = m->u.epoch.from > m->frame ? m->u.epoch.from : m->frame;
		f->frame = is_in ? first : m->frame;
		f->ready = false;
	}
	begin(f, m->epoch, m->master, &m->u.epoch.members, now_ns);
}

/* ---- roll call ---- */

/* More than half of the epoch may go on, or half of it with the master; a master that nobody can follow always. */
static bool majority(const struct bb_framelock *f, const struct bb_lock_set *with)
{
	const unsigned n = 2 * bb_lock_set_count(with);

	if (f->c.master_ns == BB_NEVER && f->master == f->c.self)
		return true;

	return n > f->n_members || (n == f->n_members && bb_lock_set_has(with, f->master));
}

static void freeze(struct bb_framelock *f, int64_t now_ns)
{
	f->state = BB_LOCK_FROZEN;
	f->join_ns = now_ns;
	f->next.any = false;
	f->wanted = (struct bb_lock_set){ { 0 } };
}

void lock_go_on(struct bb_framelock *f, const struct bb_lock_set *with, uint64_t from, int64_t now_ns)
{
	if (majority(f, with))
		drop(f, with, from, now_ns);
	else
		freeze(f, now_ns);
}

/* Everybody who is there has drawn the frame: release it, without those who have not come. */
static void settle(struct bb_framelock *f, int64_t now_ns)
{
	struct bb_lock_set with = { { 0 } }, late = { { 0 } };

	bb_lock_set_put(&with, f->c.self, true);
	bb_lock_set_put(&late, f->c.self, !f->ready);
	for (unsigned i = 0; i < f->n_members; i++)
		if (f->came[f->order[i]] > f->frame)
			bb_lock_set_put(&with, f->order[i], true);
	if (!bb_lock_set_equal(&with, &f->members) || f->master != f->c.self) {
		lock_go_on(f, &with, f->frame + 1, now_ns);
		return;
	}
	for (unsigned i = 1; i < f->n_members; i++)
		lock_send(f, f->order[i], BB_LOCK_RELEASE, f->frame, 0);
	lock_move_on(f, f->frame, now_ns, &late);
	lock_epoch_due(f, now_ns);
	lock_admit(f);
}

/* The node that keeps the roll: the master knows whom it waits for; its successor waits for reports, a frame long. */
static int64_t patience_ns(const struct bb_framelock *f)
{
	return f->attempt ? f->c.stall_ns : f->c.give_up_ns;
}

static bool keeps_roll(const struct bb_framelock *f)
{
	return f->state == BB_LOCK_IN && lock_roll_master(f) == f->c.self && f->opened_ns != BB_NEVER &&
	       !lock_planned(f, f->frame);
}

static void next_master(struct bb_framelock *f, int64_t now_ns)
{
	f->counts.stalls++;
	if (++f->attempt >= f->n_members) {
		freeze(f, now_ns);
		return;
	}
	f->master_ns = now_ns + 2 * f->c.give_up_ns;
	lock_recount(f);
	f->opened_ns = now_ns;
}

static void report(struct bb_framelock *f, int64_t now_ns)
{
	f->counts.stalls += f->rolled_ns == f->ready_ns;
	f->rolled_ns = now_ns;
	lock_send(f, lock_roll_master(f), BB_LOCK_ROLL, f->frame, 0);
}

/* When a node that waits reports; the central barrier's arrivals are reports to the master by themselves. */
static int64_t report_ns(const struct bb_framelock *f)
{
	if (!lock_waits(f) || lock_roll_master(f) == f->c.self || (!f->attempt && f->ops == &bb_lock_central))
		return BB_NEVER;
	const int64_t stalled_ns = f->ready_ns + f->c.stall_ns, again_ns = f->rolled_ns + f->c.retry_ns;
	return stalled_ns > again_ns ? stalled_ns : again_ns;
}

static int64_t give_up_master_ns(const struct bb_framelock *f)
{
	return lock_waits(f) && f->master != f->c.self ? f->master_ns : BB_NEVER;
}

/* A joiner of a timed lock first learns the time; until then it only asks who the master is. */
static void ask_to_join(struct bb_framelock *f, int64_t now_ns)
{
	const bool early = f->fit && f->state == BB_LOCK_OUT && !bb_framelock_synchronised(f, now_ns, NULL);

	if (now_ns < f->join_ns)
		return;
	f->join_ns = now_ns + (early ? f->c.stall_ns : 2 * f->c.retry_ns);
	if (f->join_to != f->c.self)
		send_join(f, f->join_to, BB_LOCK_JOIN, early);
	/* Whoever is a member knows who is the master by now: every second time another is asked. */
	f->join_to = f->join_to == f->master ? (uint16_t)(f->counts.joins++ % f->c.n_nodes) : f->master;
}

static bool outside(const struct bb_framelock *f)
{
	return f->state == BB_LOCK_OUT || f->state == BB_LOCK_FROZEN;
}

/* The master tells those who do not take part that there is an epoch: they, too, may think that they are one. */
static int64_t beacon_ns(const struct bb_framelock *f)
{
	return f->state == BB_LOCK_IN && f->master == f->c.self && f->n_members < f->c.n_nodes ? f->beacon_ns : BB_NEVER;
}

static void beacon(struct bb_framelock *f, int64_t now_ns)
{
	f->beacon_ns = now_ns + BEACON * f->c.stall_ns;
	for (uint16_t i = 0; i < f->c.n_nodes; i++)
		if (!bb_lock_set_has(&f->members, i))
			lock_send_epoch(f, i);
}

void lock_roll_step(struct bb_framelock *f, int64_t now_ns)
{
	if (outside(f))
		ask_to_join(f, now_ns);
	if (now_ns >= beacon_ns(f))
		beacon(f, now_ns);
	if (now_ns >= report_ns(f))
		report(f, now_ns);
	if (now_ns >= give_up_master_ns(f))
		next_master(f, now_ns);
	if (!keeps_roll(f))
		return;
	const bool all = f->n_came == f->n_members && f->ops != &bb_lock_central;
	if (all || now_ns - f->opened_ns >= patience_ns(f))
		settle(f, now_ns);
}

int64_t lock_roll_wake(const struct bb_framelock *f)
{
	int64_t wake_ns = outside(f) ? f->join_ns : BB_NEVER;
	const int64_t due_ns[] = { report_ns(f), give_up_master_ns(f), beacon_ns(f),
		                   keeps_roll(f) ? f->opened_ns + patience_ns(f) : BB_NEVER };

	for (size_t i = 0; i < BB_ARRAY_LEN(due_ns); i++)
		wake_ns = due_ns[i] < wake_ns ? due_ns[i] : wake_ns;
	return wake_ns;
}

/* ---- joining ---- */

void lock_admit(struct bb_framelock *f)
{
	const uint64_t from = f->frame + LOCK_JOIN_AHEAD;

	if (f->master != f->c.self || f->state != BB_LOCK_IN || f->next.any || !bb_lock_set_count(&f->wanted))
		return;
	f->next.any = true;
	f->next.epoch = f->epoch + 1;
	f->next.master = f->c.self;
	f->next.from = from;
	f->next.members = f->members;
	for (size_t i = 0; i < BB_ARRAY_LEN(f->wanted.bits); i++)
		f->next.members.bits[i] |= f->wanted.bits[i];
	f->wanted = (struct bb_lock_set){ { 0 } };
	for (uint16_t i = 0; i < f->c.n_nodes; i++)
		if (i != f->c.self && bb_lock_set_has(&f->next.members, i))
			send_epoch(f, i, f->next.epoch, f->frame, from, &f->next.members);
}

/* The master of a side too small to go on: once enough are back, it is large enough. */
static void gather(struct bb_framelock *f, uint16_t from, uint64_t frame, int64_t now_ns)
{
	if (f->master != f->c.self || !bb_lock_set_has(&f->members, from))
		return;
	bb_lock_set_put(&f->wanted, from, true);
	f->frame = frame > f->frame ? frame : f->frame;
	struct bb_lock_set with = f->wanted;
	bb_lock_set_put(&with, f->c.self, true);
	if (!majority(f, &with))
		return;
	f->state = BB_LOCK_IN;
	f->ready = false;
	f->wanted = (struct bb_lock_set){ { 0 } };
	drop(f, &with, f->frame + 1, now_ns);
}

void lock_hear_join(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns)
{
	if (m->u.join.version != f->c.version || memcmp(m->u.join.hash, f->c.hash, sizeof(f->c.hash))) {
		f->counts.refused++;
		send_join(f, from, BB_LOCK_REFUSE, false);
		return;
	}
	if (f->state == BB_LOCK_FROZEN)
		gather(f, from, m->frame, now_ns);
	if (f->state != BB_LOCK_IN)
		return;
	/* A member that asks has started anew: told of the epoch it draws with the others again. */
	if (m->round || f->master != f->c.self || bb_lock_set_has(&f->members, from) ||
	    (f->next.any && bb_lock_set_has(&f->next.members, from)))
		lock_send_epoch(f, from);
	else
		bb_lock_set_put(&f->wanted, from, true);
}

/* Only who is outside may be told to stay there. */
void lock_hear_refuse(struct bb_framelock *f, const struct bb_lock_message *m)
{
	const bool same = m->u.join.version == f->c.version && !memcmp(m->u.join.hash, f->c.hash, sizeof(f->c.hash));

	if (f->state == BB_LOCK_OUT && !same)
		f->state = BB_LOCK_REFUSED;
}
