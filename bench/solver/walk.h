/*
 * bench/solver/walk.h: the tracker over a long walk against the truth: accuracy, labels, sigmas, and how soon it finds the
 * viewer again after all lenses were covered.
 *
 * Frames of accuracy are those in which four or more cameras truly see at least three markers and the tracker solved
 * the body; errors are of the unpredicted pose at mid-exposure, of the markers' centroid. The interval of a share is
 * share +- 1.96 sqrt(share (1 - share) / n_eff), n_eff = n / (1 + 2 sum of rho(l)): rho is the autocorrelation of "this
 * frame was inside", summed over pairs of lags while a pair is positive (Geyer's initial positive sequence).
 */
#ifndef BB_BENCH_SOLVER_WALK_H
#define BB_BENCH_SOLVER_WALK_H

#include <stdio.h>

#include <jansson.h>

#include "bench/solver/studio.h"

#define BB_CHI2_3_95 7.815 /* 95 % point, 3 degrees of freedom */

struct bb_walk_config {
	const char *room, *path;
	int fidelity;
	size_t n_frames; /* as many walks as that takes, each with a seed of its own */
	uint64_t seed;
	double dark_s;   /* all lenses are covered for so long every ten seconds; 0: never */
};

struct bb_walk_share { /* of squared Mahalanobis distances below the 95 % point */
	double share, low, high, n_eff;
};

struct bb_walk {
	size_t n_frames, n_possible, n_solved, n_good; /* possible: two cameras see three markers, and no lens is covered */
	size_t n_labels, n_wrong_labels, n_wrong_poses; /* poses off by more than 5 mm or 5 degrees */
	size_t n_losses, most_frames_back;              /* frames from sight to the next solution, the first is 1 */
	double rms_mm, worst_mm, rms_deg, worst_deg;
	double sigma_mm, sigma_deg, residual_px, sigma_px; /* rms as stated; of blobs */
	struct bb_walk_share position, angle;
};

BB_MUST_CHECK enum bb_status bb_walk_measure(const struct bb_walk_config *config, struct bb_walk *out,
					     struct bb_error *err);
/* Squared Mahalanobis distance of d under a packed covariance (xx xy xz yy yz zz). */
double bb_walk_distance2(const double c[6], struct bb_vec3 d);
/* The rotation vector that turns a into b, degrees. */
struct bb_vec3 bb_walk_turn_deg(struct bb_quat a, struct bb_quat b);
/* Share of true values among n, with its interval; n_eff as above. */
struct bb_walk_share bb_walk_share_of(const bool *inside, size_t n);
void bb_walk_print(const struct bb_walk *w, FILE *f);
json_t *bb_walk_json(const struct bb_walk *w);

#endif
