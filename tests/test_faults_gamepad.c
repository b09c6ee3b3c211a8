/*
 * tests/test_faults_gamepad.c: rows H1 to H5 of the fault matrix, injected at the far end of the wire, detected and
 * recovered from by the shipped drivers, in virtual time. The reader reads once a frame of 60 Hz, as the frame loop
 * does.
 */
#include "tests/fault_table.h"
#include "tests/fixture_pads.h"

#include <math.h>
#include <unistd.h>

#define FRAME_NS INT64_C(16666667)

struct bench {
	struct rig *rig;
	struct pad_far *far;
	struct bb_gamepad *g;
	char path[32];
	enum bb_status status; /* of the last frame's reads */
	struct bb_pad_report last;
	long reports;
	uint64_t n_health; /* events */
	char named[32];    /* what the newest fault was called when it was noticed */
};

static void on_event(void *ctx, const struct bb_event *e)
{
	((struct bench *)ctx)->n_health += e->kind == BB_EV_HEALTH;
}

/* The hand of these tests: stick one deflected and moving from 0.1 s on, for ten minutes; neutral now and then. */
static const char moving[] = "0.1 axis 1 0.8 0.1\n";

static void begin(struct bench *t, enum sim_peer_kind kind, const char *still)
{
	char *text = calloc(1, 200000);
	size_t at = 0;
	struct bb_gamepad_config c = { .id = "pad" };

	assert_non_null(text);
	memset(t, 0, sizeof(*t));
	strcpy(t->path, "/tmp/bb-pad-XXXXXX");
	const int fd = mkstemp(t->path);
	assert_true(fd >= 0);
	at += (size_t)sprintf(text, "%s", still ? still : moving);
	for (int i = 0; !still && i < 600; i++) /* never still: to and fro twice a second */
		at += (size_t)sprintf(text + at, "%d.5 axis 1 %s 0.4\n%d axis 1 0.9 0.4\n", i, i % 4 == 3 ? "0" : "0.4",
				      i + 1);
	assert_int_equal(write(fd, text, at), (ssize_t)at);
	close(fd);
	free(text);
	t->rig = rig_create(7, 1);
	t->rig->on_event = on_event;
	t->rig->ctx = t;
	t->far = pad_far_create(t->rig, kind, t->path);
	assert_int_equal(pad_far_open(t->far, t->rig, &c, &t->g), BB_OK);
}

static void end(struct bench *t)
{
	bb_gamepad_close(t->g);
	pad_far_destroy(t->far);
	bb_eventlog_flush(t->rig->events);
	rig_destroy(t->rig);
	unlink(t->path);
}

static void frame(struct bench *t)
{
	struct bb_pad_report r[16];
	size_t n;

	rig_pass(t->rig, FRAME_NS);
	while ((t->status = bb_gamepad_read(t->g, r, BB_ARRAY_LEN(r), &n)) == BB_OK) {
		t->last = r[n - 1];
		t->reports += (long)n;
	}
	assert_int_equal(n, 0);
}

static void frames(struct bench *t, int64_t for_ns)
{
	const int64_t end_ns = rig_now(t->rig) + for_ns;

	while (rig_now(t->rig) < end_ns)
		frame(t);
}

static const struct bb_pad_core *core(const struct bench *t)
{
	return pad_far_core(t->far, t->g);
}

static bool named(const struct bench *t, const char *name)
{
	return strstr(bb_gamepad_device(t->g)->last_error.detail, name) != NULL;
}

static void fault(struct bench *t, const char *verb, const char *args, bool on)
{
	assert_int_equal(rig_fault(t->rig, "gamepad", "pad", verb, args, on), BB_OK);
}

