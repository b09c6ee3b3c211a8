/*
 * tests/test_faults_gpio.c: rows G1 to G9 of the fault matrix on the shipped GPIO driver: each is injected at the far
 * end of the line, and found, named and got over within its budget, in virtual time. Prints the table. With BB_KERNEL=1
 * what a kernel's chip can be told to do goes through the kernel instead, in real time.
 */
#include "tests/fault_table.h"
#include "tests/fixture_room.h"

#include <errno.h>
#include <time.h>

#include "drivers/shutter_gpio.h"
#include "sim/bus_sim_line.h"

#define T_NS 8333333
#define TELLTALE 400

struct bench {
	struct bb_clock *clk;
	struct sim_line *line;
	struct bb_shutter *sh;
	const struct bb_edge_lock *lock;
	struct bb_log log;
	struct bb_uri uri;
	char said[TELLTALE];
	enum bb_status status;       /* of the newest read */
	struct bb_shutter_edge last;
	uint64_t edges, untold, wrong; /* read; without an eye; with the wrong one */
	uint64_t ok_reads;           /* with health OK */
};

/* Row and what was injected, "G1 stuck high"; the driver's own words name it. */
static void row(const struct bench *b, const char *name, int64_t detected_ns, int64_t recovered_ns)
{
	char id[4];

	snprintf(id, sizeof(id), "%.2s", name);
	fault_row(id, name + 3, bb_shutter_device(b->sh)->last_error.detail, detected_ns, -1, recovered_ns);
}

static void hear(void *ctx, enum bb_log_level level, const char *text)
{
	struct bench *b = ctx;

	(void)level;
	snprintf(b->said, sizeof(b->said), "%s", text);
}

static int64_t now(const struct bench *b)
{
	return bb_clock_now_ns(b->clk);
}

static enum bb_status open_driver(struct bench *b)
{
	const struct bb_shutter_config c = { .id = "chain", .rate = { 120, 1 }, .cell = { 1800, 300, 500, 30 } };
	const struct bb_open open = { .clk = b->clk, .uri = &b->uri, .log = &b->log, .seed = 3 };

	return bb_shutter_gpio_open_on(sim_line_opener(b->line), &c, &open, &b->sh);
}

static void begin_line(struct bench *b, bool numbered)
{
	const struct sim_line_config wave = { .rate = { 120, 1 }, .jitter_us = 2, .numbered = numbered, .seed = 5 };

	memset(b, 0, sizeof(*b));
	b->log = (struct bb_log){ hear, b, BB_LOG_DEBUG };
	assert_int_equal(bb_uri_parse("gpio:/dev/gpiochip0?line=17&out=4", &b->uri, NULL, NULL), BB_OK);
	assert_int_equal(bb_clock_virtual_create(&b->clk), BB_OK);
	assert_int_equal(sim_line_create(b->clk, &wave, &b->line), BB_OK);
}

/* What a frame loop does, with a reading every millisecond; each edge's eye is held against the line itself. */
static void run(struct bench *b, int64_t for_ns)
{
	const int64_t end_ns = now(b) + for_ns;
	struct bb_shutter_edge e[16];
	size_t n;

	while (now(b) < end_ns) {
		const int64_t left_ns = end_ns - now(b);
		bb_clock_run_until(b->clk, now(b) + (left_ns < MS ? left_ns : MS));
		while ((b->status = bb_shutter_read(b->sh, e, BB_ARRAY_LEN(e), &n)) == BB_OK) {
			b->last = e[n - 1];
			b->edges += n;
			for (size_t i = 0; i < n; i++)
				b->untold += e[i].eye == BB_EYE_NONE;
			if (b->last.eye != BB_EYE_NONE)
				b->wrong += (b->last.eye == BB_EYE_LEFT) != sim_line_level(b->line);
		}
		b->ok_reads += bb_shutter_gpio_health(b->sh) == BB_HEALTH_OK;
	}
}

/* Goes on until just after an edge. */
static void to_edge(struct bench *b)
{
	const uint64_t edges = sim_line_edges(b->line);

	while (sim_line_edges(b->line) == edges)
		run(b, 10 * US);
}

static struct bench *begin(bool numbered)
{
	static struct bench bench;
	struct bench *b = &bench;

