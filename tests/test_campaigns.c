/*
 * tests/test_campaigns.c: random faults for ten seconds, again and again, and never more than three flashes in a second, as
 * the run's own meter sees it and as an oracle does that knows what the shutters really did. What the light does while the
 * head is suspended nobody can hold: turning points of then are left out, and seconds that flash with them counted apart.
 * `test_campaigns 10000 [FIRST]` runs so many (make soak).
 */
#include "tests/flash_campaign.h"

static uint64_t n_campaigns = 200, first;

static void no_campaign_flashes(void **state)
{
	struct sim_fault *f = calloc(300, sizeof(*f));
	uint64_t opened = 0, faults = 0, silent = 0, nobody = 0;
	double worst = 0;
	unsigned most = 0;
	int bad = 0;

	(void)state;
	assert_non_null(f);
	for (uint64_t seed = first + 1; seed <= first + n_campaigns; seed++) {
		const size_t n = plan_faults(seed, f, 300);
		const struct campaign c = campaign_of(seed, f, n, 0);
		faults += n;
		opened += c.opened;
		silent += c.meter <= 0;
		worst = fmax(worst, c.meter);
		most = c.oracle > most ? c.oracle : most;
		if (c.meter > 3 || c.oracle > 6) {
			printf("seed %llu: meter %.1f, oracle %.1f at %.3f s\n", (unsigned long long)seed, c.meter, c.oracle / 2.0,
			       (double)c.oracle_ns * 1e-9);
			bad++;
		} else if (c.all > 6) { /* the light moved while the head was suspended */
			printf("seed %llu: nobody there, %.1f\n", (unsigned long long)seed, c.all / 2.0);
			nobody++;
		}
	}
	printf("flashes: %llu campaigns of 10 s, %llu faults, shutters opened %llu times; worst second %.1f by the meter, %.1f by "
	       "the oracle, %llu above while the head was suspended; %llu without any change\n", (unsigned long long)n_campaigns,
	       (unsigned long long)faults, (unsigned long long)opened, worst, most / 2.0, (unsigned long long)nobody, (unsigned long long)silent);
	free(f);
	assert_int_equal(bad, 0);
	assert_true(nobody * 500 <= n_campaigns);
	assert_true(opened > n_campaigns / 4 && silent < n_campaigns / 2); /* they are campaigns, not holidays */
}

static void a_campaign_repeats(void **state)
{
	struct sim_fault *f = calloc(300, sizeof(*f));
	const size_t n = plan_faults(9, f, 300);

	(void)state;
	const struct campaign a = campaign_of(9, f, n, 0), b = campaign_of(9, f, n, 0);
	assert_string_equal(a.hash, b.hash);
	assert_true(a.meter >= b.meter && a.meter <= b.meter && a.oracle == b.oracle);
	free(f);
}

/* Eyes that swap and swap while the head is suspended: that flashes; when it wakes it opens, for the chain tells it. */
static void nobody_holds_while_suspended(void **state)
{
	struct sim_fault f[4] = { 0 };
	size_t n = 0;

	(void)state;
	plant(f, &n, "at 2s node/head suspend for 250ms");
	plant(f, &n, "at 2.04s shutter/chain flip_polarity for 25ms");
	plant(f, &n, "at 2.09s shutter/chain flip_polarity for 25ms");
	plant(f, &n, "at 2.14s shutter/chain flip_polarity for 25ms");
	const struct campaign c = campaign_of(2, f, n, 4);
	printf("flashes: %.1f in a second while the head is suspended, %.1f of them when it is not\n", c.all / 2.0, c.oracle / 2.0);
	assert_true(c.all > 6 && c.oracle <= 6);
	assert_int_equal(c.opened, 1);
}

int main(int argc, char **argv)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(no_campaign_flashes),
		cmocka_unit_test(a_campaign_repeats),
		cmocka_unit_test(nobody_holds_while_suspended),
	};

	if (argc > 1)
		n_campaigns = strtoull(argv[1], NULL, 10);
	if (argc > 2)
		first = strtoull(argv[2], NULL, 10);
	return cmocka_run_group_tests(tests, NULL, NULL);
}
