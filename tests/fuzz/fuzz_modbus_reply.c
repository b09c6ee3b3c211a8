/*
 * tests/fuzz/fuzz_modbus_reply.c: a strip's bytes at the driver's seam. Byte 0: framing and function, bytes 1 and 2:
 * how many values were asked for; the rest is the reply. An answer holds exactly what was asked for.
 */
#include "drivers/modbus_codec.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct modbus_reply reply;

	if (size < 3)
		return 0;
	const bool rtu = data[0] & 8;
	const struct modbus_request r = { 1, (uint8_t)(1 + (data[0] & 7) % 6), 0, (uint16_t)(data[1] << 8 | data[2]) };
	const size_t n = size - 3;
	if (rtu)
		modbus_judge_rtu(data + 3, n, &r, &reply);
	else
		modbus_judge_tcp(data + 3, n, &r, 7, &reply);
	fuzz_must(reply.n <= MODBUS_VALUES_MAX && (reply.verdict != MODBUS_BAD || reply.why));
	if (reply.verdict == MODBUS_ANSWER)
		fuzz_must(reply.n == (modbus_writes(&r) ? 0 : r.value));
	if (reply.verdict == MODBUS_EXCEPTION)
		fuzz_must(reply.exception >= 1 && reply.exception <= MODBUS_EX_MOST);
	return 0;
}
