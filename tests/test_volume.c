/* tests/test_volume.c: sampling, raw import and the generated volume. */
#include "render/volume/volume.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#define CME_HASH UINT64_C(0x77FD404E47EAA77D)

struct folder {
	char path[64];
};

static int make_folder(void **state)
{
	struct folder *f = calloc(1, sizeof(*f));

	snprintf(f->path, sizeof(f->path), "/tmp/bb-volume-XXXXXX");
	*state = f;
	return mkdtemp(f->path) ? 0 : -1;
}

static int remove_folder(void **state)
{
	struct folder *f = *state;
	char command[128];

	snprintf(command, sizeof(command), "rm -rf '%s'", f->path);
	const int failed = system(command);
	free(f);
	return failed;
}

static void write_file(const struct folder *f, const char *name, const void *bytes, size_t n, char path[128])
{
	snprintf(path, 128, "%s/%s", f->path, name);
	FILE *file = fopen(path, "wb");

	assert_non_null(file);
	assert_int_equal(fwrite(bytes, 1, n, file), n);
	assert_int_equal(fclose(file), 0);
}

static struct bb_volume *load_raw(const struct folder *f, const char *header, const void *bytes, size_t n, int number)
{
	struct bb_volume *v;
	struct bb_error err = { 0 };
	char path[128];

	write_file(f, "voxels.raw", bytes, n, path);
	write_file(f, "vol.hdr.txt", header, strlen(header), path);
	const enum bb_status status = bb_volume_load(path, BB_VOLUME_CAP_BYTES, &v, &err);
	assert_int_equal(err.number, number);
	assert_true(number ? status < 0 && !v : status == BB_OK && v);
	return v;
}

static void raw_volume_is_normalised(void **state)
{
	static const int16_t voxels[2 * 2 * 3 * 2] = { -100, 0, 100, 300, [23] = 200 };
	struct bb_volume *v = load_raw(*state, "file: voxels.raw\ndims: 2 2 3 # x y z\ntype: i16\nsteps: 2\n"
	                                       "spacing_mm: 1 1 2.5\n", voxels, sizeof(voxels), 0);

	assert_string_equal(v->name, "vol");
	assert_int_equal(v->dim[2], 3);
	assert_int_equal(v->n_steps, 2);
	assert_true(v->least == -100 && v->most == 300 && v->spacing_mm[2] == 2.5 && !v->n_nonfinite);
	assert_int_equal(v->voxels[0], 0);
	assert_int_equal(v->voxels[3], 65535);
	assert_int_equal(v->voxels[1], 16384); /* 0.25 * 65535 rounded */
	assert_true(bb_volume_voxel(v, 1, 1, 2, 1) == v->voxels[23] / 65535.0);
	assert_true(bb_volume_voxel(v, 99, 99, 99, 99) == v->voxels[23] / 65535.0);
	assert_true(bb_volume_voxel(v, -5, -5, INT64_MIN, 0) == v->voxels[0] / 65535.0);
	bb_volume_free(v);
}

static void raw_types_and_byte_orders_agree(void **state)
{
	static const uint8_t f32_big[] = { 0x3F, 0x80, 0, 0, 0x40, 0, 0, 0, 0x7F, 0xC0, 0, 0, 0x40, 0x40, 0, 0 };
	static const uint8_t i32_little[] = { 9, 9, 9, 1, 0, 0, 0, 2, 0, 0, 0, 0xFE, 0xFF, 0xFF, 0xFF, 3, 0, 0, 0 };
	struct bb_volume *v = load_raw(*state, "file: voxels.raw\ndims: 2 2 1\ntype: f32\nbyte_order: big\n", f32_big,
	                               sizeof(f32_big), 0);

	assert_true(v->least == 1 && v->most == 3);
	assert_int_equal(v->n_nonfinite, 1);
	assert_int_equal(v->voxels[2], 0); /* the NaN became the least */
	assert_int_equal(v->voxels[1], 32768);
	bb_volume_free(v);
	v = load_raw(*state, "file: voxels.raw\ndims: 4 1 1\ntype: i32\noffset_bytes: 3\n", i32_little,
	             sizeof(i32_little), 0);
	assert_true(v->least == -2 && v->most == 3);
	bb_volume_free(v);
}

