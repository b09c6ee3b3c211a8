/*
 * tests/test_layers.c: several volumes, spherical ones and meshes, drawn natively, against the reference; and the
 * reference's own triangles against what can be written down.
 */
#include "tests/layers_scenes.h"

#include "render/cpu/layers.h"

static const char *const kernels[] = { "avx512", "avx2", "portable" };

static struct {
	struct bb_renderer *reference, *layers;
	struct bb_renderer *judge; /* of pictures: the reference; for kernels after the first one, that one */
	const char *kernel;
} fixture;

static bool need_kernel(void)
{
	if (fixture.layers)
		return true;
	printf("SKIP: %s: this processor does not have it\n", fixture.kernel);
	skip();
	return false;
}

static double worst_of(struct scene *s, const char *what)
{
	char name[64];

	snprintf(name, sizeof(name), "%s, %s", fixture.kernel, what);
	const double db = scene_worst_db(fixture.layers, fixture.judge, s, name);
	scene_free(s);
	return db;
}

static void two_volumes_agree_with_the_reference(void **ctx)
{
	(void)ctx;
	if (need_kernel())
		assert_true(worst_of(scene_two_volumes(cover_leaves, NULL), "two volumes") >= 50);
}

static void meshes_between_them_do(void **ctx)
{
	(void)ctx;
	need_kernel();
	struct scene *s = scene_two_volumes(cover_leaves, NULL);
	scene_add_meshes(s);
	assert_true(worst_of(s, "two volumes and meshes") >= 45);
}

static void a_spherical_volume_does(void **ctx)
{
	(void)ctx;
	need_kernel();
	assert_true(worst_of(scene_ball(false, cover_leaves, NULL), "ball") >= 50);
	assert_true(worst_of(scene_ball(true, cover_leaves, NULL), "wedge") >= 50);
}


/* Noise shows every misplaced voxel, at the end of phi above all, where the last brick is not full. */
static void a_ball_of_noise_has_no_end_of_phi(void **ctx)
{
	uint32_t state = 12;

	(void)ctx;
	need_kernel();
	struct scene *s = scene_make();
	const struct bb_build_config config = { .edge = 16, .pad = 1, .type = BB_BRICK_F32, .has_range = true, .most = 1,
						.grid = BB_BRICK_SPHERICAL,
						.extent = { 1, 3, 0, SCENE_PI, -2, 2 * SCENE_PI - 2 } };
	const struct bb_placement here = { { { 0.1, 1.4, -0.3 }, bb_quat_euler_deg(60, 10, -5) }, { 1.2, 1.2, 1.2 } };
	struct bb_volume *v = scene_ball_volume((const uint32_t[]){ 12, 14, 21 }, config.extent, true);
	for (size_t i = 0; i < (size_t)12 * 14 * 21; i++) {
		state = state * 1664525U + 1013904223U;
		v->values[i] = (float)(state >> 8) * 0x1p-24F;
	}
	scene_add(s, v, &config, 0, &here, cover_leaves, NULL);
	assert_true(worst_of(s, "noise") >= 50);
}

/* ---- sample by sample ---- */

struct count {
	uint64_t taken, left_out;
	double worst;
};

static struct bb_vec3 point_of(const struct bb_layer_walk *w, double i)
{
	const struct bb_ray *r = &w->ray;

	return (struct bb_vec3){ r->first.x + i * r->stride.x, r->first.y + i * r->stride.y, r->first.z + i * r->stride.z };
}

/* Grid coordinates; false: outside. */
static bool grid_of(const struct bb_layer_ready *l, struct bb_vec3 at, double out[3])
{
	if (l->spherical && !bb_spherical_at(&l->ball, at, &at))
		return false;
	out[0] = at.x;
	out[1] = at.y;
	out[2] = at.z;
	return true;
}

static uint32_t finest_up(const struct bb_atlas *a, const double at[3])
{
	size_t index = 0;

	for (int k = 2; k >= 0; k--) {
		const double c = floor(at[k] / a->edge), last = a->grid[k] - 1.0;
		index = index * a->grid[k] + (size_t)fmin(fmax(c, 0), last);
	}
	const uint32_t first = a->map[0][index].up, second = a->map[a->n_shown - 1][index].up;
	return first < second ? first : second;
}

