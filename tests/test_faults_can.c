/*
 * tests/test_faults_can.c: rows C1 to C6 of the fault matrix on a simulated CAN: injected at the peer or the medium,
 * detected by name within the row's budget, and over again. Virtual time. Prints one line a row. With BB_KERNEL=1 the
 * same rows through an interface vcan0 of this kernel instead, in real time.
 */
#include "drivers/canopen_codec.h"
#include "tests/fault_table.h"
#include "tests/fixture_can.h"

#define PERIOD (BB_NS_PER_S / 120)
#define POLL (2 * MS)

struct bench {
	struct rig rig;
	struct can_far far;
	struct bb_shutter *sh;
	size_t n[4];              /* edges read, by stage, the glasses last */
	uint32_t seq[4];
	int gaps;
	int64_t worst_read_ns;    /* in real time */
};

static int setup(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));

	if (!b)
		return -1;
	rig_init(&b->rig, 5, 1);
	b->sh = can_far_open(&b->rig, &b->far);
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_STEREO), BB_OK);
	rig_run(&b->rig, 300 * MS);
	*state = b;
	return 0;
}

static int teardown(void **state)
{
	struct bench *b = *state;

	bb_shutter_close(b->sh);
	can_far_close(&b->far);
	rig_done(&b->rig);
	free(b);
	return 0;
}

static int64_t now(const struct bench *b)
{
	return bb_clock_now_ns(b->rig.clk);
}

static enum bb_status drain(struct bench *b)
{
	struct bb_shutter_edge e[64];
	enum bb_status status;
	size_t n;

	const int64_t begun_ns = now(b);
	while ((status = bb_shutter_read(b->sh, e, BB_ARRAY_LEN(e), &n)) == BB_OK)
		for (size_t i = 0; i < n; i++) {
			const int row = e[i].stage == BB_STAGE_EMITTER ? 3 : e[i].stage;
			b->gaps += b->n[row] && e[i].seq != b->seq[row] + 1;
			b->seq[row] = e[i].seq;
			b->n[row]++;
		}
	if (now(b) - begun_ns > b->worst_read_ns)
		b->worst_read_ns = now(b) - begun_ns;
	return status;
}

static void run(struct bench *b, int64_t for_ns)
{
	for (const int64_t end_ns = now(b) + for_ns; now(b) < end_ns;) {
		rig_run(&b->rig, MS / 2);
		drain(b);
	}
}

static void count_anew(struct bench *b)
{
	drain(b);
	memset(b->n, 0, sizeof(b->n));
	b->gaps = 0;
}

static struct bb_shutter_can_alarm alarm_of(const struct bench *b, enum bb_shutter_can_fault fault)
{
	return bb_shutter_can_alarm(b->sh, fault);
}

/* Runs until an alarm is raised or over; ns since from_ns, as the driver stamped it. */
static int64_t until(struct bench *b, enum bb_shutter_can_fault fault, bool active, int64_t from_ns, int64_t most_ns)
{
	const int64_t end_ns = now(b) + most_ns;

	while (alarm_of(b, fault).active != active) {
		if (now(b) > end_ns)
			fail_msg("%s is not %s within %lld ms", alarm_of(b, fault).name, active ? "raised" : "over",
			         (long long)(most_ns / MS));
		run(b, MS / 2);
	}
	return (active ? alarm_of(b, fault).raised_ns : alarm_of(b, fault).cleared_ns) - from_ns;
}

static void named(const struct bench *b, const char *word)
{
	assert_non_null(strstr(bb_shutter_device(b->sh)->last_error.detail, word));
	assert_int_not_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_OK); /* never OK while faulted */
}

static void row(const struct bench *b, const char *id, enum bb_shutter_can_fault fault, const char *what, int64_t detected_ns, int64_t budget_ns, int64_t recovered_ns)
{
	fault_row(id, what, alarm_of(b, fault).name, detected_ns, budget_ns, recovered_ns);
	assert_true(detected_ns >= 0 && detected_ns <= budget_ns);
}

static void ends_well(struct bench *b)
{
	run(b, BB_NS_PER_S);
	for (int i = 0; i < BB_CANF_COUNT; i++)
		if (alarm_of(b, (enum bb_shutter_can_fault)i).active)
			fail_msg("%s: %s", alarm_of(b, (enum bb_shutter_can_fault)i).name,
			         bb_shutter_device(b->sh)->last_error.detail);
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_OK);
	count_anew(b);
	run(b, BB_NS_PER_S);
	for (int s = 0; s < 4; s++)
		assert_true(b->n[s] >= 119 && b->n[s] <= 121);
	assert_int_equal(b->gaps, 0);
}

