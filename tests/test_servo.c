/*
 * tests/test_servo.c: sync/servo: scenarios after the simulation suites of chrony and linuxptp, each run at many seeds
 * and on axes that begin anywhere, and the corners where servos go wrong.
 */
#include "tests/servo_scene.h"

#define SEEDS 5
#define TEXT_(x) #x
#define TEXT(x) TEXT_(x)
#define HONEST 0.97 /* share of the locked time in which the error is within the stated uncertainty */
#define PI BB_SERVO_PI
#define LR BB_SERVO_LINREG

/*
 * Where the bars come from. chrony's suite: default jitter 100 us, in sync after 120 to 210 s, then 1 ms at most and 0.3 ms
 * rms: ours are half and a third of that (at 0.1 s of jitter: three times and once the jitter). linuxptp's: in sync after
 * 10 to 40 s, then 2 us at most and 1 us rms; its noise is taken as 0.3 us. G5, G6: 2 % of a 120 Hz frame. Saturation:
 * no overshoot above a tenth of what had gathered, and then linuxptp's.
 */
#define CHRONY .sync_s = 120, .settle_s = 120, .max_s = 5e-4, .rms_s = 1e-4
#define NOISY .kp = 0.1, .ki = 0.001 /* linuxptp's gains for software stamps */
#define PTP .sync_s = 40, .settle_s = 40, .max_s = 2e-6, .rms_s = 1e-6

