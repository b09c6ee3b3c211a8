/*
 * tests/test_modbus.c: golden frames of the Modbus specification in both directions and both framings, hostile replies,
 * the write allow-list, the learned time-out, and the register maps.
 */
#define _GNU_SOURCE /* posix_openpt, ptsname_r */
#include "tests/modbus_rig.h"

#include "drivers/modbus_map.h"
#include "drivers/modbus_pace.h"

#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

static size_t from_hex(const char *hex, uint8_t *out)
{
	size_t n = 0;
	unsigned byte;

	for (int used; sscanf(hex, " %2x%n", &byte, &used) == 1; hex += used)
		out[n++] = (uint8_t)byte;
	return n;
}

static struct bb_power_config strip(int64_t outlets)
{
	struct bb_power_config c = { .id = "pdu", .n_outlets = (size_t)outlets,
		                     .safety = { .outlet_cycles_per_hour = 4 } };

	for (int64_t i = 0; i < outlets; i++)
		c.outlet[i] = (struct bb_outlet_config){ .outlet = i + 1, .load_a = 1.5 };
	return c;
}

/* ---- requests: what the driver writes, what the peer reads ---- */

static const struct {
	struct modbus_request r;
	const char *tcp, *rtu; /* transaction 0x1234 */
} requests[] = {
	{ { 1, 0x05, 4, 0xFF00 }, "12 34 00 00 00 06 01 05 00 04 FF 00", "01 05 00 04 FF 00 CD FB" },
	{ { 1, 0x01, 0, 8 }, "12 34 00 00 00 06 01 01 00 00 00 08", "01 01 00 00 00 08 3D CC" },
	{ { 1, 0x03, 16, 2 }, "12 34 00 00 00 06 01 03 00 10 00 02", "01 03 00 10 00 02 C5 CE" },
};

static void test_requests_as_in_the_standard(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(requests); i++) {
		uint8_t golden[32], tcp[MODBUS_TCP_REQUEST_BYTES], unit_and_pdu[MODBUS_REQUEST_BYTES];
		modbus_put_tcp(&requests[i].r, 0x1234, tcp);
		assert_int_equal(from_hex(requests[i].tcp, golden), sizeof(tcp));
		assert_memory_equal(tcp, golden, sizeof(tcp));
		modbus_put_request(&requests[i].r, unit_and_pdu);
		assert_int_equal(from_hex(requests[i].rtu, golden), sizeof(unit_and_pdu) + 2);
		assert_memory_equal(unit_and_pdu, golden, sizeof(unit_and_pdu));
		const uint16_t crc = peer_modbus_crc(golden, sizeof(unit_and_pdu));
		assert_int_equal(golden[6] | golden[7] << 8, crc);
	}
	assert_int_equal(peer_modbus_crc((const uint8_t *)"123456789", 9), 0x4B37);
}

/* The driver's bytes on a serial line, as a stranger sees them at its other end. */
static void test_serial_request_on_the_line(void **state)
{
	uint8_t golden[16], seen[16];
	size_t n = 0;
	char path[64];
	struct modbus_reply reply;
	struct bus_modbus_config c = { .rtu = true, .baud = 19200, .stop = 1, .parity = 'E', .unit = 1, .n_allow = 1,
		                       .allow = { { 0x05, 4, 0, 0xFF00 } } };
	struct bb_clock *clk;
	struct bus_modbus *bus;

	(void)state;
	const int master = posix_openpt(O_RDWR | O_NOCTTY);
	assert_true(master >= 0 && grantpt(master) == 0 && unlockpt(master) == 0);
	assert_int_equal(ptsname_r(master, path, sizeof(path)), 0);
	snprintf(c.tty, sizeof(c.tty), "%.60s", path);
	assert_int_equal(bb_clock_posix_create(&clk), BB_OK);
	assert_int_equal(bus_modbus_create(&c, clk, &bus), BB_OK);
	assert_int_equal(bus_modbus_connect(bus, BB_NS_PER_S), BB_OK);
	assert_int_equal(bus_modbus_exchange(bus, &requests[0].r, bb_clock_now_ns(clk) + 20 * WIRE_MS, &reply), BB_TIMEOUT);
	struct pollfd p = { master, POLLIN, 0 };
	while (n < 8 && poll(&p, 1, 1000) > 0) {
		const ssize_t got = read(master, seen + n, sizeof(seen) - n);
		assert_true(got > 0);
		n += (size_t)got;
	}
	assert_int_equal(n, from_hex(requests[0].rtu, golden));
	assert_memory_equal(seen, golden, n);
	bus_modbus_destroy(bus);
	bb_clock_destroy(clk);
	close(master);
}

