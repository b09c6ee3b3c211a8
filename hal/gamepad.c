/* hal/gamepad.c: argument checks and dispatch; see hal/device.h for the pattern. */
#include "hal/gamepad_driver.h"

#include <stdlib.h>

static bool complete(const struct bb_gamepad_ops *o)
{
	return o->open && o->close && o->read && o->rumble;
}

enum bb_status bb_gamepad_open(const struct bb_gamepad_driver *driver, const struct bb_gamepad_config *config,
                          const struct bb_open *open, struct bb_gamepad **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_gamepad))
		return BB_ERR_USAGE;
	struct bb_gamepad *g = calloc(1, driver->handle_bytes);
	if (!g)
		return BB_ERR_NOMEM;
	bb_device_init(&g->dev, "gamepad", config->id, open);
	g->ops = driver->ops;
	g->config = *config;
	const enum bb_status status = g->ops->open(g, open);
	if (status != BB_OK) {
		free(g);
		return status;
	}
	*out = g;
	return BB_OK;
}

void bb_gamepad_close(struct bb_gamepad *g)
{
	if (!g)
		return;
	g->ops->close(g);
	free(g);
}

const struct bb_gamepad_limits *bb_gamepad_limits(const struct bb_gamepad *g)
{
	return &g->limits;
}

struct bb_device *bb_gamepad_device(struct bb_gamepad *g)
{
	return &g->dev;
}

enum bb_status bb_gamepad_read(struct bb_gamepad *g, struct bb_pad_report *reports, size_t cap, size_t *n_out)
{
	if (!n_out || !reports || !cap)
		return BB_ERR_USAGE;
	*n_out = 0;
	g->dev.ops++;
	return g->ops->read(g, reports, cap, n_out);
}

enum bb_status bb_gamepad_rumble(struct bb_gamepad *g, float strong, float weak)
{
	if (!(strong >= 0 && strong <= 1 && weak >= 0 && weak <= 1))
		return BB_ERR_RANGE;
	g->dev.ops++;
	return g->ops->rumble(g, strong, weak);
}
