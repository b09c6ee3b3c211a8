/*
 * render/gl/copy.h: the GL side of one layer: the atlas, the map, the transfer table, brought up to date before each
 * draw. The context must be current.
 */
#ifndef BB_RENDER_GL_COPY_H
#define BB_RENDER_GL_COPY_H

#include "render/gl/cells.h"
#include "render/gl/sender.h"
#include "render/renderer_driver.h"

/* Textures of a layer; units in this order. */
enum bb_gl_texture { BB_GL_ATLAS, BB_GL_PLACES_A, BB_GL_PLACES_B, BB_GL_SIGNS, BB_GL_TABLE, BB_GL_TABLES, BB_GL_TEXTURES };

struct bb_gl_copy {
	GLuint name[BB_GL_TEXTURES];
	/* what they were made from */
	const struct bb_atlas *atlas; /* NULL: of none yet */
	uint32_t n_slots, stored, grid[3];
	enum bb_brick_type type;
	struct bb_transfer transfer;
	double step_voxels;
	uint32_t levels;                 /* rows of the table; 0: none yet */
	uint64_t generation, map_generation;
	uint32_t n_shown;                /* maps */
	uint64_t *seen;                  /* [n_slots] generation sent; 0: none */
	struct bb_gl_cells sent, next;   /* as it has gone; as it is to go */
	bool any_sent;
	struct bb_gl_layout layout;
	struct bb_gl_sight sight;
	uint32_t voxels[3]; /* of the atlas texture */
	double texel[3];    /* 1 / voxels */
};

void bb_gl_copy_init(struct bb_gl_copy *c, const struct bb_gl *gl);
void bb_gl_copy_release(struct bb_gl_copy *c, const struct bb_gl *gl);
void bb_gl_copy_forget(struct bb_gl_copy *c);
/* Bring everything up to date for a draw; adds what was sent to *upload_bytes. 1702, 1805, 1812, 1813. */
BB_MUST_CHECK enum bb_status bb_gl_copy_update(struct bb_gl_copy *c, const struct bb_gl *gl, struct bb_gl_sender *sender,
					       const struct bb_layer *layer, const struct bb_draw *draw,
					       uint64_t *upload_bytes, struct bb_error *err);
/* Its textures to the units from `unit` on. */
void bb_gl_copy_bind(const struct bb_gl_copy *c, const struct bb_gl *gl, unsigned unit);

#endif
