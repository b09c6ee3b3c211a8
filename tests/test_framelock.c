/*
 * tests/test_framelock.c: nodes that flip together: skew, what loss, death, partition and strangers do, and that nothing
 * depends on where clocks begin. Six nodes of 100 ppm over 100 us + exponential (p99 200 us) unless it says otherwise.
 */
#include "bench/barrier/model.h"
#include "bench/barrier/sim.h"
#include "sync/framelock/straggler.h"
#include "tests/sim_rig.h"

#include <math.h>
#include <stdio.h>

#define N 6
#define T INT64_C(16666667)
#define SECOND BB_NS_PER_S

struct watch { /* what a test sees of a troupe */
	struct bb_troupe *w;
	int64_t last_ns[BB_LOCK_NODES_MAX], gap_ns[BB_LOCK_NODES_MAX]; /* of releases */
	uint64_t last_frame[BB_LOCK_NODES_MAX];
	unsigned unordered, skipped;
	struct bb_lock_set missing;  /* all the master ever named */
	uint64_t hash;
	bool hashing;
	/* a straggler's story */
	struct bb_straggler *policy;
	uint64_t lowered_frame, slower_frame;
	unsigned lowered_node;
	/* displays */
	struct bb_display *display[N];
};

static void fold(struct watch *s, uint64_t v)
{
	s->hash = (s->hash ^ v) * UINT64_C(0x100000001B3);
}

static void judge_stragglers(struct watch *s, uint64_t frame)
{
	for (unsigned i = 0; i < N; i++)
		bb_straggler_note(s->policy, i, bb_troupe_took_ns(s->w, i));
	const struct bb_straggler_verdict v = bb_straggler_decide(s->policy);
	if (v.change == BB_STRAGGLER_LOWER && !s->lowered_frame) {
		s->lowered_frame = frame;
		s->lowered_node = v.node;
	}
	if (v.change == BB_STRAGGLER_SLOWER && !s->slower_frame)
		s->slower_frame = frame;
	for (unsigned i = 0; i < N; i++)
		bb_troupe_quality(s->w, i, s->policy->node[i].quality);
	if (v.change == BB_STRAGGLER_SLOWER || v.change == BB_STRAGGLER_FASTER)
		bb_troupe_every(s->w, s->policy->every);
}

static void on_release(void *ctx, unsigned node, int64_t true_ns, const struct bb_lock_release *r)
{
	struct watch *s = ctx;

	if (s->last_ns[node] && true_ns - s->last_ns[node] > s->gap_ns[node])
		s->gap_ns[node] = true_ns - s->last_ns[node];
	s->unordered += s->last_frame[node] && r->frame <= s->last_frame[node];
	s->skipped += r->skipped;
	s->last_ns[node] = true_ns;
	s->last_frame[node] = r->frame;
	for (unsigned i = 0; i < BB_LOCK_NODES_MAX; i++)
		if (bb_lock_set_has(&r->missing, i))
			bb_lock_set_put(&s->missing, i, true);
	if (s->hashing) {
		fold(s, node);
		fold(s, (uint64_t)true_ns);
		fold(s, r->frame);
	}
	if (s->policy && node == 0)
		judge_stragglers(s, r->frame);
	if (node < N && s->display[node] && !r->skipped)
		assert_true(bb_display_present(s->display[node], r->frame, BB_EYE_NONE, 0) >= 0);
}

static struct bb_troupe_config usual(enum bb_lock_method m, unsigned n, unsigned frames)
{
	struct bb_troupe_config c = bb_troupe_usual();

	c.method = m;
	c.n_nodes = n;
	c.frames = frames;
	c.released = on_release;
	return c;
}

static void begin(struct watch *s, struct bb_troupe_config c)
{
	memset(s, 0, sizeof(*s));
	c.ctx = s;
	assert_int_equal(bb_troupe_create(&c, &s->w), BB_OK);
}

static void forget_gaps(struct watch *s)
{
	memset(s->gap_ns, 0, sizeof(s->gap_ns));
}

static int64_t worst_gap(const struct watch *s, unsigned from, unsigned to)
{
	int64_t worst_ns = 0;

	for (unsigned i = from; i <= to; i++)
		worst_ns = s->gap_ns[i] > worst_ns ? s->gap_ns[i] : worst_ns;
	return worst_ns;
}

