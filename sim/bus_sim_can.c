/* sim/bus_sim_can.c: see sim/bus_sim_can.h. */
#include "sim/bus_sim_can.h"
#include "drivers/canopen_wire.h"
#include "sim/world.h"

#include <stdlib.h>
#include <string.h>

#define SOCKET_ROOM 1024
#define SOCKET_QUEUE 10   /* txqueuelen of a CAN interface */
#define PAUSE_BITS 3
#define ERROR_BITS 20     /* flag, echo and delimiter */
#define BACK_BITS (128 * 11)
#define PEER_RESTART_NS INT64_C(100000000)
#define WIRE_WAIT_NS INT64_C(20000000)  /* a real wire that has not sent a frame by then never will */
#define WIRE_AGAIN_NS INT64_C(5000000)

struct sim_can {
	struct bb_can_bus bus;
	struct sim_can_port host, ghost; /* ghost: who injects and babbles */
	struct sim_can_wire *wire;       /* NULL: the modelled one */
	struct bb_clock *clk;
	struct bb_timer timer, babbler;
	struct sim_rng rng;
	uint64_t n_frames;
	int64_t bitrate, free_ns;        /* the bus is taken until then */
	struct sim_can_port *ports, *sender;
	struct bb_can_frame flying;
	bool destroyed, lone;
	uint32_t error_ppm;
	int64_t down;
	struct bb_can_frame babble;
	int64_t babble_ns;
	struct bb_can_frame room[SOCKET_ROOM];
	uint32_t head, held;
	struct sim_can_counters counters;
};

/* Length on the wire */

struct bits {
	int n, run, last;
	uint16_t crc;
};

static void bit(struct bits *b, int value, bool in_crc)
{
	if (in_crc) {
		const bool turn = (b->crc >> 14 & 1) != value;
		b->crc = (uint16_t)((b->crc << 1 & 0x7fff) ^ (turn ? 0x4599 : 0));
	}
	b->run = value == b->last ? b->run + 1 : 1;
	b->last = value;
	b->n++;
	if (b->run == 5) { /* a stuffed bit of the other sign, which begins a run of its own */
		b->n++;
		b->last = !value;
		b->run = 1;
	}
}

static void number(struct bits *b, uint32_t value, int width, bool in_crc)
{
	for (int i = width - 1; i >= 0; i--)
		bit(b, (int)(value >> i & 1), in_crc);
}

int sim_can_frame_bits(const struct bb_can_frame *f)
{
	struct bits b = { 0, 0, -1, 0 };

	bit(&b, 0, true); /* start of frame */
	if (f->extended) {
		number(&b, f->id >> 18 & 0x7ff, 11, true);
		number(&b, 3, 2, true);
		number(&b, f->id & 0x3ffff, 18, true);
		number(&b, f->remote, 1, true);
		number(&b, 0, 2, true);
	} else {
		number(&b, f->id & 0x7ff, 11, true);
		number(&b, f->remote, 1, true);
		number(&b, 0, 2, true);
	}
	number(&b, f->n_bytes, 4, true);
	for (int i = 0; i < f->n_bytes && !f->remote; i++)
		number(&b, f->bytes[i], 8, true);
	number(&b, b.crc, 15, false);
	return b.n + 1 + 2 + 7; /* CRC delimiter, acknowledge, end of frame */
}

int64_t sim_can_bits_ns(const struct sim_can *can, int64_t bits)
{
	return bits * BB_NS_PER_S / can->bitrate;
}

/* The host's socket */

static void to_socket(struct sim_can *can, const struct bb_can_frame *f, int64_t at_ns)
{
	if (can->held == SOCKET_ROOM) {
		can->counters.overruns++;
		return;
	}
	struct bb_can_frame *slot = &can->room[(can->head + can->held++) % SOCKET_ROOM];
	*slot = *f;
	slot->at_ns = at_ns;
}

static void tell_state(struct sim_can_port *p, uint32_t class, uint8_t controller, int64_t at_ns)
{
	struct bb_can_frame f = { .id = class | CAN_CLASS_COUNTERS, .error = true, .n_bytes = 8 };

	if (p != &p->can->host)
		return;
	f.bytes[1] = controller;
	f.bytes[6] = (uint8_t)(p->tx_errors < 255 ? p->tx_errors : 255);
	f.bytes[7] = (uint8_t)(p->rx_errors < 255 ? p->rx_errors : 255);
	to_socket(p->can, &f, at_ns);
}

