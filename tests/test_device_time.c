/* tests/test_device_time.c: hal/rate and hal/dev_time: frame times from numbers, wraps, maps from device to host. */
#include "tests/fixture_room.h"

static void frames_are_exact_for_years(void **state)
{
	const struct bb_rate ntsc = { 60000, 1001 };

	(void)state;
	assert_int_equal(bb_rate_frame_ns(ntsc, 0), 0);
	assert_int_equal(bb_rate_frame_ns(ntsc, 60000), 1001 * BB_NS_PER_S);
	/* A week: the summed rounded period would be 12 ms early. */
	assert_int_equal(bb_rate_frame_ns(ntsc, INT64_C(36251748)), INT64_C(604799995800000));
	/* 290 years. */
	const int64_t far = INT64_C(290) * 365 * 86400 * 60000 / 1001;
	assert_true(bb_rate_frame_ns(ntsc, far) > INT64_C(9100000000000000000));
	assert_true(bb_rate_frame_ns(ntsc, far + 1) - bb_rate_frame_ns(ntsc, far) - 16683333 <= 1);
}

static void frames_before_zero_round_down_too(void **state)
{
	const struct bb_rate r = { 120, 1 };

	(void)state;
	assert_int_equal(bb_rate_frame_ns(r, -120), -BB_NS_PER_S);
	assert_int_equal(bb_rate_frame_ns(r, -1), -8333334);
	for (int64_t k = -300; k < 300; k++) {
		const int64_t step = bb_rate_frame_ns(r, k + 1) - bb_rate_frame_ns(r, k);
		assert_true(step == 8333333 || step == 8333334);
	}
}

static void rates_from_decimals(void **state)
{
	static const struct {
		double hz;
		uint32_t num, den;
	} known[] = { { 120, 120, 1 }, { 60, 60, 1 }, { 59.94005994, 60000, 1001 }, { 23.976023976, 24000, 1001 },
		      { 59.95, 59950, 1000 } };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++) {
		const struct bb_rate r = bb_rate_from_hz(known[i].hz);
		assert_true(fabs(bb_rate_hz(r) - known[i].hz) <= 1e-6 * known[i].hz);
		assert_int_equal((uint64_t)r.num * known[i].den, (uint64_t)known[i].num * r.den);
	}
	static const double bad[] = { 0, -1, 1e7, (double)NAN, (double)INFINITY };
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		assert_int_equal(bb_rate_from_hz(bad[i]).num, 0);
}

static void unwrap_goes_through_wraps_and_small_steps_back(void **state)
{
	struct bb_unwrap32 u = { 0 };
	uint32_t ticks = UINT32_MAX - 5;
	int64_t want = ticks;

	(void)state;
	assert_int_equal(bb_unwrap32(&u, ticks), want);
	for (int i = 0; i < 10000; i++) {
		const uint32_t step = (uint32_t)i * 429497u % 2000000000u;
		ticks += step;
		want += step;
		assert_int_equal(bb_unwrap32(&u, ticks), want);
	}
	assert_int_equal(bb_unwrap32(&u, ticks - 7), want - 7);
	assert_true(want > 5 * INT64_C(0x100000000)); /* it did wrap */
}

static void an_empty_map_says_that_it_knows_nothing(void **state)
{
	struct bb_timemap m;

	(void)state;
	bb_timemap_init(&m, 1000);
	assert_int_equal(bb_timemap_host_ns(&m, (struct bb_dev_ns){ 77 }), 77);
	assert_int_equal(m.uncertainty_ns, INT64_MAX);
}

/* Host = device + offset; transfer 3 ms at least and up to 2 ms more. The map is never early by more than its
 * uncertainty says, and never late by more than the least excess seen. */
static void a_map_finds_the_offset_within_its_uncertainty(void **state)
{
	const int64_t offset_ns = INT64_C(-123456789012), least_ns = 3 * MS;
	struct bb_timemap m;
	struct sim_rng r;

	(void)state;
	sim_rng_seed(&r, 1, "test", "map");
	bb_timemap_init(&m, least_ns);
	int64_t error_ns = 0;
	int wrong = 0;
	for (int i = 0; i < 2000; i++) {
		const struct bb_dev_ns dev = { i * INT64_C(16666667) };
		const int64_t late_ns = (int64_t)(sim_rng_uniform(&r) * 2e6);
		bb_timemap_add(&m, dev, dev.ns + offset_ns + least_ns + late_ns);
		error_ns = bb_timemap_host_ns(&m, dev) - (dev.ns + offset_ns);
		assert_true(error_ns >= 0); /* transfer only ever delays */
		if (i >= BB_TIMEMAP_WINDOW)
			wrong += error_ns > 5 * m.uncertainty_ns;
	}
	assert_true(wrong < 2000 / 50); /* excess is about exponential with mean = uncertainty: e^-5 */
	assert_true(error_ns < 500000);
}

