/*
 * sync/framelock/set.h: a set of nodes by index, up to BB_LOCK_NODES_MAX: the members of an epoch, who is missing.
 * Plain value; zero is empty.
 */
#ifndef BB_SYNC_FRAMELOCK_SET_H
#define BB_SYNC_FRAMELOCK_SET_H

#include "hal/base.h"

#define BB_LOCK_NODES_MAX 512

struct bb_lock_set {
	uint64_t bits[BB_LOCK_NODES_MAX / 64];
};

static inline bool bb_lock_set_has(const struct bb_lock_set *s, unsigned node)
{
	return node < BB_LOCK_NODES_MAX && (s->bits[node / 64] >> node % 64 & 1);
}

static inline void bb_lock_set_put(struct bb_lock_set *s, unsigned node, bool in)
{
	const uint64_t bit = UINT64_C(1) << node % 64;

	if (node >= BB_LOCK_NODES_MAX)
		return;
	if (in)
		s->bits[node / 64] |= bit;
	else
		s->bits[node / 64] &= ~bit;
}

/* Nodes 0 to n - 1. */
static inline struct bb_lock_set bb_lock_set_first(unsigned n)
{
	struct bb_lock_set s = { { 0 } };

	for (unsigned i = 0; i < n; i++)
		bb_lock_set_put(&s, i, true);
	return s;
}

static inline unsigned bb_lock_set_count(const struct bb_lock_set *s)
{
	unsigned n = 0;

	for (unsigned i = 0; i < BB_LOCK_NODES_MAX / 64; i++)
		n += (unsigned)__builtin_popcountll(s->bits[i]);
	return n;
}

static inline bool bb_lock_set_equal(const struct bb_lock_set *a, const struct bb_lock_set *b)
{
	for (unsigned i = 0; i < BB_LOCK_NODES_MAX / 64; i++)
		if (a->bits[i] != b->bits[i])
			return false;
	return true;
}

#endif
