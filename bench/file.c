/*
 * bench/file.c: write beside, sync, rename; escape everything. No global state; the umask decides who may read.
 */
#include "bench/file.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum bb_status write_failed(const struct bb_file *f, struct bb_error *err, const char *what)
{
	const struct bb_where where = { f->path, 0, 0 };

	return bb_fail(err, BB_ERR_IO, 1901, &where, "%s: %s", what, strerror(errno));
}

enum bb_status bb_file_begin(struct bb_file *f, const char *path, struct bb_error *err)
{
	int fd;

	*f = (struct bb_file){ 0 };
	if ((size_t)snprintf(f->path, sizeof(f->path), "%s", path) >= sizeof(f->path)) {
		errno = ENAMETOOLONG;
		return write_failed(f, err, "open");
	}
	if (!*path) {
		errno = ENOENT;
		return write_failed(f, err, "open");
	}
	if (!bb_path_may_be_replaced(path)) {
		errno = EEXIST;
		return write_failed(f, err, "no regular file");
	}
	snprintf(f->part, sizeof(f->part), "%s.%ld.part", f->path, (long)getpid());
	unlink(f->part); /* left by a process that was killed and had this number */
	fd = open(f->part, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
	if (fd < 0)
		return write_failed(f, err, "open");
	f->out = fdopen(fd, "w");
	if (f->out)
		return BB_OK;
	close(fd);
	unlink(f->part);
	return write_failed(f, err, "open");
}

/* The rename itself must survive a power cut. Some file systems refuse to sync a directory: then it is up to them. */
static void sync_folder(const char *path)
{
	char copy[BB_PATH_MAX_BYTES];
	int fd;

	snprintf(copy, sizeof(copy), "%s", path);
	fd = open(dirname(copy), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	if (fd < 0)
		return;
	(void)fsync(fd);
	close(fd);
}

enum bb_status bb_file_commit(struct bb_file *f, struct bb_error *err)
{
	const bool bad = ferror(f->out) || fflush(f->out) || fsync(fileno(f->out));
	enum bb_status st = bad ? write_failed(f, err, "write") : BB_OK;

	if (fclose(f->out) && st == BB_OK)
		st = write_failed(f, err, "close");
	f->out = NULL;
	if (st == BB_OK && rename(f->part, f->path))
		st = write_failed(f, err, "rename");
	if (st != BB_OK) {
		unlink(f->part);
		return st;
	}
	sync_folder(f->path);
	return BB_OK;
}

void bb_file_abort(struct bb_file *f)
{
	if (!f->out)
		return;
	fclose(f->out);
	f->out = NULL;
	unlink(f->part);
}

/* Bytes of the well-formed UTF-8 character at s (Unicode table 3-7: no overlong forms, no surrogates), 0 if none. */
static size_t utf8_length(const unsigned char *s)
{
	static const struct {
		unsigned char first, last, low, high;
		size_t n;
	} form[] = { { 0x01, 0x7F, 0, 0, 1 },       { 0xC2, 0xDF, 0x80, 0xBF, 2 }, { 0xE0, 0xE0, 0xA0, 0xBF, 3 },
		     { 0xE1, 0xEC, 0x80, 0xBF, 3 }, { 0xED, 0xED, 0x80, 0x9F, 3 }, { 0xEE, 0xEF, 0x80, 0xBF, 3 },
		     { 0xF0, 0xF0, 0x90, 0xBF, 4 }, { 0xF1, 0xF3, 0x80, 0xBF, 4 }, { 0xF4, 0xF4, 0x80, 0x8F, 4 } };

	for (size_t i = 0; i < BB_ARRAY_LEN(form); i++) {
		if (s[0] < form[i].first || s[0] > form[i].last)
			continue;
		if (form[i].n > 1 && (s[1] < form[i].low || s[1] > form[i].high))
			return 0;
		for (size_t k = 2; k < form[i].n; k++)
			if ((s[k] & 0xC0) != 0x80)
				return 0;
		return form[i].n;
	}
	return 0;
}

/* Characters a document may carry: no control bytes, none of the two non-characters XML forbids (U+FFFE, U+FFFF). */
static size_t plain_length(const unsigned char *s)
{
	const size_t n = utf8_length(s);

	if (n == 1 && (*s == 0x7F || (*s < 0x20 && *s != '\n' && *s != '\t')))
		return 0;
	if (n == 2 && s[0] == 0xC2 && s[1] < 0xA0)
		return 0;
	if (n == 3 && s[0] == 0xEF && s[1] == 0xBF && s[2] >= 0xBE)
		return 0;
	return n;
}

static const char *markup_entity(char c)
{
	switch (c) {
	case '<':
		return "&lt;";
	case '>':
		return "&gt;";
	case '&':
		return "&amp;";
	case '"':
		return "&quot;";
	case '\'':
		return "&#39;";
	}
	return NULL;
}

void bb_put_markup(FILE *out, const char *text)
{
	while (*text) {
		const size_t n = plain_length((const unsigned char *)text);
		const char *entity = markup_entity(*text);
		if (!n)
			fputs("\xEF\xBF\xBD", out);
		else if (entity)
			fputs(entity, out);
		else
			fwrite(text, 1, n, out);
		text += n ? n : 1;
	}
}

void bb_put_markupf(FILE *out, const char *fmt, ...)
{
	char text[1024];
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	bb_put_markup(out, text);
}

void bb_put_json(FILE *out, const char *text)
{
	fputc('"', out);
	while (*text) {
		const size_t n = plain_length((const unsigned char *)text);
		if (!n)
			fputs("\\ufffd", out);
		else if (*text == '"' || *text == '\\')
			fprintf(out, "\\%c", *text);
		else if (*text == '\n' || *text == '\t')
			fputs(*text == '\n' ? "\\n" : "\\t", out);
		else
			fwrite(text, 1, n, out);
		text += n ? n : 1;
	}
	fputc('"', out);
}

void bb_put_csv(FILE *out, const char *text)
{
	const bool formula = *text && strchr("=+-@\t\r", *text);

	fputc('"', out);
	if (formula)
		fputc('\'', out);
	while (*text) {
		const size_t n = plain_length((const unsigned char *)text);
		if (!n || *text == '\n')
			fputc('?', out);
		else if (*text == '"')
			fputs("\"\"", out);
		else
			fwrite(text, 1, n, out);
		text += n ? n : 1;
	}
	fputc('"', out);
}

void bb_put_base64(FILE *out, const unsigned char *bytes, size_t n)
{
	static const char digit[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

	for (size_t i = 0; i < n; i += 3) {
		const uint32_t left = (uint32_t)(n - i);
		const uint32_t v = (uint32_t)bytes[i] << 16 | (left > 1 ? (uint32_t)bytes[i + 1] << 8 : 0) |
		                   (left > 2 ? bytes[i + 2] : 0);
		fputc(digit[v >> 18], out);
		fputc(digit[v >> 12 & 63], out);
		fputc(left > 1 ? digit[v >> 6 & 63] : '=', out);
		fputc(left > 2 ? digit[v & 63] : '=', out);
	}
}

void bb_text_clean(char *out, size_t cap, const char *text)
{
	size_t used = 0;

	while (*text) {
		size_t n = plain_length((const unsigned char *)text);
		const bool bad = !n || *text == '\n' || *text == '\t';
		if (used + (bad ? 1 : n) + 1 > cap)
			break;
		if (bad)
			out[used++] = '?';
		else
			memcpy(out + used, text, n);
		used += bad ? 0 : n;
		text += n ? n : 1;
	}
	if (cap)
		out[used] = '\0';
}

void bb_text_format(char *out, size_t cap, const char *fmt, ...)
{
	va_list ap;

	va_start(ap, fmt);
	vsnprintf(out, cap, fmt, ap);
	va_end(ap);
}

const char *bb_text_number(char *out, size_t cap, double v)
{
	if (isnan(v))
		snprintf(out, cap, "n/a");
	else if (fabs(v) >= 9999.5 && fabs(v) < 1e15)
		snprintf(out, cap, "%.0f", v);
	else
		snprintf(out, cap, "%.4g", v);
	return out;
}
