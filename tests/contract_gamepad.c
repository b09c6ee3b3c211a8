/* tests/contract_gamepad.c: what every gamepad back end must do, and what the simulated one and its scripts do. */
#include "tests/fixture_pads.h"

#include "sim/sim_gamepad.h"

#include <math.h>
#include <stdio.h>
#include <unistd.h>

static const struct backend {
	const char *name;
	const struct bb_gamepad_driver *driver;
	int fidelity;
	enum bb_pad_model model;
	bool has_far; /* a shipped driver before a far end of this kind */
	enum sim_peer_kind far;
	const char *uri; /* NULL: the kind's own */
} backends[] = {
	{ "sim, RumblePad 2", &sim_gamepad_driver, 1, BB_PAD_RUMBLEPAD2, false, 0, NULL },
	{ "sim, SpaceMouse", &sim_gamepad_driver, 1, BB_PAD_SPACEMOUSE, false, 0, NULL },
	{ "sim, Xbox 360", &sim_gamepad_driver, 1, BB_PAD_XBOX360, false, 0, NULL },
	{ "sim, RumblePad 2, fidelity 0", &sim_gamepad_driver, 0, BB_PAD_RUMBLEPAD2, false, 0, NULL },
	{ "hid + peer, RumblePad 2 wired", NULL, 1, BB_PAD_RUMBLEPAD2, true, SIM_PEER_RUMBLEPAD2_WIRED, NULL },
	{ "hid + peer, RumblePad 2 wireless", NULL, 1, BB_PAD_RUMBLEPAD2, true, SIM_PEER_RUMBLEPAD2_WIRELESS, NULL },
	{ "hid + peer, SpaceNavigator", NULL, 1, BB_PAD_SPACEMOUSE, true, SIM_PEER_SPACENAVIGATOR, NULL },
	{ "hid + peer, SpaceMouse Wireless", NULL, 1, BB_PAD_SPACEMOUSE, true, SIM_PEER_SPACEMOUSE_WIRELESS, NULL },
	{ "xusb + peer, Xbox 360", NULL, 1, BB_PAD_XBOX360, true, SIM_PEER_XBOX_PAD, NULL },
	{ "evdev + peer, RumblePad 2", NULL, 1, BB_PAD_RUMBLEPAD2, true, SIM_PEER_RUMBLEPAD2_WIRED, "evdev:046d:c218" },
	{ "evdev + peer, SpaceMouse", NULL, 1, BB_PAD_SPACEMOUSE, true, SIM_PEER_SPACEMOUSE_WIRELESS, "evdev:256f:c62e" },
	{ "evdev + peer, Xbox 360", NULL, 1, BB_PAD_XBOX360, true, SIM_PEER_XBOX_PAD, "evdev:/dev/input/event7" },
};

struct bench {
	struct rig *rig;
	struct bb_gamepad *g;
	struct pad_far *far;
};

static struct bench begin_with(const struct backend *b, uint64_t seed, const char *script)
{
	struct bench t = { rig_create(seed, b->fidelity), NULL, NULL };
	struct bb_gamepad_config c = { .id = "pad", .device = "sim:", .model = b->model };

	snprintf(c.script, sizeof(c.script), "%s", script);
	if (b->has_far) {
		t.far = pad_far_create_uri(t.rig, b->far, script, b->uri ? b->uri : pad_far_uri(b->far));
		assert_int_equal(pad_far_open(t.far, t.rig, &c, &t.g), BB_OK);
		return t;
	}
	assert_int_equal(bb_gamepad_open(b->driver, &c, &t.rig->open, &t.g), BB_OK);
	return t;
}

static void end(struct bench *t)
{
	bb_gamepad_close(t->g);
	pad_far_destroy(t->far);
	rig_destroy(t->rig);
}

static bool deflected(const struct bb_pad_report *r)
{
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (fabsf(r->axis[i]) > 0)
			return true;
	return false;
}

