/*
 * render/image_metrics.h: how different two pictures look, beside the PSNR of image.h and over the same pixels (those
 * the reference covers: its alpha exceeds 1/255).
 *
 * SSIM: Wang, Bovik, Sheikh and Simoncelli 2004: a Gaussian window of 11 x 11 pixels, deviation 1.5; C1 = (0.01 L)^2,
 * C2 = (0.03 L)^2; of luma (0.299 R + 0.587 G + 0.114 B, as their program has it), L = 255; the mean over windows whose
 * middle is a covered pixel. Moments are centred: means first, then squares of what is left, so nothing cancels. At the
 * picture's edge a window is cut and its weights made to sum to one (they leave those windows out).
 * L*u*v*: CIE 1976, from sRGB (IEC 61966-2-1) under D65; the distance is Euclidean, 1 is about what can be seen.
 * Pure functions of their arguments.
 */
#ifndef BB_RENDER_IMAGE_METRICS_H
#define BB_RENDER_IMAGE_METRICS_H

#include "render/image.h"

struct bb_image_quality {
	double ssim; /* exactly 1 when the covered pixels and those around them are equal */
	double luv_mean, luv_most;
	uint64_t n_pixels; /* covered; 0: ssim 1, distances 0 */
};

/* BB_ERR_RANGE: sizes differ; BB_ERR_NOMEM. */
BB_MUST_CHECK enum bb_status bb_image_quality(const struct bb_image *a, const struct bb_image *reference,
					      struct bb_image_quality *out);

/*
 * The mean SSIM of two planes of width x height values whose range is L > 0, over the windows whose middle has
 * covered[i] != 0 (NULL: all); 1 when there is none. BB_ERR_RANGE: a value is not finite, or L is not above 0.
 */
BB_MUST_CHECK enum bb_status bb_ssim(const float *a, const float *b, uint32_t width, uint32_t height, double range,
				     const uint8_t *covered, double *out);

/* Linear light, 0..1, of a channel of sRGB, 0..1. */
double bb_srgb_to_linear(double encoded);
/* L*, u*, v* of 8-bit sRGB. */
void bb_srgb_to_luv(const uint8_t rgb[3], double luv[3]);

#endif
