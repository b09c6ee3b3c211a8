#include "render/volume/volume_private.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

/* Deflate cannot pack tighter than 1032:1. Below the free size a bomb does no harm; above it, real scans stay far
 * below the ratio (3 to 10 for brains, about 40 for masked ones). */
#define DEFLATE_MOST 1032u
#define BOMB_FREE_BYTES (UINT64_C(64) << 20)
#define BOMB_RATIO 256u

static bool starts_with_gzip_magic(int fd)
{
	uint8_t head[2];

	return pread(fd, head, 2, 0) == 2 && head[0] == 0x1F && head[1] == 0x8B;
}

enum bb_status bb_bytes_open(const char *path, unsigned mode, struct bb_bytes *out, struct bb_error *err)
{
	struct stat st;

	*out = (struct bb_bytes){ .where = { path, 0, 0 }, .fd = -1 };
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | (mode & BB_BYTES_NO_LINK ? O_NOFOLLOW : 0));
	if (fd < 0 && errno == ELOOP && (mode & BB_BYTES_NO_LINK))
		return bb_fail(err, BB_ERR_CONFIG, 1424, &out->where, "it is a symbolic link");
	if (fd < 0)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &out->where, "%s", strerror(errno));
	if (fstat(fd, &st) || !S_ISREG(st.st_mode)) {
		close(fd);
		return bb_fail(err, BB_ERR_CONFIG, 1001, &out->where, "not a regular file");
	}
	out->fd = fd;
	out->file_bytes = (uint64_t)st.st_size;
	if (!(mode & BB_BYTES_MAY_BE_GZIP) || !starts_with_gzip_magic(fd))
		return BB_OK;
	out->gz = gzdopen(fd, "rb");
	if (!out->gz) {
		bb_bytes_close(out);
		return bb_fail(err, BB_ERR_NOMEM, 1702, &out->where, "opening a gzip stream");
	}
	out->fd = -1; /* gzclose closes it */
	return BB_OK;
}

void bb_bytes_close(struct bb_bytes *b)
{
	if (b->gz)
		gzclose_r(b->gz);
	if (b->fd >= 0)
		close(b->fd);
	b->gz = NULL;
	b->fd = -1;
}

enum bb_status bb_bytes_rewind(struct bb_bytes *b, struct bb_error *err)
{
	if (b->gz ? gzrewind(b->gz) == 0 : lseek(b->fd, 0, SEEK_SET) == 0)
		return BB_OK;
	return bb_fail(err, BB_ERR_IO, 1002, &b->where, "cannot go back to the beginning");
}

static enum bb_status read_gzip(struct bb_bytes *b, void *buf, size_t n, size_t *n_out, struct bb_error *err)
{
	const int got = gzread(b->gz, buf, (unsigned)n);
	int code = Z_OK;
	const char *text = gzerror(b->gz, &code);

	/* A stream that just stops is a short read with Z_BUF_ERROR, not a negative one. */
	if (got < 0 || ((size_t)got < n && code != Z_OK && code != Z_STREAM_END))
		return bb_fail(err, BB_ERR_FORMAT, 1408, &b->where, "%s", code == Z_ERRNO ? strerror(errno) : text);
	*n_out = (size_t)got;
	return BB_OK;
}

enum bb_status bb_bytes_read(struct bb_bytes *b, void *buf, size_t n, size_t *n_out, struct bb_error *err)
{
	*n_out = 0;
	if (b->gz)
		return read_gzip(b, buf, n, n_out, err);
	while (*n_out < n) {
		const ssize_t got = read(b->fd, (char *)buf + *n_out, n - *n_out);
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0)
			return bb_fail(err, BB_ERR_IO, 1002, &b->where, "%s", strerror(errno));
		if (!got)
			break;
		*n_out += (size_t)got;
	}
	return BB_OK;
}

enum bb_status bb_bytes_could_hold(const struct bb_bytes *b, uint64_t n, struct bb_error *err)
{
	const uint64_t most = b->gz ? b->file_bytes * DEFLATE_MOST : b->file_bytes;

	if (n > most)
		return bb_fail(err, BB_ERR_FORMAT, 1406, &b->where,
		               "the header describes %llu bytes, a file of %llu bytes cannot hold them",
		               (unsigned long long)n, (unsigned long long)b->file_bytes);
	if (b->gz && n > BOMB_FREE_BYTES && n / BOMB_RATIO > b->file_bytes)
		return bb_fail(err, BB_ERR_FORMAT, 1410, &b->where, "%llu bytes out of %llu", (unsigned long long)n,
		               (unsigned long long)b->file_bytes);
	return BB_OK;
}
