/* tests/test_sim_world.c: the generator, the sync reference, the viewer's body, the register, determinism. */
#include "tests/fixture_room.h"
#include "sim/sim_camera.h"
#include "sim/sim_display.h"
#include "sim/sim_shutter.h"

static void the_generator_is_the_published_one(void **state)
{
	/* First outputs of xoshiro256** from state { 1, 2, 3, 4 }. */
	static const uint64_t want[] = { UINT64_C(11520), UINT64_C(0), UINT64_C(1509978240),
		                         UINT64_C(1215971899390074240) };
	struct sim_rng r = { { 1, 2, 3, 4 }, false, 0 };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(want); i++)
		assert_true(sim_rng_u64(&r) == want[i]);
}

static void normal_draws_are_normal(void **state)
{
	enum { N = 200000 };
	double sum = 0, square = 0, cube = 0, fourth = 0;
	int beyond2 = 0;
	struct sim_rng r;

	(void)state;
	sim_rng_seed(&r, 7, "test", "normal");
	for (int i = 0; i < N; i++) {
		const double z = sim_rng_normal(&r);
		sum += z;
		square += z * z;
		cube += z * z * z;
		fourth += z * z * z * z;
		beyond2 += fabs(z) > 2;
	}
	assert_true(fabs(sum / N) < 5 / sqrt(N));
	assert_true(fabs(square / N - 1) < 5 * sqrt(2.0 / N));
	assert_true(fabs(cube / N) < 5 * sqrt(15.0 / N));
	assert_true(fabs(fourth / N - 3) < 5 * sqrt(96.0 / N));
	assert_true(fabs(beyond2 / (double)N - 0.0455) < 0.0025);
}

/* The polar method once more with libm's log: the home-made one must agree to its last digits. */
static void the_logarithm_is_one(void **state)
{
	struct sim_rng r, copy;

	(void)state;
	sim_rng_seed(&r, 11, "test", "log");
	copy = r;
	for (int i = 0; i < 20000; i += 2) {
		double u, v, s;
		do {
			u = 2 * sim_rng_uniform(&copy) - 1;
			v = 2 * sim_rng_uniform(&copy) - 1;
			s = u * u + v * v;
		} while (s >= 1 || s <= 0);
		const double f = sqrt(-2 * log(s) / s), a = sim_rng_normal(&r), b = sim_rng_normal(&r);
		assert_true(fabs(a - u * f) <= 1e-13 * fabs(u * f) && fabs(b - v * f) <= 1e-13 * fabs(v * f));
	}
}

static void seeds_classes_ids_and_events_differ(void **state)
{
	struct sim_rng r[5];
	uint64_t v[6];

	(void)state;
	sim_rng_seed(&r[0], 1, "camera", "c1");
	sim_rng_seed(&r[1], 2, "camera", "c1");
	sim_rng_seed(&r[2], 1, "camera", "c2");
	sim_rng_seed(&r[3], 1, "camer", "ac1");
	sim_rng_seed(&r[4], 1, "camera", "c1");
	struct sim_rng event = sim_rng_at(&r[0], 0), next = sim_rng_at(&r[0], 1);
	v[4] = sim_rng_u64(&event);
	v[5] = sim_rng_u64(&next);
	for (int i = 0; i < 4; i++)
		v[i] = sim_rng_u64(&r[i]);
	assert_true(sim_rng_u64(&r[4]) == v[0]);
	for (int i = 0; i < 6; i++)
		for (int j = 0; j < i; j++)
			assert_true(v[i] != v[j]);
}

