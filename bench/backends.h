/*
 * bench/backends.h: the one ordered table of back ends per device class. The scheme of a device's URI picks the row.
 */
#ifndef BB_BENCH_BACKENDS_H
#define BB_BENCH_BACKENDS_H

#include "hal/camera_driver.h"
#include "hal/display_driver.h"
#include "hal/gamepad_driver.h"
#include "hal/link_driver.h"
#include "hal/monitor_driver.h"
#include "hal/power_driver.h"
#include "hal/shutter_driver.h"

struct bb_backend { /* one scheme; NULL where it has no such class */
	const char *scheme, *help;
	const struct bb_shutter_driver *shutter;
	const struct bb_camera_driver *camera;
	const struct bb_display_driver *display;
	const struct bb_monitor_driver *monitor;
	const struct bb_power_driver *power;
	const struct bb_gamepad_driver *gamepad;
	const struct bb_link_driver *link;
};

/* Row i, NULL past the end. */
const struct bb_backend *bb_backend(size_t i);
/* The row of a URI's scheme; NULL: error 1502 names the schemes there are. */
const struct bb_backend *bb_backend_find(const struct bb_uri *uri, const char *device, struct bb_error *err);

#endif