static bool all_shut(const struct bench *b)
{
	for (size_t i = 0; i < 4; i++)
		if (sim_chain_is_open(b->far.chain, i))
			return false;
	return true;
}

static void c1_bus_off(void **state)
{
	struct bench *b = *state;
	const int64_t from_ns = now(b);

	sim_can_bus_off(sim_can_host(b->far.can));
	const int64_t found_ns = until(b, BB_CANF_BUS_OFF, true, from_ns, 50 * MS);
	named(b, "BUS_OFF tec 255");
	assert_true(bb_shutter_can_status(b->sh).tx_stopped);
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_HOLDOVER);
	assert_int_equal(bb_shutter_set_phase(b->sh, 0, 1000000, 1000000), BB_OK); /* kept for later */
	run(b, 50 * MS);
	assert_true(all_shut(b)); /* outputs held */
	const int64_t over_ns = until(b, BB_CANF_BUS_OFF, false, from_ns, 200 * MS);
	row(b, "C1", BB_CANF_BUS_OFF, "bus-off", found_ns, 10 * MS, over_ns);
	assert_true(over_ns >= 80 * MS && over_ns <= 125 * MS); /* 100 ms +-20 %, 1.4 ms of recessive bits, a poll */
	assert_true(all_shut(b));
	ends_well(b);
}

/* All the host sends is destroyed: warning, passive and off by its own counters. */
static void c1_by_counters(void **state)
{
	struct bench *b = *state;
	const int64_t broken_ns = now(b);

	sim_can_break_tx(sim_can_host(b->far.can), true);
	const int64_t passive_ns = until(b, BB_CANF_BUS_ERROR, true, broken_ns, 200 * MS);
	const int64_t off_ns = until(b, BB_CANF_BUS_OFF, true, broken_ns, 200 * MS);
	row(b, "C1", BB_CANF_BUS_ERROR, "every sent frame destroyed: first warning", passive_ns, 110 * MS, off_ns);
	assert_true(off_ns - passive_ns < 10 * MS); /* 20 more frames of some 100 bits */
	sim_can_break_tx(sim_can_host(b->far.can), false);
	until(b, BB_CANF_BUS_OFF, false, broken_ns, 300 * MS);
	ends_well(b);
}

static void c1_too_often(void **state)
{
	struct bench *b = *state;
	int64_t at_ns[8] = { 0 };

	for (int k = 0; k < 6; k++) {
		at_ns[k] = now(b);
		sim_can_bus_off(sim_can_host(b->far.can));
		until(b, BB_CANF_BUS_OFF, true, at_ns[k], 50 * MS);
		if (k < 5)
			at_ns[k] = until(b, BB_CANF_BUS_OFF, false, at_ns[k], 3 * BB_NS_PER_S);
	}
	for (int k = 0; k < 5; k++)
		assert_true(at_ns[k] > (80 * MS << k) && at_ns[k] < (120 * MS << k) + 5 * MS);
	run(b, 5 * BB_NS_PER_S);
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_QUARANTINED);
	assert_int_equal(drain(b), BB_ERR_LOST);
	print_message("     sixth bus-off within a minute: left alone; waits were %.0f, %.0f, %.0f, %.0f, %.0f ms\n",
	              (double)at_ns[0] * 1e-6, (double)at_ns[1] * 1e-6, (double)at_ns[2] * 1e-6,
	              (double)at_ns[3] * 1e-6, (double)at_ns[4] * 1e-6);
	for (size_t i = 0; i < 4; i++)
		assert_true(sim_chain_is_open(b->far.chain, i)); /* nobody commands them: open */
}

static void babble(struct bench *b, uint32_t id, const char *what, int stage_lost)
{
	struct bb_can_frame f = { .id = id, .n_bytes = 8, .bytes = { 1, 2, 3 } };
	const int64_t from_ns = now(b);

	count_anew(b);
	sim_can_babble(b->far.can, &f, 300 * US);
	const int64_t found_ns = until(b, BB_CANF_BABBLE, true, from_ns, 200 * MS);
	assert_int_equal(alarm_of(b, BB_CANF_BABBLE).detail, id);
	run(b, BB_NS_PER_S);
	for (int s = 0; s < 4; s++) /* everybody else is heard as ever */
		assert_true(s == stage_lost || (b->n[s] >= 119 && b->n[s] <= 125));
	assert_int_equal(alarm_of(b, BB_CANF_SYNC_LATE).count, 0);
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_DEGRADED);
	const int64_t quiet_ns = now(b);
	sim_can_babble(b->far.can, &f, 0);
	const int64_t over_ns = until(b, BB_CANF_BABBLE, false, quiet_ns, 8 * BB_NS_PER_S);
	row(b, "C2", BB_CANF_BABBLE, what, found_ns, 100 * MS, over_ns);
	assert_true(over_ns >= 4900 * MS && over_ns <= 5100 * MS);
	ends_well(b);
}

