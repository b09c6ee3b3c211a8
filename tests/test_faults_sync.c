/*
 * tests/test_faults_sync.c: rows G1 to G8, C6, O2 and O4 of the fault matrix in a whole room: what the loop names, how soon,
 * what the outputs do about it, and when all is well again. (What the drivers make of a line or a bus: test_faults_gpio.c
 * and test_faults_can.c.) A period is that of the sync, 8.33 ms.
 */
#include "tests/fault_table.h"
#include "tests/still_run.h"

#include <signal.h>
#include <sys/stat.h>

#define PERIOD (BB_NS_PER_S / 120)
#define FRAME (BB_NS_PER_S / 60)

struct story { /* what a run has to tell */
	struct bb_incident incident[16];
	size_t n;
	int64_t set_ns;               /* scene time of the first fault */
	int64_t opened_ns, closed_ns; /* scene time the outputs first opened; last closed; BB_NEVER: never */
	uint64_t opened, swapped_back, gaps, gap_ms, frames;
	double flashes, swaps;
	bool truncated;
	/* while it runs */
	int64_t start_ns, stop_at_ns, stopped_ns;
	volatile sig_atomic_t stop;
	int64_t safe_ns;              /* the shutters were open after the stop, clock time */
	uint64_t n_events, sum;       /* without those of faults and health */
};

static void follow(void *ctx, const struct bb_event *events, size_t n)
{
	struct story *s = ctx;

	for (size_t i = 0; i < n; i++) {
		const struct bb_event *e = &events[i];
		if (e->kind != BB_EV_FAULT && e->kind != BB_EV_HEALTH) {
			s->n_events++;
			s->sum = s->sum * 31 + (uint64_t)(e->at_ns * 7 + e->a * 3 + e->b);
		}
		if (e->kind == BB_EV_OUTPUT && e->a && s->opened_ns == BB_NEVER)
			s->opened_ns = e->at_ns;
		if (e->kind == BB_EV_OUTPUT && !e->a)
			s->closed_ns = s->closed_ns > e->at_ns || s->closed_ns == BB_NEVER ? e->at_ns : s->closed_ns;
		if (s->stop && e->kind == BB_EV_EDGE && e->a == BB_EYE_NONE && e->at_ns >= s->stopped_ns && !s->safe_ns)
			s->safe_ns = e->at_ns;
	}
}

static void at_time(void *ctx, double done, const char *what)
{
	struct story *s = ctx;

	if (s->stop_at_ns && !strcmp(what, "frames") && done * 10 >= (double)s->stop_at_ns * 1e-9 && !s->stop) {
		s->stop = SIGTERM;
		s->stopped_ns = s->start_ns + (int64_t)(done * 10e9);
	}
}

/* A room like rooms/cabin.yaml but for its chain's device and safety, in a folder of its own. */
static void write_room(char *path, size_t cap, const char *dir, const char *device, const char *safety)
{
	char text[16384], cwd[400], link[2][600];
	FILE *in = fopen("rooms/cabin.yaml", "r");
	assert_non_null(in);
	const size_t n = fread(text, 1, sizeof(text) - 1, in);
	fclose(in);
	text[n] = '\0';
	char *chain = strstr(text, "chain: {");
	assert_non_null(chain);
	assert_non_null(getcwd(cwd, sizeof(cwd)));
	snprintf(link[0], sizeof(link[0]), "%s/rooms/profiles", cwd);
	snprintf(link[1], sizeof(link[1]), "%s/profiles", dir);
	(void)!symlink(link[0], link[1]);
	snprintf(link[0], sizeof(link[0]), "%s/scenes", cwd);
	snprintf(link[1], sizeof(link[1]), "%s/scenes", dir);
	(void)!symlink(link[0], link[1]);
	snprintf(path, cap, "%s/room.yaml", dir);
	FILE *out = fopen(path, "w");
	assert_non_null(out);
	fprintf(out, "%.*schain: {device: \"%s\", %s", (int)(chain - text), text, device, chain + 8);
	if (safety)
		fprintf(out, "\nsafety: {%s}\n", safety);
	fclose(out);
}

struct setting {
	const char *device, *safety;
	double stop_at_s;
};

