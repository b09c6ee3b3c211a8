/* tests/contract_monitor.c: what every monitor back end must do, and what the simulated one does besides. */
#include "tests/sim_rig.h"

#include "drivers/monitor_ddc.h"
#include "sim/bus_sim_i2c.h"
#include "sim/edid_model.h"
#include "sim/sim_monitor.h"

#include <math.h>

struct bench {
	struct rig *rig;
	struct bb_monitor *m;
	const struct backend *backend;
	struct peer_ddcci *peer;
};

/* A back end that is more than one thing opens itself; light is what a meter in front of the screen reads. */
static struct bb_monitor *open_ddc(struct bench *t);
static struct bb_monitor *open_quirky_ddc(struct bench *t);
static void close_ddc(struct bench *t);
static double ddc_light(struct bench *t);

static const struct backend {
	const char *name;
	const struct bb_monitor_driver *driver;
	int fidelity;
	struct bb_monitor *(*open)(struct bench *t);
	void (*close)(struct bench *t);
	double (*light)(struct bench *t);
} backends[] = {
	{ "sim, fidelity 0", &sim_monitor_driver, 0, NULL, NULL, NULL },
	{ "sim, fidelity 1", &sim_monitor_driver, 1, NULL, NULL, NULL },
	{ "ddc, a display in process", NULL, 1, open_ddc, close_ddc, ddc_light },
	{ "ddc, a display with quirks", NULL, 1, open_quirky_ddc, close_ddc, ddc_light },
};

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
	bb_monitor_close(t->m);
	peer_ddcci_destroy(t->peer);
}

static double ddc_light(struct bench *t)
{
	return peer_ddcci_luminance(t->peer, rig_now(t->rig));
}

static struct bench begin(const struct backend *b, uint64_t seed)
{
	struct bench t = { rig_create(seed, b->fidelity), NULL, b, NULL };
	const struct bb_monitor_config c = config();

	if (b->open)
		t.m = b->open(&t);
	else
		assert_int_equal(bb_monitor_open(b->driver, &c, &t.rig->open, &t.m), BB_OK);
	return t;
}

static void end(struct bench *t)
{
	if (t->backend && t->backend->close)
		t->backend->close(t);
	else
		bb_monitor_close(t->m);
	rig_destroy(t->rig);
}

static double light(struct bench *t)
{
	return t->backend->light ? t->backend->light(t) : sim_monitor_luminance(t->m, rig_now(t->rig));
}

/* The longest any request may take: every try with its waits, its bytes and its back-off. */
static int64_t most_ns(const struct bench *t)
{
	const struct bb_monitor_limits *l = bb_monitor_limits(t->m);

	return l->most_tries * (l->reply_wait_ns + l->write_wait_ns + 30 * RIG_MS + l->most_tries * 50 * RIG_MS);
}

static struct bb_monitor_reply ask(struct bench *t, enum bb_monitor_request_kind kind, uint8_t code, uint16_t value)
{
	const struct bb_monitor_request request = { kind, code, value };
	const int64_t end_ns = rig_now(t->rig) + most_ns(t);
	struct bb_monitor_reply reply = { 0 };
	enum bb_status status;

	assert_int_equal(bb_monitor_submit(t->m, &request), BB_OK);
	while ((status = bb_monitor_poll(t->m, &reply)) == BB_TIMEOUT && rig_now(t->rig) < end_ns)
		rig_pass(t->rig, RIG_MS);
	assert_int_equal(status, BB_OK);
	assert_int_equal(reply.request.code, code);
	assert_true(reply.tries >= 1 && reply.tries <= bb_monitor_limits(t->m)->most_tries);
	assert_true(reply.done_ns <= rig_now(t->rig));
	return reply;
}

static struct bb_monitor_reply get(struct bench *t, uint8_t code)
{
	return ask(t, BB_MONITOR_GET, code, 0);
}

