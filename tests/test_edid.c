/*
 * tests/test_edid.c: the EDID reader against golden bytes, against generated EDIDs of every model and mode, against
 * damage of every kind, and, where they are, against real EDIDs and edid-decode.
 */
#include "drivers/edid.h"
#include "sim/edid_model.h"

#include <dirent.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

static const uint8_t golden[128] = {
	0x00, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x00, 0x08, 0x54, 0x01, 0x00, 0xa0, 0x01, 0x00, 0x00,
	0x01, 0x22, 0x01, 0x04, 0xa5, 0x35, 0x1e, 0x78, 0x06, 0xee, 0x91, 0xa3, 0x54, 0x4c, 0x99, 0x26,
	0x0f, 0x50, 0x54, 0x00, 0x00, 0x00, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01,
	0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x86, 0x6f, 0x80, 0xa0, 0x70, 0x38, 0x40, 0x40, 0x30, 0x20,
	0x35, 0x00, 0x13, 0x2b, 0x21, 0x00, 0x00, 0x5a, 0x00, 0x00, 0x00, 0xfc, 0x00, 0x42, 0x42, 0x55,
	0x52, 0x53, 0x54, 0x2d, 0x53, 0x49, 0x4d, 0x0a, 0x20, 0x20, 0x00, 0x00, 0x00, 0xff, 0x00, 0x53,
	0x49, 0x4d, 0x30, 0x30, 0x30, 0x30, 0x34, 0x31, 0x36, 0x0a, 0x20, 0x20, 0x00, 0x00, 0x00, 0xfd,
	0x00, 0x30, 0x78, 0x1e, 0x8c, 0x3c, 0x01, 0x0a, 0x20, 0x20, 0x20, 0x20, 0x20, 0x20, 0x00, 0x9a,
};

static void seal(uint8_t *block)
{
	unsigned int sum = 0;

	for (int i = 0; i < 127; i++)
		sum += block[i];
	block[127] = (uint8_t)(0x100 - (sum & 0xFF));
}

static void test_golden(void **state)
{
	(void)state;
	struct edid_info e;

	assert_int_equal(edid_parse(golden, sizeof(golden), &e), BB_OK);
	assert_int_equal(edid_bad_block(golden, sizeof(golden)), -1);
	assert_string_equal(e.maker, "BBT");
	assert_int_equal(e.product, 1);
	assert_int_equal(e.serial, 416);
	assert_int_equal(e.year, 2024);
	assert_true(e.week == 1 && e.version == 1 && e.revision == 4);
	assert_true(e.digital && e.bits_per_color == 8 && e.interface == 5);
	assert_true(e.width_cm == 53 && e.height_cm == 30 && e.gamma_x100 == 220);
	static const double srgb[8] = { 0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3125, 0.3291 };
	for (int i = 0; i < 8; i++)
		assert_true(fabs(e.chroma[i] / 1024.0 - srgb[i]) <= 0.5 / 1024 + 1e-12);
	assert_string_equal(e.name, "BBURST-SIM");
	assert_string_equal(e.serial_text, "SIM0000416");
	assert_true(e.has_range && e.least_hz == 48 && e.most_hz == 120 && e.least_khz == 30 && e.most_khz == 140 &&
		    e.most_mhz == 600);
	assert_int_equal(e.n_timings, 1);
	const struct edid_timing *t = &e.timing[0];
	assert_true(t->width == 1920 && t->height == 1080 && t->h_blank == 160 && t->v_blank == 64);
	assert_true(t->h_front == 48 && t->h_sync == 32 && t->v_front == 3 && t->v_sync == 5);
	assert_true(t->width_mm == 531 && t->height_mm == 299 && t->clock_khz == 285500 && !t->interlaced);
	assert_int_equal(t->stereo, EDID_STEREO_SEQUENTIAL_LEFT);
	assert_true(fabs(edid_timing_hz(t) - 119.982) < 0.001);
	assert_int_equal(e.n_declared, 0);
	assert_int_equal(e.n_extensions, 0);
}

