/*
 * tests/test_faults_camera.c: rows K1-K3, K7 and K8 of the fault matrix, injected at the far end of the wire. Each is
 * detected and left within its budget, in virtual time, and the frame loop (a read every millisecond) never waits.
 */
#include "tests/fixture_room.h"
#include "tests/fault_table.h"
#include "tests/fixture_camera_usb.h"
#include "drivers/camera_usb_time.h"
#include "sim/sim_camera.h"

#define PERIOD_NS INT64_C(16666667)

struct bench {
	struct rig rig;
	struct usb_rig usb;
	struct bb_camera *cam;
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	struct bb_camera_frame frame;
	enum bb_status last;
	int64_t last_frame_ns;
	size_t n_blobs; /* of the last frame */
};

static const struct camera_usb_health *health(const struct bench *b)
{
	return camera_usb_health(b->cam);
}

static void open_with(struct bench *b, const struct peer_camera_options *options, const char *uri)
{
	memset(b, 0, sizeof(*b));
	rig_init(&b->rig, 3, 1);
	usb_rig_open(&b->usb, &b->rig, 0, options, uri, &b->cam);
	b->frame = (struct bb_camera_frame){ .blobs = b->blobs, .cap = BB_ARRAY_LEN(b->blobs) };
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
}

static int setup(void **state)
{
	static struct bench bench;
	const struct peer_camera_options options = { .serial = "K", .stamped = true };

	open_with(&bench, &options, "usb:131d:0157?stamps=device");
	*state = &bench;
	return 0;
}

static int teardown(void **state)
{
	struct bench *b = *state;

	usb_rig_close(&b->usb, b->cam);
	rig_done(&b->rig);
	return 0;
}

static int64_t now(const struct bench *b)
{
	return bb_clock_now_ns(b->rig.clk);
}

/* One turn of the frame loop, 1 ms. */
static void turn(struct bench *b)
{
	rig_run(&b->rig, MS);
	const int64_t before_ns = now(b);
	do {
		b->last = bb_camera_read(b->cam, &b->frame);
		if (b->last == BB_OK) {
			b->last_frame_ns = now(b);
			b->n_blobs = b->frame.n;
		}
	} while (b->last == BB_OK);
	assert_int_equal(now(b), before_ns); /* it did not wait */
}

static void turns(struct bench *b, int n)
{
	while (n--)
		turn(b);
}

/* Turns until the driver names this fault ("" none); how long it took. */
static int64_t until_fault(struct bench *b, const char *fault, int64_t most_ns)
{
	const int64_t from_ns = now(b);

	while (strcmp(health(b)->fault, fault)) {
		if (now(b) - from_ns > most_ns)
			fail_msg("no \"%s\" within %.1f ms: it says \"%s\", %s", fault, (double)most_ns * 1e-6,
			         health(b)->fault, bb_camera_device(b->cam)->last_error.detail);
		turn(b);
	}
	return now(b) - from_ns;
}

static void row(const char *name, const char *injected, const char *reported, int64_t detected_ns, int64_t recovered_ns)
{
	fault_row(name, injected, reported, detected_ns, -1, recovered_ns);
}

static void k1_frames_are_lost(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	assert_string_equal(health(b)->fault, "");
	assert_int_equal(health(b)->health, BB_HEALTH_OK);
	peer_camera_world_drop(b->usb.peer, 1);
	const int64_t from_ns = b->last_frame_ns + PERIOD_NS; /* when the lost one was due */
	until_fault(b, "CAM_DROP", 2 * PERIOD_NS);
	const int64_t detected_ns = now(b) - from_ns;
	assert_true(detected_ns <= PERIOD_NS * 3 / 2);
	assert_int_equal(health(b)->lost, 1);
	assert_non_null(strstr(bb_camera_device(b->cam)->last_error.detail, "CAM_DROP: 1 missing"));
	assert_int_equal(health(b)->health, BB_HEALTH_DEGRADED);
	row("K1", "one frame never sent", "CAM_DROP", detected_ns, until_fault(b, "", 500 * MS));
}

