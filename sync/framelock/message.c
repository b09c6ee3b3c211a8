#include "sync/framelock/message.h"

#include "hal/bytes.h"

#include <string.h>

#define HEAD 32

static size_t body_bytes(enum bb_lock_kind kind)
{
	switch (kind) {
	case BB_LOCK_ARRIVE:
	case BB_LOCK_RELEASE:
	case BB_LOCK_NUDGE:
	case BB_LOCK_ROLL:
		return 0;
	case BB_LOCK_EPOCH:
		return 8 + sizeof(struct bb_lock_set);
	case BB_LOCK_JOIN:
	case BB_LOCK_REFUSE:
		return 4 + BB_LOCK_HASH;
	case BB_LOCK_PING:
	case BB_LOCK_PONG:
		return 48;
	}
	return SIZE_MAX;
}

static void write_body(const struct bb_lock_message *m, uint8_t *at)
{
	switch (m->kind) {
	case BB_LOCK_EPOCH:
		bb_put_le(at, m->u.epoch.from, 8);
		for (size_t i = 0; i < BB_LOCK_NODES_MAX / 64; i++)
			bb_put_le(at + 8 + 8 * i, m->u.epoch.members.bits[i], 8);
		break;
	case BB_LOCK_JOIN:
	case BB_LOCK_REFUSE:
		bb_put_le(at, m->u.join.version, 4);
		memcpy(at + 4, m->u.join.hash, BB_LOCK_HASH);
		break;
	case BB_LOCK_PING:
	case BB_LOCK_PONG:
		bb_put_le(at, (uint64_t)m->u.time.t1_ns, 8);
		bb_put_le(at + 8, (uint64_t)m->u.time.t2_ns, 8);
		bb_put_le(at + 16, (uint64_t)m->u.time.t3_ns, 8);
		bb_put_le(at + 24, m->u.time.plan_frame, 8);
		bb_put_le(at + 32, (uint64_t)m->u.time.plan_ns, 8);
		bb_put_le(at + 40, (uint64_t)m->u.time.plan_every, 8);
		break;
	case BB_LOCK_ARRIVE:
	case BB_LOCK_RELEASE:
	case BB_LOCK_NUDGE:
	case BB_LOCK_ROLL:
		break;
	}
}

size_t bb_lock_write(const struct bb_lock_message *m, uint8_t *bytes)
{
	const size_t n = HEAD + body_bytes(m->kind);

	memset(bytes, 0, n);
	bytes[0] = 'L';
	bytes[1] = 'K';
	bytes[2] = (uint8_t)m->kind;
	bytes[3] = m->round;
	bb_put_le(bytes + 4, m->epoch, 4);
	bb_put_le(bytes + 8, m->frame, 8);
	bb_put_le(bytes + 16, m->master, 2);
	bb_put_le(bytes + 18, m->n_nodes, 2);
	write_body(m, bytes + HEAD);
	return n;
}

/* Frames are counted from 0 by a program that runs for years: what is beyond is no frame. */
static bool frame_possible(uint64_t frame)
{
	return frame < UINT64_C(1) << 48;
}

static bool read_epoch(const uint8_t *at, struct bb_lock_message *m)
{
	m->u.epoch.from = bb_get_le(at, 8);
	for (size_t i = 0; i < BB_LOCK_NODES_MAX / 64; i++)
		m->u.epoch.members.bits[i] = bb_get_le(at + 8 + 8 * i, 8);
	for (unsigned i = m->n_nodes; i < BB_LOCK_NODES_MAX; i++)
		if (bb_lock_set_has(&m->u.epoch.members, i))
			return false;
	return frame_possible(m->u.epoch.from) && bb_lock_set_has(&m->u.epoch.members, m->master);
}

static bool read_time(const uint8_t *at, struct bb_lock_message *m)
{
	m->u.time.t1_ns = (int64_t)bb_get_le(at, 8);
	m->u.time.t2_ns = (int64_t)bb_get_le(at + 8, 8);
	m->u.time.t3_ns = (int64_t)bb_get_le(at + 16, 8);
	m->u.time.plan_frame = bb_get_le(at + 24, 8);
	m->u.time.plan_ns = (int64_t)bb_get_le(at + 32, 8);
	m->u.time.plan_every = (int64_t)bb_get_le(at + 40, 8);
	return frame_possible(m->u.time.plan_frame) && m->u.time.plan_every >= 0 && m->u.time.plan_every <= 1000;
}

static bool read_body(const uint8_t *at, struct bb_lock_message *m)
{
	switch (m->kind) {
	case BB_LOCK_EPOCH:
		return read_epoch(at, m);
	case BB_LOCK_JOIN:
	case BB_LOCK_REFUSE:
		m->u.join.version = (uint32_t)bb_get_le(at, 4);
		memcpy(m->u.join.hash, at + 4, BB_LOCK_HASH);
		return true;
	case BB_LOCK_PING:
	case BB_LOCK_PONG:
		return read_time(at, m);
	case BB_LOCK_ARRIVE:
	case BB_LOCK_RELEASE:
	case BB_LOCK_NUDGE:
	case BB_LOCK_ROLL:
		return true;
	}
	return false;
}

bool bb_lock_read(const void *bytes, size_t n, struct bb_lock_message *m)
{
	const uint8_t *b = bytes;

	if (n < HEAD || b[0] != 'L' || b[1] != 'K' || b[2] < BB_LOCK_ARRIVE || b[2] > BB_LOCK_PONG)
		return false;
	memset(m, 0, sizeof(*m));
	m->kind = (enum bb_lock_kind)b[2];
	if (n != HEAD + body_bytes(m->kind) || bb_get_le(b + 20, 8) || bb_get_le(b + 28, 4))
		return false;
	m->round = b[3];
	m->epoch = (uint32_t)bb_get_le(b + 4, 4);
	m->frame = bb_get_le(b + 8, 8);
	m->master = (uint16_t)bb_get_le(b + 16, 2);
	m->n_nodes = (uint16_t)bb_get_le(b + 18, 2);
	return frame_possible(m->frame) && m->n_nodes <= BB_LOCK_NODES_MAX && m->master < m->n_nodes && read_body(b + HEAD, m);
}
