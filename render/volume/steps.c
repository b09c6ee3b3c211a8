#define _GNU_SOURCE /* O_TMPFILE */
#include "render/volume/steps.h"
#include "render/volume/volume_private.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define CHUNK 4096u

struct bb_steps_file {
	struct bb_bytes bytes; /* fd is what is read, after unpacking */
	struct bb_layout layout;
	uint32_t first; /* its first step */
	char path[BB_PATH_MAX_BYTES];
};

struct bb_generator {
	const char *kind;
	bb_generated_row *row;
	const double *extent; /* NULL: a Cartesian grid */
};

static const struct bb_generator generators[] = {
	{ "cme", bb_cme_row, NULL },     { "enlil", bb_enlil_row, bb_enlil_extent },
	{ "delta", bb_delta_row, NULL }, { "wing", bb_wing_row, NULL },
	{ "shock", bb_shock_row, NULL },
};

static bool ends_with(const char *path, const char *end)
{
	const size_t n = strlen(path), m = strlen(end);

	return n > m && !strcmp(path + n - m, end);
}

static uint64_t mixed(uint64_t h, const void *bytes, size_t n)
{
	const uint8_t *p = bytes;

	while (n--)
		h = (h ^ *p++) * UINT64_C(0x100000001B3); /* FNV-1a */
	return h;
}

/* From a gzip stream to a file of no name beside the result. */
static enum bb_status unpack(struct bb_bytes *b, const char *scratch, struct bb_error *err)
{
	const int fd = open(scratch, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
	uint8_t *buf = malloc(1 << 20);
	enum bb_status status = BB_OK;
	size_t got = 1;

	if (fd < 0 || !buf)
		status = bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ scratch, 0, 0 }, "unpacking: %s",
				 strerror(errno));
	if (!status)
		status = bb_bytes_rewind(b, err);
	while (!status && got) {
		status = bb_bytes_read(b, buf, 1 << 20, &got, err);
		if (!status && got && write(fd, buf, got) != (ssize_t)got)
			status = bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ scratch, 0, 0 }, "unpacking: %s",
					 strerror(errno));
	}
	free(buf);
	if (status) {
		if (fd >= 0)
			close(fd);
		return status;
	}
	const struct bb_where where = b->where;
	const uint64_t n = (uint64_t)lseek(fd, 0, SEEK_CUR);
	bb_bytes_close(b);
	*b = (struct bb_bytes){ .where = where, .fd = fd, .file_bytes = n };
	return BB_OK;
}

static enum bb_status open_file(struct bb_steps_file *f, const char *path, const char *scratch, struct bb_error *err)
{
	char voxels[BB_PATH_MAX_BYTES];
	enum bb_status status;
	uint64_t n;

	snprintf(f->path, sizeof(f->path), "%s", path);
	f->bytes.fd = -1;
	if (ends_with(path, ".nii") || ends_with(path, ".nii.gz")) {
		status = bb_bytes_open(f->path, BB_BYTES_MAY_BE_GZIP, &f->bytes, err);
		if (!status)
			status = bb_nifti_layout(&f->bytes, &f->layout, err);
	} else if (ends_with(path, ".hdr.txt")) {
		status = bb_raw_layout(f->path, &f->layout, voxels, err);
		if (!status)
			status = bb_bytes_open(voxels, BB_BYTES_NO_LINK, &f->bytes, err);
		f->bytes.where.file = f->path; /* voxels is gone soon */
	} else {
		return bb_fail(err, BB_ERR_CONFIG, 1401, &(struct bb_where){ path, 0, 0 }, "the name does not say");
	}
	if (!status)
		status = bb_voxels_count(&f->bytes, &f->layout, &n, err);
	if (!status && f->bytes.gz)
		status = unpack(&f->bytes, scratch, err);
	if (!status)
		status = bb_voxels_count(&f->bytes, &f->layout, &n, err); /* now against what is really there */
	return status;
}

static enum bb_status take(struct bb_steps *s, const struct bb_steps_file *f, struct bb_error *err)
{
	const struct bb_layout *l = &f->layout, *first = &s->files[0].layout;
	struct stat st = { 0 };

