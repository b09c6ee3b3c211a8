/* render/bricks/errors_avx2.c: errors.h for processors with AVX2 (its flags: see the Makefile). */
#ifdef __AVX2__
#define NAME "avx2"
#define KERNEL bb_errors_avx2

#include "render/bricks/errors_kernel.inc"
#else
#include "render/bricks/errors.h"

const struct bb_errors_kernel bb_errors_avx2; /* not for this processor */
#endif
