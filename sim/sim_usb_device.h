/*
 * sim/sim_usb_device.h: what a simulated USB device is to whatever carries it: a bus in this process
 * (sim/bus_sim_usb.h) or USB/IP (sim/usbip_server.h). The device answers class and vendor requests and moves bytes
 * through its endpoints; descriptors and standard requests are answered here. One thread; nothing waits.
 */
#ifndef BB_SIM_USB_DEVICE_H
#define BB_SIM_USB_DEVICE_H

#include "hal/bus.h"

/* Besides a number of bytes, what an endpoint can answer. */
#define SIM_USB_NAK (-1)   /* nothing yet: ask again */
#define SIM_USB_STALL (-2)
#define SIM_USB_GONE (-3)

enum sim_usb_speed { SIM_USB_LOW = 1, SIM_USB_FULL = 2, SIM_USB_HIGH = 3 }; /* as USB/IP writes them */

struct sim_usb_device;
struct sim_usb_ops { /* every member is mandatory; sim_usb_no_*() stand in */
	/* A request that is none of the standard ones answered here. IN: fill up to n bytes; OUT: n bytes came. */
	int (*control)(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n);
	int (*in)(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap);
	int (*out)(struct sim_usb_device *dev, uint8_t endpoint, const uint8_t *bytes, size_t n);
	/* Bus reset, or plugged in again: as after power-up. */
	void (*reset)(struct sim_usb_device *dev);
	/* Is it plugged in? */
	bool (*present)(struct sim_usb_device *dev);
};

struct sim_usb_device {
	const struct sim_usb_ops *ops;
	enum sim_usb_speed speed;
	const uint8_t *device;          /* 18 bytes */
	const uint8_t *config;          /* its configuration with all that belongs to it */
	size_t n_config;
	const char *string[4];          /* 1..3 (manufacturer, product, serial); NULL: none */
	int64_t in_at_ns;               /* set by in(): when the bytes reached the host; 0: now */
	uint8_t configuration;          /* chosen */
	uint32_t halted;                /* bit endpoint number, + 16 for IN */
};

/* A control transfer as a host sees it: bytes moved, SIM_USB_STALL or SIM_USB_NAK. */
int sim_usb_control(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n);
/* A bulk or interrupt transfer; bit 7 of endpoint set: IN. */
int sim_usb_transfer(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t n);
void sim_usb_reset(struct sim_usb_device *dev);
void sim_usb_halt(struct sim_usb_device *dev, uint8_t endpoint, bool on);
uint16_t sim_usb_vendor(const struct sim_usb_device *dev);
uint16_t sim_usb_product(const struct sim_usb_device *dev);

int sim_usb_no_control(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n);
int sim_usb_no_in(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap);
int sim_usb_no_out(struct sim_usb_device *dev, uint8_t endpoint, const uint8_t *bytes, size_t n);
void sim_usb_no_reset(struct sim_usb_device *dev);
bool sim_usb_always_present(struct sim_usb_device *dev);

#endif
