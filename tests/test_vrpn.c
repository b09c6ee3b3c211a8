/*
 * tests/test_vrpn.c: VRPN's layout, pinned by bytes written out by hand; a client's conversation in pieces of any size;
 * limits; hostile bytes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "drivers/mocap/vrpn.h"

static const uint8_t cookie[24] = { 0x76, 0x72, 0x70, 0x6E, 0x3A, 0x20, 0x76, 0x65, 0x72, 0x2E, 0x20, 0x30,
	                            0x37, 0x2E, 0x33, 0x38, 0x20, 0x20, 0x30, 0, 0, 0, 0, 0 };
/* Sender 2, type 5, 1.5 s, sequence 7, sensor 0 at (1, 2, 3), not turned. */
static const uint8_t golden[24 + 64] = {
	0, 0, 0, 0x58, 0, 0, 0, 1, 0, 0x07, 0xA1, 0x20, 0, 0, 0, 2, 0, 0, 0, 5, 0, 0, 0, 7,
	0, 0, 0, 0,    0, 0, 0, 0, 0x3F, 0xF0, 0, 0, 0, 0, 0, 0, 0x40, 0, 0, 0, 0, 0, 0, 0, 0x40, 0x08, 0, 0, 0, 0, 0, 0,
	0, 0, 0, 0,    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x3F, 0xF0, 0, 0, 0, 0, 0, 0,
};
static const struct mocap_model model = { .n_bodies = 2, .body = { { .name = "glasses" }, { .name = "wand" } } };
static struct vrpn_session s;

static void test_golden(void **state)
{
	const struct bb_pose pose = { { 1, 2, 3 }, BB_QUAT_IDENTITY };
	const struct vrpn_header h = { 88, 1, 500000, 2, 5, 7 };
	struct vrpn_header back;
	uint8_t bytes[88], hello[24];

	(void)state;
	vrpn_put_cookie(hello);
	assert_memory_equal(hello, cookie, sizeof(cookie));
	vrpn_put_header(bytes, &h);
	vrpn_put_pos_quat(bytes + 24, 0, &pose);
	assert_memory_equal(bytes, golden, sizeof(golden));
	vrpn_get_header(golden, &back);
	assert_memory_equal(&back, &h, sizeof(h));
	uint8_t v[VRPN_VELOCITY_BYTES];
	vrpn_put_velocity(v, 0, pose.p, pose.q, 2);
	assert_memory_equal(v, golden + 24, 64);
	assert_memory_equal(v + 64, "\x40\0\0\0\0\0\0\0", 8);
}

static void be32(uint8_t *at, int32_t v)
{
	for (int i = 0; i < 4; i++)
		at[i] = (uint8_t)((uint32_t)v >> (24 - 8 * i));
}

/* A message as a client would send it, padded. */
static size_t put(uint8_t *at, int32_t sender, int32_t type, const char *payload, size_t n)
{
	const size_t whole = 24 + (n + 7) / 8 * 8;

	memset(at, 0, whole);
	be32(at, (int32_t)(24 + n));
	be32(at + 12, sender);
	be32(at + 16, type);
	if (n)
		memcpy(at + 24, payload, n);
	return whole;
}

static size_t describe(uint8_t *at, int32_t type, int32_t id, const char *name)
{
	char payload[128] = { 0 };
	const size_t n = strlen(name) + 1;

	be32((uint8_t *)payload, (int32_t)n);
	memcpy(payload + 4, name, n);
	return put(at, id, type, payload, n + 4);
}

struct said {
	struct vrpn_header h;
	const uint8_t *payload;
};

/* What stands in s.out, as messages. */
static size_t messages(struct said *list, size_t cap)
{
	size_t n = 0, at = 0;

	for (; at < s.n_out; n++) {
		assert_true(n < cap);
		vrpn_get_header(s.out + at, &list[n].h);
		assert_true(list[n].h.length >= 24);
		list[n].payload = s.out + at + 24;
		at += ((size_t)list[n].h.length + 7) / 8 * 8;
	}
	assert_int_equal(at, s.n_out);
	return n;
}

