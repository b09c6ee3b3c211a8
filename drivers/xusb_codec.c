/* drivers/xusb_codec.c: see drivers/xusb_codec.h. */
#include "drivers/xusb_codec.h"

#include <math.h>
#include <string.h>

#include "drivers/pad_wire.h"

const int32_t bb_xusb_steps[BB_PAD_AXES] = { 32767, 32767, 32767, 32767, 1, 1 };

static int32_t word(const uint8_t *b)
{
	const int32_t v = (int16_t)(uint16_t)(b[0] | (unsigned int)b[1] << 8);

	return v < -32767 ? -32767 : v;
}

static int32_t either(uint8_t bits, uint8_t minus, uint8_t plus)
{
	return ((bits & plus) != 0) - ((bits & minus) != 0);
}

/* Bits of bytes 6 (high half of the word) and 7 in the order of the buttons. */
static uint32_t buttons(uint8_t six, uint8_t seven)
{
	static const uint16_t order[11] = { 0x10, 0x20, 0x40, 0x80, 0x01, 0x02, 0x2000, 0x1000, 0x04, 0x4000, 0x8000 };
	const unsigned int bits = (unsigned int)six << 8 | seven;
	uint32_t out = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(order); i++)
		if (bits & order[i])
			out |= 1u << i;
	return out;
}

static enum bb_xusb_said decode_state(const uint8_t *b, struct bb_xusb_packet *out)
{
	const uint8_t *sticks = b + PAD_WIRE_XBOX_AT_STICKS;

	if (b[4] != 0)
		return BB_XUSB_SAID_BAD;
	out->sample = (struct bb_pad_sample){
		.count = { word(sticks), -word(sticks + 2), word(sticks + 4), -word(sticks + 6),
			   either(b[PAD_WIRE_XBOX_AT_BITS], 0x04, 0x08), either(b[PAD_WIRE_XBOX_AT_BITS], 0x01, 0x02) },
		.buttons = buttons(b[PAD_WIRE_XBOX_AT_BITS], b[PAD_WIRE_XBOX_AT_BITS + 1]),
	};
	memcpy(out->trigger, b + PAD_WIRE_XBOX_AT_TRIGGERS, sizeof(out->trigger));
	return BB_XUSB_SAID_STATE;
}

enum bb_xusb_said bb_xusb_decode(const uint8_t *b, size_t n, struct bb_xusb_packet *out)
{
	if (n == PAD_WIRE_XBOX_STATUS_BYTES) {
		if (b[0] != PAD_WIRE_XBOX_STATUS || b[1] & ~(PAD_WIRE_XBOX_STATUS_PAD | PAD_WIRE_XBOX_STATUS_HEADSET))
			return BB_XUSB_SAID_BAD;
		return b[1] & PAD_WIRE_XBOX_STATUS_PAD ? BB_XUSB_SAID_PRESENT : BB_XUSB_SAID_ABSENT;
	}
	if (n != PAD_WIRE_XBOX_BYTES || b[0] != 0)
		return BB_XUSB_SAID_BAD;
	if (b[1] == PAD_WIRE_XBOX_HAS_PAD_DATA)
		return decode_state(b, out);
	if (b[1] == 0 && b[2] == 0 && b[3] == PAD_WIRE_XBOX_BATTERY) {
		out->battery = (float)b[4] / 255;
		return BB_XUSB_SAID_BATTERY;
	}
	return BB_XUSB_SAID_LINK;
}

static uint8_t strength(float v)
{
	return (uint8_t)lroundf(fmaxf(0, fminf(1, v)) * 255);
}

static void command(uint8_t out[BB_XUSB_COMMAND_BYTES], uint8_t b0, uint8_t b1, uint8_t b2, uint8_t b3)
{
	memset(out, 0, BB_XUSB_COMMAND_BYTES);
	out[0] = b0;
	out[1] = b1;
	out[2] = b2;
	out[3] = b3;
}

void bb_xusb_encode_inquiry(uint8_t out[BB_XUSB_COMMAND_BYTES])
{
	command(out, PAD_WIRE_XBOX_STATUS, 0x00, 0x0F, 0xC0);
}

void bb_xusb_encode_rumble(float strong, float weak, uint8_t out[BB_XUSB_COMMAND_BYTES])
{
	command(out, 0x00, 0x01, 0x0F, 0xC0);
	out[5] = strength(strong);
	out[6] = strength(weak);
}

void bb_xusb_encode_led(unsigned int mode, uint8_t out[BB_XUSB_COMMAND_BYTES])
{
	command(out, 0x00, 0x00, 0x08, (uint8_t)(0x40 + mode % 0x0E));
}

void bb_xusb_encode_power_off(uint8_t out[BB_XUSB_COMMAND_BYTES])
{
	command(out, 0x00, 0x00, 0x08, 0xC0);
}
