/*
 * tests/test_orphan.c: rows N3 and N8 in a whole run: a wall that hears nothing of the head holds its picture for a second,
 * fades to black in half a second or more, stays dark, and comes back when the head does; nothing about it flashes.
 */
#include "tests/fault_table.h"
#include "tests/still_run.h"

#define MS INT64_C(1000000)
#define FRAME (BB_NS_PER_S / 60)

struct story { /* of one node; times since the fault */
	const char *fault;
	int64_t set_ns, clear_ns;            /* clock time */
	int64_t alone_ns, fade_ns, dark_ns, heard_ns, bright_ns;
	double deepest_step, light;
	uint16_t source;
	int64_t n_alone;
};

static void follow(void *ctx, const struct bb_event *events, size_t n)
{
	struct story *s = ctx;

	for (size_t i = 0; i < n; i++) {
		const struct bb_event *e = &events[i];
		if (e->kind == BB_EV_FAULT)
			*(e->b ? &s->set_ns : &s->clear_ns) = e->at_ns;
		if (e->kind != BB_EV_ORPHAN || (s->source && e->source != s->source))
			continue;
		const double light = (double)e->b * 1e-6;
		if (!s->source) { /* the first to be alone; the others are alike */
			s->source = e->source;
			s->alone_ns = e->at_ns;
			s->light = 1;
		}
		s->n_alone += e->a;
		s->fade_ns = !s->fade_ns && light < 1 ? e->at_ns : s->fade_ns;
		s->dark_ns = !s->dark_ns && e->b == 0 ? e->at_ns : s->dark_ns;
		s->heard_ns = !e->a && !s->heard_ns ? e->at_ns : s->heard_ns;
		s->bright_ns = s->heard_ns && e->b == 1000000 ? e->at_ns : s->bright_ns;
		s->deepest_step = fmax(s->deepest_step, fabs(light - s->light));
		s->light = light;
	}
}

static void tell(struct story *s, const char *row, const char *fault, double flashes_most)
{
	struct sim_fault f[1];
	struct bb_run run;
	size_t n = 0;

	memset(s, 0, sizeof(*s));
	plant(f, &n, fault);
	struct bb_run_options o = still_options("rooms/cabin.yaml", f, n);
	o.events = follow;
	o.events_ctx = s;
	still_run(o, &run);
	assert_true(s->source && s->set_ns);
	fault_row(row, fault, "MASTER_LOST", s->alone_ns - s->set_ns, 3 * FRAME, s->bright_ns - s->clear_ns);
	assert_true(bb_ledger_metric(run.result->ledger, BB_METRIC_FLASHES).max <= flashes_most);
	bool told = false;
	for (size_t i = 0; i < run.result->n_incidents; i++)
		told |= strstr(run.result->incidents[i].what, "MASTER_LOST") != NULL;
	assert_true(told);
	bb_run_free(&run);
}

static void holds_fades_and_returns(const struct story *s)
{
	/* Three periods after the last word, which may have been a period before the fault. */
	assert_true(s->alone_ns - s->set_ns <= 3 * FRAME + MS && s->alone_ns > s->set_ns);
	const int64_t held_ns = s->fade_ns - s->set_ns, fade_ns = s->dark_ns - s->fade_ns;
	assert_true(held_ns >= 900 * MS && held_ns <= 1100 * MS);
	assert_true(fade_ns >= 500 * MS - 2 * FRAME && fade_ns <= 700 * MS);
	assert_true(s->deepest_step <= 0.05 + 1e-6);
	assert_true(s->heard_ns >= s->clear_ns && s->heard_ns - s->clear_ns < 4 * FRAME);
	assert_true(s->bright_ns > s->heard_ns + 400 * MS && s->bright_ns < s->heard_ns + BB_NS_PER_S);
}

static void n3_cut_off(void **state)
{
	struct story s;

	(void)state;
	tell(&s, "N3", "at 2s link/net partition node=front for 4s", 1);
	holds_fades_and_returns(&s);
}

static void n8_head_stands_still(void **state)
{
	struct story s;

	(void)state;
	tell(&s, "N8", "at 2s node/head suspend for 4s", 1);
	holds_fades_and_returns(&s);
}

static void a_short_silence_is_held_only(void **state)
{
	struct story s;

	(void)state;
	tell(&s, "N3", "at 2s link/net down for 500ms", 0);
	assert_true(s.alone_ns - s.set_ns <= 3 * FRAME + MS);
	assert_int_equal(s.dark_ns, 0);
	assert_true(s.light >= 1 && s.deepest_step <= 0);
}

/* The head comes back in the middle of the fade: no turn before hal/safe_state.h's two seconds are over. */
static void back_in_the_middle_of_a_fade(void **state)
{
	struct story s;

	(void)state;
	tell(&s, "N3", "at 2s link/net partition node=front for 1250ms", 1);
	assert_true(s.dark_ns && s.heard_ns && s.bright_ns - s.fade_ns >= 2 * BB_NS_PER_S);
	assert_true(s.deepest_step <= 0.05 + 1e-6);
}

static void count_again(void *ctx, const struct bb_event *events, size_t n)
{
	for (size_t i = 0; i < n; i++) /* -1: pictures shown once more */
		*(size_t *)ctx += events[i].kind == BB_EV_FLIP && events[i].a == -1;
}

/* Held pictures that stayed one eye's would be seen by both. */
static void held_eyes_go_on_to_take_turns(void **state)
{
	struct sim_fault f[1];
	struct bb_run run;
	size_t n = 0, again = 0;

	(void)state;
	plant(f, &n, "at 2s link/net partition node=front for 1s");
	struct bb_run_options o = still_options("rooms/cabin120.yaml", f, n);
	o.events = count_again;
	o.events_ctx = &again;
	still_run(o, &run);
	bb_run_free(&run);
	assert_in_range(again, 108, 120); /* 120 a second, but for the three frames before it is missed */
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(n3_cut_off), cmocka_unit_test(n8_head_stands_still),
		cmocka_unit_test(a_short_silence_is_held_only), cmocka_unit_test(back_in_the_middle_of_a_fade),
		cmocka_unit_test(held_eyes_go_on_to_take_turns),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
