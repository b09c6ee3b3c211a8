/*
 * sim/sim_pending.c: TEMPORARY, deleted on merge: empty tables for the sims of monitors, power and gamepads and a
 * stand-in for paths, so that this branch links by itself.
 */
#include "sim/sim.h"
#include "hal/scene.h"

const struct sim_verb sim_monitor_verbs[] = { { NULL, NULL, NULL, NULL, NULL } };
const struct sim_verb sim_power_verbs[] = { { NULL, NULL, NULL, NULL, NULL } };
const struct sim_verb sim_gamepad_verbs[] = { { NULL, NULL, NULL, NULL, NULL } };

struct bb_pose bb_path_at(const struct bb_path *path, int64_t t_ns)
{
	(void)path;
	(void)t_ns;
	return BB_POSE_IDENTITY;
}
