/* hal/shutter_driver.h: what a shutter back end fills in. Included by drivers/, sim/, hal/shutter.c and tests only. */
#ifndef BB_HAL_SHUTTER_DRIVER_H
#define BB_HAL_SHUTTER_DRIVER_H

#include "hal/shutter.h"

struct bb_shutter_ops;
struct bb_shutter {
	struct bb_device dev;
	const struct bb_shutter_ops *ops;
	struct bb_shutter_config config;
	struct bb_shutter_limits limits;
};

struct bb_shutter_ops { /* every member is mandatory */
	enum bb_status (*open)(struct bb_shutter *sh, const struct bb_open *open);
	void (*close)(struct bb_shutter *sh);
	enum bb_status (*read)(struct bb_shutter *sh, struct bb_shutter_edge *edges, size_t cap, size_t *n_out);
	enum bb_status (*set_phase)(struct bb_shutter *sh, uint8_t stage, int64_t delay_ns, uint32_t duty_ppm);
	enum bb_status (*set_mode)(struct bb_shutter *sh, enum bb_shutter_mode mode);
};

struct bb_shutter_driver {
	const char *scheme;
	size_t handle_bytes;
	const struct bb_shutter_ops *ops;
};

#endif