static enum bb_status set(struct bench *t, uint8_t code, uint16_t value)
{
	return ask(t, BB_MONITOR_SET, code, value).status;
}

static void for_all(void (*check)(struct bench *))
{
	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		struct bench t = begin(&backends[i], 7);
		print_message("%s\n", backends[i].name);
		check(&t);
		end(&t);
	}
}

static void edid_is_whole(struct bench *t)
{
	const struct bb_monitor_reply r = ask(t, BB_MONITOR_EDID, 0, 0);
	static const uint8_t header[8] = { 0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0 };

	assert_int_equal(r.status, BB_OK);
	assert_memory_equal(r.edid, header, sizeof(header));
	assert_int_equal(r.edid_bytes, 128 * (1 + r.edid[126]));
	for (size_t block = 0; block < r.edid_bytes; block += 128) {
		unsigned int sum = 0;
		for (size_t i = 0; i < 128; i++)
			sum += r.edid[block + i];
		assert_int_equal(sum % 256, 0);
	}
	assert_int_equal(r.edid[8] << 8 | r.edid[9], 0x4C2D); /* SAM */
}

static void writes_are_read_back(struct bench *t)
{
	assert_int_equal(set(t, BB_VCP_LUMINANCE, 50), BB_OK);
	const struct bb_monitor_reply r = get(t, BB_VCP_LUMINANCE);
	assert_int_equal(r.status, BB_OK);
	assert_int_equal(r.current, 50);
	assert_int_equal(r.most, 100);
	const enum bb_status status = set(t, BB_VCP_LUMINANCE, 101);
	assert_true(status == BB_ERR_RANGE || status == BB_OK); /* hardware may just ignore it */
	assert_int_equal(get(t, BB_VCP_LUMINANCE).current, 50);
}

static void unknown_codes_are_unsupported(struct bench *t)
{
	assert_int_equal(get(t, 0x59).status, BB_ERR_UNSUPPORTED);
	assert_int_equal(get(t, BB_VCP_RESTORE_DEFAULTS).status, BB_ERR_UNSUPPORTED);
	assert_int_equal(set(t, BB_VCP_HOURS, 0), BB_ERR_UNSUPPORTED);
}

static void one_request_at_a_time(struct bench *t)
{
	const struct bb_monitor_request request = { BB_MONITOR_GET, BB_VCP_VERSION, 0 };
	struct bb_monitor_reply reply;

	assert_int_equal(bb_monitor_poll(t->m, &reply), BB_TIMEOUT);
	assert_int_equal(bb_monitor_submit(t->m, &request), BB_OK);
	assert_int_equal(bb_monitor_submit(t->m, &request), BB_ERR_BUSY);
	rig_pass(t->rig, most_ns(t));
	assert_int_equal(bb_monitor_poll(t->m, &reply), BB_OK);
	assert_int_equal(reply.current, 0x0202);
	assert_int_equal(bb_monitor_poll(t->m, &reply), BB_TIMEOUT);
	assert_int_equal(bb_monitor_submit(t->m, NULL), BB_ERR_USAGE);
	assert_int_equal(bb_monitor_submit(t->m, &(struct bb_monitor_request){ 9, 0, 0 }), BB_ERR_USAGE);
	bb_monitor_close(NULL);
}

static void ddc_power_off_is_refused(struct bench *t)
{
	const struct bb_monitor_request off = { BB_MONITOR_SET, BB_VCP_POWER_MODE, 5 };

	assert_int_equal(bb_monitor_submit(t->m, &off), BB_ERR_REFUSED);
	assert_int_equal(get(t, BB_VCP_POWER_MODE).current, 1);
}

static void capabilities_are_text(struct bench *t)
{
	const struct bb_monitor_reply r = ask(t, BB_MONITOR_CAPABILITIES, 0, 0);

	assert_int_equal(r.status, BB_OK);
	assert_true(r.text_bytes > 40 && r.text_bytes <= sizeof(r.text));
	assert_memory_equal(r.text, "(prot(monitor)", 14);
	assert_int_equal(r.text[r.text_bytes - 1], ')');
}

