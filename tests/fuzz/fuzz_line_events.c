/*
 * tests/fuzz/fuzz_line_events.c: whatever a v2 line descriptor may yield, read by drivers/line_uapi2.c and followed by
 * drivers/edge_lock.c. First byte: milliseconds between reads (0: a far leap). The rest: records of 48 bytes.
 */
#include "drivers/edge_lock.h"
#include "drivers/line.h"
#include "tests/fuzz/fuzz.h"

/* A lock that has seen an event keeps its promises. */
static void check(const struct bb_edge_lock *l, int64_t now_ns)
{
	fuzz_must(l->period_ns > 0 && l->period_ns < 1e12);
	fuzz_must(bb_edge_lock_wake_ns(l) > now_ns || l->raw_ns > now_ns);
	fuzz_must(bb_edge_lock_holdover_ns(l, now_ns) >= 0);
	fuzz_must(bb_edge_lock_health(l) != BB_HEALTH_OK || (l->locked && !l->silent));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct bb_clock *clk;
	struct bb_edge_lock lock;
	struct bb_shutter_edge out;
	struct bb_line_event e[3];
	int64_t now_ns = 0, last_ns = INT64_MIN;
	size_t used = 1, n;

	if (size < 1 || bb_clock_virtual_create(&clk) != BB_OK)
		return 0;
	struct bb_line_reader r = { .clk = clk, .line = 17 };
	bb_edge_lock_init(&lock, (struct bb_rate){ 120, 1 }, 100, 0);
	while (size - used >= BB_LINE_RECORD_BYTES) {
		now_ns += data[0] ? data[0] * INT64_C(1000000) : INT64_C(1) << 55;
		if (now_ns > INT64_C(1) << 61)
			break;
		bb_clock_run_until(clk, now_ns);
		const size_t most = 4 * BB_LINE_RECORD_BYTES, left = size - used;
		const size_t took = bb_line_decode(&r, data + used, left < most ? left : most, e, BB_ARRAY_LEN(e), &n);
		fuzz_must(took >= BB_LINE_RECORD_BYTES && took <= left && n <= BB_ARRAY_LEN(e));
		used += took;
		for (size_t i = 0; i < n; i++) {
			fuzz_must(e[i].at_ns >= last_ns);
			last_ns = e[i].at_ns;
			if (bb_edge_lock_event(&lock, &e[i], now_ns, &out))
				fuzz_must(out.at_ns == e[i].at_ns &&
					  (out.eye == BB_EYE_NONE || (out.eye == BB_EYE_LEFT) == e[i].level));
		}
		bb_edge_lock_pass(&lock, now_ns);
		check(&lock, now_ns);
	}
	bb_clock_destroy(clk);
	return 0;
}
