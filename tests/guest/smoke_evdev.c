/*
 * tests/guest/smoke_evdev.c: a gamepad by uinput, read back through the kernel's evdev: 500 moves of a stick, a button at
 * every tenth, and unplugging. Checks type, code and value of every event and that its stamp lies between writing and
 * reading; prints the way from uinput to the reader and from the kernel's stamp to the reader. `smoke_evdev paced` waits
 * a second, for somebody else to open the device, and a millisecond after each move, for them to keep up.
 */
#include "tests/guest/measure.h"

#include <fcntl.h>
#include <linux/uinput.h>
#include <sys/ioctl.h>
#include <unistd.h>

enum { MOVES = 500 };

static void emit(int fd, uint16_t type, uint16_t code, int32_t value)
{
	const struct input_event event = { .type = type, .code = code, .value = value };

	NEED(write(fd, &event, sizeof event) == (ssize_t)sizeof event);
}

static int plug_in(void)
{
	const struct uinput_abs_setup stick = { .code = ABS_X, .absinfo = { .minimum = -32768, .maximum = 32767 } };
	struct uinput_setup setup = { .id = { .bustype = BUS_USB, .vendor = 0x046d, .product = 0xc219, .version = 1 } };
	int fd = open("/dev/uinput", O_WRONLY | O_CLOEXEC);

	NEED(fd >= 0);
	snprintf(setup.name, sizeof setup.name, "a pad by uinput");
	NEED(ioctl(fd, UI_SET_EVBIT, EV_ABS) == 0 && ioctl(fd, UI_SET_EVBIT, EV_KEY) == 0);
	NEED(ioctl(fd, UI_SET_KEYBIT, BTN_SOUTH) == 0 && ioctl(fd, UI_ABS_SETUP, &stick) == 0);
	NEED(ioctl(fd, UI_DEV_SETUP, &setup) == 0 && ioctl(fd, UI_DEV_CREATE) == 0);
	return fd;
}

static int open_evdev(void)
{
	for (int tries = 0; tries < 200; tries++, pause_ns(10000000)) {
		for (int i = 0; i < 16; i++) {
			const int clock = CLOCK_MONOTONIC;
			struct input_id id;
			char path[32];
			int fd;

			snprintf(path, sizeof path, "/dev/input/event%d", i);
			fd = open(path, O_RDONLY | O_CLOEXEC);
			if (fd < 0)
				continue;
			if (!ioctl(fd, EVIOCGID, &id) && id.vendor == 0x046d && id.product == 0xc219) {
				NEED(ioctl(fd, EVIOCSCLOCKID, &clock) == 0);
				return fd;
			}
			close(fd);
		}
	}
	return -1;
}

static int64_t expect(int fd, uint16_t type, uint16_t code, int32_t value)
{
	struct input_event event;

	NEED(read(fd, &event, sizeof event) == (ssize_t)sizeof event);
	NEED(event.type == type && event.code == code && event.value == value);
	return event.input_event_sec * 1000000000LL + event.input_event_usec * 1000LL;
}

static void one_move(int uinput, int evdev, int i, int64_t *whole_ns, int64_t *stamp_ns)
{
	const int32_t value = i * 131 % 65535 - 32767 + !i;
	const int64_t sent_ns = clock_ns(CLOCK_MONOTONIC);
	int64_t stamped_ns, read_ns;

	emit(uinput, EV_ABS, ABS_X, value);
	if (i % 10 == 0)
		emit(uinput, EV_KEY, BTN_SOUTH, i / 10 % 2 == 0);
	emit(uinput, EV_SYN, SYN_REPORT, 0);
	stamped_ns = expect(evdev, EV_ABS, ABS_X, value);
	read_ns = clock_ns(CLOCK_MONOTONIC);
	if (i % 10 == 0)
		expect(evdev, EV_KEY, BTN_SOUTH, i / 10 % 2 == 0);
	expect(evdev, EV_SYN, SYN_REPORT, 0);
	/* The stamp has whole microseconds. */
	NEED(stamped_ns >= sent_ns - 1000 && stamped_ns <= read_ns);
	*whole_ns = read_ns - sent_ns;
	*stamp_ns = read_ns - stamped_ns;
}

int main(int argc, char **argv)
{
	const int paced = argc > 1 && !strcmp(argv[1], "paced");
	static int64_t whole_ns[MOVES], stamp_ns[MOVES];
	struct input_event event;
	int uinput = plug_in(), evdev = open_evdev();

	NEED(evdev >= 0);
	if (paced)
		pause_ns(1000000000);
	for (int i = 0; i < MOVES; i++) {
		one_move(uinput, evdev, i, &whole_ns[i], &stamp_ns[i]);
		if (paced)
			pause_ns(1000000);
	}
	NEED(ioctl(uinput, UI_DEV_DESTROY) == 0);
	NEED(read(evdev, &event, sizeof event) < 0 && errno == ENODEV);
	printf("{\"moves\": %d", MOVES);
	print_latency("uinput_to_reader", whole_ns, MOVES);
	print_latency("stamp_to_reader", stamp_ns, MOVES);
	puts("}");
	return 0;
}
