#include "hal/cvt.h"

#include <math.h>

/* CVT tells the aspect ratio by the width of the vertical sync. */
static int vsync_lines(int width, int height)
{
	static const struct {
		int x, y, lines;
	} known[] = { { 4, 3, 4 }, { 16, 9, 5 }, { 16, 10, 6 }, { 5, 4, 7 }, { 15, 9, 7 } };

	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++)
		if (height * known[i].x / known[i].y / 8 * 8 == width)
			return known[i].lines;
	return 10;
}

enum bb_status bb_cvt_rb(int width_px, int height_px, struct bb_rate rate, struct bb_cvt *out)
{
	const double least_vblank_us = 460, clock_step_khz = 250;
	const int least_back_lines = 6;

	if (width_px < 64 || width_px > 4095 || height_px < 64 || height_px > 4095 || !rate.num || !rate.den)
		return BB_ERR_RANGE;
	const double hz = bb_rate_hz(rate);
	if (!(hz >= 10 && hz <= 1000))
		return BB_ERR_RANGE;
	struct bb_cvt t = { .width = width_px, .height = height_px, .h_blank = 160, .h_front = 48, .h_sync = 32,
		                .v_front = 3, .v_sync = vsync_lines(width_px, height_px) };
	const double line_us = (1e6 / hz - least_vblank_us) / height_px;
	if (!(line_us > 0))
		return BB_ERR_RANGE;
	const int least_lines = t.v_front + t.v_sync + least_back_lines;
	t.v_blank = (int)fmin(floor(least_vblank_us / line_us) + 1, 4095);
	if (t.v_blank < least_lines)
		t.v_blank = least_lines;
	const double khz = hz * (t.height + t.v_blank) * (t.width + t.h_blank) / 1e3;
	t.clock_khz = (int64_t)(floor(khz / clock_step_khz) * clock_step_khz);
	if (t.clock_khz < 10000 || t.clock_khz > 655350 || t.v_blank >= 4095)
		return BB_ERR_RANGE;
	*out = t;
	return BB_OK;
}

double bb_cvt_line_hz(const struct bb_cvt *t)
{
	return (double)t->clock_khz * 1e3 / (t->width + t->h_blank);
}

double bb_cvt_rate_hz(const struct bb_cvt *t)
{
	return bb_cvt_line_hz(t) / (t->height + t->v_blank);
}
