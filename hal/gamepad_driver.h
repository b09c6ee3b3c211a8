/* hal/gamepad_driver.h: what a gamepad back end fills in. Included by drivers/, sim/, hal/gamepad.c and tests only. */
#ifndef BB_HAL_GAMEPAD_DRIVER_H
#define BB_HAL_GAMEPAD_DRIVER_H

#include "hal/gamepad.h"

struct bb_gamepad_ops;
struct bb_gamepad {
	struct bb_device dev;
	const struct bb_gamepad_ops *ops;
	struct bb_gamepad_config config;
	struct bb_gamepad_limits limits;
};

struct bb_gamepad_ops { /* every member is mandatory */
	enum bb_status (*open)(struct bb_gamepad *g, const struct bb_open *open);
	void (*close)(struct bb_gamepad *g);
	enum bb_status (*read)(struct bb_gamepad *g, struct bb_pad_report *reports, size_t cap, size_t *n_out);
	enum bb_status (*rumble)(struct bb_gamepad *g, float strong, float weak);
};

struct bb_gamepad_driver {
	const char *scheme;
	size_t handle_bytes;
	const struct bb_gamepad_ops *ops;
};

#endif
