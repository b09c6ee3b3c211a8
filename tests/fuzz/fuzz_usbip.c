/*
 * tests/fuzz/fuzz_usbip.c: what a USB/IP client sends. First byte: bit 0 begins after the import, of the device of bit
 * 1, or with bit 2 of a monitor behind its adapter, whose first messages go wrong with bits 3 and 4; then pieces, a
 * byte of length each; length 0 lets a fifth of a millisecond pass, the devices work and everything go out. Replies
 * must be whole, the connection bounded.
 */
#include "sim/usb_monitor.h"
#include "sim/usbip_conn.h"
#include "tests/fuzz/fuzz.h"

#define STEP_NS 200000

static bool plugged;

static bool target_write(void *ctx, uint8_t address, const uint8_t *bytes, size_t n)
{
	uint8_t *sum = ctx;

	for (size_t i = 0; i < n; i++)
		*sum = (uint8_t)(*sum + bytes[i]);
	return address == 0x50;
}

static bool target_read(void *ctx, uint8_t address, uint8_t *bytes, size_t n)
{
	memset(bytes, *(uint8_t *)ctx, n);
	return address == 0x50;
}

/* Endpoint 1 answers every third time, endpoint 2 never, endpoint 3 stalls, at 4 it is pulled out, at 5 it lies. */
static int some_in(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap)
{
	dev->in_at_ns = 0;
	if (endpoint == 0x83)
		return SIM_USB_STALL;
	if (endpoint == 0x84)
		return SIM_USB_GONE;
	if (endpoint == 0x85)
		return (int)cap + 1;
	if (endpoint != 0x81 || ++dev->halted % 3)
		return SIM_USB_NAK;
	dev->halted = 0;
	memset(bytes, 0x55, cap);
	return (int)cap;
}

static int some_out(struct sim_usb_device *dev, uint8_t endpoint, const uint8_t *bytes, size_t n)
{
	volatile uint8_t sum = 0;

	(void)dev;
	for (size_t i = 0; i < n; i++)
		sum = (uint8_t)(sum + bytes[i]);
	if (endpoint == 4)
		plugged = false;
	return endpoint == 1 ? (int)n : SIM_USB_NAK;
}

static bool present(struct sim_usb_device *dev)
{
	(void)dev;
	return plugged;
}

static const struct sim_usb_ops ops = { sim_usb_no_control, some_in, some_out, sim_usb_no_reset, present };
static const uint8_t device[18] = { 18, 1, 0, 2, 0xFF, 0, 0, 64, 1, 2, 3, 4, 0, 1, 1, 2, 3, 1 };
static const uint8_t config[52] = {
	9, 2, 52, 0, 2,    1, 0, 0x80, 50, 9, 4, 0, 0, 1,    0xFF, 0, 0, 0, 7, 5, 0x81, 2, 64,   0, 0, 9,
	4, 0, 1,  0, 0xFF, 0, 0, 0,    9,  4, 1, 0, 0, 0xFF, 0,    0, 0, 9, 4, 2, 0,    0, 0xFF, 0, 0, 0
}; /* an alternate setting, and one too many */

static void drain(struct usbip_conn *c, bool attached_from_start)
{
	size_t n;
	const uint8_t *out = usbip_conn_out(c, &n);

	fuzz_must(n <= USBIP_OUT_MAX);
	if (attached_from_start && n)
		fuzz_must(n >= 48 && (out[3] == 3 || out[3] == 4));
	usbip_conn_sent(c, n);
}

static void talk(struct usbip_conn *c, struct fuzz_input *in, bool attached, struct bb_clock *clk,
		 struct usb_monitor *m)
{
	bool alive = true;

	while (in->left && alive) {
		const size_t want = fuzz_byte(in);
		size_t n;
		const uint8_t *piece = fuzz_piece(in, want, &n);
		if (!n) {
			if (clk) {
				bb_clock_run_until(clk, bb_clock_now_ns(clk) + STEP_NS);
				(void)usb_monitor_step(m, bb_clock_now_ns(clk));
			}
			alive = usbip_conn_step(c);
			drain(c, attached);
		} else if (usbip_conn_room(c) >= n) {
			alive = usbip_conn_feed(c, piece, n);
		}
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct usbip_exports exports;
	static struct peer_i2c_tiny_usb *i2c; /* made once; attaching resets it */
	static uint8_t sum;
	struct fuzz_input in = { data, size };
	struct sim_usb_device bulk = { .ops = &ops,
				       .speed = SIM_USB_HIGH,
				       .device = device,
				       .config = config,
				       .n_config = sizeof(config),
				       .string = { NULL, "a", "b", "c" } };
	const struct bb_monitor_config config_of_monitor = {
		.id = "m", .edid = "S27A850D", .width_px = 1920, .height_px = 1080
	};
	struct usb_monitor monitor;
	struct usbip_conn *conn;
	struct bb_clock *clk = NULL;

	if (!i2c && peer_i2c_tiny_usb_create("S", &i2c) == BB_OK)
		peer_i2c_tiny_usb_add(i2c, &(struct sim_i2c_target){ target_write, target_read, &sum });
	sum = 0;
	plugged = true;
	exports.n = 4;
	exports.item[0] = (struct usbip_export){ "1-1", 1, 2, peer_i2c_tiny_usb_device(i2c), false };
	exports.item[1] = (struct usbip_export){ "1-2", 1, 3, &bulk, false };
	exports.item[2] = (struct usbip_export){ "1-3", 1, 4, NULL, false };
	exports.item[3] = (struct usbip_export){ "1-4", 1, 5, &bulk, true };
	const uint8_t how = fuzz_byte(&in);
	const bool attached = how & 1;
	if (how & 4) {
		fuzz_must(bb_clock_virtual_create(&clk) == BB_OK);
		fuzz_must(usb_monitor_init(&monitor, &config_of_monitor, NULL, 1, clk) == BB_OK);
		peer_i2c_tiny_usb_world_nak(monitor.adapter, how >> 3 & 1);
		peer_i2c_tiny_usb_world_stall(monitor.adapter, how >> 4 & 1);
		exports.item[exports.n++] = (struct usbip_export){ "1-5", 1, 6, usb_monitor_device(&monitor), false };
	}
	const enum bb_status status = attached ? usbip_conn_create_attached(&exports, how & 4 ? 4 : how >> 1 & 1, &conn)
					       : usbip_conn_create(&exports, &conn);
	if (status == BB_OK) {
		talk(conn, &in, attached, clk, &monitor);
		usbip_conn_destroy(conn);
		fuzz_must(!exports.item[0].taken && !exports.item[1].taken);
		fuzz_must(!clk || !exports.item[4].taken);
	}
	if (clk)
		usb_monitor_fini(&monitor);
	bb_clock_destroy(clk);
	return 0;
}
