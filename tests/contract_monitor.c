/* tests/contract_monitor.c: what every monitor back end must do, and what the simulated one does besides. */
#include "tests/sim_rig.h"

#include "drivers/monitor_ddc.h"
#include "sim/bus_sim_i2c.h"
#include "sim/edid_model.h"
#include "sim/sim_monitor.h"
#include "tests/fidelity.h"
#include "tests/monitor_contract.h"
#include "tests/monitor_farm.h"

#include <math.h>

struct bench {
	struct monitor_bench c;
	struct rig *rig;
	const struct backend *backend;
	struct peer_ddcci *peer;
	struct farm *farm; /* of a kernel's bus */
};

/* A back end that is more than one thing opens itself; light is what a meter in front of the screen reads. */
static struct bb_monitor *open_ddc(struct bench *t);
static struct bb_monitor *open_quirky_ddc(struct bench *t);
static struct bb_monitor *open_kernel(struct bench *t);
static void close_ddc(struct bench *t);
static void close_kernel(struct bench *t);
static double ddc_light(struct bench *t);

static const struct backend {
	const char *name;
	const struct bb_monitor_driver *driver;
	int fidelity;
	struct bb_monitor *(*open)(struct bench *t);
	void (*close)(struct bench *t);
	double (*light)(struct bench *t);
	bool kernel; /* real time, in a guest */
} backends[] = {
	{ "sim, fidelity 0", &sim_monitor_driver, 0, NULL, NULL, NULL, false },
	{ "sim, fidelity 1", &sim_monitor_driver, 1, NULL, NULL, NULL, false },
	{ "driver + peer", NULL, 1, open_ddc, close_ddc, ddc_light, false },
	{ "driver + peer with quirks", NULL, 1, open_quirky_ddc, close_ddc, ddc_light, false },
	{ "driver + kernel, i2c-tiny-usb", NULL, 1, open_kernel, close_kernel, ddc_light, true },
};

static bool in_guest(void)
{
	const char *kernel = getenv("BB_KERNEL");

	return kernel && !strcmp(kernel, "1");
}

static struct bb_monitor_config config(void)
{
	return (struct bb_monitor_config){ .id = "front-m", .node = "front", .device = "sim:", .edid = "S27A850D",
		                           .outlet = "pdu1/2", .width_px = 2560, .height_px = 1440, .rate = { 60, 1 },
		                           .input = 0x0F };
}

static struct bb_monitor *open_ddc(struct bench *t)
{
	const struct bb_monitor_config c = config();
	struct bb_i2c_bus *bus;
	struct bb_monitor *m;

	assert_int_equal(peer_ddcci_create(&c, t->rig->world, t->rig->open.seed, rig_now(t->rig), &t->peer), BB_OK);
	assert_int_equal(bus_sim_i2c_create(t->rig->clk, t->peer, NULL, &bus), BB_OK);
	assert_int_equal(monitor_ddc_open_on(bus, &c, &t->rig->open, &m), BB_OK);
	return m;
}

static struct bb_monitor *open_quirky_ddc(struct bench *t)
{
	struct bb_monitor *m = open_ddc(t);
	struct peer_quirks *q = peer_ddcci_quirks(t->peer);

	q->doubled_source = true;
	q->null_for_unsupported = true;
	q->busy_percent = 2;
	q->think_ns = 60 * RIG_MS;
	return m;
}

static void close_ddc(struct bench *t)
{
	bb_monitor_close(t->c.m);
	peer_ddcci_destroy(t->peer);
}

/* As a room file would: "i2c:/dev/i2c-0", a bus of the kernel. */
static struct bb_monitor *open_kernel(struct bench *t)
{
	const struct bb_monitor_config c = config();
	char uri[80] = "i2c:";
	struct bb_monitor *m;

	assert_true(farm_create(t->rig->clk, &t->farm));
	assert_true(farm_add(t->farm, &c, t->rig->world, t->rig->open.seed) && farm_plug(t->farm, 0));
	assert_true(farm_wait_bus(c.id, uri + 4, sizeof(uri) - 4));
	t->peer = t->farm->monitor[0].usb.monitor;
	assert_int_equal(bb_uri_parse(uri, &t->rig->uri, NULL, NULL), BB_OK);
	assert_int_equal(bb_monitor_open(&monitor_ddc_driver, &c, &t->rig->open, &m), BB_OK);
	t->c.look_ns = 5 * RIG_MS;
	t->c.rounds = 5;
	return m;
}

