/* tests/fuzz/fuzz_optics.c: any bytes as an optical recording, pushed in pieces as the first byte says. */
#include <math.h>

#include "sync/optics/recorded.h"
#include "tests/fuzz/fuzz.h"

static int64_t last_ns;

static void check(void *ctx, const struct bb_recording *r, int64_t at_ns, const double *volts)
{
	uint64_t *n = ctx;

	fuzz_must(r->n_channels > 0 && r->n_channels <= BB_CHANNELS_MAX && r->n_shows > 0 && r->n_shows <= BB_SHOWS_MAX);
	fuzz_must(!*n || at_ns > last_ns);
	for (size_t i = 0; i < r->n_channels; i++)
		fuzz_must(isfinite(volts[i]));
	last_ns = at_ns;
	++*n;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static struct bb_recorded r;
	struct fuzz_input in = { data, size };
	const size_t piece = 1 + fuzz_byte(&in);
	struct bb_error err = { 0 };
	enum bb_status status = BB_OK;
	uint64_t n = 0;

	bb_recorded_begin(&r, "fuzz", check, &n);
	while (in.left && status == BB_OK) {
		size_t got;
		const uint8_t *bytes = fuzz_piece(&in, piece, &got);
		status = bb_recorded_push(&r, (const char *)bytes, got, &err);
	}
	if (status == BB_OK)
		status = bb_recorded_end(&r, &err);
	fuzz_must(status == BB_OK ? r.headed && err.number == 0 : err.number >= 1630 && err.number <= 1637);
	return 0;
}
