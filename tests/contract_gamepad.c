/*
 * tests/contract_gamepad.c: the gamepad contract over every back end; what the simulated one and its scripts do; and one
 * script on every rung. With BB_KERNEL=1 the shipped drivers stand before pads of this kernel, too (uhid, vhci, the
 * kernel's own hid-logitech and xpad): tests/guest/ runs it so.
 */
#include "tests/fixture_pads.h"

#include "sim/sim_gamepad.h"
#include "tests/fidelity.h"
#include "tests/gamepad_contract.h"
#include "tests/guest/wire_pad.h"

#include <math.h>
#include <stdio.h>
#include <unistd.h>

enum far { FAR_NONE, FAR_HERE, FAR_UHID, FAR_VHCI }; /* where the far end of a shipped driver's wire is */

static const struct backend {
	const char *name;
	const struct bb_gamepad_driver *driver;
	int fidelity;
	enum bb_pad_model model;
	enum far has_far;
	enum sim_peer_kind far;
	const char *uri; /* NULL: the kind's own */
} backends[] = {
	{ "sim, RumblePad 2", &sim_gamepad_driver, 1, BB_PAD_RUMBLEPAD2, FAR_NONE, 0, NULL },
	{ "sim, SpaceMouse", &sim_gamepad_driver, 1, BB_PAD_SPACEMOUSE, FAR_NONE, 0, NULL },
	{ "sim, Xbox 360", &sim_gamepad_driver, 1, BB_PAD_XBOX360, FAR_NONE, 0, NULL },
	{ "sim, RumblePad 2, fidelity 0", &sim_gamepad_driver, 0, BB_PAD_RUMBLEPAD2, FAR_NONE, 0, NULL },
	{ "hid + peer, RumblePad 2 wired", NULL, 1, BB_PAD_RUMBLEPAD2, FAR_HERE, SIM_PEER_RUMBLEPAD2_WIRED, NULL },
	{ "hid + peer, RumblePad 2 wireless", NULL, 1, BB_PAD_RUMBLEPAD2, FAR_HERE, SIM_PEER_RUMBLEPAD2_WIRELESS, NULL },
	{ "hid + peer, SpaceNavigator", NULL, 1, BB_PAD_SPACEMOUSE, FAR_HERE, SIM_PEER_SPACENAVIGATOR, NULL },
	{ "hid + peer, SpaceMouse Wireless", NULL, 1, BB_PAD_SPACEMOUSE, FAR_HERE, SIM_PEER_SPACEMOUSE_WIRELESS, NULL },
	{ "xusb + peer, Xbox 360", NULL, 1, BB_PAD_XBOX360, FAR_HERE, SIM_PEER_XBOX_PAD, NULL },
	{ "evdev + peer, RumblePad 2", NULL, 1, BB_PAD_RUMBLEPAD2, FAR_HERE, SIM_PEER_RUMBLEPAD2_WIRED,
	  "evdev:046d:c218" },
	{ "evdev + peer, SpaceMouse", NULL, 1, BB_PAD_SPACEMOUSE, FAR_HERE, SIM_PEER_SPACEMOUSE_WIRELESS,
	  "evdev:256f:c62e" },
	{ "evdev + peer, Xbox 360", NULL, 1, BB_PAD_XBOX360, FAR_HERE, SIM_PEER_XBOX_PAD, "evdev:/dev/input/event7" },
};

/* Rows of a kernel: time is waited for there. */
static const struct backend kernel_backends[] = {
	{ "hid, hidraw and uhid, RumblePad 2", &bb_gamepad_hid_driver, 1, BB_PAD_RUMBLEPAD2, FAR_UHID,
	  SIM_PEER_RUMBLEPAD2_WIRED, "hid:046d:c218" },
	{ "hid, usbhid and vhci, RumblePad 2", &bb_gamepad_hid_driver, 1, BB_PAD_RUMBLEPAD2, FAR_VHCI,
	  SIM_PEER_RUMBLEPAD2_WIRELESS, "hid:046d:c219" },
	{ "evdev, hid-logitech and vhci", &bb_gamepad_evdev_driver, 1, BB_PAD_RUMBLEPAD2, FAR_VHCI,
	  SIM_PEER_RUMBLEPAD2_WIRED, "evdev:046d:c218" },
	{ "hid, hidraw and uhid, SpaceNavigator", &bb_gamepad_hid_driver, 1, BB_PAD_SPACEMOUSE, FAR_UHID,
	  SIM_PEER_SPACENAVIGATOR, "hid:046d:c626" },
	{ "hid, usbhid and vhci, SpaceMouse", &bb_gamepad_hid_driver, 1, BB_PAD_SPACEMOUSE, FAR_VHCI,
	  SIM_PEER_SPACEMOUSE_WIRELESS, "hid:256f:c62e" },
	{ "evdev, hid-generic and uhid, SpaceMouse", &bb_gamepad_evdev_driver, 1, BB_PAD_SPACEMOUSE, FAR_UHID,
	  SIM_PEER_SPACEMOUSE_WIRELESS, "evdev:256f:c62e" },
	{ "xusb, libusb and vhci, Xbox 360", &bb_gamepad_xusb_driver, 1, BB_PAD_XBOX360, FAR_VHCI, SIM_PEER_XBOX_PAD,
	  "usb:045e:0719?slot=1" },
	{ "evdev, xpad and vhci, Xbox 360", &bb_gamepad_evdev_driver, 1, BB_PAD_XBOX360, FAR_VHCI, SIM_PEER_XBOX_PAD,
	  "evdev:045e:02a1" }, /* as xpad calls the pads of a receiver */
};

