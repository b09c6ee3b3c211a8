/*
 * tests/test_steady.c: the pose the pictures use (row K4): predicted, frozen after 100 ms, neutral a second later, back only
 * after three solutions that agree, and never by a step larger than sync/track/steady.h says.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>

#include <cmocka.h>

#include "sync/track/steady.h"

#define MS INT64_C(1000000)
#define FRAME (BB_NS_PER_S / 60)
#define FREEZE (100 * MS)
#define AHEAD (40 * MS) /* exposure to photon */

static const struct bb_pose neutral = { { 0, 1.6, 0 }, { 0, 0, 0, 1 } };

/* A head that goes on at 1 m/s and 1 rad/s, a tracker that sees it or does not. */
struct scene {
	struct bb_steady s;
	int64_t now_ns, solved_ns;
	bool seen, liar;      /* liar: every other solution is a metre off */
	unsigned n;
	struct bb_steady_pose out, before;
	struct bb_pose live, live_before;
};

static struct bb_pose head_at(int64_t at_ns)
{
	const double t = (double)at_ns * 1e-9;

	return (struct bb_pose){ { 0.5 + t, 1.7, 0.4 }, bb_quat_axis_angle((struct bb_vec3){ 0, 1, 0 }, 0.5 + t) };
}

static struct bb_track_pose track(const struct scene *c, int64_t photon_ns)
{
	const bool frozen = photon_ns - c->solved_ns > FREEZE;
	struct bb_track_pose p = { .solved_ns = c->solved_ns, .position_sigma_mm = 1 };

	if (!c->n)
		return (struct bb_track_pose){ .eyes = neutral, .flags = BB_TRACK_NEVER, .position_sigma_mm = 1e6 };
	p.eyes = head_at(frozen ? c->solved_ns + FREEZE : photon_ns);
	p.flags = frozen ? BB_TRACK_FROZEN : c->seen ? BB_TRACK_FRESH : BB_TRACK_PREDICTED;
	return p;
}

static void frame(struct scene *c)
{
	c->now_ns += FRAME;
	if (c->seen) {
		struct bb_pose p = head_at(c->now_ns);
		if (c->liar && c->n % 2)
			p.p.y += 1;
		bb_steady_note(&c->s, c->now_ns, &p);
		c->solved_ns = c->now_ns;
		c->n++;
	}
	const struct bb_track_pose t = track(c, c->now_ns + AHEAD);
	c->before = c->out;
	c->live_before = c->live;
	c->live = t.eyes;
	c->out = bb_steady_step(&c->s, &t, c->now_ns + AHEAD);
}

static void frames(struct scene *c, int n)
{
	while (n--)
		frame(c);
}

static double step_m(const struct scene *c)
{
	return bb_vec3_norm(bb_vec3_sub(c->out.eyes.p, c->before.eyes.p));
}

static double off_m(const struct scene *c)
{
	return bb_vec3_norm(bb_vec3_sub(c->out.eyes.p, c->live.p));
}

static struct scene begin(void)
{
	struct scene c = { .now_ns = 5 * BB_NS_PER_S, .seen = true };
	const struct bb_steady_config usual = bb_steady_usual(neutral);

	bb_steady_init(&c.s, &usual);
	return c;
}

static void follows_at_once_where_nothing_was_shown(void **state)
{
	struct scene c = begin();

	(void)state;
	for (int i = 0; i < 3; i++) { /* as the first frame finds them */
		const struct bb_pose p = head_at(c.now_ns + i * 8 * MS);
		assert_true(bb_steady_note(&c.s, c.now_ns + i * 8 * MS, &p));
	}
	frame(&c);
	assert_int_equal(c.out.state, BB_STEADY_FOLLOW);
	assert_memory_equal(&c.out.eyes, &c.live, sizeof(c.live));
	assert_int_equal(c.out.age_ns, AHEAD);
	assert_true(fabs(c.out.position_sigma_mm - 1) < 1e-12);
}

