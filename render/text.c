#include "render/text.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define FILE_MOST_BYTES ((size_t)1 << 20)

/* Grows with what is really there: a pipe or a file in /proc has no size to trust. */
static enum bb_status read_all(int fd, struct bb_text *out, size_t *n_out, struct bb_error *err)
{
	size_t n = 0, cap = 4096;
	char *bytes = malloc(cap);

	while (bytes) {
		const ssize_t got = read(fd, bytes + n, cap - 1 - n);
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0) {
			free(bytes);
			return bb_fail(err, BB_ERR_IO, 1002, &out->where, "%s", strerror(errno));
		}
		if (!got) {
			bytes[n] = '\0';
			out->bytes = out->next = bytes;
			*n_out = n;
			return BB_OK;
		}
		n += (size_t)got;
		if (n > FILE_MOST_BYTES) {
			free(bytes);
			return bb_fail(err, BB_ERR_CONFIG, 1003, &out->where, "more than 1 MiB");
		}
		if (n + 1 == cap) {
			char *more = realloc(bytes, cap *= 2);
			if (!more)
				free(bytes);
			bytes = more;
		}
	}
	return bb_fail(err, BB_ERR_NOMEM, 1702, &out->where, "text of %zu bytes", cap);
}

static bool is_text(const char *bytes, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		const unsigned char c = (unsigned char)bytes[i];
		if ((c < 0x20 && c != '\n' && c != '\r' && c != '\t') || c == 0x7F)
			return false;
	}
	return true;
}

enum bb_status bb_text_open(const char *path, int number_not_text, struct bb_text *out, struct bb_error *err)
{
	struct stat st;
	size_t n = 0;

	*out = (struct bb_text){ .where = { path, 0, 0 } };
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	if (fd < 0)
		return bb_fail(err, BB_ERR_CONFIG, 1001, &out->where, "%s", strerror(errno));
	if (fstat(fd, &st) || !S_ISREG(st.st_mode)) {
		close(fd);
		return bb_fail(err, BB_ERR_CONFIG, 1001, &out->where, "not a regular file");
	}
	const enum bb_status status = read_all(fd, out, &n, err);
	close(fd);
	if (status)
		return status;
	if (is_text(out->bytes, n))
		return BB_OK;
	bb_text_release(out);
	return bb_fail(err, BB_ERR_FORMAT, number_not_text, &out->where, "it holds control bytes");
}

void bb_text_release(struct bb_text *text)
{
	free(text->bytes);
	text->bytes = text->next = NULL;
}

static bool is_blank(char c)
{
	return c == ' ' || c == '\t' || c == '\r';
}

char *bb_text_next(struct bb_text *text)
{
	while (text->next && *text->next) {
		char *line = text->next;
		char *end = line + strcspn(line, "\n");

		text->next = *end ? end + 1 : end;
		text->where.line++;
		*end = '\0';
		line[strcspn(line, "#")] = '\0';
		while (is_blank(*line))
			line++;
		for (end = line + strlen(line); end > line && is_blank(end[-1]); end--)
			end[-1] = '\0';
		if (*line)
			return line;
	}
	return NULL;
}

enum bb_text_word bb_text_read_number(char **cursor, double *out)
{
	char *word = *cursor;

	while (is_blank(*word))
		word++;
	const size_t n = strcspn(word, " \t\r");
	*cursor = word + n;
	if (!n)
		return BB_TEXT_END;
	if (strspn(word, "0123456789+-.eE") != n)
		return BB_TEXT_NOT_A_NUMBER;
	char *end;
	*out = strtod(word, &end);
	return end == word + n && isfinite(*out) ? BB_TEXT_NUMBER : BB_TEXT_NOT_A_NUMBER;
}
