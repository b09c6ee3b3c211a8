/*
 * sim/sim.h: the simulated back ends (scheme "sim:") and their fault verbs. Everything else a sim can be told stands in
 * its own sim/sim_<class>.h (world verbs, for bench/ and tests/ only).
 */
#ifndef BB_SIM_SIM_H
#define BB_SIM_SIM_H

#include "hal/camera_driver.h"
#include "hal/display_driver.h"
#include "hal/gamepad_driver.h"
#include "hal/link_driver.h"
#include "hal/monitor_driver.h"
#include "hal/power_driver.h"
#include "hal/shutter_driver.h"
#include "sim/faults.h"

extern const struct bb_shutter_driver sim_shutter_driver;
extern const struct bb_camera_driver sim_camera_driver;
extern const struct bb_display_driver sim_display_driver;
extern const struct bb_monitor_driver sim_monitor_driver;
extern const struct bb_power_driver sim_power_driver;
extern const struct bb_gamepad_driver sim_gamepad_driver;
extern const struct bb_link_driver sim_link_driver;

extern const struct sim_verb sim_shutter_verbs[];
extern const struct sim_verb sim_camera_verbs[];
extern const struct sim_verb sim_display_verbs[];
extern const struct sim_verb sim_monitor_verbs[];
extern const struct sim_verb sim_power_verbs[];
extern const struct sim_verb sim_gamepad_verbs[];
extern const struct sim_verb sim_link_verbs[];

#endif