static void check_report(const struct bench *t, const struct bb_pad_report *r, const struct bb_pad_report *before)
{
	const struct bb_gamepad_limits *l = bb_gamepad_limits(t->g);

	assert_true(r->at_ns <= rig_now(t->rig));
	for (size_t i = 0; i < BB_PAD_AXES; i++) {
		const double steps = (double)r->axis[i] / l->axis_step;
		assert_true(fabsf(r->axis[i]) <= 1);
		assert_true(fabs(steps - round(steps)) < 0.01);
	}
	if (l->has_battery)
		assert_true(r->battery >= 0 && r->battery <= 1);
	if (!before->at_ns)
		return;
	assert_int_equal(r->seq, before->seq + 1);
	assert_true(r->at_ns > before->at_ns);
	if (deflected(before)) /* the promise that makes silence a fault */
		assert_true(r->at_ns - before->at_ns <= l->most_report_gap_ns);
}

/* Plays for a while, reading often, and checks each report. Returns how many there were. */
static long play(struct bench *t, int64_t for_ns, struct bb_pad_report *last)
{
	const int64_t end_ns = rig_now(t->rig) + for_ns;
	struct bb_pad_report reports[16];
	long count = 0;
	size_t n;

	while (rig_now(t->rig) < end_ns) {
		rig_pass(t->rig, 10 * RIG_MS);
		while (bb_gamepad_read(t->g, reports, BB_ARRAY_LEN(reports), &n) == BB_OK)
			for (size_t i = 0; i < n; i++, count++) {
				check_report(t, &reports[i], last);
				*last = reports[i];
			}
		assert_int_equal(n, 0);
	}
	return count;
}