	begin_line(b, numbered);
	assert_int_equal(open_driver(b), BB_OK);
	b->lock = bb_shutter_gpio_lock(b->sh);
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_STEREO), BB_OK);
	run(b, 3 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	assert_true(sim_line_out(b->line));
	assert_int_equal(b->untold, 1); /* the first: nothing confirms it */
	to_edge(b);
	b->untold = 0;
	return b;
}

static void end(struct bench *b)
{
	assert_int_equal(b->wrong, 0);
	bb_shutter_close(b->sh);
	assert_false(sim_line_out(b->line));
	assert_false(sim_line_is_open(b->line));
	sim_line_destroy(b->line);
	bb_clock_destroy(b->clk);
}

static const struct bb_sync_fault_state *fault(const struct bench *b, enum bb_sync_fault f)
{
	return &b->lock->fault[f];
}

static void assert_named(struct bench *b, const char *name)
{
	const char *detail = bb_shutter_device(b->sh)->last_error.detail;

	if (strncmp(detail, name, strlen(name)))
		fail_msg("last_error says \"%s\", not %s", detail, name);
}

/* ---- the rows ---- */

static void g1_stuck(bool high)
{
	struct bench *b = begin(true);

	if (sim_line_level(b->line) != high)
		to_edge(b);
	const int64_t injected_ns = now(b);
	sim_line_stuck(b->line, true);
	run(b, 20 * MS);
	const int64_t detected_ns = fault(b, BB_SYNC_LOST)->set_ns - injected_ns;
	assert_true(fault(b, BB_SYNC_LOST)->set && detected_ns <= T_NS * 3 / 2);
	assert_named(b, "SYNC_LOST");
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_HOLDOVER);
	assert_true(bb_edge_lock_holdover_ns(b->lock, now(b)) > 8 * BB_NS_PER_S);
	assert_true(sim_line_out(b->line)); /* the loop coasts */
	run(b, 480 * MS);
	const int64_t ended_ns = now(b);
	sim_line_stuck(b->line, false);
	b->ok_reads = 0;
	run(b, 40 * MS);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_RECOVERING);
	assert_int_equal(b->ok_reads, 0);
	run(b, 160 * MS);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	const int64_t recovered_ns = fault(b, BB_SYNC_LOST)->cleared_ns - ended_ns;
	assert_true(recovered_ns <= 11 * T_NS); /* the next edge that is one, and 8 good ones */
	row(b, high ? "G1 stuck high" : "G1 stuck low", detected_ns, recovered_ns);
	end(b);
}

static void g1_a_stuck_line_is_coasted_over(void **state)
{
	(void)state;
	g1_stuck(true);
	g1_stuck(false);
}

static void g1_beyond_the_time_box_everything_opens(void **state)
{
	struct bench *b = begin(true);

	(void)state;
	const int64_t injected_ns = now(b);
	sim_line_stuck(b->line, true);
	run(b, 8300 * MS);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_HOLDOVER);
	assert_int_equal(b->status, BB_TIMEOUT);
	run(b, 100 * MS);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_LOST);
	assert_int_equal(b->status, BB_ERR_LOST);
	assert_false(sim_line_out(b->line));
	const int64_t opened_ns = sim_line_out_ns(b->line);
	assert_true(llabs(opened_ns - injected_ns - 8333 * MS) <= 10 * MS);
	const int64_t ended_ns = now(b);
	sim_line_stuck(b->line, false);
	run(b, 300 * MS);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	assert_false(sim_line_out(b->line)); /* latched */
	row(b, "G1 beyond the time-box", opened_ns - injected_ns, fault(b, BB_SYNC_LOST)->cleared_ns - ended_ns);
	run(b, 2 * BB_NS_PER_S);
	assert_true(sim_line_out(b->line));
	assert_true(sim_line_out_ns(b->line) - opened_ns >= 2 * BB_NS_PER_S);
	end(b);
}

