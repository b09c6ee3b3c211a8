/*
 * tests/layers_scenes.h: what every back end must be able to draw, for the tests of all of them: two volumes that
 * intersect, each with its own place and voxels, with a ball of triangles and a square cutting through them; a spherical
 * volume that goes all the way around and a wedge of one; and ten views, some with the head inside.
 */
#ifndef BB_TESTS_LAYERS_SCENES_H
#define BB_TESTS_LAYERS_SCENES_H

#include "tests/drawing.h"

#define SCENE_VIEWS 10
#define SCENE_PI 3.14159265358979323846

struct scene {
	struct bb_volume *volume[2];
	struct bb_transfer transfer[2];
	struct bb_bricks *bricks[2];
	struct cover *cover[2];
	struct bb_layer layer[2];
	size_t n_layers;
	struct bb_mesh mesh[2];
	size_t n_meshes;
};

/* 0 to 5 from outside, 6 to 9 with the head inside (of the ball: in its hollow, in its shell). */
static inline struct bb_view scene_view(int i)
{
	static const struct bb_corners wall = { { -1.5, 0.2, -1.5 }, { 1.5, 0.2, -1.5 }, { -1.5, 2.6, -1.5 } };
	static const struct bb_vec3 eyes[SCENE_VIEWS] = { { 0.3, 1.6, 1.4 },     { 1.6, 2.2, 0.5 },    { -1.4, 0.7, 0.9 },
							  { 0.1, 2.5, 0.3 },     { -0.9, 1.5, 0.5 },   { 0.2, 1.4, 2.5 },
							  { 0.15, 1.45, -0.2 },  { 0.0, 1.5, -0.32 },  { 0.45, 1.2, -0.25 },
							  { 0.25, 1.5, -0.3 } };

	return bb_view_make(&wall, eyes[i], eyes[0], 0.05, 50);
}

/* ---- meshes ---- */

static inline uint32_t scene_middle(float (*v)[3], uint32_t *n, uint32_t a, uint32_t b)
{
	double m[3], length = 0;

	for (int k = 0; k < 3; k++) {
		m[k] = (double)v[a][k] + (double)v[b][k];
		length += m[k] * m[k];
	}
	for (uint32_t i = 0; i < *n; i++) /* shared by the triangle next to it */
		if (fabs((double)v[i][0] - m[0] / sqrt(length)) + fabs((double)v[i][1] - m[1] / sqrt(length)) +
			    fabs((double)v[i][2] - m[2] / sqrt(length)) <
		    1e-6)
			return i;
	for (int k = 0; k < 3; k++)
		v[*n][k] = (float)(m[k] / sqrt(length));
	return (*n)++;
}

