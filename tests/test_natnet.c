/*
 * tests/test_natnet.c: NatNet's layout, pinned by bytes written out by hand and by sums of Motive's own datagrams; the
 * server's answers, clients and limits; hostile bytes.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/mocap/natnet_server.h"
#include "hal/hash.h"
#include "tests/natnet_capture.h"

static struct natnet_message message;
static uint8_t out[NATNET_DATAGRAM_MOST];
static const char *why;

/* Frame 42: one rigid body, id 1 at (1, 2, 3), not turned, error 0, tracked; no markers; every stamp 0. */
static const uint8_t minimal[4 + 112 + 4] = {
	0x07, 0x00, 0x74, 0x00, 0x2a, 0x00, 0x00, 0x00, 0, 0, 0, 0, 0, 0, 0, 0, 0x01, 0x00, 0x00, 0x00,
	0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x80, 0x3f, 0x00, 0x00, 0x00, 0x40, 0x00, 0x00, 0x40, 0x40, 0, 0, 0, 0,
	0, 0, 0, 0, 0, 0, 0, 0, 0x00, 0x00, 0x80, 0x3f, 0, 0, 0, 0, 0x01, 0x00,
};

static void test_minimal(void **state)
{
	static struct natnet_message m;

	(void)state;
	memset(&m, 0, sizeof(m));
	m.id = NATNET_FRAME;
	m.frame.number = 42;
	m.frame.n_bodies = 1;
	m.frame.body[0] = (struct natnet_rigid_body){ .id = 1, .at = { 1, 2, 3 }, .q = { 0, 0, 0, 1 }, .params = 1 };
	m.frame.has_end = true;
	assert_int_equal(natnet_write(&m, out, sizeof(out)), sizeof(minimal));
	assert_memory_equal(out, minimal, sizeof(minimal));
	assert_true(natnet_read(minimal, sizeof(minimal), &message, &why));
	assert_int_equal(message.frame.number, 42);
	assert_int_equal(message.frame.n_bodies, 1);
	assert_true(message.frame.body[0].at[2] == 3.0F && message.frame.body[0].q[3] == 1.0F);
	assert_true(message.frame.has_end && !message.frame.end);
	m.frame.has_end = false;
	assert_int_equal(natnet_write(&m, out, sizeof(out)), 4 + 112);
}

/* Written by us, a capture's numbers have the capture's sum; read, they are the numbers again. */
static void check_capture(const struct natnet_message *m, const char *sha256)
{
	static uint8_t again[2048];
	uint8_t hash[BB_HASH_BYTES];
	char hex[BB_HASH_HEX];
	const size_t n = natnet_write(m, out, sizeof(out));

	assert_true(n > 0);
	bb_hash_bytes(out, n, hash);
	bb_hash_hex(hash, hex);
	assert_string_equal(hex, sha256);
	assert_true(natnet_read(out, n, &message, &why));
	assert_int_equal(natnet_write(&message, again, sizeof(again)), n);
	assert_memory_equal(again, out, n);
}

static void test_captures(void **state)
{
	(void)state;
	check_capture(&capture_frame, capture_frame_sha256);
	assert_int_equal(message.frame.n_markers, 6);
	assert_memory_equal(message.frame.marker, capture_frame.frame.marker, 6 * sizeof(struct natnet_marker));
	check_capture(&capture_occluded, capture_occluded_sha256);
	assert_string_equal(message.frame.set[1].name, "all");
	assert_true(message.frame.marker[0].params & NATNET_OCCLUDED);
	check_capture(&capture_models, capture_models_sha256);
	assert_string_equal(message.models.model[0].name, capture_models.models.model[0].name);
	check_capture(&capture_connect, capture_connect_sha256);
	check_capture(&capture_echo, capture_echo_sha256);
}