struct bench {
	struct gamepad_bench c;
	struct rig *rig; /* NULL: the far end is the kernel's */
	struct pad_far *far;
	struct kernel_pad {
		struct pad_wire wire;
		struct bb_clock *clk;
		struct bb_uri uri;
	} *kernel;
};

/* The nodes need a moment to appear; the kernel lets go of a port when it comes to it. */
static struct bench begin_in_kernel(const struct backend *b, const char *script)
{
	static unsigned int port;
	struct kernel_pad *k = calloc(1, sizeof(*k));
	struct bb_gamepad_config c = { .id = "pad", .model = b->model };
	enum bb_status status = BB_ERR_LOST;

	assert_non_null(k);
	assert_int_equal(bb_clock_posix_create(&k->clk), BB_OK);
	assert_int_equal(pad_wire_begin(&k->wire, b->far, script, b->has_far == FAR_VHCI, port++ % 8), BB_OK);
	assert_int_equal(bb_uri_parse(b->uri, &k->uri, NULL, NULL), BB_OK);
	const struct bb_open open = { .clk = k->clk, .uri = &k->uri };
	struct bench t = { .c = { .clk = k->clk, .look_ns = RIG_MS }, .kernel = k };
	for (int tries = 0; tries < 100 && status != BB_OK; tries++) {
		bb_clock_run_until(k->clk, bb_clock_now_ns(k->clk) + 20 * RIG_MS);
		status = bb_gamepad_open(b->driver, &c, &open, &t.c.g);
	}
	assert_int_equal(status, BB_OK);
	return t;
}

static struct bench begin_with(const struct backend *b, uint64_t seed, const char *script)
{
	if (b->has_far > FAR_HERE)
		return begin_in_kernel(b, script);
	struct bench t = { .rig = rig_create(seed, b->fidelity) };
	struct bb_gamepad_config c = { .id = "pad", .device = "sim:", .model = b->model };

	t.c.clk = t.rig->clk;
	t.c.look_ns = 10 * RIG_MS;
	snprintf(c.script, sizeof(c.script), "%s", script);
	if (b->has_far) {
		t.far = pad_far_create_uri(t.rig, b->far, script, b->uri ? b->uri : pad_far_uri(b->far));
		assert_int_equal(pad_far_open(t.far, t.rig, &c, &t.c.g), BB_OK);
		return t;
	}
	assert_int_equal(bb_gamepad_open(b->driver, &c, &t.rig->open, &t.c.g), BB_OK);
	return t;
}

static void end_in_kernel(struct kernel_pad *k)
{
	assert_false(k->wire.failed);
	pad_wire_end(&k->wire);
	bb_clock_run_until(k->clk, bb_clock_now_ns(k->clk) + 300 * RIG_MS); /* before the next one comes */
	bb_clock_destroy(k->clk);
	free(k);
}

static void end(struct bench *t)
{
	bb_gamepad_close(t->c.g);
	if (t->kernel) {
		end_in_kernel(t->kernel);
		return;
	}
	pad_far_destroy(t->far);
	rig_destroy(t->rig);
}

static bool changes_only(const struct bench *t)
{
	return bb_gamepad_limits(t->c.g)->most_report_gap_ns == BB_NEVER;
}