static const struct servo_scene scenes[] = {
	/* chrony's: a sample a second, 100 us of noise. Gains for noisy stamps. */
	{ "chrony: quiet", PI, 1, 4000, .jitter_s = 1e-4, .wander_ppb = 1, NOISY, CHRONY },
	{ "chrony: quiet", LR, 1, 4000, .jitter_s = 1e-4, .wander_ppb = 1, CHRONY },
	{ "chrony: rate +5e-2", PI, 1, 4000, .rate = 5e-2, .jitter_s = 1e-4, .wander_ppb = 1, NOISY, CHRONY },
	{ "chrony: rate +5e-2", LR, 1, 4000, .rate = 5e-2, .jitter_s = 1e-4, .wander_ppb = 1, CHRONY },
	{ "chrony: rate -5e-2", PI, 1, 4000, .rate = -5e-2, .jitter_s = 1e-4, .wander_ppb = 1, NOISY, CHRONY },
	{ "chrony: rate -5e-2", LR, 1, 4000, .rate = -5e-2, .jitter_s = 1e-4, .wander_ppb = 1, CHRONY },
	{ "chrony: offset +100 s", PI, 1, 4000, .offset_s = 100, .jitter_s = 1e-4, NOISY, CHRONY },
	{ "chrony: offset +100 s", LR, 1, 4000, .offset_s = 100, .jitter_s = 1e-4, CHRONY },
	{ "chrony: offset -100 s", LR, 1, 4000, .offset_s = -100, .jitter_s = 1e-4, CHRONY },
	{ "chrony: step +1e2 s", LR, 1, 4000, .event_s = 1500, .step_s = 1e2, .jitter_s = 1e-4, CHRONY },
	{ "chrony: step -1e4 s", LR, 1, 4000, .event_s = 1500, .step_s = -1e4, .jitter_s = 1e-4, CHRONY },
	{ "chrony: step +1e8 s", PI, 1, 4000, .event_s = 1500, .step_s = 1e8, .jitter_s = 1e-4, NOISY, CHRONY },
	{ "chrony: step +1e8 s", LR, 1, 4000, .event_s = 1500, .step_s = 1e8, .jitter_s = 1e-4, CHRONY },
	{ "chrony: step -1e8 s", LR, 1, 4000, .event_s = 1500, .step_s = -1e8, .jitter_s = 1e-4, CHRONY },
	{ "chrony: clock set by 1e8 s", LR, 1, 4000, .event_s = 1500, .set_s = 1e8, .jitter_s = 1e-4, CHRONY },
	{ "chrony: clock set by -1 s", PI, 1, 4000, .event_s = 1500, .set_s = -1, .jitter_s = 1e-4, NOISY, CHRONY },
	{ "chrony: 33 % lost", PI, 1, 4000, .loss_percent = 33, .jitter_s = 1e-4, .wander_ppb = 1, NOISY, CHRONY },
	{ "chrony: 33 % lost", LR, 1, 4000, .loss_percent = 33, .jitter_s = 1e-4, .wander_ppb = 1, CHRONY },
	{ "chrony: 1200 s without samples", PI, 1, 5000, .event_s = 1500, .outage_s = 1200, .jitter_s = 1e-4,
	  .wander_ppb = 1, NOISY, CHRONY },
	{ "chrony: 1200 s without samples", LR, 1, 5000, .event_s = 1500, .outage_s = 1200, .jitter_s = 1e-4,
	  .wander_ppb = 1, CHRONY },
	{ "chrony: 1200 s, restless, fast gains", PI, 1, 5000, .event_s = 1500, .outage_s = 1200, .jitter_s = 1e-5,
	  .wander_ppb = 50, CHRONY },
	{ "chrony: jitter 0.1 s", PI, 1, 8000, .jitter_s = 0.1, .kp = 0.05, .ki = 5e-4, .sync_s = 210, .max_s = 0.3,
	  .rms_s = 0.1 },
	{ "chrony: jitter 0.1 s", LR, 1, 8000, .jitter_s = 0.1, .sync_s = 210, .max_s = 0.3, .rms_s = 0.1 },
	{ "chrony: delays of 100 us each way", LR, 1, 4000, .jitter = JITTER_DELAY, .jitter_s = 1e-4, .wander_ppb = 1,
	  CHRONY },
	/* linuxptp's: hardware stamps. */
	{ "linuxptp: quiet", PI, 1, 2000, .jitter_s = 3e-7, .wander_ppb = 1, PTP },
	{ "linuxptp: quiet", LR, 1, 2000, .jitter_s = 3e-7, .wander_ppb = 1, PTP },
	{ "linuxptp: rate +9.9 %", PI, 1, 2000, .rate = 9.9e-2, .jitter_s = 3e-7, PTP },
	{ "linuxptp: rate -8.3 %", PI, 1, 2000, .rate = -8.3e-2, .jitter_s = 3e-7, PTP },
	{ "linuxptp: rate +9.9 %", LR, 1, 2000, .rate = 9.9e-2, .jitter_s = 3e-7, PTP },
	{ "linuxptp: step of 100 s", PI, 1, 2000, .event_s = 700, .step_s = 100, .jitter_s = 3e-7, PTP },
	{ "linuxptp: step of 100 s", LR, 1, 2000, .event_s = 700, .step_s = 100, .jitter_s = 3e-7, PTP },
	{ "linuxptp: 8 samples a second", PI, 0.125, 600, .jitter_s = 3e-7, PTP },
	{ "linuxptp: 33 % lost", LR, 1, 2000, .loss_percent = 33, .jitter_s = 3e-7, PTP },
	{ "linuxptp: rate jumps by 1 ppm", PI, 1, 2000, .event_s = 700, .rate_step = 1e-6, .jitter_s = 3e-7, PTP },
	{ "linuxptp: rate jumps by 1 ppm", LR, 1, 2000, .event_s = 700, .rate_step = 1e-6, .jitter_s = 3e-7, PTP },
	/* nK3: the output is at its limit for 60 s, too slow by 50 ppm, and stepping is not allowed. */
	{ "nK3: saturated for 60 s", PI, 1, 2000, .event_s = 700, .rate_step = 1.5e-4, .rate_step_s = 60,
	  .max_ppb = 1e5, .never_step = true, .overshoot = 0.1, .jitter_s = 3e-7, .sync_s = 40, .settle_s = 80,
	  .max_s = 2e-6, .rms_s = 1e-6 },
	{ "nK3: saturated for 60 s", LR, 1, 2000, .event_s = 700, .rate_step = 1.5e-4, .rate_step_s = 60,
	  .max_ppb = 1e5, .never_step = true, .overshoot = 0.1, .jitter_s = 3e-7, .sync_s = 40, .settle_s = 80,
	  .max_s = 2e-6, .rms_s = 1e-6 },
	/* Ours: sync edges at 120 Hz. */
	{ "G5: +100 ppm and wander", PI, 1.0 / 120, 60, .rate = 1e-4, .wander_ppb = 1000, .jitter_s = 2e-6, .sync_s = 2,
	  .max_s = 166e-6, .rms_s = 166e-6 },
	{ "G5: -100 ppm and wander", LR, 1.0 / 120, 60, .rate = -1e-4, .wander_ppb = 1000, .jitter_s = 2e-6,
	  .sync_s = 2, .max_s = 166e-6, .rms_s = 166e-6 },
	{ "G6: jitter of 20 % T for 1 s", PI, 1.0 / 120, 60, .rate = 1e-4, .jitter_s = 2e-6, .jitter = JITTER_FLAT,
	  .event_s = 20, .burst_s = 1, .burst_times = 833, .sync_s = 2, .settle_s = 2, .max_s = 166e-6,
	  .rms_s = 166e-6 },
	{ "G6: jitter of 20 % T for 1 s", LR, 1.0 / 120, 60, .rate = 1e-4, .jitter_s = 2e-6, .jitter = JITTER_FLAT,
	  .event_s = 20, .burst_s = 1, .burst_times = 833, .sync_s = 2, .settle_s = 2, .max_s = 166e-6,
	  .rms_s = 166e-6 },
};