/* Frames until health is (or is not) OK; how long that took. */
static int64_t until(struct bench *t, bool ok, int64_t most_ns)
{
	const int64_t from_ns = rig_now(t->rig);

	while ((core(t)->health == BB_HEALTH_OK) != ok && rig_now(t->rig) - from_ns < most_ns)
		frame(t);
	assert_true((core(t)->health == BB_HEALTH_OK) == ok);
	if (!ok)
		snprintf(t->named, sizeof(t->named), "%.31s", bb_gamepad_device(t->g)->last_error.detail);
	return rig_now(t->rig) - from_ns;
}

static void row(const char *name, const struct bench *t, int64_t detected_ns, int64_t recovered_ns)
{
	const char *what = strchr(name, ' ') + 1;
	char id[4], injected[64];

	snprintf(id, sizeof(id), "%.*s", (int)(what - name - 1), name);
	snprintf(injected, sizeof(injected), "%s", what);
	fault_row(id, injected, t->named[0] ? t->named : bb_gamepad_device(t->g)->last_error.detail, detected_ns, -1, recovered_ns);
}

static float most(const struct bb_pad_report *r)
{
	float m = 0;

	for (size_t i = 0; i < BB_PAD_AXES; i++)
		m = fmaxf(m, fabsf(r->axis[i]));
	return m;
}

static void unplug(enum sim_peer_kind kind, const char *name)
{
	struct bench t;

	begin(&t, kind, NULL);
	frames(&t, 2 * RIG_S);
	assert_true(t.reports > 100 && core(&t)->health == BB_HEALTH_OK);
	fault(&t, "unplug", "", true);
	const int64_t detected_ns = until(&t, false, RIG_S);
	assert_true(detected_ns <= 50 * RIG_MS);
	assert_int_equal(t.status, BB_ERR_LOST);
	assert_true(named(&t, "PAD_GONE"));
	frames(&t, 7 * RIG_S);
	assert_int_equal(t.status, BB_ERR_LOST);
	const long before = t.reports;
	const int64_t back_ns = rig_now(t.rig);
	fault(&t, "unplug", "", false);
	/* It comes back with the stick deflected: until it was neutral once nothing moves. */
	while (!core(&t)->armed && rig_now(t.rig) - back_ns < 20 * RIG_S) {
		frame(&t);
		if (!core(&t)->armed)
			assert_true(t.reports == before || most(&t.last) <= 0);
	}
	assert_true(core(&t)->armed && t.reports > before);
	(void)until(&t, true, 2 * RIG_S);
	frames(&t, RIG_S);
	assert_true(most(&t.last) > 0.3f);
	row(name, &t, detected_ns, rig_now(t.rig) - RIG_S - back_ns);
	end(&t);
}

static void test_h1_unplug(void **state)
{
	(void)state;
	unplug(SIM_PEER_RUMBLEPAD2_WIRED, "H1 unplug, RumblePad 2 (hid)");
	unplug(SIM_PEER_SPACEMOUSE_WIRELESS, "H1 unplug, SpaceMouse (hid)");
	unplug(SIM_PEER_XBOX_PAD, "H1 unplug, Xbox receiver (xusb)");
}

/* Another pad on the same port is not the same pad. */
static void test_h1_reopens_by_serial(void **state)
{
	(void)state;
	struct bench t;

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, NULL);
	frames(&t, RIG_S);
	fault(&t, "unplug", "", true);
	frames(&t, RIG_S);
	struct sim_peer_pad *mine = t.far->peer, *other;
	const struct sim_peer_config c = { .kind = SIM_PEER_RUMBLEPAD2_WIRED, .id = "other", .clk = t.rig->clk };
	assert_int_equal(sim_peer_pad_create(&c, &other), BB_OK);
	t.far->peer = other;
	frames(&t, 6 * RIG_S);
	assert_int_equal(t.status, BB_ERR_LOST);
	t.far->peer = mine;
	fault(&t, "unplug", "", false);
	frames(&t, 7 * RIG_S);
	assert_true(t.status != BB_ERR_LOST && core(&t)->is_open);
	sim_peer_pad_destroy(other);
	end(&t);
}