/* An icosahedron, each triangle cut in four `depth` times: 20 * 4^depth triangles, of the radius about the middle. */
static inline struct bb_mesh scene_icosphere(struct bb_vec3 middle, double radius_m, int depth)
{
	static const uint8_t faces[20][3] = { { 0, 11, 5 }, { 0, 5, 1 },  { 0, 1, 7 },	{ 0, 7, 10 }, { 0, 10, 11 },
					      { 1, 5, 9 },  { 5, 11, 4 }, { 11, 10, 2 }, { 10, 7, 6 }, { 7, 1, 8 },
					      { 3, 9, 4 },  { 3, 4, 2 },  { 3, 2, 6 },	{ 3, 6, 8 },  { 3, 8, 9 },
					      { 4, 9, 5 },  { 2, 4, 11 }, { 6, 2, 10 },	{ 8, 6, 7 },  { 9, 8, 1 } };
	const double g = (1 + sqrt(5)) / 2, s = sqrt(1 + g * g);
	uint32_t n_triangles = 20, n = 12;
	const uint32_t most = 20U << 2 * depth;
	float(*v)[3] = calloc(most, sizeof(*v)), (*c)[4] = calloc(most, sizeof(*c));
	uint32_t(*t)[3] = calloc(most, sizeof(*t));

	if (!v || !c || !t)
		abort();
	for (int i = 0; i < 12; i++) {
		const double a = (i & 1 ? 1 : -1) / s, b = (i & 2 ? -g : g) / s;
		v[i][(i / 4 + 0) % 3] = (float)(i < 4 ? a : i < 8 ? a : a);
		v[i][(i / 4 + 1) % 3] = (float)b;
	}
	for (int i = 0; i < 20; i++)
		for (int k = 0; k < 3; k++)
			t[i][k] = faces[i][k];
	for (; depth > 0; depth--)
		for (uint32_t i = n_triangles; i-- > 0;) {
			const uint32_t old[3] = { t[i][0], t[i][1], t[i][2] };
			uint32_t m[3];
			for (int k = 0; k < 3; k++)
				m[k] = scene_middle(v, &n, old[k], old[(k + 1) % 3]);
			for (int k = 0; k < 3; k++)
				t[i][k] = m[k];
			for (int k = 0; k < 3; k++, n_triangles++) {
				t[n_triangles][0] = old[k];
				t[n_triangles][1] = m[k];
				t[n_triangles][2] = m[(k + 2) % 3];
			}
		}
	for (uint32_t i = 0; i < n; i++) {
		c[i][0] = 0.5F + 0.5F * v[i][0];
		c[i][1] = 0.5F + 0.5F * v[i][1];
		c[i][2] = 0.5F - 0.5F * v[i][2];
		c[i][3] = 0.35F + 0.25F * v[i][1];
		v[i][0] = (float)(middle.x + radius_m * (double)v[i][0]);
		v[i][1] = (float)(middle.y + radius_m * (double)v[i][1]);
		v[i][2] = (float)(middle.z + radius_m * (double)v[i][2]);
	}
	return (struct bb_mesh){ (const float(*)[3])v, (const float(*)[4])c, (const uint32_t(*)[3])t, n, n_triangles, 1 };
}

/* A square of two triangles, tilted, its corners of different colours and opacities. */
static inline struct bb_mesh scene_square(struct bb_vec3 middle, double half_m, struct bb_quat tilt)
{
	static const float colour[4][4] = {
		{ 1, 0.2F, 0.1F, 0.7F }, { 0.1F, 1, 0.2F, 0.5F }, { 0.2F, 0.3F, 1, 0.3F }, { 1, 1, 0.8F, 0.6F }
	};
	static const uint32_t triangle[2][3] = { { 0, 1, 2 }, { 2, 1, 3 } };
	float(*v)[3] = calloc(4, sizeof(*v)), (*c)[4] = calloc(4, sizeof(*c));
	uint32_t(*t)[3] = calloc(2, sizeof(*t));

	if (!v || !c || !t)
		abort();
	for (int i = 0; i < 4; i++) {
		const struct bb_vec3 corner = { (i & 1 ? half_m : -half_m), 0, (i & 2 ? half_m : -half_m) };
		const struct bb_vec3 p = bb_vec3_add(middle, bb_quat_rotate(tilt, corner));
		v[i][0] = (float)p.x;
		v[i][1] = (float)p.y;
		v[i][2] = (float)p.z;
	}
	memcpy(c, colour, sizeof(colour));
	memcpy(t, triangle, sizeof(triangle));
	return (struct bb_mesh){ (const float(*)[3])v, (const float(*)[4])c, (const uint32_t(*)[3])t, 4, 2, 1 };
}

static inline void scene_mesh_free(struct bb_mesh *m)
{
	free((void *)m->vertex_m);
	free((void *)m->rgba);
	free((void *)m->triangle);
}

/* ---- spherical ---- */

/* Two arms that wind around, brighter near the equator, in shells; smooth across the end of phi. */
static inline double scene_ball_value(double r, double theta, double phi)
{
	const double arms = 0.5 + 0.5 * cos(2 * phi - 3 * r), belt = sin(theta) * sin(theta);

	return 0.1 + 0.55 * arms * belt + 0.3 * exp(-30 * (r - 0.6) * (r - 0.6)) * (1 + 0.3 * cos(3 * theta + phi));
}

