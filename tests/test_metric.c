/* tests/test_metric.c: colour metrics: the table against the equations, those against every voxel, and the order. */
#include "bench/volume/rank.h"
#include "render/bricks/choose.h"
#include "render/bricks/metric.h"
#include "render/bricks/metric_quick.h"
#include "render/bricks/values.h"
#include "tests/brick_rig.h"

static struct bb_transfer transfer(const char *text)
{
	struct bb_transfer tf;
	struct bb_error err = { 0 };
	char path[] = "/tmp/bb-metric-XXXXXX";
	const int fd = mkstemp(path);

	assert_true(fd >= 0 && write(fd, text, strlen(text)) == (ssize_t)strlen(text));
	close(fd);
	if (bb_transfer_load(path, &tf, &err) != BB_OK)
		fail_msg("%s", err.text);
	unlink(path);
	return tf;
}

static const char filled[] = "0 0 0 0.2 0.02\n0.4 0.1 0.6 0.3 0.1\n0.7 0.9 0.7 0.1 0.2\n1 1 0.2 0.1 0.4\n";
static const char sparse[] = "0 0 0 0 0\n0.6 0 0 0 0\n0.62 1 0.5 0 0.3\n0.7 1 1 0 0.3\n0.72 0 0 0 0\n1 0 0 0 0\n";
static const char grey[] = "0 0 0 0 0\n1 1 1 1 1\n";

static struct bb_metric_colours colours_of(const char *text)
{
	const struct bb_transfer tf = transfer(text);
	struct bb_metric_colours c;

	bb_metric_colours(&tf, &c);
	return c;
}

static void the_table_is_the_equations(void **state)
{
	static const char *const texts[] = { filled, sparse, grey };
	double worst = 0, sum = 0;
	int n = 0;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(texts); i++) {
		const struct bb_metric_colours c = colours_of(texts[i]);
		static struct bb_metric_table t;
		bb_metric_table(&c, &t);
		for (double mean = 0.05; mean < 1; mean += 0.0137)
			for (double deviation = 0.008; deviation < 0.4; deviation *= 1.23) {
				const double want = bb_metric_approximate(&c, mean, deviation, 0, 1);
				const double have = bb_metric_look_up(&t, mean, deviation, 0, 1);
				/* Where next to nothing can be seen the equations go to infinity, and only their order
				 * means anything. */
				if (want > 10) {
					if (have <= 5)
						fail_msg("table %g, equations %g at mean %g, deviation %g", have, want,
							 mean, deviation);
					continue;
				}
				worst = fmax(worst, fabs(have - want) / (1 + want));
				sum += fabs(have - want) / (1 + want);
				n++;
			}
	}
	print_message("table against equations 14 to 19: %.2f %% apart in the mean, at most %.2f %%\n", 100 * sum / n,
		      100 * worst);
	assert_true(worst < 0.05 && sum / n < 0.005);
}

static void what_cannot_be_seen_is_not_wrong(void **state)
{
	const struct bb_metric_colours c = colours_of(sparse);
	static struct bb_metric_table t;
	const float dark[4] = { 0.1f, 0.2f, 0.5f, 0.3f }, flat[4] = { 0.65f, 0.65f, 0.65f, 0.65f };
	(void)state;

	bb_metric_table(&c, &t);
	assert_true(bb_metric_visible(&c, 0.65, 0.66) && bb_metric_visible(&c, 0, 1));
	assert_false(bb_metric_visible(&c, 0, 0.59) || bb_metric_visible(&c, 0.8, 1));
	assert_true(bb_metric_look_up(&t, 0.55, 0.1, 0.2, 0.59) == 0); /* though its tail would be seen */
	assert_true(bb_metric_look_up(&t, 0.65, 0, 0.65, 0.65) == 0);
	assert_true(bb_metric_look_up(&t, 0.65, 0.1, 0.2, 0.9) > 0);
	assert_true(bb_metric_reference_space(&c, dark, 4) == 0);
	assert_true(bb_metric_reference_space(&c, flat, 4) < 1e-6);
	assert_true(bb_metric_reference_time(&c, flat, 1, 4) < 1e-6);
	assert_true(bb_metric_look_up(&t, (double)NAN, (double)NAN, 0, 1) == 0);
	static struct bb_metric_times times;
	bb_metric_times(&t, &times);
	/* In time: nothing moves, or out of sight; a mean far away from all that is seen, but some of it is. */
	assert_true(bb_metric_look_up_time(&times, 0.65, 0.1, 0.2, 0.9, 0) <= 0);
	assert_true(bb_metric_look_up_time(&times, 0.55, 0.1, 0.2, 0.59, 0.1) <= 0);
	assert_true(bb_metric_look_up_time(&times, 0.1, 0.001, 0, 0.7, 0.001) > 0);
	assert_true(bb_metric_look_up_time(&times, 0.65, 0.1, 0.2, 0.9, 0.05) >
		    bb_metric_look_up_time(&times, 0.65, 0.1, 0.2, 0.9, 0.01));
}

