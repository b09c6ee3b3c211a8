/*
 * sim/sim_power.h: a simulated power strip: relays that take a moment to settle, inrush and load currents, a meter with
 * a small error. It tells the world which outlets ("pdu1/2") are fed. All outlets are closed when it is opened, as a
 * strip keeps its state over a restart of whoever talks to it. Relays follow their coils: without mains they are open,
 * with mains they go back to what was commanded. Amperes, ns. One thread, the clock's.
 */
#ifndef BB_SIM_SIM_POWER_H
#define BB_SIM_SIM_POWER_H

#include "hal/power_driver.h"

/* What happens outside, for bench/ and tests/; the fault verbs call the same. index counts config.outlet. */
enum sim_stick { SIM_STICK_NONE, SIM_STICK_OPEN, SIM_STICK_CLOSED };
/* The contact goes to the stuck state at once and obeys nothing; NONE: it follows its coil again. */
void sim_power_world_stick(struct bb_power *p, size_t index, enum sim_stick stick);
void sim_power_world_silence(struct bb_power *p, bool silent); /* no answer from the strip */
void sim_power_world_drop(struct bb_power *p, bool dropped);   /* no mains at the strip: also no answer */
/* What the outlet's load draws instead of load_a; negative: load_a again. */
void sim_power_world_current(struct bb_power *p, size_t index, double current_a);

/* Truth, past the meter and the read-back. */
bool sim_power_contact(const struct bb_power *p, size_t index);
double sim_power_current(const struct bb_power *p, size_t index, int64_t at_ns);

#endif