static void tell(struct story *s, const struct setting *set, const char *const *texts, size_t n_texts)
{
	struct sim_fault f[8];
	struct bb_run run;
	char dir[] = "/tmp/bb_sync_XXXXXX", room[64], name[64];
	size_t n = 0;

	memset(s, 0, sizeof(*s));
	s->opened_ns = s->closed_ns = BB_NEVER;
	s->stop_at_ns = (int64_t)(set->stop_at_s * 1e9);
	assert_non_null(mkdtemp(dir));
	write_room(room, sizeof(room), dir, set->device, set->safety);
	for (size_t i = 0; i < n_texts; i++)
		plant(f, &n, texts[i]);
	struct bb_run_options o = still_options(room, f, n);
	o.events = follow;
	o.progress = at_time;
	o.events_ctx = o.progress_ctx = s;
	o.stop = &s->stop;
	s->start_ns = 350 * MS; /* bring-up of 0.1 s, then 0.25 s to settle */
	still_run(o, &run);
	const struct bb_run_result *r = run.result;
	assert_true(llabs(llround(r->scene_start_s * 1e9) - s->start_ns) < 2);
	for (size_t i = 0; i < r->n_incidents && s->n < BB_ARRAY_LEN(s->incident); i++)
		s->incident[s->n++] = r->incidents[i];
	s->set_ns = r->n_faults ? r->faults[0].set_ns : 0;
	s->opened = counted(r, "shutters_opened");
	s->swapped_back = counted(r, "eyes_swapped_back");
	s->gaps = counted(r, "gaps");
	s->gap_ms = counted(r, "gap_ms");
	s->frames = counted(r, "frames");
	s->flashes = bb_ledger_metric(r->ledger, BB_METRIC_FLASHES).max;
	const struct bb_summary swaps = bb_ledger_metric(r->ledger, BB_METRIC_EYE_SWAPS);
	s->swaps = swaps.mean * (double)swaps.n;
	s->truncated = r->truncated;
	s->opened_ns -= s->opened_ns == BB_NEVER ? 0 : s->start_ns;
	s->closed_ns -= s->closed_ns == BB_NEVER ? 0 : s->start_ns;
	bb_run_free(&run);
	unlink(room);
	snprintf(name, sizeof(name), "%s/profiles", dir);
	unlink(name);
	snprintf(name, sizeof(name), "%s/scenes", dir);
	unlink(name);
	rmdir(dir);
	assert_true(s->flashes <= 3);
}

static const struct bb_incident *named(const struct story *s, const char *word)
{
	return incident_named(s->incident, s->n, word);
}

/* Named within the budget after the fault; well again, so long after its end. */
static void row(const char *id, const char *injected, const struct story *s, const char *word, int64_t budget_ns,
                int64_t for_ns, int64_t recover_most_ns)
{
	const struct bb_incident *in = named(s, word);
	const int64_t found_ns = in->from_ns - s->set_ns;
	const int64_t over_ns = in->to_ns == BB_NEVER ? BB_NEVER : in->to_ns - s->set_ns - for_ns;

	fault_row(id, injected, in->what, found_ns, budget_ns, over_ns == BB_NEVER || over_ns > 0 ? over_ns : 0);
	assert_in_range(found_ns, 0, budget_ns);
	if (recover_most_ns == BB_NEVER)
		assert_true(in->to_ns == BB_NEVER);
	else
		assert_true(over_ns <= recover_most_ns);
}

#define TELL(s, setting, ...)                                                                                        \
	do {                                                                                                        \
		const char *const texts[] = { __VA_ARGS__ };                                                        \
		tell(s, setting, texts, BB_ARRAY_LEN(texts));                                                       \
	} while (0)

static const struct setting plain = { "sim:", NULL, 0 };