static void hold(const struct servo_scene *c, uint64_t seed, const struct servo_outcome *o)
{
	const bool may_unlock = c->step_s != 0 || c->set_s != 0;
	const bool good = o->max_ns <= c->max_s * 1e9 && o->rms_ns <= c->rms_s * 1e9 && o->honest >= HONEST &&
			  o->finite && o->at_end != BB_SERVO_UNLOCKED &&
			  o->out_of_lock_s <= (may_unlock ? 10 * c->interval_s : 0) &&
			  (!(c->overshoot > 0) || o->overshoot <= c->overshoot);

	if (good)
		return;
	print_error("%s (%s), seed %llu: max %.3g s (bar %.3g), rms %.3g s (%.3g), honest %.3f, %.3g s out of lock "
		    "from %.3g s, "
		    "%llu outliers, %llu steps, overshoot %.3g, state %d\n",
		    c->name, c->kind == PI ? "PI" : "linear regression", (unsigned long long)seed, o->max_ns * 1e-9,
		    c->max_s, o->rms_ns * 1e-9, c->rms_s, o->honest, o->out_of_lock_s, o->first_out_s,
		    (unsigned long long)o->outliers, (unsigned long long)o->steps, o->overshoot, o->at_end);
	fail();
}

static void every_scene_keeps_its_bars(void **state)
{
	(void)state;
	assert_true(BB_ARRAY_LEN(scenes) >= 30);
	printf("%-40s %-6s %10s %10s %10s %10s %8s\n", "scene, worst of " TEXT(SEEDS) " seeds", "servo", "max, us", "bar", "rms, us",
	       "bar", "honest");
	for (size_t i = 0; i < BB_ARRAY_LEN(scenes); i++) {
		const struct servo_scene *c = &scenes[i];
		double max_ns = 0, rms_ns = 0, honest = 1;
		for (uint64_t seed = 0; seed < SEEDS; seed++) {
			const struct servo_outcome o = servo_scene_run(c, seed, (struct servo_axes){ 0, 0 });
			hold(c, seed, &o);
			max_ns = fmax(max_ns, o.max_ns);
			rms_ns = fmax(rms_ns, o.rms_ns);
			honest = fmin(honest, o.honest);
		}
		printf("%-40s %-6s %10.4g %10.4g %10.4g %10.4g %7.1f%%\n", c->name, c->kind == PI ? "PI" : "linreg", max_ns * 1e-3,
		       c->max_s * 1e6, rms_ns * 1e-3, c->rms_s * 1e6, honest * 100);
	}
}

