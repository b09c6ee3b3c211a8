#include "bench/backends.h"

#include <stdio.h>
#include <string.h>

#include "drivers/shutter_gpio.h"
#include "drivers/shutter_can.h"
#include "drivers/camera_usb.h"
#include "drivers/gamepad_evdev.h"
#include "drivers/gamepad_hid.h"
#include "drivers/gamepad_xusb.h"
#include "drivers/monitor_ddc.h"
#include "drivers/link/peers.h"
#include "drivers/power_modbus.h"
#include "sim/sim.h"

static const struct bb_backend backends[] = {
	/* first: a room without wires must never touch hardware */
	{ "sim", "models in this process", &sim_shutter_driver, &sim_camera_driver, &sim_display_driver,
	  &sim_monitor_driver, &sim_power_driver, &sim_gamepad_driver, &sim_link_driver },
	{ "gpio", "stereo sync on a GPIO line of the kernel", .shutter = &bb_shutter_gpio_driver },
	/* wired, and named by the room: no other scheme opens a CAN interface */
	{ "can", "CANopen shutter controllers on a SocketCAN interface", &bb_shutter_can_driver, NULL, NULL, NULL, NULL,
	  NULL, NULL },
	/* a vendor's own wire: what this asks for nobody else drives */
	{ .scheme = "usb", .help = "libusb: IR tracking cameras, Xbox 360 wireless receivers",
	  .camera = &bb_camera_usb_driver, .gamepad = &bb_gamepad_xusb_driver },
	/* pads by their own reports: battery, rumble and the seam of the hand's two halves, which evdev hides */
	{ .scheme = "hid", .help = "hidraw: RumblePad 2, SpaceMouse", .gamepad = &bb_gamepad_hid_driver },
	/* last: any pad the kernel drives, but changes only and no battery */
	{ .scheme = "evdev", .help = "the kernel's input events, SDL mappings", .gamepad = &bb_gamepad_evdev_driver },
	{ "i2c", "a monitor's DDC wires on Linux i2c-dev", .monitor = &monitor_ddc_driver },
	/* between processes: shared memory first, it needs no port */
	{ .scheme = "shm", .help = "nodes as processes of this machine: shared memory", .link = &link_shm_driver },
	{ .scheme = "zmq", .help = "nodes as processes of several machines: ZeroMQ with CURVE keys", .link = &link_zmq_driver },
	{ .scheme = "modbus", .help = "power strips on Modbus TCP and RTU", .power = &power_modbus_driver },
};

const struct bb_backend *bb_backend(size_t i)
{
	return i < BB_ARRAY_LEN(backends) ? &backends[i] : NULL;
}

const struct bb_backend *bb_backend_find(const struct bb_uri *uri, const char *device, struct bb_error *err)
{
	char known[120] = "";

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		const size_t n = strlen(known);
		if (!strcmp(backends[i].scheme, uri->scheme))
			return &backends[i];
		snprintf(known + n, sizeof(known) - n, "%s%s:", i ? ", " : "", backends[i].scheme);
	}
	bb_fail(err, BB_ERR_CONFIG, 1502, NULL, "%s asks for '%s:', this build has %s", device, uri->scheme, known);
	return NULL;
}
