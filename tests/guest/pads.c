/*
 * tests/guest/pads.c: in a guest: gamepads before the kernel, read by the shipped drivers, made to rumble, unplugged
 * and plugged in again.
 *
 *   pads uhid [CYCLES]   each HID pad as a uhid device, read through hidapi (hidraw) and libevdev at once
 *   pads usb [CYCLES]    each as a USB device behind vhci (usbhid, hid-logitech with its motors), likewise; and an Xbox
 *                        receiver by libusb, then by the kernel's own xpad and libevdev. Wants udevd.
 *
 * CYCLES of unplug and replug, 3 unless told. One JSON line on stdout. PAD_BY_p50_ns and so on are from a packet's
 * readiness at the pad to the stamp the kernel or libusb's thread gives it; user_us_p50 and so on to the report in the
 * caller's hands, who looks every 100 us. Exit 0 all right, 1 something failed, 77 neither uhid nor vhci here.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/gamepad_evdev.h"
#include "drivers/gamepad_hid.h"
#include "drivers/gamepad_xusb.h"
#include "tests/guest/measure.h"
#include "tests/guest/wire_pad.h"

#define MS INT64_C(1000000)
#define LOOK_NS (MS / 10)   /* while latency is measured; else every ms */
#define SAMPLES_MAX 1000

enum by { BY_HID, BY_EVDEV, BY_LIBUSB, N_BY };
static const char *const by_names[N_BY] = { "hid", "evdev", "libusb" };

static const struct kind {
	enum sim_peer_kind kind;
	const char *name;
	enum bb_pad_model model;
	bool usb;              /* on vhci only */
	const char *uri[N_BY]; /* NULL: not read that way */
} kinds[] = {
	{ SIM_PEER_RUMBLEPAD2_WIRED,
	  "rumblepad2-wired",
	  BB_PAD_RUMBLEPAD2,
	  false,
	  { "hid:046d:c218", "evdev:046d:c218", NULL } },
	{ SIM_PEER_RUMBLEPAD2_WIRELESS,
	  "rumblepad2-wireless",
	  BB_PAD_RUMBLEPAD2,
	  false,
	  { "hid:046d:c219", "evdev:046d:c219", NULL } },
	{ SIM_PEER_SPACENAVIGATOR,
	  "spacenavigator",
	  BB_PAD_SPACEMOUSE,
	  false,
	  { "hid:046d:c626", "evdev:046d:c626", NULL } },
	{ SIM_PEER_SPACEMOUSE_WIRELESS,
	  "spacemouse-wireless",
	  BB_PAD_SPACEMOUSE,
	  false,
	  { "hid:256f:c62e", "evdev:256f:c62e", NULL } },
	{ SIM_PEER_XBOX_PAD,
	  "xbox360-xpad",
	  BB_PAD_XBOX360,
	  true,
	  { NULL, "evdev:045e:02a1", NULL } }, /* as xpad calls the pads of a receiver */
	{ SIM_PEER_XBOX_PAD, "xbox360-receiver", BB_PAD_XBOX360, true, { NULL, NULL, "usb:045e:0719?slot=1" } },
};

struct reader {
	struct bb_gamepad *g;
	struct bb_uri uri;
	struct bb_open open;
	enum by by;
	long reports, wrong_axes, wrong_order;
	enum bb_status status;
	struct bb_pad_report last;
	int64_t user_ns[SAMPLES_MAX], stamp_ns[SAMPLES_MAX];
	size_t n_latency;
	bool rumbles;
	const char *failure;
};

struct bench {
	struct bb_clock *clk;
	struct pad_wire wire;
	const struct kind *kind;
	struct reader reader[N_BY];
	bool measures;
	int64_t lost_ns[N_BY], back_ns[N_BY]; /* the longest */
};

static int64_t now(const struct bench *b)
{
	return bb_clock_now_ns(b->clk);
}

/* What is read must be near what the hand does now: a script at rest between its moves is compared there only. */
static void compare(struct bench *b, struct reader *r)
{
	struct sim_pad_state truth;

	pad_wire_lock(&b->wire);
	sim_peer_pad_truth(b->wire.peer, &truth);
	pad_wire_unlock(&b->wire);
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (fabs((double)r->last.axis[i] - truth.axis[i]) > 0.2)
			r->wrong_axes++;
}

/* From the newest packet: they are 8 ms apart or more, and no way is as long as that. */
static void note_latency(struct bench *b, struct reader *r, int64_t at_ns)
{
	pad_wire_lock(&b->wire);
	const int64_t said_ns = bb_clock_from_monotonic_ns(b->clk, b->wire.said_ns);
	pad_wire_unlock(&b->wire);
	if (r->n_latency == SAMPLES_MAX)
		return;
	r->user_ns[r->n_latency] = now(b) - said_ns;
	r->stamp_ns[r->n_latency++] = at_ns - said_ns;
}

