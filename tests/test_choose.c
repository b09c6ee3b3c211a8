/* tests/test_choose.c: what every way of choosing bricks must hold, and how far the heuristics are from the optimum. */
#include "render/bricks/perceived.h"
#include "render/bricks/selector.h"
#include "tests/brick_rig.h"

static struct bb_transfer tent(void) /* sees the upper half, with a peak */
{
	struct bb_transfer tf = { .n = 4, .least_visible = 0.4 };

	tf.point[0] = (struct bb_transfer_point){ 0, 0, 0, 0, 0 };
	tf.point[1] = (struct bb_transfer_point){ 0.4, 0.1, 0.1, 0.4, 0 };
	tf.point[2] = (struct bb_transfer_point){ 0.7, 1, 0.6, 0.1, 0.5 };
	tf.point[3] = (struct bb_transfer_point){ 1, 1, 1, 0.2, 0.1 };
	return tf;
}

/* Each leaf of the octree exactly once, all at the step. */
static void covers(const struct bb_tree *t, const struct bb_choice *c, size_t n, uint32_t step)
{
	const uint32_t first = t->first[t->n_levels - 1];
	uint8_t *seen = calloc(t->n_nodes, 1);

	assert_non_null(seen);
	for (size_t i = 0; i < n; i++) {
		const struct bb_tree_span s = bb_tree_span(t, c[i].tau);
		assert_true(c[i].node < t->n_nodes && s.from <= step && step < s.to);
		seen[c[i].node]++;
	}
	for (uint32_t leaf = first; leaf < t->n_nodes; leaf++) {
		int times = 0;
		for (uint32_t node = leaf; node != BB_TREE_NONE; node = bb_tree_parent(t, node))
			times += seen[node];
		assert_int_equal(times, 1);
	}
	free(seen);
}

struct choosing {
	struct brick_rig rig;
	struct bb_bricks *b;
	const struct bb_tree *t;
	float *space, *time, *work;
	struct bb_choice *heap, *out;
};

static void open_rig(struct choosing *c)
{
	c->b = rig_build(&c->rig);
	c->t = &bb_bricks_header(c->b)->tree;
	c->space = malloc(c->t->n_bricks * 4);
	c->time = malloc(c->t->n_bricks * 4);
	c->work = malloc(c->t->n_bricks * 4);
	c->heap = malloc(bb_choose_most(c->t) * sizeof(*c->heap));
	c->out = malloc(bb_choose_most(c->t) * sizeof(*c->out));
	assert_true(c->space && c->time && c->work && c->heap && c->out);
}

static void begin(struct choosing *c, uint32_t nx, uint32_t ny, uint32_t nz, uint32_t steps, uint32_t edge)
{
	rig_begin(&c->rig, nx, ny, nz, steps, edge);
	open_rig(c);
}

static void end(struct choosing *c)
{
	free(c->space);
	free(c->time);
	free(c->work);
	free(c->heap);
	free(c->out);
	bb_bricks_close(c->b);
	rig_end(&c->rig);
}

static void rate(struct choosing *c, enum bb_gain_method method)
{
	const struct bb_transfer tf = tent();
	struct bb_gain_weights w;
	struct bb_error err = { 0 };

	bb_gain_weights(&tf, &w);
	if (bb_gain_points(c->b, &w, method, c->space, c->time, c->work, &err) != BB_OK)
		fail_msg("%s", err.text);
}

static double stream_of(const struct bb_tree *t, const struct bb_choice *c, size_t n)
{
	double sum = 0;

	for (size_t i = 0; i < n; i++) {
		const struct bb_tree_span s = bb_tree_span(t, c[i].tau);
		sum += 1.0 / (s.to - s.from);
	}
	return sum;
}

static void budgets_are_kept_by_every_method(void **state)
{
	struct choosing c;
	(void)state;

	begin(&c, 60, 41, 50, 5, 8);
	for (int method = 0; method < BB_GAIN_METHODS; method++) {
		rate(&c, (enum bb_gain_method)method);
		for (uint64_t id = 0; id < c.t->n_bricks; id++) {
			const bool leaf = bb_tree_place(c.t, (uint32_t)(id % c.t->n_nodes)).level + 1 == c.t->n_levels;
			const struct bb_tree_span s = bb_tree_span(c.t, (uint32_t)(id / c.t->n_nodes));
			assert_true(leaf == (c.space[id] < 0) && (s.to - s.from == 1) == (c.time[id] < 0));
		}
		for (uint32_t memory = 1; memory < 400; memory += 13)
			for (double stream = 0; stream < 60; stream += 7.3) {
				const struct bb_choose_budget budget = { .memory_bricks = memory,
									 .stream_bricks = stream };
				const size_t n =
					bb_choose_by_budget(c.t, c.space, c.time, memory % 5, &budget, c.heap, c.out);
				assert_true(n >= 1 && n <= memory);
				assert_true(stream <= 0 || stream_of(c.t, c.out, n) <= stream + 1e-9);
				covers(c.t, c.out, n, memory % 5);
			}
	}
	end(&c);
}