static void blends_from_neutral_when_the_picture_stood_there(void **state)
{
	struct scene c = begin();

	(void)state;
	c.seen = false;
	frames(&c, 5);
	assert_int_equal(c.out.state, BB_STEADY_NEUTRAL);
	assert_memory_equal(&c.out.eyes, &neutral, sizeof(neutral));
	assert_true(c.out.age_ns == BB_NEVER && c.out.position_sigma_mm >= 1e6);
	c.seen = true;
	frames(&c, 2); /* two poses are not three */
	assert_memory_equal(&c.out.eyes, &neutral, sizeof(neutral));
	frame(&c);
	assert_int_equal(c.out.state, BB_STEADY_BLEND);
	frames(&c, 12);
	assert_int_equal(c.out.state, BB_STEADY_FOLLOW);
	assert_memory_equal(&c.out.eyes, &c.live, sizeof(c.live));
}

static void freezes_and_decays(void **state)
{
	struct scene c = begin();

	(void)state;
	frames(&c, 30);
	c.seen = false;
	const int64_t lost_ns = c.now_ns;
	while (c.now_ns + FRAME + AHEAD - lost_ns <= FREEZE) { /* still a prediction, and it moves with the head */
		frame(&c);
		assert_int_equal(c.out.state, BB_STEADY_FOLLOW);
		assert_true(step_m(&c) > 0.9 * 1.0 / 60);
	}
	const struct bb_pose held = c.out.eyes;
	frame(&c);
	assert_int_equal(c.out.state, BB_STEADY_DECAY);
	const double gap_m = bb_vec3_norm(bb_vec3_sub(held.p, neutral.p));
	assert_true(step_m(&c) < 0.002 * gap_m); /* it stands before it drifts */
	const int64_t froze_ns = c.before.age_ns;
	assert_true(froze_ns <= FREEZE && froze_ns > FREEZE - FRAME);
	double most_m = 0;
	for (int i = 1; i < 62; i++) {
		frame(&c);
		most_m = fmax(most_m, step_m(&c));
		assert_true(step_m(&c) <= 1.5 * gap_m * (double)FRAME / (double)BB_NS_PER_S + 1e-12);
		assert_true(c.out.position_sigma_mm >= 1e3 * off_m(&c)); /* honest: it knows how far it went from the tracker's */
	}
	assert_true(most_m > 1.4 * gap_m * (double)FRAME / (double)BB_NS_PER_S);
	assert_int_equal(c.out.state, BB_STEADY_NEUTRAL);
	assert_memory_equal(&c.out.eyes, &neutral, sizeof(neutral));
}

/* After an outage of so many frames; while it decays as well as when it is over. */
static void comes_back(int outage)
{
	struct scene c = begin();

	frames(&c, 30);
	c.seen = false;
	frames(&c, outage);
	c.seen = true;
	const double from_m = bb_vec3_norm(bb_vec3_sub(c.s.from.p, neutral.p));
	frames(&c, 2);
	assert_true(c.out.state == BB_STEADY_DECAY || c.out.state == BB_STEADY_NEUTRAL);
	assert_true(step_m(&c) <= 1.5 * from_m * (double)FRAME / (double)BB_NS_PER_S);
	frame(&c);
	assert_int_equal(c.out.state, BB_STEADY_BLEND);
	double gap_m = 0;
	int n = 0;
	while (c.out.state == BB_STEADY_BLEND) {
		const double live_m = bb_vec3_norm(bb_vec3_sub(c.live.p, c.live_before.p));
		gap_m = fmax(gap_m, bb_vec3_norm(bb_vec3_sub(c.live.p, c.s.from.p)));
		assert_true(step_m(&c) <= 1.5 * gap_m * (double)FRAME / (200.0 * (double)MS) + live_m + 1e-9);
		frame(&c);
		assert_true(++n < 20);
	}
	assert_in_range(n, 11, 12); /* 200 ms */
	assert_memory_equal(&c.out.eyes, &c.live, sizeof(c.live));
}

static void returns_without_a_jump(void **state)
{
	(void)state;
	comes_back(12);
	comes_back(40);
	comes_back(300);
}