static void close_kernel(struct bench *t)
{
	bb_monitor_close(t->c.m);
	farm_destroy(t->farm);
}

/* What belongs to the world is another thread's in the guest. */
static void lock(struct bench *t)
{
	if (t->farm)
		farm_lock(t->farm);
}

static void unlock(struct bench *t)
{
	if (t->farm)
		farm_unlock(t->farm);
}

static double ddc_light(struct bench *t)
{
	lock(t);
	const double light = peer_ddcci_luminance(t->peer, rig_now(t->rig));
	unlock(t);
	return light;
}

static enum bb_status fault(struct bench *t, const char *verb, const char *args, bool on)
{
	lock(t);
	const enum bb_status status = rig_fault(t->rig, "monitor", "front-m", verb, args, on);
	unlock(t);
	return status;
}

static void feed(struct bench *t, bool on)
{
	lock(t);
	sim_world_set_fed(t->rig->world, "pdu1/2", on);
	unlock(t);
}

static struct bench begin(const struct backend *b, uint64_t seed)
{
	const struct bb_monitor_config c = config();
	struct bb_clock *clk;
	struct bench t = { .backend = b };

	assert_int_equal(b->kernel ? bb_clock_posix_create(&clk) : bb_clock_virtual_create(&clk), BB_OK);
	t.rig = rig_create_on(clk, seed, b->fidelity);
	t.c.clk = clk;
	if (b->open)
		t.c.m = b->open(&t);
	else
		assert_int_equal(bb_monitor_open(b->driver, &c, &t.rig->open, &t.c.m), BB_OK);
	return t;
}

static void end(struct bench *t)
{
	if (t->backend && t->backend->close)
		t->backend->close(t);
	else
		bb_monitor_close(t->c.m);
	rig_destroy(t->rig);
}

static double light(struct bench *t)
{
	return t->backend->light ? t->backend->light(t) : sim_monitor_luminance(t->c.m, rig_now(t->rig));
}

static struct bb_monitor_reply ask(struct bench *t, enum bb_monitor_request_kind kind, uint8_t code, uint16_t value)
{
	return monitor_ask(&t->c, kind, code, value);
}

static struct bb_monitor_reply get(struct bench *t, uint8_t code)
{
	return monitor_get(&t->c, code);
}

static enum bb_status set(struct bench *t, uint8_t code, uint16_t value)
{
	return monitor_set(&t->c, code, value);
}

static void for_all(void (*check)(struct bench *))
{
	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		if (backends[i].kernel && !in_guest())
			continue;
		struct bench t = begin(&backends[i], 7);
		print_message("%s\n", backends[i].name);
		check(&t);
		end(&t);
	}
}

#define CONTRACT(name)                                                                                               \
	static void test_##name(void **state)                                                                        \
	{                                                                                                            \
		(void)state;                                                                                         \
		for_all(name);                                                                                       \
	}
#define SHARED(name)                                                                                                 \
	static void name(struct bench *t)                                                                            \
	{                                                                                                            \
		monitor_##name(&t->c);                                                                               \
	}                                                                                                            \
	CONTRACT(name)
SHARED(edid_is_whole)
SHARED(writes_are_read_back)
SHARED(unknown_codes_are_unsupported)
SHARED(one_request_at_a_time)
SHARED(power_off_is_refused)
SHARED(saving_is_refused)
SHARED(capabilities_are_text)
SHARED(reply_waits_are_kept)
SHARED(write_waits_are_kept)

/* What it is, and what it says of itself, is what the room file made it. */
static void is_the_one_of_the_room(struct bench *t)
{
	struct bb_monitor_reply r = ask(t, BB_MONITOR_EDID, 0, 0);

	assert_int_equal(r.edid[8] << 8 | r.edid[9], 0x4C2D); /* SAM */
	assert_int_equal(get(t, BB_VCP_VERSION).current, 0x0202);
	r = ask(t, BB_MONITOR_CAPABILITIES, 0, 0);
	assert_memory_equal(r.text, "(prot(monitor)", 14);
	assert_int_equal(r.text[r.text_bytes - 1], ')');
}
CONTRACT(is_the_one_of_the_room)

