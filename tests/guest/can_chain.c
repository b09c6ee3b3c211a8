/*
 * tests/guest/can_chain.c: can_chain URI STAGES SECONDS [ALARM]...: a chain of shutter controllers through the shipped
 * driver, opened as a room would, and a second socket beside it that stamps what is on the wire. Prints what came as
 * one line of JSON: the kernel's stamp of a phase PDO against SYNC (pdo_type=1) or against the switch it tells of
 * (254), and how old an edge is when its user, who looks every millisecond, has it. Then waits for each ALARM, by its name in
 * drivers/shutter_can.h, to be raised and over; "any": until something is wrong and all is well again. Exit 0: every
 * edge came, with its eye, and no alarm that was not named.
 */
#include "tests/guest/measure.h"

#include "drivers/bus_can.h"
#include "drivers/canopen_codec.h"
#include "drivers/shutter_can.h"

#define SAMPLES_MOST 100000
#define MS INT64_C(1000000)
#define ALARM_MOST_NS (10 * BB_NS_PER_S)

static int64_t to_pdo_ns[SAMPLES_MOST], to_user_ns[SAMPLES_MOST];

struct watch {
	struct bb_clock *clk;
	struct bb_shutter *sh;
	struct bb_can_bus *wire;
	int n_stages;
	bool measuring, synchronous;
	/* the wire */
	int64_t sync_ns, edge_ns[256]; /* by SYNC's counter: the generator's edge; 0 until the follow-up tells */
	struct {
		uint8_t counter;
		int64_t since_ns;      /* less the edge */
	} pending[BB_STAGES_MAX + 1];
	size_t n_pending, n_pdo;
	uint64_t frames, syncs, untold;
	/* the user */
	size_t n_user;
	uint64_t lost, wrong_eyes, edges;
	int64_t worst_read_ns;
	struct bb_shutter_edge last[BB_STAGES_MAX + 1];
	bool any[BB_STAGES_MAX + 1];
};

static void say(void *ctx, enum bb_log_level level, const char *line)
{
	(void)ctx;
	(void)level;
	printf("%s\n", line);
}

static void take_phase(struct watch *w, const struct bb_can_frame *f)
{
	struct bb_co_phase p;

	if (bb_co_read_phase(f, &p) != BB_OK)
		return; /* the driver has an alarm for that */
	if (!w->measuring || w->n_pdo == SAMPLES_MOST)
		return;
	if (w->synchronous)
		to_pdo_ns[w->n_pdo++] = f->at_ns - w->sync_ns;
	else if (w->edge_ns[p.counter])
		to_pdo_ns[w->n_pdo++] = f->at_ns - w->edge_ns[p.counter] - p.phase_ns;
	else if (w->n_pending < BB_ARRAY_LEN(w->pending)) {
		w->pending[w->n_pending].counter = p.counter;
		w->pending[w->n_pending++].since_ns = f->at_ns - p.phase_ns;
	}
}

/* What the emitter's frame took tells when the edge was; phases of low ids may have come before it. */
static void take_follow(struct watch *w, const struct bb_can_frame *f)
{
	struct bb_co_follow p;

	if (bb_co_read_follow(f, &p) != BB_OK)
		return;
	w->edge_ns[p.counter] = w->sync_ns - p.latency_ns;
	for (; w->n_pending; w->n_pending--)
		if (w->pending[w->n_pending - 1].counter == p.counter && w->n_pdo < SAMPLES_MOST)
			to_pdo_ns[w->n_pdo++] = w->pending[w->n_pending - 1].since_ns - w->edge_ns[p.counter];
		else
			w->untold++;
}

static void take_frame(struct watch *w, const struct bb_can_frame *f)
{
	uint8_t node, counter = 0;

	w->frames++;
	switch (bb_co_kind(f, &node)) {
	case BB_CO_SYNC:
		if (bb_co_read_sync(f, &counter) == BB_OK) {
			w->sync_ns = f->at_ns;
			w->edge_ns[counter] = 0;
			w->syncs += w->measuring;
		}
		break;
	case BB_CO_TPDO2:
		take_follow(w, f);
		break;
	case BB_CO_TPDO1:
		take_phase(w, f);
		break;
	default:
		break;
	}
}

