/*
 * tests/guest/smoke_uhid.c: a SpaceMouse (256f:c62e) by uhid, read back through the kernel's hidraw: 500 motion reports,
 * the LED report the other way, and unplugging. Checks every byte; prints the way from uhid to the hidraw reader.
 */
#include "tests/guest/measure.h"

#include <fcntl.h>
#include <linux/hidraw.h>
#include <linux/uhid.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

enum { REPORTS = 500, MOTION = 1, LED = 4, VENDOR = 0x256f, PRODUCT = 0xc62e };

/* Multi-axis controller: report 1 is six 16 bit axes, -350..350; report 4 one byte of LEDs. */
static const uint8_t descriptor[] = {
	0x05, 0x01, 0x09, 0x08, 0xa1, 0x01, 0xa1, 0x00, 0x85, MOTION, 0x16, 0xa2, 0xfe, 0x26, 0x5e, 0x01, 0x09, 0x30,
	0x09, 0x31, 0x09, 0x32, 0x09, 0x33, 0x09, 0x34, 0x09, 0x35, 0x75, 0x10, 0x95, 0x06, 0x81, 0x02, 0xc0, 0xa1,
	0x02, 0x85, LED, 0x05, 0x08, 0x09, 0x4b, 0x15, 0x00, 0x25, 0x01, 0x75, 0x01, 0x95, 0x01, 0x91, 0x02, 0x75,
	0x07, 0x95, 0x01, 0x91, 0x03, 0xc0, 0xc0,
};

static int plug_in(void)
{
	struct uhid_event event = { .type = UHID_CREATE2 };
	struct uhid_create2_req *create = &event.u.create2;
	int fd = open("/dev/uhid", O_RDWR | O_CLOEXEC);

	NEED(fd >= 0);
	snprintf((char *)create->name, sizeof create->name, "SpaceMouse Wireless");
	memcpy(create->rd_data, descriptor, sizeof descriptor);
	create->rd_size = sizeof descriptor;
	create->bus = 3;
	create->vendor = VENDOR;
	create->product = PRODUCT;
	NEED(write(fd, &event, sizeof event) == (ssize_t)sizeof event);
	return fd;
}

static int open_hidraw(void)
{
	for (int tries = 0; tries < 200; tries++, pause_ns(10000000)) {
		for (int i = 0; i < 8; i++) {
			struct hidraw_devinfo info;
			char path[32];
			int fd;

			snprintf(path, sizeof path, "/dev/hidraw%d", i);
			fd = open(path, O_RDWR | O_CLOEXEC);
			if (fd < 0)
				continue;
			if (!ioctl(fd, HIDIOCGRAWINFO, &info) && (uint16_t)info.vendor == VENDOR &&
			    (uint16_t)info.product == PRODUCT)
				return fd;
			close(fd);
		}
	}
	return -1;
}

static int64_t one_report(int uhid, int hidraw, int i)
{
	struct uhid_event event = { .type = UHID_INPUT2, .u.input2 = { .size = 13 } };
	uint8_t got[64];
	int64_t sent_ns;

	event.u.input2.data[0] = MOTION;
	for (int axis = 0; axis < 6; axis++) {
		const int value = (i * 7 + axis * 100) % 701 - 350;

		event.u.input2.data[1 + 2 * axis] = (uint8_t)(value & 0xff);
		event.u.input2.data[2 + 2 * axis] = (uint8_t)((value >> 8) & 0xff);
	}
	sent_ns = clock_ns(CLOCK_MONOTONIC);
	NEED(write(uhid, &event, sizeof event) == (ssize_t)sizeof event);
	NEED(read(hidraw, got, sizeof got) == 13 && !memcmp(got, event.u.input2.data, 13));
	return clock_ns(CLOCK_MONOTONIC) - sent_ns;
}

static void light_led(int uhid, int hidraw)
{
	const uint8_t report[] = { LED, 1 };
	struct uhid_event event;

	NEED(write(hidraw, report, sizeof report) == (ssize_t)sizeof report);
	do
		NEED(read(uhid, &event, sizeof event) > 0);
	while (event.type != UHID_OUTPUT);
	NEED(event.u.output.size == 2 && !memcmp(event.u.output.data, report, 2));
}

static void unplug(int uhid, int hidraw)
{
	const struct uhid_event event = { .type = UHID_DESTROY };
	struct pollfd gone = { .fd = hidraw, .events = POLLIN };
	uint8_t byte;

	NEED(write(uhid, &event, sizeof event) == (ssize_t)sizeof event);
	NEED(poll(&gone, 1, 2000) == 1 && (gone.revents & (POLLERR | POLLHUP)));
	NEED(read(hidraw, &byte, 1) < 0 && errno == EIO);
}

int main(void)
{
	static int64_t latency_ns[REPORTS];
	int uhid = plug_in(), hidraw = open_hidraw();

	NEED(hidraw >= 0);
	for (int i = 0; i < REPORTS; i++)
		latency_ns[i] = one_report(uhid, hidraw, i);
	light_led(uhid, hidraw);
	unplug(uhid, hidraw);
	printf("{\"reports\": %d", REPORTS);
	print_latency("uhid_to_hidraw", latency_ns, REPORTS);
	puts("}");
	return 0;
}
