/* tests/test_watch.c: incidents open at once, close after settling, and are not held against a settling device. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <string.h>

#include "bench/watch.h"

#define MS INT64_C(1000000)

static struct bb_watch *watch(void)
{
	struct bb_watch *w;

	assert_int_equal(bb_watch_create(2, NULL, 500 * MS, &w), BB_OK);
	assert_int_equal(bb_watch_slot(w, "camera", "c1"), 0);
	return w;
}

static void one_incident_for_a_flapping_fault(void **state)
{
	struct bb_watch *w = watch();
	const struct bb_incident *in;
	(void)state;

	for (int i = 0; i < 10; i++) {
		bb_watch_bad(w, 0, (1000 + 200 * i) * MS, BB_HEALTH_DEGRADED, "flap %d", i);
		bb_watch_good(w, 0, (1100 + 200 * i) * MS);
	}
	bb_watch_good(w, 0, 3400 * MS);
	assert_int_equal(bb_watch_health(w, 0), BB_HEALTH_OK);
	assert_int_equal(bb_watch_incidents(w, &in), 1);
	assert_int_equal(in[0].from_ns, 1000 * MS);
	assert_int_equal(in[0].to_ns, 2900 * MS); /* good since then; the settling time is not counted */
	assert_string_equal(in[0].culprit, "camera/c1");
	assert_true(bb_watch_longest_bad_s(w, 0) > 1.89 && bb_watch_longest_bad_s(w, 0) < 1.91);
	bb_watch_destroy(w);
}

static void the_worst_state_and_its_words_stay(void **state)
{
	struct bb_watch *w = watch();
	const struct bb_incident *in;
	(void)state;

	bb_watch_bad(w, 0, 0, BB_HEALTH_DEGRADED, "weak");
	bb_watch_bad(w, 0, 5 * MS, BB_HEALTH_LOST, "gone");
	bb_watch_bad(w, 0, 9 * MS, BB_HEALTH_DEGRADED, "weak");
	bb_watch_finish(w, 2000 * MS);
	assert_int_equal(bb_watch_incidents(w, &in), 1);
	assert_string_equal(in[0].state, "LOST");
	assert_string_equal(in[0].what, "gone");
	assert_true(in[0].to_ns == BB_NEVER); /* until the end */
	assert_true(bb_watch_bad_s(w, 0) > 1.99);
	bb_watch_destroy(w);
}

static void many_slots_and_incidents_stay_in_bounds(void **state)
{
	struct bb_watch *w = watch();
	const struct bb_incident *in;
	(void)state;

	for (int i = 0; i < 10; i++)
		assert_true(bb_watch_slot(w, "camera", "more") < 2);
	for (int64_t i = 0; i < 5000; i++) {
		bb_watch_bad(w, 1, i * 2000 * MS, BB_HEALTH_DEGRADED, "again");
		bb_watch_good(w, 1, i * 2000 * MS + MS);
		bb_watch_good(w, 1, i * 2000 * MS + 600 * MS);
	}
	assert_true(bb_watch_incidents(w, &in) <= 1024);
	assert_true(bb_watch_bad_s(w, 1) > 4.9 && bb_watch_bad_s(w, 1) < 5.1); /* the sums go on */
	bb_watch_destroy(w);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(one_incident_for_a_flapping_fault),
		cmocka_unit_test(the_worst_state_and_its_words_stay),
		cmocka_unit_test(many_slots_and_incidents_stay_in_bounds),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
