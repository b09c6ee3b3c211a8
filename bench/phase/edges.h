/*
 * bench/phase/edges.h: edges somebody measured, folded into one stereo cycle. The file is CSV with the header
 * t_ns,track,eye,event: stamps on one clock, any order; eye is left, right or NA. `run --out` writes one (edges.csv); a
 * logic analyser's export becomes one with a line of awk. Tracks a plan knows: vblank:WALL (event flip), shutter:WALL and
 * glasses (event open), strobe:CAMERA (event mid); others are drawn as well.
 */
#ifndef BB_BENCH_PHASE_EDGES_H
#define BB_BENCH_PHASE_EDGES_H

#include <stdio.h>

#include "sync/plan.h"

#define BB_PHASE_GROUPS 128
#define BB_PHASE_EDGES_MOST 2000000
#define BB_PHASE_TEXT 48

struct bb_phase_group { /* all edges of one track, eye and event */
	char track[BB_PHASE_TEXT], event[16];
	enum bb_eye eye;
	size_t n;
	double mean_us;        /* 0 .. 2 T after the left eye's edge; without an eye 0 .. T after any edge */
	double least_us, most_us; /* about the mean: the earliest and the latest */
	double planned_us;     /* where the plan has it; NAN: it does not say */
};

struct bb_phase_edges {
	double cycle_us;       /* as measured */
	char reference[BB_PHASE_TEXT]; /* the track whose left edges begin a cycle */
	double reference_us;   /* ... and where the plan has them */
	size_t n_groups;
	struct bb_phase_group group[BB_PHASE_GROUPS];
};

/* 1613: not such a list, with the line; 1614: no left edges of a wall or of the glasses to begin cycles with. */
BB_MUST_CHECK enum bb_status bb_phase_edges_read(const char *path, const struct bb_room *room,
                                                 const struct bb_plan *plan, struct bb_phase_edges *out,
                                                 struct bb_error *err);
/* Spread over so much of the cycle that a mean says nothing. */
bool bb_phase_loose(const struct bb_phase_edges *e, const struct bb_phase_group *g);
double bb_phase_off_us(const struct bb_phase_edges *e, const struct bb_phase_group *g); /* measured less planned */
void bb_phase_edges_print(const struct bb_phase_edges *e, FILE *out);
struct json_t *bb_phase_edges_json(const struct bb_phase_edges *e);

#endif
