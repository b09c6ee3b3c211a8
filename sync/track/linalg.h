/*
 * sync/track/linalg.h: the small dense algebra of tracking: symmetric eigenvectors up to 4 x 4, Cholesky of 6 x 6.
 * Pure, no allocation; sizes are fixed because every matrix here is.
 */
#ifndef BB_SYNC_TRACK_LINALG_H
#define BB_SYNC_TRACK_LINALG_H

#include "hal/geometry.h"

/* Eigenvalues, largest first, of the symmetric n x n matrix a (row-major, n <= 4, destroyed). The unit eigenvector of
 * values[k] is column k: vectors[i * n + k]. Its sign is fixed by making the largest component positive. */
void bb_sym_eigen(int n, double *a, double *values, double *vectors);

/* a = L L^T in place (lower half); false when not positive definite. Only the lower half is read. */
bool bb_chol6_factor(double a[6][6]);
void bb_chol6_solve(const double l[6][6], const double b[6], double x[6]);
void bb_chol6_inverse(const double l[6][6], double inverse[6][6]);

/* The shortest rotation that takes the direction a to b (unit vectors); opposite ones turn about any normal. */
struct bb_quat bb_quat_between(struct bb_vec3 a, struct bb_vec3 b);
/* The rotation vector (axis times angle, rad) and back. */
struct bb_quat bb_quat_exp(struct bb_vec3 v);
struct bb_vec3 bb_quat_log(struct bb_quat q);

#endif
