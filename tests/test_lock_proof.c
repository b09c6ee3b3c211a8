/*
 * tests/test_lock_proof.c: displays are locked when counters are equal at a common instant and vblanks begin together: the
 * same verdict for simulated displays, for what they recorded, and by hand.
 */
#include "sim/sim_display.h"
#include "sync/lock_proof.h"
#include "tests/sim_rig.h"

#include <stdio.h>

#define N 4
#define T INT64_C(16666667)
#define LIMIT_NS 20000

static const struct bb_rate rate = { 60, 1 };

static struct bb_lock_proof four(void)
{
	struct bb_lock_proof p;

	bb_lock_proof_init(&p, N, rate, LIMIT_NS);
	return p;
}

static void by_hand(void **state)
{
	static const struct {
		uint64_t counter[N];
		int64_t at_us[N], uncertainty_us, judged_us; /* judged_us: after the first */
		enum bb_lock_verdict want;
		unsigned display;
	} rows[] = {
		{ { 7, 7, 7, 7 }, { 0, 3, 5, 1 }, 1, 100, BB_LOCK_PROVEN, 2 },
		{ { 7, 8, 9, 7 }, { 0, 16670, 33338, 1 }, 1, 100000, BB_LOCK_PROVEN, 2 },      /* sampled in turn */
		{ { 7, 7, 6, 7 }, { 0, 3, 5, 1 }, 1, 100, BB_LOCK_COUNTERS_APART, 2 },
		{ { 7, 7, 7, 7 }, { 0, 3, 5, 16667 }, 1, 100, BB_LOCK_COUNTERS_APART, 3 },     /* a frame behind */
		{ { 6, 6, 7, 6 }, { 16667, 16667, 16667, 16667 }, 1, 100, BB_LOCK_COUNTERS_APART, 2 },
		{ { 7, 7, 7, 7 }, { 0, 400, 5, 1 }, 1, 100, BB_LOCK_PHASES_APART, 1 },
		{ { 7, 7, 7, 7 }, { 0, -400, 5, 1 }, 1, 100, BB_LOCK_PHASES_APART, 1 },
		{ { 7, 7, 7, 7 }, { 0, 30, 5, 1 }, 1, 100, BB_LOCK_PHASES_APART, 1 },
		{ { 7, 7, 7, 7 }, { 0, 15, 5, 1 }, 10, 100, BB_LOCK_INCONCLUSIVE, 1 },
		{ { 7, 7, 7, 7 }, { 0, 3, 5, 1 }, 50, 100, BB_LOCK_INCONCLUSIVE, 2 },
		{ { 7, 7, 7, 7 }, { 0, 3, 5, 1 }, 1, 11000000, BB_LOCK_INCONCLUSIVE, 0 },      /* too old */
		{ { UINT64_MAX, UINT64_MAX, 0, UINT64_MAX }, { 0, 1, 16667, 2 }, 1, 100, BB_LOCK_PROVEN, 3 }, /* wraps */
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		struct bb_lock_proof p = four();
		for (unsigned d = 0; d < N; d++)
			assert_true(bb_lock_proof_add(&p, d, rows[i].counter[d], BB_NS_PER_S + rows[i].at_us[d] * 1000,
			                              rows[i].uncertainty_us * 1000));
		const struct bb_lock_finding f = bb_lock_proof_judge(&p, BB_NS_PER_S + rows[i].judged_us * 1000);
		if (f.verdict != rows[i].want || f.display != rows[i].display)
			fail_msg("row %zu: %s, display %u", i, bb_lock_verdict_text(f.verdict), f.display);
	}
}

static void what_is_no_sample_is_ignored(void **state)
{
	struct bb_lock_proof p = four();
	(void)state;

	assert_int_equal(bb_lock_proof_judge(&p, 0).verdict, BB_LOCK_INCONCLUSIVE);
	assert_false(bb_lock_proof_add(&p, N, 1, 0, 0));
	assert_false(bb_lock_proof_add(&p, 0, 1, 0, -1));
	assert_true(bb_lock_proof_add(&p, 0, 1, T, 0));
	assert_false(bb_lock_proof_add(&p, 0, 1, 0, 0));
}

/* Half of all counters lie between these, which is as far as two can be from one another. */
static void counters_as_far_apart_as_can_be_are_told(void **state)
{
	struct bb_lock_proof p = four();
	(void)state;

	for (unsigned i = 0; i < N; i++)
		assert_true(bb_lock_proof_add(&p, i, i == 2 ? UINT64_C(1) << 63 : 0, T, 1000));
	const struct bb_lock_finding f = bb_lock_proof_judge(&p, T);
	assert_int_equal(f.verdict, BB_LOCK_COUNTERS_APART);
	assert_int_equal(f.display, 2);
}

/* A flip whose sequence stepped by two in one frame's time: the eyes are swapped from there on. */
static void a_dropped_frame_is_counted(void **state)
{
	struct bb_lock_proof p = four();
	(void)state;

	for (uint64_t k = 0; k < 100; k++)
		bb_lock_proof_add(&p, 1, k + (k >= 50), (int64_t)k * T, 1000);
	for (uint64_t k = 0; k < 100; k += 7)
		bb_lock_proof_add(&p, 2, k, (int64_t)k * T, 1000);
	assert_int_equal(p.display[1].skips, 1);
	assert_int_equal(p.display[2].skips, 0);
}

static unsigned read_text(struct bb_lock_proof *p, const char *text)
{
	*p = four();
	return bb_lock_proof_read(p, text, strlen(text));
}

