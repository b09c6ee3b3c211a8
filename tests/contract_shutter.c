/*
 * tests/contract_shutter.c: the shutter contract (tests/shutter_contract.h) over every back end, tolerances from its
 * limits; the class's script on its rungs, as a table; then what only the simulated chain can be told. Rows of a kernel
 * run with BB_KERNEL=1, in the guest of tests/guest/, which has a chip of sim/kmod/ and an interface vcan0 for them.
 */
#include "tests/fixture_room.h"
#include "drivers/shutter_gpio.h"
#include "sim/bus_sim_line.h"
#include "sim/sim_shutter.h"
#include "tests/fixture_can.h"
#include "tests/shutter_contract.h"

#define STAGES 4 /* rows of the fixture's chain: front, left, right, glasses */
#define GPIO_WORLD "/dev/bb-gpio"

struct bench {
	struct shutter_bench t;
	struct rig rig;
	void *peer; /* the far end of the wire, where a row has one */
	struct bb_timer unstick; /* ends a silence of the chain */
};

static const struct backend {
	const char *name;
	int fidelity;
	enum bb_status (*open)(struct bench *b, const struct bb_open *open);
	void (*close)(struct bench *b); /* of what open made besides the handle; NULL: nothing */
	void (*silence)(struct shutter_bench *t, uint32_t edges);
	enum bb_eye (*truth)(struct shutter_bench *t, int64_t *at_ns);
	const struct bb_shutter_driver *driver; /* NULL: not of the simulated world */
	bool numbered;
	const char *kernel;   /* NULL: in process; else what the URI says besides */
	const char *line_rung, *chain_rung; /* in the tables of the glasses' edges, of all stages'; NULL: not there */
} *backend;

static struct bench *bench_of(struct shutter_bench *t)
{
	return bb_container_of(t, struct bench, t);
}

static void world_says(struct shutter_bench *t, uint32_t edges)
{
	char text[48];

	snprintf(text, sizeof(text), "miss n=%u", edges);
	rig_fault(&bench_of(t)->rig, "shutter/chain", text, true);
}

static enum bb_eye light(struct shutter_bench *t, int64_t *at_ns)
{
	const int64_t now_ns = bb_clock_now_ns(t->clk);
	const bool left = sim_shutter_transmission(t->sh, BB_STAGE_EMITTER, BB_EYE_LEFT, now_ns) > 0.5;
	const bool right = sim_shutter_transmission(t->sh, BB_STAGE_EMITTER, BB_EYE_RIGHT, now_ns) > 0.5;

	(void)at_ns;
	return left == right ? BB_EYE_NONE : left ? BB_EYE_LEFT : BB_EYE_RIGHT;
}

static enum bb_status open_sim(struct bench *b, const struct bb_open *open)
{
	return bb_shutter_open(backend->driver, &b->rig.fix.room.chain, open, &b->t.sh);
}

/* ---- the GPIO driver ---- */

/* On a line whose far end is a generator with the chain's own errors. */
static enum bb_status open_gpio(struct bench *b, const struct bb_open *open)
{
	const struct bb_shutter_config *c = &b->rig.fix.room.chain;
	const struct sim_line_config wave = { .rate = c->rate, .rate_error_ppm = c->rate_error_ppm,
		                              .jitter_us = c->jitter_us, .numbered = backend->numbered,
		                              .seed = b->rig.seed };
	struct sim_line *line;
	struct bb_uri uri;
	struct bb_open with = *open;

	assert_int_equal(bb_uri_parse("gpio:/dev/gpiochip0?line=17&out=4", &uri, NULL, NULL), BB_OK);
	with.uri = &uri;
	assert_int_equal(sim_line_create(b->rig.clk, &wave, &line), BB_OK);
	b->peer = line;
	return bb_shutter_gpio_open_on(sim_line_opener(line), c, &with, &b->t.sh);
}

