/* hal/power_driver.h: what a power back end fills in. Included by drivers/, sim/, hal/power.c and tests only. */
#ifndef BB_HAL_POWER_DRIVER_H
#define BB_HAL_POWER_DRIVER_H

#include "hal/power.h"

#define BB_POWER_CYCLES_KEPT 8 /* at least the ceiling of cycles per hour */

struct bb_power_ops;
struct bb_power {
	struct bb_device dev;
	const struct bb_power_ops *ops;
	struct bb_power_config config;
	struct bb_power_limits limits;
	struct bb_power_guard { /* kept by hal/power.c */
		bool on;                 /* commanded, or found by reading back */
		bool sure;               /* the device acknowledged the last command */
		bool switched;           /* at_ns is meaningful */
		int64_t at_ns;           /* last change of `on` */
		bool before_switched;    /* the same before the last command, should it prove lost */
		int64_t before_ns;
		int64_t cycle_ns[BB_POWER_CYCLES_KEPT]; /* the last switch-ons, a ring */
		size_t n_cycles;         /* switch-ons in all */
	} guard[BB_OUTLETS_MAX];
	int64_t last_on_ns;          /* of any outlet, when any_on: stagger */
	bool any_on;
};

struct bb_power_ops { /* every member is mandatory */
	enum bb_status (*open)(struct bb_power *p, const struct bb_open *open);
	void (*close)(struct bb_power *p);
	enum bb_status (*set)(struct bb_power *p, size_t index, bool on);
	enum bb_status (*read)(struct bb_power *p, size_t index, struct bb_outlet_state *out);
};

struct bb_power_driver {
	const char *scheme;
	size_t handle_bytes;
	const struct bb_power_ops *ops;
};

#endif
