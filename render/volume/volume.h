/*
 * render/volume/volume.h: a time-varying volume in memory: u16 voxels normalised over the data's finite range, x
 * fastest, then y, z, step. value = least + u16 / 65535 * (most - least). Non-finite voxels become `least` and are
 * counted. Import: NIfTI-1 (.nii, .nii.gz; 3-D and 4-D; u8, i16, i32, f32, f64; slope and intercept; either byte
 * order), raw + header text, and generated ones. Sizes in a header are checked against the file and the cap before
 * anything is allocated.
 */
#ifndef BB_RENDER_VOLUME_VOLUME_H
#define BB_RENDER_VOLUME_VOLUME_H

#include "hal/status.h"

struct bb_volume {
	char name[64];
	uint32_t dim[3], n_steps;
	double spacing_mm[3];
	double least, most;
	uint64_t n_nonfinite;
	uint16_t *voxels; /* owned; or NULL and */
	float *values;    /* owned, 0..1: as exact as single precision is */
	bool around;      /* the last axis has no ends: its last voxel's neighbour is its first */
};

#define BB_VOLUME_CAP_BYTES (UINT64_C(2) << 30)

/* By extension: .nii, .nii.gz, .hdr.txt (our raw header). cap_bytes bounds all memory taken. 14xx errors. */
BB_MUST_CHECK enum bb_status bb_volume_load(const char *path, uint64_t cap_bytes, struct bb_volume **out,
                                            struct bb_error *err);
/* "cme": shells that leave a bright core, edge^3 voxels, n steps. The same bytes on every machine. */
BB_MUST_CHECK enum bb_status bb_volume_generate(const char *kind, uint32_t edge, uint32_t n_steps,
                                                struct bb_volume **out, struct bb_error *err);
void bb_volume_free(struct bb_volume *v);
/* Voxel clamped to the edges (around: taken from the other end), 0..1. */
double bb_volume_voxel(const struct bb_volume *v, int64_t x, int64_t y, int64_t z, uint32_t step);
/* Trilinear in voxel coordinates (voxel centres at integers), linear between steps, normalised 0..1, double. */
double bb_volume_sample(const struct bb_volume *v, const double p[3], double step);

#endif