static void extreme_values_do_no_harm(void **state)
{
	static const double nothing[] = { (double)NAN, HUGE_VAL, -HUGE_VAL, (double)NAN };
	static const double tiny[] = { 0, 4.9e-324, 0, 4.9e-324 };
	static const double wide[] = { -1.7e308, 1.7e308, 0, 0 };
	static const char header[] = "file: voxels.raw\ndims: 2 2 1\ntype: f64\n";
	struct bb_volume *v = load_raw(*state, header, nothing, sizeof(nothing), 0);

	assert_true(v->least == 0 && v->most == 0 && v->n_nonfinite == 4 && v->voxels[1] == 0);
	bb_volume_free(v);
	v = load_raw(*state, header, tiny, sizeof(tiny), 0);
	assert_int_equal(v->voxels[1], 65535);
	bb_volume_free(v);
	load_raw(*state, header, wide, sizeof(wide), 1413);
}

static void sampling_is_linear_everywhere(void **state)
{
	(void)state;
	uint16_t voxels[3 * 4 * 5 * 2];
	const struct bb_volume v = { .dim = { 3, 4, 5 }, .n_steps = 2, .voxels = voxels };
	uint32_t seed = 7;
	size_t i = 0;

	for (uint32_t s = 0; s < 2; s++)
		for (uint32_t z = 0; z < 5; z++)
			for (uint32_t y = 0; y < 4; y++)
				for (uint32_t x = 0; x < 3; x++)
					voxels[i++] = (uint16_t)(100 + 1000 * x + 700 * y + 300 * z + 5000 * s);
	for (int k = 0; k < 1000; k++) {
		double u[4];
		for (int a = 0; a < 4; a++)
			u[a] = (double)(seed = seed * 1664525u + 1013904223u) / 4294967296.0;
		const double p[3] = { u[0] * 2, u[1] * 3, u[2] * 4 };
		const double want = (100 + 1000 * p[0] + 700 * p[1] + 300 * p[2] + 5000 * u[3]) / 65535;
		assert_true(fabs(bb_volume_sample(&v, p, u[3]) - want) < 1e-12);
	}
	const double far[3] = { 1e300, -1e300, (double)NAN };
	assert_true(fabs(bb_volume_sample(&v, far, (double)NAN) - 2100 / 65535.0) < 1e-12);
	assert_true(fabs(bb_volume_sample(&v, far, 1e9) - 7100 / 65535.0) < 1e-12);
}

/* Values of single precision are sampled as they are; a last axis without ends goes on with its first voxel. */
static void values_and_an_axis_without_ends(void **state)
{
	(void)state;
	float values[2 * 3 * 4];
	struct bb_volume v = { .dim = { 2, 3, 4 }, .n_steps = 1, .values = values };

	for (size_t i = 0; i < BB_ARRAY_LEN(values); i++)
		values[i] = (float)(0.1 + 0.03 * (double)i); /* 0.03 x + 0.06 y + 0.18 z */
	for (int around = 0; around < 2; around++) {
		v.around = around;
		assert_true(bb_volume_voxel(&v, 1, 2, 3, 0) == (double)values[23]);
		assert_true(bb_volume_voxel(&v, 5, -1, 3, 0) == (double)values[19]);
		assert_true(bb_volume_voxel(&v, 0, 0, 4, 0) == (double)values[around ? 0 : 18]);
		assert_true(bb_volume_voxel(&v, 0, 0, -1, 0) == (double)values[around ? 18 : 0]);
		assert_true(bb_volume_voxel(&v, 0, 0, -9, 0) == (double)values[around ? 18 : 0]);
		const double inside[3] = { 0.25, 1.5, 2.75 }, end[3] = { 0.25, 1.5, 3.25 }, begin[3] = { 0.25, 1.5, -0.75 };
		const double here = 0.1 + 0.03 * 0.25 + 0.06 * 1.5, last = here + 0.18 * 3;
		assert_true(fabs(bb_volume_sample(&v, inside, 0) - (here + 0.18 * 2.75)) < 1e-7);
		assert_true(fabs(bb_volume_sample(&v, end, 0) - (around ? last + (here - last) / 4 : last)) < 1e-7);
		assert_true(fabs(bb_volume_sample(&v, begin, 0) - (around ? here + (last - here) * 0.75 : here)) < 1e-7);
		const double odd[3] = { (double)NAN, (double)NAN, (double)NAN };
		assert_true(bb_volume_sample(&v, odd, 0) >= (double)values[0]);
	}
}

