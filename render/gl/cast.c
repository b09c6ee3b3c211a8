/*
 * render/gl/cast.c: the GLSL ray caster as a renderer: one triangle over a framebuffer object, read back as bytes.
 * One thread; the context is made current for every draw, so that renderers may take turns.
 */
#include <stdio.h>
#include <stdlib.h>

#include "render/gl/context.h"
#include "render/gl/copy.h"
#include "render/gl/program.h"
#include "render/gl/triangles.h"

struct caster {
	struct bb_renderer base;
	struct bb_gl_context context;
	struct bb_gl_sender sender;
	struct bb_gl_programs programs;
	struct bb_gl_copy copy[BB_LAYERS_MOST];
	struct bb_gl_triangles triangles;
	GLuint vertex_array, framebuffer, colour;
	uint32_t width, height; /* of the framebuffer */
};

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

/* ---- uniforms ---- */

static void put3(const struct bb_gl *gl, GLint at, struct bb_vec3 v)
{
	gl->Uniform3f(at, (float)v.x, (float)v.y, (float)v.z);
}

static void put_rays(const struct bb_gl *gl, const struct bb_gl_layer_uniforms *u, const struct bb_rays *rays)
{
	const struct bb_vec3 k = rays->voxels_per_m, e = rays->eye_m, dim = rays->dim;

	put3(gl, u->u_corner, rays->corner_m);
	put3(gl, u->u_across, rays->across_m);
	put3(gl, u->u_down, rays->down_m);
	put3(gl, u->u_eye, (struct bb_vec3){ e.x * k.x + dim.x / 2, e.y * k.y + dim.y / 2, e.z * k.z + dim.z / 2 });
	put3(gl, u->u_voxels_per_m, k);
	put3(gl, u->u_dim, dim);
	gl->Uniform1f(u->u_step_m, (float)rays->step_m);
}

static void put_atlas(const struct bb_gl *gl, const struct bb_gl_layer_uniforms *u, const struct bb_gl_copy *c,
		      bool by_level, GLint unit)
{
	const struct bb_atlas *atlas = c->atlas;
	struct bb_spherical ball;

	put3(gl, u->u_grid, (struct bb_vec3){ atlas->grid[0], atlas->grid[1], atlas->grid[2] });
	put3(gl, u->u_texel, (struct bb_vec3){ c->texel[0], c->texel[1], c->texel[2] });
	put3(gl, u->u_per_cells,
	     (struct bb_vec3){ 1.0 / atlas->grid[0] / atlas->edge, 1.0 / atlas->grid[1] / atlas->edge,
			       1.0 / atlas->grid[2] / atlas->edge });
	gl->Uniform2f(u->u_brick, (float)atlas->edge, (float)bb_gl_parts(atlas->edge));
	gl->Uniform1f(u->u_mix, atlas->mix);
	gl->Uniform1f(u->u_per_row, 1 / (float)c->levels);
	gl->Uniform1i(u->u_atlas, unit + BB_GL_ATLAS);
	gl->Uniform1i(u->u_places_a, unit + BB_GL_PLACES_A);
	gl->Uniform1i(u->u_places_b, unit + BB_GL_PLACES_B);
	gl->Uniform1i(u->u_signs, unit + BB_GL_SIGNS);
	gl->Uniform1i(u->u_table, unit + (by_level ? BB_GL_TABLES : BB_GL_TABLE));
	if (atlas->kind != BB_BRICK_SPHERICAL)
		return;
	bb_spherical_of(atlas->dim, atlas->extent, &ball);
	put3(gl, u->u_from, (struct bb_vec3){ ball.from[0], ball.from[1], ball.from[2] });
	put3(gl, u->u_per, (struct bb_vec3){ 1 / ball.per_voxel[0], 1 / ball.per_voxel[1], 1 / ball.per_voxel[2] });
	put3(gl, u->u_size, (struct bb_vec3){ ball.dim[0], ball.dim[1], ball.dim[2] });
}

static void put_triangles(const struct bb_gl *gl, const struct bb_gl_program *p, const struct bb_view *view, uint32_t width,
			  GLint unit)
{
	const struct bb_corners *c = &view->corners;

	put3(gl, p->u_room_corner, bb_vec3_sub(c->upper_left, view->eye));
	put3(gl, p->u_room_across, bb_vec3_sub(c->lower_right, c->lower_left));
	put3(gl, p->u_room_down, bb_vec3_sub(c->lower_left, c->upper_left));
	gl->Uniform1i(p->u_planes, unit + BB_GL_PLANES);
	gl->Uniform1i(p->u_colours, unit + BB_GL_COLOURS);
	gl->Uniform1i(p->u_tiles, unit + BB_GL_TILES);
	gl->Uniform1i(p->u_tiles_across, (GLint)((width + BB_GL_TILE_PIXELS - 1) / BB_GL_TILE_PIXELS));
}

/* ---- drawing ---- */

static void swap_copies(struct bb_gl_copy *a, struct bb_gl_copy *b)
{
	const struct bb_gl_copy was = *a;

	*a = *b;
	*b = was;
}

/* Layer k uses copy k; when the layers' order has changed, so does that of the copies, and nothing is sent again. */
static enum bb_status update(struct caster *c, const struct bb_draw *draw, uint64_t *upload_bytes)
{
	enum bb_status st = BB_OK;

	for (size_t k = 0; k < draw->n_layers && st == BB_OK; k++) {
		for (size_t j = k + 1; j < BB_LAYERS_MOST && c->copy[k].atlas != draw->layers[k].atlas; j++)
			if (c->copy[j].atlas == draw->layers[k].atlas)
				swap_copies(&c->copy[k], &c->copy[j]);
		st = bb_gl_copy_update(&c->copy[k], &c->context.gl, &c->sender, &draw->layers[k], draw, upload_bytes,
				       &c->base.last_error);
	}
	return st;
}

