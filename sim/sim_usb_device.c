/* sim/sim_usb_device.c: see sim/sim_usb_device.h. */
#include "sim/sim_usb_device.h"

#include <string.h>

#define TYPE_STANDARD 0x00
#define TYPE_MASK 0x60
#define TO_MASK 0x1F
#define TO_DEVICE 0
#define TO_INTERFACE 1
#define TO_ENDPOINT 2

int sim_usb_no_control(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n)
{
	(void)dev;
	(void)setup;
	(void)bytes;
	(void)n;
	return SIM_USB_STALL;
}

int sim_usb_no_in(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap)
{
	(void)dev;
	(void)endpoint;
	(void)bytes;
	(void)cap;
	return SIM_USB_STALL;
}

int sim_usb_no_out(struct sim_usb_device *dev, uint8_t endpoint, const uint8_t *bytes, size_t n)
{
	(void)dev;
	(void)endpoint;
	(void)bytes;
	(void)n;
	return SIM_USB_STALL;
}

void sim_usb_no_reset(struct sim_usb_device *dev)
{
	(void)dev;
}

bool sim_usb_always_present(struct sim_usb_device *dev)
{
	(void)dev;
	return true;
}

uint16_t sim_usb_vendor(const struct sim_usb_device *dev)
{
	return (uint16_t)(dev->device[8] | dev->device[9] << 8);
}

uint16_t sim_usb_product(const struct sim_usb_device *dev)
{
	return (uint16_t)(dev->device[10] | dev->device[11] << 8);
}

static uint32_t halt_bit(uint8_t endpoint)
{
	return 1u << ((endpoint & 0x0F) + (endpoint & 0x80 ? 16 : 0));
}

void sim_usb_halt(struct sim_usb_device *dev, uint8_t endpoint, bool on)
{
	if (on)
		dev->halted |= halt_bit(endpoint);
	else
		dev->halted &= ~halt_bit(endpoint);
}

void sim_usb_reset(struct sim_usb_device *dev)
{
	dev->halted = 0;
	dev->configuration = 0;
	dev->ops->reset(dev);
}

static int give(uint8_t *bytes, size_t n, const void *from, size_t n_from)
{
	const size_t n_given = n < n_from ? n : n_from;

	memcpy(bytes, from, n_given);
	return (int)n_given;
}

static int give_string(const struct sim_usb_device *dev, unsigned index, uint8_t *bytes, size_t n)
{
	uint8_t text[2 + 2 * 63] = { 4, 3, 0x09, 0x04 }; /* string 0: US English */
	size_t length = 4;

	if (index) {
		if (index >= BB_ARRAY_LEN(dev->string) || !dev->string[index])
			return SIM_USB_STALL;
		length = 2;
		for (const char *c = dev->string[index]; *c && length < sizeof(text); c++) {
			text[length++] = (uint8_t)*c;
			text[length++] = 0;
		}
		text[0] = (uint8_t)length;
	}
	return give(bytes, n, text, length);
}

static int give_descriptor(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n)
{
	const unsigned type = setup->value >> 8, index = setup->value & 0xFF;

	if (type == 1)
		return give(bytes, n, dev->device, 18);
	if (type == 2 && !index)
		return give(bytes, n, dev->config, dev->n_config);
	if (type == 3)
		return give_string(dev, index, bytes, n);
	return SIM_USB_STALL;
}

static int standard_in(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n)
{
	const unsigned to = setup->request_type & TO_MASK;
	uint8_t status[2] = { 0, 0 };

	switch (setup->request) {
	case 0: /* GET_STATUS */
		if (to == TO_ENDPOINT)
			status[0] = (dev->halted & halt_bit((uint8_t)setup->index)) != 0;
		return give(bytes, n, status, 2);
	case 6: /* GET_DESCRIPTOR; an interface's are its class's matter */
		return to == TO_DEVICE ? give_descriptor(dev, setup, bytes, n)
		                       : dev->ops->control(dev, setup, bytes, n);
	case 8: /* GET_CONFIGURATION */
		return give(bytes, n, &dev->configuration, 1);
	case 10: /* GET_INTERFACE */
		return give(bytes, n, status, 1);
	default:
		return SIM_USB_STALL;
	}
}

static int standard_out(struct sim_usb_device *dev, const struct bb_usb_setup *setup)
{
	const unsigned to = setup->request_type & TO_MASK;

	switch (setup->request) {
	case 1: /* CLEAR_FEATURE */
	case 3: /* SET_FEATURE */
		if (to == TO_ENDPOINT && setup->value == 0)
			sim_usb_halt(dev, (uint8_t)setup->index, setup->request == 3);
		return 0;
	case 9: /* SET_CONFIGURATION */
		if (setup->value && setup->value != dev->config[5])
			return SIM_USB_STALL;
		dev->configuration = (uint8_t)setup->value;
		dev->halted = 0;
		return 0;
	case 11: /* SET_INTERFACE: there are no alternate settings */
		return setup->value ? SIM_USB_STALL : 0;
	default:
		return SIM_USB_STALL;
	}
}

int sim_usb_control(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n)
{
	if (n > setup->length)
		n = setup->length;
	if ((setup->request_type & TYPE_MASK) != TYPE_STANDARD)
		return dev->ops->control(dev, setup, bytes, n);
	return setup->request_type & 0x80 ? standard_in(dev, setup, bytes, n) : standard_out(dev, setup);
}

int sim_usb_transfer(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t n)
{
	if (dev->halted & halt_bit(endpoint))
		return SIM_USB_STALL;
	if (!(endpoint & 0x80))
		return dev->ops->out(dev, endpoint, bytes, n);
	dev->in_at_ns = 0;
	return dev->ops->in(dev, endpoint, bytes, n);
}
