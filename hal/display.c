/* hal/display.c: argument checks and dispatch; see hal/device.h for the pattern. */
#include "hal/display_driver.h"

#include <stdlib.h>

static bool complete(const struct bb_display_ops *o)
{
	return o->open && o->close && o->vblank && o->present && o->flips && o->swap_counter;
}

enum bb_status bb_display_open(const struct bb_display_driver *driver, const struct bb_display_config *config,
                          const struct bb_open *open, struct bb_display **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_display))
		return BB_ERR_USAGE;
	struct bb_display *d = calloc(1, driver->handle_bytes);
	if (!d)
		return BB_ERR_NOMEM;
	bb_device_init(&d->dev, "display", config->id, open);
	d->ops = driver->ops;
	d->config = *config;
	const enum bb_status status = d->ops->open(d, open);
	if (status != BB_OK) {
		free(d);
		return status;
	}
	*out = d;
	return BB_OK;
}

void bb_display_close(struct bb_display *d)
{
	if (!d)
		return;
	d->ops->close(d);
	free(d);
}

const struct bb_display_limits *bb_display_limits(const struct bb_display *d)
{
	return &d->limits;
}

struct bb_device *bb_display_device(struct bb_display *d)
{
	return &d->dev;
}

enum bb_status bb_display_vblank(struct bb_display *d, struct bb_vblank *out)
{
	if (!out)
		return BB_ERR_USAGE;
	*out = (struct bb_vblank){ 0, 0 };
	d->dev.ops++;
	return d->ops->vblank(d, out);
}

enum bb_status bb_display_present(struct bb_display *d, uint64_t frame, enum bb_eye eye, uint32_t target_seq)
{
	d->dev.ops++;
	return d->ops->present(d, frame, eye, target_seq);
}

enum bb_status bb_display_flips(struct bb_display *d, struct bb_flip *flips, size_t cap, size_t *n_out)
{
	if (!n_out || !flips || !cap)
		return BB_ERR_USAGE;
	*n_out = 0;
	d->dev.ops++;
	return d->ops->flips(d, flips, cap, n_out);
}

enum bb_status bb_display_swap_counter(struct bb_display *d, uint64_t *counter_out)
{
	if (!counter_out)
		return BB_ERR_USAGE;
	*counter_out = 0;
	d->dev.ops++;
	return d->ops->swap_counter(d, counter_out);
}
