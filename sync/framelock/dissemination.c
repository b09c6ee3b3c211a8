/*
 * sync/framelock/dissemination.c: in round k every member signals the one 2^k ranks further on and waits for the one 2^k
 * ranks back; after ceil(log2 n) rounds each has heard of all, directly or through others.
 */
#include "sync/framelock/framelock_impl.h"

static unsigned rounds(const struct bb_framelock *f)
{
	unsigned k = 0;

	while (1u << k < f->n_members)
		k++;
	return k;
}

static uint16_t at_distance(const struct bb_framelock *f, unsigned ahead)
{
	return f->order[(f->rank + ahead) % f->n_members];
}

static void signal_round(struct bb_framelock *f, uint64_t frame, unsigned k)
{
	lock_send(f, at_distance(f, 1u << k), BB_LOCK_ARRIVE, frame, k);
}

static void advance(struct bb_framelock *f, int64_t now_ns)
{
	const unsigned all = rounds(f);

	while (f->round < all && f->signal[f->round] > f->frame)
		if (++f->round < all)
			signal_round(f, f->frame, f->round);
	if (f->round == all)
		lock_release(f, f->frame, now_ns);
}

static void arrive(struct bb_framelock *f, int64_t now_ns)
{
	if (rounds(f))
		signal_round(f, f->frame, 0);
	advance(f, now_ns);
}

static void hear(struct bb_framelock *f, uint16_t from, const struct bb_lock_message *m, int64_t now_ns)
{
	if (m->round >= rounds(f))
		return;
	if (m->kind == BB_LOCK_NUDGE) {
		if (m->frame < f->frame || (m->frame == f->frame && f->ready && f->round >= m->round))
			signal_round(f, m->frame, m->round);
		return;
	}
	if (from != at_distance(f, f->n_members - (1u << m->round)) || f->signal[m->round] > m->frame)
		return;
	f->signal[m->round] = m->frame + 1;
	if (f->ready)
		advance(f, now_ns);
}

static void retry(struct bb_framelock *f)
{
	lock_send(f, at_distance(f, f->n_members - (1u << f->round)), BB_LOCK_NUDGE, f->frame, f->round);
}

static void passed(struct bb_framelock *f)
{
	(void)f; /* everybody finds out by itself */
}

const struct bb_lock_ops bb_lock_dissemination = { arrive, hear, retry, passed };
