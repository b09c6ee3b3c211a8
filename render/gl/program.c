#include "render/gl/program.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/gl/cast_glsl.h"
#include "render/gl/cells.h"
#include "render/gl/triangles.h"

static uint32_t layers_of(uint32_t key)
{
	return key >> 3 & 7;
}

/* ---- text ---- */

struct text {
	char *at;
	size_t n, most;
	bool short_of_memory;
};

static void add_char(struct text *t, char c)
{
	if (t->n + 1 >= t->most) {
		const size_t most = t->most ? t->most * 2 : 8192;
		char *more = realloc(t->at, most);
		if (!more) {
			t->short_of_memory = true;
			return;
		}
		t->at = more;
		t->most = most;
	}
	t->at[t->n++] = c;
	t->at[t->n] = 0;
}

/* "@" becomes the layer's number. */
static void add(struct text *t, const char *piece, size_t layer)
{
	for (; *piece && !t->short_of_memory; piece++)
		add_char(t, *piece == '@' ? (char)('0' + layer) : *piece);
}

static void add_all(struct text *t, const char *piece, size_t n_layers)
{
	for (size_t k = 0; k < n_layers; k++)
		add(t, piece, k);
}

static void add_number(struct text *t, const char *name, uint32_t value)
{
	char line[80];

	snprintf(line, sizeof(line), "#define %s %u\n", name, value);
	add(t, line, 0);
}

static void add_defines(struct text *t, uint32_t key)
{
	add(t, "#version 330 core\n", 0);
	add_number(t, "TABLE", BB_GL_TABLE_ENTRIES);
	add_number(t, "SEEN", BB_GL_SIGN_SEEN);
	add_number(t, "PARTLY", BB_GL_SIGN_PARTLY);
	add_number(t, "FLAT", BB_GL_SIGN_FLAT);
	add_number(t, "FRAGMENTS", BB_MESH_FRAGMENTS_MOST);
	add_number(t, "TILE", BB_GL_TILE_PIXELS);
	add_number(t, "LAYERS", layers_of(key));
	add_number(t, "MESHES", (key & BB_GL_KEY_MESHES) != 0);
	add_number(t, "BY_LEVEL", (key & BB_GL_KEY_BY_LEVEL) != 0);
	add_number(t, "TAKES", key & BB_GL_KEY_THREE ? 3 : 1);
	for (uint32_t k = 0; k < layers_of(key); k++) {
		char name[16];
		snprintf(name, sizeof(name), "STEPS%u", k);
		add_number(t, name, key & BB_GL_KEY_LAYER(k, BB_GL_KEY_TWO_STEPS) ? 2 : 1);
		snprintf(name, sizeof(name), "SPHERICAL%u", k);
		add_number(t, name, (key & BB_GL_KEY_LAYER(k, BB_GL_KEY_SPHERICAL)) != 0);
		snprintf(name, sizeof(name), "FLATS%u", k);
		add_number(t, name, (key & BB_GL_KEY_LAYER(k, BB_GL_KEY_FLATS)) != 0);
	}
}

/* "#define NEAREST min(next0, min(next1, ... FAR))" */
static void add_least(struct text *t, const char *name, const char *of, size_t n_layers)
{
	add(t, "#define ", 0);
	add(t, name, 0);
	add(t, " ", 0);
	add_all(t, of, n_layers);
	add(t, "FAR", 0);
	add_all(t, ")", n_layers);
	add(t, "\n", 0);
}

static void write_shader(struct text *t, uint32_t key)
{
	const size_t n = layers_of(key);

	add_defines(t, key);
	add(t, bb_cast_common_glsl, 0);
	add_all(t, bb_cast_layer_glsl, n);
	if (n == 1 && !(key & BB_GL_KEY_MESHES)) {
		add(t, bb_cast_alone_glsl, 0);
		return;
	}
	if (key & BB_GL_KEY_MESHES)
		add(t, bb_cast_meshes_glsl, 0);
	add_all(t, bb_cast_turn_glsl, n);
	add_least(t, "NEAREST", "min(next@, ", n);
	add_least(t, "BEYOND", "min(beyond@, ", n);
	add(t, bb_cast_merge_glsl, 0);
	add_all(t, bb_cast_begin_glsl, n);
	add(t, bb_cast_rounds_glsl, 0);
	add_all(t, bb_cast_ready_glsl, n);
	add(t, bb_cast_samples_glsl, 0);
	add_all(t, bb_cast_turns_glsl, n);
	add(t, bb_cast_surfaces_glsl, 0);
}