static void test_contract(void **state)
{
	(void)state;
	for (size_t b = 0; b < BB_ARRAY_LEN(backends); b++) {
		struct bench t = begin_with(&backends[b], 7, "");
		struct bb_pad_report last = { 0 };
		const long count = gamepad_play(&t.c, 60 * RIG_S, &last);

		print_message("%s: %ld reports in 60 s\n", backends[b].name, count);
		/* Where only changes are told there is no gap that would be a fault, and fewer reports. */
		assert_true(count > (changes_only(&t) ? 500 : 60 * 60 / 3));
		gamepad_bad_calls_are_refused(&t.c);
		gamepad_rumbles_if_it_says_so(&t.c);
		end(&t);
	}
}

/* On every pad and seed: deflected from 2 s to 6 s without a gap, and about two thirds of the time. */
static void test_generated_scripts(void **state)
{
	(void)state;
	static const char *const ids[] = { "pad", "mouse", "p3" };
	double sum = 0;

	for (uint64_t seed = 0; seed < 40; seed++) {
		struct sim_pad_script *s;
		struct sim_pad_state at;
		long away = 0, all = 0;
		assert_int_equal(sim_pad_script_generate(seed, ids[seed % 3], &s), BB_OK);
		for (int64_t t_ns = 0; t_ns <= 60 * RIG_S; t_ns += 5 * RIG_MS, all++) {
			double most = 0;
			sim_pad_script_at(s, t_ns, &at);
			for (size_t i = 0; i < BB_PAD_AXES; i++)
				most = fmax(most, fabs(at.axis[i]));
			assert_true(most <= 1);
			away += most > 0;
			if (t_ns >= 2 * RIG_S && t_ns <= 6 * RIG_S)
				assert_true(most >= 0.25);
		}
		const double share = (double)away / (double)all;
		assert_true(share > 0.55 && share < 0.85);
		sum += share;
		assert_true(sim_pad_script_end_ns(s) > 500 * RIG_S);
		sim_pad_script_free(s);
	}
	print_message("deflected %.1f %% of the time\n", sum / 40 * 100);
	assert_true(fabs(sum / 40 - 2.0 / 3) < 0.06);
}

static void test_idle_is_silent(void **state)
{
	(void)state;
	struct bench t = begin_with(&backends[0], 7, "");
	struct bb_pad_report last = { 0 };

	sim_world_set_scene_start(t.rig->world, 10 * RIG_S);
	assert_int_equal(gamepad_play(&t.c, 10 * RIG_S, &last), 0);
	assert_true(gamepad_play(&t.c, 4 * RIG_S, &last) > 2 * RIG_S / (16 * RIG_MS));
	assert_true(gamepad_deflected(&last));
	end(&t);
}

static void script_file(char path[32], const char *text)
{
	strcpy(path, "/tmp/bb-pad-XXXXXX");
	const int fd = mkstemp(path);
	assert_true(fd >= 0);
	assert_int_equal(write(fd, text, strlen(text)), (ssize_t)strlen(text));
	close(fd);
}

/* What a script asks for arrives, to the step of the model's own counts. */
static void play_script(const struct backend *b, const char *path)
{
	struct bench t = begin_with(b, 7, path);
	const bool has_battery = bb_gamepad_limits(t.c.g)->has_battery, space = b->model == BB_PAD_SPACEMOUSE;
	/* The kernel turns a byte's two middles and xpad's ~y into one step more. */
	const float step = (float)bb_gamepad_limits(t.c.g)->axis_step * (b->uri ? 1.6f : 0.51f);
	struct bb_pad_report last = { 0 };

	gamepad_play(&t.c, 700 * RIG_MS, &last);
	assert_true(fabsf(last.axis[0] - 0.5f) < step);
	gamepad_play(&t.c, 1300 * RIG_MS, &last); /* at 2 s: half way from 0.5 to -1 */
	assert_true(fabsf(last.axis[0] + 0.25f) < 0.03f);
	assert_int_equal(last.buttons, space ? 2 : 6);
	gamepad_play(&t.c, 1200 * RIG_MS, &last); /* at 3.2 s: neutral, said once */
	assert_false(gamepad_deflected(&last));
	assert_int_equal(last.buttons, 0);
	const uint32_t seq = last.seq;
	gamepad_play(&t.c, 700 * RIG_MS, &last);
	assert_int_equal(last.seq, seq);
	gamepad_play(&t.c, 500 * RIG_MS, &last);
	assert_int_equal(last.buttons, space ? 1 : 0x11);
	if (has_battery && !t.far) /* a far end tells its battery now and then only */
		assert_true(fabsf(last.battery - 0.4f) < 1e-6f);
	assert_true(fabsf(last.axis[5] + 1) < 1e-6f && fabsf(last.axis[2] + 0.3f) < step);
	assert_true(fabsf(last.axis[1] - 0.2f) < step && fabsf(last.axis[3]) < 1e-6f && fabsf(last.axis[4] - 1) < 1e-6f);
	gamepad_play(&t.c, RIG_S, &last);
	assert_false(gamepad_deflected(&last));
	end(&t);
}

