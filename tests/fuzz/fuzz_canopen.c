/*
 * tests/fuzz/fuzz_canopen.c: any bytes as CANopen frames into every reader and an SDO transfer. Input: records of 12
 * bytes: id low, id high, length, ns of patience, 8 data bytes. The first byte picks what the SDO client wants.
 */
#include "drivers/canopen_sdo.h"
#include "tests/fuzz/fuzz.h"

#define RECORD 12

static void read_all(const struct bb_can_frame *f)
{
	struct bb_co_sdo_reply r;
	struct bb_co_emcy e;
	struct bb_co_phase p;
	struct bb_co_follow l;
	struct bb_co_lss_reply s;
	uint8_t b, node;

	const enum bb_co_kind kind = bb_co_kind(f, &node);
	fuzz_must(node <= CO_NODE_MOST && (node == 0 || kind != BB_CO_OTHER));
	if (bb_co_read_sync(f, &b) == BB_OK)
		fuzz_must(b <= SHUT_COUNTER_MOST);
	if (bb_co_read_heartbeat(f, &b) == BB_OK)
		fuzz_must(b == 0 || b == 4 || b == 5 || b == 0x7f);
	if (bb_co_read_emcy(f, &e) == BB_OK)
		fuzz_must(f->n_bytes == 8);
	if (bb_co_read_sdo(f, &r) == BB_OK)
		fuzz_must(r.n <= 7 && bb_co_abort_text(r.code));
	if (bb_co_read_phase(f, &p) == BB_OK)
		fuzz_must(p.counter >= 1 && p.counter <= SHUT_COUNTER_MOST && (p.flags & SHUT_FLAG_EYE) != 3);
	if (bb_co_read_follow(f, &l) == BB_OK)
		fuzz_must(l.counter >= 1);
	if (bb_co_read_lss(f, &s) == BB_OK)
		fuzz_must(s.command == f->bytes[0]);
}

/* Reads and writes of every kind of length; a reply's index and subindex must be these. */
static void begin(struct bb_co_sdo *c, uint8_t what, int64_t now_ns)
{
	const uint8_t bytes[BB_CO_SDO_MOST] = { 1, 2, 3 };

	if (what & 0x80)
		bb_co_sdo_start_write(c, 0x2000, what & 1, bytes, 1u + (what >> 1 & 63), now_ns);
	else
		bb_co_sdo_start_read(c, 0x1008, what & 1, now_ns);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_co_sdo c;
	struct bb_can_frame out;
	int64_t now_ns = 0;

	if (!size)
		return 0;
	bb_co_sdo_init(&c, 5, 20);
	begin(&c, data[0], now_ns);
	for (size_t at = 1; at + RECORD <= size; at += RECORD) {
		const uint8_t *d = data + at;
		struct bb_can_frame f = { .id = (uint32_t)d[0] | (uint32_t)(d[1] & 15) << 8,
					  .extended = d[1] & 0x80,
					  .remote = d[1] & 0x40,
					  .error = d[1] & 0x20,
					  .n_bytes = d[2] % 9 };

		memcpy(f.bytes, d + 4, 8);
		now_ns += d[3];
		read_all(&f);
		bb_co_sdo_poll(&c, now_ns);
		(void)!bb_co_sdo_receive(&c, &f, now_ns);
		fuzz_must(c.n <= BB_CO_SDO_MOST && c.done <= BB_CO_SDO_MOST);
		if (bb_co_sdo_take(&c, &out))
			fuzz_must(out.id == 0x605 && out.n_bytes == 8);
		if (!bb_co_sdo_busy(&c))
			begin(&c, d[3], now_ns);
	}
	return 0;
}
