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
	 * another owner has the wire, or this transfer is under way: ask for the same again, at free_ns where that lies
	 * ahead. Whoever asks for another meanwhile gives up the first. */
	enum bb_status (*transfer)(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n);
	void (*close)(struct bb_i2c_bus *bus);
};
struct bb_i2c_bus {
	const struct bb_i2c_ops *ops;
	struct bb_clock *clk;
	int64_t free_ns; /* when the last transfer ends on the wire, where the clock does not run meanwhile; else 0 */
	uint32_t n_reopened; /* how often the adapter was another than the time before: unplugged and plugged in again */
};

struct bb_can_frame {
	uint32_t id;      /* 11 or 29 bit */
	bool extended, remote, error;
	uint8_t n_bytes;  /* 0..8 */
	uint8_t bytes[8];
	int64_t at_ns;    /* reception: the end of the frame, host time */
};
/* An error frame's id holds its classes and bytes what SocketCAN puts there (drivers/canopen_wire.h names them). */
struct bb_can_bus;
struct bb_can_ops {
	enum bb_status (*send)(struct bb_can_bus *bus, const struct bb_can_frame *frame); /* BB_ERR_BUSY: queue full */
	/* BB_TIMEOUT: none. BB_ERR_LOST from either: the interface is down or gone; ask again, it may come back. */
	enum bb_status (*receive)(struct bb_can_bus *bus, struct bb_can_frame *frame);
	/* Back on the bus after bus-off. BB_ERR_UNSUPPORTED: not ours to do, the link restarts by itself or never. */
	enum bb_status (*restart)(struct bb_can_bus *bus);
	void (*close)(struct bb_can_bus *bus);
};
struct bb_can_bus {
	const struct bb_can_ops *ops;
	struct bb_clock *clk;
	int64_t bitrate; /* bits per second, 0: not known */
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
	/* BB_TIMEOUT: none; BB_ERR_LOST: the chip is gone, errno says how. */
	enum bb_status (*read)(struct bb_line_bus *bus, struct bb_line_event *events, size_t cap, size_t *n_out);
	enum bb_status (*set)(struct bb_line_bus *bus, bool level); /* BB_ERR_UNSUPPORTED: no output line */
	void (*close)(struct bb_line_bus *bus);
};
struct bb_line_bus {
	const struct bb_line_ops *ops;
	struct bb_clock *clk;
	int fd;          /* readable while events wait; -1 when the back end has none */
};

/* One input line with both edges and, if out >= 0, one output line of the same chip that begins low. */
struct bb_line_request {
	char chip[96];   /* "/dev/gpiochip0" */
	uint32_t line;
	int32_t out;
	uint32_t n_buffer; /* events the kernel should keep, at least */
	bool active_low;
	enum { BB_LINE_BIAS_AS_IS, BB_LINE_BIAS_OFF, BB_LINE_BIAS_UP, BB_LINE_BIAS_DOWN } bias;
};
/* Opens a line bus again and again: how a class driver is given its bus. On failure *out is NULL, errno holds the
 * cause and err says it in words with what to do about it. */
struct bb_line_opener {
	enum bb_status (*open)(void *ctx, const struct bb_line_request *request, struct bb_clock *clk,
	                       struct bb_line_bus **out, struct bb_error *err);
	void *ctx;
};

#endif