/* ---- building ---- */

static GLuint build_shader(const struct bb_gl *gl, GLenum type, const char *text, struct bb_error *err)
{
	const GLuint shader = gl->CreateShader(type);
	GLint ok = 0;
	char log[200] = "";

	gl->ShaderSource(shader, 1, &text, NULL);
	gl->CompileShader(shader);
	gl->GetShaderiv(shader, GL_COMPILE_STATUS, &ok);
	if (!ok) {
		gl->GetShaderInfoLog(shader, sizeof(log), NULL, log);
		(void)bb_fail(err, BB_ERR_INTERNAL, 1804, NULL, "%s", log);
	}
	return shader;
}

static enum bb_status link_program(const struct bb_gl *gl, const char *fragment_text, GLuint *out, struct bb_error *err)
{
	const GLuint vertex = build_shader(gl, GL_VERTEX_SHADER, bb_cast_vertex_glsl, err);
	const GLuint fragment = build_shader(gl, GL_FRAGMENT_SHADER, fragment_text, err);
	char log[200] = "";
	GLint ok = 0;

	*out = gl->CreateProgram();
	gl->AttachShader(*out, vertex);
	gl->AttachShader(*out, fragment);
	gl->LinkProgram(*out);
	gl->DeleteShader(vertex);
	gl->DeleteShader(fragment);
	gl->GetProgramiv(*out, GL_LINK_STATUS, &ok);
	if (ok)
		return BB_OK;
	gl->GetProgramInfoLog(*out, sizeof(log), NULL, log);
	gl->DeleteProgram(*out);
	if (err && err->number == 1804) /* the compiler has said it better */
		return BB_ERR_INTERNAL;
	return bb_fail(err, BB_ERR_INTERNAL, 1804, NULL, "%s", log);
}

static void find_uniforms(const struct bb_gl *gl, struct bb_gl_program *p)
{
	char name[32];

#define X(uniform) p->uniform = gl->GetUniformLocation(p->name, #uniform);
	BB_GL_UNIFORMS(X)
#undef X
	for (unsigned k = 0; k < layers_of(p->key); k++) {
#define X(uniform)                                          \
	snprintf(name, sizeof(name), #uniform "%u", k);     \
	p->layer[k].uniform = gl->GetUniformLocation(p->name, name);
		BB_GL_LAYER_UNIFORMS(X)
#undef X
	}
}

static enum bb_status build(struct bb_gl_program *p, const struct bb_gl *gl, uint32_t key, struct bb_error *err)
{
	struct text text = { 0 };
	enum bb_status st = BB_ERR_NOMEM;

	if (p->key)
		gl->DeleteProgram(p->name);
	*p = (struct bb_gl_program){ 0 };
	write_shader(&text, key);
	if (text.short_of_memory)
		(void)bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a shader");
	else
		st = link_program(gl, text.at, &p->name, err);
	free(text.at);
	if (st != BB_OK)
		return st;
	p->key = key;
	find_uniforms(gl, p);
	return BB_OK;
}

enum bb_status bb_gl_program_for(struct bb_gl_programs *p, const struct bb_gl *gl, uint32_t key,
				 const struct bb_gl_program **out, struct bb_error *err)
{
	struct bb_gl_program *found = NULL, *oldest = &p->program[0];

	for (size_t i = 0; i < BB_GL_PROGRAMS; i++) {
		if (p->program[i].key == key)
			found = &p->program[i];
		if (p->program[i].used < oldest->used)
			oldest = &p->program[i];
	}
	if (!found) {
		const enum bb_status st = build(oldest, gl, key, err);
		if (st != BB_OK)
			return st;
		found = oldest;
	}
	found->used = ++p->uses;
	*out = found;
	return BB_OK;
}

void bb_gl_programs_release(struct bb_gl_programs *p, const struct bb_gl *gl)
{
	for (size_t i = 0; i < BB_GL_PROGRAMS; i++)
		if (p->program[i].key)
			gl->DeleteProgram(p->program[i].name);
	*p = (struct bb_gl_programs){ 0 };
}
