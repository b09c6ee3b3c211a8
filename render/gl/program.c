#include "render/gl/program.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "render/gl/cast_glsl.h"
#include "render/gl/cells.h"

/* ---- what a draw needs ---- */

#define KEY_MESHES 1u
#define KEY_BY_LEVEL 2u
#define KEY_TWO_STEPS 1u
#define KEY_SPHERICAL 2u

static uint32_t layer_key(uint32_t key, size_t k)
{
	return key >> (5 + 2 * k) & 3;
}

static uint32_t layers_of(uint32_t key)
{
	return key >> 2 & 7;
}

static uint32_t key_of(const struct bb_draw *draw)
{
	uint32_t key = (uint32_t)draw->n_layers << 2 | (draw->n_meshes ? KEY_MESHES : 0) |
		       (draw->steps_by_level ? KEY_BY_LEVEL : 0);

	for (size_t k = 0; k < draw->n_layers; k++) {
		const struct bb_atlas *a = draw->layers[k].atlas;
		key |= ((a->n_shown > 1 ? KEY_TWO_STEPS : 0) | (a->kind == BB_BRICK_SPHERICAL ? KEY_SPHERICAL : 0))
		       << (5 + 2 * k);
	}
	return key;
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

static void add_defines(struct text *t, uint32_t key)
{
	char line[160];

	snprintf(line, sizeof(line), "#version 330 core\n#define TABLE %d\n#define LAYERS %u\n#define MESHES %d\n#define BY_LEVEL %d\n",
		 BB_GL_TABLE_ENTRIES, layers_of(key), (key & KEY_MESHES) != 0, (key & KEY_BY_LEVEL) != 0);
	add(t, line, 0);
	for (size_t k = 0; k < layers_of(key); k++) {
		snprintf(line, sizeof(line), "#define STEPS@ %d\n#define SPHERICAL@ %d\n",
			 layer_key(key, k) & KEY_TWO_STEPS ? 2 : 1, (layer_key(key, k) & KEY_SPHERICAL) != 0);
		add(t, line, k);
	}
}

static void write_shader(struct text *t, uint32_t key)
{
	const size_t n = layers_of(key);

	add_defines(t, key);
	add(t, bb_cast_common_glsl, 0);
	add_all(t, bb_cast_layer_glsl, n);
	add(t, bb_cast_alone_glsl, 0);
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

	p->u_pixel = gl->GetUniformLocation(p->name, "u_pixel");
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

enum bb_status bb_gl_program_for(struct bb_gl_programs *p, const struct bb_gl *gl, const struct bb_draw *draw,
				 const struct bb_gl_program **out, struct bb_error *err)
{
	const uint32_t key = key_of(draw);
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
