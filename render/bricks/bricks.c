#define _GNU_SOURCE /* O_NOATIME */
#include "render/bricks/bricks_private.h"
#include "render/bricks/values.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum bb_status read_at(const struct bb_bricks *b, uint64_t at, void *buf, size_t n, struct bb_error *err)
{
	const struct bb_where where = { b->path, 0, 0 };

	for (size_t done = 0; done < n;) {
		const ssize_t got = bb_bricks_file_read(b->fd, (char *)buf + done, n - done, at + done);
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0)
			return bb_fail(err, BB_ERR_IO, 1002, &where, "%s", strerror(errno));
		if (!got)
			return bb_fail(err, BB_ERR_FORMAT, 1406, &where, "it has become shorter");
		done += (size_t)got;
	}
	return BB_OK;
}

/* Records of a section, some at a time, with its CRC. take keeps one, or says by which number it is wrong. */
static enum bb_status read_section(struct bb_bricks *b, const struct bb_bricks_section *s, size_t record_bytes,
				   int (*take)(struct bb_bricks *b, uint64_t i, const uint8_t *from), const char *what,
				   struct bb_error *err)
{
	enum { AT_A_TIME = 1024 };
	const struct bb_where where = { b->path, 0, 0 };
	uint8_t buf[AT_A_TIME * BB_BRICKS_MOMENTS_BYTES];
	uint32_t crc = 0;

	for (uint64_t i = 0; i < b->h.tree.n_bricks; i += AT_A_TIME) {
		const uint64_t left = b->h.tree.n_bricks - i, part = left < AT_A_TIME ? left : AT_A_TIME;
		const enum bb_status status = read_at(b, s->offset + i * record_bytes, buf, part * record_bytes, err);
		if (status)
			return status;
		crc = bb_crc32c(crc, buf, part * record_bytes);
		for (uint64_t k = 0; k < part; k++) {
			const int wrong = take(b, i + k, buf + k * record_bytes);
			if (wrong)
				return bb_fail(err, BB_ERR_FORMAT, wrong, &where, "%s: brick %llu", what,
					       (unsigned long long)(i + k));
		}
	}
#ifndef BB_FUZZ
	if (crc != s->crc)
		return bb_fail(err, BB_ERR_FORMAT, 1441, &where, "%s", what);
#endif
	return BB_OK;
}

static bool lies_in_file(const struct bb_bricks *b, const struct bb_bricks_record *r, size_t most_bytes)
{
	return r->offset >= BB_BRICKS_HEADER_BYTES && r->offset <= b->file_bytes &&
	       r->bytes <= b->file_bytes - r->offset && r->bytes <= most_bytes;
}

static int take_index(struct bb_bricks *b, uint64_t i, const uint8_t *from)
{
	b->index[i] = bb_bricks_record_read(from);
	return lies_in_file(b, &b->index[i], bb_values_packed_cap(b->h.codec, bb_bricks_brick_bytes(&b->h))) ? 0 : 1445;
}

static int take_moments(struct bb_bricks *b, uint64_t i, const uint8_t *from)
{
	struct bb_bricks_moments *m = &b->moments[i];

	*m = bb_bricks_moments_read(from);
	if (!lies_in_file(b, &m->histograms, BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST))
		return 1445;
	/* Whoever selects by them may divide by them and index with them. */
	const float spread[] = { m->deviation, m->time_dev, m->time_cov, m->leaf_error };
	bool sane = isfinite(m->mean) && isfinite(m->least) && isfinite(m->most) && m->least <= m->most;
	for (size_t k = 0; k < BB_ARRAY_LEN(spread); k++)
		sane &= isfinite(spread[k]) && spread[k] >= 0;
	return sane ? 0 : 1454;
}

static enum bb_status load(struct bb_bricks *b, struct bb_error *err)
{
	const struct bb_where where = { b->path, 0, 0 };
	uint8_t header[BB_BRICKS_HEADER_BYTES];
	struct stat st;

	/* When a brick was last read is nobody's business, and writing it down costs a tenth of reading a small one. */
	b->fd = open(b->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOATIME);
	if (b->fd < 0 && errno == EPERM) /* another's file */
		b->fd = open(b->path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	if (b->fd < 0)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &where, "%s", strerror(errno));
	if (fstat(b->fd, &st) || !S_ISREG(st.st_mode))
		return bb_fail(err, BB_ERR_CONFIG, 1001, &where, "not a regular file");
	b->file_bytes = (uint64_t)st.st_size;
	if (b->file_bytes < sizeof(header))
		return bb_fail(err, BB_ERR_FORMAT, 1440, &where, "%llu bytes are too few for a header",
			       (unsigned long long)b->file_bytes);
	enum bb_status status = read_at(b, 0, header, sizeof(header), err);
	if (!status)
		status = bb_bricks_header_read(header, b->file_bytes, &where, &b->h, err);
	if (status)
		return status;
	/* The sections lie in the file, so this is no more than it has bytes. */
	b->index = calloc(b->h.tree.n_bricks, sizeof(*b->index));
	b->moments = calloc(b->h.tree.n_bricks, sizeof(*b->moments));
	if (!b->index || !b->moments)
		return bb_fail(err, BB_ERR_NOMEM, 1702, &where, "%llu bricks", (unsigned long long)b->h.tree.n_bricks);
	status = read_section(b, &b->h.index, BB_BRICKS_INDEX_BYTES, take_index, "the index", err);
	if (!status)
		status = read_section(b, &b->h.moments, BB_BRICKS_MOMENTS_BYTES, take_moments, "the moments", err);
	return status;
}