	for (int a = 0; a < 3; a++)
		if (l->dim[a] != first->dim[a] || l->dim[a] > INT32_MAX)
			return bb_fail(err, BB_ERR_FORMAT, 1446, &f->bytes.where,
				       "%lld x %lld x %lld voxels, the first file has %lld x %lld x %lld",
				       (long long)l->dim[0], (long long)l->dim[1], (long long)l->dim[2],
				       (long long)first->dim[0], (long long)first->dim[1], (long long)first->dim[2]);
	bool other = l->spherical != first->spherical;
	for (int i = 0; i < 6; i++)
		other |= l->extent[i] < first->extent[i] || l->extent[i] > first->extent[i];
	if (other)
		return bb_fail(err, BB_ERR_FORMAT, 1446, &f->bytes.where,
			       "its grid is another one than the first file's");
	if (l->n_steps > (int64_t)(1u << 16) - s->n_steps)
		return bb_fail(err, BB_ERR_FORMAT, 1404, &f->bytes.where, "more than 65536 steps");
	s->n_steps += (uint32_t)l->n_steps;
	s->value_bytes += (uint64_t)l->dim[0] * (uint64_t)l->dim[1] * (uint64_t)l->dim[2] * (uint64_t)l->n_steps *
			  bb_voxel_bytes(l->type);
	s->fingerprint = mixed(s->fingerprint, f->path, strlen(f->path));
	s->fingerprint = mixed(s->fingerprint, &f->bytes.file_bytes, 8);
	s->fingerprint = mixed(s->fingerprint, l->extent, sizeof(l->extent));
	if (stat(f->path, &st) == 0) {
		s->fingerprint = mixed(s->fingerprint, &st.st_mtim.tv_sec, sizeof(st.st_mtim.tv_sec));
		s->fingerprint = mixed(s->fingerprint, &st.st_mtim.tv_nsec, sizeof(st.st_mtim.tv_nsec));
	}
	return BB_OK;
}

enum bb_status bb_steps_open(const char *const *paths, size_t n_paths, const char *scratch, struct bb_steps **out,
			     struct bb_error *err)
{
	struct bb_steps *s = calloc(1, sizeof(*s));
	enum bb_status status = n_paths ? BB_OK : BB_ERR_USAGE;

	*out = NULL;
	if (s)
		s->files = calloc(n_paths ? n_paths : 1, sizeof(*s->files));
	if (!s || !s->files) {
		free(s);
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu files", n_paths);
	}
	s->fingerprint = UINT64_C(0xCBF29CE484222325);
	for (size_t i = 0; i < n_paths && !status; i++) {
		struct bb_steps_file *f = &s->files[s->n_files++];
		status = open_file(f, paths[i], scratch, err);
		f->first = s->n_steps;
		if (!status)
			status = take(s, f, err);
	}
	if (status) {
		bb_steps_close(s);
		return status;
	}
	const char *slash = strrchr(paths[0], '/'), *base = slash ? slash + 1 : paths[0];
	snprintf(s->name, sizeof(s->name), "%.*s", (int)strcspn(base, "."), base);
	for (int a = 0; a < 3; a++) {
		s->dim[a] = (uint32_t)s->files[0].layout.dim[a];
		s->spacing_mm[a] = s->files[0].layout.spacing_mm[a];
	}
	s->spherical = s->files[0].layout.spherical;
	memcpy(s->extent, s->files[0].layout.extent, sizeof(s->extent));
	*out = s;
	return BB_OK;
}

enum bb_status bb_steps_generate(const char *kind, const uint32_t dim[3], uint32_t n_steps, struct bb_steps **out,
				 struct bb_error *err)
{
	size_t i = 0;

	*out = NULL;
	while (i < BB_ARRAY_LEN(generators) && strcmp(generators[i].kind, kind))
		i++;
	if (i == BB_ARRAY_LEN(generators))
		return bb_fail(err, BB_ERR_CONFIG, 1430, NULL, "%.32s", kind);
	const struct bb_generator *g = &generators[i];
	for (int a = 0; a < 3; a++)
		if (dim[a] < 4 || dim[a] > 1u << 16 || n_steps < 1 || n_steps > 1u << 16)
			return bb_fail(err, BB_ERR_CONFIG, 1431, NULL, "%u x %u x %u voxels, %u steps", dim[0], dim[1],
				       dim[2], n_steps);
	struct bb_steps *s = calloc(1, sizeof(*s));
	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a generator");
	snprintf(s->name, sizeof(s->name), "%s", kind);
	s->generator = g;
	s->spherical = g->extent;
	if (g->extent)
		memcpy(s->extent, g->extent, sizeof(s->extent));
	s->n_steps = n_steps;
	for (int a = 0; a < 3; a++) {
		s->dim[a] = dim[a];
		s->spacing_mm[a] = 1;
	}
	bb_steps_seed(s, 1);
	*out = s;
	return BB_OK;
}

enum bb_status bb_steps_of_volume(const struct bb_volume *v, struct bb_steps **out, struct bb_error *err)
{
	struct bb_steps *s = calloc(1, sizeof(*s));

