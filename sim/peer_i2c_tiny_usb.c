/* sim/peer_i2c_tiny_usb.c: see sim/peer_i2c_tiny_usb.h. */
#include "sim/peer_i2c_tiny_usb.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum request { ECHO, GET_FUNCTIONS, SET_DELAY, GET_STATUS, IO, IO_BEGIN = 5, IO_END = 6, IO_BEGIN_END = 7, END = 2 };
enum bus_status { IDLE, ACKNOWLEDGED, NOT_ACKNOWLEDGED };

#define FLAG_READ 0x0001
#define BITS_A_BYTE 9
#define FUNCTIONS 0x8EFF0001u /* I2C and what SMBus makes of it */

struct peer_i2c_tiny_usb {
	struct sim_usb_device usb;
	char serial[BB_ID_MAX];
	bool plugged, mute;
	uint32_t nak, stall;
	uint16_t delay_us;
	enum bus_status status;
	size_t n;
	struct sim_i2c_target target[PEER_I2C_TARGETS];

	struct peer_ddcci *monitor;
	const struct bb_clock *clk;
	int64_t from_ns, due_ns; /* of the message on the wire; due_ns BB_NEVER: none */
	struct bb_usb_setup under_way;
};

static struct peer_i2c_tiny_usb *own(struct sim_usb_device *dev)
{
	return bb_container_of(dev, struct peer_i2c_tiny_usb, usb);
}

static enum bus_status ask_monitor(struct peer_i2c_tiny_usb *p, uint8_t address, bool read, uint8_t *bytes, size_t n)
{
	const enum peer_wire wire =
		read ? peer_ddcci_read(p->monitor, address, bytes, n, p->from_ns)
		     : peer_ddcci_write(p->monitor, address, bytes, n, p->from_ns, p->due_ns);

	switch (wire) {
	case PEER_ACK:
		return ACKNOWLEDGED;
	case PEER_NO_ACK:
		break;
	case PEER_ERROR:
		return IDLE;
	case PEER_HELD: /* it samples a line that is low: an acknowledge, and zeros */
		if (read)
			memset(bytes, 0, n);
		return ACKNOWLEDGED;
	}
	return NOT_ACKNOWLEDGED;
}

static enum bus_status ask(struct peer_i2c_tiny_usb *p, uint8_t address, bool read, uint8_t *bytes, size_t n)
{
	enum bus_status status = p->monitor ? ask_monitor(p, address, read, bytes, n) : NOT_ACKNOWLEDGED;

	for (size_t i = 0; i < p->n && status == NOT_ACKNOWLEDGED; i++) {
		const struct sim_i2c_target *t = &p->target[i];
		if (read ? t->read(t->ctx, address, bytes, n) : t->write(t->ctx, address, bytes, n))
			status = ACKNOWLEDGED;
	}
	return status;
}

/* Is the message still on the wire? The host asks again and again with the same setup. */
static bool on_the_wire(struct peer_i2c_tiny_usb *p, const struct bb_usb_setup *setup, size_t n)
{
	const int64_t now_ns = bb_clock_now_ns(p->clk);
	const struct bb_usb_setup *u = &p->under_way;

	if (p->due_ns == BB_NEVER || setup->request != u->request || setup->value != u->value ||
	    setup->index != u->index || setup->length != u->length) {
		p->under_way = *setup;
		p->from_ns = now_ns;
		p->due_ns = now_ns + (int64_t)(1 + n) * BITS_A_BYTE * p->delay_us * 1000;
	}
	return now_ns < p->due_ns;
}

/* Of the flags only the direction matters: the kernel sets others too. A message nobody acknowledges still moves its
 * full length, and the status that is asked for next says so. */
static int message(struct peer_i2c_tiny_usb *p, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n)
{
	const bool read = (setup->value & FLAG_READ) != 0;
	const bool in = (setup->request_type & 0x80) != 0;
	enum bus_status status = NOT_ACKNOWLEDGED;

	if (setup->index > 0x7F || read != in)
		return SIM_USB_STALL;
	if (p->stall) {
		p->stall--;
		return SIM_USB_STALL;
	}
	if (p->clk && on_the_wire(p, setup, n))
		return SIM_USB_NAK;
	if (read)
		memset(bytes, 0xFF, n); /* a bus nobody drives reads ones */
	if (p->nak)
		p->nak--;
	else
		status = ask(p, (uint8_t)setup->index, read, bytes, n);
	p->due_ns = BB_NEVER;
	if (p->monitor && (status != ACKNOWLEDGED || (setup->request & END)))
		peer_ddcci_stop(p->monitor);
	if (status == IDLE)
		return SIM_USB_STALL;
	p->status = status;
	return (int)n;
}