static void recordings_are_read_or_refused_by_line(void **state)
{
	static const struct {
		const char *text;
		unsigned line;
	} rows[] = {
		{ "# a swap group\n0 12 1000 5\n1 12 1010 5 # late\n\n2 12 990 5\r\n3 12 1000 5", 0 },
		{ "0 12 1000\n", 1 },
		{ "0 12 1000 5\n4 12 1000 5\n", 2 },
		{ "0 12 1000 5 6\n", 1 },
		{ "0 12 1e3 5\n", 1 },
		{ "0 -1 1000 5\n", 1 },
		{ "0 1 99999999999999999999 5\n", 1 },
		{ "0 1 1000 5\n0 2 900 5\n", 2 },
		{ "0 1 1000 -5\n", 1 },
		{ "nan nan nan nan", 1 },
		{ "0 12-1000 5 5\n", 1 },
		{ "0 1 4611686018427387904 5\n0 2 4611686018435721237 5\n", 0 },
		{ "0 1 -9223372036854775807 5\n0 2 9223372036854775807 5\n", 1 },
		{ "0 1 0 5\n0 2 9223372036854775807 5\n", 2 },
		{ "0 1 1000 9223372036854775807\n", 1 },
		{ "", 0 },
	};
	struct bb_lock_proof p;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++)
		if (read_text(&p, rows[i].text) != rows[i].line)
			fail_msg("row %zu: line %u, want %u", i, read_text(&p, rows[i].text), rows[i].line);
	assert_int_equal(read_text(&p, rows[0].text), 0);
	assert_int_equal(bb_lock_proof_judge(&p, 1000).verdict, BB_LOCK_PROVEN);
}

struct stand {
	struct rig *rig;
	struct bb_display *display[N];
	char record[65536];
	size_t n_record;
};

static void open_displays(struct stand *s, bool genlock)
{
	memset(s, 0, sizeof(*s));
	s->rig = rig_create(5, 1);
	for (unsigned i = 0; i < N; i++) {
		struct bb_display_config c = s->rig->screen.display;
		c.genlock = genlock;
		c.rate_error_ppm = genlock ? (double)NAN : 10.0 * i;
		snprintf(c.id, sizeof(c.id), "d%u", i);
		assert_int_equal(bb_display_open(&sim_display_driver, &c, &s->rig->open, &s->display[i]), BB_OK);
	}
}

static void close_displays(struct stand *s)
{
	for (unsigned i = 0; i < N; i++)
		bb_display_close(s->display[i]);
	rig_destroy(s->rig);
}

/* For so many frames: a sample a frame, into the proof and into the recording. */
static struct bb_lock_finding watch(struct stand *s, struct bb_lock_proof *p, int frames)
{
	for (int k = 0; k < frames; k++) {
		rig_pass(s->rig, T);
		for (unsigned i = 0; i < N; i++) {
			struct bb_vblank v;
			uint64_t counter;
			assert_int_equal(bb_display_vblank(s->display[i], &v), BB_OK);
			if (bb_display_swap_counter(s->display[i], &counter) != BB_OK)
				counter = v.seq; /* of no group */
			const int64_t error_ns = bb_display_limits(s->display[i])->stamp_error_ns;
			assert_true(bb_lock_proof_add(p, i, counter, v.at_ns, error_ns));
			s->n_record += (size_t)snprintf(s->record + s->n_record, sizeof(s->record) - s->n_record,
			                                "%u %llu %lld %lld\n", i, (unsigned long long)counter, (long long)v.at_ns, (long long)error_ns);
		}
	}
	return bb_lock_proof_judge(p, rig_now(s->rig));
}

static void same_when_replayed(const struct stand *s, const struct bb_lock_finding *f)
{
	struct bb_lock_proof p = four();

	assert_int_equal(bb_lock_proof_read(&p, s->record, s->n_record), 0);
	const struct bb_lock_finding again = bb_lock_proof_judge(&p, bb_clock_now_ns(s->rig->clk));
	assert_memory_equal(&again, f, sizeof(again));
}

static void simulated_displays_and_their_recording_get_one_verdict(void **state)
{
	static struct stand s;
	struct bb_lock_proof p = four();
	(void)state;

	open_displays(&s, true);
	struct bb_lock_finding f = watch(&s, &p, 100);
	assert_int_equal(f.verdict, BB_LOCK_PROVEN);
	assert_true(f.skips == 0 && f.phase_ns > -6000 && f.phase_ns < 6000);
	same_when_replayed(&s, &f);
	/* One loses its reference: its crystal carries it away, and it is named. */
	assert_int_equal(rig_fault(s.rig, "display", "d2", "rate", "ppm=200", true), BB_OK);
	assert_int_equal(rig_fault(s.rig, "display", "d2", "unlock", "", true), BB_OK);
	f = watch(&s, &p, 100);
	assert_int_equal(f.verdict, BB_LOCK_PHASES_APART);
	assert_int_equal(f.display, 2);
	same_when_replayed(&s, &f);
	close_displays(&s);
}

static void displays_on_their_own_crystals_are_not_locked(void **state)
{
	static struct stand s;
	struct bb_lock_proof p = four();
	(void)state;

	open_displays(&s, false);
	const struct bb_lock_finding f = watch(&s, &p, 50);
	assert_true(f.verdict == BB_LOCK_PHASES_APART || f.verdict == BB_LOCK_COUNTERS_APART);
	close_displays(&s);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(by_hand),
		cmocka_unit_test(what_is_no_sample_is_ignored),
		cmocka_unit_test(counters_as_far_apart_as_can_be_are_told),
		cmocka_unit_test(a_dropped_frame_is_counted),
		cmocka_unit_test(recordings_are_read_or_refused_by_line),
		cmocka_unit_test(simulated_displays_and_their_recording_get_one_verdict),
		cmocka_unit_test(displays_on_their_own_crystals_are_not_locked),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