static void c2_babbling_stranger(void **state)
{
	babble(*state, 0x123, "babbling node, id 123, 3300/s", -1);
}

static void c2_babbling_above_sync(void **state)
{
	babble(*state, 0x00a, "babbling node, id 00a (before SYNC)", -1);
}

static void c2_babbling_stage(void **state)
{
	babble(*state, CO_TPDO1 + CAN_NODE + 1, "babbling stage: its own phase id", 0);
}

static void c3_node_lost(void **state)
{
	struct bench *b = *state;
	struct sim_co_node *left = sim_chain_node(b->far.chain, 2);
	const int64_t from_ns = now(b);

	sim_can_mute(&left->port, true);
	const int64_t found_ns = until(b, BB_CANF_NODE_LOST, true, from_ns, 500 * MS);
	named(b, "NODE_LOST node 7 (left)");
	assert_int_equal(alarm_of(b, BB_CANF_NODE_LOST).detail, CAN_NODE + 2);
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_DEGRADED);
	run(b, 600 * MS);
	assert_true(sim_chain_is_open(b->far.chain, 2)); /* its safe default */
	assert_false(sim_chain_is_open(b->far.chain, 1));
	const int64_t back_ns = now(b);
	sim_can_mute(&left->port, false);
	const int64_t over_ns = until(b, BB_CANF_NODE_LOST, false, back_ns, 2 * BB_NS_PER_S);
	row(b, "C3", BB_CANF_NODE_LOST, "node unplugged from the bus", found_ns, 150 * MS + POLL, over_ns);
	ends_well(b);
}

static void c3_node_boots(void **state)
{
	struct bench *b = *state;
	const int64_t from_ns = now(b);

	assert_int_equal(bb_shutter_set_phase(b->sh, 1, 2222000, 750000), BB_OK);
	run(b, 50 * MS);
	sim_chain_power(b->far.chain, 2, false);
	const int64_t found_ns = until(b, BB_CANF_NODE_LOST, true, from_ns, 500 * MS) - 50 * MS;
	run(b, 100 * MS);
	const int64_t back_ns = now(b);
	sim_chain_power(b->far.chain, 2, true);
	const int64_t over_ns = until(b, BB_CANF_NODE_LOST, false, back_ns, 2 * BB_NS_PER_S);
	row(b, "C3", BB_CANF_NODE_LOST, "node without power, then boots", found_ns, 150 * MS + POLL, over_ns);
	/* Too quick for heartbeats: its boot-up tells. */
	const int64_t again_ns = now(b);
	sim_chain_power(b->far.chain, 2, false);
	sim_chain_power(b->far.chain, 2, true);
	const int64_t seen_ns = until(b, BB_CANF_NODE_LOST, true, again_ns, 500 * MS);
	row(b, "C3", BB_CANF_NODE_LOST, "node starts anew within a heartbeat", seen_ns, 150 * MS + POLL,
	    until(b, BB_CANF_NODE_LOST, false, again_ns, 2 * BB_NS_PER_S));
	ends_well(b);
}

