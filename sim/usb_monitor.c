/* sim/usb_monitor.c: see sim/usb_monitor.h. */
#include "sim/usb_monitor.h"

#include <string.h>

#define MAINS_LOOK_NS INT64_C(100000000)

enum bb_status usb_monitor_init(struct usb_monitor *u, const struct bb_monitor_config *config, struct sim_world *world,
				uint64_t seed, const struct bb_clock *clk)
{
	memset(u, 0, sizeof(*u));
	u->config = *config;
	enum bb_status status = peer_ddcci_create(config, world, seed, bb_clock_now_ns(clk), &u->monitor);
	if (status == BB_OK)
		status = peer_i2c_tiny_usb_create(u->config.id, &u->adapter);
	if (status == BB_OK)
		peer_i2c_tiny_usb_monitor(u->adapter, u->monitor, clk);
	else
		usb_monitor_fini(u);
	return status;
}

void usb_monitor_fini(struct usb_monitor *u)
{
	peer_i2c_tiny_usb_destroy(u->adapter);
	peer_ddcci_destroy(u->monitor);
	*u = (struct usb_monitor){ 0 };
}

struct sim_usb_device *usb_monitor_device(struct usb_monitor *u)
{
	return peer_i2c_tiny_usb_device(u->adapter);
}

int64_t usb_monitor_step(struct usb_monitor *u, int64_t now_ns)
{
	const int64_t due_ns = peer_i2c_tiny_usb_due_ns(u->adapter);

	peer_ddcci_look(u->monitor, now_ns);
	if (peer_ddcci_on_outlet(u->monitor) && due_ns > now_ns + MAINS_LOOK_NS)
		return now_ns + MAINS_LOOK_NS;
	return due_ns;
}
