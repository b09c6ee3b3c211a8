/* sim/peer_pads_usb.c: RumblePad 2 and the SpaceMice as USB devices: descriptors, HID class requests, one IN endpoint.
 */
#include "sim/peer_pads_impl.h"

#include <string.h>

#include "drivers/pad_wire.h"

#define REPORT_MAX 64

static struct sim_peer_pad *of(struct sim_usb_device *dev)
{
	return bb_container_of(dev, struct sim_peer_pad, usb);
}

#define IDENTITY(vendor, product)                                                                                      \
	18, 1, 0x00, 0x02, 0, 0, 0, 8, (vendor)&0xFF, (vendor) >> 8, (product)&0xFF, (product) >> 8, 0x00, 0x01, 1, 2, \
		3, 1
/* One HID interface, one interrupt IN endpoint; output reports go by SET_REPORT. */
#define CONFIG(n_report_descriptor, packet, interval_ms)                                                         \
	9, 2, 34, 0, 1, 1, 0, 0x80, 50, 9, 4, 0, 0, 1, 3, 0, 0, 0, 9, 0x21, 0x11, 0x01, 0, 1, 0x22,              \
		(uint8_t)(n_report_descriptor), (uint8_t)((n_report_descriptor) >> 8), 7, 5, 0x81, 3, packet, 0, \
		interval_ms

static const uint8_t wired_device[] = { IDENTITY(PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_RUMBLEPAD2_WIRED) };
static const uint8_t wireless_device[] = { IDENTITY(PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_RUMBLEPAD2_WIRELESS) };
static const uint8_t navigator_device[] = { IDENTITY(PAD_WIRE_VENDOR_LOGITECH, PAD_WIRE_SPACENAVIGATOR) };
static const uint8_t spacemouse_device[] = { IDENTITY(PAD_WIRE_VENDOR_3DCONNEXION, PAD_WIRE_SPACEMOUSE_WIRELESS) };

static const struct {
	const uint8_t *device;
	const char *product;
	uint8_t packet;
} faces[SIM_PEER_KINDS] = {
	[SIM_PEER_RUMBLEPAD2_WIRED] = { wired_device, "Logitech RumblePad 2 USB", 8 },
	[SIM_PEER_RUMBLEPAD2_WIRELESS] = { wireless_device, "Cordless RumblePad 2", 8 },
	[SIM_PEER_SPACENAVIGATOR] = { navigator_device, "SpaceNavigator", 8 },
	[SIM_PEER_SPACEMOUSE_WIRELESS] = { spacemouse_device, "SpaceMouse Wireless", 16 },
};

static int get_descriptor(struct sim_peer_pad *p, unsigned int type, uint8_t *bytes, size_t n)
{
	size_t n_from = 9;
	const uint8_t *from = p->usb_config + 18; /* the HID descriptor stands behind configuration and interface */

	if (type == 0x22)
		from = sim_peer_pad_descriptor(p, &n_from);
	else if (type != 0x21)
		return SIM_USB_STALL;
	n = n < n_from ? n : n_from;
	memcpy(bytes, from, n);
	return (int)n;
}

/* SET_REPORT has the id in its value; where there is none the bytes begin without one. */
static int set_report(struct sim_peer_pad *p, const struct bb_usb_setup *setup, const uint8_t *bytes, size_t n)
{
	uint8_t with_id[REPORT_MAX + 1] = { 0 };
	const bool has_id = (setup->value & 0xFF) != 0;

	if (setup->value >> 8 != 2 || n > REPORT_MAX)
		return SIM_USB_STALL;
	memcpy(with_id + !has_id, bytes, n);
	return sim_peer_pad_give(p, with_id, n + !has_id) == BB_OK ? (int)n : SIM_USB_STALL;
}

static int control(struct sim_usb_device *dev, const struct bb_usb_setup *setup, uint8_t *bytes, size_t n)
{
	switch (setup->request_type << 8 | setup->request) {
	case 0x8106:
		return get_descriptor(of(dev), setup->value >> 8, bytes, n);
	case 0x2109:
		return set_report(of(dev), setup, bytes, n);
	case 0x210A: /* SET_IDLE, SET_PROTOCOL: taken, of no effect */
	case 0x210B:
		return 0;
	default:
		return SIM_USB_STALL;
	}
}

static int in(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap)
{
	size_t n;

	if (endpoint != 0x81)
		return SIM_USB_STALL;
	switch (sim_peer_pad_take(of(dev), bytes, cap, &n, &dev->in_at_ns)) {
	case BB_OK:
		return (int)n;
	case BB_ERR_LOST:
		return SIM_USB_GONE;
	default:
		return SIM_USB_NAK;
	}
}

static bool present(struct sim_usb_device *dev)
{
	return sim_peer_pad_plugged(of(dev));
}

/* What nobody has fetched is of before. */
static void reset(struct sim_usb_device *dev)
{
	of(dev)->n = 0;
}

void sim_peer_usb_init(struct sim_peer_pad *p)
{
	static const struct sim_usb_ops ops = { control, in, sim_usb_no_out, reset, present };
	size_t n = 0;

	if (!faces[p->kind].device)
		return;
	sim_peer_hid_descriptor(p->kind, &n);
	const uint8_t config[] = { CONFIG(n, faces[p->kind].packet, 8) };
	_Static_assert(sizeof(config) == sizeof(p->usb_config), "one HID interface with one endpoint");
	memcpy(p->usb_config, config, sizeof(config));
	p->usb = (struct sim_usb_device){ .ops = &ops,
					  .speed = SIM_USB_FULL,
					  .device = faces[p->kind].device,
					  .config = p->usb_config,
					  .n_config = sizeof(p->usb_config),
					  .string = { NULL, "blackburst", faces[p->kind].product, p->id } };
}

struct sim_usb_device *sim_peer_pad_usb(struct sim_peer_pad *p)
{
	return p->usb.ops ? &p->usb : NULL;
}