/* Three samples share a look at the map when the outer ones lie no farther from the middle one than bricks know. */
static bool three_at_once(const struct bb_draw *draw, const struct bb_rays *rays)
{
	const struct bb_vec3 k = rays->voxels_per_m;
	const double finest = k.x > k.y ? (k.x > k.z ? k.x : k.z) : (k.y > k.z ? k.y : k.z);

	return draw->n_layers == 1 && !draw->n_meshes && !draw->steps_by_level &&
	       draw->layers[0].atlas->kind != BB_BRICK_SPHERICAL && rays->step_m * finest <= 0.5 + 1e-6;
}

static uint32_t key_of(const struct caster *c, const struct bb_draw *draw, const struct bb_rays *rays)
{
	uint32_t key = BB_GL_KEY_LAYERS(draw->n_layers) | (draw->n_meshes ? BB_GL_KEY_MESHES : 0) |
		       (draw->steps_by_level ? BB_GL_KEY_BY_LEVEL : 0) | (three_at_once(draw, rays) ? BB_GL_KEY_THREE : 0);

	for (size_t k = 0; k < draw->n_layers; k++) {
		const struct bb_atlas *a = draw->layers[k].atlas;
		key |= BB_GL_KEY_LAYER(k, (a->n_shown > 1 ? BB_GL_KEY_TWO_STEPS : 0) |
						  (a->kind == BB_BRICK_SPHERICAL ? BB_GL_KEY_SPHERICAL : 0) |
						  (c->copy[k].sent.any_flat ? BB_GL_KEY_FLATS : 0));
	}
	return key;
}

static void put(const struct caster *c, const struct bb_gl_program *p, const struct bb_draw *draw,
		const struct bb_rays *rays)
{
	const struct bb_gl *gl = &c->context.gl;

	gl->UseProgram(p->name);
	gl->Uniform2f(p->u_pixel, 1.0F / (float)rays->width, 1.0F / (float)rays->height);
	for (size_t k = 0; k < draw->n_layers; k++) {
		put_rays(gl, &p->layer[k], &rays[k]);
		put_atlas(gl, &p->layer[k], &c->copy[k], draw->steps_by_level, (GLint)k * BB_GL_TEXTURES);
		bb_gl_copy_bind(&c->copy[k], gl, (unsigned)k * BB_GL_TEXTURES);
	}
	if (!draw->n_meshes)
		return;
	put_triangles(gl, p, draw->view, rays->width, (GLint)draw->n_layers * BB_GL_TEXTURES);
	bb_gl_triangles_bind(&c->triangles, gl, (unsigned)draw->n_layers * BB_GL_TEXTURES);
}

static enum bb_status caster_draw(struct bb_renderer *r, const struct bb_draw *draw, const struct bb_rays *rays,
				  struct bb_image *image, struct bb_draw_stats *stats)
{
	struct caster *c = bb_container_of(r, struct caster, base);
	const struct bb_gl *gl = &c->context.gl;
	const struct bb_gl_program *p = NULL;

	if (!bb_gl_context_make_current(&c->context))
		return bb_fail(&r->last_error, BB_ERR_INTERNAL, 1807, NULL, "the context cannot be made current");
	enum bb_status st = update(c, draw, &stats->upload_bytes);
	if (st == BB_OK && draw->n_meshes)
		st = bb_gl_triangles_update(&c->triangles, gl, draw, image->width, image->height, &stats->upload_bytes,
					    &r->last_error);
	if (st == BB_OK)
		st = bb_gl_program_for(&c->programs, gl, key_of(c, draw, rays), &p, &r->last_error);
	if (st == BB_OK)
		st = fit_framebuffer(c, image->width, image->height, &r->last_error);
	if (st != BB_OK)
		return st;
	put(c, p, draw, rays);
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

static void caster_forget(struct bb_renderer *r)
{
	struct caster *c = bb_container_of(r, struct caster, base);

	for (size_t k = 0; k < BB_LAYERS_MOST; k++)
		bb_gl_copy_forget(&c->copy[k]);
	bb_gl_triangles_forget(&c->triangles);
}

static void caster_destroy(struct bb_renderer *r)
{
	struct caster *c = bb_container_of(r, struct caster, base);
	const struct bb_gl *gl = &c->context.gl;

	if (c->context.kind && bb_gl_context_make_current(&c->context)) {
		bb_gl_programs_release(&c->programs, gl);
		for (size_t k = 0; k < BB_LAYERS_MOST; k++)
			bb_gl_copy_release(&c->copy[k], gl);
		bb_gl_triangles_release(&c->triangles, gl);
		bb_gl_sender_release(&c->sender, gl);
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
	const enum bb_status st = bb_gl_context_open(kind, &c->context, err);

	if (st != BB_OK)
		return st;
	gl->GenVertexArrays(1, &c->vertex_array);
	gl->GenFramebuffers(1, &c->framebuffer);
	gl->GenRenderbuffers(1, &c->colour);
	gl->Disable(GL_DITHER);
	gl->PixelStorei(GL_PACK_ALIGNMENT, 4);
	gl->PixelStorei(GL_UNPACK_ALIGNMENT, 1);
	bb_gl_sender_init(&c->sender, gl);
	bb_gl_triangles_init(&c->triangles, gl);
	for (size_t k = 0; k < BB_LAYERS_MOST; k++)
		bb_gl_copy_init(&c->copy[k], gl);
	describe(c);
	return BB_OK;
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
