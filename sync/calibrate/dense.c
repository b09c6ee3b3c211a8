/* sync/calibrate/dense.c: see dense.h. */
#include "sync/calibrate/dense.h"

#include <lapacke.h>

bool bb_dense_solve(double *a, double *b, size_t n)
{
	/* Row-major lower is column-major upper: nothing needs turning round. */
	return LAPACKE_dposv_work(LAPACK_COL_MAJOR, 'U', (lapack_int)n, 1, a, (lapack_int)n, b, (lapack_int)n) == 0;
}
