/*
 * sim/peer_pads_xbox.c: the pads of an Xbox 360 wireless receiver and the receiver's four slots. Written from recorded
 * packets (xboxdrv's PROTOCOL), without a look at the driver's decoder.
 */
#include "sim/peer_pads_impl.h"

#include <math.h>
#include <string.h>

#include "drivers/pad_wire.h"

/* Buttons 1..11: A B X Y LB RB back start guide L3 R3. */
static const struct {
	uint8_t byte, bit;
} places[11] = {
	{ 7, 0x10 }, { 7, 0x20 }, { 7, 0x40 }, { 7, 0x80 }, { 7, 0x01 }, { 7, 0x02 },
	{ 6, 0x20 }, { 6, 0x10 }, { 7, 0x04 }, { 6, 0x40 }, { 6, 0x80 },
};

static void put_word(uint8_t *to, int32_t v)
{
	to[0] = (uint8_t)(v & 0xFF);
	to[1] = (uint8_t)((uint32_t)v >> 8 & 0xFF);
}

static void send_state(struct sim_peer_pad *p, const struct peer_values *v)
{
	uint8_t m[PAD_WIRE_XBOX_BYTES] = { 0x00, PAD_WIRE_XBOX_HAS_PAD_DATA, 0x00, 0xF0, 0x00, 0x13 };

	for (size_t i = 0; i < BB_ARRAY_LEN(places); i++)
		if (v->buttons >> i & 1)
			m[places[i].byte] |= places[i].bit;
	m[6] |= v->count[5] < 0 ? 0x01 : v->count[5] > 0 ? 0x02 : 0;
	m[6] |= v->count[4] < 0 ? 0x04 : v->count[4] > 0 ? 0x08 : 0;
	put_word(m + 10, v->count[0]);
	put_word(m + 12, -v->count[1]); /* up is positive on this wire */
	put_word(m + 14, v->count[2]);
	put_word(m + 16, -v->count[3]);
	sim_peer_emit(p, m, sizeof(m));
}

static void send_battery(struct sim_peer_pad *p, double level)
{
	uint8_t m[PAD_WIRE_XBOX_BYTES] = { 0x00, 0x00, 0x00, PAD_WIRE_XBOX_BATTERY, (uint8_t)lround(level * 255) };

	sim_peer_emit(p, m, sizeof(m));
}

static void joined(struct sim_peer_pad *p)
{
	static const uint8_t here[] = { PAD_WIRE_XBOX_STATUS, PAD_WIRE_XBOX_STATUS_PAD };
	static const uint8_t link[PAD_WIRE_XBOX_BYTES] = { 0x00, PAD_WIRE_XBOX_LINK, 0x00, 0xF0, 0xF0, 0xCC, 0xFD, 0x1F,
							   0x9F };
	static const uint8_t led[PAD_WIRE_XBOX_BYTES] = { 0x00, PAD_WIRE_XBOX_LED_STATUS, 0x02 };

	sim_peer_pad_send(p, here, sizeof(here));
	sim_peer_pad_send(p, link, sizeof(link));
	sim_peer_pad_send(p, led, sizeof(led));
	p->battery_due_ns = bb_clock_now_ns(p->clk);
}

static void answer_presence(struct sim_peer_pad *p)
{
	const uint8_t m[] = { PAD_WIRE_XBOX_STATUS, p->fault_off ? 0 : PAD_WIRE_XBOX_STATUS_PAD };

	sim_peer_pad_send(p, m, sizeof(m));
}

static enum bb_status give(struct sim_peer_pad *p, const uint8_t *b, size_t n)
{
	static const uint8_t inquiry[] = { 0x08, 0x00, 0x0F, 0xC0 }, rumble[] = { 0x00, 0x01, 0x0F, 0xC0, 0x00 };

	if (n != PAD_WIRE_XBOX_COMMAND_BYTES)
		return BB_ERR_IO;
	if (!memcmp(b, inquiry, sizeof(inquiry))) {
		answer_presence(p);
	} else if (p->fault_off) {
		return BB_OK; /* the radio says nothing */
	} else if (!memcmp(b, rumble, sizeof(rumble))) {
		p->has_rumbled = true;
		p->strong = (float)b[5] / 255;
		p->weak = (float)b[6] / 255;
	} else if (b[0] == 0 && b[1] == 0 && b[2] == 0x08 && b[3] == 0xC0) {
		p->fault_off = true;
		answer_presence(p);
	} else if (b[0] == 0 && b[1] == 0 && b[2] == 0x08 && (b[3] & 0xF0) == 0x40) {
		p->led = b[3] & 0x0F;
	}
	return BB_OK;
}

const struct peer_model sim_peer_xbox = {
	{ 32767, 32767, 32767, 32767, 1, 1 }, 0x7FF, send_state, joined, give, INT64_C(10000000000), send_battery
};

/* The receiver. ------------------------------------------------------------------------------------------------ */

static struct sim_xbox_receiver *receiver(struct sim_usb_device *dev)
{
	return bb_container_of(dev, struct sim_xbox_receiver, usb);
}

