/*
 * tests/test_errors.c: errors of all time nodes at once (render/bricks/errors.h) against a slow count of every single
 * comparison, in whole 256ths of bins, for any number of steps, rows and columns, every kernel; sums that run over.
 */
#include "render/bricks/crc32c.h"
#include "render/bricks/errors.h"
#include "render/bricks/format.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define STEPS_MOST 51
#define TIMES_MOST (2 * STEPS_MOST)
#define COLUMNS_MOST 20
#define HALF_MOST ((COLUMNS_MOST + 1) / 2)

static uint32_t next(uint64_t *state)
{
	*state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
	return (uint32_t)(*state >> 33);
}

/* ---- the slow way: each comparison raises the bins between two places ---- */

struct count {
	int64_t part[BB_STATS_BINS]; /* in 256ths */
};

static void compare(struct count *c, const struct bb_bin_scale *s, float a, float b)
{
	const int p = bb_bin_place(s, a), q = bb_bin_place(s, b), low = p < q ? p : q, high = p < q ? q : p;

	for (int i = low / 256; i < BB_STATS_BINS && i * 256 < high; i++) {
		const int from = low > i * 256 ? low : i * 256, to = high < (i + 1) * 256 ? high : (i + 1) * 256;
		c->part[i] += to - from;
	}
}

static void check(const struct bb_bin_sums *sums, const struct count *want, const char *what, uint32_t tau)
{
	int64_t above = sums->at[BB_STATS_BINS].below;

	for (int i = BB_STATS_BINS; i-- > 0;) {
		if (sums->at[i].part + 256 * above != want->part[i])
			fail_msg("%s of time node %u, bin %d: %lld, want %lld", what, tau, i,
				 (long long)(sums->at[i].part + 256 * above), (long long)want->part[i]);
		above += sums->at[i].below;
	}
}

/* ---- a quad of random voxels ---- */

struct scene {
	struct bb_tree tree;
	struct bb_tree_span span[TIMES_MOST];
	uint32_t leaf[STEPS_MOST], depth[TIMES_MOST];
	struct bb_errors_tree t;
	struct bb_bin_scale scale;
	float values[TIMES_MOST][4][COLUMNS_MOST], half[TIMES_MOST][HALF_MOST];
	struct bb_errors_quad q;
};

static float mean_of_steps(const struct scene *s, uint32_t tau, uint32_t row, uint32_t x)
{
	double sum = 0;

	for (uint32_t step = s->span[tau].from; step < s->span[tau].to; step++)
		sum += (double)s->values[s->leaf[step]][row][x];
	return (float)(sum / (s->span[tau].to - s->span[tau].from));
}

static void make_scene(struct scene *s, uint32_t n_steps, uint64_t *seed)
{
	static const uint32_t rows[] = { 1, 2, 4 };
	uint32_t deepest = 0;

	memset(s, 0, sizeof(*s));
	assert_true(bb_tree_init(&s->tree, (const uint32_t[]){ 8, 8, 8 }, n_steps, 8));
	for (uint32_t tau = 0; tau < s->tree.n_times; tau++) {
		s->span[tau] = bb_tree_span(&s->tree, tau);
		s->depth[tau] = tau ? s->depth[s->span[tau].parent] + 1 : 0;
		deepest = s->depth[tau] > deepest ? s->depth[tau] : deepest;
	}
	for (uint32_t step = 0; step < n_steps; step++)
		s->leaf[step] = bb_tree_leaf_time(&s->tree, step);
	s->t = (struct bb_errors_tree){ s->tree.n_times, n_steps, deepest / 4 + 1, s->span, s->leaf, s->depth };
	s->scale = bb_bin_scale(-1, 3);
	s->q = (struct bb_errors_quad){ .values = s->values[0][0],
					.per_time = sizeof(s->values[0]) / sizeof(float),
					.row = { 0, COLUMNS_MOST, 2 * COLUMNS_MOST, 3 * COLUMNS_MOST },
					.n_rows = rows[next(seed) % 3],
					.n = 1 + next(seed) % COLUMNS_MOST,
					.leaves = next(seed) % 2,
					.half = next(seed) % 4 ? s->half[0] : NULL,
					.half_per_time = HALF_MOST };
	const uint32_t kinds = 1 + next(seed) % 400; /* few: many voxels in one place */
	for (uint32_t row = 0; row < 4; row++)
		for (uint32_t x = 0; x < COLUMNS_MOST; x++) {
			for (uint32_t step = 0; step < n_steps; step++)
				s->values[s->leaf[step]][row][x] =
					-1 + 4 * (float)(next(seed) % kinds) / (float)(kinds > 1 ? kinds - 1 : 1);
			for (uint32_t tau = 0; tau < s->tree.n_times; tau++)
				if (s->span[tau].child[0] != BB_TREE_NONE)
					s->values[tau][row][x] = mean_of_steps(s, tau, row, x);
		}
}