static void test_script_is_played(void **state)
{
	(void)state;
	char path[32];

	script_file(path, "# a comment\n0.5 axis 1 0.5 0\n1 button 3 down # B\n1 button 2 down\n1.5 axis 1 -1 1.0\n\n"
	                  "3 button 3 up\n3 button 2 up\n3 axis 1 0 0\n3.5 battery 0.4\n"
	                  "4 report 0.1 0.2 -0.3 0 1 -1 0x11\n5 report 0 0 0 0 0 0 0\n");
	for (size_t b = 0; b < BB_ARRAY_LEN(backends); b++)
		play_script(&backends[b], path);
	unlink(path);
}

/* The simulated pad and driver + far end tell of the same hand: the measure of how true the simulation is. */
static void test_sim_and_wire_agree(void **state)
{
	(void)state;
	static const struct {
		size_t sim, wire;
	} pairs[] = { { 0, 4 }, { 0, 5 }, { 1, 6 }, { 1, 7 }, { 2, 8 } };
	struct bb_pad_report a[16], b[16];

	print_message("%-34s %8s %10s %10s %8s\n", "60 s of one script", "reports", "axis/step", "time_us", "buttons");
	for (size_t k = 0; k < BB_ARRAY_LEN(pairs); k++) {
		struct bench ta = begin_with(&backends[pairs[k].sim], 7, "");
		struct bench tb = begin_with(&backends[pairs[k].wire], 7, "");
		long n = 0, wrong = 0;
		double worst = 0;
		int64_t late_ns = 0;
		while (rig_now(ta.rig) < 60 * RIG_S) {
			size_t na = 0, nb = 0;
			rig_pass(ta.rig, 4 * RIG_MS); /* at most one tick of the hand */
			rig_pass(tb.rig, 4 * RIG_MS);
			(void)!bb_gamepad_read(ta.c.g, a, BB_ARRAY_LEN(a), &na);
			(void)!bb_gamepad_read(tb.c.g, b, BB_ARRAY_LEN(b), &nb);
			assert_true(na ? nb >= 1 && nb <= 2 : nb == 0); /* buttons may have a report of their own */
			if (!na)
				continue;
			n++;
			for (size_t i = 0; i < BB_PAD_AXES; i++)
				worst = fmax(worst, (double)fabsf(a[0].axis[i] - b[nb - 1].axis[i]));
			wrong += a[0].buttons != b[nb - 1].buttons;
			late_ns = llabs(a[0].at_ns - b[nb - 1].at_ns) > late_ns ? llabs(a[0].at_ns - b[nb - 1].at_ns) : late_ns;
		}
		worst /= bb_gamepad_limits(tb.c.g)->axis_step;
		print_message("%-34s %8ld %10.3f %10.3f %8ld\n", backends[pairs[k].wire].name, n, worst, (double)late_ns * 1e-3,
		              wrong);
		assert_true(n > 1200 && worst < 0.01 && wrong == 0 && late_ns <= 1000);
		end(&ta);
		end(&tb);
	}
}

static void test_broken_scripts(void **state)
{
	(void)state;
	static const struct {
		const char *text;
		int number, line;
	} bad[] = {
		{ "axis 1 0 0\n", 1331, 1 },
		{ "\n1\n", 1331, 2 },
		{ "1 jump 3\n", 1331, 1 },
		{ "1 axis 1 0.5\n", 1331, 1 },
		{ "1 axis 1 0.5 0 0\n", 1331, 1 },
		{ "1 axis 1.5 0.5 0\n", 1331, 1 },
		{ "1 axis 0 0.5 0\n", 1332, 1 },
		{ "1 axis 7 0.5 0\n", 1332, 1 },
		{ "1 axis 1 1.01 0\n", 1332, 1 },
		{ "1 axis 1 nan 0\n", 1331, 1 },
		{ "1 axis 1 1e999 0\n", 1332, 1 },
		{ "1 axis 1 0x1 0\n", 1331, 1 },
		{ "1 axis 1 0 -1\n", 1332, 1 },
		{ "1 axis 1 0 601\n", 1332, 1 },
		{ "-1 axis 1 0 0\n", 1332, 1 },
		{ "1e9 axis 1 0 0\n", 1332, 1 },
		{ "2 axis 1 0 0\n1 axis 1 0 0\n", 1333, 2 },
		{ "1 button 33 down\n", 1332, 1 },
		{ "1 button 1 pressed\n", 1331, 1 },
		{ "1 button 1\n", 1331, 1 },
		{ "1 battery 1.1\n", 1332, 1 },
		{ "1 battery\n", 1331, 1 },
		{ "1 report 0 0 0 0 0 0\n", 1331, 1 },
		{ "1 report 0 0 0 0 0 0 0xg\n", 1331, 1 },
		{ "1 report 0 0 0 0 0 0 -1\n", 1331, 1 },
		{ "1 report 0 0 0 0 0 0 99999999999\n", 1331, 1 },
		{ "1 report 0 0 0 0 0 2 0\n", 1332, 1 },
		{ "1 axis 1 0 0 a b c d e f g h i j k l m n\n", 1331, 1 },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct sim_pad_script *s;
		struct bb_error err = { 0 };
		char want[64];
		assert_int_equal(sim_pad_script_parse(bad[i].text, strlen(bad[i].text), "p.txt", &s, &err),
		                 BB_ERR_CONFIG);
		assert_null(s);
		assert_int_equal(err.number, bad[i].number);
		snprintf(want, sizeof(want), "p.txt:%d:", bad[i].line);
		assert_non_null(strstr(err.text, want));
	}
}

