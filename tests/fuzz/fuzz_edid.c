/* tests/fuzz/fuzz_edid.c: any bytes as an EDID. Seeds: golden and generated EDIDs, and extensions that lie. */
#include "drivers/edid.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct edid_info e;
	const int bad = edid_bad_block(data, size);

	fuzz_must(bad >= -1 && (bad < 0 || (size_t)bad <= size / 128));
	if (edid_parse(data, size, &e) != BB_OK)
		return 0;
	fuzz_must(size >= 128 && e.n_timings <= EDID_MOST_TIMINGS && e.n_extensions < EDID_MOST_BLOCKS);
	fuzz_must(e.n_extensions <= e.n_declared && (e.n_extensions + 1) * 128 <= size);
	fuzz_must(strlen(e.name) < sizeof(e.name) && strlen(e.serial_text) < sizeof(e.serial_text));
	for (size_t i = 0; i < e.n_timings; i++)
		fuzz_must(edid_timing_hz(&e.timing[i]) >= 0);
	return 0;
}
