/*
 * tests/contract_shutter.c: what every shutter chain must do, over every back end, with tolerances from its limits;
 * then what only the simulated one can be told.
 */
#include "tests/fixture_room.h"
#include "drivers/shutter_gpio.h"
#include "sim/bus_sim_line.h"
#include "sim/sim_shutter.h"
#include "tests/fixture_can.h"

#define STAGES 4 /* front, left, right, emitter (as row 3 below) */
#define ROW(stage) ((stage) == BB_STAGE_EMITTER ? STAGES - 1 : (stage))

struct bench {
	struct rig rig;
	struct bb_shutter *sh;
	void *peer; /* the far end of the wire, where a row has one */
	size_t n[STAGES];
	struct bb_shutter_edge edge[STAGES][2000];
};

static const struct backend {
	const char *name;
	int fidelity;
	enum bb_status (*open)(struct bench *b, const struct bb_open *open);
	void (*close)(struct bench *b); /* of what open made besides the handle; NULL: nothing */
	const struct bb_shutter_driver *driver; /* NULL: not of the simulated world */
} *backend;

static enum bb_status open_sim(struct bench *b, const struct bb_open *open)
{
	return bb_shutter_open(backend->driver, &b->rig.fix.room.chain, open, &b->sh);
}

/* The shipped GPIO driver on a line whose far end is a generator with the chain's own errors. */
static enum bb_status open_gpio(struct bench *b, const struct bb_open *open)
{
	const struct bb_shutter_config *c = &b->rig.fix.room.chain;
	const struct sim_line_config wave = { .rate = c->rate, .rate_error_ppm = c->rate_error_ppm,
		                              .jitter_us = c->jitter_us, .numbered = backend->fidelity,
		                              .seed = b->rig.seed };
	struct sim_line *line;
	struct bb_uri uri;
	struct bb_open with = *open;

	assert_int_equal(bb_uri_parse("gpio:/dev/gpiochip0?line=17&out=4", &uri, NULL, NULL), BB_OK);
	with.uri = &uri;
	assert_int_equal(sim_line_create(b->rig.clk, &wave, &line), BB_OK);
	b->peer = line;
	return bb_shutter_gpio_open_on(sim_line_opener(line), c, &with, &b->sh);
}

static void close_gpio(struct bench *b)
{
	assert_false(sim_line_is_open(b->peer));
	assert_false(sim_line_out(b->peer)); /* fail-safe: the glasses hear nothing */
	sim_line_destroy(b->peer);
}

/* The shipped CAN driver with a chain of CANopen controllers at the far end of a medium. */
static enum bb_status open_can(struct bench *b, const struct bb_open *open)
{
	struct can_far *far = calloc(1, sizeof(*far));

	(void)open;
	assert_non_null(far);
	b->peer = far;
	b->sh = can_far_open(&b->rig, far);
	return BB_OK;
}

static void close_can(struct bench *b)
{
	can_far_close(b->peer);
	free(b->peer);
}

static const struct backend backends[] = {
	{ "shutter: sim, fidelity 0", 0, open_sim, NULL, &sim_shutter_driver },
	{ "shutter: sim, fidelity 1", 1, open_sim, NULL, &sim_shutter_driver },
	{ "shutter: sim, fidelity 2", 2, open_sim, NULL, &sim_shutter_driver },
	{ "shutter: gpio driver, line without numbers", 0, open_gpio, close_gpio, NULL },
	{ "shutter: gpio driver, numbered line", 1, open_gpio, close_gpio, NULL },
	{ "shutter: CAN driver and peer, ideal", 0, open_can, close_can, NULL },
	{ "shutter: CAN driver and peer", 1, open_can, close_can, NULL },
};

static int setup(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));

	if (!b)
		return -1;
	rig_init(&b->rig, 1, backend->fidelity);
	const struct bb_open open = rig_open(&b->rig);
	assert_int_equal(backend->open(b, &open), BB_OK);
	*state = b;
	return 0;
}

static int teardown(void **state)
{
	struct bench *b = *state;

	bb_shutter_close(b->sh);
	if (backend->close)
		backend->close(b);
	rig_done(&b->rig);
	free(b);
	return 0;
}

/* Does the back end report the edges of this row? The glasses' always. */
static bool seen(const struct bench *b, int row)
{
	return row == STAGES - 1 || row < bb_shutter_limits(b->sh)->n_stages;
}

