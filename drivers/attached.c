#define _GNU_SOURCE /* versionsort */
#include "drivers/attached.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define ARPHRD_CAN 280
#define IFF_UP 1
#define BTN_JOYSTICK 0x120 /* to BTN_THUMBR, 0x13e: what makes an input device a pad */
#define BTN_THUMBR 0x13e

/* What our drivers understand, by vendor and product; 0 as product: all of that vendor. */
static const struct known {
	const char *scheme;
	uint16_t vendor, product;
	const char *name;
} known[] = {
	{ "usb", 0x131d, 0, "TrackIR-class camera" },
	{ "usb", 0x045e, 0x0719, "Xbox 360 wireless receiver" },
	{ "usb", 0x045e, 0x0291, "Xbox 360 wireless receiver" },
	{ "usb", 0x045e, 0x02a9, "Xbox 360 wireless receiver" },
	{ "hid", 0x046d, 0xc218, "RumblePad 2" },
	{ "hid", 0x046d, 0xc219, "Cordless RumblePad 2" },
	{ "hid", 0x046d, 0xc626, "SpaceNavigator" },
	{ "hid", 0x046d, 0xc628, "SpaceNavigator for Notebooks" },
	{ "hid", 0x046d, 0xc62b, "SpaceMouse Pro" },
	{ "hid", 0x256f, 0, "SpaceMouse" },
};

struct listing {
	const char *root;
	struct bb_attached *out;
	size_t n, cap;
};

/* A line of sysfs without its end and without what a terminal must not see; empty when it cannot be read. */
static void read_line(const char *root, const char *path, char *out, size_t cap)
{
	char full[512];
	ssize_t n = -1;

	out[0] = '\0';
	if (snprintf(full, sizeof(full), "%s%s", root, path) >= (int)sizeof(full))
		return;
	const int fd = open(full, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	if (fd >= 0) {
		n = read(fd, out, cap - 1);
		close(fd);
	}
	out[n > 0 ? n : 0] = '\0';
	out[strcspn(out, "\n")] = '\0';
	for (char *c = out; *c; c++)
		if (*c < ' ' || *c > '~')
			*c = '?';
}

static void attribute(const struct listing *l, const char *dir, const char *name, const char *attribute, char *out,
		      size_t cap)
{
	char path[400];

	out[0] = '\0';
	if (snprintf(path, sizeof(path), "%s/%s/%s", dir, name, attribute) < (int)sizeof(path))
		read_line(l->root, path, out, cap);
}

/* A number of sysfs, 0 when it is none: nothing of ours has it then. */
static unsigned long number(const char *text, int base)
{
	char *end;
	const unsigned long v = strtoul(text, &end, base);

	return end == text || *end ? 0 : v;
}

static uint16_t hex_attribute(const struct listing *l, const char *dir, const char *name, const char *what)
{
	char text[16];

	attribute(l, dir, name, what, text, sizeof(text));
	return (uint16_t)number(text, 16);
}

static bool may_use(const char *root, const char *node)
{
	char path[400];

	return snprintf(path, sizeof(path), "%s%s", root, node) < (int)sizeof(path) &&
	       faccessat(AT_FDCWD, path, R_OK | W_OK, AT_EACCESS) == 0;
}

static const struct known *known_as(const char *scheme, uint16_t vendor, uint16_t product)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++)
		if (!strcmp(known[i].scheme, scheme) && known[i].vendor == vendor &&
		    (!known[i].product || known[i].product == product))
			return &known[i];
	return NULL;
}

/* The next free row, NULL when there is none. */
static struct bb_attached *add(struct listing *l, const char *scheme, const char *node)
{
	if (l->n == l->cap)
		return NULL;
	struct bb_attached *a = &l->out[l->n++];
	*a = (struct bb_attached){ .scheme = scheme, .known = true };
	snprintf(a->node, sizeof(a->node), "%s", node);
	a->usable = node[0] && may_use(l->root, node);
	return a;
}