static void g2_bounces_are_dropped(void **state)
{
	struct bench *b = begin(true);

	(void)state;
	run(b, 60 * BB_NS_PER_S);
	to_edge(b);
	const uint64_t edges = b->edges, real = sim_line_edges(b->line);
	sim_line_bounce(b->line, 1, 300 * US);
	to_edge(b);
	const int64_t injected_ns = now(b);
	run(b, 100 * MS);
	assert_int_equal(fault(b, BB_SYNC_GLITCH)->n, 2); /* there and back */
	assert_named(b, "GLITCH");
	assert_int_equal(b->edges - edges, sim_line_edges(b->line) - real);
	assert_int_equal(b->untold, 0);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK); /* one in a minute is no reason */
	const int64_t detected_ns = fault(b, BB_SYNC_GLITCH)->set_ns - injected_ns;
	assert_true(detected_ns <= T_NS / 4);
	row(b, "G2 one bounce", detected_ns, fault(b, BB_SYNC_GLITCH)->cleared_ns - injected_ns);
	const int64_t begun_ns = now(b);
	sim_line_bounce(b->line, 60, 300 * US);
	run(b, BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_DEGRADED);
	const int64_t found_ns = fault(b, BB_SYNC_GLITCH)->set_ns - begun_ns;
	run(b, 61 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	row(b, "G2 bounces above 1 % of a minute", found_ns, fault(b, BB_SYNC_GLITCH)->cleared_ns - begun_ns - 500 * MS);
	assert_int_equal(b->edges - edges, sim_line_edges(b->line) - real);
	end(b);
}

static void g3_a_missed_pulse_keeps_the_eyes(void **state)
{
	struct bench *b = begin(true);

	(void)state;
	for (unsigned n = 1; n <= 2; n++) {
		const uint32_t seq = b->last.seq;
		const uint64_t before = fault(b, BB_SYNC_MISSED)->n;
		const int64_t injected_ns = now(b);
		sim_line_miss(b->line, n);
		run(b, (int64_t)(n + 1) * T_NS + 2 * MS);
		assert_int_equal(fault(b, BB_SYNC_MISSED)->n - before, n);
		assert_named(b, "MISSED");
		assert_int_equal(b->last.seq, seq + n + 1); /* the gap is seen */
		assert_int_equal(b->untold, 0);             /* and the eye known all the same */
		assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
		const int64_t detected_ns = fault(b, BB_SYNC_MISSED)->set_ns - injected_ns;
		assert_true(detected_ns <= T_NS * 3 / 2);
		row(b, n == 1 ? "G3 one missed pulse" : "G3 two missed pulses", detected_ns,
		    fault(b, BB_SYNC_MISSED)->cleared_ns - injected_ns - (int64_t)n * T_NS);
		to_edge(b);
	}
	end(b);
}

static void g4_lost_events(bool numbered, unsigned n)
{
	struct bench *b = begin(numbered);
	char name[48];

	const int64_t injected_ns = now(b);
	sim_line_overflow(b->line, n);
	while (!fault(b, BB_SYNC_OVERRUN)->n)
		run(b, MS);
	const int64_t back_ns = injected_ns + (int64_t)(n + 1) * T_NS; /* the first event that can be read */
	const int64_t detected_ns = fault(b, BB_SYNC_OVERRUN)->set_ns - back_ns;
	assert_true(detected_ns <= 2 * MS);
	assert_named(b, "EVT_OVERRUN");
	assert_int_equal(b->last.eye, BB_EYE_NONE);
	assert_true(bb_shutter_gpio_health(b->sh) != BB_HEALTH_OK);
	run(b, 200 * MS);
	assert_int_equal(b->untold, 1); /* the next one, alternating and in its place, is the tag */
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	snprintf(name, sizeof(name), "G4 %u events lost, %s", n, numbered ? "numbered" : "inferred");
	row(b, name, detected_ns, fault(b, BB_SYNC_OVERRUN)->cleared_ns - back_ns);
	end(b);
}

static void g4_lost_events_are_seen_and_nothing_is_guessed(void **state)
{
	(void)state;
	for (int numbered = 1; numbered >= 0; numbered--) {
		g4_lost_events(numbered, 1);
		g4_lost_events(numbered, 16);
	}
}

static void g5_drift_is_followed(void **state)
{
	struct bench *b = begin(true);

	(void)state;
	for (int ppm = -100; ppm <= 100; ppm += 200) {
		const struct bb_rate rate = { 120, 1 };
		const int64_t injected_ns = now(b);
		double square = 0;
		int n = 0;
		sim_line_rate(b->line, rate, ppm);
		while (fabs(b->lock->drift_ppm - ppm) > 5 && now(b) - injected_ns < 5 * BB_NS_PER_S)
			run(b, MS);
		const int64_t detected_ns = now(b) - injected_ns;
		assert_true(detected_ns <= 2 * BB_NS_PER_S);
		for (b->ok_reads = 0; n < 240; n++) {
			to_edge(b);
			const double off_ns = (double)(b->lock->ref_ns - b->last.at_ns);
			square += off_ns * off_ns / 240;
		}
		assert_true(sqrt(square) <= 0.02 * T_NS);
		assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
		fault_row("G5", ppm < 0 ? "rate -100 ppm" : "rate +100 ppm", "(drift)", detected_ns, -1, 0);
		printf("     rms phase error %.3f %% of a period, drift %.1f ppm\n", 100 * sqrt(square) / T_NS,
		       b->lock->drift_ppm);
	}
	assert_int_equal(fault(b, BB_SYNC_JITTER)->n, 0);
	assert_int_equal(b->untold, 0);
	end(b);
}

