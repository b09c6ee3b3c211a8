/*
 * drivers/ddcci_codec.h: DDC/CI messages to bytes and back. Pure; every byte read is hostile. Requests are written as
 * I2C wants them, without the address byte 6E, which only the checksum knows.
 */
#ifndef BB_DRIVERS_DDCCI_CODEC_H
#define BB_DRIVERS_DDCCI_CODEC_H

#include "hal/status.h"

#define DDCCI_MOST_REQUEST 8 /* bytes of the longest request written here */
#define DDCCI_VCP_REPLY_BYTES 11
#define DDCCI_FRAGMENT_BYTES 38
#define DDCCI_MOST_REPLY (DDCCI_FRAGMENT_BYTES + 1) /* one more for displays that send their address twice */

/* XOR over the address byte that begins a message and the bytes that follow it. */
uint8_t ddcci_checksum(uint8_t address, const uint8_t *bytes, size_t n);

size_t ddcci_put_get(uint8_t out[DDCCI_MOST_REQUEST], uint8_t code);
size_t ddcci_put_set(uint8_t out[DDCCI_MOST_REQUEST], uint8_t code, uint16_t value);
size_t ddcci_put_save(uint8_t out[DDCCI_MOST_REQUEST]);
size_t ddcci_put_capabilities(uint8_t out[DDCCI_MOST_REQUEST], uint16_t offset);
size_t ddcci_put_identification(uint8_t out[DDCCI_MOST_REQUEST]);

enum ddcci_answer {
	DDCCI_ANSWER, /* a whole reply to what was asked */
	DDCCI_NULL,   /* the empty message: busy, asleep, or its way to say "unsupported" */
	DDCCI_ALL_ZERO,
	DDCCI_BAD, /* checksum, length, opcode, or an answer to another question */
};

struct ddcci_vcp {
	bool supported;
	uint8_t code, type;
	uint16_t most, current;
};
struct ddcci_fragment {
	uint16_t offset;
	size_t n;            /* 0 ends the text */
	const uint8_t *text; /* inside the bytes given */
};

/* bytes: what was read from the display. *doubled (may be NULL): its source byte stands there twice. why (may be NULL)
 * gets a static text for DDCCI_BAD. */
BB_MUST_CHECK enum ddcci_answer ddcci_take_vcp(const uint8_t *bytes, size_t n, uint8_t code, struct ddcci_vcp *out,
					       bool *doubled, const char **why);
BB_MUST_CHECK enum ddcci_answer ddcci_take_fragment(const uint8_t *bytes, size_t n, uint16_t offset,
						    struct ddcci_fragment *out, bool *doubled, const char **why);

#endif