static void drain(struct bench *b, struct reader *r)
{
	struct bb_pad_report reports[16];
	size_t n = 0;

	if (!r->g)
		return;
	while ((r->status = bb_gamepad_read(r->g, reports, BB_ARRAY_LEN(reports), &n)) == BB_OK) {
		if (b->measures)
			note_latency(b, r, reports[n - 1].at_ns);
		for (size_t i = 0; i < n; i++) {
			r->wrong_order += r->reports && reports[i].at_ns <= r->last.at_ns;
			r->last = reports[i];
			r->reports++;
		}
	}
}

static void pass(struct bench *b, int64_t for_ns)
{
	const int64_t end_ns = now(b) + for_ns;

	while (now(b) < end_ns) {
		bb_clock_run_until(b->clk, now(b) + (b->measures ? LOOK_NS : MS));
		for (int i = 0; i < N_BY; i++)
			drain(b, &b->reader[i]);
	}
}

static void fail(struct reader *r, const char *why)
{
	if (!r->failure)
		r->failure = why;
}

/* The nodes need a moment to appear. */
static void open_reader(struct bench *b, struct reader *r)
{
	static const struct bb_gamepad_driver *const drivers[N_BY] = { &bb_gamepad_hid_driver, &bb_gamepad_evdev_driver,
								       &bb_gamepad_xusb_driver };
	struct bb_gamepad_config c = { .id = "pad", .model = b->kind->model };
	enum bb_status status = BB_ERR_LOST;

	if (!b->kind->uri[r->by] || bb_uri_parse(b->kind->uri[r->by], &r->uri, NULL, NULL) != BB_OK)
		return;
	r->open = (struct bb_open){ .clk = b->clk, .uri = &r->uri };
	for (int i = 0; i < 40 && status != BB_OK; i++) {
		pass(b, 50 * MS);
		status = bb_gamepad_open(drivers[r->by], &c, &r->open, &r->g);
	}
	if (status != BB_OK)
		fail(r, status == BB_ERR_FORMAT ? "descriptor refused" : "does not open");
}

static void close_reader(struct reader *r)
{
	bb_gamepad_close(r->g);
	r->g = NULL;
}

static void check_rumble(struct bench *b, struct reader *r)
{
	float strong = 0, weak = 0;

	if (!r->g || r->failure || !bb_gamepad_limits(r->g)->has_rumble)
		return;
	if (bb_gamepad_rumble(r->g, 1, 0.5f) != BB_OK)
		fail(r, "rumble refused");
	pass(b, 200 * MS);
	pad_wire_lock(&b->wire);
	const bool told = sim_peer_pad_rumble(b->wire.peer, &strong, &weak);
	pad_wire_unlock(&b->wire);
	if (!told || fabsf(strong - 1) > 0.02f || fabsf(weak - 0.5f) > 0.02f)
		fail(r, told ? "rumble arrived as another" : "rumble did not arrive");
	(void)!bb_gamepad_rumble(r->g, 0, 0);
	pass(b, 200 * MS);
	r->rumbles = true;
}

/* How long until each reader says so. */
static void wait_status(struct bench *b, bool lost, int64_t worst_ns[N_BY])
{
	const int64_t from_ns = now(b);
	int left = N_BY;
	bool done[N_BY] = { false };

	while (now(b) - from_ns < 15000 * MS && left) {
		pass(b, MS);
		for (int i = 0; i < N_BY; i++) {
			struct reader *r = &b->reader[i];
			if (done[i] || (r->g && (r->status == BB_ERR_LOST) != lost))
				continue;
			done[i] = true;
			left--;
			if (r->g && now(b) - from_ns > worst_ns[i])
				worst_ns[i] = now(b) - from_ns;
		}
	}
	for (int i = 0; i < N_BY; i++)
		if (!done[i])
			fail(&b->reader[i], lost ? "unplug not seen" : "does not come back");
}

static void cycle(struct bench *b, int i)
{
	/* The kernel takes some 50 ms to take a uhid device away; from there on it is the readers' time. Behind vhci
	 * its hub looks at its ports now and then. */
	const int64_t most_ns = b->wire.usb ? 500 * MS : 50 * MS;

	pad_wire_plug(&b->wire, false);
	wait_status(b, true, b->lost_ns);
	for (int r = 0; r < N_BY; r++)
		if (b->lost_ns[r] > most_ns)
			fail(&b->reader[r], "unplug seen too late");
	pass(b, 100 * MS);
	pad_wire_plug(&b->wire, true);
	wait_status(b, false, b->back_ns);
	pass(b, 300 * MS);
	if (i % 4 != 3)
		return;
	for (int r = 0; r < N_BY;
	     r++) { /* more than five returns in a minute are a quarantine: a person opens it again */
		close_reader(&b->reader[r]);
		open_reader(b, &b->reader[r]);
	}
}

static bool failed(const struct bench *b)
{
	for (int i = 0; i < N_BY; i++)
		if (b->reader[i].failure)
			return true;
	return b->wire.failed;
}