static void g6_jitter_loses_nothing(void **state)
{
	struct bench *b = begin(true);

	(void)state;
	const uint32_t seq = b->last.seq;
	const uint64_t real = sim_line_edges(b->line);
	const int64_t injected_ns = now(b);
	sim_line_jitter(b->line, T_NS / 5);
	run(b, BB_NS_PER_S);
	assert_true(fault(b, BB_SYNC_JITTER)->n && bb_shutter_gpio_health(b->sh) == BB_HEALTH_DEGRADED);
	assert_named(b, "JITTER");
	const int64_t detected_ns = fault(b, BB_SYNC_JITTER)->set_ns - injected_ns;
	assert_true(detected_ns <= 3 * T_NS + T_NS / 5 + MS);
	const int64_t ended_ns = now(b);
	sim_line_jitter(b->line, 0);
	run(b, BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	assert_int_equal(b->last.seq - seq, sim_line_edges(b->line) - real); /* not one frame slipped */
	assert_int_equal(fault(b, BB_SYNC_LOST)->n + fault(b, BB_SYNC_GLITCH)->n + fault(b, BB_SYNC_RATE)->n, 0);
	assert_int_equal(b->untold, 0);
	row(b, "G6 jitter +-20 % for 1 s", detected_ns, fault(b, BB_SYNC_JITTER)->cleared_ns - ended_ns);
	end(b);
}

static void g7_another_rate(uint32_t hz)
{
	struct bench *b = begin(true);
	char name[48];

	const uint64_t before = sim_line_edges(b->line);
	int64_t injected_ns = now(b);
	sim_line_rate(b->line, (struct bb_rate){ hz, 1 }, 0);
	while (!fault(b, BB_SYNC_RATE)->n)
		run(b, 500 * US);
	assert_true(sim_line_edges(b->line) - before <= 5);
	assert_named(b, "RATE_CHANGE");
	assert_false(sim_line_out(b->line)); /* open */
	const int64_t detected_ns = fault(b, BB_SYNC_RATE)->set_ns - injected_ns;
	run(b, BB_NS_PER_S);
	const int64_t relocked_ns = fault(b, BB_SYNC_RATE)->cleared_ns - injected_ns;
	assert_true(!fault(b, BB_SYNC_RATE)->set && relocked_ns <= BB_NS_PER_S);
	assert_true(fabs(b->lock->period_ns * hz - 1e9) < 1e9 * 1e-4);
	snprintf(name, sizeof(name), "G7 120 to %u Hz", hz);
	row(b, name, detected_ns, relocked_ns);
	run(b, 3 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_DEGRADED); /* it is not what the room says */
	assert_false(sim_line_out(b->line));
	injected_ns = now(b);
	sim_line_rate(b->line, (struct bb_rate){ 120, 1 }, 0);
	run(b, 3 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	assert_true(sim_line_out(b->line));
	snprintf(name, sizeof(name), "G7 %u to 120 Hz", hz);
	row(b, name, fault(b, BB_SYNC_RATE)->set_ns - injected_ns, fault(b, BB_SYNC_RATE)->cleared_ns - injected_ns);
	end(b);
}

static void g7_another_rate_opens_and_relocks(void **state)
{
	(void)state;
	g7_another_rate(96);
	g7_another_rate(60);
	g7_another_rate(144);
}

static void g8_inverted_eyes(int64_t after_ns)
{
	struct bench *b = begin(true);

	run(b, after_ns);
	const int64_t injected_ns = now(b);
	sim_line_invert(b->line);
	run(b, 3 * T_NS);
	assert_int_equal(fault(b, BB_SYNC_SWAP)->n, 1);
	const int64_t detected_ns = fault(b, BB_SYNC_SWAP)->set_ns - injected_ns;
	assert_true(detected_ns <= 2 * T_NS + MS); /* and a reading's delay */
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_DEGRADED);
	assert_named(b, "EYE_SWAP");
	run(b, 300 * MS);
	assert_true(b->untold <= 2);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	row(b, after_ns ? "G8 eyes inverted within a frame" : "G8 eyes inverted at an edge", detected_ns,
	    fault(b, BB_SYNC_SWAP)->cleared_ns - injected_ns);
	end(b);
}

static void g8_inverted_eyes_are_told_by_the_level(void **state)
{
	(void)state;
	g8_inverted_eyes(0);
	g8_inverted_eyes(T_NS * 2 / 5);
	g8_inverted_eyes(T_NS * 3 / 5);
}

static void g9_the_chip_vanishes(int os_errno, const char *says)
{
	struct bench *b = begin(true);
	char name[48];

	const int64_t injected_ns = now(b);
	sim_line_vanish(b->line, os_errno);
	run(b, MS);
	assert_int_equal(b->status, BB_ERR_LOST);
	const struct bb_last_error *e = &bb_shutter_device(b->sh)->last_error;
	const int64_t detected_ns = fault(b, BB_SYNC_GONE)->set_ns - injected_ns;
	assert_true(detected_ns <= MS); /* one read */
	assert_int_equal(e->os_errno, ENODEV);
	assert_named(b, "GONE");
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_HOLDOVER);
	assert_false(sim_line_out(b->line));
	run(b, 3 * BB_NS_PER_S);
	assert_string_equal(e->op, "reopen");
	assert_int_equal(e->os_errno, os_errno);
	assert_non_null(strstr(e->detail, says));
	const int64_t ended_ns = now(b);
	sim_line_vanish(b->line, 0);
	run(b, 6 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	assert_true(sim_line_out(b->line));
	snprintf(name, sizeof(name), "G9 chip gone, then %s", strerror(os_errno));
	row(b, name, detected_ns, fault(b, BB_SYNC_LOST)->cleared_ns - ended_ns);
	assert_true(fault(b, BB_SYNC_GONE)->cleared_ns - ended_ns <= 6 * BB_NS_PER_S); /* back-off ends at 5 s +-20 % */
	end(b);
}

static void g9_a_vanished_chip_is_knocked_for(void **state)
{
	(void)state;
	g9_the_chip_vanishes(ENOENT, "BB1542");
	g9_the_chip_vanishes(EACCES, "BB1540");
}

static void g9_five_returns_a_minute_are_enough(void **state)
{
	struct bench *b = begin(true);
	int rounds = 0;

	(void)state;
	for (; bb_shutter_gpio_health(b->sh) != BB_HEALTH_QUARANTINED && rounds < 20; rounds++) {
		sim_line_vanish(b->line, ENOENT);
		run(b, 50 * MS);
		sim_line_vanish(b->line, 0);
		run(b, BB_NS_PER_S);
	}
	assert_int_equal(rounds, 6);
	run(b, 120 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_QUARANTINED);
	assert_false(sim_line_is_open(b->line));
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_OPEN), BB_OK); /* somebody looked after it */
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_STEREO), BB_OK);
	run(b, 3 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_gpio_health(b->sh), BB_HEALTH_OK);
	end(b);
}