static void saving_is_refused(struct bench *t)
{
	const struct bb_monitor_request save = { BB_MONITOR_SAVE, 0, 0 };
	const struct bb_monitor_request store = { BB_MONITOR_SET, BB_VCP_SETTINGS, 1 };

	assert_int_equal(bb_monitor_submit(t->m, &save), BB_ERR_REFUSED);
	assert_int_equal(bb_monitor_submit(t->m, &store), BB_ERR_REFUSED);
}

static void waits_are_kept(struct bench *t)
{
	const struct bb_monitor_limits *l = bb_monitor_limits(t->m);

	for (int i = 0; i < 50; i++) {
		int64_t start_ns = rig_now(t->rig);
		struct bb_monitor_reply r = get(t, BB_VCP_LUMINANCE);
		assert_true(r.done_ns - start_ns >= r.tries * l->reply_wait_ns);
		start_ns = rig_now(t->rig);
		r = ask(t, BB_MONITOR_SET, BB_VCP_LUMINANCE, 40);
		assert_true(r.done_ns - start_ns >= r.tries * l->write_wait_ns);
	}
}

#define CONTRACT(name)                                                                                               \
	static void test_##name(void **state)                                                                        \
	{                                                                                                            \
		(void)state;                                                                                         \
		for_all(name);                                                                                       \
	}
CONTRACT(edid_is_whole)
CONTRACT(writes_are_read_back)
CONTRACT(unknown_codes_are_unsupported)
CONTRACT(one_request_at_a_time)
CONTRACT(ddc_power_off_is_refused)
CONTRACT(capabilities_are_text)
CONTRACT(saving_is_refused)
CONTRACT(waits_are_kept)

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
		assert_int_equal(bb_monitor_open(&sim_monitor_driver, &c, &rig->open, &t.m), BB_OK);
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
	assert_int_equal(r.tries, bb_monitor_limits(t->m)->most_tries);
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
	for (uint16_t mode = 2; mode <= 4; mode++) {
		assert_int_equal(set(t, BB_VCP_POWER_MODE, mode), BB_OK);
		check_asleep(t);
		assert_int_equal(set(t, BB_VCP_POWER_MODE, 1), BB_OK);
		check_awake(t);
	}
	static const char *const sleepy[] = { "off", "standby" };
	for (size_t i = 0; i < BB_ARRAY_LEN(sleepy); i++) {
		assert_int_equal(rig_fault(t->rig, "monitor", "front-m", sleepy[i], "", true), BB_OK);
		check_asleep(t);
		assert_int_equal(set(t, BB_VCP_POWER_MODE, 1), BB_ERR_BUSY);
		assert_int_equal(rig_fault(t->rig, "monitor", "front-m", sleepy[i], "", false), BB_OK);
		check_awake(t);
	}
}

static void is_lost_and_found(struct bench *t)
{
	sim_world_set_fed(t->rig->world, "pdu1/2", false);
	rig_pass(t->rig, RIG_S);
	check_gone(t, false);
	sim_world_set_fed(t->rig->world, "pdu1/2", true);
	rig_pass(t->rig, RIG_S);
	check_awake(t);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "unplug", "", true), BB_OK);
	check_gone(t, false);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "unplug", "", false), BB_OK);
	check_awake(t);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "silent", "", true), BB_OK);
	check_gone(t, true);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "silent", "", false), BB_OK);
	check_awake(t);
}

CONTRACT(sleeps_and_wakes)
CONTRACT(is_lost_and_found)

