/*
 * sim/bus_sim_usb.h: a USB host in this process: ports, simulated devices plugged into them, and buses on top of them
 * for the shipped drivers. Nothing waits: what is not there at once is BB_TIMEOUT. One thread.
 */
#ifndef BB_SIM_BUS_SIM_USB_H
#define BB_SIM_BUS_SIM_USB_H

#include "sim/sim_usb_device.h"

#define BUS_SIM_USB_PORTS 16

struct bus_sim_usb { /* the caller's memory; outlives the buses opened on it */
	struct bb_usb_host host;
	struct {
		struct sim_usb_device *device;
		void *claimed; /* by a bus, NULL: free */
		uint64_t plug; /* counts: a bus knows that its device was out */
	} port[BUS_SIM_USB_PORTS];
	uint64_t n_plugs, n_opens;
};

void bus_sim_usb_init(struct bus_sim_usb *usb);
/* The device starts as after power-up. False: no such port, or it is taken. */
bool bus_sim_usb_plug(struct bus_sim_usb *usb, size_t port, struct sim_usb_device *device);
void bus_sim_usb_unplug(struct bus_sim_usb *usb, size_t port);

#endif
