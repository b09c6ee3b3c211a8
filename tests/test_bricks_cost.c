/*
 * tests/test_bricks_cost.c: what a build takes: memory under the cap, by the builder's own count and by the kernel's,
 * and bytes moved against input and output. tests/scale-volume.sh asks the same at full size.
 */
#include "tests/brick_rig.h"

#include <malloc.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define UNDER_SANITIZER
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define UNDER_SANITIZER
#endif

#define LIBRARIES_BYTES (6u << 20) /* code that is met for the first time, stacks of threads, codecs' own tables */

static uint64_t status_bytes(const char *key)
{
	FILE *f = fopen("/proc/self/status", "r");
	unsigned long kib = 0;
	char line[128];

	assert_non_null(f);
	while (fgets(line, sizeof(line), f))
		if (!strncmp(line, key, strlen(key)))
			sscanf(line + strlen(key), ": %lu", &kib);
	fclose(f);
	return (uint64_t)kib * 1024;
}

/* The kernel forgets this process's highest memory. */
static bool forget_peak(void)
{
	FILE *f = fopen("/proc/self/clear_refs", "w");

	if (!f)
		return false;
	const bool ok = fputs("5", f) >= 0;
	return fclose(f) == 0 && ok;
}

struct cost {
	uint64_t peak, resident, result;
	double moved; /* bytes read and written over input and output */
};

static bool build_cost(struct brick_rig *r, uint64_t cap, struct cost *out)
{
	struct bb_error err = { 0 };
	const uint64_t input = rig_voxels(r) * r->n_steps * sizeof(float);
	malloc_trim(0); /* what earlier builds gave back is not counted as ours */
	const bool forgot = forget_peak();
	const uint64_t before = status_bytes("VmRSS");

	r->config.memory_bytes = cap;
	const enum bb_status status = bb_bricks_build(&r->config, &r->report, &err);
	const uint64_t most = status_bytes("VmHWM");
	assert_true(r->report.peak_bytes <= cap); /* of one that fails, too */
	if (status) {
		assert_int_equal(err.number, 1447);
		assert_int_not_equal(access(r->result, F_OK), 0);
		return false;
	}
	*out = (struct cost){ r->report.peak_bytes, forgot && most > before ? most - before : 0, r->report.result_bytes,
			      (double)(r->report.bytes_read + r->report.bytes_written) /
				      (double)(input + r->report.result_bytes) };
	return true;
}

static void memory_stays_under_any_cap(void **state)
{
	static const struct {
		uint32_t dim[3], steps, edge;
		enum bb_brick_type type;
		enum bb_brick_codec codec;
		enum bb_brick_grid grid;
	} shape[] = {
		{ { 80, 72, 64 }, 6, 8, BB_BRICK_F32, BB_BRICK_PLAIN, BB_BRICK_CARTESIAN },
		{ { 80, 72, 64 }, 6, 8, BB_BRICK_F32, BB_BRICK_PLAIN, BB_BRICK_SPHERICAL },
		{ { 100, 97, 70 }, 4, 32, BB_BRICK_F32, BB_BRICK_ZSTD, BB_BRICK_CARTESIAN },
		{ { 100, 97, 70 }, 4, 16, BB_BRICK_U16, BB_BRICK_LZ4, BB_BRICK_SPHERICAL },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(shape); i++) {
		struct brick_rig r;
		struct cost c = { 0 };
		unsigned failed = 0, built = 0;
		double most_moved = 0;
		uint64_t least_cap = 0;
		rig_begin(&r, shape[i].dim[0], shape[i].dim[1], shape[i].dim[2], shape[i].steps, shape[i].edge);
		r.config.type = shape[i].type;
		r.config.codec = shape[i].codec;
		r.config.grid = shape[i].grid;
		memcpy(r.config.extent, (const double[]){ 1, 2, 0, 3, 0, 6.283185307179586 }, sizeof(r.config.extent));
		for (uint64_t cap = 2u << 20; cap <= 128u << 20; cap *= 2) {
			if (!build_cost(&r, cap, &c)) {
				failed++;
				continue;
			}
			least_cap = built++ ? least_cap : cap;
			most_moved = fmax(most_moved, c.moved);
#ifndef UNDER_SANITIZER
			if (c.resident > cap + LIBRARIES_BYTES)
				fail_msg("cap %llu, the process took %llu", (unsigned long long)cap,
					 (unsigned long long)c.resident);
#endif
		}
		print_message("%u x %u x %u x %u, edge %u, %s, %s: %u caps too small, %u kept; the least kept is %.1f "
			      "MiB; at "
			      "128 MiB %.1f MiB are counted, the process grows by %.1f; moved %.3f x (input + output), "
			      "at the "
			      "least cap %.3f x\n",
			      r.dim[0], r.dim[1], r.dim[2], r.n_steps, shape[i].edge, bb_brick_type_text(shape[i].type),
			      bb_brick_codec_text(shape[i].codec), failed, built, (double)least_cap / 1048576,
			      (double)c.peak / 1048576, (double)c.resident / 1048576, c.moved, most_moved);
		assert_true(failed > 0 && built >= 3);
		if (shape[i].type == BB_BRICK_F32 && shape[i].codec == BB_BRICK_PLAIN)
			assert_true(c.moved <= 1.3);
		rig_end(&r);
	}
}

/* A machine with many processors needs no more memory than one with two, nor makes another file. */
static void threads_are_as_many_as_there_is_memory_for(void **state)
{
	struct brick_rig r;
	struct cost c = { 0 };
	uint64_t cap = 2u << 20, result;
	(void)state;

	rig_begin(&r, 100, 97, 70, 4, 32);
	while (!build_cost(&r, cap, &c))
		cap *= 2;
	result = c.result;
	r.config.threads = 64;
	assert_true(build_cost(&r, cap, &c));
	assert_true(c.result == result);
	rig_end(&r);
}

/* The root's samples of so many steps are more than its bins hold, and more than a leaf's voxels. */
static void thousands_of_steps_are_counted_with_fewer_samples(void **state)
{
	struct brick_rig r;
	(void)state;

	rig_begin(&r, 16, 16, 16, 2100, 4);
	r.config.type = BB_BRICK_U8;
	r.config.memory_bytes = 512u << 20;
	struct bb_bricks *b = rig_build(&r);
	const struct bb_bricks_moments *root = &bb_bricks_moments(b)[0];
	const double range = bb_bricks_header(b)->most - bb_bricks_header(b)->least;
	print_message("root of 2100 steps: leaf error %.4f of the range\n", (double)root->leaf_error / range);
	assert_true((double)root->leaf_error > 0.01 * range && (double)root->leaf_error < range);
	bb_bricks_close(b);
	rig_end(&r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(memory_stays_under_any_cap),
		cmocka_unit_test(threads_are_as_many_as_there_is_memory_for),
		cmocka_unit_test(thousands_of_steps_are_counted_with_fewer_samples),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