/* A sample near a face may be counted to either side of it. */
static bool near_a_face(const struct bb_atlas *a, const double at[3])
{
	for (int k = 0; k < 3; k++) {
		const double d = at[k] / a->edge - floor(at[k] / a->edge + 0.5);
		if (fabs(d) < 1e-5 || at[k] < 1e-3 || at[k] > a->dim[k] - 1e-3)
			return true;
	}
	return false;
}

static void check_left_out(const struct bb_layer_ready *l, const struct bb_transfer *tf, const struct bb_layer_walk *w,
			   int64_t i, struct count *n)
{
	double at[3], rgba[4];

	n->left_out++;
	if (!grid_of(l, point_of(w, (double)i), at) || near_a_face(l->atlas, at))
		return;
	const uint32_t s = 1U << (l->steps_by_level ? finest_up(l->atlas, at) : 0);
	if (i % s != s / 2)
		return;
	bb_transfer_at(tf, bb_layer_value(l->atlas, at, l->blend), rgba);
	assert_true(rgba[3] < 1e-6);
}

static void check_taken(const struct bb_layer_ready *l, const struct bb_layer_walk *w, uint32_t k, struct count *n)
{
	double at[3];

	n->taken++;
	if (!grid_of(l, point_of(w, w->number[k]), at) || near_a_face(l->atlas, at))
		return;
	const uint32_t up = l->steps_by_level ? finest_up(l->atlas, at) : 0, s = 1U << up;
	assert_true((uint32_t)w->number[k] % s == s / 2 && w->up[k] == up);
	n->worst = fmax(n->worst, fabs((double)w->value[k] - bb_layer_value(l->atlas, at, l->blend)));
}

static void check_ray(const struct bb_layer_ready *l, const struct bb_transfer *tf, uint32_t column, uint32_t row,
		      struct count *n)
{
	struct bb_layer_walk w;
	int64_t i = 0;

	bb_layer_walk_begin(&w, l, column, row);
	while (bb_layer_walk_on(&w))
		for (uint32_t k = 0; k < w.n; k++, i++) {
			assert_true(w.number[k] >= i && (uint32_t)w.number[k] < w.ray.n);
			for (; i < w.number[k]; i++)
				check_left_out(l, tf, &w, i, n);
			check_taken(l, &w, k, n);
		}
	for (; i < w.ray.n; i++)
		check_left_out(l, tf, &w, i, n);
}

static const struct bb_layer_kernel *kernel_named(const char *name)
{
	struct bb_layers_caster c;

	return bb_layers_caster_init(&c, name, 1, NULL) == BB_OK ? c.kernel : NULL;
}

/* Every sample of some rays has the value of its point, and those that are left out would not have shown. */
static struct count check_samples(const struct scene *s, int view_index, bool steps_by_level, bool blend)
{
	const struct bb_view view = scene_view(view_index);
	const struct bb_draw draw = { .view = &view, .layers = s->layer, .n_layers = 1, .step_voxels = 0.4,
				      .steps_by_level = steps_by_level, .blend_levels = blend };
	struct bb_rays rays;
	struct bb_layer_ready ready;
	struct count n = { 0 };

	assert_int_equal(bb_rays_make(&view, s->layer, draw.step_voxels, 64, 48, &rays), BB_OK);
	assert_int_equal(bb_layer_make_ready(&draw, 0, &rays, kernel_named(fixture.kernel), 1, &ready, NULL), BB_OK);
	for (uint32_t i = 0; i < 64 * 48; i += 37)
		check_ray(&ready, s->layer->transfer, i % 64, i / 64, &n);
	bb_layer_unready(&ready);
	return n;
}

