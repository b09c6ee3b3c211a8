/* hal/monitor_driver.h: what a monitor back end fills in. Included by drivers/, sim/, hal/monitor.c and tests only. */
#ifndef BB_HAL_MONITOR_DRIVER_H
#define BB_HAL_MONITOR_DRIVER_H

#include "hal/monitor.h"

struct bb_monitor_ops;
struct bb_monitor {
	struct bb_device dev;
	const struct bb_monitor_ops *ops;
	struct bb_monitor_config config;
	struct bb_monitor_limits limits;
};

struct bb_monitor_ops { /* every member is mandatory */
	enum bb_status (*open)(struct bb_monitor *m, const struct bb_open *open);
	void (*close)(struct bb_monitor *m);
	enum bb_status (*submit)(struct bb_monitor *m, const struct bb_monitor_request *request);
	enum bb_status (*poll)(struct bb_monitor *m, struct bb_monitor_reply *reply);
};

struct bb_monitor_driver {
	const char *scheme;
	size_t handle_bytes;
	const struct bb_monitor_ops *ops;
};

#endif
