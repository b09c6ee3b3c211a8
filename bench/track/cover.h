/*
 * bench/track/cover.h: a room's coverage, voxel by voxel (sync/coverage/coverage.h over a grid, on all processors), and
 * what is told of it: table, JSON, CSV, pictures, page. The same bytes for any number of threads.
 */
#ifndef BB_BENCH_TRACK_COVER_H
#define BB_BENCH_TRACK_COVER_H

#include <stdio.h>

#include <jansson.h>

#include "sync/coverage/coverage.h"

#define BB_COVER_LEVELS_MAX 8

struct bb_cover_wishes {
	double voxel_m;
	bool boxed; /* else the room's own box */
	struct bb_vec3 min, max;
	double marker_m, least_px, noise_px; /* 0: as each camera has it */
	unsigned headings, threads;
};

struct bb_cover {
	const struct bb_room *room; /* borrowed */
	struct bb_coverage *model;
	struct bb_coverage_config config;
	struct bb_coverage_grid grid;
	struct bb_coverage_voxel *voxels; /* owned; NULL before bb_cover_run */
	size_t n_inside;
	unsigned threads;
	double run_s;
};

/* Defaults as for a simulated room: markers and range of sim/sim_camera.h, the viewer of sim/world.h. */
struct bb_coverage_config bb_cover_config(const struct bb_room *room, const struct bb_cover_wishes *w);
/* 1750: no cameras; 1751: no volume, or too many voxels; 1013: glasses far from the head; 1110: a lens. */
BB_MUST_CHECK enum bb_status bb_cover_begin(const struct bb_room *room, const struct bb_cover_wishes *w,
					    struct bb_cover *out, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_cover_run(struct bb_cover *c, struct bb_error *err);
void bb_cover_end(struct bb_cover *c);

const char *bb_cover_body_text(enum bb_coverage_body body); /* "none", "mean", "worst" */

struct bb_cover_summary {                  /* of one way to count the viewer, over all voxels inside */
	double share[BB_COVER_LEVELS_MAX]; /* seen by at least so many cameras */
	double placed;                     /* share that has a position at all, of all headings that count */
	double p10_n;                      /* all but the weakest decile are seen by as many or more */
	double p50_m, p90_m, worst_p90_m;  /* INFINITY: that many have no position */
	double weak_m; /* of the weakest decile: harmonic mean of the error, so that one without a position counts */
};
BB_MUST_CHECK enum bb_status bb_cover_summarise(const struct bb_cover *c, enum bb_coverage_body body,
						const unsigned *levels, size_t n_levels, struct bb_cover_summary *out);

void bb_cover_print(const struct bb_cover *c, const struct bb_cover_summary s[BB_COVERAGE_BODIES],
		    const unsigned *levels, size_t n_levels, FILE *f);
json_t *bb_cover_json(const struct bb_cover *c, const struct bb_cover_summary s[BB_COVERAGE_BODIES],
		      const unsigned *levels, size_t n_levels);
/* A line for each voxel inside; lengths in mm, "inf" where there is no position. */
BB_MUST_CHECK enum bb_status bb_cover_csv(const struct bb_cover *c, const char *path, struct bb_error *err);

/* Random points of the volume, noisy pixels, the tracker's own rays and triangulation: does the error come as foretold? */
struct bb_cover_trial {
	size_t n_points, n_samples, n_within; /* points whose ratio is within 10 % of 1 */
	size_t n_refused;                     /* samples that gave no position: in no ratio, but for points without any, 0 */
	double least_ratio, most_ratio, mean_ratio, rms_deviation; /* measured rms error / expected */
	double cameras_mean;
};
void bb_cover_trial(const struct bb_cover *c, size_t n_points, size_t n_samples, uint64_t seed,
		    struct bb_cover_trial *out);

#endif
