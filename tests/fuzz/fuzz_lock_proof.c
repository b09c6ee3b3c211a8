/*
 * tests/fuzz/fuzz_lock_proof.c: a recording of vblanks and the verdict on it, at the newest of them. The first byte says
 * how many displays there are, the second at which rate.
 */
#include "sync/lock_proof.h"
#include "tests/fuzz/fuzz.h"

static int64_t newest_ns(const struct bb_lock_proof *p)
{
	int64_t at_ns = 0;

	for (unsigned i = 0; i < p->n; i++)
		if (p->display[i].any && (i == 0 || p->display[i].vblank_ns > at_ns))
			at_ns = p->display[i].vblank_ns;
	return at_ns;
}

static void judge(const struct bb_lock_proof *p)
{
	const struct bb_lock_finding f = bb_lock_proof_judge(p, newest_ns(p));
	const int64_t period_ns = bb_rate_period_ns(p->rate);

	fuzz_must(bb_lock_verdict_text(f.verdict) != NULL);
	fuzz_must(f.display < (p->n ? p->n : 1) && f.uncertainty_ns >= 0);
	fuzz_must(2 * f.phase_ns <= period_ns + 4 && 2 * f.phase_ns >= -period_ns - 4);
	fuzz_must(p->n > 1 || f.verdict == BB_LOCK_INCONCLUSIVE);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static const struct bb_rate rates[] = { { 120, 1 }, { 60000, 1001 }, { 119982, 1000 }, { 1, 1 } };
	static struct bb_lock_proof p;
	struct fuzz_input in = { data, size };
	const unsigned n = fuzz_byte(&in);
	size_t n_bytes, lines = 1;

	bb_lock_proof_init(&p, n, rates[fuzz_byte(&in) % 4], 100000);
	const char *text = (const char *)fuzz_piece(&in, in.left, &n_bytes);
	const unsigned line = bb_lock_proof_read(&p, text, n_bytes);

	for (size_t i = 0; i < n_bytes; i++)
		lines += text[i] == '\n';
	fuzz_must(line <= lines);
	judge(&p);
	return 0;
}
