/* tests/test_pad_codec.c: golden reports of gamepads, both ways: what drivers read and write, what the far ends do. */
#include "tests/fixture_pads.h"

#include "drivers/pad_codec.h"
#include "drivers/xusb_codec.h"

#include <math.h>
#include <unistd.h>

/* What a report says. */
struct golden {
	enum bb_pad_kind kind;
	size_t n;
	uint8_t bytes[16];
	int32_t count[BB_PAD_AXES];
	uint32_t buttons;
};

static const struct golden goldens[] = {
	/* recorded, idle */
	{ BB_PAD_KIND_RUMBLEPAD2_WIRELESS, 8, { 0x01, 0x80, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x74 }, { 0 }, 0 },
	{ BB_PAD_KIND_RUMBLEPAD2_WIRED, 8, { 0x80, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x04, 0xFF }, { 0 }, 0 },
	/* fields, one after another */
	{ BB_PAD_KIND_RUMBLEPAD2_WIRED, 8, { 0x01, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x04, 0xFF }, { -127 }, 0 },
	{ BB_PAD_KIND_RUMBLEPAD2_WIRED, 8, { 0xFF, 0x00, 0x80, 0x7F, 0x08, 0x00, 0x04, 0xFF }, { 127, -127 }, 0 },
	{ BB_PAD_KIND_RUMBLEPAD2_WIRED, 8, { 0x80, 0x7F, 0x00, 0xFF, 0x08, 0x00, 0x04, 0xFF }, { 0, 0, -127, 127 }, 0 },
	{ BB_PAD_KIND_RUMBLEPAD2_WIRED,
	  8,
	  { 0x80, 0x7F, 0x80, 0x7F, 0x10, 0x00, 0x04, 0xFF },
	  { 0, 0, 0, 0, 0, -1 },
	  1 },
	{ BB_PAD_KIND_RUMBLEPAD2_WIRED,
	  8,
	  { 0x80, 0x7F, 0x80, 0x7F, 0x83, 0x00, 0x04, 0xFF },
	  { 0, 0, 0, 0, 1, 1 },
	  8 },
	{ BB_PAD_KIND_RUMBLEPAD2_WIRED,
	  8,
	  { 0x80, 0x7F, 0x80, 0x7F, 0x06, 0x01, 0x04, 0xFF },
	  { 0, 0, 0, 0, -1, 0 },
	  0x10 },
	{ BB_PAD_KIND_RUMBLEPAD2_WIRELESS,
	  8,
	  { 0x01, 0x80, 0x7F, 0x80, 0x7F, 0x27, 0xA0, 0x74 },
	  { 0, 0, 0, 0, -1, -1 },
	  0xA02 }, /* A, start, right stick */
	/* six words in one: x right, towards the user, down */
	{ BB_PAD_KIND_SPACE,
	  13,
	  { 0x01, 0x5E, 0x01, 0x64, 0x00, 0x9C, 0xFF, 0x01, 0x00, 0x02, 0x00, 0xFD, 0xFF },
	  { 350, 100, 100, 1, 3, 2 },
	  0 },
	{ BB_PAD_KIND_SPACE,
	  7,
	  { 0x02, 0x00, 0x00, 0xE2, 0xFF, 0x00, 0x00 },
	  { 0, 0, 0, 0, 0, -30 },
	  0 },                                                    /* recorded */
	{ BB_PAD_KIND_SPACE, 3, { 0x03, 0x03, 0x00 }, { 0 }, 3 }, /* recorded */
	{ BB_PAD_KIND_SPACE, 5, { 0x03, 0x01, 0x02, 0x03, 0x04 }, { 0 }, 0x04030201 },
	{ BB_PAD_KIND_SPACE, 7, { 0x02, 0x90, 0x01, 0x00, 0x80, 0x00, 0x80 }, { 0, 0, 0, 350, 350, -350 }, 0 },
};