static void close_gpio(struct bench *b)
{
	assert_false(sim_line_is_open(b->peer));
	assert_false(sim_line_out(b->peer)); /* fail-safe: the glasses hear nothing */
	sim_line_destroy(b->peer);
}

static void line_misses(struct shutter_bench *t, uint32_t edges)
{
	sim_line_miss(bench_of(t)->peer, edges);
}

static enum bb_eye line_level(struct shutter_bench *t, int64_t *at_ns)
{
	(void)at_ns;
	return sim_line_level(bench_of(t)->peer) ? BB_EYE_LEFT : BB_EYE_RIGHT; /* high is the left eye */
}

/* On a line of a chip of the kernel, whose far end is a file. */
static void tell_gpio(const char *command)
{
	FILE *f = fopen(GPIO_WORLD, "w");

	assert_non_null(f);
	assert_true(fputs(command, f) >= 0);
	assert_int_equal(fclose(f), 0);
}

static enum bb_status open_gpio_kernel(struct bench *b, const struct bb_open *open)
{
	const struct bb_shutter_config *c = &b->rig.fix.room.chain;
	const double period_ns = 1e9 / bb_rate_hz(c->rate) * (1 - c->rate_error_ppm * 1e-6);
	struct bb_open with = *open;
	struct bb_uri uri;
	char text[96];

	snprintf(text, sizeof(text), "wave 3 %lld", llround(period_ns));
	tell_gpio(text);
	snprintf(text, sizeof(text), "gpio:/dev/gpiochip0?line=3&out=4%s", backend->kernel);
	assert_int_equal(bb_uri_parse(text, &uri, NULL, NULL), BB_OK);
	with.uri = &uri;
	return bb_shutter_open(&bb_shutter_gpio_driver, c, &with, &b->t.sh);
}

static bool chip_level(size_t line)
{
	char levels[16] = "";
	FILE *f = fopen(GPIO_WORLD, "r");

	assert_non_null(f);
	assert_non_null(fgets(levels, sizeof(levels), f));
	fclose(f);
	return levels[line] == '1';
}

static enum bb_eye chip_eye(struct shutter_bench *t, int64_t *at_ns)
{
	(void)t;
	(void)at_ns;
	return chip_level(3) ? BB_EYE_LEFT : BB_EYE_RIGHT;
}

static void close_gpio_kernel(struct bench *b)
{
	(void)b;
	assert_false(chip_level(4)); /* fail-safe: the glasses hear nothing */
	tell_gpio("stop");
}

static void chip_misses(struct shutter_bench *t, uint32_t edges)
{
	char text[48];

	(void)t;
	snprintf(text, sizeof(text), "miss 3 %u", edges);
	tell_gpio(text);
}

/* ---- the CAN driver with a chain of CANopen controllers at the far end ---- */

static enum bb_status open_can(struct bench *b, const struct bb_open *open)
{
	struct can_far *far = calloc(1, sizeof(*far));

	(void)open;
	assert_non_null(far);
	b->peer = far;
	b->t.sh = backend->kernel ? can_far_open_on(&b->rig, far, backend->kernel, CAN_NODE) : can_far_open(&b->rig, far);
	return BB_OK;
}

static void close_can(struct bench *b)
{
	bb_clock_disarm(b->rig.clk, &b->unstick);
	can_far_close(b->peer);
	free(b->peer);
}

static enum bb_eye chain_eye(struct shutter_bench *t, int64_t *at_ns)
{
	const struct can_far *far = bench_of(t)->peer;

	*at_ns = sim_chain_switched_ns(far->chain, 0);
	return sim_chain_eye(far->chain, 0);
}

static void stick(struct bench *b, bool on)
{
	const struct can_far *far = b->peer;

	for (size_t i = 0; i < sim_chain_positions(far->chain); i++)
		sim_chain_stuck(far->chain, i, on);
}

static int64_t unstick(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	(void)scheduled_ns;
	(void)now_ns;
	stick(bb_container_of(timer, struct bench, unstick), false);
	return BB_NEVER;
}

