/*
 * drivers/pad_codec.h: bytes of HID gamepads and 6-DOF controllers to counts and back: Logitech RumblePad 2, wired
 * (046D:C218) and wireless (046D:C219), and the 3Dconnexion family. Pure functions; every byte is hostile.
 */
#ifndef BB_DRIVERS_PAD_CODEC_H
#define BB_DRIVERS_PAD_CODEC_H

#include "drivers/pad_core.h"

enum bb_pad_kind { BB_PAD_KIND_RUMBLEPAD2_WIRED, BB_PAD_KIND_RUMBLEPAD2_WIRELESS, BB_PAD_KIND_SPACE };

/* What drives a USB identity; false: nothing here does. */
bool bb_pad_kind_of(uint16_t vendor, uint16_t product, enum bb_pad_kind *out);
/* Counts from neutral to the end of each axis. */
const int32_t *bb_pad_kind_steps(enum bb_pad_kind kind);
/* Least bytes of the report that carries the axes, with its id; *id_out is 0 when reports have none. */
size_t bb_pad_kind_report_bytes(enum bb_pad_kind kind, uint8_t *id_out);

enum bb_pad_said {
	BB_PAD_SAID_STATE, /* the sample is complete */
	BB_PAD_SAID_PART,  /* half of it: the turning follows in a report of its own */
	BB_PAD_SAID_BATTERY,
	BB_PAD_SAID_NOTHING, /* a report of that device which says nothing about the hand */
	BB_PAD_SAID_BAD,
};
/* One input report. sample is the device's last state and is updated by what the report says; left alone when it is
 * bad. battery 0..1 is written with BB_PAD_SAID_BATTERY only. */
enum bb_pad_said bb_pad_decode(enum bb_pad_kind kind, const uint8_t *report, size_t n, struct bb_pad_sample *sample,
			       float *battery);

#define BB_PAD_RUMBLE_BYTES 8 /* report id first, as hidapi and hidraw want it; 0: the device has none */
void bb_pad_encode_rumble(enum bb_pad_kind kind, uint8_t report_id, float strong, float weak,
			  uint8_t out[BB_PAD_RUMBLE_BYTES]);

#endif