static int first_row(const struct bench *b)
{
	return seen(b, 0) ? 0 : STAGES - 1;
}

static int64_t period(const struct bench *b)
{
	return bb_rate_period_ns(b->rig.fix.room.chain.rate);
}

/* How far one edge may be from its place: jitter, the generator's rate error, stamps. */
static int64_t wander(const struct bench *b)
{
	const struct bb_shutter_config *c = &b->rig.fix.room.chain;

	return 2 * bb_shutter_limits(b->sh)->stamp_error_ns + (int64_t)(8 * c->jitter_us * 1000) +
	       (int64_t)(c->rate_error_ppm * 1e-6 * (double)period(b)) + 2;
}

/* Runs the clock, reading as it goes; edges by stage, from now on. */
static void collect(struct bench *b, int64_t for_ns)
{
	const int64_t end_ns = bb_clock_now_ns(b->rig.clk) + for_ns;
	struct bb_shutter_edge e[16];
	size_t n;

	memset(b->n, 0, sizeof(b->n));
	while (bb_clock_now_ns(b->rig.clk) < end_ns) {
		rig_run(&b->rig, 10 * MS);
		while (bb_shutter_read(b->sh, e, BB_ARRAY_LEN(e), &n) == BB_OK)
			for (size_t i = 0; i < n; i++) {
				const size_t row = ROW(e[i].stage);
				assert_true(row < STAGES && b->n[row] < 2000);
				assert_true(e[i].at_ns <= bb_clock_now_ns(b->rig.clk));
				b->edge[row][b->n[row]++] = e[i];
			}
	}
}

static void stereo(struct bench *b)
{
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_STEREO), BB_OK);
}

static void limits_hold_the_configuration(void **state)
{
	struct bench *b = *state;
	const struct bb_shutter_limits *l = bb_shutter_limits(b->sh);

	assert_true(l->least_period_ns <= period(b) && period(b) <= l->most_period_ns);
	assert_true(l->phase_step_ns >= 0 && l->stamp_error_ns >= 0);
	assert_true(l->open_ns >= l->close_ns);
	assert_true(l->n_stages >= 0 && l->n_stages <= b->rig.fix.room.chain.n_stages);
}

static void edges_alternate_eyes_at_the_rate(void **state)
{
	struct bench *b = *state;

	stereo(b);
	collect(b, 5 * BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++) {
		if (!seen(b, s)) {
			assert_int_equal(b->n[s], 0);
			continue;
		}
		assert_true(b->n[s] >= 599 && b->n[s] <= 601);
		for (size_t i = 1; i < b->n[s]; i++) {
			const struct bb_shutter_edge *p = &b->edge[s][i - 1], *q = &b->edge[s][i];
			assert_int_equal(q->seq, p->seq + 1);
			assert_true(q->eye != p->eye && (q->eye == BB_EYE_LEFT || q->eye == BB_EYE_RIGHT));
			assert_true(llabs(q->at_ns - p->at_ns - period(b)) <= wander(b));
		}
	}
	for (int s = 1; s < STAGES && seen(b, 0); s++) { /* one edge has one eye everywhere */
		const uint32_t ahead = b->edge[s][0].seq - b->edge[0][0].seq;
		assert_int_equal((b->edge[s][0].eye + b->edge[0][0].eye + ahead) % 2, 0);
	}
}

/* Edges of a stage against those of the emitter by number, mean, ns. */
static double lag_ns(const struct bench *b, int stage)
{
	double sum = 0;
	int n = 0;

	for (size_t i = 0, k = 0; i < b->n[stage] && k < b->n[STAGES - 1];) {
		const struct bb_shutter_edge *p = &b->edge[stage][i], *q = &b->edge[STAGES - 1][k];
		if (p->seq != q->seq) {
			if (p->seq < q->seq)
				i++;
			else
				k++;
			continue;
		}
		sum += (double)(p->at_ns - q->at_ns);
		n++;
		i++;
		k++;
	}
	assert_true(n > 50);
	return sum / n;
}