static void c4_queue_full(void **state)
{
	struct bench *b = *state;
	int calls = 0;

	sim_can_hold_tx(sim_can_host(b->far.can), true);
	const int64_t from_ns = now(b);
	for (; !alarm_of(b, BB_CANF_TX_DROP).active; calls++)
		assert_int_equal(bb_shutter_set_mode(b->sh, calls % 2 ? BB_SHUTTER_STEREO : BB_SHUTTER_OPEN), BB_OK);
	assert_true(calls > BB_STAGES_MAX && calls < 100);
	assert_int_equal(now(b), from_ns); /* the same call */
	named(b, "TX_DROP");
	if (calls % 2)
		assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_STEREO), BB_OK);
	for (int64_t k = 0; k < 200; k++) /* state: the newest wins */
		assert_int_equal(bb_shutter_set_phase(b->sh, 0, 1000000 + k * 1000, 1000000), BB_OK);
	run(b, 100 * MS);
	const int64_t free_ns = now(b);
	sim_can_hold_tx(sim_can_host(b->far.can), false);
	const int64_t over_ns = until(b, BB_CANF_TX_DROP, false, free_ns, 500 * MS);
	row(b, "C4", BB_CANF_TX_DROP, "send queue full", 0, 1, over_ns);
	ends_well(b);
	const struct sim_co_node *front = sim_chain_node(b->far.chain, 1);
	for (size_t i = 0; i < front->n_app; i++)
		if (front->app[i].index == SHUT_OD_DRIVE && front->app[i].sub == 1)
			assert_int_equal(*front->app[i].value, 1199000);
}

static void c4_nothing_drains(void **state)
{
	struct bench *b = *state;
	const int64_t from_ns = now(b);

	sim_can_hold_tx(sim_can_host(b->far.can), true);
	/* Ten heartbeats fit into the interface's queue: only then is anything refused. */
	for (int64_t k = 0; k < 16; k++) {
		assert_int_equal(bb_shutter_set_phase(b->sh, (uint8_t)(k % 3), 1000000 + k * 10000, 1000000), BB_OK);
		run(b, 25 * MS);
	}
	const int64_t found_ns = until(b, BB_CANF_TX_DROP, true, from_ns, BB_NS_PER_S);
	sim_can_hold_tx(sim_can_host(b->far.can), false);
	const int64_t free_ns = now(b);
	row(b, "C4", BB_CANF_TX_DROP, "send queue does not drain", found_ns, 500 * MS,
	    until(b, BB_CANF_TX_DROP, false, free_ns, 500 * MS));
	run(b, 2 * BB_NS_PER_S);
	ends_well(b);
}

/* A phase of node 6 with a right CRC, found by trying. */
static struct bb_can_frame forged(uint8_t counter, uint8_t sequence)
{
	struct bb_can_frame f = { .id = CO_TPDO1 + CAN_NODE + 1, .n_bytes = 8,
		                  .bytes = { counter, 1 | SHUT_FLAG_LINE, 0x40, 0x42, 0x0f, 0, sequence } };
	struct bb_co_phase p;

	for (int crc = 0; crc < 256; crc++) {
		f.bytes[7] = (uint8_t)crc;
		if (bb_co_read_phase(&f, &p) == BB_OK)
			break;
	}
	return f;
}

/* One frame from nowhere; ns from its end to its being found. The driver looks every 2 ms. */
static int64_t one_frame(struct bench *b, const struct bb_can_frame *f, enum bb_shutter_can_fault fault)
{
	const uint64_t count = alarm_of(b, fault).count;
	const int64_t from_ns = now(b);
	struct bb_shutter_can_node before, after;

	bb_shutter_can_node(b->sh, 1, &before);
	sim_can_inject(b->far.can, f);
	while (alarm_of(b, fault).count == count) {
		assert_true(now(b) - from_ns < 10 * MS);
		rig_run(&b->rig, 20 * US);
		drain(b); /* reading looks at once */
	}
	bb_shutter_can_node(b->sh, 1, &after);
	assert_true(after.phases <= before.phases + 1); /* at most the true one beside it */
	return alarm_of(b, fault).raised_ns - from_ns;
}

static void over(struct bench *b, const char *what, enum bb_shutter_can_fault fault, int64_t found_ns)
{
	const int64_t from_ns = now(b);

	row(b, "C5", fault, what, found_ns, 500 * US, until(b, fault, false, from_ns, BB_NS_PER_S));
	ends_well(b);
}

static void c5_wrong_frames(void **state)
{
	struct bench *b = *state;
	struct bb_can_frame f = forged(9, 1);

	f.n_bytes = 7;
	over(b, "phase of 7 bytes", BB_CANF_PROTO, one_frame(b, &f, BB_CANF_PROTO));
	f = forged(9, 1);
	f.bytes[7] ^= 1;
	over(b, "phase with a wrong CRC", BB_CANF_PROTO, one_frame(b, &f, BB_CANF_PROTO));
	f = (struct bb_can_frame){ .id = CO_HEARTBEAT + CAN_NODE, .n_bytes = 2 };
	over(b, "heartbeat of 2 bytes", BB_CANF_PROTO, one_frame(b, &f, BB_CANF_PROTO));
	f = (struct bb_can_frame){ .id = CO_SYNC, .n_bytes = 3, .bytes = { 1, 1, 1 } };
	over(b, "SYNC of 3 bytes", BB_CANF_PROTO, one_frame(b, &f, BB_CANF_PROTO));
}