/* ---- replies: what the peer writes, what the driver reads ---- */

static const struct {
	struct modbus_request r;
	const char *pdu;
	enum modbus_verdict verdict;
	size_t n;
	uint16_t first, last;
} replies[] = {
	{ { 1, 0x01, 0, 6 }, "01 01 3F", MODBUS_ANSWER, 6, 1, 1 },
	{ { 1, 0x02, 1, 2 }, "02 01 03", MODBUS_ANSWER, 2, 1, 1 },
	{ { 1, 0x04, 0, 4 }, "04 08 42 42 50 57 00 01 00 06", MODBUS_ANSWER, 4, 0x4242, 6 },
	{ { 1, 0x04, 256, 1 }, "04 02 05 DC", MODBUS_ANSWER, 1, 1500, 1500 },
	{ { 1, 0x05, 2, 0xFF00 }, "05 00 02 FF 00", MODBUS_ANSWER, 0, 0, 0 },
	{ { 1, 0x03, 16, 2 }, "83 02", MODBUS_EXCEPTION, 0, 0, 0 }, /* RTU: 01 83 02 C0 F1 */
	{ { 1, 0x01, 0, 0 }, "81 03", MODBUS_EXCEPTION, 0, 0, 0 },
	{ { 1, 0x07, 0, 0 }, "87 01", MODBUS_EXCEPTION, 0, 0, 0 },
};

static void test_replies_of_the_peer_are_read_by_the_driver(void **state)
{
	const struct bb_power_config c = strip(6);
	struct peer_modbus peer;
	struct modbus_reply reply;

	(void)state;
	peer_modbus_init(&peer, &c, 1, 0);
	for (size_t i = 0; i < BB_ARRAY_LEN(replies); i++) {
		uint8_t request[MODBUS_REQUEST_BYTES], golden[300], adu[300] = { 0x12, 0x34 };
		const size_t n = from_hex(replies[i].pdu, golden);
		modbus_put_request(&replies[i].r, request);
		assert_int_equal(peer_modbus_pdu(&peer, request + 1, 5, adu + 7, 1), n);
		assert_memory_equal(adu + 7, golden, n);
		adu[5] = (uint8_t)(n + 1);
		adu[6] = 1;
		modbus_judge_tcp(adu, 7 + n, &replies[i].r, 0x1234, &reply);
		assert_int_equal(reply.verdict, replies[i].verdict);
		assert_int_equal(reply.n, replies[i].n);
		if (reply.n) {
			assert_int_equal(reply.value[0], replies[i].first);
			assert_int_equal(reply.value[reply.n - 1], replies[i].last);
		}
		modbus_judge_rtu(adu + 6, 1 + n + 2, &replies[i].r, &reply);
		assert_int_equal(reply.verdict, replies[i].verdict);
	}
	uint8_t golden[8];
	assert_int_equal(from_hex("01 83 02 C0 F1", golden), 5);
	assert_int_equal(peer_modbus_crc(golden, 3), 0xF1C0);
}