static void test_hostile_scripts(void **state)
{
	(void)state;
	struct sim_pad_script *s;
	struct bb_error err = { 0 };
	const size_t n = 300 * 1024;
	char *big = malloc(n);

	assert_non_null(big);
	memset(big, '\n', n);
	assert_int_equal(sim_pad_script_parse(big, n, "big", &s, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1334);
	size_t at = 0;
	for (int i = 0; i < 8193; i++) /* one event too many */
		at += (size_t)sprintf(big + at, "1 battery 1\n");
	err.number = 0;
	assert_int_equal(sim_pad_script_parse(big, at, "many", &s, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1334);
	err.number = 0;
	assert_int_equal(sim_pad_script_parse("1 axis 1\0 0 0\n", 14, "zero", &s, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1331);
	err.number = 0;
	assert_int_equal(sim_pad_script_load("/nonexistent/pad.txt", &s, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1001);
	err.number = 0;
	assert_int_equal(sim_pad_script_load("/tmp", &s, &err), BB_ERR_CONFIG); /* a folder */
	assert_int_equal(err.number, 1002);
	assert_int_equal(sim_pad_script_parse("", 0, "empty", &s, NULL), BB_OK);
	sim_pad_script_free(s);
	/* Noise: any answer but a crash. */
	struct sim_rng rng;
	sim_rng_seed(&rng, 1, "test", "noise");
	static const char alphabet[] = "0123456789.-e \n\t#axisbuttonreportbattery";
	for (int round = 0; round < 3000; round++) {
		const size_t len = sim_rng_u64(&rng) % 200;
		for (size_t i = 0; i < len; i++)
			big[i] = alphabet[sim_rng_u64(&rng) % (sizeof(alphabet) - 1)];
		if (sim_pad_script_parse(big, len, "noise", &s, NULL) == BB_OK)
			sim_pad_script_free(s);
	}
	free(big);
}

static void test_committed_scripts(void **state)
{
	(void)state;
	static const char *const paths[] = { "scenes/pads/rumblepad2-walk.txt", "scenes/pads/spacemouse-orbit.txt" };

	for (size_t i = 0; i < BB_ARRAY_LEN(paths); i++) {
		struct sim_pad_script *s;
		struct bb_error err = { 0 };
		if (sim_pad_script_load(paths[i], &s, &err) != BB_OK)
			fail_msg("%s", err.text);
		struct sim_pad_state at;
		for (int64_t t_ns = 2 * RIG_S; t_ns <= 6 * RIG_S; t_ns += RIG_MS) {
			double most = 0;
			sim_pad_script_at(s, t_ns, &at);
			for (size_t k = 0; k < BB_PAD_AXES; k++)
				most = fmax(most, fabs(at.axis[k]));
			assert_true(most > 0.05);
		}
		assert_true(sim_pad_script_end_ns(s) >= 60 * RIG_S);
		sim_pad_script_free(s);
	}
}

/* The first read that answers, within a second. */
static enum bb_status soon(struct bench *t, enum bb_status wanted)
{
	struct bb_pad_report one;
	enum bb_status status = BB_TIMEOUT;
	size_t n;

	for (int i = 0; i < 100 && status != wanted; i++) {
		status = bb_gamepad_read(t->c.g, &one, 1, &n);
		rig_pass(t->rig, 10 * RIG_MS);
	}
	return status;
}

static void faults_of(const struct backend *b)
{
	struct bench t = begin_with(b, 7, "");
	struct bb_pad_report last = { 0 }, one;
	size_t n;

	rig_check_verbs(t.rig, "gamepad", "pad", b->has_far ? sim_peer_pad_verbs : sim_gamepad_verbs);
	rig_pass(t.rig, RIG_S); /* they unplugged it as well */
	(void)soon(&t, BB_OK);
	gamepad_play(&t.c, 3 * RIG_S, &last);
	assert_true(gamepad_deflected(&last));
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "silence", "", true), BB_OK);
	assert_int_equal(gamepad_play(&t.c, RIG_S, &last), 0);
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "silence", "", false), BB_OK);
	last.at_ns = 0; /* the gap is the fault's */
	assert_true(gamepad_play(&t.c, 100 * RIG_MS, &last) > (changes_only(&t) ? -1 : 3));
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "battery", "level=0.05", true), BB_OK);
	gamepad_play(&t.c, 100 * RIG_MS, &last);
	if (bb_gamepad_limits(t.c.g)->has_battery)
		assert_true(fabsf(last.battery - 0.05f) < 0.005f);
	else
		assert_true(isnan(last.battery));
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "battery", "level=0", true), BB_OK);
	assert_int_equal(gamepad_play(&t.c, 200 * RIG_MS, &last), 0);
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "battery", "level=0", false), BB_OK);
	last.at_ns = 0;
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "stick_axis", "axis=3 value=-0.5", true), BB_OK);
	gamepad_play(&t.c, 5 * RIG_S, &last);
	assert_true(fabsf(last.axis[2] + 0.5f) < 0.01f);
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "unplug", "", true), BB_OK);
	assert_int_equal(bb_gamepad_read(t.c.g, &one, 1, &n), BB_ERR_LOST);
	assert_int_equal(bb_gamepad_rumble(t.c.g, 0, 0),
	                 bb_gamepad_limits(t.c.g)->has_rumble ? BB_ERR_LOST : BB_ERR_UNSUPPORTED);
	rig_pass(t.rig, RIG_S);
	assert_int_equal(bb_gamepad_read(t.c.g, &one, 1, &n), BB_ERR_LOST);
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "unplug", "", false), BB_OK);
	assert_int_equal(soon(&t, BB_OK), BB_OK);
	static const char *const bad[][2] = { { "battery", "level=2" }, { "stick_axis", "axis=7" },
		                              { "stick_axis", "value=x" }, { "drift", "offset=nan" } };
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		assert_int_equal(rig_fault(t.rig, "gamepad", "pad", bad[i][0], bad[i][1], true), BB_ERR_CONFIG);
	end(&t);
}

