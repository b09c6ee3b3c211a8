/*
 * render/gl/context.c: which kinds of context there are, in the order of preference, and what they share.
 */
#include "render/gl/context.h"

#include <dlfcn.h>
#include <string.h>

/* OSMesa first: it needs no device node, no display and no driver file beside itself. */
static const struct bb_gl_kind *const kinds[] = { &bb_gl_osmesa, &bb_gl_egl };

/* The dynamic linker knows which libraries this process has: no state of ours to keep. */
static bool in_use(const struct bb_gl_kind *kind)
{
	void *library = dlopen(kind->library, RTLD_LAZY | RTLD_LOCAL | RTLD_NOLOAD);

	if (library)
		dlclose(library);
	return library != NULL;
}

static const struct bb_gl_kind *other_in_use(const struct bb_gl_kind *kind)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(kinds); i++)
		if (kinds[i] != kind && in_use(kinds[i]))
			return kinds[i];
	return NULL;
}

/* Never unloaded: Mesa leaves threads and exit handlers behind that would run into unmapped code. */
static bool load(const struct bb_gl_kind *kind, struct bb_gl_context *c)
{
	*c = (struct bb_gl_context){ .kind = kind };
	c->library = dlopen(kind->library, RTLD_LAZY | RTLD_LOCAL | RTLD_NODELETE);
	return c->library != NULL;
}

static enum bb_status pick(const char *name, struct bb_gl_context *out, struct bb_error *err)
{
	const bool any = strcmp(name, "auto") == 0;
	bool known = any;

	for (size_t i = 0; i < BB_ARRAY_LEN(kinds); i++) {
		if (!any && strcmp(name, kinds[i]->name) != 0)
			continue;
		known = true;
		const struct bb_gl_kind *other = other_in_use(kinds[i]);
		if (other && any)
			continue;
		if (other)
			return bb_fail(err, BB_ERR_BUSY, 1803, NULL, "%s is asked for, %s is loaded", name,
				       other->name);
		if (load(kinds[i], out))
			return BB_OK;
	}
	if (!known)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL,
			       "no such OpenGL kind: \"%.40s\"; there are osmesa, egl, auto", name);
	return bb_fail(err, BB_ERR_UNSUPPORTED, 1801, NULL, "kind %s", name);
}

enum bb_status bb_gl_symbol(const struct bb_gl_context *c, const char *name, bb_gl_function *out, struct bb_error *err)
{
	void *symbol = dlsym(c->library, name);

	/* POSIX gives functions out as object pointers; copying the bytes is the way ISO C leaves open. */
	memcpy(out, &symbol, sizeof(symbol));
	if (!symbol)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1802, NULL, "%s has no %s", c->kind->library, name);
	return BB_OK;
}

static enum bb_status check_version(struct bb_gl_context *c, struct bb_error *err)
{
	GLint major = 0, minor = 0;

	c->gl.GetIntegerv(GL_MAJOR_VERSION, &major);
	c->gl.GetIntegerv(GL_MINOR_VERSION, &minor);
	if (major * 10 + minor < 33)
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1802, NULL, "%s gives OpenGL %d.%d", c->kind->name, major,
			       minor);
	return BB_OK;
}

enum bb_status bb_gl_context_open(const char *kind, struct bb_gl_context *out, struct bb_error *err)
{
	*out = (struct bb_gl_context){ 0 };
	enum bb_status st = pick(kind, out, err);
	if (st != BB_OK)
		return st;
	st = out->kind->open(out, err);
	if (st == BB_OK && !out->kind->make_current(out))
		st = bb_fail(err, BB_ERR_UNSUPPORTED, 1802, NULL, "%s: the context cannot be made current",
			     out->kind->name);
	if (st == BB_OK) {
		const char *missing = bb_gl_load(&out->gl, out->kind->get, out);
		st = missing ? bb_fail(err, BB_ERR_UNSUPPORTED, 1802, NULL, "%s has no %s", out->kind->name, missing)
			     : check_version(out, err);
	}
	if (st != BB_OK)
		bb_gl_context_close(out);
	return st;
}

bool bb_gl_context_make_current(struct bb_gl_context *c)
{
	return c->kind->make_current(c);
}

void bb_gl_context_close(struct bb_gl_context *c)
{
	if (!c || !c->kind)
		return;
	c->kind->close(c);
	dlclose(c->library); /* balances the count; the library stays */
	*c = (struct bb_gl_context){ 0 };
}