static void test_device_identification(void **state)
{
	const struct bb_power_config c = strip(2);
	struct peer_modbus peer;
	uint8_t out[300];
	const uint8_t ask[] = { 0x2B, 0x0E, 0x01, 0x00 };

	(void)state;
	peer_modbus_init(&peer, &c, 1, 0);
	const size_t n = peer_modbus_pdu(&peer, ask, sizeof(ask), out, 0);
	assert_true(n > 20 && n <= MODBUS_PDU_MOST);
	assert_int_equal(out[6], 3);
	assert_memory_equal(out + 9, "blackburst", 10);
}

/* Every way in which a reply can be wrong, each from a right one. */
static void test_hostile_replies(void **state)
{
	static const struct {
		const char *adu;
		enum modbus_verdict verdict;
	} cases[] = { /* to: read 8 coils of unit 1, transaction 0x0007 */
		{ "00 07 00 00 00 04 01 01 01 FF", MODBUS_ANSWER },
		{ "00 06 00 00 00 04 01 01 01 FF", MODBUS_OTHER },
		{ "00 07 00 01 00 04 01 01 01 FF", MODBUS_BAD },
		{ "00 07 00 00 00 03 01 01 01 FF", MODBUS_BAD },
		{ "00 07 00 00 00 05 01 01 01 FF", MODBUS_BAD },
		{ "00 07 00 00 FF FF 01 01 01 FF", MODBUS_BAD },
		{ "00 06 00 00 FF FF 01 01 01 FF", MODBUS_BAD },
		{ "00 07 00 00 00 04 02 01 01 FF", MODBUS_BAD },
		{ "00 07 00 00 00 04 01 02 01 FF", MODBUS_BAD },
		{ "00 07 00 00 00 04 01 01 02 FF", MODBUS_BAD },
		{ "00 07 00 00 00 05 01 01 01 FF FF", MODBUS_BAD },
		{ "00 07 00 00 00 03 01 01 00", MODBUS_BAD },
		{ "00 07 00 00 00 03 01 81 02", MODBUS_EXCEPTION },
		{ "00 07 00 00 00 03 01 81 00", MODBUS_BAD },
		{ "00 07 00 00 00 03 01 81 0C", MODBUS_BAD },
		{ "00 07 00 00 00 02 01 81", MODBUS_BAD },
		{ "00 07 00 00 00 01 01", MODBUS_BAD },
		{ "00 07 00 00", MODBUS_BAD },
		{ "", MODBUS_BAD },
	};
	const struct modbus_request r = { 1, 0x01, 0, 8 };
	struct modbus_reply reply;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		uint8_t adu[300];
		const size_t n = from_hex(cases[i].adu, adu);
		modbus_judge_tcp(adu, n, &r, 7, &reply);
		if (reply.verdict != cases[i].verdict)
			fail_msg("%s: verdict %d", cases[i].adu, (int)reply.verdict);
		assert_true(reply.verdict != MODBUS_BAD || reply.why);
	}
	uint8_t long_one[400] = { 0, 7, 0, 0, 1, 0x8A, 1, 1 };
	modbus_judge_tcp(long_one, sizeof(long_one), &r, 7, &reply);
	assert_int_equal(reply.verdict, MODBUS_BAD);
}