static int give(uint8_t *bytes, size_t n, const uint8_t *from, size_t n_from)
{
	const size_t given = n < n_from ? n : n_from;

	memcpy(bytes, from, given);
	return (int)given;
}

static int control(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n)
{
	struct peer_i2c_tiny_usb *p = own(dev);
	const bool in = (setup->request_type & 0x80) != 0;
	const uint32_t f = FUNCTIONS;

	if (p->mute)
		return SIM_USB_NAK;
	if (setup->request >= IO && setup->request <= IO_BEGIN_END)
		return message(p, setup, bytes, n);
	switch (setup->request) {
	case ECHO:
		return in ? give(bytes, n, (uint8_t[]){ (uint8_t)setup->value, (uint8_t)(setup->value >> 8) }, 2)
		          : SIM_USB_STALL;
	case GET_FUNCTIONS:
		return in ? give(bytes, n,
		                 (uint8_t[]){ (uint8_t)f, (uint8_t)(f >> 8), (uint8_t)(f >> 16), (uint8_t)(f >> 24) }, 4)
		          : SIM_USB_STALL;
	case SET_DELAY:
		p->delay_us = setup->value ? setup->value : 10;
		return 0;
	case GET_STATUS:
		return in ? give(bytes, n, (uint8_t[]){ (uint8_t)p->status }, 1) : SIM_USB_STALL;
	default:
		return SIM_USB_STALL;
	}
}

static void reset(struct sim_usb_device *dev)
{
	own(dev)->status = IDLE;
	own(dev)->delay_us = 10;
	own(dev)->due_ns = BB_NEVER;
}

static bool present(struct sim_usb_device *dev)
{
	return own(dev)->plugged;
}

static const struct sim_usb_ops ops = { control, sim_usb_no_in, sim_usb_no_out, reset, present };

static const uint8_t device_descriptor[18] = { 18, 1, 0x10, 0x01, 0xFF, 0, 0, 8, 0x40, 0x1C, 0x34, 0x05, 0x05, 0x02,
	                                       1, 2, 3, 1 };
static const uint8_t config_descriptor[18] = {
	9, 2, 18, 0, 1, 1, 0, 0x80, 50, /* one interface, 100 mA */
	9, 4, 0, 0, 0, 0, 0, 0, 0,      /* no endpoint but the first */
};

enum bb_status peer_i2c_tiny_usb_create(const char *serial, struct peer_i2c_tiny_usb **out)
{
	struct peer_i2c_tiny_usb *p = calloc(1, sizeof(*p));

	*out = p;
	if (!p)
		return BB_ERR_NOMEM;
	p->plugged = true;
	snprintf(p->serial, sizeof(p->serial), "%s", serial);
	p->usb = (struct sim_usb_device){ .ops = &ops,
		                          .speed = SIM_USB_LOW,
		                          .device = device_descriptor,
		                          .config = config_descriptor,
		                          .n_config = sizeof(config_descriptor),
		                          .string = { NULL, "blackburst", "i2c-tiny-usb", p->serial } };
	reset(&p->usb);
	return BB_OK;
}

void peer_i2c_tiny_usb_destroy(struct peer_i2c_tiny_usb *p)
{
	free(p);
}

struct sim_usb_device *peer_i2c_tiny_usb_device(struct peer_i2c_tiny_usb *p)
{
	return &p->usb;
}

bool peer_i2c_tiny_usb_add(struct peer_i2c_tiny_usb *p, const struct sim_i2c_target *target)
{
	if (p->n == PEER_I2C_TARGETS)
		return false;
	p->target[p->n++] = *target;
	return true;
}

void peer_i2c_tiny_usb_monitor(struct peer_i2c_tiny_usb *p, struct peer_ddcci *monitor, const struct bb_clock *clk)
{
	p->monitor = monitor;
	p->clk = clk;
}

int64_t peer_i2c_tiny_usb_due_ns(const struct peer_i2c_tiny_usb *p)
{
	return p->due_ns;
}

uint16_t peer_i2c_tiny_usb_delay_us(const struct peer_i2c_tiny_usb *p)
{
	return p->delay_us;
}

void peer_i2c_tiny_usb_world_plug(struct peer_i2c_tiny_usb *p, bool plugged)
{
	p->plugged = plugged;
}

void peer_i2c_tiny_usb_world_nak(struct peer_i2c_tiny_usb *p, uint32_t messages)
{
	p->nak = messages;
}

void peer_i2c_tiny_usb_world_stall(struct peer_i2c_tiny_usb *p, uint32_t messages)
{
	p->stall = messages;
}

void peer_i2c_tiny_usb_world_mute(struct peer_i2c_tiny_usb *p, bool mute)
{
	p->mute = mute;
}
