/*
 * render/volume/nifti.c: the NIfTI-1 header (nifti1.h of the NIfTI data format working group): 348 bytes at fixed
 * offsets, in the byte order in which sizeof_hdr reads 348. Single files only (magic "n+1"); extensions lie between the
 * header and vox_offset and are skipped with it.
 */
#include "render/volume/volume_private.h"

#include <math.h>
#include <string.h>

#define HEADER_BYTES 348
#define OFFSET_LEAST 352             /* the header and its four extension bytes */
#define OFFSET_MOST (1 << 26)        /* 64 MiB of extensions */

enum { AT_SIZEOF_HDR = 0, AT_DIM = 40, AT_DATATYPE = 70, AT_BITPIX = 72, AT_PIXDIM = 76, AT_VOX_OFFSET = 108,
       AT_SCL_SLOPE = 112, AT_SCL_INTER = 116, AT_XYZT_UNITS = 123, AT_MAGIC = 344 };

struct header {
	const uint8_t *bytes;
	bool big_endian;
	const struct bb_where *where;
};

static int16_t get_i16(const struct header *h, size_t at)
{
	const uint8_t *p = h->bytes + at;

	return (int16_t)(h->big_endian ? p[0] << 8 | p[1] : p[1] << 8 | p[0]);
}

static uint32_t get_u32(const uint8_t *p, bool big_endian)
{
	return big_endian ? (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3]
	                  : (uint32_t)p[3] << 24 | (uint32_t)p[2] << 16 | (uint32_t)p[1] << 8 | p[0];
}

static double get_f32(const struct header *h, size_t at)
{
	const uint32_t bits = get_u32(h->bytes + at, h->big_endian);
	float f;

	memcpy(&f, &bits, sizeof(f));
	return (double)f;
}

static enum bb_status check_kind(struct header *h, struct bb_error *err)
{
	const uint32_t little = get_u32(h->bytes, false), big = get_u32(h->bytes, true);

	if (little == 540 || big == 540)
		return bb_fail(err, BB_ERR_FORMAT, 1402, h->where, "this is NIfTI-2");
	if (little != HEADER_BYTES && big != HEADER_BYTES)
		return bb_fail(err, BB_ERR_FORMAT, 1402, h->where, "sizeof_hdr is %u, not 348", little);
	h->big_endian = big == HEADER_BYTES;
	if (!memcmp(h->bytes + AT_MAGIC, "ni1", 4))
		return bb_fail(err, BB_ERR_FORMAT, 1402, h->where, "this is the header of a pair (.hdr and .img)");
	if (memcmp(h->bytes + AT_MAGIC, "n+1", 4))
		return bb_fail(err, BB_ERR_FORMAT, 1402, h->where, "no magic n+1 at byte 344");
	return BB_OK;
}

static enum bb_status read_type(const struct header *h, struct bb_layout *l, struct bb_error *err)
{
	static const struct {
		int16_t code;
		enum bb_voxel_type type;
	} types[] = { { 2, BB_VOXEL_U8 },  { 4, BB_VOXEL_I16 },  { 8, BB_VOXEL_I32 },  { 16, BB_VOXEL_F32 },
		      { 64, BB_VOXEL_F64 }, { 256, BB_VOXEL_I8 }, { 512, BB_VOXEL_U16 } };
	const int code = get_i16(h, AT_DATATYPE), bits = get_i16(h, AT_BITPIX);

	for (size_t i = 0; i < BB_ARRAY_LEN(types); i++) {
		if (types[i].code != code)
			continue;
		l->type = types[i].type;
		if (bits != (int)bb_voxel_bytes(l->type) * 8)
			return bb_fail(err, BB_ERR_FORMAT, 1403, h->where, "datatype %d with %d bits a voxel", code,
			               bits);
		return BB_OK;
	}
	return bb_fail(err, BB_ERR_FORMAT, 1403, h->where, "datatype %d", code);
}

static enum bb_status read_dims(const struct header *h, struct bb_layout *l, struct bb_error *err)
{
	const int n = get_i16(h, AT_DIM);

