/* drivers/ddcci_codec.c: see drivers/ddcci_codec.h; DDC/CI 1.1 sections 4 and 6. */
#include "drivers/ddcci_codec.h"

#include "drivers/ddcci_wire.h"

#include <string.h>

uint8_t ddcci_checksum(uint8_t address, const uint8_t *bytes, size_t n)
{
	uint8_t sum = address;

	for (size_t i = 0; i < n; i++)
		sum ^= bytes[i];
	return sum;
}

/* ---- requests ---- */

/* The data stand in out + 2 already. */
static size_t wrap(uint8_t *out, size_t n_data)
{
	out[0] = DDCCI_HOST;
	out[1] = (uint8_t)(DDCCI_LENGTH_FLAG | n_data);
	out[2 + n_data] = ddcci_checksum(DDCCI_TO_DISPLAY, out, 2 + n_data);
	return 3 + n_data;
}

size_t ddcci_put_get(uint8_t out[DDCCI_MOST_REQUEST], uint8_t code)
{
	out[2] = DDCCI_GET;
	out[3] = code;
	return wrap(out, 2);
}

size_t ddcci_put_set(uint8_t out[DDCCI_MOST_REQUEST], uint8_t code, uint16_t value)
{
	out[2] = DDCCI_SET;
	out[3] = code;
	out[4] = (uint8_t)(value >> 8);
	out[5] = (uint8_t)value;
	return wrap(out, 4);
}

size_t ddcci_put_save(uint8_t out[DDCCI_MOST_REQUEST])
{
	out[2] = DDCCI_SAVE;
	return wrap(out, 1);
}

size_t ddcci_put_capabilities(uint8_t out[DDCCI_MOST_REQUEST], uint16_t offset)
{
	out[2] = DDCCI_CAPABILITIES;
	out[3] = (uint8_t)(offset >> 8);
	out[4] = (uint8_t)offset;
	return wrap(out, 3);
}

size_t ddcci_put_identification(uint8_t out[DDCCI_MOST_REQUEST])
{
	out[2] = DDCCI_IDENTIFICATION;
	return wrap(out, 1);
}

/* ---- replies ---- */

struct data {
	const uint8_t *bytes;
	size_t n;
};

static enum ddcci_answer bad(const char **why, const char *text)
{
	if (why)
		*why = text;
	return DDCCI_BAD;
}

static bool all_zero(const uint8_t *bytes, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (bytes[i])
			return false;
	return n > 0;
}

/* Takes the envelope off: source, length, data, checksum. What follows the checksum is whatever the bus floated to. */
static enum ddcci_answer unwrap(const uint8_t *bytes, size_t n, struct data *out, bool *doubled, const char **why)
{
	*out = (struct data){ NULL, 0 };
	if (doubled)
		*doubled = false;
	if (all_zero(bytes, n))
		return DDCCI_ALL_ZERO;
	if (n >= 2 && bytes[0] == DDCCI_TO_DISPLAY && bytes[1] == DDCCI_TO_DISPLAY) {
		if (doubled)
			*doubled = true;
		bytes++;
		n--;
	}
	if (n < 3)
		return bad(why, "shorter than any message");
	if (bytes[0] != DDCCI_TO_DISPLAY)
		return bad(why, "does not begin with the display's address");
	if (!(bytes[1] & DDCCI_LENGTH_FLAG))
		return bad(why, "a length without its flag");
	const size_t n_data = bytes[1] & 0x7Fu;
	if (n_data > DDCCI_MOST_DATA || 3 + n_data > n)
		return bad(why, "longer than what was read");
#ifndef BB_FUZZ
	if (ddcci_checksum(DDCCI_VIRTUAL_HOST, bytes, 2 + n_data) != bytes[2 + n_data])
		return bad(why, "wrong checksum");
#endif
	if (!n_data)
		return DDCCI_NULL;
	*out = (struct data){ bytes + 2, n_data };
	return DDCCI_ANSWER;
}

enum ddcci_answer ddcci_take_vcp(const uint8_t *bytes, size_t n, uint8_t code, struct ddcci_vcp *out, bool *doubled,
				 const char **why)
{
	struct data d;
	const enum ddcci_answer answer = unwrap(bytes, n, &d, doubled, why);

	*out = (struct ddcci_vcp){ .code = code };
	if (answer != DDCCI_ANSWER)
		return answer;
	if (d.bytes[0] != DDCCI_GET_REPLY || d.n != 8)
		return bad(why, "not a VCP reply");
	if (d.bytes[2] != code)
		return bad(why, "a reply about another code");
	if (d.bytes[1] > DDCCI_RESULT_UNSUPPORTED)
		return bad(why, "an unknown result");
	out->supported = d.bytes[1] == DDCCI_RESULT_OK;
	out->type = d.bytes[3];
	out->most = (uint16_t)(d.bytes[4] << 8 | d.bytes[5]);
	out->current = (uint16_t)(d.bytes[6] << 8 | d.bytes[7]);
	return DDCCI_ANSWER;
}

enum ddcci_answer ddcci_take_fragment(const uint8_t *bytes, size_t n, uint16_t offset, struct ddcci_fragment *out,
				      bool *doubled, const char **why)
{
	struct data d;
	const enum ddcci_answer answer = unwrap(bytes, n, &d, doubled, why);

	*out = (struct ddcci_fragment){ .offset = offset };
	if (answer != DDCCI_ANSWER)
		return answer;
	if (d.bytes[0] != DDCCI_CAPABILITIES_REPLY || d.n < 3)
		return bad(why, "not a part of the capabilities");
	if ((d.bytes[1] << 8 | d.bytes[2]) != offset)
		return bad(why, "a part from another offset");
	out->n = d.n - 3;
	out->text = d.bytes + 3;
	return DDCCI_ANSWER;
}
