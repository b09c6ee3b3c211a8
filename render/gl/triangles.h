/*
 * render/gl/triangles.h: the meshes of a picture as the shader reads them: for each tile of the picture the triangles that
 * may be met there, in their order; for each of these its three edge planes through the eye, made in double; for all
 * triangles the colours of their corners. The shader keeps and sorts what a pixel's ray meets: the fragments of an
 * A-buffer. There is no near plane: what lies in front of the eye is seen. The context must be current.
 */
#ifndef BB_RENDER_GL_TRIANGLES_H
#define BB_RENDER_GL_TRIANGLES_H

#include "render/gl/functions.h"
#include "render/renderer_driver.h"

#define BB_GL_TILE_PIXELS 16

/* Buffers and their textures: edge planes and what belongs to them, corners' colours, tiles. */
enum bb_gl_list { BB_GL_PLANES, BB_GL_COLOURS, BB_GL_TILES, BB_GL_LISTS };

struct bb_gl_triangles {
	GLuint buffer[BB_GL_LISTS], texture[BB_GL_LISTS];
	int most; /* texels of such a texture */
	/* what they were made from */
	struct bb_mesh *meshes; /* [n_meshes] */
	size_t n_meshes;
	struct bb_vec3 eye, upper_left, lower_left, lower_right;
	uint32_t width, height;
	bool colours_sent, tiles_sent;
};

void bb_gl_triangles_init(struct bb_gl_triangles *t, const struct bb_gl *gl);
void bb_gl_triangles_release(struct bb_gl_triangles *t, const struct bb_gl *gl);
void bb_gl_triangles_forget(struct bb_gl_triangles *t);
/* Brings them up to date for a draw with meshes. 1702, 1814, 1816. */
BB_MUST_CHECK enum bb_status bb_gl_triangles_update(struct bb_gl_triangles *t, const struct bb_gl *gl,
						    const struct bb_draw *draw, uint32_t width, uint32_t height,
						    uint64_t *upload_bytes, struct bb_error *err);
/* Its textures to the units from `unit` on. */
void bb_gl_triangles_bind(const struct bb_gl_triangles *t, const struct bb_gl *gl, unsigned unit);

#endif