static void test_reports_are_read(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(goldens); i++) {
		const struct golden *g = &goldens[i];
		struct bb_pad_sample s = { 0 };
		float battery = 0;
		assert_int_equal(bb_pad_decode(g->kind, g->bytes, g->n, &s, &battery), BB_PAD_SAID_STATE);
		assert_memory_equal(s.count, g->count, sizeof(s.count));
		assert_int_equal(s.buttons, g->buttons);
	}
}

static void test_halves_and_battery(void **state)
{
	(void)state;
	static const uint8_t move[7] = { 0x01, 0x0A, 0x00, 0x00, 0x00, 0x14, 0x00 }, level[2] = { 0x17, 0x64 };
	struct bb_pad_sample s = { .count = { 9, 9, 9, 9, 9, 9 } };
	static const int32_t after[BB_PAD_AXES] = { 10, -20, 0, 9, 9, 9 };
	float battery = 0;

	assert_int_equal(bb_pad_decode(BB_PAD_KIND_SPACE, move, 7, &s, &battery), BB_PAD_SAID_PART);
	assert_memory_equal(s.count, after, sizeof(after));
	assert_int_equal(bb_pad_decode(BB_PAD_KIND_SPACE, level, 2, &s, &battery), BB_PAD_SAID_BATTERY);
	assert_true(fabsf(battery - 1) < 1e-6f);
}

static void test_bad_reports(void **state)
{
	(void)state;
	static const struct {
		enum bb_pad_kind kind;
		size_t n;
		uint8_t bytes[8];
	} bad[] = {
		{ BB_PAD_KIND_RUMBLEPAD2_WIRED, 0, { 0 } },
		{ BB_PAD_KIND_RUMBLEPAD2_WIRED, 7, { 0x80, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x04 } },
		{ BB_PAD_KIND_RUMBLEPAD2_WIRED,
		  8,
		  { 0x80, 0x7F, 0x80, 0x7F, 0x09, 0x00, 0x04, 0xFF } }, /* no such hat */
		{ BB_PAD_KIND_RUMBLEPAD2_WIRELESS, 7, { 0x01, 0x80, 0x7F, 0x80, 0x7F, 0x08, 0x00 } },
		{ BB_PAD_KIND_RUMBLEPAD2_WIRELESS, 8, { 0x02, 0x80, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x74 } },
		{ BB_PAD_KIND_SPACE, 0, { 0 } },
		{ BB_PAD_KIND_SPACE, 1, { 0x03 } },
		{ BB_PAD_KIND_SPACE, 6, { 0x01, 0, 0, 0, 0, 0 } },
		{ BB_PAD_KIND_SPACE, 6, { 0x02, 0, 0, 0, 0, 0 } },
		{ BB_PAD_KIND_SPACE, 2, { 0x00, 0 } },
		{ BB_PAD_KIND_SPACE, 2, { 0x17, 101 } },
	};
	const struct bb_pad_sample before = { .count = { 1, 2, 3, 4, 5, 6 }, .buttons = 7 };

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_pad_sample s = before;
		float battery = 0.5f;
		assert_int_equal(bb_pad_decode(bad[i].kind, bad[i].bytes, bad[i].n, &s, &battery), BB_PAD_SAID_BAD);
		assert_memory_equal(&s, &before, sizeof(s));
		assert_true(fabsf(battery - 0.5f) < 1e-6f);
	}
}

static void test_rumble_is_written(void **state)
{
	(void)state;
	static const uint8_t on[8] = { 0x00, 0x51, 0x00, 0x80, 0x00, 0xFF, 0x00, 0x00 };
	static const uint8_t off[8] = { 0x00, 0xF3 }, wireless[8] = { 0x01, 0x42, 0x00, 0x80, 0xFF };
	uint8_t out[BB_PAD_RUMBLE_BYTES];

	bb_pad_encode_rumble(BB_PAD_KIND_RUMBLEPAD2_WIRED, 0, 1, 0.5f, out);
	assert_memory_equal(out, on, sizeof(on));
	bb_pad_encode_rumble(BB_PAD_KIND_RUMBLEPAD2_WIRED, 0, 0, 0, out);
	assert_memory_equal(out, off, sizeof(off));
	bb_pad_encode_rumble(BB_PAD_KIND_RUMBLEPAD2_WIRELESS, 1, 1, 0.5f, out);
	assert_memory_equal(out, wireless, sizeof(wireless));
}

