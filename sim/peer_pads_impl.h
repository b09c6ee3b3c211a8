/* sim/peer_pads_impl.h: the inside of struct sim_peer_pad, shared by the peer_pads_*.c files only. One thread. */
#ifndef BB_SIM_PEER_PADS_IMPL_H
#define BB_SIM_PEER_PADS_IMPL_H

#include "sim/peer_pads.h"

struct peer_values { /* what the hand does, in the device's own counts, in the frame of hal/gamepad.h */
	int32_t count[BB_PAD_AXES];
	uint32_t buttons;
	double battery;
};

struct peer_packet {
	int64_t at_ns;
	size_t n;
	uint8_t bytes[SIM_PEER_PACKET_BYTES];
};

struct peer_model {
	int32_t steps[BB_PAD_AXES];
	uint32_t buttons;
	void (*send)(struct sim_peer_pad *p, const struct peer_values *v);
	void (*joined)(struct sim_peer_pad *p); /* plugged in, or back from sleep */
	enum bb_status (*give)(struct sim_peer_pad *p, const uint8_t *bytes, size_t n);
	int64_t battery_every_ns; /* BB_NEVER: it never says */
	void (*send_battery)(struct sim_peer_pad *p, double level);
};

struct sim_peer_pad {
	enum sim_peer_kind kind;
	const struct peer_model *model;
	struct sim_usb_device usb;
	uint8_t usb_config[34];
	char id[BB_ID_MAX];
	struct bb_clock *clk;
	struct sim_world *world;
	struct sim_rng rng, noise;
	struct sim_pad_script *script;
	struct bb_timer timer;
	double battery; /* of a script that does not say */
	struct peer_values told;
	int64_t battery_due_ns;
	uint32_t generation;

	size_t head, n;
	struct peer_packet queue[SIM_PEER_QUEUE];
	void (*listener)(void *ctx);
	void *listener_ctx;

	bool has_rumbled;
	float strong, weak;
	int led;

	bool fault_silence, fault_unplug, fault_off, fault_battery, fault_short, fault_id, fault_descriptor;
	double fault_level, garbage_share;
	bool fault_stick[BB_PAD_AXES];
	double stick_value[BB_PAD_AXES], drift[BB_PAD_AXES], shake[BB_PAD_AXES];
};

/* A packet of the device itself: faults of the wire apply, and silence. */
void sim_peer_emit(struct sim_peer_pad *p, const uint8_t *bytes, size_t n);
extern const struct peer_model sim_peer_rumblepad_wired, sim_peer_rumblepad_wireless, sim_peer_spacenavigator,
	sim_peer_spacemouse, sim_peer_xbox;
void sim_peer_usb_init(struct sim_peer_pad *p);
/* HID report descriptors; NULL for the Xbox pad. */
const uint8_t *sim_peer_hid_descriptor(enum sim_peer_kind kind, size_t *n_out);

#endif
