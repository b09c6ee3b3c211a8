/*
 * tests/test_mesh.c: where rays meet triangles: the tree and Embree against every triangle one after the other, edges
 * and corners that triangles share, many surfaces of one pixel, and meshes that are damaged.
 */
#include "tests/layers_scenes.h"

#include "render/mesh_scene.h"

static double drawn_number(uint32_t *state)
{
	*state = *state * 1664525U + 1013904223U;
	return *state / 4294967296.0;
}

static struct bb_mesh soup(uint32_t n, double edge_m, uint32_t *state)
{
	struct bb_mesh m = { .n_vertices = 3 * n, .n_triangles = n, .generation = 1 };
	float(*v)[3] = calloc(3 * n, sizeof(*v)), (*c)[4] = calloc(3 * n, sizeof(*c));
	uint32_t(*t)[3] = calloc(n, sizeof(*t));

	assert_true(v && c && t);
	for (uint32_t i = 0; i < n; i++)
		for (int k = 0; k < 3; k++) {
			for (int a = 0; a < 3; a++)
				v[3 * i + (uint32_t)k][a] = k ? v[3 * i][a] + (float)(edge_m * (drawn_number(state) - 0.5))
							      : (float)(drawn_number(state) * 2 - 1 + (a == 1 ? 1.4 : 0));
			for (int a = 0; a < 4; a++)
				c[3 * i + (uint32_t)k][a] = (float)drawn_number(state);
			t[i][k] = 3 * i + (uint32_t)k;
		}
	m.vertex_m = (const float(*)[3])v;
	m.rgba = (const float(*)[4])c;
	m.triangle = (const uint32_t(*)[3])t;
	return m;
}

static void every_triangle(const struct bb_mesh *m, size_t n, const struct bb_mesh_ray *ray,
			   struct bb_mesh_fragments *out)
{
	out->n = 0;
	for (uint32_t k = 0; k < n; k++)
		for (uint32_t t = 0; t < m[k].n_triangles; t++) {
			struct bb_mesh_fragment f = { .mesh = k };
			if (bb_mesh_ray_meets(ray, &m[k], t, &f))
				bb_mesh_fragments_add(out, &f);
		}
}

static bool same(const struct bb_mesh_fragments *a, const struct bb_mesh_fragments *b)
{
	return a->n == b->n && !memcmp(a->at, b->at, a->n * sizeof(a->at[0]));
}

/* How many of the rays find other fragments than by every triangle; all rays of a picture of a view. */
static unsigned differ(const struct bb_mesh_scene *s, const struct bb_mesh *m, size_t n, int view_index, size_t *most)
{
	const struct bb_view view = scene_view(view_index);
	struct bb_mesh_fragments want, got;
	unsigned odd = 0;

	memset(&want, 0, sizeof(want));
	memset(&got, 0, sizeof(got));
	for (uint32_t row = 0; row < 60; row++)
		for (uint32_t column = 0; column < 80; column++) {
			const struct bb_mesh_ray ray = bb_mesh_ray_at(&view, 80, 60, column, row);
			every_triangle(m, n, &ray, &want);
			bb_mesh_scene_meets(s, &ray, &got);
			odd += !same(&want, &got);
			*most = want.n > *most ? want.n : *most;
		}
	return odd;
}

static void trees_find_every_triangle(void **ctx)
{
	uint32_t state = 11;
	struct bb_mesh m[3] = { soup(900, 0.3, &state), soup(40, 3, &state),
				scene_icosphere((struct bb_vec3){ 0, 1.4, -0.2 }, 0.7, 3) };

	(void)ctx;
	for (int own = 0; own < 2; own++) {
		struct bb_mesh_scene *s;
		size_t most = 0;
		assert_int_equal(bb_mesh_scene_create(m, 3, own, &s, NULL), BB_OK);
		for (int view = 0; view < SCENE_VIEWS; view += 3) {
			const unsigned odd = differ(s, m, 3, view, &most);
			printf("%s, view %d: %u of 4800 rays differ, %zu surfaces at most\n",
			       bb_mesh_scene_description(s), view, odd, most);
			/* A ray that Embree sees pass an edge on its other side is one in millions. */
			assert_true(odd <= (own ? 0 : 1));
		}
		assert_true(most > 8);
		bb_mesh_scene_destroy(s);
	}
	for (int i = 0; i < 3; i++)
		scene_mesh_free(&m[i]);
}

/* Eye, edges and pixels' centres in one plane, to the last bit: a square cut along its diagonal and a fan of eight
 * triangles around a vertex in the middle of a pixel. Every pixel meets each of them once. */
