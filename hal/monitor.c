/* hal/monitor.c: argument checks and dispatch; see hal/device.h for the pattern. */
#include "hal/monitor_driver.h"

#include <stdlib.h>

static bool complete(const struct bb_monitor_ops *o)
{
	return o->open && o->close && o->submit && o->poll;
}

enum bb_status bb_monitor_open(const struct bb_monitor_driver *driver, const struct bb_monitor_config *config,
                          const struct bb_open *open, struct bb_monitor **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_monitor))
		return BB_ERR_USAGE;
	struct bb_monitor *m = calloc(1, driver->handle_bytes);
	if (!m)
		return BB_ERR_NOMEM;
	bb_device_init(&m->dev, "monitor", config->id, open);
	m->ops = driver->ops;
	m->config = *config;
	const enum bb_status status = m->ops->open(m, open);
	if (status != BB_OK) {
		free(m);
		return status;
	}
	*out = m;
	return BB_OK;
}

void bb_monitor_close(struct bb_monitor *m)
{
	if (!m)
		return;
	m->ops->close(m);
	free(m);
}

const struct bb_monitor_limits *bb_monitor_limits(const struct bb_monitor *m)
{
	return &m->limits;
}

struct bb_device *bb_monitor_device(struct bb_monitor *m)
{
	return &m->dev;
}

enum bb_status bb_monitor_submit(struct bb_monitor *m, const struct bb_monitor_request *request)
{
	if (!request)
		return BB_ERR_USAGE;
	/* Power-off by DDC can leave a display that only mains or a button wakes: hal/safety.h forbids it. */
	if (request->kind == BB_MONITOR_SET && request->code == BB_VCP_POWER_MODE && request->value == 5)
		return bb_device_fail(&m->dev, BB_ERR_REFUSED, "submit", "VCP D6 = 5 (power off) is not allowed");
	/* What is saved by mistake outlives the run. B0 = 1 is the same wish as a VCP write. */
	if (request->kind == BB_MONITOR_SAVE ||
	    (request->kind == BB_MONITOR_SET && request->code == BB_VCP_SETTINGS && request->value == 1))
		return bb_device_fail(&m->dev, BB_ERR_REFUSED, "submit", "saving settings in the display is not allowed");
	m->dev.ops++;
	return m->ops->submit(m, request);
}

enum bb_status bb_monitor_poll(struct bb_monitor *m, struct bb_monitor_reply *reply)
{
	if (!reply)
		return BB_ERR_USAGE;
	m->dev.ops++;
	return m->ops->poll(m, reply);
}
