#include "drivers/modbus_codec.h"

#include <string.h>

static void put16(uint8_t *at, unsigned v)
{
	at[0] = (uint8_t)(v >> 8);
	at[1] = (uint8_t)(v & 0xFF);
}

static uint16_t get16(const uint8_t *at)
{
	return (uint16_t)(at[0] * 256 + at[1]);
}

void modbus_put_request(const struct modbus_request *r, uint8_t out[MODBUS_REQUEST_BYTES])
{
	out[0] = r->unit;
	out[1] = r->function;
	put16(out + 2, r->address);
	put16(out + 4, r->value);
}

void modbus_put_tcp(const struct modbus_request *r, uint16_t transaction, uint8_t out[MODBUS_TCP_REQUEST_BYTES])
{
	put16(out, transaction);
	put16(out + 2, 0);
	put16(out + 4, MODBUS_REQUEST_BYTES);
	modbus_put_request(r, out + 6);
}

bool modbus_writes(const struct modbus_request *r)
{
	return r->function > MODBUS_FN_READ_INPUT_REGISTERS; /* whatever is no known read may be a write */
}

bool modbus_allowed(const struct modbus_allow *list, size_t n, uint8_t unit, const struct modbus_request *r)
{
	for (size_t i = 0; i < n && r->unit == unit; i++)
		if (list[i].function == r->function && list[i].address == r->address &&
		    (r->value == list[i].off || r->value == list[i].on))
			return true;
	return false;
}

static void bad(struct modbus_reply *out, const char *why)
{
	out->verdict = MODBUS_BAD;
	out->why = why;
}

static void take_bits(const uint8_t *data, struct modbus_reply *out, size_t count)
{
	out->n = count;
	for (size_t i = 0; i < count; i++)
		out->value[i] = data[i / 8] >> i % 8 & 1;
}

static void take_words(const uint8_t *data, struct modbus_reply *out, size_t count)
{
	out->n = count;
	for (size_t i = 0; i < count; i++)
		out->value[i] = get16(data + 2 * i);
}

/* A read's data: a byte that says how many, then so many. */
static void judge_read(const uint8_t *pdu, size_t n, const struct modbus_request *r, struct modbus_reply *out)
{
	const bool bits = r->function <= MODBUS_FN_READ_INPUTS;
	const size_t want = bits ? (r->value + 7U) / 8 : 2U * r->value;

	if (r->value > MODBUS_VALUES_MAX)
		bad(out, "more values than were ever asked for");
	else if (n < 2 || pdu[1] != want || n != 2 + want)
		bad(out, "another number of values than asked for");
	else if (bits)
		take_bits(pdu + 2, out, r->value);
	else
		take_words(pdu + 2, out, r->value);
}

static void judge_pdu(const uint8_t *pdu, size_t n, const struct modbus_request *r, struct modbus_reply *out)
{
	if (n == 2 && pdu[0] == (r->function | MODBUS_FN_ERROR)) {
		out->verdict = MODBUS_EXCEPTION;
		out->exception = pdu[1];
		if (pdu[1] < 1 || pdu[1] > MODBUS_EX_MOST)
			bad(out, "an exception code there is not");
		return;
	}
	out->verdict = MODBUS_ANSWER;
	if (!n || pdu[0] != r->function)
		bad(out, "another function than asked for");
	else if (!modbus_writes(r))
		judge_read(pdu, n, r, out);
	else if (n != 5 || get16(pdu + 1) != r->address || get16(pdu + 3) != r->value)
		bad(out, "the echo of a write differs");
}

void modbus_judge_tcp(const uint8_t *adu, size_t n, const struct modbus_request *r, uint16_t transaction,
                      struct modbus_reply *out)
{
	memset(out, 0, sizeof(*out));
	if (n < MODBUS_MBAP_BYTES + 2 || n > MODBUS_TCP_ADU_MOST) {
		bad(out, "too short or too long");
		return;
	}
	out->transaction = get16(adu);
	if (get16(adu + 2) != 0)
		bad(out, "another protocol than Modbus");
	else if ((size_t)get16(adu + 4) + 6 != n)
		bad(out, "the header lies about the length");
	else if (out->transaction != transaction)
		out->verdict = MODBUS_OTHER;
	else if (adu[6] != r->unit)
		bad(out, "another unit answers");
	else
		judge_pdu(adu + MODBUS_MBAP_BYTES, n - MODBUS_MBAP_BYTES, r, out);
}

void modbus_judge_rtu(const uint8_t *adu, size_t n, const struct modbus_request *r, struct modbus_reply *out)
{
	memset(out, 0, sizeof(*out));
	if (n < 5 || n > MODBUS_RTU_ADU_MOST)
		bad(out, "too short or too long");
	else if (adu[0] != r->unit)
		out->verdict = MODBUS_OTHER;
	else
		judge_pdu(adu + 1, n - 3, r, out);
}
