/*
 * tests/fuzz/fuzz_trackir.c: what a camera sends. Two bytes, then a transfer, and so on. Of the two, from the highest
 * bit: repair the packet's own length, so that stripes are reached; double the transfer's bytes 0 to 7 times, so that a
 * short input says a long transfer; 12 bits of length. Whatever comes, blobs lie on the sensor, in order.
 */
#include "drivers/trackir_codec.h"
#include "tests/fuzz/fuzz.h"

#define LONGEST (TRACKIR_READ_BYTES + 8) /* one that is refused for its length */

static void look(const struct trackir_packet *p)
{
	struct bb_blob blob[64];
	bool overflow;
	const size_t n = trackir_blobs(p, blob, BB_ARRAY_LEN(blob), &overflow);

	fuzz_must(n <= BB_ARRAY_LEN(blob) && p->n <= TRACKIR_STRIPES_MAX && (!overflow || n == BB_ARRAY_LEN(blob)));
	for (size_t i = 0; i < n; i++) {
		fuzz_must(blob[i].x_px >= 0 && blob[i].x_px < 1024 && blob[i].y_px >= 0 && blob[i].y_px < 512);
		fuzz_must(blob[i].area_px >= 1 && (!i || blob[i].y_px >= blob[i - 1].y_px));
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

/* The next transfer, told by a word. */
static uint8_t *transfer(struct fuzz_input *in, unsigned int word, size_t *n_out)
{
	static uint8_t bytes[LONGEST];
	size_t n = word & 0xFFF;

	n = n < in->left ? n : in->left;
	memcpy(bytes, in->at, n);
	in->at += n;
	in->left -= n;
	for (unsigned int k = word >> 12 & 7; k && n; k--) {
		const size_t more = n < sizeof(bytes) - n ? n : sizeof(bytes) - n;
		memcpy(bytes + n, bytes, more);
		n += more;
	}
	if (word & 0x8000 && n >= 8)
		repair(bytes, n);
	*n_out = n;
	return fuzz_exact(bytes, n);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct trackir_stream stream;
	static struct trackir_packet packet;
	struct fuzz_input in = { data, size };

	trackir_stream_init(&stream);
	while (in.left > 2) {
		const unsigned int high = fuzz_byte(&in), word = high << 8 | fuzz_byte(&in);
		size_t n;
		const uint8_t *bytes = transfer(&in, word, &n);
		const enum trackir_item item = trackir_stream_add(&stream, bytes, n);
		fuzz_must(stream.n <= sizeof(stream.bytes));
		if (item == TRACKIR_FRAME)
			look(&stream.packet);
		if (trackir_packet4_read(bytes, n, &packet))
			fuzz_must(packet.n <= 15);
	}
	return 0;
}
