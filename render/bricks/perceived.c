#include "render/bricks/perceived.h"

#include <math.h>

#include "render/image_metrics.h"

/* Of the sRGB primaries; the rows' sums are the white point. */
static const double to_xyz[3][3] = {
	{ 0.4124564, 0.3575761, 0.1804375 },
	{ 0.2126729, 0.7151522, 0.0721750 },
	{ 0.0193339, 0.1191920, 0.9503041 },
};
static const double white[3] = { 0.4124564 + 0.3575761 + 0.1804375, 1.0000001, 0.0193339 + 0.1191920 + 0.9503041 };

static double linear(double v)
{
	return bb_srgb_to_linear(v > 0 ? (v < 1 ? v : 1) : 0);
}

static void xyz_of(const double rgb[3], double xyz[3])
{
	const double c[3] = { linear(rgb[0]), linear(rgb[1]), linear(rgb[2]) };

	for (int k = 0; k < 3; k++)
		xyz[k] = to_xyz[k][0] * c[0] + to_xyz[k][1] * c[1] + to_xyz[k][2] * c[2];
}

/* CIE 15:2004, with its exact constants: 216/24389 and 24389/27. */
static double lab_part(double share)
{
	return share > 216.0 / 24389 ? cbrt(share) : (24389.0 / 27 * share + 16) / 116;
}

void bb_perceived_lab(const double rgb[3], double lab[3])
{
	double xyz[3], f[3];

	xyz_of(rgb, xyz);
	for (int k = 0; k < 3; k++)
		f[k] = lab_part(xyz[k] / white[k]);
	lab[0] = 116 * f[1] - 16;
	lab[1] = 500 * (f[0] - f[1]);
	lab[2] = 200 * (f[1] - f[2]);
}

void bb_perceived_luv(const double rgb[3], double luv[3])
{
	double xyz[3];

	xyz_of(rgb, xyz);
	const double sum = xyz[0] + 15 * xyz[1] + 3 * xyz[2], of_white = white[0] + 15 * white[1] + 3 * white[2];
	luv[0] = 116 * lab_part(xyz[1] / white[1]) - 16;
	luv[1] = luv[2] = 0;
	if (!(sum > 0)) /* black has no hue */
		return;
	luv[1] = 13 * luv[0] * (4 * xyz[0] / sum - 4 * white[0] / of_white);
	luv[2] = 13 * luv[0] * (9 * xyz[1] / sum - 9 * white[1] / of_white);
}

double bb_perceived_distance(const double a[3], const double b[3])
{
	const double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];

	return sqrt(x * x + y * y + z * z);
}