static const struct {
	enum bb_xusb_said said;
	size_t n;
	uint8_t bytes[29];
	int32_t count[BB_PAD_AXES];
	uint32_t buttons;
} packets[] = {
	{ BB_XUSB_SAID_PRESENT, 2, { 0x08, 0x80 }, { 0 }, 0 },
	{ BB_XUSB_SAID_PRESENT, 2, { 0x08, 0xC0 }, { 0 }, 0 },
	{ BB_XUSB_SAID_ABSENT, 2, { 0x08, 0x40 }, { 0 }, 0 },
	{ BB_XUSB_SAID_ABSENT, 2, { 0x08, 0x00 }, { 0 }, 0 },
	{ BB_XUSB_SAID_LINK,
	  29,
	  { 0x00, 0x0F, 0x00, 0xF0, 0xF0, 0xCC, 0xFD, 0x1F, 0x9F, 0x70, 0xC9, 0x00, 0x63, 0xB0, 0x00,
	    0x05, 0x13, 0xA7, 0x20, 0x1D, 0x30, 0x03, 0x40, 0x01, 0x50, 0x01, 0xFF, 0xFF, 0xFF },
	  { 0 },
	  0 },
	{ BB_XUSB_SAID_LINK, 29, { 0x00, 0xF8, 0x02 }, { 0 }, 0 },
	{ BB_XUSB_SAID_LINK, 29, { 0x00, 0xF8, 0x01 }, { 0 }, 0 },
	{ BB_XUSB_SAID_BATTERY, 29, { 0x00, 0x00, 0x00, 0x13, 0xA2 }, { 0 }, 0 },
	{ BB_XUSB_SAID_STATE, 29, { 0x00, 0x01, 0x00, 0xF0, 0x00, 0x13 }, { 0 }, 0 },
	{ BB_XUSB_SAID_STATE, 29, { 0x00, 0x01, 0x00, 0xF0, 0x00, 0x13, 0x19, 0x10 }, { 0, 0, 0, 0, 1, -1 }, 0x81 },
	{ BB_XUSB_SAID_STATE,
	  29,
	  { 0x00, 0x01, 0x00, 0xF0, 0x00, 0x13, 0xE6, 0xE7, 0xFF, 0x80, 0xFF, 0x7F, 0x00, 0x80, 0x69, 0xED, 0x23,
	    0xFF },
	  { 32767, 32767, -4759, 221, -1, 1 },
	  0x77E },
	{ BB_XUSB_SAID_BAD, 0, { 0 }, { 0 }, 0 },
	{ BB_XUSB_SAID_BAD, 2, { 0x08, 0x01 }, { 0 }, 0 },
	{ BB_XUSB_SAID_BAD, 2, { 0x09, 0x80 }, { 0 }, 0 },
	{ BB_XUSB_SAID_BAD, 28, { 0x00, 0x01 }, { 0 }, 0 },
	{ BB_XUSB_SAID_BAD, 29, { 0x01, 0x01 }, { 0 }, 0 },
	{ BB_XUSB_SAID_BAD, 29, { 0x00, 0x01, 0x00, 0xF0, 0x01, 0x13 }, { 0 }, 0 },
};

static void test_packets_are_read(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(packets); i++) {
		struct bb_xusb_packet p = { 0 };
		assert_int_equal(bb_xusb_decode(packets[i].bytes, packets[i].n, &p), packets[i].said);
		assert_memory_equal(p.sample.count, packets[i].count, sizeof(p.sample.count));
		assert_int_equal(p.sample.buttons, packets[i].buttons);
		if (packets[i].said == BB_XUSB_SAID_BATTERY)
			assert_true(fabsf(p.battery - 162.0f / 255) < 1e-6f);
	}
}

