/* tests/test_transfer.c: looking up, the range question and step correction of transfer functions. */
#include "render/transfer.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

static enum bb_status load_text(const char *text, struct bb_transfer *tf, struct bb_error *err)
{
	char path[] = "/tmp/bb-tf-XXXXXX";
	const int fd = mkstemp(path);

	assert_true(fd >= 0);
	assert_int_equal(write(fd, text, strlen(text)), strlen(text));
	close(fd);
	*err = (struct bb_error){ 0 };
	const enum bb_status status = bb_transfer_load(path, tf, err);
	unlink(path);
	return status;
}

static struct bb_transfer loaded(const char *text)
{
	struct bb_transfer tf;
	struct bb_error err;

	assert_int_equal(load_text(text, &tf, &err), BB_OK);
	return tf;
}

static void interpolates_and_clamps(void **state)
{
	(void)state;
	const struct bb_transfer tf = loaded("# comment\r\n0.25 1 0 0 0.5 # trailing\n\n0.75\t0 1 .5 1e-1\n");
	double c[4];

	assert_int_equal(tf.n, 2);
	bb_transfer_at(&tf, 0.5, c);
	assert_true(fabs(c[0] - 0.5) <= 1e-15);
	assert_true(fabs(c[1] - 0.5) <= 1e-15);
	assert_true(fabs(c[2] - 0.25) <= 1e-15);
	assert_true(fabs(c[3] - 0.3) <= 1e-15);
	bb_transfer_at(&tf, -3, c);
	assert_true(c[3] == 0.5);
	bb_transfer_at(&tf, HUGE_VAL, c);
	assert_true(c[3] == 0.1);
	bb_transfer_at(&tf, (double)NAN, c);
	assert_true(c[3] == 0.5);
	bb_transfer_at(&tf, 0.75, c);
	assert_true(c[1] == 1 && c[3] == 0.1);
}

static void knows_what_is_visible(void **state)
{
	(void)state;
	assert_true(loaded("0 0 0 0 0\n.3 0 0 0 0\n.6 1 1 1 .2\n1 0 0 0 0\n").least_visible == 0.3);
	assert_true(loaded(".4 0 0 0 .1\n1 0 0 0 0\n").least_visible == 0);
	assert_true(loaded("0 0 0 0 0\n1 1 1 1 0\n").least_visible > 1);
	assert_true(loaded("0 0 0 0 0\n.9 0 0 0 0\n1 1 1 1 1\n").least_visible == 0.9);
}

/* Against brute force: no sample within the range may exceed the answer, and some sample must come near it. */
static void range_maximum_is_exact(void **state)
{
	(void)state;
	const struct bb_transfer tf = loaded("0 0 0 0 0\n.1 0 0 0 0\n.2 0 0 0 .7\n.3 0 0 0 0\n.6 0 0 0 0\n.61 0 0 0 1\n"
	                                     ".62 0 0 0 0\n1 0 0 0 .3\n");
	uint32_t seed = 1;

	assert_true(bb_transfer_most_opacity(&tf, 0, 0.1) == 0);
	assert_true(bb_transfer_most_opacity(&tf, 0.3, 0.6) == 0);
	assert_true(bb_transfer_most_opacity(&tf, 0.3, nextafter(0.6, 1)) > 0);
	assert_true(bb_transfer_most_opacity(&tf, 0.15, 0.25) == 0.7);
	assert_true(bb_transfer_most_opacity(&tf, 0.9, 0.15) == 1); /* the wrong way round */
	assert_true(bb_transfer_most_opacity(&tf, (double)NAN, (double)NAN) == 0);
	for (int i = 0; i < 2000; i++) {
		double v[2], c[4], seen = 0;
		for (int k = 0; k < 2; k++)
			v[k] = (double)(seed = seed * 1664525u + 1013904223u) / 4294967296.0;
		const double lo = fmin(v[0], v[1]), hi = fmax(v[0], v[1]);
		const double most = bb_transfer_most_opacity(&tf, lo, hi);
		for (int k = 0; k <= 400; k++) {
			bb_transfer_at(&tf, lo + (hi - lo) * k / 400, c);
			assert_true(c[3] <= most);
			seen = fmax(seen, c[3]);
		}
		assert_true(most - seen <= 100 * (hi - lo) / 400 + 1e-12); /* steepest slope is 100 */
	}
}