static void k1_a_share_is_lost(void **state)
{
	static const int percents[] = { 1, 5, 20 };
	struct bench *b = *state;

	for (size_t i = 0; i < BB_ARRAY_LEN(percents); i++) {
		char verb[32];
		const uint64_t frames = health(b)->frames, lost = health(b)->lost;
		snprintf(verb, sizeof(verb), "drop percent=%d", percents[i]);
		rig_fault(&b->rig, "camera/c1", verb, true);
		turns(b, 20000);
		rig_fault(&b->rig, "camera/c1", verb, false);
		const double n = (double)(health(b)->frames - frames), m = (double)(health(b)->lost - lost);
		const double share = 100 * m / (n + m), sd = 100 * sqrt(percents[i] / 100.0 / (n + m));
		assert_true(fabs(share - percents[i]) < 5 * sd);
		print_message("[          ] %d %% dropped: the driver counts %.2f %%\n", percents[i], share);
	}
	until_fault(b, "", 500 * MS);
}

static void wrap(struct bench *b, const struct peer_camera_options *options)
{
	int64_t last_ns = 0;
	uint32_t seq = 0;

	open_with(b, options, "usb:131d:0157?stamps=device");
	for (int i = 0; i < 300; i++) {
		do
			rig_run(&b->rig, 100 * US);
		while (bb_camera_read(b->cam, &b->frame) != BB_OK);
		const int64_t step_ns = b->frame.mid_exposure.ns - last_ns;
		assert_true(!i || llabs(step_ns - PERIOD_NS) <= 20 * US);
		assert_int_equal(b->frame.seq, seq++);
		last_ns = b->frame.mid_exposure.ns;
	}
	assert_string_equal(health(b)->fault, "");
	assert_int_equal(health(b)->bad, 0);
}

/* Where the model's own counter stands is its seed's; the wrap is put two seconds ahead of it. 300 frames also wrap the
 * USB frame number twice and the 8-bit packet number once. */
static void k2_counters_wrap(void **state)
{
	static struct bench b;
	struct peer_camera_options options = { .serial = "K", .stamped = true };

	(void)state;
	open_with(&b, &options, "usb:131d:0157?stamps=device");
	options.clock_us = 0u - (uint32_t)(sim_camera_stamp(b.usb.model, 0).ns / 1000) - 2000000u;
	options.counter = 0u - 100u;
	usb_rig_close(&b.usb, b.cam);
	rig_done(&b.rig);
	wrap(&b, &options);
	assert_true(b.frame.mid_exposure.ns > INT64_C(0x100000000) * US);
	row("K2", "32-bit us, counter, USB frame wrap", "(none)", 0, 0);
	usb_rig_close(&b.usb, b.cam);
	rig_done(&b.rig);
}

/* The numbers of a camera without counters have 8 bits: the clock says how often they wrapped. */
static void k2_eight_bits_and_a_long_gap(void **state)
{
	static const uint32_t gaps[] = { 1, 2, 200, 255, 256, 257, 300, 1000, 65536, 216000 };
	struct camera_usb_time t = { .period_ns = PERIOD_NS, .least_latency_ns = 3 * MS, .jitter_ns = 400 * US };
	struct camera_usb_mark mark = { .arrived_ns = BB_NS_PER_S };
	uint32_t lost, seq = 0;

	(void)state;
	assert_true(camera_usb_time_add(&t, &mark, &lost));
	for (size_t i = 0; i < BB_ARRAY_LEN(gaps); i++) {
		mark.counter = (mark.counter + gaps[i]) & 0xFF;
		mark.arrived_ns += gaps[i] * PERIOD_NS + (i & 1 ? 300 * US : -300 * US);
		seq += gaps[i];
		assert_true(camera_usb_time_add(&t, &mark, &lost));
		assert_int_equal(t.seq, seq);
		assert_int_equal(lost, gaps[i] - 1);
		assert_true(llabs(t.stamp_ns - (mark.arrived_ns - 3 * MS)) <= 800 * US);
	}
	for (int i = 0; i < 20; i++) { /* an hour away, and a clock that is up to 50 frames wrong by then */
		mark.counter = (mark.counter + 216000u + (uint32_t)i) & 0xFF;
		mark.arrived_ns += (216000 + i + (i & 1 ? 50 : -50)) * PERIOD_NS;
		seq += 216000u + (uint32_t)i;
		assert_true(camera_usb_time_add(&t, &mark, &lost));
		assert_int_equal(t.seq, seq);
	}
	assert_false(camera_usb_time_add(&t, &mark, &lost)); /* the same again */
	assert_int_equal(t.seq, seq);
}

