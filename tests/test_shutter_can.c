/*
 * tests/test_shutter_can.c: the CAN driver with a chain of simulated controllers: bring-up, new controllers without
 * ids, what it refuses, its edges against the truth and against the device-level sim, and SYNC to phase PDO in numbers.
 */
#include "drivers/bus_can.h"
#include "drivers/canopen_codec.h"
#include "tests/fixture_can.h"

static int compare(const void *a, const void *b)
{
	const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;

	return (x > y) - (x < y);
}

static double at_share(const int64_t *sorted, size_t n, double share)
{
	return (double)sorted[(size_t)(share * (double)(n - 1) + 0.5)] * 1e-3;
}

static void many_stages(struct rig *rig, int n)
{
	struct bb_shutter_config *c = &rig->fix.room.chain;

	c->n_stages = n;
	for (int i = 0; i < n; i++)
		snprintf(c->stage[i], sizeof(c->stage[i]), "wall-%02d", i);
}

static void bring_up_finds_and_labels_all(void **state)
{
	struct rig rig;
	struct can_far far;
	struct bb_shutter_can_node node;

	(void)state;
	for (int n = 1; n <= BB_STAGES_MAX; n += 31) {
		rig_init(&rig, 1, 1);
		many_stages(&rig, n);
		can_far_wire(&rig, &far, 1000000, CAN_NODE);
		struct bb_shutter *sh = can_far_driver(&rig, &far);
		const int64_t took_ns = can_far_bring_up(&rig, sh, BB_NS_PER_S);
		print_message("bring-up of %2d stages: %lld ms, %llu frames\n", n, (long long)(took_ns / MS),
		              (unsigned long long)sim_can_counters(far.can)->frames);
		for (int i = 0; i <= n; i++) {
			assert_true(bb_shutter_can_node(sh, (size_t)i, &node));
			assert_true(node.ready && node.position == i && node.id == CAN_NODE + i);
			assert_int_equal(node.serial, sim_chain_node(far.chain, (size_t)i)->identity[3]);
			assert_string_equal(node.name, i ? "shutter stage, 10 MHz" : "shutter emitter, 10 MHz");
			assert_string_equal(sim_chain_label(far.chain, (size_t)i),
			                    i ? rig.fix.room.chain.stage[i - 1] : "");
		}
		assert_false(bb_shutter_can_node(sh, (size_t)n + 1, &node));
		assert_int_equal(bb_shutter_can_alarm(sh, BB_CANF_NODE).count, 0);
		bb_shutter_close(sh);
		can_far_close(&far);
		rig_done(&rig);
	}
}

static void new_controllers_get_ids_by_fastscan(void **state)
{
	struct rig rig;
	struct can_far far;
	struct bb_shutter_can_node node;
	bool seen[4] = { false };

	(void)state;
	rig_init(&rig, 1, 1);
	can_far_wire(&rig, &far, 500000, CO_NODE_NONE);
	rig_option(&rig, "lss_ms", "3");
	struct bb_shutter *sh = can_far_driver(&rig, &far);
	const int64_t took_ns = can_far_bring_up(&rig, sh, 10 * BB_NS_PER_S);
	print_message("4 new controllers found by fastscan and configured: %lld ms\n", (long long)(took_ns / MS));
	for (size_t i = 0; i < 4; i++) { /* ids in order of serials, places by the line */
		assert_true(bb_shutter_can_node(sh, i, &node) && node.ready);
		assert_true(node.position >= 0 && node.position < 4 && !seen[node.position]);
		seen[node.position] = true;
		assert_int_equal(sim_chain_node(far.chain, (size_t)node.position)->stored_id, node.id);
	}
	assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	rig_run(&rig, 50 * MS);
	for (size_t i = 0; i < 4; i++)
		assert_false(sim_chain_is_open(far.chain, i));
	/* Without lss they stay unknown. */
	bb_shutter_close(sh);
	can_far_close(&far);
	rig_done(&rig);
	rig_init(&rig, 1, 1);
	can_far_wire(&rig, &far, 500000, CO_NODE_NONE);
	rig_option(&rig, "lss", "false");
	sh = can_far_driver(&rig, &far);
	rig_run(&rig, 5 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_can_status(sh).health, BB_HEALTH_LOST);
	assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_ERR_LOST);
	bb_shutter_close(sh);
	can_far_close(&far);
	rig_done(&rig);
}

