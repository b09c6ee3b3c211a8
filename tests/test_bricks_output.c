/*
 * tests/test_bricks_output.c: the ring between those who make a brick file and the thread that writes it
 * (render/bricks/build_output.c): bytes in the order of turns whoever is first, waiting for places and for room, a
 * beginning anywhere, a disk that is full.
 */
#define _GNU_SOURCE /* O_DIRECT */
#include "render/bricks/build_private.h"
#include "render/parallel.h"

#include <fcntl.h>
#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cmocka.h>

#define PLACE_MOST 3000

struct rig {
	struct bb_build_config config;
	struct bb_build_report report;
	struct bb_error err;
	struct bb_build build;
	char path[32];
};

static void rig_begin(struct rig *r, uint64_t memory_bytes, uint64_t at)
{
	*r = (struct rig){ .config = { .memory_bytes = memory_bytes, .threads = 2 }, .path = "/tmp/bb-output-XXXXXX" };
	r->build = (struct bb_build){ .config = &r->config, .report = &r->report, .err = &r->err };
	r->build.fd = mkstemp(r->path);
	assert_true(r->build.fd >= 0);
	for (uint64_t i = 0; i < at; i++)
		assert_int_equal(pwrite(r->build.fd, "B", 1, (off_t)i), 1);
	bb_build_output_open(&r->build, PLACE_MOST);
	bb_build_output_start(&r->build, at);
	bb_build_output_begin(&r->build);
	assert_int_equal(r->build.status, BB_OK);
}

static void rig_end(struct rig *r)
{
	bb_build_output_close(&r->build);
	assert_true(r->build.held_bytes == 0);
	close(r->build.fd);
	unlink(r->path);
}

static size_t length(size_t turn)
{
	return 1 + turn * 7919 % PLACE_MOST;
}

static uint8_t byte_of(size_t turn, size_t i)
{
	return (uint8_t)(turn * 31 + i * 7 + (i >> 8));
}

/* False: the build has failed. */
static bool give(struct rig *r, size_t turn)
{
	uint64_t at;
	uint8_t *place = bb_build_output_take(&r->build, turn, length(turn), &at);

	if (!place)
		return false;
	for (size_t i = 0; i < length(turn); i++)
		place[i] = byte_of(turn, i);
	bb_build_output_put(&r->build, at, length(turn));
	return true;
}

static void check_file(struct rig *r, uint64_t begin, size_t n_turns)
{
	FILE *f = fopen(r->path, "r");

	assert_non_null(f);
	for (uint64_t i = 0; i < begin; i++)
		assert_int_equal(fgetc(f), 'B');
	for (size_t turn = 0; turn < n_turns; turn++)
		for (size_t i = 0; i < length(turn); i++)
			if (fgetc(f) != byte_of(turn, i))
				fail_msg("turn %zu, byte %zu", turn, i);
	assert_int_equal(fgetc(f), EOF);
	fclose(f);
}

/* ---- in order ---- */

static void piece(void *ctx, size_t i, unsigned thread)
{
	(void)thread;
	if (!give(ctx, i))
		fail_msg("%s", ((struct rig *)ctx)->err.text);
}

static void bytes_are_in_the_order_of_turns(void **state)
{
	static const uint64_t begins[] = { 0, 1, 4095, 4096, 123457 };
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(begins); i++) {
		struct rig r;
		rig_begin(&r, i % 2 ? 64u << 20 : 1u << 20, begins[i]);
		bb_parallel(8, 1500, piece, &r);
		bb_build_output_flush(&r.build);
		check_file(&r, begins[i], 1500);
		bb_build_output_begin(&r.build); /* after a flush it goes on */
		const uint64_t end = bb_build_output_end(&r.build);
		assert_true(give(&r, 0));
		bb_build_output_flush(&r.build);
		assert_true(bb_build_output_end(&r.build) == end + length(0));
		assert_true(lseek(r.build.fd, 0, SEEK_END) == (off_t)(end + length(0)));
		assert_int_equal(r.build.status, BB_OK);
		rig_end(&r);
	}
}

/* ---- one that sleeps while it fills its place ---- */

struct others {
	struct rig *r;
	size_t n, done;
};

