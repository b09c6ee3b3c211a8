/* tests/test_blackbox.c: planted faults, and whether what the black box puts first is what was planted. */
#include "bench/blackbox.h"
#include "tests/still_run.h"

static void first_cause(const char *fault, const char *culprit, const char *words)
{
	struct sim_fault f[1];
	struct bb_run run;
	size_t n = 0;

	if (fault)
		plant(f, &n, fault);
	struct bb_run_options o = still_options("rooms/cabin.yaml", f, n);
	o.duration_s = 4;
	still_run(o, &run);
	const struct bb_run_result *r = run.result;
	if (!culprit) {
		assert_int_equal(r->n_black, 0);
	} else {
		assert_true(r->n_black >= 1);
		for (size_t i = 0; i < r->n_black; i++) {
			const struct bb_black_cause *c = &r->black[i].cause[0];
			if (!r->black[i].n_causes || strcmp(c->culprit, culprit) || !strstr(c->text, words))
				fail_msg("%s: %s: %s", fault, r->black[i].what, c->text);
		}
		printf("black box: %-46s %s\n", fault, r->black[0].cause[0].text);
	}
	bb_run_free(&run);
}

static void the_first_cause_is_the_planted_one(void **state)
{
	(void)state;
	first_cause(NULL, NULL, NULL);
	first_cause("at 2s shutter/chain stuck for 1s", "shutter/chain", "SYNC_LOST");
	first_cause("at 2s shutter/chain unplug for 1s", "shutter/chain", "CHAIN_GONE");
	first_cause("at 2s shutter/chain rate hz=96 for 1s", "shutter/chain", "RATE_CHANGE");
	first_cause("at 2s node/right slow ms=20", "node/right", "drawing took");
	first_cause("at 2s node/left late frames=2 for 1s", "node/left", "drawing took");
	first_cause("at 2s node/back crash for 1s", "node/back", "never took the scene state");
	first_cause("at 2s link/net partition node=floor for 1s", "node/floor", "never took the scene state");
	first_cause("at 2s link/net down for 500ms", "link/net", "the network is down");
	first_cause("at 2s display/front drop_flip n=3", "display/front", "never showed frame");
}

/* What is not kept is counted; the events are the last ones, in order. */
static void told_of_all(const struct bb_blackbox *b, const struct bb_run_result *r)
{
	char dir[] = "/tmp/bb_black_XXXXXX", path[64], line[256] = "";
	struct bb_error err = { 0 };
	long a, before = 0, n = 0;

	assert_non_null(mkdtemp(dir));
	assert_int_equal(bb_blackbox_write(b, r, dir, &err), BB_OK);
	snprintf(path, sizeof(path), "%s/blackbox.txt", dir);
	FILE *f = fopen(path, "r");
	assert_non_null(f);
	while (fgets(line, sizeof(line), f)) {
		const char *draw = strstr(line, " draw ");
		if (!draw)
			continue;
		a = atol(draw + 6);
		assert_true(n++ % BB_BLACKBOX_EVENTS == 0 || a == (before + 1) % 300);
		before = a;
	}
	assert_int_equal(n, 4 * BB_BLACKBOX_EVENTS);
	assert_int_equal(before, 299);
	assert_string_equal(line, "50 times in all that something went wrong; the first 4, a second apart, are kept\n");
	fclose(f);
	unlink(path);
	snprintf(path, sizeof(path), "%s/blackbox.json", dir);
	unlink(path);
	rmdir(dir);
}

/* Late because of bricks: the sentence says so, and how long they took. */
static void bricks_are_named(void **state)
{
	struct bb_run_result r = { 0 };
	struct bb_eventlog *log = calloc(1, sizeof(*log));
	struct bb_room room = { .n_nodes = 4 };
	struct bb_node nodes[4] = { { .id = "head" }, { .id = "n1" }, { .id = "n2" }, { .id = "n3" } };
	struct bb_blackbox *b;

	(void)state;
	assert_non_null(log);
	bb_eventlog_init(log, NULL, NULL);
	assert_int_equal(bb_blackbox_create(log, &b), BB_OK);
	assert_int_equal(bb_ledger_create(100, 4, &r.ledger), BB_OK);
	room.nodes = nodes;
	r.room = &room;
	for (uint64_t k = 0; k < 50; k++) {
		bb_ledger_span(r.ledger, k, BB_STAGE_SELECT, 3, 0, (int64_t)k * 8 * MS, (int64_t)k * 8 * MS + MS);
		bb_ledger_span(r.ledger, k, BB_STAGE_DRAW, 3, 0, (int64_t)k * 8 * MS, (int64_t)k * 8 * MS + 2 * MS);
	}
	struct bb_event e[300] = { 0 };
	for (int i = 0; i < 300; i++)
		e[i] = (struct bb_event){ .at_ns = i, .a = i, .kind = BB_EV_DRAW };
	for (int k = 0; k < 20; k++)
		bb_blackbox_events(b, e, 300);
	const struct bb_black_trigger t = { .kind = BB_BLACK_LATE, .at_ns = 400 * MS, .frame = 8123, .node = 3,
		                            .load_ns = 41 * MS, .draw_ns = 3 * MS };
	bb_blackbox_trigger(b, &t);
	for (int64_t k = 1; k < 50; k++) { /* a storm of them: four are kept, a second apart */
		struct bb_black_trigger more = t;
		more.at_ns += k * 100 * MS;
		bb_blackbox_trigger(b, &more);
	}
	bb_blackbox_rank(b, &r);
	assert_int_equal(r.n_black, 4);
	assert_string_equal(r.black[0].cause[0].text, "node/n3 late at frame 8123: its bricks took 41 ms (usually 1)");
	assert_string_equal(r.black[0].cause[1].text, "node/n3 late at frame 8123: drawing took 3 ms (usually 2)");
	told_of_all(b, &r);
	bb_blackbox_destroy(b);
	bb_ledger_destroy(r.ledger);
	free(log);
}

int main(void)
{
	const struct CMUnitTest tests[] = { cmocka_unit_test(the_first_cause_is_the_planted_one),
		                            cmocka_unit_test(bricks_are_named) };

	return cmocka_run_group_tests(tests, NULL, NULL);
}