/* What is asked for during bring-up is done at its end; every edge is where the controller really switched. */
static void edges_are_where_the_stages_switched(void **state)
{
	struct rig rig;
	struct can_far far;
	struct bb_shutter_edge e[64];
	int64_t worst_ns = 0;
	int compared = 0;
	size_t n;

	(void)state;
	rig_init(&rig, 7, 1);
	can_far_wire(&rig, &far, 1000000, CAN_NODE);
	struct bb_shutter *sh = can_far_driver(&rig, &far);
	assert_int_equal(bb_shutter_set_phase(sh, 2, 2500000, 900000), BB_OK);
	assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	for (int t = 0; t < 4000; t++) {
		rig_run(&rig, MS);
		while (bb_shutter_read(sh, e, BB_ARRAY_LEN(e), &n) == BB_OK)
			for (size_t i = 0; i < n; i++) {
				const size_t at = e[i].stage == BB_STAGE_EMITTER ? 0 : e[i].stage + 1u;
				const int64_t off_ns = e[i].at_ns - sim_chain_switched_ns(far.chain, at);
				if (llabs(off_ns) > 4 * MS)
					continue; /* it has switched again since */
				compared++;
				if (llabs(off_ns) > worst_ns)
					worst_ns = llabs(off_ns);
			}
	}
	print_message("edges against the truth: %d compared, %lld ns off at most\n", compared, (long long)worst_ns);
	assert_true(compared > 1500);
	assert_true(worst_ns <= bb_shutter_limits(sh)->stamp_error_ns);
	bb_shutter_close(sh);
	rig_run(&rig, 10 * MS);
	for (size_t i = 0; i < 4; i++)
		assert_true(sim_chain_is_open(far.chain, i)); /* close() opens */
	can_far_close(&far);
	rig_done(&rig);
}

/* A host that dies says nothing: the controllers open when its heartbeat is missing. */
static void a_dead_host_opens_the_eyes(void **state)
{
	struct rig rig;
	struct can_far far;

	(void)state;
	rig_init(&rig, 7, 1);
	struct bb_shutter *sh = can_far_open(&rig, &far);
	assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	rig_run(&rig, 100 * MS);
	assert_false(sim_chain_is_open(far.chain, 1));
	sim_can_mute(sim_can_host(far.can), true);
	rig_run(&rig, 400 * MS);
	assert_false(sim_chain_is_open(far.chain, 1)); /* held a while */
	rig_run(&rig, 200 * MS);
	for (size_t i = 0; i < 4; i++)
		assert_true(sim_chain_is_open(far.chain, i));
	sim_can_mute(sim_can_host(far.can), false);
	rig_run(&rig, 1500 * MS);
	assert_int_equal(bb_shutter_can_status(sh).health, BB_HEALTH_OK);
	assert_false(sim_chain_is_open(far.chain, 1));
	bb_shutter_close(sh);
	can_far_close(&far);
	rig_done(&rig);
}

/* The device-level sim and driver + peer, same seed: the same generator, the same units. */

struct record {
	struct bb_shutter_edge edge[4000];
	size_t n;
};

static void record(struct rig *rig, struct bb_shutter *sh, int64_t end_ns, struct record *r)
{
	size_t n;

	assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	while (bb_clock_now_ns(rig->clk) < end_ns) {
		rig_run(rig, 10 * MS);
		while (bb_shutter_read(sh, &r->edge[r->n], 64, &n) == BB_OK) {
			r->n += n;
			assert_true(r->n + 64 <= BB_ARRAY_LEN(r->edge));
		}
	}
}