static void g9_a_line_that_cannot_be_had_says_why(void **state)
{
	static const struct {
		int os_errno, number;
		enum bb_status status;
		const char *remedy;
	} want[] = { { EACCES, 1540, BB_ERR_IO, "udev rule" }, { ENOENT, 1542, BB_ERR_LOST, "gpioinfo" } };
	struct bench b;
	char number[8];

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(want); i++) {
		begin_line(&b, true);
		sim_line_vanish(b.line, want[i].os_errno);
		assert_int_equal(open_driver(&b), want[i].status);
		assert_null(b.sh);
		snprintf(number, sizeof(number), "BB%d", want[i].number);
		assert_non_null(strstr(b.said, number));
		assert_non_null(strstr(b.said, want[i].remedy));
		sim_line_vanish(b.line, 0);
		struct bb_shutter *first;
		assert_int_equal(open_driver(&b), BB_OK);
		first = b.sh;
		assert_int_equal(open_driver(&b), BB_ERR_BUSY);
		assert_non_null(strstr(b.said, "BB1541"));
		fault_row("G9", want[i].os_errno == EACCES ? "EACCES on open" : "ENOENT on open", number, 0, 0, 0);
		bb_shutter_close(first);
		sim_line_destroy(b.line);
		bb_clock_destroy(b.clk);
	}
}

