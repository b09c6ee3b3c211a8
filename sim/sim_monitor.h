/*
 * sim/sim_monitor.h: a simulated monitor with DDC/CI: an EDID, the VCP codes of an office display with their legal
 * values, the waits and busy answers of a slow microcontroller, power states, hours and a lamp that warms up. It is
 * seeded, and a function of the clock; at fidelity 0 it answers at once and is never busy.
 *
 * Asleep (standby, off by its button, D6 other than 1) it answers EDID, and Null to everything else; a write of D6 = 1
 * wakes it unless its button or a fault holds it. Without mains or cable nothing answers. After power-on it answers
 * Null for two seconds. cd/m2, ns. One thread, the clock's.
 */
#ifndef BB_SIM_SIM_MONITOR_H
#define BB_SIM_SIM_MONITOR_H

#include "hal/monitor_driver.h"

/* What a meter in front of the screen would read now or later (or at the last change, for times before it): peak
 * luminance of white, 0 when dark. It rises from 80 % of its final value with a time constant of ten minutes. */
double sim_monitor_luminance(struct bb_monitor *m, int64_t at_ns);
/* What is really set, whatever DDC answers; false for a code the monitor does not have. */
bool sim_monitor_value(struct bb_monitor *m, uint8_t code, uint16_t *out);

#endif
