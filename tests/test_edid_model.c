/*
 * tests/test_edid_model.c: generated EDIDs against golden bytes, against the standard's arithmetic over many modes,
 * and, where the program is installed, against edid-decode.
 */
#include "sim/edid_model.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

/* 1920x1080 at 120 Hz with reduced blanking, stereo, serial 416: passed by edid-decode's conformity check. */
static const uint8_t golden[128] = {
	0x00, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x00, 0x08, 0x54, 0x01, 0x00, 0xa0, 0x01, 0x00, 0x00, 0x01, 0x22,
	0x01, 0x04, 0xa5, 0x35, 0x1e, 0x78, 0x06, 0xee, 0x91, 0xa3, 0x54, 0x4c, 0x99, 0x26, 0x0f, 0x50, 0x54, 0x00,
	0x00, 0x00, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01,
	0x86, 0x6f, 0x80, 0xa0, 0x70, 0x38, 0x40, 0x40, 0x30, 0x20, 0x35, 0x00, 0x13, 0x2b, 0x21, 0x00, 0x00, 0x5a,
	0x00, 0x00, 0x00, 0xfc, 0x00, 0x42, 0x42, 0x55, 0x52, 0x53, 0x54, 0x2d, 0x53, 0x49, 0x4d, 0x0a, 0x20, 0x20,
	0x00, 0x00, 0x00, 0xff, 0x00, 0x53, 0x49, 0x4d, 0x30, 0x30, 0x30, 0x30, 0x34, 0x31, 0x36, 0x0a, 0x20, 0x20,
	0x00, 0x00, 0x00, 0xfd, 0x00, 0x30, 0x78, 0x1e, 0x8c, 0x3c, 0x01, 0x0a, 0x20, 0x20, 0x20, 0x20, 0x20, 0x20,
	0x00, 0x9a,
};

static void test_golden(void **state)
{
	(void)state;
	const struct sim_edid_spec spec = { sim_edid_model(""), 1920, 1080, { 120, 1 }, 416, true };
	uint8_t out[SIM_EDID_MAX_BYTES];
	size_t n;

	assert_int_equal(sim_edid_make(&spec, out, &n), BB_OK);
	assert_int_equal(n, sizeof(golden));
	assert_memory_equal(out, golden, sizeof(golden));
}

/* Timings as real monitors and public mode tables give them for CVT reduced blanking. */
static void test_cvt_rb(void **state)
{
	(void)state;
	static const struct {
		int width, height, hz, v_blank, v_sync;
		int64_t clock_khz;
	} known[] = {
		{ 2560, 1440, 60, 41, 5, 241500 },  /* the Samsung S27A850 */
		{ 1920, 1200, 60, 35, 6, 154000 },
		{ 1920, 1080, 60, 31, 5, 138500 },
		{ 1920, 1080, 120, 64, 5, 285500 },
		{ 1400, 1050, 60, 30, 4, 101000 },
		{ 2560, 1600, 60, 46, 6, 268500 },
		{ 3840, 2160, 60, 62, 5, 533250 },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++) {
		const struct bb_rate rate = { (uint32_t)known[i].hz, 1 };
		struct bb_cvt t;
		assert_int_equal(bb_cvt_rb(known[i].width, known[i].height, rate, &t), BB_OK);
		assert_int_equal(t.clock_khz, known[i].clock_khz);
		assert_int_equal(t.v_blank, known[i].v_blank);
		assert_int_equal(t.v_sync, known[i].v_sync);
		assert_true(fabs(bb_cvt_rate_hz(&t) - known[i].hz) < 0.11);
	}
}

static void check_block(const uint8_t *b)
{
	unsigned int sum = 0;

	for (int i = 0; i < 128; i++)
		sum += b[i];
	assert_int_equal(sum & 0xFF, 0);
}

/* Reads the detailed timing back, independently of how it was written. */
static void check_dtd(const uint8_t *d, int width, int height, double hz)
{
	const int clock = d[0] | d[1] << 8, h = d[2] | (d[4] & 0xF0) << 4, hb = d[3] | (d[4] & 15) << 8;
	const int v = d[5] | (d[7] & 0xF0) << 4, vb = d[6] | (d[7] & 15) << 8;

	assert_int_equal(h, width);
	assert_int_equal(v, height);
	const double rate = clock * 1e4 / (h + hb) / (v + vb);
	assert_true(rate <= hz * (1 + 1e-9)); /* the clock is rounded down to 0.25 MHz */
	assert_true(rate > hz - 250e3 / (h + hb) / (v + vb) - 1e-9);
	assert_true(vb * 1e6 / rate / (v + vb) >= 460 - 1e-6); /* the blanking that CVT demands */
}

static void test_all_modes(void **state)
{
	(void)state;
	static const int hz[] = { 24, 30, 50, 60, 75, 100, 120, 144, 240 };
	int made = 0, refused = 0;

	for (int width = 64; width <= 4160; width += 64)
		for (int height = 64; height <= 4160; height += 128)
			for (size_t i = 0; i < BB_ARRAY_LEN(hz); i++) {
				const struct sim_edid_spec spec = { sim_edid_model_at((size_t)made % 4), width, height,
					                            { (uint32_t)hz[i], 1 }, (uint32_t)made, false };
				uint8_t out[SIM_EDID_MAX_BYTES];
				size_t n;
				const enum bb_status status = sim_edid_make(&spec, out, &n);
				if (status != BB_OK) {
					assert_int_equal(status, BB_ERR_RANGE);
					assert_int_equal(n, 0);
					refused++;
					continue;
				}
				made++;
				check_block(out);
				assert_int_equal(n, 128 * (1 + out[126]));
				if (n == 256)
					check_block(out + 128);
				check_dtd(out + 54, width, height, hz[i]);
			}
	print_message("%d made, %d refused\n", made, refused);
	assert_true(made > 1000 && refused > 1000);
}

