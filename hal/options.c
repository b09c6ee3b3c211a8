#include "hal/options.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WORD_MAX_BYTES 48

/* Levenshtein's distance; words beyond WORD_MAX_BYTES count as far away. */
static size_t edit_distance(const char *a, const char *b)
{
	const size_t na = strlen(a), nb = strlen(b);
	size_t row[WORD_MAX_BYTES + 1];

	if (na > WORD_MAX_BYTES || nb > WORD_MAX_BYTES)
		return SIZE_MAX;
	for (size_t j = 0; j <= nb; j++)
		row[j] = j;
	for (size_t i = 1; i <= na; i++) {
		size_t diagonal = row[0];
		row[0] = i;
		for (size_t j = 1; j <= nb; j++) {
			const size_t swap = diagonal + (a[i - 1] != b[j - 1]);
			const size_t least = row[j] < row[j - 1] ? row[j] + 1 : row[j - 1] + 1;
			diagonal = row[j];
			row[j] = swap < least ? swap : least;
		}
	}
	return row[nb];
}

const char *bb_nearer(const char *asked, const char *word, const char *best, size_t *distance)
{
	const size_t d = edit_distance(asked, word);

	if (d >= *distance)
		return best;
	*distance = d;
	return word;
}

static void *member_of(const struct bb_option *o, void *target)
{
	return (char *)target + o->offset;
}

/* Index of a word in "dlp|lcd|led"; -1 when it is none of them. */
static int word_index(const char *words, const char *value)
{
	const size_t n = strlen(value);
	int index = 0;

	for (const char *w = words; w; index++) {
		const size_t len = strcspn(w, "|");
		if (len == n && !memcmp(w, value, n))
			return index;
		w = w[len] ? w + len + 1 : NULL;
	}
	return -1;
}

void bb_options_defaults(const struct bb_option *table, void *target)
{
	for (const struct bb_option *o = table; o->name; o++) {
		void *member = member_of(o, target);
		switch (o->type) {
		case BB_OPT_TYPE_I64:
			*(int64_t *)member = (int64_t)llround(o->fallback * o->scale);
			break;
		case BB_OPT_TYPE_F64:
			*(double *)member = o->fallback * o->scale;
			break;
		case BB_OPT_TYPE_BOOL:
			*(bool *)member = o->fallback != 0;
			break;
		case BB_OPT_TYPE_ENUM:
			*(int *)member = (int)o->fallback;
			break;
		case BB_OPT_TYPE_TEXT:
			snprintf(member, o->size, "%s", o->words ? o->words : "");
			break;
		}
	}
}

static enum bb_status bad_value(const struct bb_option *o, const char *value, const char *wanted,
                                const struct bb_where *where, struct bb_error *err)
{
	return bb_fail(err, BB_ERR_CONFIG, 1012, where, "%s: '%.60s' is not %s", o->name, value, wanted);
}

static enum bb_status out_of_range(const struct bb_option *o, const char *value, const struct bb_where *where,
                                   struct bb_error *err)
{
	return bb_fail(err, BB_ERR_CONFIG, 1013, where, "%s: %.60s is not within %g .. %g", o->name, value, o->least,
	               o->most);
}

/* Decimal or 0x; a leading zero does not make a number octal. */
static enum bb_status set_i64(const struct bb_option *o, int64_t *member, const char *value,
                              const struct bb_where *where, struct bb_error *err)
{
	const char *digits = *value == '-' || *value == '+' ? value + 1 : value;
	const bool hex = digits[0] == '0' && (digits[1] == 'x' || digits[1] == 'X');
	const char *legal = hex ? "0123456789abcdefABCDEF" : "0123456789";
	long long v;

	digits += hex ? 2 : 0;
	if (!*digits || digits[strspn(digits, legal)])
		return bad_value(o, value, "a whole number", where, err);
	errno = 0;
	v = strtoll(value, NULL, hex ? 16 : 10);
	if (errno == ERANGE || !((double)v >= o->least && (double)v <= o->most))
		return out_of_range(o, value, where, err);
	*member = o->scale == 1 ? (int64_t)v : (int64_t)llround((double)v * o->scale);
	return BB_OK;
}

/* The characters are checked first: strtod alone would take "nan", "inf" and hexadecimal. */
static enum bb_status set_f64(const struct bb_option *o, double *member, const char *value,
                              const struct bb_where *where, struct bb_error *err)
{
	char *end;
	double v;

	if (!*value || value[strspn(value, "0123456789+-.eE")])
		return bad_value(o, value, "a finite number", where, err);
	v = strtod(value, &end);
	if (end == value || *end || !isfinite(v))
		return bad_value(o, value, "a finite number", where, err);
	if (!(v >= o->least && v <= o->most))
		return out_of_range(o, value, where, err);
	*member = v * o->scale;
	return BB_OK;
}

