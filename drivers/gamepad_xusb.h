/*
 * drivers/gamepad_xusb.h: one pad of an Xbox 360 wireless receiver over USB interrupt endpoints. URI
 * "usb:045e:0719?slot=2&gap_ms=200": slots 1..4, each handle claims its own interface. A pad that is off is LOST while
 * its receiver stays open; it comes back by itself. States and names of faults: drivers/pad_core.h. One thread.
 */
#ifndef BB_DRIVERS_GAMEPAD_XUSB_H
#define BB_DRIVERS_GAMEPAD_XUSB_H

#include "drivers/xusb_codec.h"
#include "hal/bus.h"

struct bb_gamepad_xusb {
	struct bb_gamepad base;
	struct bb_pad_core core;
	struct bb_usb_host real, *host;
	const struct bb_log *log;
	struct bb_usb_match match;
	struct bb_usb_bus *bus;
	uint8_t endpoint;  /* of its slot, OUT */
	unsigned int slot; /* 1..4 */
	bool asked, present;
	int64_t asked_ns;
	bool rumbling;
};

extern const struct bb_gamepad_driver bb_gamepad_xusb_driver;
extern const struct bb_gamepad_ops bb_gamepad_xusb_ops;

/* What ops->open does, on another host: a test's own ops table has an open that calls this. */
BB_MUST_CHECK enum bb_status bb_gamepad_xusb_open_on(struct bb_gamepad *g, const struct bb_open *open,
						     struct bb_usb_host *host);
const struct bb_pad_core *bb_gamepad_xusb_core(const struct bb_gamepad *g);

#endif
