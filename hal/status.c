#include "hal/status.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

const char *bb_status_text(enum bb_status status)
{
	switch (status) {
#define X(name, value, text)                                                                                          \
	case name:                                                                                                    \
		return text;
		BB_STATUS_LIST(X)
#undef X
	}
	return "unknown status";
}

static const struct bb_error_entry catalogue[] = {
#define X(number, title, cause, remedy) { number, title, cause, remedy },
#include "hal/errors.def"
#undef X
};

const struct bb_error_entry *bb_error_catalogue(size_t i)
{
	return i < BB_ARRAY_LEN(catalogue) ? &catalogue[i] : NULL;
}

static const struct bb_error_entry *entry_of(int number)
{
	static const struct bb_error_entry unknown = { 0, "error", "a bug in blackburst", "please report it" };

	for (size_t i = 0; i < BB_ARRAY_LEN(catalogue); i++)
		if (catalogue[i].number == number)
			return &catalogue[i];
	return &unknown;
}

/* Control bytes of hostile input must not reach a terminal: shown as \xNN. Returns the length written. */
static size_t put_clean(char *out, size_t cap, const char *text)
{
	size_t n = 0;

	for (; *text && n + 5 < cap; text++) {
		const unsigned char c = (unsigned char)*text;
		if (c < 0x20 || c == 0x7F)
			n += (size_t)snprintf(out + n, cap - n, "\\x%02X", c);
		else
			out[n++] = *text;
	}
	out[n] = '\0';
	return n;
}

enum bb_status bb_fail(struct bb_error *err, enum bb_status status, int number, const struct bb_where *where,
                       const char *fmt, ...)
{
	char what[256], place[200] = "";
	const struct bb_error_entry *e = entry_of(number);
	va_list ap;

	if (!err || err->number)
		return status;
	va_start(ap, fmt);
	vsnprintf(what, sizeof(what), fmt, ap);
	va_end(ap);
	if (where && where->file && where->line)
		snprintf(place, sizeof(place), ", %.150s:%d:%d", where->file, where->line, where->column ? where->column : 1);
	else if (where && where->file)
		snprintf(place, sizeof(place), ", %.180s", where->file);
	err->number = number;

	char line[sizeof(err->text)];
	snprintf(line, sizeof(line), "BB%04d: %s: %s%s; likely cause: %s; next: %s", number, e->title, what, place,
	         e->cause, e->remedy);
	put_clean(err->text, sizeof(err->text), line);
	return status;
}
