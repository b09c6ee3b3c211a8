/* hal/display_driver.h: what a display back end fills in. Included by drivers/, sim/, hal/display.c and tests only. */
#ifndef BB_HAL_DISPLAY_DRIVER_H
#define BB_HAL_DISPLAY_DRIVER_H

#include "hal/display.h"

struct bb_display_ops;
struct bb_display {
	struct bb_device dev;
	const struct bb_display_ops *ops;
	struct bb_display_config config;
	struct bb_display_limits limits;
};

struct bb_display_ops { /* every member is mandatory */
	enum bb_status (*open)(struct bb_display *d, const struct bb_open *open);
	void (*close)(struct bb_display *d);
	enum bb_status (*vblank)(struct bb_display *d, struct bb_vblank *out);
	enum bb_status (*present)(struct bb_display *d, uint64_t frame, enum bb_eye eye, uint32_t target_seq);
	enum bb_status (*flips)(struct bb_display *d, struct bb_flip *flips, size_t cap, size_t *n_out);
	enum bb_status (*swap_counter)(struct bb_display *d, uint64_t *counter_out);
};

struct bb_display_driver {
	const char *scheme;
	size_t handle_bytes;
	const struct bb_display_ops *ops;
};

#endif