static void shared_edges_are_met_once(void **ctx)
{
	static const float vertex[9][3] = { { -1, 0, 0 }, { 1, 0, 0 }, { -1, 2, 0 }, { 1, 2, 0 }, { 0, 1, 0 },
					    { 0, 0, 0 },  { 1, 1, 0 }, { 0, 2, 0 },  { -1, 1, 0 } };
	static const float rgba[9][4] = { { 1, 1, 1, 0.5F }, { 1, 1, 1, 0.5F }, { 1, 1, 1, 0.5F },
					  { 1, 1, 1, 0.5F }, { 1, 1, 1, 0.5F }, { 1, 1, 1, 0.5F },
					  { 1, 1, 1, 0.5F }, { 1, 1, 1, 0.5F }, { 1, 1, 1, 0.5F } };
	static const uint32_t square[2][3] = { { 0, 1, 2 }, { 1, 2, 3 } }; /* wound in different ways */
	static const uint32_t fan[8][3] = { { 4, 0, 5 }, { 4, 5, 1 }, { 1, 6, 4 }, { 4, 6, 3 },
					    { 3, 7, 4 }, { 4, 7, 2 }, { 2, 8, 4 }, { 4, 8, 0 } };
	const struct bb_mesh meshes[2] = { { vertex, rgba, square, 9, 2, 1 }, { vertex, rgba, fan, 9, 8, 1 } };
	const struct bb_corners wall = { { -0.75, 0.25, 0 }, { 0.75, 0.25, 0 }, { -0.75, 1.75, 0 } };
	const struct bb_view view = bb_view_make(&wall, (struct bb_vec3){ 0, 1, 2 }, wall.lower_left, 0.05, 50);

	(void)ctx;
	for (int own = 0; own < 2; own++) {
		struct bb_mesh_scene *s;
		assert_int_equal(bb_mesh_scene_create(meshes, 2, own, &s, NULL), BB_OK);
		for (uint32_t size = 1; size < 70; size += 2) /* odd: the middle is a pixel's */
			for (uint32_t i = 0; i < size * size; i++) {
				const struct bb_mesh_ray ray = bb_mesh_ray_at(&view, size, size, i % size, i / size);
				struct bb_mesh_fragments f;
				bb_mesh_scene_meets(s, &ray, &f);
				assert_int_equal(f.n, 2);
				assert_true(f.at[0].mesh == 0 && f.at[1].mesh == 1);
				assert_true(fabs(f.at[0].rgba[3] - 0.5) < 1e-12);
			}
		bb_mesh_scene_destroy(s);
	}
}

/* Coincident squares are all there, in their order; of more surfaces than a pixel has room for the farthest are left
 * out, whatever order they come in. */
static void the_nearest_surfaces_stay(void **ctx)
{
	enum { N = 50 };
	struct bb_mesh m[N];
	const struct bb_view view = scene_view(0);
	uint32_t state = 3;

	(void)ctx;
	for (int i = 0; i < N; i++) /* by sevens, so that they do not come in order; ten of them at one place */
		m[i] = scene_square((struct bb_vec3){ 0, 1.4, i < 10 ? 0 : -0.02 * (i * 7 % N) }, 3,
				    bb_quat_euler_deg(0, 90, 0));
	for (int own = 0; own < 2; own++) {
		struct bb_mesh_scene *s;
		assert_int_equal(bb_mesh_scene_create(m, N, own, &s, NULL), BB_OK);
		for (int i = 0; i < 100; i++) {
			const struct bb_mesh_ray ray = bb_mesh_ray_at(&view, 97, 89, (uint32_t)(drawn_number(&state) * 97),
								      (uint32_t)(drawn_number(&state) * 89));
			struct bb_mesh_fragments f;
			bb_mesh_scene_meets(s, &ray, &f);
			assert_int_equal(f.n, BB_MESH_FRAGMENTS_MOST);
			for (uint32_t k = 0; k < 10; k++)
				assert_true(f.at[k].mesh == k);
			for (uint32_t k = 10; k < BB_MESH_FRAGMENTS_MOST; k++)
				assert_true(f.at[k].at_m > f.at[k - 1].at_m);
			double farthest = 0; /* of those at 40 of the 50 places, 22 nearest stay */
			for (uint32_t k = 10; k < N; k++) {
				struct bb_mesh_fragment other = { .mesh = k };
				const bool there = bb_mesh_ray_meets(&ray, &m[k], 0, &other) ||
						   bb_mesh_ray_meets(&ray, &m[k], 1, &other);
				assert_true(there);
				farthest += other.at_m <= f.at[BB_MESH_FRAGMENTS_MOST - 1].at_m;
			}
			assert_true(farthest == BB_MESH_FRAGMENTS_MOST - 10);
		}
		bb_mesh_scene_destroy(s);
	}
	for (int i = 0; i < N; i++)
		scene_mesh_free(&m[i]);
}

