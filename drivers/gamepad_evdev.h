/*
 * drivers/gamepad_evdev.h: any gamepad the kernel drives, over its input events. URI "evdev:/dev/input/event3" or
 * "evdev:046d:c219?serial=..." (xpad calls the pads of a wireless receiver 045e:02a1), with "mapping=FILE" a file of
 * SDL_GameControllerDB lines. Without one: sticks on ABS_X/Y and ABS_RX/RY (or Z/RZ), the cross on ABS_HAT0, buttons
 * by ascending code; a SpaceMouse: six axes, ABS_X to ABS_RZ. With one: buttons are A B X Y LB RB back start guide L3
 * R3 and the triggers beyond half way.
 *
 * The kernel tells changes only, so silence of a still stick is no fault here and most_report_gap_ns is for ever.
 * States and names of other faults: drivers/pad_core.h. One thread.
 */
#ifndef BB_DRIVERS_GAMEPAD_EVDEV_H
#define BB_DRIVERS_GAMEPAD_EVDEV_H

#include "drivers/bus_input.h"
#include "drivers/pad_core.h"
#include "drivers/sdl_mapping.h"

struct bb_input_port { /* where buses come from */
	enum bb_status (*open)(void *ctx, const struct bb_input_identity *wanted, struct bb_clock *clk,
			       struct bb_input_bus **out, struct bb_input_identity *found, struct bb_error *err);
	void *ctx;
};

#define BB_EVDEV_CODES 0x300 /* of keys; axes have 0x40 */
#define BB_EVDEV_AXES 0x40

struct bb_gamepad_evdev {
	struct bb_gamepad base;
	struct bb_pad_core core;
	struct bb_input_port port;
	const struct bb_log *log;
	struct bb_input_identity wanted;
	struct bb_input_bus *bus;
	char mapping_file[64];
	struct bb_sdl_mapping mapping;    /* n == 0: none */
	size_t n_buttons, n_axes, n_hats; /* as SDL counts them */
	uint16_t button[64], axis[BB_EVDEV_AXES];
	struct bb_input_range range[BB_EVDEV_AXES];
	int32_t value[BB_EVDEV_AXES];
	bool key[BB_EVDEV_CODES];
	bool rumbling;
};

extern const struct bb_gamepad_driver bb_gamepad_evdev_driver;
extern const struct bb_gamepad_ops bb_gamepad_evdev_ops;

/* What ops->open does, with buses from elsewhere: a test's own ops table has an open that calls this. */
BB_MUST_CHECK enum bb_status bb_gamepad_evdev_open_on(struct bb_gamepad *g, const struct bb_open *open,
						      const struct bb_input_port *port);
const struct bb_pad_core *bb_gamepad_evdev_core(const struct bb_gamepad *g);

#endif
