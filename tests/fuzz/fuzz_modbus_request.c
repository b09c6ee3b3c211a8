/*
 * tests/fuzz/fuzz_modbus_request.c: a client's bytes at our Modbus server: TCP and RTU streams in pieces of any size.
 * Bit 0 of the first byte chooses the framing, bits 5 to 7 what is wrong with the strip; the second byte is the piece.
 * Whatever comes, replies fit a frame and the strip stays sane.
 */
#include "sim/peer_modbus.h"
#include "tests/fuzz/fuzz.h"

static void check_replies(struct sim_wire_line *line, bool rtu, bool spoilt)
{
	uint8_t out[SIM_WIRE_SAY_MAX];

	for (size_t n; (n = sim_wire_line_next(line, out, sizeof(out))) > 0;) {
		if (spoilt)
			continue;
		fuzz_must(n <= (rtu ? MODBUS_RTU_ADU_MOST : MODBUS_TCP_ADU_MOST));
		fuzz_must(rtu ? n >= 5 : n >= 9 && (size_t)(out[4] << 8 | out[5]) + 6 == n);
	}
}

/* A strip in order at the first three. */
static struct peer_modbus_faults faults_of(unsigned int how)
{
	switch (how) {
	case 3:
		return (struct peer_modbus_faults){ .garbage = true };
	case 4:
		return (struct peer_modbus_faults){ .late_ns = 1000000, .late_left = 2, .deaf_to_writes = true };
	case 5:
		return (struct peer_modbus_faults){ .exception = 4 };
	case 6:
		return (struct peer_modbus_faults){ .foreign = true, .silent = true };
	case 7:
		return (struct peer_modbus_faults){ .half_open = true };
	default:
		return (struct peer_modbus_faults){ 0 };
	}
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	const struct bb_power_config config = { .id = "pdu",
						.n_outlets = 2,
						.outlet = { { .outlet = 1 }, { .outlet = 9 } } };
	struct peer_modbus peer;
	struct peer_modbus_session session = { 0 };

	if (size < 2)
		return 0;
	const bool rtu = data[0] & 1;
	const struct sim_wire_protocol *protocol = rtu ? &peer_modbus_rtu : &peer_modbus_tcp;
	const size_t piece = data[1] ? data[1] : 1;
	static struct sim_wire_line
		*line; /* made once, empty after every run: a fresh one each time takes most of the time */
	if (!line && !(line = sim_wire_line_create()))
		return 0;
	peer_modbus_init(&peer, &config, 1, 0);
	peer.faults = faults_of(data[0] >> 5);
	peer.outlet[0].stick = data[0] & 2 ? PEER_MODBUS_STUCK_CLOSED : PEER_MODBUS_FREE;
	for (size_t at = 2; at < size; at += piece) {
		const size_t n = size - at < piece ? size - at : piece;
		const bool goes_on = protocol->take(&peer, &session, line, data + at, n, (int64_t)at * 1000000);
		check_replies(line, rtu, peer.faults.garbage);
		fuzz_must(session.n < sizeof(session.bytes));
		if (!goes_on)
			break;
	}
	fuzz_must(peer.n_outlets == 9 && peer.n_writes <= peer.n_requests);
	return 0;
}
