/*
 * bench/solver/cost.h: what a set of frames costs the solver: N cameras along the top edges of a room, bodies that move in
 * it, clutter on every sensor. Nothing hides a marker: every camera that has a body in its field sees all of it, which
 * is the most there is to do. Times are processor time of this machine, one thread; work is counted and the same everywhere.
 */
#ifndef BB_BENCH_SOLVER_COST_H
#define BB_BENCH_SOLVER_COST_H

#include <stdio.h>

#include <jansson.h>

#include "hal/room.h"
#include "sync/track/tracker.h"

#define BB_COST_POINTS_MAX 32

struct bb_cost_config {
	const char *room;   /* cameras are like its first; as many as its own stand where its own do */
	size_t n_cameras, n_bodies, n_clutter; /* clutter: stray blobs of each frame */
	size_t n_sets, n_cold;                 /* timed warm sets; fresh trackers timed on their first set */
	uint64_t seed;
};

struct bb_cost {
	size_t n_cameras, n_bodies, n_clutter;
	double period_us;                          /* of the cameras */
	double median_us, p99_us, most_us;         /* of a warm set: frames taken in and solved */
	double cold_median_us, cold_most_us;       /* of a tracker's first set, every body unknown */
	double blobs;                              /* mean of a frame */
	double solved;                             /* share of bodies solved in warm sets */
	double cold_solved;                        /* and in first sets */
	uint64_t floods, wrong;                    /* sets with a flooded camera; poses off by more than 5 mm */
	struct bb_track_work work, cold_work;      /* the most of any set */
};

struct bb_cost_table {
	const char *room;
	uint64_t seed;
	size_t n_by_cameras, n_by_clutter;
	struct bb_cost usual, by_cameras[BB_COST_POINTS_MAX], by_clutter[BB_COST_POINTS_MAX];
};

/* 1720: the room has no cameras; 1721: more than 72 cameras, 8 bodies or 100000 blobs. */
BB_MUST_CHECK enum bb_status bb_cost_measure(const struct bb_cost_config *config, struct bb_cost *out,
					     struct bb_error *err);
/* n bodies of 3 to 6 markers, any two distances of any of them apart by a millimetre or more. */
void bb_cost_bodies(struct bb_body *bodies, size_t n);
void bb_cost_print(const struct bb_cost_table *t, FILE *f);
json_t *bb_cost_json(const struct bb_cost_table *t);
BB_MUST_CHECK enum bb_status bb_cost_plot(const struct bb_cost_table *t, const char *path, struct bb_error *err);

#endif
