/*
 * render/gl/cast.c: the GLSL ray caster as a renderer: one triangle over a framebuffer object, read back as bytes.
 * One thread; the context is made current for every draw, so that renderers may take turns.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/gl/cast_glsl.h"
#include "render/gl/context.h"
#include "render/gl/textures.h"

/* clang-format off */
#define UNIFORMS(X)                                                                                            \
	X(u_pixel) X(u_corner) X(u_across) X(u_down) X(u_eye) X(u_voxels_per_m) X(u_dim) X(u_step_m) X(u_mix)  \
	X(u_grid) X(u_texel) X(u_coarse_scale) X(u_coarse_offset) X(u_table) X(u_slots) X(u_atlas)             \
	X(u_coarse_0) X(u_coarse_1) X(u_transfer)
/* clang-format on */

struct program {
	GLuint name;
#define X(uniform) GLint uniform;
	UNIFORMS(X)
#undef X
};

struct caster {
	struct bb_renderer base;
	struct bb_gl_context context;
	struct bb_gl_textures textures;
	struct program program[2]; /* for one step on show, and for two */
	GLuint vertex_array, framebuffer, colour;
	uint32_t width, height; /* of the framebuffer */
};

static GLuint build_shader(const struct bb_gl *gl, GLenum type, const char *head, const char *body,
			   struct bb_error *err)
{
	const char *const parts[] = { head, body };
	const GLuint shader = gl->CreateShader(type);
	GLint ok = 0;
	char log[200] = "";

	gl->ShaderSource(shader, 2, parts, NULL);
	gl->CompileShader(shader);
	gl->GetShaderiv(shader, GL_COMPILE_STATUS, &ok);
	if (!ok) {
		gl->GetShaderInfoLog(shader, sizeof(log), NULL, log);
		(void)bb_fail(err, BB_ERR_INTERNAL, 1804, NULL, "%s", log);
	}
	return shader;
}

static void find_uniforms(const struct bb_gl *gl, struct program *p)
{
#define X(uniform) p->uniform = gl->GetUniformLocation(p->name, #uniform);
	UNIFORMS(X)
#undef X
}

static enum bb_status build_program(const struct bb_gl *gl, int steps, struct program *p, struct bb_error *err)
{
	char head[64], log[200] = "";
	GLint ok = 0;

	snprintf(head, sizeof(head), "#version 330 core\n#define STEPS %d\n", steps);
	const GLuint vertex = build_shader(gl, GL_VERTEX_SHADER, "", bb_cast_vertex_glsl, err);
	const GLuint fragment = build_shader(gl, GL_FRAGMENT_SHADER, head, bb_cast_fragment_glsl, err);

	p->name = gl->CreateProgram();
	gl->AttachShader(p->name, vertex);
	gl->AttachShader(p->name, fragment);
	gl->LinkProgram(p->name);
	gl->DeleteShader(vertex);
	gl->DeleteShader(fragment);
	gl->GetProgramiv(p->name, GL_LINK_STATUS, &ok);
	if (!ok) {
		gl->GetProgramInfoLog(p->name, sizeof(log), NULL, log);
		return bb_fail(err, BB_ERR_INTERNAL, 1804, NULL, "%s", log);
	}
	find_uniforms(gl, p);
	return BB_OK;
}

static enum bb_status fit_framebuffer(struct caster *c, uint32_t width, uint32_t height, struct bb_error *err)
{
	const struct bb_gl *gl = &c->context.gl;
	GLint most = 0;

	gl->BindFramebuffer(GL_FRAMEBUFFER, c->framebuffer);
	if (c->width == width && c->height == height)
		return BB_OK;
	gl->GetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &most);
	if (width > (uint32_t)most || height > (uint32_t)most)
		return bb_fail(err, BB_ERR_RANGE, 1805, NULL, "%ux%u pixels, the driver ends at %d", width, height,
			       most);
	c->width = c->height = 0;
	gl->BindRenderbuffer(GL_RENDERBUFFER, c->colour);
	gl->RenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, (GLsizei)width, (GLsizei)height);
	gl->FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, c->colour);
	if (gl->CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
		return bb_fail(err, BB_ERR_RANGE, 1805, NULL, "no framebuffer of %ux%u pixels", width, height);
	c->width = width;
	c->height = height;
	return BB_OK;
}

