/* sync/calibrate/sequence_line.c: one line of a wand sequence taken apart; see sequence.h. */
#include "sync/calibrate/sequence.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_PX 65536.0
#define MOST_S 1e6
#define MOST_MM 1e5

struct cursor {
	const char *at, *end;
};

/* The next word, NUL-terminated in out[cap]; 0 at the end, -1 when it does not fit or is no text. */
static int word(struct cursor *c, char *out, size_t cap)
{
	size_t n = 0;

	out[0] = 0;
	while (c->at < c->end && (*c->at == ' ' || *c->at == '\t' || *c->at == '\r'))
		c->at++;
	for (; c->at < c->end && *c->at != ' ' && *c->at != '\t' && *c->at != '\r'; c->at++) {
		if (n + 1 >= cap || (unsigned char)*c->at < ' ')
			return -1;
		out[n++] = *c->at;
	}
	out[n] = 0;
	return n > 0;
}

/* A plain decimal within +-most; 0 at the end of the line, -1 when it is none. */
static int number(struct cursor *c, double most, double *out)
{
	char text[40], *end;
	const int found = word(c, text, sizeof(text));

	if (found <= 0)
		return found;
	if (text[strspn(text, "0123456789+-.eE")])
		return -1;
	*out = strtod(text, &end);
	return !*end && fabs(*out) <= most ? 1 : -1; /* false for NaN, and infinity is above most */
}

static const char *numbers(struct cursor *c, size_t n, struct bb_sequence_line *out)
{
	double more;

	for (size_t i = 0; i < n; i++) {
		out->number[i] = 0;
		if (number(c, MOST_MM, &out->number[i]) != 1)
			return n == 3 ? "three numbers in mm wanted" : "twelve numbers in mm wanted";
		out->number[i] *= 1e-3;
	}
	return number(c, MOST_MM, &more) ? "more numbers than wanted" : NULL;
}

static const char *sight(struct cursor *c, double t_s, struct bb_sequence_line *out)
{
	double x = 0, y = 0;
	int found;

	out->kind = BB_SEQUENCE_SIGHT;
	if (!(t_s >= 0))
		return "a time below 0";
	out->t_ns = llround(t_s * 1e9);
	if (word(c, out->id, sizeof(out->id)) != 1)
		return "a camera's id wanted after the time";
	while ((found = number(c, MOST_PX, &x)) == 1) {
		if (number(c, MOST_PX, &y) != 1)
			return "an x without a y";
		if (out->n == BB_SEQUENCE_BLOBS_MAX)
			return "more than 32 blobs";
		out->px[out->n][0] = (float)x;
		out->px[out->n++][1] = (float)y;
	}
	return found ? "not a number of pixels" : NULL;
}

const char *bb_sequence_line(const char *text, size_t n, struct bb_sequence_line *out)
{
	struct cursor c = { text, text + n }, again = c;
	char key[BB_ID_MAX], extra[BB_ID_MAX];
	double t_s = 0;

	out->kind = BB_SEQUENCE_NOTHING;
	out->n = 0;
	const int found = word(&c, key, sizeof(key));
	if (!found || key[0] == '#' || (n && text[0] == '#'))
		return NULL;
	if (found < 0)
		return "a word too long, or no text";
	if (!strcmp(key, "wand_mm")) {
		out->kind = BB_SEQUENCE_WAND;
		return numbers(&c, 3, out);
	}
	if (!strcmp(key, "square_mm")) {
		out->kind = BB_SEQUENCE_SQUARE;
		return numbers(&c, 12, out);
	}
	if (!strcmp(key, "camera") || !strcmp(key, "part")) {
		if (word(&c, out->id, sizeof(out->id)) != 1 || word(&c, extra, sizeof(extra)))
			return "one word wanted";
		out->kind = key[0] == 'c' ? BB_SEQUENCE_CAMERA :
		            !strcmp(out->id, "square") ? BB_SEQUENCE_PART_SQUARE : BB_SEQUENCE_PART_WAND;
		return key[0] == 'c' || !strcmp(out->id, "square") || !strcmp(out->id, "wand") ? NULL : "square or wand wanted";
	}
	if (number(&again, MOST_S, &t_s) != 1)
		return "neither a key nor a time in seconds";
	return sight(&again, t_s, out);
}