static void test_faults(void **state)
{
	(void)state;
	for (size_t b = 0; b < BB_ARRAY_LEN(backends); b++)
		faults_of(&backends[b]);
}

static void test_unread_reports(void **state)
{
	(void)state;
	struct bench t = begin_with(&backends[0], 7, "");
	struct bb_pad_report reports[200];
	size_t n;

	rig_pass(t.rig, 6 * RIG_S); /* some 330 reports nobody read: the newest stay, the gap shows in seq */
	assert_int_equal(bb_gamepad_read(t.c.g, reports, 200, &n), BB_OK);
	assert_true(n > 60 && n < 200);
	assert_true(reports[0].seq > 0);
	for (size_t i = 1; i < n; i++)
		assert_int_equal(reports[i].seq, reports[i - 1].seq + 1);
	assert_true(rig_now(t.rig) - reports[n - 1].at_ns <= bb_gamepad_limits(t.c.g)->most_report_gap_ns);
	end(&t);
}

static void repeat(const struct backend *back)
{
	struct bb_pad_report a = { 0 }, b = { 0 }, c = { 0 };
	struct bench t = begin_with(back, 7, "");
	const long na = gamepad_play(&t.c, 10 * RIG_S, &a);
	end(&t);
	t = begin_with(back, 7, "");
	const long nb = gamepad_play(&t.c, 10 * RIG_S, &b);
	end(&t);
	t = begin_with(back, 8, "");
	gamepad_play(&t.c, 10 * RIG_S, &c);
	end(&t);
	assert_int_equal(na, nb);
	assert_true(a.at_ns == b.at_ns && a.seq == b.seq && a.buttons == b.buttons);
	assert_memory_equal(a.axis, b.axis, sizeof(a.axis));
	assert_true(a.at_ns != c.at_ns);
}