static void g1_sync_line_stuck(void **state)
{
	const struct setting coasts = { "sim:?coast_s=30", "holdover_most_s: 2", 0 };
	struct story s;

	(void)state;
	TELL(&s, &plain, "at 2s shutter/chain stuck for 1s"); /* cells that stand cannot wait longer than 250 ms */
	row("G1", "room: line stuck 1 s, chain stands", &s, "SYNC_LOST", PERIOD * 3 / 2, 1000 * MS, 2000 * MS);
	assert_in_range(s.opened_ns - s.set_ns, 230 * MS, 260 * MS);
	assert_int_equal(s.opened, 1);
	assert_string_equal(named(&s, "SYNC_LOST")->state, "LOST");
	TELL(&s, &coasts, "at 2s shutter/chain stuck for 1.5s"); /* within the time-box: nobody sees anything */
	row("G1", "room: line stuck 1.5 s, chain coasts", &s, "SYNC_LOST", PERIOD * 3 / 2, 1500 * MS, 8 * PERIOD + FRAME + PERIOD);
	assert_int_equal(s.opened, 0);
	assert_string_equal(named(&s, "SYNC_LOST")->state, "HOLDOVER");
	assert_true(s.flashes < 0.6);
	TELL(&s, &coasts, "at 2s shutter/chain stuck for 3s"); /* beyond it: open, mono, and a fade back */
	row("G1", "room: line stuck 3 s, holdover at most 2 s", &s, "SYNC_LOST", PERIOD * 3 / 2, 3000 * MS, 3000 * MS);
	assert_in_range(s.opened_ns - s.set_ns, 2000 * MS - PERIOD - 1, 2000 * MS + FRAME + PERIOD);
	assert_in_range(s.closed_ns - s.opened_ns, 2250 * MS, 2600 * MS); /* latched, then a fade to a quarter of the light */
}

static void g2_g3_single_edges(void **state)
{
	struct story s;

	(void)state;
	TELL(&s, &plain, "at 2s shutter/chain double n=1");
	row("G2", "room: one spurious edge", &s, "GLITCH", FRAME + PERIOD, 0, 3 * FRAME);
	assert_int_equal(s.opened, 0);
	TELL(&s, &plain, "at 2s shutter/chain miss n=1");
	row("G3", "room: one pulse missed", &s, "SYNC_LOST", PERIOD * 3 / 2 + 1, 0, 12 * PERIOD);
	assert_int_equal(s.opened, 0);
	assert_true(s.swaps <= 0);
}

static void g4_events_lost(void **state)
{
	struct story s;

	(void)state;
	/* Five seconds unread are 3600 edges, and a queue holds 512: the rest is gone, its parity known by its tags. */
	TELL(&s, &plain, "at 2s node/head suspend for 5s");
	row("G4", "room: nobody reads edges for 5 s", &s, "GAP", 5000 * MS + 3 * FRAME, 5000 * MS, 2 * FRAME);
	assert_true(s.swaps <= 0);
	assert_int_equal(s.opened, 0);
}

static void g5_g6_drift_and_jitter(void **state)
{
	struct story s;

	(void)state;
	for (int sign = -1; sign <= 1; sign += 2) {
		const struct setting off = { sign < 0 ? "sim:?rate_error_ppm=-100" : "sim:?rate_error_ppm=100", NULL, 0 };
		tell(&s, &off, NULL, 0);
		assert_int_equal(s.n, 0);
		assert_int_equal(s.opened, 0);
		fault_row("G5", sign < 0 ? "room: sync at -100 ppm" : "room: sync at +100 ppm", "(none)", 0, 2 * BB_NS_PER_S, 0);
	}
	TELL(&s, &plain, "at 2s shutter/chain jitter_burst us=200 for 1s");
	row("G6", "room: jitter 200 us rms for 1 s", &s, "JITTER", 10 * PERIOD, 1000 * MS, 1500 * MS);
	assert_int_equal(s.opened, 0);
	TELL(&s, &plain, "at 2s shutter/chain jitter_burst us=960 for 1s"); /* 20 % of a period: an eye's light would flicker */
	row("G6", "room: jitter 960 us rms for 1 s", &s, "SYNC_FLAPS", 30 * PERIOD, 1000 * MS, 3000 * MS);
}

static void g7_rate_change(void **state)
{
	struct story s;

	(void)state;
	TELL(&s, &plain, "at 2s shutter/chain rate hz=96 for 1s");
	row("G7", "room: rate 120 to 96 Hz for 1 s", &s, "RATE_CHANGE", 5 * BB_NS_PER_S / 96, 1000 * MS, 2500 * MS);
	assert_in_range(s.opened_ns - s.set_ns, 0, 5 * BB_NS_PER_S / 96); /* open and mono, never blank */
	assert_int_equal(s.opened, 1);
}