static void *take(struct bb_errors *e, const struct scene *s, uint64_t voxels, enum bb_errors_way way)
{
	void *memory = calloc(1, bb_errors_bytes(&s->t, voxels));

	assert_non_null(memory);
	bb_errors_init(e, &s->t, voxels, s->scale, 4, way, memory);
	bb_errors_clear(e);
	return memory;
}

/* ---- what must come out ---- */

static void check_time(const struct bb_errors *e, const struct scene *s, uint32_t tau, int64_t times)
{
	struct count leaf = { { 0 } }, space = { { 0 } }, time = { { 0 } };
	struct bb_bin_sums sums;
	double away = 0, sigmas = 0, variations = 0;

	for (uint32_t r = 0; r < s->q.n_rows; r++)
		for (uint32_t x = 0; x < s->q.n; x++) {
			const float v = s->values[tau][r][x];
			double square = 0;
			if (s->q.half)
				compare(&space, &s->scale, s->half[tau][x / 2], v);
			for (int c = 0; c < 2 && s->span[tau].child[c] != BB_TREE_NONE; c++)
				compare(&time, &s->scale, v, s->values[s->span[tau].child[c]][r][x]);
			for (uint32_t step = s->span[tau].from; step < s->span[tau].to; step++) {
				const double d = (double)s->values[s->leaf[step]][r][x] - (double)v;
				compare(&leaf, &s->scale, v, s->values[s->leaf[step]][r][x]);
				away += fabs(d);
				square += d * d;
			}
			const double sigma = sqrt(square / (s->span[tau].to - s->span[tau].from));
			sigmas += sigma;
			variations += sigma / fmax(fabs((double)v), 4e-3);
		}
	for (int i = 0; i < BB_STATS_BINS; i++) {
		leaf.part[i] *= times;
		space.part[i] *= times;
		time.part[i] *= times;
	}
	memset(&sums, 0, sizeof(sums));
	bb_errors_time(e, tau, &sums);
	check(&sums, &time, "errors against children in time", tau);
	memset(&sums, 0, sizeof(sums));
	bb_errors_space(e, tau, &sums);
	check(&sums, &space, "errors of the parent in space", tau);
	if (!s->q.leaves)
		return;
	memset(&sums, 0, sizeof(sums));
	bb_errors_leaf(e, tau, &sums);
	check(&sums, &leaf, "errors against steps", tau);
	if (s->span[tau].child[0] == BB_TREE_NONE)
		return;
	assert_true(fabs(bb_errors_sum(e, tau, BB_ERRORS_APART) - away * (double)times) <= 1e-9 * (double)times);
	assert_true(fabs(bb_errors_sum(e, tau, BB_ERRORS_DEVIATION) - sigmas * (double)times) <= 1e-9 * (double)times);
	assert_true(fabs(bb_errors_sum(e, tau, BB_ERRORS_VARIATION) / (double)times - variations) <= 1e-9 * variations);
}