/* What the writer put in comes out, for every model over many modes. */
static void test_generated(void **state)
{
	(void)state;
	static const uint32_t hz[] = { 24, 60, 120, 144 };
	int n = 0;

	for (int width = 640; width <= 4000; width += 160)
		for (int height = 480; height <= 2400; height += 120)
			for (size_t i = 0; i < BB_ARRAY_LEN(hz); i++) {
				const struct sim_edid_spec spec = { sim_edid_model_at((size_t)n % 4),
								    width,
								    height,
								    { hz[i], 1 },
								    (uint32_t)n * 977,
								    n % 3 == 0 };
				uint8_t b[SIM_EDID_MAX_BYTES];
				struct bb_cvt t;
				struct edid_info e;
				size_t bytes;
				if (sim_edid_make(&spec, b, &bytes) != BB_OK)
					continue;
				n++;
				assert_int_equal(bb_cvt_rb(width, height, spec.rate, &t), BB_OK);
				assert_int_equal(edid_parse(b, bytes, &e), BB_OK);
				assert_string_equal(e.maker, spec.model->maker);
				assert_string_equal(e.name, spec.model->shown);
				assert_int_equal(e.serial, spec.serial);
				assert_true(e.timing[0].width == width && e.timing[0].height == height);
				assert_true(e.timing[0].clock_khz == t.clock_khz && e.timing[0].v_blank == t.v_blank &&
					    e.timing[0].h_sync == t.h_sync && e.timing[0].v_sync == t.v_sync);
				assert_int_equal(e.timing[0].stereo,
						 spec.stereo ? EDID_STEREO_SEQUENTIAL_LEFT : EDID_STEREO_NONE);
				assert_int_equal(e.n_extensions, bytes / 128 - 1);
				if (e.n_extensions) {
					assert_true(e.extension[0].tag == 2 && e.extension[0].revision == 3);
					assert_int_equal(e.extension[0].n_blocks, 2);
				}
			}
	print_message("%d EDIDs\n", n);
	assert_true(n > 500);
}

static void test_stereo_bits(void **state)
{
	(void)state;
	static const struct {
		uint8_t flags;
		enum edid_stereo stereo;
	} known[] = { { 0x00, EDID_STEREO_NONE },
		      { 0x01, EDID_STEREO_NONE },
		      { 0x20, EDID_STEREO_SEQUENTIAL_RIGHT },
		      { 0x40, EDID_STEREO_SEQUENTIAL_LEFT },
		      { 0x21, EDID_STEREO_ROWS_RIGHT_EVEN },
		      { 0x41, EDID_STEREO_ROWS_LEFT_EVEN },
		      { 0x60, EDID_STEREO_FOUR_WAY },
		      { 0x61, EDID_STEREO_SIDE_BY_SIDE } };

	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++) {
		uint8_t b[128];
		struct edid_info e;
		memcpy(b, golden, 128);
		b[71] = (uint8_t)(0x9E | known[i].flags);
		seal(b);
		assert_int_equal(edid_parse(b, 128, &e), BB_OK);
		assert_int_equal(e.timing[0].stereo, known[i].stereo);
		assert_true(e.timing[0].interlaced);
	}
}

static void test_damage(void **state)
{
	(void)state;
	struct edid_info e;
	uint8_t b[128];

	for (unsigned int bit = 0; bit < 1024; bit++) {
		memcpy(b, golden, 128);
		b[bit / 8] ^= (uint8_t)(1u << bit % 8);
		assert_int_equal(edid_parse(b, 128, &e), BB_ERR_FORMAT);
		assert_int_equal(edid_bad_block(b, 128), 0);
	}
	for (size_t n = 0; n < 128; n++) {
		assert_int_equal(edid_parse(golden, n, &e), BB_ERR_FORMAT);
		assert_int_equal(edid_bad_block(golden, n), 0);
	}
}

/* Extensions that lie: counts without blocks, lengths past the end, timings where none can be. */
static void test_hostile_extensions(void **state)
{
	(void)state;
	uint8_t b[EDID_MOST_BLOCKS * 128 + 128];
	struct edid_info e;

	memset(b, 0, sizeof(b));
	memcpy(b, golden, 128);
	b[126] = 255;
	seal(b);
	assert_int_equal(edid_parse(b, 128, &e), BB_OK);
	assert_true(e.n_declared == 255 && e.n_extensions == 0);
	assert_int_equal(edid_parse(b, 255, &e), BB_OK); /* half a block is none */
	assert_int_equal(e.n_extensions, 0);
	assert_int_equal(edid_bad_block(b, 255), 1);
	assert_int_equal(edid_parse(b, sizeof(b), &e), BB_OK);
	assert_int_equal(e.n_extensions, EDID_MOST_BLOCKS - 1);
	b[126] = 1;
	seal(b);
	for (unsigned int tag = 0; tag < 256; tag++)
		for (unsigned int at = 0; at < 256; at++)
			for (unsigned int fill = 0; fill < 4; fill++) {
				memset(b + 128, (int)(fill * 0x55), 128);
				b[128] = (uint8_t)tag;
				b[129] = 3;
				b[130] = (uint8_t)at;
				seal(b + 128);
				assert_int_equal(edid_parse(b, 256, &e), BB_OK);
				assert_int_equal(e.n_extensions, 1);
				assert_true(e.n_timings <= EDID_MOST_TIMINGS && e.extension[0].n_blocks <= 125);
				if (tag != 2)
					assert_int_equal(e.n_timings, 1); /* a DisplayID block is not read as CTA */
			}
	/* One good data block, and one whose length runs past the collection. */
	memset(b + 128, 0, 128);
	memcpy(b + 128, "\x02\x03\x0B\x80\x43\x10\x04\x01\x5F", 9);
	seal(b + 128);
	assert_int_equal(edid_parse(b, 256, &e), BB_OK);
	assert_int_equal(e.extension[0].n_blocks, 1);
	b[200] ^= 1;
	assert_int_equal(edid_parse(b, 256, &e), BB_OK);
	assert_false(e.extension[0].good);
	assert_int_equal(edid_bad_block(b, 256), 1);
}

