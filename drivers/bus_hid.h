/*
 * drivers/bus_hid.h: opens a hal/bus.h HID bus on a device of this machine (hidapi over hidraw nodes). Reading never
 * waits. One thread a bus.
 */
#ifndef BB_DRIVERS_BUS_HID_H
#define BB_DRIVERS_BUS_HID_H

#include "hal/bus.h"

#define BB_HID_SERIAL_MAX 64

struct bb_hid_identity {
	uint16_t vendor, product;
	char serial[BB_HID_SERIAL_MAX]; /* "": any; of a device found: what it said, printable ASCII */
	char path[64];                  /* "": any; "/dev/hidraw3" */
};

/* The first device that fits. BB_ERR_LOST: none is there (1562); BB_ERR_IO: it may not be used (1563). */
BB_MUST_CHECK enum bb_status bb_bus_hid_open(const struct bb_hid_identity *wanted, struct bb_clock *clk,
					     struct bb_hid_bus **out, struct bb_hid_identity *found,
					     struct bb_error *err);

#endif