static void check_means(const struct scene *s)
{
	for (uint32_t tau = 0; s->q.half && tau < s->t.n_times; tau++)
		for (uint32_t x = 0; x < s->q.n; x += 2) {
			double sum = 0;
			uint32_t n = 0;
			for (uint32_t r = 0; r < s->q.n_rows; r++)
				for (uint32_t k = x; k < x + 2 && k < s->q.n; k++, n++)
					sum += (double)s->values[tau][r][k];
			assert_true(fabs((double)s->half[tau][x / 2] - sum / n) < 1e-6);
		}
}

static void check_steps(const struct bb_errors *e, const struct scene *s)
{
	for (uint32_t step = 0; s->q.leaves && step < s->t.n_steps; step++) {
		uint32_t counts[BB_STATS_BINS + 1] = { 0 };
		struct bb_moments m;
		double sum = 0, m2 = 0, n = s->q.n_rows * s->q.n;
		for (uint32_t r = 0; r < s->q.n_rows; r++)
			for (uint32_t x = 0; x < s->q.n; x++) {
				counts[bb_bin_place(&s->scale, s->values[s->leaf[step]][r][x]) / 256]++;
				sum += (double)s->values[s->leaf[step]][r][x];
			}
		for (uint32_t r = 0; r < s->q.n_rows; r++)
			for (uint32_t x = 0; x < s->q.n; x++)
				m2 += pow((double)s->values[s->leaf[step]][r][x] - sum / n, 2);
		assert_memory_equal(e->counts + step * (BB_STATS_BINS + 1), counts, sizeof(counts));
		bb_moment_lanes_close(&e->lanes[step], &m);
		assert_true(m.n >= n && m.n <= n && fabs(m.mean - sum / n) < 1e-12 && fabs(m.m2 - m2) < 1e-10);
	}
}

static void begin(struct bb_errors *e, const struct scene *s)
{
	for (uint32_t step = 0; step < s->t.n_steps; step++)
		bb_moment_lanes_begin(&e->lanes[step], s->values[s->leaf[step]][0][0]);
}

static void every_comparison_is_counted(void **state)
{
	struct scene *s = malloc(sizeof(*s));
	unsigned ways = 0, groups[8] = { 0 };
	uint64_t seed = 5;
	(void)state;

	assert_non_null(s);
	for (uint32_t i = 0; i < 400; i++) {
		make_scene(s, i % 50 ? 1 + next(&seed) % 20 : STEPS_MOST, &seed);
		groups[s->t.n_groups]++;
		uint32_t crc = 0;
		for (enum bb_errors_way way = 0; way < BB_ERRORS_WAYS; way++) {
			struct bb_errors e;
			if (!bb_errors_has(way))
				continue;
			void *memory = take(&e, s, 4 * COLUMNS_MOST, way);
			begin(&e, s);
			bb_errors_add(&e, &s->q);
			check_means(s);
			check_steps(&e, s);
			for (uint32_t tau = 0; tau < s->t.n_times; tau++)
				check_time(&e, s, tau, 1);
			const uint32_t here = bb_crc32c(bb_crc32c(0, e.sums, s->t.n_times * BB_ERRORS_SUMS * 64),
							e.lanes, s->t.n_steps * sizeof(*e.lanes));
			assert_true(way == BB_ERRORS_PORTABLE || here == crc); /* the same bits everywhere */
			crc = here;
			ways |= 1u << way;
			free(memory);
		}
	}
	print_message("400 scenes, kernels %#x, one group of lanes %u times, two %u\n", ways, groups[1], groups[2]);
	assert_true(groups[1] > 100 && groups[2] > 100 && ways & 1u << bb_errors_best());
	free(s);
}