	*out = s;
	if (!s)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a volume's steps");
	memcpy(s->name, v->name, sizeof(s->name));
	memcpy(s->dim, v->dim, sizeof(s->dim));
	memcpy(s->spacing_mm, v->spacing_mm, sizeof(s->spacing_mm));
	s->n_steps = v->n_steps;
	s->memory = v;
	return BB_OK;
}

void bb_steps_seed(struct bb_steps *s, uint32_t seed)
{
	if (!s->generator)
		return;
	s->seed = seed;
	s->fingerprint = mixed(UINT64_C(0xCBF29CE484222325), s->generator->kind, strlen(s->generator->kind));
	s->fingerprint = mixed(mixed(mixed(s->fingerprint, s->dim, 12), &s->n_steps, 4), &seed, 4);
}

void bb_steps_close(struct bb_steps *s)
{
	if (!s)
		return;
	for (size_t i = 0; i < s->n_files; i++)
		bb_bytes_close(&s->files[i].bytes);
	free(s->files);
	free(s);
}

/* ---- reading ---- */

static enum bb_status read_at(const struct bb_bytes *b, uint64_t at, void *buf, size_t n, struct bb_error *err)
{
	for (size_t done = 0; done < n;) {
		const ssize_t got = pread(b->fd, (char *)buf + done, n - done, (off_t)(at + done));
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0)
			return bb_fail(err, BB_ERR_IO, 1002, &b->where, "%s", strerror(errno));
		if (!got) /* it was long enough when it was opened */
			return bb_fail(err, BB_ERR_FORMAT, 1406, &b->where, "it has become shorter while it was read");
		done += (size_t)got;
	}
	return BB_OK;
}

static bool is_plain_f32(const struct bb_layout *l)
{
	return l->type == BB_VOXEL_F32 && l->slope == 1 && l->intercept == 0 && !l->big_endian &&
	       __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__;
}

static enum bb_status read_values(const struct bb_steps_file *f, uint64_t first, size_t n, float *out,
				  struct bb_error *err)
{
	const struct bb_layout *l = &f->layout;
	const size_t size = bb_voxel_bytes(l->type);
	uint8_t raw[CHUNK * 8];
	double value[CHUNK];

	if (is_plain_f32(l))
		return read_at(&f->bytes, l->offset_bytes + first * 4, out, n * 4, err);
	for (size_t done = 0; done < n;) {
		const size_t part = n - done < CHUNK ? n - done : CHUNK;
		const enum bb_status status =
			read_at(&f->bytes, l->offset_bytes + (first + done) * size, raw, part * size, err);
		if (status)
			return status;
		bb_voxels_convert(l, raw, part, value);
		for (size_t i = 0; i < part; i++)
			out[done + i] = (float)value[i];
		done += part;
	}
	return BB_OK;
}

static void generate_rows(const struct bb_steps *s, uint32_t step, uint32_t z, uint32_t y, uint32_t n, float *out)
{
	const struct bb_generated g = { { s->dim[0], s->dim[1], s->dim[2] }, s->n_steps, s->seed };
	double row[CHUNK];

	for (uint32_t i = 0; i < n; i++, out += s->dim[0])
		for (uint32_t x = 0; x < s->dim[0]; x += CHUNK) {
			const uint32_t part = s->dim[0] - x < CHUNK ? s->dim[0] - x : CHUNK;
			s->generator->row(&g, step, z, y + i, x, part, row);
			for (uint32_t k = 0; k < part; k++)
				out[x + k] = (float)row[k];
		}
}

static void copy_rows(const struct bb_volume *v, uint32_t step, uint32_t z, uint32_t y, uint32_t n, float *out)
{
	for (uint32_t i = 0; i < n; i++)
		for (uint32_t x = 0; x < v->dim[0]; x++)
			*out++ = (float)(v->least + bb_volume_voxel(v, x, y + i, z, step) * (v->most - v->least));
}

enum bb_status bb_steps_rows(const struct bb_steps *s, uint32_t step, uint32_t z, uint32_t y, uint32_t n, float *out,
			     struct bb_error *err)
{
	size_t i = 0;

	if (s->generator) {
		generate_rows(s, step, z, y, n, out);
		return BB_OK;
	}
	if (s->memory) {
		copy_rows(s->memory, step, z, y, n, out);
		return BB_OK;
	}
	while (i + 1 < s->n_files && s->files[i + 1].first <= step)
		i++;
	const struct bb_steps_file *f = &s->files[i];
	const uint64_t plane = (uint64_t)(step - f->first) * s->dim[2] + z;
	return read_values(f, (plane * s->dim[1] + y) * s->dim[0], (size_t)n * s->dim[0], out, err);
}