enum bb_status bb_bricks_open(const char *path, struct bb_bricks **out, struct bb_error *err)
{
	struct bb_bricks *b = calloc(1, sizeof(*b));

	*out = NULL;
	if (!b)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a brick file");
	b->fd = -1;
	snprintf(b->path, sizeof(b->path), "%s", path);
	const enum bb_status status = load(b, err);
	if (status)
		bb_bricks_close(b);
	else
		*out = b;
	return status;
}

void bb_bricks_close(struct bb_bricks *b)
{
	if (!b)
		return;
	if (b->fd >= 0)
		close(b->fd);
	free(b->index);
	free(b->moments);
	free(b);
}

const struct bb_bricks_header *bb_bricks_header(const struct bb_bricks *b)
{
	return &b->h;
}

const struct bb_bricks_moments *bb_bricks_moments(const struct bb_bricks *b)
{
	return b->moments;
}

const struct bb_bricks_record *bb_bricks_index(const struct bb_bricks *b)
{
	return b->index;
}

static enum bb_status read_record(const struct bb_bricks *b, uint64_t brick, const struct bb_bricks_record *r,
				  uint8_t *buf, const char *what, struct bb_error *err)
{
	const enum bb_status status = read_at(b, r->offset, buf, r->bytes, err);

#ifndef BB_FUZZ
	if (!status && bb_crc32c(0, buf, r->bytes) != r->crc)
		return bb_fail(err, BB_ERR_FORMAT, 1441, &(struct bb_where){ b->path, 0, 0 }, "%s %llu", what,
			       (unsigned long long)brick);
#endif
	(void)brick;
	(void)what;
	return status;
}

enum bb_status bb_bricks_read(const struct bb_bricks *b, uint64_t brick, uint8_t *out, struct bb_error *err)
{
	if (brick >= b->h.tree.n_bricks)
		return BB_ERR_USAGE;
	const struct bb_where where = { b->path, 0, 0 };
	const struct bb_bricks_record *r = &b->index[brick];
	const size_t n = bb_bricks_brick_bytes(&b->h);
	if (bb_bricks_as_is(&b->h, r->bytes))
		return r->bytes == n ? read_record(b, brick, r, out, "brick", err) :
				       bb_fail(err, BB_ERR_FORMAT, 1450, &where, "brick %llu: it is not as large as the others",
					       (unsigned long long)brick);
	struct bb_unpacker unpacker;
	uint8_t *packed = malloc(r->bytes ? r->bytes : 1);
	enum bb_status status = BB_OK;
	if (!bb_unpacker_init(&unpacker, b->h.codec) || !packed)
		status = bb_fail(err, BB_ERR_NOMEM, 1702, &where, "a packed brick");
	if (!status)
		status = read_record(b, brick, r, packed, "brick", err);
	if (!status && !bb_values_unpack(&unpacker, packed, r->bytes, out, n))
		status = bb_fail(err, BB_ERR_FORMAT, 1450, &where, "brick %llu", (unsigned long long)brick);
	bb_unpacker_fini(&unpacker);
	free(packed);
	return status;
}

enum bb_status bb_bricks_histograms(const struct bb_bricks *b, uint64_t brick,
				    uint16_t out[BB_HIST_KINDS][BB_STATS_BINS], struct bb_error *err)
{
	uint8_t coded[BB_HIST_KINDS * BB_HISTOGRAM_CODED_MOST];
	size_t at = 0;

	if (brick >= b->h.tree.n_bricks)
		return BB_ERR_USAGE;
	const struct bb_bricks_record *r = &b->moments[brick].histograms;
	const enum bb_status status = read_record(b, brick, r, coded, "histograms of brick", err);
	if (status)
		return status;
	for (int kind = 0; kind < BB_HIST_KINDS; kind++) {
		const size_t n = bb_histogram_decode(coded + at, r->bytes - at, out[kind]);
		if (!n)
			return bb_fail(err, BB_ERR_FORMAT, 1450, &(struct bb_where){ b->path, 0, 0 },
				       "histograms of brick %llu", (unsigned long long)brick);
		at += n;
	}
	return BB_OK;
}