/* Two values, half each: equations 7 to 10 by hand. */
static void the_reference_is_the_equations(void **state)
{
	const struct bb_metric_colours c = colours_of(grey);
	const float two[2] = { 0.25f, 0.75f };
	(void)state;

	const double a = (64.5) / 256, b = (192.5) / 256, m = (a + b) / 2;
	const double dev = sqrt(
		(a * 3 * (a - m) * (a - m) + (a - m) * (a - m) + b * 3 * (b - m) * (b - m) + (b - m) * (b - m)) / 2);
	const double mu = sqrt(m * 3 * m * m + m * m);
	assert_true(fabs(bb_metric_reference_space(&c, two, 2) - dev / mu) < 1e-6);
	assert_true(fabs(bb_metric_reference_time(&c, two, 1, 2) - dev / mu) < 1e-6);
}

/* ---- against every voxel ---- */

static double rank_correlation(const float *a, const float *b, size_t n)
{
	double out;

	assert_int_equal(bb_rank_correlation(a, b, n, &out, NULL), BB_OK);
	return out;
}

/* The data's own voxels of a brick, as parts of the range; returns how many in a step. */
static size_t own_voxels(const struct brick_rig *r, const struct bb_bricks *b, uint64_t id, float *out, size_t *steps)
{
	const struct bb_bricks_header *h = bb_bricks_header(b);
	const struct bb_tree *t = &h->tree;
	const struct bb_tree_place p = bb_tree_place(t, (uint32_t)(id % t->n_nodes));
	const struct bb_tree_span s = bb_tree_span(t, (uint32_t)(id / t->n_nodes));
	const uint32_t reach = t->edge << (t->n_levels - 1 - p.level);
	size_t n = 0;

	for (uint32_t step = s.from; step < s.to; step++)
		for (uint32_t z = p.at[2] * reach; z < (p.at[2] + 1) * reach && z < r->dim[2]; z++)
			for (uint32_t y = p.at[1] * reach; y < (p.at[1] + 1) * reach && y < r->dim[1]; y++)
				for (uint32_t x = p.at[0] * reach; x < (p.at[0] + 1) * reach && x < r->dim[0]; x++) {
					const size_t at =
						((step * (size_t)r->dim[2] + z) * r->dim[1] + y) * r->dim[0] + x;
					out[n++] = (float)(((double)r->voxels[at] - h->least) / (h->most - h->least));
				}
	*steps = s.to - s.from;
	return n / *steps;
}

