/*
 * bench/guardian.h: what is left when a run ends as it should not. Signals that ask it to end (INT, TERM, HUP, PIPE) set a
 * number which the frame loop looks at every frame: it opens the shutters and reports what there is. For real devices
 * the run is a process of its own, and its parent, which holds no device, waits: if the run dies (SEGV, ABRT, KILL, out
 * of memory), the parent opens the room's shutters itself.
 */
#ifndef BB_BENCH_GUARDIAN_H
#define BB_BENCH_GUARDIAN_H

#include <signal.h>

#include "hal/room.h"

/* From now on the first such signal sets what is returned, the second of the same one does what it always does. */
const volatile sig_atomic_t *bb_guardian_signals(void);

/* Does a room of this have shutters that go on when this process is gone? */
bool bb_guardian_wanted(const struct bb_room *room);
/*
 * Forks. In the child: true, and the run goes on. In the parent: returns false when the child has ended; *code_out is
 * its exit code, or 3 when it died, after the shutters were opened; err says so (1692). With no process to spare: true.
 */
bool bb_guardian_fork(const struct bb_room *room, int *code_out, struct bb_error *err);

#endif