static void test_commands_are_written(void **state)
{
	(void)state;
	static const uint8_t inquiry[12] = { 0x08, 0x00, 0x0F, 0xC0 },
			     rumble[12] = { 0x00, 0x01, 0x0F, 0xC0, 0x00, 0xFF, 0x80 };
	static const uint8_t led[12] = { 0x00, 0x00, 0x08, 0x46 }, off[12] = { 0x00, 0x00, 0x08, 0xC0 };
	uint8_t out[BB_XUSB_COMMAND_BYTES];

	bb_xusb_encode_inquiry(out);
	assert_memory_equal(out, inquiry, 12);
	bb_xusb_encode_rumble(1, 0.5f, out);
	assert_memory_equal(out, rumble, 12);
	bb_xusb_encode_led(6, out);
	assert_memory_equal(out, led, 12);
	bb_xusb_encode_power_off(out);
	assert_memory_equal(out, off, 12);
}

/* The far ends, told by a script, say the same bytes. ---------------------------------------------------------- */

static const struct {
	enum sim_peer_kind kind;
	const char *script;
	size_t n;
	uint8_t bytes[29];
} said[] = {
	{ SIM_PEER_RUMBLEPAD2_WIRED, "0 axis 1 -1 0\n", 8, { 0x01, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x04, 0xFF } },
	{ SIM_PEER_RUMBLEPAD2_WIRED,
	  "0 report 1 -1 0 0 0 0 0\n",
	  8,
	  { 0xFF, 0x00, 0x80, 0x7F, 0x08, 0x00, 0x04, 0xFF } },
	{ SIM_PEER_RUMBLEPAD2_WIRED,
	  "0 report 0 0 0 0 0 -1 1\n",
	  8,
	  { 0x80, 0x7F, 0x80, 0x7F, 0x10, 0x00, 0x04, 0xFF } },
	{ SIM_PEER_RUMBLEPAD2_WIRED,
	  "0 report 0 0 0 0 1 1 8\n",
	  8,
	  { 0x80, 0x7F, 0x80, 0x7F, 0x83, 0x00, 0x04, 0xFF } },
	{ SIM_PEER_RUMBLEPAD2_WIRELESS,
	  "0 report 0 0 0 0 -1 -1 0xA02\n",
	  8,
	  { 0x01, 0x80, 0x7F, 0x80, 0x7F, 0x27, 0xA0, 0x74 } },
	{ SIM_PEER_SPACEMOUSE_WIRELESS,
	  "0 report 1 0.2857 0.2857 0.00286 0.00857 0.00571 0\n",
	  13,
	  { 0x01, 0x5E, 0x01, 0x64, 0x00, 0x9C, 0xFF, 0x01, 0x00, 0x02, 0x00, 0xFD, 0xFF } },
	{ SIM_PEER_SPACENAVIGATOR, "0 button 1 down\n0 button 2 down\n", 3, { 0x03, 0x03, 0x00 } },
	{ SIM_PEER_SPACENAVIGATOR, "0 axis 6 -0.0857 0\n", 7, { 0x02, 0x00, 0x00, 0xE2, 0xFF, 0x00, 0x00 } },
	{ SIM_PEER_XBOX_PAD, "0 report 0 0 0 0 1 -1 0x81\n", 29, { 0x00, 0x01, 0x00, 0xF0, 0x00, 0x13, 0x19, 0x10 } },
};

static void script_file(char path[32], const char *text)
{
	strcpy(path, "/tmp/bb-pad-XXXXXX");
	const int fd = mkstemp(path);
	assert_true(fd >= 0);
	assert_int_equal(write(fd, text, strlen(text)), (ssize_t)strlen(text));
	close(fd);
}

