/* tests/test_flash_latch.c: the flapping sync line of tests/test_flash_unlatched.c, and the latch holds it. */
#include "tests/flash_flapping.h"

static void with_the_latch_it_does_not(void **state)
{
	(void)state;
	for (uint64_t room = 0; room < 2; room++) {
		const struct campaign c = flapping(room);
		printf("flashes: %s flapping at 10 Hz with the latch: %.1f a second by the meter, %.1f by the oracle, opened %llu "
		       "times\n", room ? "cabin" : "cabin120", c.meter, c.oracle / 2.0, (unsigned long long)c.opened);
		assert_true(c.meter <= 3);
		assert_true(c.oracle <= 6);
		assert_in_range(c.opened, 1, 5);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = { cmocka_unit_test(with_the_latch_it_does_not) };

	return cmocka_run_group_tests(tests, NULL, NULL);
}