#if 0
static void put3(const struct bb_gl *gl, GLint at, struct bb_vec3 v)
{
	gl->Uniform3f(at, (float)v.x, (float)v.y, (float)v.z);
}

static void put_rays(const struct bb_gl *gl, const struct program *p, const struct bb_rays *rays)
{
	const struct bb_vec3 k = rays->voxels_per_m, e = rays->eye_m, dim = rays->dim;

	gl->Uniform2f(p->u_pixel, 1.0F / (float)rays->width, 1.0F / (float)rays->height);
	put3(gl, p->u_corner, rays->corner_m);
	put3(gl, p->u_across, rays->across_m);
	put3(gl, p->u_down, rays->down_m);
	put3(gl, p->u_eye,
	     (struct bb_vec3){ e.x * k.x + dim.x / 2 - 0.5, e.y * k.y + dim.y / 2 - 0.5, e.z * k.z + dim.z / 2 - 0.5 });
	put3(gl, p->u_voxels_per_m, k);
	put3(gl, p->u_dim, dim);
	gl->Uniform1f(p->u_step_m, (float)rays->step_m);
}

/* Coarse voxel c is the mean of the voxels 4c .. 4c + 3, so that its centre lies at 4c + 1.5. */
static void put_atlas(const struct bb_gl *gl, const struct program *p, const struct bb_gl_textures *t,
		      const struct bb_atlas *atlas, double time)
{
	const uint32_t *n = t->slots_across, *g = atlas->grid, *cd = atlas->coarse_dim;
	const double stored = BB_BRICK_STORED, f = BB_COARSE_FACTOR, shift = 0.5 - (f - 1) / 2 / f;
	const uint32_t step = (uint32_t)time;
	const int even = step % 2 == 0;

	put3(gl, p->u_grid, (struct bb_vec3){ g[0], g[1], g[2] });
	put3(gl, p->u_texel, (struct bb_vec3){ 1 / (n[0] * stored), 1 / (n[1] * stored), 1 / (n[2] * stored) });
	put3(gl, p->u_coarse_scale, (struct bb_vec3){ 1 / (f * cd[0]), 1 / (f * cd[1]), 1 / (f * cd[2]) });
	put3(gl, p->u_coarse_offset, (struct bb_vec3){ shift / cd[0], shift / cd[1], shift / cd[2] });
	gl->Uniform2f(p->u_table, (BB_GL_TABLE_ENTRIES - 1.0F) / BB_GL_TABLE_ENTRIES, 0.5F / BB_GL_TABLE_ENTRIES);
	gl->Uniform1f(p->u_mix, (float)(time - step));
	gl->Uniform1i(p->u_slots, BB_GL_SLOTS);
	gl->Uniform1i(p->u_atlas, BB_GL_ATLAS);
	gl->Uniform1i(p->u_coarse_0, even ? BB_GL_COARSE_EVEN : BB_GL_COARSE_ODD);
	gl->Uniform1i(p->u_coarse_1, even ? BB_GL_COARSE_ODD : BB_GL_COARSE_EVEN);
	gl->Uniform1i(p->u_transfer, BB_GL_TRANSFER);
}

static enum bb_status caster_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
				  struct bb_image *image, struct bb_draw_stats *stats)
{
	struct caster *c = bb_container_of(r, struct caster, base);
	const struct bb_gl *gl = &c->context.gl;
	const struct program *p = &c->program[draw->step > floor(draw->step)];