/* The line stops, and runs again in the middle between the last edge that must not come and the next. */
static void chain_sticks(struct shutter_bench *t, uint32_t edges)
{
	struct bench *b = bench_of(t);
	const int64_t now_ns = bb_clock_now_ns(t->clk);
	const int64_t next = sim_world_reference_after(b->rig.world, t->config->rate, now_ns) + (int64_t)edges;

	stick(b, true);
	b->unstick = (struct bb_timer){ .step = unstick };
	const int64_t end_ns = sim_world_sync_ns(b->rig.world, next) - shutter_period_ns(t) / 2;
	assert_int_equal(bb_clock_arm(t->clk, &b->unstick, end_ns), BB_OK);
}

#define SIM .open = open_sim, .silence = world_says, .truth = light, .driver = &sim_shutter_driver
#define LINE .open = open_gpio, .close = close_gpio, .silence = line_misses, .truth = line_level
#define CHIP .open = open_gpio_kernel, .close = close_gpio_kernel, .silence = chip_misses, .truth = chip_eye
#define CHAIN .open = open_can, .close = close_can, .silence = chain_sticks, .truth = chain_eye

static const struct backend backends[] = {
	{ .name = "shutter: sim, fidelity 0", .fidelity = 0, SIM, .line_rung = "sim", .chain_rung = "sim" },
	{ .name = "shutter: sim, fidelity 1", .fidelity = 1, SIM },
	{ .name = "shutter: sim, fidelity 2", .fidelity = 2, SIM },
	{ .name = "shutter: gpio driver, line without numbers", .fidelity = 1, LINE },
	{ .name = "shutter: gpio driver, numbered line", .fidelity = 1, LINE, .numbered = true,
	  .line_rung = "gpio driver + peer" },
	{ .name = "shutter: CAN driver and peer, ideal", .fidelity = 0, CHAIN, .line_rung = "CAN driver + peer",
	  .chain_rung = "CAN driver + peer" },
	{ .name = "shutter: CAN driver and peer", .fidelity = 1, CHAIN },
	{ .name = "shutter: gpio driver, a kernel's chip", .fidelity = 1, CHIP, .kernel = "",
	  .line_rung = "gpio driver + kernel" },
	{ .name = "shutter: gpio driver, a kernel's chip by libgpiod", .fidelity = 1, CHIP, .kernel = "&api=gpiod" },
	{ .name = "shutter: CAN driver, a kernel's bus", .fidelity = 1, CHAIN, .kernel = "vcan0",
	  .line_rung = "CAN driver + kernel", .chain_rung = "CAN driver + kernel" },
};

static bool runs_here(const struct backend *b)
{
	return !b->kernel || getenv("BB_KERNEL");
}

/* Simulated time costs nothing; a kernel's is waited for, and timers look every 2 ms besides. */
static struct bench *bench_open(int fidelity, double jitter_us)
{
	struct bench *b = calloc(1, sizeof(*b));

	assert_non_null(b);
	if (backend->kernel)
		assert_int_equal(bb_clock_posix_create(&b->rig.clk), BB_OK);
	fixture_room_init(&b->rig.fix);
	b->rig.fix.room.chain.jitter_us = jitter_us;
	rig_world(&b->rig, 1, fidelity);
	b->t.clk = b->rig.clk;
	b->t.config = &b->rig.fix.room.chain;
	b->t.scale = backend->kernel ? 0.2 : 1;
	b->t.gap_ns = backend->kernel ? 15 * MS : 0;
	b->t.silence = backend->silence;
	b->t.truth = backend->truth;
	const struct bb_open open = rig_open(&b->rig);
	assert_int_equal(backend->open(b, &open), BB_OK);
	return b;
}

static void bench_close(struct bench *b)
{
	bb_shutter_close(b->t.sh);
	if (backend->close)
		backend->close(b);
	rig_done(&b->rig);
	free(b);
}

