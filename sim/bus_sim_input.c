/* sim/bus_sim_input.c: see sim/bus_sim_input.h. Codes as a Debian 6.1 kernel gives them. */
#include "sim/bus_sim_input.h"

#include <linux/input.h>
#include <stdlib.h>
#include <string.h>

#define EVENTS 64
#define KEYS 16

struct field {         /* of a packet: where a value stands and what it becomes */
	uint8_t id;    /* report id it belongs to; 0: any */
	uint8_t at;    /* byte */
	uint8_t bytes; /* 1 unsigned, 2 signed LE */
	bool inverted; /* ~, as xpad does with y */
	uint16_t axis;
	int32_t least, most;
};

struct translation {
	uint8_t least_bytes;
	size_t n_fields;
	struct field field[6];
	uint8_t hat_at;           /* 0xFF: none; a nibble, 8 = centre */
	uint8_t keys_id, keys_at; /* bits from there on, LSB first */
	uint8_t key_shift;        /* bits of the first byte that are none */
	size_t n_keys;
	uint16_t key[KEYS]; /* 0: no key */
	bool motors;
};

#define BYTE_AXIS(id, at, axis)                \
	{                                      \
		id, at, 1, false, axis, 0, 255 \
	}
#define SPACE_AXIS(id, at, axis)                  \
	{                                         \
		id, at, 2, false, axis, -350, 350 \
	}
#define STICK(at, inv, axis)                       \
	{                                          \
		0, at, 2, inv, axis, -32768, 32767 \
	}
#define TWELVE(first)                                                                                          \
	{                                                                                                      \
		first, first + 1, first + 2, first + 3, first + 4, first + 5, first + 6, first + 7, first + 8, \
			first + 9, first + 10, first + 11                                                      \
	}

static const struct translation translations[SIM_PEER_KINDS] = {
	[SIM_PEER_RUMBLEPAD2_WIRED] = { 8,
					4,
					{ BYTE_AXIS(0, 0, ABS_X), BYTE_AXIS(0, 1, ABS_Y), BYTE_AXIS(0, 2, ABS_Z),
					  BYTE_AXIS(0, 3, ABS_RZ) },
					4,
					0,
					4,
					4,
					12,
					TWELVE(BTN_TRIGGER),
					true },
	[SIM_PEER_RUMBLEPAD2_WIRELESS] = { 8,
					   4,
					   { BYTE_AXIS(1, 1, ABS_X), BYTE_AXIS(1, 2, ABS_Y), BYTE_AXIS(1, 3, ABS_Z),
					     BYTE_AXIS(1, 4, ABS_RZ) },
					   5,
					   1,
					   5,
					   4,
					   12,
					   TWELVE(BTN_SOUTH),
					   true },
	[SIM_PEER_SPACENAVIGATOR] = { 3,
				      6,
				      { SPACE_AXIS(1, 1, ABS_X), SPACE_AXIS(1, 3, ABS_Y), SPACE_AXIS(1, 5, ABS_Z),
					SPACE_AXIS(2, 1, ABS_RX), SPACE_AXIS(2, 3, ABS_RY), SPACE_AXIS(2, 5, ABS_RZ) },
				      0xFF,
				      3,
				      1,
				      0,
				      2,
				      { BTN_0, BTN_1 },
				      false },
	[SIM_PEER_SPACEMOUSE_WIRELESS] = { 2,
					   6,
					   { SPACE_AXIS(1, 1, ABS_X), SPACE_AXIS(1, 3, ABS_Y), SPACE_AXIS(1, 5, ABS_Z),
					     SPACE_AXIS(1, 7, ABS_RX), SPACE_AXIS(1, 9, ABS_RY),
					     SPACE_AXIS(1, 11, ABS_RZ) },
					   0xFF,
					   3,
					   1,
					   0,
					   2,
					   { BTN_0, BTN_1 },
					   false },
	[SIM_PEER_XBOX_PAD] = { 29,
				4,
				{ STICK(10, false, ABS_X), STICK(12, true, ABS_Y), STICK(14, false, ABS_RX),
				  STICK(16, true, ABS_RY) },
				0xFF,
				0,
				6,
				0,
				16,
				{ BTN_TRIGGER_HAPPY3, BTN_TRIGGER_HAPPY4, BTN_TRIGGER_HAPPY1, BTN_TRIGGER_HAPPY2,
				  BTN_START, BTN_SELECT, BTN_THUMBL, BTN_THUMBR, BTN_TL, BTN_TR, BTN_MODE, 0, BTN_A,
				  BTN_B, BTN_X, BTN_Y },
				true },
};