static void c5_duplicate_node(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_can_status st = bb_shutter_can_status(b->sh);

	run(b, 6 * MS); /* between two edges of stage 0 */
	st = bb_shutter_can_status(b->sh);
	const struct bb_can_frame f = forged((uint8_t)(st.sync_seq % 240 + 1), 77);
	const int64_t found_ns = one_frame(b, &f, BB_CANF_DUP_ID);
	named(b, "DUP_ID two controllers answer as node 6");
	over(b, "two nodes with one id", BB_CANF_DUP_ID, found_ns);
	const struct bb_can_frame host = { .id = CO_HEARTBEAT + 127, .n_bytes = 1, .bytes = { 5 } };
	over(b, "somebody with the host's own id", BB_CANF_DUP_ID, one_frame(b, &host, BB_CANF_DUP_ID));
}

static void c5_stale_counter(void **state)
{
	struct bench *b = *state;
	const int64_t from_ns = now(b);

	sim_chain_freeze(b->far.chain, 1, true);
	const int64_t found_ns = until(b, BB_CANF_STALE, true, from_ns, 100 * MS);
	count_anew(b);
	run(b, 200 * MS);
	assert_int_equal(b->n[0], 0); /* dropped, each of them */
	assert_true(b->n[1] >= 23);
	sim_chain_freeze(b->far.chain, 1, false);
	const int64_t thawed_ns = now(b);
	row(b, "C5", BB_CANF_STALE, "a counter that stands still", found_ns, 2 * PERIOD + POLL,
	    until(b, BB_CANF_STALE, false, thawed_ns, BB_NS_PER_S));
	ends_well(b);
}

static void c6_sync_missing(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_can_status st = bb_shutter_can_status(b->sh);

	count_anew(b);
	const int64_t due_ns = st.sync_ns + PERIOD; /* the next one does not come */
	sim_chain_drop_sync(b->far.chain, 3);
	const int64_t found_ns = until(b, BB_CANF_SYNC_LATE, true, due_ns, 50 * MS);
	named(b, "SYNC_LATE");
	const int64_t over_ns = until(b, BB_CANF_SYNC_LATE, false, due_ns, 500 * MS);
	row(b, "C6", BB_CANF_SYNC_LATE, "three SYNCs missing", found_ns, PERIOD, over_ns);
	assert_true(over_ns >= 11 * PERIOD && over_ns <= 14 * PERIOD); /* three missed, ten good */
	assert_int_equal(b->gaps, 0); /* phases had the host's clock to stand on */
	assert_true(bb_shutter_can_status(b->sh).freewheeled >= 3);
	ends_well(b);
}

static void c6_sync_late(void **state)
{
	struct bench *b = *state;
	struct bb_shutter_can_status st = bb_shutter_can_status(b->sh);
	const int64_t due_ns = st.sync_ns + PERIOD;

	sim_chain_late_sync(b->far.chain, 3 * MS);
	const int64_t found_ns = until(b, BB_CANF_SYNC_LATE, true, due_ns, 50 * MS);
	run(b, 20 * MS);
	sim_chain_late_sync(b->far.chain, 0);
	const int64_t ended_ns = now(b);
	row(b, "C6", BB_CANF_SYNC_LATE, "SYNC 3 ms late", found_ns, PERIOD,
	    until(b, BB_CANF_SYNC_LATE, false, ended_ns, 500 * MS));
	ends_well(b);
}

static void c6_link_down(void **state)
{
	struct bench *b = *state;
	const int64_t from_ns = now(b);

	sim_can_link_down(b->far.can, true);
	const int64_t found_ns = until(b, BB_CANF_IF_DOWN, true, from_ns, 100 * MS);
	named(b, "IF_DOWN");
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_HOLDOVER);
	const uint32_t seq = bb_shutter_can_status(b->sh).sync_seq;
	run(b, BB_NS_PER_S);
	assert_in_range(bb_shutter_can_status(b->sh).sync_seq - seq, 118, 121); /* freewheels */
	assert_true(sim_chain_is_open(b->far.chain, 1)); /* no host: open */
	sim_can_link_down(b->far.can, false);
	const int64_t up_ns = now(b);
	const int64_t over_ns = until(b, BB_CANF_IF_DOWN, false, up_ns, BB_NS_PER_S);
	row(b, "C6", BB_CANF_IF_DOWN, "interface down for 1 s", found_ns, 50 * MS, over_ns);
	assert_true(over_ns >= 9 * PERIOD && over_ns <= 12 * PERIOD);
	ends_well(b);
	/* For good: lost after the holdover. */
	sim_can_link_down(b->far.can, true);
	run(b, 9 * BB_NS_PER_S);
	assert_int_equal(drain(b), BB_ERR_LOST);
	sim_can_link_down(b->far.can, false);
	run(b, BB_NS_PER_S);
	ends_well(b);
}

