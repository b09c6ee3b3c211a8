/*
 * sim/sim_gamepad.h: a simulated gamepad or 6-DOF controller that plays an event text. It reports every 8 to 16 ms
 * while any axis is off neutral or something changed, and is silent while idle, as the hardware is. Values are
 * quantised as the model's own reports are; plugged in again it holds everything at neutral until the hand was neutral
 * once, as the drivers do. Script time counts from the scene's start. One thread, the clock's.
 *
 * The event text: one event a line, "#" begins a comment, times are seconds and never go back, at most 256 KiB and
 * 8192 events. Errors are 1331 (a line that is no event), 1332 (a number out of range), 1333 (time goes back),
 * 1334 (too much).
 *
 *   t_s axis N VALUE RAMP_S     axis N (1..6) goes to VALUE (-1..1) within RAMP_S (0..600)
 *   t_s button N down|up        button N (1..32)
 *   t_s battery LEVEL           0..1
 *   t_s report A1 .. A6 BITS    a recorded report: six axes at once, buttons as bits (decimal or 0x...)
 *
 * With script "" the pad plays ten minutes generated from the seed and its id: deflected about two thirds of the time,
 * and certainly from 2.0 s to 6.0 s.
 */
#ifndef BB_SIM_SIM_GAMEPAD_H
#define BB_SIM_SIM_GAMEPAD_H

#include "hal/gamepad_driver.h"

struct sim_pad_script;

/* What the script asks for at a time from its start: a pure function of both. */
struct sim_pad_state {
	double axis[BB_PAD_AXES];
	uint32_t buttons;
	double battery; /* NAN: the script has not said */
};

BB_MUST_CHECK enum bb_status sim_pad_script_load(const char *path, struct sim_pad_script **out, struct bb_error *err);
/* The same from bytes; name is for messages. */
BB_MUST_CHECK enum bb_status sim_pad_script_parse(const char *bytes, size_t n, const char *name,
                                                  struct sim_pad_script **out, struct bb_error *err);
BB_MUST_CHECK enum bb_status sim_pad_script_generate(uint64_t seed, const char *id, struct sim_pad_script **out);
void sim_pad_script_free(struct sim_pad_script *s);
void sim_pad_script_at(const struct sim_pad_script *s, int64_t t_ns, struct sim_pad_state *out);
int64_t sim_pad_script_end_ns(const struct sim_pad_script *s); /* of its last event or ramp */

/* Last rumble asked for, 0..1; false when there was none. */
bool sim_gamepad_rumble(struct bb_gamepad *g, float *strong, float *weak);

#endif