static void a_bad_uri_is_refused(void **state)
{
	static const char *const uris[] = { "gpio:/dev/gpiochip0", "gpio:?line=3", "gpio:gpiochip0?line=3",
		                            "gpio:/dev/gpiochip0?line=-1", "gpio:/dev/gpiochip0?line=3&out=3",
		                            "gpio:/dev/gpiochip0?line=3&api=sysfs", "gpio:/dev/gpiochip0?line=3&lyne=4" };
	struct bench b;

	(void)state;
	begin_line(&b, true);
	for (size_t i = 0; i < BB_ARRAY_LEN(uris); i++) {
		assert_int_equal(bb_uri_parse(uris[i], &b.uri, NULL, NULL), BB_OK);
		assert_int_equal(open_driver(&b), BB_ERR_CONFIG);
		assert_non_null(strstr(b.said, "BB1"));
	}
	sim_line_destroy(b.line);
	bb_clock_destroy(b.clk);
}

/* ---- through a kernel's chip (sim/kmod/), in real time ---- */

struct chip {
	struct bb_clock *clk;
	struct bb_shutter *sh;
	const struct bb_edge_lock *lock;
	struct bb_shutter_edge last;
	uint64_t edges, untold;
	int64_t worst_read_ns;
};

static void tell_chip(const char *command)
{
	FILE *f = fopen("/dev/bb-gpio", "w");

	assert_non_null(f);
	assert_true(fputs(command, f) >= 0);
	assert_int_equal(fclose(f), 0);
}

static enum bb_eye chip_eye(void)
{
	char levels[16] = "";
	FILE *f = fopen("/dev/bb-gpio", "r");

	assert_non_null(f);
	assert_non_null(fgets(levels, sizeof(levels), f));
	fclose(f);
	return levels[3] == '1' ? BB_EYE_LEFT : BB_EYE_RIGHT;
}

static void chip_run(struct chip *c, int64_t for_ns)
{
	const int64_t end_ns = bb_clock_now_ns(c->clk) + for_ns;
	struct bb_shutter_edge e[16];
	size_t n;

	while (bb_clock_now_ns(c->clk) < end_ns) {
		bb_clock_run_until(c->clk, bb_clock_now_ns(c->clk) + MS);
		const int64_t begun_ns = bb_clock_now_ns(c->clk);
		while (bb_shutter_read(c->sh, e, BB_ARRAY_LEN(e), &n) == BB_OK) {
			for (size_t i = 0; i < n; i++)
				c->untold += e[i].eye == BB_EYE_NONE;
			c->last = e[n - 1];
			c->edges += n;
		}
		if (bb_clock_now_ns(c->clk) - begun_ns > c->worst_read_ns)
			c->worst_read_ns = bb_clock_now_ns(c->clk) - begun_ns;
	}
}

/* Every edge is there, and its eye that of the line. */
static void chip_is_well(struct chip *c)
{
	const uint32_t seq = c->last.seq;
	int judged = 0;

	c->edges = c->untold = 0;
	for (int i = 0; i < 300; i++) {
		chip_run(c, MS);
		const int64_t age_ns = bb_clock_now_ns(c->clk) - c->last.at_ns;
		if (age_ns < MS || age_ns > 6 * MS)
			continue;
		assert_int_equal(chip_eye(), c->last.eye);
		judged++;
	}
	assert_true(judged > 50);
	assert_int_equal(c->last.seq - seq, c->edges);
	assert_in_range(c->edges, 35, 50);
	assert_int_equal(c->untold, 0);
}

/* Tells the chip, or lets nobody look for deaf_ns; then until it is found, named, and over. */
static void chip_row(struct chip *c, const char *id, const char *what, const char *command, int64_t deaf_ns,
                     enum bb_sync_fault f, int64_t budget_ns)
{
	const struct timespec deaf = { .tv_sec = deaf_ns / BB_NS_PER_S };
	const char *name = bb_sync_fault_text(f);
	const uint64_t before = c->lock->fault[f].n;
	char named[TELLTALE];