static void approximations_rank_like_the_reference(void **state)
{
	static const struct {
		const char *name, *text;
		double space, time, local;
	} rows[] = { { "filled", filled, 0.9, 0.65, 0.9 }, { "sparse", sparse, 0.8, 0.5, 0.8 } };
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 64, 56, 48, 5, 8);
	struct bb_bricks *b = rig_build(&r);
	const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
	float *v = malloc(rig_voxels(&r) * 5 * sizeof(float)), *space = malloc(n * 4), *time = malloc(n * 4);
	float *want[2] = { malloc(n * 4), malloc(n * 4) }, *have[2] = { malloc(n * 4), malloc(n * 4) };
	float *local = malloc(n * 4);
	assert_true(v && space && time && local && want[0] && want[1] && have[0] && have[1]);
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		const struct bb_metric_colours c = colours_of(rows[i].text);
		static struct bb_metric_table t;
		static struct bb_metric_times over_time;
		size_t times = 0;
		bb_metric_table(&c, &t);
		bb_metric_times(&t, &over_time);
		bb_metric_rate_local(b, &t, &over_time, space, local);
		bb_metric_rate(b, &t, space, time);
		for (uint64_t id = 0; id < n; id++) {
			size_t steps;
			const size_t voxels = own_voxels(&r, b, id, v, &steps);
			want[0][id] = (float)bb_metric_reference_space(&c, v, voxels * steps);
			if (steps < 2)
				continue;
			want[1][times] = (float)bb_metric_reference_time(&c, v, voxels, steps);
			have[1][times] = local[id];
			have[0][times++] = time[id];
		}
		const double s = rank_correlation(want[0], space, n), u = rank_correlation(want[1], have[0], times),
			     l = rank_correlation(want[1], have[1], times);
		print_message(
			"%s: rank correlation with the reference %.3f in space (%llu bricks), %.3f in time (%zu), "
			"%.3f by where the values are\n",
			rows[i].name, s, (unsigned long long)n, u, times, l);
		assert_true(s >= rows[i].space && u >= rows[i].time && l >= rows[i].local);
	}
	for (int k = 0; k < 2; k++) {
		free(want[k]);
		free(have[k]);
	}
	free(local);
	free(v);
	free(space);
	free(time);
	bb_bricks_close(b);
	rig_end(&r);
}

/* The pass over a file against equations 7 to 13 over each brick's own voxels. */
static void the_reference_of_a_file_is_that_of_its_voxels(void **state)
{
	static const char *const texts[] = { filled, sparse };
	struct brick_rig r;
	double worst = 0;
	(void)state;

	rig_begin(&r, 37, 30, 21, 5, 8);
	struct bb_bricks *b = rig_build(&r);
	const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
	float *v = malloc(rig_voxels(&r) * 5 * sizeof(float)), *space = malloc(n * 4), *time = malloc(n * 4);
	struct bb_error err = { 0 };
	assert_true(v && space && time);
	for (size_t i = 0; i < BB_ARRAY_LEN(texts); i++) {
		const struct bb_metric_colours c = colours_of(texts[i]);
		assert_int_equal(bb_metric_rate_reference(b, &c, space, time, &err), BB_OK);
		for (uint64_t id = 0; id < n; id++) {
			size_t steps;
			const size_t voxels = own_voxels(&r, b, id, v, &steps);
			const double s = bb_metric_reference_space(&c, v, voxels * steps);
			const double t = bb_metric_reference_time(&c, v, voxels, steps);
			worst = fmax(worst,
				     fmax(fabs((double)space[id] - s) / (1 + s), fabs((double)time[id] - t) / (1 + t)));
		}
	}
	print_message("%llu bricks: at most %.1e apart\n", (unsigned long long)n, worst);
	assert_true(worst < 2e-6);
	free(v);
	free(space);
	free(time);
	bb_bricks_close(b);
	rig_end(&r);
}

/* ---- means at zero, other units, shifted values (row nV3) ---- */

