#include "hal/file.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum bb_status read_all(int fd, const char *path, char *buf, size_t cap, size_t *n, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };

	*n = 0;
	while (*n < cap) {
		const ssize_t got = read(fd, buf + *n, cap - *n);
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0)
			return bb_fail(err, BB_ERR_IO, 1002, &where, "%s", strerror(errno));
		if (got == 0)
			return BB_OK;
		*n += (size_t)got;
	}
	return bb_fail(err, BB_ERR_CONFIG, 1003, &where, "more than %zu bytes", cap - 1);
}

static enum bb_status read_fd(int fd, const char *path, size_t cap, char **out, size_t *n_out, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	enum bb_status status;
	struct stat st;
	char *buf;

	if (fstat(fd, &st) < 0)
		return bb_fail(err, BB_ERR_IO, 1002, &where, "%s", strerror(errno));
	if (!S_ISREG(st.st_mode))
		return bb_fail(err, BB_ERR_CONFIG, 1018, &where, "a directory, a pipe or a device");
	if (st.st_size < 0 || (uint64_t)st.st_size > cap)
		return bb_fail(err, BB_ERR_CONFIG, 1003, &where, "%lld bytes, at most %zu", (long long)st.st_size, cap);
	/* The file may grow while it is read: one byte more than the cap tells. */
	buf = malloc(cap + 1);
	if (!buf)
		return bb_fail(err, BB_ERR_NOMEM, 1702, &where, "%zu bytes", cap);
	status = read_all(fd, path, buf, cap + 1, n_out, err);
	if (status) {
		free(buf);
		*n_out = 0;
		return status;
	}
	buf[*n_out] = '\0';
	*out = buf;
	return BB_OK;
}

enum bb_status bb_file_read(const char *path, size_t cap_bytes, char **out, size_t *n_out, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	enum bb_status status;
	int fd;

	*out = NULL;
	*n_out = 0;
	/* Not blocking: a pipe by that name must be refused, not waited for. */
	fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
	if (fd < 0)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &where, "%s", strerror(errno));
	status = read_fd(fd, path, cap_bytes, out, n_out, err);
	close(fd);
	return status;
}

enum bb_status bb_file_check_text(const char *path, const char *text, size_t n, struct bb_error *err)
{
	struct bb_where where = { path, 1, 1 };
	const unsigned char *b = (const unsigned char *)text;

	if (n >= 3 && b[0] == 0xEF && b[1] == 0xBB && b[2] == 0xBF)
		return bb_fail(err, BB_ERR_FORMAT, 1007, &where, "EF BB BF");
	if (n >= 2 && ((b[0] == 0xFE && b[1] == 0xFF) || (b[0] == 0xFF && b[1] == 0xFE)))
		return bb_fail(err, BB_ERR_FORMAT, 1007, &where, "%02X %02X", b[0], b[1]);
	for (size_t i = 0; i < n; i++, where.column++) {
		if ((b[i] < 0x20 && b[i] != '\t' && b[i] != '\n' && b[i] != '\r') || b[i] == 0x7F)
			return bb_fail(err, BB_ERR_FORMAT, 1006, &where, "byte 0x%02X", b[i]);
		if (b[i] == '\n') {
			where.line++;
			where.column = 0;
		}
	}
	if (strspn(text, " \t\r\n") == n)
		return bb_fail(err, BB_ERR_FORMAT, 1004, &where, "nothing in it");
	return BB_OK;
}

bool bb_path_may_be_replaced(const char *path)
{
	struct stat st;

	return stat(path, &st) != 0 || S_ISREG(st.st_mode);
}

bool bb_path_is_same(const char *a, const char *b)
{
	struct stat x, y;

	return stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

bool bb_path_is_tame(const char *path)
{
	if (!*path || *path == '/')
		return false;
	for (const char *p = path; *p;) {
		const size_t n = strcspn(p, "/");
		if (n == 2 && p[0] == '.' && p[1] == '.')
			return false;
		p += n;
		p += strspn(p, "/");
	}
	return true;
}

void bb_path_settle(char *name, size_t cap, const char *configuration)
{
	char folder[PATH_MAX], path[PATH_MAX];

	if (!*name || access(name, F_OK) == 0 || snprintf(folder, sizeof(folder), "%s", configuration) >= PATH_MAX)
		return;
	for (int up = 0; up < 2; up++) {
		char *slash = strrchr(folder, '/');
		if (!slash || slash == folder)
			return;
		*slash = '\0';
		const int n = snprintf(path, sizeof(path), "%s/%s", folder, name);
		if (n >= (int)cap || n >= PATH_MAX || access(path, F_OK))
			continue;
		memcpy(name, path, (size_t)n + 1);
		return;
	}
}
