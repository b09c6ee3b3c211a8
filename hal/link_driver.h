/* hal/link_driver.h: what a link back end fills in. Included by drivers/, sim/, hal/link.c and tests only. */
#ifndef BB_HAL_LINK_DRIVER_H
#define BB_HAL_LINK_DRIVER_H

#include "hal/link.h"

struct bb_link_ops;
struct bb_link {
	struct bb_device dev;
	const struct bb_link_ops *ops;
	struct bb_link_config config;
	struct bb_link_limits limits;
};

struct bb_link_ops { /* every member is mandatory */
	enum bb_status (*open)(struct bb_link *l, const struct bb_open *open);
	void (*close)(struct bb_link *l);
	enum bb_status (*send)(struct bb_link *l, uint16_t from, uint16_t to, const void *bytes, size_t n);
	enum bb_status (*receive)(struct bb_link *l, uint16_t node, struct bb_link_message *out);
	enum bb_status (*notify)(struct bb_link *l, uint16_t node, struct bb_timer *timer);
};

struct bb_link_driver {
	const char *scheme;
	size_t handle_bytes;
	const struct bb_link_ops *ops;
};

#endif
