/* drivers/bus_input.c: input events by libevdev, the only file that sees it. See drivers/bus_input.h. */
#include "drivers/bus_input.h"

#include <errno.h>
#include <fcntl.h>
#include <libevdev/libevdev.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#define NODES_MAX 256

struct bus_input {
	struct bb_input_bus base;
	int fd, effect; /* effect: -1 none uploaded */
	struct libevdev *dev;
	bool syncing;
};

static struct bus_input *of(struct bb_input_bus *bus)
{
	return bb_container_of(bus, struct bus_input, base);
}

/* The node stamps by CLOCK_MONOTONIC, the stopwatch's clock; the bus's clock began later. */
static int64_t host_ns(struct bb_input_bus *bus, const struct input_event *e)
{
	const int64_t stamp_ns = (int64_t)e->input_event_sec * BB_NS_PER_S + (int64_t)e->input_event_usec * 1000;
	const int64_t age_ns = bb_clock_stopwatch_ns() - stamp_ns;

	return bb_clock_now_ns(bus->clk) - (age_ns > 0 ? age_ns : 0);
}

static enum bb_status next(struct bus_input *b, struct input_event *e)
{
	int rc = libevdev_next_event(b->dev, b->syncing ? LIBEVDEV_READ_FLAG_SYNC : LIBEVDEV_READ_FLAG_NORMAL, e);

	if (rc == -EAGAIN && b->syncing) { /* the state has come once more */
		b->syncing = false;
		rc = libevdev_next_event(b->dev, LIBEVDEV_READ_FLAG_NORMAL, e);
	}
	if (rc == LIBEVDEV_READ_STATUS_SYNC)
		b->syncing = true;
	if (rc == -EAGAIN)
		return BB_TIMEOUT;
	return rc < 0 ? BB_ERR_LOST : BB_OK;
}

static enum bb_status input_read(struct bb_input_bus *bus, struct bb_input_event *events, size_t cap, size_t *n_out)
{
	enum bb_status status = BB_OK;
	struct input_event e;

	for (*n_out = 0; *n_out < cap && (status = next(of(bus), &e)) == BB_OK;)
		events[(*n_out)++] = (struct bb_input_event){ host_ns(bus, &e), e.type, e.code, e.value };
	return *n_out ? BB_OK : status;
}

static bool input_has(struct bb_input_bus *bus, unsigned int type, unsigned int code)
{
	return libevdev_has_event_code(of(bus)->dev, type, code);
}

static bool input_range(struct bb_input_bus *bus, unsigned int axis, struct bb_input_range *out)
{
	const struct input_absinfo *a = libevdev_get_abs_info(of(bus)->dev, axis);

	if (!a)
		return false;
	*out = (struct bb_input_range){ a->minimum, a->maximum, a->value };
	return true;
}

static enum bb_status write_status(void)
{
	return errno == ENODEV ? BB_ERR_LOST : BB_ERR_IO;
}

static enum bb_status input_rumble(struct bb_input_bus *bus, uint16_t strong, uint16_t weak)
{
	struct bus_input *b = of(bus);
	struct ff_effect effect = { .type = FF_RUMBLE, .id = (int16_t)b->effect };
	const struct input_event play = { .type = EV_FF, .value = strong || weak };

	if (!input_has(bus, EV_FF, FF_RUMBLE))
		return BB_ERR_UNSUPPORTED;
	effect.u.rumble.strong_magnitude = strong;
	effect.u.rumble.weak_magnitude = weak;
	if (ioctl(b->fd, EVIOCSFF, &effect) < 0)
		return write_status();
	b->effect = effect.id;
	struct input_event e = play;
	e.code = (uint16_t)effect.id;
	return write(b->fd, &e, sizeof(e)) == (ssize_t)sizeof(e) ? BB_OK : write_status();
}

