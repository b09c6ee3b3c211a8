/* tests/fuzz/fuzz_xusb.c: packets of an Xbox 360 wireless receiver, length-prefixed. */
#include <stdlib.h>
#include <string.h>

#include "drivers/xusb_codec.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_xusb_packet p = { 0 };
	uint8_t out[BB_XUSB_COMMAND_BYTES];

	for (size_t at = 0; at < size;) {
		size_t n = data[at++];
		n = n < size - at ? n : size - at;
		uint8_t *packet = malloc(n ? n : 1);
		if (!packet)
			return 0;
		memcpy(packet, data + at, n);
		(void)bb_xusb_decode(packet, n, &p);
		free(packet);
		for (size_t i = 0; i < BB_PAD_AXES; i++)
			if (abs(p.sample.count[i]) > bb_xusb_steps[i])
				abort();
		if (!(p.battery >= 0 && p.battery <= 1))
			abort();
		at += n;
	}
	bb_xusb_encode_rumble((float)size / 16, (float)size / 64 - 1, out);
	bb_xusb_encode_led((unsigned int)size, out);
	return 0;
}