static void test_sim_every_value(void **state)
{
	(void)state;
	static const struct {
		uint8_t code;
		bool read, write;
		uint16_t legal[8]; /* ends with 0; empty: 0..100 */
	} codes[] = {
		{ 0x02, 1, 1, { 1 } }, { 0x10, 1, 1, { 0 } }, { 0x12, 1, 1, { 0 } },
		{ 0x14, 1, 1, { 1, 2, 5, 6, 8, 11 } },
		{ 0x16, 1, 1, { 0 } }, { 0x18, 1, 1, { 0 } }, { 0x1A, 1, 1, { 0 } },
		{ 0x60, 1, 1, { 1, 3, 0x0F, 0x10, 0x11, 0x12 } }, { 0xAC, 1, 0, { 0 } }, { 0xAE, 1, 0, { 0 } },
		{ 0xC0, 1, 0, { 0 } }, { 0xC6, 1, 0, { 0 } }, { 0xC8, 1, 0, { 0 } }, { 0xDF, 1, 0, { 0 } },
	};
	struct bench t = begin(&backends[0], 1);

	for (size_t i = 0; i < BB_ARRAY_LEN(codes); i++) {
		const uint8_t code = codes[i].code;
		assert_int_equal(get(&t, code).status, BB_OK);
		for (uint32_t value = 0; value <= 300; value++) {
			const uint16_t before = get(&t, code).current;
			bool legal = !codes[i].legal[0] && value <= 100;
			for (size_t k = 0; codes[i].legal[k]; k++)
				legal |= codes[i].legal[k] == value;
			const enum bb_status status = set(&t, code, (uint16_t)value);
			if (!codes[i].write) {
				assert_int_equal(status, BB_ERR_UNSUPPORTED);
				continue;
			}
			assert_int_equal(status, legal ? BB_OK : BB_ERR_RANGE);
			assert_int_equal(get(&t, code).current, legal ? value : before);
		}
	}
	for (int code = 0; code < 256; code++) { /* and no other code */
		bool known = code == 0xD6;
		for (size_t i = 0; i < BB_ARRAY_LEN(codes); i++)
			known |= codes[i].code == code;
		assert_int_equal(get(&t, (uint8_t)code).status == BB_OK, known);
	}
	end(&t);
}

static void test_sim_restore(void **state)
{
	(void)state;
	struct bench t = begin(&backends[1], 1);
	const uint16_t factory = get(&t, BB_VCP_LUMINANCE).current;

	assert_int_equal(set(&t, BB_VCP_LUMINANCE, 11), BB_OK);
	assert_int_equal(set(&t, BB_VCP_RESTORE_DEFAULTS, 0), BB_ERR_RANGE);
	assert_int_equal(get(&t, BB_VCP_LUMINANCE).current, 11);
	assert_int_equal(set(&t, BB_VCP_RESTORE_DEFAULTS, 1), BB_OK);
	const struct bb_monitor_reply r = get(&t, BB_VCP_LUMINANCE);
	assert_int_equal(r.current, factory);
	assert_true(r.tries > 1); /* it was busy restoring */
	end(&t);
}

/* As in the protocol notes' golden replies: 24-bit line rate in most and current, refresh in 0.01 Hz. */
static void test_sim_frequencies_and_hours(void **state)
{
	(void)state;
	struct bench t = begin(&backends[1], 1);
	struct bb_monitor_reply r = get(&t, BB_VCP_H_FREQUENCY);

	assert_int_equal((uint32_t)r.most << 16 | r.current, 88787);
	r = get(&t, BB_VCP_V_FREQUENCY);
	assert_int_equal(r.current, 5995);
	assert_int_equal(r.most, 0xFFFF);
	const uint16_t hours = get(&t, BB_VCP_HOURS).current;
	rig_pass(t.rig, 5 * 3600 * RIG_S);
	assert_int_equal(get(&t, BB_VCP_HOURS).current, hours + 5);
	assert_int_equal(set(&t, BB_VCP_INPUT, 0x11), BB_OK); /* no signal there */
	r = get(&t, BB_VCP_V_FREQUENCY);
	assert_true(r.current == 0xFFFF && r.most == 0xFFFF);
	end(&t);
}

