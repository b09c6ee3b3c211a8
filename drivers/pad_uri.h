/*
 * drivers/pad_uri.h: the URI of a real gamepad: "hid:046d:c219?serial=A1&gap_ms=200", "usb:045e:0719?slot=2",
 * "evdev:/dev/input/event3?mapping=pads.txt". Stateless.
 */
#ifndef BB_DRIVERS_PAD_URI_H
#define BB_DRIVERS_PAD_URI_H

#include "hal/device.h"

struct bb_pad_uri {
	bool has_identity; /* "vvvv:pppp", hexadecimal */
	uint16_t vendor, product;
	char path[96]; /* otherwise */
	char serial[64];
	char mapping[64]; /* a file of SDL_GameControllerDB lines; "" = none */
	int64_t slot;     /* 1..4 of a receiver */
	int64_t gap_ns;   /* silence with a deflected stick longer than this is a fault; BB_NEVER: gap_ms=0 */
};

BB_MUST_CHECK enum bb_status bb_pad_uri_read(struct bb_device *dev, const struct bb_open *open, struct bb_pad_uri *out);
/* 1501 into the log and last_error; returns BB_ERR_CONFIG. */
enum bb_status bb_pad_uri_fail(struct bb_device *dev, const struct bb_open *open, const char *what);

#endif