/* nK1, nK2: every answer bit for bit the same wherever the axes begin, also when they pass the end of int64 during the
 * scene, three ticks before, at and after any moment of it. */
static void where_time_begins_changes_no_bit(void **state)
{
	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(scenes); i++) {
		const int64_t half_ns = llrint(scenes[i].duration_s * 0.5e9);
		const struct servo_outcome at_zero = servo_scene_run(&scenes[i], 1, (struct servo_axes){ 0, 0 });
		const struct servo_axes far = { INT64_C(1) << 62, INT64_C(1) << 62 };
		struct servo_outcome o = servo_scene_run(&scenes[i], 1, far);
		assert_string_equal(o.hash, at_zero.hash);
		const struct servo_axes wraps = { INT64_MAX - half_ns + (int64_t)(i % 7) - 3, INT64_MAX - half_ns / 3 };
		o = servo_scene_run(&scenes[i], 1, wraps);
		assert_string_equal(o.hash, at_zero.hash);
	}
	const struct servo_outcome one = servo_scene_run(&scenes[0], 1, (struct servo_axes){ 0, 0 });
	const struct servo_outcome other = servo_scene_run(&scenes[0], 2, (struct servo_axes){ 0, 0 });
	assert_string_not_equal(one.hash, other.hash);
}

/* nK2: the steered clock is read through a 32-bit counter of us or ms, the reference sends 32-bit seconds (NTP's era
 * ends in 2036, a signed time_t in 2038) with ns: the counter's wrap falls on every tick from -3 to +3 of a sample. */
static void counters_wrap_unseen(void **state)
{
	static const int64_t unit_ns[] = { 1000, 1000000 };

	(void)state;
	for (size_t u = 0; u < BB_ARRAY_LEN(unit_ns); u++)
		for (int kind = 0; kind < 2; kind++) {
			char first[BB_HASH_HEX] = "";
			for (int ticks = -4; ticks <= 3; ticks++) { /* -4: no wrap at all */
				const struct bb_servo_config c = bb_servo_defaults(kind ? LR : PI, BB_NS_PER_S);
				const int64_t at_sample = 30 * BB_NS_PER_S / unit_ns[u];
				const uint32_t start = ticks < -3 ? 0 : (uint32_t)(0 - at_sample + ticks);
				struct bb_unwrap32 local = { 0 }, seconds = { 0 };
				static struct bb_servo s;
				struct bb_hash hash;
				char hex[BB_HASH_HEX];
				const int64_t zero = bb_unwrap32(&local, start);
				const int64_t zero_s = bb_unwrap32(&seconds, ticks < -3 ? 1 : UINT32_MAX - 30);
				assert_true(bb_hash_init(&hash));
				bb_servo_init(&s, &c);
				for (int64_t i = 1; i <= 60; i++) {
					const uint32_t raw = start + (uint32_t)(i * (BB_NS_PER_S + 50000) / unit_ns[u]);
					const uint32_t raw_s = (ticks < -3 ? 1 : UINT32_MAX - 30) + (uint32_t)i;
					const int64_t local_ns = (bb_unwrap32(&local, raw) - zero) * unit_ns[u];
					const int64_t reference_ns =
						(bb_unwrap32(&seconds, raw_s) - zero_s) * BB_NS_PER_S;
					const struct bb_servo_sample x = { local_ns, local_ns,
									   local_ns - reference_ns };
					const struct bb_servo_answer a = bb_servo_sample(&s, &x);
					bb_hash_update(&hash, &a.step_ns, sizeof(a.step_ns));
					bb_hash_update(&hash, &a.adjust_ppb, sizeof(a.adjust_ppb));
				}
				bb_hash_final_hex(&hash, hex);
				if (ticks < -3)
					memcpy(first, hex, sizeof(first));
				assert_string_equal(hex, first);
			}
		}
}

/* ---- corners ---- */

static struct bb_servo locked_servo(enum bb_servo_kind kind, int64_t *now_ns)
{
	const struct bb_servo_config c = bb_servo_defaults(kind, BB_NS_PER_S);
	struct bb_servo s;