/* Vectors are whole, numbers are as many as there are: what lies after them is anything, and changes nothing. */
static void what_lies_after_the_numbers_is_nobodys(void **ctx)
{
	static const float base[3] = { 1, 2, 3 }, stride[3] = { 0.5F, 0.25F, -1 };
	static const int32_t after[] = { INT32_MIN, INT32_MAX, 0 };
	float out[BB_ARRAY_LEN(after)][3][BB_LAYER_ROOM];
	int32_t number[BB_LAYER_ROOM];
	(void)ctx;
	need_kernel();

	for (size_t way = 0; way < BB_ARRAY_LEN(after); way++) {
		for (int32_t i = 0; i < BB_LAYER_ROOM; i++)
			number[i] = i < 5 ? 10 + 3 * i : after[way];
		kernel_named(fixture.kernel)->line(base, stride, number, 5, out[way]);
		for (int a = 0; a < 3; a++)
			for (int i = 0; i < 5; i++)
				assert_float_equal(out[way][a][i], base[a] + (float)(3 * i) * stride[a], 0);
	}
}

static void every_sample_has_its_points_value(void **ctx)
{
	static const uint32_t dim[3] = { 70, 37, 51 };
	uint32_t state = 9;

	(void)ctx;
	need_kernel();
	for (int i = 0; i < 16; i++) {
		const enum bb_brick_type type = (enum bb_brick_type)(i % BB_BRICK_TYPES);
		const struct bb_build_config config = { .edge = i % 3 ? 16 : 6, .pad = 1 + (uint32_t)i / 7 % 2,
							.type = type, .has_range = true, .most = 1 };
		struct scene *s = scene_make();
		struct bb_volume *v = i % 2 ? drawing_volume(dim[0], dim[1], dim[2], 2) : drawing_noise(dim, 2, &state);
		const struct bb_placement here = drawing_placement(v);
		scene_add(s, v, &config, i % 4 ? 0.3 : 1, &here, i ? scene_levels : cover_leaves, NULL);
		if (i % 5 == 4)
			scene_flatten(s, 0);
		const struct count n = check_samples(s, i % SCENE_VIEWS, i / 4 % 2, i / 2 % 2);
		printf("%s, %s, edge %u, flat %d, by level %d, blended %d: %lu samples, %lu left out, %.1e off\n",
		       fixture.kernel, bb_brick_type_text(type), config.edge, i % 5 == 4, i / 4 % 2, i / 2 % 2,
		       (unsigned long)n.taken, (unsigned long)n.left_out, n.worst);
		assert_true(n.taken > 200 && n.worst < 5e-6);
		scene_free(s);
	}
}

static void every_spherical_sample_has(void **ctx)
{
	(void)ctx;
	need_kernel();
	for (int i = 0; i < 8; i++) {
		struct scene *s = scene_ball(i & 1, i > 1 ? scene_levels : cover_leaves, NULL);
		if (i > 5)
			scene_flatten(s, 0);
		const struct count n = check_samples(s, (i * 3 + 6) % SCENE_VIEWS, i == 3 || i == 4, i / 2 % 2);
		printf("%s, spherical %d: %lu samples, %lu left out, %.1e off\n", fixture.kernel, i,
		       (unsigned long)n.taken, (unsigned long)n.left_out, n.worst);
		assert_true(n.taken > 200 && n.left_out > 0 && n.worst < 5e-6);
		scene_free(s);
	}
}

/* ---- other things ---- */

static bool same_pictures(struct bb_renderer *a, struct bb_renderer *b, const struct scene *s, int view)
{
	struct bb_image x = scene_picture(a, s, view, 0.7, false, NULL), y = scene_picture(b, s, view, 0.7, false, NULL);
	const bool same = !memcmp(x.rgba, y.rgba, (size_t)x.width * x.height * 4);

	bb_image_release(&x);
	bb_image_release(&y);
	return same;
}