static enum bb_lock_state state_of(const struct watch *s, unsigned node)
{
	return bb_framelock_state(bb_troupe_lock(s->w, node));
}

static unsigned members_of(const struct watch *s, unsigned node)
{
	return bb_lock_set_count(bb_framelock_members(bb_troupe_lock(s->w, node)));
}

/* ---- bytes ---- */

static void messages_survive_the_wire_and_nothing_else_does(void **state)
{
	struct bb_lock_message m = { .kind = BB_LOCK_EPOCH, .epoch = 7, .frame = 99, .master = 2, .n_nodes = 416 }, back;
	uint8_t bytes[BB_LOCK_MESSAGE_MAX + 1] = { 0 };
	(void)state;

	m.u.epoch.from = 101;
	m.u.epoch.members = bb_lock_set_first(416);
	const size_t n = bb_lock_write(&m, bytes);
	assert_int_equal(n, BB_LOCK_MESSAGE_MAX);
	assert_true(bb_lock_read(bytes, n, &back));
	assert_int_equal(back.epoch, 7);
	assert_int_equal(back.frame, 99);
	assert_int_equal(back.u.epoch.from, 101);
	assert_true(bb_lock_set_equal(&back.u.epoch.members, &m.u.epoch.members));
	for (size_t cut = 0; cut < n; cut++)
		assert_false(bb_lock_read(bytes, cut, &back));
	assert_false(bb_lock_read(bytes, n + 1, &back));
	struct { size_t at; uint8_t value; } const bad[] = {
		{ 0, 'X' }, { 2, 0 }, { 2, 10 }, { 15, 1 }, { 17, 2 }, { 19, 3 }, { 20, 1 }, { 31, 1 }, { 39, 1 }, { 40, 0xFB }, { 103, 0x80 },
	};
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		const uint8_t was = bytes[bad[i].at];
		bytes[bad[i].at] = bad[i].value;
		if (bb_lock_read(bytes, n, &back))
			fail_msg("byte %zu = %u was taken", bad[i].at, bad[i].value);
		bytes[bad[i].at] = was;
	}
}

static void random_bytes_change_nothing(void **state)
{
	struct watch s;
	struct sim_rng r;
	uint8_t bytes[BB_LOCK_MESSAGE_MAX];
	(void)state;

	sim_rng_seed(&r, 1, "noise", "framelock");
	begin(&s, usual(BB_LOCK_CENTRAL, N, 50));
	assert_true(bb_troupe_run(s.w, 20, 10 * SECOND));
	struct bb_framelock *lock = bb_troupe_lock(s.w, 0);
	const uint64_t frame = bb_framelock_frame(lock), bad = bb_framelock_counts(lock).bad;
	for (int i = 0; i < 100000; i++) {
		const size_t n = sim_rng_u64(&r) % sizeof(bytes);
		for (size_t k = 0; k < n; k++)
			bytes[k] = (uint8_t)sim_rng_u64(&r);
		bb_framelock_hear(lock, (uint16_t)(sim_rng_u64(&r) % 9), bytes, n, bb_troupe_local_ns(s.w, 0, bb_troupe_now_ns(s.w)));
	}
	assert_int_equal(bb_framelock_counts(lock).bad - bad, 100000);
	assert_int_equal(bb_framelock_frame(lock), frame);
	assert_true(bb_troupe_run(s.w, 40, 10 * SECOND));
	bb_troupe_destroy(s.w);
}

/* ---- all well ---- */

static void every_method_releases_every_frame_once_in_order(void **state)
{
	static const unsigned sizes[] = { 1, 2, 3, 5, 6, 7, 16, 33, 416 };
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++)
		for (size_t i = 0; i < BB_ARRAY_LEN(sizes); i++) {
			struct bb_troupe_config c = usual((enum bb_lock_method)m, sizes[i], sizes[i] > 100 ? 10 : 60);
			if (sizes[i] > 100 && m != BB_LOCK_TIMED)
				c.settle_frames = 2;
			begin(&s, c);
			if (!bb_troupe_run(s.w, c.settle_frames + c.frames, 20 * SECOND))
				fail_msg("method %d, %u nodes: stands at frame %llu", m, sizes[i], (unsigned long long)s.last_frame[0]);
			const struct bb_troupe_result r = bb_troupe_result(s.w);
			assert_int_equal(s.unordered, 0);
			assert_int_equal(s.skipped, 0);
			assert_int_equal(r.epochs, 1);
			assert_true(r.frames_lost == 0 && r.torn == 0);
			const double least = bb_barrier_messages(c.method, sizes[i]);
			if (r.messages < least - 1 || r.messages > 2.5 * least + 1)
				fail_msg("method %d, %u nodes: %g messages, least %g", m, sizes[i], r.messages, least);
			bb_troupe_destroy(s.w);
		}
}

