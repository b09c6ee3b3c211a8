/*
 * tests/test_hostile_data.c: broken transfer functions and volumes. The number before the first '-' of a file's name in
 * tests/hostile/{tf,volumes} is the error it must give; binary ones are made here. Each in under a second, all
 * together within 256 MiB, none with a crash.
 */
#include "hal/clock.h"
#include "render/transfer.h"
#include "render/volume/volume.h"

#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <cmocka.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define UNDER_SANITIZER
#endif
#elif defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define UNDER_SANITIZER
#endif

#define MOST_NS INT64_C(1000000000)
#define MOST_KIB (256 * 1024)

static void expect(const char *path, uint64_t cap_bytes, int number)
{
	static struct bb_transfer tf;
	const size_t n = strlen(path);
	const bool is_tf = n > 3 && !strcmp(path + n - 3, ".tf");
	struct bb_error err = { 0 };
	struct bb_volume *v = NULL;

	const int64_t start_ns = bb_clock_stopwatch_ns();
	const enum bb_status status = is_tf ? bb_transfer_load(path, &tf, &err) : bb_volume_load(path, cap_bytes, &v, &err);
	const int64_t took_ns = bb_clock_stopwatch_ns() - start_ns;
	if (err.number != number || status >= 0)
		print_error("%s: want BB%d, got %s\n", path, number, err.number ? err.text : "no error");
	assert_true(status < 0 && !v);
	assert_int_equal(err.number, number);
	assert_non_null(strstr(err.text, "/")); /* it names a file */
	assert_true(took_ns < MOST_NS);
}

static void every_file_of(const char *folder, size_t least)
{
	struct dirent **entries;
	const int n = scandir(folder, &entries, NULL, alphasort);
	size_t n_tried = 0;

	assert_true(n > 0);
	for (int i = 0; i < n; i++) {
		char path[512];
		const int number = atoi(entries[i]->d_name);
		snprintf(path, sizeof(path), "%s/%s", folder, entries[i]->d_name);
		free(entries[i]);
		if (number < 1000)
			continue;
		expect(path, BB_VOLUME_CAP_BYTES, number);
		n_tried++;
	}
	free(entries);
	print_message("%s: %zu files\n", folder, n_tried);
	assert_true(n_tried >= least);
}

static void transfer_functions(void **state)
{
	(void)state;
	every_file_of("tests/hostile/tf", 15);
}

static void volumes(void **state)
{
	(void)state;
	every_file_of("tests/hostile/volumes", 25);
}

/* The line of the fault stands in the message. */
static void faults_have_a_line(void **state)
{
	(void)state;
	struct bb_error err = { 0 };
	struct bb_volume *v;

	assert_true(bb_volume_load("tests/hostile/volumes/1421-dims-twice.hdr.txt", 1 << 20, &v, &err) < 0);
	assert_non_null(strstr(err.text, "1421-dims-twice.hdr.txt:3:"));
}

/* A sound NIfTI file to damage: 4 x 4 x 4 i16. */
static size_t sound(uint8_t *b)
{
	static const int16_t dim[8] = { 3, 4, 4, 4, 1, 1, 1, 1 };
	const float one = 1, offset = 352;

	memset(b, 0, 480);
	b[0] = 348 & 0xFF;
	b[1] = 348 >> 8;
	memcpy(b + 40, dim, sizeof(dim));
	b[70] = 4;
	b[72] = 16;
	for (size_t i = 0; i < 3; i++)
		memcpy(b + 80 + 4 * i, &one, 4);
	memcpy(b + 108, &offset, 4);
	memcpy(b + 344, "n+1", 4);
	for (size_t i = 352; i < 480; i++)
		b[i] = (uint8_t)(i * 37);
	return 480;
}

struct folder {
	char path[64];
};