/* Nor does it matter whether there is Embree, or what was drawn before. */
static void threads_and_trees_change_nothing(void **ctx)
{
	struct bb_renderer *one, *own;

	(void)ctx;
	need_kernel();
	struct scene *s = scene_two_volumes(scene_levels, NULL);
	scene_add_meshes(s);
	assert_int_equal(bb_renderer_layers_create(fixture.kernel, 1, false, &one, NULL), BB_OK);
	assert_int_equal(bb_renderer_layers_create(fixture.kernel, 5, true, &own, NULL), BB_OK);
	for (int view = 0; view < SCENE_VIEWS; view += 2)
		assert_true(same_pictures(one, own, s, view));
	float(*vertex)[3] = (float(*)[3])(void *)s->mesh[1].vertex_m;
	for (int i = 0; i < 4; i++)
		vertex[i][1] += 0.1F;
	bb_renderer_forget(own);
	assert_false(same_pictures(one, own, s, 0)); /* nobody told the first one */
	s->mesh[1].generation++;
	assert_true(same_pictures(one, own, s, 0));
	bb_renderer_destroy(one);
	bb_renderer_destroy(own);
	scene_free(s);
}

/* "cpu" draws what its kernels of one volume do not by these; what both can draw looks alike. */
static void the_cpu_renderer_has_it_all(void **ctx)
{
	struct bb_renderer *cpu;

	(void)ctx;
	need_kernel();
	assert_int_equal(bb_renderer_cpu_create(fixture.kernel, 2, &cpu, NULL), BB_OK);
	for (int i = 0; i < 3; i++) {
		struct scene *s = i < 2 ? scene_two_volumes(scene_levels, NULL) : scene_ball(true, cover_leaves, NULL);
		if (!i)
			scene_add_meshes(s);
		assert_true(same_pictures(cpu, fixture.layers, s, 6));
		bb_renderer_forget(cpu);
		scene_free(s);
	}
	for (int i = 0; i < 4; i++) { /* levels; steps by them; blended */
		struct scene *s = scene_two_volumes(scene_levels, NULL);
		const struct bb_view view = scene_view(i);
		const struct bb_draw draw = { .view = &view, .layers = s->layer, .n_layers = 1, .step_voxels = 0.5,
					      .steps_by_level = i & 1, .blend_levels = i > 1 };
		struct bb_image a, b;
		struct bb_image_difference d;
		assert_int_equal(bb_image_create(90, 70, &a), BB_OK);
		assert_int_equal(bb_image_create(90, 70, &b), BB_OK);
		assert_int_equal(bb_renderer_draw(cpu, &draw, &a, NULL), BB_OK);
		assert_int_equal(bb_renderer_draw(fixture.layers, &draw, &b, NULL), BB_OK);
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		printf("%s, one volume both ways, by level %d, blended %d: %.1f dB, most %u\n", fixture.kernel, i & 1,
		       i > 1, d.psnr_db, d.most);
		assert_true(d.psnr_db > (i > 1 ? 199 : 55));
		bb_renderer_forget(cpu);
		bb_image_release(&a);
		bb_image_release(&b);
		scene_free(s);
	}
	bb_renderer_destroy(cpu);
}

static void a_damaged_mesh_is_refused(void **ctx)
{
	const struct bb_view view = scene_view(0);
	struct bb_image image;

	(void)ctx;
	need_kernel();
	struct scene *s = scene_two_volumes(cover_leaves, NULL);
	scene_add_meshes(s);
	((uint32_t(*)[3])(void *)s->mesh[0].triangle)[7][1] = s->mesh[0].n_vertices;
	const struct bb_draw draw = { .view = &view, .layers = s->layer, .n_layers = 2, .meshes = s->mesh, .n_meshes = 2,
				      .step_voxels = 1 };
	assert_int_equal(bb_image_create(8, 8, &image), BB_OK);
	struct bb_renderer *const both[] = { fixture.layers, fixture.reference };
	for (int i = 0; i < 2; i++) {
		assert_int_equal(bb_renderer_draw(both[i], &draw, &image, NULL), BB_ERR_RANGE);
		assert_int_equal(bb_renderer_last_error(both[i])->number, 1816);
	}
	bb_image_release(&image);
	scene_free(s);
}

