/*
 * tests/test_sight.c: what views make of the nodes of an octree, against points: no node that holds a point of a
 * picture is called hidden, no voxel is wider there than was said, and a parent is worth as much as its children.
 */
#include "render/bricks/sight.h"
#include "tests/brick_rig.h"

#include <time.h>

#define VIEWS 4

static double uniform(uint64_t *state, double low, double high)
{
	return low + (high - low) * rig_random(state) / 2147483648.0;
}

static struct bb_vec3 anywhere(uint64_t *state, double reach)
{
	return (struct bb_vec3){ uniform(state, -reach, reach), uniform(state, -reach, reach),
				 uniform(state, -reach, reach) };
}

struct place { /* a volume in a room, and who looks at it */
	struct bb_tree tree;
	enum bb_brick_grid grid;
	double extent[6];
	struct bb_pose pose;
	struct bb_vec3 size_m;
	struct bb_view view[VIEWS];
	struct bb_sight_view views[VIEWS];
	size_t n_views;
	struct bb_sight_frustum frusta[VIEWS];
	struct bb_sight sight;
};

static struct bb_view some_view(uint64_t *state)
{
	const struct bb_pose wall = { anywhere(state, 3),
				      bb_quat_euler_deg(uniform(state, -180, 180), uniform(state, -90, 90),
							uniform(state, -180, 180)) };
	const double width = uniform(state, 0.3, 4), height = uniform(state, 0.3, 4);
	const struct bb_corners c = {
		bb_pose_apply(&wall, (struct bb_vec3){ -width / 2, -height / 2, 0 }),
		bb_pose_apply(&wall, (struct bb_vec3){ width / 2, -height / 2, 0 }),
		bb_pose_apply(&wall, (struct bb_vec3){ -width / 2 + uniform(state, -0.1, 0.1), height / 2, 0 }),
	};
	const struct bb_vec3 eye = bb_pose_apply(
		&wall, (struct bb_vec3){ uniform(state, -3, 3), uniform(state, -2, 2), uniform(state, 0.01, 4) });

	return bb_view_make(&c, eye, eye, 0.05, 60);
}

static void some_place(struct place *p, uint64_t *state, enum bb_brick_grid grid)
{
	const uint32_t dim[3] = { 5 + rig_random(state) % 200, 5 + rig_random(state) % 100,
				  5 + rig_random(state) % 90 };
	const double around = uniform(state, 0, 1) < 0.5 ? 1 : uniform(state, 0.1, 1);

	*p = (struct place){ .grid = grid, .n_views = 1 + rig_random(state) % VIEWS };
	assert_true(bb_tree_init(&p->tree, dim, 1, 8));
	p->size_m = (struct bb_vec3){ uniform(state, 0.1, 4), uniform(state, 0.1, 4), uniform(state, 0.1, 4) };
	if (grid == BB_BRICK_SPHERICAL) {
		const double pi = acos(-1), theta = uniform(state, 0, 1), phi = uniform(state, -pi, pi);
		const double extent[6] = { uniform(state, 0, 2), 3, theta, theta + uniform(state, 0.1, pi - theta), phi,
					   phi + around * 2 * pi };
		memcpy(p->extent, extent, sizeof(extent));
		p->size_m = (struct bb_vec3){ p->size_m.x, p->size_m.x, p->size_m.x };
	}
	p->pose = (struct bb_pose){ anywhere(state, 2),
				    bb_quat_euler_deg(uniform(state, -180, 180), uniform(state, -90, 90), 0) };
	for (size_t i = 0; i < p->n_views; i++) {
		p->view[i] = some_view(state);
		p->views[i] = (struct bb_sight_view){ &p->view[i], 200 + rig_random(state) % 2000,
						      200 + rig_random(state) % 2000 };
	}
	bb_sight_prepare(&p->tree, grid, p->extent, &p->pose, p->size_m, p->views, p->n_views, NULL, p->frusta,
			 &p->sight);
}

/* Where voxel coordinates of the data (faces at whole numbers) lie in the room, and how long a voxel's edges are. */
static struct bb_vec3 in_room(const struct place *p, const double at[3], double voxel_m[3])
{
	const double *e = p->extent, size[3] = { p->size_m.x, p->size_m.y, p->size_m.z };
	double q[3], part[3];