static void k3_blind(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	assert_true(b->n_blobs > 0);
	const int64_t from_ns = now(b);
	rig_fault(&b->rig, "camera/c1", "cover", true);
	until_fault(b, "CAM_BLIND", 7 * PERIOD_NS);
	const int64_t detected_ns = now(b) - from_ns;
	assert_true(detected_ns <= 6 * PERIOD_NS); /* five frames, the first of which may be on its way */
	turns(b, 300);
	assert_string_equal(health(b)->fault, "CAM_BLIND");
	rig_fault(&b->rig, "camera/c1", "cover", false);
	const int64_t recovered_ns = until_fault(b, "", 12 * PERIOD_NS);
	assert_true(recovered_ns >= 9 * PERIOD_NS);
	row("K3", "lens covered", "CAM_BLIND", detected_ns, recovered_ns);
}

static void unplug(struct bench *b, size_t from, size_t to, bool first)
{
	turns(b, 200);
	const uint32_t seq = b->frame.seq;
	const int64_t stamp_ns = b->frame.mid_exposure.ns, seen_ns = b->frame.arrived_ns;
	bus_sim_usb_unplug(&b->usb.host, from);
	const int64_t detected_ns = until_fault(b, "CAM_GONE", 100 * MS);
	assert_int_equal(b->last, BB_ERR_LOST);
	assert_int_equal(health(b)->health, BB_HEALTH_LOST);
	turns(b, 3000);
	assert_int_equal(b->last, BB_ERR_LOST);
	assert_true(bus_sim_usb_plug(&b->usb.host, to, peer_camera_usb(b->usb.peer)));
	const int64_t at_ns = now(b);
	const uint64_t frames = health(b)->frames;
	while (health(b)->frames == frames && now(b) - at_ns < BB_NS_PER_S)
		turn(b);
	const int64_t recovered_ns = now(b) - at_ns;
	assert_true(health(b)->frames > frames);
	until_fault(b, "", 500 * MS);
	/* The same camera: numbers and stamps go on, the gap is as long as it was. */
	assert_true(b->frame.seq > seq);
	const int64_t gap_ns = b->frame.mid_exposure.ns - stamp_ns - (b->frame.arrived_ns - seen_ns);
	assert_true(llabs(gap_ns) < MS);
	assert_int_equal(peer_camera_lamps(b->usb.peer), true);
	if (first)
		row("K7", "unplugged, back on another port", "CAM_GONE", detected_ns, recovered_ns);
}

static void k7_unplug_and_replug(void **state)
{
	struct bench *b = *state;

	unplug(b, 2, 5, true);
	unplug(b, 5, 5, false);
	unplug(b, 5, 1, false);
	assert_int_equal(health(b)->reopens, 3);
	assert_int_equal(health(b)->bad, 0); /* counters that began again are no damage */
	assert_string_equal(health(b)->serial, "K");
}

