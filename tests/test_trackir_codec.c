/*
 * tests/test_trackir_codec.c: the TrackIR-class wire in both directions: recorded packets of real cameras, commands of
 * the published protocol, packets of the simulated camera, reassembly, and what hostile bytes do.
 */
#include "tests/fixture_room.h"
#include "drivers/trackir_codec.h"
#include "sim/peer_camera.h"
#include "tests/golden_trackir.h"

static struct trackir_stream stream;
static struct trackir_packet packet;

static void bytes_are(struct trackir_command c, const char *hex)
{
	char text[3 * TRACKIR_COMMAND_MAX + 1] = "";

	for (size_t i = 0; i < c.n; i++)
		snprintf(text + 3 * i, 4, i + 1 < c.n ? "%02X " : "%02X", c.bytes[i]);
	assert_string_equal(text, hex);
}

static void commands_are_the_published_ones(void **state)
{
	struct trackir_command pair[2];

	(void)state;
	bytes_are(trackir_simple(TRACKIR_CMD_FLUSH), "12");
	bytes_are(trackir_simple(TRACKIR_CMD_STOP), "13");
	bytes_are(trackir_video(true), "14 00");
	bytes_are(trackir_video(false), "14 01");
	bytes_are(trackir_simple(TRACKIR_CMD_GET_CONFIG), "17");
	bytes_are(trackir_simple(TRACKIR_CMD_GET_STATUS), "1D");
	bytes_are(trackir_simple(TRACKIR_CMD_RELOAD), "20");
	bytes_are(trackir_leds(TRACKIR_LED_IR, TRACKIR_LED_IR), "10 80 80");
	bytes_are(trackir_threshold(0x96), "15 96 01 00");
	bytes_are(trackir_start_set(), "19 05 10 10 00");
	trackir_exposure(0x18F, pair);
	bytes_are(pair[0], "23 42 08 01 00 00");
	bytes_are(pair[1], "23 42 10 8F 00 00");
	bytes_are(trackir_sync_offset(500), "2F 00 00 01 F4");
}

static void a_recorded_packet_is_read(void **state)
{
	/* Computed from the bytes by a script that knows nothing of this program. */
	static const double want[3][3] = { { 298.58108, 243.24300, 265 },
		                           { 343.52532, 335.44410, 333 },
		                           { 265.57450, 336.28714, 314 } };
	struct bb_blob blob[8];
	bool overflow;

	(void)state;
	assert_true(trackir_packet_read(golden_tir5, sizeof(golden_tir5), &packet));
	assert_int_equal(packet.number, 5);
	assert_int_equal(packet.kind, TRACKIR_KIND_LONG);
	assert_false(packet.stamped);
	assert_int_equal(packet.n, 44);
	assert_int_equal(packet.stripe[0].first, 303);
	assert_int_equal(packet.stripe[0].line, 237);
	assert_int_equal(packet.stripe[0].points, 5);
	assert_int_equal(packet.stripe[0].sum_x, 339);
	assert_int_equal(packet.stripe[0].sum, 147);
	const size_t n = trackir_blobs(&packet, blob, BB_ARRAY_LEN(blob), &overflow);
	assert_int_equal(n, 3);
	assert_false(overflow);
	for (size_t i = 0; i < n; i++) {
		assert_true(fabs((double)blob[i].x_px - want[i][0]) < 1e-3);
		assert_true(fabs((double)blob[i].y_px - want[i][1]) < 1e-3);
		assert_true((double)blob[i].area_px == want[i][2]);
	}
}

static void an_older_packet_is_read(void **state)
{
	(void)state;
	assert_true(trackir_packet4_read(golden_tir4, sizeof(golden_tir4), &packet));
	assert_int_equal(packet.n, 15);
	assert_int_equal(packet.stripe[0].line, 0xB2);
	assert_int_equal(packet.stripe[0].first, 0x231);
	assert_int_equal(packet.stripe[0].points, 5);
	assert_false(trackir_packet4_read(golden_tir4, 10, &packet));
	assert_false(trackir_packet4_read(golden_tir5, sizeof(golden_tir5), &packet));
}

static void the_firmware_sum(void **state)
{
	const uint8_t bytes[] = { 0x01, 0xFF, 0x80 };
	/* 1 ^ 10 = 11; 11 + FF = 110, ^ FF0 = EE0; EE0 + 80 = F60, ^ 800 = 760 */

	(void)state;
	assert_int_equal(trackir_firmware_sum(bytes, 1), 0x11);
	assert_int_equal(trackir_firmware_sum(bytes, 2), 0xEE0);
	assert_int_equal(trackir_firmware_sum(bytes, 3), 0x760);
	assert_int_equal(trackir_firmware_sum(bytes, 0), 0);
}

