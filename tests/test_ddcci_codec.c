/*
 * tests/test_ddcci_codec.c: DDC/CI frames against golden bytes, both ways: what the driver writes, what it makes of
 * replies, and what the simulated display does with the same bytes.
 */
#include "drivers/ddcci_codec.h"
#include "drivers/ddcci_wire.h"
#include "sim/peer_ddcci.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#define MS INT64_C(1000000)

/* The standard's own examples of checksums: address byte first. */
static void test_checksums(void **state)
{
	(void)state;
	static const struct {
		uint8_t first, bytes[4];
		size_t n;
		uint8_t sum;
	} known[] = {
		{ 0x6E, { 0x51, 0x82, 0xF5, 0x01 }, 4, 0x49 },
		{ 0x6E, { 0x51, 0x81, 0xB1 }, 3, 0x0F },
		{ 0xF0, { 0xF1, 0x81, 0xB1 }, 3, 0x31 },
		{ 0x6E, { 0xF1, 0x81, 0xB1 }, 3, 0xAF },
		/* replies: 50 stands for 6F (and for F1) */
		{ 0x50, { 0x6E, 0x82, 0xA1, 0x00 }, 4, 0x1D },
		{ 0x50, { 0x6E, 0x80 }, 2, 0xBE },
		{ 0x50, { 0xF0, 0x82, 0xA1, 0x00 }, 4, 0x83 },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++)
		assert_int_equal(ddcci_checksum(known[i].first, known[i].bytes, known[i].n), known[i].sum);
}

static void check_request(const char *golden, const uint8_t *bytes, size_t n)
{
	char text[64] = "6E";

	for (size_t i = 0; i < n; i++)
		snprintf(text + strlen(text), sizeof(text) - strlen(text), " %02X", bytes[i]);
	assert_string_equal(text, golden);
}

static void test_requests(void **state)
{
	(void)state;
	uint8_t b[DDCCI_MOST_REQUEST];

	check_request("6E 51 82 01 10 AC", b, ddcci_put_get(b, 0x10));
	check_request("6E 51 82 01 60 DC", b, ddcci_put_get(b, 0x60));
	check_request("6E 51 82 01 D6 6A", b, ddcci_put_get(b, 0xD6));
	check_request("6E 51 82 01 DF 63", b, ddcci_put_get(b, 0xDF));
	check_request("6E 51 84 03 10 00 32 9A", b, ddcci_put_set(b, 0x10, 50));
	check_request("6E 51 84 03 D6 00 04 6A", b, ddcci_put_set(b, 0xD6, 4));
	check_request("6E 51 84 03 60 00 11 C9", b, ddcci_put_set(b, 0x60, 0x11));
	check_request("6E 51 81 0C B2", b, ddcci_put_save(b));
	check_request("6E 51 83 F3 00 00 4F", b, ddcci_put_capabilities(b, 0));
	check_request("6E 51 83 F3 00 20 6F", b, ddcci_put_capabilities(b, 32));
	check_request("6E 51 81 F1 4F", b, ddcci_put_identification(b));
}

static const struct golden_value {
	uint8_t bytes[11];
	struct ddcci_vcp vcp;
} values[] = {
	{ { 0x6E, 0x88, 0x02, 0x00, 0x10, 0x00, 0x00, 0x64, 0x00, 0x32, 0xF2 }, { true, 0x10, 0, 100, 50 } },
	{ { 0x6E, 0x88, 0x02, 0x01, 0x59, 0x00, 0x00, 0x00, 0x00, 0x00, 0xEC }, { false, 0x59, 0, 0, 0 } },
	{ { 0x6E, 0x88, 0x02, 0x00, 0xDF, 0x00, 0xFF, 0xFF, 0x02, 0x02, 0x6B }, { true, 0xDF, 0, 0xFFFF, 0x0202 } },
	{ { 0x6E, 0x88, 0x02, 0x00, 0xAE, 0x00, 0xFF, 0xFF, 0x2E, 0xE0, 0xD4 }, { true, 0xAE, 0, 0xFFFF, 12000 } },
	{ { 0x6E, 0x88, 0x02, 0x00, 0xC0, 0x00, 0x00, 0x00, 0x30, 0x39, 0x7D }, { true, 0xC0, 0, 0, 12345 } },
	{ { 0x6E, 0x88, 0x02, 0x00, 0xAC, 0x00, 0x00, 0x02, 0x0F, 0x58, 0x4D }, { true, 0xAC, 0, 2, 135000 & 0xFFFF } },
};