static void set_phase_moves_one_stage_by_what_was_asked(void **state)
{
	struct bench *b = *state;
	const double step_ns = (double)bb_shutter_limits(b->sh)->phase_step_ns;
	static const int64_t asked_ns[] = { 0, 1234567, 3000000, 8000000, 100400 };
	double first[STAGES] = { 0 };

	if (step_ns <= 0) { /* then it must say so */
		assert_int_equal(bb_shutter_set_phase(b->sh, 1, 1234567, 1000000), BB_ERR_UNSUPPORTED);
		return;
	}
	stereo(b);
	for (size_t i = 0; i < BB_ARRAY_LEN(asked_ns); i++) {
		assert_int_equal(bb_shutter_set_phase(b->sh, 1, asked_ns[i], 1000000), BB_OK);
		collect(b, 30 * MS); /* the edge under way */
		collect(b, BB_NS_PER_S);
		for (int s = 0; s < STAGES; s++) {
			const double moved_ns = lag_ns(b, s) - (i ? first[s] : lag_ns(b, s));
			const double want_ns = s == 1 ? (double)(asked_ns[i] - asked_ns[0]) : 0;
			assert_true(fabs(moved_ns - want_ns) <= 2 * step_ns + 2);
			if (!i)
				first[s] = lag_ns(b, s);
		}
	}
}

static void phase_arguments_are_checked(void **state)
{
	struct bench *b = *state;

	assert_int_equal(bb_shutter_set_phase(b->sh, 3, 0, 0), BB_ERR_USAGE);
	assert_int_equal(bb_shutter_set_phase(b->sh, 0, -1, 0), BB_ERR_RANGE);
	assert_int_equal(bb_shutter_set_phase(b->sh, 0, period(b), 0), BB_ERR_RANGE);
	assert_int_equal(bb_shutter_set_phase(b->sh, 0, 0, 1000001), BB_ERR_RANGE);
	assert_int_equal(bb_shutter_set_phase(b->sh, BB_STAGE_EMITTER, 3000000, 500000),
	                 bb_shutter_limits(b->sh)->phase_step_ns ? BB_OK : BB_ERR_UNSUPPORTED);
}

static void open_mode_stops_the_edges(void **state)
{
	struct bench *b = *state;

	collect(b, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(b->n[s], 0); /* open until told otherwise */
	stereo(b);
	stereo(b);
	collect(b, 100 * MS);
	assert_true(b->n[first_row(b)] >= 11);
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_OPEN), BB_OK);
	collect(b, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(b->n[s], 0);
	stereo(b);
	collect(b, 100 * MS);
	assert_true(b->n[first_row(b)] >= 11);
}

static void reading_in_small_pieces_loses_nothing(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_edge e;
	uint32_t seq = 0;
	size_t n;
	int seen = 0;

	stereo(b);
	rig_run(&b->rig, 200 * MS);
	const int64_t now_ns = bb_clock_now_ns(b->rig.clk);
	while (bb_shutter_read(b->sh, &e, 1, &n) == BB_OK) {
		assert_int_equal(n, 1);
		if (ROW(e.stage) == first_row(b)) {
			assert_true(!seen || e.seq == seq + 1);
			seq = e.seq;
			seen++;
		}
	}
	assert_int_equal(n, 0);
	assert_true(seen >= 23);
	assert_int_equal(bb_clock_now_ns(b->rig.clk), now_ns);
	assert_int_equal(bb_shutter_read(b->sh, &e, 0, &n), BB_ERR_USAGE);
}

/* What follows needs the simulated world. */

static void compensated_stages_are_in_phase_with_the_glasses(void **state)
{
	struct bench *b = *state;

	for (uint8_t s = 0; s < 3; s++)
		assert_int_equal(bb_shutter_set_phase(b->sh, s, 3000000, 1000000), BB_OK);
	stereo(b);
	collect(b, 20 * MS);
	collect(b, BB_NS_PER_S);
	for (int s = 0; s < 3; s++) {
		const double lag = lag_ns(b, s);
		assert_true(fabs(lag) <= (backend->fidelity ? 80e3 : 1)); /* two units, 2.5 sd of 15 us each */
		assert_true(!backend->fidelity || fabs(lag) > 1);         /* no unit is perfect */
	}
}

static void raw_stages_follow_down_the_chain(void **state)
{
	struct bench *b = *state;

	stereo(b);
	collect(b, 20 * MS);
	collect(b, BB_NS_PER_S);
	for (int s = 0; s < 3; s++)
		assert_true(fabs(lag_ns(b, s) - ((s + 1) * 35e3 - 3000e3)) < 80e3);
}

