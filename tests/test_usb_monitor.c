/*
 * tests/test_usb_monitor.c: a monitor behind i2c-tiny-usb, asked by the control transfers the kernel's driver makes: messages
 * take the time of their bits, and what goes wrong on the wire is told as that adapter tells it. Virtual clock, no kernel.
 */
#include "sim/usb_monitor.h"
#include "tests/sim_rig.h"

#define BEGIN 5 /* I2C_IO with a start; 4: in the middle; 6: with a stop; 7: both */
#define END 6
#define BOTH 7
#define ACKNOWLEDGED 1
#define NOT_ACKNOWLEDGED 2
#define BYTE_NS 90000 /* nine bits of 10 us */

struct bench {
	struct rig *rig;
	struct usb_monitor usb;
};

static struct bench begin(void)
{
	const struct bb_monitor_config c = { .id = "m1", .edid = "S27A850D", .input = 0x0F };
	struct bench t = { .rig = rig_create(5, 1) };

	assert_int_equal(usb_monitor_init(&t.usb, &c, t.rig->world, 5, t.rig->clk), BB_OK);
	return t;
}

static void end(struct bench *t)
{
	usb_monitor_fini(&t->usb);
	rig_destroy(t->rig);
}

static int ask(struct bench *t, uint8_t request, uint8_t address, bool read, uint8_t *bytes, size_t n)
{
	const struct bb_usb_setup setup = { read ? 0xC1 : 0x41, request, read ? 1 : 0, address, (uint16_t)n };

	return sim_usb_control(usb_monitor_device(&t->usb), &setup, bytes, n);
}

static int status(struct bench *t)
{
	const struct bb_usb_setup setup = { 0xC1, 3, 0, 0, 1 };
	uint8_t byte = 0xEE;

	assert_int_equal(sim_usb_control(usb_monitor_device(&t->usb), &setup, &byte, 1), 1);
	return byte;
}

/* The whole message, however long it takes; returns what the transfer does. */
static int message(struct bench *t, uint8_t request, uint8_t address, bool read, uint8_t *bytes, size_t n)
{
	int moved;

	while ((moved = ask(t, request, address, read, bytes, n)) == SIM_USB_NAK) {
		const int64_t due_ns = usb_monitor_step(&t->usb, rig_now(t->rig));
		assert_in_range(due_ns - rig_now(t->rig), 1, RIG_S);
		bb_clock_run_until(t->rig->clk, due_ns);
	}
	return moved;
}

static void inject(struct bench *t, const char *class_name, const char *verb, bool on)
{
	assert_int_equal(rig_fault(t->rig, class_name, "m1", verb, "", on), BB_OK);
}

static const uint8_t get_luminance[] = { 0x51, 0x82, 0x01, 0x10, 0xAC };                                      /* golden */
static const uint8_t luminance[] = { 0x6E, 0x88, 0x02, 0x00, 0x10, 0x00, 0x00, 0x64, 0x00, 0x4B, 0x8B }; /* 75 of 100 */

static void a_message_takes_its_bits(void **state)
{
	(void)state;
	struct bench t = begin();
	uint8_t request[sizeof(get_luminance)], reply[sizeof(luminance)];
	const int64_t start_ns = rig_now(t.rig);

	memcpy(request, get_luminance, sizeof(request));
	assert_int_equal(usb_monitor_step(&t.usb, start_ns), BB_NEVER); /* nothing is on the wire */
	assert_int_equal(ask(&t, BOTH, 0x37, false, request, sizeof(request)), SIM_USB_NAK);
	assert_int_equal(usb_monitor_step(&t.usb, start_ns), start_ns + 6 * BYTE_NS);
	rig_pass(t.rig, 6 * BYTE_NS - 1);
	assert_int_equal(ask(&t, BOTH, 0x37, false, request, sizeof(request)), SIM_USB_NAK);
	rig_pass(t.rig, 1);
	assert_int_equal(ask(&t, BOTH, 0x37, false, request, sizeof(request)), sizeof(request));
	assert_int_equal(status(&t), ACKNOWLEDGED);
	rig_pass(t.rig, 40 * RIG_MS);
	assert_int_equal(message(&t, BOTH, 0x37, true, reply, sizeof(reply)), sizeof(reply));
	assert_memory_equal(reply, luminance, sizeof(reply));
	assert_int_equal(rig_now(t.rig) - start_ns, 40 * RIG_MS + (6 + 12) * BYTE_NS);
	assert_int_equal(peer_ddcci_counts(t.usb.monitor)->too_early, 0);
	end(&t);
}