static void test_displayid(void **state)
{
	(void)state;
	/* Version 1.2, 20 bytes: a block of 12 and one of 2. */
	static const uint8_t section[] = { 0x70, 0x12, 20, 0x03, 0x00, 0x03, 0x00, 12 };
	uint8_t b[256] = { 0 };
	struct edid_info e;

	memcpy(b, golden, 128);
	b[126] = 1;
	seal(b);
	memcpy(b + 128, section, sizeof(section));
	b[128 + 5 + 15] = 0x0C;
	b[128 + 5 + 17] = 2;
	seal(b + 128);
	assert_int_equal(edid_parse(b, 256, &e), BB_OK);
	assert_int_equal(e.extension[0].tag, 0x70);
	assert_int_equal(e.extension[0].n_blocks, 2);
}

/* ---- real ones ---- */

static size_t slurp(const char *path, uint8_t *out, size_t cap)
{
	FILE *f = fopen(path, "rb");
	const size_t n = f ? fread(out, 1, cap, f) : 0;

	if (f)
		fclose(f);
	return n;
}

/* "Manufacturer: SAM", "Model: 2108", "Serial Number: 1" as edid-decode prints them. */
static bool asked_edid_decode(const char *path, char maker[4], unsigned int *product)
{
	char command[700], line[256];
	int found = 0;

	snprintf(command, sizeof(command), "edid-decode '%s' 2>/dev/null", path);
	FILE *p = popen(command, "r");
	if (!p)
		return false;
	while (fgets(line, sizeof(line), p)) {
		found += sscanf(line, " Manufacturer: %3s", maker) == 1;
		found += sscanf(line, " Model: %u", product) == 1;
	}
	pclose(p);
	return found == 2;
}

static void test_real(void **state)
{
	(void)state;
	static const char folder[] = "build/data/edid";
	DIR *d = opendir(folder);
	int n = 0, judged = 0, damaged = 0;

	if (!d) {
		print_message("SKIP: no %s: put EDIDs of real monitors there (*.bin)\n", folder);
		skip();
	}
	for (const struct dirent *f; (f = readdir(d));) {
		uint8_t b[2048];
		char path[400], maker[4] = "";
		unsigned int product = 0;
		struct edid_info e;
		if (!strstr(f->d_name, ".bin"))
			continue;
		snprintf(path, sizeof(path), "%s/%s", folder, f->d_name);
		const size_t bytes = slurp(path, b, sizeof(b));
		n++;
		if (edid_parse(b, bytes, &e) != BB_OK) {
			damaged++;
			continue;
		}
		assert_memory_equal(e.maker, f->d_name, 3); /* their names begin with maker and product */
		assert_int_equal(
			e.product,
			strtoul((char[]){ f->d_name[3], f->d_name[4], f->d_name[5], f->d_name[6], 0 }, NULL, 16));
		if (asked_edid_decode(path, maker, &product)) {
			judged++;
			assert_string_equal(e.maker, maker);
			assert_int_equal(e.product, product);
		}
	}
	closedir(d);
	print_message("%d real EDIDs, %d without a good base block, %d compared with edid-decode\n", n, damaged,
		      judged);
	assert_true(n > 0 && damaged < n / 4);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_golden),
		cmocka_unit_test(test_generated),
		cmocka_unit_test(test_stereo_bits),
		cmocka_unit_test(test_damage),
		cmocka_unit_test(test_hostile_extensions),
		cmocka_unit_test(test_displayid),
		cmocka_unit_test(test_real),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