static int setup(void **state)
{
	*state = bench_open(backend->fidelity, fixture_chain().jitter_us);
	return 0;
}

static int teardown(void **state)
{
	bench_close(*state);
	return 0;
}

#define SHARED(check)                                                                                                \
	static void test_##check(void **state)                                                                       \
	{                                                                                                            \
		shutter_##check(&((struct bench *)*state)->t);                                                       \
	}

SHARED(limits_hold)
SHARED(edges_alternate)
SHARED(truth_is_told)
SHARED(phase_moves)
SHARED(arguments_are_checked)
SHARED(open_stops)
SHARED(small_pieces_lose_nothing)

/* ---- the script on every rung ---- */

/* Without jitter, which is drawn anew for each rung. */
static int table(const char *name, bool chain)
{
	const struct fid_log *logs[BB_ARRAY_LEN(backends)];
	size_t n = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		backend = &backends[i];
		const char *rung = chain ? backend->chain_rung : backend->line_rung;
		if (!rung || !runs_here(backend))
			continue;
		struct fid_log *log = calloc(1, sizeof(*log));
		assert_non_null(log);
		log->rung = rung;
		struct bench *b = bench_open(0, 0);
		shutter_script(&b->t, log, chain);
		bench_close(b);
		logs[n++] = log;
	}
	const int apart = fid_table(name, logs, n);
	for (size_t i = 0; i < n; i++)
		free((void *)(uintptr_t)logs[i]);
	return apart;
}

static void rungs_agree(void **state)
{
	(void)state;
	const int lines = table("glasses", false), chains = table("shutter", true);
	assert_int_equal(lines, 0);
	assert_int_equal(chains, 0);
}

/* What follows needs the simulated world. */

static void compensated_stages_are_in_phase_with_the_glasses(void **state)
{
	struct bench *b = *state;

	for (uint8_t s = 0; s < 3; s++)
		assert_int_equal(bb_shutter_set_phase(b->t.sh, s, 3000000, 1000000), BB_OK);
	shutter_stereo(&b->t);
	shutter_collect(&b->t, 20 * MS);
	shutter_collect(&b->t, BB_NS_PER_S);
	for (int s = 0; s < 3; s++) {
		const double lag = shutter_lag_ns(&b->t, (size_t)s);
		assert_true(fabs(lag) <= (backend->fidelity ? 80e3 : 1)); /* two units, 2.5 sd of 15 us each */
		assert_true(!backend->fidelity || fabs(lag) > 1);         /* no unit is perfect */
	}
}

static void raw_stages_follow_down_the_chain(void **state)
{
	struct bench *b = *state;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 20 * MS);
	shutter_collect(&b->t, BB_NS_PER_S);
	for (int s = 0; s < 3; s++)
		assert_true(fabs(shutter_lag_ns(&b->t, (size_t)s) - ((s + 1) * 35e3 - 3000e3)) < 80e3);
}