	bb_servo_init(&s, &c);
	*now_ns = 0;
	double local_ns = 0;
	for (int i = 0; i < 40; i++) {
		const struct bb_servo_sample x = { *now_ns, llrint(local_ns), llrint(local_ns) - *now_ns };
		const struct bb_servo_answer a = bb_servo_sample(&s, &x);
		local_ns += (double)a.step_ns + 1e9 * (1 + a.adjust_ppb * 1e-9);
		*now_ns += BB_NS_PER_S;
	}
	assert_int_equal(s.state, BB_SERVO_LOCKED);
	return s;
}

static void one_sample_steps_and_knows_nothing_more(void **state)
{
	static const int64_t offsets_ns[] = { 5, 20000, 20001, -20001, INT64_C(100000000000000000), INT64_MAX };

	(void)state;
	for (int kind = 0; kind < 2; kind++)
		for (size_t i = 0; i < BB_ARRAY_LEN(offsets_ns); i++) {
			const struct bb_servo_config c = bb_servo_defaults((enum bb_servo_kind)kind, BB_NS_PER_S);
			static struct bb_servo s;
			const struct bb_servo_sample x = { 77, 77, offsets_ns[i] };
			bb_servo_init(&s, &c);
			const struct bb_servo_answer a = bb_servo_sample(&s, &x);
			const bool steps = llabs(offsets_ns[i]) > 20000;
			assert_int_equal(a.verdict, steps ? BB_SERVO_STEPPED : BB_SERVO_USED);
			assert_int_equal(a.step_ns, steps ? -offsets_ns[i] : 0);
			assert_true(a.adjust_ppb == 0);
			assert_int_equal(s.state, BB_SERVO_UNLOCKED);
			assert_int_equal(bb_servo_uncertainty_ns(&s, 78), INT64_MAX);
			assert_int_equal(bb_servo_holdover_left_ns(&s, INT64_MAX, 78), 0);
		}
}

static void equal_stamps_and_time_that_runs_back_are_ignored(void **state)
{
	(void)state;
	for (int kind = 0; kind < 2; kind++) {
		int64_t now_ns;
		struct bb_servo s = locked_servo((enum bb_servo_kind)kind, &now_ns), before;
		const int64_t heard_ns = s.heard_ns;
		const int64_t at_ns[] = { heard_ns, heard_ns + 1, heard_ns + s.config.min_dt_ns - 1, heard_ns - 1,
					  heard_ns - BB_NS_PER_S };
		before = s;
		for (size_t i = 0; i < BB_ARRAY_LEN(at_ns); i++) {
			const struct bb_servo_sample x = { at_ns[i], at_ns[i], 123456789 };
			assert_int_equal(bb_servo_sample(&s, &x).verdict, BB_SERVO_EARLY);
		}
		before.n_early = BB_ARRAY_LEN(at_ns);
		assert_memory_equal(&s, &before, sizeof(s));
	}
}

/* N4: somebody sets the clock that is steered: seen in the sample that shows it, and put right in the same answer. */
static void a_set_clock_is_seen_at_once(void **state)
{
	static const int64_t sets_ns[] = { INT64_C(1000000000), -INT64_C(1000000000), INT64_C(100000000000000000),
					   -INT64_C(100000000000000000) };

	(void)state;
	for (int kind = 0; kind < 2; kind++)
		for (size_t i = 0; i < BB_ARRAY_LEN(sets_ns); i++) {
			int64_t now_ns;
			struct bb_servo s = locked_servo((enum bb_servo_kind)kind, &now_ns);
			const struct bb_servo_sample x = { now_ns, now_ns + sets_ns[i], sets_ns[i] };
			const struct bb_servo_answer a = bb_servo_sample(&s, &x);
			assert_int_equal(a.verdict, BB_SERVO_SET);
			assert_int_equal(a.step_ns, -sets_ns[i]);
			assert_int_equal(s.n_sets, 1);
		}
}

