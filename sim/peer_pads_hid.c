/*
 * sim/peer_pads_hid.c: what a RumblePad 2 and the SpaceMice write into their reports, and how they describe them.
 * Written from recorded reports, without a look at the drivers' decoder.
 */
#include "sim/peer_pads_impl.h"

#include <math.h>
#include <string.h>

#include "drivers/pad_wire.h"

/* RumblePad 2. ------------------------------------------------------------------------------------------------- */

static uint8_t hat_code(int32_t x, int32_t y)
{
	static const uint8_t code[3][3] = {
		/* [y + 1][x + 1]: up is y = -1 */
		{ 7, PAD_WIRE_HAT_UP, 1 },
		{ 6, PAD_WIRE_HAT_CENTRE, 2 },
		{ 5, 4, 3 },
	};
	return code[y + 1][x + 1];
}

static void put_rumblepad(const struct peer_values *v, uint8_t out[6])
{
	out[0] = (uint8_t)(PAD_WIRE_RUMBLEPAD_CENTRE_X + v->count[0]);
	out[1] = (uint8_t)(PAD_WIRE_RUMBLEPAD_CENTRE_Y + v->count[1]);
	out[2] = (uint8_t)(PAD_WIRE_RUMBLEPAD_CENTRE_X + v->count[2]);
	out[3] = (uint8_t)(PAD_WIRE_RUMBLEPAD_CENTRE_Y + v->count[3]);
	out[4] = (uint8_t)(hat_code(v->count[4], v->count[5]) | (v->buttons & 15) << 4);
	out[5] = (uint8_t)(v->buttons >> 4 & 0xFF);
}

static void send_wired(struct sim_peer_pad *p, const struct peer_values *v)
{
	uint8_t report[8] = { 0, 0, 0, 0, 0, 0, 0x04, 0xFF };

	put_rumblepad(v, report);
	sim_peer_emit(p, report, sizeof(report));
}

static void send_wireless(struct sim_peer_pad *p, const struct peer_values *v)
{
	uint8_t report[8] = { PAD_WIRE_RUMBLEPAD_ID, 0, 0, 0, 0, 0, 0, 0x74 };

	put_rumblepad(v, report + 1);
	sim_peer_emit(p, report, sizeof(report));
}

static void motors(struct sim_peer_pad *p, uint8_t strong, uint8_t weak)
{
	p->has_rumbled = true;
	p->strong = (float)strong / 255;
	p->weak = (float)weak / 255;
}

/* Both motors from one report of seven values: 51 and F3, on the wireless one 42 as well. Others are swallowed. */
static enum bb_status give_rumblepad(struct sim_peer_pad *p, const uint8_t *bytes, size_t n)
{
	const bool wireless = p->kind == SIM_PEER_RUMBLEPAD2_WIRELESS;
	const uint8_t *v = bytes + 1;

	if (n != 1 + PAD_WIRE_RUMBLE_BYTES || bytes[0] != (wireless ? PAD_WIRE_RUMBLEPAD_ID : 0))
		return BB_ERR_IO;
	if (v[0] == PAD_WIRE_RUMBLE_SET)
		motors(p, v[4], v[2]);
	else if (v[0] == PAD_WIRE_RUMBLE_STOP)
		motors(p, 0, 0);
	else if (v[0] == PAD_WIRE_RUMBLE_WIRELESS && wireless)
		motors(p, v[3], v[2]);
	return BB_OK;
}

static void joined_silently(struct sim_peer_pad *p)
{
	(void)p;
}

const struct peer_model sim_peer_rumblepad_wired = {
	{ 127, 127, 127, 127, 1, 1 }, 0xFFF, send_wired, joined_silently, give_rumblepad, BB_NEVER, NULL
};
const struct peer_model sim_peer_rumblepad_wireless = {
	{ 127, 127, 127, 127, 1, 1 }, 0xFFF, send_wireless, joined_silently, give_rumblepad, BB_NEVER, NULL
};

/* SpaceMouse. -------------------------------------------------------------------------------------------------- */

static void put_word(uint8_t *to, int32_t v)
{
	to[0] = (uint8_t)(v & 0xFF);
	to[1] = (uint8_t)((uint32_t)v >> 8 & 0xFF);
}

