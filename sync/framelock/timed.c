/* sync/framelock/timed.c: the master's clock as this node knows it, and the plan of flips on it. */
#include "sync/framelock/framelock_impl.h"

#define SILENT_FRAMES 3 /* of a node that has not drawn for so long nobody hears any more */

static const struct lock_plan *plan_of(const struct bb_framelock *f, uint64_t frame)
{
	for (int i = LOCK_PLANS - 1; i >= 0; i--)
		if (f->plan[i].every && f->plan[i].frame <= frame)
			return &f->plan[i];
	return NULL;
}

bool bb_framelock_synchronised(const struct bb_framelock *f, int64_t now_ns, int64_t *uncertainty_ns)
{
	if (uncertainty_ns)
		*uncertainty_ns = 0;
	if (f->master == f->c.self)
		return true;
	if (!f->fit || f->fit->n < f->fit->window)
		return false;
	if (uncertainty_ns)
		(void)bb_clockfit_remote_ns(f->fit, now_ns, uncertainty_ns);
	return true;
}

bool lock_planned(const struct bb_framelock *f, uint64_t frame)
{
	return f->fit && plan_of(f, frame) && bb_framelock_synchronised(f, 0, NULL);
}

int64_t bb_framelock_flip_ns(const struct bb_framelock *f, uint64_t frame)
{
	const struct lock_plan *p = f->fit ? plan_of(f, frame) : NULL;

	if (!p || !bb_framelock_synchronised(f, 0, NULL))
		return BB_NEVER;
	const int64_t at_ns = p->at_ns + bb_rate_frame_ns(f->c.rate, (int64_t)(frame - p->frame) * p->every);
	return f->master == f->c.self ? at_ns : bb_clockfit_local_ns(f->fit, at_ns, NULL);
}

uint64_t bb_framelock_next(const struct bb_framelock *f, int64_t now_ns)
{
	uint64_t frame = f->frame;

	while (lock_planned(f, frame) && bb_framelock_flip_ns(f, frame) <= now_ns)
		frame++;
	return frame;
}

static void keep_plan(struct bb_framelock *f, uint64_t frame, int64_t at_ns, int64_t every)
{
	struct lock_plan *newest = &f->plan[LOCK_PLANS - 1];

	if (!every || (newest->every && frame <= newest->frame))
		return;
	f->plan[0] = *newest;
	*newest = (struct lock_plan){ frame, at_ns, every };
}

#define PLAN_FAR_NS (3600 * BB_NS_PER_S) /* from the master's clock, at the frame under way: no master plans that */
#define PLAN_FRAMES_MOST (INT64_C(1) << 36)

/* A plan comes from a wire: what it says of this frame must be near the time at which it was said. */
static bool plan_makes_sense(const struct bb_framelock *f, uint64_t frame, int64_t at_ns, int64_t every, int64_t said_ns)
{
	const int64_t ahead = (int64_t)(f->frame - frame);
	int64_t frames, flip_ns, off_ns;

	if (every <= 0 || __builtin_mul_overflow(ahead, every, &frames) || frames > PLAN_FRAMES_MOST || frames < -PLAN_FRAMES_MOST)
		return false;
	return !__builtin_add_overflow(at_ns, bb_rate_frame_ns(f->c.rate, frames), &flip_ns) &&
	       !__builtin_sub_overflow(flip_ns, said_ns, &off_ns) && off_ns < PLAN_FAR_NS && off_ns > -PLAN_FAR_NS;
}

void bb_framelock_plan(struct bb_framelock *f, uint64_t frame, int64_t at_ns, unsigned every)
{
	if (f->fit && f->master == f->c.self && frame >= f->frame)
		keep_plan(f, frame, at_ns, every);
}