struct sim_input_bus {
	struct bb_input_bus base;
	struct sim_peer_pad *peer;
	uint32_t generation;
	const struct translation *tr;
	int32_t value[ABS_HAT0Y + 1];
	bool key[KEYS];
	size_t head, n;
	struct bb_input_event queue[EVENTS];
};

static struct sim_input_bus *of(struct bb_input_bus *bus)
{
	return bb_container_of(bus, struct sim_input_bus, base);
}

static void put(struct sim_input_bus *b, int64_t at_ns, unsigned int type, unsigned int code, int32_t value)
{
	if (b->n < EVENTS)
		b->queue[(b->head + b->n++) % EVENTS] =
			(struct bb_input_event){ at_ns, (uint16_t)type, (uint16_t)code, value };
}

static void put_axis(struct sim_input_bus *b, int64_t at_ns, unsigned int axis, int32_t value)
{
	if (b->value[axis] == value)
		return;
	b->value[axis] = value;
	put(b, at_ns, EV_ABS, axis, value);
}

static int32_t field_value(const struct field *f, const uint8_t *m)
{
	if (f->bytes == 1)
		return m[f->at];
	const int32_t v = (int16_t)(uint16_t)(m[f->at] | m[f->at + 1] << 8);
	return f->inverted ? ~v : v;
}

static void put_hat(struct sim_input_bus *b, int64_t at_ns, unsigned int code)
{
	static const struct {
		int32_t x, y;
	} way[9] = { { 0, -1 }, { 1, -1 }, { 1, 0 }, { 1, 1 }, { 0, 1 }, { -1, 1 }, { -1, 0 }, { -1, -1 }, { 0, 0 } };
	const size_t i = code < 9 ? code : 8;

	put_axis(b, at_ns, ABS_HAT0X, way[i].x);
	put_axis(b, at_ns, ABS_HAT0Y, way[i].y);
}

static void put_keys(struct sim_input_bus *b, int64_t at_ns, const uint8_t *m, size_t n)
{
	for (size_t i = 0; i < b->tr->n_keys; i++) {
		const size_t bit = i + b->tr->key_shift, at = b->tr->keys_at + bit / 8;
		const bool down = at < n && m[at] >> bit % 8 & 1;
		if (b->tr->key[i] && down != b->key[i]) {
			b->key[i] = down;
			put(b, at_ns, EV_KEY, b->tr->key[i], down);
		}
	}
}

/* One packet; packets that change nothing are not told of, as in the kernel. */
static void translate(struct sim_input_bus *b, const uint8_t *m, size_t n, int64_t at_ns)
{
	const struct translation *tr = b->tr;
	const size_t before = b->n;

	if (n < tr->least_bytes || (tr == &translations[SIM_PEER_XBOX_PAD] && m[1] != 1))
		return;
	for (size_t i = 0; i < tr->n_fields; i++)
		if ((!tr->field[i].id || tr->field[i].id == m[0]) && tr->field[i].at + tr->field[i].bytes <= n)
			put_axis(b, at_ns, tr->field[i].axis, field_value(&tr->field[i], m));
	if (tr->hat_at < n && (!tr->keys_id || tr->keys_id == m[0]))
		put_hat(b, at_ns, m[tr->hat_at] & 15);
	if (!tr->keys_id || tr->keys_id == m[0])
		put_keys(b, at_ns, m, n);
	if (b->n > before)
		put(b, at_ns, EV_SYN, SYN_REPORT, 0);
}