static void g8_polarity(void **state)
{
	const struct setting untagged = { "sim:?untagged=1", NULL, 0 };
	struct story s;

	(void)state;
	TELL(&s, &plain, "at 2s shutter/chain flip_polarity for 4s");
	row("G8", "room: glasses inverted for 4 s, tagged", &s, "eye", 2 * FRAME, 4000 * MS, 10 * FRAME);
	assert_int_equal(s.swapped_back, 2); /* the walls' pictures follow the tags, and follow them back */
	assert_true(s.swaps <= 4);           /* frames shown before that */
	assert_int_equal(s.opened, 0);
	TELL(&s, &untagged, "at 2s shutter/chain miss n=3");
	row("G8", "room: untagged, three pulses missed", &s, "EYES_UNKNOWN", 200 * MS, 0, BB_NEVER);
}

static void c6_chain_unreachable(void **state)
{
	struct story s;

	(void)state;
	TELL(&s, &plain, "at 2s shutter/chain unplug for 1s");
	row("C6", "room: chain does not answer for 1 s", &s, "CHAIN_GONE", 50 * MS, 1000 * MS, 2500 * MS);
	assert_in_range(s.opened_ns - s.set_ns, 0, 50 * MS);
}

static void o2_asked_to_stop(void **state)
{
	const struct setting stop = { "sim:", NULL, 3 };
	struct story s;

	(void)state;
	tell(&s, &stop, NULL, 0);
	assert_true(s.truncated && s.stop == SIGTERM);
	assert_in_range(s.frames, 170, 185);
	assert_in_range(s.safe_ns - s.stopped_ns, 0, FRAME + MS); /* asked within a frame, open at the begin of the next */
	fault_row("O2", "room: SIGTERM in the middle of a frame", "(stopped)", s.safe_ns - s.stopped_ns, FRAME + MS, 0);
}

static void o4_stood_still(void **state)
{
	struct story s;

	(void)state;
	TELL(&s, &plain, "at 2s node/head suspend for 5s");
	row("O4", "room: suspended for 5 s", &s, "GAP", 5000 * MS + 3 * FRAME, 5000 * MS, 2 * FRAME);
	assert_int_equal(s.gaps, 1);
	assert_in_range(s.gap_ms, 4990, 5020);
	assert_in_range(s.frames, 295, 302); /* five of ten seconds: nothing is made up for */
	TELL(&s, &plain, "at 2s node/head suspend for 40ms"); /* less than three frames is no gap */
	assert_int_equal(s.gaps, 0);
}

/* A second or three years, on or back: told in the next frame, and nothing else is another than without. */
static void n4_wall_clock_set(void **state)
{
	static const char *const by[] = { "1", "-1", "1e8", "-1e8" };
	struct story plain_one, s;
	char text[64], label[64];

	(void)state;
	tell(&plain_one, &plain, NULL, 0);
	for (size_t i = 0; i < BB_ARRAY_LEN(by); i++) {
		snprintf(text, sizeof(text), "at 2s node/head set_clock s=%s", by[i]);
		snprintf(label, sizeof(label), "room: wall clock set by %s s", by[i]);
		TELL(&s, &plain, text);
		row("N4", label, &s, "CLOCK_STEP", FRAME + MS, 0, BB_NEVER);
		assert_int_equal(s.n, 1);
		assert_int_equal(s.n_events, plain_one.n_events);
		assert_int_equal(s.frames, plain_one.frames);
		assert_int_equal(s.sum, plain_one.sum);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(g1_sync_line_stuck), cmocka_unit_test(g2_g3_single_edges), cmocka_unit_test(g4_events_lost),
		cmocka_unit_test(g5_g6_drift_and_jitter), cmocka_unit_test(g7_rate_change), cmocka_unit_test(g8_polarity),
		cmocka_unit_test(c6_chain_unreachable), cmocka_unit_test(o2_asked_to_stop), cmocka_unit_test(o4_stood_still),
		cmocka_unit_test(n4_wall_clock_set),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
