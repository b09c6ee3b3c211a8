#include "render/volume/volume_private.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum bb_status bb_volume_create(const int64_t dim[3], int64_t n_steps, uint64_t cap_bytes,
                                const struct bb_where *where, struct bb_volume **out, struct bb_error *err)
{
	uint64_t n = sizeof(uint16_t);

	*out = NULL;
	for (int i = 0; i < 4; i++) {
		const int64_t edge = i < 3 ? dim[i] : n_steps;
		if (edge < 1 || edge > INT32_MAX || __builtin_mul_overflow(n, (uint64_t)edge, &n))
			return bb_fail(err, BB_ERR_FORMAT, 1404, where, "%lld x %lld x %lld voxels, %lld steps",
			               (long long)dim[0], (long long)dim[1], (long long)dim[2], (long long)n_steps);
	}
	if (n > cap_bytes || n > SIZE_MAX / 2)
		return bb_fail(err, BB_ERR_FORMAT, 1405, where, "%llu bytes of voxels, the cap is %llu",
		               (unsigned long long)n, (unsigned long long)cap_bytes);
	struct bb_volume *v = calloc(1, sizeof(*v));
	if (v)
		v->voxels = calloc(1, (size_t)n);
	if (!v || !v->voxels) {
		free(v);
		return bb_fail(err, BB_ERR_NOMEM, 1702, where, "%llu bytes of voxels", (unsigned long long)n);
	}
	for (int i = 0; i < 3; i++) {
		v->dim[i] = (uint32_t)dim[i];
		v->spacing_mm[i] = 1;
	}
	v->n_steps = (uint32_t)n_steps;
	*out = v;
	return BB_OK;
}

void bb_volume_free(struct bb_volume *v)
{
	if (!v)
		return;
	free(v->voxels);
	free(v->values);
	free(v);
}

static bool ends_with(const char *path, const char *end)
{
	const size_t n = strlen(path), m = strlen(end);

	return n > m && !strcmp(path + n - m, end);
}

/* The file's own name without folder and extensions. */
static void set_name(struct bb_volume *v, const char *path)
{
	const char *slash = strrchr(path, '/');
	const char *base = slash ? slash + 1 : path;

	snprintf(v->name, sizeof(v->name), "%.*s", (int)strcspn(base, "."), base);
}

enum bb_status bb_volume_load(const char *path, uint64_t cap_bytes, struct bb_volume **out, struct bb_error *err)
{
	enum bb_status status;

	*out = NULL;
	if (ends_with(path, ".nii") || ends_with(path, ".nii.gz"))
		status = bb_volume_load_nifti(path, cap_bytes, out, err);
	else if (ends_with(path, ".hdr.txt"))
		status = bb_volume_load_raw(path, cap_bytes, out, err);
	else
		return bb_fail(err, BB_ERR_CONFIG, 1401, &(struct bb_where){ path, 0, 0 }, "the name does not say");
	if (!status)
		set_name(*out, path);
	return status;
}

enum bb_status bb_volume_generate(const char *kind, uint32_t edge, uint32_t n_steps, struct bb_volume **out,
                                  struct bb_error *err)
{
	*out = NULL;
	if (strcmp(kind, "cme"))
		return bb_fail(err, BB_ERR_CONFIG, 1430, NULL, "%.32s", kind);
	if (edge < 4 || edge > 1024 || n_steps < 1 || n_steps > 1000)
		return bb_fail(err, BB_ERR_CONFIG, 1431, NULL, "edge %u, %u steps", edge, n_steps);
	const enum bb_status status = bb_volume_create((const int64_t[]){ edge, edge, edge }, n_steps,
	                                               BB_VOLUME_CAP_BYTES, NULL, out, err);
	if (status)
		return status;
	set_name(*out, kind);
	bb_volume_fill_cme(*out);
	return BB_OK;
}

static uint32_t clamp_index(int64_t i, uint32_t n)
{
	return i < 0 ? 0 : i >= n ? n - 1 : (uint32_t)i;
}

double bb_volume_voxel(const struct bb_volume *v, int64_t x, int64_t y, int64_t z, uint32_t step)
{
	const int64_t nz = v->dim[2], round = v->around ? (z % nz + nz) % nz : z;
	const size_t xi = clamp_index(x, v->dim[0]), yi = clamp_index(y, v->dim[1]), zi = clamp_index(round, v->dim[2]);
	const size_t si = clamp_index(step, v->n_steps), at = ((si * v->dim[2] + zi) * v->dim[1] + yi) * v->dim[0] + xi;

	return v->values ? (double)v->values[at] : v->voxels[at] / 65535.0;
}

/* Splits a coordinate into the voxel below and the part towards the next; far outside (and NaN) is the nearest edge. */
static double split(double p, double least, double most, int64_t *below)
{
	const double inside = p > least ? (p < most ? p : most) : least;

	*below = (int64_t)floor(inside);
	return inside - (double)*below;
}

static double trilinear(const struct bb_volume *v, const int64_t i[3], const double f[3], uint32_t step)
{
	double plane[2];

	for (int dz = 0; dz < 2; dz++) {
		double row[2];
		for (int dy = 0; dy < 2; dy++) {
			const double a = bb_volume_voxel(v, i[0], i[1] + dy, i[2] + dz, step);
			const double b = bb_volume_voxel(v, i[0] + 1, i[1] + dy, i[2] + dz, step);
			row[dy] = a + (b - a) * f[0];
		}
		plane[dz] = row[0] + (row[1] - row[0]) * f[1];
	}
	return plane[0] + (plane[1] - plane[0]) * f[2];
}

double bb_volume_sample(const struct bb_volume *v, const double p[3], double step)
{
	int64_t i[3], s;
	double f[3];

	for (int a = 0; a < 3; a++) {
		const double beyond = a == 2 && v->around ? 1 : 0;
		f[a] = split(p[a], -beyond, v->dim[a] - 1 + beyond, &i[a]);
	}
	const double t = split(step, 0, (double)v->n_steps - 1, &s);
	const double now = trilinear(v, i, f, (uint32_t)s);
	const double next = t > 0 ? trilinear(v, i, f, (uint32_t)s + 1) : now;
	return now + (next - now) * t;
}