/* What runs over 32 bits goes to wider bins in time: the same quad a hundred thousand times. */
static void nothing_runs_over(void **state)
{
	struct scene *s = malloc(sizeof(*s));
	struct bb_errors e;
	uint64_t seed = 77;
	const int64_t times = 100000;
	(void)state;

	assert_non_null(s);
	do
		make_scene(s, 7, &seed);
	while (!s->q.leaves || !s->q.half || s->q.n_rows < 4 || s->q.n < 12);
	void *memory = take(&e, s, (uint64_t)times * 4 * COLUMNS_MOST, bb_errors_best());
	assert_non_null(e.wide);
	for (int round = 0; round < 2; round++) { /* it is empty in between */
		begin(&e, s);
		for (int64_t i = 0; i < times; i++)
			bb_errors_add(&e, &s->q);
		for (uint32_t tau = 0; tau < s->t.n_times; tau++)
			check_time(&e, s, tau, times);
		bb_errors_clear(&e);
	}
	free(memory);
	free(s);
}

/* Data without a range: nothing is divided by. */
static void nothing_at_all_is_no_error(void **state)
{
	struct scene *s = malloc(sizeof(*s));
	uint64_t seed = 3;
	(void)state;

	assert_non_null(s);
	make_scene(s, 4, &seed);
	memset(s->values, 0, sizeof(s->values));
	s->scale = bb_bin_scale(0, 0);
	s->q.leaves = true;
	for (enum bb_errors_way way = 0; way < BB_ERRORS_WAYS; way++) {
		struct bb_errors e;
		if (!bb_errors_has(way))
			continue;
		void *memory = take(&e, s, 4 * COLUMNS_MOST, way);
		e.floor = 0;
		begin(&e, s);
		bb_errors_add(&e, &s->q);
		for (uint32_t tau = 0; tau < s->t.n_times; tau++)
			for (int which = 0; which < BB_ERRORS_SUMS; which++) {
				const double sum = bb_errors_sum(&e, tau, (enum bb_errors_sum)which);
				assert_true(sum >= 0 && sum <= 0);
			}
		free(memory);
	}
	free(s);
}

/* Samples: what is shown of a time node against the data's steps. */
static void every_sample_is_counted(void **state)
{
	struct scene *s = malloc(sizeof(*s));
	uint64_t seed = 9;
	(void)state;

	assert_non_null(s);
	for (uint32_t i = 0; i < 200; i++) {
		make_scene(s, 1 + next(&seed) % 20, &seed);
		const uint32_t n = 1 + next(&seed) % 8;
		for (enum bb_errors_way way = 0; way < BB_ERRORS_WAYS; way++) {
			struct bb_errors e;
			if (!bb_errors_has(way))
				continue;
			void *memory = take(&e, s, 4 * COLUMNS_MOST, way);
			for (uint32_t tau = 0; tau < s->t.n_times; tau++)
				memcpy(e.values + tau * 32, s->values[tau][0], 8 * sizeof(float));
			for (uint32_t step = 0; step < s->t.n_steps; step++)
				memcpy(e.values + s->leaf[step] * 32 + 8, s->values[s->leaf[step]][1],
				       8 * sizeof(float));
			bb_errors_sample(&e, n);
			for (uint32_t tau = 0; tau < s->t.n_times; tau++) {
				struct bb_bin_sums sums = { 0 };
				struct count want = { { 0 } };
				double away = 0;
				for (uint32_t x = 0; x < n; x++)
					for (uint32_t k = s->span[tau].from; k < s->span[tau].to; k++) {
						const float v = s->values[s->leaf[k]][1][x],
							    shown = s->values[tau][0][x];
						compare(&want, &s->scale, v, shown);
						away += fabs((double)v - (double)shown);
					}
				bb_errors_sampled(&e, tau, &sums);
				check(&sums, &want, "sampled errors", tau);
				assert_true(fabs(bb_errors_sum(&e, tau, BB_ERRORS_APART) - away) < 1e-9);
			}
			free(memory);
		}
	}
	free(s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_comparison_is_counted),
		cmocka_unit_test(nothing_runs_over),
		cmocka_unit_test(nothing_at_all_is_no_error),
		cmocka_unit_test(every_sample_is_counted),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
