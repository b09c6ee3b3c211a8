/*
 * tests/test_attached.c: a folder of files stands for a machine; what is listed of it, and what is said of a device
 * that a room names: here, not usable, missing, and why.
 */
#define _GNU_SOURCE
#include "drivers/attached.h"

#include <arpa/inet.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#define NOBODY 65534

struct machine {
	char root[64];
	struct bb_attached list[32];
	size_t n;
};

/* A file below the root, with the folders above it. */
static void put(const struct machine *m, const char *path, const char *text)
{
	char full[400];
	FILE *f;

	snprintf(full, sizeof(full), "%s%s", m->root, path);
	for (char *slash = full + strlen(m->root) + 1; (slash = strchr(slash, '/')); *slash++ = '/') {
		*slash = '\0';
		mkdir(full, 0755);
	}
	f = fopen(full, "w");
	assert_non_null(f);
	fputs(text, f);
	fclose(f);
}

static int setup(void **state)
{
	struct machine *m = calloc(1, sizeof(*m));

	assert_non_null(m);
	snprintf(m->root, sizeof(m->root), "/tmp/bb-attached-XXXXXX");
	assert_non_null(mkdtemp(m->root));
	*state = m;
	return 0;
}

static int teardown(void **state)
{
	struct machine *m = *state;
	char command[128];

	snprintf(command, sizeof(command), "rm -rf %s", m->root);
	assert_int_equal(system(command), 0);
	free(m);
	return 0;
}

static void furnish(struct machine *m)
{
	put(m, "/sys/class/i2c-dev/i2c-2/name", "i915 gmbus dpb\n");
	put(m, "/sys/class/i2c-dev/i2c-10/name", "i2c-tiny-usb\n");
	put(m, "/dev/i2c-2", "");
	put(m, "/sys/bus/gpio/devices/gpiochip0/uevent", "");
	put(m, "/dev/gpiochip0", "");
	put(m, "/sys/class/net/lo/type", "772\n");
	put(m, "/sys/class/net/can0/type", "280\n");
	put(m, "/sys/class/net/can0/flags", "0x40080\n");
	put(m, "/sys/class/net/can1/type", "280\n");
	put(m, "/sys/class/net/can1/flags", "0x400c1\n");
	put(m, "/sys/bus/usb/devices/1-1/idVendor", "131d\n");
	put(m, "/sys/bus/usb/devices/1-1/idProduct", "0157\n");
	put(m, "/sys/bus/usb/devices/1-1/serial", "A1\n");
	put(m, "/sys/bus/usb/devices/1-1/product", "TrackIR 5\n");
	put(m, "/sys/bus/usb/devices/1-1/busnum", "1\n");
	put(m, "/sys/bus/usb/devices/1-1/devnum", "7\n");
	put(m, "/dev/bus/usb/001/007", "");
	put(m, "/sys/bus/usb/devices/1-1:1.0/bInterfaceClass", "ff\n");
	put(m, "/sys/bus/usb/devices/1-2/idVendor", "1d6b\n");
	put(m, "/sys/bus/usb/devices/1-2/idProduct", "0002\n");
	put(m, "/sys/class/hidraw/hidraw0/device/uevent",
	    "DRIVER=hid-generic\nHID_ID=0003:0000046D:0000C218\nHID_NAME=Logitech\x1b[2J RumblePad\nHID_UNIQ=S7\n");
	put(m, "/dev/hidraw0", "");
	put(m, "/sys/class/input/event3/device/name", "Pad\n");
	put(m, "/sys/class/input/event3/device/id/vendor", "046d\n");
	put(m, "/sys/class/input/event3/device/id/product", "c218\n");
	put(m, "/sys/class/input/event3/device/capabilities/key", "fff000000000000 0 0 0 0\n");
	put(m, "/dev/input/event3", "");
	put(m, "/sys/class/input/event4/device/name", "Keyboard\n");
	put(m, "/sys/class/input/event4/device/capabilities/key",
	    "402000000 3803078f800d001 feffffdfffefffff fffffffffffffffe\n");
}

static const struct bb_attached *find(const struct machine *m, const char *device)
{
	for (size_t i = 0; i < m->n; i++)
		if (!strcmp(m->list[i].device, device))
			return &m->list[i];
	fail_msg("no %s", device);
	return NULL;
}

static void what_is_there_is_listed(void **state)
{
	struct machine *m = *state;

	assert_int_equal(bb_attached_list(m->root, m->list, BB_ARRAY_LEN(m->list)), 0);
	furnish(m);
	m->n = bb_attached_list(m->root, m->list, BB_ARRAY_LEN(m->list));
	assert_int_equal(m->n, 10);
	assert_true(find(m, "usb:131d:0157?serial=A1")->known && find(m, "usb:131d:0157?serial=A1")->usable);
	assert_non_null(strstr(find(m, "usb:131d:0157?serial=A1")->what, "TrackIR 5 (TrackIR-class"));
	assert_string_equal(find(m, "usb:131d:0157?serial=A1")->node, "/dev/bus/usb/001/007");
	assert_false(find(m, "usb:1d6b:0002")->known);
	assert_true(find(m, "hid:046d:c218?serial=S7")->known);
	assert_null(strchr(find(m, "hid:046d:c218?serial=S7")->what, 0x1b)); /* nothing for a terminal to obey */
	assert_true(find(m, "evdev:046d:c218")->known);
	assert_false(find(m, "evdev:0000:0000")->known);
	assert_false(find(m, "can:can0")->usable);
	assert_true(find(m, "can:can1")->usable);
	assert_true(find(m, "i2c:/dev/i2c-2") < find(m, "i2c:/dev/i2c-10")); /* numbers, not letters */
	assert_false(find(m, "i2c:/dev/i2c-10")->usable);                    /* no node */
	assert_int_equal(bb_attached_list(m->root, m->list, 3), 3);
}