static void run(struct bench *b, int cycles)
{
	for (int i = 0; i < N_BY; i++) {
		b->reader[i].by = (enum by)i;
		open_reader(b, &b->reader[i]);
	}
	pass(b, 500 * MS); /* what waited since the plug */
	b->measures = true;
	pass(b, 3500 * MS);
	b->measures = false;
	for (int i = 0; i < N_BY; i++) {
		struct reader *r = &b->reader[i];
		if (r->g && r->reports < (i == BY_EVDEV ? 10 : 100))
			fail(r, "too few reports");
		if (r->g)
			compare(b, r);
		check_rumble(b, r);
	}
	for (int i = 0; i < cycles && !failed(b); i++)
		cycle(b, i);
	for (int i = 0; i < N_BY; i++) {
		if (b->reader[i].wrong_axes)
			fail(&b->reader[i], "axes are not what the hand does");
		if (b->reader[i].wrong_order)
			fail(&b->reader[i], "stamps do not ascend");
		close_reader(&b->reader[i]);
	}
	pass(b, 50 * MS);
	if (b->wire.failed)
		fail(&b->reader[b->kind->uri[BY_LIBUSB] ? BY_LIBUSB : BY_EVDEV], "the wire failed");
	if (b->wire.uhid && sim_uhid_is_open(b->wire.uhid))
		fail(&b->reader[0], "a handle stayed open");
}

static void print_latency_of(const struct kind *k, struct reader *r)
{
	char name[48];

	snprintf(name, sizeof(name), "%s_%s", k->name, by_names[r->by]);
	for (char *c = name; *c; c++)
		*c = *c == '-' ? '_' : *c;
	if (!r->n_latency)
		return;
	print_seen("user", r->user_ns, r->n_latency);
	if (r->by != BY_HID) /* hidraw has no stamps: the driver's is that of the look */
		print_latency(name, r->stamp_ns, r->n_latency);
}

/* One row a reader. */
static bool print(struct bench *b, bool *first)
{
	bool ok = true;

	for (int i = 0; i < N_BY; i++) {
		struct reader *r = &b->reader[i];
		if (!b->kind->uri[i])
			continue;
		printf("%s{\"pad\":\"%s\",\"by\":\"%s\",\"ok\":%s,\"reports\":%ld,\"rumbles\":%s,\"lost_ms\":%.1f,"
		       "\"back_ms\":%.1f%s%s%s",
		       *first ? "" : ",", b->kind->name, by_names[i], r->failure ? "false" : "true", r->reports,
		       r->rumbles ? "true" : "false", (double)b->lost_ns[i] * 1e-6, (double)b->back_ns[i] * 1e-6,
		       r->failure ? ",\"why\":\"" : "", r->failure ? r->failure : "", r->failure ? "\"" : "");
		print_latency_of(b->kind, r);
		printf("}");
		*first = false;
		ok &= !r->failure;
	}
	return ok;
}

/* 0 ok, 1 failed, 77 not here. */
static int one(const struct kind *k, bool usb, int cycles, unsigned int *port, bool *first)
{
	struct bench b = { .kind = k };
	int code = 1;

	if (bb_clock_posix_create(&b.clk) != BB_OK)
		return 1;
	const enum bb_status status = pad_wire_begin(&b.wire, k->kind, "", usb, *port);
	if (status == BB_ERR_UNSUPPORTED)
		code = 77;
	if (status == BB_OK) {
		run(&b, cycles);
		code = print(&b, first) ? 0 : 1;
	}
	*port = (b.wire.port + 1) % 8; /* the kernel lets go of a port when it comes to it */
	pad_wire_end(&b.wire);
	bb_clock_destroy(b.clk);
	return code;
}

int main(int argc, char **argv)
{
	const long cycles = argc > 2 ? strtol(argv[2], NULL, 10) : 3;
	const bool usb = argc > 1 && !strcmp(argv[1], "usb");
	const long before = descriptors();
	unsigned int port = 0;
	bool first = true;
	int code = 0;

	if (argc < 2 || argc > 3 || (!usb && strcmp(argv[1], "uhid") != 0) || cycles < 0 || cycles > 10000) {
		fprintf(stderr, "usage: pads uhid|usb [CYCLES]\n");
		return 2;
	}
	printf("{\"test\":\"pads\",\"wire\":\"%s\",\"cycles\":%ld,\"rows\":[", argv[1], cycles);
	for (size_t i = 0; i < BB_ARRAY_LEN(kinds) && code != 77; i++) {
		const int one_code = kinds[i].usb && !usb ? 0 : one(&kinds[i], usb, (int)cycles, &port, &first);
		code = one_code ? one_code : code;
	}
	const long leaked = descriptors() - before;
	if (leaked > 1 && !code) /* hidapi and udev may keep one for themselves */
		code = 1;
	printf("],\"fd_leaked\":%ld,\"result\":\"%s\"}\n", leaked, code == 77 ? "skipped" : code ? "failed" : "ok");
	if (code == 77)
		printf("SKIP: no %s here\n", usb ? "vhci" : "/dev/uhid");
	return code;
}