/* A plug that wobbles: pauses grow, and after five returns within a minute a person has to look. */
static void test_h1_flapping_is_quarantined(void **state)
{
	(void)state;
	struct bench t;
	int returns = 0;

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, NULL);
	for (; returns < 10 && core(&t)->health != BB_HEALTH_QUARANTINED; returns++) {
		fault(&t, "unplug", "", true);
		frames(&t, 100 * RIG_MS);
		fault(&t, "unplug", "", false);
		frames(&t, 1500 * RIG_MS);
	}
	print_message("quarantined after %d returns, %lu buses opened\n", returns, t.far->opened);
	assert_int_equal(returns, 6);
	assert_int_equal(t.status, BB_ERR_FORMAT);
	assert_true(named(&t, "PAD_QUARANTINE"));
	frames(&t, 70 * RIG_S);
	assert_int_equal(t.status, BB_ERR_FORMAT); /* never by itself */
	bb_gamepad_close(t.g);
	const struct bb_gamepad_config c = { .id = "pad" };
	assert_int_equal(pad_far_open(t.far, t.rig, &c, &t.g), BB_OK); /* closed and opened: a person looked */
	frames(&t, RIG_S);
	assert_true(core(&t)->health == BB_HEALTH_OK);
	end(&t);
}

/* The pauses between attempts: 100 ms * 2^k +- 20 %, at most 5 s, and not two pads in step. */
static void test_h1_pauses_grow(void **state)
{
	(void)state;
	struct bench t;
	int64_t last_ns = 0, pause_ns = 0;
	uint32_t attempts = 0;

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, NULL);
	fault(&t, "unplug", "", true);
	frame(&t);
	last_ns = rig_now(t.rig);
	for (int k = 0; k < 9; k++) {
		while (core(&t)->attempts == attempts)
			frame(&t);
		attempts = core(&t)->attempts;
		pause_ns = rig_now(t.rig) - last_ns;
		last_ns = rig_now(t.rig);
		const double want = fmin(5000, 100 * pow(2, k)) * 1e6;
		assert_true((double)pause_ns >= 0.8 * want && (double)pause_ns <= 1.2 * want + (double)FRAME_NS);
	}
	end(&t);
}

static void silent(enum sim_peer_kind kind, const char *verb, const char *args, const char *name)
{
	struct bench t;

	begin(&t, kind, NULL);
	frames(&t, 2 * RIG_S);
	fault(&t, verb, args, true);
	const int64_t last_ns = rig_now(t.rig);
	const int64_t detected_ns = until(&t, false, RIG_S);
	assert_true(rig_now(t.rig) - last_ns <= 250 * RIG_MS);
	assert_true(named(&t, "PAD_SILENT") && named(&t, "battery"));
	assert_true(core(&t)->health == BB_HEALTH_LOST);
	frames(&t, 3 * RIG_S);
	assert_true(core(&t)->health == BB_HEALTH_LOST);
	assert_int_equal(t.status, BB_TIMEOUT);
	fault(&t, verb, args, false);
	const int64_t recovered_ns = until(&t, true, RIG_S);
	assert_true(recovered_ns <= 500 * RIG_MS);
	row(name, &t, detected_ns, recovered_ns);
	end(&t);
}

static void test_h2_silence(void **state)
{
	(void)state;
	silent(SIM_PEER_RUMBLEPAD2_WIRELESS, "silence", "", "H2 silent, stick deflected (hid)");
	silent(SIM_PEER_SPACEMOUSE_WIRELESS, "battery", "level=0", "H2 battery dead, SpaceMouse (hid)");
	silent(SIM_PEER_XBOX_PAD, "silence", "", "H2 silent, stick deflected (xusb)");
}

/* A pad in a drawer is no fault. */
static void test_h2_idle_is_no_fault(void **state)
{
	(void)state;
	struct bench t;

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, "0.5 axis 1 0.5 0.2\n1 axis 1 0 0.2\n");
	frames(&t, 60 * RIG_S);
	assert_true(t.reports > 10 && core(&t)->health == BB_HEALTH_OK);
	bb_eventlog_flush(t.rig->events);
	assert_int_equal(t.n_health, 0);
	end(&t);
}