static void test_values(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(values); i++) {
		const struct golden_value *g = &values[i];
		struct ddcci_vcp v;
		bool doubled;
		assert_int_equal(ddcci_take_vcp(g->bytes, 11, g->vcp.code, &v, &doubled, NULL), DDCCI_ANSWER);
		assert_false(doubled);
		assert_true(v.supported == g->vcp.supported && v.code == g->vcp.code && v.type == g->vcp.type &&
			    v.most == g->vcp.most && v.current == g->vcp.current);
		uint8_t twice[12] = { 0x6E };
		memcpy(twice + 1, g->bytes, 11);
		assert_int_equal(ddcci_take_vcp(twice, 12, g->vcp.code, &v, &doubled, NULL), DDCCI_ANSWER);
		assert_true(doubled && v.current == g->vcp.current);
		assert_int_equal(ddcci_take_vcp(twice, 11, g->vcp.code, &v, &doubled, NULL), DDCCI_BAD);
		assert_true(doubled);
		assert_int_equal(ddcci_take_vcp(g->bytes, 11, (uint8_t)(g->vcp.code + 1), &v, NULL, NULL), DDCCI_BAD);
	}
}

/* Every byte wrong in every bit, and every length. */
static void test_damaged_values(void **state)
{
	(void)state;
	struct ddcci_vcp v;
	const char *why;

	for (size_t i = 0; i < BB_ARRAY_LEN(values); i++)
		for (unsigned int bit = 0; bit < 88; bit++) {
			uint8_t b[11];
			memcpy(b, values[i].bytes, 11);
			b[bit / 8] ^= (uint8_t)(1u << bit % 8);
			why = NULL;
			assert_int_equal(ddcci_take_vcp(b, 11, values[i].vcp.code, &v, NULL, &why), DDCCI_BAD);
			assert_non_null(why);
		}
	for (size_t n = 0; n < 11; n++)
		assert_int_equal(ddcci_take_vcp(values[0].bytes, n, 0x10, &v, NULL, NULL), DDCCI_BAD);
	static const uint8_t zeros[11], null[11] = { 0x6E, 0x80, 0xBE, 0xFF, 0xFF };
	assert_int_equal(ddcci_take_vcp(zeros, 11, 0x10, &v, NULL, NULL), DDCCI_ALL_ZERO);
	assert_int_equal(ddcci_take_vcp(null, 11, 0x10, &v, NULL, NULL), DDCCI_NULL);
	assert_int_equal(ddcci_take_vcp(null, 3, 0x10, &v, NULL, NULL), DDCCI_NULL);
}

static void test_fragments(void **state)
{
	(void)state;
	static const uint8_t part[] = { 0x6E, 0x91, 0xE3, 0x00, 0x00, 0x28, 0x70, 0x72, 0x6F, 0x74,
					0x28, 0x6D, 0x6F, 0x6E, 0x69, 0x74, 0x6F, 0x72, 0x29, 0x10 };
	static const uint8_t last[] = { 0x6E, 0x83, 0xE3, 0x00, 0x0E, 0x50 };
	struct ddcci_fragment f;
	struct ddcci_vcp v;

	assert_int_equal(ddcci_take_fragment(part, sizeof(part), 0, &f, NULL, NULL), DDCCI_ANSWER);
	assert_int_equal(f.n, 14);
	assert_memory_equal(f.text, "(prot(monitor)", 14);
	assert_int_equal(ddcci_take_fragment(part, sizeof(part), 32, &f, NULL, NULL), DDCCI_BAD);
	assert_int_equal(ddcci_take_fragment(last, sizeof(last), 14, &f, NULL, NULL), DDCCI_ANSWER);
	assert_int_equal(f.n, 0);
	assert_int_equal(ddcci_take_vcp(last, sizeof(last), 0xE3, &v, NULL, NULL), DDCCI_BAD);
	assert_int_equal(ddcci_take_fragment(values[0].bytes, 11, 0, &f, NULL, NULL), DDCCI_BAD);
}

/* ---- the same bytes at the simulated display ---- */

struct end {
	struct peer_ddcci *p;
	int64_t now_ns;
};

