/*
 * render/stream/slots.c: which brick is in which slot, and which slot has been of no use for longest. A slot's own memory
 * is not touched here.
 */
#include "render/stream/stream_private.h"

#include <string.h>

static uint32_t home_of(const struct bb_slots *s, uint64_t brick)
{
	return (uint32_t)((brick * UINT64_C(0x9E3779B97F4A7C15)) >> 32) & (s->n_hash - 1);
}

uint32_t bb_slots_find(const struct bb_slots *s, uint64_t brick)
{
	for (uint32_t i = home_of(s, brick); s->hash[i]; i = (i + 1) & (s->n_hash - 1))
		if (s->slot[s->hash[i] - 1].brick == brick)
			return s->hash[i] - 1;
	return BB_NO_SLOT;
}

static void enter(struct bb_slots *s, uint64_t brick, uint32_t slot)
{
	uint32_t i = home_of(s, brick);

	while (s->hash[i])
		i = (i + 1) & (s->n_hash - 1);
	s->hash[i] = slot + 1;
}

/* Whoever stands behind the gap and may stand in it moves up (Knuth 6.4, algorithm R). */
static void leave(struct bb_slots *s, uint64_t brick)
{
	const uint32_t mask = s->n_hash - 1;
	uint32_t gap = home_of(s, brick);

	while (s->slot[s->hash[gap] - 1].brick != brick)
		gap = (gap + 1) & mask;
	for (uint32_t i = (gap + 1) & mask; s->hash[i]; i = (i + 1) & mask) {
		const uint32_t home = home_of(s, s->slot[s->hash[i] - 1].brick);
		if (((i - home) & mask) < ((i - gap) & mask))
			continue;
		s->hash[gap] = s->hash[i];
		gap = i;
	}
	s->hash[gap] = 0;
}

static void unlink_slot(struct bb_slots *s, uint32_t i)
{
	const struct bb_slot *slot = &s->slot[i];

	if (slot->older == BB_NO_SLOT)
		s->oldest = slot->newer;
	else
		s->slot[slot->older].newer = slot->newer;
	if (slot->newer == BB_NO_SLOT)
		s->newest = slot->older;
	else
		s->slot[slot->newer].older = slot->older;
}

static void append_slot(struct bb_slots *s, uint32_t i)
{
	s->slot[i].older = s->newest;
	s->slot[i].newer = BB_NO_SLOT;
	if (s->newest == BB_NO_SLOT)
		s->oldest = i;
	else
		s->slot[s->newest].newer = i;
	s->newest = i;
}

static void prepend_slot(struct bb_slots *s, uint32_t i)
{
	s->slot[i].newer = s->oldest;
	s->slot[i].older = BB_NO_SLOT;
	if (s->oldest == BB_NO_SLOT)
		s->newest = i;
	else
		s->slot[s->oldest].older = i;
	s->oldest = i;
}

void bb_slots_touch(struct bb_slots *s, uint32_t i)
{
	if (s->slot[i].used_frame == s->frame)
		return;
	s->slot[i].used_frame = s->frame;
	unlink_slot(s, i);
	append_slot(s, i);
}

uint32_t bb_slots_reserve(struct bb_slots *s, uint64_t brick, bool *evicted)
{
	uint32_t i = s->oldest;

	while (i != BB_NO_SLOT && s->slot[i].pending)
		i = s->slot[i].newer;
	if (i == BB_NO_SLOT || s->slot[i].used_frame >= s->frame)
		return BB_NO_SLOT;
	*evicted = s->slot[i].brick != BB_NO_BRICK;
	if (*evicted)
		leave(s, s->slot[i].brick);
	s->slot[i].brick = brick;
	s->slot[i].pending = true;
	s->n_pending++;
	enter(s, brick, i);
	bb_slots_touch(s, i);
	return i;
}

void bb_slots_commit(struct bb_slots *s, uint32_t i, bool failed)
{
	s->slot[i].pending = false;
	s->n_pending--;
	if (!failed)
		return;
	leave(s, s->slot[i].brick);
	s->slot[i].brick = BB_NO_BRICK;
	s->slot[i].used_frame = 0;
	unlink_slot(s, i);
	prepend_slot(s, i);
}

void bb_slots_clear(struct bb_slots *s)
{
	memset(s->hash, 0, s->n_hash * sizeof(*s->hash));
	s->oldest = s->newest = BB_NO_SLOT;
	s->n_pending = 0;
	s->frame = 1;
	for (uint32_t i = 0; i < s->n; i++) {
		s->slot[i] = (struct bb_slot){ .brick = BB_NO_BRICK };
		append_slot(s, i);
	}
}
