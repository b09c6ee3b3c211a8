/*
 * hal/cvt.h: what mode a display runs when it is asked for a size and a rate: VESA CVT 1.2 with reduced blanking, the
 * pixel clock rounded down to 0.25 MHz, so that "120 Hz" becomes 119.982 or 119.909.
 */
#ifndef BB_HAL_CVT_H
#define BB_HAL_CVT_H

#include "hal/rate.h"
#include "hal/status.h"

struct bb_cvt {
	int width, height;     /* active, px */
	int h_blank, h_front, h_sync, v_blank, v_front, v_sync;
	int64_t clock_khz;
};
/* BB_ERR_RANGE when the mode does not fit an 18-byte descriptor of an EDID (4095 x 4095 px, 655.35 MHz). */
BB_MUST_CHECK enum bb_status bb_cvt_rb(int width_px, int height_px, struct bb_rate rate, struct bb_cvt *out);
double bb_cvt_rate_hz(const struct bb_cvt *t);
double bb_cvt_line_hz(const struct bb_cvt *t);

#endif