/* Vendor and product as a device; which model that is, as far as we know it. */
static void identify(struct bb_attached *a, const char *name)
{
	const struct known *k = known_as(a->scheme, a->vendor, a->product);

	a->known = k;
	snprintf(a->device, sizeof(a->device), "%s:%04x:%04x%s%.40s", a->scheme, a->vendor, a->product,
		 a->serial[0] ? "?serial=" : "", a->serial);
	snprintf(a->what, sizeof(a->what), "%.60s%s%s%s", name[0] ? name : "(without a name)", k ? " (" : "",
		 k ? k->name : "", k ? ")" : "");
}

/* ---- one function a scheme: name is an entry of its folder ---- */

#define GPIO_DIR "/sys/bus/gpio/devices"
#define NET_DIR "/sys/class/net"
#define USB_DIR "/sys/bus/usb/devices"
#define HID_DIR "/sys/class/hidraw"
#define INPUT_DIR "/sys/class/input"
#define I2C_DIR "/sys/class/i2c-dev"

static void on_gpio(struct listing *l, const char *name)
{
	char node[64];

	snprintf(node, sizeof(node), "/dev/%.50s", name);
	struct bb_attached *a = strncmp(name, "gpiochip", 8) ? NULL : add(l, "gpio", node);
	if (!a)
		return;
	snprintf(a->device, sizeof(a->device), "gpio:%s?line=N", node);
	snprintf(a->what, sizeof(a->what), "GPIO chip; `gpioinfo %.50s` lists its lines", name);
}

static void on_net(struct listing *l, const char *name)
{
	char text[32];

	attribute(l, NET_DIR, name, "type", text, sizeof(text));
	struct bb_attached *a = number(text, 10) != ARPHRD_CAN ? NULL : add(l, "can", "");
	if (!a)
		return;
	attribute(l, NET_DIR, name, "flags", text, sizeof(text));
	a->usable = number(text, 16) & IFF_UP;
	snprintf(a->device, sizeof(a->device), "can:%.60s", name);
	snprintf(a->what, sizeof(a->what), "CAN interface, %s", a->usable ? "up" : "down");
}

static void on_usb(struct listing *l, const char *name)
{
	const uint16_t vendor = hex_attribute(l, USB_DIR, name, "idVendor");
	const uint16_t product = hex_attribute(l, USB_DIR, name, "idProduct");
	char bus[8], device[8], node[64], product_name[64];

	if (strchr(name, ':') || !vendor)
		return;
	attribute(l, USB_DIR, name, "busnum", bus, sizeof(bus));
	attribute(l, USB_DIR, name, "devnum", device, sizeof(device));
	snprintf(node, sizeof(node), "/dev/bus/usb/%03lu/%03lu", number(bus, 10), number(device, 10));
	struct bb_attached *a = add(l, "usb", node);
	if (!a)
		return;
	a->vendor = vendor;
	a->product = product;
	attribute(l, USB_DIR, name, "serial", a->serial, sizeof(a->serial));
	attribute(l, USB_DIR, name, "product", product_name, sizeof(product_name));
	identify(a, product_name);
}

/* Of "HID_ID=0003:0000046D:0000C218" and its neighbours in a uevent file. */
static void uevent_value(const char *text, const char *key, char *out, size_t cap)
{
	const char *at = strstr(text, key);

	out[0] = '\0';
	if (at)
		snprintf(out, cap, "%.*s", (int)strcspn(at + strlen(key), "?"), at + strlen(key));
}

