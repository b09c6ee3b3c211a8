/* tests/fuzz/fuzz_hid_report.c: input reports of HID gamepads; byte 0 picks the kind, then length-prefixed reports. */
#include <stdlib.h>
#include <string.h>

#include "drivers/pad_codec.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(enum bb_pad_kind kind, const struct bb_pad_sample *s)
{
	const int32_t *steps = bb_pad_kind_steps(kind);

	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (s->count[i] > steps[i] || s->count[i] < -steps[i])
			abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_pad_sample s = { 0 };
	uint8_t out[BB_PAD_RUMBLE_BYTES];
	float battery = 0;

	if (!size)
		return 0;
	enum bb_pad_kind kind = (enum bb_pad_kind)(data[0] % 3);
	uint8_t id;
	if (bb_pad_kind_report_bytes(kind, &id) > 8 || bb_pad_kind_of((uint16_t)size, data[0], &kind))
		abort();
	for (size_t at = 1; at < size;) {
		size_t n = data[at++];
		n = n < size - at ? n : size - at;
		uint8_t *report = malloc(n ? n : 1); /* as long as it is, not a byte more */
		if (!report)
			return 0;
		memcpy(report, data + at, n);
		const struct bb_pad_sample before = s;
		if (bb_pad_decode(kind, report, n, &s, &battery) == BB_PAD_SAID_BAD && memcmp(&before, &s, sizeof(s)))
			abort();
		free(report);
		check(kind, &s);
		if (!(battery >= 0 && battery <= 1))
			abort();
		at += n;
	}
	bb_pad_encode_rumble(kind, data[0], (float)size / 64, (float)data[0] / 64 - 1, out);
	return 0;
}