static void test_far_ends_say_the_same(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(said); i++) {
		struct rig *rig = rig_create(7, 1);
		char path[32];
		script_file(path, said[i].script);
		struct pad_far *far = pad_far_create(rig, said[i].kind, path);
		uint8_t bytes[SIM_PEER_PACKET_BYTES], last[SIM_PEER_PACKET_BYTES] = { 0 };
		size_t n = 0, n_last = 0;
		int64_t at_ns;
		rig_pass(rig, 20 * RIG_MS);
		while (sim_peer_pad_take(far->peer, bytes, sizeof(bytes), &n, &at_ns) == BB_OK) {
			n_last = n;
			memcpy(last, bytes, n);
		}
		assert_int_equal(n_last, said[i].n);
		assert_memory_equal(last, said[i].bytes, n_last);
		pad_far_destroy(far);
		rig_destroy(rig);
		unlink(path);
	}
}

/* A far end at rest: what was recorded of the hardware. */
static void test_far_ends_at_rest(void **state)
{
	(void)state;
	static const uint8_t wired[8] = { 0x80, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x04, 0xFF };
	static const uint8_t wireless[8] = { 0x01, 0x80, 0x7F, 0x80, 0x7F, 0x08, 0x00, 0x74 };

	for (int k = 0; k < 2; k++) {
		struct rig *rig = rig_create(7, 1);
		char path[32];
		script_file(path, "0 axis 1 1 0\n0.1 axis 1 0 0\n");
		struct pad_far *far =
			pad_far_create(rig, k ? SIM_PEER_RUMBLEPAD2_WIRELESS : SIM_PEER_RUMBLEPAD2_WIRED, path);
		uint8_t bytes[SIM_PEER_PACKET_BYTES];
		size_t n = 0, n_last = 0;
		int64_t at_ns;
		rig_pass(rig, 200 * RIG_MS);
		while (sim_peer_pad_take(far->peer, bytes, sizeof(bytes), &n, &at_ns) == BB_OK)
			n_last = n;
		assert_int_equal(n_last, 8);
		assert_memory_equal(bytes, k ? wireless : wired, 8);
		pad_far_destroy(far);
		rig_destroy(rig);
		unlink(path);
	}
}

static void test_far_ends_hear_commands(void **state)
{
	(void)state;
	static const uint8_t hid[8] = { 0x00, 0x51, 0x00, 0x80, 0x00, 0xFF, 0x00, 0x00 }, stop[8] = { 0x00, 0xF3 };
	static const uint8_t usb[12] = { 0x00, 0x01, 0x0F, 0xC0, 0x00, 0xFF, 0x80 },
			     off[12] = { 0x00, 0x00, 0x08, 0xC0 };
	static const uint8_t ask[12] = { 0x08, 0x00, 0x0F, 0xC0 }, led[12] = { 0x00, 0x00, 0x08, 0x49 };
	struct rig *rig = rig_create(7, 1);
	struct pad_far *far = pad_far_create(rig, SIM_PEER_RUMBLEPAD2_WIRED, "");
	uint8_t bytes[SIM_PEER_PACKET_BYTES];
	float strong, weak;
	int64_t at_ns;
	size_t n;

	assert_int_equal(sim_peer_pad_give(far->peer, hid, 8), BB_OK);
	assert_true(sim_peer_pad_rumble(far->peer, &strong, &weak) && fabsf(strong - 1) < 1e-6f &&
		    fabsf(weak - 128.0f / 255) < 1e-6f);
	assert_int_equal(sim_peer_pad_give(far->peer, stop, 8), BB_OK);
	assert_true(sim_peer_pad_rumble(far->peer, &strong, &weak) && fabsf(strong) + fabsf(weak) < 1e-6f);
	assert_int_equal(sim_peer_pad_give(far->peer, hid, 7), BB_ERR_IO);
	pad_far_destroy(far);
	rig_destroy(rig);
	rig = rig_create(7, 1);
	far = pad_far_create(rig, SIM_PEER_XBOX_PAD, "");
	while (sim_peer_pad_take(far->peer, bytes, sizeof(bytes), &n, &at_ns) == BB_OK)
		;
	assert_int_equal(sim_peer_pad_give(far->peer, usb, 12), BB_OK);
	assert_true(sim_peer_pad_rumble(far->peer, &strong, &weak) && fabsf(strong - 1) < 1e-6f &&
		    fabsf(weak - 128.0f / 255) < 1e-6f);
	assert_int_equal(sim_peer_pad_give(far->peer, led, 12), BB_OK);
	assert_int_equal(sim_peer_pad_led(far->peer), 9);
	assert_int_equal(sim_peer_pad_give(far->peer, ask, 12), BB_OK);
	assert_int_equal(sim_peer_pad_take(far->peer, bytes, sizeof(bytes), &n, &at_ns), BB_OK);
	assert_true(n == 2 && bytes[0] == 0x08 && bytes[1] == 0x80);
	assert_int_equal(sim_peer_pad_give(far->peer, off, 12), BB_OK);
	assert_int_equal(sim_peer_pad_take(far->peer, bytes, sizeof(bytes), &n, &at_ns), BB_OK);
	assert_true(n == 2 && bytes[1] == 0x00);
	pad_far_destroy(far);
	rig_destroy(rig);
}

