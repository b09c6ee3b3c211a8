/* tests/fuzz/fuzz_hid_report.c: input reports of HID gamepads; byte 0 picks the kind, then length-prefixed reports. */
#include "drivers/pad_codec.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct fuzz_input in = { data, size };
	struct bb_pad_sample s = { 0 };
	float battery = 0;
	const enum bb_pad_kind kind = (enum bb_pad_kind)(fuzz_byte(&in) % 3);
	const int32_t *steps = bb_pad_kind_steps(kind);

	while (in.left) {
		const struct bb_pad_sample before = s;
		const size_t want = fuzz_byte(&in);
		size_t n;
		const uint8_t *report = fuzz_piece(&in, want, &n);
		if (bb_pad_decode(kind, report, n, &s, &battery) == BB_PAD_SAID_BAD)
			fuzz_must(!memcmp(&before, &s, sizeof(s)));
		for (size_t i = 0; i < BB_PAD_AXES; i++)
			fuzz_must(s.count[i] <= steps[i] && s.count[i] >= -steps[i]);
		fuzz_must(battery >= 0 && battery <= 1);
	}
	return 0;
}