static void on_hid(struct listing *l, const char *name)
{
	char path[400], full[1024], id[40], product[64], node[64];
	FILE *f;
	size_t n = 0;

	if (snprintf(path, sizeof(path), "%s" HID_DIR "/%.60s/device/uevent", l->root, name) >= (int)sizeof(path))
		return;
	f = fopen(path, "re");
	if (f) {
		n = fread(full, 1, sizeof(full) - 1, f);
		fclose(f);
	}
	full[n] = '\0';
	for (size_t i = 0; i < n; i++)
		full[i] = full[i] < ' ' || full[i] > '~' ? '?' : full[i]; /* ends of lines, too */
	uevent_value(full, "HID_ID=", id, sizeof(id));
	const char *vendor = strchr(id, ':'), *device = vendor ? strchr(vendor + 1, ':') : NULL;
	if (!device)
		return;
	id[device - id] = '\0'; /* vendor and device are now texts of their own */
	snprintf(node, sizeof(node), "/dev/%.50s", name);
	struct bb_attached *a = add(l, "hid", node);
	if (!a)
		return;
	a->vendor = (uint16_t)number(vendor + 1, 16);
	a->product = (uint16_t)number(device + 1, 16);
	uevent_value(full, "HID_UNIQ=", a->serial, sizeof(a->serial));
	uevent_value(full, "HID_NAME=", product, sizeof(product));
	identify(a, product);
}

/* Has it a button of a pad? The kernel writes words of 64 bits, the lowest last. */
static bool is_pad(const struct listing *l, const char *name)
{
	char text[512], *word;

	attribute(l, INPUT_DIR, name, "device/capabilities/key", text, sizeof(text));
	for (unsigned low = 0; (word = strrchr(text, ' ')) || text[0]; low += 64) {
		const unsigned long long bits = strtoull(word ? word + 1 : text, NULL, 16);
		for (unsigned i = 0; i < 64; i++)
			if ((bits >> i & 1) && low + i >= BTN_JOYSTICK && low + i <= BTN_THUMBR)
				return true;
		*(word ? word : text) = '\0';
	}
	return false;
}

static void on_input(struct listing *l, const char *name)
{
	char node[64], product[64];

	if (strncmp(name, "event", 5))
		return;
	snprintf(node, sizeof(node), "/dev/input/%.40s", name);
	struct bb_attached *a = add(l, "evdev", node);
	if (!a)
		return;
	a->vendor = hex_attribute(l, INPUT_DIR, name, "device/id/vendor");
	a->product = hex_attribute(l, INPUT_DIR, name, "device/id/product");
	attribute(l, INPUT_DIR, name, "device/uniq", a->serial, sizeof(a->serial));
	attribute(l, INPUT_DIR, name, "device/name", product, sizeof(product));
	identify(a, product);
	a->known = is_pad(l, name);
}

static void on_i2c(struct listing *l, const char *name)
{
	char node[64], adapter[64];

	snprintf(node, sizeof(node), "/dev/%.50s", name);
	struct bb_attached *a = strncmp(name, "i2c-", 4) ? NULL : add(l, "i2c", node);
	if (!a)
		return;
	attribute(l, I2C_DIR, name, "name", adapter, sizeof(adapter));
	snprintf(a->device, sizeof(a->device), "i2c:%s", node);
	snprintf(a->what, sizeof(a->what), "I2C bus, %s", adapter[0] ? adapter : "adapter without a name");
}

size_t bb_attached_list(const char *root, struct bb_attached *out, size_t cap)
{
	static const struct {
		const char *dir;
		void (*on)(struct listing *l, const char *name);
	} folders[] = { { NET_DIR, on_net }, { INPUT_DIR, on_input }, { GPIO_DIR, on_gpio },
			{ HID_DIR, on_hid }, { I2C_DIR, on_i2c },     { USB_DIR, on_usb } };
	struct listing l = { .root = root, .out = out, .cap = cap };

	for (size_t i = 0; i < BB_ARRAY_LEN(folders); i++) {
		struct dirent **entries;
		char path[400];
		snprintf(path, sizeof(path), "%s%s", root, folders[i].dir);
		const int n = scandir(path, &entries, NULL, versionsort);
		for (int k = 0; k < n; k++) {
			if (entries[k]->d_name[0] != '.')
				folders[i].on(&l, entries[k]->d_name);
			free(entries[k]);
		}
		if (n >= 0)
			free(entries);
	}
	return l.n;
}
