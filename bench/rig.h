/*
 * bench/rig.h: the room's devices, opened through their back ends: only those the scene needs, at the fidelity it asks
 * for; everything else stays closed and costs nothing. Closing leaves shutters open and outlets as they are.
 */
#ifndef BB_BENCH_RIG_H
#define BB_BENCH_RIG_H

#include "hal/room.h"
#include "hal/scene.h"

struct bb_rig { /* arrays run parallel to the room's; NULL entries are not needed by the scene */
	const struct bb_room *room;
	int needs[BB_CLASS_COUNT];
	struct bb_shutter *shutter;
	struct bb_camera **cameras;
	struct bb_display **displays; /* by screen */
	struct bb_monitor **monitors;
	struct bb_power **pdus;
	struct bb_gamepad **gamepads;
	struct bb_link *link;
};

/* open: clk, events, log, seed and world are taken from it, uri and fidelity are set per device. */
BB_MUST_CHECK enum bb_status bb_rig_open(struct bb_rig *rig, const struct bb_room *room,
                                         const int needs[BB_CLASS_COUNT], const struct bb_open *open,
                                         struct bb_error *err);
void bb_rig_close(struct bb_rig *rig);

/* Visit every device of the room in room order; dev is NULL for one that is not open. A rig with only its room set is
 * one with everything closed. */
typedef void (*bb_rig_visit)(void *ctx, enum bb_class class, size_t index, const char *class_name, const char *id,
                             const char *uri, struct bb_device *dev);
void bb_rig_each(const struct bb_rig *rig, bb_rig_visit visit, void *ctx);

#endif