static void skew_is_within_its_bars(void **state)
{
	static const struct {
		enum bb_lock_method method;
		double p99_us, p50_least_us; /* and no better than arithmetic allows */
	} bars[] = { { BB_LOCK_CENTRAL, 300, 100 }, { BB_LOCK_TREE, 500, 200 }, { BB_LOCK_DISSEMINATION, 500, 200 },
		     { BB_LOCK_TIMED, 20, 0 } };
	struct watch s;
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(bars); i++)
		for (uint64_t seed = 1; seed <= 5; seed++) {
			struct bb_troupe_config c = usual(bars[i].method, N, 2000);
			c.seed = seed;
			begin(&s, c);
			assert_true(bb_troupe_run(s.w, c.settle_frames + c.frames, 60 * SECOND));
			const struct bb_troupe_result r = bb_troupe_result(s.w);
			assert_int_equal(r.frames, c.frames);
			if (r.skew.p99 > bars[i].p99_us || r.skew.p50 < bars[i].p50_least_us)
				fail_msg("method %zu, seed %d: skew p50 %g p99 %g us", i, (int)seed, r.skew.p50, r.skew.p99);
			assert_true(r.torn == 0 && r.late == 0);
			bb_troupe_destroy(s.w);
		}
}

static void the_model_says_what_is_measured(void **state)
{
	static const unsigned sizes[] = { 2, 6, 16, 64 };
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_DISSEMINATION; m++)
		for (size_t i = 0; i < BB_ARRAY_LEN(sizes); i++) {
			const struct bb_troupe_config c = usual((enum bb_lock_method)m, sizes[i], 300);
			const struct bb_barrier_network net = { c.link.delay_us, c.link.jitter_us, c.link.send_us, 64 };
			begin(&s, c);
			assert_true(bb_troupe_run(s.w, c.settle_frames + c.frames, 60 * SECOND));
			const double got = bb_troupe_result(s.w).skew.p50, want = bb_barrier_skew_us(c.method, &net, sizes[i], 0.5);
			if (fabs(got - want) > 0.05 * want)
				fail_msg("method %d, %u nodes: %g us, model %g us", m, sizes[i], got, want);
			bb_troupe_destroy(s.w);
		}
}

/* Six genlocked displays on the nodes' network: every frame at one vblank number. */
static void genlocked_flips_land_on_one_vblank(void **state)
{
	static const enum bb_lock_method methods[] = { BB_LOCK_CENTRAL, BB_LOCK_TIMED };
	enum { FRAMES = 600 };
	(void)state;

	for (size_t i = 0; i < BB_ARRAY_LEN(methods); i++) {
		struct watch s;
		struct bb_troupe_config c = usual(methods[i], N, FRAMES);
		uint32_t seq[FRAMES + 200] = { 0 };
		unsigned shown = 0, apart = 0;

		begin(&s, c);
		struct rig *rig = rig_create_on(bb_troupe_clock(s.w), 3, 1);
		for (unsigned d = 0; d < N; d++) {
			struct bb_display_config config = rig->screen.display;
			config.genlock = true;
			snprintf(config.id, sizeof(config.id), "d%u", d);
			assert_int_equal(bb_display_open(&sim_display_driver, &config, &rig->open, &s.display[d]), BB_OK);
		}
		for (uint64_t frame = 20; frame <= FRAMES + c.settle_frames; frame += 20) {
			struct bb_flip flips[32];
			size_t n;
			assert_true(bb_troupe_run(s.w, frame, 5 * SECOND));
			for (unsigned d = 0; d < N; d++) {
				if (bb_display_flips(s.display[d], flips, 32, &n) < 0)
					fail();
				for (size_t k = 0; k < n; k++, shown++) {
					uint32_t *want = &seq[flips[k].frame % BB_ARRAY_LEN(seq)];
					apart += *want && *want != flips[k].seq;
					*want = flips[k].seq;
				}
			}
		}
		assert_true(shown > N * (FRAMES + c.settle_frames - 25));
		assert_int_equal(apart, 0);
		for (unsigned d = 0; d < N; d++)
			bb_display_close(s.display[d]);
		sim_world_destroy(rig->world);
		free(rig->events);
		free(rig);
		bb_troupe_destroy(s.w);
	}
}