static void test_peer_refuses_what_hardware_refuses(void **state)
{
	static const struct {
		const char *pdu, *reply;
	} cases[] = {
		{ "01 00 00 00 00", "81 03" },       { "01 00 00 07 D1", "81 03" },    { "01 00 00 00 07", "81 02" },
		{ "01 00 06 00 01", "81 02" },       { "01 FF FF 00 02", "81 02" },    { "01 00 00 00", "81 03" },
		{ "03 00 00 00 7E", "83 03" },       { "04 00 04 00 01", "84 02" },    { "04 FF FF 00 7D", "84 02" },
		{ "05 00 00 12 34", "85 03" },       { "05 00 06 FF 00", "85 02" },    { "06 00 00 00 02", "86 03" },
		{ "0F 00 00 00 06 02 3F", "8F 03" }, { "0F 00 00 00 06 01 3F", "0F 00 00 00 06" },
		{ "0F 00 01 00 06 01 3F", "8F 02" }, { "10 00 00 00 01 02 00 02", "90 03" },
		{ "10 00 00 00 01 02 00 01", "10 00 00 00 01" }, { "2B 0D 01 00", "AB 01" }, { "64 00 00 00 00", "E4 01" },
		{ "17", "97 03" },
	};
	const struct bb_power_config c = strip(6);
	struct peer_modbus peer;

	(void)state;
	peer_modbus_init(&peer, &c, 1, 0);
	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		uint8_t pdu[32], want[32], out[300];
		const size_t n = from_hex(cases[i].pdu, pdu), n_want = from_hex(cases[i].reply, want);
		const size_t got = peer_modbus_pdu(&peer, pdu, n, out, 0);
		if (got != n_want || memcmp(out, want, n_want) != 0)
			fail_msg("%s: %zu bytes, %02X %02X", cases[i].pdu, got, out[0], out[1]);
	}
	assert_int_equal(peer_modbus_pdu(&peer, NULL, 0, (uint8_t[300]){ 0 }, 0), 0);
}

/* ---- the allow-list: before the wire ---- */

static void test_no_write_beyond_the_list(void **state)
{
	const struct bb_power_config c = strip(6), two = strip(2);
	struct modbus_rig *rig = modbus_rig_create(&c, false);
	struct bus_modbus_config link;
	struct modbus_map map;
	struct bus_modbus *bus;
	struct bb_error err = { 0 };
	struct modbus_reply reply;
	unsigned refused = 0, random = 1;

	(void)state;
	snprintf(rig->device, sizeof(rig->device), "modbus:%s?unit=1", rig->path);
	assert_int_equal(bb_uri_parse(rig->device, &rig->uri, NULL, &err), BB_OK);
	assert_int_equal(modbus_map_read(&rig->uri, &two, &map, &err), BB_OK);
	assert_int_equal(modbus_map_link(&rig->uri, &two, &map, &link, &err), BB_OK);
	assert_int_equal(bus_modbus_create(&link, rig->clk, &bus), BB_OK);
	assert_int_equal(bus_modbus_connect(bus, BB_NS_PER_S), BB_OK);
	for (int i = 0; i < 1000; i++) {
		random = random * 1103515245 + 12345;
		const struct modbus_request r = { (uint8_t)(i % 3), (uint8_t)(5 + i % 40), (uint16_t)(random >> 16 & 7),
			                          (uint16_t)(i % 2 ? 0xFF00 : random >> 8) };
		const bool mine = r.unit == 1 && r.function == 5 && r.address < 2 && (r.value == 0xFF00 || !r.value);
		if (mine)
			continue;
		assert_int_equal(bus_modbus_exchange(bus, &r, bb_clock_now_ns(rig->clk) + BB_NS_PER_S, &reply), BB_ERR_REFUSED);
		refused++;
	}
	pthread_mutex_lock(&rig->lock);
	assert_int_equal(rig->peer.n_requests, 0);
	pthread_mutex_unlock(&rig->lock);
	const struct modbus_request mine = modbus_map_write(&map, 2, false);
	assert_int_equal(bus_modbus_exchange(bus, &mine, bb_clock_now_ns(rig->clk) + 5 * BB_NS_PER_S, &reply), BB_OK);
	pthread_mutex_lock(&rig->lock);
	assert_int_equal(rig->peer.n_writes, 1);
	pthread_mutex_unlock(&rig->lock);
	print_message("%u writes beyond the list refused, 0 bytes of them on the wire\n", refused);
	assert_true(refused >= 200);
	bus_modbus_destroy(bus);
	modbus_rig_destroy(rig);
}