static void a_map_follows_a_drifting_clock(void **state)
{
	struct bb_timemap m;
	int64_t worst_ns = 0;

	(void)state;
	bb_timemap_init(&m, 0);
	for (int64_t i = 0; i < 20000; i++) { /* 30 ppm slow device, a frame of 60 Hz each, no jitter */
		const int64_t host_ns = i * 16666667;
		const struct bb_dev_ns dev = { host_ns - host_ns * 30 / 1000000 };
		bb_timemap_add(&m, dev, host_ns);
		const int64_t error_ns = llabs(bb_timemap_host_ns(&m, dev) - host_ns);
		worst_ns = error_ns > worst_ns ? error_ns : worst_ns;
	}
	assert_true(worst_ns <= (int64_t)BB_TIMEMAP_WINDOW * 16666667 * 30 / 1000000 + 1);
}

/* nK2: host, device, or both pass the end of int64 at any stamp from -3 to +3: the same map but for the offset. */
static void a_map_does_not_see_the_end_of_int64(void **state)
{
	static struct bb_timemap first, m;

	(void)state;
	for (int host_wraps = 0; host_wraps < 2; host_wraps++)
		for (int device_wraps = 0; device_wraps < 2; device_wraps++)
			for (int64_t tick = -3; tick <= 3; tick++) {
				const int64_t host_ns = host_wraps ? INT64_MAX - 32 * 16666667 + tick : 0;
				const int64_t device_ns = device_wraps ? INT64_MAX - 20 * 16666667 + tick : 0;
				struct sim_rng r;
				sim_rng_seed(&r, 1, "test", "wrap");
				bb_timemap_init(&m, 3 * MS);
				for (int64_t i = 0; i < 100; i++) {
					const int64_t late_ns = 3 * MS + (int64_t)(sim_rng_uniform(&r) * 2e6);
					const struct bb_dev_ns dev = { bb_ns_after(device_ns, i * 16666667) };
					bb_timemap_add(&m, dev, bb_ns_after(host_ns, i * 16666667 + late_ns));
				}
				if (!host_wraps && !device_wraps)
					first = m;
				assert_int_equal(m.uncertainty_ns, first.uncertainty_ns);
				const struct bb_dev_ns at = { bb_ns_after(device_ns, 5000) };
				assert_int_equal(bb_ns_since(bb_timemap_host_ns(&m, at), host_ns),
				                 bb_timemap_host_ns(&first, (struct bb_dev_ns){ 5000 }));
			}
}

/* A device may stamp what it likes: how far apart two such offsets are is still no negative number. */
static void stamps_as_far_apart_as_can_be_keep_an_uncertainty(void **state)
{
	struct bb_timemap m;

	(void)state;
	bb_timemap_init(&m, 0);
	bb_timemap_add(&m, (struct bb_dev_ns){ -(INT64_C(1) << 62) }, 0);
	bb_timemap_add(&m, (struct bb_dev_ns){ INT64_C(1) << 62 }, 0);
	assert_true(m.uncertainty_ns >= INT64_C(1) << 62);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(frames_are_exact_for_years),
		cmocka_unit_test(frames_before_zero_round_down_too),
		cmocka_unit_test(rates_from_decimals),
		cmocka_unit_test(unwrap_goes_through_wraps_and_small_steps_back),
		cmocka_unit_test(an_empty_map_says_that_it_knows_nothing),
		cmocka_unit_test(a_map_finds_the_offset_within_its_uncertainty),
		cmocka_unit_test(a_map_follows_a_drifting_clock),
		cmocka_unit_test(a_map_does_not_see_the_end_of_int64),
		cmocka_unit_test(stamps_as_far_apart_as_can_be_keep_an_uncertainty),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