static void replies_are_told_apart(void **state)
{
	const uint8_t status[] = { 0x07, 0x20, 0, 1, 0x12, 0x34, 2 }, config[] = { 0x14, 0x40, 1, 0 };

	(void)state;
	trackir_stream_init(&stream);
	assert_int_equal(trackir_stream_add(&stream, status, sizeof(status)), TRACKIR_STATUS);
	assert_true(stream.status.firmware_loaded);
	assert_int_equal(stream.status.firmware_sum, 0x1234);
	assert_int_equal(stream.status.config_flag, 2);
	assert_int_equal(trackir_stream_add(&stream, config, sizeof(config)), TRACKIR_CONFIG);
	assert_int_equal(stream.config, 0x14);
	assert_int_equal(trackir_stream_add(&stream, status, 6), TRACKIR_NOTHING);
	assert_int_equal(stream.n_bad, 1);
}

static void packets_are_put_together(void **state)
{
	(void)state;
	trackir_stream_init(&stream);
	for (size_t cut = 4; cut < sizeof(golden_tir5); cut++) {
		assert_int_equal(trackir_stream_add(&stream, golden_tir5, cut), TRACKIR_NOTHING);
		assert_int_equal(trackir_stream_add(&stream, golden_tir5 + cut, sizeof(golden_tir5) - cut),
		                 TRACKIR_FRAME);
		assert_int_equal(stream.packet.n, 44);
	}
	assert_int_equal(stream.n_partial + stream.n_bad, 0);
	/* Its end never comes: the next one is whole, and the loss is counted. */
	assert_int_equal(trackir_stream_add(&stream, golden_tir5, 100), TRACKIR_NOTHING);
	assert_int_equal(trackir_stream_add(&stream, golden_tir5, sizeof(golden_tir5)), TRACKIR_FRAME);
	assert_int_equal(stream.n_partial, 1);
}

static void nothing_but_a_packet_is_one(void **state)
{
	uint8_t b[sizeof(golden_tir5)];
	unsigned refused = 0;

	(void)state;
	for (size_t n = 0; n < sizeof(b); n++)
		assert_false(trackir_packet_read(golden_tir5, n, &packet));
	for (size_t i = 0; i < 4; i++) /* the header's XOR and the length's own check */
		for (int bit = 0; bit < 8; bit++) {
			memcpy(b, golden_tir5, sizeof(b));
			b[i] = (uint8_t)(b[i] ^ 1 << bit);
			assert_false(trackir_packet_read(b, sizeof(b), &packet));
			b[i] = golden_tir5[i];
			b[sizeof(b) - 4 + i] = (uint8_t)(b[sizeof(b) - 4 + i] ^ 1 << bit);
			assert_false(trackir_packet_read(b, sizeof(b), &packet));
		}
	for (size_t i = 4; i < sizeof(b) - 4; i++) { /* a stripe out of order, off the sensor, weightless */
		memcpy(b, golden_tir5, sizeof(b));
		b[i] ^= 0xFF;
		refused += !trackir_packet_read(b, sizeof(b), &packet);
	}
	assert_true(refused > 150);
	memcpy(b, golden_tir5, sizeof(b));
	b[2] = TRACKIR_KIND_VIDEO;
	b[3] = (uint8_t)(b[3] ^ TRACKIR_KIND_VIDEO ^ TRACKIR_KIND_LONG);
	assert_false(trackir_packet_read(b, sizeof(b), &packet));
}

static void too_many_blobs_overflow(void **state)
{
	struct bb_blob blob[4];
	bool overflow;

	(void)state;
	packet.n = 0;
	for (uint16_t i = 0; i < 300; i++)
		packet.stripe[packet.n++] = (struct trackir_stripe){ .line = (uint16_t)(i / 60 * 2),
			                                             .first = (uint16_t)(i % 60 * 10), .points = 3,
			                                             .sum = 3, .sum_x = 3 };
	assert_int_equal(trackir_blobs(&packet, blob, 4, &overflow), 4);
	assert_true(overflow);
	packet.n = 0;
	assert_int_equal(trackir_blobs(&packet, blob, 4, &overflow), 0);
	assert_false(overflow);
}

static void touching_stripes_are_one_blob(void **state)
{
	/* A U: two arms that meet at the bottom. */
	const struct trackir_stripe u[] = { { 10, 100, 3, 3, 3 }, { 10, 110, 3, 3, 3 }, { 11, 100, 3, 3, 3 },
		                            { 11, 110, 3, 3, 3 }, { 12, 100, 13, 78, 13 } };
	struct bb_blob blob[4];
	bool overflow;

	(void)state;
	memcpy(packet.stripe, u, sizeof(u));
	packet.n = BB_ARRAY_LEN(u);
	assert_int_equal(trackir_blobs(&packet, blob, 4, &overflow), 1);
	assert_true(fabs((double)blob[0].x_px - 106) < 1e-4);
	assert_true((double)blob[0].area_px == 25);
	packet.n = 4;
	assert_int_equal(trackir_blobs(&packet, blob, 4, &overflow), 2);
}

