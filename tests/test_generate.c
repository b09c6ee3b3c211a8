/* tests/test_generate.c: made sequences: the same bytes everywhere, any rows alone, and what each should look like. */
#include "render/transfer.h"
#include "render/volume/steps.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

struct sequence {
	struct bb_steps *steps;
	float *voxels; /* [step][z][y][x] */
	float least, most;
	size_t n;
};

static struct sequence make(const char *kind, uint32_t nx, uint32_t ny, uint32_t nz, uint32_t n_steps, uint32_t seed)
{
	const uint32_t dim[3] = { nx, ny, nz };
	struct sequence s = { .n = (size_t)nx * ny * nz * n_steps };
	struct bb_error err = { 0 };

	if (bb_steps_generate(kind, dim, n_steps, &s.steps, &err) != BB_OK)
		fail_msg("%s", err.text);
	bb_steps_seed(s.steps, seed);
	s.voxels = malloc(s.n * sizeof(float));
	assert_non_null(s.voxels);
	for (uint32_t step = 0; step < n_steps; step++)
		for (uint32_t z = 0; z < nz; z++)
			assert_int_equal(bb_steps_rows(s.steps, step, z, 0, ny,
						       s.voxels + ((size_t)step * nz + z) * ny * nx, &err),
					 BB_OK);
	s.least = s.most = s.voxels[0];
	for (size_t i = 0; i < s.n; i++) {
		assert_true(isfinite(s.voxels[i]));
		s.least = fminf(s.least, s.voxels[i]);
		s.most = fmaxf(s.most, s.voxels[i]);
	}
	return s;
}

static void drop(struct sequence *s)
{
	bb_steps_close(s->steps);
	free(s->voxels);
}

static float voxel(const struct sequence *s, uint32_t x, uint32_t y, uint32_t z, uint32_t step)
{
	const uint32_t *d = s->steps->dim;

	return s->voxels[(((size_t)step * d[2] + z) * d[1] + y) * d[0] + x];
}

static uint64_t fnv(const void *bytes, size_t n)
{
	const uint8_t *p = bytes;
	uint64_t h = UINT64_C(0xCBF29CE484222325);

	while (n--)
		h = (h ^ *p++) * UINT64_C(0x100000001B3);
	return h;
}

static const struct kind {
	const char *name;
	uint64_t hash; /* of 37 x 30 x 26 voxels, 4 steps, seed 1: pins the bytes on every machine and compiler */
} kinds[] = {
	{ "cme", UINT64_C(0x6b805b0b346a4c86) },   { "enlil", UINT64_C(0xe0a40296936ba0e4) },
	{ "delta", UINT64_C(0xf9f059c9a8a04350) }, { "wing", UINT64_C(0xbd7df9491942e967) },
	{ "shock", UINT64_C(0xdacd902450c32c2c) },
};

static void the_same_bytes_everywhere(void **state)
{
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(kinds); i++) {
		struct sequence a = make(kinds[i].name, 37, 30, 26, 4, 1), b = make(kinds[i].name, 37, 30, 26, 4, 2);
		const uint64_t hash = fnv(a.voxels, a.n * sizeof(float));
		print_message("%s: hash %016llx\n", kinds[i].name, (unsigned long long)hash);
		assert_int_equal(hash, kinds[i].hash);
		assert_true(a.steps->fingerprint != b.steps->fingerprint);
		assert_memory_not_equal(a.voxels, b.voxels, a.n * sizeof(float));
		drop(&a);
		drop(&b);
	}
}

/* In any order, any rows at a time: what is read does not depend on what was read before. */
static void any_rows_alone(void **state)
{
	uint64_t seed = 3;
	(void)state;

	for (size_t k = 0; k < BB_ARRAY_LEN(kinds); k++) {
		struct sequence s = make(kinds[k].name, 40, 21, 17, 5, 9);
		float rows[40 * 21];
		for (int i = 0; i < 300; i++) {
			uint32_t r[4];
			for (int j = 0; j < 4; j++) {
				seed = seed * UINT64_C(6364136223846793005) + 1442695040888963407;
				r[j] = (uint32_t)(seed >> 33);
			}
			const uint32_t step = r[0] % 5, z = r[1] % 17, y = r[2] % 21, n = 1 + r[3] % (21 - y);
			assert_int_equal(bb_steps_rows(s.steps, step, z, y, n, rows, NULL), BB_OK);
			assert_memory_equal(rows, s.voxels + (((size_t)step * 17 + z) * 21 + y) * 40,
					    (size_t)n * 40 * sizeof(float));
		}
		drop(&s);
	}
}

