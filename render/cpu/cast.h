/*
 * render/cpu/cast.h: what the native ray caster prepares for its kernels, one for each instruction set. Kernels are the
 * same text (cast_kernel.inc) compiled for portable C, AVX2 and AVX-512 and chosen at run time.
 */
#ifndef BB_RENDER_CPU_CAST_H
#define BB_RENDER_CPU_CAST_H

#include "render/renderer_driver.h"

#define BB_CAST_TILE 64       /* pixels across and down that one thread takes at a time */
#define BB_CAST_RAYS 4        /* go together: 2 x 2 pixels */
#define BB_CAST_SCALE 1024.0F /* so that an opacity of 6e-8 is still a normal half */
#define BB_CAST_PIECES 32
#define BB_CAST_LEVELS 20
#define BB_CAST_LEAP 8 /* blocks at most that a ray leaps over at once, to either side */

/* A cell at the time on show. */
struct bb_cast_cell {
	int32_t slot[2]; /* BB_ATLAS_FLAT: all of it has the value */
	float value[2];
	uint8_t up[2];
	uint8_t merge; /* the 2^merge cells around it, per axis, are the same brick, or as flat */
	bool whole;    /* nothing in those is empty */
};

/* What is where in one volume at the time on show; kept between pictures and brought up to date (cast_space.c). */
struct bb_cast_space {
	struct bb_cast_cell *cell; /* [grid z][y][x] */
	/* Blocks, of 8 voxels or what is left of a cell, [z][y][x]: 0: something can be seen; n: nothing, nor in the n
	 * - 1 blocks around it on each side. */
	uint8_t *empty;
	uint8_t *clear, *spare[2]; /* whether nothing can be seen in a block; space to work in */
	float *wall[3];            /* [n_blocks + 1]: where blocks begin; far out at the ends */
	uint32_t n_blocks[3];
	size_t n_cells, n_all; /* blocks */
	uint32_t up_most;
	uint16_t visible[4097]; /* the next 4096th of the data's range, from this one on, in which something can be seen
				 */
	/* What all this was made from: */
	struct bb_atlas atlas;
	uint64_t *seen[2]; /* [cells]: generation of the slot */
	bool made, skipping;
};

/* A transfer function for the kernels; kept until it is another one (cast_table.c). */
struct bb_cast_table {
	/* [up][n + 1]: premultiplied r, g, b and opacity of one step's length, times BB_CAST_SCALE, as halves; red in
	 * the lowest 16 bits. The one behind the last is nothing. */
	uint64_t *entry;
	size_t n, n_levels;
	float shown[2]; /* entries shown[0] .. shown[1] - 1 hold all that can be seen, on any level */
	/* [up]: colour (not premultiplied) and opacity as BB_CAST_PIECES straight pieces, where that is as good: at x
	 * pieces it is from + by * x. */
	struct bb_cast_pieces {
		float from[4][BB_CAST_PIECES], by[4][BB_CAST_PIECES];
	} * pieces;
	bool smooth; /* it is, on all levels */
	struct bb_transfer transfer;
	double step_voxels;
};

struct bb_cast { /* of one picture; constant while it is drawn */
	const struct bb_rays *rays;
	struct bb_image *image;
	const struct bb_atlas *atlas;
	const struct bb_cast_space *space;
	const struct bb_cast_table *table;
	bool by_level;  /* longer steps in coarser bricks */
	float per_edge; /* 1 / edge */
	double unit;         /* samples of coarse bricks stay at numbers that their level takes: multiples of this */
	double eye[3];       /* corner coordinates */
	/* A point p of corner coordinates is seen at x / z, y / z of the picture's width and height: (x, y, z) = screen *
	 * (p, 1); z > 0 in front of the eye. */
	double screen[3][4];
	float opaque;   /* transmittance that ends a ray; below 0: none does */
	const uint32_t
		*order; /* NULL: packets of neighbours; pixels, BB_CAST_RAYS to a packet, to be drawn in this order */
};

struct bb_cast_counts {
	uint64_t rays, samples;
};

/* Draws BB_CAST_TILE^2 pixels. */
typedef void bb_cast_tile_fn(const struct bb_cast *c, uint32_t tile, struct bb_cast_counts *counts);
bb_cast_tile_fn bb_cast_tile_portable, bb_cast_tile_avx2, bb_cast_tile_avx512;

static inline uint32_t bb_cast_tiles_across(const struct bb_image *image)
{
	return (image->width + BB_CAST_TILE - 1) / BB_CAST_TILE;
}

/* False: no memory. skipping: false calls everything visible. */
BB_MUST_CHECK bool bb_cast_space_update(struct bb_cast_space *s, const struct bb_atlas *atlas,
					const struct bb_transfer *tf, bool tf_changed, bool skipping, unsigned threads);
void bb_cast_space_release(struct bb_cast_space *s);

/* n_levels: of bricks that have steps of their own. */
BB_MUST_CHECK bool bb_cast_table_update(struct bb_cast_table *t, const struct bb_transfer *tf, double step_voxels,
					size_t n_levels, bool *changed);
void bb_cast_table_release(struct bb_cast_table *t);

#endif