static void nothing_depends_on_where_clocks_begin(void **state)
{
	uint64_t hash[2];
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++) {
		for (int k = 0; k < 2; k++) {
			struct watch s;
			struct bb_troupe_config c = usual((enum bb_lock_method)m, N, 200);
			c.zero_ns = k ? INT64_C(1) << 62 : 0;
			c.link.loss_ppm = 20000;
			begin(&s, c);
			s.hashing = true;
			bb_troupe_kill(s.w, 4);
			assert_true(bb_troupe_run(s.w, 60, 60 * SECOND));
			bb_troupe_revive(s.w, 4);
			assert_true(bb_troupe_run(s.w, 300, 60 * SECOND));
			hash[k] = s.hash;
			bb_troupe_destroy(s.w);
		}
		if (hash[0] != hash[1])
			fail_msg("method %d: another story at 2^62 ns", m);
	}
}

/* ---- loss ---- */

static void lost_and_repeated_messages_cost_time_only(void **state)
{
	static const double losses[] = { 0.01, 0.1, 0.33 };
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++)
		for (size_t i = 0; i < BB_ARRAY_LEN(losses); i++) {
			struct bb_troupe_config c = usual((enum bb_lock_method)m, N, 400);
			c.link.loss_ppm = losses[i] * 1e6;
			c.link.duplicate_ppm = 1e5;
			begin(&s, c);
			if (!bb_troupe_run(s.w, c.settle_frames + c.frames, 120 * SECOND))
				fail_msg("method %d, %g lost: stands at frame %llu", m, losses[i], (unsigned long long)s.last_frame[0]);
			const struct bb_troupe_result r = bb_troupe_result(s.w);
			assert_int_equal(s.unordered, 0);
			/* A stall of 3 T on top of a frame; at a third lost a node may be taken for dead once, and joins again. */
			const int64_t most_ns = (losses[i] < 0.3 || m < BB_LOCK_DISSEMINATION ? 4 : 8) * T;
			if (worst_gap(&s, 0, N - 1) > most_ns)
				fail_msg("method %d, %g lost: %g frames", m, losses[i], (double)worst_gap(&s, 0, N - 1) / (double)T);
			if (m == BB_LOCK_CENTRAL || losses[i] < 0.3)
				assert_int_equal(r.epochs, 1); /* nobody is taken for dead */
			if (m == BB_LOCK_TIMED && (r.skew.p99 > 20 || r.frames_lost > 0))
				fail_msg("%g lost: skew p99 %g us, %g vblanks lost", losses[i], r.skew.p99, r.frames_lost);
			bb_troupe_destroy(s.w);
		}
}

/* ---- death ---- */

static void a_node_killed_in_the_barrier_stops_the_others_three_frames_at_most(void **state)
{
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++)
		for (int when = 0; when < 8; when++) { /* eighths of a frame: drawing, waiting, just released */
			const unsigned dead = (unsigned)(1 + when % (N - 1));
			begin(&s, usual((enum bb_lock_method)m, N, 400));
			assert_true(bb_troupe_run(s.w, 150, 10 * SECOND));
			bb_troupe_run_for(s.w, when * T / 8);
			bb_troupe_kill(s.w, dead);
			forget_gaps(&s);
			const uint64_t frame = s.last_frame[0];
			bb_troupe_run_for(s.w, 5 * T); /* one is drawn first, and one ends */
			assert_false(bb_lock_set_has(bb_framelock_members(bb_troupe_lock(s.w, 0)), dead));
			bb_troupe_run_for(s.w, SECOND);
			s.gap_ns[dead] = 0;
			if (worst_gap(&s, 0, N - 1) > 4 * T) /* three more than the one that is usual */
				fail_msg("method %d, killed at %d/8: %g frames", m, when, (double)worst_gap(&s, 0, N - 1) / (double)T);
			assert_true(s.last_frame[0] > frame + 50);
			assert_int_equal(members_of(&s, 0), N - 1);
			assert_true(bb_lock_set_has(&s.missing, dead));
			/* Back again: within 2 s, and nobody stops for it. */
			forget_gaps(&s);
			bb_troupe_revive(s.w, dead);
			bb_troupe_run_for(s.w, 2 * SECOND);
			assert_int_equal(state_of(&s, dead), BB_LOCK_IN);
			assert_int_equal(members_of(&s, 0), N);
			assert_true(s.last_frame[dead] + 2 > s.last_frame[0]);
			s.gap_ns[dead] = 0;
			assert_true(worst_gap(&s, 0, N - 1) <= 3 * T);
			bb_troupe_destroy(s.w);
		}
}