static void the_sim_and_the_wire_agree(void **state)
{
	struct record *a = calloc(1, sizeof(*a)), *b = calloc(1, sizeof(*b));
	struct rig rig;
	struct can_far far;
	int64_t worst_ns[4] = { 0 };
	int pairs[4] = { 0 }, eyes = 0;

	(void)state;
	assert_true(a && b);
	rig_init(&rig, 11, 1);
	struct bb_shutter *sh = rig_shutter(&rig);
	rig_run(&rig, 500 * MS);
	record(&rig, sh, 4 * BB_NS_PER_S, a);
	bb_shutter_close(sh);
	rig_done(&rig);
	rig_init(&rig, 11, 1);
	sh = can_far_open(&rig, &far);
	const int64_t allowed_ns = bb_shutter_limits(sh)->stamp_error_ns + 1000; /* the sim's own */
	rig_run(&rig, 500 * MS - bb_clock_now_ns(rig.clk));
	record(&rig, sh, 4 * BB_NS_PER_S, b);
	bb_shutter_close(sh);
	can_far_close(&far);
	rig_done(&rig);
	for (size_t i = 0; i < a->n; i++)
		for (size_t k = 0; k < b->n; k++) {
			const int64_t off_ns = b->edge[k].at_ns - a->edge[i].at_ns;
			const int row = a->edge[i].stage == BB_STAGE_EMITTER ? 3 : a->edge[i].stage;
			if (a->edge[i].stage != b->edge[k].stage || llabs(off_ns) > 2 * MS)
				continue;
			pairs[row]++;
			eyes += a->edge[i].eye != b->edge[k].eye;
			assert_int_equal(a->edge[i].seq % 240, b->edge[k].seq % 240);
			worst_ns[row] = llabs(off_ns) > worst_ns[row] ? llabs(off_ns) : worst_ns[row];
		}
	print_message("shutter: sim against driver + peer, 3.5 s\n  stage    edges sim  edges wire  worst ns  allowed\n");
	for (int s = 0; s < 4; s++) {
		static const char *const names[] = { "front", "left", "right", "glasses" };
		print_message("  %-8s %9d  %10d  %8lld  %7lld\n", names[s], pairs[s], pairs[s], (long long)worst_ns[s],
		              (long long)allowed_ns);
		assert_true(pairs[s] >= 415);
		assert_true(worst_ns[s] <= allowed_ns);
	}
	assert_int_equal(eyes, 0);
	assert_true(llabs((int64_t)a->n - (int64_t)b->n) <= 8);
	free(a);
	free(b);
}

/* SYNC to phase PDO, on the wire: a tap stamps both. */

#define SAMPLES 200000
struct tap {
	struct sim_can_port port;
	struct sim_chain *chain;
	int64_t sync_ns, begin_ns;
	bool synchronous;
	int64_t sample[SAMPLES];
	size_t n;
};

static void on_frame(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns)
{
	struct tap *t = bb_container_of(port, struct tap, port);
	uint8_t node;

	if (f->id == CO_SYNC)
		t->sync_ns = at_ns;
	if (bb_co_kind(f, &node) != BB_CO_TPDO1 || !t->sync_ns || at_ns < t->begin_ns || t->n == SAMPLES)
		return;
	/* An event PDO goes when the stage has switched: what the bus adds is the time since. */
	const int64_t from_ns = t->synchronous ? t->sync_ns : sim_chain_switched_ns(t->chain, (size_t)(node - CAN_NODE));
	t->sample[t->n++] = at_ns - from_ns;
}

static void measure(int n_stages, int64_t bitrate, bool synchronous)
{
	struct tap *t = calloc(1, sizeof(*t));
	struct rig rig;
	struct can_far far;

	assert_non_null(t);
	rig_init(&rig, 1, 1);
	many_stages(&rig, n_stages);
	can_far_wire(&rig, &far, bitrate, CAN_NODE);
	t->port.frame = on_frame;
	t->chain = far.chain;
	t->synchronous = synchronous;
	sim_can_attach(far.can, &t->port);
	if (synchronous)
		rig_option(&rig, "pdo_type", "1");
	struct bb_shutter *sh = can_far_driver(&rig, &far);
	can_far_bring_up(&rig, sh, 3 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	t->begin_ns = bb_clock_now_ns(rig.clk) + 50 * MS;
	const int64_t busy_ns = sim_can_counters(far.can)->busy_ns, from_ns = bb_clock_now_ns(rig.clk);
	rig_run(&rig, 20 * BB_NS_PER_S);
	const double load = (double)(sim_can_counters(far.can)->busy_ns - busy_ns) /
	                    (double)(bb_clock_now_ns(rig.clk) - from_ns);
	qsort(t->sample, t->n, sizeof(t->sample[0]), compare);
	print_message("  %-17s %6d  %7lld  %5.1f %%  %6zu  %8.1f  %8.1f  %8.1f\n",
	              synchronous ? "SYNC to PDO" : "switch to PDO", n_stages, (long long)bitrate, load * 100, t->n,
	              at_share(t->sample, t->n, 0.5), at_share(t->sample, t->n, 0.99),
	              at_share(t->sample, t->n, 1));
	assert_true(t->n > (size_t)(n_stages * 2350));
	assert_true(t->sample[t->n - 1] < bb_rate_period_ns(rig.fix.room.chain.rate));
	for (int i = 0; i < BB_CANF_COUNT; i++)
		if (bb_shutter_can_alarm(sh, (enum bb_shutter_can_fault)i).count)
			fail_msg("%s: %s", bb_shutter_can_alarm(sh, (enum bb_shutter_can_fault)i).name,
			         bb_shutter_device(sh)->last_error.detail);
	sim_can_detach(&t->port);
	bb_shutter_close(sh);
	can_far_close(&far);
	rig_done(&rig);
	free(t);
}

static void sync_to_phase_in_numbers(void **state)
{
	(void)state;
	print_message("  virtual time, 20 s   stages  bit/s     load    frames    p50 us    p99 us    max us\n");
	measure(3, 1000000, true);
	measure(3, 500000, true);
	measure(3, 1000000, false);
	measure(18, 1000000, true);
	measure(32, 1000000, true);
	measure(32, 1000000, false);
}

static void nonsense_is_refused(void **state)
{
	static const struct {
		const char *key, *value;
	} bad[] = { { "node", "0" }, { "node", "126" }, { "master", "3" }, { "overflow", "7" }, { "overflow", "242" },
		    { "nonsense", "1" }, { "stamp_error_us", "inf" }, { "heartbeat_ms", "x" } };
	struct rig rig;
	struct can_far far;
	struct bb_shutter *sh;

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		rig_init(&rig, 1, 1);
		can_far_wire(&rig, &far, 1000000, CAN_NODE);
		rig_option(&rig, bad[i].key, bad[i].value);
		const struct bb_open open = rig_open(&rig);
		assert_int_equal(bb_shutter_can_open_on(sim_can_bus(far.can), &rig.fix.room.chain, &open, &sh),
		                 BB_ERR_CONFIG);
		assert_null(sh);
		can_far_close(&far);
		rig_done(&rig);
	}
}