/* A message that was given up by the host is not taken for the next one. */
static void another_message_begins_anew(void **state)
{
	(void)state;
	struct bench t = begin();
	uint8_t request[sizeof(get_luminance)], offset = 0;

	memcpy(request, get_luminance, sizeof(request));
	assert_int_equal(ask(&t, BOTH, 0x37, false, request, sizeof(request)), SIM_USB_NAK);
	rig_pass(t.rig, 10 * RIG_MS);
	assert_int_equal(ask(&t, BEGIN, 0x50, false, &offset, 1), SIM_USB_NAK);
	assert_int_equal(usb_monitor_step(&t.usb, rig_now(t.rig)), rig_now(t.rig) + 2 * BYTE_NS);
	end(&t);
}

static void the_wire_is_told_as_the_adapter_sees_it(void **state)
{
	(void)state;
	struct bench t = begin();
	uint8_t bytes[8] = { 0 };

	assert_int_equal(message(&t, BOTH, 0x22, false, bytes, 1), 1); /* nobody there: the length moves, the status tells */
	assert_int_equal(status(&t), NOT_ACKNOWLEDGED);
	inject(&t, "ddc", "bus_error", true);
	assert_int_equal(message(&t, BOTH, 0x37, false, bytes, 1), SIM_USB_STALL);
	inject(&t, "ddc", "bus_error", false);
	inject(&t, "ddc", "stuck", true); /* low is an acknowledge and zeros, at any address */
	memset(bytes, 0xAA, sizeof(bytes));
	assert_int_equal(message(&t, BOTH, 0x22, true, bytes, sizeof(bytes)), sizeof(bytes));
	assert_int_equal(status(&t), ACKNOWLEDGED);
	for (size_t i = 0; i < sizeof(bytes); i++)
		assert_int_equal(bytes[i], 0);
	inject(&t, "ddc", "stuck", false);
	inject(&t, "monitor", "unplug", true);
	assert_int_equal(message(&t, BOTH, 0x50, false, bytes, 1), 1);
	assert_int_equal(status(&t), NOT_ACKNOWLEDGED);
	end(&t);
}

/* The segment holds from its message to the stop, and no longer. */
static void a_stop_clears_the_segment(void **state)
{
	(void)state;
	struct bench t = begin();
	uint8_t edid[512], segment = 1, offset = 0, bytes[8];

	for (size_t i = 0; i < sizeof(edid); i++)
		edid[i] = (uint8_t)(i / 256 ? 0xB0 : 0xA0);
	assert_int_equal(peer_ddcci_set_edid(t.usb.monitor, edid, sizeof(edid)), BB_OK);
	assert_int_equal(message(&t, BEGIN, 0x30, false, &segment, 1), 1);
	assert_int_equal(message(&t, 4, 0x50, false, &offset, 1), 1);
	assert_int_equal(message(&t, END, 0x50, true, bytes, sizeof(bytes)), sizeof(bytes));
	assert_int_equal(bytes[0], 0xB0);
	assert_int_equal(message(&t, BEGIN, 0x50, false, &offset, 1), 1);
	assert_int_equal(message(&t, END, 0x50, true, bytes, sizeof(bytes)), sizeof(bytes));
	assert_int_equal(bytes[0], 0xA0);
	end(&t);
}

static void it_is_the_adapter_of_its_room(void **state)
{
	(void)state;
	struct bench t = begin();
	const struct bb_monitor_config impossible = { .id = "m2", .width_px = 60000 }, again = { .id = "m1" };
	struct usb_monitor other;

	assert_string_equal(usb_monitor_device(&t.usb)->string[3], "m1");
	assert_int_equal(usb_monitor_init(&other, &impossible, t.rig->world, 5, t.rig->clk), BB_ERR_CONFIG);
	assert_int_equal(usb_monitor_init(&other, &again, t.rig->world, 5, t.rig->clk), BB_ERR_BUSY);
	end(&t);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_message_takes_its_bits),
		cmocka_unit_test(another_message_begins_anew),
		cmocka_unit_test(the_wire_is_told_as_the_adapter_sees_it),
		cmocka_unit_test(a_stop_clears_the_segment),
		cmocka_unit_test(it_is_the_adapter_of_its_room),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
