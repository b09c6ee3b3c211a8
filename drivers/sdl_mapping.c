/* drivers/sdl_mapping.c: see drivers/sdl_mapping.h. */
#include "drivers/sdl_mapping.h"

#include <string.h>

#define LINE_BYTES_MAX 4096
#define INDEX_MOST 127

struct piece { /* of a line: not terminated */
	const char *at;
	size_t n;
};

static bool is(struct piece p, const char *word)
{
	return p.n == strlen(word) && !memcmp(p.at, word, p.n);
}

/* What stands before the next comma; the line goes on behind it. */
static struct piece cut(struct piece *line, char end)
{
	const char *comma = line->n ? memchr(line->at, end, line->n) : NULL;
	const struct piece out = { line->at, comma ? (size_t)(comma - line->at) : line->n };
	const size_t used = out.n + (comma != NULL);

	line->at += used;
	line->n -= used;
	return out;
}

static int hex_digit(char c)
{
	if (c >= '0' && c <= '9')
		return c - '0';
	if (c >= 'a' && c <= 'f')
		return c - 'a' + 10;
	return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

static bool read_guid(struct piece text, uint8_t out[16])
{
	if (text.n != 32)
		return false;
	for (size_t i = 0; i < 16; i++) {
		const int high = hex_digit(text.at[2 * i]), low = hex_digit(text.at[2 * i + 1]);
		if (high < 0 || low < 0)
			return false;
		out[i] = (uint8_t)(high << 4 | low);
	}
	return true;
}

void bb_sdl_guid(const struct bb_input_identity *id, uint8_t out[16])
{
	const uint16_t words[8] = { id->bus, 0, id->vendor, 0, id->product, 0, id->version, 0 };

	for (size_t i = 0; i < 8; i++) {
		out[2 * i] = (uint8_t)words[i];
		out[2 * i + 1] = (uint8_t)(words[i] >> 8);
	}
}

/* A whole number that ends where the piece does or at `stop`. */
static bool whole(struct piece *p, uint8_t *out)
{
	unsigned int v = 0;
	size_t i = 0;

	for (; i < p->n && i < 4 && p->at[i] >= '0' && p->at[i] <= '9'; i++)
		v = v * 10 + (unsigned int)(p->at[i] - '0');
	if (!i || v > INDEX_MOST)
		return false;
	p->at += i;
	p->n -= i;
	*out = (uint8_t)v;
	return true;
}

static int sign(struct piece *p)
{
	const int half = p->n && *p->at == '+' ? 1 : p->n && *p->at == '-' ? -1 : 0;

	if (half) {
		p->at++;
		p->n--;
	}
	return half;
}

static bool hat_source(struct piece *p, struct bb_sdl_binding *b)
{
	if (!whole(p, &b->index) || !p->n || *p->at != '.')
		return false;
	p->at++;
	p->n--;
	return whole(p, &b->hat_bit) && (b->hat_bit == 1 || b->hat_bit == 2 || b->hat_bit == 4 || b->hat_bit == 8);
}

static bool read_source(struct piece p, struct bb_sdl_binding *b)
{
	b->half = sign(&p);
	if (!p.n)
		return false;
	const char kind = *p.at;
	p.at++;
	p.n--;
	b->source = kind == 'a' ? BB_SDL_FROM_AXIS : kind == 'h' ? BB_SDL_FROM_HAT : BB_SDL_FROM_BUTTON;
	if (kind == 'h' ? !hat_source(&p, b) : !whole(&p, &b->index))
		return false;
	if (p.n && *p.at == '~' && kind == 'a') {
		b->turned = true;
		p.at++;
		p.n--;
	}
	return !p.n && (kind == 'a' || ((kind == 'b' || kind == 'h') && !b->half));
}

static bool read_target(struct piece p, struct bb_sdl_binding *b)
{
	static const char *const names[BB_SDL_TARGETS] = {
		"a",       "b",     "x",         "y",          "leftshoulder", "rightshoulder", "back",
		"start",   "guide", "leftstick", "rightstick", "dpup",         "dpdown",        "dpleft",
		"dpright", "leftx", "lefty",     "rightx",     "righty",       "lefttrigger",   "righttrigger",
	};
	b->target_half = sign(&p);
	for (unsigned int i = 0; i < BB_SDL_TARGETS; i++)
		if (is(p, names[i])) {
			b->target = (enum bb_sdl_target)i;
			return true;
		}
	return false;
}

static enum bb_status add_pair(struct piece pair, const struct bb_where *where, struct bb_sdl_mapping *out,
			       struct bb_error *err)
{
	struct bb_sdl_binding b = { 0 };
	struct piece rest = pair;
	const struct piece target = cut(&rest, ':');

	if (target.n == pair.n)
		return bb_fail(err, BB_ERR_CONFIG, 1564, where, "'%.*s' is no target:source",
			       (int)(pair.n < 40 ? pair.n : 40), pair.at);
	if (!read_target(target, &b)) /* newer ones: misc1, paddles, touchpad, hints */
		return BB_OK;
	if (!read_source(rest, &b))
		return bb_fail(err, BB_ERR_CONFIG, 1564, where, "'%.*s' is no source", (int)(rest.n < 40 ? rest.n : 40),
			       rest.at);
	if (out->n == BB_SDL_BINDINGS_MAX)
		return bb_fail(err, BB_ERR_CONFIG, 1564, where, "more than %d bindings", BB_SDL_BINDINGS_MAX);
	out->binding[out->n++] = b;
	return BB_OK;
}

static struct piece trimmed(const char *line, size_t n)
{
	while (n && (line[n - 1] == '\r' || line[n - 1] == '\n' || line[n - 1] == ' '))
		n--;
	return (struct piece){ line, n };
}

static void keep_name(struct piece name, char *out, size_t cap)
{
	size_t n = 0;

	for (; n < name.n && n + 1 < cap; n++)
		out[n] = name.at[n] >= ' ' && name.at[n] < 127 ? name.at[n] : '?';
	out[n] = '\0';
}

enum bb_status bb_sdl_mapping_parse(const char *line, size_t n, const struct bb_where *where,
				    struct bb_sdl_mapping *out, struct bb_error *err)
{
	struct piece rest = trimmed(line, n);
	enum bb_status status = BB_OK;

	memset(out, 0, sizeof(*out));
	if (!rest.n || *rest.at == '#')
		return BB_SKIPPED;
	if (rest.n > LINE_BYTES_MAX)
		return bb_fail(err, BB_ERR_CONFIG, 1564, where, "a line of more than %d bytes", LINE_BYTES_MAX);
	if (!read_guid(cut(&rest, ','), out->guid))
		return bb_fail(err, BB_ERR_CONFIG, 1564, where, "a GUID has 32 hexadecimal digits");
	keep_name(cut(&rest, ','), out->name, sizeof(out->name));
	while (rest.n && status == BB_OK) {
		const struct piece pair = cut(&rest, ',');
		if (pair.n > 9 && !memcmp(pair.at, "platform:", 9)) {
			if (!is((struct piece){ pair.at + 9, pair.n - 9 }, "Linux"))
				return BB_SKIPPED;
		} else if (pair.n) {
			status = add_pair(pair, where, out, err);
		}
	}
	return status;
}

/* 2: the very device; 1: another version of it; 0: another device. Bytes 2 and 3 may hold a checksum of its name. */
static int same_device(const uint8_t a[16], const uint8_t b[16])
{
	if (memcmp(a, b, 2) || memcmp(a + 4, b + 4, 8))
		return 0;
	return memcmp(a + 12, b + 12, 4) ? 1 : 2;
}

enum bb_status bb_sdl_mapping_find(const char *text, size_t n, const char *file, const struct bb_input_identity *id,
				   struct bb_sdl_mapping *out, struct bb_error *err)
{
	struct bb_where where = { .file = file };
	struct piece rest = { text, n };
	struct bb_sdl_mapping found;
	uint8_t wanted[16], guid[16];
	int best = 0;

	bb_sdl_guid(id, wanted);
	while (rest.n && best < 2) {
		const struct piece line = cut(&rest, '\n');
		struct piece copy = line;
		where.line++;
		const int fits = read_guid(cut(&copy, ','), guid) ? same_device(guid, wanted) : 0;
		if (fits <= best)
			continue;
		const enum bb_status status = bb_sdl_mapping_parse(line.at, line.n, &where, &found, err);
		if (status < 0)
			return status;
		if (status != BB_OK)
			continue;
		best = fits;
		*out = found;
	}
	if (best)
		return BB_OK;
	where.line = 0;
	return bb_fail(err, BB_ERR_CONFIG, 1565, &where,
		       "%04x:%04x, GUID %02x%02x0000%02x%02x0000%02x%02x0000%02x%02x0000", id->vendor, id->product,
		       wanted[0], wanted[1], wanted[4], wanted[5], wanted[8], wanted[9], wanted[12], wanted[13]);
}
