/* sync/framelock/central.c: everybody tells the master that it has drawn; the master tells everybody when all have. */
#include "sync/framelock/framelock_impl.h"

static void complete(struct bb_framelock *f, int64_t now_ns)
{
	if (f->master == f->c.self && f->n_came == f->n_members && !lock_planned(f, f->frame))
		lock_release(f, f->frame, now_ns);
}

static void arrive(struct bb_framelock *f, int64_t now_ns)
{
	if (f->master != f->c.self)
		lock_send(f, f->master, BB_LOCK_ARRIVE, f->frame, 0);
	else
		complete(f, now_ns);
}

static void hear(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns)
{
	/* On a plan a node tells once, for the master to know; who asks again (round 1) has no plan and waits. */
	if (m->frame < f->frame && (m->round || !lock_planned(f, m->frame)))
		lock_send(f, from, BB_LOCK_RELEASE, f->frame - 1, 0);
	else
		complete(f, now_ns);
}

static void retry(struct bb_framelock *f)
{
	if (f->master != f->c.self)
		lock_send(f, f->master, BB_LOCK_ARRIVE, f->frame, 1);
}

static void passed(struct bb_framelock *f)
{
	for (uint16_t i = 1; f->master == f->c.self && i < f->n_members; i++)
		lock_send(f, f->order[i], BB_LOCK_RELEASE, f->frame - 1, 0);
}

const struct bb_lock_ops bb_lock_central = { arrive, hear, retry, passed };