static void without_limits_all_that_gains_is_split(void **state)
{
	const struct bb_choose_budget budget = { .memory_bricks = UINT32_MAX };
	struct choosing c;
	(void)state;

	begin(&c, 33, 24, 17, 3, 8);
	rate(&c, BB_GAIN_CHILD);
	const size_t n = bb_choose_by_budget(c.t, c.space, c.time, 1, &budget, c.heap, c.out);
	for (size_t i = 0; i < n; i++) {
		const uint64_t id = (uint64_t)c.out[i].tau * c.t->n_nodes + c.out[i].node;
		assert_true(!(c.space[id] > 0) && !(c.time[id] > 0));
	}
	covers(c.t, c.out, n, 1);
	end(&c);
}

static double left_with(struct choosing *c, enum bb_gain_method method, double stream)
{
	const struct bb_choose_budget budget = { .memory_bricks = UINT32_MAX, .stream_bricks = stream };
	double sum = 0;

	rate(c, method);
	const size_t n = bb_choose_by_budget(c->t, c->space, c->time, 1, &budget, c->heap, c->out);
	covers(c->t, c->out, n, 1);
	for (size_t i = 0; i < n; i++)
		sum += (double)c->work[(uint64_t)c->out[i].tau * c->t->n_nodes + c->out[i].node];
	return sum / (double)c->work[0];
}

/* One of eight voxels is bright or dark, in turn: the level above the data is wrong everywhere, the one above that,
 * which is grey again, in these voxels only. */
static void far_error_does_not_stop_half_way(void **state)
{
	struct choosing c;
	(void)state;

	rig_begin(&c.rig, 32, 32, 32, 3, 8);
	for (size_t i = 0; i < rig_voxels(&c.rig) * 3; i++) {
		const size_t x = i % 32, y = i / 32 % 32, z = i / 1024 % 32;
		const bool odd = x & y & z & 1, bright = (x / 2 ^ y / 2 ^ z / 2) & 1;
		c.rig.voxels[i] = odd ? (bright ? 1.f : 0.f) : 0.5f;
	}
	rig_write(&c.rig);
	open_rig(&c);
	assert_true(left_with(&c, BB_GAIN_LEAF, 0) > 0.99); /* or the test shows nothing */
	for (double stream = 0; stream < 2000; stream += 1000)
		assert_true(left_with(&c, BB_GAIN_FAR, stream) <= 0);
	end(&c);
}

/* What far error says of a brick is the best of all depths, added up here the slow way. */
static double best_depth(const struct choosing *c, uint32_t tau, uint32_t node, uint32_t depth, double *bricks)
{
	uint32_t child[8];
	const uint32_t n = bb_tree_children(c->t, node, child);
	double sum = 0, many = 0;

	if (!depth) {
		*bricks = 1;
		return (double)c->work[(uint64_t)tau * c->t->n_nodes + node];
	}
	for (uint32_t i = 0; i < n; i++) {
		double here;
		sum += best_depth(c, tau, child[i], depth - 1, &here);
		many += here;
	}
	*bricks = many;
	return sum;
}

static void best_of_all_depths(bool noise)
{
	struct choosing c;
	uint64_t seed = 8;

	rig_begin(&c.rig, 37, 30, 21, 5, 4);
	for (size_t i = 0; noise && i < rig_voxels(&c.rig) * 5; i++)
		c.rig.voxels[i] = (float)(rig_random(&seed) % 1000);
	rig_write(&c.rig);
	open_rig(&c);
	rate(&c, BB_GAIN_FAR);
	for (uint64_t id = 0; id < c.t->n_bricks; id++) {
		const uint32_t node = (uint32_t)(id % c.t->n_nodes), tau = (uint32_t)(id / c.t->n_nodes);
		const uint32_t levels = c.t->n_levels - 1 - bb_tree_place(c.t, node).level;
		double best = levels ? 0 : -1, bricks;
		for (uint32_t depth = 1; depth <= levels; depth++) {
			const double left = best_depth(&c, tau, node, depth, &bricks);
			best = bricks > 1 ? fmax(best, ((double)c.work[id] - left) / bricks) : best;
		}
		assert_true(fabs((double)c.space[id] - best) <= 1e-5 * fmax(fabs(best), (double)c.work[id] * 1e-2));
	}
	end(&c);
}

