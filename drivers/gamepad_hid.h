/*
 * drivers/gamepad_hid.h: RumblePad 2 (wired, wireless) and the SpaceMouse family over HID reports. URI
 * "hid:046d:c219?serial=...&gap_ms=200"; gap_ms=0: a still stick may be silent for ever. After an unplug the same
 * serial is looked for again, on whatever port. A descriptor that cannot be, or is not that model's, is refused.
 * States and names of faults: drivers/pad_core.h. One thread.
 */
#ifndef BB_DRIVERS_GAMEPAD_HID_H
#define BB_DRIVERS_GAMEPAD_HID_H

#include "drivers/bus_hid.h"
#include "drivers/pad_codec.h"

struct bb_hid_port { /* where buses come from */
	enum bb_status (*open)(void *ctx, const struct bb_hid_identity *wanted, struct bb_clock *clk,
			       struct bb_hid_bus **out, struct bb_hid_identity *found, struct bb_error *err);
	void *ctx;
};

struct bb_gamepad_hid {
	struct bb_gamepad base;
	struct bb_pad_core core;
	struct bb_hid_port port;
	const struct bb_log *log;
	struct bb_hid_identity wanted;
	struct bb_hid_bus *bus;
	enum bb_pad_kind kind;
	struct bb_pad_sample state; /* as the device says it */
	bool has_part;              /* its move is known, its turn is due */
	int64_t part_ns;
	uint8_t rumble_id;
	bool rumbling;
};

extern const struct bb_gamepad_driver bb_gamepad_hid_driver;
extern const struct bb_gamepad_ops bb_gamepad_hid_ops;

/* What ops->open does, with buses from elsewhere: a test's own ops table has an open that calls this. */
BB_MUST_CHECK enum bb_status bb_gamepad_hid_open_on(struct bb_gamepad *g, const struct bb_open *open,
						    const struct bb_hid_port *port);
const struct bb_pad_core *bb_gamepad_hid_core(const struct bb_gamepad *g);

#endif
