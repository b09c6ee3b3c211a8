/*
 * render/gl/context.h: an offscreen OpenGL 3.3 core context without a window system. The library behind it is looked
 * for at run time, so that a machine with only one of them works. Both bring their own copy of the same dispatch
 * tables: a process uses one kind (1803 for the other). One thread at a time, which calls make_current before it draws.
 */
#ifndef BB_RENDER_GL_CONTEXT_H
#define BB_RENDER_GL_CONTEXT_H

#include "hal/status.h"
#include "render/gl/functions.h"

struct bb_gl_context;

struct bb_gl_kind {          /* what a kind of context fills in */
	const char *name;    /* "osmesa" */
	const char *library; /* "libOSMesa.so.8" */
	enum bb_status (*open)(struct bb_gl_context *c, struct bb_error *err);
	bool (*make_current)(struct bb_gl_context *c);
	bb_gl_function (*get)(void *context, const char *name);
	void (*close)(struct bb_gl_context *c); /* also after a failed open */
};

extern const struct bb_gl_kind bb_gl_osmesa, bb_gl_egl;

struct bb_gl_context {
	const struct bb_gl_kind *kind;
	void *library;
	void *session; /* the kind's own */
	struct bb_gl gl;
};

/* kind as in bb_renderer_gl_create. The context is current afterwards. */
BB_MUST_CHECK enum bb_status bb_gl_context_open(const char *kind, struct bb_gl_context *out, struct bb_error *err);
bool bb_gl_context_make_current(struct bb_gl_context *c);
void bb_gl_context_close(struct bb_gl_context *c); /* closed or zero is allowed */

/* For the kinds: a function of their library, 1802 when it is missing. */
BB_MUST_CHECK enum bb_status bb_gl_symbol(const struct bb_gl_context *c, const char *name, bb_gl_function *out,
					  struct bb_error *err);

#endif