static void why_a_device_is_missing_is_said(void **state)
{
	static const struct {
		const char *device;
		enum bb_attached_state want;
		const char *why, *remedy;
	} rows[] = {
		{ "i2c:/dev/i2c-2", BB_ATTACHED_HERE, "", "" },
		{ "i2c:/dev/i2c-4", BB_ATTACHED_MISSING, "there is /dev/i2c-2, /dev/i2c-10", "i2cdetect" },
		{ "i2c:/dev/i2c-10", BB_ATTACHED_REFUSED, "is not there", "udev" },
		{ "can:can0", BB_ATTACHED_REFUSED, "down", "ip link set" },
		{ "can:can1?node=5", BB_ATTACHED_HERE, "", "" },
		{ "can:can2", BB_ATTACHED_MISSING, "there is can0, can1", "ip -details" },
		{ "gpio:/dev/gpiochip0?line=3", BB_ATTACHED_HERE, "", "" },
		{ "usb:131d:0157", BB_ATTACHED_HERE, "", "" },
		{ "usb:131d:0157?serial=A1", BB_ATTACHED_HERE, "", "" },
		{ "usb:131d:0157?serial=B2", BB_ATTACHED_MISSING, "there is", "plug it in" },
		{ "hid:046d:c218", BB_ATTACHED_HERE, "", "" },
		{ "evdev:/dev/input/event3", BB_ATTACHED_HERE, "", "" },
		{ "evdev:045e:02a1", BB_ATTACHED_MISSING, "there is", "plug it in" },
		{ "modbus:rtu:/dev/ttyUSB0?unit=1", BB_ATTACHED_MISSING, "serial port", "by-id" },
		{ "modbus:tcp://127.0.0.1:1?unit=1", BB_ATTACHED_MISSING, "refused", "Modbus/TCP" },
		{ "link:x", BB_ATTACHED_UNSEEN, "", "" },
	};
	struct machine *m = *state;
	struct bb_attached_answer a;
	struct bb_uri uri;

	furnish(m);
	m->n = bb_attached_list(m->root, m->list, BB_ARRAY_LEN(m->list));
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		assert_int_equal(bb_uri_parse(rows[i].device, &uri, NULL, NULL), BB_OK);
		bb_attached_match(m->root, m->list, m->n, &uri, &a);
		if (a.state != rows[i].want || !strstr(a.why, rows[i].why) || !strstr(a.remedy, rows[i].remedy))
			fail_msg("%s: %d \"%s\" \"%s\"", rows[i].device, (int)a.state, a.why, a.remedy);
		assert_true((a.state == BB_ATTACHED_HERE || a.state == BB_ATTACHED_UNSEEN) == !a.why[0]);
	}
}

static void an_unloaded_module_is_named(void **state)
{
	struct machine *m = *state;
	struct bb_attached_answer a;
	struct bb_uri uri;

	assert_int_equal(bb_uri_parse("i2c:/dev/i2c-4", &uri, NULL, NULL), BB_OK);
	bb_attached_match(m->root, NULL, 0, &uri, &a);
	assert_int_equal(a.state, BB_ATTACHED_MISSING);
	assert_string_equal(a.why, "i2c-dev is not loaded");
	assert_non_null(strstr(a.remedy, "modprobe i2c-dev"));
}

static void a_strip_that_listens_is_here(void **state)
{
	struct sockaddr_in at = { .sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
	socklen_t size = sizeof(at);
	struct bb_attached_answer a;
	struct bb_uri uri;
	char text[80];
	const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

	(void)state;
	assert_true(fd >= 0 && bind(fd, (struct sockaddr *)&at, size) == 0 && listen(fd, 1) == 0);
	assert_int_equal(getsockname(fd, (struct sockaddr *)&at, &size), 0);
	snprintf(text, sizeof(text), "modbus:tcp://127.0.0.1:%u?unit=1", ntohs(at.sin_port));
	assert_int_equal(bb_uri_parse(text, &uri, NULL, NULL), BB_OK);
	bb_attached_match("", NULL, 0, &uri, &a);
	assert_int_equal(a.state, BB_ATTACHED_HERE);
	close(fd);
}

static void a_node_of_somebody_else_says_whose(void **state)
{
	struct machine *m = *state;
	struct bb_attached_answer a;
	struct bb_uri uri;
	char path[128];

	furnish(m);
	snprintf(path, sizeof(path), "%s/dev/i2c-2", m->root);
	assert_int_equal(chmod(path, 0) || chmod(m->root, 0755), 0);
	const uid_t me = geteuid();
	assert_int_equal(me ? 0 : seteuid(NOBODY), 0); /* root may use everything */
	m->n = bb_attached_list(m->root, m->list, BB_ARRAY_LEN(m->list));
	assert_int_equal(bb_uri_parse("i2c:/dev/i2c-2", &uri, NULL, NULL), BB_OK);
	bb_attached_match(m->root, m->list, m->n, &uri, &a);
	assert_int_equal(me ? 0 : seteuid(me), 0);
	assert_int_equal(a.state, BB_ATTACHED_REFUSED);
	assert_non_null(strstr(a.why, "mode 0000"));
	assert_non_null(strstr(a.remedy, "70-blackburst.rules"));
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(what_is_there_is_listed),      T(why_a_device_is_missing_is_said),    T(an_unloaded_module_is_named),
		T(a_strip_that_listens_is_here), T(a_node_of_somebody_else_says_whose),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