static void colours_go_over_into_each_other(void **ctx)
{
	static const float vertex[3][3] = { { 0, 0, -1 }, { 4, 0, -1 }, { 0, 4, -1 } };
	static const float rgba[3][4] = { { 1, 0, 0, 0.2F }, { 0, 1, 0, 0.4F }, { 0, 0, 1, 1 } };
	static const uint32_t triangle[1][3] = { { 0, 1, 2 } };
	const struct bb_mesh m = { vertex, rgba, triangle, 3, 1, 1 };
	const struct bb_corners wall = { { 0, 0, -1 }, { 2, 0, -1 }, { 0, 2, -1 } };
	const struct bb_view view = bb_view_make(&wall, (struct bb_vec3){ 0.5, 0.5, 3 }, wall.lower_left, 0.05, 50);
	struct bb_mesh_fragment f;

	(void)ctx;
	for (uint32_t row = 0; row < 10; row++)
		for (uint32_t column = 0; column < 10; column++) {
			const struct bb_mesh_ray ray = bb_mesh_ray_at(&view, 10, 10, column, row);
			const double x = (column + 0.5) / 5, y = 2 - (row + 0.5) / 5;
			if (fabs(x + y - 4) < 1e-9)
				continue;
			assert_true(bb_mesh_ray_meets(&ray, &m, 0, &f));
			assert_true(fabs(f.rgba[0] - (1 - x / 4 - y / 4)) < 1e-12 && fabs(f.rgba[1] - x / 4) < 1e-12);
			assert_true(fabs(f.rgba[3] - (0.2 * f.rgba[0] + 0.4 * x / 4 + y / 4)) < 1e-7);
			assert_true(fabs(f.at_m - sqrt((x - 0.5) * (x - 0.5) + (y - 0.5) * (y - 0.5) + 16)) < 1e-9);
		}
}

static void damaged_meshes_are_refused(void **ctx)
{
	static const float bad[][3] = { { (float)NAN, 0, 0 }, { 0, HUGE_VALF, 0 }, { 0, 0, -2e6F } };
	struct bb_mesh m = scene_square((struct bb_vec3){ 0, 0, 0 }, 1, BB_QUAT_IDENTITY);
	uint32_t(*triangle)[3] = (uint32_t(*)[3])(void *)m.triangle;
	float(*vertex)[3] = (float(*)[3])(void *)m.vertex_m;
	struct bb_mesh_scene *s;
	struct bb_error err = { 0 };

	(void)ctx;
	triangle[1][2] = 4;
	assert_int_equal(bb_mesh_scene_create(&m, 1, false, &s, &err), BB_ERR_RANGE);
	assert_true(err.number == 1816 && !s);
	triangle[1][2] = 3;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		memcpy(vertex[2], bad[i], sizeof(bad[i]));
		assert_int_equal(bb_mesh_scene_create(&m, 1, true, &s, NULL), BB_ERR_RANGE);
	}
	memset(vertex, 0, 4 * sizeof(*vertex)); /* of no size: met by nobody */
	for (int own = 0; own < 2; own++) {
		struct bb_mesh_fragments f;
		const struct bb_view view = scene_view(0);
		const struct bb_mesh_ray ray = bb_mesh_ray_at(&view, 9, 9, 4, 4);
		assert_int_equal(bb_mesh_scene_create(&m, 1, own, &s, NULL), BB_OK);
		bb_mesh_scene_meets(s, &ray, &f);
		assert_int_equal(f.n, 0);
		bb_mesh_scene_destroy(s);
	}
	m.n_triangles = 0; /* nothing at all */
	for (int own = 0; own < 2; own++) {
		assert_int_equal(bb_mesh_scene_create(&m, 1, own, &s, NULL), BB_OK);
		bb_mesh_scene_destroy(s);
	}
	scene_mesh_free(&m);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(trees_find_every_triangle),     cmocka_unit_test(shared_edges_are_met_once),
		cmocka_unit_test(the_nearest_surfaces_stay),     cmocka_unit_test(colours_go_over_into_each_other),
		cmocka_unit_test(damaged_meshes_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
