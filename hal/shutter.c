/* hal/shutter.c: argument checks and dispatch; see hal/device.h for the pattern. */
#include "hal/shutter_driver.h"

#include <stdlib.h>

static bool complete(const struct bb_shutter_ops *o)
{
	return o->open && o->close && o->read && o->set_phase && o->set_mode;
}

enum bb_status bb_shutter_open(const struct bb_shutter_driver *driver, const struct bb_shutter_config *config,
                          const struct bb_open *open, struct bb_shutter **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_shutter))
		return BB_ERR_USAGE;
	struct bb_shutter *sh = calloc(1, driver->handle_bytes);
	if (!sh)
		return BB_ERR_NOMEM;
	bb_device_init(&sh->dev, "shutter", config->id, open);
	sh->ops = driver->ops;
	sh->config = *config;
	const enum bb_status status = sh->ops->open(sh, open);
	if (status != BB_OK) {
		free(sh);
		return status;
	}
	*out = sh;
	return BB_OK;
}

void bb_shutter_close(struct bb_shutter *sh)
{
	if (!sh)
		return;
	sh->ops->close(sh);
	free(sh);
}

const struct bb_shutter_limits *bb_shutter_limits(const struct bb_shutter *sh)
{
	return &sh->limits;
}

struct bb_device *bb_shutter_device(struct bb_shutter *sh)
{
	return &sh->dev;
}

enum bb_status bb_shutter_read(struct bb_shutter *sh, struct bb_shutter_edge *edges, size_t cap, size_t *n_out)
{
	if (!n_out || !edges || !cap)
		return BB_ERR_USAGE;
	*n_out = 0;
	sh->dev.ops++;
	return sh->ops->read(sh, edges, cap, n_out);
}

enum bb_status bb_shutter_set_phase(struct bb_shutter *sh, uint8_t stage, int64_t delay_ns, uint32_t duty_ppm)
{
	if (stage != BB_STAGE_EMITTER && stage >= sh->config.n_stages)
		return BB_ERR_USAGE;
	if (delay_ns < 0 || delay_ns >= bb_rate_period_ns(sh->config.rate) || duty_ppm > 1000000)
		return BB_ERR_RANGE;
	sh->dev.ops++;
	return sh->ops->set_phase(sh, stage, delay_ns, duty_ppm);
}

enum bb_status bb_shutter_set_mode(struct bb_shutter *sh, enum bb_shutter_mode mode)
{
	sh->dev.ops++;
	return sh->ops->set_mode(sh, mode);
}
