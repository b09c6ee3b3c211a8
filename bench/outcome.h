/*
 * bench/outcome.h: what is left when a run is over: devices, incidents, faults, pictures and facts gathered into the
 * result, and the result written into its folder.
 */
#ifndef BB_BENCH_OUTCOME_H
#define BB_BENCH_OUTCOME_H

#include "bench/facility.h"
#include "bench/loop/loop.h"

struct bb_outcome_sources { /* all borrowed */
	const struct bb_run_options *options;
	const struct bb_rig *rig;
	const struct bb_eventlog *events;
	const struct sim_world *world;
	struct bb_watch *watch;
	const struct bb_facility *facility;
	const struct bb_frame_loop *loop;
	const struct bb_pictures *pictures;
	const struct bb_renderer *renderer;
	const struct bb_bricks *bricks;
	bool judged; /* pictures have something to be compared with */
	const struct bb_clock *clk;
	int64_t bring_up_ns;
};

/* Fills everything of *r but the verdicts; what memory is missing for is left out. */
void bb_outcome_gather(const struct bb_outcome_sources *s, struct bb_run_result *r);
/* All files; dir NULL writes nothing. */
BB_MUST_CHECK enum bb_status bb_outcome_write(const struct bb_run_result *r, const char *dir, struct bb_error *err);

#endif
