/*
 * render/volume/decode.c: typed samples to normalised u16 in two passes over the file: the first finds the range and
 * proves that the bytes are there, only then is memory taken, and the second fills it. One slab of samples is held.
 */
#include "render/volume/volume_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SLAB_SAMPLES 8192u
#define TRAILING_MOST_BYTES (UINT64_C(1) << 20) /* padding after the voxels; more means the header is wrong */

struct slab {
	uint8_t raw[SLAB_SAMPLES * 8];
	double value[SLAB_SAMPLES];
};

struct range {
	double least, most;
	uint64_t n_finite;
};

size_t bb_voxel_bytes(enum bb_voxel_type type)
{
	static const uint8_t bytes[BB_VOXEL_TYPES] = { 1, 1, 2, 2, 4, 4, 8 };

	return bytes[type];
}

static bool host_is_big_endian(void)
{
	return __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;
}

static void swap_samples(uint8_t *raw, size_t n, size_t bytes)
{
	for (size_t i = 0; i < n; i++, raw += bytes)
		for (size_t k = 0; k < bytes / 2; k++) {
			const uint8_t keep = raw[k];
			raw[k] = raw[bytes - 1 - k];
			raw[bytes - 1 - k] = keep;
		}
}

#define CONVERT(ctype)                                                                                                \
	for (size_t i = 0; i < n; i++) {                                                                              \
		ctype x;                                                                                              \
		memcpy(&x, raw + i * sizeof(x), sizeof(x));                                                           \
		value[i] = (double)x * slope + intercept;                                                             \
	}                                                                                                             \
	break

static void convert(const struct bb_layout *l, const uint8_t *raw, size_t n, double *value)
{
	const double slope = l->slope, intercept = l->intercept;

	switch (l->type) {
	case BB_VOXEL_U8:
		CONVERT(uint8_t);
	case BB_VOXEL_I8:
		CONVERT(int8_t);
	case BB_VOXEL_I16:
		CONVERT(int16_t);
	case BB_VOXEL_U16:
		CONVERT(uint16_t);
	case BB_VOXEL_I32:
		CONVERT(int32_t);
	case BB_VOXEL_F32:
		CONVERT(float);
	case BB_VOXEL_F64:
	case BB_VOXEL_TYPES:
		CONVERT(double);
	}
}

void bb_voxels_convert(const struct bb_layout *l, uint8_t *raw, size_t n, double *value)
{
	if (l->big_endian != host_is_big_endian())
		swap_samples(raw, n, bb_voxel_bytes(l->type));
	convert(l, raw, n, value);
}

static enum bb_status skip(struct bb_bytes *bytes, struct slab *slab, uint64_t n, struct bb_error *err)
{
	while (n) {
		const size_t part = n < sizeof(slab->raw) ? (size_t)n : sizeof(slab->raw);
		size_t got;
		const enum bb_status status = bb_bytes_read(bytes, slab->raw, part, &got, err);
		if (status)
			return status;
		if (got < part)
			return bb_fail(err, BB_ERR_FORMAT, 1406, &bytes->where, "it ends before its voxels begin");
		n -= part;
	}
	return BB_OK;
}

/* One pass over all samples: slab after slab to `each`, which advances its own state. */
static enum bb_status pass(struct bb_bytes *bytes, const struct bb_layout *l, uint64_t n, struct slab *slab,
                           void (*each)(void *state, const double *value, size_t n), void *state, struct bb_error *err)
{
	const size_t size = bb_voxel_bytes(l->type);
	enum bb_status status = bb_bytes_rewind(bytes, err);

	if (!status)
		status = skip(bytes, slab, l->offset_bytes, err);
	while (!status && n) {
		const size_t part = n < SLAB_SAMPLES ? (size_t)n : SLAB_SAMPLES;
		size_t got;
		status = bb_bytes_read(bytes, slab->raw, part * size, &got, err);
		if (status)
			return status;
		if (got < part * size)
			return bb_fail(err, BB_ERR_FORMAT, 1406, &bytes->where, "%llu voxels are missing",
			               (unsigned long long)(n - got / size));
		bb_voxels_convert(l, slab->raw, part, slab->value);
		each(state, slab->value, part);
		n -= part;
	}
	return status;
}

static void widen(void *state, const double *value, size_t n)
{
	struct range *r = state;

	for (size_t i = 0; i < n; i++) {
		if (!isfinite(value[i]))
			continue;
		if (!r->n_finite++)
			r->least = r->most = value[i];
		else if (value[i] < r->least)
			r->least = value[i];
		else if (value[i] > r->most)
			r->most = value[i];
	}
}

struct filling {
	const struct bb_volume *v;
	uint16_t *next;
};

