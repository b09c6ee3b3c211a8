/* render/bricks/errors_portable.c: errors.h for any processor. */
#define NAME "portable"
#define KERNEL bb_errors_portable

#include "render/bricks/errors_kernel.inc"
