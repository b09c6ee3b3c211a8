/*
 * hal/gamepad.h: gamepads and 6-DOF controllers: reports of axes and buttons, rumble, battery.
 *
 * Axes are -1..1, 0 = neutral. RumblePad 2: left x, left y, right x, right y, hat x, hat y. SpaceMouse: tx ty tz rx ry
 * rz in the maker's frame turned to ours (right-handed, Y up).
 */
#ifndef BB_HAL_GAMEPAD_H
#define BB_HAL_GAMEPAD_H

#include "hal/device.h"

enum bb_pad_model { BB_PAD_RUMBLEPAD2, BB_PAD_SPACEMOUSE, BB_PAD_XBOX360 };

struct bb_gamepad_config {
	char id[BB_ID_MAX];
	char device[160];
	enum bb_pad_model model;
	char script[BB_PATH_MAX_BYTES]; /* sim: event text, recorded or written; "" = one generated from the seed */
};

struct bb_gamepad_limits {
	int64_t most_report_gap_ns;  /* while any axis is off neutral: silence longer than this is a fault */
	double axis_step;            /* quantisation of an axis */
	bool has_rumble, has_battery;
};

#define BB_PAD_AXES 6
struct bb_pad_report {
	int64_t at_ns;
	uint32_t seq;
	float axis[BB_PAD_AXES];
	uint32_t buttons;            /* bit i = button i + 1 */
	float battery;               /* 0..1; NAN when unknown */
};

struct bb_gamepad;
struct bb_gamepad_driver;

BB_MUST_CHECK enum bb_status bb_gamepad_open(const struct bb_gamepad_driver *driver,
                                             const struct bb_gamepad_config *config, const struct bb_open *open,
                                             struct bb_gamepad **out);
void bb_gamepad_close(struct bb_gamepad *g);
const struct bb_gamepad_limits *bb_gamepad_limits(const struct bb_gamepad *g);
/* Reports not read yet, oldest first; BB_TIMEOUT when there is none; BB_ERR_LOST after an unplug. */
BB_MUST_CHECK enum bb_status bb_gamepad_read(struct bb_gamepad *g, struct bb_pad_report *reports, size_t cap,
                                             size_t *n_out);
BB_MUST_CHECK enum bb_status bb_gamepad_rumble(struct bb_gamepad *g, float strong, float weak);
struct bb_device *bb_gamepad_device(struct bb_gamepad *g);

#endif