/* Any numbers at all: no trap, and answers within the limits. */
static void hostile_samples_give_finite_answers(void **state)
{
	struct sim_rng r;

	(void)state;
	sim_rng_seed(&r, 1, "servo", "hostile");
	for (int kind = 0; kind < 2; kind++) {
		struct bb_servo_config c = bb_servo_defaults((enum bb_servo_kind)kind, BB_NS_PER_S);
		static struct bb_servo s;
		c.min_dt_ns = 1;
		c.max_ppb = 1e6;
		c.sanity_ppb = (double)NAN;
		c.wander_ppb = (double)INFINITY;
		bb_servo_init(&s, &c);
		struct bb_servo_sample x = { 0, 0, 0 };
		for (int i = 0; i < 20000; i++) {
			const unsigned shift = (unsigned)(sim_rng_u64(&r) % 64);
			x.now_ns = bb_ns_after(x.now_ns, (int64_t)(sim_rng_u64(&r) >> shift));
			x.local_ns = i % 3 ? x.now_ns : (int64_t)sim_rng_u64(&r);
			x.offset_ns = (int64_t)sim_rng_u64(&r) >> (sim_rng_u64(&r) % 64);
			const struct bb_servo_answer a = bb_servo_sample(&s, &x);
			assert_true(isfinite(a.adjust_ppb) && fabs(a.adjust_ppb) <= 1e6);
			assert_true(isfinite(bb_servo_step(&s, bb_ns_after(x.now_ns, 500))));
			assert_true(bb_servo_uncertainty_ns(&s, x.now_ns) >= 0);
			assert_true(bb_servo_holdover_left_ns(&s, 1000000, x.now_ns) >= 0);
		}
	}
}

/* ---- holdover ---- */

static void silence_is_holdover_and_three_samples_end_it(void **state)
{
	(void)state;
	for (int kind = 0; kind < 2; kind++) {
		int64_t now_ns;
		struct bb_servo s = locked_servo((enum bb_servo_kind)kind, &now_ns);
		bb_servo_step(&s, s.sample_ns + s.config.holdover_after_ns);
		assert_int_equal(s.state, BB_SERVO_LOCKED);
		bb_servo_step(&s, s.sample_ns + s.config.holdover_after_ns + 1);
		assert_int_equal(s.state, BB_SERVO_HOLDOVER);
		int64_t last_ns = 0;
		for (int i = 0; i < 20; i++) { /* it only grows */
			now_ns += 10 * BB_NS_PER_S;
			assert_true(bb_servo_step(&s, now_ns) == s.drift_ppb);
			const int64_t unsure_ns = bb_servo_uncertainty_ns(&s, now_ns);
			assert_true(unsure_ns > last_ns);
			last_ns = unsure_ns;
		}
		for (int i = 1; i <= 3; i++) {
			now_ns += BB_NS_PER_S;
			const int64_t local_ns =
				bb_ns_after(s.local_ns, bb_ns_since(now_ns, s.heard_ns) + llrint(s.moved_heard_ns));
			const struct bb_servo_sample x = { now_ns, local_ns, 0 };
			bb_servo_sample(&s, &x);
			assert_int_equal(s.state, i < 3 ? BB_SERVO_HOLDOVER : BB_SERVO_LOCKED);
		}
	}
}

/* G1's time box: a tenth of a 120 Hz period over the frequency's uncertainty: 8.3 s at 100 ppm, 833 s at 1 ppm. */
static void the_time_box_is_the_budget_over_the_uncertainty(void **state)
{
	static const struct {
		double ppm, s;
	} rows[] = { { 100, 8.333 }, { 1, 833.3 } };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		int64_t now_ns;
		struct bb_servo s = locked_servo(PI, &now_ns);
		s.config.wander_ppb = 0;
		s.offset_ns = s.phase_ppb = s.given_ppb = s.drift_ppb = s.offset_sigma_ns = s.moved_ns = 0;
		s.sample_ns = s.given_ns = now_ns;
		s.rate_sigma_ppb = rows[i].ppm * 1000 / 3; /* an uncertainty is three sigma */
		const double left_s = (double)bb_servo_holdover_left_ns(&s, 833333, now_ns) * 1e-9;
		assert_true(fabs(left_s - rows[i].s) < 0.01 * rows[i].s);
		assert_int_equal(bb_servo_holdover_left_ns(&s, 833333, now_ns + (int64_t)(rows[i].s * 1.1e9)), 0);
	}
}

