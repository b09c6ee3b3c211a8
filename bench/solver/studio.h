/*
 * bench/solver/studio.h: a room's cameras and a viewer who walks, without the rest of a run: the simulated cameras on a
 * virtual clock, time maps and a tracker, stepped one exposure at a time, with the world's truth beside.
 *
 * Everything is owned by the studio. One thread. The same for the same configuration.
 */
#ifndef BB_BENCH_SOLVER_STUDIO_H
#define BB_BENCH_SOLVER_STUDIO_H

#include "bench/rig.h"
#include "sim/world.h"
#include "sync/track/tracker.h"

struct bb_studio_config {
	const char *room, *path; /* files; the head walks the path from 0 s */
	int fidelity;            /* of the cameras */
	uint64_t seed;
};

struct bb_studio {
	struct bb_room *room;
	struct bb_tracker *tracker;
	struct sim_world *world;
	double blob_sigma_px;
	int64_t duration_ns, period_ns; /* of the path; of the cameras */
	int64_t start_ns;               /* of the path, on the clock; before it time maps settle */
	int64_t mid_ns;                 /* host time of the newest exposure seen */
	int64_t solve_ns;               /* what the newest bb_studio_step took to solve, by the stopwatch */
	struct bb_studio_private *own;
};

/* 1720: the room has no cameras or bodies, or its cameras differ in rate; else as the loaders and bb_rig_open. */
BB_MUST_CHECK enum bb_status bb_studio_open(const struct bb_studio_config *config, struct bb_studio *out,
					   struct bb_error *err);
/* The same in a room that is loaded already, and may have been changed; the studio owns it from here, whatever comes. */
BB_MUST_CHECK enum bb_status bb_studio_open_room(const struct bb_studio_config *config, struct bb_room *room,
						 struct bb_studio *out, struct bb_error *err);
void bb_studio_close(struct bb_studio *s);
/* One exposure of all cameras, solved. false when the path is over. */
bool bb_studio_step(struct bb_studio *s, struct bb_track_solution *solution, bool *solved);
/* Hangs something over every lens, or takes it away: from the next exposure on. */
void bb_studio_cover(struct bb_studio *s, bool on);
/* Truth about body 0: cameras that see at least three of its markers; where a camera would show a marker, noise and
 * what stands before it apart (false: not in its picture); the centroid of its markers. */
size_t bb_studio_seeing(const struct bb_studio *s, int64_t at_ns);
bool bb_studio_marker_px(const struct bb_studio *s, size_t camera, size_t marker, int64_t at_ns, double px[2],
			bool *visible);
struct bb_vec3 bb_studio_centroid(const struct bb_studio *s, int64_t at_ns);

#endif