static bool stale(const struct sim_input_bus *b)
{
	return !sim_peer_pad_plugged(b->peer) || sim_peer_pad_generation(b->peer) != b->generation;
}

static enum bb_status sim_read(struct bb_input_bus *bus, struct bb_input_event *events, size_t cap, size_t *n_out)
{
	struct sim_input_bus *b = of(bus);
	uint8_t packet[SIM_PEER_PACKET_BYTES];
	int64_t at_ns = 0;
	size_t n = 0;

	*n_out = 0;
	if (stale(b))
		return BB_ERR_LOST;
	while (b->n < EVENTS / 2 && sim_peer_pad_take(b->peer, packet, sizeof(packet), &n, &at_ns) == BB_OK)
		translate(b, packet, n, at_ns);
	for (; *n_out < cap && b->n; b->n--) {
		events[(*n_out)++] = b->queue[b->head];
		b->head = (b->head + 1) % EVENTS;
	}
	return *n_out ? BB_OK : BB_TIMEOUT;
}

static bool sim_has(struct bb_input_bus *bus, unsigned int type, unsigned int code)
{
	const struct translation *tr = of(bus)->tr;

	if (type == EV_FF)
		return code == FF_RUMBLE && tr->motors;
	for (size_t i = 0; type == EV_KEY && i < tr->n_keys; i++)
		if (code && tr->key[i] == code)
			return true;
	return false;
}

static bool sim_range(struct bb_input_bus *bus, unsigned int axis, struct bb_input_range *out)
{
	struct sim_input_bus *b = of(bus);

	if (b->tr->hat_at != 0xFF && (axis == ABS_HAT0X || axis == ABS_HAT0Y)) {
		*out = (struct bb_input_range){ -1, 1, b->value[axis] };
		return true;
	}
	for (size_t i = 0; i < b->tr->n_fields; i++)
		if (b->tr->field[i].axis == axis) {
			*out = (struct bb_input_range){ b->tr->field[i].least, b->tr->field[i].most, b->value[axis] };
			return true;
		}
	return false;
}

/* The kernel's drivers write to the pad: lg2ff and lgff a report, xpad a packet. */
static enum bb_status sim_rumble(struct bb_input_bus *bus, uint16_t strong, uint16_t weak)
{
	struct sim_input_bus *b = of(bus);
	const uint8_t s = (uint8_t)(strong >> 8), w = (uint8_t)(weak >> 8);
	const uint8_t wired[8] = { 0x00, s || w ? 0x51 : 0xF3, 0x00, w, 0x00, s },
		      wireless[8] = { 0x01, 0x42, 0x00, w, s };
	const uint8_t usb[12] = { 0x00, 0x01, 0x0F, 0xC0, 0x00, s, w };

	if (!b->tr->motors)
		return BB_ERR_UNSUPPORTED;
	if (stale(b))
		return BB_ERR_LOST;
	if (sim_peer_pad_kind(b->peer) == SIM_PEER_XBOX_PAD)
		return sim_peer_pad_give(b->peer, usb, sizeof(usb));
	return sim_peer_pad_give(b->peer, sim_peer_pad_kind(b->peer) == SIM_PEER_RUMBLEPAD2_WIRELESS ? wireless : wired,
				 8);
}

static void sim_close(struct bb_input_bus *bus)
{
	if (bus)
		free(of(bus));
}

static const struct bb_input_ops ops = { sim_read, sim_has, sim_range, sim_rumble, sim_close };

enum bb_status sim_input_bus_open(struct sim_peer_pad *peer, struct bb_clock *clk, struct bb_input_bus **out)
{
	*out = NULL;
	if (!sim_peer_pad_plugged(peer))
		return BB_ERR_LOST;
	struct sim_input_bus *b = calloc(1, sizeof(*b));
	if (!b)
		return BB_ERR_NOMEM;
	b->base = (struct bb_input_bus){ &ops, clk };
	b->peer = peer;
	b->generation = sim_peer_pad_generation(peer);
	b->tr = &translations[sim_peer_pad_kind(peer)];
	*out = &b->base;
	return BB_OK;
}
