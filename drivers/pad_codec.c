/* drivers/pad_codec.c: see drivers/pad_codec.h. */
#include "drivers/pad_codec.h"

#include <math.h>
#include <string.h>

#include "drivers/pad_wire.h"

static const int32_t rumblepad_steps[BB_PAD_AXES] = { 127, 127, 127, 127, 1, 1 };
static const int32_t space_steps[BB_PAD_AXES] = { PAD_WIRE_SPACE_COUNTS, PAD_WIRE_SPACE_COUNTS, PAD_WIRE_SPACE_COUNTS,
						  PAD_WIRE_SPACE_COUNTS, PAD_WIRE_SPACE_COUNTS, PAD_WIRE_SPACE_COUNTS };

bool bb_pad_kind_of(uint16_t vendor, uint16_t product, enum bb_pad_kind *out)
{
	static const struct {
		uint16_t vendor, product;
		enum bb_pad_kind kind;
	} known[] = {
		{ PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_RUMBLEPAD2_WIRED, BB_PAD_KIND_RUMBLEPAD2_WIRED },
		{ PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_RUMBLEPAD2_WIRELESS, BB_PAD_KIND_RUMBLEPAD2_WIRELESS },
		{ PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_SPACENAVIGATOR, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_SPACENAVIGATOR_NOTEBOOK, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_SPACEEXPLORER, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_SPACEPILOT_PRO, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_SPACEMOUSE_PRO, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_3DCONNEXION, PAD_WIRE_SPACEMOUSE_WIRELESS, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_3DCONNEXION, PAD_WIRE_SPACEMOUSE_RECEIVER, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_3DCONNEXION, PAD_WIRE_SPACEMOUSE_PRO_WIRELESS, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_3DCONNEXION, PAD_WIRE_SPACEMOUSE_PRO_RECEIVER, BB_PAD_KIND_SPACE },
		{ PAD_WIRE_VENDOR_3DCONNEXION, PAD_WIRE_SPACEMOUSE_COMPACT, BB_PAD_KIND_SPACE },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++)
		if (known[i].vendor == vendor && known[i].product == product) {
			*out = known[i].kind;
			return true;
		}
	return false;
}

const int32_t *bb_pad_kind_steps(enum bb_pad_kind kind)
{
	return kind == BB_PAD_KIND_SPACE ? space_steps : rumblepad_steps;
}

size_t bb_pad_kind_report_bytes(enum bb_pad_kind kind, uint8_t *id_out)
{
	*id_out = 0;
	if (kind == BB_PAD_KIND_SPACE) {
		*id_out = PAD_WIRE_SPACE_MOVE;
		return 7;
	}
	if (kind == BB_PAD_KIND_RUMBLEPAD2_WIRELESS) {
		*id_out = PAD_WIRE_RUMBLEPAD_ID;
		return 7; /* what is read of it */
	}
	return 6;
}

/* Both middles of a byte axis are neutral on some pad; the recorded ones rest at 0x80 (x) and 0x7F (y). */
static int32_t stick(uint8_t byte, int32_t centre)
{
	const int32_t v = byte - centre;

	return v < -127 ? -127 : v > 127 ? 127 : v;
}

static enum bb_pad_said decode_rumblepad(const uint8_t *b, struct bb_pad_sample *s)
{
	static const int32_t hat_x[9] = { 0, 1, 1, 1, 0, -1, -1, -1, 0 };
	static const int32_t hat_y[9] = { -1, -1, 0, 1, 1, 1, 0, -1, 0 }; /* up is negative, as on the sticks */
	const unsigned int hat = b[4] & 15;

	if (hat > PAD_WIRE_HAT_CENTRE)
		return BB_PAD_SAID_BAD;
	s->count[0] = stick(b[0], PAD_WIRE_RUMBLEPAD_CENTRE_X);
	s->count[1] = stick(b[1], PAD_WIRE_RUMBLEPAD_CENTRE_Y);
	s->count[2] = stick(b[2], PAD_WIRE_RUMBLEPAD_CENTRE_X);
	s->count[3] = stick(b[3], PAD_WIRE_RUMBLEPAD_CENTRE_Y);
	s->count[4] = hat_x[hat];
	s->count[5] = hat_y[hat];
	s->buttons = (uint32_t)b[4] >> 4 | (uint32_t)b[5] << 4;
	return BB_PAD_SAID_STATE;
}