static void step_correction_is_exact_at_the_ends(void **state)
{
	(void)state;
	assert_true(bb_transfer_opacity_for_step(0, 0.5) == 0 && !signbit(bb_transfer_opacity_for_step(0, 0.5)));
	assert_true(bb_transfer_opacity_for_step(1, 0.01) == 1);
	assert_true(bb_transfer_opacity_for_step(1, 0) == 0);
	assert_true(bb_transfer_opacity_for_step((double)NAN, 1) == 0);
	assert_true(bb_transfer_opacity_for_step(0.5, (double)NAN) == 0);
	assert_true(fabs(bb_transfer_opacity_for_step(0.75, 0.5) - 0.5) <= 1e-15);
	/* Tiny opacities keep their digits: 1 - pow(1 - a, r) would give 0 here. */
	assert_true(fabs(bb_transfer_opacity_for_step(1e-18, 0.5) / 5e-19 - 1) <= 1e-12);
	for (int i = 1; i < 1000; i++) { /* two half steps let through what one whole step does */
		const double a = i / 1000.0, half = bb_transfer_opacity_for_step(a, 0.5);
		assert_true(fabs(1 - (1 - half) * (1 - half) - a) <= 1e-14);
	}
}

static void refuses_bad_lines_with_number_and_line(void **state)
{
	(void)state;
	static const struct {
		const char *text;
		int number;
		const char *line;
	} bad[] = {
		{ "0 0 0 0 0\n0.5 1 1 1\n", 1301, ":2:" },
		{ "0 0 0 0 0\n0.5 1 1 1 1 1\n", 1301, ":2:" },
		{ "0 0 0 0 0\n# x\n\nnan 0 0 0 0\n", 1302, ":4:" },
		{ "0 0 0 0 inf\n", 1302, ":1:" },
		{ "0 0 0 0 1e999\n", 1302, ":1:" },
		{ "0x0 0 0 0 0\n", 1302, ":1:" },
		{ "0 0 0 0 0\n1 2 0 0 0\n", 1303, ":2:" },
		{ "-0.1 0 0 0 0\n", 1303, ":1:" },
		{ "0.5 0 0 0 0\n0.5 1 1 1 1\n", 1304, ":2:" },
		{ "0.5 0 0 0 0\n0.25 1 1 1 1\n", 1304, ":2:" },
		{ "", 1305, "" },
		{ "0 0 0 0 0", 1305, "" },
		{ "0 0 0 0 0\n\x01", 1307, "" },
	};
	struct bb_transfer tf;
	struct bb_error err;

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		assert_true(load_text(bad[i].text, &tf, &err) < 0);
		assert_int_equal(err.number, bad[i].number);
		assert_non_null(strstr(err.text, bad[i].line));
	}
	err = (struct bb_error){ 0 };
	assert_int_equal(bb_transfer_load("/nowhere/x.tf", &tf, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1001);
	assert_true(bb_transfer_load("/tmp", &tf, NULL) < 0);
}

static void takes_1024_points_and_not_one_more(void **state)
{
	(void)state;
	static char text[1025 * 32];
	struct bb_transfer tf;
	struct bb_error err;

	for (int n = 1024; n <= 1025; n++) {
		size_t at = 0;
		for (int i = 0; i < n; i++)
			at += (size_t)snprintf(text + at, sizeof(text) - at, "%.6f 0 0 0 0\n", i / 1025.0);
		assert_int_equal(load_text(text, &tf, &err), n == 1024 ? BB_OK : BB_ERR_FORMAT);
		assert_int_equal(err.number, n == 1024 ? 0 : 1306);
	}
}

static void shipped_functions_load(void **state)
{
	(void)state;
	static const char *const files[] = { "scenes/mri.tf", "scenes/cme.tf" };
	struct bb_transfer tf;

	for (size_t i = 0; i < BB_ARRAY_LEN(files); i++) {
		assert_int_equal(bb_transfer_load(files[i], &tf, NULL), BB_OK);
		assert_true(tf.least_visible > 0 && tf.least_visible < 0.5); /* empty space is skipped */
		for (size_t k = 1; k < tf.n; k++) /* smooth: no opacity cliff */
			assert_true(fabs(tf.point[k].opacity - tf.point[k - 1].opacity) < 0.05);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(interpolates_and_clamps),
		cmocka_unit_test(knows_what_is_visible),
		cmocka_unit_test(range_maximum_is_exact),
		cmocka_unit_test(step_correction_is_exact_at_the_ends),
		cmocka_unit_test(refuses_bad_lines_with_number_and_line),
		cmocka_unit_test(takes_1024_points_and_not_one_more),
		cmocka_unit_test(shipped_functions_load),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