static void quantise(void *state, const double *value, size_t n)
{
	struct filling *f = state;
	const double least = f->v->least, span = f->v->most - f->v->least;

	for (size_t i = 0; i < n; i++) {
		/* Divide first: 65535 / span overflows for the smallest spans. */
		const double part = isfinite(value[i]) && span > 0 ? (value[i] - least) / span : 0;
		*f->next++ = part > 0 ? (uint16_t)((part < 1 ? part : 1) * 65535 + 0.5) : 0;
	}
}

/* To the end of the file: that is where gzip keeps its checksum. */
static enum bb_status check_tail(struct bb_bytes *bytes, struct slab *slab, struct bb_error *err)
{
	uint64_t n = 0;
	size_t got;

	do {
		const enum bb_status status = bb_bytes_read(bytes, slab->raw, sizeof(slab->raw), &got, err);
		if (status)
			return status;
		n += got;
		if (n > TRAILING_MOST_BYTES)
			return bb_fail(err, BB_ERR_FORMAT, 1411, &bytes->where, "more than 1 MiB follows the voxels");
	} while (got);
	return BB_OK;
}

enum bb_status bb_voxels_count(const struct bb_bytes *bytes, const struct bb_layout *l, uint64_t *n_out,
                               struct bb_error *err)
{
	uint64_t n = 1, n_bytes;

	if (l->dim[0] < 1 || l->dim[1] < 1 || l->dim[2] < 1 || l->n_steps < 1)
		return bb_fail(err, BB_ERR_FORMAT, 1404, &bytes->where, "%lld x %lld x %lld voxels, %lld steps",
		               (long long)l->dim[0], (long long)l->dim[1], (long long)l->dim[2], (long long)l->n_steps);
	const bool overflow = __builtin_mul_overflow(n, (uint64_t)l->dim[0], &n) ||
	                      __builtin_mul_overflow(n, (uint64_t)l->dim[1], &n) ||
	                      __builtin_mul_overflow(n, (uint64_t)l->dim[2], &n) ||
	                      __builtin_mul_overflow(n, (uint64_t)l->n_steps, &n) ||
	                      __builtin_mul_overflow(n, (uint64_t)bb_voxel_bytes(l->type), &n_bytes) ||
	                      __builtin_add_overflow(n_bytes, l->offset_bytes, &n_bytes);
	if (overflow)
		return bb_fail(err, BB_ERR_FORMAT, 1404, &bytes->where, "more voxels than can be counted");
	*n_out = n;
	return bb_bytes_could_hold(bytes, n_bytes, err);
}

static enum bb_status find_range(struct bb_bytes *bytes, const struct bb_layout *l, uint64_t n, struct slab *slab,
                                 struct range *range, struct bb_error *err)
{
	enum bb_status status = pass(bytes, l, n, slab, widen, range, err);

	if (!status)
		status = check_tail(bytes, slab, err);
	if (!status && !isfinite(range->most - range->least))
		status = bb_fail(err, BB_ERR_FORMAT, 1413, &bytes->where, "from %g to %g", range->least, range->most);
	return status;
}

static enum bb_status decode(struct bb_bytes *bytes, const struct bb_layout *l, uint64_t cap_bytes, uint64_t n,
                             struct slab *slab, struct bb_volume **out, struct bb_error *err)
{
	struct range range = { 0 };
	enum bb_status status = find_range(bytes, l, n, slab, &range, err);

	if (!status)
		status = bb_volume_create(l->dim, l->n_steps, cap_bytes - sizeof(*slab), &bytes->where, out, err);
	if (status)
		return status;
	struct bb_volume *v = *out;
	struct filling filling = { v, v->voxels };
	memcpy(v->spacing_mm, l->spacing_mm, sizeof(v->spacing_mm));
	v->least = range.least;
	v->most = range.most;
	v->n_nonfinite = n - range.n_finite;
	status = pass(bytes, l, n, slab, quantise, &filling, err);
	if (status) {
		bb_volume_free(v);
		*out = NULL;
	}
	return status;
}

enum bb_status bb_volume_decode(struct bb_bytes *bytes, const struct bb_layout *layout, uint64_t cap_bytes,
                                struct bb_volume **out, struct bb_error *err)
{
	uint64_t n = 0;
	enum bb_status status = bb_voxels_count(bytes, layout, &n, err);

	*out = NULL;
	if (status)
		return status;
	/* Before the first pass: a scan of gigabytes that cannot be kept helps nobody. */
	if (cap_bytes < sizeof(struct slab) || n > (cap_bytes - sizeof(struct slab)) / sizeof(uint16_t))
		return bb_fail(err, BB_ERR_FORMAT, 1405, &bytes->where, "%llu voxels, the cap is %llu bytes",
		               (unsigned long long)n, (unsigned long long)cap_bytes);
	struct slab *slab = malloc(sizeof(*slab));
	if (!slab)
		return bb_fail(err, BB_ERR_NOMEM, 1702, &bytes->where, "a slab of voxels");
	status = decode(bytes, layout, cap_bytes, n, slab, out, err);
	free(slab);
	return status;
}