static uint64_t fnv(const void *bytes, size_t n)
{
	uint64_t h = UINT64_C(14695981039346656037);

	for (size_t i = 0; i < n; i++)
		h = (h ^ ((const uint8_t *)bytes)[i]) * UINT64_C(1099511628211);
	return h;
}

static double mean_within(const struct bb_volume *v, uint32_t step, double from, double to)
{
	const double middle = (v->dim[0] - 1) / 2.0, half = v->dim[0] / 2.0;
	double sum = 0;
	size_t n = 0;

	for (uint32_t z = 0; z < v->dim[2]; z++)
		for (uint32_t y = 0; y < v->dim[1]; y++)
			for (uint32_t x = 0; x < v->dim[0]; x++) {
				const double dx = x - middle, dy = y - middle, dz = z - middle;
				const double r = sqrt(dx * dx + dy * dy + dz * dz) / half;
				if (r < from || r >= to)
					continue;
				sum += bb_volume_voxel(v, x, y, z, step);
				n++;
			}
	return sum / (double)n;
}

/* The hash pins the bytes: on another machine or compiler it must be the same. */
static void cme_is_the_same_everywhere_and_flies_out(void **state)
{
	(void)state;
	struct bb_volume *v, *again;
	const size_t bytes = (size_t)87 * 87 * 87 * 5 * 2;

	assert_int_equal(bb_volume_generate("cme", 87, 5, &v, NULL), BB_OK);
	assert_int_equal(bb_volume_generate("cme", 87, 5, &again, NULL), BB_OK);
	assert_memory_equal(v->voxels, again->voxels, bytes);
	print_message("cme 87^3 x 5: hash %016llx\n", (unsigned long long)fnv(v->voxels, bytes));
	assert_true(fnv(v->voxels, bytes) == CME_HASH);
	for (uint32_t s = 0; s < 5; s++) {
		assert_true(mean_within(v, s, 0, 0.06) > 0.85);   /* the core stays */
		assert_true(mean_within(v, s, 1.06, 2) == 0);     /* nothing in the corners */
		assert_true(bb_volume_voxel(v, 0, 43, 43, s) < 3000 / 65535.0);
	}
	assert_true(mean_within(v, 0, 0.2, 0.35) > 2 * mean_within(v, 4, 0.2, 0.35));
	assert_true(mean_within(v, 4, 0.75, 0.95) > 4 * mean_within(v, 0, 0.75, 0.95));
	bb_volume_free(v);
	bb_volume_free(again);
}

static void generator_refuses_nonsense(void **state)
{
	(void)state;
	static const struct {
		const char *kind;
		uint32_t edge, steps;
		int number;
	} bad[] = { { "sphere", 8, 1, 1430 },      { "", 8, 1, 1430 },       { "cme", 0, 5, 1431 },
		    { "cme", 87, 0, 1431 },        { "cme", 100000, 5, 1431 }, { "cme", UINT32_MAX, UINT32_MAX, 1431 },
		    { "cme", 1024, 1000, 1405 } };

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_error err = { 0 };
		struct bb_volume *v;
		assert_true(bb_volume_generate(bad[i].kind, bad[i].edge, bad[i].steps, &v, &err) < 0);
		assert_null(v);
		assert_int_equal(err.number, bad[i].number);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(raw_volume_is_normalised, make_folder, remove_folder),
		cmocka_unit_test_setup_teardown(raw_types_and_byte_orders_agree, make_folder, remove_folder),
		cmocka_unit_test_setup_teardown(extreme_values_do_no_harm, make_folder, remove_folder),
		cmocka_unit_test(sampling_is_linear_everywhere),
		cmocka_unit_test(values_and_an_axis_without_ends),
		cmocka_unit_test(cme_is_the_same_everywhere_and_flies_out),
		cmocka_unit_test(generator_refuses_nonsense),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