static double double_at(const uint8_t *at)
{
	uint64_t bits = 0;
	double v;

	for (int i = 0; i < 8; i++)
		bits = bits << 8 | at[i];
	memcpy(&v, &bits, sizeof(v));
	return v;
}

static void greet(size_t piece)
{
	vrpn_session_begin(&s, &model, 0);
	assert_int_equal(s.n_out, 24);
	assert_memory_equal(s.out, cookie, 24);
	vrpn_session_sent(&s, 24);
	for (size_t at = 0; at < sizeof(cookie); at += piece)
		assert_true(vrpn_session_take(&s, cookie + at, sizeof(cookie) - at < piece ? sizeof(cookie) - at : piece, 0));
	assert_true(s.greeted);
}

static void test_conversation(void **state)
{
	struct said said[16] = { 0 };
	uint8_t bytes[512];
	struct mocap_frame a = { .mid_exposure_ns = 1500000000 }, b = { .mid_exposure_ns = 1510000000 };

	(void)state;
	for (size_t piece = 1; piece <= 64; piece *= 4) {
		greet(piece);
		assert_int_equal(messages(said, 16), 5); /* two senders, three types */
		assert_int_equal(said[1].h.type, VRPN_SENDER_DESCRIPTION);
		assert_int_equal(said[1].h.sender, 1);
		assert_memory_equal(said[1].payload, "\0\0\0\5wand", 9);
		assert_int_equal(said[2].h.type, VRPN_TYPE_DESCRIPTION);
		assert_memory_equal(said[2].payload + 4, VRPN_POS_QUAT, sizeof(VRPN_POS_QUAT));
		vrpn_session_sent(&s, s.n_out);

		/* A remote device registers, says where UDP would reach it, and asks whether we live. */
		size_t n = describe(bytes, -1, 3, "wand@tcp://localhost:3883");
		n += describe(bytes + n, -2, 7, "vrpn_Base ping_message");
		n += put(bytes + n, 40000, -3, "127.0.0.1", 10);
		n += put(bytes + n, 3, 7, NULL, 0);
		n += put(bytes + n, 4, 7, NULL, 0); /* not one of ours */
		for (size_t at = 0; at < n; at += piece)
			assert_true(vrpn_session_take(&s, bytes + at, n - at < piece ? n - at : piece, 1500000000));
		assert_int_equal(messages(said, 16), 1);
		assert_int_equal(said[0].h.sender, 1);
		assert_int_equal(said[0].h.type, 2);
		vrpn_session_sent(&s, s.n_out);
	}
	a.body[0] = b.body[0] = (struct mocap_pose){ true, { { 1, 2, 3 }, BB_QUAT_IDENTITY }, 0 };
	b.body[0].pose.p.x = 1.02;
	b.body[0].pose.q = bb_quat_axis_angle((struct bb_vec3){ 0, 1, 0 }, 0.02);
	vrpn_session_frame(&s, &a, NULL);
	assert_int_equal(messages(said, 16), 1);
	assert_int_equal(said[0].h.length, 88);
	assert_int_equal(said[0].h.seconds, 1);
	assert_int_equal(said[0].h.micros, 500000);
	assert_memory_equal(said[0].payload, golden + 24, 64);
	vrpn_session_sent(&s, s.n_out);
	vrpn_session_frame(&s, &b, &a);
	assert_int_equal(messages(said, 16), 2); /* the wand is not seen */
	assert_int_equal(said[1].h.length, 24 + 72);
	assert_true(fabs(double_at(said[1].payload + 8) - 2) < 1e-9);           /* m/s */
	assert_true(fabs(double_at(said[1].payload + 40) - sin(0.01)) < 1e-12); /* half the angle of 10 ms */
	assert_true(fabs(double_at(said[1].payload + 64) - 0.01) < 1e-15);
	assert_true(vrpn_session_take(&s, bytes, put(bytes, 0, -4, NULL, 0), 0));
	assert_false(vrpn_session_take(&s, bytes, put(bytes, 0, -5, NULL, 0), 0));
}

