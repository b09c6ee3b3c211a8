/*
 * bench/volume/look.h: what a choice of bricks looks like, without a renderer: the volume as the chosen bricks have it,
 * at the data's own resolution, and a picture of it along its shortest axis, one sample a voxel. Slow, simple, the same
 * on every machine: for judging selectors, not for people to look at.
 */
#ifndef BB_BENCH_VOLUME_LOOK_H
#define BB_BENCH_VOLUME_LOOK_H

#include "render/bricks/bricks.h"
#include "render/bricks/choose.h"
#include "render/transfer.h"

struct bb_look { /* a file's stage; the voxels are parts of the data's range, x fastest */
	const struct bb_bricks *b;
	int axis; /* along which is looked */
	uint32_t width, height;
	float *voxels;
	uint8_t *stored; /* a brick's, while it is read */
	float *values;
};

/* rgb over black, premultiplied, and opacity; [width * height][4], the caller's. */
size_t bb_look_pixels(const struct bb_look *l);

BB_MUST_CHECK enum bb_status bb_look_begin(struct bb_look *l, const struct bb_bricks *b, struct bb_error *err);
void bb_look_end(struct bb_look *l);
/* A flat choice is its mean; one above the data's level is interpolated linearly between its voxels. */
BB_MUST_CHECK enum bb_status bb_look_fill(struct bb_look *l, const struct bb_choice *c, size_t n, struct bb_error *err);
void bb_look_cast(const struct bb_look *l, const struct bb_transfer *tf, float (*picture)[4]);

struct bb_look_difference { /* over the pixels where the reference's opacity exceeds 1/255 */
	double luv;         /* mean distance in CIE L*u*v* */
	double psnr_db;     /* 8-bit RGB, peak 255; 200 when equal */
	size_t n_pixels;
};
struct bb_look_difference bb_look_compare(const float (*picture)[4], const float (*reference)[4], size_t n);

#endif