/* Datagrams somebody has captured, one a file in build/data/natnet/: read and written again, they are the same. */
static void test_files(void **state)
{
	DIR *dir = opendir("build/data/natnet");
	const struct dirent *entry;
	int n = 0;

	(void)state;
	while (dir && (entry = readdir(dir))) {
		static uint8_t bytes[NATNET_DATAGRAM_MOST];
		char path[512];
		if (!strstr(entry->d_name, ".bin"))
			continue;
		snprintf(path, sizeof(path), "build/data/natnet/%s", entry->d_name);
		FILE *f = fopen(path, "rb");
		assert_non_null(f);
		const size_t size = fread(bytes, 1, sizeof(bytes), f);
		fclose(f);
		if (!natnet_read(bytes, size, &message, &why))
			fail_msg("%s: %s", entry->d_name, why);
		assert_int_equal(natnet_write(&message, out, sizeof(out)), size);
		assert_memory_equal(out, bytes, size);
		n++;
	}
	if (dir)
		closedir(dir);
	if (!n) {
		print_message("no captures in build/data/natnet: those of test_captures have to do\n");
		skip();
	}
	print_message("%d captured datagrams\n", n);
}

/* ---- hostile ---- */

static void test_cut_and_longer(void **state)
{
	const struct natnet_message *all[] = { &capture_frame, &capture_occluded, &capture_models, &capture_echo };
	uint8_t bytes[512];

	(void)state;
	for (size_t k = 0; k < BB_ARRAY_LEN(all); k++) {
		const size_t n = natnet_write(all[k], bytes, sizeof(bytes) - 1);
		bytes[n] = 0;
		for (size_t cut = 0; cut <= n + 1; cut++) {
			if (cut >= 4) { /* it says so itself: only the fields can tell */
				bytes[2] = (uint8_t)(cut - 4);
				bytes[3] = (uint8_t)((cut - 4) >> 8);
			}
			/* the end of data may be missing whole */
			const bool fine = cut == n || (all[k]->id == NATNET_FRAME && cut == n - 4);
			assert_int_equal(natnet_read(bytes, cut, &message, &why), fine);
			assert_int_equal(why == NULL, fine);
		}
		for (size_t room = 0; room < n; room++)
			assert_int_equal(natnet_write(all[k], out, room), 0);
	}
}

static void test_lies(void **state)
{
	static const int32_t counts[] = { -1, INT32_MIN, INT32_MAX, 257, 17, 5 };
	uint8_t bytes[sizeof(minimal)];

	(void)state;
	for (size_t at = 8; at <= 16; at += 4) /* sets, unlabelled, bodies */
		for (size_t i = 0; i < BB_ARRAY_LEN(counts); i++) {
			memcpy(bytes, minimal, sizeof(bytes));
			memcpy(bytes + at, &counts[i], 4);
			assert_false(natnet_read(bytes, sizeof(bytes), &message, &why));
		}
	memcpy(bytes, minimal, sizeof(bytes));
	bytes[0] = 15;
	assert_false(natnet_read(bytes, sizeof(bytes), &message, &why));
	bytes[0] = 7;
	bytes[2]++;
	assert_false(natnet_read(bytes, sizeof(bytes), &message, &why));
	/* A marker set "a", then a force plate: what nobody here reads ends the list, and cannot be written. */
	static const uint8_t plate[] = { 5, 0, 19, 0, 2, 0, 0, 0, 0, 0, 0, 0, 'a', 0, 0, 0, 0, 0, 3, 0, 0, 0, 9 };
	assert_true(natnet_read(plate, sizeof(plate), &message, &why));
	assert_int_equal(message.models.n, 1);
	assert_int_equal(message.models.n_others, 1);
	assert_int_equal(natnet_write(&message, out, sizeof(out)), 0);
	message.id = NATNET_FRAME;
	message.frame.n_sets = NATNET_SETS_MOST + 1;
	assert_int_equal(natnet_write(&message, out, sizeof(out)), 0);
}

/* ---- the server ---- */

