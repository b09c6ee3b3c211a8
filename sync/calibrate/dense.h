/*
 * sync/calibrate/dense.h: the one dense system of a calibration, by LAPACK: cameras times 11 unknowns, 264 for 24 cameras.
 * The only file that calls LAPACKE; its BLAS is the serial one, so that the same machine gives the same bits.
 */
#ifndef BB_SYNC_CALIBRATE_DENSE_H
#define BB_SYNC_CALIBRATE_DENSE_H

#include "hal/base.h"

/* Solves a x = b, a symmetric positive definite, n x n row-major, only its lower half read, destroyed; x replaces b.
 * false: a is not positive definite. */
bool bb_dense_solve(double *a, double *b, size_t n);

#endif
