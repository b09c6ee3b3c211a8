/*
 * hal/bus_input.h: the seam under drivers that read the kernel's input events: drivers/bus_input.c implements it with
 * libevdev, sim/bus_sim_input.c with a peer in this process. Codes are the kernel's own. As hal/bus.h otherwise: a bus
 * belongs to one thread, nothing waits.
 */
#ifndef BB_HAL_BUS_INPUT_H
#define BB_HAL_BUS_INPUT_H

#include "hal/clock.h"

struct bb_input_event {
	int64_t at_ns; /* the kernel's stamp as host time */
	uint16_t type, code;
	int32_t value;
};

struct bb_input_identity {
	uint16_t bus, vendor, product, version;
	char serial[64]; /* "": it has none */
	char path[64];   /* "/dev/input/event3" */
};

struct bb_input_range {
	int32_t least, most, value; /* value: at opening */
};

struct bb_input_bus;
struct bb_input_ops {
	/* Events in order, packets closed by SYN_REPORT. After an overrun the whole state comes once more. BB_TIMEOUT:
	 * none; BB_ERR_LOST: unplugged. */
	enum bb_status (*read)(struct bb_input_bus *bus, struct bb_input_event *events, size_t cap, size_t *n_out);
	bool (*has)(struct bb_input_bus *bus, unsigned int type, unsigned int code);
	bool (*range)(struct bb_input_bus *bus, unsigned int axis, struct bb_input_range *out);
	/* Both 0: off. BB_ERR_UNSUPPORTED: it has no motors. */
	enum bb_status (*rumble)(struct bb_input_bus *bus, uint16_t strong, uint16_t weak);
	void (*close)(struct bb_input_bus *bus);
};
struct bb_input_bus {
	const struct bb_input_ops *ops;
	struct bb_clock *clk;
};

#endif