static void short_gap_is_nothing(void **state)
{
	struct scene c = begin();

	(void)state;
	frames(&c, 30);
	c.seen = false;
	frames(&c, 3);
	assert_int_equal(c.out.state, BB_STEADY_FOLLOW);
	c.seen = true;
	frame(&c);
	assert_int_equal(c.out.state, BB_STEADY_FOLLOW);
	assert_memory_equal(&c.out.eyes, &c.live, sizeof(c.live));
}

static void poses_that_contradict_each_other_are_not_believed(void **state)
{
	struct scene c = begin();

	(void)state;
	c.seen = false;
	frames(&c, 3);
	c.seen = c.liar = true;
	frames(&c, 60);
	assert_int_equal(c.out.state, BB_STEADY_NEUTRAL);
	c.liar = false;
	frames(&c, 3);
	assert_int_equal(c.out.state, BB_STEADY_BLEND);
}

static void no_numbers_are_no_pose(void **state)
{
	struct scene c = begin();
	static const double bad[] = { (double)NAN, (double)INFINITY };

	(void)state;
	frames(&c, 30);
	const struct bb_pose last = c.out.eyes;
	for (size_t i = 0; i < 2; i++) {
		struct bb_track_pose t = track(&c, c.now_ns + AHEAD);
		struct bb_pose p = head_at(c.now_ns);
		t.eyes.p.y = bad[i];
		const struct bb_steady_pose out = bb_steady_step(&c.s, &t, c.now_ns + AHEAD);
		assert_true(bb_vec3_norm(bb_vec3_sub(out.eyes.p, last.p)) < 1e-9);
		assert_true(out.state == BB_STEADY_DECAY && out.age_ns == BB_NEVER);
		p.q.w = bad[i];
		assert_false(bb_steady_note(&c.s, c.now_ns + (int64_t)i + 1, &p));
	}
	const struct bb_track_pose none = { .eyes = { { 0, 0, 0 }, { 0, 0, 0, 0 } } }; /* a rotation that is none */
	assert_true(isfinite(bb_steady_step(&c.s, &none, c.now_ns + AHEAD).eyes.q.w));
	frames(&c, 20);
	assert_int_equal(c.out.state, BB_STEADY_FOLLOW);
}

static void time_that_jumps_moves_no_further_than_its_cap(void **state)
{
	static const int64_t jumps[] = { 0, -BB_NS_PER_S, 3600 * BB_NS_PER_S, INT64_MAX / 2 };

	(void)state;
	for (size_t i = 0; i < sizeof(jumps) / sizeof(*jumps); i++) {
		struct scene c = begin();
		frames(&c, 30);
		c.seen = false;
		frames(&c, 20);
		assert_int_equal(c.out.state, BB_STEADY_DECAY);
		const struct bb_pose before = c.out.eyes;
		const struct bb_track_pose t = track(&c, c.now_ns + AHEAD);
		const struct bb_steady_pose out = bb_steady_step(&c.s, &t, c.now_ns + AHEAD + jumps[i]);
		const double most = 1.5 * bb_vec3_norm(bb_vec3_sub(c.s.from.p, neutral.p)) * 0.05;
		assert_true(bb_vec3_norm(bb_vec3_sub(out.eyes.p, before.p)) <= (jumps[i] > 0 ? most : 1e-12));
		if (jumps[i] <= 0)
			continue;
		struct bb_pose p = head_at(c.now_ns); /* solutions from before the jump do not count with those after it */
		bb_steady_note(&c.s, INT64_MIN + 1, &p);
		bb_steady_note(&c.s, INT64_MAX, &p);
		assert_int_equal(c.s.agreed, 1);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(follows_at_once_where_nothing_was_shown),
		cmocka_unit_test(blends_from_neutral_when_the_picture_stood_there), cmocka_unit_test(freezes_and_decays),
		cmocka_unit_test(returns_without_a_jump), cmocka_unit_test(short_gap_is_nothing),
		cmocka_unit_test(poses_that_contradict_each_other_are_not_believed), cmocka_unit_test(no_numbers_are_no_pose),
		cmocka_unit_test(time_that_jumps_moves_no_further_than_its_cap),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