static void far_points_are_the_best_of_all_depths(void **state)
{
	(void)state;

	best_of_all_depths(false);
	best_of_all_depths(true); /* averages of it are all alike: the deepest split gains most */
}

/* A row of four leaves, two steps. The mean over both steps would split node 1, the step on show node 2. */
static void a_brick_is_judged_by_its_step_when_streaming_is_free(void **state)
{
	const float space[3][7] = { { 9, 5, 4, -1, -1, -1, -1 },
				    { 9, 1, 8, -1, -1, -1, -1 },
				    { 9, 9, 0, -1, -1, -1, -1 } };
	const float time[3][7] = { { 3, 1, 1, 1, 1, 1, 1 },
				   { -1, -1, -1, -1, -1, -1, -1 },
				   { -1, -1, -1, -1, -1, -1, -1 } };
	struct bb_choice heap[4], out[4];
	struct bb_tree t;
	(void)state;

	assert_true(bb_tree_init(&t, (const uint32_t[]){ 32, 8, 8 }, 2, 8));
	assert_true(t.n_nodes == 7 && t.n_times == 3);
	for (int free_time = 0; free_time < 2; free_time++) {
		const struct bb_choose_budget budget = { .memory_bricks = 3, .stream_bricks = free_time ? 0 : 100 };
		const size_t n = bb_choose_by_budget(&t, space[0], time[0], 0, &budget, heap, out);
		bool split[3] = { true, true, true };
		assert_int_equal(n, 3);
		covers(&t, out, n, 0);
		for (size_t i = 0; i < n; i++)
			if (out[i].node < 3)
				split[out[i].node] = false;
		assert_true(split[1] == !free_time && split[2] == free_time);
	}
}

static void weights_in_lab_by_hand(void **state)
{
	struct bb_transfer tf = { .n = 2 };
	struct bb_gain_weights w;
	double lab[3];
	(void)state;

	tf.point[0] = (struct bb_transfer_point){ 0, 0.5, 0.5, 0.5, 0.1 };
	tf.point[1] = (struct bb_transfer_point){ 1, 0.5, 0.5, 0.5, 0.1 };
	bb_gain_weights_of(&tf, BB_GAIN_LAB, &w);
	const double grey = 0.5 * (1 - pow(0.9, BB_GAIN_SLAB_VOXELS));
	bb_perceived_lab((const double[]){ grey, grey, grey }, lab);
	for (int i = 0; i < BB_STATS_BINS; i++) {
		assert_true(fabs((double)w.opacity[i] - lab[0] / 100) < 1e-5);
		assert_true(w.change[i] <= 0);
	}
	tf.point[0].opacity = 0; /* from black to that: all changes add up to it */
	bb_gain_weights_of(&tf, BB_GAIN_LAB, &w);
	double sum = 0;
	for (int i = 0; i < BB_STATS_BINS; i++)
		sum += (double)w.change[i] / BB_STATS_BINS;
	assert_true(fabs(sum - lab[0] / 100) < 1e-4);
}

/* Half of the volume weighs nothing: not a brick more is spent on it than what it takes to reach the other. */
static void weights_say_where_bricks_go(void **state)
{
	struct choosing c;
	size_t n[2] = { 0 };
	(void)state;

	begin(&c, 64, 64, 64, 3, 8);
	rate(&c, BB_GAIN_FAR);
	float *weight = calloc(c.t->n_nodes, sizeof(*weight));
	assert_non_null(weight);
	for (uint32_t node = 0; node < c.t->n_nodes; node++) {
		const struct bb_tree_place p = bb_tree_place(c.t, node);
		weight[node] = 2 * p.at[0] < c.t->grid[p.level][0]; /* the left half, and what reaches into it */
	}
	for (int weighted = 0; weighted < 2; weighted++) {
		const struct bb_choose_budget budget = { .memory_bricks = 200, .weight = weighted ? weight : NULL };
		const size_t all = bb_choose_by_budget(c.t, c.space, c.time, 1, &budget, c.heap, c.out);
		covers(c.t, c.out, all, 1);
		for (size_t i = 0; i < all; i++)
			n[weighted] += !(weight[c.out[i].node] > 0);
	}
	print_message("of 200 bricks %zu, then %zu on the half that weighs nothing\n", n[0], n[1]);
	assert_true(n[0] > 20);
	assert_int_equal(n[1], 4);
	free(weight);
	end(&c);
}

