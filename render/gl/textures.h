/*
 * render/gl/textures.h: the atlas, the slot map, the coarse volumes and the transfer table on the GL side, brought up
 * to date before each draw. The context must be current.
 */
#ifndef BB_RENDER_GL_TEXTURES_H
#define BB_RENDER_GL_TEXTURES_H

#include "render/gl/functions.h"
#include "render/renderer_driver.h"

#define BB_GL_TABLE_ENTRIES 8192

enum bb_gl_unit { BB_GL_SLOTS, BB_GL_ATLAS, BB_GL_COARSE_EVEN, BB_GL_COARSE_ODD, BB_GL_TRANSFER, BB_GL_UNITS };

struct bb_gl_textures {
	GLuint name[BB_GL_UNITS];
	/* what they were made from */
	const void *stream;
	const struct bb_transfer *transfer;
	double step_voxels;
	uint32_t coarse_step[2]; /* step held by the even and the odd texture */
	uint32_t slots_across[3];
	uint64_t generation;
	uint64_t *seen; /* [n_slots] generation uploaded */
	int32_t *map;   /* [grid cells][2] as uploaded */
	bool map_valid;
	int max_3d;
};

void bb_gl_textures_init(struct bb_gl_textures *t, const struct bb_gl *gl);
void bb_gl_textures_release(struct bb_gl_textures *t, const struct bb_gl *gl);
/* Bring everything up to date for a draw; adds what was sent to *upload_bytes. */
BB_MUST_CHECK enum bb_status bb_gl_textures_update(struct bb_gl_textures *t, const struct bb_gl *gl,
						   const struct bb_draw *draw, uint64_t *upload_bytes,
						   struct bb_error *err);

#endif