static void a_program_that_starts_anew_before_it_was_missed_is_let_in(void **state)
{
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++) {
		begin(&s, usual((enum bb_lock_method)m, N, 400));
		assert_true(bb_troupe_run(s.w, 150, 10 * SECOND));
		bb_troupe_kill(s.w, 3);
		bb_troupe_run_for(s.w, T / 2);
		forget_gaps(&s);
		bb_troupe_revive(s.w, 3);
		bb_troupe_run_for(s.w, 2 * SECOND);
		s.gap_ns[3] = 0;
		assert_true(worst_gap(&s, 0, N - 1) <= 4 * T);
		assert_int_equal(members_of(&s, 0), N);
		assert_true(s.last_frame[3] + 2 > s.last_frame[0]);
		bb_troupe_destroy(s.w);
	}
}

static void a_dead_master_is_followed_by_the_next_in_order(void **state)
{
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++) {
		begin(&s, usual((enum bb_lock_method)m, N, 400));
		assert_true(bb_troupe_run(s.w, 150, 10 * SECOND));
		bb_troupe_kill(s.w, 0);
		forget_gaps(&s);
		bb_troupe_run_for(s.w, 2 * SECOND);
		for (unsigned i = 1; i < N; i++) {
			assert_int_equal(state_of(&s, i), BB_LOCK_IN);
			assert_int_equal(bb_framelock_master(bb_troupe_lock(s.w, i)), 1);
			assert_int_equal(members_of(&s, i), N - 1);
		}
		if (worst_gap(&s, 1, N - 1) > 7 * T)
			fail_msg("method %d: %g frames", m, (double)worst_gap(&s, 1, N - 1) / (double)T);
		bb_troupe_kill(s.w, 1); /* and the next */
		bb_troupe_run_for(s.w, 2 * SECOND);
		assert_int_equal(bb_framelock_master(bb_troupe_lock(s.w, 5)), 2);
		bb_troupe_revive(s.w, 0);
		bb_troupe_revive(s.w, 1);
		bb_troupe_run_for(s.w, 3 * SECOND);
		for (unsigned i = 0; i < N; i++) {
			assert_int_equal(bb_framelock_master(bb_troupe_lock(s.w, i)), 2); /* who was master is a node like others */
			assert_int_equal(members_of(&s, i), N);
			assert_true(s.last_frame[i] + 2 > s.last_frame[2]);
		}
		bb_troupe_destroy(s.w);
	}
}

/* ---- partition ---- */