/* The USB faces: what a host reads at enumeration, class requests, and the endpoint. */
static void test_usb_faces(void **state)
{
	(void)state;
	for (int kind = 0; kind < SIM_PEER_XBOX_PAD; kind++) {
		struct rig *rig = rig_create(7, 1);
		struct pad_far *far = pad_far_create(rig, (enum sim_peer_kind)kind, "");
		struct sim_usb_device *dev = sim_peer_pad_usb(far->peer);
		struct bb_usb_setup get = { .request_type = 0x81, .request = 6, .value = 0x2200, .length = 512 };
		uint8_t bytes[512];
		size_t n = 0;
		const uint8_t *want = sim_peer_pad_descriptor(far->peer, &n);
		assert_non_null(dev);
		assert_int_equal(dev->config[2] | dev->config[3] << 8, dev->n_config);
		assert_int_equal(dev->config[18 + 7] | dev->config[18 + 8] << 8, n);
		assert_int_equal(sim_usb_control(dev, &get, bytes, sizeof(bytes)), (int)n);
		assert_memory_equal(bytes, want, n);
		get.value = 0x2300;
		assert_int_equal(sim_usb_control(dev, &get, bytes, sizeof(bytes)), SIM_USB_STALL);
		assert_int_equal(sim_usb_transfer(dev, 0x81, bytes, 64), SIM_USB_NAK);
		rig_pass(rig, 4 * RIG_S);
		assert_true(sim_usb_transfer(dev, 0x81, bytes, 64) > 1);
		if (kind == SIM_PEER_RUMBLEPAD2_WIRED) {
			const struct bb_usb_setup set = {
				.request_type = 0x21, .request = 9, .value = 0x0200, .length = 7
			};
			float strong, weak;
			uint8_t report[7] = { 0x51, 0, 0, 0, 0xFF };
			assert_int_equal(sim_usb_control(dev, &set, report, 7), 7);
			assert_true(sim_peer_pad_rumble(far->peer, &strong, &weak) && fabsf(strong - 1) < 1e-6f);
		}
		sim_peer_pad_unplug(far->peer, true);
		assert_int_equal(sim_usb_transfer(dev, 0x81, bytes, 64), SIM_USB_GONE);
		pad_far_destroy(far);
		rig_destroy(rig);
	}
}