static inline struct bb_volume *scene_ball_volume(const uint32_t dim[3], const double extent[6], bool around)
{
	struct bb_volume *v = calloc(1, sizeof(*v));
	float *out = calloc((size_t)dim[0] * dim[1] * dim[2], sizeof(*out));

	if (!v || !out)
		abort();
	*v = (struct bb_volume){ .name = "ball", .dim = { dim[0], dim[1], dim[2] }, .n_steps = 1,
				 .spacing_mm = { 1, 1, 1 }, .most = 1, .values = out, .around = around };
	for (uint32_t z = 0; z < dim[2]; z++)
		for (uint32_t y = 0; y < dim[1]; y++)
			for (uint32_t x = 0; x < dim[0]; x++) {
				const double r = extent[0] + (x + 0.5) / dim[0] * (extent[1] - extent[0]);
				const double theta = extent[2] + (y + 0.5) / dim[1] * (extent[3] - extent[2]);
				const double phi = extent[4] + (z + 0.5) / dim[2] * (extent[5] - extent[4]);
				const double value = scene_ball_value(r / extent[1], theta, phi);
				*out++ = (float)fmax(0, fmin(1, value));
			}
	return v;
}

/* ---- scenes ---- */

static inline uint32_t scene_hash(uint32_t x, uint32_t y, uint32_t z)
{
	uint32_t h = x * 0x9E3779B1U ^ y * 0x85EBCA77U ^ z * 0xC2B2AE3DU;

	h = (h ^ h >> 15) * 0x2C1B3C6DU;
	return h ^ h >> 13;
}

/* Levels as a cut through a tree has them: some bricks 2 above the leaves, some 1, the rest leaves. */
static inline uint32_t scene_levels(const uint32_t cell[3], void *ctx)
{
	(void)ctx;
	if (scene_hash(cell[0] >> 2, cell[1] >> 2, cell[2] >> 2) % 4 == 0)
		return 2;
	return scene_hash(cell[0] >> 1, cell[1] >> 1, (cell[2] >> 1) + 77) % 2;
}

/* Any level anywhere, as no tree would cut it. */
static inline uint32_t scene_patches(const uint32_t cell[3], void *ctx)
{
	(void)ctx;
	return scene_hash(cell[0], cell[1], cell[2]) % 3;
}

/* A third of the cells of every level are of one value each. */
static inline void scene_flatten(struct scene *s, size_t layer)
{
	const struct bb_atlas *a = &s->cover[layer]->atlas;
	const size_t n = (size_t)a->grid[0] * a->grid[1] * a->grid[2];

	for (unsigned shown = 0; shown < 2; shown++)
		for (size_t i = 0; i < n; i++) {
			struct bb_atlas_cell *c = &s->cover[layer]->map[shown][i];
			const uint32_t h = scene_hash((uint32_t)i, shown < a->n_shown ? shown : 0, 5);
			if (h % 3 == 0)
				*c = (struct bb_atlas_cell){ BB_ATLAS_FLAT, c->up, (float)(h >> 8 & 255) / 255 };
		}
}

static inline void scene_free(struct scene *s)
{
	for (size_t i = 0; i < s->n_layers; i++) {
		cover_free(s->cover[i]);
		bb_bricks_close(s->bricks[i]);
		bb_volume_free(s->volume[i]);
	}
	for (size_t i = 0; i < s->n_meshes; i++)
		scene_mesh_free(&s->mesh[i]);
	free(s);
}

static inline struct scene *scene_make(void)
{
	struct scene *s = calloc(1, sizeof(*s));

	if (!s)
		abort();
	s->transfer[0] = drawing_smooth();
	return s;
}

static inline void scene_add(struct scene *s, struct bb_volume *v, const struct bb_build_config *config, double time,
			     const struct bb_placement *placement, cover_up *up, void *ctx)
{
	struct bb_steps *steps;
	const size_t i = s->n_layers++;

	if (bb_steps_of_volume(v, &steps, NULL) != BB_OK)
		abort();
	s->volume[i] = v;
	s->bricks[i] = cover_build(steps, *config);
	s->cover[i] = cover_make(s->bricks[i], time, up, ctx);
	s->layer[i] = (struct bb_layer){ &s->cover[i]->atlas, &s->transfer[i], *placement, v };
	bb_steps_close(steps);
}

