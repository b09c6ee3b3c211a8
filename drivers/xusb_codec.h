/*
 * drivers/xusb_codec.h: packets of the Xbox 360 wireless receiver to counts and back. Pure functions; every byte is
 * hostile. Buttons: A B X Y LB RB back start guide L3 R3; up is negative on sticks and cross, as on every other pad.
 */
#ifndef BB_DRIVERS_XUSB_CODEC_H
#define BB_DRIVERS_XUSB_CODEC_H

#include "drivers/pad_core.h"

enum bb_xusb_said {
	BB_XUSB_SAID_STATE,
	BB_XUSB_SAID_PRESENT, /* a pad is in this slot; the same packet tells of headsets */
	BB_XUSB_SAID_ABSENT,
	BB_XUSB_SAID_BATTERY,
	BB_XUSB_SAID_LINK, /* serial number, LED status, headset: of no interest */
	BB_XUSB_SAID_BAD,
};

struct bb_xusb_packet {
	struct bb_pad_sample sample;
	uint8_t trigger[2]; /* left, right; no axis of hal/gamepad.h */
	float battery;      /* 0..1: the level byte of 255, recorded values are A2 and E0 */
};

extern const int32_t bb_xusb_steps[BB_PAD_AXES];
enum bb_xusb_said bb_xusb_decode(const uint8_t *packet, size_t n, struct bb_xusb_packet *out);

#define BB_XUSB_COMMAND_BYTES 12
void bb_xusb_encode_inquiry(uint8_t out[BB_XUSB_COMMAND_BYTES]);
void bb_xusb_encode_rumble(float strong, float weak, uint8_t out[BB_XUSB_COMMAND_BYTES]);
/* 0 off, 1 all blink, 2..5 one flashes and stays, 6..9 one on, 10 and above turn. */
void bb_xusb_encode_led(unsigned int mode, uint8_t out[BB_XUSB_COMMAND_BYTES]);
void bb_xusb_encode_power_off(uint8_t out[BB_XUSB_COMMAND_BYTES]);

#endif