	for (int a = 0; a < 3; a++)
		part[a] = at[a] / p->tree.dim[a];
	if (p->grid == BB_BRICK_SPHERICAL) {
		const double per = p->size_m.x / 2 / e[1], r = (e[0] + part[0] * (e[1] - e[0])) * per;
		const double theta = e[2] + part[1] * (e[3] - e[2]), phi = e[4] + part[2] * (e[5] - e[4]);
		q[0] = r * sin(theta) * cos(phi);
		q[1] = r * cos(theta);
		q[2] = r * sin(theta) * sin(phi);
		voxel_m[0] = (e[1] - e[0]) * per / p->tree.dim[0];
		voxel_m[1] = r * (e[3] - e[2]) / p->tree.dim[1];
		voxel_m[2] = r * sin(theta) * (e[5] - e[4]) / p->tree.dim[2];
	} else {
		for (int a = 0; a < 3; a++) {
			q[a] = (part[a] - 0.5) * size[a];
			voxel_m[a] = size[a] / p->tree.dim[a];
		}
	}
	return bb_pose_apply(&p->pose, (struct bb_vec3){ q[0], q[1], q[2] });
}

/* Pixels between a point and one a voxel's edge beside it, parallel to the wall; 0: the point is in no picture. */
static double pixels_at(const struct place *p, struct bb_vec3 point, double voxel_m)
{
	double most = 0;

	for (size_t i = 0; i < p->n_views; i++) {
		const struct bb_view *v = &p->view[i];
		const struct bb_vec3 beside = bb_vec3_add(point, bb_vec3_scale(v->right, voxel_m));
		double here[3], there[3], w, w2;
		bb_view_project(v, point, here, &w);
		bb_view_project(v, beside, there, &w2);
		if (w > 0.05 && fabs(here[0]) <= 1 && fabs(here[1]) <= 1)
			most = fmax(most, (there[0] - here[0]) / 2 * p->views[i].width_px);
	}
	return most;
}

struct tally {
	size_t boxes, seen, called;
};

/* Random points of a node: the widest voxel a picture shows there. 0: none of them is in a picture. */
static double widest(const struct place *p, uint32_t node, uint64_t *state, int points)
{
	const struct bb_tree *t = &p->tree;
	const struct bb_tree_place at = bb_tree_place(t, node);
	const double reach = ldexp(t->edge, (int)(t->n_levels - 1 - at.level));
	double most = 0;

	for (int i = 0; i < points; i++) {
		double q[3], voxel_m[3];
		for (int a = 0; a < 3; a++) {
			const double from = at.at[a] * reach, to = fmin(from + reach, t->dim[a]);
			q[a] = i < 8 ? (i >> a & 1 ? to : from) : uniform(state, from, to);
		}
		const struct bb_vec3 point = in_room(p, q, voxel_m);
		most = fmax(most, pixels_at(p, point, fmax(voxel_m[0], fmax(voxel_m[1], voxel_m[2]))));
	}
	return most;
}

static void judge(const struct place *p, uint32_t node, uint64_t *state, int points, struct tally *n)
{
	const uint32_t up = p->tree.n_levels - 1 - bb_tree_place(&p->tree, node).level;
	const double most = widest(p, node, state, points);
	const double have = (double)bb_sight_pixels(&p->sight, node);

	n->boxes++;
	n->seen += most > 0;
	n->called += have > 0;
	if (most > 0 && have < fmin(most, BB_SIGHT_PIXELS_MOST) * ldexp(1, (int)up) * 0.99999)
		fail_msg("node %u shows voxels of %g pixels, said to be %g", node, most * ldexp(1, (int)up), have);
}

static void tallied(enum bb_brick_grid grid, const char *name, uint64_t seed)
{
	struct tally n = { 0 };

	while (n.boxes < 100000) {
		struct place p;
		some_place(&p, &seed, grid);
		for (int i = 0; i < 500; i++)
			judge(&p, rig_random(&seed) % p.tree.n_nodes, &seed, 16, &n);
	}
	print_message("%s: %zu nodes, %zu with one of 16 points in a picture, none of them called hidden; %zu called "
		      "visible\n",
		      name, n.boxes, n.seen, n.called);
	assert_true(n.seen > n.boxes / 20 && n.called < n.boxes * 9 / 10);
}

