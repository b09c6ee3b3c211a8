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
	/* All messages with repeated starts. BB_ERR_LOST: address not acknowledged; BB_ERR_IO: bus error. */
	enum bb_status (*transfer)(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n);
	void (*close)(struct bb_i2c_bus *bus);
};
struct bb_i2c_bus {
	const struct bb_i2c_ops *ops;
	struct bb_clock *clk;
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
	/* The device starts afresh, the bus stays open. BB_TIMEOUT: under way, ask again; BB_ERR_LOST: gone by it. */
	enum bb_status (*reset)(struct bb_usb_bus *bus);
};
struct bb_usb_bus {
	const struct bb_usb_ops *ops;
	struct bb_clock *clk;
	int64_t arrived_ns; /* when the bytes of the last IN transfer reached this host */
};

/* Which device: serial "" takes the only one there is, and open() fills in what it found ("" when it has none). */
struct bb_usb_match {
	uint16_t vendor, product;
	uint8_t interface;
	char serial[64];
};
/* Where USB devices are found. open() is asked until it has an answer: BB_TIMEOUT is "under way, ask again" (a kernel
 * that just saw a plug can be busy for half a second); BB_ERR_LOST: none that matches; BB_ERR_BUSY: somebody else has
 * it, or several match; BB_ERR_IO: it is there and may not be used. `why` says it in words. The bus is the caller's to
 * close; close() ends an open that is under way. */
struct bb_usb_host {
	enum bb_status (*open)(struct bb_usb_host *host, struct bb_usb_match *match, struct bb_clock *clk,
	                       int64_t deadline_ns, struct bb_usb_bus **out);
	void (*close)(struct bb_usb_host *host);
	void *pending;
	char why[96];
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