/* Another camera of the same kind in its place is not taken for it. */
static void k7_identity_is_the_serial(void **state)
{
	struct bench *b = *state;
	const struct peer_camera_options other = { .serial = "OTHER", .stamped = true };
	struct bb_camera *model = rig_camera(&b->rig, 1);
	struct peer_camera *peer;

	assert_int_equal(peer_camera_create(model, &other, &peer), BB_OK);
	turns(b, 200);
	bus_sim_usb_unplug(&b->usb.host, 2);
	assert_true(bus_sim_usb_plug(&b->usb.host, 2, peer_camera_usb(peer)));
	turns(b, 2000);
	assert_int_equal(b->last, BB_ERR_LOST);
	assert_string_equal(health(b)->fault, "CAM_GONE");
	assert_true(bus_sim_usb_plug(&b->usb.host, 3, peer_camera_usb(b->usb.peer)));
	until_fault(b, "", BB_NS_PER_S);
	peer_camera_destroy(peer);
	bb_camera_close(model);
}

static void k7_unplugged_mid_packet(void **state)
{
	const struct peer_camera_options options = { .serial = "K", .stamped = true, .most_in_bytes = 64 };
	static struct bench b;

	(void)state;
	open_with(&b, &options, "usb:131d:0157?stamps=device");
	turns(&b, 300);
	assert_true(health(&b)->frames > 10); /* several transfers a packet */
	while (bb_camera_read(b.cam, &b.frame) != BB_TIMEOUT)
		;
	rig_run(&b.rig, 20 * MS);
	assert_true(sim_usb_transfer(peer_camera_usb(b.usb.peer), 0x82, (uint8_t[64]){ 0 }, 64) == 64);
	bus_sim_usb_unplug(&b.usb.host, 2);
	until_fault(&b, "CAM_GONE", 100 * MS);
	assert_true(bus_sim_usb_plug(&b.usb.host, 4, peer_camera_usb(b.usb.peer)));
	until_fault(&b, "", BB_NS_PER_S);
	usb_rig_close(&b.usb, b.cam);
	rig_done(&b.rig);
}

static void k7_flapping_is_quarantined(void **state)
{
	struct bench *b = *state;

	for (int i = 0; i < 6; i++) {
		bus_sim_usb_unplug(&b->usb.host, 2);
		turns(b, 50);
		assert_true(bus_sim_usb_plug(&b->usb.host, 2, peer_camera_usb(b->usb.peer)));
		turns(b, 400);
	}
	assert_string_equal(health(b)->fault, "QUARANTINED");
	assert_int_equal(b->last, BB_ERR_LOST);
	turns(b, 120000);
	assert_string_equal(health(b)->fault, "QUARANTINED");
	assert_int_equal(bb_camera_stop(b->cam), BB_ERR_LOST);
	assert_int_equal(bb_camera_start(b->cam), BB_OK); /* by hand */
	until_fault(b, "", BB_NS_PER_S);
}

static void k8_one_stall(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	peer_camera_world_stall(b->usb.peer, 1);
	const int64_t detected_ns = until_fault(b, "USB_ERR", 2 * MS);
	assert_int_equal(health(b)->stalls, 1);
	assert_int_equal(health(b)->resets, 0);
	assert_non_null(strstr(bb_camera_device(b->cam)->last_error.detail, "USB_ERR"));
	row("K8", "endpoint stalls once", "USB_ERR", detected_ns, until_fault(b, "", 500 * MS));
	assert_int_equal(health(b)->resets, 0);
}

static void k8_stalls_need_resets(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	peer_camera_world_stall(b->usb.peer, 4);
	const int64_t detected_ns = until_fault(b, "USB_ERR", 2 * MS);
	row("K8", "stalls again after each cure, 4x", "USB_ERR", detected_ns, until_fault(b, "", BB_NS_PER_S));
	assert_int_equal(health(b)->resets, 3);
	assert_true(peer_camera_streams(b->usb.peer));
}

static void k8_stalls_for_ever(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	peer_camera_world_stall(b->usb.peer, UINT32_MAX);
	const int64_t detected_ns = until_fault(b, "QUARANTINED", BB_NS_PER_S);
	assert_int_equal(health(b)->resets, 3);
	turns(b, 1000);
	assert_int_equal(b->last, BB_ERR_LOST);
	peer_camera_world_stall(b->usb.peer, 0);
	assert_int_equal(bb_camera_stop(b->cam), BB_ERR_LOST);
	const int64_t at_ns = now(b);
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	until_fault(b, "", BB_NS_PER_S);
	row("K8", "stalls for ever; start by hand", "QUARANTINED", detected_ns, now(b) - at_ns);
}