/* Without an identity to check nothing is ever written. */
static void test_no_identity_no_write(void **state)
{
	const struct bb_power_config c = strip(2);
	struct modbus_rig *rig = modbus_rig_create(&c, false);
	struct bb_power *p;
	struct bb_outlet_state s;

	(void)state;
	assert_int_equal(modbus_rig_open(rig, &c, "&model=generic&command=0&timeout_most_ms=300", &p), BB_OK);
	assert_int_equal(bb_power_read(p, 0, &s), BB_OK);
	assert_true(s.known && s.closed);
	assert_int_equal(bb_power_set(p, 0, false), BB_ERR_REFUSED);
	assert_non_null(strstr(bb_power_device(p)->last_error.detail, "read only"));
	bb_power_close(p);
	modbus_rig_destroy(rig);
}

/* A register off by one between a manual that counts from 1 and the wire. */
static void test_maps(void **state)
{
	static const struct {
		const char *options;
		bool good;
		uint16_t outlet_1, current_2;
	} cases[] = {
		{ "?unit=1", true, 0, 257 },
		{ "?model=netio", true, 101, 102 },
		{ "?model=netio&base=1", true, 100, 101 },
		{ "?model=gude", true, 0, 0 },
		{ "?model=generic&command=1&base=1&current=100&current_step=4&current_words=2", true, 0, 103 },
		{ "?model=generic", false, 0, 0 },
		{ "?model=generic&command=0&base=1", false, 0, 0 },
		{ "?model=generic&command=65535", false, 0, 0 },
		{ "?model=generic&command=0&id=4242", false, 0, 0 },
		{ "?model=generic&command=0&id_at=0&id=42424", false, 0, 0 },
		{ "?model=generic&command=0&id_at=0&id=4242-", false, 0, 0 },
		{ "?model=generic&command=0&id_at=0&id=xyz", false, 0, 0 },
		{ "?model=acme", false, 0, 0 },
		{ "?unit=256", false, 0, 0 },
		{ "?timeout_least_ms=500&timeout_most_ms=100", false, 0, 0 },
		{ "?nonsense=1", false, 0, 0 },
	};
	const struct bb_power_config c = strip(2);

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		char text[160];
		struct bb_uri uri;
		struct modbus_map map;
		struct bb_error err = { 0 };
		snprintf(text, sizeof(text), "modbus:tcp://127.0.0.1:1502%s", cases[i].options);
		assert_int_equal(bb_uri_parse(text, &uri, NULL, &err), BB_OK);
		const enum bb_status status = modbus_map_read(&uri, &c, &map, &err);
		if ((status == BB_OK) != cases[i].good)
			fail_msg("%s: %s", text, err.text);
		assert_true(status == BB_OK || err.number);
		if (status != BB_OK)
			continue;
		assert_int_equal(modbus_map_write(&map, 1, true).address, cases[i].outlet_1);
		if (map.current >= 0)
			assert_int_equal(modbus_map_read_current(&map, 2, 1).address, cases[i].current_2);
	}
}

static void test_addresses(void **state)
{
	static const struct {
		const char *uri;
		bool good;
	} cases[] = {
		{ "modbus:tcp://127.0.0.1", true },          { "modbus:tcp://127.0.0.1:65535", true },
		{ "modbus:tcp://127.0.0.1:0", false },       { "modbus:tcp://127.0.0.1:65536", false },
		{ "modbus:tcp://127.0.0.1:", false },        { "modbus:tcp://127.0.0.1:+5", false },
		{ "modbus:tcp://localhost:502", false },     { "modbus:tcp://", false },
		{ "modbus:tcp://127.0.0.1:502x", false },    { "modbus:rtu:/dev/ttyUSB0", true },
		{ "modbus:rtu:ttyUSB0", false },             { "modbus:/dev/ttyUSB0", false },
		{ "modbus:rtu:/dev/ttyUSB0?unit=0", false }, { "modbus:tcp://255.255.255.255555:1", false },
	};
	const struct bb_power_config c = strip(2);

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(cases); i++) {
		struct bb_uri uri;
		struct modbus_map map;
		struct bus_modbus_config link;
		struct bb_error err = { 0 };
		assert_int_equal(bb_uri_parse(cases[i].uri, &uri, NULL, &err), BB_OK);
		assert_int_equal(modbus_map_read(&uri, &c, &map, &err), BB_OK);
		if ((modbus_map_link(&uri, &c, &map, &link, &err) == BB_OK) != cases[i].good)
			fail_msg("%s: %s", cases[i].uri, err.text);
	}
}