static void tolerance_is_a_dial(void **state)
{
	const struct bb_transfer tf = tent();
	struct bb_metric_colours colours;
	static struct bb_metric_table table;
	struct choosing c;
	size_t before = 0;
	(void)state;

	begin(&c, 60, 41, 50, 5, 8);
	bb_metric_colours(&tf, &colours);
	bb_metric_table(&colours, &table);
	bb_metric_rate(c.b, &table, c.space, c.time);
	for (double tolerance = 1e19; tolerance > 1e-4; tolerance /= 4) {
		const size_t n = bb_choose_by_tolerance(c.t, c.space, c.time, 2, tolerance, tolerance, c.out);
		assert_true(n >= before); /* never fewer bricks for a smaller error */
		before = n;
		covers(c.t, c.out, n, 2);
	}
	assert_int_equal(bb_choose_by_tolerance(c.t, c.space, c.time, 2, 1e20, 1e20, c.out), 1);
	assert_true(before > 200);
	end(&c);
}

static void uniform_takes_the_finest_level_that_fits(void **state)
{
	struct bb_tree t;
	struct bb_choice out[512];
	(void)state;

	assert_true(bb_tree_init(&t, (const uint32_t[]){ 64, 64, 64 }, 3, 8));
	assert_int_equal(bb_choose_uniform(&t, 1, 1, out), 1);
	assert_int_equal(bb_choose_uniform(&t, 1, 63, out), 8);
	assert_int_equal(bb_choose_uniform(&t, 1, 64, out), 64);
	assert_int_equal(bb_choose_uniform(&t, 1, 9999, out), 512);
	covers(&t, out, 512, 1);
}

/* ---- against the best there is ---- */

/* Every choice of a tiny tree, one after another. */
static double exhaustive(const struct bb_tree *t, const float *cost, uint32_t node, uint32_t left)
{
	uint32_t child[8];
	const uint32_t n = bb_tree_children(t, node, child);
	double best = (double)cost[node];

	if (n == 2) /* the tree of this test is a row */
		for (uint32_t first = 1; first < left; first++)
			best = fmin(best,
				    exhaustive(t, cost, child[0], first) + exhaustive(t, cost, child[1], left - first));
	return left ? best : (double)INFINITY;
}

static void the_optimum_is_the_best_of_all(void **state)
{
	struct bb_tree t;
	struct bb_choice out[16];
	uint64_t seed = 77;
	(void)state;

	assert_true(bb_tree_init(&t, (const uint32_t[]){ 32, 4, 4 }, 1, 4));
	assert_int_equal(t.n_nodes, 15);
	for (int i = 0; i < 300; i++) {
		float cost[15];
		for (int k = 0; k < 15; k++)
			cost[k] = (float)(rig_random(&seed) % 1000);
		const uint32_t memory = 1 + rig_random(&seed) % 8;
		const size_t n = bb_choose_optimum(&t, cost, 0, memory, out);
		double sum = 0;
		for (size_t k = 0; k < n; k++)
			sum += (double)cost[out[k].node];
		assert_true(n >= 1 && n <= memory);
		covers(&t, out, n, 0);
		assert_true(fabs(sum - exhaustive(&t, cost, 0, memory)) < 1e-6);
	}
}

static double cost_of(const struct choosing *c, const float *cost, size_t n)
{
	double sum = 0;

	for (size_t i = 0; i < n; i++)
		sum += (double)cost[(uint64_t)c->out[i].tau * c->t->n_nodes + c->out[i].node];
	return sum;
}

/* The smallest tolerance in space, and one in time in such a ratio to it, that need no more bricks. */
static size_t choose_in_ratio(struct choosing *c, const struct bb_selector *s, const struct bb_ratings *r,
			      uint32_t memory, double ratio)
{
	struct bb_selector_ask ask = { .step = 1 };
	double low = 1e-7, high = 1e30;

	while (high / low > 1.001) {
		ask.space_most = sqrt(low * high);
		ask.time_most = ask.space_most * ratio;
		if (s->choose(c->t, r, &ask, c->heap, c->out) <= memory)
			high = ask.space_most;
		else
			low = ask.space_most;
	}
	ask.space_most = high;
	ask.time_most = high * ratio;
	return s->choose(c->t, r, &ask, c->heap, c->out);
}

