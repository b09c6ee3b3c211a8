/* hal/power.c: argument checks and dispatch; see hal/device.h for the pattern. */
#include "hal/power_driver.h"

#include <stdlib.h>

static bool complete(const struct bb_power_ops *o)
{
	return o->open && o->close && o->set && o->read;
}

enum bb_status bb_power_open(const struct bb_power_driver *driver, const struct bb_power_config *config,
                          const struct bb_open *open, struct bb_power **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_power))
		return BB_ERR_USAGE;
	struct bb_power *p = calloc(1, driver->handle_bytes);
	if (!p)
		return BB_ERR_NOMEM;
	bb_device_init(&p->dev, "power", config->id, open);
	p->ops = driver->ops;
	p->config = *config;
	const enum bb_status status = p->ops->open(p, open);
	if (status != BB_OK) {
		free(p);
		return status;
	}
	*out = p;
	return BB_OK;
}

void bb_power_close(struct bb_power *p)
{
	if (!p)
		return;
	p->ops->close(p);
	free(p);
}

const struct bb_power_limits *bb_power_limits(const struct bb_power *p)
{
	return &p->limits;
}

struct bb_device *bb_power_device(struct bb_power *p)
{
	return &p->dev;
}