static const struct natnet_server_config config = {
	.model = { .n_bodies = 2, .rate_hz = 240,
	           .body = { { "glasses", 3, { { 0, 0, 0 }, { 0.1, 0, 0 }, { 0, 0.1, 0 } } }, { "wand", 1, { { 0, 0, 1 } } } } },
	.data_port = 1511,
};
static const struct natnet_address viewer = { 0x0100007f, 4000, 0 };

static size_t hear_id(struct natnet_server *s, const struct natnet_address *from, uint8_t id, int64_t now_ns)
{
	const uint8_t bytes[4] = { id, 0, 0, 0 };

	return natnet_server_hear(s, from, bytes, sizeof(bytes), now_ns, out, sizeof(out));
}

static size_t hear(struct natnet_server *s, const struct natnet_message *m, int64_t now_ns)
{
	uint8_t bytes[512];
	const size_t n = natnet_write(m, bytes, sizeof(bytes));

	return natnet_server_hear(s, &viewer, bytes, n, now_ns, out, sizeof(out));
}

static void test_conversation(void **state)
{
	struct natnet_server *s;
	struct mocap_frame f = { .number = 9, .mid_exposure_ns = 1500000000, .received_ns = 1503000000, .sent_ns = 1504000000,
		                 .recorded = true };
	const uint8_t *bytes;

	(void)state;
	assert_true(natnet_server_create(&config, &s));
	assert_null(natnet_server_client(s, 0));
	assert_int_equal(hear_id(s, &viewer, NATNET_REQUEST_FRAME, 0), 0); /* there is none yet */
	size_t n = hear(s, &capture_connect, 0);
	assert_int_equal(n, 283); /* 268 asked for it */
	assert_true(natnet_read(out, n, &message, &why));
	assert_int_equal(message.id, NATNET_SERVER_INFO);
	assert_int_equal(message.server.hello.natnet_version[0], 3);
	assert_int_equal(message.server.clock_hz, 1000000000);
	assert_int_equal(message.server.data_port, 1511);
	assert_int_equal(message.server.multicast, 0);
	assert_memory_equal(natnet_server_client(s, 0), &viewer, sizeof(uint32_t) + sizeof(uint16_t));

	n = hear_id(s, &viewer, NATNET_REQUEST_MODELS, 0);
	assert_true(natnet_read(out, n, &message, &why));
	assert_int_equal(message.models.n, 5);
	assert_int_equal(message.models.model[2].kind, NATNET_RIGID_BODY);
	assert_string_equal(message.models.model[2].name, "wand");
	assert_int_equal(message.models.model[2].id, 2);
	assert_string_equal(message.models.model[4].marker[3], "wand_1");

	f.body[0] = (struct mocap_pose){ true, { { 1, 2, 3 }, { 0, 0, 0, 1 } }, 0.0005 };
	n = natnet_server_frame(s, &f, &bytes);
	assert_true(natnet_read(bytes, n, &message, &why));
	assert_int_equal(message.frame.number, 9);
	assert_int_equal(message.frame.n_bodies, 2);
	assert_int_equal(message.frame.body[0].params, NATNET_TRACKED);
	assert_int_equal(message.frame.body[1].params, 0);
	assert_true(message.frame.body[0].at[1] == 2.0F && message.frame.body[0].error == 0.0005F);
	assert_int_equal(message.frame.n_markers, 4);
	assert_int_equal(message.frame.marker[1].id, 1 << 16 | 2);
	assert_true(message.frame.marker[1].at[0] == 1.1F);
	assert_int_equal(message.frame.marker[3].params, NATNET_OCCLUDED | NATNET_MODEL_SOLVED | NATNET_HAS_MODEL);
	assert_int_equal(message.frame.n_sets, 3);
	assert_int_equal(message.frame.set[2].n, 4);
	assert_int_equal(message.frame.mid_exposure, 1500000000);
	assert_int_equal(message.frame.transmitted, 1504000000);
	assert_int_equal(message.frame.params, NATNET_RECORDING);
	assert_true(fabs(message.frame.timestamp_s - 1.5) < 1e-12);
	assert_int_equal(hear_id(s, &viewer, NATNET_REQUEST_FRAME, 0), n);

	struct natnet_message echo = { .id = NATNET_ECHO_REQUEST, .echo = { .sent = 77 } };
	n = hear(s, &echo, 123);
	assert_true(natnet_read(out, n, &message, &why));
	assert_int_equal(message.echo.sent, 77);
	assert_int_equal(message.echo.received, 123);
	struct natnet_message request = { .id = NATNET_REQUEST, .raw = { 10, "FrameRate" } };
	n = hear(s, &request, 123);
	assert_true(natnet_read(out, n, &message, &why));
	assert_int_equal(message.id, NATNET_RESPONSE);
	assert_memory_equal(message.raw.bytes, &(float){ 240 }, 4);
	request.raw.bytes[0] = 'f';
	n = hear(s, &request, 123);
	assert_true(natnet_read(out, n, &message, &why));
	assert_int_equal(message.id, NATNET_UNRECOGNIZED);
	assert_int_equal(hear_id(s, &viewer, NATNET_DISCONNECT, 0), 0);
	assert_null(natnet_server_client(s, 0));
	natnet_server_destroy(s);
}

