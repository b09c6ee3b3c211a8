/*
 * tests/fuzz/fuzz_vcp_reply.c: what a display sends when it was asked for a value or a part of its capabilities. Byte
 * 0: the code, bytes 1 and 2: the offset; the rest is the reply. deep_vcp_reply.c has the whole driver before such a
 * wire.
 */
#include "drivers/ddcci_codec.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct ddcci_vcp value;
	struct ddcci_fragment part;
	const char *why = NULL;
	bool doubled = false;

	if (size < 3)
		return 0;
	const uint16_t offset = (uint16_t)(data[1] << 8 | data[2]);
	const uint8_t *reply = data + 3;
	const size_t n = size - 3;
	enum ddcci_answer answer = ddcci_take_vcp(reply, n, data[0], &value, &doubled, &why);
	fuzz_must(answer != DDCCI_BAD || why);
	fuzz_must(value.code == data[0] && (answer == DDCCI_ANSWER || (!value.supported && !value.current)));
	fuzz_must(answer == ddcci_take_vcp(reply, n, data[0], &value, NULL, NULL));

	why = NULL;
	answer = ddcci_take_fragment(reply, n, offset, &part, &doubled, &why);
	fuzz_must(answer != DDCCI_BAD || why);
	fuzz_must(part.offset == offset && (answer == DDCCI_ANSWER || !part.n));
	if (answer == DDCCI_ANSWER)
		fuzz_must(part.text > reply && part.text + part.n < reply + n);
	return 0;
}
