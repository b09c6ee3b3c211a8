/*
 * tests/guest/pads.c: in a guest with uhid, hidraw and evdev: each HID gamepad is made as a uhid device, read by the
 * shipped drivers through hidapi and through libevdev, made to rumble, and unplugged and plugged in again.
 *
 *   pads [CYCLES]     default 3. One JSON line on stdout. Exit 0 all right, 1 something failed, 77 no uhid here.
 *
 * One thread: peers, the kernel's device and drivers are stepped in turn on the posix clock.
 */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/gamepad_evdev.h"
#include "drivers/gamepad_hid.h"
#include "sim/uhid.h"

#define MS INT64_C(1000000)

static const struct kind {
	enum sim_peer_kind kind;
	const char *name, *hid, *evdev;
	enum bb_pad_model model;
} kinds[] = {
	{ SIM_PEER_RUMBLEPAD2_WIRED, "rumblepad2-wired", "hid:046d:c218", "evdev:046d:c218", BB_PAD_RUMBLEPAD2 },
	{ SIM_PEER_RUMBLEPAD2_WIRELESS, "rumblepad2-wireless", "hid:046d:c219", "evdev:046d:c219", BB_PAD_RUMBLEPAD2 },
	{ SIM_PEER_SPACENAVIGATOR, "spacenavigator", "hid:046d:c626", "evdev:046d:c626", BB_PAD_SPACEMOUSE },
	{ SIM_PEER_SPACEMOUSE_WIRELESS, "spacemouse-wireless", "hid:256f:c62e", "evdev:256f:c62e", BB_PAD_SPACEMOUSE },
};

struct reader {
	struct bb_gamepad *g;
	struct bb_uri uri;
	struct bb_open open;
	bool evdev;
	long reports, wrong_axes, wrong_order;
	enum bb_status status;
	struct bb_pad_report last;
	int64_t late_most_ns;
	const char *failure;
};

struct bench {
	struct bb_clock *clk;
	struct sim_peer_pad *peer;
	struct sim_uhid *uhid;
	struct reader reader[2]; /* hid, evdev */
	int64_t lost_ns[2], back_ns[2]; /* the longest */
};

static long descriptors(void)
{
	DIR *d = opendir("/proc/self/fd");
	long n = 0;

	while (d && readdir(d))
		n++;
	if (d)
		closedir(d);
	return n;
}

static int64_t now(const struct bench *b)
{
	return bb_clock_now_ns(b->clk);
}

/* What is read must be near what the hand does now: a script at rest between its moves is compared there only. */
static void compare(struct bench *b, struct reader *r)
{
	struct sim_pad_state truth;

	sim_peer_pad_truth(b->peer, &truth);
	const bool armed = r->evdev ? bb_gamepad_evdev_core(r->g)->armed : bb_gamepad_hid_core(r->g)->armed;
	for (size_t i = 0; armed && i < BB_PAD_AXES; i++)
		if (fabs((double)r->last.axis[i] - truth.axis[i]) > 0.2)
			r->wrong_axes++;
}

static void drain(struct bench *b, struct reader *r)
{
	struct bb_pad_report reports[16];
	size_t n = 0;

	if (!r->g)
		return;
	while ((r->status = bb_gamepad_read(r->g, reports, BB_ARRAY_LEN(reports), &n)) == BB_OK)
		for (size_t i = 0; i < n; i++) {
			r->wrong_order += r->reports && reports[i].at_ns <= r->last.at_ns;
			r->last = reports[i];
			r->reports++;
			const int64_t late_ns = now(b) - r->last.at_ns;
			r->late_most_ns = late_ns > r->late_most_ns ? late_ns : r->late_most_ns;
		}
}

static void pass(struct bench *b, int64_t for_ns)
{
	const int64_t end_ns = now(b) + for_ns;

	while (now(b) < end_ns) {
		bb_clock_run_until(b->clk, now(b) + MS);
		if (sim_uhid_step(b->uhid) == BB_ERR_IO)
			b->reader[0].failure = "uhid refused";
		for (int i = 0; i < 2; i++)
			drain(b, &b->reader[i]);
	}
}

static void fail(struct reader *r, const char *why)
{
	if (!r->failure)
		r->failure = why;
}

