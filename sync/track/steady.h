/*
 * sync/track/steady.h: which pose the pictures use, so that a tracker that loses its body and finds it again never makes
 * the room jump (row K4 of the fault matrix).
 *
 *   FOLLOW   the tracker's prediction, as long as it predicts: it stops doing so 100 ms after its last solution.
 *   DECAY    nothing is extrapolated any more: from the pose shown last, within decay_ns, to the neutral one.
 *   NEUTRAL  there, until enough solutions in a row agree with each other.
 *   BLEND    from the pose shown then to the tracker's, within blend_ns.
 *
 * Both ways run on 3 t^2 - 2 t^3, whose steepest slope is 1.5: a step from one call to the next is at most
 * 1.5 gap dt / decay_ns (blend_ns), with dt capped at BB_STEADY_STEP_NS, plus what the tracker's own pose moves while it is
 * blended in. Where nothing was shown yet nothing can jump: the first pose is taken as it is.
 *
 * Algorithm only: times are host ns of the caller, may stand still or run back; poses that are no numbers count as none.
 */
#ifndef BB_SYNC_TRACK_STEADY_H
#define BB_SYNC_TRACK_STEADY_H

#include "sync/track/tracker.h"

#define BB_STEADY_STEP_NS INT64_C(50000000) /* a longer pause between calls moves the picture no further than this one */

enum bb_steady_state { BB_STEADY_FOLLOW, BB_STEADY_DECAY, BB_STEADY_NEUTRAL, BB_STEADY_BLEND };

struct bb_steady_config {
	struct bb_pose neutral;        /* of the eyes */
	int64_t decay_ns, blend_ns;    /* 1 s, 200 ms */
	unsigned consistent;           /* solutions in a row that agree before they are believed: 3 */
	int64_t apart_ns;              /* further apart they are not in a row */
	double most_m_s, most_rad_s;   /* faster from one to the next is not the same head, */
	double slack_m, slack_rad;     /* beyond this much of noise */
};
/* What row K4 asks for, around a neutral pose. */
struct bb_steady_config bb_steady_usual(struct bb_pose neutral);

struct bb_steady_pose {
	struct bb_pose eyes;
	double position_sigma_mm;      /* of the tracker, and how far from its pose this one was taken */
	int64_t age_ns;                /* of the newest solution; BB_NEVER: there was none */
	enum bb_steady_state state;
};

struct bb_steady {
	struct bb_steady_config c;
	enum bb_steady_state state;
	bool shown, noted;
	int64_t at_ns, moved_ns;       /* of the last step; how long it decays or blends */
	struct bb_pose from, last;     /* where that began; shown last */
	int64_t note_ns;               /* the newest solution */
	struct bb_pose note;
	unsigned agreed;
};

void bb_steady_init(struct bb_steady *s, const struct bb_steady_config *c);
/* Every solution, oldest first: the eyes' pose at its mid-exposure. Returns false when it does not follow on the one
 * before. */
bool bb_steady_note(struct bb_steady *s, int64_t at_ns, const struct bb_pose *eyes);
/* The pose for a picture that is seen at at_ns, from the tracker's prediction for that time. */
struct bb_steady_pose bb_steady_step(struct bb_steady *s, const struct bb_track_pose *tracked, int64_t at_ns);

#endif