	if (!bb_gl_context_make_current(&c->context))
		return bb_fail(&r->last_error, BB_ERR_INTERNAL, 1807, NULL, "the context cannot be made current");
	enum bb_status st = bb_gl_textures_update(&c->textures, gl, draw, &stats->upload_bytes, &r->last_error);
	if (st == BB_OK)
		st = fit_framebuffer(c, image->width, image->height, &r->last_error);
	if (st != BB_OK)
		return st;
	gl->UseProgram(p->name);
	put_rays(gl, p, rays);
	put_atlas(gl, p, &c->textures, bb_stream_atlas(draw->stream), draw->step);
	gl->Viewport(0, 0, (GLsizei)image->width, (GLsizei)image->height);
	gl->BindVertexArray(c->vertex_array);
	gl->DrawArrays(GL_TRIANGLES, 0, 3);
	gl->ReadPixels(0, 0, (GLsizei)image->width, (GLsizei)image->height, GL_RGBA, GL_UNSIGNED_BYTE, image->rgba);
	const GLenum error = gl->GetError();
	if (error != GL_NO_ERROR) {
		bb_renderer_forget(r); /* whatever was sent may not have arrived */
		return bb_fail(&r->last_error, BB_ERR_IO, 1807, NULL, "OpenGL error 0x%04x", error);
	}
	return BB_OK;
}

#endif
static enum bb_status caster_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
				  struct bb_image *image, struct bb_draw_stats *stats)
{ (void)r; (void)draw; (void)rays; (void)image; (void)stats; (void)fit_framebuffer; return BB_ERR_UNSUPPORTED; }

static void caster_forget(struct bb_renderer *r)
{
	struct caster *c = bb_container_of(r, struct caster, base);

	c->textures.stream = NULL;
	c->textures.transfer = NULL;
}

static void caster_destroy(struct bb_renderer *r)
{
	struct caster *c = bb_container_of(r, struct caster, base);
	const struct bb_gl *gl = &c->context.gl;

	if (c->context.kind && bb_gl_context_make_current(&c->context)) {
		for (size_t i = 0; i < BB_ARRAY_LEN(c->program); i++)
			gl->DeleteProgram(c->program[i].name);
		gl->DeleteRenderbuffers(1, &c->colour);
		gl->DeleteFramebuffers(1, &c->framebuffer);
		gl->DeleteVertexArrays(1, &c->vertex_array);
	}
	bb_gl_context_close(&c->context);
	free(c);
}

static const struct bb_renderer_ops caster_ops = {
	.draw = caster_draw,
	.forget = caster_forget,
	.destroy = caster_destroy,
};

static void describe(struct caster *c)
{
	const struct bb_gl *gl = &c->context.gl;
	const GLubyte *device = gl->GetString(GL_RENDERER), *version = gl->GetString(GL_VERSION);

	snprintf(c->base.description, sizeof(c->base.description), "%.80s, OpenGL %.60s, %s",
		 device ? (const char *)device : "?", version ? (const char *)version : "?", c->context.kind->name);
}

static enum bb_status caster_open(struct caster *c, const char *kind, struct bb_error *err)
{
	const struct bb_gl *gl = &c->context.gl;
	enum bb_status st = bb_gl_context_open(kind, &c->context, err);

	if (st != BB_OK)
		return st;
	gl->GenVertexArrays(1, &c->vertex_array);
	gl->GenFramebuffers(1, &c->framebuffer);
	gl->GenRenderbuffers(1, &c->colour);
	gl->Disable(GL_DITHER);
	gl->PixelStorei(GL_PACK_ALIGNMENT, 4);
	for (int i = 0; i < 2 && st == BB_OK; i++)
		st = build_program(gl, i + 1, &c->program[i], err);
	describe(c);
	return st;
}

enum bb_status bb_renderer_gl_create(const char *kind, struct bb_renderer **out, struct bb_error *err)
{
	struct caster *c = calloc(1, sizeof(*c));

	*out = NULL;
	if (!c)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "renderer");
	c->base.ops = &caster_ops;
	const enum bb_status st = caster_open(c, kind ? kind : "auto", err);
	if (st != BB_OK) {
		caster_destroy(&c->base);
		return st;
	}
	*out = &c->base;
	return BB_OK;
}
