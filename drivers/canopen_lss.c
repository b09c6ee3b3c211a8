/* drivers/canopen_lss.c: see drivers/canopen_lss.h. */
#include "drivers/canopen_lss.h"

#include <string.h>

void bb_co_lss_init(struct bb_co_lss_master *m, int64_t wait_ns)
{
	memset(m, 0, sizeof(*m));
	m->wait_ns = wait_ns;
	m->status = BB_SKIPPED;
}

static void put(struct bb_co_lss_master *m, enum bb_co_lss_state state, int64_t now_ns)
{
	m->state = state;
	m->heard = false;
	m->has_frame = true;
	m->deadline_ns = now_ns + m->wait_ns;
}

/* "Is your bit zero, and all above it as I say?" Silence means one. */
static void ask_bit(struct bb_co_lss_master *m, int64_t now_ns)
{
	bb_co_lss_fastscan(&m->frame, m->id[m->sub], m->bit, m->sub, m->sub);
	put(m, BB_CO_LSS_BIT, now_ns);
}

static void confirm(struct bb_co_lss_master *m, int64_t now_ns)
{
	bb_co_lss_fastscan(&m->frame, m->id[m->sub], 0, m->sub, (uint8_t)((m->sub + 1) % 4));
	put(m, BB_CO_LSS_CONFIRM, now_ns);
}

static void finish(struct bb_co_lss_master *m, enum bb_status status)
{
	m->state = BB_CO_LSS_IDLE;
	m->status = status;
}

void bb_co_lss_start(struct bb_co_lss_master *m, uint8_t node, int64_t now_ns)
{
	memset(m->id, 0, sizeof(m->id));
	m->node = node;
	m->sub = 0;
	m->bit = 31;
	m->status = BB_TIMEOUT;
	bb_co_lss_fastscan(&m->frame, 0, CO_LSS_RESET_SCAN, 0, 0);
	put(m, BB_CO_LSS_ANYONE, now_ns);
}

/* The node in configuration state goes back to waiting: with a new id it boots. */
static void leave(struct bb_co_lss_master *m, enum bb_status status, int64_t now_ns)
{
	bb_co_lss(&m->frame, CO_LSS_SWITCH, 0);
	put(m, BB_CO_LSS_LEAVE, now_ns);
	m->status = status;
}

static void confirmed(struct bb_co_lss_master *m, int64_t now_ns)
{
	if (m->sub < 3) {
		m->sub++;
		m->bit = 31;
		ask_bit(m, now_ns);
		return;
	}
	bb_co_lss(&m->frame, CO_LSS_SET_NODE, m->node);
	put(m, BB_CO_LSS_ASSIGN, now_ns);
}

void bb_co_lss_receive(struct bb_co_lss_master *m, const struct bb_can_frame *f, int64_t now_ns)
{
	struct bb_co_lss_reply r;

	if (bb_co_read_lss(f, &r) != BB_OK)
		return;
	switch (m->state) {
	case BB_CO_LSS_ANYONE:
	case BB_CO_LSS_BIT:
	case BB_CO_LSS_CONFIRM:
		m->heard |= r.command == CO_LSS_FOUND;
		break;
	case BB_CO_LSS_ASSIGN:
		if (r.command != CO_LSS_SET_NODE)
			return;
		if (r.error) {
			leave(m, BB_ERR_REFUSED, now_ns);
			return;
		}
		bb_co_lss(&m->frame, CO_LSS_STORE, 0);
		put(m, BB_CO_LSS_STORE, now_ns);
		return;
	case BB_CO_LSS_STORE: /* a node that cannot store keeps the id until it is switched off: good enough */
		if (r.command == CO_LSS_STORE)
			leave(m, BB_TIMEOUT, now_ns);
		return;
	default:
		return;
	}
}

/* Several may answer one question, so an answer is weighed when its time is over. */
void bb_co_lss_poll(struct bb_co_lss_master *m, int64_t now_ns)
{
	if (m->state == BB_CO_LSS_IDLE || now_ns < m->deadline_ns)
		return;
	switch (m->state) {
	case BB_CO_LSS_ANYONE:
		if (m->heard)
			ask_bit(m, now_ns);
		else
			finish(m, BB_SKIPPED);
		return;
	case BB_CO_LSS_BIT:
		if (!m->heard)
			m->id[m->sub] |= UINT32_C(1) << m->bit;
		if (m->bit) {
			m->bit--;
			ask_bit(m, now_ns);
		} else
			confirm(m, now_ns);
		return;
	case BB_CO_LSS_CONFIRM:
		if (m->heard)
			confirmed(m, now_ns);
		else
			finish(m, BB_ERR_LOST);
		return;
	case BB_CO_LSS_LEAVE:
		finish(m, m->status == BB_TIMEOUT ? BB_OK : m->status);
		return;
	default:
		leave(m, BB_ERR_LOST, now_ns);
		return;
	}
}

bool bb_co_lss_take(struct bb_co_lss_master *m, struct bb_can_frame *out)
{
	if (!m->has_frame)
		return false;
	*out = m->frame;
	m->has_frame = false;
	return true;
}