static void take_edge(struct watch *w, const struct bb_shutter_edge *e, int64_t now_ns)
{
	const int row = e->stage == BB_STAGE_EMITTER ? w->n_stages : e->stage;

	NEED(row <= w->n_stages);
	w->edges += w->measuring;
	if (w->measuring && w->any[row]) {
		w->lost += e->seq - w->last[row].seq - 1;
		w->wrong_eyes += (e->seq + e->eye) % 2 != (w->last[row].seq + w->last[row].eye) % 2 || e->eye == BB_EYE_NONE;
	}
	if (w->measuring && w->n_user < SAMPLES_MOST)
		to_user_ns[w->n_user++] = now_ns - e->at_ns;
	w->last[row] = *e;
	w->any[row] = w->measuring;
}

static void pass(struct watch *w, int64_t for_ns)
{
	const int64_t end_ns = bb_clock_now_ns(w->clk) + for_ns;
	struct bb_shutter_edge e[64];
	struct bb_can_frame f;
	size_t n;

	while (bb_clock_now_ns(w->clk) < end_ns) {
		bb_clock_run_until(w->clk, bb_clock_now_ns(w->clk) + MS);
		const int64_t begun_ns = bb_clock_now_ns(w->clk);
		while (bb_shutter_read(w->sh, e, BB_ARRAY_LEN(e), &n) == BB_OK)
			for (size_t i = 0; i < n; i++)
				take_edge(w, &e[i], bb_clock_now_ns(w->clk));
		const int64_t took_ns = bb_clock_now_ns(w->clk) - begun_ns;
		w->worst_read_ns = took_ns > w->worst_read_ns ? took_ns : w->worst_read_ns;
		while (w->wire->ops->receive(w->wire, &f) == BB_OK)
			take_frame(w, &f);
	}
}

static bool ready(const struct watch *w)
{
	return bb_shutter_can_status(w->sh).health == BB_HEALTH_OK;
}

static struct bb_shutter_can_alarm named(const struct watch *w, const char *name)
{
	for (int i = 0; i < BB_CANF_COUNT; i++)
		if (!strcmp(bb_shutter_can_alarm(w->sh, (enum bb_shutter_can_fault)i).name, name))
			return bb_shutter_can_alarm(w->sh, (enum bb_shutter_can_fault)i);
	printf("no alarm is called %s\n", name);
	exit(1);
}

/* Whatever it was, it is over: all is well for two seconds. */
static bool await_any(struct watch *w)
{
	const int64_t from_ns = bb_clock_now_ns(w->clk);
	int64_t well_ns = BB_NEVER;
	bool wrong = false;

	while (!wrong || well_ns == BB_NEVER || bb_clock_now_ns(w->clk) - well_ns < 2 * BB_NS_PER_S) {
		if (bb_clock_now_ns(w->clk) - from_ns > 3 * ALARM_MOST_NS) {
			printf("%s: %s\n", wrong ? "not well again" : "nothing went wrong",
			       bb_shutter_device(w->sh)->last_error.detail);
			return false;
		}
		pass(w, 5 * MS);
		wrong |= !ready(w);
		well_ns = !ready(w) ? BB_NEVER : well_ns == BB_NEVER ? bb_clock_now_ns(w->clk) : well_ns;
	}
	printf("well again %.3f s after the measurement\n", (double)(well_ns - from_ns) * 1e-9);
	return true;
}

/* Until it was raised once more than before and is over, and all is well; prints how long it stood. */
static bool await(struct watch *w, const char *name)
{
	const int64_t from_ns = bb_clock_now_ns(w->clk);
	const uint64_t before = named(w, name).count;
	struct bb_shutter_can_alarm a;

	do {
		if (bb_clock_now_ns(w->clk) - from_ns > ALARM_MOST_NS) {
			printf("%s: %s, %s\n", name, named(w, name).count > before ? "raised, not over" : "not raised",
			       bb_shutter_device(w->sh)->last_error.detail);
			return false;
		}
		pass(w, 5 * MS);
		a = named(w, name);
	} while (a.count == before || a.active || !ready(w));
	printf("alarm %-10s raised at %9.3f ms, over %9.3f ms later\n", name, (double)(a.raised_ns - from_ns) * 1e-6,
	       (double)(a.cleared_ns - a.raised_ns) * 1e-6);
	return true;
}

