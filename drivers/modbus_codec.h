/*
 * drivers/modbus_codec.h: requests to bytes, and what came back to a verdict. Every byte of a reply is hostile: a reply
 * counts only if transaction, protocol, length, unit, function and size all fit the request. No state, no threads.
 */
#ifndef BB_DRIVERS_MODBUS_CODEC_H
#define BB_DRIVERS_MODBUS_CODEC_H

#include "drivers/modbus_wire.h"
#include "hal/base.h"

struct modbus_request { /* functions 01 to 06 */
	uint8_t unit, function;
	uint16_t address, value; /* value: what is written; for reads the count */
};

#define MODBUS_REQUEST_BYTES 6 /* unit and PDU */
#define MODBUS_TCP_REQUEST_BYTES (6 + MODBUS_REQUEST_BYTES)
void modbus_put_request(const struct modbus_request *r, uint8_t out[MODBUS_REQUEST_BYTES]);
void modbus_put_tcp(const struct modbus_request *r, uint16_t transaction, uint8_t out[MODBUS_TCP_REQUEST_BYTES]);
bool modbus_writes(const struct modbus_request *r);

enum modbus_verdict {
	MODBUS_ANSWER,    /* to this request */
	MODBUS_EXCEPTION, /* to this request: see exception */
	MODBUS_OTHER,     /* well-formed, but to another request: late */
	MODBUS_BAD,       /* no Modbus, or a lie: the stream cannot be trusted any more */
};

#define MODBUS_VALUES_MAX 128
struct modbus_reply {
	enum modbus_verdict verdict;
	const char *why;         /* BAD: in words, static */
	uint16_t transaction;    /* TCP */
	uint8_t exception;
	size_t n;                /* values: bits as 0 and 1, or registers */
	uint16_t value[MODBUS_VALUES_MAX];
};
/* n bytes as received: MBAP and PDU. */
void modbus_judge_tcp(const uint8_t *adu, size_t n, const struct modbus_request *r, uint16_t transaction,
                      struct modbus_reply *out);
/* Unit, PDU and a checksum that whoever received it has verified. */
void modbus_judge_rtu(const uint8_t *adu, size_t n, const struct modbus_request *r, struct modbus_reply *out);

/* The writes a strip may be told, everything else is refused before it becomes bytes. */
struct modbus_allow {
	uint8_t function;
	uint16_t address, off, on; /* the two values that may be written */
};
bool modbus_allowed(const struct modbus_allow *list, size_t n, uint8_t unit, const struct modbus_request *r);

#endif