static struct end begin(void)
{
	const struct bb_monitor_config c = {
		.id = "golden", .edid = "generic", .width_px = 1920, .height_px = 1080, .rate = { 120, 1 }
	};
	struct end e = { NULL, 0 };

	assert_int_equal(peer_ddcci_create(&c, NULL, 1, 0, &e.p), BB_OK);
	return e;
}

/* Writes what follows the address byte of a golden request, and reads n bytes after the standard's wait. */
static void talk(struct end *e, const uint8_t *request, size_t n_request, uint8_t *reply, size_t n)
{
	e->now_ns += 100 * MS;
	assert_int_equal(peer_ddcci_write(e->p, 0x37, request, n_request, e->now_ns, e->now_ns + MS), PEER_ACK);
	peer_ddcci_stop(e->p);
	e->now_ns += 41 * MS;
	if (n)
		assert_int_equal(peer_ddcci_read(e->p, 0x37, reply, n, e->now_ns), PEER_ACK);
	peer_ddcci_stop(e->p);
}

static void test_peer_golden(void **state)
{
	(void)state;
	static const uint8_t set[] = { 0x51, 0x84, 0x03, 0x10, 0x00, 0x32, 0x9A },
			     get[] = { 0x51, 0x82, 0x01, 0x10, 0xAC }, version[] = { 0x51, 0x82, 0x01, 0xDF, 0x63 },
			     save[] = { 0x51, 0x81, 0x0C, 0xB2 }, strange[] = { 0x51, 0x82, 0x01, 0x59, 0xE5 },
			     caps[] = { 0x51, 0x83, 0xF3, 0x00, 0x00, 0x4F }, identify[] = { 0x51, 0x81, 0xF1, 0x4F },
			     wrong[] = { 0x51, 0x82, 0x01, 0x10, 0xAD };
	static const uint8_t null[] = { 0x6E, 0x80, 0xBE };
	struct end e = begin();
	uint8_t b[38];

	talk(&e, set, sizeof(set), NULL, 0);
	talk(&e, get, sizeof(get), b, 11);
	assert_memory_equal(b, values[0].bytes, 11);
	talk(&e, version, sizeof(version), b, 11);
	assert_memory_equal(b, values[2].bytes, 11);
	talk(&e, strange, sizeof(strange), b, 11);
	assert_memory_equal(b, values[1].bytes, 11);
	talk(&e, caps, sizeof(caps), b, 38);
	assert_memory_equal(b, "\x6E\xA3\xE3\0\0(prot(monitor)", 19);
	talk(&e, identify, sizeof(identify), b, 11);
	assert_memory_equal(b, null, 3);
	talk(&e, wrong, sizeof(wrong), b, 11);
	assert_memory_equal(b, null, 3);
	assert_int_equal(peer_ddcci_counts(e.p)->damaged, 1);
	talk(&e, save, sizeof(save), NULL, 0);
	assert_int_equal(peer_ddcci_counts(e.p)->saves, 1);
	assert_int_equal(peer_ddcci_counts(e.p)->too_early, 0);
	peer_ddcci_destroy(e.p);
}

/* Programs look for a display by a write of one byte; it means nothing. */
static void test_peer_probe(void **state)
{
	(void)state;
	static const uint8_t zero[1], get[] = { 0x51, 0x82, 0x01, 0x10, 0xAC };
	struct end e = begin();
	uint8_t b[11];

	assert_int_equal(peer_ddcci_write(e.p, 0x37, zero, 1, MS, 2 * MS), PEER_ACK);
	talk(&e, get, sizeof(get), b, 11);
	assert_int_equal(b[4], 0x10);
	assert_int_equal(peer_ddcci_write(e.p, 0x38, zero, 1, e.now_ns, e.now_ns), PEER_NO_ACK);
	assert_int_equal(peer_ddcci_counts(e.p)->damaged, 0);
	/* Inside the wait after a Set it hears nothing; before its reply is ready it says Null. */
	static const uint8_t set[] = { 0x51, 0x84, 0x03, 0x10, 0x00, 0x32, 0x9A };
	e.now_ns += 100 * MS;
	assert_int_equal(peer_ddcci_write(e.p, 0x37, set, sizeof(set), e.now_ns, e.now_ns + MS), PEER_ACK);
	assert_int_equal(peer_ddcci_write(e.p, 0x37, get, sizeof(get), e.now_ns + 40 * MS, e.now_ns + 41 * MS),
			 PEER_ACK);
	assert_int_equal(peer_ddcci_counts(e.p)->too_early, 1);
	e.now_ns += 100 * MS;
	assert_int_equal(peer_ddcci_write(e.p, 0x37, get, sizeof(get), e.now_ns, e.now_ns + MS), PEER_ACK);
	assert_int_equal(peer_ddcci_read(e.p, 0x37, b, 11, e.now_ns + 20 * MS), PEER_ACK);
	assert_memory_equal(b, "\x6E\x80\xBE", 3);
	assert_int_equal(peer_ddcci_read(e.p, 0x37, b, 11, e.now_ns + 45 * MS), PEER_ACK);
	assert_memory_equal(b, values[0].bytes, 11);
	assert_int_equal(peer_ddcci_counts(e.p)->too_early, 2);
	peer_ddcci_destroy(e.p);
}