static void a_controller_of_another_kind_is_named(void **state)
{
	struct rig rig;
	struct can_far far;

	(void)state;
	rig_init(&rig, 1, 1);
	can_far_wire(&rig, &far, 1000000, CAN_NODE);
	sim_chain_node(far.chain, 2)->type = 0x00030191;
	struct bb_shutter *sh = can_far_driver(&rig, &far);
	rig_run(&rig, 500 * MS);
	assert_true(bb_shutter_can_alarm(sh, BB_CANF_NODE).active);
	assert_int_equal(bb_shutter_can_alarm(sh, BB_CANF_NODE).detail, CAN_NODE + 2);
	assert_int_equal(bb_shutter_can_status(sh).health, BB_HEALTH_DEGRADED);
	assert_int_equal(bb_shutter_can_status(sh).n_ready, 3); /* the others work */
	assert_non_null(strstr(bb_shutter_device(sh)->last_error.detail, "1000h"));
	bb_shutter_close(sh);
	can_far_close(&far);
	rig_done(&rig);
}

static void absent_interfaces_have_numbers(void **state)
{
	struct bb_can_bus *bus;
	struct bb_error err = { 0 };
	struct rig rig;

	(void)state;
	rig_init(&rig, 1, 1);
	assert_int_equal(bb_can_bus_open("this-is-no-interface", rig.clk, &bus, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1531);
	err.number = 0;
	const enum bb_status status = bb_can_bus_open("can-none", rig.clk, &bus, &err);
	print_message("%s\n", err.text);
	assert_null(bus);
	assert_true((status == BB_ERR_UNSUPPORTED && err.number == 1530) ||
	            (status == BB_ERR_LOST && err.number == 1531) || err.number == 1533);
	struct bb_shutter *sh;
	snprintf(rig.uri.path, sizeof(rig.uri.path), "can-none");
	const struct bb_open open = rig_open(&rig);
	assert_int_equal(bb_shutter_open(&bb_shutter_can_driver, &rig.fix.room.chain, &open, &sh), status);
	assert_null(sh);
	rig_done(&rig);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(bring_up_finds_and_labels_all),
		cmocka_unit_test(new_controllers_get_ids_by_fastscan),
		cmocka_unit_test(edges_are_where_the_stages_switched),
		cmocka_unit_test(a_dead_host_opens_the_eyes),
		cmocka_unit_test(the_sim_and_the_wire_agree),
		cmocka_unit_test(sync_to_phase_in_numbers),
		cmocka_unit_test(nonsense_is_refused),
		cmocka_unit_test(a_controller_of_another_kind_is_named),
		cmocka_unit_test(absent_interfaces_have_numbers),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