static void the_larger_side_goes_on_and_the_other_freezes(void **state)
{
	static const struct {
		unsigned side[N];
		int goes_on; /* side; -1: none */
		unsigned master;
	} rows[] = {
		{ { 0, 0, 0, 0, 1, 1 }, 0, 0 }, { { 0, 1, 1, 1, 1, 1 }, 1, 1 }, { { 0, 1, 1, 0, 0, 1 }, 0, 0 },
		{ { 0, 1, 1, 1, 1, 0 }, 1, 1 }, { { 0, 0, 1, 1, 2, 2 }, -1, 0 },
	};
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++)
		for (size_t k = 0; k < BB_ARRAY_LEN(rows); k++) {
			begin(&s, usual((enum bb_lock_method)m, N, 400));
			assert_true(bb_troupe_run(s.w, 150, 10 * SECOND));
			for (unsigned i = 0; i < N; i++)
				bb_troupe_cut(s.w, i, rows[k].side[i]);
			bb_troupe_run_for(s.w, 2 * SECOND);
			const uint64_t at = s.last_frame[rows[k].master];
			bb_troupe_run_for(s.w, SECOND);
			for (unsigned i = 0; i < N; i++) {
				const bool on = (int)rows[k].side[i] == rows[k].goes_on;
				if ((state_of(&s, i) == BB_LOCK_IN) != on || (s.last_frame[i] > at + 50) != on)
					fail_msg("method %d, row %zu: node %u in state %d at frame %llu", m, k, i, (int)state_of(&s, i),
					         (unsigned long long)s.last_frame[i]);
			}
			for (unsigned i = 0; i < N; i++)
				bb_troupe_cut(s.w, i, 0);
			bb_troupe_run_for(s.w, 3 * SECOND);
			for (unsigned i = 0; i < N; i++)
				if (state_of(&s, i) != BB_LOCK_IN || members_of(&s, i) != N || s.last_frame[i] + 2 < s.last_frame[0] ||
				    bb_framelock_master(bb_troupe_lock(s.w, i)) != rows[k].master)
					fail_msg("method %d, row %zu: node %u is not back: state %d, frame %llu", m, k, i,
					         (int)state_of(&s, i), (unsigned long long)s.last_frame[i]);
			bb_troupe_destroy(s.w);
		}
}

/* Ten seconds of partitions, loss and a node that dies and starts anew, in any order; then peace: all are back. */
static void after_any_chaos_all_are_back(void **state)
{
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++)
		for (uint64_t seed = 1; seed <= 12; seed++) {
			struct watch s;
			struct bb_troupe_config c = usual((enum bb_lock_method)m, N, 100);
			struct sim_rng r;
			bool dead[N] = { false };
			c.seed = seed;
			begin(&s, c);
			sim_rng_seed(&r, seed, "chaos", "framelock");
			for (int k = 0; k < 60; k++) {
				const unsigned node = (unsigned)(sim_rng_u64(&r) % N), mortal = N - 1;
				const double dice = sim_rng_uniform(&r);
				bb_troupe_run_for(s.w, (int64_t)(sim_rng_uniform(&r) * 2 * 1e9 / 6));
				if (dice < 0.3 && dead[mortal]) {
					bb_troupe_revive(s.w, mortal);
					dead[mortal] = false;
				} else if (dice < 0.5) {
					bb_troupe_kill(s.w, mortal);
					dead[mortal] = true;
				} else if (dice < 0.8) {
					bb_troupe_cut(s.w, node, (unsigned)(sim_rng_u64(&r) % 3));
				} else {
					bb_troupe_loss(s.w, dice < 0.9 ? 0.3 : 0);
				}
			}
			bb_troupe_loss(s.w, 0);
			for (unsigned i = 0; i < N; i++) {
				bb_troupe_cut(s.w, i, 0);
				if (dead[i])
					bb_troupe_revive(s.w, i);
			}
			bb_troupe_run_for(s.w, 5 * SECOND);
			const uint64_t at = s.last_frame[0];
			bb_troupe_run_for(s.w, SECOND);
			for (unsigned i = 0; i < N; i++)
				if (state_of(&s, i) != BB_LOCK_IN || members_of(&s, i) != N || s.last_frame[i] < at + 50 ||
				    bb_framelock_master(bb_troupe_lock(s.w, i)) != bb_framelock_master(bb_troupe_lock(s.w, 0)))
					fail_msg("method %d, seed %d: node %u in state %d, master %u, %u members, frame %llu of %llu", m,
					         (int)seed, i, (int)state_of(&s, i), bb_framelock_master(bb_troupe_lock(s.w, i)),
					         members_of(&s, i), (unsigned long long)s.last_frame[i], (unsigned long long)at);
			bb_troupe_destroy(s.w);
		}
}

/* ---- joining ---- */

static void who_is_alone_at_first_is_joined_by_all(void **state)
{
	struct watch s;
	(void)state;

	for (int m = 0; m < BB_LOCK_METHODS; m++) {
		struct bb_troupe_config c = usual((enum bb_lock_method)m, N, 400);
		c.starts_empty = true;
		begin(&s, c);
		bb_troupe_run_for(s.w, 2 * SECOND);
		for (unsigned i = 0; i < N; i++)
			assert_int_equal(members_of(&s, i), N);
		bb_troupe_destroy(s.w);
	}
}