static void go_off(struct sim_can_port *p, int64_t at_ns)
{
	p->state = 3;
	p->n_box = 0;
	p->back_ns = BB_NEVER;
	tell_state(p, CAN_CLASS_BUS_OFF, 0, at_ns);
	if (p != &p->can->host) /* peers come back by themselves */
		p->back_ns = at_ns + PEER_RESTART_NS + sim_can_bits_ns(p->can, BACK_BITS);
}

static void count_errors(struct sim_can_port *p, int tx, int rx, int64_t at_ns)
{
	if (p->state == 3)
		return;
	p->tx_errors = p->tx_errors + tx > 0 ? p->tx_errors + tx : 0;
	p->rx_errors = p->rx_errors + rx > 0 ? p->rx_errors + rx : 0;
	if (p->rx_errors > 255)
		p->rx_errors = 255;
	const int worst = p->tx_errors > p->rx_errors ? p->tx_errors : p->rx_errors;
	const int state = p->tx_errors > 255 ? 3 : worst > 127 ? 2 : worst > 95 ? 1 : 0;
	if (state == p->state)
		return;
	if (state == 3) {
		go_off(p, at_ns);
		return;
	}
	static const uint8_t words[3][2] = { { CAN_STATE_ACTIVE, CAN_STATE_ACTIVE },
		                             { CAN_STATE_TX_WARNING, CAN_STATE_RX_WARNING },
		                             { CAN_STATE_TX_PASSIVE, CAN_STATE_RX_PASSIVE } };
	p->state = state;
	tell_state(p, CAN_CLASS_CONTROLLER, words[state][p->rx_errors > p->tx_errors], at_ns);
}

/* The medium */

static uint32_t rank_of(const struct bb_can_frame *f)
{
	return f->extended ? f->id : f->id << 18;
}

static uint32_t best_of(const struct sim_can_port *p)
{
	uint32_t best = 0;

	for (uint32_t i = 1; !p->fifo && i < p->n_box; i++)
		if (rank_of(&p->box[i]) < rank_of(&p->box[best]))
			best = i;
	return best;
}

static bool may_send(const struct sim_can_port *p)
{
	return p->n_box && !p->muted && !p->held && p->state != 3;
}

static struct sim_can_port *winner(const struct sim_can *can)
{
	struct sim_can_port *best = NULL;

	for (struct sim_can_port *p = can->ports; p; p = p->next)
		if (may_send(p) && (!best || rank_of(&p->box[best_of(p)]) < rank_of(&best->box[best_of(best)])))
			best = p;
	return best;
}

static int64_t earliest_back_ns(const struct sim_can *can)
{
	int64_t least_ns = BB_NEVER;

	for (const struct sim_can_port *p = can->ports; p; p = p->next)
		if (p->state == 3 && p->back_ns < least_ns)
			least_ns = p->back_ns;
	return least_ns;
}

static int64_t wake_ns(const struct sim_can *can)
{
	const int64_t back_ns = earliest_back_ns(can);
	int64_t at_ns = BB_NEVER;

	if (can->sender)
		at_ns = can->free_ns;
	else if (winner(can)) {
		/* Arbitration is a bit later, so that all who begin at one moment take part. */
		const int64_t next_ns = bb_clock_now_ns(can->clk) + (can->wire ? 0 : sim_can_bits_ns(can, 1));
		at_ns = next_ns > can->free_ns ? next_ns : can->free_ns;
	}
	return at_ns < back_ns ? at_ns : back_ns;
}

static void kick(struct sim_can *can)
{
	const int64_t at_ns = wake_ns(can);

	if (at_ns != BB_NEVER && (!can->timer.slot || at_ns < can->timer.at_ns) &&
	    bb_clock_arm(can->clk, &can->timer, at_ns) != BB_OK)
		can->counters.errors++;
}

static bool somebody_hears(const struct sim_can *can, const struct sim_can_port *sender)
{
	for (const struct sim_can_port *p = can->ports; p; p = p->next)
		if (p != sender && p != &can->ghost && p->state != 3 && !p->muted)
			return true;
	return false;
}