static void refused(const uint8_t *bytes, size_t n)
{
	greet(24);
	assert_false(vrpn_session_take(&s, bytes, n, 0));
	assert_non_null(s.why);
}

static void test_hostile(void **state)
{
	static const char *const other[] = { "vrpn: ver. 06.38  0", "VRPN: ver. 07.38  0", "GET / HTTP/1.1\r\n\r\n....." };
	uint8_t bytes[256] = { 0 };

	(void)state;
	for (size_t i = 0; i < 3; i++) {
		vrpn_session_begin(&s, &model, 0);
		memset(bytes, 0, 24);
		memcpy(bytes, other[i], strlen(other[i]));
		assert_false(vrpn_session_take(&s, bytes, 24, 0));
	}
	vrpn_session_begin(&s, &model, 0);
	snprintf((char *)bytes, 24, "vrpn: ver. 07.05  1"); /* an older minor version, with a log */
	assert_true(vrpn_session_take(&s, bytes, 24, 0));
	assert_true(s.greeted);

	static const int32_t lengths[] = { 0, 23, -1, INT32_MIN, INT32_MAX, VRPN_MESSAGE_MOST + 1 };
	for (size_t i = 0; i < BB_ARRAY_LEN(lengths); i++) {
		const size_t n = put(bytes, 0, 1, NULL, 0);
		be32(bytes, lengths[i]);
		refused(bytes, n);
	}
	refused(bytes, describe(bytes, -1, VRPN_IDS_MAX, "wand"));
	refused(bytes, describe(bytes, -2, -1, "wand"));
	refused(bytes, put(bytes, 0, -6, NULL, 0));
	refused(bytes, put(bytes, 1, -1, "\0\0\0\5wan", 7));    /* more is said than comes */
	refused(bytes, put(bytes, 1, -1, "\0\0\0\4wand", 8));   /* no end */
	refused(bytes, put(bytes, 1, -1, "\0\0\0\0", 4));
	refused(bytes, put(bytes, 1, -1, "\xff\xff\xff\xff", 4));
}

/* Who does not read loses frames, whole ones, and nothing grows. */
static void test_slow_reader(void **state)
{
	struct mocap_frame f = { .mid_exposure_ns = 1 };
	struct said said[VRPN_OUT_BYTES / 24];

	(void)state;
	f.body[0].valid = f.body[1].valid = true;
	f.body[0].pose = f.body[1].pose = BB_POSE_IDENTITY;
	greet(24);
	for (int i = 0; i < 1000; i++)
		vrpn_session_frame(&s, &f, NULL);
	assert_true(s.dropped > 0 && s.dropped + s.poses / 2 == 1000 && s.n_out <= VRPN_OUT_BYTES);
	assert_int_equal(messages(said, BB_ARRAY_LEN(said)), 5 + s.poses);
	vrpn_session_sent(&s, s.n_out);
	vrpn_session_frame(&s, &f, NULL);
	assert_int_equal(messages(said, BB_ARRAY_LEN(said)), 2);
}

static void test_lob(void **state)
{
	static const char *const bad[] = { "127.0.0.1", "127.0.0.1 0", "127.0.0.1 65536", "localhost 4000", "1.2.3 4000",
		                           "256.0.0.1 4000", "127.0.0.1 4000x", "127.0.0.1 4000 1", "", "127.0.0.1 -1" };
	uint32_t ip = 0;
	uint16_t port = 0;

	(void)state;
	assert_true(vrpn_lob_read((const uint8_t *)"127.0.0.1 40123", 16, &ip, &port)); /* with its NUL */
	assert_memory_equal(&ip, "\x7f\0\0\1", 4);
	assert_int_equal(port, 40123);
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		assert_false(vrpn_lob_read((const uint8_t *)bad[i], strlen(bad[i]), &ip, &port));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_golden),      cmocka_unit_test(test_conversation), cmocka_unit_test(test_hostile),
		cmocka_unit_test(test_slow_reader), cmocka_unit_test(test_lob),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
