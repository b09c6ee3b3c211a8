/*
 * tests/test_sight_worth.c: what it is worth to know what the views see: the error that is left in the pictures when
 * bricks are chosen without it, by what lies in a picture at all, by how large it is there, and by what hides it.
 */
#include "render/bricks/selector.h"
#include "render/bricks/sight.h"
#include "tests/brick_rig.h"

#define VIEWS_MOST 10
#define STEP 1

struct scene {
	const char *name;
	struct bb_pose pose;
	struct bb_vec3 size_m;
	struct bb_vec3 eyes;
	size_t n_walls;
};

/* Five walls of a cabin of 3 m, around the origin; the first is ahead. */
static struct bb_corners wall(size_t i)
{
	static const struct bb_corners walls[] = {
		{ { -1.5, -1.5, -1.5 }, { 1.5, -1.5, -1.5 }, { -1.5, 1.5, -1.5 } },
		{ { -1.5, -1.5, 1.5 }, { -1.5, -1.5, -1.5 }, { -1.5, 1.5, 1.5 } },
		{ { 1.5, -1.5, -1.5 }, { 1.5, -1.5, 1.5 }, { 1.5, 1.5, -1.5 } },
		{ { -1.5, -1.5, 1.5 }, { 1.5, -1.5, 1.5 }, { -1.5, -1.5, -1.5 } },
		{ { -1.5, 1.5, -1.5 }, { 1.5, 1.5, -1.5 }, { -1.5, 1.5, 1.5 } },
	};
	return walls[i];
}

struct worth {
	struct brick_rig rig;
	struct bb_bricks *b;
	const struct bb_tree *t;
	struct bb_ratings r;
	struct bb_choice *heap, *out;
	struct bb_view view[VIEWS_MOST];
	struct bb_sight_view views[VIEWS_MOST];
	struct bb_sight_frustum frusta[VIEWS_MOST];
	struct bb_sight sight;
	float *seen, *weight, *area;
};

static struct bb_transfer filled(void)
{
	struct bb_transfer tf = { .n = 3, .least_visible = 0 };

	tf.point[0] = (struct bb_transfer_point){ 0, 0, 0.2, 0.6, 0.02 };
	tf.point[1] = (struct bb_transfer_point){ 0.6, 0.1, 0.7, 0.3, 0.05 };
	tf.point[2] = (struct bb_transfer_point){ 1, 1, 0.5, 0.1, 0.25 };
	return tf;
}

static void begin(struct worth *w)
{
	const struct bb_transfer tf = filled();
	struct bb_error err = { 0 };

	rig_begin(&w->rig, 96, 80, 88, 2, 8);
	w->b = rig_build(&w->rig);
	w->t = &bb_bricks_header(w->b)->tree;
	w->r = (struct bb_ratings){ malloc(w->t->n_bricks * 4), malloc(w->t->n_bricks * 4),
				    malloc(w->t->n_bricks * 4) };
	w->heap = malloc(bb_choose_most(w->t) * sizeof(*w->heap));
	w->out = malloc(bb_choose_most(w->t) * sizeof(*w->out));
	w->seen = calloc(w->t->n_nodes, 4);
	w->weight = calloc(w->t->n_nodes, 4);
	w->area = calloc(w->t->n_nodes, 4);
	assert_true(w->r.space && w->r.time && w->r.work && w->heap && w->out && w->seen && w->weight && w->area);
	assert_int_equal(bb_selector_find("far")->rate(w->b, &tf, &w->r, &err), BB_OK);
}

static void end(struct worth *w)
{
	free(w->r.space);
	free(w->r.time);
	free(w->r.work);
	free(w->heap);
	free(w->out);
	free(w->seen);
	free(w->weight);
	free(w->area);
	bb_bricks_close(w->b);
	rig_end(&w->rig);
}

static void look(struct worth *w, const struct scene *s)
{
	for (size_t i = 0; i < s->n_walls * 2; i++) {
		const struct bb_corners c = wall(i / 2);
		const struct bb_vec3 eye = bb_vec3_add(s->eyes, (struct bb_vec3){ i % 2 ? 0.032 : -0.032, 0, 0 });
		w->view[i] = bb_view_make(&c, eye, eye, 0.05, 60);
		w->views[i] = (struct bb_sight_view){ &w->view[i], 1920, 1920 };
	}
	bb_sight_prepare(w->t, BB_BRICK_CARTESIAN, NULL, &s->pose, s->size_m, w->views, s->n_walls * 2, NULL, w->frusta,
			 &w->sight);
}

/* Light that reaches a leaf's middle from the eyes, through the means of the leaves on its way. */
static float light_at(const struct worth *w, const struct scene *s, const struct bb_transfer *tf, uint32_t leaf)
{
	const struct bb_tree_place p = bb_tree_place(w->t, leaf);
	const struct bb_bricks_header *h = bb_bricks_header(w->b);
	const double size[3] = { s->size_m.x, s->size_m.y, s->size_m.z };
	const struct bb_vec3 eye_m = bb_pose_inverse_apply(&s->pose, s->eyes);
	const double eye[3] = { eye_m.x, eye_m.y, eye_m.z };
	double from[3], way[3], length = 0, light = 1;

	for (int a = 0; a < 3; a++) {
		from[a] = (eye[a] / size[a] + 0.5) * w->t->dim[a];
		way[a] = (p.at[a] + 0.5) * w->t->edge - from[a];
		length += way[a] * way[a];
	}
	const double steps = ceil(sqrt(length));
	for (double k = 0.5; k < steps; k++) {
		struct bb_tree_place at = { .level = w->t->n_levels - 1 };
		bool in = true;
		for (int a = 0; a < 3; a++) {
			const double x = from[a] + way[a] * k / steps;
			in = in && x >= 0 && x < w->t->dim[a];
			at.at[a] = in ? (uint32_t)x / w->t->edge : 0;
		}
		const uint32_t node = in ? bb_tree_node(w->t, &at) : leaf;
		if (node == leaf)
			continue;
		const uint64_t id = (uint64_t)bb_tree_leaf_time(w->t, STEP) * w->t->n_nodes + node;
		double rgba[4];
		bb_transfer_at(tf, ((double)bb_bricks_moments(w->b)[id].mean - h->least) / (h->most - h->least), rgba);
		light *= 1 - rgba[3];
	}
	return (float)light;
}