static void test_contract(void **state)
{
	(void)state;
	for (size_t b = 0; b < BB_ARRAY_LEN(backends); b++) {
		struct bench t = begin_with(&backends[b], 7, "");
		struct bb_pad_report last = { 0 }, one;
		size_t n = 9;
		const long count = play(&t, 60 * RIG_S, &last);

		print_message("%s: %ld reports in 60 s\n", backends[b].name, count);
		/* Where only changes are told there is no gap that would be a fault, and fewer reports. */
		assert_true(count > (bb_gamepad_limits(t.g)->most_report_gap_ns == BB_NEVER ? 500 : 60 * 60 / 3));
		assert_int_equal(bb_gamepad_read(t.g, NULL, 1, &n), BB_ERR_USAGE);
		assert_int_equal(bb_gamepad_read(t.g, &one, 0, &n), BB_ERR_USAGE);
		assert_int_equal(bb_gamepad_rumble(t.g, 2, 0), BB_ERR_RANGE);
		assert_int_equal(bb_gamepad_rumble(t.g, NAN, 0), BB_ERR_RANGE);
		assert_int_equal(bb_gamepad_rumble(t.g, 0.5f, 1),
		                 bb_gamepad_limits(t.g)->has_rumble ? BB_OK : BB_ERR_UNSUPPORTED);
		bb_gamepad_close(NULL);
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
	assert_int_equal(play(&t, 10 * RIG_S, &last), 0);
	assert_true(play(&t, 4 * RIG_S, &last) > 2 * RIG_S / (16 * RIG_MS));
	assert_true(deflected(&last));
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
	const bool has_battery = bb_gamepad_limits(t.g)->has_battery, space = b->model == BB_PAD_SPACEMOUSE;
	/* The kernel turns a byte's two middles and xpad's ~y into one step more. */
	const float step = (float)bb_gamepad_limits(t.g)->axis_step * (b->uri ? 1.6f : 0.51f);
	struct bb_pad_report last = { 0 };

	play(&t, 700 * RIG_MS, &last);
	assert_true(fabsf(last.axis[0] - 0.5f) < step);
	play(&t, 1300 * RIG_MS, &last); /* at 2 s: half way from 0.5 to -1 */
	assert_true(fabsf(last.axis[0] + 0.25f) < 0.03f);
	assert_int_equal(last.buttons, space ? 2 : 6);
	play(&t, 1200 * RIG_MS, &last); /* at 3.2 s: neutral, said once */
	assert_false(deflected(&last));
	assert_int_equal(last.buttons, 0);
	const uint32_t seq = last.seq;
	play(&t, 700 * RIG_MS, &last);
	assert_int_equal(last.seq, seq);
	play(&t, 500 * RIG_MS, &last);
	assert_int_equal(last.buttons, space ? 1 : 0x11);
	if (has_battery && !t.far) /* a far end tells its battery now and then only */
		assert_true(fabsf(last.battery - 0.4f) < 1e-6f);
	assert_true(fabsf(last.axis[5] + 1) < 1e-6f && fabsf(last.axis[2] + 0.3f) < step);
	assert_true(fabsf(last.axis[1] - 0.2f) < step && fabsf(last.axis[3]) < 1e-6f && fabsf(last.axis[4] - 1) < 1e-6f);
	play(&t, RIG_S, &last);
	assert_false(deflected(&last));
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
			(void)!bb_gamepad_read(ta.g, a, BB_ARRAY_LEN(a), &na);
			(void)!bb_gamepad_read(tb.g, b, BB_ARRAY_LEN(b), &nb);
			assert_true(na ? nb >= 1 && nb <= 2 : nb == 0); /* buttons may have a report of their own */
			if (!na)
				continue;
			n++;
			for (size_t i = 0; i < BB_PAD_AXES; i++)
				worst = fmax(worst, (double)fabsf(a[0].axis[i] - b[nb - 1].axis[i]));
			wrong += a[0].buttons != b[nb - 1].buttons;
			late_ns = llabs(a[0].at_ns - b[nb - 1].at_ns) > late_ns ? llabs(a[0].at_ns - b[nb - 1].at_ns) : late_ns;
		}
		worst /= bb_gamepad_limits(tb.g)->axis_step;
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
		status = bb_gamepad_read(t->g, &one, 1, &n);
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
	play(&t, 3 * RIG_S, &last);
	assert_true(deflected(&last));
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "silence", "", true), BB_OK);
	assert_int_equal(play(&t, RIG_S, &last), 0);
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "silence", "", false), BB_OK);
	last.at_ns = 0; /* the gap is the fault's */
	const bool changes_only = bb_gamepad_limits(t.g)->most_report_gap_ns == BB_NEVER;
	assert_true(play(&t, 100 * RIG_MS, &last) > (changes_only ? -1 : 3));
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "battery", "level=0.05", true), BB_OK);
	play(&t, 100 * RIG_MS, &last);
	if (bb_gamepad_limits(t.g)->has_battery)
		assert_true(fabsf(last.battery - 0.05f) < 0.005f);
	else
		assert_true(isnan(last.battery));
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "battery", "level=0", true), BB_OK);
	assert_int_equal(play(&t, 200 * RIG_MS, &last), 0);
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "battery", "level=0", false), BB_OK);
	last.at_ns = 0;
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "stick_axis", "axis=3 value=-0.5", true), BB_OK);
	play(&t, 5 * RIG_S, &last);
	assert_true(fabsf(last.axis[2] + 0.5f) < 0.01f);
	assert_int_equal(rig_fault(t.rig, "gamepad", "pad", "unplug", "", true), BB_OK);
	assert_int_equal(bb_gamepad_read(t.g, &one, 1, &n), BB_ERR_LOST);
	assert_int_equal(bb_gamepad_rumble(t.g, 0, 0),
	                 bb_gamepad_limits(t.g)->has_rumble ? BB_ERR_LOST : BB_ERR_UNSUPPORTED);
	rig_pass(t.rig, RIG_S);
	assert_int_equal(bb_gamepad_read(t.g, &one, 1, &n), BB_ERR_LOST);
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
	assert_int_equal(bb_gamepad_read(t.g, reports, 200, &n), BB_OK);
	assert_true(n > 60 && n < 200);
	assert_true(reports[0].seq > 0);
	for (size_t i = 1; i < n; i++)
		assert_int_equal(reports[i].seq, reports[i - 1].seq + 1);
	assert_true(rig_now(t.rig) - reports[n - 1].at_ns <= bb_gamepad_limits(t.g)->most_report_gap_ns);
	end(&t);
}

static void repeat(const struct backend *back)
{
	struct bb_pad_report a = { 0 }, b = { 0 }, c = { 0 };
	struct bench t = begin_with(back, 7, "");
	const long na = play(&t, 10 * RIG_S, &a);
	end(&t);
	t = begin_with(back, 7, "");
	const long nb = play(&t, 10 * RIG_S, &b);
	end(&t);
	t = begin_with(back, 8, "");
	play(&t, 10 * RIG_S, &c);
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
	return cmocka_run_group_tests(tests, NULL, NULL);
}