static bool same(const struct bb_can_frame *a, const struct bb_can_frame *b)
{
	return a->id == b->id && a->extended == b->extended && a->remote == b->remote && a->n_bytes == b->n_bytes &&
	       !memcmp(a->bytes, b->bytes, a->n_bytes);
}

static void begin_frame(struct sim_can *can, struct sim_can_port *p, int64_t at_ns)
{
	struct sim_rng r = sim_rng_at(&can->rng, can->n_frames++);

	can->sender = p;
	can->flying = p->box[best_of(p)];
	can->lone = !can->wire && !somebody_hears(can, p);
	for (struct sim_can_port *q = can->ports; q; q = q->next)
		q->joined = q != p && may_send(q) && same(&q->box[best_of(q)], &can->flying);
	can->destroyed = can->lone || p->broken || (double)can->error_ppm * 1e-6 > sim_rng_uniform(&r);
	can->free_ns = at_ns + sim_can_bits_ns(can, sim_can_frame_bits(&can->flying));
	if (can->destroyed)
		can->free_ns += sim_can_bits_ns(can, ERROR_BITS);
	can->counters.busy_ns += can->free_ns - at_ns;
}

/* The frame of can->sender. The wire may say that it is sent before it returns. */
static void give_to_wire(struct sim_can *can)
{
	const int64_t now_ns = bb_clock_now_ns(can->clk);

	can->free_ns = now_ns + WIRE_WAIT_NS;
	if (can->wire->send(can->wire, &can->flying))
		return;
	can->sender = NULL;
	can->free_ns = now_ns + WIRE_AGAIN_NS;
	can->counters.errors++;
}

static void forget(struct sim_can_port *p, const struct bb_can_frame *f)
{
	const uint32_t i = best_of(p);

	if (i < p->n_box && p->box[i].id == f->id) {
		memmove(p->box + i, p->box + i + 1, (p->n_box - i - 1) * sizeof(*f));
		p->n_box--;
		return;
	}
	for (uint32_t k = 0; k < p->n_box; k++) /* a lower id came in meanwhile */
		if (p->box[k].id == f->id) {
			memmove(p->box + k, p->box + k + 1, (p->n_box - k - 1) * sizeof(*f));
			p->n_box--;
			return;
		}
}

static void lose_frame(struct sim_can *can, struct sim_can_port *from, int64_t at_ns)
{
	can->counters.errors++;
	/* Nobody to acknowledge: a passive sender does not count further. */
	if (!can->lone || from->state < 2)
		count_errors(from, 8, 0, at_ns);
	for (struct sim_can_port *p = can->ports; p; p = p->next)
		if (p != from && !p->muted)
			count_errors(p, 0, 1, at_ns);
}

static void deliver(struct sim_can *can, struct sim_can_port *from, int64_t at_ns)
{
	struct bb_can_frame f = can->flying;
	struct sim_can_port *next;

	can->counters.frames++;
	f.at_ns = at_ns;
	forget(from, &f);
	count_errors(from, -1, 0, at_ns);
	if (from->sent)
		from->sent(from, &f, at_ns);
	for (struct sim_can_port *p = can->ports; p; p = next) {
		next = p->next;
		if (p == from || p->muted || p->state == 3)
			continue;
		if (p->joined) {
			forget(p, &f);
			continue;
		}
		count_errors(p, 0, -1, at_ns);
		if (p->frame)
			p->frame(p, &f, at_ns);
	}
}

static void give_up(struct sim_can *can, struct sim_can_port *from)
{
	can->counters.errors++;
	forget(from, &can->flying);
}

