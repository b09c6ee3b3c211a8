/* drivers/bus_hid.c: HID reports by hidapi's hidraw back end; the only file that sees hidapi. See drivers/bus_hid.h. */
#include "drivers/bus_hid.h"

#include <errno.h>
#include <fcntl.h>
#include <hidapi/hidapi.h>
#include <linux/hidraw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <wchar.h>

struct bus_hid {
	struct bb_hid_bus base;
	hid_device *dev;
	char path[64];
};

static struct bus_hid *of(struct bb_hid_bus *bus)
{
	return bb_container_of(bus, struct bus_hid, base);
}

/* hidapi says -1 for an unplugged node and for an interrupted call alike; the node's own poll result is behind both, so
 * -1 is taken as gone: reopening is cheap, a stale handle is not. */
static enum bb_status hid_bus_read(struct bb_hid_bus *bus, uint8_t *report, size_t cap, size_t *n_out, int64_t *at_ns)
{
	const int n = hid_read_timeout(of(bus)->dev, report, cap, 0);

	*n_out = 0;
	*at_ns = bb_clock_now_ns(bus->clk);
	if (n < 0)
		return BB_ERR_LOST;
	if (n == 0)
		return BB_TIMEOUT;
	*n_out = (size_t)n;
	return BB_OK;
}

static enum bb_status hid_bus_write(struct bb_hid_bus *bus, const uint8_t *report, size_t n)
{
	errno = 0;
	if (hid_write(of(bus)->dev, report, n) == (int)n)
		return BB_OK;
	return errno == ENODEV || errno == ENXIO || errno == EIO ? BB_ERR_LOST : BB_ERR_IO;
}

/* hidapi 0.13 has no call for the descriptor; the node has. */
static enum bb_status hid_bus_descriptor(struct bb_hid_bus *bus, uint8_t *bytes, size_t cap, size_t *n_out)
{
	struct hidraw_report_descriptor d = { 0 };
	const int fd = open(of(bus)->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	int n = 0;

	*n_out = 0;
	if (fd < 0)
		return errno == ENOENT || errno == ENODEV || errno == ENXIO ? BB_ERR_LOST : BB_ERR_IO;
	int failed = ioctl(fd, HIDIOCGRDESCSIZE, &n) < 0;
	if (!failed && n > 0 && n <= HID_MAX_DESCRIPTOR_SIZE && (size_t)n <= cap) {
		d.size = (uint32_t)n;
		failed = ioctl(fd, HIDIOCGRDESC, &d) < 0;
	}
	close(fd);
	if (failed || n <= 0 || n > HID_MAX_DESCRIPTOR_SIZE || (size_t)n > cap)
		return BB_ERR_IO;
	memcpy(bytes, d.value, (size_t)n);
	*n_out = (size_t)n;
	return BB_OK;
}

static void hid_bus_close(struct bb_hid_bus *bus)
{
	if (!bus)
		return;
	hid_close(of(bus)->dev);
	free(of(bus));
}

static const struct bb_hid_ops ops = { hid_bus_read, hid_bus_write, hid_bus_descriptor, hid_bus_close };

/* A serial comes from the device: only printable ASCII is taken over. */
static void narrow(const wchar_t *from, char *to, size_t cap)
{
	size_t n = 0;

	for (; from && from[n] && n + 1 < cap; n++)
		to[n] = from[n] > 32 && from[n] < 127 ? (char)from[n] : '_';
	to[n] = '\0';
}

static bool fits(const struct hid_device_info *info, const struct bb_hid_identity *wanted)
{
	char serial[BB_HID_SERIAL_MAX];

	if (!info->path || strlen(info->path) >= sizeof(wanted->path))
		return false;
	narrow(info->serial_number, serial, sizeof(serial));
	return (!wanted->serial[0] || !strcmp(serial, wanted->serial)) &&
	       (!wanted->path[0] || !strcmp(info->path, wanted->path));
}

static enum bb_status open_node(const struct hid_device_info *info, struct bb_clock *clk, struct bb_hid_bus **out)
{
	struct bus_hid *b = calloc(1, sizeof(*b));

	if (!b)
		return BB_ERR_NOMEM;
	b->base = (struct bb_hid_bus){ &ops, clk };
	snprintf(b->path, sizeof(b->path), "%s", info->path);
	b->dev = hid_open_path(info->path);
	if (!b->dev) {
		free(b);
		return BB_ERR_IO;
	}
	*out = &b->base;
	return BB_OK;
}

enum bb_status bb_bus_hid_open(const struct bb_hid_identity *wanted, struct bb_clock *clk, struct bb_hid_bus **out,
			       struct bb_hid_identity *found, struct bb_error *err)
{
	enum bb_status status = BB_ERR_LOST;

	*out = NULL;
	if (hid_init())
		return bb_fail(err, BB_ERR_IO, 1563, NULL, "hidapi cannot start");
	struct hid_device_info *all = hid_enumerate(wanted->vendor, wanted->product);
	for (const struct hid_device_info *i = all; i && status != BB_OK; i = i->next) {
		if (!fits(i, wanted))
			continue;
		status = open_node(i, clk, out);
		if (status != BB_OK) {
			(void)bb_fail(err, status, 1563, NULL, "%s: %s", i->path, strerror(errno));
			continue;
		}
		*found = (struct bb_hid_identity){ .vendor = i->vendor_id, .product = i->product_id };
		narrow(i->serial_number, found->serial, sizeof(found->serial));
		snprintf(found->path, sizeof(found->path), "%s", i->path);
	}
	hid_free_enumeration(all);
	if (status == BB_ERR_LOST)
		(void)bb_fail(err, status, 1562, NULL, "no HID device %04x:%04x%s%s", wanted->vendor, wanted->product,
			      wanted->serial[0] ? " with serial " : "", wanted->serial);
	return status;
}