static void sync_edges_come_from_their_number(void **state)
{
	struct rig r;

	(void)state;
	rig_init(&r, 1, 1);
	const int64_t zero_ns = sim_world_sync_ns(r.world, 0);
	assert_true(zero_ns >= 0 && zero_ns < 8333334);
	/* 12 ppm fast: after 10^6 edges 100 ms early, to the ns. */
	const int64_t ideal_ns = bb_rate_frame_ns((struct bb_rate){ 120, 1 }, 1000000);
	const int64_t true_ns = sim_world_sync_ns(r.world, 1000000) - zero_ns;
	assert_true(llabs(true_ns - (int64_t)((double)ideal_ns / (1 + 12e-6))) <= 1);
	for (int64_t n = 0; n < 5000; n += 7) {
		const int64_t at_ns = sim_world_sync_ns(r.world, n);
		assert_int_equal(sim_world_sync_after(r.world, at_ns), at_ns);
		assert_int_equal(sim_world_sync_after(r.world, at_ns + 1), sim_world_sync_ns(r.world, n + 1));
		assert_int_equal(sim_world_reference_after(r.world, (struct bb_rate){ 120, 1 }, at_ns), n);
	}
	/* Rates that divide each other share instants. */
	for (int64_t n = 0; n < 1000; n++)
		assert_int_equal(sim_world_reference_ns(r.world, (struct bb_rate){ 60, 1 }, n),
		                 sim_world_sync_ns(r.world, 2 * n));
	rig_done(&r);
}

static void a_rate_change_bends_time_without_a_jump(void **state)
{
	const struct bb_rate rate = { 120, 1 };
	struct rig r;

	(void)state;
	rig_init(&r, 1, 1);
	const int64_t before_ns = sim_world_sync_ns(r.world, 100);
	assert_int_equal(sim_world_set_sync_error(r.world, BB_NS_PER_S, -8333333), BB_OK); /* 119 Hz */
	assert_int_equal(sim_world_set_sync_error(r.world, 2 * BB_NS_PER_S, 12000), BB_OK);
	assert_int_equal(sim_world_set_sync_error(r.world, BB_NS_PER_S, 0), BB_ERR_USAGE); /* not back in time */
	assert_int_equal(sim_world_set_sync_error(r.world, 3 * BB_NS_PER_S, -BB_NS_PER_S), BB_ERR_RANGE);
	assert_int_equal(sim_world_sync_ns(r.world, 100), before_ns);
	int in_second[3] = { 0 };
	for (int64_t k = 0, last_ns = -1; k < 358; k++) {
		const int64_t at_ns = sim_world_sync_ns(r.world, k);
		assert_true(at_ns > last_ns);
		assert_int_equal(sim_world_reference_after(r.world, rate, at_ns), k);
		last_ns = at_ns;
		if (at_ns < 3 * BB_NS_PER_S)
			in_second[at_ns / BB_NS_PER_S]++;
	}
	assert_true(in_second[0] == 120 || in_second[0] == 121);
	assert_int_equal(in_second[1], 119);
	rig_done(&r);
}

static void without_a_chain_the_displays_set_the_rate(void **state)
{
	struct rig r = { 0 };

	(void)state;
	fixture_room_init(&r.fix);
	r.fix.room.has_chain = false;
	r.fix.screens[0].display.rate = (struct bb_rate){ 60, 1 };
	rig_world(&r, 1, 1);
	assert_int_equal(sim_world_sync_rate(r.world).num, 60);
	assert_int_equal(sim_world_sync_error_ppb(r.world), 0);
	rig_done(&r);
}

struct walk {
	double yaw_deg;
};

static struct bb_pose walk(void *ctx, int64_t t_ns)
{
	const struct walk *w = ctx;

	return (struct bb_pose){ { (double)t_ns * 1e-9, 1.6, 0 }, bb_quat_euler_deg(w->yaw_deg, 0, 0) };
}

static void the_glasses_sit_on_the_eyes(void **state)
{
	struct walk w = { 30 };
	struct bb_vec3 marker[8];
	struct rig r;

	(void)state;
	rig_init(&r, 1, 1);
	assert_true(bb_vec3_norm(bb_vec3_sub(sim_world_head(r.world, 5).p, r.fix.room.neutral)) == 0);
	sim_world_set_head_fn(r.world, walk, &w);
	sim_world_set_scene_start(r.world, BB_NS_PER_S);
	assert_true(fabs(sim_world_head(r.world, 3 * BB_NS_PER_S).p.x - 2) < 1e-12); /* scene time */
	const struct bb_pose head = sim_world_head(r.world, 2 * BB_NS_PER_S),
			     body = sim_world_body(r.world, 0, 2 * BB_NS_PER_S);
	const struct bb_vec3 eye = bb_pose_apply(&body, r.fix.room.bodies[0].eye_centre);
	assert_true(bb_vec3_norm(bb_vec3_sub(eye, head.p)) < 1e-12);
	assert_int_equal(sim_world_markers(r.world, 2 * BB_NS_PER_S, marker, 8), 5);
	assert_int_equal(sim_world_markers(r.world, 2 * BB_NS_PER_S, marker, 3), 3);
	for (int i = 0; i < 3; i++)
		assert_true(bb_vec3_norm(
				    bb_vec3_sub(marker[i], bb_pose_apply(&body, r.fix.room.bodies[0].marker[i]))) == 0);
	rig_done(&r);
}

