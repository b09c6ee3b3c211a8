/*
 * tests/test_line.c: below the GPIO driver: the kernel's records against golden bytes, distrust of what is not a
 * record, the line descriptor over a pipe, both queues overflowing, and a reader that was away too long.
 */
#include "tests/fixture_room.h"

#include <errno.h>
#include <unistd.h>

#include "drivers/edge_lock.h"
#include "drivers/line.h"
#include "sim/bus_sim_line.h"

/* struct gpio_v2_line_event of linux/gpio.h on a little-endian machine: stamp, edge, line, number, number on the line,
 * six words of padding. */
static const uint8_t rising[BB_LINE_RECORD_BYTES] = { 0x15, 0xcd, 0x5b, 0x07, 0, 0, 0, 0, 1, 0, 0, 0, 17, 0, 0, 0,
	                                              1,    0,    0,    0,    1, 0, 0, 0 };
static const uint8_t falling[BB_LINE_RECORD_BYTES] = { 0x6a, 0xf5, 0xda, 0x07, 0, 0, 0, 0, 2, 0, 0, 0, 17, 0, 0, 0,
	                                               9,    0,    0,    0,    2, 0, 0, 0 };

struct reading {
	struct bb_clock *clk;
	struct bb_line_reader r;
	uint8_t bytes[8 * BB_LINE_RECORD_BYTES];
	size_t n_bytes, n;
	struct bb_line_event e[8];
};

static void reading_begin(struct reading *t)
{
	memset(t, 0, sizeof(*t));
	assert_int_equal(bb_clock_virtual_create(&t->clk), BB_OK);
	bb_clock_run_until(t->clk, BB_NS_PER_S);
	t->r = (struct bb_line_reader){ .clk = t->clk, .line = 17 };
}

static void add(struct reading *t, const uint8_t *record)
{
	memcpy(t->bytes + t->n_bytes, record, BB_LINE_RECORD_BYTES);
	t->n_bytes += BB_LINE_RECORD_BYTES;
}

/* A record with one byte other than it should be. */
static void add_but(struct reading *t, const uint8_t *record, size_t at, uint8_t value)
{
	add(t, record);
	t->bytes[t->n_bytes - BB_LINE_RECORD_BYTES + at] = value;
}

static void decode(struct reading *t)
{
	assert_int_equal(bb_line_decode(&t->r, t->bytes, t->n_bytes, t->e, BB_ARRAY_LEN(t->e), &t->n),
	                 t->n_bytes - t->n_bytes % BB_LINE_RECORD_BYTES);
}

static void golden_records_are_read(void **state)
{
	struct reading t;

	(void)state;
	reading_begin(&t);
	add(&t, rising);
	add(&t, falling);
	t.n_bytes += 7; /* a torn one */
	decode(&t);
	assert_int_equal(t.n, 2);
	assert_int_equal(t.e[0].at_ns, 123456789);
	assert_int_equal(t.e[1].at_ns, 131790186);
	assert_true(t.e[0].level && !t.e[1].level);
	assert_int_equal(t.e[0].seq, 1);
	assert_int_equal(t.e[1].seq, 2);
	assert_true(!t.e[0].overflow && !t.e[1].overflow);
	assert_int_equal(t.r.n_malformed, 0);
	bb_clock_destroy(t.clk);
}

static void a_gap_in_the_numbers_is_a_loss(void **state)
{
	struct reading t;

	(void)state;
	reading_begin(&t);
	add(&t, rising);
	add_but(&t, falling, 20, 3);
	decode(&t);
	assert_int_equal(t.n, 2);
	assert_true(t.e[1].overflow);
	bb_clock_destroy(t.clk);
}

static void what_is_no_record_of_ours_is_dropped_and_admitted(void **state)
{
	static const struct {
		size_t at;
		uint8_t value;
	} wrong[] = { { 8, 0 }, { 8, 3 }, { 11, 0x80 }, { 12, 16 }, { 15, 1 }, { 7, 0x80 }, { 4, 1 }, { 3, 0 } };
	struct reading t;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(wrong); i++) {
		reading_begin(&t);
		add(&t, rising);
		add_but(&t, falling, wrong[i].at, wrong[i].value);
		add(&t, falling); /* no gap in the numbers */
		decode(&t);
		assert_int_equal(t.n, 2);
		assert_int_equal(t.r.n_malformed, 1);
		assert_true(t.e[1].overflow && t.e[1].seq == 2);
		bb_clock_destroy(t.clk);
	}
}

