/*
 * tests/bench_gl.c: how fast the GLSL caster is beside a plain one: the same picture from one dense 3-D texture without
 * bricks, on the same driver, in turns. Each time comes with the PSNR of that very picture against the reference.
 * bench_gl [EDGE] [ROUNDS]; edges of 8, 16 and 32 when none is given.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "hal/clock.h"
#include "render/gl/context.h"
#include "render/renderer.h"
#include "tests/cover.h"

#ifndef VOXELS
#define VOXELS 256
#endif
#ifndef PIXELS
#define PIXELS 512
#endif
#define STEP 0.5
#define TABLE 8192
#define ROUNDS_MOST 99

static void must(enum bb_status st, const struct bb_error *err)
{
	if (st == BB_OK)
		return;
	fprintf(stderr, "bench_gl: %s\n", err->text);
	exit(st == BB_ERR_UNSUPPORTED ? 77 : 1);
}

/* ---- the scene: shells and smooth noise; a filled and a sparse transfer function ---- */

static float grain(int32_t x, int32_t y, int32_t z)
{
	uint32_t h = (uint32_t)x * 73856093U ^ (uint32_t)y * 19349663U ^ (uint32_t)z * 83492791U;

	h = (h ^ h >> 15) * 2246822519U;
	h = (h ^ h >> 13) * 3266489917U;
	return (float)((h ^ h >> 16) & 0xFFFFFF) / 16777216;
}

static float smooth_noise(float x, float y, float z)
{
	const float p[3] = { x, y, z };
	int32_t at[3];
	float t[3], sum = 0;

	for (int a = 0; a < 3; a++) {
		at[a] = (int32_t)floorf(p[a]);
		t[a] = p[a] - (float)at[a];
		t[a] = t[a] * t[a] * (3 - 2 * t[a]);
	}
	for (int k = 0; k < 8; k++)
		sum += grain(at[0] + (k & 1), at[1] + (k >> 1 & 1), at[2] + (k >> 2)) * (k & 1 ? t[0] : 1 - t[0]) *
		       (k & 2 ? t[1] : 1 - t[1]) * (k & 4 ? t[2] : 1 - t[2]);
	return sum;
}

static float value_at(int x, int y, int z)
{
	const float half = VOXELS / 2.0F, a = ((float)x + 0.5F) / half - 1, b = ((float)y + 0.5F) / half - 1,
		    c = ((float)z + 0.5F) / half - 1, r = sqrtf(a * a + b * b + c * c) + 1e-6F;
	const float towards[3] = { a / r, b / r, (0.8F * a + 0.6F * c) / r };
	float sum = 0.25F * smooth_noise((float)x * 0.06F, (float)y * 0.06F, (float)z * 0.06F);

	for (int k = 0; k < 3; k++) {
		const float off = (r - 0.15F - 0.25F * (float)k) / (0.02F + 0.01F * (float)k);
		sum += 0.75F * expf(-0.5F * off * off) * (0.3F + 0.7F * fmaxf(0, towards[k]));
	}
	return sum < 1 ? sum : 1;
}

static struct bb_volume *make_volume(void)
{
	struct bb_volume *v = calloc(1, sizeof(*v));
	float *out = malloc(sizeof(*out) * VOXELS * VOXELS * VOXELS);

	if (!v || !out)
		abort();
	*v = (struct bb_volume){ .name = "shells", .dim = { VOXELS, VOXELS, VOXELS }, .n_steps = 1,
				 .spacing_mm = { 1, 1, 1 }, .most = 1, .values = out };
	for (int z = 0; z < VOXELS; z++)
		for (int y = 0; y < VOXELS; y++)
			for (int x = 0; x < VOXELS; x++)
				*out++ = value_at(x, y, z);
	return v;
}

static const struct bb_transfer filled = {
	.n = 2, .point = { { 0, 0, 0.4, 1, 0 }, { 1, 1, 0.8, 0, 0.012 } }, .least_visible = 0
};
static const struct bb_transfer sparse = {
	.n = 3, .point = { { 0, 0, 0.4, 1, 0 }, { 0.55, 0.55, 0.62, 0.45, 0 }, { 1, 1, 0.8, 0, 0.09 } }, .least_visible = 0.55
};