static void scalar_metrics_at_their_edges(void **state)
{
	const double denormal = 1e-310, tiny = 1e-40;
	const struct {
		double mean, deviation, range;
		bool bare; /* is the coefficient as it stands a number? */
		double want;
	} rows[] = {
		{ 0, 0, 0, false, 0 },           { 0, 0, 2, false, 0 },
		{ 0, 0.5, 2, false, 250 },       { -1, 0.5, 2, true, 0.5 },
		{ -1e-9, 0.5, 2, true, 250 },    { 4, 1, 2, true, 0.25 },
		{ tiny, tiny, tiny, true, 1 },   { 0, denormal, denormal, false, 1000 },
		{ 1e30, 1e29, 1e30, true, 0.1 }, { 1e-30, 1e-31, 1e-30, true, 0.1 },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		const double bare = bb_metric_scalar(BB_SCALAR_BARE, rows[i].mean, rows[i].deviation, rows[i].range);
		const double ours = bb_metric_scalar(BB_SCALAR_GUARDED, rows[i].mean, rows[i].deviation, rows[i].range);
		const double sand = bb_metric_scalar(BB_SCALAR_SAND, rows[i].mean, rows[i].deviation, rows[i].range);
		assert_true(isfinite(bare) == rows[i].bare);
		if (!(fabs(ours - rows[i].want) <= 1e-6 * rows[i].want))
			fail_msg("row %zu: %g, not %g", i, ours, rows[i].want);
		assert_true(isfinite(sand) && ours >= 0);
	}
}

struct altered { /* one data set in another unit, or shifted; its ratings */
	struct brick_rig rig;
	struct bb_bricks *b;
	float *space[3], *time[3]; /* Sand's, ours, colours */
	uint64_t n;
};

enum { SAND, OURS, COLOUR };

/* Values are whole 256ths, so that no shift or scale by a power of two rounds them. */
static void alter(struct altered *a, double scale, double shift)
{
	const struct bb_metric_colours c = colours_of(filled);
	static struct bb_metric_table t;

	rig_begin(&a->rig, 40, 36, 28, 4, 8);
	for (size_t i = 0; i < rig_voxels(&a->rig) * 4; i++)
		a->rig.voxels[i] = (float)((rint((double)a->rig.voxels[i] * 256) / 256 + shift) * scale);
	rig_write(&a->rig);
	a->b = rig_build(&a->rig);
	a->n = bb_bricks_header(a->b)->tree.n_bricks;
	for (int k = 0; k < 3; k++) {
		a->space[k] = malloc(a->n * 4);
		a->time[k] = malloc(a->n * 4);
		assert_true(a->space[k] && a->time[k]);
	}
	bb_metric_table(&c, &t);
	bb_metric_rate_scalar(a->b, BB_SCALAR_SAND, a->space[SAND], a->time[SAND]);
	bb_metric_rate_scalar(a->b, BB_SCALAR_GUARDED, a->space[OURS], a->time[OURS]);
	bb_metric_rate(a->b, &t, a->space[COLOUR], a->time[COLOUR]);
}

static void forget(struct altered *a)
{
	for (int k = 0; k < 3; k++) {
		free(a->space[k]);
		free(a->time[k]);
	}
	bb_bricks_close(a->b);
	rig_end(&a->rig);
}

static size_t chosen(const struct altered *a, int k, double space, double time)
{
	const struct bb_tree *t = &bb_bricks_header(a->b)->tree;
	struct bb_choice *out = malloc(bb_choose_most(t) * sizeof(*out));

	assert_non_null(out);
	const size_t n = bb_choose_by_tolerance(t, a->space[k], a->time[k], 1, space, time, out);
	free(out);
	return n;
}

static double ranked_alike(const struct altered *a, const struct altered *b, int k)
{
	return rank_correlation(a->space[k], b->space[k], a->n);
}