static void *give_others(void *arg)
{
	struct others *o = arg;

	for (size_t turn = 1; turn < o->n && give(o->r, turn); turn++)
		__atomic_store_n(&o->done, turn, __ATOMIC_RELEASE);
	return NULL;
}

/* Until the other thread has been where it is for a while. */
static size_t wait_until_still(const struct others *o)
{
	size_t before = 0, now;

	do {
		before = __atomic_load_n(&o->done, __ATOMIC_ACQUIRE);
		usleep(50000);
		now = __atomic_load_n(&o->done, __ATOMIC_ACQUIRE);
	} while (now != before || !now);
	return now;
}

static void a_sleeper_holds_up_the_others_but_not_for_ever(void **state)
{
	static const struct {
		uint64_t memory_bytes;
		size_t least, most; /* turns of the others, before they must wait */
	} ways[] = {
		{ 256u << 20, 127, 127 }, /* for a place */
		{ 1u << 20, 2, 100 },     /* for room */
	};
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(ways); i++) {
		struct rig r;
		pthread_t thread;
		uint64_t at;
		rig_begin(&r, ways[i].memory_bytes, 0);
		struct others o = { .r = &r, .n = 400 };
		uint8_t *place = bb_build_output_take(&r.build, 0, length(0), &at);
		assert_non_null(place);
		assert_int_equal(pthread_create(&thread, NULL, give_others, &o), 0);
		const size_t waits_at = wait_until_still(&o);
		print_message("the others wait after %zu turns\n", waits_at);
		assert_true(waits_at >= ways[i].least && waits_at <= ways[i].most);
		for (size_t k = 0; k < length(0); k++)
			place[k] = byte_of(0, k);
		bb_build_output_put(&r.build, at, length(0));
		pthread_join(thread, NULL);
		assert_int_equal(o.done, 399);
		bb_build_output_flush(&r.build);
		check_file(&r, 0, 400);
		rig_end(&r);
	}
}

/* ---- a full disk ---- */

static void a_full_disk_wakes_everybody(void **state)
{
	const struct rlimit little = { 100000, RLIM_INFINITY };
	struct rlimit all;
	struct rig r;
	size_t turn = 0;
	(void)state;

	assert_int_equal(getrlimit(RLIMIT_FSIZE, &all), 0);
	signal(SIGXFSZ, SIG_IGN);
	rig_begin(&r, 1u << 20, 0);
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &little), 0);
	while (turn < 100000 && give(&r, turn))
		turn++;
	assert_true(turn < 1000);
	assert_false(give(&r, turn + 5)); /* a turn that will never come */
	bb_build_output_flush(&r.build);
	rig_end(&r);
	assert_int_equal(r.build.status, BB_ERR_IO);
	assert_int_equal(r.err.number, 1901);
	assert_int_equal(setrlimit(RLIMIT_FSIZE, &all), 0);
}

/* What cannot be written past the page cache, here because of where it lies, is written through it. */
static void a_write_that_is_refused_goes_through_the_page_cache(void **state)
{
	struct rig r;
	char got[6] = { 0 };
	(void)state;

	rig_begin(&r, 1u << 20, 0);
	if (fcntl(r.build.fd, F_GETFL) & O_DIRECT)
		assert_true(bb_build_pwrite(&r.build, r.build.fd, "brick", 5, 3));
	else
		print_message("no direct writes in /tmp: all of this test goes through the page cache\n");
	assert_true(bb_build_pwrite(&r.build, r.build.fd, "brick", 5, 3));
	assert_false(fcntl(r.build.fd, F_GETFL) & O_DIRECT);
	assert_int_equal(pread(r.build.fd, got, 5, 3), 5);
	assert_string_equal(got, "brick");
	assert_int_equal(r.build.status, BB_OK);
	rig_end(&r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(bytes_are_in_the_order_of_turns),
		cmocka_unit_test(a_sleeper_holds_up_the_others_but_not_for_ever),
		cmocka_unit_test(a_full_disk_wakes_everybody),
		cmocka_unit_test(a_write_that_is_refused_goes_through_the_page_cache),
	};

	alarm(120); /* who waits for ever is ended */
	return cmocka_run_group_tests(tests, NULL, NULL);
}
