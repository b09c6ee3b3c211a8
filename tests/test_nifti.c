/* tests/test_nifti.c: NIfTI-1 files made here byte by byte, and real scans where they are at hand. */
#include "render/volume/volume.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zlib.h>

#include <cmocka.h>

#define FILE_MAX (352 + 4096)

struct made { /* a file being made, in either byte order */
	uint8_t bytes[FILE_MAX];
	size_t n;
	bool big;
};

static void put(struct made *m, size_t at, const void *value, size_t n)
{
	for (size_t i = 0; i < n; i++)
		m->bytes[at + i] = ((const uint8_t *)value)[m->big ? n - 1 - i : i];
	if (at + n > m->n)
		m->n = at + n;
}

static void put_i16(struct made *m, size_t at, int v)
{
	const int16_t x = (int16_t)v;

	put(m, at, &x, 2);
}

static void put_f32(struct made *m, size_t at, float v)
{
	put(m, at, &v, 4);
}

static struct made header(bool big, int datatype, int bits, int n_dims, const int *dims)
{
	struct made m = { .big = big };

	put(&m, 0, &(int32_t){ 348 }, 4);
	put_i16(&m, 40, n_dims);
	for (size_t i = 0; i < 7; i++) {
		put_i16(&m, 42 + 2 * i, (int)i < n_dims ? dims[i] : 1);
		put_f32(&m, 80 + 4 * i, (float)(i + 1));
	}
	put_i16(&m, 70, datatype);
	put_i16(&m, 72, bits);
	put_f32(&m, 108, 352);
	memcpy(m.bytes + 344, "n+1", 4);
	m.n = 352;
	return m;
}

static void write_made(const struct made *m, const char *path)
{
	FILE *f = fopen(path, "wb");

	assert_non_null(f);
	assert_int_equal(fwrite(m->bytes, 1, m->n, f), m->n);
	assert_int_equal(fclose(f), 0);
}

static void write_packed(const struct made *m, const char *path)
{
	gzFile f = gzopen(path, "wb");

	assert_non_null(f);
	assert_int_equal(gzwrite(f, m->bytes, (unsigned)m->n), m->n);
	assert_int_equal(gzclose(f), Z_OK);
}

static struct bb_volume *load_as(const struct made *m, bool packed, int number)
{
	char path[64] = "/tmp/bb-nifti-XXXXXX";
	struct bb_error err = { 0 };
	struct bb_volume *v;

	assert_non_null(mkdtemp(path));
	const size_t n = strlen(path);
	strcat(path, packed ? "/a.nii.gz" : "/a.nii");
	packed ? write_packed(m, path) : write_made(m, path);
	const enum bb_status status = bb_volume_load(path, BB_VOLUME_CAP_BYTES, &v, &err);
	unlink(path);
	path[n] = '\0';
	rmdir(path);
	assert_int_equal(err.number, number);
	assert_true(number ? status < 0 && !v : status == BB_OK && v);
	return v;
}

/* Writes sample i = i - 3 in the type asked for. */
static void put_sample(struct made *m, size_t at, int datatype, int value)
{
	switch (datatype) {
	case 2:
		put(m, at, &(uint8_t){ (uint8_t)value }, 1);
		break;
	case 256:
		put(m, at, &(int8_t){ (int8_t)value }, 1);
		break;
	case 4:
	case 512:
		put_i16(m, at, value);
		break;
	case 8:
		put(m, at, &(int32_t){ value }, 4);
		break;
	case 16:
		put_f32(m, at, (float)value);
		break;
	default:
		put(m, at, &(double){ value }, 8);
	}
}

static void every_type_in_either_order_and_packing(void **state)
{
	(void)state;
	static const struct {
		int datatype, bits, first;
	} types[] = { { 2, 8, 0 }, { 4, 16, -3 }, { 8, 32, -3 }, { 16, 32, -3 }, { 64, 64, -3 }, { 256, 8, -3 },
		      { 512, 16, 60000 - 65536 } };
	const int dims[] = { 3, 2, 2, 2 };

	for (size_t t = 0; t < BB_ARRAY_LEN(types); t++)
		for (int variant = 0; variant < 4; variant++) {
			struct made m = header(variant & 1, types[t].datatype, types[t].bits, 4, dims);
			for (int i = 0; i < 24; i++)
				put_sample(&m, 352 + (size_t)(i * types[t].bits / 8), types[t].datatype,
				           types[t].first + i);
			struct bb_volume *v = load_as(&m, variant & 2, 0);
			const double first = types[t].datatype == 512 ? 60000 : types[t].first;
			assert_true(v->dim[0] == 3 && v->dim[1] == 2 && v->dim[2] == 2 && v->n_steps == 2);
			assert_true(v->least == first && v->most == first + 23);
			assert_true(v->spacing_mm[0] == 1 && v->spacing_mm[2] == 3);
			assert_string_equal(v->name, "a");
			for (int i = 0; i < 24; i++)
				assert_int_equal(v->voxels[i], (int)(i / 23.0 * 65535 + 0.5));
			bb_volume_free(v);
		}
}