	if (n < 3 || n > 7)
		return bb_fail(err, BB_ERR_FORMAT, 1404, h->where, "%d dimensions, 3 or 4 can be shown", n);
	for (int i = 0; i < 3; i++)
		l->dim[i] = get_i16(h, AT_DIM + 2 + 2 * (size_t)i);
	l->n_steps = n > 3 ? get_i16(h, AT_DIM + 8) : 1;
	for (int i = 5; i <= n; i++)
		if (get_i16(h, AT_DIM + 2 * (size_t)i) != 1)
			return bb_fail(err, BB_ERR_FORMAT, 1404, h->where, "dimension %d has %d entries", i,
			               get_i16(h, AT_DIM + 2 * (size_t)i));
	return BB_OK;
}

static enum bb_status read_spacing(const struct header *h, struct bb_layout *l, struct bb_error *err)
{
	const int unit = h->bytes[AT_XYZT_UNITS] & 7; /* 1 m, 2 mm, 3 um, else unknown: mm by custom */
	const double mm = unit == 1 ? 1e3 : unit == 3 ? 1e-3 : 1;

	for (int i = 0; i < 3; i++) {
		const double pixdim = fabs(get_f32(h, AT_PIXDIM + 4 + 4 * (size_t)i));
		l->spacing_mm[i] = pixdim == 0 ? 1 : pixdim * mm; /* zero: not set */
		if (!(l->spacing_mm[i] >= 1e-6 && l->spacing_mm[i] <= 1e6))
			return bb_fail(err, BB_ERR_FORMAT, 1412, h->where, "pixdim[%d] is %g mm", i + 1,
			               l->spacing_mm[i]);
	}
	return BB_OK;
}

static enum bb_status read_scale_and_offset(const struct header *h, struct bb_layout *l, struct bb_error *err)
{
	const double offset = get_f32(h, AT_VOX_OFFSET);

	l->slope = get_f32(h, AT_SCL_SLOPE);
	l->intercept = get_f32(h, AT_SCL_INTER);
	if (!isfinite(l->slope) || !isfinite(l->intercept))
		return bb_fail(err, BB_ERR_FORMAT, 1409, h->where, "slope %g, intercept %g", l->slope, l->intercept);
	if (l->slope == 0) { /* by the standard: not scaled at all */
		l->slope = 1;
		l->intercept = 0;
	}
	/* Compared as a double: casting NaN, a negative or 1e30 is undefined. */
	if (!(offset >= OFFSET_LEAST && offset <= OFFSET_MOST) || offset != floor(offset))
		return bb_fail(err, BB_ERR_FORMAT, 1407, h->where, "vox_offset is %g", offset);
	l->offset_bytes = (uint64_t)offset;
	return BB_OK;
}

enum bb_status bb_nifti_layout(struct bb_bytes *bytes, struct bb_layout *l, struct bb_error *err)
{
	uint8_t buf[HEADER_BYTES];
	struct header h = { buf, false, &bytes->where };
	size_t got;
	enum bb_status status = bb_bytes_read(bytes, buf, sizeof(buf), &got, err);

	*l = (struct bb_layout){ 0 };
	if (status)
		return status;
	if (got < sizeof(buf))
		return bb_fail(err, BB_ERR_FORMAT, 1402, h.where, "%zu bytes are too few for a header", got);
	status = check_kind(&h, err);
	if (!status)
		status = read_type(&h, l, err);
	if (!status)
		status = read_dims(&h, l, err);
	if (!status)
		status = read_spacing(&h, l, err);
	if (!status)
		status = read_scale_and_offset(&h, l, err);
	l->big_endian = h.big_endian;
	return status;
}

enum bb_status bb_volume_load_nifti(const char *path, uint64_t cap_bytes, struct bb_volume **out, struct bb_error *err)
{
	struct bb_bytes bytes;
	struct bb_layout layout;
	/* By content, not by name: a .nii that was packed without renaming is common. */
	enum bb_status status = bb_bytes_open(path, BB_BYTES_MAY_BE_GZIP, &bytes, err);

	if (status)
		return status;
	status = bb_nifti_layout(&bytes, &layout, err);
	if (!status)
		status = bb_volume_decode(&bytes, &layout, cap_bytes, out, err);
	bb_bytes_close(&bytes);
	return status;
}