/* Noise: one frame in fifty is destroyed. Nothing may be lost but time. */
static void noise_costs_time_only(void **state)
{
	struct bench *b = *state;

	sim_can_error_ppm(b->far.can, 20000);
	count_anew(b);
	run(b, 5 * BB_NS_PER_S);
	for (int s = 0; s < 4; s++)
		assert_true(b->n[s] >= 598 && b->n[s] <= 602);
	assert_int_equal(b->gaps, 0);
	assert_true(sim_can_counters(b->far.can)->errors > 50);
	sim_can_error_ppm(b->far.can, 0);
	ends_well(b);
}

/* The words of `serve --fault`: each does what it says, and is over. */

static const struct {
	const char *device, *fault;
	enum bb_shutter_can_fault alarm; /* BB_CANF_COUNT: none */
} verbs[] = {
	{ "can/chain", "babble id=0x123 us=300", BB_CANF_BABBLE },
	{ "can/chain", "unplug stage=left", BB_CANF_NODE_LOST },
	{ "can/chain", "power stage=left", BB_CANF_NODE_LOST },
	{ "can/chain", "drop_sync n=3", BB_CANF_SYNC_LATE },
	{ "can/chain", "late_sync us=3000", BB_CANF_SYNC_LATE },
	{ "can/chain", "freeze stage=left", BB_CANF_STALE },
	{ "can/chain", "noise ppm=20000", BB_CANF_COUNT },
	{ "can/chain", "emergency stage=left code=0x4200", BB_CANF_NODE },
	{ "can/chain", "twin", BB_CANF_DUP_ID },
	{ "can/chain", "bad_sync", BB_CANF_PROTO },
	{ "can/chain", "bus_off", BB_CANF_BUS_OFF },
	{ "shutter/chain", "miss n=3", BB_CANF_SYNC_LATE },
	{ "shutter/chain", "stuck stage=left", BB_CANF_NODE },
	{ "shutter/chain", "flip_polarity stage=left", BB_CANF_COUNT },
	{ "shutter/chain", "stage_offset stage=left us=900", BB_CANF_COUNT },
	{ "shutter/chain", "unplug", BB_CANF_NODE_LOST },
};

static void verbs_do_what_they_say(void **state)
{
	struct bench *b = *state;
	const char *const classes[] = { "can", "shutter" };

	assert_int_equal(sim_world_register(b->rig.world, "can", "chain", b->far.chain, sim_chain_can_verbs), BB_OK);
	assert_int_equal(sim_world_register(b->rig.world, "shutter", "chain", b->far.chain, sim_chain_shutter_verbs), BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(verbs); i++) {
		const bool alarms = verbs[i].alarm != BB_CANF_COUNT;
		const uint64_t count = alarms ? alarm_of(b, verbs[i].alarm).count : 0;
		const int64_t from_ns = now(b);
		print_message("%s %s\n", verbs[i].device, verbs[i].fault);
		rig_fault(&b->rig, verbs[i].device, verbs[i].fault, true);
		while (alarms && alarm_of(b, verbs[i].alarm).count == count) { /* it may be over as quickly */
			assert_true(now(b) - from_ns < 500 * MS);
			run(b, MS / 2);
		}
		run(b, 200 * MS);
		rig_fault(&b->rig, verbs[i].device, verbs[i].fault, false);
		if (alarms)
			until(b, verbs[i].alarm, false, now(b), 8 * BB_NS_PER_S);
		run(b, 500 * MS);
		ends_well(b);
	}
	for (size_t c = 0; c < BB_ARRAY_LEN(classes); c++) /* none was forgotten above */
		for (const struct sim_verb *v = c ? sim_chain_shutter_verbs : sim_chain_can_verbs; v->name; v++) {
			size_t i = 0;
			while (i < BB_ARRAY_LEN(verbs) && (strncmp(verbs[i].device, classes[c], strlen(classes[c])) ||
			                                   strncmp(verbs[i].fault, v->name, strlen(v->name))))
				i++;
			assert_true(i < BB_ARRAY_LEN(verbs));
		}
}

