/*
 * tests/fuzz/fuzz_canopen.c: any bytes as CANopen frames into every reader, an SDO transfer and a fastscan.
 * Input: records of 12 bytes: id low, id high, length, minutes of patience, 8 data bytes. The first byte of the input
 * picks what the SDO client wants.
 */
#include "drivers/canopen_lss.h"
#include "drivers/canopen_sdo.h"

#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#define CHECK(x) \
	do { \
		if (!(x)) \
			abort(); \
	} while (0)

static void read_all(const struct bb_can_frame *f)
{
	struct bb_co_sdo_reply r;
	struct bb_co_emcy e;
	struct bb_co_phase p;
	struct bb_co_follow l;
	struct bb_co_lss_reply s;
	uint8_t b, node;

	const enum bb_co_kind kind = bb_co_kind(f, &node);
	CHECK(node <= CO_NODE_MOST && (node == 0 || kind != BB_CO_OTHER));
	if (bb_co_read_sync(f, &b) == BB_OK)
		CHECK(b <= SHUT_COUNTER_MOST);
	if (bb_co_read_heartbeat(f, &b) == BB_OK)
		CHECK(b == 0 || b == 4 || b == 5 || b == 0x7f);
	if (bb_co_read_emcy(f, &e) == BB_OK)
		CHECK(f->n_bytes == 8);
	if (bb_co_read_sdo(f, &r) == BB_OK)
		CHECK(r.n <= 7 && bb_co_abort_text(r.code));
	if (bb_co_read_phase(f, &p) == BB_OK)
		CHECK(p.counter >= 1 && p.counter <= SHUT_COUNTER_MOST && (p.flags & SHUT_FLAG_EYE) != 3);
	if (bb_co_read_follow(f, &l) == BB_OK)
		CHECK(l.counter >= 1);
	if (bb_co_read_lss(f, &s) == BB_OK)
		CHECK(s.command == f->bytes[0]);
}

static void begin(struct bb_co_sdo *c, uint8_t what)
{
	uint8_t bytes[BB_CO_SDO_MOST] = { 1, 2, 3 };

	bb_co_sdo_init(c, 5, 20);
	if (what & 0x80)
		bb_co_sdo_start_write(c, 0x2000, what & 1, bytes, 1u + (what >> 1 & 63), 0);
	else
		bb_co_sdo_start_read(c, 0x1008, what & 1, 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_co_lss_master m;
	struct bb_co_sdo c;
	struct bb_can_frame out;
	int64_t now_ns = 0;

	if (!size)
		return 0;
	begin(&c, data[0]);
	bb_co_lss_init(&m, 10);
	bb_co_lss_start(&m, 6, 0);
	for (size_t at = 1; at + 12 <= size && at < 12 * 160; at += 12) {
		const uint8_t *d = data + at;
		struct bb_can_frame f = { .id = (uint32_t)d[0] | (uint32_t)(d[1] & 7) << 8, .extended = d[1] & 0x80,
			                  .remote = d[1] & 0x40, .n_bytes = d[2] % 9 };

		memcpy(f.bytes, d + 4, 8);
		now_ns += d[3];
		read_all(&f);
		bb_co_sdo_poll(&c, now_ns);
		bb_co_sdo_receive(&c, &f, now_ns);
		CHECK(c.n <= BB_CO_SDO_MOST && c.done <= BB_CO_SDO_MOST);
		if (bb_co_sdo_take(&c, &out))
			CHECK(out.id == 0x605 && out.n_bytes == 8);
		if (!bb_co_sdo_busy(&c))
			begin(&c, d[3]);
		bb_co_lss_receive(&m, &f, now_ns);
		bb_co_lss_poll(&m, now_ns);
		CHECK(m.sub < 4 && m.bit < 32);
		if (bb_co_lss_take(&m, &out))
			CHECK(out.id == CO_LSS_REQUEST);
		if (m.status != BB_TIMEOUT)
			bb_co_lss_start(&m, 6, now_ns);
	}
	return 0;
}