	if (command)
		tell_chip(command);
	else
		nanosleep(&deaf, NULL);
	const int64_t from_ns = bb_clock_now_ns(c->clk);
	while (c->lock->fault[f].n == before) {
		assert_true(bb_clock_now_ns(c->clk) - from_ns < BB_NS_PER_S);
		chip_run(c, MS / 2);
	}
	const int64_t found_ns = bb_clock_now_ns(c->clk) - from_ns;
	snprintf(named, sizeof(named), "%s", bb_shutter_device(c->sh)->last_error.detail);
	if (strncmp(named, name, strlen(name)))
		fail_msg("last_error says \"%s\", not %s", named, name);
	while (c->lock->fault[f].set || bb_shutter_gpio_health(c->sh) != BB_HEALTH_OK) {
		assert_true(bb_clock_now_ns(c->clk) - from_ns < 12 * BB_NS_PER_S);
		chip_run(c, MS / 2);
	}
	fault_row(id, what, named, found_ns, budget_ns, bb_clock_now_ns(c->clk) - from_ns - found_ns);
	assert_in_range(found_ns, 0, budget_ns);
	chip_is_well(c);
}

static void rows_on_a_kernels_chip(void **state)
{
	const struct bb_shutter_config config = { .id = "chain", .rate = { 120, 1 }, .cell = { 1800, 300, 500, 30 } };
	struct chip c = { 0 };
	struct bb_uri uri;

	(void)state;
	tell_chip("wave 3 8333333");
	assert_int_equal(bb_uri_parse("gpio:/dev/gpiochip0?line=3", &uri, NULL, NULL), BB_OK);
	assert_int_equal(bb_clock_posix_create(&c.clk), BB_OK);
	const struct bb_open open = { .clk = c.clk, .uri = &uri, .seed = 3 };
	assert_int_equal(bb_shutter_open(&bb_shutter_gpio_driver, &config, &open, &c.sh), BB_OK);
	c.lock = bb_shutter_gpio_lock(c.sh);
	assert_int_equal(bb_shutter_set_mode(c.sh, BB_SHUTTER_STEREO), BB_OK);
	chip_run(&c, 2 * BB_NS_PER_S);
	chip_is_well(&c);
	chip_row(&c, "G1", "chip: silent for 12 edges", "miss 3 12", 0, BB_SYNC_LOST, 5 * T_NS / 2 + 2 * MS);
	chip_row(&c, "G3", "chip: one interrupt lost", "miss 3 1", 0, BB_SYNC_MISSED, 3 * T_NS + 2 * MS);
	chip_row(&c, "G3", "chip: two interrupts lost", "miss 3 2", 0, BB_SYNC_MISSED, 4 * T_NS + 2 * MS);
	c.worst_read_ns = 0;
	chip_row(&c, "G4", "chip: nobody looks for 10 s", NULL, 10 * BB_NS_PER_S, BB_SYNC_OVERRUN, 2 * MS);
	assert_true(c.worst_read_ns < T_NS); /* not even with a full queue */
	print_message("the longest read took %.3f ms\n", (double)c.worst_read_ns * 1e-6);
	bb_shutter_close(c.sh);
	bb_clock_destroy(c.clk);
	tell_chip("stop");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(g1_a_stuck_line_is_coasted_over),
		cmocka_unit_test(g1_beyond_the_time_box_everything_opens),
		cmocka_unit_test(g2_bounces_are_dropped),
		cmocka_unit_test(g3_a_missed_pulse_keeps_the_eyes),
		cmocka_unit_test(g4_lost_events_are_seen_and_nothing_is_guessed),
		cmocka_unit_test(g5_drift_is_followed),
		cmocka_unit_test(g6_jitter_loses_nothing),
		cmocka_unit_test(g7_another_rate_opens_and_relocks),
		cmocka_unit_test(g8_inverted_eyes_are_told_by_the_level),
		cmocka_unit_test(g9_a_vanished_chip_is_knocked_for),
		cmocka_unit_test(g9_five_returns_a_minute_are_enough),
		cmocka_unit_test(g9_a_line_that_cannot_be_had_says_why),
		cmocka_unit_test(a_bad_uri_is_refused),
	};

	const struct CMUnitTest kernel[] = { cmocka_unit_test(rows_on_a_kernels_chip) };

	if (getenv("BB_KERNEL"))
		return cmocka_run_group_tests_name("faults: GPIO sync line of a kernel", kernel, NULL, NULL);
	return cmocka_run_group_tests_name("faults: GPIO sync line", tests, NULL, NULL);
}