static void test_sim_busy_share(void **state)
{
	(void)state;
	struct bench t = begin(&backends[1], 3);
	uint32_t tries = 0, most = 0;

	for (int i = 0; i < 2000; i++) {
		const struct bb_monitor_reply r = get(&t, BB_VCP_LUMINANCE);
		assert_int_equal(r.status, BB_OK);
		tries += r.tries;
		most = r.tries > most ? r.tries : most;
	}
	print_message("%u tries for 2000 requests, at most %u\n", tries, most);
	assert_true(tries > 2020 && tries < 2070); /* 2 % of the tries: 41 +- 6 */
	end(&t);
	for (int fidelity = 0; fidelity < 2; fidelity++) { /* the option; fidelity 0 is never busy */
		struct rig *rig = rig_create(3, fidelity);
		const struct bb_monitor_config c = config();
		rig->uri.n_options = 1;
		strcpy(rig->uri.option[0].key, "busy_percent");
		strcpy(rig->uri.option[0].value, "100");
		t.rig = rig;
		t.c.clk = rig->clk;
		assert_int_equal(bb_monitor_open(&sim_monitor_driver, &c, &rig->open, &t.c.m), BB_OK);
		assert_int_equal(get(&t, BB_VCP_LUMINANCE).status, fidelity ? BB_ERR_BUSY : BB_OK);
		end(&t);
	}
}

static void test_sim_bad_opens(void **state)
{
	(void)state;
	struct rig *rig = rig_create(3, 1);
	struct bb_monitor_config c = config();
	struct bb_monitor *m;

	c.width_px = 7680;
	assert_int_equal(bb_monitor_open(&sim_monitor_driver, &c, &rig->open, &m), BB_ERR_CONFIG);
	c = config();
	rig->uri.n_options = 1;
	strcpy(rig->uri.option[0].key, "nonsense");
	assert_int_equal(bb_monitor_open(&sim_monitor_driver, &c, &rig->open, &m), BB_ERR_CONFIG);
	assert_null(m);
	rig_destroy(rig);
}

static void check_asleep(struct bench *t)
{
	struct bb_monitor_reply r = get(t, BB_VCP_LUMINANCE);

	assert_int_equal(r.status, BB_ERR_BUSY);
	assert_int_equal(r.tries, bb_monitor_limits(t->c.m)->most_tries);
	assert_int_equal(set(t, BB_VCP_LUMINANCE, 1), BB_ERR_BUSY);
	assert_int_equal(ask(t, BB_MONITOR_EDID, 0, 0).status, BB_OK);
	assert_true(light(t) <= 0);
}

static void check_gone(struct bench *t, bool edid)
{
	assert_int_equal(get(t, BB_VCP_LUMINANCE).status, BB_ERR_LOST);
	assert_int_equal(ask(t, BB_MONITOR_EDID, 0, 0).status, edid ? BB_OK : BB_ERR_LOST);
}

static void check_awake(struct bench *t)
{
	rig_pass(t->rig, 2 * RIG_S);
	assert_int_equal(get(t, BB_VCP_LUMINANCE).status, BB_OK);
	assert_int_equal(ask(t, BB_MONITOR_EDID, 0, 0).status, BB_OK);
	assert_true(light(t) > 1);
}

static void sleeps_and_wakes(struct bench *t)
{
	/* Real time: the one that differs most. */
	for (uint16_t mode = t->backend->kernel ? 4 : 2; mode <= 4; mode++) {
		assert_int_equal(set(t, BB_VCP_POWER_MODE, mode), BB_OK);
		check_asleep(t);
		assert_int_equal(set(t, BB_VCP_POWER_MODE, 1), BB_OK);
		check_awake(t);
	}
	static const char *const sleepy[] = { "off", "standby" };
	for (size_t i = t->backend->kernel ? 1 : 0; i < BB_ARRAY_LEN(sleepy); i++) {
		assert_int_equal(fault(t, sleepy[i], "", true), BB_OK);
		check_asleep(t);
		assert_int_equal(set(t, BB_VCP_POWER_MODE, 1), BB_ERR_BUSY);
		assert_int_equal(fault(t, sleepy[i], "", false), BB_OK);
		check_awake(t);
	}
}