static void come_back(struct sim_can *can, int64_t at_ns)
{
	for (struct sim_can_port *p = can->ports; p; p = p->next) {
		if (p->state != 3 || p->back_ns > at_ns)
			continue;
		p->state = p->tx_errors = p->rx_errors = 0;
		tell_state(p, CAN_CLASS_RESTARTED, 0, at_ns);
		if (p->back)
			p->back(p, at_ns);
	}
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_can *can = bb_container_of(timer, struct sim_can, timer);
	struct sim_can_port *from = can->sender;

	(void)now_ns;
	come_back(can, scheduled_ns);
	if (from && scheduled_ns >= can->free_ns) {
		can->sender = NULL;
		can->free_ns += sim_can_bits_ns(can, PAUSE_BITS);
		if (can->destroyed)
			lose_frame(can, from, scheduled_ns);
		else if (can->wire)
			give_up(can, from);
		else
			deliver(can, from, scheduled_ns);
	} else if (!from && scheduled_ns >= can->free_ns) {
		struct sim_can_port *p = winner(can);
		if (p)
			begin_frame(can, p, scheduled_ns);
		if (p && can->wire && !can->destroyed)
			give_to_wire(can);
	}
	const int64_t at_ns = wake_ns(can);
	if (timer->slot) { /* a callback sent something and armed it */
		if (at_ns < timer->at_ns)
			bb_clock_disarm(can->clk, timer);
		else
			return BB_NEVER;
	}
	return at_ns;
}

/* Ports */

void sim_can_attach(struct sim_can *can, struct sim_can_port *port)
{
	struct sim_can_port **end = &can->ports;

	while (*end)
		end = &(*end)->next;
	*end = port;
	port->next = NULL;
	port->can = can;
	port->cap = port == &can->host ? SOCKET_QUEUE : SIM_CAN_MAILBOX;
	port->n_box = 0;
	port->state = port->tx_errors = port->rx_errors = 0;
	kick(can); /* somebody may have waited for an acknowledgement */
}

void sim_can_detach(struct sim_can_port *port)
{
	if (!port->can)
		return;
	for (struct sim_can_port **p = &port->can->ports; *p; p = &(*p)->next)
		if (*p == port) {
			*p = port->next;
			break;
		}
	if (port->can->sender == port) { /* the frame under way breaks off */
		port->can->sender = NULL;
		bb_clock_disarm(port->can->clk, &port->can->timer);
		kick(port->can);
	}
	port->can = NULL;
}

enum bb_status sim_can_send(struct sim_can_port *port, const struct bb_can_frame *f)
{
	if (!port->can)
		return BB_ERR_LOST;
	if (port->n_box == port->cap)
		return BB_ERR_BUSY;
	if ((port->state == 3 || port->muted) && port != &port->can->host)
		return BB_ERR_BUSY; /* lost, as when mailboxes are written over */
	port->box[port->n_box++] = *f;
	kick(port->can);
	return BB_OK;
}

static struct sim_can *of_bus(struct bb_can_bus *bus)
{
	return bb_container_of(bus, struct sim_can, bus);
}

static enum bb_status bus_send(struct bb_can_bus *bus, const struct bb_can_frame *f)
{
	struct sim_can *can = of_bus(bus);

	if (f->n_bytes > 8 || f->error || f->id > (f->extended ? 0x1fffffffu : 0x7ffu))
		return BB_ERR_USAGE;
	return can->down ? BB_ERR_LOST : sim_can_send(&can->host, f);
}

static enum bb_status bus_receive(struct bb_can_bus *bus, struct bb_can_frame *f)
{
	struct sim_can *can = of_bus(bus);

	if (can->down)
		return BB_ERR_LOST;
	if (!can->held)
		return BB_TIMEOUT;
	*f = can->room[can->head];
	can->head = (can->head + 1) % SOCKET_ROOM;
	can->held--;
	return BB_OK;
}

static enum bb_status bus_restart(struct bb_can_bus *bus)
{
	struct sim_can *can = of_bus(bus);

	if (can->host.state != 3)
		return BB_ERR_BUSY;
	can->host.back_ns = bb_clock_now_ns(can->clk) + sim_can_bits_ns(can, BACK_BITS);
	can->host.n_box = 0;
	kick(can);
	return BB_OK;
}

static void bus_close(struct bb_can_bus *bus)
{
	struct sim_can *can = of_bus(bus);

	can->held = 0; /* frames not sent yet still go out, as a socket's do */
}

static void host_frame(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns)
{
	if (!port->can->down)
		to_socket(port->can, f, at_ns);
}

static int64_t babble_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_can *can = bb_container_of(timer, struct sim_can, babbler);

	(void)now_ns;
	if (!can->babble_ns)
		return BB_NEVER;
	if (can->ghost.n_box < SIM_CAN_MAILBOX)
		(void)sim_can_send(&can->ghost, &can->babble);
	return scheduled_ns + can->babble_ns;
}