static int32_t word(const uint8_t *b)
{
	return (int16_t)(uint16_t)(b[0] | (unsigned int)b[1] << 8);
}

static int32_t held(int32_t v)
{
	return v < -PAD_WIRE_SPACE_COUNTS  ? -PAD_WIRE_SPACE_COUNTS
	       : v > PAD_WIRE_SPACE_COUNTS ? PAD_WIRE_SPACE_COUNTS
					   : v;
}

/* The maker's frame is x right, y towards the user, z down; ours is x right, y up, z towards the user. Both are
 * right-handed, so a turn goes as a move does. */
static void decode_triple(const uint8_t *b, int32_t *out)
{
	out[0] = held(word(b));
	out[1] = held(-word(b + 4));
	out[2] = held(word(b + 2));
}

static enum bb_pad_said decode_space(const uint8_t *b, size_t n, struct bb_pad_sample *s, float *battery)
{
	if (n < 2)
		return BB_PAD_SAID_BAD;
	switch (b[0]) {
	case PAD_WIRE_SPACE_MOVE:
		if (n < 7)
			return BB_PAD_SAID_BAD;
		decode_triple(b + 1, s->count);
		if (n < 13)
			return BB_PAD_SAID_PART;
		decode_triple(b + 7, s->count + 3);
		return BB_PAD_SAID_STATE;
	case PAD_WIRE_SPACE_TURN:
		if (n < 7)
			return BB_PAD_SAID_BAD;
		decode_triple(b + 1, s->count + 3);
		return BB_PAD_SAID_STATE;
	case PAD_WIRE_SPACE_BUTTONS:
		s->buttons = 0;
		for (size_t i = 1; i < n && i <= 4; i++)
			s->buttons |= (uint32_t)b[i] << (8 * (i - 1));
		return BB_PAD_SAID_STATE;
	case PAD_WIRE_SPACE_BATTERY:
		if (b[1] > 100)
			return BB_PAD_SAID_BAD;
		*battery = (float)b[1] / 100;
		return BB_PAD_SAID_BATTERY;
	default: /* the family's newer members have reports of their own */
		return b[0] < PAD_WIRE_SPACE_LED ? BB_PAD_SAID_BAD : BB_PAD_SAID_NOTHING;
	}
}

enum bb_pad_said bb_pad_decode(enum bb_pad_kind kind, const uint8_t *report, size_t n, struct bb_pad_sample *sample,
			       float *battery)
{
	switch (kind) {
	case BB_PAD_KIND_RUMBLEPAD2_WIRED:
		return n < PAD_WIRE_RUMBLEPAD_BYTES ? BB_PAD_SAID_BAD : decode_rumblepad(report, sample);
	case BB_PAD_KIND_RUMBLEPAD2_WIRELESS:
		if (n < PAD_WIRE_RUMBLEPAD_BYTES || report[0] != PAD_WIRE_RUMBLEPAD_ID)
			return BB_PAD_SAID_BAD;
		return decode_rumblepad(report + 1, sample);
	case BB_PAD_KIND_SPACE:
		return decode_space(report, n, sample, battery);
	}
	return BB_PAD_SAID_BAD;
}

static uint8_t strength(float v)
{
	return (uint8_t)lroundf(fmaxf(0, fminf(1, v)) * 255);
}

void bb_pad_encode_rumble(enum bb_pad_kind kind, uint8_t report_id, float strong, float weak,
			  uint8_t out[BB_PAD_RUMBLE_BYTES])
{
	const uint8_t s = strength(strong), w = strength(weak);

	memset(out, 0, BB_PAD_RUMBLE_BYTES);
	out[0] = report_id;
	if (kind == BB_PAD_KIND_RUMBLEPAD2_WIRELESS) {
		out[1] = PAD_WIRE_RUMBLE_WIRELESS;
		out[3] = w;
		out[4] = s;
		return;
	}
	out[1] = s || w ? PAD_WIRE_RUMBLE_SET : PAD_WIRE_RUMBLE_STOP;
	out[3] = w;
	out[5] = s;
}
