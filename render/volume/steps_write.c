#include "hal/file.h"
#include "render/parallel.h"
#include "render/volume/steps.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define END ".hdr.txt"
#define PLANES_MOST 64 /* at a time */

struct batch {
	const struct bb_steps *steps;
	uint64_t first; /* plane, counted through all steps */
	size_t plane_floats;
	float *values;
	enum bb_status status[PLANES_MOST];
	struct bb_error err[PLANES_MOST];
};

static void one_plane(void *ctx, size_t i, unsigned thread)
{
	struct batch *b = ctx;
	const uint64_t plane = b->first + i;
	(void)thread;

	b->status[i] =
		bb_steps_rows(b->steps, (uint32_t)(plane / b->steps->dim[2]), (uint32_t)(plane % b->steps->dim[2]), 0,
			      b->steps->dim[1], b->values + i * b->plane_floats, &b->err[i]);
}

static enum bb_status put(int fd, const void *bytes, size_t n, const char *path, struct bb_error *err)
{
	for (size_t done = 0; done < n;) {
		const ssize_t put_now = write(fd, (const char *)bytes + done, n - done);
		if (put_now < 0 && errno == EINTR)
			continue;
		if (put_now <= 0)
			return bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ path, 0, 0 }, "%s", strerror(errno));
		done += (size_t)put_now;
	}
	return BB_OK;
}

static enum bb_status write_voxels(const struct bb_steps *s, int fd, const char *path, unsigned threads,
				   bool (*progress)(void *ctx, uint64_t done, uint64_t total), void *ctx,
				   struct bb_error *err)
{
	const uint64_t total = (uint64_t)s->dim[2] * s->n_steps;
	struct batch *b = calloc(1, sizeof(*b));
	enum bb_status status = BB_OK;
	uint64_t at_once = (16u << 20) / ((uint64_t)s->dim[0] * s->dim[1] * sizeof(float));

	at_once = at_once < threads ? threads : at_once > PLANES_MOST ? PLANES_MOST : at_once;
	if (b) {
		b->steps = s;
		b->plane_floats = (size_t)s->dim[0] * s->dim[1];
		b->values = malloc(at_once * b->plane_floats * sizeof(float));
	}
	if (!b || !b->values) {
		free(b);
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%llu planes", (unsigned long long)at_once);
	}
	for (; b->first < total && !status; b->first += at_once) {
		const size_t n = (size_t)(total - b->first < at_once ? total - b->first : at_once);
		if (progress && !progress(ctx, b->first, total)) {
			status = BB_SKIPPED;
			break;
		}
		bb_parallel(threads, n, one_plane, b);
		for (size_t i = 0; i < n && !status; i++)
			if ((status = b->status[i]) && err)
				*err = b->err[i];
		if (!status)
			status = put(fd, b->values, n * b->plane_floats * sizeof(float), path, err);
	}
	free(b->values);
	free(b);
	return status;
}

static enum bb_status write_header(const struct bb_steps *s, const char *path, const char *voxels, struct bb_error *err)
{
	const char *slash = strrchr(voxels, '/');
	FILE *f = fopen(path, "we");

	if (!f)
		return bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ path, 0, 0 }, "%s", strerror(errno));
	fprintf(f, "file: %s\ndims: %u %u %u\ntype: f32\nsteps: %u\nspacing_mm: %.17g %.17g %.17g\n",
		slash ? slash + 1 : voxels, s->dim[0], s->dim[1], s->dim[2], s->n_steps, s->spacing_mm[0],
		s->spacing_mm[1], s->spacing_mm[2]);
	if (s->spherical)
		fprintf(f, "spherical: %.17g %.17g %.17g %.17g %.17g %.17g\n", s->extent[0], s->extent[1], s->extent[2],
			s->extent[3], s->extent[4], s->extent[5]);
	const bool ok = !ferror(f);
	if (fclose(f) || !ok)
		return bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ path, 0, 0 }, "%s", strerror(errno));
	return BB_OK;
}

enum bb_status bb_steps_write(const struct bb_steps *s, const char *path, unsigned threads,
			      bool (*progress)(void *ctx, uint64_t done, uint64_t total), void *ctx,
			      struct bb_error *err)
{
	const size_t n = strlen(path), end = strlen(END);
	char voxels[BB_PATH_MAX_BYTES], part[2][BB_PATH_MAX_BYTES];

	if (n <= end || strcmp(path + n - end, END) || n + 16 > BB_PATH_MAX_BYTES)
		return bb_fail(err, BB_ERR_CONFIG, 1401, &(struct bb_where){ path, 0, 0 },
			       "a name that ends in " END " is wanted");
	if (!threads || threads > PLANES_MOST)
		return BB_ERR_RANGE;
	snprintf(voxels, sizeof(voxels), "%.*s.raw", (int)(n - end), path);
	if (!bb_path_may_be_replaced(path) || !bb_path_may_be_replaced(voxels))
		return bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ path, 0, 0 }, "it is there and no regular file");
	snprintf(part[0], sizeof(part[0]), "%.*s.raw.part", (int)(n - end), path);
	snprintf(part[1], sizeof(part[1]), "%.*s" END ".part", (int)(n - end), path);
	const int fd = open(part[0], O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
	if (fd < 0)
		return bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ part[0], 0, 0 }, "%s", strerror(errno));
	enum bb_status status = write_voxels(s, fd, part[0], threads, progress, ctx, err);
	if (close(fd) && !status)
		status = bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ part[0], 0, 0 }, "%s", strerror(errno));
	if (!status)
		status = write_header(s, part[1], voxels, err);
	if (!status && (rename(part[0], voxels) || rename(part[1], path)))
		status = bb_fail(err, BB_ERR_IO, 1901, &(struct bb_where){ path, 0, 0 }, "%s", strerror(errno));
	if (status) {
		unlink(part[0]);
		unlink(part[1]);
	}
	return status;
}