static void test_refusals(void **state)
{
	(void)state;
	static const struct {
		int width, height;
		struct bb_rate rate;
	} bad[] = {
		{ 0, 1080, { 60, 1 } }, { 1920, -1, { 60, 1 } }, { 4096, 2160, { 60, 1 } }, { 1920, 1080, { 0, 1 } },
		{ 1920, 1080, { 60, 0 } },  { 1920, 1080, { 2000, 1 } }, { 3840, 2160, { 120, 1 } },
		{ 1920, 1080, { 1, 1000 } }, { INT32_MAX, INT32_MAX, { UINT32_MAX, 1 } },
	};
	struct bb_cvt t;

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		assert_int_equal(bb_cvt_rb(bad[i].width, bad[i].height, bad[i].rate, &t), BB_ERR_RANGE);
}

static void test_models(void **state)
{
	(void)state;
	assert_string_equal(sim_edid_model(NULL)->name, "generic");
	assert_string_equal(sim_edid_model("no such monitor")->name, "generic");
	assert_int_equal(sim_edid_model("S27A850D")->product, 0x083C);
	assert_int_equal(sim_edid_model("S27A850D")->width_px, 2560);
	for (size_t i = 0; sim_edid_model_at(i); i++) {
		assert_true(strlen(sim_edid_model_at(i)->shown) <= 13);
		assert_ptr_equal(sim_edid_model(sim_edid_model_at(i)->name), sim_edid_model_at(i));
	}
}

/* "EDID conformity: PASS" of a program that knows nothing of ours. */
static void check_with_edid_decode(const uint8_t *edid, size_t n, const struct sim_edid_spec *spec)
{
	char path[] = "/tmp/bb-edid-XXXXXX", command[128], line[256];
	bool pass = false;
	const int fd = mkstemp(path);

	assert_true(fd >= 0);
	assert_int_equal(write(fd, edid, n), (ssize_t)n);
	close(fd);
	snprintf(command, sizeof(command), "edid-decode --check %s 2>&1", path);
	FILE *f = popen(command, "r");
	assert_non_null(f);
	for (bool verdict = false; fgets(line, sizeof(line), f);) {
		pass |= strstr(line, "EDID conformity: PASS") != NULL;
		verdict |= !strncmp(line, "Failures:", 9);
		if (verdict)
			print_message("%s", line);
	}
	pclose(f);
	unlink(path);
	if (!pass)
		fail_msg("%s, %d x %d at %.3f Hz, serial %u", spec->model->name, spec->width_px, spec->height_px,
		         bb_rate_hz(spec->rate), spec->serial);
}

static void test_edid_decode(void **state)
{
	(void)state;
	if (system("command -v edid-decode >/dev/null 2>&1")) {
		print_message("skipped: edid-decode is not installed (package edid-decode)\n");
		skip();
	}
	/* Sizes and rates from the least a room may name to the most a descriptor holds, in every kind of EDID there is. */
	static const int sizes[][2] = { { 64, 64 },     { 640, 480 },   { 800, 600 },   { 1000, 500 },  { 1024, 768 },
		                        { 1280, 720 },  { 1280, 1024 }, { 1366, 768 },  { 1400, 1050 }, { 1600, 1200 },
		                        { 1920, 1080 }, { 1920, 1200 }, { 2560, 1080 }, { 2560, 1440 }, { 2560, 1600 },
		                        { 3440, 1440 }, { 3840, 2160 }, { 4095, 100 },  { 100, 4000 } };
	static const struct bb_rate rates[] = { { 10, 1 }, { 24, 1 }, { 50, 1 },  { 60000, 1001 }, { 60, 1 },
		                                { 96, 1 }, { 120, 1 }, { 144, 1 }, { 240, 1 },      { 1000, 1 } };
	static const uint32_t serials[] = { 0, 416, 9999999 };
	unsigned int made = 0;

	for (size_t i = 0; sim_edid_model_at(i); i++)
		for (size_t k = 0; k < BB_ARRAY_LEN(sizes) * BB_ARRAY_LEN(rates); k++) {
			const int *px = sizes[k / BB_ARRAY_LEN(rates)];
			const struct sim_edid_spec spec = { sim_edid_model_at(i), px[0], px[1], rates[k % BB_ARRAY_LEN(rates)],
				                            serials[(i + k) % 3], (i + k) % 2 };
			uint8_t out[SIM_EDID_MAX_BYTES];
			size_t n;
			if (sim_edid_make(&spec, out, &n) != BB_OK)
				continue;
			made++;
			check_with_edid_decode(out, n, &spec);
		}
	print_message("edid-decode passes all %u\n", made);
	assert_true(made > 300);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(test_golden),    cmocka_unit_test(test_cvt_rb), cmocka_unit_test(test_all_modes),
		cmocka_unit_test(test_refusals), cmocka_unit_test(test_models), cmocka_unit_test(test_edid_decode),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