static void input_close(struct bb_input_bus *bus)
{
	if (!bus)
		return;
	libevdev_free(of(bus)->dev);
	close(of(bus)->fd); /* takes its effects along */
	free(of(bus));
}

static const struct bb_input_ops ops = { input_read, input_has, input_range, input_rumble, input_close };

static void describe(struct libevdev *dev, const char *path, struct bb_input_identity *id)
{
	const char *serial = libevdev_get_uniq(dev);

	*id = (struct bb_input_identity){ (uint16_t)libevdev_get_id_bustype(dev),
					  (uint16_t)libevdev_get_id_vendor(dev),
					  (uint16_t)libevdev_get_id_product(dev),
					  (uint16_t)libevdev_get_id_version(dev),
					  "",
					  "" };
	for (size_t i = 0; serial && serial[i] && i + 1 < sizeof(id->serial); i++)
		id->serial[i] = serial[i] > ' ' && serial[i] < 127 ? serial[i] : '_';
	snprintf(id->path, sizeof(id->path), "%s", path);
}

static bool fits(const struct bb_input_identity *id, const struct bb_input_identity *wanted, struct libevdev *dev)
{
	if (wanted->path[0])
		return true;
	return id->vendor == wanted->vendor && id->product == wanted->product &&
	       (!wanted->serial[0] || !strcmp(id->serial, wanted->serial)) &&
	       libevdev_has_event_code(dev, EV_ABS, ABS_X);
}

/* BB_SKIPPED: another device. */
static enum bb_status try_node(const char *path, const struct bb_input_identity *wanted, struct bb_clock *clk,
			       struct bb_input_bus **out, struct bb_input_identity *found)
{
	struct libevdev *dev = NULL;
	int fd = open(path, O_RDWR | O_NONBLOCK | O_CLOEXEC);

	if (fd < 0 && errno == EACCES)
		fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC); /* to read is enough, but for the motors */
	if (fd < 0)
		return errno == ENOENT || errno == ENODEV || errno == ENXIO ? BB_ERR_LOST : BB_ERR_IO;
	if (libevdev_new_from_fd(fd, &dev) < 0) {
		close(fd);
		return BB_ERR_IO;
	}
	describe(dev, path, found);
	struct bus_input *b = fits(found, wanted, dev) ? calloc(1, sizeof(*b)) : NULL;
	if (!b) {
		libevdev_free(dev);
		close(fd);
		return BB_SKIPPED;
	}
	(void)libevdev_set_clock_id(dev, CLOCK_MONOTONIC);
	*b = (struct bus_input){ { &ops, clk }, fd, -1, dev, false };
	*out = &b->base;
	return BB_OK;
}

enum bb_status bb_bus_input_open(const struct bb_input_identity *wanted, struct bb_clock *clk,
				 struct bb_input_bus **out, struct bb_input_identity *found, struct bb_error *err)
{
	enum bb_status status = BB_ERR_LOST, refused = BB_OK;
	char path[64];

	*out = NULL;
	if (wanted->path[0]) {
		status = try_node(wanted->path, wanted, clk, out, found);
		if (status == BB_OK)
			return status;
		return bb_fail(err, status == BB_ERR_LOST ? status : BB_ERR_IO, status == BB_ERR_LOST ? 1562 : 1563,
			       NULL, "%s: %s", wanted->path, strerror(errno));
	}
	for (int i = 0; i < NODES_MAX; i++) {
		snprintf(path, sizeof(path), "/dev/input/event%d", i);
		status = try_node(path, wanted, clk, out, found);
		if (status == BB_OK)
			return status;
		if (status == BB_ERR_IO)
			refused = status;
	}
	return bb_fail(err, refused == BB_OK ? BB_ERR_LOST : BB_ERR_IO, refused == BB_OK ? 1562 : 1563, NULL,
		       "no input device %04x:%04x%s", wanted->vendor, wanted->product,
		       refused == BB_OK ? "" : " among those that may be opened");
}