static struct bb_shutter_edge newest(struct bench *b, uint8_t stage)
{
	struct bb_shutter_edge e, last = { 0 };
	size_t n;

	drain(b);
	rig_run(&b->rig, 100 * MS);
	while (bb_shutter_read(b->sh, &e, 1, &n) == BB_OK)
		last = e.stage == stage ? e : last;
	return last;
}

static void verbs_reach_the_edges(void **state)
{
	struct bench *b = *state;
	const struct bb_shutter_edge before = newest(b, 1);

	sim_chain_flip(b->far.chain, 2, true);
	const struct bb_shutter_edge flipped = newest(b, 1);
	assert_int_not_equal((flipped.seq + flipped.eye) % 2, (before.seq + before.eye) % 2);
	sim_chain_flip(b->far.chain, 2, false);
	sim_chain_offset(b->far.chain, 2, 900 * US);
	const struct bb_shutter_edge late = newest(b, 1);
	assert_int_equal((late.seq + late.eye) % 2, (before.seq + before.eye) % 2);
	const int64_t later_ns = late.at_ns - before.at_ns - bb_rate_frame_ns(b->rig.fix.room.chain.rate, late.seq - before.seq);
	assert_in_range(later_ns, 880 * US, 920 * US); /* jitter, rate */
	sim_chain_offset(b->far.chain, 2, -900 * US);
	count_anew(b);
	run(b, 50 * MS);
	sim_chain_miss(b->far.chain, 2, 3);
	run(b, 150 * MS);
	assert_int_equal(b->gaps, 1);
	assert_in_range(b->n[1], 20, 22);
	assert_in_range(b->n[0], 23, 25);
}

/* ---- through a kernel's bus: its own sockets at both ends, in real time ---- */

#define HEARTBEAT_MOST (150 * MS + 2 * POLL)

static const struct {
	const char *row, *what, *device, *fault;
	enum bb_shutter_can_fault alarm;
	int64_t hold_ns, budget_ns; /* how long it stays; 0: it is over at once */
} kernel_rows[] = {
	{ "C1", "vcan: error frames say bus-off", "can/chain", "bus_off", BB_CANF_BUS_OFF, 100 * MS, 10 * MS },
	{ "C2", "vcan: babbling node, 3300/s", "can/chain", "babble id=0x123 us=300", BB_CANF_BABBLE, 300 * MS,
	  100 * MS },
	{ "C3", "vcan: node unplugged from the bus", "can/chain", "unplug stage=left", BB_CANF_NODE_LOST, 600 * MS,
	  HEARTBEAT_MOST },
	{ "C3", "vcan: node without power, then boots", "can/chain", "power stage=left", BB_CANF_NODE_LOST, 600 * MS,
	  HEARTBEAT_MOST },
	{ "C5", "vcan: a counter that stands still", "can/chain", "freeze stage=left", BB_CANF_STALE, 200 * MS,
	  2 * PERIOD + 2 * POLL },
	{ "C5", "vcan: somebody with the host's own id", "can/chain", "twin", BB_CANF_DUP_ID, 0, PERIOD },
	{ "C5", "vcan: SYNC of 3 bytes", "can/chain", "bad_sync", BB_CANF_PROTO, 0, PERIOD },
	{ "C6", "vcan: three SYNCs missing", "can/chain", "drop_sync n=3", BB_CANF_SYNC_LATE, 0, 2 * PERIOD + 2 * POLL },
	{ "C6", "vcan: SYNC 3 ms late", "can/chain", "late_sync us=3000", BB_CANF_SYNC_LATE, 200 * MS,
	  2 * PERIOD + 2 * POLL },
};

static int kernel_setup(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));

	if (!b || bb_clock_posix_create(&b->rig.clk) != BB_OK)
		return -1;
	fixture_room_init(&b->rig.fix);
	rig_world(&b->rig, 5, 1);
	b->sh = can_far_open_on(&b->rig, &b->far, "vcan0", CAN_NODE);
	assert_int_equal(sim_world_register(b->rig.world, "can", "chain", b->far.chain, sim_chain_can_verbs), BB_OK);
	assert_int_equal(bb_shutter_set_mode(b->sh, BB_SHUTTER_STEREO), BB_OK);
	rig_run(&b->rig, 300 * MS);
	*state = b;
	return 0;
}