enum bb_status sim_can_create(struct bb_clock *clk, int64_t bitrate, uint64_t seed, struct sim_can **out)
{
	static const struct bb_can_ops ops = { bus_send, bus_receive, bus_restart, bus_close };

	*out = NULL;
	if (bitrate < 10000 || bitrate > 1000000)
		return BB_ERR_RANGE;
	struct sim_can *can = calloc(1, sizeof(*can));
	if (!can)
		return BB_ERR_NOMEM;
	can->bus = (struct bb_can_bus){ &ops, clk, bitrate };
	can->clk = clk;
	can->bitrate = bitrate;
	can->timer = (struct bb_timer){ .step = step, .rank = 2 };
	can->babbler = (struct bb_timer){ .step = babble_step, .rank = 1 };
	can->host.frame = host_frame;
	can->host.fifo = true;
	sim_rng_seed(&can->rng, seed, "can", "medium");
	sim_can_attach(can, &can->host);
	sim_can_attach(can, &can->ghost);
	*out = can;
	return BB_OK;
}

void sim_can_destroy(struct sim_can *can)
{
	if (!can)
		return;
	for (struct sim_can_port *p = can->ports; p; p = p->next)
		p->can = NULL;
	bb_clock_disarm(can->clk, &can->timer);
	bb_clock_disarm(can->clk, &can->babbler);
	free(can);
}

struct bb_can_bus *sim_can_bus(struct sim_can *can)
{
	return &can->bus;
}

struct sim_can_port *sim_can_host(struct sim_can *can)
{
	return &can->host;
}

const struct sim_can_counters *sim_can_counters(const struct sim_can *can)
{
	return &can->counters;
}

/* A real wire */

void sim_can_use_wire(struct sim_can *can, struct sim_can_wire *wire)
{
	sim_can_detach(&can->host);
	can->wire = wire;
}

void sim_can_wire_sent(struct sim_can *can, const struct bb_can_frame *f, int64_t at_ns)
{
	struct sim_can_port *from = can->sender;

	if (!from || can->destroyed || !same(f, &can->flying))
		return; /* given up before */
	can->sender = NULL;
	can->free_ns = 0;
	deliver(can, from, at_ns);
	bb_clock_disarm(can->clk, &can->timer);
	kick(can);
}

void sim_can_wire_heard(struct sim_can *can, const struct bb_can_frame *f, int64_t at_ns)
{
	struct sim_can_port *next;

	can->counters.frames++;
	for (struct sim_can_port *p = can->ports; p; p = next) {
		next = p->next;
		if (p->frame && !p->muted && p->state != 3)
			p->frame(p, f, at_ns);
	}
}

/* Verbs */

void sim_can_break_tx(struct sim_can_port *port, bool on)
{
	port->broken += on ? 1 : -1;
}

void sim_can_mute(struct sim_can_port *port, bool on)
{
	port->muted += on ? 1 : -1;
	if (port->muted)
		port->n_box = 0;
	kick(port->can);
}

void sim_can_hold_tx(struct sim_can_port *port, bool on)
{
	port->held += on ? 1 : -1;
	kick(port->can);
}

void sim_can_bus_off(struct sim_can_port *port)
{
	port->tx_errors = 256;
	go_off(port, bb_clock_now_ns(port->can->clk));
	kick(port->can);
}

void sim_can_error_ppm(struct sim_can *can, uint32_t ppm)
{
	can->error_ppm = ppm;
}

void sim_can_link_down(struct sim_can *can, bool on)
{
	can->down += on ? 1 : -1;
	can->held = 0;
	can->host.n_box = 0;
}

void sim_can_inject(struct sim_can *can, const struct bb_can_frame *f)
{
	(void)sim_can_send(&can->ghost, f);
}

void sim_can_babble(struct sim_can *can, const struct bb_can_frame *f, int64_t period_ns)
{
	can->babble = *f;
	can->babble_ns = period_ns;
	bb_clock_disarm(can->clk, &can->babbler);
	if (period_ns && bb_clock_arm(can->clk, &can->babbler, bb_clock_now_ns(can->clk)) != BB_OK)
		can->counters.errors++;
}