static bool no_other_alarm(const struct watch *w, int n, char **names)
{
	bool good = true;

	for (int i = 0; i < BB_CANF_COUNT; i++) {
		const struct bb_shutter_can_alarm a = bb_shutter_can_alarm(w->sh, (enum bb_shutter_can_fault)i);
		int k = 0;
		while (k < n && strcmp(names[k], a.name) && strcmp(names[k], "any"))
			k++;
		if (a.count && k == n) {
			printf("alarm %s, %llu times, which nobody asked for\n", a.name, (unsigned long long)a.count);
			good = false;
		}
	}
	return good;
}

static void print(const struct watch *w, bool good)
{
	printf("{\"program\": \"can_chain\", \"stages\": %d, \"syncs\": %llu, \"edges\": %llu, \"lost\": %llu, "
	       "\"wrong_eyes\": %llu, \"phases\": %zu, \"worst_read_us\": %.1f",
	       w->n_stages, (unsigned long long)w->syncs, (unsigned long long)w->edges, (unsigned long long)w->lost,
	       (unsigned long long)w->wrong_eyes, w->n_pdo, (double)w->worst_read_ns * 1e-3);
	print_latency(w->synchronous ? "sync_to_pdo" : "switch_to_pdo", to_pdo_ns, w->n_pdo);
	print_latency("edge_to_user", to_user_ns, w->n_user);
	printf(", \"pass\": %s}\n", good ? "true" : "false");
}

int main(int argc, char **argv)
{
	static struct watch w;
	const struct bb_log log = { say, NULL, BB_LOG_WARN };
	struct bb_shutter_config config = { .id = "chain", .rate = { 120, 1 }, .stage_delay_us = 35,
		                            .cell = { 1800, 300, 500, 30 }, .emitter_offset_us = 3000 };
	struct bb_error err = { 0 };
	struct bb_uri uri;

	NEED(argc >= 4 && bb_uri_parse(argv[1], &uri, NULL, &err) == BB_OK);
	w.n_stages = atoi(argv[2]);
	const double seconds = atof(argv[3]);
	NEED(w.n_stages > 0 && w.n_stages <= BB_STAGES_MAX && seconds > 0 && seconds <= 60);
	config.n_stages = w.n_stages;
	for (int i = 0; i < w.n_stages; i++)
		snprintf(config.stage[i], sizeof(config.stage[i]), "stage%d", i + 1);
	for (size_t i = 0; i < uri.n_options; i++)
		w.synchronous |= !strcmp(uri.option[i].key, "pdo_type") && atoi(uri.option[i].value) <= 240;
	NEED(bb_clock_posix_create(&w.clk) == BB_OK);
	NEED(bb_can_bus_open(uri.path, w.clk, &w.wire, &err) == BB_OK);
	const struct bb_open open = { .clk = w.clk, .uri = &uri, .log = &log, .seed = 1 };
	NEED(bb_shutter_open(&bb_shutter_can_driver, &config, &open, &w.sh) == BB_OK);
	for (int i = 0; !ready(&w) && i < 500; i++)
		pass(&w, 10 * MS);
	NEED(ready(&w));
	for (int i = 0; i < w.n_stages; i++) /* with the glasses, as a room does, and far from SYNC */
		NEED(bb_shutter_set_phase(w.sh, (uint8_t)i, 3 * MS, 1000000) == BB_OK);
	NEED(bb_shutter_set_mode(w.sh, BB_SHUTTER_STEREO) == BB_OK);
	pass(&w, 200 * MS);
	w.measuring = true;
	w.worst_read_ns = 0;
	pass(&w, (int64_t)(seconds * 1e9));
	w.measuring = false;
	const uint64_t rows = (uint64_t)w.n_stages + 1, least = rows * (uint64_t)(seconds * 120 - 3);
	bool good = w.edges >= least && w.n_pdo >= least && !w.lost && !w.wrong_eyes && w.untold <= rows &&
	            w.worst_read_ns < bb_rate_period_ns(config.rate);
	for (int i = 4; i < argc && good; i++)
		good = strcmp(argv[i], "any") ? await(&w, argv[i]) : await_any(&w);
	good = no_other_alarm(&w, argc - 4, argv + 4) && good;
	print(&w, good);
	bb_shutter_close(w.sh);
	w.wire->ops->close(w.wire);
	bb_clock_destroy(w.clk);
	return good ? 0 : 1;
}