static void is_lost_and_found(struct bench *t)
{
	feed(t, false);
	rig_pass(t->rig, RIG_S);
	check_gone(t, false);
	feed(t, true);
	rig_pass(t->rig, RIG_S);
	check_awake(t);
	assert_int_equal(fault(t, "unplug", "", true), BB_OK);
	check_gone(t, false);
	assert_int_equal(fault(t, "unplug", "", false), BB_OK);
	check_awake(t);
	assert_int_equal(fault(t, "silent", "", true), BB_OK);
	check_gone(t, true);
	assert_int_equal(fault(t, "silent", "", false), BB_OK);
	check_awake(t);
}

CONTRACT(sleeps_and_wakes)
CONTRACT(is_lost_and_found)

static void settings_are_tampered_with(struct bench *t)
{
	assert_int_equal(set(t, BB_VCP_NEW_CONTROL, 1), BB_OK);
	assert_int_equal(fault(t, "input", "value=0x12", true), BB_OK);
	assert_int_equal(get(t, BB_VCP_INPUT).current, 0x12);
	assert_int_equal(get(t, BB_VCP_NEW_CONTROL).current, 2);
	assert_int_equal(fault(t, "input", "value=0x12", false), BB_OK);
	assert_int_equal(get(t, BB_VCP_INPUT).current, 0x0F);
	assert_int_equal(fault(t, "input", "", true), BB_OK);
	assert_int_not_equal(get(t, BB_VCP_INPUT).current, 0x0F);
	assert_int_equal(fault(t, "drift", "luminance=33", true), BB_OK);
	assert_int_equal(get(t, BB_VCP_LUMINANCE).current, 33);
	assert_int_equal(fault(t, "corrupt_edid", "", true), BB_OK);
	const struct bb_monitor_reply r = ask(t, BB_MONITOR_EDID, 0, 0);
	unsigned int sum = 0;
	for (size_t i = 0; i < 128; i++)
		sum += r.edid[i];
	assert_int_not_equal(sum % 256, 0);
	assert_int_equal(r.status, BB_ERR_FORMAT);
	assert_int_equal(fault(t, "ignore_write", "", true), BB_OK);
	const struct bb_monitor_reply w = ask(t, BB_MONITOR_SET, BB_VCP_CONTRAST, 12);
	assert_int_equal(w.status, BB_ERR_VERIFY);
	assert_true(w.current != 12 && w.tries >= 2); /* written once more before it says so */
	assert_int_equal(fault(t, "ignore_write", "", false), BB_OK);
	assert_int_equal(set(t, BB_VCP_CONTRAST, 12), BB_OK);
	assert_int_equal(fault(t, "busy", "", true), BB_OK);
	assert_int_equal(get(t, BB_VCP_LUMINANCE).status, BB_ERR_BUSY);
}
CONTRACT(settings_are_tampered_with)

/* ---- fidelity: one script on every rung ---- */

/* As the driver's peer: never busy by chance. */
static struct bb_monitor *open_steady_sim(struct bench *t)
{
	const struct bb_monitor_config c = config();
	struct bb_monitor *m;

	t->rig->uri.n_options = 1;
	strcpy(t->rig->uri.option[0].key, "busy_percent");
	strcpy(t->rig->uri.option[0].value, "0");
	assert_int_equal(bb_monitor_open(&sim_monitor_driver, &c, &t->rig->open, &m), BB_OK);
	return m;
}