/* Four slots: an empty one says so when asked, the headsets' endpoints are silent. */
static void test_receiver_slots(void **state)
{
	(void)state;
	static const uint8_t ask[12] = { 0x08, 0x00, 0x0F, 0xC0 };
	struct rig *rig = rig_create(7, 1);
	struct pad_far *far = pad_far_create(rig, SIM_PEER_XBOX_PAD, "");
	struct sim_usb_device *dev = &far->receiver.usb;
	struct bb_gamepad *g;
	struct bb_gamepad_config c = { .id = "other" };
	struct bb_pad_report one;
	uint8_t bytes[32];
	size_t n;

	memcpy(bytes, ask, 12);
	assert_int_equal(sim_usb_transfer(dev, 0x05, bytes, 12), 12);
	assert_int_equal(sim_usb_transfer(dev, 0x85, bytes, 32), 2);
	assert_true(bytes[0] == 0x08 && bytes[1] == 0x00);
	assert_int_equal(sim_usb_transfer(dev, 0x85, bytes, 32), SIM_USB_NAK);
	assert_int_equal(sim_usb_transfer(dev, 0x82, bytes, 32), SIM_USB_NAK);
	assert_int_equal(sim_usb_transfer(dev, 0x89, bytes, 32), SIM_USB_STALL);
	assert_int_equal(bb_uri_parse("usb:045e:0719?slot=3", &far->uri, NULL, NULL), BB_OK);
	assert_int_equal(pad_far_open(far, rig, &c, &g), BB_OK);
	assert_int_equal(bb_gamepad_read(g, &one, 1, &n), BB_ERR_LOST); /* nobody holds that pad */
	/* Somebody switches one on. */
	struct sim_peer_pad *second;
	const struct sim_peer_config pc = { .kind = SIM_PEER_XBOX_PAD, .id = "second", .clk = rig->clk };
	assert_int_equal(sim_peer_pad_create(&pc, &second), BB_OK);
	far->receiver.pad[2] = second;
	long reports = 0;
	for (int i = 0; i < 400; i++) {
		rig_pass(rig, 10 * RIG_MS);
		reports += bb_gamepad_read(g, &one, 1, &n) == BB_OK;
	}
	assert_true(reports > 50);
	assert_int_equal(sim_peer_pad_led(second), 8);
	bb_gamepad_close(g);
	sim_peer_pad_destroy(second);
	pad_far_destroy(far);
	rig_destroy(rig);
}

static void test_bad_uris(void **state)
{
	(void)state;
	static const struct {
		enum sim_peer_kind kind;
		const char *uri;
	} bad[] = {
		{ SIM_PEER_RUMBLEPAD2_WIRED, "hid:" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "hid:046d" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "hid:046d:c2191" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "hid:046d:zzzz" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "hid:dead:beef" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "hid:046d:c218?nonsense=1" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "hid:046d:c218?gap_ms=-1" },
		{ SIM_PEER_XBOX_PAD, "usb:046d:c218" },
		{ SIM_PEER_XBOX_PAD, "usb:045e:0719?slot=5" },
		{ SIM_PEER_XBOX_PAD, "usb:045e:0719?slot=0" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "evdev:" },
		{ SIM_PEER_RUMBLEPAD2_WIRED, "evdev:event3" },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct rig *rig = rig_create(7, 1);
		struct pad_far *far = pad_far_create_uri(rig, bad[i].kind, "", bad[i].uri);
		const struct bb_gamepad_config c = { .id = "pad" };
		struct bb_gamepad *g;
		assert_int_equal(pad_far_open(far, rig, &c, &g), BB_ERR_CONFIG);
		assert_null(g);
		pad_far_destroy(far);
		rig_destroy(rig);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_reports_are_read),
		cmocka_unit_test(test_halves_and_battery),
		cmocka_unit_test(test_bad_reports),
		cmocka_unit_test(test_rumble_is_written),
		cmocka_unit_test(test_packets_are_read),
		cmocka_unit_test(test_commands_are_written),
		cmocka_unit_test(test_far_ends_say_the_same),
		cmocka_unit_test(test_far_ends_at_rest),
		cmocka_unit_test(test_far_ends_hear_commands),
		cmocka_unit_test(test_usb_faces),
		cmocka_unit_test(test_receiver_slots),
		cmocka_unit_test(test_bad_uris),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