static void the_head_hides_only_what_is_behind_it(void **state)
{
	struct bb_vec3 marker[8];
	struct rig r;

	(void)state;
	rig_init(&r, 1, 1);
	const size_t n = sim_world_markers(r.world, 0, marker, 8);
	for (size_t i = 0; i < n; i++) { /* the viewer looks along -Z */
		assert_true(sim_world_visible(r.world, (struct bb_vec3){ 0, 1.6, -2 }, marker[i], 0));
		assert_true(sim_world_visible(r.world, (struct bb_vec3){ 1.2, 2.4, -1.2 }, marker[i], 0));
		assert_false(sim_world_visible(r.world, (struct bb_vec3){ 0, 1.5, 2 }, marker[i], 0));
	}
	/* From behind and below, the torso is in the way of a hand held in front of the belly. */
	const struct bb_vec3 hand = { 0, 1.1, -0.4 };
	assert_false(sim_world_visible(r.world, (struct bb_vec3){ 0, 1.2, 2 }, hand, 0));
	assert_true(sim_world_visible(r.world, (struct bb_vec3){ 2, 1.2, 0 }, hand, 0));
	rig_done(&r);
}

static void an_open_door_hides_what_is_behind_it(void **state)
{
	struct bb_wall wall = { .id = "back", .corners = { { 1.5, 0, 1.5 }, { -1.5, 0, 1.5 }, { 1.5, 2.4, 1.5 } }, .columns = 3,
		                .rows = 2, .door_column = 1, .door_columns = 1, .door_rows = 1 };
	const struct bb_vec3 a = { 0, 1, 1 }, b = { 1, 1, 1 }, above = { 0, 2, 1 }, above_b = { 1, 2, 1 }, past = { 0, 1, 0.4 };
	struct rig r;

	(void)state;
	rig_init(&r, 1, 1);
	r.fix.room.n_walls = 1;
	r.fix.room.walls = &wall;
	rig_fault(&r, "world/viewer", "leave", true);
	assert_true(sim_world_visible(r.world, a, b, 0)); /* shut, it is the wall */
	rig_fault(&r, "world/viewer", "door deg=90", true); /* 1 m wide, 1.2 m high, along x = 0.5 from z = 1.5 to 0.5 */
	assert_false(sim_world_visible(r.world, a, b, 0));
	assert_false(sim_world_visible(r.world, b, a, 0));
	assert_true(sim_world_visible(r.world, above, above_b, 0));
	assert_true(sim_world_visible(r.world, past, (struct bb_vec3){ 1, 1, 0.4 }, 0));
	assert_true(sim_world_visible(r.world, a, past, 0)); /* along it */
	rig_fault(&r, "world/viewer", "door deg=90", false);
	assert_true(sim_world_visible(r.world, a, b, 0));
	r.fix.room.n_walls = 0;
	rig_done(&r);
}

static void badly_measured_markers_still_stick_out(void **state)
{
	struct bb_vec3 marker[8];
	struct rig r = { 0 };

	(void)state;
	fixture_room_init(&r.fix);
	r.fix.room.bodies[0].eye_centre.z = -0.02; /* eyes in front of the markers: inside the nominal head */
	rig_world(&r, 1, 1);
	const size_t n = sim_world_markers(r.world, 0, marker, 8);
	for (size_t i = 0; i < n; i++)
		assert_true(sim_world_visible(r.world, (struct bb_vec3){ 0.1, 1.8, -2 }, marker[i], 0));
	rig_done(&r);
}