/* The other direction: the simulated camera takes the published bytes and answers with them. */

static const struct bb_usb_setup get_device = { .request_type = 0x80, .request = 6, .value = 0x0100, .length = 64 };

static void the_peer_speaks_the_same(void **state)
{
	static const struct peer_camera_options options = { .serial = "S1", .no_firmware = true, .needs_reload = true };
	static uint8_t b[TRACKIR_READ_BYTES], firmware[] = { 0x1C, 3, 0x01, 0xFF, 0x80 };
	struct rig rig;
	struct peer_camera *peer;

	(void)state;
	rig_init(&rig, 1, 1);
	struct bb_camera *model = rig_camera(&rig, 0);
	assert_int_equal(peer_camera_create(model, &options, &peer), BB_OK);
	struct sim_usb_device *dev = peer_camera_usb(peer);
	assert_int_equal(sim_usb_control(dev, &get_device, b, 64), 18);
	assert_int_equal(b[8] | b[9] << 8, 0x131D);
	assert_int_equal(b[10] | b[11] << 8, 0x0157);
#define SAY(...) sim_usb_transfer(dev, 0x01, (uint8_t[]){ __VA_ARGS__ }, sizeof((uint8_t[]){ __VA_ARGS__ }))
	assert_int_equal(SAY(0x17), 1);
	assert_int_equal(sim_usb_transfer(dev, 0x82, b, sizeof(b)), 4);
	assert_memory_equal(b, ((uint8_t[]){ 0x14, 0x40 }), 2);
	assert_int_equal(SAY(0x1D), 1);
	assert_int_equal(sim_usb_transfer(dev, 0x82, b, sizeof(b)), 7);
	assert_memory_equal(b, ((uint8_t[]){ 0x07, 0x20, 0, 0, 0, 0, 1 }), 7); /* nothing loaded, not configured */
	assert_int_equal(SAY(0x1B), 1);
	assert_int_equal(sim_usb_transfer(dev, 0x01, firmware, sizeof(firmware)), 5);
	assert_int_equal(peer_camera_firmware_sum(peer), 0x760);
	assert_int_equal(SAY(0x20), 1);
	assert_int_equal(SAY(0x1D), 1);
	assert_int_equal(sim_usb_transfer(dev, 0x82, b, sizeof(b)), 7);
	assert_memory_equal(b, ((uint8_t[]){ 0x07, 0x20, 0, 1, 0x07, 0x60, 2 }), 7);
	assert_int_equal(SAY(0x10, 0x80, 0x80), 3);
	assert_true(peer_camera_lamps(peer));
	assert_int_equal(SAY(0x15, 0x96, 1, 0), 4);
	assert_int_equal(SAY(0x23, 0x42, 0x08, 0, 0, 0), 6);
	assert_int_equal(SAY(0x23, 0x42, 0x10, 0x32, 0, 0), 6);
	assert_int_equal(SAY(0x14, 0), 2);
	assert_true(peer_camera_streams(peer));
	assert_int_equal(SAY(0x15, 20, 1, 0), SIM_USB_STALL);
	assert_int_equal(SAY(0x77), SIM_USB_STALL);
	rig_run(&rig, 100 * MS);
	const int n = sim_usb_transfer(dev, 0x82, b, sizeof(b));
	assert_true(n >= 8 && (n - 8) % 8 == 0);
	assert_int_equal(b[0] ^ b[1] ^ b[2] ^ b[3], 0xAA);
	assert_int_equal(b[1], 0x10);
	assert_int_equal(b[2], 5);
	assert_int_equal((b[n - 4] << 24 | b[n - 3] << 16 | b[n - 2] << 8 | b[n - 1]), n - 8);
	peer_camera_destroy(peer);
	bb_camera_close(model);
	rig_done(&rig);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(commands_are_the_published_ones), cmocka_unit_test(a_recorded_packet_is_read),
		cmocka_unit_test(an_older_packet_is_read),         cmocka_unit_test(the_firmware_sum),
		cmocka_unit_test(replies_are_told_apart),          cmocka_unit_test(packets_are_put_together),
		cmocka_unit_test(nothing_but_a_packet_is_one),     cmocka_unit_test(too_many_blobs_overflow),
		cmocka_unit_test(touching_stripes_are_one_blob),   cmocka_unit_test(the_peer_speaks_the_same),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
