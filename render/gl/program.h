/*
 * render/gl/program.h: the caster's shaders, built when a draw first needs them and kept: one for each combination of
 * layers, of what they are, and of what else is to be drawn. The context must be current.
 */
#ifndef BB_RENDER_GL_PROGRAM_H
#define BB_RENDER_GL_PROGRAM_H

#include "render/gl/functions.h"
#include "render/renderer_driver.h"

/* What a draw needs, in a word: never 0. */
#define BB_GL_KEY_MESHES 1u
#define BB_GL_KEY_BY_LEVEL 2u
#define BB_GL_KEY_THREE 4u                            /* one look at the map serves three samples */
#define BB_GL_KEY_LAYERS(n) ((uint32_t)(n) << 3)
#define BB_GL_KEY_LAYER(k, bits) ((uint32_t)(bits) << (6 + 3 * (k))) /* of layer k: */
#define BB_GL_KEY_TWO_STEPS 1u
#define BB_GL_KEY_SPHERICAL 2u
#define BB_GL_KEY_FLATS 4u

/* clang-format off */
#define BB_GL_UNIFORMS(X)                                                                                        \
	X(u_pixel) X(u_room_corner) X(u_room_across) X(u_room_down) X(u_planes) X(u_colours) X(u_tiles)         \
	X(u_tiles_across)
#define BB_GL_LAYER_UNIFORMS(X)                                                                                  \
	X(u_corner) X(u_across) X(u_down) X(u_eye) X(u_voxels_per_m) X(u_dim) X(u_step_m) X(u_mix) X(u_per_row) X(u_grid)    \
	X(u_texel) X(u_per_cells) X(u_brick) X(u_from) X(u_per) X(u_size) X(u_places_a) X(u_places_b) X(u_signs) X(u_atlas)   \
	X(u_table)
/* clang-format on */

struct bb_gl_program {
	uint32_t key; /* 0: none */
	uint64_t used;
	GLuint name;
#define X(uniform) GLint uniform;
	BB_GL_UNIFORMS(X)
#undef X
	struct bb_gl_layer_uniforms {
#define X(uniform) GLint uniform;
		BB_GL_LAYER_UNIFORMS(X)
#undef X
	} layer[BB_LAYERS_MOST];
};

#define BB_GL_PROGRAMS 16

struct bb_gl_programs {
	struct bb_gl_program program[BB_GL_PROGRAMS];
	uint64_t uses;
};

/* 1804: it does not build. Valid until the next call. */
BB_MUST_CHECK enum bb_status bb_gl_program_for(struct bb_gl_programs *p, const struct bb_gl *gl, uint32_t key,
					       const struct bb_gl_program **out, struct bb_error *err);
void bb_gl_programs_release(struct bb_gl_programs *p, const struct bb_gl *gl);

#endif
