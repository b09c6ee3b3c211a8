/* drivers/vcp_capabilities.c: see drivers/vcp_capabilities.h; MCCS 2.2 section 7 (access bus capabilities). */
#include "drivers/vcp_capabilities.h"

#include <string.h>

struct reader {
	const char *at, *end;
	struct vcp_capabilities *out;
	size_t n_found; /* keywords and codes */
};

static bool is_word(char c)
{
	return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_';
}

static int hex_digit(char c)
{
	if (c >= '0' && c <= '9')
		return c - '0';
	if (c >= 'A' && c <= 'F')
		return c - 'A' + 10;
	if (c >= 'a' && c <= 'f')
		return c - 'a' + 10;
	return -1;
}

static void skip_blanks(struct reader *r)
{
	while (r->at < r->end && (*r->at == ' ' || *r->at == '\t' || *r->at == '\r' || *r->at == '\n' || !*r->at))
		r->at++;
}

static bool next_is(struct reader *r, char c)
{
	skip_blanks(r);
	return r->at < r->end && *r->at == c;
}

static size_t word_length(const struct reader *r)
{
	size_t n = 0;

	while (r->at + n < r->end && is_word(r->at[n]))
		n++;
	return n;
}

/* A word with something other than hexadecimal in it, and a bracket after it: the next keyword, so a ')' is missing. */
static bool at_keyword(const struct reader *r)
{
	const size_t n = word_length(r);
	bool hex = true;

	for (size_t i = 0; i < n; i++)
		hex &= hex_digit(r->at[i]) >= 0;
	return n && !hex && r->at + n < r->end && r->at[n] == '(';
}

/* One byte of one or two digits; longer words are bytes written without blanks. */
static bool take_byte(struct reader *r, uint8_t *out)
{
	const int high = r->at < r->end ? hex_digit(*r->at) : -1;

	if (high < 0)
		return false;
	r->at++;
	const int low = r->at < r->end ? hex_digit(*r->at) : -1;
	if (low >= 0)
		r->at++;
	*out = (uint8_t)(low >= 0 ? high << 4 | low : high);
	return true;
}

static void take_values(struct reader *r, uint8_t code)
{
	struct vcp_capability *c = &r->out->code[code];

	c->first = (uint16_t)r->out->n_values;
	c->n = 0;
	for (;;) {
		uint8_t value;
		skip_blanks(r);
		if (r->at == r->end || at_keyword(r) || *r->at == '(') {
			r->out->unbalanced = true;
			return;
		}
		if (*r->at == ')') {
			r->at++;
			return;
		}
		if (!take_byte(r, &value)) {
			r->out->noise = true;
			r->at++;
		} else if (r->out->n_values < VCP_CAPABILITIES_VALUES) {
			r->out->value[r->out->n_values++] = value;
			c->n++;
		}
	}
}

static void take_code(struct reader *r, uint8_t code)
{
	struct vcp_capability *c = &r->out->code[code];

	r->n_found++;
	r->out->n_codes += !c->known;
	c->known = true;
	if (next_is(r, '(')) {
		r->at++;
		take_values(r, code);
	}
}

/* A list of bytes up to its bracket; codes of vcp() may have lists of their own. */
static void take_list(struct reader *r, bool vcp)
{
	for (;;) {
		uint8_t byte;
		skip_blanks(r);
		if (r->at == r->end || at_keyword(r)) {
			r->out->unbalanced = true;
			return;
		}
		if (*r->at == ')') {
			r->at++;
			return;
		}
		if (!take_byte(r, &byte)) {
			r->out->noise = true;
			r->at++;
		} else if (vcp) {
			take_code(r, byte);
		} else {
			r->out->command[byte] = true;
			r->n_found++;
		}
	}
}

static void take_text(struct reader *r, char *out, size_t cap)
{
	size_t n = 0;

	while (r->at < r->end && *r->at != ')' && *r->at != '(') {
		if (n + 1 < cap && *r->at >= 0x20 && *r->at < 0x7F)
			out[n++] = *r->at;
		r->at++;
	}
	out[n] = '\0';
	r->out->unbalanced |= r->at == r->end || *r->at == '(';
	r->at += r->at < r->end && *r->at == ')';
}

static void take_version(struct reader *r)
{
	char text[8] = "";

	take_text(r, text, sizeof(text));
	for (size_t i = 1; text[i]; i++)
		if (text[i] == '.' && text[i - 1] >= '0' && text[i - 1] <= '9' && text[i + 1] >= '0' &&
		    text[i + 1] <= '9') {
			r->out->mccs_major = (uint8_t)(text[i - 1] - '0');
			r->out->mccs_minor = (uint8_t)(text[i + 1] - '0');
			return;
		}
	r->out->noise = true;
}

static void skip_list(struct reader *r)
{
	size_t depth = 1;

	while (r->at < r->end && depth) {
		depth += *r->at == '(';
		depth -= *r->at == ')';
		r->at++;
	}
	r->out->unbalanced |= depth > 0;
}

static bool is(const char *word, size_t n, const char *name)
{
	return strlen(name) == n && !memcmp(word, name, n);
}

static void take_keyword(struct reader *r, const char *word, size_t n)
{
	struct vcp_capabilities *c = r->out;

	if (is(word, n, "vcp") || is(word, n, "VCP"))
		take_list(r, true);
	else if (is(word, n, "cmds"))
		take_list(r, false);
	else if (is(word, n, "prot"))
		take_text(r, c->prot, sizeof(c->prot));
	else if (is(word, n, "type"))
		take_text(r, c->type, sizeof(c->type));
	else if (is(word, n, "model"))
		take_text(r, c->model, sizeof(c->model));
	else if (is(word, n, "mccs_ver"))
		take_version(r);
	else
		skip_list(r);
	r->n_found++;
}

/* Depth of the outer bracket: real strings have it, lack it, or close it too early. */
static void walk(struct reader *r)
{
	long depth = 0;

	while (skip_blanks(r), r->at < r->end) {
		const char *word = r->at;
		const size_t n = word_length(r);
		r->at += n;
		if (n && next_is(r, '(')) {
			r->at++;
			take_keyword(r, word, n);
		} else if (!n) {
			depth += *r->at == '(';
			depth -= *r->at == ')';
			r->out->noise |= *r->at != '(' && *r->at != ')';
			r->at++;
		} else {
			r->out->noise = true;
		}
	}
	r->out->unbalanced |= depth != 0;
}

enum bb_status vcp_capabilities_parse(const char *text, size_t n, struct vcp_capabilities *out)
{
	struct reader r = { text, text + n, out, 0 };

	memset(out, 0, sizeof(*out));
	walk(&r);
	return r.n_found ? BB_OK : BB_ERR_FORMAT;
}

bool vcp_capabilities_allow(const struct vcp_capabilities *c, uint8_t code, uint8_t value)
{
	const struct vcp_capability *row = &c->code[code];

	for (size_t i = 0; i < row->n; i++)
		if (c->value[row->first + i] == value)
			return true;
	return row->known && !row->n;
}