/* From x right, y up, z towards the user to the maker's x right, y towards the user, z down. */
static void put_triple(uint8_t *to, const int32_t *count)
{
	put_word(to, count[0]);
	put_word(to + 2, count[2]);
	put_word(to + 4, -count[1]);
}

static void send_buttons(struct sim_peer_pad *p, const struct peer_values *v)
{
	const uint8_t report[3] = { PAD_WIRE_SPACE_BUTTONS, (uint8_t)(v->buttons & 0xFF),
				    (uint8_t)(v->buttons >> 8 & 0xFF) };

	sim_peer_emit(p, report, sizeof(report));
}

static bool axes_said(const struct sim_peer_pad *p, const struct peer_values *v)
{
	static const int32_t rest[BB_PAD_AXES];

	return !memcmp(v->count, rest, sizeof(rest)) && !memcmp(p->told.count, rest, sizeof(rest));
}

static void send_navigator(struct sim_peer_pad *p, const struct peer_values *v)
{
	uint8_t move[7] = { PAD_WIRE_SPACE_MOVE }, turn[7] = { PAD_WIRE_SPACE_TURN };

	put_triple(move + 1, v->count);
	put_triple(turn + 1, v->count + 3);
	if (!axes_said(p, v)) {
		sim_peer_emit(p, move, sizeof(move));
		sim_peer_emit(p, turn, sizeof(turn));
	}
	if (v->buttons != p->told.buttons)
		send_buttons(p, v);
}

static void send_spacemouse(struct sim_peer_pad *p, const struct peer_values *v)
{
	uint8_t report[13] = { PAD_WIRE_SPACE_MOVE };

	put_triple(report + 1, v->count);
	put_triple(report + 7, v->count + 3);
	if (!axes_said(p, v))
		sim_peer_emit(p, report, sizeof(report));
	if (v->buttons != p->told.buttons)
		send_buttons(p, v);
}

static void send_battery(struct sim_peer_pad *p, double level)
{
	const uint8_t report[2] = { PAD_WIRE_SPACE_BATTERY, (uint8_t)lround(level * 100) };

	sim_peer_emit(p, report, sizeof(report));
}

static enum bb_status give_space(struct sim_peer_pad *p, const uint8_t *bytes, size_t n)
{
	if (n != 2 || bytes[0] != PAD_WIRE_SPACE_LED || bytes[1] > 1)
		return BB_ERR_IO;
	p->led = bytes[1];
	return BB_OK;
}

const struct peer_model sim_peer_spacenavigator = {
	{ 350, 350, 350, 350, 350, 350 }, 0x3, send_navigator, joined_silently, give_space, BB_NEVER, NULL
};
const struct peer_model sim_peer_spacemouse = { { 350, 350, 350, 350, 350, 350 },
						0x3,
						send_spacemouse,
						joined_silently,
						give_space,
						INT64_C(10000000000),
						send_battery };

/* Descriptors. ------------------------------------------------------------------------------------------------- */

#define RUMBLEPAD_FIELDS                                                                                       \
	0x15, 0x00, 0x26, 0xFF, 0x00, 0x75, 0x08, 0x95, 0x04,                     /* four bytes 0..255: */     \
		0x09, 0x30, 0x09, 0x31, 0x09, 0x32, 0x09, 0x35, 0x81, 0x02,       /* X Y Z Rz */               \
		0x15, 0x00, 0x25, 0x07, 0x35, 0x00, 0x46, 0x3B, 0x01, 0x65, 0x14, /* 0..7 is 0..315 degrees */ \
		0x75, 0x04, 0x95, 0x01, 0x09, 0x39, 0x81, 0x42, 0x65, 0x00,       /* hat, centre is null */    \
		0x05, 0x09, 0x19, 0x01, 0x29, 0x0C, 0x25, 0x01, 0x45, 0x01,       /* buttons 1..12 */          \
		0x75, 0x01, 0x95, 0x0C, 0x81, 0x02, 0x06, 0x00, 0xFF              /* the maker's own page */

static const uint8_t rumblepad_wired[] = {
	0x05, 0x01, 0x09, 0x04, 0xA1, 0x01, 0xA1, 0x02, RUMBLEPAD_FIELDS,
	0x26, 0xFF, 0x00, 0x46, 0xFF, 0x00, 0x75, 0x08, 0x95,
	0x02, 0x09, 0x01, 0x81, 0x02, 0xC0, 0xA1, 0x02, 0x75,
	0x08, 0x95, 0x07, 0x09, 0x02, 0x91, 0x02, 0xC0, 0xC0,
};

