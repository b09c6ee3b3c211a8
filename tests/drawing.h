/*
 * tests/drawing.h: what the tests of the renderers share: a volume made of formulas, transfer functions, three views of
 * it (from outside, from a corner, with the head inside), and a picture of one of them.
 */
#ifndef BB_TESTS_DRAWING_H
#define BB_TESTS_DRAWING_H

#include <setjmp.h>
#include <stdarg.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "render/renderer.h"
#include "tests/cover.h"

#define DRAWING_VIEWS 3

/* A bright core in two shells that grow with time; every edge length different and none a multiple of a brick's. */
static inline struct bb_volume *drawing_volume(uint32_t nx, uint32_t ny, uint32_t nz, uint32_t n_steps)
{
	struct bb_volume *v = calloc(1, sizeof(*v));
	uint16_t *out = v ? calloc((size_t)nx * ny * nz * n_steps, sizeof(*out)) : NULL;

	if (!out)
		abort();
	*v = (struct bb_volume){
		.name = "formula", .dim = { nx, ny, nz }, .n_steps = n_steps, .spacing_mm = { 1, 1, 1 }, .most = 1,
		.voxels = out
	};
	for (uint32_t t = 0; t < n_steps; t++)
		for (uint32_t z = 0; z < nz; z++)
			for (uint32_t y = 0; y < ny; y++)
				for (uint32_t x = 0; x < nx; x++) {
					const double a = 2.0 * x / (nx - 1) - 1, b = 2.0 * y / (ny - 1) - 1,
						     c = 2.0 * z / (nz - 1) - 1;
					const double r = sqrt(a * a + b * b + c * c), grow = 0.15 * t;
					const double shell =
						exp(-40 * (r - 0.45 - grow) * (r - 0.45 - grow)) * (0.6 + 0.4 * a * b);
					const double core = exp(-30 * r * r);
					*out++ = (uint16_t)(65535 * fmin(1, 0.8 * shell + core) + 0.5);
				}
	return v;
}

static inline void drawing_free(struct bb_volume *v)
{
	if (v)
		free(v->voxels);
	free(v);
}

static inline struct bb_transfer drawing_transfer(size_t n, const struct bb_transfer_point *points)
{
	struct bb_transfer tf = { .n = n, .least_visible = 2 };

	memcpy(tf.point, points, n * sizeof(*points));
	for (size_t i = n - 1; i-- > 0;)
		if (points[i].opacity > 0 || points[i + 1].opacity > 0)
			tf.least_visible = points[i].value;
	return tf;
}

static inline struct bb_transfer drawing_smooth(void)
{
	static const struct bb_transfer_point points[] = { { 0, 0.1, 0.1, 0.3, 0 },
							   { 0.15, 0.1, 0.3, 0.6, 0 },
							   { 0.5, 0.9, 0.5, 0.1, 0.06 },
							   { 0.8, 1, 0.8, 0.3, 0.15 },
							   { 1, 1, 1, 0.9, 0.25 } };

	return drawing_transfer(BB_ARRAY_LEN(points), points);
}

/* An edge of 1/200 of the range: steeper than any table of a few hundred entries could show. */
static inline struct bb_transfer drawing_sharp(void)
{
	static const struct bb_transfer_point sharp[] = { { 0, 0, 0, 1, 0 },       { 0.4, 1, 0, 0, 0 },
							  { 0.405, 1, 1, 0, 0.5 }, { 0.41, 0, 1, 0, 0 },
							  { 0.8, 0, 1, 1, 0 },     { 0.801, 1, 1, 1, 1 },
							  { 1, 1, 1, 1, 1 } };

	return drawing_transfer(BB_ARRAY_LEN(sharp), sharp);
}

