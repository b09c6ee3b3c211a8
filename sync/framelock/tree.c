/* sync/framelock/tree.c: members by rank are a heap with LOCK_RADIX children each; arrivals go up, releases down. */
#include "sync/framelock/framelock_impl.h"

static unsigned child_rank(const struct bb_framelock *f, unsigned child)
{
	return LOCK_RADIX * (unsigned)f->rank + 1 + child;
}

static uint16_t parent(const struct bb_framelock *f)
{
	return f->order[(f->rank - 1u) / LOCK_RADIX];
}

static void up(struct bb_framelock *f, int64_t now_ns)
{
	if (!f->ready || f->told)
		return;
	for (unsigned i = 0; i < LOCK_RADIX && child_rank(f, i) < f->n_members; i++)
		if (f->signal[i] <= f->frame)
			return;
	f->told = true;
	if (f->rank)
		lock_send(f, parent(f), BB_LOCK_ARRIVE, f->frame, 0);
	else
		lock_release(f, f->frame, now_ns);
}

static void hear(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns)
{
	if (m->frame < f->frame) {
		lock_send(f, from, BB_LOCK_RELEASE, f->frame - 1, 0);
		return;
	}
	for (unsigned i = 0; i < LOCK_RADIX && child_rank(f, i) < f->n_members; i++)
		if (f->order[child_rank(f, i)] == from && f->signal[i] <= m->frame)
			f->signal[i] = m->frame + 1;
	up(f, now_ns);
}

static void retry(struct bb_framelock *f)
{
	if (f->told && f->rank)
		lock_send(f, parent(f), BB_LOCK_ARRIVE, f->frame, 1);
}

static void passed(struct bb_framelock *f)
{
	for (unsigned i = 0; i < LOCK_RADIX && child_rank(f, i) < f->n_members; i++)
		lock_send(f, f->order[child_rank(f, i)], BB_LOCK_RELEASE, f->frame - 1, 0);
}

const struct bb_lock_ops bb_lock_tree = { up, hear, retry, passed };
