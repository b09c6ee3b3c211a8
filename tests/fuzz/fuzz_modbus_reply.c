/*
 * tests/fuzz/fuzz_modbus_reply.c: a strip's bytes at the driver's seam. Byte 0: framing and function, bytes 1 and 2: how
 * many values were asked for; the rest is the reply. An answer holds exactly what was asked for.
 */
#include "drivers/modbus_codec.h"

#include <stdlib.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

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
	if (reply.n > MODBUS_VALUES_MAX || (reply.verdict == MODBUS_BAD && !reply.why))
		abort();
	if (reply.verdict == MODBUS_ANSWER && reply.n != (modbus_writes(&r) ? 0 : r.value))
		abort();
	if (reply.verdict == MODBUS_EXCEPTION && (reply.exception < 1 || reply.exception > MODBUS_EX_MOST))
		abort();
	return 0;
}