static void the_register_finds_and_forgets(void **state)
{
	static const struct sim_verb none[] = { { NULL, NULL, NULL, NULL, NULL } };
	const struct sim_verb *verbs = NULL;
	int device[40];
	struct rig r;

	(void)state;
	rig_init(&r, 1, 1);
	for (int i = 0; i < 40; i++) {
		char id[8];
		snprintf(id, sizeof(id), "d%d", i);
		assert_int_equal(sim_world_register(r.world, "display", id, &device[i], none), BB_OK);
		assert_int_equal(sim_world_register(r.world, "display", id, &device[i], none), BB_ERR_BUSY);
	}
	assert_ptr_equal(sim_world_find(r.world, "display", "d7", &verbs), &device[7]);
	assert_ptr_equal(verbs, none);
	sim_world_unregister(r.world, &device[7]);
	assert_null(sim_world_find(r.world, "display", "d7", NULL));
	assert_null(sim_world_find(r.world, "camera", "d8", NULL));
	assert_ptr_equal(sim_world_find(r.world, "display", "d39", NULL), &device[39]);
	assert_non_null(sim_world_find(r.world, "node", "left", NULL));
	rig_done(&r);
}

static void mains(void **state)
{
	struct rig r;

	(void)state;
	rig_init(&r, 1, 1);
	assert_true(sim_world_fed(r.world, "pdu1/2"));
	sim_world_set_fed(r.world, "pdu1/2", false);
	sim_world_set_fed(r.world, "pdu1/2", false);
	sim_world_set_fed(r.world, "pdu1/3", false);
	assert_false(sim_world_fed(r.world, "pdu1/2"));
	sim_world_set_fed(r.world, "pdu1/2", true);
	assert_true(sim_world_fed(r.world, "pdu1/2"));
	assert_false(sim_world_fed(r.world, "pdu1/3"));
	rig_done(&r);
}

/* A second of everything; order: which of the devices opens first. */
static void live(struct rig *r, uint64_t seed, int order)
{
	struct bb_shutter *sh = NULL;
	struct bb_camera *cam[2] = { NULL, NULL };
	struct bb_display *d[2] = { NULL, NULL };
	struct bb_link *l = NULL;

	rig_init(r, seed, 1);
	for (int i = 0; i < 6; i++) {
		switch (order ? 5 - i : i) {
		case 0: sh = rig_shutter(r); break;
		case 1: cam[0] = rig_camera(r, 0); break;
		case 2: cam[1] = rig_camera(r, 1); break;
		case 3: d[0] = rig_display(r, 0); break;
		case 4: d[1] = rig_display(r, 2); break;
		default: l = rig_link(r); break;
		}
	}
	if (!order)
		assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	assert_int_equal(bb_camera_start(cam[order]), BB_OK);
	assert_int_equal(bb_camera_start(cam[!order]), BB_OK);
	if (order)
		assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	for (uint64_t f = 0; f < 40; f++) {
		rig_run(r, 25 * MS);
		for (int i = 0; i < 2; i++) /* a target that has passed: the next vblank */
			assert_int_equal(bb_display_present(d[i], f, BB_EYE_NONE, 0), BB_OK);
		assert_int_equal(bb_link_send(l, 0, BB_LINK_ALL, &f, sizeof(f)), BB_OK);
	}
	bb_shutter_close(sh);
	for (int i = 0; i < 2; i++) {
		bb_camera_close(cam[i]);
		bb_display_close(d[i]);
	}
	bb_link_close(l);
	bb_eventlog_flush(r->log);
}

static bool same_log(const struct rig *a, const struct rig *b)
{
	return a->n_events == b->n_events && !memcmp(a->event, b->event, a->n_events * sizeof(*a->event));
}

static void same_seed_same_bytes(void **state)
{
	struct rig a, b, c;

	(void)state;
	live(&a, 5, 0);
	live(&b, 5, 0);
	live(&c, 6, 0);
	assert_true(a.n_events > 700);
	assert_true(same_log(&a, &b));
	assert_false(same_log(&a, &c));
	rig_done(&a);
	rig_done(&b);
	rig_done(&c);
}

/* The events of one source by name, with the source number left out. */
static size_t events_of(const struct rig *r, const char *name, struct bb_event *out)
{
	size_t n = 0;

	for (size_t i = 0; i < r->n_events; i++)
		if (!strcmp(r->log->names[r->event[i].source], name)) {
			out[n] = r->event[i];
			out[n++].source = 0;
		}
	return n;
}