static void test_currents(void **state)
{
	const struct modbus_map big = { .current_words = 2, .current_step = 4, .current_scale_a = 0.001 };
	struct modbus_map little = big;
	const struct modbus_reply reply = { .n = 6, .value = { 0, 1500, 9, 9, 1, 2 } };

	(void)state;
	little.word_order = MODBUS_WORDS_LITTLE;
	assert_true(modbus_map_current_a(&big, &reply, 0) > 1.4999 && modbus_map_current_a(&big, &reply, 0) < 1.5001);
	assert_true(modbus_map_current_a(&big, &reply, 1) > 65.5 && modbus_map_current_a(&big, &reply, 1) < 65.6);
	assert_true(modbus_map_current_a(&little, &reply, 0) > 98303 && modbus_map_current_a(&little, &reply, 0) < 98305);
	assert_true(modbus_map_current_block(&big) == 31);
}

/* ---- waits ---- */

static void test_learned_timeout(void **state)
{
	struct modbus_pace *p = calloc(1, sizeof(*p));

	(void)state;
	assert_non_null(p);
	p->least_ns = 200 * WIRE_MS;
	p->most_ns = 3000 * WIRE_MS;
	assert_int_equal(modbus_pace_timeout_ns(p), p->most_ns);
	for (int i = 0; i < 30; i++)
		modbus_pace_add(p, WIRE_MS);
	assert_int_equal(modbus_pace_timeout_ns(p), p->least_ns);
	modbus_pace_add(p, 400 * WIRE_MS);
	assert_int_equal(modbus_pace_timeout_ns(p), 800 * WIRE_MS);
	for (int i = 0; i < 900; i++)
		modbus_pace_add(p, WIRE_MS);
	assert_int_equal(modbus_pace_timeout_ns(p), 800 * WIRE_MS);
	for (int i = 0; i < 100; i++)
		modbus_pace_add(p, 150 * WIRE_MS); /* one in a thousand may be slower */
	assert_int_equal(modbus_pace_timeout_ns(p), 300 * WIRE_MS);
	for (int i = 0; i < 10; i++)
		modbus_pace_add(p, 2900 * WIRE_MS);
	assert_int_equal(modbus_pace_timeout_ns(p), p->most_ns);
	free(p);
}

static void test_backoff(void **state)
{
	struct modbus_backoff b = { .random = 7 };
	int64_t plain_ns = 100 * WIRE_MS;

	(void)state;
	for (int i = 0; i < 20; i++) {
		const int64_t ns = modbus_backoff_next_ns(&b);
		assert_in_range(ns, plain_ns * 8 / 10, plain_ns * 12 / 10);
		plain_ns = plain_ns * 2 > 5 * BB_NS_PER_S ? 5 * BB_NS_PER_S : plain_ns * 2;
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_requests_as_in_the_standard),
		cmocka_unit_test(test_serial_request_on_the_line),
		cmocka_unit_test(test_replies_of_the_peer_are_read_by_the_driver),
		cmocka_unit_test(test_device_identification),
		cmocka_unit_test(test_hostile_replies),
		cmocka_unit_test(test_peer_refuses_what_hardware_refuses),
		cmocka_unit_test(test_no_write_beyond_the_list),
		cmocka_unit_test(test_no_identity_no_write),
		cmocka_unit_test(test_maps),
		cmocka_unit_test(test_addresses),
		cmocka_unit_test(test_currents),
		cmocka_unit_test(test_learned_timeout),
		cmocka_unit_test(test_backoff),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