/* Noise of its own from each state. */
static inline struct bb_volume *drawing_noise(const uint32_t size[3], uint32_t n_steps, uint32_t *state)
{
	struct bb_volume *v = drawing_volume(size[0], size[1], size[2], n_steps);

	for (size_t i = 0; i < (size_t)size[0] * size[1] * size[2] * n_steps; i++) {
		*state = *state * 1664525U + 1013904223U;
		v->voxels[i] = (uint16_t)(*state >> 16);
	}
	return v;
}

static inline struct bb_placement drawing_placement(const struct bb_volume *v)
{
	const double k = 1.2 / v->dim[0]; /* 1.2 m wide */

	return (struct bb_placement){ { { 0.1, 1.4, -0.3 }, bb_quat_euler_deg(25, 10, -5) },
				      { k * v->dim[0], k * v->dim[1], k * v->dim[2] } };
}

/* View 0: from the middle of the room, 1: off to a side and near the wall, 2: the head inside the volume. */
static inline struct bb_view drawing_view(int i)
{
	static const struct bb_corners wall = { { -1.5, 0.2, -1.5 }, { 1.5, 0.2, -1.5 }, { -1.5, 2.6, -1.5 } };
	static const struct bb_vec3 eyes[DRAWING_VIEWS] = { { 0.3, 1.6, 1.4 },
							    { 1.6, 2.2, 0.5 },
							    { 0.15, 1.45, -0.2 } };

	return bb_view_make(&wall, eyes[i], eyes[0], 0.05, 50);
}

/* A volume as a renderer wants it: bricks of it, a cover of one time, the volume itself for the reference. */
struct drawing {
	struct bb_bricks *bricks;
	struct cover *cover;
	struct bb_layer layer;
};

static inline struct drawing drawing_of(const struct bb_volume *v, const struct bb_transfer *tf, uint32_t edge,
					enum bb_brick_type type, double time, cover_up *up, void *ctx)
{
	struct drawing d = { .bricks = cover_bricks(v, edge, 1, type) };

	d.cover = cover_make(d.bricks, time, up, ctx);
	d.layer = (struct bb_layer){ &d.cover->atlas, tf, drawing_placement(v), v };
	return d;
}

static inline void drawing_done(struct drawing *d)
{
	cover_free(d->cover);
	bb_bricks_close(d->bricks);
}

/* A picture of one of the views, of DRAWING_WIDTH x DRAWING_HEIGHT pixels. */
#define DRAWING_WIDTH 160
#define DRAWING_HEIGHT 120

static inline struct bb_image drawing_picture(struct bb_renderer *r, const struct bb_layer *layers, size_t n_layers,
					      int view_index, double step_voxels, struct bb_draw_stats *stats)
{
	const struct bb_view view = drawing_view(view_index);
	const struct bb_draw draw = {
		.view = &view, .layers = layers, .n_layers = n_layers, .step_voxels = step_voxels
	};
	struct bb_image image;

	assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(r, &draw, &image, stats), BB_OK);
	return image;
}

/* Draws with a back end and with the reference; says and returns how they differ. */
static inline struct bb_image_difference drawing_against(struct bb_renderer *r, struct bb_renderer *reference,
							 const char *name, const struct bb_layer *layers, size_t n_layers,
							 int view, double step_voxels)
{
	struct bb_image_difference d;
	struct bb_draw_stats own, ref;
	struct bb_image a = drawing_picture(r, layers, n_layers, view, step_voxels, &own);
	struct bb_image b = drawing_picture(reference, layers, n_layers, view, step_voxels, &ref);

	assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
	printf("%s, view %d at step %.2f: %.1f dB over %lu pixels, most %u/255; %.0f Ms/s, reference %.0f Ms/s\n", name, view,
	       layers->atlas->time, d.psnr_db, (unsigned long)d.n_pixels, d.most,
	       (double)ref.samples * 1e3 / (double)own.elapsed_ns, (double)ref.samples * 1e3 / (double)ref.elapsed_ns);
	assert_true(!own.rays || own.rays == ref.rays); /* those that count */
	bb_image_release(&a);
	bb_image_release(&b);
	return d;
}

#endif