static bool xbox_present(struct sim_usb_device *dev)
{
	const struct sim_xbox_receiver *r = receiver(dev);

	for (size_t i = 0; i < SIM_XBOX_SLOTS; i++)
		if (r->pad[i] && !sim_peer_pad_plugged(r->pad[i]))
			return false;
	return true;
}

/* What nobody has fetched is of before; who is there says so again. */
static void xbox_reset(struct sim_usb_device *dev)
{
	struct sim_xbox_receiver *r = receiver(dev);

	for (size_t i = 0; i < SIM_XBOX_SLOTS; i++) {
		r->asked[i] = false;
		if (!r->pad[i])
			continue;
		r->pad[i]->n = 0;
		if (!r->pad[i]->fault_off)
			joined(r->pad[i]);
	}
}

/* Slot of a pad's endpoint; SIM_XBOX_SLOTS: a headset's; -1: none. */
static int slot_of(uint8_t endpoint)
{
	const int number = endpoint & 0x0F;

	if (endpoint & 0x70 || number < 1 || number > 2 * SIM_XBOX_SLOTS)
		return -1;
	return number & 1 ? number / 2 : SIM_XBOX_SLOTS;
}

static int xbox_in(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap)
{
	struct sim_xbox_receiver *r = receiver(dev);
	const int slot = slot_of(endpoint);
	size_t n;

	if (!xbox_present(dev))
		return SIM_USB_GONE;
	if (slot < 0)
		return SIM_USB_STALL;
	if (slot == SIM_XBOX_SLOTS)
		return SIM_USB_NAK;
	if (r->pad[slot])
		return sim_peer_pad_take(r->pad[slot], bytes, cap, &n, &dev->in_at_ns) == BB_OK ? (int)n : SIM_USB_NAK;
	if (!r->asked[slot] || cap < 2)
		return SIM_USB_NAK;
	r->asked[slot] = false;
	bytes[0] = PAD_WIRE_XBOX_STATUS;
	bytes[1] = 0;
	return 2;
}

static int xbox_out(struct sim_usb_device *dev, uint8_t endpoint, const uint8_t *bytes, size_t n)
{
	struct sim_xbox_receiver *r = receiver(dev);
	const int slot = slot_of(endpoint);

	if (!xbox_present(dev))
		return SIM_USB_GONE;
	if (slot < 0 || n > 32)
		return SIM_USB_STALL;
	if (slot == SIM_XBOX_SLOTS)
		return (int)n;
	if (r->pad[slot])
		return sim_peer_pad_give(r->pad[slot], bytes, n) == BB_OK ? (int)n : SIM_USB_STALL;
	r->asked[slot] = n >= 4 && bytes[0] == 0x08 && bytes[2] == 0x0F && bytes[3] == 0xC0;
	return (int)n;
}

#define XBOX_PAD(number, endpoint) \
	9, 4, number, 0, 2, 0xFF, 0x5D, 0x81, 0, 7, 5, 0x80 | (endpoint), 3, 32, 0, 1, 7, 5, endpoint, 3, 32, 0, 8
#define XBOX_HEADSET(number, endpoint) \
	9, 4, number, 0, 2, 0xFF, 0x5D, 0x82, 0, 7, 5, 0x80 | (endpoint), 3, 32, 0, 2, 7, 5, endpoint, 3, 32, 0, 4
#define XBOX_CONFIG_BYTES (9 + 8 * (9 + 7 + 7))

static const uint8_t xbox_device[18] = {
	18,
	1,
	0x00,
	0x02,
	0xFF,
	0xFF,
	0xFF,
	8,
	PAD_WIRE_VENDOR_MICROSOFT & 0xFF,
	PAD_WIRE_VENDOR_MICROSOFT >> 8,
	PAD_WIRE_XBOX_RECEIVER & 0xFF,
	PAD_WIRE_XBOX_RECEIVER >> 8,
	0x00,
	0x01,
	1,
	2,
	3,
	1,
};
static const uint8_t xbox_config[XBOX_CONFIG_BYTES] = {
	9,
	2,
	XBOX_CONFIG_BYTES & 0xFF,
	XBOX_CONFIG_BYTES >> 8,
	8,
	1,
	0,
	0xA0,
	130,
	XBOX_PAD(0, 1),
	XBOX_HEADSET(1, 2),
	XBOX_PAD(2, 3),
	XBOX_HEADSET(3, 4),
	XBOX_PAD(4, 5),
	XBOX_HEADSET(5, 6),
	XBOX_PAD(6, 7),
	XBOX_HEADSET(7, 8),
};

void sim_xbox_init(struct sim_xbox_receiver *r)
{
	static const struct sim_usb_ops ops = { sim_usb_no_control, xbox_in, xbox_out, xbox_reset, xbox_present };

	*r = (struct sim_xbox_receiver){ .usb = { .ops = &ops,
						  .speed = SIM_USB_FULL,
						  .device = xbox_device,
						  .config = xbox_config,
						  .n_config = sizeof(xbox_config),
						  .string = { NULL, "blackburst", "Xbox 360 receiver peer",
							      "SIM0719" } } };
}