/* At a time of the script, so that no delay adds up: a request, or something happens to the monitor. */
static const struct act {
	int at_ms;
	enum bb_monitor_request_kind kind;
	uint8_t code;
	uint16_t value;
	const char *verb; /* "mains" is not a verb */
	bool on;
} script[] = {
	{ 0, BB_MONITOR_EDID, 0, 0, NULL, 0 },
	{ 500, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 1000, BB_MONITOR_GET, BB_VCP_CONTRAST, 0, NULL, 0 },
	{ 1500, BB_MONITOR_GET, BB_VCP_INPUT, 0, NULL, 0 },
	{ 2000, BB_MONITOR_GET, BB_VCP_POWER_MODE, 0, NULL, 0 },
	{ 2500, BB_MONITOR_GET, BB_VCP_VERSION, 0, NULL, 0 },
	{ 3000, BB_MONITOR_GET, BB_VCP_H_FREQUENCY, 0, NULL, 0 },
	{ 3500, BB_MONITOR_GET, BB_VCP_V_FREQUENCY, 0, NULL, 0 },
	{ 4000, BB_MONITOR_GET, BB_VCP_HOURS, 0, NULL, 0 },
	{ 4500, BB_MONITOR_GET, 0x59, 0, NULL, 0 },
	{ 5000, BB_MONITOR_CAPABILITIES, 0, 0, NULL, 0 },
	{ 7000, BB_MONITOR_SET, BB_VCP_LUMINANCE, 50, NULL, 0 },
	{ 7500, BB_MONITOR_SET, BB_VCP_LUMINANCE, 101, NULL, 0 },
	{ 8000, BB_MONITOR_SET, BB_VCP_HOURS, 1, NULL, 0 },
	{ 8500, BB_MONITOR_SET, BB_VCP_POWER_MODE, 5, NULL, 0 },
	{ 8600, BB_MONITOR_SAVE, 0, 0, NULL, 0 },
	{ 8700, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 9000, 0, 0, 0, "input", true },
	{ 9100, BB_MONITOR_GET, BB_VCP_INPUT, 0, NULL, 0 },
	{ 9400, BB_MONITOR_GET, BB_VCP_V_FREQUENCY, 0, NULL, 0 },
	{ 9500, 0, 0, 0, "input", false },
	{ 9600, 0, 0, 0, "ignore_write", true },
	{ 9700, BB_MONITOR_SET, BB_VCP_CONTRAST, 33, NULL, 0 },
	{ 10100, 0, 0, 0, "ignore_write", false },
	{ 10200, BB_MONITOR_SET, BB_VCP_CONTRAST, 33, NULL, 0 },
	{ 10600, 0, 0, 0, "corrupt_edid", true },
	{ 10700, BB_MONITOR_EDID, 0, 0, NULL, 0 },
	{ 11900, 0, 0, 0, "corrupt_edid", false },
	{ 12000, BB_MONITOR_EDID, 0, 0, NULL, 0 },
	{ 13000, 0, 0, 0, "silent", true },
	{ 13100, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 15000, BB_MONITOR_EDID, 0, 0, NULL, 0 },
	{ 16000, 0, 0, 0, "silent", false },
	{ 22000, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 23000, 0, 0, 0, "unplug", true },
	{ 23100, BB_MONITOR_EDID, 0, 0, NULL, 0 },
	{ 25000, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 27000, 0, 0, 0, "unplug", false },
	{ 33000, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 34000, BB_MONITOR_SET, BB_VCP_POWER_MODE, 4, NULL, 0 },
	{ 36000, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 43000, BB_MONITOR_SET, BB_VCP_POWER_MODE, 1, NULL, 0 },
	{ 50000, BB_MONITOR_GET, BB_VCP_POWER_MODE, 0, NULL, 0 },
	{ 51000, 0, 0, 0, "mains", false },
	{ 51500, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
	{ 53000, 0, 0, 0, "mains", true },
	{ 60000, BB_MONITOR_GET, BB_VCP_LUMINANCE, 0, NULL, 0 },
};

/* How far a done_ns may lie from what the standard's waits alone make it, by the limits: each transfer, and any time at
 * all within the request's longest when it did not come off at the first try. */
static int64_t within_ns(struct bench *t, const struct bb_monitor_reply *r)
{
	static const int64_t transfers[] = { [BB_MONITOR_GET] = 2, [BB_MONITOR_SET] = 3 };
	const struct bb_monitor_limits *l = bb_monitor_limits(t->c.m);
	const bool replied = r->status == BB_OK || r->status == BB_ERR_UNSUPPORTED || r->status == BB_ERR_RANGE;

	if (r->tries > 1 || !replied)
		return l->most_request_ns;
	if (r->request.kind == BB_MONITOR_EDID)
		return (int64_t)r->edid_bytes / 32 * l->transfer_ns;
	if (r->request.kind == BB_MONITOR_CAPABILITIES)
		return 2 * ((int64_t)r->text_bytes / 32 + 2) * l->transfer_ns;
	return transfers[r->request.kind] * l->transfer_ns;
}

static unsigned int sum_of(const uint8_t *bytes, size_t n)
{
	unsigned int sum = 0;

	for (size_t i = 0; i < n; i++)
		sum = sum * 31 + bytes[i];
	return sum & 0xFFFF;
}

static void note_reply(struct bench *t, struct fid_log *log, const struct bb_monitor_reply *r)
{
	const int64_t within = within_ns(t, r);
	const char *word = bb_status_text(r->status);

	if (r->request.kind == BB_MONITOR_EDID)
		fid_note(log, r->done_ns, within, "EDID: %s, %zu bytes, %04X", word, r->edid_bytes,
			 sum_of(r->edid, r->edid_bytes));
	else if (r->request.kind == BB_MONITOR_CAPABILITIES)
		fid_note(log, r->done_ns, within, "capabilities: %s, %zu bytes, %04X", word, r->text_bytes,
			 sum_of((const uint8_t *)r->text, r->text_bytes));
	else if (r->request.kind == BB_MONITOR_SET)
		fid_note(log, r->done_ns, within, "set %02X to %u: %s", r->request.code, r->request.value, word);
	else
		fid_note(log, r->done_ns, within, "get %02X: %s, %u of %u", r->request.code, word, r->current, r->most);
}

static void act(struct bench *t, const struct act *a, struct fid_log *log)
{
	const struct bb_monitor_request q = { a->kind, a->code, a->value };

	if (a->verb && !strcmp(a->verb, "mains")) {
		feed(t, a->on);
	} else if (a->verb) {
		assert_int_equal(fault(t, a->verb, "", a->on), BB_OK);
	} else {
		const enum bb_status status = bb_monitor_submit(t->c.m, &q);
		if (status != BB_OK) {
			fid_note(log, rig_now(t->rig), bb_monitor_limits(t->c.m)->transfer_ns, "%d %02X: not asked: %s",
				 (int)a->kind, a->code, bb_status_text(status));
			return;
		}
		const struct bb_monitor_reply r = monitor_take(&t->c);
		note_reply(t, log, &r);
	}
}

#define FAULTS_MS 9600 /* from here on of the script; before it every answer comes at the first try */

static void play(const struct backend *b, struct fid_log *plain, struct fid_log *faults)
{
	struct bench t = begin(b, 7);
	const int64_t start_ns = rig_now(t.rig);

	plain->rung = faults->rung = b->name;
	fid_note(plain, start_ns, 0, "begins");
	fid_note(faults, start_ns, 0, "begins");
	for (size_t i = 0; i < BB_ARRAY_LEN(script); i++) {
		bb_clock_run_until(t.c.clk, start_ns + script[i].at_ms * RIG_MS);
		act(&t, &script[i], script[i].at_ms < FAULTS_MS ? plain : faults);
	}
	end(&t);
}

static void test_fidelity(void **state)
{
	static const struct backend rungs[] = {
		{ "sim", NULL, 1, open_steady_sim, NULL, NULL, false },
		{ "driver + peer", NULL, 1, open_ddc, close_ddc, ddc_light, false },
		{ "driver + kernel", NULL, 1, open_kernel, close_kernel, ddc_light, true },
	};
	static struct fid_log plain[BB_ARRAY_LEN(rungs)], faults[BB_ARRAY_LEN(rungs)];
	const struct fid_log *all[2][BB_ARRAY_LEN(rungs)];
	size_t n = 0;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rungs); i++) {
		if (rungs[i].kernel && !in_guest())
			continue;
		play(&rungs[i], &plain[i], &faults[i]);
		all[0][n] = &plain[i];
		all[1][n++] = &faults[i];
	}
	const int apart = fid_table("monitor", all[0], n);
	assert_int_equal(apart + fid_table("monitor faults", all[1], n), 0);
}