/* A slab of one value with a square across its middle, head-on: half the slab, the square, the other half. */
static void a_square_divides_a_slab(void **ctx)
{
	static const struct bb_transfer_point red[] = { { 0, 1, 0, 0, 0.02 }, { 1, 1, 0, 0, 0.02 } };
	const struct bb_build_config config = { .edge = 16, .pad = 1, .type = BB_BRICK_U8, .has_range = true, .most = 1 };
	const struct bb_placement here = { { { 0, 1, -1 }, BB_QUAT_IDENTITY }, { 1, 1, 1 } };
	const struct bb_corners wall = { { -1e-3, 1 - 1e-3, -2 }, { 1e-3, 1 - 1e-3, -2 }, { -1e-3, 1 + 1e-3, -2 } };
	const struct bb_view view = bb_view_make(&wall, (struct bb_vec3){ 0, 1, 3 }, wall.lower_left, 0.05, 50);
	const double half = 1 - pow(0.98, 16), square = 0.25, behind = (1 - half) * (1 - square) * half;
	struct scene *s = scene_make();
	struct bb_image image;

	(void)ctx;
	need_kernel();
	s->transfer[0] = drawing_transfer(2, red);
	scene_add(s, drawing_volume(32, 32, 32, 1), &config, 0, &here, cover_leaves, NULL);
	s->mesh[0] = scene_square((struct bb_vec3){ 0, 1, -1 }, 1, bb_quat_euler_deg(0, 90, 0));
	s->n_meshes = 1;
	for (int i = 0; i < 4; i++)
		memcpy(((float(*)[4])(void *)s->mesh[0].rgba)[i], (float[]){ 0, 1, 0, (float)square }, sizeof(float[4]));
	const struct bb_draw draw = { .view = &view, .layers = s->layer, .n_layers = 1, .meshes = s->mesh, .n_meshes = 1,
				      .step_voxels = 0.5 };
	assert_int_equal(bb_image_create(5, 5, &image), BB_OK);
	struct bb_renderer *const both[] = { fixture.layers, fixture.reference };
	for (int i = 0; i < 2; i++) {
		assert_int_equal(bb_renderer_draw(both[i], &draw, &image, NULL), BB_OK);
		const uint8_t *px = image.rgba + 12 * 4;
		assert_int_equal(px[0], (int)floor((half + behind) * 255 + 0.5));
		assert_int_equal(px[1], (int)floor((1 - half) * square * 255 + 0.5));
		assert_int_equal(px[3], (int)floor((half + (1 - half) * square + behind) * 255 + 0.5));
	}
	bb_image_release(&image);
	scene_free(s);
}

/* Two volumes of the same place and steps: at each point the first one comes first, for all back ends. */
static void equal_distances_go_by_layer(void **ctx)
{
	static const struct bb_transfer_point red[] = { { 0, 1, 0, 0, 0 },
							{ 0.3, 1, 0, 0, 0 },
							{ 0.31, 1, 0, 0, 0.95 },
							{ 1, 1, 0, 0, 0.95 } },
					      blue[] = { { 0, 0, 0, 1, 0 },
							 { 0.3, 0, 0, 1, 0 },
							 { 0.31, 0, 0, 1, 0.95 },
							 { 1, 0, 0, 1, 0.95 } };
	const struct bb_build_config config = { .edge = 16, .pad = 1, .type = BB_BRICK_U16, .has_range = true, .most = 1 };
	struct scene *s = scene_make();
	struct bb_volume *v = drawing_volume(40, 40, 40, 1), *again = drawing_volume(40, 40, 40, 1);
	const struct bb_placement here = drawing_placement(v);
	double level[2][2];

	(void)ctx;
	need_kernel();
	scene_add(s, v, &config, 0, &here, cover_leaves, NULL);
	scene_add(s, again, &config, 0, &here, scene_levels, NULL);
	s->layer[1] = s->layer[0];
	s->layer[1].transfer = &s->transfer[1];
	for (int swapped = 0; swapped < 2; swapped++) {
		s->transfer[swapped] = drawing_transfer(4, red);
		s->transfer[!swapped] = drawing_transfer(4, blue);
		struct bb_image a = scene_picture(fixture.layers, s, 0, 1, false, NULL);
		struct bb_image b = scene_picture(fixture.reference, s, 0, 1, false, NULL);
		struct bb_image_difference d;
		assert_int_equal(bb_image_compare(&a, &b, &d), BB_OK);
		assert_true(d.n_pixels > 100 && d.psnr_db > 60);
		level[swapped][0] = level[swapped][1] = 0;
		for (size_t i = 0; i < (size_t)a.width * a.height; i++) {
			level[swapped][0] += a.rgba[4 * i];
			level[swapped][1] += a.rgba[4 * i + 2];
		}
		bb_image_release(&a);
		bb_image_release(&b);
	}
	printf("%s, the same place: %.0f of the first, %.0f of the second\n", fixture.kernel, level[0][0], level[0][1]);
	assert_true(level[0][0] > 1.2 * level[0][1] && level[1][1] > 1.2 * level[1][0]);
	scene_free(s);
}