/* Of a leaf's error: how many pixels show each of its voxels, dimmed by what lies in front. */
static void prepare(struct worth *w, const struct scene *s)
{
	const struct bb_transfer tf = filled();

	look(w, s);
	for (uint32_t leaf = w->t->first[w->t->n_levels - 1]; leaf < w->t->n_nodes; leaf++) {
		const float pixels = bb_sight_pixels(&w->sight, leaf);
		w->seen[leaf] = light_at(w, s, &tf, leaf);
		w->area[leaf] = pixels * pixels * w->seen[leaf];
	}
	bb_sight_seen(w->t, w->seen);
}

/* Error of a chosen brick, spread over its leaves, times what the pictures show of them. */
static double error_in_pictures(const struct worth *w, uint32_t node, double each)
{
	uint32_t child[8];
	const uint32_t n = bb_tree_children(w->t, node, child);
	double sum = 0;

	for (uint32_t i = 0; i < n; i++)
		sum += error_in_pictures(w, child[i], each);
	return n ? sum : each * (double)bb_tree_covered(w->t, node) * (double)w->area[node];
}

static double left_with(const struct worth *w, uint32_t memory, const float *weight)
{
	const struct bb_choose_budget budget = { .memory_bricks = memory, .weight = weight };
	const size_t n = bb_choose_by_budget(w->t, w->r.space, w->r.time, STEP, &budget, w->heap, w->out);
	double sum = 0;

	assert_true(n >= 1 && n <= memory);
	for (size_t i = 0; i < n; i++) {
		const struct bb_tree_span s = bb_tree_span(w->t, w->out[i].tau);
		const double all = (double)w->r.work[(uint64_t)w->out[i].tau * w->t->n_nodes + w->out[i].node];
		const double voxels = (double)bb_tree_covered(w->t, w->out[i].node) * (s.to - s.from);
		sum += error_in_pictures(w, w->out[i].node, all / voxels);
	}
	return sum;
}

static void each_part_of_a_view_is_worth_something(void **state)
{
	static const struct scene scenes[] = {
		{ "a wall, half of the volume beside it",
		  { { 1.6, 0, -2.5 }, BB_QUAT_IDENTITY },
		  { 3, 2.5, 2.75 },
		  { 0, 0, 0 },
		  1 },
		{ "five walls, the head inside",
		  { { 0, 0, -0.8 }, BB_QUAT_IDENTITY },
		  { 3, 2.5, 2.75 },
		  { 0.2, 0.1, 0.1 },
		  5 },
		{ "five walls, the volume ahead",
		  { { 0, 0, -4 }, BB_QUAT_IDENTITY },
		  { 3, 2.5, 2.75 },
		  { 0, 0, 0 },
		  5 },
	};
	struct worth w;
	(void)state;

	begin(&w);
	const uint32_t memory = (uint32_t)bb_choose_most(w.t) / 8;
	for (size_t i = 0; i < BB_ARRAY_LEN(scenes); i++) {
		double left[4];
		prepare(&w, &scenes[i]);
		left[0] = left_with(&w, memory, NULL);
		for (uint32_t node = 0; node < w.t->n_nodes; node++)
			w.weight[node] = bb_sight_pixels(&w.sight, node) > 0;
		left[1] = left_with(&w, memory, w.weight);
		bb_sight_weights(&w.sight, w.weight);
		left[2] = left_with(&w, memory, w.weight);
		w.sight.seen = w.seen;
		bb_sight_weights(&w.sight, w.weight);
		left[3] = left_with(&w, memory, w.weight);
		print_message(
			"%-40s error left in the pictures: 1 without views, %.3f by frustum, %.3f by area, %.3f by "
			"occlusion, too\n",
			scenes[i].name, left[1] / left[0], left[2] / left[0], left[3] / left[0]);
		assert_true(left[1] <= left[0] * 1.001 && left[2] <= left[1] * 1.001 && left[3] <= left[2] * 1.001);
		assert_true(left[3] < left[0] * 0.9);
	}
	end(&w);
}

/* A volume so far away that a pixel holds two voxels of the finest but one level: none of the finest is taken. */
static void nothing_finer_than_a_pixel_is_taken(void **state)
{
	const struct scene s = { "far", { { 0, 0, -2 }, BB_QUAT_IDENTITY }, { 0.03, 0.03, 0.03 }, { 0, 0, 0 }, 1 };
	struct worth w;
	(void)state;

	begin(&w);
	look(&w, &s);
	bb_sight_weights(&w.sight, w.weight);
	const uint32_t finest = w.t->first[w.t->n_levels - 1];
	const struct bb_choose_budget budget = { .memory_bricks = UINT32_MAX, .weight = w.weight };
	const size_t n = bb_choose_by_budget(w.t, w.r.space, w.r.time, STEP, &budget, w.heap, w.out);
	assert_true(n > 1);
	for (size_t i = 0; i < n; i++)
		assert_true(w.out[i].node < finest);
	end(&w);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(each_part_of_a_view_is_worth_something),
		cmocka_unit_test(nothing_finer_than_a_pixel_is_taken),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
