/* tests/test_perceived.c: L*a*b* and L*u*v* against published values of the sRGB primaries, and what must hold anyway.
 */
#include "render/bricks/perceived.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>

#include <cmocka.h>

/* Widely published for the primaries (D65), to two places. */
static void known_colours(void **state)
{
	static const struct {
		double rgb[3], lab[3], luv[3];
	} rows[] = {
		{ { 0, 0, 0 }, { 0, 0, 0 }, { 0, 0, 0 } },
		{ { 1, 1, 1 }, { 100, 0, 0 }, { 100, 0, 0 } },
		{ { 1, 0, 0 }, { 53.24, 80.09, 67.20 }, { 53.24, 175.01, 37.76 } },
		{ { 0, 1, 0 }, { 87.73, -86.18, 83.18 }, { 87.73, -83.08, 107.39 } },
		{ { 0, 0, 1 }, { 32.30, 79.19, -107.86 }, { 32.30, -9.40, -130.34 } },
		{ { 0.5, 0.5, 0.5 }, { 53.39, 0, 0 }, { 53.39, 0, 0 } },
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		double lab[3], luv[3];
		bb_perceived_lab(rows[i].rgb, lab);
		bb_perceived_luv(rows[i].rgb, luv);
		for (int k = 0; k < 3; k++)
			if (fabs(lab[k] - rows[i].lab[k]) > 0.02 || fabs(luv[k] - rows[i].luv[k]) > 0.02)
				fail_msg("row %zu: lab %.3f %.3f %.3f, luv %.3f %.3f %.3f", i, lab[0], lab[1], lab[2],
					 luv[0], luv[1], luv[2]);
	}
}

static void greys_have_no_hue_and_nothing_is_nan(void **state)
{
	const double odd[][3] = { { -1, 2, 0.5 }, { (double)NAN, 0, 0 }, { (double)INFINITY, 1, 1 }, { 1e-9, 0, 0 } };
	double before = -1, out[3];
	(void)state;

	for (double g = 0; g <= 1; g += 1.0 / 64) {
		bb_perceived_lab((const double[]){ g, g, g }, out);
		assert_true(out[0] > before && fabs(out[1]) < 1e-4 && fabs(out[2]) < 1e-4);
		before = out[0];
		bb_perceived_luv((const double[]){ g, g, g }, out);
		assert_true(fabs(out[1]) < 1e-4 && fabs(out[2]) < 1e-4);
	}
	for (size_t i = 0; i < BB_ARRAY_LEN(odd); i++) {
		bb_perceived_lab(odd[i], out);
		assert_true(isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]));
		bb_perceived_luv(odd[i], out);
		assert_true(isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]));
	}
	assert_true(fabs(bb_perceived_distance((const double[]){ 1, 2, 3 }, (const double[]){ 4, 6, 3 }) - 5) < 1e-12);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(known_colours),
		cmocka_unit_test(greys_have_no_hue_and_nothing_is_nan),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
