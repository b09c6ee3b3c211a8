/*
 * render/image.h: 8-bit RGBA pictures, PNG files, and how two pictures are compared.
 * Rows run from the top; colour is premultiplied over black, alpha is the volume's own opacity.
 */
#ifndef BB_RENDER_IMAGE_H
#define BB_RENDER_IMAGE_H

#include "hal/status.h"

struct bb_image {
	uint32_t width, height;
	uint8_t *rgba; /* width * height * 4 bytes, owned */
};

BB_MUST_CHECK enum bb_status bb_image_create(uint32_t width, uint32_t height, struct bb_image *out);
void bb_image_release(struct bb_image *img);
/* Written to a temporary name and renamed: old or new, never a part. RGB only, alpha dropped. */
BB_MUST_CHECK enum bb_status bb_image_write_png(const struct bb_image *img, const char *path, struct bb_error *err);

/* A PNG of any kind as 8-bit RGB in rgba with alpha 255; refused above that many pixels. 1641: cannot be read. */
BB_MUST_CHECK enum bb_status bb_image_read_png(const char *path, size_t most_pixels, struct bb_image *out,
                                               struct bb_error *err);

struct bb_image_difference {
	double psnr_db;         /* 8-bit RGB over the pixels where b's (the reference's) alpha exceeds 1/255, peak 255; 200 when equal */
	bool identical;         /* on those pixels */
	uint64_t n_pixels;      /* compared */
	uint64_t n_differ;      /* of all pixels, any channel of RGB */
	unsigned most;          /* largest difference of a channel, all pixels */
};
/* Sizes must match (BB_ERR_RANGE). */
BB_MUST_CHECK enum bb_status bb_image_compare(const struct bb_image *a, const struct bb_image *reference,
                                              struct bb_image_difference *out);

#endif
