/* hal/link.c: argument checks and dispatch; see hal/device.h for the pattern. */
#include "hal/link_driver.h"

#include <stdlib.h>

static bool complete(const struct bb_link_ops *o)
{
	return o->open && o->close && o->send && o->receive && o->notify;
}

enum bb_status bb_link_open(const struct bb_link_driver *driver, const struct bb_link_config *config,
                          const struct bb_open *open, struct bb_link **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_link))
		return BB_ERR_USAGE;
	struct bb_link *l = calloc(1, driver->handle_bytes);
	if (!l)
		return BB_ERR_NOMEM;
	bb_device_init(&l->dev, "link", config->id, open);
	l->ops = driver->ops;
	l->config = *config;
	const enum bb_status status = l->ops->open(l, open);
	if (status != BB_OK) {
		free(l);
		return status;
	}
	*out = l;
	return BB_OK;
}

void bb_link_close(struct bb_link *l)
{
	if (!l)
		return;
	l->ops->close(l);
	free(l);
}

const struct bb_link_limits *bb_link_limits(const struct bb_link *l)
{
	return &l->limits;
}

struct bb_device *bb_link_device(struct bb_link *l)
{
	return &l->dev;
}

enum bb_status bb_link_send(struct bb_link *l, uint16_t from, uint16_t to, const void *bytes, size_t n)
{
	if (!bytes || !n)
		return BB_ERR_USAGE;
	if (n > l->limits.most_bytes || from >= l->config.n_nodes || (to != BB_LINK_ALL && to >= l->config.n_nodes))
		return BB_ERR_RANGE;
	l->dev.ops++;
	return l->ops->send(l, from, to, bytes, n);
}

enum bb_status bb_link_receive(struct bb_link *l, uint16_t node, struct bb_link_message *out)
{
	if (!out)
		return BB_ERR_USAGE;
	if (node >= l->config.n_nodes)
		return BB_ERR_RANGE;
	l->dev.ops++;
	return l->ops->receive(l, node, out);
}

enum bb_status bb_link_notify(struct bb_link *l, uint16_t node, struct bb_timer *timer)
{
	if (node >= l->config.n_nodes)
		return BB_ERR_RANGE;
	return l->ops->notify(l, node, timer);
}