static void another_version_or_configuration_is_refused(void **state)
{
	struct watch s;
	(void)state;

	begin(&s, usual(BB_LOCK_CENTRAL, N, 400));
	assert_true(bb_troupe_run(s.w, 20, 10 * SECOND));
	bb_troupe_kill(s.w, 4);
	bb_troupe_kill(s.w, 5);
	bb_troupe_run_for(s.w, SECOND);
	bb_troupe_configure(s.w, 4, BB_LOCK_VERSION + 1, 0);
	bb_troupe_configure(s.w, 5, BB_LOCK_VERSION, 1);
	bb_troupe_revive(s.w, 4);
	bb_troupe_revive(s.w, 5);
	bb_troupe_run_for(s.w, SECOND);
	assert_int_equal(state_of(&s, 4), BB_LOCK_REFUSED);
	assert_int_equal(state_of(&s, 5), BB_LOCK_REFUSED);
	assert_int_equal(members_of(&s, 0), N - 2);
	assert_true(bb_framelock_counts(bb_troupe_lock(s.w, 0)).refused >= 2);
	bb_troupe_destroy(s.w);
}

/* ---- slow ---- */

static void a_slow_node_draws_coarser_and_the_wall_is_back_at_full_rate(void **state)
{
	static const enum bb_lock_method methods[] = { BB_LOCK_CENTRAL, BB_LOCK_TREE, BB_LOCK_DISSEMINATION };
	(void)state;

	for (size_t m = 0; m < BB_ARRAY_LEN(methods); m++) {
		struct bb_straggler policy;
		struct watch s;
		struct bb_troupe_config c = usual(methods[m], N, 400);
		c.draw_least = c.draw_most = 0.6;
		begin(&s, c);
		bb_straggler_init(&policy, N, T);
		s.policy = &policy;
		assert_true(bb_troupe_run(s.w, 150, 10 * SECOND));
		bb_troupe_slow(s.w, 3, 2.5); /* 1.5 frames a frame */
		const uint64_t slow = s.last_frame[0];
		assert_true(bb_troupe_run(s.w, slow + 15, 10 * SECOND));
		assert_true(s.lowered_frame && s.lowered_frame <= slow + 5);
		assert_int_equal(s.lowered_node, 3);
		forget_gaps(&s);
		const int64_t from_ns = bb_troupe_now_ns(s.w);
		assert_true(bb_troupe_run(s.w, slow + 15 + 60, 10 * SECOND));
		assert_true(bb_troupe_now_ns(s.w) - from_ns < 61 * T); /* full rate */
		assert_int_equal(s.slower_frame, 0);
		assert_true(policy.node[3].quality < 1 && policy.node[2].quality == 1);
		bb_troupe_slow(s.w, 3, 1);
		assert_true(bb_troupe_run(s.w, slow + 600, 30 * SECOND));
		assert_true(policy.node[3].quality == 1);
		bb_troupe_destroy(s.w);
	}
}

static void who_can_draw_no_coarser_slows_all_until_it_fits(void **state)
{
	struct bb_straggler s;
	(void)state;

	bb_straggler_init(&s, 3, T);
	for (int frame = 0; frame < 40; frame++) {
		bb_straggler_note(&s, 0, T / 2);
		bb_straggler_note(&s, 1, (int64_t)(7.0 * (double)T * s.node[1].quality)); /* 1.75 T at the least quality */
		bb_straggler_note(&s, 2, T / 2);
		bb_straggler_decide(&s);
	}
	assert_int_equal(s.every, 2);
	assert_true(s.node[1].quality == BB_STRAGGLER_QUALITY_LEAST && s.node[0].quality == 1);
	unsigned frames = 0;
	for (; s.every > 1 || s.node[1].quality < 1; frames++) {
		for (unsigned i = 0; i < 3; i++)
			bb_straggler_note(&s, i, T / 2);
		bb_straggler_decide(&s);
		assert_true(frames < 2000);
	}
	assert_true(frames >= BB_STRAGGLER_RECOVER);
}

