/*
 * sim/peer_pads.h: the far ends of gamepads' wires, byte for byte, with encoders of their own: RumblePad 2 wired and
 * wireless, SpaceNavigator, wireless SpaceMouse, and the pads of an Xbox 360 wireless receiver. Each plays an event
 * text (sim/sim_gamepad.h has the format) every 8 to 16 ms while an axis is off neutral or something changed, in step
 * with a simulated gamepad of the same seed and id. bus_sim_hid.h and bus_sim_usb.h put drivers before them in this
 * process, uhid.h the kernel, the USB face below a USB/IP server. Runs on its clock; one thread.
 */
#ifndef BB_SIM_PEER_PADS_H
#define BB_SIM_PEER_PADS_H

#include "sim/faults.h"
#include "sim/sim_gamepad.h"
#include "sim/sim_usb_device.h"
#include "sim/world.h"

enum sim_peer_kind {
	SIM_PEER_RUMBLEPAD2_WIRED,
	SIM_PEER_RUMBLEPAD2_WIRELESS,
	SIM_PEER_SPACENAVIGATOR,      /* moves and turns in reports of their own */
	SIM_PEER_SPACEMOUSE_WIRELESS, /* both in one; battery */
	SIM_PEER_XBOX_PAD,            /* one slot of a receiver */
	SIM_PEER_KINDS
};

#define SIM_PEER_PACKET_BYTES 32
#define SIM_PEER_QUEUE 64 /* as many as the kernel keeps of a hidraw node; the newest are lost, as there */

struct sim_peer_config {
	enum sim_peer_kind kind;
	const char *id;     /* its serial number as well */
	const char *script; /* "" = generated from seed and id */
	uint64_t seed;
	struct bb_clock *clk;
	struct sim_world *world; /* NULL: scripts count from 0, and nothing is registered for faults */
};

struct sim_peer_pad;
BB_MUST_CHECK enum bb_status sim_peer_pad_create(const struct sim_peer_config *config, struct sim_peer_pad **out);
void sim_peer_pad_destroy(struct sim_peer_pad *p);
enum sim_peer_kind sim_peer_pad_kind(const struct sim_peer_pad *p);
const char *sim_peer_pad_serial(const struct sim_peer_pad *p);

/* The wire. */
/* Its next packet to the host: an input report (with its id where it has one) or a receiver's packet. BB_TIMEOUT: none;
 * BB_ERR_LOST: unplugged. at_ns is when it was sent. */
BB_MUST_CHECK enum bb_status sim_peer_pad_take(struct sim_peer_pad *p, uint8_t *bytes, size_t cap, size_t *n_out,
					       int64_t *at_ns);
/* From the host: an output report, its id first (0 where it has none), or a command to a receiver's pad. BB_ERR_IO:
 * what hardware would refuse or ignore. */
BB_MUST_CHECK enum bb_status sim_peer_pad_give(struct sim_peer_pad *p, const uint8_t *bytes, size_t n);
const uint8_t *sim_peer_pad_descriptor(const struct sim_peer_pad *p, size_t *n_out); /* HID report descriptor */
bool sim_peer_pad_plugged(const struct sim_peer_pad *p);
uint32_t sim_peer_pad_generation(const struct sim_peer_pad *p); /* one more with each unplug: old handles are stale */
/* Called when there is something to take, when it is unplugged and plugged in. NULL: nobody. */
void sim_peer_pad_listen(struct sim_peer_pad *p, void (*fn)(void *ctx), void *ctx);

/* The world. */
void sim_peer_pad_unplug(struct sim_peer_pad *p, bool on);
bool sim_peer_pad_rumble(const struct sim_peer_pad *p, float *strong, float *weak);
int sim_peer_pad_led(const struct sim_peer_pad *p); /* -1: never told */
/* Sends these bytes as they are. */
void sim_peer_pad_send(struct sim_peer_pad *p, const uint8_t *bytes, size_t n);
/* The truth, for a test to compare with. */
void sim_peer_pad_truth(const struct sim_peer_pad *p, struct sim_pad_state *out);
extern const struct sim_verb sim_peer_pad_verbs[];

/* The USB face, for a bus in this process (bus_sim_usb.h) or a USB/IP server. NULL: an Xbox pad has none of its own.
 * What is parked on its IN endpoint may go on when the listener is called. */
struct sim_usb_device *sim_peer_pad_usb(struct sim_peer_pad *p);

/* The Xbox 360 wireless receiver with up to four pads; an empty slot is NULL. The caller's memory; the pads outlive it,
 * and all pads' plugs are the receiver's: one pulled, all gone. Pads are on endpoints 1, 3, 5, 7 in both directions. */
#define SIM_XBOX_SLOTS 4
struct sim_xbox_receiver {
	struct sim_usb_device usb;
	struct sim_peer_pad *pad[SIM_XBOX_SLOTS];
	bool asked[SIM_XBOX_SLOTS]; /* an empty slot owes an answer to a presence inquiry */
};
void sim_xbox_init(struct sim_xbox_receiver *r);

#endif
