/*
 * render/atlas.h: bricks in memory, and which of them stands for which part of a volume at the time on show: the
 * language between streaming and drawing. A renderer takes it as it is and needs to know nothing of where it came from.
 *
 * Coordinates. A volume of dim voxels is the box 0..dim in corner coordinates: voxel i lies from i to i + 1, its centre
 * at i + 0.5. Cell c (one leaf brick's room) is the part from c * edge to (c + 1) * edge of each axis. A brick `up` levels
 * above the leaves has voxels 2^up as wide and stands for the cells (c >> up); a point p of corner coordinates lies in it
 * at p / 2^up - (c >> up) * edge + pad - 0.5, where its stored values have whole numbers from 0 to stored - 1. Bricks have
 * true neighbours around them (pad >= 1) and repeat the nearest voxel where the volume ends: nothing needs to be clamped.
 *
 * Spherical grids: axis 0 is r, 1 theta (from the pole), 2 phi. The volume is the part of a ball that the extent says, in
 * its cube; theta = 0 is the cube's +y, phi = 0 its +x, growing towards +z. Where phi goes all the way around, the padding
 * goes around with it.
 */
#ifndef BB_RENDER_ATLAS_H
#define BB_RENDER_ATLAS_H

#include "hal/geometry.h"
#include "render/bricks/format.h"

/* Where a volume stands in the room: a point p of volume space (metres, centred) is corner coordinate
 * (p / size + 0.5) * dim on each axis. Spherical: all edges are the ball's diameter. */
struct bb_placement {
	struct bb_pose pose;   /* volume space to room */
	struct bb_vec3 size_m; /* edge lengths in the room */
};

#define BB_ATLAS_FLAT (-1) /* in the place of a slot: every voxel of the cell has `value` */
#define BB_ATLAS_BLOCK 8

struct bb_atlas_cell {
	int32_t slot;
	uint32_t up;
	float value; /* 0..1 */
};

/* What values can be met while sampling a block of 8^3 voxels of a brick (those around it included): parts of the data's
 * range in 65535ths, rounded outwards. */
struct bb_atlas_range {
	uint16_t least, most;
};

struct bb_atlas {
	uint32_t dim[3], n_steps;
	uint32_t edge, pad, stored; /* stored = edge + 2 pad */
	enum bb_brick_type type;
	enum bb_brick_grid kind;
	double extent[6]; /* as in format.h */
	float scale;         /* a value in the atlas times this: 0..1 of the data's range; 1 for f16 and f32 */
	float least, parts;  /* f32: a value v of the file is (v - least) * parts in the atlas */
	uint32_t grid[3];    /* cells per axis */

	uint32_t n_slots;
	size_t slot_bytes;
	const uint8_t *bricks; /* slot s at s * slot_bytes, x fastest; a plane, a row and 64 bytes more than all of them */
	uint32_t blocks;       /* of a brick, per axis: edge / 8 rounded up */
	const struct bb_atlas_range *range; /* [slot][blocks z][y][x] */
	uint64_t generation;                /* grows whenever a slot's content changes */
	const uint64_t *slot_generation;    /* [slot] */

	double time;      /* in steps; what the maps are for */
	uint32_t n_shown; /* 1: the time falls on a step; 2: it lies between two */
	float mix;        /* share of the second */
	const struct bb_atlas_cell *map[2]; /* [cells z][y][x]; one that is not used equals the first */
	uint64_t map_generation;            /* grows whenever a map changes */
};

/* What a file's header says of its bricks; the rest stays as it is. */
void bb_atlas_describe(struct bb_atlas *atlas, const struct bb_bricks_header *h);
size_t bb_atlas_slack_bytes(const struct bb_atlas *atlas); /* behind the last slot */
/*
 * A brick has come from its file: its ranges are measured, f32 values become parts of the data's range, and values that
 * are not finite or lie outside that range, as a forged file has them or one that was built for a range that does not hold,
 * become the nearest that do not (NaN: the least), so that no caster needs to look again. Returns how many there were. Any
 * thread, nothing else is touched.
 */
size_t bb_atlas_accept(const struct bb_atlas *atlas, uint8_t *brick, struct bb_atlas_range *out);

#endif