/* The receiver stays, its pad is switched off. */
static void test_h1_xbox_pad_off(void **state)
{
	(void)state;
	struct bench t;

	begin(&t, SIM_PEER_XBOX_PAD, NULL);
	frames(&t, 2 * RIG_S);
	assert_int_equal(sim_peer_pad_led(t.far->peer), 7); /* slot 2 is lit */
	fault(&t, "off", "", true);
	const int64_t detected_ns = until(&t, false, RIG_S);
	assert_true(detected_ns <= 50 * RIG_MS && t.status == BB_ERR_LOST && named(&t, "PAD_GONE"));
	assert_int_equal(bb_gamepad_rumble(t.g, 1, 0), BB_ERR_LOST);
	frames(&t, 4 * RIG_S);
	assert_int_equal(t.status, BB_ERR_LOST);
	assert_true(core(&t)->is_open); /* the bus is */
	fault(&t, "off", "", false);
	const int64_t recovered_ns = until(&t, true, 5 * RIG_S);
	row("H1 pad off, receiver alive (xusb)", &t, detected_ns, recovered_ns);
	end(&t);
}

static void bad_reports(enum sim_peer_kind kind, const char *verb, const char *name)
{
	struct bench t;

	begin(&t, kind, NULL);
	frames(&t, 2 * RIG_S);
	const long before = t.reports;
	fault(&t, verb, "", true);
	const int64_t detected_ns = until(&t, false, RIG_S);
	assert_true(detected_ns <= 2 * FRAME_NS);
	assert_true(named(&t, "PAD_BAD") && core(&t)->bad_total > 0);
	assert_int_equal(t.reports, before); /* ignored */
	fault(&t, verb, "", false);
	const int64_t recovered_ns = until(&t, true, RIG_S);
	assert_true(core(&t)->health == BB_HEALTH_OK);
	row(name, &t, detected_ns, recovered_ns);
	/* For longer than a second it is quarantined, and stays so. */
	fault(&t, verb, "", true);
	frames(&t, 2 * RIG_S);
	assert_true(core(&t)->health == BB_HEALTH_QUARANTINED && named(&t, "PAD_QUARANTINE"));
	assert_int_equal(t.status, BB_ERR_FORMAT);
	assert_int_equal(bb_gamepad_rumble(t.g, 0, 0),
			 kind == SIM_PEER_SPACENAVIGATOR ? BB_ERR_UNSUPPORTED : BB_ERR_FORMAT);
	fault(&t, verb, "", false);
	frames(&t, 5 * RIG_S);
	assert_int_equal(t.status, BB_ERR_FORMAT);
	end(&t);
}

static void test_h3_bad_reports(void **state)
{
	(void)state;
	bad_reports(SIM_PEER_RUMBLEPAD2_WIRED, "short", "H3 short reports, RumblePad 2 (hid)");
	bad_reports(SIM_PEER_RUMBLEPAD2_WIRELESS, "wrong_id", "H3 wrong report id (hid)");
	bad_reports(SIM_PEER_SPACENAVIGATOR, "wrong_id", "H3 wrong report id, SpaceMouse (hid)");
	bad_reports(SIM_PEER_XBOX_PAD, "short", "H3 short packets (xusb)");
}

/* One bad report in thirty is counted and named; the pad goes on. */
static void test_h3_a_few_bad_reports(void **state)
{
	(void)state;
	struct bench t;

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, NULL);
	frames(&t, RIG_S);
	fault(&t, "garbage", "share=0.03", true);
	frames(&t, 20 * RIG_S);
	assert_true(core(&t)->bad_total > 20 && t.reports > 1000);
	assert_true(core(&t)->health != BB_HEALTH_QUARANTINED && named(&t, "PAD_BAD"));
	fault(&t, "garbage", "share=0.03", false);
	(void)until(&t, true, RIG_S);
	end(&t);
}

