/* render/bricks/errors_avx512.c: errors.h for processors with AVX-512 (its flags: see the Makefile). */
#ifdef __AVX512F__
#define NAME "avx512"
#define KERNEL bb_errors_avx512

#include "render/bricks/errors_kernel.inc"
#else
#include "render/bricks/errors.h"

const struct bb_errors_kernel bb_errors_avx512; /* not for this processor */
#endif