static void the_rate_error_is_the_generators(void **state)
{
	struct bench *b = *state;

	stereo(b);
	collect(b, 10 * BB_NS_PER_S);
	const struct bb_shutter_edge *p = &b->edge[0][0], *q = &b->edge[0][b->n[0] - 1];
	const double ideal_ns = (double)bb_rate_frame_ns(b->rig.fix.room.chain.rate, q->seq - p->seq);
	const double ppm = (ideal_ns / (double)(q->at_ns - p->at_ns) - 1) * 1e6;
	assert_true(fabs(ppm - 12) < 2.5); /* 20 us of jitter in 10 s */
}

static void transitions_follow_the_edges(void **state)
{
	struct bench *b = *state;
	double least = 1;

	for (int64_t t = 0; t < 30; t++) { /* open before stereo */
		rig_run(&b->rig, MS);
		assert_true(sim_shutter_transmission(b->sh, 0, BB_EYE_LEFT, bb_clock_now_ns(b->rig.clk)) > 0.999);
	}
	stereo(b);
	collect(b, 200 * MS);
	const struct bb_shutter_edge e = b->edge[0][b->n[0] - 1];
	const enum bb_eye opening = e.eye, closing = e.eye == BB_EYE_LEFT ? BB_EYE_RIGHT : BB_EYE_LEFT;
	int64_t ten = 0, ninety = 0;
	for (int64_t t = 0; t < 8000; t += 10) { /* within the last period, in 10 us */
		const double o = sim_shutter_transmission(b->sh, 0, opening, e.at_ns + t * US);
		const double c = sim_shutter_transmission(b->sh, 0, closing, e.at_ns + t * US);
		ten = !ten && o >= 0.1 ? t : ten;
		ninety = !ninety && o >= 0.9 ? t : ninety;
		assert_true(o >= 0 && o <= 1 && c >= 0 && c <= 1);
		least = fmin(least, c);
	}
	assert_true(llabs(ninety - ten - 1800) <= 20);
	assert_true(least < 1e-6);
	assert_true(sim_shutter_transmission(b->sh, 0, closing, e.at_ns + 300 * US) < 0.12); /* closing is fast */
	assert_true(sim_shutter_transmission(b->sh, 9, BB_EYE_LEFT, e.at_ns) == 0);
	/* Half duty: dark again in the second half. */
	assert_int_equal(bb_shutter_set_phase(b->sh, 0, 0, 500000), BB_OK);
	collect(b, 100 * MS);
	const struct bb_shutter_edge h = b->edge[0][b->n[0] - 1];
	assert_true(sim_shutter_transmission(b->sh, 0, (enum bb_eye)h.eye, h.at_ns + 4 * MS) > 0.9);
	assert_true(sim_shutter_transmission(b->sh, 0, (enum bb_eye)h.eye, h.at_ns + 6 * MS) < 0.01);
}

static bool opened(struct bench *b, int stage)
{
	const int64_t at_ns = bb_clock_now_ns(b->rig.clk) + 20 * MS;
	const uint8_t s = stage == STAGES - 1 ? BB_STAGE_EMITTER : (uint8_t)stage;

	return sim_shutter_transmission(b->sh, s, BB_EYE_LEFT, at_ns) > 0.99 &&
	       sim_shutter_transmission(b->sh, s, BB_EYE_RIGHT, at_ns) > 0.99;
}

static void missed_edges_are_gaps(void **state)
{
	struct bench *b = *state;

	stereo(b);
	collect(b, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "miss n=3", true);
	rig_fault(&b->rig, "shutter/chain", "miss stage=left n=2", true);
	collect(b, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++) {
		uint32_t lost = 0;
		for (size_t i = 1; i < b->n[s]; i++) {
			lost += b->edge[s][i].seq - b->edge[s][i - 1].seq - 1;
			assert_int_equal((b->edge[s][i].seq + b->edge[s][i].eye) % 2,
			                 (b->edge[s][0].seq + b->edge[s][0].eye) % 2);
		}
		lost += b->n[s] < 115; /* the gap may lie before the first edge collected */
		assert_true(lost <= (s == 1 ? 5 : 3));
		assert_true(b->n[s] <= (s == 1 ? 116u : 118u) && b->n[s] >= (s == 1 ? 114u : 116u));
	}
}

