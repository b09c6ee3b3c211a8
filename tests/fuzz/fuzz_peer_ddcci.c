/*
 * tests/fuzz/fuzz_peer_ddcci.c: what a host writes to a simulated monitor's DDC wires, and reads back. Byte 0: quirks,
 * byte 1: 1 + a fault. Then a byte a message: bits 0 and 1: to the controller, to the controller with a whole request's
 * envelope around the bytes, to the EDID, to the segment pointer; bit 2: a read; bits 3 to 7: its length; ms of
 * waiting; and what is written.
 */
#include "drivers/ddcci_wire.h"
#include "sim/peer_ddcci.h"
#include "tests/fuzz/fuzz.h"

#define MS INT64_C(1000000)

static void read_back(struct peer_ddcci *p, uint16_t address, size_t n, int64_t now_ns)
{
	static const uint8_t none[64];
	uint8_t *bytes = fuzz_exact(none, n);

	(void)peer_ddcci_read(p, address, bytes, n, now_ns);
}

static void send(struct peer_ddcci *p, struct fuzz_input *in, uint16_t address, size_t want, bool wrap, int64_t now_ns)
{
	uint8_t request[3 + 32] = { DDCCI_HOST };
	size_t n;
	const uint8_t *bytes = fuzz_piece(in, want, &n);

	if (wrap) {
		request[1] = (uint8_t)(DDCCI_LENGTH_FLAG | n);
		memcpy(request + 2, bytes, n);
		bytes = fuzz_exact(request, n += 3);
	}
	(void)peer_ddcci_write(p, address, bytes, n, now_ns, now_ns + MS);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const uint16_t addresses[4] = { 0x37, 0x37, 0x50, 0x30 };
	static const struct bb_monitor_config config = { .id = "m" };
	struct fuzz_input in = { data, size };
	struct peer_ddcci *p;
	int64_t now_ns = 1000 * MS;

	if (!size || peer_ddcci_create(&config, NULL, 1, 0, &p) != BB_OK)
		return 0;
	const uint8_t quirks = fuzz_byte(&in);
	*peer_ddcci_quirks(p) = (struct peer_quirks){ .doubled_source = quirks & 1,
						      .null_for_unsupported = quirks & 2,
						      .zero_for_unsupported = quirks & 4,
						      .malformed_capabilities = quirks & 8,
						      .no_ack_asleep = quirks & 16,
						      .think_ns = 30 * MS };
	const unsigned int fault = fuzz_byte(&in);
	if (fault && fault <= PEER_FAULT_COUNT)
		peer_ddcci_fault(p, (enum peer_fault)(fault - 1), true, now_ns);
	while (in.left) {
		const uint8_t how = fuzz_byte(&in);
		const uint16_t address = addresses[how & 3];
		now_ns += fuzz_byte(&in) * MS;
		if (how & 4)
			read_back(p, address, how >> 3, now_ns);
		else
			send(p, &in, address, how >> 3, (how & 3) == 1, now_ns);
		peer_ddcci_stop(p);
	}
	const struct peer_counts *c = peer_ddcci_counts(p);
	fuzz_must(c->writes + c->saves <= c->requests && c->writes_asleep <= c->writes);
	peer_ddcci_destroy(p);
	return 0;
}
