/* tests/fuzz/fuzz_xusb.c: packets of an Xbox 360 wireless receiver, length-prefixed. */
#include "drivers/xusb_codec.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct fuzz_input in = { data, size };
	struct bb_xusb_packet p = { 0 };

	while (in.left) {
		const size_t want = fuzz_byte(&in);
		size_t n;
		const uint8_t *packet = fuzz_piece(&in, want, &n);
		(void)bb_xusb_decode(packet, n, &p);
		for (size_t i = 0; i < BB_PAD_AXES; i++)
			fuzz_must(abs(p.sample.count[i]) <= bb_xusb_steps[i]);
		fuzz_must(p.battery >= 0 && p.battery <= 1);
	}
	return 0;
}