static void test_silence(void **state)
{
	struct natnet_address gone, other = viewer;
	struct natnet_server *s;

	(void)state;
	other.port++;
	assert_true(natnet_server_create(&config, &s));
	assert_int_equal(hear_id(s, &viewer, NATNET_KEEPALIVE, 0), 0);
	(void)hear_id(s, &other, NATNET_KEEPALIVE, 0);
	for (int64_t t_ns = 0; t_ns < 3 * NATNET_SILENCE_NS; t_ns += BB_NS_PER_S) {
		(void)hear_id(s, &viewer, NATNET_KEEPALIVE, t_ns);
		const size_t n = natnet_server_expire(s, t_ns, &gone, out, sizeof(out));
		assert_int_equal(n, t_ns == NATNET_SILENCE_NS ? 4 : 0);
		if (n) {
			assert_int_equal(out[0], NATNET_DISCONNECT_TIMEOUT);
			assert_int_equal(gone.port, other.port);
		}
	}
	assert_non_null(natnet_server_client(s, 0));
	assert_null(natnet_server_client(s, 1));
	natnet_server_destroy(s);
}

/* A thousand askers a second get what one may have, and no more clients than there are places. */
static void test_limits(void **state)
{
	struct natnet_address from = viewer;
	struct natnet_server *s;
	uint64_t answered = 0;

	(void)state;
	assert_true(natnet_server_create(&config, &s));
	for (int i = 0; i < 2000; i++) {
		from.port = (uint16_t)i;
		answered += hear_id(s, &from, NATNET_REQUEST_MODELS, (int64_t)i * 1000000) > 0;
		(void)hear_id(s, &from, NATNET_KEEPALIVE, (int64_t)i * 1000000);
	}
	assert_in_range(answered, 2 * NATNET_ANSWERS_PER_S, 2 * NATNET_ANSWERS_PER_S + NATNET_ANSWERS_BURST);
	assert_int_equal(natnet_server_counts(s)->beyond_rate, 2000 - answered);
	assert_non_null(natnet_server_client(s, NATNET_CLIENTS_MAX - 1));
	assert_null(natnet_server_client(s, NATNET_CLIENTS_MAX));
	assert_int_equal(natnet_server_counts(s)->refused_clients, 2000 - NATNET_CLIENTS_MAX);
	assert_int_equal(natnet_server_hear(s, &viewer, minimal, 30, 0, out, sizeof(out)), 0);
	assert_int_equal(natnet_server_counts(s)->malformed, 1);
	natnet_server_destroy(s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_minimal),        cmocka_unit_test(test_captures), cmocka_unit_test(test_files),
		cmocka_unit_test(test_cut_and_longer), cmocka_unit_test(test_lies),     cmocka_unit_test(test_conversation),
		cmocka_unit_test(test_silence),        cmocka_unit_test(test_limits),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
