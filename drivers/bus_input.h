/*
 * drivers/bus_input.h: opens a hal/bus_input.h bus on an evdev node of this machine (libevdev). One thread a bus.
 */
#ifndef BB_DRIVERS_BUS_INPUT_H
#define BB_DRIVERS_BUS_INPUT_H

#include "hal/bus_input.h"

/* By path where wanted->path is given, else the first node with that vendor, product and (if given) serial that has
 * axes. BB_ERR_LOST: none is there (1562); BB_ERR_IO: it may not be used (1563). */
BB_MUST_CHECK enum bb_status bb_bus_input_open(const struct bb_input_identity *wanted, struct bb_clock *clk,
					       struct bb_input_bus **out, struct bb_input_identity *found,
					       struct bb_error *err);

#endif
