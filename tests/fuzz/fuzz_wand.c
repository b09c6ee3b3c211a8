/* tests/fuzz/fuzz_wand.c: any bytes as lines of a wand sequence. */
#include <math.h>

#include "sync/calibrate/sequence.h"
#include "tests/fuzz/fuzz.h"

static void check(const struct bb_sequence_line *l)
{
	fuzz_must(l->kind >= BB_SEQUENCE_NOTHING && l->kind <= BB_SEQUENCE_SIGHT && l->n <= BB_SEQUENCE_BLOBS_MAX);
	for (int i = 0; l->kind == BB_SEQUENCE_SQUARE && i < 12; i++)
		fuzz_must(fabs(l->number[i]) <= 100);
	for (int i = 0; l->kind == BB_SEQUENCE_WAND && i < 3; i++)
		fuzz_must(fabs(l->number[i]) <= 100);
	if (l->kind != BB_SEQUENCE_SIGHT)
		return;
	fuzz_must(l->t_ns >= 0 && l->t_ns <= INT64_C(1000000000000000) && *l->id && memchr(l->id, 0, sizeof(l->id)));
	for (size_t i = 0; i < l->n; i++)
		fuzz_must(fabsf(l->px[i][0]) <= 65536 && fabsf(l->px[i][1]) <= 65536);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	struct fuzz_input in = { data, size };

	while (in.left) {
		const uint8_t *stop = memchr(in.at, '\n', in.left);
		struct bb_sequence_line line;
		size_t n = stop ? (size_t)(stop - in.at) : in.left;
		const char *bytes = (const char *)fuzz_piece(&in, n, &n);
		if (!bb_sequence_line(bytes, n, &line))
			check(&line);
		(void)fuzz_byte(&in);
	}
	return 0;
}