static void the_rate_error_is_the_generators(void **state)
{
	struct bench *b = *state;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 10 * BB_NS_PER_S);
	const struct bb_shutter_edge *p = &b->t.edge[0][0], *q = &b->t.edge[0][b->t.n[0] - 1];
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
		assert_true(sim_shutter_transmission(b->t.sh, 0, BB_EYE_LEFT, bb_clock_now_ns(b->rig.clk)) > 0.999);
	}
	shutter_stereo(&b->t);
	shutter_collect(&b->t, 200 * MS);
	const struct bb_shutter_edge e = b->t.edge[0][b->t.n[0] - 1];
	const enum bb_eye opening = e.eye, closing = e.eye == BB_EYE_LEFT ? BB_EYE_RIGHT : BB_EYE_LEFT;
	int64_t ten = 0, ninety = 0;
	for (int64_t t = 0; t < 8000; t += 10) { /* within the last period, in 10 us */
		const double o = sim_shutter_transmission(b->t.sh, 0, opening, e.at_ns + t * US);
		const double c = sim_shutter_transmission(b->t.sh, 0, closing, e.at_ns + t * US);
		ten = !ten && o >= 0.1 ? t : ten;
		ninety = !ninety && o >= 0.9 ? t : ninety;
		assert_true(o >= 0 && o <= 1 && c >= 0 && c <= 1);
		least = fmin(least, c);
	}
	assert_true(llabs(ninety - ten - 1800) <= 20);
	assert_true(least < 1e-6);
	assert_true(sim_shutter_transmission(b->t.sh, 0, closing, e.at_ns + 300 * US) < 0.12); /* closing is fast */
	assert_true(sim_shutter_transmission(b->t.sh, 9, BB_EYE_LEFT, e.at_ns) == 0);
	/* Half duty: dark again in the second half. */
	assert_int_equal(bb_shutter_set_phase(b->t.sh, 0, 0, 500000), BB_OK);
	shutter_collect(&b->t, 100 * MS);
	const struct bb_shutter_edge h = b->t.edge[0][b->t.n[0] - 1];
	assert_true(sim_shutter_transmission(b->t.sh, 0, (enum bb_eye)h.eye, h.at_ns + 4 * MS) > 0.9);
	assert_true(sim_shutter_transmission(b->t.sh, 0, (enum bb_eye)h.eye, h.at_ns + 6 * MS) < 0.01);
}

static bool opened(struct bench *b, int stage)
{
	const int64_t at_ns = bb_clock_now_ns(b->rig.clk) + 20 * MS;
	const uint8_t s = stage == STAGES - 1 ? BB_STAGE_EMITTER : (uint8_t)stage;

	return sim_shutter_transmission(b->t.sh, s, BB_EYE_LEFT, at_ns) > 0.99 &&
	       sim_shutter_transmission(b->t.sh, s, BB_EYE_RIGHT, at_ns) > 0.99;
}

static void missed_edges_are_gaps(void **state)
{
	struct bench *b = *state;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "miss n=3", true);
	rig_fault(&b->rig, "shutter/chain", "miss stage=left n=2", true);
	shutter_collect(&b->t, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++) {
		uint32_t lost = 0;
		for (size_t i = 1; i < b->t.n[s]; i++) {
			lost += b->t.edge[s][i].seq - b->t.edge[s][i - 1].seq - 1;
			assert_int_equal((b->t.edge[s][i].seq + b->t.edge[s][i].eye) % 2,
			                 (b->t.edge[s][0].seq + b->t.edge[s][0].eye) % 2);
		}
		lost += b->t.n[s] < 115; /* the gap may lie before the first edge collected */
		assert_true(lost <= (s == 1 ? 5 : 3));
		assert_true(b->t.n[s] <= (s == 1 ? 116u : 118u) && b->t.n[s] >= (s == 1 ? 114u : 116u));
	}
}

static void double_edges_repeat_a_number(void **state)
{
	struct bench *b = *state;
	int repeated = 0;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "double stage=front n=4", true);
	shutter_collect(&b->t, BB_NS_PER_S);
	for (size_t i = 1; i < b->t.n[0]; i++) {
		const struct bb_shutter_edge *p = &b->t.edge[0][i - 1], *q = &b->t.edge[0][i];
		if (q->seq != p->seq)
			continue;
		repeated++;
		assert_true(q->eye != p->eye);
		assert_true(llabs(q->at_ns - p->at_ns - shutter_period_ns(&b->t) / 4) <= shutter_wander_ns(&b->t));
	}
	assert_int_equal(repeated, 4);
	assert_true(b->t.n[0] >= 123 && b->t.n[1] <= 121);
}

/* +1: the eyes of a stage are those of the generator; -1: swapped. */
static int polarity(const struct bench *b, int stage)
{
	const struct bb_shutter_edge *e = &b->t.edge[stage][b->t.n[stage] - 1];

	return (e->eye == BB_EYE_LEFT) == (e->seq % 2 == 0) ? 1 : -1;
}