void lock_time_hear(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns)
{
	const struct lock_plan *p = &f->plan[LOCK_PLANS - 1];

	if (m->kind == BB_LOCK_PING && f->master == f->c.self && f->state == BB_LOCK_IN) {
		if (m->epoch == f->epoch && m->frame)
			lock_note(f, from, m->frame - 1, now_ns);
		struct bb_lock_message answer = { .kind = BB_LOCK_PONG, .epoch = f->epoch, .frame = f->frame };
		answer.u.time.t1_ns = m->u.time.t1_ns;
		answer.u.time.t2_ns = answer.u.time.t3_ns = now_ns;
		answer.u.time.plan_frame = p->frame;
		answer.u.time.plan_ns = p->at_ns;
		answer.u.time.plan_every = p->every;
		lock_send_message(f, from, &answer);
	}
	if (m->kind != BB_LOCK_PONG || from != f->master || !f->fit)
		return;
	const struct bb_exchange x = { m->u.time.t1_ns, m->u.time.t2_ns, m->u.time.t3_ns, now_ns };
	if (bb_clockfit_add(f->fit, &x) == BB_CLOCKFIT_REFUSED)
		return;
	if (f->fit->n == f->fit->window)
		f->ping_ns = now_ns + f->c.ping_ns;
	if (plan_makes_sense(f, m->u.time.plan_frame, m->u.time.plan_ns, m->u.time.plan_every, m->u.time.t3_ns))
		keep_plan(f, m->u.time.plan_frame, m->u.time.plan_ns, m->u.time.plan_every);
	if (f->c.master_ns != BB_NEVER)
		f->master_ns = now_ns + f->c.master_ns;
}

/* The master, at a planned flip: nobody waits, but a node that draws no more must not count for ever. */
static void drop_silent(struct bb_framelock *f, int64_t now_ns)
{
	struct bb_lock_set with = f->members;

	if (f->master != f->c.self || f->frame < f->epoch_from + SILENT_FRAMES)
		return;
	for (unsigned i = 1; i < f->n_members; i++)
		if (f->came[f->order[i]] + SILENT_FRAMES <= f->frame)
			bb_lock_set_put(&with, f->order[i], false);
	if (!bb_lock_set_equal(&with, &f->members))
		lock_go_on(f, &with, f->frame, now_ns);
}

static int64_t flip_due_ns(const struct bb_framelock *f)
{
	if (f->state != BB_LOCK_IN || !f->ready || !lock_planned(f, f->frame))
		return BB_NEVER;
	const int64_t flip_ns = bb_framelock_flip_ns(f, f->frame);
	return flip_ns > f->ready_ns ? flip_ns : f->ready_ns;
}

static int64_t tell_again_ns(const struct bb_framelock *f)
{
	return flip_due_ns(f) == BB_NEVER || f->master == f->c.self ? BB_NEVER : f->sent_ns + 2 * f->c.retry_ns;
}

/* Without word from the master its plan is worth nothing: a barrier again, which finds another master. */
static bool master_silent(const struct bb_framelock *f, int64_t now_ns)
{
	return f->master != f->c.self && f->plan[LOCK_PLANS - 1].every && f->state == BB_LOCK_IN && now_ns >= f->master_ns;
}

void lock_time_step(struct bb_framelock *f, int64_t now_ns)
{
	/* Spread out, or the answers would queue at the master, which looks like a shorter way there than back. */
	if (f->ping_ns == INT64_MIN)
		f->ping_ns = now_ns + f->c.retry_ns * f->c.self / f->c.n_nodes;
	if (f->master != f->c.self && now_ns >= f->ping_ns) {
		struct bb_lock_message m = { .kind = BB_LOCK_PING, .epoch = f->epoch, .frame = f->frame };
		m.u.time.t1_ns = now_ns;
		f->ping_ns = now_ns + f->c.retry_ns; /* without an answer; the first window is filled as quickly */
		lock_send_message(f, f->master, &m);
	}
	/* Nobody waits for it, but who has drawn nothing for long is dropped: twice a lost message may be enough. */
	if (now_ns >= tell_again_ns(f)) {
		f->sent_ns = now_ns;
		lock_send(f, f->master, BB_LOCK_ARRIVE, f->frame, 0);
	}
	if (master_silent(f, now_ns))
		f->plan[0] = f->plan[1] = (struct lock_plan){ 0 };
	if (now_ns < flip_due_ns(f))
		return;
	lock_release(f, f->frame, now_ns);
	drop_silent(f, now_ns);
}

int64_t lock_time_wake(const struct bb_framelock *f)
{
	const int64_t ping_ns = f->master == f->c.self ? BB_NEVER : f->ping_ns, flip_ns = flip_due_ns(f);
	const int64_t again_ns = tell_again_ns(f), soon_ns = ping_ns < flip_ns ? ping_ns : flip_ns;

	return again_ns < soon_ns ? again_ns : soon_ns;
}