static void test_sim_warm_up(void **state)
{
	(void)state;
	struct bench t = begin(&backends[1], 1);
	const double warm = sim_monitor_luminance(t.c.m, rig_now(t.rig));

	assert_true(warm > 200 && warm < 300);
	sim_world_set_fed(t.rig->world, "pdu1/2", false);
	rig_pass(t.rig, 4 * 3600 * RIG_S);
	assert_true(sim_monitor_luminance(t.c.m, rig_now(t.rig)) <= 0);
	sim_world_set_fed(t.rig->world, "pdu1/2", true);
	rig_pass(t.rig, RIG_S);
	const double cold = sim_monitor_luminance(t.c.m, rig_now(t.rig));
	assert_true(fabs(cold / warm - 0.8) < 0.005);
	/* After one time constant 63 % of the way is done; asking ahead and waiting give the same. */
	const double ahead = sim_monitor_luminance(t.c.m, rig_now(t.rig) + 600 * RIG_S);
	rig_pass(t.rig, 600 * RIG_S);
	const double then = sim_monitor_luminance(t.c.m, rig_now(t.rig));
	assert_true(fabs(ahead - then) < 1e-9 * warm);
	assert_true(fabs((then - cold) / (warm - cold) - (1 - exp(-1))) < 0.01);
	rig_pass(t.rig, 7200 * RIG_S);
	assert_true(fabs(sim_monitor_luminance(t.c.m, rig_now(t.rig)) / warm - 1) < 1e-4);
	/* Half the brightness is clearly darker. */
	assert_int_equal(set(&t, BB_VCP_LUMINANCE, 0), BB_OK);
	assert_true(sim_monitor_luminance(t.c.m, rig_now(t.rig)) < warm / 3);
	end(&t);
}