static void test_repeatable(void **state)
{
	(void)state;
	repeat(&backends[1]);
	repeat(&backends[6]);
	repeat(&backends[8]);
}

static void test_bad_opens(void **state)
{
	(void)state;
	struct rig *rig = rig_create(1, 1);
	struct bb_gamepad_config c = { .id = "pad", .script = "/nonexistent" };
	struct bb_gamepad *g;

	assert_int_equal(bb_gamepad_open(&sim_gamepad_driver, &c, &rig->open, &g), BB_ERR_CONFIG);
	c.script[0] = '\0';
	c.model = (enum bb_pad_model)77;
	assert_int_equal(bb_gamepad_open(&sim_gamepad_driver, &c, &rig->open, &g), BB_ERR_CONFIG);
	assert_null(g);
	rig_destroy(rig);
}

/* One script on every rung: what a user of the pad sees change. ------------------------------------------------- */

/* One thing at a time, since a SpaceNavigator tells moves and turns apart. Pulled out from 2.7 s to 3.1 s; then it has time
 * to be found again, its stick deflected already, which moves nothing before it was neutral once (row H1). */
static const char rung_script[] = "1.2 axis 1 0.5 0\n1.3 axis 1 -1 0\n1.4 axis 1 0 0\n1.5 axis 2 0.3 0\n1.6 axis 2 0 0\n"
				  "1.7 button 1 down\n1.8 button 1 up\n1.9 button 2 down\n2 button 2 up\n"
				  "2.1 axis 5 1 0\n2.2 axis 5 0 0\n2.3 axis 3 -0.7 0\n2.4 axis 3 0 0\n"
				  "2.9 axis 2 -0.5 0\n4.6 axis 2 0 0\n4.8 axis 1 0.8 0.4\n5.3 axis 1 0 0\n";
#define UNPLUG_NS (2700 * RIG_MS)
#define OUT_NS (400 * RIG_MS)
#define SCRIPT_NS (5500 * RIG_MS)
#define GONE_NS (50 * RIG_MS) /* row H1 */

struct rung {
	const struct backend *backend;
	struct fid_log log;
	int tenth[BB_PAD_AXES];
	uint32_t buttons;
	struct bb_pad_report last;
	struct bb_gamepad_limits limits;
	long reports;
};

/* A stamp is the sender's or the kernel's, or that of a look at a wire; and a pad tells a change with its next report. */
static int64_t stamp_within_ns(const struct bench *t)
{
	if (t->kernel)
		return t->c.look_ns + PAD_WIRE_STEP_MS * RIG_MS;
	return t->far ? t->c.look_ns : bb_gamepad_limits(t->c.g)->most_report_gap_ns;
}

static void note_report(struct rung *r, const struct bench *t, const struct bb_pad_report *report)
{
	int tenth[BB_PAD_AXES];

	for (size_t i = 0; i < BB_PAD_AXES; i++)
		tenth[i] = (int)lround((double)report->axis[i] * 10);
	if (!memcmp(tenth, r->tenth, sizeof(tenth)) && report->buttons == r->buttons)
		return;
	memcpy(r->tenth, tenth, sizeof(tenth));
	r->buttons = report->buttons;
	fid_note(&r->log, report->at_ns, stamp_within_ns(t), "axes %d %d %d %d %d %d tenths, buttons 0x%x", tenth[0],
	         tenth[1], tenth[2], tenth[3], tenth[4], tenth[5], r->buttons);
}

static void watch(struct rung *r, struct bench *t, int64_t until_ns)
{
	struct bb_pad_report reports[16];
	size_t n;

	while (bb_clock_now_ns(t->c.clk) < until_ns) {
		bb_clock_run_until(t->c.clk, bb_clock_now_ns(t->c.clk) + t->c.look_ns);
		while (bb_gamepad_read(t->c.g, reports, BB_ARRAY_LEN(reports), &n) == BB_OK)
			for (size_t i = 0; i < n; i++, r->reports++) {
				gamepad_check_report(&t->c, &reports[i], &r->last);
				r->last = reports[i];
				note_report(r, t, &reports[i]);
			}
	}
}

static void plug(struct bench *t, bool on)
{
	if (t->kernel)
		pad_wire_plug(&t->kernel->wire, on);
	else
		assert_int_equal(rig_fault(t->rig, "gamepad", "pad", "unplug", "", !on), BB_OK);
}