static void settings_are_tampered_with(struct bench *t)
{
	assert_int_equal(set(t, BB_VCP_NEW_CONTROL, 1), BB_OK);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "input", "value=0x12", true), BB_OK);
	assert_int_equal(get(t, BB_VCP_INPUT).current, 0x12);
	assert_int_equal(get(t, BB_VCP_NEW_CONTROL).current, 2);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "input", "value=0x12", false), BB_OK);
	assert_int_equal(get(t, BB_VCP_INPUT).current, 0x0F);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "input", "", true), BB_OK);
	assert_int_not_equal(get(t, BB_VCP_INPUT).current, 0x0F);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "drift", "luminance=33", true), BB_OK);
	assert_int_equal(get(t, BB_VCP_LUMINANCE).current, 33);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "corrupt_edid", "", true), BB_OK);
	const struct bb_monitor_reply r = ask(t, BB_MONITOR_EDID, 0, 0);
	unsigned int sum = 0;
	for (size_t i = 0; i < 128; i++)
		sum += r.edid[i];
	assert_int_not_equal(sum % 256, 0);
	assert_int_equal(rig_fault(t->rig, "monitor", "front-m", "busy", "", true), BB_OK);
	assert_int_equal(get(t, BB_VCP_LUMINANCE).status, BB_ERR_BUSY);
}
CONTRACT(settings_are_tampered_with)

static void test_sim_warm_up(void **state)
{
	(void)state;
	struct bench t = begin(&backends[1], 1);
	const double warm = sim_monitor_luminance(t.m, rig_now(t.rig));

	assert_true(warm > 200 && warm < 300);
	sim_world_set_fed(t.rig->world, "pdu1/2", false);
	rig_pass(t.rig, 4 * 3600 * RIG_S);
	assert_true(sim_monitor_luminance(t.m, rig_now(t.rig)) <= 0);
	sim_world_set_fed(t.rig->world, "pdu1/2", true);
	rig_pass(t.rig, RIG_S);
	const double cold = sim_monitor_luminance(t.m, rig_now(t.rig));
	assert_true(fabs(cold / warm - 0.8) < 0.005);
	/* After one time constant 63 % of the way is done; asking ahead and waiting give the same. */
	const double ahead = sim_monitor_luminance(t.m, rig_now(t.rig) + 600 * RIG_S);
	rig_pass(t.rig, 600 * RIG_S);
	const double then = sim_monitor_luminance(t.m, rig_now(t.rig));
	assert_true(fabs(ahead - then) < 1e-9 * warm);
	assert_true(fabs((then - cold) / (warm - cold) - (1 - exp(-1))) < 0.01);
	rig_pass(t.rig, 7200 * RIG_S);
	assert_true(fabs(sim_monitor_luminance(t.m, rig_now(t.rig)) / warm - 1) < 1e-4);
	/* Half the brightness is clearly darker. */
	assert_int_equal(set(&t, BB_VCP_LUMINANCE, 0), BB_OK);
	assert_true(sim_monitor_luminance(t.m, rig_now(t.rig)) < warm / 3);
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

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_edid_is_whole),
		cmocka_unit_test(test_writes_are_read_back),
		cmocka_unit_test(test_unknown_codes_are_unsupported),
		cmocka_unit_test(test_one_request_at_a_time),
		cmocka_unit_test(test_ddc_power_off_is_refused),
		cmocka_unit_test(test_capabilities_are_text),
		cmocka_unit_test(test_saving_is_refused),
		cmocka_unit_test(test_waits_are_kept),
		cmocka_unit_test(test_sim_every_value),
		cmocka_unit_test(test_sim_restore),
		cmocka_unit_test(test_sim_frequencies_and_hours),
		cmocka_unit_test(test_sim_busy_share),
		cmocka_unit_test(test_sim_bad_opens),
		cmocka_unit_test(test_sleeps_and_wakes),
		cmocka_unit_test(test_is_lost_and_found),
		cmocka_unit_test(test_settings_are_tampered_with),
		cmocka_unit_test(test_sim_warm_up),
		cmocka_unit_test(test_sim_is_repeatable),
		cmocka_unit_test(test_sim_verbs),
		cmocka_unit_test(test_sim_ideal_is_free),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
