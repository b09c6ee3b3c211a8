/* tests/test_metric.c: colour metrics: the table against the equations, those against every voxel, and the order. */
#include "render/bricks/metric.h"
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

struct ranked {
	double value;
	size_t index;
};

static int by_value(const void *a, const void *b)
{
	const struct ranked *x = a, *y = b;

	return (x->value > y->value) - (x->value < y->value);
}

/* Ranks, equal values sharing theirs. */
static void ranks(const double *v, size_t n, double *out)
{
	struct ranked *r = malloc(n * sizeof(*r));

	assert_non_null(r);
	for (size_t i = 0; i < n; i++)
		r[i] = (struct ranked){ v[i], i };
	qsort(r, n, sizeof(*r), by_value);
	for (size_t i = 0, k; i < n; i = k) {
		for (k = i + 1; k < n && !(r[k].value > r[i].value); k++)
			;
		for (size_t j = i; j < k; j++)
			out[r[j].index] = ((double)i + (double)k - 1) / 2;
	}
	free(r);
}

/* Spearman's: the correlation of ranks. */
static double rank_correlation(const double *a, const double *b, size_t n)
{
	double *x = malloc(n * sizeof(*x)), *y = malloc(n * sizeof(*y)), xy = 0, xx = 0, yy = 0;

	assert_true(x && y);
	ranks(a, n, x);
	ranks(b, n, y);
	for (size_t i = 0; i < n; i++) {
		const double dx = x[i] - ((double)n - 1) / 2, dy = y[i] - ((double)n - 1) / 2;
		xy += dx * dy;
		xx += dx * dx;
		yy += dy * dy;
	}
	free(x);
	free(y);
	return xy / sqrt(xx * yy);
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
		double space, time;
	} rows[] = { { "filled", filled, 0.9, 0.65 }, { "sparse", sparse, 0.8, 0.5 } };
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 64, 56, 48, 5, 8);
	struct bb_bricks *b = rig_build(&r);
	const uint64_t n = bb_bricks_header(b)->tree.n_bricks;
	float *v = malloc(rig_voxels(&r) * 5 * sizeof(float)), *space = malloc(n * 4), *time = malloc(n * 4);
	double *want[2] = { malloc(n * 8), malloc(n * 8) }, *have[2] = { malloc(n * 8), malloc(n * 8) };
	assert_true(v && space && time && want[0] && want[1] && have[0] && have[1]);
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		const struct bb_metric_colours c = colours_of(rows[i].text);
		static struct bb_metric_table t;
		size_t times = 0;
		bb_metric_table(&c, &t);
		bb_metric_rate(b, &t, space, time);
		for (uint64_t id = 0; id < n; id++) {
			size_t steps;
			const size_t voxels = own_voxels(&r, b, id, v, &steps);
			want[0][id] = bb_metric_reference_space(&c, v, voxels * steps);
			have[0][id] = (double)space[id];
			if (steps < 2)
				continue;
			want[1][times] = bb_metric_reference_time(&c, v, voxels, steps);
			have[1][times++] = (double)time[id];
		}
		const double s = rank_correlation(want[0], have[0], n), u = rank_correlation(want[1], have[1], times);
		print_message(
			"%s: rank correlation with the reference %.3f in space (%llu bricks), %.3f in time (%zu)\n",
			rows[i].name, s, (unsigned long long)n, u, times);
		assert_true(s >= rows[i].space && u >= rows[i].time);
	}
	for (int k = 0; k < 2; k++) {
		free(want[k]);
		free(have[k]);
	}
	free(v);
	free(space);
	free(time);
	bb_bricks_close(b);
	rig_end(&r);
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
		cmocka_unit_test(the_order_is_from_the_largest_down),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