static double mean_of_radius(const struct sequence *s, uint32_t x, uint32_t step)
{
	const uint32_t *d = s->steps->dim;
	double sum = 0;

	for (uint32_t z = 0; z < d[2]; z++)
		for (uint32_t y = 0; y < d[1]; y++)
			sum += (double)voxel(s, x, y, z, step);
	return sum / d[1] / d[2];
}

/* Largest radius at which something is as dense as only a sheath is. */
static int front_of(const struct sequence *s, uint32_t step)
{
	const uint32_t *d = s->steps->dim;

	for (uint32_t x = d[0]; x-- > 0;)
		for (uint32_t z = 0; z < d[2]; z++)
			for (uint32_t y = 0; y < d[1]; y++)
				if (voxel(s, x, y, z, step) > 0.6f * s->most)
					return (int)x;
	return -1;
}

static void wind_blows_round_and_out(void **state)
{
	struct sequence s = make("enlil", 64, 32, 96, 6, 1);
	const uint32_t *d = s.steps->dim;
	double across = 0, inside = 0;
	(void)state;

	assert_true(s.steps->spherical);
	assert_true(s.steps->extent[0] > 0 && s.steps->extent[1] > s.steps->extent[0]);
	assert_true(s.steps->extent[5] - s.steps->extent[4] > 6.2831853);
	/* No seam where phi comes round: the step over it is like any other. */
	for (uint32_t x = 0; x < d[0]; x++)
		for (uint32_t y = 0; y < d[1]; y++) {
			across += fabs((double)(voxel(&s, x, y, 0, 3) - voxel(&s, x, y, d[2] - 1, 3)));
			for (uint32_t z = 1; z < d[2]; z++)
				inside +=
					fabs((double)(voxel(&s, x, y, z, 3) - voxel(&s, x, y, z - 1, 3))) / (d[2] - 1);
		}
	print_message("enlil: mean step over the seam %.4f, elsewhere %.4f\n", across / d[0] / d[1],
		      inside / d[0] / d[1]);
	assert_true(across < 2 * inside);
	/* The ejection goes out; without one the wind is much the same at every distance. */
	print_message("enlil: front at %d, %d, %d, %d, %d, %d of 64 radii; %.2f .. %.2f\n", front_of(&s, 0),
		      front_of(&s, 1), front_of(&s, 2), front_of(&s, 3), front_of(&s, 4), front_of(&s, 5),
		      (double)s.least, (double)s.most);
	assert_int_equal(front_of(&s, 0), -1);
	assert_true(front_of(&s, 2) > front_of(&s, 1) + 5 && front_of(&s, 3) > front_of(&s, 2) + 5);
	assert_true(mean_of_radius(&s, 5, 0) < 2 * mean_of_radius(&s, 60, 0));
	assert_true(mean_of_radius(&s, 60, 0) < 2 * mean_of_radius(&s, 5, 0));
	drop(&s);
}

/* Mean absolute change from a step to the next, in parts of the range. */
static double change(const struct sequence *s)
{
	const size_t per_step = s->n / s->steps->n_steps;
	double sum = 0;

	for (size_t i = per_step; i < s->n; i++)
		sum += fabs((double)(s->voxels[i] - s->voxels[i - per_step]));
	return sum / (double)(s->n - per_step) / (double)(s->most - s->least);
}

static double share_below(const struct sequence *s, float limit, uint32_t x)
{
	const uint32_t *d = s->steps->dim;
	size_t n = 0;

	for (uint32_t z = 0; z < d[2]; z++)
		for (uint32_t y = 0; y < d[1]; y++)
			n += voxel(s, x, y, z, 0) < limit;
	return (double)n / d[1] / d[2];
}