/* 2.7 m away, the volume is a cube of a metre in the origin; 30 degrees from side to side. */
static struct bb_view make_view(void)
{
	const struct bb_vec3 to = bb_vec3_unit((struct bb_vec3){ 1, 0.6, 0.4 }, (struct bb_vec3){ 1, 0, 0 });
	const struct bb_vec3 eye = bb_vec3_scale(to, 700.0 / VOXELS), across_unit = { -to.y, to.x, 0 };
	const struct bb_vec3 across = bb_vec3_unit(across_unit, eye), up = bb_vec3_cross(to, across);
	const double half = 700.0 / VOXELS * tan(15 * 3.14159265358979 / 180) * PIXELS / 512;
	const struct bb_vec3 right = bb_vec3_scale(across, half), top = bb_vec3_scale(up, half);
	const struct bb_vec3 low = bb_vec3_scale(top, -1), left = bb_vec3_scale(right, -1);
	const struct bb_corners c = { .lower_left = bb_vec3_add(low, left), .lower_right = bb_vec3_add(low, right),
				      .upper_left = bb_vec3_add(top, left) };

	return bb_view_make(&c, eye, eye, 0.05, 50);
}

/* ---- the plain caster ---- */

static const char plain_vertex[] =
	"#version 330 core\n"
	"void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }\n";

static const char plain_fragment[] =
	"#version 330 core\n"
	"uniform vec3 eye, corner, across, down;\n" /* voxels */
	"uniform float step, n_voxels, n_pixels;\n"
	"uniform sampler3D volume;\n"
	"uniform sampler1D table;\n"
	"out vec4 colour;\n"
	"void main()\n"
	"{\n"
	"	vec2 share = gl_FragCoord.xy / n_pixels;\n"
	"	vec3 d = normalize(corner + share.x * across + share.y * down);\n"
	"	vec3 a = -eye / d, b = (n_voxels - eye) / d, near = min(a, b), far = max(a, b);\n"
	"	float enter = max(max(near.x, near.y), max(near.z, 0.0)), leave = min(min(far.x, far.y), far.z);\n"
	"	int n = leave > enter ? int(ceil((leave - enter) / step - 0.5)) : 0;\n"
	"	vec3 first = (eye + d * (enter + 0.5 * step)) / n_voxels, stride = d * step / n_voxels;\n"
	"	vec4 sum = vec4(0.0);\n"
	"	for (int i = 0; i < n; i++) {\n"
	"		float v = texture(volume, first + float(i) * stride).x;\n"
	"		sum += (1.0 - sum.w) * texture(table, v);\n"
	"	}\n"
	"	colour = floor(clamp(sum, 0.0, 1.0) * 255.0 + 0.5) / 255.0;\n"
	"}\n";

struct plain {
	struct bb_gl_context context;
	GLuint program, texture[2], vertex_array, framebuffer, target;
};

static GLuint shader(const struct bb_gl *gl, GLenum type, const char *text)
{
	const GLuint s = gl->CreateShader(type);
	GLint ok;

	gl->ShaderSource(s, 1, &text, NULL);
	gl->CompileShader(s);
	gl->GetShaderiv(s, GL_COMPILE_STATUS, &ok);
	if (!ok)
		abort();
	return s;
}

static void plain_textures(struct plain *p, const struct bb_volume *v, GLint filter)
{
	const struct bb_gl *gl = &p->context.gl;
	static const GLenum target[2] = { GL_TEXTURE_3D, GL_TEXTURE_1D };

	gl->GenTextures(2, p->texture);
	for (int k = 0; k < 2; k++) {
		gl->ActiveTexture(GL_TEXTURE0 + (GLenum)k);
		gl->BindTexture(target[k], p->texture[k]);
		gl->TexParameteri(target[k], GL_TEXTURE_MIN_FILTER, k ? filter : GL_LINEAR);
		gl->TexParameteri(target[k], GL_TEXTURE_MAG_FILTER, k ? filter : GL_LINEAR);
		gl->TexParameteri(target[k], GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target[k], GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target[k], GL_TEXTURE_WRAP_R, GL_CLAMP_TO_EDGE);
		gl->TexParameteri(target[k], GL_TEXTURE_MAX_LEVEL, 0);
	}
	gl->ActiveTexture(GL_TEXTURE0);
	gl->TexImage3D(GL_TEXTURE_3D, 0, GL_R32F, VOXELS, VOXELS, VOXELS, 0, GL_RED, GL_FLOAT, v->values);
}

static void plain_table(const struct plain *p, const struct bb_transfer *tf)
{
	static float table[TABLE][4];

	for (int i = 0; i < TABLE; i++) {
		double rgba[4];
		bb_transfer_at(tf, (i + 0.5) / TABLE, rgba);
		const double opacity = bb_transfer_opacity_for_step(rgba[3], STEP);
		for (int k = 0; k < 4; k++)
			table[i][k] = (float)(k < 3 ? rgba[k] * opacity : opacity);
	}
	p->context.gl.ActiveTexture(GL_TEXTURE1);
	p->context.gl.TexImage1D(GL_TEXTURE_1D, 0, GL_RGBA32F, TABLE, 0, GL_RGBA, GL_FLOAT, table);
}