static void nothing_in_a_picture_is_called_hidden(void **state)
{
	(void)state;
	tallied(BB_BRICK_CARTESIAN, "Cartesian", 3);
	tallied(BB_BRICK_SPHERICAL, "spherical", 5);
}

/* What is called visible and has none of 4000 points in a picture: the price of boxes and planes. */
static void little_hidden_is_called_visible(void **state)
{
	uint64_t seed = 11;
	struct tally n[2] = { { 0 } };
	(void)state;

	for (int grid = 0; grid < 2; grid++) {
		for (int k = 0; k < 60; k++) {
			struct place p;
			some_place(&p, &seed, (enum bb_brick_grid)grid);
			for (int i = 0; i < 20; i++) {
				const uint32_t leaves = p.tree.n_nodes - p.tree.first[p.tree.n_levels - 1];
				judge(&p, p.tree.first[p.tree.n_levels - 1] + rig_random(&seed) % leaves, &seed, 1000,
				      &n[grid]);
			}
		}
		print_message("%s leaves: %.1f %% hidden by points, %.1f %% called so\n",
			      grid ? "spherical" : "Cartesian",
			      100 - 100.0 * (double)n[grid].seen / (double)n[grid].boxes,
			      100 - 100.0 * (double)n[grid].called / (double)n[grid].boxes);
		assert_true((double)(n[grid].called - n[grid].seen) < 0.1 * (double)n[grid].boxes);
	}
}

static void a_parent_is_worth_its_children(void **state)
{
	uint64_t seed = 21;
	size_t edges = 0;
	(void)state;

	for (int k = 0; k < 200; k++) {
		struct place p;
		some_place(&p, &seed, (enum bb_brick_grid)(k % 2));
		float *seen = calloc(p.tree.n_nodes, sizeof(*seen));
		assert_non_null(seen);
		for (uint32_t i = p.tree.first[p.tree.n_levels - 1]; i < p.tree.n_nodes; i++)
			seen[i] = (float)uniform(&seed, 0, 1);
		bb_sight_seen(&p.tree, seen);
		p.sight.seen = seen;
		for (uint32_t i = 0; i < p.tree.n_nodes; i++) {
			uint32_t child[8];
			const uint32_t n = bb_tree_children(&p.tree, i, child);
			for (uint32_t c = 0; c < n; c++, edges++) {
				assert_true(seen[i] >= seen[child[c]]);
				assert_true(bb_sight_weight(&p.sight, i) >= bb_sight_weight(&p.sight, child[c]));
				assert_true(bb_sight_pixels(&p.sight, i) >=
					    2 * bb_sight_pixels(&p.sight, child[c]) * 0.999999f);
			}
		}
		free(seen);
	}
	print_message("%zu parents and children\n", edges);
}