static void test_h4_hostile_descriptor(void **state)
{
	(void)state;
	struct bench t;
	struct bb_gamepad *g;
	const struct bb_gamepad_config c = { .id = "pad" };

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, NULL);
	frames(&t, RIG_S);
	fault(&t, "bad_descriptor", "", true);
	assert_int_equal(pad_far_open(t.far, t.rig, &c, &g), BB_ERR_FORMAT); /* at open */
	assert_null(g);
	frames(&t, RIG_S);
	assert_true(core(&t)->health == BB_HEALTH_OK); /* others run */
	/* And what comes back with one after an unplug is refused for good. */
	fault(&t, "unplug", "", true);
	frame(&t);
	const int64_t from_ns = rig_now(t.rig);
	fault(&t, "unplug", "", false);
	while (core(&t)->health != BB_HEALTH_QUARANTINED && rig_now(t.rig) - from_ns < RIG_S)
		frame(&t);
	assert_int_equal(t.status, BB_ERR_FORMAT);
	assert_true(named(&t, "DESC_REJECT"));
	row("H4 hostile descriptor (hid), reopened", &t, rig_now(t.rig) - from_ns, BB_NEVER);
	end(&t);
}

static void axis_fault(enum sim_peer_kind kind, const char *still, const char *verb, const char *args, bool recentres,
		       const char *name)
{
	struct bench t;

	begin(&t, kind, still);
	frames(&t, 2 * RIG_S);
	fault(&t, verb, args, true);
	const int64_t detected_ns = until(&t, false, 12 * RIG_S);
	assert_true(detected_ns <= 10 * RIG_S);
	assert_true(named(&t, "PAD_DRIFT"));
	assert_true(core(&t)->health == BB_HEALTH_DEGRADED);
	frames(&t, RIG_S);
	if (recentres)
		assert_true(fabsf(t.last.axis[2]) < 0.02f);
	else
		assert_true(fabsf(t.last.axis[2]) > 0.1f);
	frames(&t, 3 * RIG_S);
	assert_true(core(&t)->health == BB_HEALTH_DEGRADED);
	fault(&t, verb, args, false);
	const int64_t recovered_ns = until(&t, true, 20 * RIG_S);
	row(name, &t, detected_ns, recovered_ns);
	end(&t);
}

static void test_h5_axes(void **state)
{
	(void)state;
	static const char rest[] = "1 button 1 down\n";

	axis_fault(SIM_PEER_RUMBLEPAD2_WIRED, NULL, "stick_axis", "axis=3 value=0.7", false, "H5 stuck axis (hid)");
	axis_fault(SIM_PEER_RUMBLEPAD2_WIRED, rest, "drift", "axis=3 offset=0.1", true, "H5 drift, recentred (hid)");
	axis_fault(SIM_PEER_SPACEMOUSE_WIRELESS, rest, "drift", "axis=3 offset=-0.08", true,
		   "H5 drift, SpaceMouse (hid)");
	axis_fault(SIM_PEER_XBOX_PAD, NULL, "stick_axis", "axis=3 value=-1", false, "H5 stuck axis (xusb)");
}

static void test_h5_noise(void **state)
{
	(void)state;
	struct bench t;

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, "1 button 1 down\n");
	frames(&t, 2 * RIG_S);
	fault(&t, "noise", "axis=2 size=0.4", true);
	const int64_t detected_ns = until(&t, false, 12 * RIG_S);
	assert_true(detected_ns <= 10 * RIG_S && named(&t, "PAD_DRIFT") && named(&t, "noisy"));
	row("H5 noise (hid)", &t, detected_ns, BB_NEVER);
	end(&t);
}