/* The least error a selector leaves in so many bricks; one by tolerance with the best of 17 ratios of its two. */
static double least_within(struct choosing *c, const struct bb_selector *s, const struct bb_ratings *r,
			   const float *cost, uint32_t memory)
{
	const struct bb_selector_ask ask = { .step = 1, .budget.memory_bricks = memory };
	double least = (double)INFINITY;

	for (int k = -8; k <= (s->by_tolerance ? 8 : -8); k++) {
		const size_t n = s->by_tolerance ? choose_in_ratio(c, s, r, memory, pow(10, k / 2.0))
						 : s->choose(c->t, r, &ask, c->heap, c->out);
		assert_true(n >= 1 && n <= memory);
		covers(c->t, c->out, n, 1);
		least = fmin(least, cost_of(c, cost, n));
	}
	return least;
}

/* How much more leaf error, by colours as they are mixed or seen, a selector leaves than the optimum; over budgets. */
static double regret(struct choosing *c, const struct bb_selector *s, const float *cost)
{
	const struct bb_transfer tf = tent();
	struct bb_ratings r = { c->space, c->time, c->work };
	struct bb_error err = { 0 };
	double sum = 0;
	int n_budgets = 0;

	assert_int_equal(s->rate(c->b, &tf, &r, &err), BB_OK);
	for (uint32_t memory = 8; memory <= 256; memory = memory * 3 / 2, n_budgets++) {
		const size_t n = bb_choose_optimum(c->t, cost, 1, memory, c->out);
		assert_true(n >= 1 && n <= memory);
		covers(c->t, c->out, n, 1);
		const double least = cost_of(c, cost, n);
		const double here = least_within(c, s, &r, cost, memory);
		assert_true(here >= least * 0.9999);
		sum += (here - least) / (double)cost[0];
	}
	return 100 * sum / n_budgets;
}

static void the_regret_of_each_selector_is_known(void **state)
{
	static const enum bb_gain_colour colour[2] = { BB_GAIN_RGB, BB_GAIN_LAB };
	const struct bb_transfer tf = tent();
	struct bb_error err = { 0 };
	struct bb_gain_weights w;
	struct choosing c;
	float *cost[2];
	double leaf = 0, uniform = 0;
	(void)state;

	begin(&c, 64, 56, 48, 4, 8);
	for (int k = 0; k < 2; k++) {
		bb_gain_weights_of(&tf, colour[k], &w);
		assert_int_equal(bb_gain_points(c.b, &w, BB_GAIN_LEAF, c.space, c.time, c.work, &err), BB_OK);
		cost[k] = malloc(c.t->n_bricks * 4);
		assert_non_null(cost[k]);
		memcpy(cost[k], c.work, c.t->n_bricks * 4);
	}
	print_message(
		"regret in %% of the root's error, mean over budgets of 8 to 256 bricks, error in RGB and in L*a*b*\n");
	for (const struct bb_selector *s = bb_selectors; s->name; s++) {
		const double rgb = regret(&c, s, cost[0]), lab = regret(&c, s, cost[1]);
		print_message("%-18s %6.2f %6.2f\n", s->name, rgb, lab);
		leaf = strcmp(s->name, "leaf") ? leaf : rgb;
		uniform = strcmp(s->name, "uniform") ? uniform : rgb;
		assert_true(strcmp(s->name, "optimum") || rgb < 1e-6);
		assert_true(strcmp(s->name, "leaf-lab") || lab < 0.5);
	}
	assert_true(leaf < 0.5 && leaf <= uniform); /* better than no choice at all */
	free(cost[0]);
	free(cost[1]);
	end(&c);
}

static void every_selector_has_a_name_of_its_own(void **state)
{
	(void)state;

	assert_null(bb_selector_find("no such"));
	for (const struct bb_selector *s = bb_selectors; s->name; s++) {
		assert_ptr_equal(bb_selector_find(s->name), s);
		assert_true(s->rate && s->choose && s->line);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(budgets_are_kept_by_every_method),
		cmocka_unit_test(without_limits_all_that_gains_is_split),
		cmocka_unit_test(far_error_does_not_stop_half_way),
		cmocka_unit_test(far_points_are_the_best_of_all_depths),
		cmocka_unit_test(a_brick_is_judged_by_its_step_when_streaming_is_free),
		cmocka_unit_test(weights_in_lab_by_hand),
		cmocka_unit_test(weights_say_where_bricks_go),
		cmocka_unit_test(tolerance_is_a_dial),
		cmocka_unit_test(uniform_takes_the_finest_level_that_fits),
		cmocka_unit_test(the_optimum_is_the_best_of_all),
		cmocka_unit_test(the_regret_of_each_selector_is_known),
		cmocka_unit_test(every_selector_has_a_name_of_its_own),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