/* A wall 1 m ahead, 1 m wide, 100 pixels; a cube of 1 m whose middle is 2 m away. */
static void numbers_by_hand(void **state)
{
	const struct bb_corners c = { { -0.5, -0.5, -1 }, { 0.5, -0.5, -1 }, { -0.5, 0.5, -1 } };
	const struct bb_view view =
		bb_view_make(&c, (struct bb_vec3){ 0, 0, 0 }, (struct bb_vec3){ 0, 0, 0 }, 0.05, 60);
	const struct bb_sight_view views[] = { { &view, 100, 50 } };
	struct bb_pose pose = { { 0, 0, -2 }, BB_QUAT_IDENTITY };
	struct bb_sight_frustum f[1];
	struct bb_sight s;
	struct bb_tree t;
	float seen[9] = { 0 };
	(void)state;

	assert_true(bb_tree_init(&t, (const uint32_t[]){ 16, 16, 16 }, 1, 8));
	assert_int_equal(t.n_nodes, 9);
	bb_sight_prepare(&t, BB_BRICK_CARTESIAN, NULL, &pose, (struct bb_vec3){ 1, 1, 1 }, views, 1, NULL, f, &s);
	/* The root: its box, a voxel of 1/8 m wide on either side, begins at 1.5 - 1/16 m. */
	assert_true(fabs((double)bb_sight_pixels(&s, 0) - 100.0 / 8 / (1.5 - 1.0 / 16)) < 1e-4);
	/* A leaf behind: begins at 2 - 1/32 m; one in front at 1.5 - 1/32 m. z grows towards the eye. */
	assert_true(fabs((double)bb_sight_pixels(&s, 1) - 100.0 / 16 / (2 - 1.0 / 32)) < 1e-4);
	assert_true(fabs((double)bb_sight_pixels(&s, 5) - 100.0 / 16 / (1.5 - 1.0 / 32)) < 1e-4);
	const double p = 100.0 / 16 / (1.5 - 1.0 / 32);
	assert_true(fabs((double)bb_sight_weight(&s, 5) - p * p) < 1e-3);
	seen[5] = 0.5f;
	bb_sight_seen(&t, seen);
	assert_true(seen[0] >= 0.5f && seen[0] <= 0.5f);
	s.seen = seen;
	assert_true(fabs((double)bb_sight_weight(&s, 5) - p * p / 2) < 1e-3);
	assert_true(fabs((double)bb_sight_weight(&s, 6) - p * p * BB_SIGHT_SEEN_LEAST) < 1e-3);
	/* Behind the eye; far away, where a voxel of the root is 0.5 pixels; beside the wall. */
	const struct {
		struct bb_vec3 at;
		bool seen, worth;
	} rows[] = {
		{ { 0, 0, 2 }, false, false },  { { 0, 0, -25 }, true, false }, { { 5, 0, -2 }, false, false },
		{ { 1.2, 0, -2 }, true, true }, { { 0, 0, 0 }, true, true },
	};
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		pose.p = rows[i].at;
		bb_sight_prepare(&t, BB_BRICK_CARTESIAN, NULL, &pose, (struct bb_vec3){ 1, 1, 1 }, views, 1, NULL, f,
				 &s);
		assert_true((bb_sight_pixels(&s, 0) > 0) == rows[i].seen);
		assert_true((bb_sight_weight(&s, 0) > 0) == rows[i].worth);
	}
	bb_sight_prepare(&t, BB_BRICK_CARTESIAN, NULL, &pose, (struct bb_vec3){ 1, 1, 1 }, views, 0, NULL, f, &s);
	assert_true(bb_sight_pixels(&s, 0) <= 0); /* nobody looks */
}

static void asking_is_cheap(void **state)
{
	uint64_t seed = 31;
	(void)state;

	for (int grid = 0; grid < 2; grid++) {
		struct bb_view view[10];
		struct bb_sight_view views[10];
		struct bb_sight_frustum frusta[10];
		struct bb_sight s;
		struct place p;
		double best = 1e9;
		some_place(&p, &seed, (enum bb_brick_grid)grid);
		for (int i = 0; i < 10; i++) {
			view[i] = some_view(&seed);
			views[i] = (struct bb_sight_view){ &view[i], 1920, 1080 };
		}
		bb_sight_prepare(&p.tree, p.grid, p.extent, &p.pose, p.size_m, views, 10, NULL, frusta, &s);
		for (int k = 0; k < 20; k++) {
			struct timespec a, b;
			float sum = 0;
			clock_gettime(CLOCK_THREAD_CPUTIME_ID, &a);
			for (uint32_t i = 0; i < 10000; i++)
				sum += bb_sight_weight(&s, i % p.tree.n_nodes);
			clock_gettime(CLOCK_THREAD_CPUTIME_ID, &b);
			assert_true(sum >= 0);
			best = fmin(best, (double)(b.tv_sec - a.tv_sec) * 1e9 + (double)(b.tv_nsec - a.tv_nsec));
		}
		print_message("%s: %.0f ns a node, ten views\n", grid ? "spherical" : "Cartesian", best / 10000);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(nothing_in_a_picture_is_called_hidden),
		cmocka_unit_test(little_hidden_is_called_visible),
		cmocka_unit_test(a_parent_is_worth_its_children),
		cmocka_unit_test(numbers_by_hand),
		cmocka_unit_test(asking_is_cheap),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
