/*
 * sync/framelock/nodes.h: a set of nodes by index, up to BB_LOCK_NODES_MAX: the members of an epoch, who is missing.
 * Plain value; zero is empty.
 */
#ifndef BB_SYNC_FRAMELOCK_NODES_H
#define BB_SYNC_FRAMELOCK_NODES_H

#include "hal/base.h"

#define BB_LOCK_NODES_MAX 512

struct bb_nodes {
	uint64_t bits[BB_LOCK_NODES_MAX / 64];
};

static inline bool bb_nodes_has(const struct bb_nodes *s, unsigned node)
{
	return node < BB_LOCK_NODES_MAX && (s->bits[node / 64] >> node % 64 & 1);
}

static inline void bb_nodes_put(struct bb_nodes *s, unsigned node, bool in)
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
static inline struct bb_nodes bb_nodes_first(unsigned n)
{
	struct bb_nodes s = { { 0 } };

	for (unsigned i = 0; i < n; i++)
		bb_nodes_put(&s, i, true);
	return s;
}

static inline unsigned bb_nodes_count(const struct bb_nodes *s)
{
	unsigned n = 0;

	for (unsigned i = 0; i < BB_LOCK_NODES_MAX / 64; i++)
		n += (unsigned)__builtin_popcountll(s->bits[i]);
	return n;
}

static inline bool bb_nodes_equal(const struct bb_nodes *a, const struct bb_nodes *b)
{
	for (unsigned i = 0; i < BB_LOCK_NODES_MAX / 64; i++)
		if (a->bits[i] != b->bits[i])
			return false;
	return true;
}

#endif