static void once_late_is_no_straggler(void **state)
{
	struct bb_straggler s;
	(void)state;

	bb_straggler_init(&s, 2, T);
	for (int frame = 0; frame < 100; frame++) {
		bb_straggler_note(&s, 0, T / 2);
		bb_straggler_note(&s, 1, frame % 2 ? T / 2 : 2 * T);
		bb_straggler_note(&s, 2, 9 * T); /* nobody */
		bb_straggler_note(&s, 1000, 9 * T);
		assert_int_equal(bb_straggler_decide(&s).change, BB_STRAGGLER_NONE);
	}
}

static void ignore_send(void *ctx, uint16_t to, const void *bytes, size_t n)
{
	(void)ctx;
	(void)to;
	(void)bytes;
	(void)n;
}

static void ignore_release(void *ctx, const struct bb_lock_release *r)
{
	(void)ctx;
	(void)r;
}

/* A plan comes from a wire: one that is not about now is none, whatever else the message says. */
static void plans_far_from_now_are_none(void **state)
{
	static const struct {
		int64_t plan_ns;
		bool taken;
	} rows[] = {
		{ 0, true },          { 3500 * SECOND, true },   { -3500 * SECOND, true }, { 3700 * SECOND, false },
		{ -3700 * SECOND, false }, { INT64_MAX - SECOND, false }, { INT64_MIN, false },
	};
	struct bb_lock_config c = { .method = BB_LOCK_TIMED, .n_nodes = 2, .self = 1, .rate = { 60, 1 }, .window = 1,
		                    .send = ignore_send, .released = ignore_release };
	(void)state;

	c.members = bb_lock_set_first(2);
	bb_lock_config_times(&c, T);
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++) {
		struct bb_lock_message m = { .kind = BB_LOCK_PONG, .epoch = 1, .n_nodes = 2 };
		uint8_t bytes[BB_LOCK_MESSAGE_MAX];
		struct bb_framelock *f;
		m.u.time.t2_ns = m.u.time.t3_ns = 100000;
		m.u.time.plan_frame = 10;
		m.u.time.plan_ns = rows[i].plan_ns;
		m.u.time.plan_every = 1;
		const size_t n = bb_lock_write(&m, bytes);
		assert_int_equal(bb_framelock_create(&c, &f), BB_OK);
		bb_framelock_hear(f, 0, bytes, n, 200000);
		assert_int_equal(bb_framelock_counts(f).bad, 0);
		assert_int_equal(bb_framelock_flip_ns(f, 10) != BB_NEVER, rows[i].taken);
		bb_framelock_destroy(f);
	}
}

static void nonsense_is_refused(void **state)
{
	struct bb_lock_config c = { .n_nodes = 4, .rate = { 60, 1 }, .send = NULL };
	struct bb_framelock *f;
	(void)state;

	bb_lock_config_times(&c, T);
	assert_int_equal(bb_framelock_create(&c, &f), BB_ERR_USAGE);
	assert_null(f);
	bb_framelock_destroy(NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(messages_survive_the_wire_and_nothing_else_does),
		cmocka_unit_test(random_bytes_change_nothing),
		cmocka_unit_test(every_method_releases_every_frame_once_in_order),
		cmocka_unit_test(skew_is_within_its_bars),
		cmocka_unit_test(the_model_says_what_is_measured),
		cmocka_unit_test(genlocked_flips_land_on_one_vblank),
		cmocka_unit_test(nothing_depends_on_where_clocks_begin),
		cmocka_unit_test(lost_and_repeated_messages_cost_time_only),
		cmocka_unit_test(a_node_killed_in_the_barrier_stops_the_others_three_frames_at_most),
		cmocka_unit_test(a_program_that_starts_anew_before_it_was_missed_is_let_in),
		cmocka_unit_test(a_dead_master_is_followed_by_the_next_in_order),
		cmocka_unit_test(the_larger_side_goes_on_and_the_other_freezes),
		cmocka_unit_test(after_any_chaos_all_are_back),
		cmocka_unit_test(who_is_alone_at_first_is_joined_by_all),
		cmocka_unit_test(another_version_or_configuration_is_refused),
		cmocka_unit_test(a_slow_node_draws_coarser_and_the_wall_is_back_at_full_rate),
		cmocka_unit_test(who_can_draw_no_coarser_slows_all_until_it_fits),
		cmocka_unit_test(once_late_is_no_straggler),
		cmocka_unit_test(plans_far_from_now_are_none),
		cmocka_unit_test(nonsense_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