static void a_polarity_flip_swaps_the_glasses_against_the_walls(void **state)
{
	struct bench *b = *state;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(polarity(b, s), 1);
	rig_fault(&b->rig, "shutter/chain", "flip_polarity", true);
	shutter_collect(&b->t, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(polarity(b, s), s == STAGES - 1 ? -1 : 1);
	rig_fault(&b->rig, "shutter/chain", "flip_polarity stage=left", true);
	rig_fault(&b->rig, "shutter/chain", "flip_polarity", false);
	shutter_collect(&b->t, 100 * MS);
	for (int s = 0; s < STAGES; s++)
		assert_int_equal(polarity(b, s), s == 1 ? -1 : 1);
}

static void a_stuck_line_stops_and_fails_open(void **state)
{
	struct bench *b = *state;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "stuck stage=left", true);
	shutter_collect(&b->t, 50 * MS);
	assert_false(opened(b, 1));
	shutter_collect(&b->t, 100 * MS);
	assert_int_equal(b->t.n[1], 0);
	assert_true(b->t.n[0] >= 11);
	assert_true(opened(b, 1));
	assert_false(opened(b, 0));
	rig_fault(&b->rig, "shutter/chain", "stuck stage=left", false);
	shutter_collect(&b->t, 100 * MS);
	assert_true(b->t.n[1] >= 11);
	assert_int_equal(polarity(b, 1), 1);
}

static void an_offset_moves_one_stage_and_comes_off(void **state)
{
	struct bench *b = *state;
	double before[STAGES], after[STAGES];

	shutter_stereo(&b->t);
	shutter_collect(&b->t, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++)
		before[s] = shutter_lag_ns(&b->t, (size_t)s);
	rig_fault(&b->rig, "shutter/chain", "stage_offset stage=right us=900", true);
	shutter_collect(&b->t, 20 * MS);
	shutter_collect(&b->t, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++)
		assert_true(fabs(shutter_lag_ns(&b->t, (size_t)s) - before[s] - (s == 2 ? 900e3 : 0)) < 3e3);
	rig_fault(&b->rig, "shutter/chain", "stage_offset stage=right us=900", false);
	shutter_collect(&b->t, 20 * MS);
	shutter_collect(&b->t, BB_NS_PER_S);
	for (int s = 0; s < STAGES; s++) {
		after[s] = shutter_lag_ns(&b->t, (size_t)s);
		assert_true(fabs(after[s] - before[s]) < 3e3);
	}
}

static void jitter_and_rate_faults_show(void **state)
{
	struct bench *b = *state;
	double square = 0;

	shutter_stereo(&b->t);
	rig_fault(&b->rig, "shutter/chain", "jitter_burst us=100", true);
	shutter_collect(&b->t, 5 * BB_NS_PER_S);
	for (size_t i = 1; i < b->t.n[0]; i++) {
		const double d = (double)(b->t.edge[0][i].at_ns - b->t.edge[0][i - 1].at_ns - shutter_period_ns(&b->t));
		square += d * d / (double)(b->t.n[0] - 1);
	}
	assert_true(sqrt(square / 2) > 85e3 && sqrt(square / 2) < 120e3);
	rig_fault(&b->rig, "shutter/chain", "jitter_burst us=100", false);
	rig_fault(&b->rig, "shutter/chain", "rate hz=100", true);
	shutter_collect(&b->t, BB_NS_PER_S);
	assert_true(b->t.n[0] >= 99 && b->t.n[0] <= 101);
	rig_fault(&b->rig, "shutter/chain", "rate hz=100", false);
	shutter_collect(&b->t, BB_NS_PER_S);
	assert_true(b->t.n[0] >= 119 && b->t.n[0] <= 121);
}

