/*
 * tests/fuzz/fuzz_trackir.c: what a camera sends. Two bytes of length, then a transfer, and so on; bit 15 of the length
 * repairs the packet's own length, so that stripes are reached. Whatever comes, blobs lie on the sensor, in order.
 */
#include <stdlib.h>
#include <string.h>

#include "drivers/trackir_codec.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check(bool fine)
{
	if (!fine)
		abort();
}

static void look(const struct trackir_packet *p)
{
	struct bb_blob blob[64];
	bool overflow;
	const size_t n = trackir_blobs(p, blob, BB_ARRAY_LEN(blob), &overflow);

	check(n <= BB_ARRAY_LEN(blob) && p->n <= TRACKIR_STRIPES_MAX);
	for (size_t i = 0; i < n; i++) {
		check(blob[i].x_px >= 0 && blob[i].x_px < 1024 && blob[i].y_px >= 0 && blob[i].y_px < 512);
		check(blob[i].area_px >= 1);
		check(!i || blob[i].y_px >= blob[i - 1].y_px);
	}
}

static void repair(uint8_t *b, size_t n)
{
	const uint32_t length = (uint32_t)n - 8;

	b[1] = TRACKIR_TYPE_PACKET;
	b[3] = (uint8_t)(b[0] ^ b[1] ^ b[2] ^ TRACKIR_XOR);
	for (size_t i = 0; i < 4; i++)
		b[n - 4 + i] = (uint8_t)(length >> (24 - 8 * i));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct trackir_stream stream;
	static struct trackir_packet packet;

	trackir_stream_init(&stream);
	while (size > 2) {
		const size_t word = (size_t)data[0] << 8 | data[1], length = word & 0x7FFF;
		const size_t want = length < size - 2 ? length : size - 2;
		uint8_t *exact = malloc(want ? want : 1); /* so that one byte too far is seen */
		if (!exact)
			return 0;
		memcpy(exact, data + 2, want);
		if (word & 0x8000 && want >= 8)
			repair(exact, want);
		if (trackir_stream_add(&stream, exact, want) == TRACKIR_FRAME)
			look(&stream.packet);
		if (trackir_packet4_read(exact, want, &packet))
			check(packet.n <= 15);
		free(exact);
		data += 2 + want;
		size -= 2 + want;
	}
	return 0;
}
