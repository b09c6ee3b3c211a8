/*
 * power_write tcp|rtu [COUNT]: how long a power write takes until it is verified: from bb_power_set to the read that
 * shows the contact where it was told to be, over the kernel's loopback TCP or a pty. The simulated relay needs 20 ms of
 * it and the driver may say so up to relay_ms + three time-outs later.
 */
#include "tests/guest/measure.h"
#include "tests/modbus_rig.h"

#define OUTLETS 16
#define MOST 256

int main(int argc, char **argv)
{
	const bool rtu = argc > 1 && !strcmp(argv[1], "rtu");
	const int count = argc > 2 ? atoi(argv[2]) : 64;
	static int64_t took_ns[MOST];
	struct bb_power_config config = { .id = "pdu", .n_outlets = OUTLETS };
	struct bb_power *p;

	NEED(count > 0 && count <= MOST && count <= OUTLETS * 8);
	config.safety = (struct bb_safety){ .outlet_least_off_s = 0.1, .outlet_least_on_s = 0.1,
		                            .outlet_cycles_per_hour = 4, .outlet_stagger_ms = 1 };
	for (int i = 0; i < OUTLETS; i++)
		config.outlet[i] = (struct bb_outlet_config){ i + 1, "", 1, 1, 0 };
	struct modbus_rig *rig = modbus_rig_create(&config, rtu);
	NEED(modbus_rig_open(rig, &config, "&timeout_most_ms=200&poll_ms=100&relay_ms=30", &p) == BB_OK);
	modbus_rig_pass(rig, 200 * WIRE_MS);
	for (int k = 0; k < count; k++) {
		const size_t index = (size_t)k % OUTLETS;
		const bool on = k / OUTLETS % 2;
		struct bb_outlet_state s = { 0 };
		modbus_rig_pass(rig, bb_power_wait_ns(p, index, on) + WIRE_MS);
		const int64_t begun_ns = bb_clock_now_ns(rig->clk);
		NEED(bb_power_set(p, index, on) == BB_OK);
		do {
			modbus_rig_pass(rig, WIRE_MS / 10);
			NEED(bb_power_read(p, index, &s) == BB_OK);
			NEED(bb_clock_now_ns(rig->clk) - begun_ns < bb_power_limits(p)->settle_ns);
		} while (!s.known || s.closed != on || s.commanded != on);
		took_ns[k] = bb_clock_now_ns(rig->clk) - begun_ns;
	}
	printf("{\"case\": \"power_write\", \"over\": \"%s\", \"writes\": %d", rtu ? "rtu" : "tcp", count);
	print_latency("write_to_verified", took_ns, (size_t)count);
	printf("}\n");
	bb_power_close(p);
	modbus_rig_destroy(rig);
	return 0;
}
