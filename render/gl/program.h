/*
 * render/gl/program.h: the caster's shaders, built when a draw first needs them and kept: one for each combination of
 * layers, of what they are, and of what else is to be drawn. The context must be current.
 */
#ifndef BB_RENDER_GL_PROGRAM_H
#define BB_RENDER_GL_PROGRAM_H

#include "render/gl/functions.h"
#include "render/renderer_driver.h"

/* clang-format off */
#define BB_GL_LAYER_UNIFORMS(X)                                                                                  \
	X(u_corner) X(u_across) X(u_down) X(u_eye) X(u_voxels_per_m) X(u_dim) X(u_step_m) X(u_mix) X(u_grid)    \
	X(u_texel) X(u_brick) X(u_from) X(u_per) X(u_size) X(u_map) X(u_atlas) X(u_table)
/* clang-format on */

struct bb_gl_program {
	uint32_t key; /* what it is for; 0: none */
	uint64_t used;
	GLuint name;
	GLint u_pixel;
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

/* The one for a draw. 1804: it does not build. Valid until the next call. */
BB_MUST_CHECK enum bb_status bb_gl_program_for(struct bb_gl_programs *p, const struct bb_gl *gl,
					       const struct bb_draw *draw, const struct bb_gl_program **out,
					       struct bb_error *err);
void bb_gl_programs_release(struct bb_gl_programs *p, const struct bb_gl *gl);

#endif