/* A hand that works for ten minutes is none of these. */
static void test_h5_no_false_alarm(void **state)
{
	(void)state;
	struct rig *rig = rig_create(11, 1);
	struct pad_far *far = pad_far_create(rig, SIM_PEER_RUMBLEPAD2_WIRELESS, "");
	const struct bb_gamepad_config c = { .id = "pad" };
	struct bb_pad_report r[16];
	struct bb_gamepad *g;
	size_t n;
	int faulty = 0;

	assert_int_equal(pad_far_open(far, rig, &c, &g), BB_OK);
	while (rig_now(rig) < 500 * RIG_S) {
		rig_pass(rig, FRAME_NS);
		while (bb_gamepad_read(g, r, BB_ARRAY_LEN(r), &n) == BB_OK)
			;
		faulty += pad_far_core(far, g)->health != BB_HEALTH_OK;
	}
	assert_int_equal(faulty, 0);
	bb_gamepad_close(g);
	pad_far_destroy(far);
	rig_destroy(rig);
}

/* Nobody read for six seconds: what the kernel kept is of the beginning, and is not played now. */
static void test_old_reports_are_dropped(void **state)
{
	(void)state;
	struct bench t;

	begin(&t, SIM_PEER_RUMBLEPAD2_WIRED, NULL);
	frames(&t, RIG_S);
	rig_pass(t.rig, 6 * RIG_S);
	const long before = t.reports;
	struct bb_pad_report r[16];
	size_t n;
	assert_int_equal(bb_gamepad_read(t.g, r, 16, &n), BB_TIMEOUT);
	assert_int_equal(t.reports, before);
	assert_true(named(&t, "PAD_OVERRUN"));
	frames(&t, 100 * RIG_MS);
	assert_true(t.reports > before);
	end(&t);
}

static void test_rumble_reaches_the_motors(void **state)
{
	(void)state;
	static const enum sim_peer_kind kinds[] = { SIM_PEER_RUMBLEPAD2_WIRED, SIM_PEER_RUMBLEPAD2_WIRELESS,
						    SIM_PEER_XBOX_PAD };
	float strong, weak;

	for (size_t i = 0; i < BB_ARRAY_LEN(kinds); i++) {
		struct bench t;
		begin(&t, kinds[i], NULL);
		frames(&t, 100 * RIG_MS);
		assert_int_equal(bb_gamepad_rumble(t.g, 1, 0.5f), BB_OK);
		assert_true(sim_peer_pad_rumble(t.far->peer, &strong, &weak));
		assert_true(fabsf(strong - 1) < 0.01f && fabsf(weak - 0.5f) < 0.01f);
		assert_int_equal(bb_gamepad_rumble(t.g, 0, 0.25f), BB_OK);
		(void)sim_peer_pad_rumble(t.far->peer, &strong, &weak);
		assert_true(fabsf(strong) < 0.01f && fabsf(weak - 0.25f) < 0.01f);
		bb_gamepad_close(t.g); /* a motor does not run on */
		t.g = NULL;
		(void)sim_peer_pad_rumble(t.far->peer, &strong, &weak);
		assert_true(fabsf(strong) < 0.01f && fabsf(weak) < 0.01f);
		end(&t);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_h1_unplug),
		cmocka_unit_test(test_h1_xbox_pad_off),
		cmocka_unit_test(test_h1_reopens_by_serial),
		cmocka_unit_test(test_h1_flapping_is_quarantined),
		cmocka_unit_test(test_h1_pauses_grow),
		cmocka_unit_test(test_h2_silence),
		cmocka_unit_test(test_h2_idle_is_no_fault),
		cmocka_unit_test(test_h3_bad_reports),
		cmocka_unit_test(test_h3_a_few_bad_reports),
		cmocka_unit_test(test_h4_hostile_descriptor),
		cmocka_unit_test(test_h5_axes),
		cmocka_unit_test(test_h5_noise),
		cmocka_unit_test(test_h5_no_false_alarm),
		cmocka_unit_test(test_old_reports_are_dropped),
		cmocka_unit_test(test_rumble_reaches_the_motors),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