static void double_edges_repeat_a_number(void **state)
{
	struct bench *b = *state;
	int repeated = 0;

	stereo(b);
	collect(b, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "double stage=front n=4", true);
	collect(b, BB_NS_PER_S);
	for (size_t i = 1; i < b->n[0]; i++) {
		const struct bb_shutter_edge *p = &b->edge[0][i - 1], *q = &b->edge[0][i];
		if (q->seq != p->seq)
			continue;
		repeated++;
		assert_true(q->eye != p->eye);
		assert_true(llabs(q->at_ns - p->at_ns - period(b) / 4) <= wander(b));
	}
	assert_int_equal(repeated, 4);
	assert_true(b->n[0] >= 123 && b->n[1] <= 121);
}

/* +1: the eyes of a stage are those of the generator; -1: swapped. */
static int polarity(const struct bench *b, int stage)
{
	const struct bb_shutter_edge *e = &b->edge[stage][b->n[stage] - 1];

	return (e->eye == BB_EYE_LEFT) == (e->seq % 2 == 0) ? 1 : -1;
}

static void a_polarity_flip_swaps_the_glasses_against_the_walls(void **state)
{
	struct bench *b = *state;

	stereo(b);
	collect(b, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(polarity(b, s), 1);
	rig_fault(&b->rig, "shutter/chain", "flip_polarity", true);
	collect(b, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(polarity(b, s), s == STAGES - 1 ? -1 : 1);
	rig_fault(&b->rig, "shutter/chain", "flip_polarity stage=left", true);
	rig_fault(&b->rig, "shutter/chain", "flip_polarity", false);
	collect(b, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(polarity(b, s), s == 1 ? -1 : 1);
}

static void a_stuck_line_stops_and_fails_open(void **state)
{
	struct bench *b = *state;

	stereo(b);
	collect(b, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "stuck stage=left", true);
	collect(b, 50 * MS);
	assert_false(opened(b, 1));
	collect(b, 100 * MS);
	assert_int_equal(b->n[1], 0);
	assert_true(b->n[0] >= 11);
	assert_true(opened(b, 1));
	assert_false(opened(b, 0));
	rig_fault(&b->rig, "shutter/chain", "stuck stage=left", false);
	collect(b, 100 * MS);
	assert_true(b->n[1] >= 11);
	assert_int_equal(polarity(b, 1), 1);
}

static void an_offset_moves_one_stage_and_comes_off(void **state)
{
	struct bench *b = *state;
	double before[STAGES], after[STAGES];

	stereo(b);
	collect(b, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++)
		before[s] = lag_ns(b, s);
	rig_fault(&b->rig, "shutter/chain", "stage_offset stage=right us=900", true);
	collect(b, 20 * MS);
	collect(b, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++)
		assert_true(fabs(lag_ns(b, s) - before[s] - (s == 2 ? 900e3 : 0)) < 3e3);
	rig_fault(&b->rig, "shutter/chain", "stage_offset stage=right us=900", false);
	collect(b, 20 * MS);
	collect(b, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++) {
		after[s] = lag_ns(b, s);
		assert_true(fabs(after[s] - before[s]) < 3e3);
	}
}

static void jitter_and_rate_faults_show(void **state)
{
	struct bench *b = *state;
	double square = 0;

	stereo(b);
	rig_fault(&b->rig, "shutter/chain", "jitter_burst us=100", true);
	collect(b, 5 * BB_NS_PER_S);
	for (size_t i = 1; i < b->n[0]; i++) {
		const double d = (double)(b->edge[0][i].at_ns - b->edge[0][i - 1].at_ns - period(b));
		square += d * d / (double)(b->n[0] - 1);
	}
	assert_true(sqrt(square / 2) > 85e3 && sqrt(square / 2) < 120e3);
	rig_fault(&b->rig, "shutter/chain", "jitter_burst us=100", false);
	rig_fault(&b->rig, "shutter/chain", "rate hz=100", true);
	collect(b, BB_NS_PER_S);
	assert_true(b->n[0] >= 99 && b->n[0] <= 101);
	rig_fault(&b->rig, "shutter/chain", "rate hz=100", false);
	collect(b, BB_NS_PER_S);
	assert_true(b->n[0] >= 119 && b->n[0] <= 121);
}

static void unplugged_is_lost_and_open(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_edge e[4];
	size_t n;

	stereo(b);
	collect(b, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "unplug", true);
	assert_int_equal(bb_shutter_read(b->sh, e, 4, &n), BB_ERR_LOST);
	assert_int_equal(bb_shutter_set_phase(b->sh, 0, 0, 0), BB_ERR_LOST);
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_STEREO), BB_ERR_LOST);
	for (int s = 0; s < STAGES; s++)
		assert_true(opened(b, s));
	rig_fault(&b->rig, "shutter/chain", "unplug", false);
	collect(b, 100 * MS);
	assert_true(b->n[0] >= 11);
}

static void closing_opens_the_eyes(void **state)
{
	struct bench *b = *state;
	size_t opened_stages = 0;

	stereo(b);
	collect(b, 100 * MS);
	bb_shutter_close(b->sh);
	b->sh = NULL;
	bb_shutter_close(NULL);
	bb_eventlog_flush(b->rig.log);
	for (size_t i = b->rig.n_events - STAGES; i < b->rig.n_events; i++) {
		assert_int_equal(b->rig.event[i].kind, BB_EV_EDGE);
		opened_stages += b->rig.event[i].a == BB_EYE_NONE;
	}
	assert_int_equal(opened_stages, STAGES);
	const uint64_t steps = bb_clock_steps(b->rig.clk);
	rig_run(&b->rig, BB_NS_PER_S);
	assert_int_equal(bb_clock_steps(b->rig.clk), steps);
}

static void nobody_reading_loses_the_oldest(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_edge e[1];
	size_t n;

	stereo(b);
	rig_run(&b->rig, 5 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_read(b->sh, e, 1, &n), BB_OK);
	assert_true(e[0].at_ns > 3 * BB_NS_PER_S);
	assert_true(sim_shutter_dropped(b->sh) > 1800);
}

static void nonsense_is_refused(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_config c = b->rig.fix.room.chain;
	struct bb_open open = rig_open(&b->rig);
	struct bb_shutter *sh;

	c.rate = (struct bb_rate){ 500, 1 };
	assert_int_equal(bb_shutter_open(backend->driver, &c, &open, &sh), BB_ERR_RANGE);
	c = b->rig.fix.room.chain;
	c.n_stages = 33;
	assert_int_equal(bb_shutter_open(backend->driver, &c, &open, &sh), BB_ERR_CONFIG);
	c = b->rig.fix.room.chain;
	c.open_us = (double)NAN;
	assert_int_equal(bb_shutter_open(backend->driver, &c, &open, &sh), BB_ERR_RANGE);
	rig_option(&b->rig, "jitter_us", "inf");
	assert_int_equal(bb_shutter_open(backend->driver, &b->rig.fix.room.chain, &open, &sh), BB_ERR_CONFIG);
	assert_null(sh);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(limits_hold_the_configuration), T(edges_alternate_eyes_at_the_rate),
		T(set_phase_moves_one_stage_by_what_was_asked), T(phase_arguments_are_checked),
		T(open_mode_stops_the_edges), T(reading_in_small_pieces_loses_nothing),
	};
	const struct CMUnitTest of_the_world[] = {
		T(compensated_stages_are_in_phase_with_the_glasses), T(raw_stages_follow_down_the_chain),
		T(the_rate_error_is_the_generators), T(transitions_follow_the_edges), T(missed_edges_are_gaps),
		T(double_edges_repeat_a_number), T(a_polarity_flip_swaps_the_glasses_against_the_walls),
		T(a_stuck_line_stops_and_fails_open), T(an_offset_moves_one_stage_and_comes_off),
		T(jitter_and_rate_faults_show), T(unplugged_is_lost_and_open), T(closing_opens_the_eyes),
		T(nobody_reading_loses_the_oldest), T(nonsense_is_refused),
	};
	int failed = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		backend = &backends[i];
		failed += cmocka_run_group_tests_name(backend->name, tests, NULL, NULL);
		if (backend->driver)
			failed += cmocka_run_group_tests_name(backend->name, of_the_world, NULL, NULL);
	}
	return failed;
}
