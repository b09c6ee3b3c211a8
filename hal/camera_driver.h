/* hal/camera_driver.h: what a camera back end fills in. Included by drivers/, sim/, hal/camera.c and tests only. */
#ifndef BB_HAL_CAMERA_DRIVER_H
#define BB_HAL_CAMERA_DRIVER_H

#include "hal/camera.h"

struct bb_camera_ops;
struct bb_camera {
	struct bb_device dev;
	const struct bb_camera_ops *ops;
	struct bb_camera_config config;
	struct bb_camera_limits limits; /* filled by ops->open */
};

struct bb_camera_ops { /* every member is mandatory */
	enum bb_status (*open)(struct bb_camera *cam, const struct bb_open *open);
	void (*close)(struct bb_camera *cam); /* frees what open took; the handle itself is hal's */
	enum bb_status (*start)(struct bb_camera *cam);
	enum bb_status (*stop)(struct bb_camera *cam);
	enum bb_status (*read)(struct bb_camera *cam, struct bb_camera_frame *frame);
	enum bb_status (*set_exposure)(struct bb_camera *cam, int64_t exposure_ns, int64_t offset_ns);
};

struct bb_camera_driver {
	const char *scheme; /* "sim", "usb" */
	size_t handle_bytes;
	const struct bb_camera_ops *ops;
};

#endif