static void k8_cut_and_damaged_packets(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	for (int damaged = 0; damaged < 2; damaged++) {
		const uint64_t frames = health(b)->frames;
		if (damaged)
			peer_camera_world_damage(b->usb.peer, 1);
		else
			peer_camera_world_cut(b->usb.peer, 1);
		const int64_t from_ns = now(b);
		/* Cut short it may still be continued; the next transfer tells. */
		until_fault(b, "USB_ERR", 3 * PERIOD_NS);
		const int64_t detected_ns = now(b) - from_ns;
		assert_true(health(b)->partial == 1u + (uint64_t)damaged);
		assert_true(health(b)->frames <= frames + 2);
		row("K8", damaged ? "packet with a wrong length" : "packet cut short", "USB_ERR", detected_ns,
		    until_fault(b, "", 500 * MS));
	}
	assert_int_equal(health(b)->resets + health(b)->stalls, 0);
}

static void k8_silence(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	peer_camera_world_mute(b->usb.peer, true);
	const int64_t detected_ns = until_fault(b, "USB_ERR", BB_NS_PER_S);
	peer_camera_world_mute(b->usb.peer, false);
	row("K8", "takes everything, says nothing", "USB_ERR", detected_ns, until_fault(b, "", BB_NS_PER_S));
}

/* A camera that follows a sync input and gets none is not broken: it answers, and is left alone. */
static void k8_no_sync_is_no_fault(void **state)
{
	struct bench *b = *state;

	turns(b, 200);
	rig_fault(&b->rig, "camera/c1", "drop percent=100", true);
	turns(b, 3000);
	assert_int_equal(b->last, BB_TIMEOUT);
	assert_int_equal(health(b)->stalls + health(b)->resets, 0);
	rig_fault(&b->rig, "camera/c1", "drop percent=100", false);
	turns(b, 200);
	assert_string_equal(health(b)->fault, "");
}

static void no_firmware_is_refused(void **state)
{
	static struct bench b;
	const struct peer_camera_options options = { .serial = "K", .no_firmware = true };
	struct bb_camera *cam;

	(void)state;
	memset(&b, 0, sizeof(b));
	rig_init(&b.rig, 3, 1);
	struct bb_camera *model = rig_camera(&b.rig, 0);
	struct bb_open open = rig_open(&b.rig);
	assert_int_equal(peer_camera_create(model, &options, &b.usb.peer), BB_OK);
	bus_sim_usb_init(&b.usb.host);
	assert_int_equal(bb_uri_parse("usb:131d:0157", &b.usb.uri, NULL, NULL), BB_OK);
	open.uri = &b.usb.uri;
	assert_int_equal(camera_usb_open_on(&b.usb.host.host, &b.rig.fix.cameras[0], &open, &cam), BB_ERR_LOST);
	assert_true(bus_sim_usb_plug(&b.usb.host, 0, peer_camera_usb(b.usb.peer)));
	assert_int_equal(camera_usb_open_on(&b.usb.host.host, &b.rig.fix.cameras[0], &open, &cam), BB_ERR_UNSUPPORTED);
	assert_null(cam);
	peer_camera_destroy(b.usb.peer);
	bb_camera_close(model);
	rig_done(&b.rig);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(k1_frames_are_lost), T(k1_a_share_is_lost), cmocka_unit_test(k2_counters_wrap),
		cmocka_unit_test(k2_eight_bits_and_a_long_gap), T(k3_blind), T(k7_unplug_and_replug),
		T(k7_identity_is_the_serial), cmocka_unit_test(k7_unplugged_mid_packet), T(k7_flapping_is_quarantined),
		T(k8_one_stall), T(k8_stalls_need_resets), T(k8_stalls_for_ever), T(k8_cut_and_damaged_packets),
		T(k8_silence), T(k8_no_sync_is_no_fault), cmocka_unit_test(no_firmware_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
