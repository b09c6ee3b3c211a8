/*
 * hal/bus.h: the byte seams under the class drivers: I2C transfer, CAN frame, USB control/bulk/interrupt, HID report,
 * line event. drivers/bus_*.c and line_*.c implement them with one vendor library each; sim/bus_sim.c connects them to
 * a peer in this process. Class drivers hold no vendor call. Buffers are the caller's; a bus belongs to one thread;
 * deadlines are absolute ns on the bus's clock, and a call returns BB_TIMEOUT when one passes.
 */
#ifndef BB_HAL_BUS_H
#define BB_HAL_BUS_H

#include "hal/clock.h"

struct bb_i2c_message {
	uint16_t address; /* 7 bit */
	bool read;
	uint16_t n_bytes;
	uint8_t *bytes;
};
struct bb_i2c_bus;
struct bb_i2c_ops {
	/* All messages with repeated starts. BB_ERR_LOST: address not acknowledged; BB_ERR_IO: bus error; BB_ERR_BUSY:
	 * another owner has the wire, nothing was sent: try again, at free_ns where that lies ahead. */
	enum bb_status (*transfer)(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n);
	void (*close)(struct bb_i2c_bus *bus);
};
struct bb_i2c_bus {
	const struct bb_i2c_ops *ops;
	struct bb_clock *clk;
	int64_t free_ns; /* when the last transfer ends on the wire, where the clock does not run meanwhile; else 0 */
};

struct bb_can_frame {
	uint32_t id;      /* 11 or 29 bit */
	bool extended, remote, error;
	uint8_t n_bytes;  /* 0..8 */
	uint8_t bytes[8];
	int64_t at_ns;    /* reception, host time */
};
struct bb_can_bus;
struct bb_can_ops {
	enum bb_status (*send)(struct bb_can_bus *bus, const struct bb_can_frame *frame); /* BB_ERR_BUSY: queue full */
	enum bb_status (*receive)(struct bb_can_bus *bus, struct bb_can_frame *frame);    /* BB_TIMEOUT: none */
	void (*close)(struct bb_can_bus *bus);
};
struct bb_can_bus {
	const struct bb_can_ops *ops;
	struct bb_clock *clk;
};

struct bb_usb_setup {
	uint8_t request_type, request;
	uint16_t value, index, length;
};
struct bb_usb_bus;
struct bb_usb_ops {
	enum bb_status (*control)(struct bb_usb_bus *bus, const struct bb_usb_setup *setup, uint8_t *bytes,
	                          size_t *n_bytes, int64_t deadline_ns);
	/* Bulk or interrupt by the endpoint's own type; bit 7 of endpoint set = IN. BB_ERR_IO: stalled. */
	enum bb_status (*transfer)(struct bb_usb_bus *bus, uint8_t endpoint, uint8_t *bytes, size_t *n_bytes,
	                           int64_t deadline_ns);
	enum bb_status (*clear_halt)(struct bb_usb_bus *bus, uint8_t endpoint);
	void (*close)(struct bb_usb_bus *bus);
};
struct bb_usb_bus {
	const struct bb_usb_ops *ops;
	struct bb_clock *clk;
};

struct bb_hid_bus;
struct bb_hid_ops {
	enum bb_status (*read)(struct bb_hid_bus *bus, uint8_t *report, size_t cap, size_t *n_out, int64_t *at_ns);
	enum bb_status (*write)(struct bb_hid_bus *bus, const uint8_t *report, size_t n);
	enum bb_status (*descriptor)(struct bb_hid_bus *bus, uint8_t *bytes, size_t cap, size_t *n_out);
	void (*close)(struct bb_hid_bus *bus);
};
struct bb_hid_bus {
	const struct bb_hid_ops *ops;
	struct bb_clock *clk;
};

struct bb_line_event {
	int64_t at_ns;   /* kernel stamp */
	uint32_t seq;    /* 0 when the back end has none */
	bool level;      /* after the edge */
	bool overflow;   /* events were lost before this one */
};
struct bb_line_bus;
struct bb_line_ops {
	enum bb_status (*read)(struct bb_line_bus *bus, struct bb_line_event *events, size_t cap, size_t *n_out);
	enum bb_status (*set)(struct bb_line_bus *bus, bool level);
	void (*close)(struct bb_line_bus *bus);
};
struct bb_line_bus {
	const struct bb_line_ops *ops;
	struct bb_clock *clk;
};

#endif