/* Two volumes, one u16 of two steps between which the time lies, one u8 with other edges and voxels. */
static inline struct scene *scene_two_volumes(cover_up *up, void *ctx)
{
	static const struct bb_transfer_point cool[] = { { 0, 0.2, 0.6, 0.9, 0 },
							 { 0.3, 0.2, 0.7, 0.9, 0.02 },
							 { 1, 0.7, 1, 0.8, 0.2 } };
	const struct bb_build_config fine = { .edge = 16, .pad = 1, .type = BB_BRICK_U16, .has_range = true, .most = 1 };
	const struct bb_build_config coarse = { .edge = 8, .pad = 1, .type = BB_BRICK_F16, .has_range = true, .most = 1 };
	const struct bb_placement there = { { { 0.25, 1.3, -0.15 }, bb_quat_euler_deg(-40, 20, 30) }, { 0.7, 0.8, 0.9 } };
	struct scene *s = scene_make();
	struct bb_volume *v = drawing_volume(70, 50, 37, 2);
	const struct bb_placement here = drawing_placement(v);

	s->transfer[1] = drawing_transfer(BB_ARRAY_LEN(cool), cool);
	scene_add(s, v, &fine, 0.4, &here, up, ctx);
	scene_add(s, drawing_volume(30, 41, 26, 1), &coarse, 0, &there, up, ctx);
	return s;
}

static inline void scene_add_meshes(struct scene *s)
{
	s->mesh[0] = scene_icosphere((struct bb_vec3){ 0.2, 1.4, -0.3 }, 0.38, 3);
	s->mesh[1] = scene_square((struct bb_vec3){ 0.05, 1.35, -0.35 }, 0.6, bb_quat_euler_deg(20, 35, 10));
	s->n_meshes = 2;
}

/* wedge: a part of the angles and of r down to the middle; else a hollow ball, all the way around. */
static inline struct scene *scene_ball(bool wedge, cover_up *up, void *ctx)
{
	static const uint32_t dim[2][3] = { { 40, 36, 75 }, { 45, 30, 40 } };
	static const double extent[2][6] = { { 3, 10, 0, SCENE_PI, 0, 2 * SCENE_PI }, { 0, 5, 0.5, 2.2, -0.7, 2.4 } };
	struct bb_build_config config = { .edge = 16, .pad = 1, .type = BB_BRICK_F32, .has_range = true, .most = 1,
					  .grid = BB_BRICK_SPHERICAL };
	const struct bb_placement here = { { { 0.1, 1.4, -0.3 }, bb_quat_euler_deg(25, 10, -5) }, { 1.2, 1.2, 1.2 } };
	struct scene *s = scene_make();

	memcpy(config.extent, extent[wedge], sizeof(config.extent));
	scene_add(s, scene_ball_volume(dim[wedge], extent[wedge], !wedge), &config, 0, &here, up, ctx);
	return s;
}

static inline struct bb_image scene_picture(struct bb_renderer *r, const struct scene *s, int view_index,
					    double step_voxels, bool blend_levels, struct bb_draw_stats *stats)
{
	const struct bb_view view = scene_view(view_index);
	const struct bb_draw draw = { .view = &view,
				      .layers = s->layer,
				      .n_layers = s->n_layers,
				      .meshes = s->mesh,
				      .n_meshes = s->n_meshes,
				      .step_voxels = step_voxels,
				      .blend_levels = blend_levels };
	struct bb_image image;

	assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &image), BB_OK);
	assert_int_equal(bb_renderer_draw(r, &draw, &image, stats), BB_OK);
	return image;
}

/* All ten views by a back end and by the reference: the worst of them. */
static inline double scene_worst_db(struct bb_renderer *r, struct bb_renderer *reference, const struct scene *s,
				    const char *name)
{
	double worst = 1e9;

	for (int i = 0; i < SCENE_VIEWS; i++) {
		struct bb_draw_stats own, ref;
		struct bb_image_difference d;
		struct bb_image a = scene_picture(r, s, i, 0.5, false, &own);
		struct bb_image b = scene_picture(reference, s, i, 0.5, false, &ref);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		printf("%s, view %d: %.1f dB over %lu pixels, most %u/255; %.0f Ms/s, reference %.1f Ms/s\n", name, i,
		       d.psnr_db, (unsigned long)d.n_pixels, d.most,
		       (double)ref.samples * 1e3 / (double)own.elapsed_ns,
		       (double)ref.samples * 1e3 / (double)ref.elapsed_ns);
		assert_true(d.n_pixels > 100);
		worst = fmin(worst, d.psnr_db);
		bb_image_release(&a);
		bb_image_release(&b);
	}
	return worst;
}

#endif
