/* tests/fixture_pads.h: a shipped gamepad driver in front of a simulated far end, on a rig's virtual clock. */
#ifndef BB_TESTS_FIXTURE_PADS_H
#define BB_TESTS_FIXTURE_PADS_H

#include "drivers/gamepad_evdev.h"
#include "drivers/gamepad_hid.h"
#include "drivers/gamepad_xusb.h"
#include "sim/bus_sim_hid.h"
#include "sim/bus_sim_input.h"
#include "sim/bus_sim_usb.h"
#include "tests/sim_rig.h"

#include <stdio.h>

struct pad_far {
	enum sim_peer_kind kind;
	bool evdev; /* read through the kernel's events */
	struct sim_peer_pad *peer;
	struct bus_sim_usb usb;
	struct sim_xbox_receiver receiver;
	struct bb_gamepad_ops ops;
	struct bb_gamepad_driver driver;
	struct bb_uri uri;
	unsigned long opened; /* buses */
};

static struct pad_far *pad_far_now; /* ops->open has no argument for it */

static inline enum bb_status pad_far_bus(void *ctx, const struct bb_hid_identity *wanted, struct bb_clock *clk,
					 struct bb_hid_bus **out, struct bb_hid_identity *found, struct bb_error *err)
{
	struct pad_far *far = ctx;
	const char *serial = sim_peer_pad_serial(far->peer);

	*out = NULL;
	if (wanted->serial[0] && strcmp(wanted->serial, serial))
		return bb_fail(err, BB_ERR_LOST, 1562, NULL, "another pad");
	const enum bb_status status = sim_hid_bus_open(far->peer, clk, out);
	if (status != BB_OK)
		return bb_fail(err, status, 1562, NULL, "no such pad");
	*found = *wanted;
	snprintf(found->serial, sizeof(found->serial), "%s", serial);
	far->opened++;
	return BB_OK;
}

static inline enum bb_status pad_far_open_hid(struct bb_gamepad *g, const struct bb_open *open)
{
	return bb_gamepad_hid_open_on(g, open, &(struct bb_hid_port){ pad_far_bus, pad_far_now });
}

static inline enum bb_status pad_far_open_usb(struct bb_gamepad *g, const struct bb_open *open)
{
	return bb_gamepad_xusb_open_on(g, open, &pad_far_now->usb.host);
}

static inline enum bb_status pad_far_events(void *ctx, const struct bb_input_identity *wanted, struct bb_clock *clk,
					    struct bb_input_bus **out, struct bb_input_identity *found,
					    struct bb_error *err)
{
	struct pad_far *far = ctx;
	const enum bb_status status = sim_input_bus_open(far->peer, clk, out);

	if (status != BB_OK)
		return bb_fail(err, status, 1562, NULL, "no such pad");
	*found = (struct bb_input_identity){ .bus = 3, .vendor = 0x046D, .product = 0xC219, .version = 0x0110 };
	(void)wanted;
	snprintf(found->serial, sizeof(found->serial), "%s", sim_peer_pad_serial(far->peer));
	far->opened++;
	return BB_OK;
}

static inline enum bb_status pad_far_open_evdev(struct bb_gamepad *g, const struct bb_open *open)
{
	return bb_gamepad_evdev_open_on(g, open, &(struct bb_input_port){ pad_far_events, pad_far_now });
}

static inline const char *pad_far_uri(enum sim_peer_kind kind)
{
	static const char *const uris[SIM_PEER_KINDS] = {
		[SIM_PEER_RUMBLEPAD2_WIRED] = "hid:046d:c218", [SIM_PEER_RUMBLEPAD2_WIRELESS] = "hid:046d:c219",
		[SIM_PEER_SPACENAVIGATOR] = "hid:046d:c626",   [SIM_PEER_SPACEMOUSE_WIRELESS] = "hid:256f:c62e",
		[SIM_PEER_XBOX_PAD] = "usb:045e:0719?slot=2",
	};
	return uris[kind];
}

static inline bool pad_is_hid(enum sim_peer_kind kind)
{
	return kind != SIM_PEER_XBOX_PAD;
}

/* The far end alone; the pad is not opened yet. */
static inline struct pad_far *pad_far_create_uri(struct rig *rig, enum sim_peer_kind kind, const char *script,
						 const char *uri)
{
	const bool evdev = !strncmp(uri, "evdev:", 6);
	struct pad_far *far = calloc(1, sizeof(*far));
	const struct sim_peer_config c = { .kind = kind,
					   .id = "pad",
					   .script = script,
					   .seed = rig->open.seed,
					   .clk = rig->clk,
					   .world = rig->world };

	assert_non_null(far);
	far->kind = kind;
	assert_int_equal(sim_peer_pad_create(&c, &far->peer), BB_OK);
	far->evdev = evdev;
	far->driver = evdev              ? bb_gamepad_evdev_driver
		      : pad_is_hid(kind) ? bb_gamepad_hid_driver
					 : bb_gamepad_xusb_driver;
	far->ops = *far->driver.ops;
	far->ops.open = evdev ? pad_far_open_evdev : pad_is_hid(kind) ? pad_far_open_hid : pad_far_open_usb;
	far->driver.ops = &far->ops;
	bus_sim_usb_init(&far->usb);
	sim_xbox_init(&far->receiver);
	if (!evdev && !pad_is_hid(kind)) {
		far->receiver.pad[1] = far->peer; /* slot 2 */
		assert_true(bus_sim_usb_plug(&far->usb, 3, &far->receiver.usb));
	}
	assert_int_equal(bb_uri_parse(uri, &far->uri, NULL, NULL), BB_OK);
	rig->open.uri = &far->uri;
	pad_far_now = far;
	return far;
}

static inline struct pad_far *pad_far_create(struct rig *rig, enum sim_peer_kind kind, const char *script)
{
	return pad_far_create_uri(rig, kind, script, pad_far_uri(kind));
}

static inline enum bb_status pad_far_open(struct pad_far *far, struct rig *rig, const struct bb_gamepad_config *c,
					  struct bb_gamepad **out)
{
	pad_far_now = far;
	return bb_gamepad_open(&far->driver, c, &rig->open, out);
}

static inline void pad_far_destroy(struct pad_far *far)
{
	if (!far)
		return;
	sim_peer_pad_destroy(far->peer);
	free(far);
}

static inline const struct bb_pad_core *pad_far_core(const struct pad_far *far, const struct bb_gamepad *g)
{
	return far->evdev              ? bb_gamepad_evdev_core(g)
	       : pad_is_hid(far->kind) ? bb_gamepad_hid_core(g)
				       : bb_gamepad_xusb_core(g);
}

#endif