static void steps_by_level_take_fewer(void **ctx)
{
	(void)ctx;
	need_kernel();
	struct scene *s = scene_two_volumes(scene_levels, NULL);
	const struct bb_view view = scene_view(0);
	struct bb_draw draw = { .view = &view, .layers = s->layer, .n_layers = 2, .step_voxels = 0.5 };
	struct bb_draw_stats all, few;
	struct bb_image_difference d;
	struct bb_image a, b;

	assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &a), BB_OK);
	assert_int_equal(bb_image_create(DRAWING_WIDTH, DRAWING_HEIGHT, &b), BB_OK);
	assert_int_equal(bb_renderer_draw(fixture.layers, &draw, &a, &all), BB_OK);
	draw.steps_by_level = true;
	assert_int_equal(bb_renderer_draw(fixture.layers, &draw, &b, &few), BB_OK);
	assert_int_equal(bb_image_compare(&b, &a, &d), BB_OK);
	printf("%s, steps by level: %lu samples for %lu, %.1f dB from each other\n", fixture.kernel,
	       (unsigned long)few.samples, (unsigned long)all.samples, d.psnr_db);
	assert_true(few.samples < all.samples * 3 / 4 && few.samples > all.samples / 8 && d.psnr_db > 40);
	bb_image_release(&a);
	bb_image_release(&b);
	scene_free(s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(two_volumes_agree_with_the_reference),
		cmocka_unit_test(meshes_between_them_do),
		cmocka_unit_test(a_spherical_volume_does),
		cmocka_unit_test(a_ball_of_noise_has_no_end_of_phi),
		cmocka_unit_test(what_lies_after_the_numbers_is_nobodys),
		cmocka_unit_test(every_sample_has_its_points_value),
		cmocka_unit_test(every_spherical_sample_has),
		cmocka_unit_test(threads_and_trees_change_nothing),
		cmocka_unit_test(the_cpu_renderer_has_it_all),
		cmocka_unit_test(a_damaged_mesh_is_refused),
		cmocka_unit_test(a_square_divides_a_slab),
		cmocka_unit_test(equal_distances_go_by_layer),
		cmocka_unit_test(steps_by_level_take_fewer),
	};
	int failed = 0;

	struct bb_renderer *made[BB_ARRAY_LEN(kernels)] = { NULL };

	assert_int_equal(bb_renderer_reference_create(2, &fixture.reference), BB_OK);
	fixture.judge = fixture.reference;
	for (size_t k = 0; k < BB_ARRAY_LEN(kernels); k++) {
		fixture.kernel = kernels[k];
		(void)!bb_renderer_layers_create(kernels[k], 2, false, &made[k], NULL);
		fixture.layers = made[k];
		failed += cmocka_run_group_tests_name(kernels[k], tests, NULL, NULL);
		fixture.judge = fixture.judge == fixture.reference && made[k] ? made[k] : fixture.judge;
	}
	for (size_t k = 0; k < BB_ARRAY_LEN(kernels); k++)
		bb_renderer_destroy(made[k]);
	bb_renderer_destroy(fixture.reference);
	return failed;
}