static int make_folder(void **state)
{
	struct folder *f = calloc(1, sizeof(*f));

	snprintf(f->path, sizeof(f->path), "/tmp/bb-hostile-XXXXXX");
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

static void in(const struct folder *f, const char *name, char path[128])
{
	snprintf(path, 128, "%s/%s", f->path, name);
}

static void write_bytes(const char *path, const void *bytes, size_t n)
{
	FILE *file = fopen(path, "wb");

	assert_non_null(file);
	assert_int_equal(fwrite(bytes, 1, n, file), n);
	assert_int_equal(fclose(file), 0);
}

static void f32_at(uint8_t *b, size_t at, double v)
{
	const float f = (float)v;

	memcpy(b + at, &f, 4);
}

static void i16_at(uint8_t *b, size_t at, int v)
{
	b[at] = (uint8_t)v;
	b[at + 1] = (uint8_t)((unsigned)v >> 8);
}

/* Each row changes one or two numbers of the sound header; tried plain and packed. */
static void damaged_headers(void **state)
{
	static const struct {
		char kind; /* 'i' i16, 'f' f32, 'b' byte */
		size_t at;
		double value;
		int number;
	} rows[] = {
		{ 'i', 40, 0, 1404 },       { 'i', 40, -1, 1404 },        { 'i', 40, 2, 1404 },
		{ 'i', 40, 8, 1404 },       { 'i', 40, 32767, 1404 },     { 'i', 42, 0, 1404 },
		{ 'i', 44, -4, 1404 },      { 'i', 46, -32768, 1404 },    { 'i', 46, 5, 1406 },
		{ 'i', 42, 32767, 1406 },   { 'i', 70, 0, 1403 },         { 'i', 70, 32, 1403 },
		{ 'i', 70, 128, 1403 },     { 'i', 70, 1024, 1403 },      { 'i', 70, 2304, 1403 },
		{ 'i', 72, 8, 1403 },       { 'i', 72, -16, 1403 },       { 'f', 108, (double)NAN, 1407 },
		{ 'f', 108, -352, 1407 },   { 'f', 108, 1e30, 1407 },     { 'f', 108, HUGE_VAL, 1407 },
		{ 'f', 108, 0, 1407 },      { 'f', 108, 352.5, 1407 },    { 'f', 108, 1e6, 1406 },
		{ 'f', 112, (double)NAN, 1409 }, { 'f', 112, HUGE_VAL, 1409 }, { 'f', 116, (double)NAN, 1409 },
		{ 'f', 80, (double)NAN, 1412 },  { 'f', 84, HUGE_VAL, 1412 },  { 'f', 88, 1e-30, 1412 },
		{ 'b', 0, 0, 1402 },        { 'b', 1, 2, 1402 },          { 'b', 344, 0, 1402 },
		{ 'b', 345, 'i', 1402 },    { 'b', 346, '2', 1402 },
	};
	uint8_t b[480];
	char path[128];

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		const size_t n = sound(b);
		if (rows[i].kind == 'i')
			i16_at(b, rows[i].at, (int)rows[i].value);
		else if (rows[i].kind == 'f')
			f32_at(b, rows[i].at, rows[i].value);
		else
			b[rows[i].at] = (uint8_t)rows[i].value;
		in(*state, "damaged.nii", path);
		write_bytes(path, b, n);
		expect(path, BB_VOLUME_CAP_BYTES, rows[i].number);
		in(*state, "damaged.nii.gz", path);
		gzFile gz = gzopen(path, "wb");
		assert_int_equal(gzwrite(gz, b, (unsigned)n), n);
		assert_int_equal(gzclose(gz), Z_OK);
		expect(path, BB_VOLUME_CAP_BYTES, rows[i].number);
	}
	sound(b); /* the undamaged one loads, or all of the above proves nothing */
	struct bb_volume *v;
	in(*state, "sound.nii", path);
	write_bytes(path, b, 480);
	assert_int_equal(bb_volume_load(path, BB_VOLUME_CAP_BYTES, &v, NULL), BB_OK);
	bb_volume_free(v);
}

/* 2150 x 2100 x 1000 voxels, 2 steps, i16: 18.06e9 bytes. */
static void eighteen_gigabytes_in_377_bytes(void **state)
{
	uint8_t b[480];
	char path[128];

	sound(b);
	i16_at(b, 40, 4);
	i16_at(b, 42, 2150);
	i16_at(b, 44, 2100);
	i16_at(b, 46, 1000);
	i16_at(b, 48, 2);
	in(*state, "claims.nii", path);
	write_bytes(path, b, 377);
	expect(path, BB_VOLUME_CAP_BYTES, 1406);
	expect(path, UINT64_MAX, 1406); /* even without a cap */
	in(*state, "claims.nii.gz", path);
	gzFile gz = gzopen(path, "wb");
	assert_int_equal(gzwrite(gz, b, 377), 377);
	assert_int_equal(gzclose(gz), Z_OK);
	expect(path, UINT64_MAX, 1406);
}

static size_t packed(const char *path, uint8_t *out, size_t cap)
{
	uint8_t b[480];
	gzFile gz = gzopen(path, "wb");

	sound(b);
	assert_int_equal(gzwrite(gz, b, 480), 480);
	assert_int_equal(gzclose(gz), Z_OK);
	FILE *file = fopen(path, "rb");
	const size_t n = fread(out, 1, cap, file);
	fclose(file);
	assert_true(n > 100 && n < cap);
	return n;
}

/* Cut anywhere, even within the checksum at its end; and with any byte of the checksum wrong. */
static void damaged_gzip(void **state)
{
	uint8_t b[1024];
	char path[128];

	in(*state, "cut.nii.gz", path);
	const size_t n = packed(path, b, sizeof(b));
	for (size_t cut = 20; cut < n; cut++) {
		write_bytes(path, b, cut);
		expect(path, BB_VOLUME_CAP_BYTES, 1408);
	}
	for (size_t i = n - 8; i < n; i++) {
		b[i] ^= 1;
		write_bytes(path, b, n);
		expect(path, BB_VOLUME_CAP_BYTES, 1408);
		b[i] ^= 1;
	}
}

