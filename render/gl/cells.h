/*
 * render/gl/cells.h: the map as the shader reads it: where the bricks of the one or two maps on show lie, how far a ray
 * may go before it must ask again, and which parts of a cell can show anything under a transfer function. Arithmetic only.
 */
#ifndef BB_RENDER_GL_CELLS_H
#define BB_RENDER_GL_CELLS_H

#include "render/atlas.h"
#include "render/transfer.h"

#define BB_GL_TABLE_ENTRIES 8192 /* of a transfer function: its steepest slope is 1/200 of the range or less */
#define BB_GL_SHADES 4096

/* How many of the SHADES parts of the data's range before a part can show something; parts overlap by an entry of the
 * table, so that what is skipped is what every entry that could be met says nothing of. */
struct bb_gl_sight {
	uint16_t before[BB_GL_SHADES + 1];
};
void bb_gl_sight_make(const struct bb_transfer *tf, struct bb_gl_sight *out);

/* Where slots lie in the texture: along z first, so that slots that follow each other are one block of memory. */
struct bb_gl_layout {
	uint32_t across[3];
};
/* False: they do not fit into a texture of most^3. */
bool bb_gl_layout_make(uint32_t n_slots, uint32_t stored, size_t voxel_bytes, uint32_t most, struct bb_gl_layout *out);
void bb_gl_layout_at(const struct bb_gl_layout *l, uint32_t slot, uint32_t at[3]);

/* Parts of a cell along an edge that are seen or skipped each on its own: 1 to 4. */
uint32_t bb_gl_parts(uint32_t edge);

/* Where a brick is, for one map: position p of the volume is at + p * shrink * texel in the texture. A cell of one value:
 * shrink is 0 and at[0] the value. */
struct bb_gl_place {
	float at[3], shrink;
};

/* What is to be seen of a cell: bits 0..3: the aligned cube of 2^bits cells around it is all alike; 4..8: levels above the
 * leaves, of the finer of two bricks; the others as below. */
struct bb_gl_sign {
	uint32_t word, unused, parts[2]; /* bit x + 4 y + 16 z: that part can show something */
};
#define BB_GL_SIGN_SEEN 0x200u   /* it can show something */
#define BB_GL_SIGN_PARTLY 0x400u /* only some of its parts can */
#define BB_GL_SIGN_FLAT 0x800u   /* it has one value */

struct bb_gl_cells { /* [cells z][y][x], the caller's */
	struct bb_gl_place *place[2];
	struct bb_gl_sign *sign;
	bool any_flat; /* a cell of one value can be seen */
};
/* texel: 1 / voxels of the texture along each axis. */
void bb_gl_cells_fill(const struct bb_atlas *atlas, const struct bb_gl_layout *l, const double texel[3],
		      const struct bb_gl_sight *sight, struct bb_gl_cells *out);

#endif