static void plain_put(const struct plain *p, const struct bb_view *view)
{
	const struct bb_gl *gl = &p->context.gl;
	const struct bb_corners *c = &view->corners;
	const struct bb_vec3 middle = { 0.5, 0.5, 0.5 };
	const struct {
		const char *name;
		struct bb_vec3 v;
	} put[] = { { "eye", bb_vec3_add(view->eye, middle) },
		    { "corner", bb_vec3_sub(c->upper_left, view->eye) },
		    { "across", bb_vec3_sub(c->lower_right, c->lower_left) },
		    { "down", bb_vec3_sub(c->lower_left, c->upper_left) } };

	gl->UseProgram(p->program);
	for (size_t i = 0; i < BB_ARRAY_LEN(put); i++)
		gl->Uniform3f(gl->GetUniformLocation(p->program, put[i].name), (float)(put[i].v.x * VOXELS),
			      (float)(put[i].v.y * VOXELS), (float)(put[i].v.z * VOXELS));
	gl->Uniform1f(gl->GetUniformLocation(p->program, "step"), (float)STEP);
	gl->Uniform1f(gl->GetUniformLocation(p->program, "n_voxels"), VOXELS);
	gl->Uniform1f(gl->GetUniformLocation(p->program, "n_pixels"), PIXELS);
	gl->Uniform1i(gl->GetUniformLocation(p->program, "volume"), 0);
	gl->Uniform1i(gl->GetUniformLocation(p->program, "table"), 1);
}

static void plain_open(struct plain *p, const struct bb_volume *v, const struct bb_view *view, GLint filter)
{
	struct bb_error err = { 0 };

	must(bb_gl_context_open("osmesa", &p->context, &err), &err);
	const struct bb_gl *gl = &p->context.gl;
	p->program = gl->CreateProgram();
	gl->AttachShader(p->program, shader(gl, GL_VERTEX_SHADER, plain_vertex));
	gl->AttachShader(p->program, shader(gl, GL_FRAGMENT_SHADER, plain_fragment));
	gl->LinkProgram(p->program);
	gl->GenVertexArrays(1, &p->vertex_array);
	gl->GenFramebuffers(1, &p->framebuffer);
	gl->GenRenderbuffers(1, &p->target);
	gl->BindVertexArray(p->vertex_array);
	gl->BindRenderbuffer(GL_RENDERBUFFER, p->target);
	gl->RenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, PIXELS, PIXELS);
	gl->BindFramebuffer(GL_FRAMEBUFFER, p->framebuffer);
	gl->FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, p->target);
	gl->Viewport(0, 0, PIXELS, PIXELS);
	plain_textures(p, v, filter);
	plain_put(p, view);
}

static void plain_draw(struct plain *p, struct bb_image *image)
{
	const struct bb_gl *gl = &p->context.gl;

	if (!bb_gl_context_make_current(&p->context))
		abort();
	gl->DrawArrays(GL_TRIANGLES, 0, 3);
	gl->ReadPixels(0, 0, PIXELS, PIXELS, GL_RGBA, GL_UNSIGNED_BYTE, image->rgba);
}

/* ---- in turns ---- */

struct times { /* of one subject's draws */
	double ms[ROUNDS_MOST], cpu_ms[ROUNDS_MOST]; /* on the wall; of all threads, which a busy machine leaves alone */
};

struct subjects {
	struct bb_renderer *gl, *reference;
	struct plain plain[2]; /* the table between its entries; the nearest of them */
	const struct bb_volume *volume;
	struct bb_view view;
};

static void take(struct subjects *s, int k, const struct bb_draw *draw, struct bb_image *image, struct times *t, int at)
{
	const clock_t cpu = clock();
	const int64_t begin_ns = bb_clock_stopwatch_ns();

	if (k < 2)
		plain_draw(&s->plain[k], image);
	else
		must(bb_renderer_draw(s->gl, draw, image, NULL), bb_renderer_last_error(s->gl));
	t->ms[at] = (double)(bb_clock_stopwatch_ns() - begin_ns) / 1e6;
	t->cpu_ms[at] = (double)(clock() - cpu) * 1e3 / CLOCKS_PER_SEC;
}

