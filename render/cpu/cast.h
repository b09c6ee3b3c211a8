/*
 * render/cpu/cast.h: what the native ray caster prepares for its kernels, one for each instruction set. Kernels are the
 * same text (cast_kernel.h) compiled for portable C, AVX2 and AVX-512 and chosen at run time.
 */
#ifndef BB_RENDER_CPU_CAST_H
#define BB_RENDER_CPU_CAST_H

#include "render/renderer_driver.h"

#define BB_CAST_TABLE 8192 /* entries of the transfer function: its steepest slope is 1/200 of the range or less */
#define BB_CAST_PACKET 16  /* rays that go together: 4 x 4 pixels */
#define BB_CAST_SIDE 4
#define BB_CAST_SCALE 1024.0F /* so that an opacity of 6e-8 is still a normal half */

/* A step of a time on show: its bricks, or the coarse copy of a brick that is not there. */
struct bb_cast_step {
	const int32_t *slot;    /* [grid z][y][x]; -1: coarse */
	const uint16_t *coarse; /* [z][y][x] */
};

struct bb_cast { /* of one picture; constant while it is drawn */
	const struct bb_rays *rays;
	struct bb_image *image;
	uint32_t grid[3];
	float most[3];          /* dim - 1 */
	const uint16_t *bricks; /* [slot][18][18][18] */
	const uint8_t *empty;   /* [grid z][y][x]: nothing to be seen at this time */
	uint32_t coarse_dim[3];
	float coarse_most[3];
	size_t n_steps; /* 1: the time falls on a step; 2: between two */
	struct bb_cast_step step[2];
	float mix; /* of the second */
	/* Premultiplied r, g, b and opacity of one step's length, times BB_CAST_SCALE, as halves; red in the lowest 16
	 * bits. */
	const uint64_t *table;
};

struct bb_cast_counts {
	uint64_t rays, samples;
};

/* Draws the packets of one row of packets: pixels of rows BB_CAST_SIDE * row and below. */
typedef void bb_cast_row_fn(const struct bb_cast *c, uint32_t row, struct bb_cast_counts *counts);
bb_cast_row_fn bb_cast_row_portable, bb_cast_row_avx2, bb_cast_row_avx512;

#endif
