#include "hal/uri.h"

#include <string.h>

struct span {
	const char *at;
	size_t n;
};

static bool copy(struct span s, char *out, size_t cap)
{
	if (s.n >= cap)
		return false;
	memcpy(out, s.at, s.n);
	out[s.n] = '\0';
	return true;
}

static bool all_of(struct span s, const char *legal)
{
	for (size_t i = 0; i < s.n; i++)
		if (!s.at[i] || !strchr(legal, s.at[i]))
			return false;
	return s.n > 0;
}

static enum bb_status bad(const char *text, const char *why, const struct bb_where *where, struct bb_error *err)
{
	return bb_fail(err, BB_ERR_CONFIG, 1501, where, "'%.80s': %s", text, why);
}

static const char *add_option(struct bb_uri *u, struct span item)
{
	const char *equals = memchr(item.at, '=', item.n);
	struct span key = { item.at, equals ? (size_t)(equals - item.at) : item.n };
	struct span value = { equals ? equals + 1 : item.at, equals ? item.n - key.n - 1 : 0 };

	if (!equals)
		return "an option is key=value";
	if (u->n_options == BB_URI_OPTIONS_MAX)
		return "too many options";
	if (!all_of(key, "abcdefghijklmnopqrstuvwxyz0123456789_"))
		return "an option's name has a-z, 0-9 and _";
	if (!copy(key, u->option[u->n_options].key, sizeof(u->option[0].key)))
		return "an option's name is too long";
	if (!copy(value, u->option[u->n_options].value, sizeof(u->option[0].value)))
		return "an option's value is too long";
	for (size_t i = 0; i < u->n_options; i++)
		if (!strcmp(u->option[i].key, u->option[u->n_options].key))
			return "an option is given twice";
	u->n_options++;
	return NULL;
}

static const char *parse(struct bb_uri *u, const char *text)
{
	const size_t n = strlen(text), n_scheme = strcspn(text, ":");
	const size_t n_path = n_scheme < n ? strcspn(text + n_scheme + 1, "?") : 0;
	const char *query = text + n_scheme + 1 + n_path;

	for (const char *c = text; *c; c++)
		if ((unsigned char)*c <= 0x20 || (unsigned char)*c >= 0x7F)
			return "only printable ASCII without blanks";
	if (n_scheme == n)
		return "no ':' after the back end's name";
	if (!all_of((struct span){ text, n_scheme }, "abcdefghijklmnopqrstuvwxyz0123456789") ||
	    !copy((struct span){ text, n_scheme }, u->scheme, sizeof(u->scheme)))
		return "the back end's name has 1 to 15 of a-z and 0-9";
	if (!copy((struct span){ text + n_scheme + 1, n_path }, u->path, sizeof(u->path)))
		return "the path is too long";
	if (!*query)
		return NULL;
	do { /* "?a=1&b=2": each round begins at the separator */
		const struct span item = { query + 1, strcspn(query + 1, "&") };
		const char *why = add_option(u, item);
		if (why)
			return why;
		query = item.at + item.n;
	} while (*query);
	return NULL;
}

enum bb_status bb_uri_parse(const char *text, struct bb_uri *out, const struct bb_where *where, struct bb_error *err)
{
	const char *why;

	memset(out, 0, sizeof(*out));
	why = parse(out, text);
	if (!why)
		return BB_OK;
	memset(out, 0, sizeof(*out));
	return bad(text, why, where, err);
}