static void a_descriptor_is_read_without_blocking(void **state)
{
	struct reading t;
	struct bb_line_bus *bus;
	int fd[2];

	(void)state;
	reading_begin(&t);
	assert_int_equal(pipe(fd), 0);
	assert_int_equal(bb_line_uapi2_on(fd[0], -1, 17, t.clk, &bus), BB_OK);
	assert_int_equal(bus->ops->read(bus, t.e, 8, &t.n), BB_TIMEOUT);
	assert_int_equal(t.n, 0);
	assert_int_equal(write(fd[1], rising, sizeof(rising)), sizeof(rising));
	assert_int_equal(write(fd[1], falling, sizeof(falling)), sizeof(falling));
	assert_int_equal(bus->ops->read(bus, t.e, 1, &t.n), BB_OK); /* no more than asked for */
	assert_int_equal(t.n, 1);
	assert_int_equal(bus->ops->read(bus, t.e, 8, &t.n), BB_OK);
	assert_int_equal(t.n, 1);
	assert_false(t.e[0].level);
	assert_int_equal(bus->ops->set(bus, true), BB_ERR_UNSUPPORTED);
	assert_int_equal(write(fd[1], rising, 5), 5);
	assert_int_equal(bus->ops->read(bus, t.e, 8, &t.n), BB_ERR_LOST); /* no kernel tears a record */
	close(fd[1]);
	assert_int_equal(bus->ops->read(bus, t.e, 8, &t.n), BB_ERR_LOST);
	bus->ops->close(bus);
	assert_int_equal(bb_line_uapi2_on(fd[0], -1, 17, t.clk, &bus), BB_ERR_IO); /* closed it is */
	assert_int_equal(errno, EBADF);
	assert_null(bus);
	bb_clock_destroy(t.clk);
}

static void what_is_no_chip_is_refused(void **state)
{
	static const struct bb_line_opener *const openers[] = { &bb_line_uapi2, &bb_line_gpiod };
	struct bb_line_request r = { .line = 3, .out = -1 };
	struct bb_clock *clk;

	(void)state;
	assert_int_equal(bb_clock_virtual_create(&clk), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(openers); i++) {
		struct bb_line_bus *bus;
		struct bb_error err = { 0 };
		snprintf(r.chip, sizeof(r.chip), "/dev/null");
		assert_int_equal(openers[i]->open(openers[i]->ctx, &r, clk, &bus, &err), BB_ERR_CONFIG);
		assert_null(bus);
		assert_int_equal(err.number, 1542);
		err.number = 0;
		snprintf(r.chip, sizeof(r.chip), "/dev/gpiochip4711");
		assert_int_equal(openers[i]->open(openers[i]->ctx, &r, clk, &bus, &err), BB_ERR_LOST);
		assert_int_equal(errno, ENOENT);
		assert_int_equal(err.number, 1542);
	}
	bb_clock_destroy(clk);
}

static size_t take(struct bb_line_bus *bus, struct bb_line_event *events, size_t cap)
{
	size_t n = 0, got;

	while (n < cap && bus->ops->read(bus, events + n, cap - n, &got) == BB_OK)
		n += got;
	return n;
}

/* A peer with a bus: the first event is read, then nobody reads for a time, then everything and what comes after. */
static size_t unread(bool numbered, int64_t for_ns, struct bb_line_event *events, size_t cap)
{
	const struct sim_line_config wave = { .rate = { 120, 1 }, .begin_ns = MS, .numbered = numbered };
	const struct bb_line_request r = { .chip = "sim", .line = 1, .out = -1, .n_buffer = 256 };
	struct bb_line_bus *bus;
	struct sim_line *line;
	struct bb_clock *clk;

	assert_int_equal(bb_clock_virtual_create(&clk), BB_OK);
	assert_int_equal(sim_line_create(clk, &wave, &line), BB_OK);
	const struct bb_line_opener *o = sim_line_opener(line);
	assert_int_equal(o->open(o->ctx, &r, clk, &bus, NULL), BB_OK);
	bb_clock_run_until(clk, 2 * MS);
	size_t n = take(bus, events, cap);
	assert_int_equal(n, 1);
	bb_clock_run_until(clk, for_ns);
	n += take(bus, events + n, cap - n);
	bb_clock_run_until(clk, for_ns + 20 * MS);
	n += take(bus, events + n, cap - n);
	bus->ops->close(bus);
	sim_line_destroy(line);
	bb_clock_destroy(clk);
	return n;
}

static void full_queues_drop_as_the_kernels_do(void **state)
{
	static struct bb_line_event e[600];

	(void)state;
	/* v2: the newest 256 are there, and the gap shows. */
	size_t n = unread(true, 3 * BB_NS_PER_S, e, 600);
	assert_true(n >= 256 && n <= 260);
	size_t gaps = 0, i;
	for (i = 1; i < n; i++) {
		assert_int_equal(e[i].overflow, e[i].seq != e[i - 1].seq + 1);
		gaps += e[i].overflow;
	}
	assert_int_equal(gaps, 1);
	assert_true(e[n - 1].at_ns > 3 * BB_NS_PER_S);
	/* v1: the oldest 16, and nobody says anything. */
	n = unread(false, 3 * BB_NS_PER_S, e, 600);
	assert_true(n >= 17 && n <= 20);
	assert_true(e[15].at_ns < 140 * MS && e[n - 1].at_ns > 3 * BB_NS_PER_S);
	for (i = 0; i < n; i++)
		assert_true(!e[i].seq && !e[i].overflow);
}