static void a_tolerance_means_the_same_in_every_unit(void **state)
{
	const double scale[] = { ldexp(1, 100), ldexp(1, -100) }; /* 1.3e30 and 7.9e-31 */
	const double tolerance[] = { 0.5, 2, 0.5 };
	struct altered own, other;
	(void)state;

	alter(&own, 1, 0);
	for (size_t i = 0; i < BB_ARRAY_LEN(scale); i++) {
		size_t n[2][3];
		alter(&other, scale[i], 0);
		for (int k = 0; k < 3; k++) {
			for (uint64_t id = 0; id < own.n; id++)
				assert_true(isfinite(other.space[k][id]) && isfinite(other.time[k][id]));
			n[0][k] = chosen(&own, k, tolerance[k], tolerance[k]);
			n[1][k] = chosen(&other, k, tolerance[k], tolerance[k]);
		}
		print_message(
			"x %.1e, bricks at one tolerance: Sand's %zu, then %zu; ours %zu, %zu; colours %zu, %zu\n",
			scale[i], n[0][SAND], n[1][SAND], n[0][OURS], n[1][OURS], n[0][COLOUR], n[1][COLOUR]);
		assert_true(n[0][OURS] == n[1][OURS] && n[0][COLOUR] == n[1][COLOUR]);
		assert_true(n[0][SAND] != n[1][SAND]); /* what it is refused for */
		forget(&other);
	}
	forget(&own);
}

static void colours_do_not_mind_a_shift(void **state)
{
	struct altered own, other;
	(void)state;

	alter(&own, 1, 0);
	alter(&other, 1, 64);
	print_message("64 added: rank correlation with the ranks before %.6f by colours, %.6f by deviation, %.6f by "
		      "coefficient of variation\n",
		      ranked_alike(&own, &other, COLOUR), ranked_alike(&own, &other, SAND),
		      ranked_alike(&own, &other, OURS));
	assert_true(ranked_alike(&own, &other, COLOUR) > 0.99999);
	assert_true(ranked_alike(&own, &other, OURS) < 0.99); /* it compares with a mean that means nothing */
	assert_int_equal(chosen(&own, COLOUR, 0.2, 0.2), chosen(&other, COLOUR, 0.2, 0.2));
	forget(&own);
	forget(&other);
}

static void quick_functions_are_libm_to_six_digits(void **state)
{
	double log_worst = 0, exp_worst = 0;
	(void)state;

	for (double x = 1e-6; x < 1e6; x *= 1.0003)
		log_worst = fmax(log_worst, fabs((double)bb_quick_log2((float)x) - log2((double)(float)x)));
	for (double x = 1e-9; x < 80; x = x * 1.0007 + 1e-12) {
		const double want = expm1((double)(float)x);
		exp_worst = fmax(exp_worst, fabs((double)bb_quick_expm1((float)x) - want) / want);
	}
	print_message("log2 at most %.1e off, expm1 %.1e of itself\n", log_worst, exp_worst);
	assert_true(log_worst < 3e-6 && exp_worst < 1.2e-5); /* of a large power its float exponent is the limit */
	assert_true(bb_quick_expm1(0) <= 0 && bb_quick_log2(1) <= 0 && bb_quick_log2(1) >= 0);
}

static void the_order_is_from_the_largest_down(void **state)
{
	enum { N = 50000 };
	static float error[N];
	static uint64_t scratch[N];
	static uint32_t order[N];
	uint64_t seed = 4;
	(void)state;

	for (uint32_t i = 0; i < N; i++)
		error[i] = rig_random(&seed) % 5 ? (float)(rig_random(&seed) % 1000) * 1e-3f : 0;
	bb_metric_order(error, N, scratch, order);
	for (uint32_t i = 1; i < N; i++) {
		const float a = error[order[i - 1]], b = error[order[i]];
		assert_true(a > b || (!(a < b) && order[i - 1] < order[i]));
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_table_is_the_equations),
		cmocka_unit_test(what_cannot_be_seen_is_not_wrong),
		cmocka_unit_test(the_reference_is_the_equations),
		cmocka_unit_test(approximations_rank_like_the_reference),
		cmocka_unit_test(the_reference_of_a_file_is_that_of_its_voxels),
		cmocka_unit_test(scalar_metrics_at_their_edges),
		cmocka_unit_test(a_tolerance_means_the_same_in_every_unit),
		cmocka_unit_test(colours_do_not_mind_a_shift),
		cmocka_unit_test(quick_functions_are_libm_to_six_digits),
		cmocka_unit_test(the_order_is_from_the_largest_down),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
