/*
 * render/gl/functions.c: fills the table of functions.h.
 */
#include "render/gl/functions.h"

const char *bb_gl_load(struct bb_gl *gl, bb_gl_function (*get)(void *ctx, const char *name), void *ctx)
{
#define X(type, name)                          \
	gl->name = (type)get(ctx, "gl" #name); \
	if (!gl->name)                         \
		return "gl" #name;
	BB_GL_FUNCTIONS(X)
#undef X
	return NULL;
}