/* All 256 codes through the driver's writer, the display, and the driver's reader. */
static void test_round_trip(void **state)
{
	(void)state;
	struct end e = begin();
	int supported = 0;

	for (int code = 0; code < 256; code++) {
		uint8_t request[DDCCI_MOST_REQUEST], reply[11];
		struct ddcci_vcp v;
		uint16_t truth = 0;
		talk(&e, request, ddcci_put_get(request, (uint8_t)code), reply, 11);
		assert_int_equal(ddcci_take_vcp(reply, 11, (uint8_t)code, &v, NULL, NULL), DDCCI_ANSWER);
		assert_int_equal(v.supported, peer_ddcci_value(e.p, (uint8_t)code, &truth));
		assert_int_equal(v.current, truth);
		supported += v.supported;
	}
	assert_int_equal(supported, 15);
	for (unsigned int value = 0; value <= 100; value++) {
		uint8_t request[DDCCI_MOST_REQUEST];
		uint16_t truth;
		talk(&e, request, ddcci_put_set(request, 0x12, (uint16_t)value), NULL, 0);
		assert_true(peer_ddcci_value(e.p, 0x12, &truth));
		assert_int_equal(truth, value);
	}
	peer_ddcci_destroy(e.p);
}

static void read_edid(struct end *e, uint8_t segment, uint8_t offset, uint8_t *out, size_t n)
{
	if (segment)
		assert_int_equal(peer_ddcci_write(e->p, 0x30, &segment, 1, e->now_ns, e->now_ns), PEER_ACK);
	assert_int_equal(peer_ddcci_write(e->p, 0x50, &offset, 1, e->now_ns, e->now_ns), PEER_ACK);
	assert_int_equal(peer_ddcci_read(e->p, 0x50, out, n, e->now_ns), PEER_ACK);
	peer_ddcci_stop(e->p);
}

static void test_peer_memory(void **state)
{
	(void)state;
	struct end e = begin();
	uint8_t big[640], b[128];
	const uint8_t one = 1;

	assert_int_equal(peer_ddcci_write(e.p, 0x30, &one, 1, 0, 0), PEER_NO_ACK); /* one block: no segments */
	for (size_t i = 0; i < sizeof(big); i++)
		big[i] = (uint8_t)(i * 7 + i / 256);
	assert_int_equal(peer_ddcci_set_edid(e.p, big, sizeof(big)), BB_OK);
	assert_int_equal(peer_ddcci_set_edid(e.p, big, 2000), BB_ERR_RANGE);
	read_edid(&e, 0, 128, b, 128);
	assert_memory_equal(b, big + 128, 128);
	read_edid(&e, 2, 0, b, 128);
	assert_memory_equal(b, big + 512, 128);
	read_edid(&e, 0, 0, b, 128); /* the stop cleared the segment */
	assert_memory_equal(b, big, 128);
	assert_int_equal(peer_ddcci_read(e.p, 0x50, b, 128, 0), PEER_ACK); /* goes on where it was */
	assert_memory_equal(b, big + 128, 128);
	read_edid(&e, 3, 0, b, 128);
	assert_int_equal(b[5], 0xFF);
	peer_ddcci_destroy(e.p);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_checksums),   cmocka_unit_test(test_requests),
		cmocka_unit_test(test_values),      cmocka_unit_test(test_damaged_values),
		cmocka_unit_test(test_fragments),   cmocka_unit_test(test_peer_golden),
		cmocka_unit_test(test_peer_probe),  cmocka_unit_test(test_round_trip),
		cmocka_unit_test(test_peer_memory),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
