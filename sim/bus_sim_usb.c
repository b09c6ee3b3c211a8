/* sim/bus_sim_usb.c: see sim/bus_sim_usb.h. */
#include "sim/bus_sim_usb.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct bus {
	struct bb_usb_bus base;
	struct bus_sim_usb *usb;
	size_t port;
	uint64_t plug;
};

static struct sim_usb_device *device_of(struct bus *b)
{
	struct sim_usb_device *dev = b->usb->port[b->port].device;

	if (!dev || b->usb->port[b->port].plug != b->plug)
		return NULL;
	if (dev->ops->present(dev))
		return dev;
	b->plug = 0; /* a device that went away by itself is not the same when it returns */
	return NULL;
}

static enum bb_status status_of(struct bb_usb_bus *bus, struct sim_usb_device *dev, int moved, size_t *n_bytes)
{
	*n_bytes = moved > 0 ? (size_t)moved : 0;
	bus->arrived_ns = dev->in_at_ns ? dev->in_at_ns : bb_clock_now_ns(bus->clk);
	if (moved >= 0)
		return BB_OK;
	return moved == SIM_USB_NAK ? BB_TIMEOUT : moved == SIM_USB_GONE ? BB_ERR_LOST : BB_ERR_IO;
}

static enum bb_status control(struct bb_usb_bus *bus, const struct bb_usb_setup *setup, uint8_t *bytes,
                              size_t *n_bytes, int64_t deadline_ns)
{
	struct sim_usb_device *dev = device_of(bb_container_of(bus, struct bus, base));

	(void)deadline_ns;
	if (!dev)
		return BB_ERR_LOST;
	return status_of(bus, dev, sim_usb_control(dev, setup, bytes, *n_bytes), n_bytes);
}

static enum bb_status transfer(struct bb_usb_bus *bus, uint8_t endpoint, uint8_t *bytes, size_t *n_bytes,
                               int64_t deadline_ns)
{
	struct sim_usb_device *dev = device_of(bb_container_of(bus, struct bus, base));

	(void)deadline_ns;
	if (!dev)
		return BB_ERR_LOST;
	return status_of(bus, dev, sim_usb_transfer(dev, endpoint, bytes, *n_bytes), n_bytes);
}

static enum bb_status clear_halt(struct bb_usb_bus *bus, uint8_t endpoint)
{
	const struct bb_usb_setup clear = { .request_type = 0x02, .request = 1, .index = endpoint };
	size_t n = 0;

	return control(bus, &clear, NULL, &n, 0);
}

static enum bb_status reset(struct bb_usb_bus *bus)
{
	struct sim_usb_device *dev = device_of(bb_container_of(bus, struct bus, base));

	if (!dev)
		return BB_ERR_LOST;
	sim_usb_reset(dev);
	dev->configuration = dev->config[5];
	return BB_OK;
}

static void bus_close(struct bb_usb_bus *bus)
{
	struct bus *b = bb_container_of(bus, struct bus, base);

	if (b->usb->port[b->port].claimed == b)
		b->usb->port[b->port].claimed = NULL;
	free(b);
}

static const struct bb_usb_ops ops = { control, transfer, clear_halt, bus_close, reset };

/* The serial number as a host reads it: from the string descriptor. */
static void read_serial(struct sim_usb_device *dev, char *out, size_t cap)
{
	const struct bb_usb_setup get = { .request_type = 0x80, .request = 6,
		                          .value = (uint16_t)(0x0300 | dev->device[16]), .index = 0x0409,
		                          .length = 255 };
	uint8_t bytes[255];
	const int n = dev->device[16] ? sim_usb_control(dev, &get, bytes, sizeof(bytes)) : 0;
	size_t length = 0;

	for (int i = 2; i + 1 < n && length + 1 < cap; i += 2)
		out[length++] = (char)bytes[i];
	out[length] = '\0';
}

static bool fits(struct sim_usb_device *dev, const struct bb_usb_match *match, char serial[static 64])
{
	if (!dev || !dev->ops->present(dev) || sim_usb_vendor(dev) != match->vendor ||
	    sim_usb_product(dev) != match->product)
		return false;
	read_serial(dev, serial, 64);
	return !*match->serial || !strcmp(serial, match->serial);
}

static enum bb_status host_open(struct bb_usb_host *host, struct bb_usb_match *match, struct bb_clock *clk,
                                int64_t deadline_ns, struct bb_usb_bus **out)
{
	struct bus_sim_usb *usb = bb_container_of(host, struct bus_sim_usb, host);
	char serial[64], found[64] = "";
	size_t at = BUS_SIM_USB_PORTS, n = 0;

	(void)deadline_ns;
	*out = NULL;
	for (size_t i = 0; i < BUS_SIM_USB_PORTS; i++)
		if (fits(usb->port[i].device, match, serial)) {
			at = i;
			n++;
			memcpy(found, serial, sizeof(found));
		}
	if (n)
		snprintf(host->why, sizeof(host->why), "%zu alike: say which by serial", n);
	else
		snprintf(host->why, sizeof(host->why), "no %04x:%04x on the bus", match->vendor, match->product);
	if (n != 1)
		return n ? BB_ERR_BUSY : BB_ERR_LOST;
	if (usb->port[at].claimed) {
		snprintf(host->why, sizeof(host->why), "another program has it");
		return BB_ERR_BUSY;
	}
	struct bus *b = calloc(1, sizeof(*b));
	if (!b)
		return BB_ERR_NOMEM;
	usb->port[at].claimed = b;
	*b = (struct bus){ { .ops = &ops, .clk = clk }, usb, at, usb->port[at].plug };
	memcpy(match->serial, found, sizeof(found));
	usb->port[at].device->configuration = usb->port[at].device->config[5]; /* as the kernel does */
	usb->n_opens++;
	*out = &b->base;
	return BB_OK;
}

static void host_close(struct bb_usb_host *host)
{
	(void)host;
}

void bus_sim_usb_init(struct bus_sim_usb *usb)
{
	memset(usb, 0, sizeof(*usb));
	usb->host = (struct bb_usb_host){ .open = host_open, .close = host_close };
}

bool bus_sim_usb_plug(struct bus_sim_usb *usb, size_t port, struct sim_usb_device *device)
{
	if (port >= BUS_SIM_USB_PORTS || usb->port[port].device)
		return false;
	usb->port[port].device = device;
	usb->port[port].claimed = NULL;
	usb->port[port].plug = ++usb->n_plugs;
	sim_usb_reset(device);
	return true;
}

void bus_sim_usb_unplug(struct bus_sim_usb *usb, size_t port)
{
	if (port < BUS_SIM_USB_PORTS)
		usb->port[port].device = NULL;
}