/* 100 outages of ten minutes: the error at their end is within what was stated then. */
static void holdover_is_honest(void **state)
{
	(void)state;
	for (int kind = 0; kind < 2; kind++) {
		const struct servo_scene c = { "outage",
					       (enum bb_servo_kind)kind,
					       1,
					       800,
					       .rate = 3e-5,
					       .wander_ppb = 3,
					       .jitter_s = 1e-5,
					       .event_s = 200,
					       .outage_s = 700,
					       .max_s = 1 };
		double least = 1, sum = 0;
		for (uint64_t seed = 0; seed < 100; seed++) {
			const struct servo_outcome o = servo_scene_run(&c, seed, (struct servo_axes){ 0, 0 });
			assert_int_equal(o.at_end, BB_SERVO_HOLDOVER);
			least = fmin(least, o.honest);
			sum += o.honest;
		}
		assert_true(sum / 100 >= HONEST);
	}
}

static void no_verdict_below_the_uncertainty(void **state)
{
	(void)state;
	assert_int_equal(bb_servo_within(50, 10, 100), BB_WITHIN);
	assert_int_equal(bb_servo_within(-90, 10, 100), BB_WITHIN);
	assert_int_equal(bb_servo_within(-91, 10, 100), BB_WITHIN_UNKNOWN);
	assert_int_equal(bb_servo_within(110, 10, 100), BB_WITHIN_UNKNOWN);
	assert_int_equal(bb_servo_within(-111, 10, 100), BB_BEYOND);
	assert_int_equal(bb_servo_within(0, INT64_MAX, 100), BB_WITHIN_UNKNOWN);
	assert_int_equal(bb_servo_within(INT64_MIN, 0, 100), BB_BEYOND);
}

/* G6: a single wild offset is seen in its own sample, moves nothing, and is gone with the next. */
static void an_outlier_moves_nothing(void **state)
{
	(void)state;
	for (int kind = 0; kind < 2; kind++) {
		int64_t now_ns;
		struct bb_servo s = locked_servo((enum bb_servo_kind)kind, &now_ns);
		const double before_ppb = s.drift_ppb;
		for (int i = 0; i < 20; i++, now_ns += BB_NS_PER_S) {
			const int64_t local_ns =
				bb_ns_after(s.local_ns, bb_ns_since(now_ns, s.heard_ns) + llrint(s.given_ppb));
			const struct bb_servo_sample x = { now_ns, local_ns, i % 5 ? 0 : 1600000 };
			const struct bb_servo_answer a = bb_servo_sample(&s, &x);
			assert_int_equal(a.verdict, i % 5 ? BB_SERVO_USED : BB_SERVO_OUTLIER);
			assert_true(fabs(a.adjust_ppb - before_ppb) < 5);
			assert_int_equal(s.state, BB_SERVO_LOCKED);
		}
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_scene_keeps_its_bars),
		cmocka_unit_test(where_time_begins_changes_no_bit),
		cmocka_unit_test(counters_wrap_unseen),
		cmocka_unit_test(one_sample_steps_and_knows_nothing_more),
		cmocka_unit_test(equal_stamps_and_time_that_runs_back_are_ignored),
		cmocka_unit_test(a_set_clock_is_seen_at_once),
		cmocka_unit_test(hostile_samples_give_finite_answers),
		cmocka_unit_test(silence_is_holdover_and_three_samples_end_it),
		cmocka_unit_test(the_time_box_is_the_budget_over_the_uncertainty),
		cmocka_unit_test(holdover_is_honest),
		cmocka_unit_test(no_verdict_below_the_uncertainty),
		cmocka_unit_test(an_outlier_moves_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
