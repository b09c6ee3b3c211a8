/*
 * render/volume/volume_private.h: what the importers share: a source of bytes (plain or gzip), the checks of a header's
 * claims, and the two passes that turn typed samples into normalised u16 voxels. One thread; sizes in bytes.
 */
#ifndef BB_RENDER_VOLUME_PRIVATE_H
#define BB_RENDER_VOLUME_PRIVATE_H

#include "render/volume/volume.h"

/* bytes.c: a regular file, read from the front, as often as wanted. */
struct bb_bytes {
	struct bb_where where;
	int fd;            /* -1 once gz owns it */
	void *gz;          /* gzFile, NULL for a plain file */
	uint64_t file_bytes;
};
enum bb_bytes_mode {
	BB_BYTES_MAY_BE_GZIP = 1,
	BB_BYTES_NO_LINK = 2 /* the name came out of a file: do not follow a link elsewhere */
};
BB_MUST_CHECK enum bb_status bb_bytes_open(const char *path, unsigned mode, struct bb_bytes *out, struct bb_error *err);
void bb_bytes_close(struct bb_bytes *b);
BB_MUST_CHECK enum bb_status bb_bytes_rewind(struct bb_bytes *b, struct bb_error *err);
/* Up to n bytes; fewer only at the end of the file. A damaged gzip stream is 1408. */
BB_MUST_CHECK enum bb_status bb_bytes_read(struct bb_bytes *b, void *buf, size_t n, size_t *n_out,
                                           struct bb_error *err);
/* Could the file hold that many bytes at all? 1406 when it cannot, 1410 when only a bomb could. Allocates nothing. */
BB_MUST_CHECK enum bb_status bb_bytes_could_hold(const struct bb_bytes *b, uint64_t n, struct bb_error *err);

/* decode.c */
enum bb_voxel_type {
	BB_VOXEL_U8, BB_VOXEL_I8, BB_VOXEL_I16, BB_VOXEL_U16, BB_VOXEL_I32, BB_VOXEL_F32, BB_VOXEL_F64, BB_VOXEL_TYPES
};
size_t bb_voxel_bytes(enum bb_voxel_type type);

struct bb_layout { /* how the voxels lie in the file; filled by a header parser, believed by nobody */
	int64_t dim[3], n_steps;
	double spacing_mm[3];
	enum bb_voxel_type type;
	bool big_endian;
	double slope, intercept;
	uint64_t offset_bytes;
	bool spherical;   /* raw headers can say so */
	double extent[6]; /* as in bb_steps */
};
/* n samples of the file at raw (overwritten when their bytes are the other way round) as values, scaled. */
void bb_voxels_convert(const struct bb_layout *l, uint8_t *raw, size_t n, double *value);
/* How many samples there are, when the file could hold them and the layout is one at all. 1404, 1406, 1410. */
BB_MUST_CHECK enum bb_status bb_voxels_count(const struct bb_bytes *bytes, const struct bb_layout *l, uint64_t *n_out,
                                             struct bb_error *err);
/* Checks the layout against the file and the cap, then reads it in two passes: range, then voxels. */
BB_MUST_CHECK enum bb_status bb_volume_decode(struct bb_bytes *bytes, const struct bb_layout *layout,
                                              uint64_t cap_bytes, struct bb_volume **out, struct bb_error *err);

/* volume.c: zeroed voxels, checked dimensions and size. 1404, 1405, 1702. */
BB_MUST_CHECK enum bb_status bb_volume_create(const int64_t dim[3], int64_t n_steps, uint64_t cap_bytes,
                                              const struct bb_where *where, struct bb_volume **out,
                                              struct bb_error *err);

/* nifti.c, raw.c: the header only; voxels is the path of the file that has them. */
BB_MUST_CHECK enum bb_status bb_nifti_layout(struct bb_bytes *bytes, struct bb_layout *out, struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_raw_layout(const char *path, struct bb_layout *out, char voxels[BB_PATH_MAX_BYTES],
                                           struct bb_error *err);
/* What is made instead of read: a pure function of these and of where a voxel is. */
struct bb_generated {
	uint32_t dim[3], n_steps, seed;
};
/* Of a step: 0 .. 1 through the sequence. */
static inline double bb_generated_phase(const struct bb_generated *g, uint32_t step)
{
	return g->n_steps > 1 ? (double)step / ((double)g->n_steps - 1) : 0;
}
/* cme.c (in 0 .. 1), enlil.c, vortices.c, shock.c: n values of one row from x on. */
typedef void bb_generated_row(const struct bb_generated *g, uint32_t step, uint32_t z, uint32_t y, uint32_t x, uint32_t n,
			      double *out);
bb_generated_row bb_cme_row, bb_enlil_row, bb_delta_row, bb_wing_row, bb_shock_row;
extern const double bb_enlil_extent[6]; /* r, theta, phi: from, to */
BB_MUST_CHECK enum bb_status bb_volume_load_nifti(const char *path, uint64_t cap_bytes, struct bb_volume **out,
                                                  struct bb_error *err);
BB_MUST_CHECK enum bb_status bb_volume_load_raw(const char *path, uint64_t cap_bytes, struct bb_volume **out,
                                                struct bb_error *err);
void bb_volume_fill_cme(struct bb_volume *v);

#endif
