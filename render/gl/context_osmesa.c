/*
 * render/gl/context_osmesa.c: OSMesa, Mesa's renderer into plain memory. The only file that knows it.
 * Mesa 25.1 removed it upstream; then context_egl.c remains.
 */
#include "render/gl/context.h" /* first: gl.h, which osmesa.h brings, hides types of glcorearb.h */

#include <stdlib.h>

#include <GL/osmesa.h>

/* osmesa.h declares functions, not their types. */
typedef OSMesaContext (*create_fn)(const int *attributes, OSMesaContext share);
typedef void (*destroy_fn)(OSMesaContext context);
typedef GLboolean (*make_current_fn)(OSMesaContext context, void *buffer, GLenum type, GLsizei width, GLsizei height);
typedef OSMESAproc (*get_fn)(const char *name);

struct osmesa {
	OSMesaContext context;
	destroy_fn destroy;
	make_current_fn make_current;
	get_fn get;
	uint32_t pixel; /* a window is wanted; all drawing goes to framebuffer objects */
};

static enum bb_status osmesa_open(struct bb_gl_context *c, struct bb_error *err)
{
	static const int attributes[] = { OSMESA_FORMAT,
					  OSMESA_RGBA,
					  OSMESA_DEPTH_BITS,
					  0,
					  OSMESA_PROFILE,
					  OSMESA_CORE_PROFILE,
					  OSMESA_CONTEXT_MAJOR_VERSION,
					  3,
					  OSMESA_CONTEXT_MINOR_VERSION,
					  3,
					  0 };
	static const char *const names[] = { "OSMesaCreateContextAttribs", "OSMesaDestroyContext", "OSMesaMakeCurrent",
					     "OSMesaGetProcAddress" };
	bb_gl_function f[BB_ARRAY_LEN(names)];
	struct osmesa *o = calloc(1, sizeof(*o));

	if (!o)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "OSMesa context");
	c->session = o;
	for (size_t i = 0; i < BB_ARRAY_LEN(names); i++)
		if (bb_gl_symbol(c, names[i], &f[i], err) != BB_OK)
			return BB_ERR_UNSUPPORTED;
	o->destroy = (destroy_fn)f[1];
	o->make_current = (make_current_fn)f[2];
	o->get = (get_fn)f[3];
	o->context = ((create_fn)f[0])(attributes, NULL);
	if (!o->context)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1802, NULL, "OSMesa makes no 3.3 core context");
	return BB_OK;
}

static bool osmesa_make_current(struct bb_gl_context *c)
{
	struct osmesa *o = c->session;

	return o->make_current(o->context, &o->pixel, GL_UNSIGNED_BYTE, 1, 1) == GL_TRUE;
}

static bb_gl_function osmesa_get(void *context, const char *name)
{
	const struct osmesa *o = ((struct bb_gl_context *)context)->session;

	return (bb_gl_function)o->get(name);
}

static void osmesa_close(struct bb_gl_context *c)
{
	struct osmesa *o = c->session;

	if (o && o->context) {
		o->make_current(NULL, NULL, GL_UNSIGNED_BYTE, 0, 0);
		o->destroy(o->context);
	}
	free(o);
}

const struct bb_gl_kind bb_gl_osmesa = {
	.name = "osmesa",
	.library = "libOSMesa.so.8",
	.open = osmesa_open,
	.make_current = osmesa_make_current,
	.get = osmesa_get,
	.close = osmesa_close,
};
