/* tests/test_polarity.c: rows G3 and G8: flips, glitches and rooms where nothing tells the eyes. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "sim/optics/sensor.h"
#include "sync/polarity.h"

#define PERIOD INT64_C(8333333)

static enum bb_eye eye_of(int n)
{
	return n % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT;
}

static enum bb_eye other(enum bb_eye eye)
{
	return eye == BB_EYE_LEFT ? BB_EYE_RIGHT : BB_EYE_LEFT;
}

static struct bb_polarity fresh(void)
{
	struct bb_polarity p;

	bb_polarity_init(&p, (struct bb_rate){ 120, 1 });
	return p;
}

static void tells_a_flip_with_its_time(void **state)
{
	(void)state;
	for (int source = 0; source < BB_POLARITY_SOURCES; source++)
		for (int at = 10; at < 14; at++) {
			struct bb_polarity p = fresh();
			int told = -1;
			for (int n = 0; n < 60; n++) {
				const enum bb_eye glasses = n < at ? eye_of(n) : other(eye_of(n));
				const enum bb_polarity_verdict v =
					bb_polarity_see(&p, (enum bb_polarity_source)source, n * PERIOD, eye_of(n), glasses);
				if (v == BB_POLARITY_FLIPPED && told < 0)
					told = n;
				if (n > 1 && n < at)
					assert_int_equal(v, BB_POLARITY_HOLDS);
			}
			assert_int_equal(told, at + 1); /* two eye changes: one frame of both eyes */
			assert_int_equal(p.flipped_ns, at * PERIOD);
			assert_int_equal(p.by, source);
			assert_int_equal(p.flips, 1);
		}
}

static void holds_again_after_ten_frames(void **state)
{
	struct bb_polarity p = fresh();
	int n = 0, since = 0;
	(void)state;

	for (; n < 10; n++)
		bb_polarity_see(&p, BB_POLARITY_LEVEL, n * PERIOD, eye_of(n), other(eye_of(n)));
	assert_int_equal(p.verdict, BB_POLARITY_FLIPPED);
	while (bb_polarity_see(&p, BB_POLARITY_LEVEL, n * PERIOD, eye_of(n), eye_of(n)) == BB_POLARITY_FLIPPED) {
		n++;
		since++;
		/* Another source that agreed all along does not end it. */
		assert_int_equal(bb_polarity_see(&p, BB_POLARITY_COUNTER, n * PERIOD, eye_of(n), eye_of(n)), BB_POLARITY_FLIPPED);
		assert_true(since < 100);
	}
	assert_int_equal(since + 1, 20);
}

/* Row G3: one wrong edge is no flip, and parity is kept through a missed one. */
static void takes_a_glitch_for_a_glitch(void **state)
{
	struct bb_polarity p = fresh();
	(void)state;

	for (int n = 0; n < 40; n++) {
		const bool wrong = n == 10 || n == 20;
		if (n == 30)
			continue;
		assert_int_not_equal(bb_polarity_see(&p, BB_POLARITY_LEVEL, n * PERIOD, eye_of(n),
		                                     wrong ? other(eye_of(n)) : eye_of(n)), BB_POLARITY_FLIPPED);
	}
	assert_int_equal(p.glitches, 2);
	assert_int_equal(p.verdict, BB_POLARITY_HOLDS);
}

static void says_when_nothing_tells(void **state)
{
	struct bb_polarity p = fresh();
	int n = 0;
	(void)state;

	for (; n < 19; n++)
		assert_int_equal(bb_polarity_see(&p, BB_POLARITY_LEVEL, (n + 1) * PERIOD, BB_EYE_NONE, eye_of(n)),
		                 BB_POLARITY_UNKNOWN);
	for (; n < 40; n++)
		assert_int_equal(bb_polarity_see(&p, BB_POLARITY_LEVEL, (n + 1) * PERIOD, BB_EYE_NONE, eye_of(n)),
		                 BB_POLARITY_UNTAGGED);
	/* A second source that does tell is enough. */
	p = fresh();
	for (n = 0; n < 60; n++) {
		bb_polarity_see(&p, BB_POLARITY_TAG, (n + 1) * PERIOD, eye_of(n), eye_of(n));
		bb_polarity_see(&p, BB_POLARITY_LEVEL, (n + 1) * PERIOD, BB_EYE_NONE, eye_of(n));
	}
	assert_int_equal(p.verdict, BB_POLARITY_HOLDS);
	/* And when it falls silent nobody knows any more; glasses that are open for both ask for nothing. */
	for (; n < 100; n++)
		bb_polarity_see(&p, BB_POLARITY_LEVEL, (n + 1) * PERIOD, BB_EYE_NONE, n < 70 ? BB_EYE_NONE : eye_of(n));
	assert_int_equal(p.verdict, BB_POLARITY_UNTAGGED);
}

/* A display drops one frame: from then on its tag is a frame late, and the glasses show each eye the other picture. */
static void sees_a_dropped_frame_in_the_light(void **state)
{
	struct bb_error err = { 0 };
	struct bb_room *room;
	struct sim_look look = sim_look_bands();
	const size_t screen = 0;
	struct sim_optics *o;
	struct bb_tag_reader reader;
	struct bb_polarity p = fresh();
	const int dropped = 100;
	int told = -1;
	uint64_t gaps = 0;
	(void)state;

	assert_int_equal(bb_room_load("rooms/cabin120.yaml", &room, &err), BB_OK);
	look.tag = true;
	assert_int_equal(sim_optics_create(room, &screen, 1, &look, &o), BB_OK);
	bb_tag_reader_init(&reader);
	sim_optics_step(o, 0);
	for (int n = 0; n < 200; n++) {
		const int64_t at_ns = n * PERIOD;
		double light = 0;
		if (n == dropped)
			sim_optics_vblank(o, 0, at_ns); /* the old picture stays for one more vblank, and so on */
		else
			sim_optics_frame(o, 0, at_ns, eye_of(n < dropped ? n : n - 1));
		for (int i = 1; i <= 100; i++) {
			sim_optics_step(o, at_ns + PERIOD * i / 100);
			light += sim_optics_tag(o, 0) / 100;
		}
		const enum bb_eye picture = bb_tag_reader_frame(&reader, light);
		if (bb_polarity_see(&p, BB_POLARITY_TAG, at_ns, picture, eye_of(n)) == BB_POLARITY_FLIPPED && told < 0)
			told = n;
		gaps += n > 20 && reader.gap;
	}
	assert_true(told >= dropped && told <= dropped + 3); /* within two frames of both eyes */
	assert_true(p.flipped_ns >= dropped * PERIOD && p.flipped_ns <= (dropped + 1) * PERIOD);
	assert_int_equal(p.flips, 1);
	assert_true(gaps >= 1); /* one right frame was counted twice, or none */
	sim_optics_destroy(o);
	bb_room_free(room);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(tells_a_flip_with_its_time),   cmocka_unit_test(holds_again_after_ten_frames),
		cmocka_unit_test(takes_a_glitch_for_a_glitch),  cmocka_unit_test(says_when_nothing_tells),
		cmocka_unit_test(sees_a_dropped_frame_in_the_light),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
