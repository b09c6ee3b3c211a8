/*
 * hal/safe_state.h: what the room's outputs may do next: shutters open or running, how far apart the two eyes' views are,
 * how bright the pictures are. Whatever asks, and however often, people see no more than this:
 *
 *   opening   one immediate step, at any time: shutters open, both eyes see one view. Then nothing moves for gap_ns.
 *   others    one at a time, their beginnings gap_ns apart; brightness and depth move by 1 in fade_ns at most, and a call
 *             that comes late moves them no further than a twentieth of that
 *   closing   first the pictures fade to `dim`, what running shutters let through of what open ones do; then the shutters
 *             run and the pictures are bright again in one step, and the light an eye gets has not jumped
 *
 * Pure: no clock, no memory, no device. The owner applies what comes out. Sources: WCAG 2.3.1; fades and latch are ours.
 */
#ifndef BB_HAL_SAFE_STATE_H
#define BB_HAL_SAFE_STATE_H

#include "hal/safety.h"

enum bb_show { /* what is asked for */
	BB_SHOW_STEREO,
	BB_SHOW_MONO,  /* shutters run, both eyes see one view */
	BB_SHOW_BLACK, /* shutters as they are, pictures dark; the loop never asks for it */
	BB_SHOW_OPEN   /* the safe state: shutters open, one view */
};

struct bb_safe_output {
	bool open;     /* the shutters, all of them and the glasses; else they run */
	double depth;  /* 0: both eyes see the view of their midpoint .. 1: each its own */
	double light;  /* of the pictures, 0..1 */
};

struct bb_safe_state {
	int64_t fade_ns, gap_ns;
	double dim;             /* 0 < dim <= 1 */
	enum bb_show show;      /* under way, or reached */
	int64_t moved_ns;       /* when that began */
	int64_t stepped_ns;
	struct bb_safe_output out;
};

/* Begins as a bright room does before anybody acts: in `show`, settled, free to move at once. */
void bb_safe_init(struct bb_safe_state *s, const struct bb_safety *limits, double dim, enum bb_show show, int64_t now_ns);
/* Once a frame, and whenever the outputs must open; now_ns never runs back. */
struct bb_safe_output bb_safe_step(struct bb_safe_state *s, enum bb_show want, int64_t now_ns);

#endif