static void bombs(void **state)
{
	static uint8_t noise[200 * 1024];
	uint8_t b[480];
	char path[128];
	uint32_t seed = 3;

	/* Claims 512 x 512 x 200 i16 = 100 MiB of a file of 200 KiB: deflate could, no scan does. */
	sound(b);
	i16_at(b, 42, 512);
	i16_at(b, 44, 512);
	i16_at(b, 46, 200);
	for (size_t i = 0; i < sizeof(noise); i++)
		noise[i] = (uint8_t)((seed = seed * 1664525u + 1013904223u) >> 24);
	in(*state, "bomb.nii.gz", path);
	gzFile gz = gzopen(path, "wb1");
	assert_int_equal(gzwrite(gz, b, 352), 352);
	assert_int_equal(gzwrite(gz, noise, sizeof(noise)), sizeof(noise));
	assert_int_equal(gzclose(gz), Z_OK);
	expect(path, BB_VOLUME_CAP_BYTES, 1410);

	/* A sound volume with 40 MiB of zeros behind it. */
	sound(b);
	memset(noise, 0, sizeof(noise));
	gz = gzopen(path, "wb1");
	assert_int_equal(gzwrite(gz, b, 480), 480);
	for (int i = 0; i < 200; i++)
		assert_int_equal(gzwrite(gz, noise, sizeof(noise)), sizeof(noise));
	assert_int_equal(gzclose(gz), Z_OK);
	expect(path, BB_VOLUME_CAP_BYTES, 1411);
}

static void the_cap_is_kept(void **state)
{
	static uint8_t big[352 + 128 * 128 * 64];
	char path[128];
	struct bb_volume *v;

	sound(big);
	i16_at(big, 42, 128);
	i16_at(big, 44, 128);
	i16_at(big, 46, 64);
	big[70] = 2;
	big[72] = 8;
	in(*state, "big.nii", path);
	write_bytes(path, big, sizeof(big));
	expect(path, 0, 1405);
	expect(path, 1, 1405);
	expect(path, 128 * 128 * 64 * 2, 1405); /* the voxels fit, the slab they pass through does not */
	assert_int_equal(bb_volume_load(path, 128 * 128 * 64 * 2 + (1 << 18), &v, NULL), BB_OK);
	bb_volume_free(v);
}

static void things_that_are_no_files(void **state)
{
	char path[128], other[128];

	in(*state, "pipe.nii", path);
	assert_int_equal(mkfifo(path, 0600), 0);
	expect(path, BB_VOLUME_CAP_BYTES, 1001);
	in(*state, "pipe.tf", path);
	assert_int_equal(mkfifo(path, 0600), 0);
	expect(path, 0, 1001);
	in(*state, "folder.nii.gz", path);
	assert_int_equal(mkdir(path, 0700), 0);
	expect(path, BB_VOLUME_CAP_BYTES, 1001);
	in(*state, "zero.nii", path);
	assert_int_equal(symlink("/dev/zero", path), 0);
	expect(path, BB_VOLUME_CAP_BYTES, 1001);
	in(*state, "loop.nii", path);
	assert_int_equal(symlink(path, path), 0);
	expect(path, BB_VOLUME_CAP_BYTES, 1001);

	/* A header may not reach out of its folder through a link either. */
	in(*state, "link.raw", other);
	assert_int_equal(symlink("/etc/passwd", other), 0);
	in(*state, "link.hdr.txt", path);
	static const char text[] = "file: link.raw\ndims: 1 1 1\ntype: u8\n";
	write_bytes(path, text, sizeof(text) - 1);
	expect(path, BB_VOLUME_CAP_BYTES, 1424);
}

static void two_mebibytes_of_transfer_function(void **state)
{
	char path[128];
	const size_t n = (size_t)2 << 20;
	char *text = malloc(n);

	memset(text, '#', n);
	in(*state, "long.tf", path);
	write_bytes(path, text, n);
	expect(path, 0, 1003);
	free(text);
}

static void memory_stayed_small(void **state)
{
	(void)state;
	struct rusage use;

#ifdef UNDER_SANITIZER
	print_message("skipped: a sanitizer's own memory would be counted\n");
	skip();
#endif
	assert_int_equal(getrusage(RUSAGE_SELF, &use), 0);
	print_message("most memory held: %ld KiB\n", use.ru_maxrss);
	assert_true(use.ru_maxrss < MOST_KIB);
}

#define IN_FOLDER(test) cmocka_unit_test_setup_teardown(test, make_folder, remove_folder)

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(transfer_functions),
		cmocka_unit_test(volumes),
		cmocka_unit_test(faults_have_a_line),
		IN_FOLDER(damaged_headers),
		IN_FOLDER(eighteen_gigabytes_in_377_bytes),
		IN_FOLDER(damaged_gzip),
		IN_FOLDER(bombs),
		IN_FOLDER(the_cap_is_kept),
		IN_FOLDER(things_that_are_no_files),
		IN_FOLDER(two_mebibytes_of_transfer_function),
		cmocka_unit_test(memory_stayed_small),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