/* The nodes need a moment to appear. */
static void open_reader(struct bench *b, struct reader *r, const struct kind *k)
{
	const struct bb_gamepad_driver *driver = r->evdev ? &bb_gamepad_evdev_driver : &bb_gamepad_hid_driver;
	struct bb_gamepad_config c = { .id = "pad", .model = k->model };
	enum bb_status status = BB_ERR_LOST;

	if (bb_uri_parse(r->evdev ? k->evdev : k->hid, &r->uri, NULL, NULL) != BB_OK) {
		fail(r, "uri");
		return;
	}
	r->open = (struct bb_open){ .clk = b->clk, .uri = &r->uri };
	for (int i = 0; i < 40 && status != BB_OK; i++) {
		pass(b, 50 * MS);
		status = bb_gamepad_open(driver, &c, &r->open, &r->g);
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
	pass(b, 100 * MS);
	if (!sim_peer_pad_rumble(b->peer, &strong, &weak) || fabsf(strong - 1) > 0.02f || fabsf(weak - 0.5f) > 0.02f)
		fail(r, "rumble did not arrive");
	(void)!bb_gamepad_rumble(r->g, 0, 0);
	pass(b, 100 * MS);
}

/* How long until each reader says so. */
static void wait_status(struct bench *b, bool lost, int64_t worst_ns[2])
{
	const int64_t from_ns = now(b);
	bool done[2] = { false, false };

	while (now(b) - from_ns < 12000 * MS && !(done[0] && done[1])) {
		pass(b, MS);
		for (int i = 0; i < 2; i++) {
			struct reader *r = &b->reader[i];
			if (done[i] || (r->g && (r->status == BB_ERR_LOST) != lost))
				continue;
			done[i] = true;
			if (now(b) - from_ns > worst_ns[i])
				worst_ns[i] = now(b) - from_ns;
		}
	}
	for (int i = 0; i < 2; i++)
		if (!done[i])
			fail(&b->reader[i], lost ? "unplug not seen" : "does not come back");
}

static void cycle(struct bench *b, const struct kind *k, int i)
{
	sim_peer_pad_unplug(b->peer, true);
	if (sim_uhid_step(b->uhid) != BB_OK) /* the kernel takes some 50 ms to take a device away: not the readers' time */
		fail(&b->reader[0], "uhid refused");
	wait_status(b, true, b->lost_ns);
	for (int r = 0; r < 2; r++)
		if (b->lost_ns[r] > 50 * MS)
			fail(&b->reader[r], "unplug seen too late");
	pass(b, 100 * MS);
	sim_peer_pad_unplug(b->peer, false);
	wait_status(b, false, b->back_ns);
	pass(b, 300 * MS);
	if (i % 4 != 3)
		return;
	for (int r = 0; r < 2; r++) { /* more than five returns in a minute are a quarantine: a person opens it again */
		close_reader(&b->reader[r]);
		open_reader(b, &b->reader[r], k);
	}
}

static void run(struct bench *b, const struct kind *k, int cycles)
{
	for (int i = 0; i < 2; i++) {
		b->reader[i].evdev = i == 1;
		open_reader(b, &b->reader[i], k);
	}
	pass(b, 4000 * MS);
	for (int i = 0; i < 2; i++) {
		struct reader *r = &b->reader[i];
		if (r->g && r->reports < (i ? 10 : 100))
			fail(r, "too few reports");
		if (r->g)
			compare(b, r);
		check_rumble(b, r);
	}
	for (int i = 0; i < cycles && !b->reader[0].failure && !b->reader[1].failure; i++)
		cycle(b, k, i);
	for (int i = 0; i < 2; i++) {
		if (b->reader[i].wrong_axes)
			fail(&b->reader[i], "axes are not what the hand does");
		if (b->reader[i].wrong_order)
			fail(&b->reader[i], "stamps do not ascend");
		close_reader(&b->reader[i]);
	}
	pass(b, 50 * MS);
	if (sim_uhid_is_open(b->uhid))
		fail(&b->reader[0], "a handle stayed open");
}

static bool print(const struct bench *b, const struct kind *k, bool first)
{
	bool ok = true;

	for (int i = 0; i < 2; i++) {
		const struct reader *r = &b->reader[i];
		printf("%s{\"pad\":\"%s\",\"by\":\"%s\",\"ok\":%s,\"reports\":%ld,\"late_most_us\":%.1f,\"lost_ms\":%.1f,"
		       "\"back_ms\":%.1f%s%s%s}", first && !i ? "" : ",", k->name, i ? "evdev" : "hid", r->failure ? "false" : "true",
		       r->reports, (double)r->late_most_ns * 1e-3, (double)b->lost_ns[i] * 1e-6, (double)b->back_ns[i] * 1e-6,
		       r->failure ? ",\"why\":\"" : "", r->failure ? r->failure : "", r->failure ? "\"" : "");
		ok &= !r->failure;
	}
	return ok;
}

/* 0 ok, 1 failed, 77 not here. */
static int one(const struct kind *k, int cycles, bool first)
{
	struct bench b = { 0 };
	struct sim_peer_config c = { .kind = k->kind, .id = "A1", .script = "", .seed = 7 };
	int code = 1;

	if (bb_clock_posix_create(&b.clk) != BB_OK)
		return 1;
	c.clk = b.clk;
	if (sim_peer_pad_create(&c, &b.peer) == BB_OK) {
		const enum bb_status status = sim_uhid_create(b.peer, &b.uhid);
		if (status == BB_ERR_UNSUPPORTED)
			code = 77;
		if (status == BB_OK) {
			run(&b, k, cycles);
			code = print(&b, k, first) ? 0 : 1;
		}
	}
	sim_uhid_destroy(b.uhid);
	sim_peer_pad_destroy(b.peer);
	bb_clock_destroy(b.clk);
	return code;
}

int main(int argc, char **argv)
{
	const long cycles = argc > 1 ? strtol(argv[1], NULL, 10) : 3;
	const long before = descriptors();
	int code = 0;

	if (argc > 2 || cycles < 0 || cycles > 10000) {
		fprintf(stderr, "usage: pads [CYCLES]\n");
		return 2;
	}
	printf("{\"test\":\"pads\",\"cycles\":%ld,\"rows\":[", cycles);
	for (size_t i = 0; i < BB_ARRAY_LEN(kinds) && code != 77; i++) {
		const int one_code = one(&kinds[i], (int)cycles, i == 0);
		code = one_code ? one_code : code;
	}
	const long leaked = descriptors() - before;
	if (leaked > 1 && !code) /* hidapi and udev may keep one for themselves */
		code = 1;
	printf("],\"fd_leaked\":%ld,\"result\":\"%s\"}\n", leaked, code == 77 ? "skipped: no /dev/uhid" : code ? "failed" : "ok");
	return code;
}