/* All is well, and stays so: no edge is missing. */
static void kernel_ends_well(struct bench *b)
{
	for (int i = 0; i < 400 && bb_shutter_can_status(b->sh).health != BB_HEALTH_OK; i++)
		run(b, 5 * MS);
	count_anew(b);
	run(b, 300 * MS);
	for (int s = 0; s < 4; s++)
		assert_in_range(b->n[s], 34, 38);
	assert_int_equal(b->gaps, 0);
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_OK);
}

/* From its being injected until somebody who reads every half a millisecond sees the alarm. */
static int64_t kernel_found_ns(struct bench *b, enum bb_shutter_can_fault fault, uint64_t count, int64_t from_ns)
{
	while (alarm_of(b, fault).count == count) {
		assert_true(now(b) - from_ns < BB_NS_PER_S);
		run(b, MS / 2);
	}
	return now(b) - from_ns;
}

static void rows_on_a_kernels_bus(void **state)
{
	struct bench *b = *state;

	for (size_t i = 0; i < BB_ARRAY_LEN(kernel_rows); i++) {
		const enum bb_shutter_can_fault fault = kernel_rows[i].alarm;
		const uint64_t count = alarm_of(b, fault).count;
		int64_t ended_ns = now(b);
		rig_fault(&b->rig, kernel_rows[i].device, kernel_rows[i].fault, true);
		const int64_t found_ns = kernel_found_ns(b, fault, count, ended_ns);
		if (kernel_rows[i].hold_ns) {
			run(b, kernel_rows[i].hold_ns);
			ended_ns = now(b);
			rig_fault(&b->rig, kernel_rows[i].device, kernel_rows[i].fault, false);
		}
		run(b, 3 * PERIOD); /* the end may be one more, as of a SYNC in its old place */
		while (alarm_of(b, fault).active) {
			assert_true(now(b) - ended_ns < 8 * BB_NS_PER_S);
			run(b, MS / 2);
		}
		const int64_t over_ns = alarm_of(b, fault).cleared_ns - ended_ns;
		row(b, kernel_rows[i].row, fault, kernel_rows[i].what, found_ns, kernel_rows[i].budget_ns,
		    over_ns > 0 ? over_ns : 0);
		kernel_ends_well(b);
	}
}

static void an_interface_of_the_kernels_goes_down(void **state)
{
	struct bench *b = *state;
	const int64_t from_ns = now(b);

	assert_int_equal(system("ip link set vcan0 down"), 0);
	const int64_t found_ns = kernel_found_ns(b, BB_CANF_IF_DOWN, 0, from_ns);
	run(b, 500 * MS);
	assert_int_equal(bb_shutter_can_status(b->sh).health, BB_HEALTH_HOLDOVER);
	assert_int_equal(system("ip link set vcan0 up"), 0);
	const int64_t up_ns = now(b);
	const int64_t over_ns = until(b, BB_CANF_IF_DOWN, false, up_ns, 2 * BB_NS_PER_S);
	row(b, "C6", BB_CANF_IF_DOWN, "vcan: interface down for 0.5 s", found_ns, 50 * MS, over_ns);
	kernel_ends_well(b);
	assert_true(b->worst_read_ns < PERIOD); /* no read of any row held the frame loop */
	print_message("the longest read took %.3f ms\n", (double)b->worst_read_ns * 1e-6);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(c1_bus_off), T(c1_by_counters), T(c1_too_often), T(c2_babbling_stranger), T(c2_babbling_above_sync),
		T(c2_babbling_stage), T(c3_node_lost), T(c3_node_boots), T(c4_queue_full), T(c4_nothing_drains),
		T(c5_wrong_frames), T(c5_duplicate_node), T(c5_stale_counter), T(c6_sync_missing), T(c6_sync_late),
		T(c6_link_down), T(noise_costs_time_only), T(verbs_do_what_they_say), T(verbs_reach_the_edges),
	};

	const struct CMUnitTest kernel[] = {
		cmocka_unit_test_setup_teardown(rows_on_a_kernels_bus, kernel_setup, teardown),
		cmocka_unit_test_setup_teardown(an_interface_of_the_kernels_goes_down, kernel_setup, teardown),
	};

	return getenv("BB_KERNEL") ? cmocka_run_group_tests(kernel, NULL, NULL) :
	                             cmocka_run_group_tests(tests, NULL, NULL);
}
