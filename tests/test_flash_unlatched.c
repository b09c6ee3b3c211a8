/*
 * tests/test_flash_unlatched.c: does the flash meter see what the latch prevents? This program has the outputs' state
 * machine and their guard built without latch and fades (the linker takes these copies instead of the library's), and a
 * sync line that flaps ten times a second: it must be found to flash. The same fault with the latch in is in
 * tests/test_flash_latch.c.
 */
#define BB_SAFE_UNLATCHED
#include "hal/safe_state.c"
#include "sync/sync_guard.c"

#include "tests/flash_flapping.h"

static void without_the_latch_it_flashes(void **state)
{
	(void)state;
	for (uint64_t room = 0; room < 2; room++) {
		const struct campaign c = flapping(room);
		printf("flashes: %s flapping at 10 Hz without the latch: %.1f a second by the meter, %.1f by the oracle, opened %llu "
		       "times\n", room ? "cabin" : "cabin120", c.meter, c.oracle / 2.0, (unsigned long long)c.opened);
		assert_true(c.meter > 3);
		assert_true(c.oracle > 6);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = { cmocka_unit_test(without_the_latch_it_flashes) };

	return cmocka_run_group_tests(tests, NULL, NULL);
}