static void unplugged_is_lost_and_open(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_edge e[4];
	size_t n;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 100 * MS);
	rig_fault(&b->rig, "shutter/chain", "unplug", true);
	assert_int_equal(bb_shutter_read(b->t.sh, e, 4, &n), BB_ERR_LOST);
	assert_int_equal(bb_shutter_set_phase(b->t.sh, 0, 0, 0), BB_ERR_LOST);
	assert_int_equal(bb_shutter_set_mode(b->t.sh, BB_SHUTTER_STEREO), BB_ERR_LOST);
	for (int s = 0; s < STAGES; s++)
		assert_true(opened(b, s));
	rig_fault(&b->rig, "shutter/chain", "unplug", false);
	shutter_collect(&b->t, 100 * MS);
	assert_true(b->t.n[0] >= 11);
}

static void closing_opens_the_eyes(void **state)
{
	struct bench *b = *state;
	size_t opened_stages = 0;

	shutter_stereo(&b->t);
	shutter_collect(&b->t, 100 * MS);
	bb_shutter_close(b->t.sh);
	b->t.sh = NULL;
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

	shutter_stereo(&b->t);
	rig_run(&b->rig, 5 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_read(b->t.sh, e, 1, &n), BB_OK);
	assert_true(e[0].at_ns > 3 * BB_NS_PER_S);
	assert_true(sim_shutter_dropped(b->t.sh) > 1800);
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
	c.glasses.open_us = (double)NAN;
	assert_int_equal(bb_shutter_open(backend->driver, &c, &open, &sh), BB_ERR_RANGE);
	rig_option(&b->rig, "jitter_us", "inf");
	assert_int_equal(bb_shutter_open(backend->driver, &b->rig.fix.room.chain, &open, &sh), BB_ERR_CONFIG);
	assert_null(sh);
}

/* And what only a bus of a kernel can: all answer a question of fastscan at once, which comes through as one frame. */
static void new_controllers_get_ids_on_a_kernels_bus(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));
	struct can_far far;
	struct bb_shutter_can_node node;
	unsigned places = 0;

	(void)state;
	assert_non_null(b);
	assert_int_equal(bb_clock_posix_create(&b->rig.clk), BB_OK);
	fixture_room_init(&b->rig.fix);
	rig_world(&b->rig, 1, 1);
	struct bb_shutter *sh = can_far_open_on(&b->rig, &far, "vcan0", CO_NODE_NONE);
	for (size_t i = 0; i < STAGES; i++) {
		assert_true(bb_shutter_can_node(sh, i, &node) && node.ready && node.position >= 0 && node.position < STAGES);
		assert_int_equal(sim_chain_node(far.chain, (size_t)node.position)->stored_id, node.id);
		places |= 1u << node.position;
	}
	assert_int_equal(places, (1 << STAGES) - 1);
	print_message("%d new controllers found by fastscan and configured: %.0f ms\n", STAGES,
	              (double)bb_clock_now_ns(b->rig.clk) * 1e-6);
	bb_shutter_close(sh);
	can_far_close(&far);
	rig_done(&b->rig);
	free(b);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(test_limits_hold), T(test_edges_alternate), T(test_truth_is_told), T(test_phase_moves),
		T(test_arguments_are_checked),
		T(test_open_stops), T(test_small_pieces_lose_nothing),
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
		if (!runs_here(backend))
			continue;
		print_message("%s\n", backend->name);
		failed += cmocka_run_group_tests_name(backend->name, tests, NULL, NULL);
		if (backend->driver)
			failed += cmocka_run_group_tests_name(backend->name, of_the_world, NULL, NULL);
	}
	const struct CMUnitTest kernel[] = { cmocka_unit_test(new_controllers_get_ids_on_a_kernels_bus) };
	if (getenv("BB_KERNEL"))
		failed += cmocka_run_group_tests_name("shutter: kernel", kernel, NULL, NULL);
	const struct CMUnitTest fidelity[] = { cmocka_unit_test(rungs_agree) };
	return failed + cmocka_run_group_tests_name("shutter: rungs", fidelity, NULL, NULL);
}