static enum bb_status set_text(const struct bb_option *o, char *member, const char *value,
                               const struct bb_where *where, struct bb_error *err)
{
	const size_t n = strlen(value);

	if (n >= o->size || (double)n < o->least)
		return bb_fail(err, BB_ERR_CONFIG, 1013, where, "%s has %zu bytes, wanted %g .. %zu", o->name, n,
		               fmax(o->least, 0), o->size - 1);
	for (const char *c = value; *c; c++)
		if ((unsigned char)*c < 0x20 || *c == 0x7F)
			return bad_value(o, value, "one line of text", where, err);
	memcpy(member, value, n + 1);
	return BB_OK;
}

static enum bb_status set_bool(const struct bb_option *o, bool *member, const char *value,
                               const struct bb_where *where, struct bb_error *err)
{
	if (strcmp(value, "true") && strcmp(value, "false"))
		return bad_value(o, value, "true or false", where, err);
	*member = *value == 't';
	return BB_OK;
}

static enum bb_status set_enum(const struct bb_option *o, int *member, const char *value,
                               const struct bb_where *where, struct bb_error *err)
{
	const int index = word_index(o->words, value);

	if (index < 0)
		return bad_value(o, value, o->words, where, err);
	*member = index;
	return BB_OK;
}

static enum bb_status unknown_option(const struct bb_option *table, const char *key, const struct bb_where *where,
                                     struct bb_error *err)
{
	const char *best = NULL;
	size_t distance = strlen(key) / 2 + 1;

	for (const struct bb_option *o = table; o->name; o++)
		best = bb_nearer(key, o->name, best, &distance);
	if (best)
		return bb_fail(err, BB_ERR_CONFIG, 1011, where, "'%.48s', did you mean '%s'?", key, best);
	return bb_fail(err, BB_ERR_CONFIG, 1011, where, "'%.48s'", key);
}

enum bb_status bb_options_set(const struct bb_option *table, void *target, const char *key, const char *value,
                              const struct bb_where *where, struct bb_error *err)
{
	const struct bb_option *o = table;

	while (o->name && strcmp(o->name, key))
		o++;
	if (!o->name)
		return unknown_option(table, key, where, err);
	switch (o->type) {
	case BB_OPT_TYPE_I64:
		return set_i64(o, member_of(o, target), value, where, err);
	case BB_OPT_TYPE_F64:
		return set_f64(o, member_of(o, target), value, where, err);
	case BB_OPT_TYPE_BOOL:
		return set_bool(o, member_of(o, target), value, where, err);
	case BB_OPT_TYPE_TEXT:
		return set_text(o, member_of(o, target), value, where, err);
	case BB_OPT_TYPE_ENUM:
		return set_enum(o, member_of(o, target), value, where, err);
	}
	return BB_ERR_INTERNAL;
}

static void dump_one(const struct bb_option *o, const void *member, char *buf, size_t cap)
{
	const char *word = o->words;

	switch (o->type) {
	case BB_OPT_TYPE_I64:
		if (o->scale == 1)
			snprintf(buf, cap, "%" PRId64, *(const int64_t *)member);
		else
			snprintf(buf, cap, "%.10g", (double)*(const int64_t *)member / o->scale);
		break;
	case BB_OPT_TYPE_F64:
		snprintf(buf, cap, "%.10g", *(const double *)member / o->scale);
		break;
	case BB_OPT_TYPE_BOOL:
		snprintf(buf, cap, "%s", *(const bool *)member ? "true" : "false");
		break;
	case BB_OPT_TYPE_TEXT:
		snprintf(buf, cap, "%s", (const char *)member);
		break;
	case BB_OPT_TYPE_ENUM:
		for (int i = *(const int *)member; i > 0 && word; i--) {
			word = strchr(word, '|');
			word = word ? word + 1 : NULL;
		}
		snprintf(buf, cap, "%.*s", word ? (int)strcspn(word, "|") : 0, word ? word : "");
		break;
	}
}

void bb_options_dump(const struct bb_option *table, const void *target, char *buf, size_t cap)
{
	size_t used = 0;

	if (!cap)
		return;
	*buf = '\0';
	for (const struct bb_option *o = table; o->name && used + 1 < cap; o++) {
		char value[192];
		int n;

		dump_one(o, (const char *)target + o->offset, value, sizeof(value));
		n = snprintf(buf + used, cap - used, "%s%s=%s", used ? " " : "", o->name, value);
		used += n > 0 ? (size_t)n : 0;
	}
}
