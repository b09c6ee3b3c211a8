/* hal/camera.c: argument checks and dispatch for cameras; see hal/device.h for the pattern. */
#include "hal/camera_driver.h"

#include <stdlib.h>

static bool complete(const struct bb_camera_ops *o)
{
	return o->open && o->close && o->start && o->stop && o->read && o->set_exposure;
}

enum bb_status bb_camera_open(const struct bb_camera_driver *driver, const struct bb_camera_config *config,
                              const struct bb_open *open, struct bb_camera **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_camera))
		return BB_ERR_USAGE;
	struct bb_camera *cam = calloc(1, driver->handle_bytes);
	if (!cam)
		return BB_ERR_NOMEM;
	bb_device_init(&cam->dev, "camera", config->id, open);
	cam->ops = driver->ops;
	cam->config = *config;
	const enum bb_status status = cam->ops->open(cam, open);
	if (status != BB_OK) {
		free(cam);
		return status;
	}
	*out = cam;
	return BB_OK;
}

void bb_camera_close(struct bb_camera *cam)
{
	if (!cam)
		return;
	cam->ops->close(cam);
	free(cam);
}

const struct bb_camera_limits *bb_camera_limits(const struct bb_camera *cam)
{
	return &cam->limits;
}

enum bb_status bb_camera_start(struct bb_camera *cam)
{
	cam->dev.ops++;
	return cam->ops->start(cam);
}

enum bb_status bb_camera_stop(struct bb_camera *cam)
{
	cam->dev.ops++;
	return cam->ops->stop(cam);
}

enum bb_status bb_camera_read(struct bb_camera *cam, struct bb_camera_frame *frame)
{
	if (!frame || (!frame->blobs && frame->cap))
		return BB_ERR_USAGE;
	frame->n = 0;
	frame->has_grey = false;
	cam->dev.ops++;
	return cam->ops->read(cam, frame);
}

enum bb_status bb_camera_set_exposure(struct bb_camera *cam, int64_t exposure_ns, int64_t offset_ns)
{
	if (exposure_ns <= 0 || offset_ns < 0)
		return BB_ERR_USAGE;
	cam->dev.ops++;
	return cam->ops->set_exposure(cam, exposure_ns, offset_ns);
}

struct bb_device *bb_camera_device(struct bb_camera *cam)
{
	return &cam->dev;
}
