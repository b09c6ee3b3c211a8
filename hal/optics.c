#include "hal/optics.h"

#include <stdio.h>
#include <string.h>

static const char *const patterns[BB_PATTERN_COUNT] = { "white-black", "black-white", "black-black", "white-white" };
static const char *const spots[BB_SPOT_COUNT] = { "top", "middle", "bottom", "tag", "lamp" };
static const char *const lenses[BB_LENS_COUNT] = { "bare", "left", "right" };

double bb_pattern_light(enum bb_pattern pattern, enum bb_eye eye)
{
	if (pattern == BB_PATTERN_WHITE_WHITE)
		return 1;
	return pattern == (eye == BB_EYE_RIGHT ? BB_PATTERN_BLACK_WHITE : BB_PATTERN_WHITE_BLACK);
}

/* x^5 + x^2 + 1, from all ones: a maximal sequence. Bit i of the word is cycle i. */
static uint32_t tag_sequence(void)
{
	uint32_t state = 31, word = 0;

	for (int i = 0; i < BB_TAG_CYCLES; i++) {
		word |= (state & 1) << i;
		state = state >> 1 | ((state ^ state >> 2) & 1) << 4;
	}
	return word;
}

double bb_tag_light(uint64_t cycle, enum bb_eye eye)
{
	return eye == BB_EYE_RIGHT ? 0.5 * (tag_sequence() >> cycle % BB_TAG_CYCLES & 1) : 1;
}

int bb_tag_place(unsigned bits)
{
	const uint32_t word = tag_sequence();

	for (int at = 0; at < BB_TAG_CYCLES; at++) {
		unsigned here = 0;
		for (int i = 0; i < BB_TAG_BITS; i++)
			here = here << 1 | (word >> (at + i) % BB_TAG_CYCLES & 1);
		if (here == bits)
			return at;
	}
	return -1;
}

static bool find(const char *const *names, size_t n, const char *text, size_t length, size_t *out)
{
	for (*out = 0; *out < n; ++*out)
		if (strlen(names[*out]) == length && !strncmp(names[*out], text, length))
			return true;
	return false;
}

const char *bb_pattern_text(enum bb_pattern pattern)
{
	return patterns[pattern];
}

bool bb_pattern_find(const char *text, enum bb_pattern *out)
{
	size_t i;
	const bool found = find(patterns, BB_PATTERN_COUNT, text, strlen(text), &i);

	if (found)
		*out = (enum bb_pattern)i;
	return found;
}

void bb_channel_text(const struct bb_channel *c, char *out, size_t cap)
{
	snprintf(out, cap, "%s%s%s.%s", c->wall, *c->wall ? "." : "", spots[c->spot], lenses[c->lens]);
}

bool bb_channel_find(const char *text, struct bb_channel *out)
{
	const char *lens = strrchr(text, '.'), *spot = lens;
	size_t i, k;

	if (!lens || !find(lenses, BB_LENS_COUNT, lens + 1, strlen(lens + 1), &k))
		return false;
	while (spot > text && spot[-1] != '.')
		spot--;
	const size_t n_wall = spot > text ? (size_t)(spot - text) - 1 : 0;
	if (!find(spots, BB_SPOT_COUNT, spot, (size_t)(lens - spot), &i) || n_wall >= sizeof(out->wall))
		return false;
	/* A lamp stands before no wall, and everything else does. */
	if ((i == BB_SPOT_LAMP) != (spot == text) || (spot > text && !n_wall))
		return false;
	memset(out, 0, sizeof(*out));
	memcpy(out->wall, text, n_wall);
	out->spot = (uint8_t)i;
	out->lens = (uint8_t)k;
	return true;
}