static void wait_for(struct rung *r, struct bench *t, bool lost, int64_t within_ns)
{
	const int64_t begun_ns = bb_clock_now_ns(t->c.clk);
	struct bb_pad_report one;
	size_t n;

	while ((bb_gamepad_read(t->c.g, &one, 1, &n) == BB_ERR_LOST) != lost) {
		assert_true(bb_clock_now_ns(t->c.clk) - begun_ns <= within_ns);
		bb_clock_run_until(t->c.clk, bb_clock_now_ns(t->c.clk) + t->c.look_ns);
	}
	fid_note(&r->log, bb_clock_now_ns(t->c.clk), within_ns, lost ? "gone" : "back");
}

/* Drivers look for it again after pauses that double, give or take a fifth: it may be out that long once more and a half.
 * A kernel takes some half a second to know a USB device. */
static int64_t back_within_ns(const struct bench *t)
{
	return t->kernel ? 3 * (OUT_NS + 100 * RIG_MS) : t->far ? OUT_NS * 3 / 2 : t->c.look_ns;
}

static void play_rung(struct rung *r, const char *path)
{
	struct bench t = begin_with(r->backend, 7, path);

	r->limits = *bb_gamepad_limits(t.c.g);
	if (!t.kernel)
		t.c.look_ns = RIG_MS;
	watch(r, &t, UNPLUG_NS);
	plug(&t, false);
	wait_for(r, &t, true, t.kernel ? GONE_NS : t.c.look_ns);
	r->last.at_ns = 0; /* a new life */
	watch(r, &t, bb_clock_now_ns(t.c.clk) + OUT_NS);
	plug(&t, true);
	wait_for(r, &t, false, back_within_ns(&t));
	watch(r, &t, SCRIPT_NS);
	if (t.kernel) {
		assert_true(r->reports >= (changes_only(&t) ? 20 : 60));
		gamepad_bad_calls_are_refused(&t.c);
		gamepad_rumbles_if_it_says_so(&t.c);
	}
	end(&t);
}

static bool in_kernel(void)
{
	const char *told = getenv("BB_KERNEL");

	return told && !strcmp(told, "1");
}

static int rungs_of(enum bb_pad_model model, const char *path)
{
	static const char *const names[] = { "rumblepad2", "spacemouse", "xbox360" };
	struct rung *rung = calloc(BB_ARRAY_LEN(backends) + BB_ARRAY_LEN(kernel_backends), sizeof(*rung));
	const struct fid_log *logs[BB_ARRAY_LEN(backends) + BB_ARRAY_LEN(kernel_backends)];
	bool tells_battery = false;
	size_t n = 0;

	assert_non_null(rung);
	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++)
		if (backends[i].model == model && backends[i].fidelity)
			rung[n++].backend = &backends[i];
	for (size_t i = 0; i < BB_ARRAY_LEN(kernel_backends) && in_kernel(); i++)
		if (kernel_backends[i].model == model)
			rung[n++].backend = &kernel_backends[i];
	for (size_t i = 0; i < n; i++) {
		rung[i].log.rung = rung[i].backend->name;
		play_rung(&rung[i], path);
		logs[i] = &rung[i].log;
		tells_battery |= i && rung[i].limits.has_battery;
	}
	/* A simulated pad can what some driver can with such a pad, and no more. */
	assert_int_equal(rung[0].limits.has_battery, tells_battery);
	assert_int_equal(rung[0].limits.has_rumble, rung[1].limits.has_rumble);
	const int differ = fid_table(names[model], logs, n);
	free(rung);
	return differ;
}

static void test_every_rung_tells_the_same(void **state)
{
	char path[32];
	int differ = 0;

	(void)state;
	script_file(path, rung_script);
	for (int model = BB_PAD_RUMBLEPAD2; model <= BB_PAD_XBOX360; model++)
		differ += rungs_of((enum bb_pad_model)model, path);
	unlink(path);
	assert_int_equal(differ, 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_contract),         cmocka_unit_test(test_generated_scripts),
		cmocka_unit_test(test_idle_is_silent),   cmocka_unit_test(test_script_is_played),
		cmocka_unit_test(test_broken_scripts),   cmocka_unit_test(test_hostile_scripts),
		cmocka_unit_test(test_committed_scripts), cmocka_unit_test(test_faults),
		cmocka_unit_test(test_unread_reports),   cmocka_unit_test(test_repeatable),
		cmocka_unit_test(test_bad_opens),         cmocka_unit_test(test_sim_and_wire_agree),
	};
	const struct CMUnitTest rungs[] = { cmocka_unit_test(test_every_rung_tells_the_same) };
	const int failed = in_kernel() ? 0 : cmocka_run_group_tests(tests, NULL, NULL);

	return failed + cmocka_run_group_tests(rungs, NULL, NULL);
}
