/*
 * render/gl/context_egl.c: EGL on Mesa's surfaceless platform: no window system, no pbuffer. The only file that knows
 * EGL. Takes the first driver Mesa finds, a GPU's or llvmpipe.
 */
#include <stdlib.h>

#include <EGL/egl.h>
#include <EGL/eglext.h>

#include "render/gl/context.h"

#define EGL_SYMBOLS(X)                                 \
	X(PFNEGLGETPROCADDRESSPROC, eglGetProcAddress) \
	X(PFNEGLINITIALIZEPROC, eglInitialize)         \
	X(PFNEGLBINDAPIPROC, eglBindAPI)               \
	X(PFNEGLCHOOSECONFIGPROC, eglChooseConfig)     \
	X(PFNEGLCREATECONTEXTPROC, eglCreateContext)   \
	X(PFNEGLDESTROYCONTEXTPROC, eglDestroyContext) \
	X(PFNEGLMAKECURRENTPROC, eglMakeCurrent)       \
	X(PFNEGLGETERRORPROC, eglGetError)

struct egl {
#define X(type, name) type name;
	EGL_SYMBOLS(X)
#undef X
	EGLDisplay display;
	EGLContext context;
};

static enum bb_status load_symbols(const struct bb_gl_context *c, struct egl *e, struct bb_error *err)
{
	bb_gl_function f;

#define X(type, name)                                 \
	if (bb_gl_symbol(c, #name, &f, err) != BB_OK) \
		return BB_ERR_UNSUPPORTED;            \
	e->name = (type)f;
	EGL_SYMBOLS(X)
#undef X
	return BB_OK;
}

static enum bb_status fail(const struct egl *e, const char *what, struct bb_error *err)
{
	return bb_fail(err, BB_ERR_UNSUPPORTED, 1802, NULL, "EGL: %s (error 0x%04x)", what, (unsigned)e->eglGetError());
}

static enum bb_status open_display(struct egl *e, struct bb_error *err)
{
	const PFNEGLGETPLATFORMDISPLAYEXTPROC get =
		(PFNEGLGETPLATFORMDISPLAYEXTPROC)e->eglGetProcAddress("eglGetPlatformDisplayEXT");

	if (!get)
		return fail(e, "no eglGetPlatformDisplayEXT", err);
	e->display = get(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL);
	if (e->display == EGL_NO_DISPLAY)
		return fail(e, "no surfaceless display", err);
	if (!e->eglInitialize(e->display, NULL, NULL)) {
		e->display = EGL_NO_DISPLAY;
		return fail(e, "the surfaceless display does not start", err);
	}
	return BB_OK;
}

static enum bb_status open_context(struct egl *e, struct bb_error *err)
{
	static const EGLint config_attributes[] = { EGL_SURFACE_TYPE, 0, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT,
						    EGL_NONE };
	static const EGLint attributes[] = { EGL_CONTEXT_MAJOR_VERSION,
					     3,
					     EGL_CONTEXT_MINOR_VERSION,
					     3,
					     EGL_CONTEXT_OPENGL_PROFILE_MASK,
					     EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
					     EGL_NONE };
	EGLConfig config = NULL;
	EGLint n = 0;

	if (!e->eglBindAPI(EGL_OPENGL_API))
		return fail(e, "no desktop OpenGL", err);
	if (!e->eglChooseConfig(e->display, config_attributes, &config, 1, &n) || n < 1)
		return fail(e, "no configuration", err);
	e->context = e->eglCreateContext(e->display, config, EGL_NO_CONTEXT, attributes);
	if (e->context == EGL_NO_CONTEXT)
		return fail(e, "no 3.3 core context", err);
	return BB_OK;
}

static enum bb_status egl_open(struct bb_gl_context *c, struct bb_error *err)
{
	struct egl *e = calloc(1, sizeof(*e));

	if (!e)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "EGL context");
	c->session = e;
	enum bb_status st = load_symbols(c, e, err);
	if (st == BB_OK)
		st = open_display(e, err);
	return st == BB_OK ? open_context(e, err) : st;
}

static bool egl_make_current(struct bb_gl_context *c)
{
	const struct egl *e = c->session;

	return e->eglMakeCurrent(e->display, EGL_NO_SURFACE, EGL_NO_SURFACE, e->context) == EGL_TRUE;
}

static bb_gl_function egl_get(void *context, const char *name)
{
	const struct egl *e = ((struct bb_gl_context *)context)->session;

	return (bb_gl_function)e->eglGetProcAddress(name);
}

/* The display is one for the whole process, however often it was opened: it is left to the process's end, so that one
 * renderer's end does not pull it away from under another. */
static void egl_close(struct bb_gl_context *c)
{
	struct egl *e = c->session;

	if (e && e->context != EGL_NO_CONTEXT) {
		e->eglMakeCurrent(e->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
		e->eglDestroyContext(e->display, e->context);
	}
	free(e);
}

const struct bb_gl_kind bb_gl_egl = {
	.name = "egl",
	.library = "libEGL.so.1",
	.open = egl_open,
	.make_current = egl_make_current,
	.get = egl_get,
	.close = egl_close,
};
