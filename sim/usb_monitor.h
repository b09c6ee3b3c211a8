/*
 * sim/usb_monitor.h: a monitor of a room at the far end of USB: sim/peer_ddcci.h behind an i2c-tiny-usb adapter of its
 * own, for usbip_server_export(). The adapter's serial number is the monitor's id. One thread; ns.
 */
#ifndef BB_SIM_USB_MONITOR_H
#define BB_SIM_USB_MONITOR_H

#include "sim/peer_i2c_tiny_usb.h"

struct usb_monitor {
	struct bb_monitor_config config;
	struct peer_ddcci *monitor;
	struct peer_i2c_tiny_usb *adapter;
};

/* The caller's memory. Registers with the world, unless NULL, as "monitor/ID" and "ddc/ID" (faults).
 * BB_ERR_CONFIG when the mode fits no EDID. */
BB_MUST_CHECK enum bb_status usb_monitor_init(struct usb_monitor *u, const struct bb_monitor_config *config,
					      struct sim_world *world, uint64_t seed, const struct bb_clock *clk);
void usb_monitor_fini(struct usb_monitor *u);
struct sim_usb_device *usb_monitor_device(struct usb_monitor *u);
/* Looks at the mains. Returns when the USB transfers should be carried on at the latest; BB_NEVER: when some come. */
int64_t usb_monitor_step(struct usb_monitor *u, int64_t now_ns);

#endif
