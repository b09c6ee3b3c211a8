/*
 * tests/fuzz/fuzz_canopen_lss.c: what answers a fastscan. Of each byte, bits 0 and 1: nothing until the time-out,
 * "found" and the time-out, any frame in time (its length and 8 bytes follow), nothing and a new scan; the others: how
 * often, less one. So that a whole scan of 4 times 32 bits is a few bytes.
 */
#include "drivers/canopen_lss.h"
#include "tests/fuzz/fuzz.h"

#define POLLS 1024

static void poll(struct bb_co_lss_master *m, int64_t now_ns)
{
	struct bb_can_frame out;

	bb_co_lss_poll(m, now_ns);
	fuzz_must(m->sub < 4 && m->bit < 32);
	if (bb_co_lss_take(m, &out))
		fuzz_must(out.id == CO_LSS_REQUEST && out.n_bytes == 8);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct fuzz_input in = { data, size };
	struct bb_co_lss_master m;
	int64_t now_ns = 0;
	int polls = 0;

	bb_co_lss_init(&m, 10);
	bb_co_lss_start(&m, 6, now_ns);
	while (in.left && polls < POLLS) {
		const uint8_t how = fuzz_byte(&in);
		struct bb_can_frame f = { .id = CO_LSS_REPLY, .n_bytes = 8, .bytes = { CO_LSS_FOUND } };
		if ((how & 3) == 2) {
			f.n_bytes = fuzz_byte(&in) % 9;
			for (size_t i = 0; i < 8; i++)
				f.bytes[i] = fuzz_byte(&in);
		}
		if ((how & 3) == 3)
			bb_co_lss_start(&m, 6, now_ns);
		for (int i = 0; i <= how >> 2; i++, polls++) {
			if ((how & 3) == 1 || (how & 3) == 2)
				bb_co_lss_receive(&m, &f, now_ns);
			now_ns += (how & 3) == 2 ? 1 : 10;
			poll(&m, now_ns);
		}
	}
	return 0;
}
