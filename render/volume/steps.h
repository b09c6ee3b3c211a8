/*
 * render/volume/steps.h: a time-varying volume that need not fit into memory: any rows of any step on demand, as f32.
 * From NIfTI-1 and raw files (one with all steps, or a sequence of files of the same shape) or from a generator. A
 * packed file
 * (.nii.gz) is unpacked into a nameless file in `scratch` first. Reading is thread-safe.
 */
#ifndef BB_RENDER_VOLUME_STEPS_H
#define BB_RENDER_VOLUME_STEPS_H

#include "render/volume/volume.h"

struct bb_steps {
	char name[64];
	uint32_t dim[3], n_steps;
	double spacing_mm[3];
	uint64_t value_bytes; /* of all steps, as they lie in the files; 0: generated */
	uint64_t fingerprint; /* of paths, sizes, dates and shape: the same input again has the same */
	struct bb_steps_file *files;
	size_t n_files;
	const struct bb_volume *memory;       /* NULL: files, or */
	const struct bb_generator *generator; /* NULL: files */
	uint32_t seed;
	bool spherical;   /* x, y, z are r, theta, phi */
	double extent[6]; /* of r, theta (from the pole) and phi: from, to; angles in radians */
};

/* Is that a part of a sphere? Angles written with a few digits may be a little too large. False for NaN. */
bool bb_steps_extent_is_sane(const double extent[6]);
/* paths: in the order of time. 10xx and 14xx; 1446: shapes differ. */
BB_MUST_CHECK enum bb_status bb_steps_open(const char *const *paths, size_t n_paths, const char *scratch,
					   struct bb_steps **out, struct bb_error *err);
/*
 * A made sequence of any size, the same on every machine: "cme"; "enlil", a spherical grid of solar wind with mass
 * ejections; "delta" and "wing", vortices that break down, over wings; "shock", a planar front that meets a perturbed
 * boundary of two gases. Seed 1. 1430, 1431.
 */
BB_MUST_CHECK enum bb_status bb_steps_generate(const char *kind, const uint32_t dim[3], uint32_t n_steps,
					       struct bb_steps **out, struct bb_error *err);
/* Of a volume in memory (borrowed), its values as they are, not as parts of their range. */
BB_MUST_CHECK enum bb_status bb_steps_of_volume(const struct bb_volume *v, struct bb_steps **out, struct bb_error *err);
/* Another seed for a made sequence, before anything is read of it. */
void bb_steps_seed(struct bb_steps *s, uint32_t seed);
/* Rows y .. y + n - 1 of plane z of a step: n * dim[0] values, NaN and infinities as they are. */
BB_MUST_CHECK enum bb_status bb_steps_rows(const struct bb_steps *s, uint32_t step, uint32_t z, uint32_t y, uint32_t n,
					   float *out, struct bb_error *err);
void bb_steps_close(struct bb_steps *s);
/*
 * All steps as f32 voxels, NAME.raw, and the header beside them that bb_steps_open takes, NAME.hdr.txt (path). Written
 * under other names and renamed, the header last. 1901, 1702; 1401: the path does not end so. progress as in the
 * builder, of planes; false stops with BB_SKIPPED and leaves nothing.
 */
BB_MUST_CHECK enum bb_status bb_steps_write(const struct bb_steps *s, const char *path, unsigned threads,
					    bool (*progress)(void *ctx, uint64_t done, uint64_t total), void *ctx,
					    struct bb_error *err);

#endif