static void vortices_widen_and_change_slowly(void **state)
{
	(void)state;

	for (int wing = 0; wing < 2; wing++) {
		struct sequence s = wing ? make("wing", 100, 34, 26, 12, 1) : make("delta", 56, 63, 26, 12, 1);
		const uint32_t nx = s.steps->dim[0];
		const double before = share_below(&s, 0.85f, nx / 25), over = share_below(&s, 0.85f, nx / 2),
			     after = share_below(&s, 0.85f, nx * 9 / 10);
		print_message(
			"%s: %.4f, %.4f, %.4f of the air is thin before, over and behind the wing; a step changes "
			"%.4f of the range\n",
			s.steps->name, before, over, after, change(&s));
		assert_false(s.steps->spherical);
		assert_true(before == 0 && over > 0.005 && after > over);
		assert_true(change(&s) > 0.001 && change(&s) < 0.03);
		drop(&s);
	}
}

static void a_front_runs_through_constant_gas(void **state)
{
	struct sequence s = make("shock", 256, 16, 16, 25, 1);
	const uint32_t *d = s.steps->dim;
	uint32_t last = 0;
	size_t flat = 0;
	(void)state;

	for (uint32_t step = 0; step < 13; step++) { /* it meets the wall in step 15 */
		uint32_t x = d[0] - 1;
		while (x > 0 && fabsf(voxel(&s, x, 8, 8, step) / voxel(&s, x - 1, 8, 8, step) - 1) < 0.05f)
			x--;
		assert_true(x >= last);
		last = x;
	}
	assert_true(last > d[0] * 7 / 10);
	for (uint32_t x = 1; x < d[0]; x++)
		flat += memcmp(&(float){ voxel(&s, x, 8, 8, 12) }, &(float){ voxel(&s, x - 1, 8, 8, 12) }, 4) == 0;
	print_message(
		"shock: front at %u of 256 in step 12; %zu of 255 neighbours are exactly alike; a step changes %.4f "
		"of the range\n",
		last, flat, change(&s));
	assert_true(flat > 100);
	drop(&s);
}

static double visible(const struct sequence *s, const char *name, const char *which)
{
	static struct bb_transfer tf;
	char path[64];
	struct bb_error err = { 0 };
	size_t n = 0;

	snprintf(path, sizeof(path), "scenes/%s-%s.tf", name, which);
	if (bb_transfer_load(path, &tf, &err) != BB_OK)
		fail_msg("%s", err.text);
	for (size_t i = 0; i < s->n; i++) {
		double rgba[4];
		bb_transfer_at(&tf, (double)((s->voxels[i] - s->least) / (s->most - s->least)), rgba);
		n += rgba[3] > 0;
	}
	return (double)n / (double)s->n;
}

static void transfer_functions_are_sparse_and_filled(void **state)
{
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(kinds); i++) {
		struct sequence s = make(kinds[i].name, 96, 64, 48, 5, 1);
		const double sparse = visible(&s, kinds[i].name, "sparse"),
			     filled = visible(&s, kinds[i].name, "filled");
		print_message("%s: %.2f %% of the voxels are seen with -sparse.tf, %.2f %% with -filled.tf\n",
			      kinds[i].name, 100 * sparse, 100 * filled);
		assert_true(sparse > 0.002 && sparse < 0.08);
		assert_true(filled > 0.95);
		drop(&s);
	}
}

static bool stop_at_once(void *ctx, uint64_t done, uint64_t total)
{
	(void)ctx;
	(void)total;
	return done < 2;
}

