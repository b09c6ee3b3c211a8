/* tests/test_barrier.c: the swap barrier: releases together, names the late, drops the dead, takes them back. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "sync/barrier.h"

#define T INT64_C(16666667)
#define ALL UINT64_C(0x1F)

static struct bb_barrier five(void)
{
	struct bb_barrier b;

	bb_barrier_init(&b, 5, 3 * T, 3);
	return b;
}

static void all_but(struct bb_barrier *b, uint64_t frame, unsigned absent, int64_t now_ns)
{
	for (unsigned i = 0; i < 5; i++)
		if (i != absent)
			bb_barrier_arrive(b, i, frame, now_ns + i);
}

static void releases_when_the_last_arrives(void **state)
{
	struct bb_barrier b = five();
	struct bb_release r;
	(void)state;

	bb_barrier_open(&b, 7, ALL, 100);
	all_but(&b, 7, 3, 1000);
	assert_false(bb_barrier_step(&b, 2000, &r));
	bb_barrier_arrive(&b, 3, 7, 3000);
	assert_true(bb_barrier_step(&b, 3000, &r));
	assert_int_equal(r.frame, 7);
	assert_int_equal(r.missing, 0);
	assert_int_equal(r.last, 3);
	assert_int_equal(r.first_ns, 1000);
	assert_int_equal(r.last_ns, 3000);
	assert_false(bb_barrier_step(&b, 4000, &r)); /* once */
}

static void names_the_missing_at_the_deadline(void **state)
{
	struct bb_barrier b = five();
	struct bb_release r;
	(void)state;

	bb_barrier_open(&b, 1, ALL, 0);
	all_but(&b, 1, 2, 500);
	assert_false(bb_barrier_step(&b, 3 * T - 1, &r));
	assert_true(bb_barrier_step(&b, 3 * T, &r));
	assert_int_equal(r.missing, 1 << 2);
	assert_int_equal(r.last, 2);
}

static void drops_after_three_and_takes_back(void **state)
{
	struct bb_barrier b = five();
	struct bb_release r;
	int64_t now_ns = 0;
	(void)state;

	for (uint64_t frame = 0; frame < 3; frame++) {
		bb_barrier_open(&b, frame, ALL, now_ns);
		all_but(&b, frame, 4, now_ns + 1);
		now_ns += 3 * T;
		assert_true(bb_barrier_step(&b, now_ns, &r));
	}
	bb_barrier_open(&b, 3, ALL, now_ns);
	all_but(&b, 3, 4, now_ns + 1);
	assert_true(bb_barrier_step(&b, now_ns + 10, &r)); /* nobody waits for a dead node */
	bb_barrier_arrive(&b, 4, 2, now_ns + 20);          /* it talks again, of an old frame */
	bb_barrier_open(&b, 4, ALL, now_ns + T);
	all_but(&b, 4, 4, now_ns + T + 1);
	assert_false(bb_barrier_step(&b, now_ns + T + 10, &r));
	bb_barrier_arrive(&b, 4, 4, now_ns + T + 20);
	assert_true(bb_barrier_step(&b, now_ns + T + 20, &r));
	assert_int_equal(r.last, 4);
}

static void ignores_strangers_and_other_frames(void **state)
{
	struct bb_barrier b = five();
	struct bb_release r;
	(void)state;

	bb_barrier_open(&b, 9, ALL, 0);
	bb_barrier_arrive(&b, 63, 9, 1);
	bb_barrier_arrive(&b, 500, 9, 1);
	for (unsigned i = 0; i < 5; i++)
		bb_barrier_arrive(&b, i, 8, 1);
	assert_false(bb_barrier_step(&b, 10, &r));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(releases_when_the_last_arrives),
		cmocka_unit_test(names_the_missing_at_the_deadline),
		cmocka_unit_test(drops_after_three_and_takes_back),
		cmocka_unit_test(ignores_strangers_and_other_frames),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