static const uint8_t rumblepad_wireless[] = {
	0x05,
	0x01,
	0x09,
	0x05,
	0xA1,
	0x01,
	0x85,
	PAD_WIRE_RUMBLEPAD_ID,
	0xA1,
	0x02,
	RUMBLEPAD_FIELDS,
	0x26,
	0xFF,
	0x00,
	0x46,
	0xFF,
	0x00,
	0x75,
	0x08,
	0x95,
	0x01,
	0x09,
	0x01,
	0x81,
	0x02,
	0xC0,
	0xA1,
	0x02,
	0x75,
	0x08,
	0x95,
	0x07,
	0x09,
	0x02,
	0x91,
	0x02,
	0xC0,
	0xC0,
};

#define SPACE_RANGE 0x16, 0xA2, 0xFE, 0x26, 0x5E, 0x01, 0x36, 0x88, 0xFA, 0x46, 0x78, 0x05, 0x75, 0x10 /* +-350 */
#define SPACE_BUTTONS                                                                                               \
	0xA1, 0x02, 0x85, 0x03, 0x05, 0x01, 0x05, 0x09, 0x19, 0x01, 0x29, 0x02, 0x15, 0x00, 0x25, 0x01, 0x35, 0x00, \
		0x45, 0x01, 0x75, 0x01, 0x95, 0x02, 0x81, 0x02, 0x95, 0x0E, 0x81, 0x03, 0xC0
#define SPACE_LED                                                                                                   \
	0xA1, 0x02, 0x85, 0x04, 0x05, 0x08, 0x09, 0x4B, 0x15, 0x00, 0x25, 0x01, 0x95, 0x01, 0x75, 0x01, 0x91, 0x02, \
		0x95, 0x01, 0x75, 0x07, 0x91, 0x03, 0xC0

static const uint8_t spacenavigator[] = {
	0x05, 0x01, 0x09, 0x08, 0xA1, 0x01, 0xA1, 0x00, 0x85, 0x01, SPACE_RANGE,   0x95,      0x03,        0x09,
	0x30, 0x09, 0x31, 0x09, 0x32, 0x81, 0x02, 0xC0, 0xA1, 0x00, 0x85,          0x02,      SPACE_RANGE, 0x95,
	0x03, 0x09, 0x33, 0x09, 0x34, 0x09, 0x35, 0x81, 0x02, 0xC0, SPACE_BUTTONS, SPACE_LED, 0xC0,
};

static const uint8_t spacemouse[] = {
	0x05, 0x01, 0x09,          0x08,      0xA1, 0x01, 0xA1, 0x00, 0x85, 0x01, SPACE_RANGE, 0x95, 0x06,
	0x09, 0x30, 0x09,          0x31,      0x09, 0x32, 0x09, 0x33, 0x09, 0x34, 0x09,        0x35, 0x81,
	0x02, 0xC0, SPACE_BUTTONS, SPACE_LED, 0xA1, 0x02, 0x85, 0x17, 0x05, 0x06, 0x09,        0x20, 0x15,
	0x00, 0x25, 0x64,          0x75,      0x08, 0x95, 0x01, 0x81, 0x02, 0xC0, 0xC0,
};

const uint8_t *sim_peer_hid_descriptor(enum sim_peer_kind kind, size_t *n_out)
{
	static const struct {
		const uint8_t *bytes;
		size_t n;
	} all[SIM_PEER_KINDS] = {
		[SIM_PEER_RUMBLEPAD2_WIRED] = { rumblepad_wired, sizeof(rumblepad_wired) },
		[SIM_PEER_RUMBLEPAD2_WIRELESS] = { rumblepad_wireless, sizeof(rumblepad_wireless) },
		[SIM_PEER_SPACENAVIGATOR] = { spacenavigator, sizeof(spacenavigator) },
		[SIM_PEER_SPACEMOUSE_WIRELESS] = { spacemouse, sizeof(spacemouse) },
	};
	*n_out = all[kind].n;
	return all[kind].bytes;
}