/* As files, and back: the same floats, the same grid. */
static void written_and_read_again(void **state)
{
	static const char *const written[] = { "enlil", "shock" };
	char dir[] = "/tmp/bb-generate-XXXXXX", path[64], voxels[64];
	(void)state;

	assert_non_null(mkdtemp(dir));
	snprintf(path, sizeof(path), "%s/a.hdr.txt", dir);
	snprintf(voxels, sizeof(voxels), "%s/a.raw", dir);
	const char *const paths[] = { path };
	for (size_t i = 0; i < BB_ARRAY_LEN(written); i++) {
		struct sequence s = make(written[i], 19, 14, 23, 3, 5);
		struct bb_steps *back = NULL;
		struct bb_error err = { 0 };
		float rows[19 * 14];
		if (bb_steps_write(s.steps, path, 3, NULL, NULL, &err) != BB_OK ||
		    bb_steps_open(paths, 1, dir, &back, &err) != BB_OK)
			fail_msg("%s", err.text);
		assert_memory_equal(back->dim, s.steps->dim, sizeof(back->dim));
		assert_int_equal(back->n_steps, 3);
		assert_int_equal(back->spherical, s.steps->spherical);
		assert_memory_equal(back->extent, s.steps->extent, sizeof(back->extent));
		for (uint32_t k = 0; k < 3 * 23; k++) {
			assert_int_equal(bb_steps_rows(back, k / 23, k % 23, 0, 14, rows, &err), BB_OK);
			assert_memory_equal(rows, s.voxels + (size_t)k * 19 * 14, sizeof(rows));
		}
		bb_steps_close(back);
		assert_true(unlink(path) == 0 && unlink(voxels) == 0);
		assert_int_equal(bb_steps_write(s.steps, path, 1, stop_at_once, NULL, &err), BB_SKIPPED);
		assert_int_equal(bb_steps_write(s.steps, "a.raw", 1, NULL, NULL, &err), BB_ERR_CONFIG);
		assert_int_equal(err.number, 1401);
		err = (struct bb_error){ 0 };
		assert_int_equal(bb_steps_write(s.steps, "/nowhere/a.hdr.txt", 1, NULL, NULL, &err), BB_ERR_IO);
		assert_int_equal(err.number, 1901);
		drop(&s);
	}
	assert_int_equal(rmdir(dir), 0); /* a stop leaves nothing */
}

/* One sequence has one grid. */
static void files_of_two_grids_are_refused(void **state)
{
	char dir[] = "/tmp/bb-generate-XXXXXX", command[64], path[2][64];
	const uint32_t dim[3] = { 6, 5, 4 };
	struct bb_error err = { 0 };
	(void)state;

	assert_non_null(mkdtemp(dir));
	for (int i = 0; i < 2; i++) {
		struct bb_steps *s;
		snprintf(path[i], sizeof(path[i]), "%s/%d.hdr.txt", dir, i);
		assert_int_equal(bb_steps_generate(i ? "enlil" : "cme", dim, 1, &s, &err), BB_OK);
		assert_int_equal(bb_steps_write(s, path[i], 1, NULL, NULL, &err), BB_OK);
		bb_steps_close(s);
	}
	for (int i = 0; i < 2; i++) {
		const char *const paths[] = { path[i], path[1 - i] };
		struct bb_steps *s = NULL;
		err = (struct bb_error){ 0 };
		assert_int_equal(bb_steps_open(paths, 2, dir, &s, &err), BB_ERR_FORMAT);
		assert_int_equal(err.number, 1446);
		assert_null(s);
	}
	snprintf(command, sizeof(command), "rm -r %s", dir);
	assert_int_equal(system(command), 0);
}

static void nonsense_is_refused(void **state)
{
	static const struct {
		const char *kind;
		uint32_t dim[3], steps;
		int number;
	} bad[] = { { "smoke", { 8, 8, 8 }, 1, 1430 }, { "", { 8, 8, 8 }, 1, 1430 },
		    { "enlil", { 3, 8, 8 }, 1, 1431 }, { "delta", { 8, 65537, 8 }, 1, 1431 },
		    { "shock", { 8, 8, 8 }, 0, 1431 }, { "wing", { 8, 8, 8 }, 65537, 1431 } };
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_error err = { 0 };
		struct bb_steps *s;
		assert_true(bb_steps_generate(bad[i].kind, bad[i].dim, bad[i].steps, &s, &err) < 0);
		assert_null(s);
		assert_int_equal(err.number, bad[i].number);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_same_bytes_everywhere),
		cmocka_unit_test(any_rows_alone),
		cmocka_unit_test(wind_blows_round_and_out),
		cmocka_unit_test(vortices_widen_and_change_slowly),
		cmocka_unit_test(a_front_runs_through_constant_gas),
		cmocka_unit_test(transfer_functions_are_sparse_and_filled),
		cmocka_unit_test(written_and_read_again),
		cmocka_unit_test(files_of_two_grids_are_refused),
		cmocka_unit_test(nonsense_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