static void order_of_opening_changes_no_device(void **state)
{
	static const char *const names[] = { "shutter/chain", "camera/c1",    "camera/c2",
		                             "display/front", "display/desk", "link/net" };
	static struct bb_event ea[2000], eb[2000];
	struct rig a, b;

	(void)state;
	live(&a, 5, 0);
	live(&b, 5, 1);
	for (size_t i = 0; i < BB_ARRAY_LEN(names); i++) {
		const size_t n = events_of(&a, names[i], ea);
		assert_true(n >= 39);
		assert_int_equal(events_of(&b, names[i], eb), n);
		assert_memory_equal(ea, eb, n * sizeof(*ea));
	}
	rig_done(&a);
	rig_done(&b);
}

static int64_t block(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	const int64_t end_ns = bb_clock_stopwatch_ns() + 60 * MS;

	(void)timer;
	(void)scheduled_ns;
	(void)now_ns;
	while (bb_clock_stopwatch_ns() < end_ns)
		;
	return BB_NEVER;
}

/* On the posix clock steps run late (here one of the loop's blocks for 60 ms): what happened meanwhile is still reported,
 * in order and with the times at which it happened. */
static void late_steps_lose_nothing(void **state)
{
	struct bb_timer blocker = { .step = block, .rank = 3 };
	struct bb_shutter_edge e[256], last = { 0 };
	struct bb_blob blobs[64];
	struct bb_camera_frame frame = { .blobs = blobs, .cap = 64 };
	struct rig r = { 0 };
	uint32_t frames = 0;
	size_t n, edges = 0;

	(void)state;
	fixture_room_init(&r.fix);
	assert_int_equal(bb_clock_posix_create(&r.clk), BB_OK);
	rig_world(&r, 1, 1);
	struct bb_shutter *sh = rig_shutter(&r);
	struct bb_camera *cam = rig_camera(&r, 0);
	assert_int_equal(bb_shutter_set_mode(sh, BB_SHUTTER_STEREO), BB_OK);
	assert_int_equal(bb_camera_start(cam), BB_OK);
	const int64_t start_ns = bb_clock_now_ns(r.clk);
	assert_int_equal(bb_clock_arm(r.clk, &blocker, start_ns + 40 * MS), BB_OK);
	bb_clock_run_until(r.clk, start_ns + 200 * MS);
	for (; bb_camera_read(cam, &frame) == BB_OK; frames++)
		assert_int_equal(frame.seq, frames);
	assert_true(frames >= 10);
	assert_int_equal(bb_shutter_read(sh, e, BB_ARRAY_LEN(e), &n), BB_OK);
	for (size_t i = 0; i < n; i++) {
		if (e[i].stage)
			continue;
		assert_true(!edges || e[i].seq == last.seq + 1);
		assert_true(!edges || llabs(e[i].at_ns - last.at_ns - 8333333) < 30 * US);
		last = e[i];
		edges++;
	}
	assert_true(edges >= 22);
	bb_shutter_close(sh);
	bb_camera_close(cam);
	rig_done(&r);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_generator_is_the_published_one),
		cmocka_unit_test(normal_draws_are_normal),
		cmocka_unit_test(the_logarithm_is_one),
		cmocka_unit_test(seeds_classes_ids_and_events_differ),
		cmocka_unit_test(sync_edges_come_from_their_number),
		cmocka_unit_test(a_rate_change_bends_time_without_a_jump),
		cmocka_unit_test(without_a_chain_the_displays_set_the_rate),
		cmocka_unit_test(the_glasses_sit_on_the_eyes),
		cmocka_unit_test(the_head_hides_only_what_is_behind_it),
		cmocka_unit_test(an_open_door_hides_what_is_behind_it),
		cmocka_unit_test(badly_measured_markers_still_stick_out),
		cmocka_unit_test(the_register_finds_and_forgets),
		cmocka_unit_test(mains),
		cmocka_unit_test(same_seed_same_bytes),
		cmocka_unit_test(order_of_opening_changes_no_device),
		cmocka_unit_test(late_steps_lose_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