static int by_size(const void *a, const void *b)
{
	const double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

static void report(const char *name, struct times *t, int n, const struct bb_image *image, const struct bb_image *truth,
		   uint64_t samples)
{
	struct bb_image_difference d;

	must(bb_image_compare(image, truth, &d), &(struct bb_error){ .text = "sizes" });
	qsort(t->ms, (size_t)n, sizeof(t->ms[0]), by_size);
	qsort(t->cpu_ms, (size_t)n, sizeof(t->cpu_ms[0]), by_size);
	printf("  %-21s %7.1f ms [%.1f - %.1f] %6.1f Ms/s; processor %7.1f ms [%.1f - %.1f]; PSNR %.1f dB, most %u/255\n", name,
	       t->ms[n / 2], t->ms[0], t->ms[n - 1], (double)samples / 1e3 / t->ms[n / 2], t->cpu_ms[n / 2], t->cpu_ms[0],
	       t->cpu_ms[n - 1], d.psnr_db, d.most);
}

static void compare(struct subjects *s, const char *name, const struct bb_transfer *tf, struct cover *cover, int rounds)
{
	const struct bb_layer layer = { &cover->atlas, tf, { { { 0, 0, 0 }, BB_QUAT_IDENTITY }, { 1, 1, 1 } }, s->volume };
	const struct bb_draw draw = { .view = &s->view, .layers = &layer, .n_layers = 1, .step_voxels = STEP };
	struct bb_image image[3], truth;
	struct bb_draw_stats stats;
	static struct times t[3];
	const int m = rounds / 2;

	must(bb_image_create(PIXELS, PIXELS, &truth), NULL);
	must(bb_renderer_draw(s->reference, &draw, &truth, &stats), bb_renderer_last_error(s->reference));
	for (int k = 0; k < 3; k++)
		must(bb_image_create(PIXELS, PIXELS, &image[k]), NULL);
	for (int k = 0; k < 2; k++) {
		(void)bb_gl_context_make_current(&s->plain[k].context);
		plain_table(&s->plain[k], tf);
	}
	for (int i = -1; i < rounds; i++) { /* the first one warms up */
		const int at = i < 0 ? 0 : i;
		for (int k = 0; k < 3; k++)
			take(s, k, &draw, &image[k], &t[k], at);
	}
	printf("%s, edge %u, %s: %.2f M samples\n", name, cover->atlas.edge, bb_brick_type_text(cover->atlas.type),
	       (double)stats.samples / 1e6);
	report("plain", &t[0], rounds, &image[0], &truth, stats.samples);
	report("plain, nearest entry", &t[1], rounds, &image[1], &truth, stats.samples);
	report("bricks", &t[2], rounds, &image[2], &truth, stats.samples);
	printf("  speed of bricks / plain: %.2f on the wall, %.2f of the processor; / plain, nearest entry: %.2f, %.2f\n",
	       t[0].ms[m] / t[2].ms[m], t[0].cpu_ms[m] / t[2].cpu_ms[m], t[1].ms[m] / t[2].ms[m],
	       t[1].cpu_ms[m] / t[2].cpu_ms[m]);
	fflush(stdout);
	bb_renderer_forget(s->gl);
	for (int k = 0; k < 3; k++)
		bb_image_release(&image[k]);
	bb_image_release(&truth);
}

int main(int argc, char **argv)
{
	const uint32_t edges[] = { 8, 16, 32, 64 }, only = argc > 1 ? (uint32_t)atoi(argv[1]) : 0;
	const int rounds = argc > 2 && atoi(argv[2]) > 0 && atoi(argv[2]) < ROUNDS_MOST ? atoi(argv[2]) : 5;
	struct bb_volume *v = make_volume();
	struct subjects s = { .volume = v, .view = make_view() };
	struct bb_error err = { 0 };

	must(bb_renderer_gl_create("osmesa", &s.gl, &err), &err);
	must(bb_renderer_reference_create(2, &s.reference), NULL);
	plain_open(&s.plain[0], v, &s.view, GL_LINEAR);
	plain_open(&s.plain[1], v, &s.view, GL_NEAREST);
	printf("%s\n", bb_renderer_description(s.gl));
	for (size_t i = 0; i < BB_ARRAY_LEN(edges); i++) {
		if (only && only != edges[i])
			continue;
		struct bb_bricks *b = cover_bricks(v, edges[i], 1, BB_BRICK_F32);
		struct cover *cover = cover_make(b, 0, cover_leaves, NULL);
		compare(&s, "filled", &filled, cover, rounds);
		compare(&s, "sparse", &sparse, cover, rounds);
		cover_free(cover);
		bb_bricks_close(b);
	}
	bb_renderer_destroy(s.gl);
	bb_renderer_destroy(s.reference);
	bb_gl_context_close(&s.plain[0].context);
	bb_gl_context_close(&s.plain[1].context);
	free(v->values);
	free(v);
	return 0;
}
