/*
 * drivers/shutter_can_bus.c: the host's own place on the bus: error frames, bus-off with back-off, a link that is down.
 * After bus-off nothing is sent until the controller is back; the shutters hold what they were told.
 */
#include "drivers/shutter_can_impl.h"

#define BACK_OFF_NS (100 * SC_MS)
#define BACK_OFF_MOST_NS (5 * BB_NS_PER_S)
#define MINUTE_NS (60 * BB_NS_PER_S)

static uint64_t draw(struct shutter_can *s)
{
	uint64_t z = s->random += UINT64_C(0x9e3779b97f4a7c15);

	z = (z ^ z >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
	z = (z ^ z >> 27) * UINT64_C(0x94d049bb133111eb);
	return z ^ z >> 31;
}

/* 100 ms doubled per try, +-20 % so that several hosts on one bus do not come back together. */
static int64_t back_off_ns(struct shutter_can *s)
{
	int64_t wait_ns = BACK_OFF_NS << (s->tries < 6 ? s->tries : 6);

	if (wait_ns > BACK_OFF_MOST_NS)
		wait_ns = BACK_OFF_MOST_NS;
	return wait_ns * 4 / 5 + (int64_t)(draw(s) % (uint64_t)(wait_ns * 2 / 5 + 1));
}

static int restarts_since(const struct shutter_can *s, int64_t from_ns)
{
	int n = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(s->restarts_ns); i++)
		n += s->restarts_ns[i] >= from_ns;
	return n;
}

static void go_off(struct shutter_can *s, int64_t now_ns)
{
	if (s->off)
		return;
	s->off = true;
	if (now_ns - s->back_ns > MINUTE_NS)
		s->tries = 0;
	s->restart_ns = now_ns + back_off_ns(s);
	sc_raise(s, BB_CANF_BUS_OFF, s->tx_errors, now_ns, "tec %u rec %u, try again in %lld ms", s->tx_errors,
	         s->rx_errors, (long long)((s->restart_ns - now_ns) / SC_MS));
}

/* What was not heard while away is nobody's fault. */
static void forgive(struct shutter_can *s, int64_t now_ns)
{
	for (size_t i = 0; i < s->n_nodes; i++)
		s->node[i].beat_ns = now_ns;
}

static void come_back(struct shutter_can *s, int64_t now_ns)
{
	if (!s->off)
		return;
	s->off = false;
	s->back_ns = now_ns;
	s->restart_ns = BB_NEVER;
	forgive(s, now_ns);
	sc_clear(s, BB_CANF_BUS_OFF, now_ns);
	sc_clear(s, BB_CANF_BUS_ERROR, now_ns);
}

void sc_error_frame(struct shutter_can *s, const struct bb_can_frame *f, int64_t now_ns)
{
	const uint32_t class = f->id;

	if (f->n_bytes != 8)
		return;
	if (class & (CAN_CLASS_COUNTERS | CAN_CLASS_CONTROLLER)) {
		s->tx_errors = f->bytes[6];
		s->rx_errors = f->bytes[7];
	}
	if (class & CAN_CLASS_RESTARTED)
		come_back(s, now_ns);
	if (class & CAN_CLASS_BUS_OFF)
		go_off(s, now_ns);
	if (!(class & CAN_CLASS_CONTROLLER))
		return;
	if (f->bytes[1] & CAN_STATE_RX_OVERFLOW)
		sc_raise(s, BB_CANF_BUS_ERROR, f->bytes[1], now_ns, "receive overflow");
	if (f->bytes[1] & (CAN_STATE_TX_PASSIVE | CAN_STATE_RX_PASSIVE | CAN_STATE_TX_WARNING | CAN_STATE_RX_WARNING))
		sc_raise(s, BB_CANF_BUS_ERROR, f->bytes[1], now_ns, "controller %s, tec %u rec %u",
		         f->bytes[1] & 0x30 ? "passive" : "warning", s->tx_errors, s->rx_errors);
	if (f->bytes[1] & CAN_STATE_ACTIVE)
		sc_clear(s, BB_CANF_BUS_ERROR, now_ns);
}

void sc_bus_status(struct shutter_can *s, enum bb_status status, int64_t now_ns)
{
	if (status == BB_ERR_LOST && s->down_ns == BB_NEVER) {
		s->down_ns = now_ns;
		sc_raise(s, BB_CANF_IF_DOWN, 0, now_ns, "the interface is down");
	}
	if (status == BB_OK || status == BB_TIMEOUT) {
		if (status == BB_OK && s->off) /* somebody is heard: the link restarted by itself */
			come_back(s, now_ns);
		if (s->down_ns != BB_NEVER)
			forgive(s, now_ns);
		s->down_ns = BB_NEVER;
	}
}

static void restart(struct shutter_can *s, int64_t now_ns)
{
	if (restarts_since(s, now_ns - MINUTE_NS) == (int)BB_ARRAY_LEN(s->restarts_ns)) {
		s->quarantined = true;
		s->restart_ns = BB_NEVER;
		sc_raise(s, BB_CANF_BUS_OFF, s->tx_errors, now_ns, "five times within a minute: left alone");
		return;
	}
	for (size_t i = BB_ARRAY_LEN(s->restarts_ns) - 1; i > 0; i--)
		s->restarts_ns[i] = s->restarts_ns[i - 1];
	s->restarts_ns[0] = now_ns;
	s->tries++;
	(void)s->bus->ops->restart(s->bus); /* not ours to do: the link may have a restart time of its own */
	s->restart_ns = now_ns + back_off_ns(s);
}

void sc_bus_poll(struct shutter_can *s, int64_t now_ns)
{
	if (s->off && !s->quarantined && now_ns >= s->restart_ns)
		restart(s, now_ns);
	if (s->alarm[BB_CANF_IF_DOWN].active && s->down_ns == BB_NEVER && s->good >= SC_GOOD_SYNCS)
		sc_clear(s, BB_CANF_IF_DOWN, now_ns);
	if (s->off || s->down_ns != BB_NEVER)
		return;
	const uint64_t sent = s->tx.sent;
	const enum bb_status status = bb_can_queue_flush(&s->tx, s->bus);
	if (status == BB_ERR_BUSY) {
		if (s->busy_ns == BB_NEVER || s->tx.sent != sent)
			s->busy_ns = now_ns;
		else if (now_ns - s->busy_ns > 20 * SC_MS)
			sc_raise(s, BB_CANF_TX_DROP, s->tx.n, now_ns, "the bus takes nothing, %u frames wait", s->tx.n);
		return;
	}
	s->busy_ns = BB_NEVER;
	if (status == BB_ERR_LOST)
		sc_bus_status(s, status, now_ns);
	else if (status == BB_OK && s->tx.n < BB_CAN_QUEUE / 2)
		sc_clear(s, BB_CANF_TX_DROP, now_ns);
}