static void record(void *ctx, const struct bb_event *e)
{
	uint64_t *hash = ctx;

	for (size_t i = 0; i < sizeof(*e); i++)
		*hash = (*hash ^ ((const uint8_t *)e)[i]) * 0x100000001B3u;
}

static uint64_t events_hash(uint64_t seed)
{
	struct bench t = begin(&backends[1], seed);
	uint64_t hash = 0xCBF29CE484222325u;

	t.rig->on_event = record;
	t.rig->ctx = &hash;
	for (int i = 0; i < 200; i++)
		get(&t, BB_VCP_LUMINANCE);
	bb_eventlog_flush(t.rig->events);
	end(&t);
	return hash;
}

static void test_sim_is_repeatable(void **state)
{
	(void)state;
	assert_true(events_hash(5) == events_hash(5));
	assert_true(events_hash(5) != events_hash(6));
}

static void test_sim_verbs(void **state)
{
	(void)state;
	struct bench t = begin(&backends[1], 1);
	static const char *const bad[][2] = { { "input", "value=x" },     { "input", "value=0" },
		                              { "input", "value=256" },   { "input", "value=0x" },
		                              { "drift", "luminance=101" }, { "drift", "luminance=-1" },
		                              { "drift", "luminance=5.5" } };

	rig_check_verbs(t.rig, "monitor", "front-m", sim_monitor_verbs);
	check_awake(&t);
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		assert_int_equal(rig_fault(t.rig, "monitor", "front-m", bad[i][0], bad[i][1], true), BB_ERR_CONFIG);
	end(&t);
}

/* At fidelity 0 a monitor costs nothing but what is asked of it: no timer runs. */
static void test_sim_ideal_is_free(void **state)
{
	(void)state;
	struct bench t = begin(&backends[0], 1);

	rig_pass(t.rig, 60 * RIG_S);
	assert_int_equal(get(&t, BB_VCP_LUMINANCE).status, BB_OK);
	assert_int_equal(bb_clock_steps(t.rig->clk), 0);
	end(&t);
}

int main(int argc, char **argv)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_edid_is_whole),
		cmocka_unit_test(test_writes_are_read_back),
		cmocka_unit_test(test_unknown_codes_are_unsupported),
		cmocka_unit_test(test_one_request_at_a_time),
		cmocka_unit_test(test_power_off_is_refused),
		cmocka_unit_test(test_saving_is_refused),
		cmocka_unit_test(test_capabilities_are_text),
		cmocka_unit_test(test_reply_waits_are_kept),
		cmocka_unit_test(test_write_waits_are_kept),
		cmocka_unit_test(test_is_the_one_of_the_room),
		cmocka_unit_test(test_sim_every_value),
		cmocka_unit_test(test_sim_restore),
		cmocka_unit_test(test_sim_frequencies_and_hours),
		cmocka_unit_test(test_sim_busy_share),
		cmocka_unit_test(test_sim_bad_opens),
		cmocka_unit_test(test_sleeps_and_wakes),
		cmocka_unit_test(test_is_lost_and_found),
		cmocka_unit_test(test_settings_are_tampered_with),
		cmocka_unit_test(test_fidelity),
		cmocka_unit_test(test_sim_warm_up),
		cmocka_unit_test(test_sim_is_repeatable),
		cmocka_unit_test(test_sim_verbs),
		cmocka_unit_test(test_sim_ideal_is_free),
	};
	if (argc > 1)
		cmocka_set_test_filter(argv[1]); /* "test_fidelity" */
	return cmocka_run_group_tests(tests, NULL, NULL);
}