static void slope_intercept_and_extension(void **state)
{
	(void)state;
	const int dims[] = { 2, 2, 1 };
	struct made m = header(false, 4, 16, 3, dims);

	put_f32(&m, 112, -0.5f);
	put_f32(&m, 116, 10);
	put_f32(&m, 108, 400); /* 48 bytes of extension in between */
	memset(m.bytes + 348, 0x5A, 52);
	for (int i = 0; i < 4; i++)
		put_i16(&m, 400 + 2 * (size_t)i, 4 * i);
	struct bb_volume *v = load_as(&m, true, 0);
	assert_true(v->least == 4 && v->most == 10);
	assert_true(v->voxels[0] == 65535 && v->voxels[3] == 0);
	bb_volume_free(v);
	put_f32(&m, 112, 0); /* slope 0: neither counts */
	v = load_as(&m, false, 0);
	assert_true(v->least == 0 && v->most == 12);
	bb_volume_free(v);
}

static void units_and_trailing_dimensions(void **state)
{
	(void)state;
	const int flat[] = { 2, 1, 1, 1, 1, 1, 1 }, vector[] = { 2, 1, 1, 1, 3 };
	struct made m = header(true, 2, 8, 7, flat);

	m.bytes[123] = 1; /* metres */
	put_f32(&m, 80, -0.002f);
	put_f32(&m, 84, 0);
	m.n = 354;
	struct bb_volume *v = load_as(&m, false, 0);
	assert_true(fabs(v->spacing_mm[0] - 2) < 1e-6 && v->spacing_mm[1] == 1);
	bb_volume_free(v);
	m = header(false, 2, 8, 5, vector);
	m.n = FILE_MAX;
	load_as(&m, false, 1404);
}

static void one_voxel_too_few_is_noticed(void **state)
{
	(void)state;
	const int dims[] = { 4, 4, 4 };
	struct made m = header(false, 4, 16, 3, dims);

	m.n = 352 + 128;
	bb_volume_free(load_as(&m, false, 0));
	bb_volume_free(load_as(&m, true, 0));
	m.n--;
	load_as(&m, false, 1406);
	load_as(&m, true, 1406);
}

/* Any header, a thousand of them: an answer, an error with a number, and nothing else. */
static void random_damage_never_crashes(void **state)
{
	(void)state;
	const int dims[] = { 4, 4, 4, 2 };
	char path[] = "/tmp/bb-nifti-XXXXXX.nii";
	const int fd = mkstemps(path, 4);
	uint32_t seed = 99;
	int n_good = 0;

	assert_true(fd >= 0);
	for (int round = 0; round < 2000; round++) {
		struct made m = header(round & 1, 4, 16, 4, dims);
		struct bb_error err = { 0 };
		struct bb_volume *v;
		m.n = 352 + 256;
		for (int k = 0; k < 1 + round % 5; k++) {
			seed = seed * 1664525u + 1013904223u;
			const size_t at = k & 1 ? 40 + (seed >> 8) % 84 : (seed >> 8) % 348;
			m.bytes[at] = (uint8_t)(seed >> 24);
		}
		assert_int_equal(ftruncate(fd, 0), 0);
		assert_int_equal(pwrite(fd, m.bytes, m.n, 0), m.n);
		const enum bb_status status = bb_volume_load(path, 1u << 20, &v, &err);
		assert_true(status == BB_OK ? !err.number : err.number >= 1401 && err.number <= 1413);
		n_good += status == BB_OK;
		bb_volume_free(v);
	}
	close(fd);
	unlink(path);
	assert_true(n_good > 100 && n_good < 1900); /* both kinds were met */
}

static struct bb_volume *load_real(const char *path)
{
	struct bb_error err = { 0 };
	struct bb_volume *v;

	if (access(path, R_OK)) {
		print_message("skipped: %s is not here\n", path);
		skip();
	}
	const enum bb_status status = bb_volume_load(path, BB_VOLUME_CAP_BYTES, &v, &err);
	if (status)
		print_error("%s\n", err.text);
	assert_int_equal(status, BB_OK);
	return v;
}

static void reads_the_echo_planar_scan(void **state)
{
	(void)state;
	struct bb_volume *v = load_real("build/data/example4d.nii.gz");
	size_t n_air = 0, n = (size_t)128 * 96 * 24;

	assert_string_equal(v->name, "example4d");
	assert_true(v->dim[0] == 128 && v->dim[1] == 96 && v->dim[2] == 24 && v->n_steps == 2);
	assert_true(v->least == 0 && v->most == 1162 && v->n_nonfinite == 0);
	assert_true(v->spacing_mm[0] == 2 && fabs(v->spacing_mm[2] - 2.2) < 1e-5);
	for (size_t i = 0; i < n; i++)
		n_air += v->voxels[i] == 0;
	assert_true(n_air > n / 2 && n_air < n);
	assert_true(memcmp(v->voxels, v->voxels + n, n * 2) != 0); /* the steps differ */
	bb_volume_free(v);
}

static void reads_the_perfusion_scan(void **state)
{
	(void)state;
	struct bb_volume *v = load_real("build/data/pcasl.nii.gz");

	assert_true(v->dim[0] == 52 && v->dim[1] == 68 && v->dim[2] == 20 && v->n_steps == 10);
	assert_true(v->least == 0 && v->most == 2640);
	assert_true(v->spacing_mm[0] == 3 && v->spacing_mm[2] == 6);
	bb_volume_free(v);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_type_in_either_order_and_packing),
		cmocka_unit_test(slope_intercept_and_extension),
		cmocka_unit_test(units_and_trailing_dimensions),
		cmocka_unit_test(one_voxel_too_few_is_noticed),
		cmocka_unit_test(random_damage_never_crashes),
		cmocka_unit_test(reads_the_echo_planar_scan),
		cmocka_unit_test(reads_the_perfusion_scan),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