/* A process that slept for a second hears everything at once: nothing was lost, so nothing is wrong. */
static void a_late_reader_finds_no_fault(void **state)
{
	struct bb_edge_lock l;
	struct bb_shutter_edge out;
	uint32_t untold = 0;

	(void)state;
	bb_edge_lock_init(&l, (struct bb_rate){ 120, 1 }, 100, 0);
	for (uint32_t i = 0; i < 240; i++) {
		const int64_t at_ns = bb_rate_frame_ns((struct bb_rate){ 120, 1 }, i);
		const int64_t now_ns = i < 120 ? at_ns + 50 * US : 2 * BB_NS_PER_S;
		const struct bb_line_event e = { .at_ns = at_ns, .seq = i + 1, .level = i % 2 == 0 };
		assert_true(bb_edge_lock_event(&l, &e, now_ns, &out));
		assert_int_equal(out.seq, i);
		untold += out.eye == BB_EYE_NONE;
		assert_true(out.eye == BB_EYE_NONE || (out.eye == BB_EYE_LEFT) == e.level);
	}
	bb_edge_lock_pass(&l, 2 * BB_NS_PER_S);
	assert_int_equal(untold, 1);
	for (int f = 0; f < BB_SYNC_FAULT_COUNT; f++)
		assert_int_equal(l.fault[f].n, 0);
	assert_int_equal(bb_edge_lock_health(&l), BB_HEALTH_OK);
}

/* One level read late by the interrupt's thread: that eye is not told, the parity stands. */
static void one_level_against_the_parity_is_not_believed(void **state)
{
	struct bb_edge_lock l;
	struct bb_shutter_edge out;

	(void)state;
	bb_edge_lock_init(&l, (struct bb_rate){ 120, 1 }, 100, 0);
	for (uint32_t i = 0; i < 60; i++) {
		const int64_t at_ns = bb_rate_frame_ns((struct bb_rate){ 120, 1 }, i);
		const struct bb_line_event e = { .at_ns = at_ns, .seq = i + 1, .level = (i % 2 == 0) != (i == 40) };
		assert_true(bb_edge_lock_event(&l, &e, at_ns, &out));
		assert_int_equal(out.eye, i == 0 || i == 40 ? BB_EYE_NONE : i % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT);
	}
	assert_int_equal(l.unmatched, 1);
	assert_int_equal(l.fault[BB_SYNC_SWAP].n, 0);
}

/* A worn contact: four pulses within a quarter of the period after each edge. Not one may move the loop. */
static void chatter_is_dropped(void **state)
{
	struct bb_edge_lock l;
	struct bb_shutter_edge out;
	uint32_t seq = 0;

	(void)state;
	bb_edge_lock_init(&l, (struct bb_rate){ 120, 1 }, 100, 0);
	for (uint32_t i = 0; i < 120; i++) {
		const int64_t at_ns = bb_rate_frame_ns((struct bb_rate){ 120, 1 }, i);
		struct bb_line_event e = { .at_ns = at_ns, .seq = ++seq, .level = i % 2 == 0 };
		assert_true(bb_edge_lock_event(&l, &e, at_ns, &out));
		assert_int_equal(out.seq, i);
		for (int k = 1; k <= 8; k++) {
			e = (struct bb_line_event){ .at_ns = at_ns + k * 200 * US, .seq = ++seq, .level = !e.level };
			assert_false(bb_edge_lock_event(&l, &e, e.at_ns, &out));
		}
	}
	assert_int_equal(l.fault[BB_SYNC_GLITCH].n, 8 * 120);
	assert_int_equal(l.fault[BB_SYNC_LOST].n + l.fault[BB_SYNC_SWAP].n + l.fault[BB_SYNC_OVERRUN].n, 0);
	assert_int_equal(bb_edge_lock_health(&l), BB_HEALTH_DEGRADED); /* and it is said */
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(golden_records_are_read),
		cmocka_unit_test(a_gap_in_the_numbers_is_a_loss),
		cmocka_unit_test(what_is_no_record_of_ours_is_dropped_and_admitted),
		cmocka_unit_test(a_descriptor_is_read_without_blocking),
		cmocka_unit_test(what_is_no_chip_is_refused),
		cmocka_unit_test(full_queues_drop_as_the_kernels_do),
		cmocka_unit_test(a_late_reader_finds_no_fault),
		cmocka_unit_test(chatter_is_dropped),
		cmocka_unit_test(one_level_against_the_parity_is_not_believed),
	};

	return cmocka_run_group_tests_name("GPIO lines", tests, NULL, NULL);
}
