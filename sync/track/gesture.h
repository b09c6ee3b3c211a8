/*
 * sync/track/gesture.h: two gestures, which is what a wand needs and no more: to point, and to grab by laying a finger on a
 * marker.
 *
 * Pointing: a body points along its own -z, from its origin: which screen, where on it. Grabbing: one marker of a body that
 * is seen otherwise is not seen for so many solutions in a row; it is let go when it is seen again as often, or when the body
 * has not been seen for release_ns, so that nothing hangs on a wand that was put away.
 *
 * Pure but for the state; times are the caller's host ns.
 */
#ifndef BB_SYNC_TRACK_GESTURE_H
#define BB_SYNC_TRACK_GESTURE_H

#include "hal/room.h"

struct bb_pointing {
	bool hit;
	uint16_t screen;             /* index in the room: the nearest one, seen from its front */
	double x_px, y_px;           /* pixel (0, 0) is the centre of the upper left one */
	double distance_m;
};
/* A pose or room that is no number hits nothing. */
struct bb_pointing bb_gesture_point(const struct bb_room *room, const struct bb_pose *body);

enum bb_grab_change { BB_GRAB_NONE, BB_GRAB_TAKEN, BB_GRAB_LET_GO };

struct bb_grab {
	unsigned marker, frames;     /* which one; how often in a row until it counts */
	int64_t release_ns;
	bool held;
	unsigned against;            /* solutions in a row that say otherwise than held */
	int64_t seen_ns;
};
void bb_grab_init(struct bb_grab *g, unsigned marker, unsigned frames);
/* A solution of the body at at_ns: bit m of labelled is set if some camera saw marker m. Older than the last: ignored. */
enum bb_grab_change bb_grab_solution(struct bb_grab *g, int64_t at_ns, uint32_t labelled);
/* Nothing new until now. */
enum bb_grab_change bb_grab_wait(struct bb_grab *g, int64_t now_ns);

#endif
