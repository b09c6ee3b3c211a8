/*
 * tests/contract_camera.c: what every camera must do, over every back end, with tolerances from its limits; then what
 * only the simulated one can be told.
 */
#include "tests/fixture_room.h"
#include "tests/fixture_camera_usb.h"
#include "sim/sim_camera.h"

struct bench;
static const struct backend {
	const char *name;
	const struct bb_camera_driver *driver; /* NULL: by open_over and close_over */
	int fidelity;
	void (*open_over)(struct bench *b, size_t i);
	void (*close_over)(struct bench *b);
	const char *uri;
} *backend;

struct bench {
	struct rig rig;
	struct usb_rig usb;
	struct bb_camera *cam;
	struct bb_camera *model; /* whose world the tests ask and change: the camera itself, or what the peer sees by */
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	struct bb_camera_frame frame;
};

/* The shipped driver and a camera at the far end of a bus in this process. */
static void open_usb(struct bench *b, size_t i)
{
	const struct peer_camera_options options = { .serial = "C1", .stamped = strstr(backend->uri, "device"),
		                                     .offset_ns = 500 * US };

	usb_rig_open(&b->usb, &b->rig, i, &options, backend->uri, &b->cam);
	b->model = b->usb.model;
}

static void close_usb(struct bench *b)
{
	usb_rig_close(&b->usb, b->cam);
}

static const struct backend backends[] = {
	{ "camera: sim, fidelity 0", &sim_camera_driver, 0, NULL, NULL, NULL },
	{ "camera: sim, fidelity 1", &sim_camera_driver, 1, NULL, NULL, NULL },
	{ "camera: sim, fidelity 2", &sim_camera_driver, 2, NULL, NULL, NULL },
	{ "camera: usb driver and peer, own clock", NULL, 1, open_usb, close_usb,
	  "usb:131d:0157?stamps=device&threshold=40" },
	{ "camera: usb driver and peer, no clock", NULL, 1, open_usb, close_usb, "usb:131d:0157?threshold=40" },
};

static void open_camera(struct bench *b, size_t i, uint64_t seed)
{
	const struct bb_open open = (rig_init(&b->rig, seed, backend->fidelity), rig_open(&b->rig));

	b->frame = (struct bb_camera_frame){ .blobs = b->blobs, .cap = BB_ARRAY_LEN(b->blobs) };
	if (backend->open_over) {
		backend->open_over(b, i);
		return;
	}
	assert_int_equal(bb_camera_open(backend->driver, &b->rig.fix.cameras[i], &open, &b->cam), BB_OK);
	b->model = b->cam;
}

static void close_camera(struct bench *b)
{
	if (backend->close_over)
		backend->close_over(b);
	else
		bb_camera_close(b->cam);
	rig_done(&b->rig);
}

/* Without one its stamps are the host's. */
static bool has_clock(void)
{
	return backend->driver || strstr(backend->uri, "device");
}

/* A test that needs the simulated device itself. */
static bool needs_the_sim(void)
{
	if (!backend->driver)
		print_message("[          ] not over a wire\n");
	return !backend->driver;
}

static int setup(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));

	if (!b)
		return -1;
	*state = b;
	open_camera(b, 0, 1);
	return 0;
}

static int teardown(void **state)
{
	struct bench *b = *state;

	close_camera(b);
	free(b);
	return 0;
}

static enum bb_status next(struct bench *b, int64_t within_ns)
{
	const int64_t end_ns = bb_clock_now_ns(b->rig.clk) + within_ns;

	for (;;) {
		const enum bb_status status = bb_camera_read(b->cam, &b->frame);
		if (status != BB_TIMEOUT || bb_clock_now_ns(b->rig.clk) >= end_ns)
			return status;
		rig_run(&b->rig, 100 * US);
	}
}

static void limits_are_said(void **state)
{
	struct bench *b = *state;
	const struct bb_camera_limits *l = bb_camera_limits(b->cam);
	const double hz = bb_rate_hz(b->rig.fix.cameras[0].rate);

	assert_true(l->least_rate_hz <= hz && hz <= l->most_rate_hz);
	assert_true(l->most_blobs > 0 && l->most_blobs <= BB_CAMERA_BLOBS_MAX);
	assert_true(l->least_latency_ns > 0 && l->stamp_error_ns >= 0 && l->blob_error_px >= 0);
}

static void a_stopped_camera_has_no_frames(void **state)
{
	struct bench *b = *state;

	rig_run(&b->rig, 100 * MS);
	assert_int_equal(bb_camera_read(b->cam, &b->frame), BB_TIMEOUT);
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	rig_run(&b->rig, 100 * MS);
	assert_int_equal(bb_camera_read(b->cam, &b->frame), BB_OK);
	assert_int_equal(bb_camera_stop(b->cam), BB_OK);
	rig_run(&b->rig, 100 * MS);
	assert_int_equal(bb_camera_read(b->cam, &b->frame), BB_TIMEOUT);
}

static void reading_never_moves_time(void **state)
{
	struct bench *b = *state;

	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	const int64_t now_ns = bb_clock_now_ns(b->rig.clk);
	for (int i = 0; i < 100; i++)
		assert_int_equal(bb_camera_read(b->cam, &b->frame), BB_TIMEOUT);
	assert_int_equal(bb_clock_now_ns(b->rig.clk), now_ns);
	assert_int_equal(b->frame.n, 0);
}

/* Ten seconds: numbers without gaps, the configured rate, stamps and arrivals that fit the limits through a time map. */
static void frames_come_in_order_on_time(void **state)
{
	struct bench *b = *state;
	const struct bb_camera_limits *l = bb_camera_limits(b->cam);
	const int64_t period_ns = bb_rate_period_ns(b->rig.fix.cameras[0].rate);
	int64_t first_dev_ns = 0, last_dev_ns = 0, last_arrived_ns = 0;
	struct bb_timemap map;

	bb_timemap_init(&map, l->least_latency_ns);
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	for (uint32_t i = 0; i < 600; i++) {
		assert_int_equal(next(b, 2 * period_ns + l->least_latency_ns), BB_OK);
		const int64_t dev_ns = b->frame.mid_exposure.ns;
		bb_timemap_add(&map, b->frame.mid_exposure, b->frame.arrived_ns);
		if (!i)
			first_dev_ns = dev_ns;
		assert_int_equal(b->frame.seq, i);
		assert_true(b->frame.arrived_ns <= bb_clock_now_ns(b->rig.clk));
		assert_true(!i || b->frame.arrived_ns > last_arrived_ns);
		assert_true(!i || llabs(dev_ns - last_dev_ns - period_ns) <=
		                          2 * l->stamp_error_ns + 200 * period_ns / 1000000);
		/* Transfer only delays: host time by the map is never after the arrival less the least latency. */
		assert_true(bb_timemap_host_ns(&map, b->frame.mid_exposure) + l->least_latency_ns <=
		            b->frame.arrived_ns);
		last_dev_ns = dev_ns;
		last_arrived_ns = b->frame.arrived_ns;
	}
	const int64_t span_ns = last_dev_ns - first_dev_ns;
	assert_true(llabs(span_ns - 599 * period_ns) <=
	            2 * l->stamp_error_ns + span_ns / 5000); /* 200 ppm: two crystals */
}

static void a_small_buffer_shows_overflow(void **state)
{
	struct bench *b = *state;

	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	b->frame.cap = 2;
	assert_int_equal(next(b, 100 * MS), BB_OK);
	assert_int_equal(b->frame.n, 2);
	assert_true(b->frame.overflow);
	assert_int_equal(bb_camera_read(b->cam, NULL), BB_ERR_USAGE);
}

static void exposure_is_range_checked(void **state)
{
	struct bench *b = *state;
	const int64_t period_ns = bb_rate_period_ns(b->rig.fix.cameras[0].rate);
	const int64_t before_ns = bb_camera_limits(b->cam)->least_latency_ns;

	assert_int_equal(bb_camera_set_exposure(b->cam, 0, 0), BB_ERR_USAGE);
	assert_int_equal(bb_camera_set_exposure(b->cam, 2 * period_ns, 0), BB_ERR_RANGE);
	assert_int_equal(bb_camera_set_exposure(b->cam, MS, period_ns), BB_ERR_RANGE);
	assert_int_equal(bb_camera_set_exposure(b->cam, 2800 * US, 0), BB_OK);
	assert_int_equal(bb_camera_limits(b->cam)->least_latency_ns - before_ns, MS); /* from 800 us, half of it */
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	assert_int_equal(next(b, 100 * MS), BB_OK);
}

/* What follows needs the simulated world. */

static void stamps_are_right_within_limits(void **state)
{
	struct bench *b = *state;
	const struct bb_camera_config *c = &b->rig.fix.cameras[0];
	const int64_t error_ns = bb_camera_limits(b->cam)->stamp_error_ns;

	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	const int64_t k0 = sim_world_reference_after(b->rig.world, c->rate, bb_clock_now_ns(b->rig.clk) - 500 * US + 1);
	for (int64_t k = k0; k < k0 + 100; k++) {
		assert_int_equal(next(b, 100 * MS), BB_OK);
		const int64_t mid_ns = sim_world_reference_ns(b->rig.world, c->rate, k) + 500 * US + 400 * US;
		const int64_t dev_ns = has_clock() ? sim_camera_stamp(b->model, mid_ns).ns : mid_ns;
		assert_true(llabs(b->frame.mid_exposure.ns - dev_ns) <= error_ns);
		const int64_t least_ns = mid_ns + bb_camera_limits(b->cam)->least_latency_ns;
		assert_true(b->frame.arrived_ns >= least_ns && b->frame.arrived_ns <= least_ns + 300 * US);
		if (backend->fidelity == 0)
			assert_int_equal(b->frame.arrived_ns, least_ns);
	}
}

static struct bb_pose sway(void *ctx, int64_t t_ns)
{
	const double t = (double)t_ns * 1e-9;

	(void)ctx;
	return (struct bb_pose){ { 0.4 * sin(2 * t), 1.6 + 0.1 * sin(5 * t), 0.3 * cos(1.5 * t) - 0.2 },
		                 bb_quat_euler_deg(40 * sin(t), 0, 0) };
}

/* The nearest blob to each marker the camera can see, against a projection written out here once more. */
static double project_error(const struct bench *b, struct bb_vec3 marker, const struct bb_camera_config *c,
                            bool *inside)
{
	const struct bb_vec3 p = bb_pose_inverse_apply(&c->pose, marker);
	const double r = hypot(p.x, p.y) / p.z, f = 1 + c->k1 * r * r + c->k2 * r * r * r * r;
	const double x = c->cx_px + c->fx_px * p.x / p.z * f, y = c->cy_px + c->fy_px * p.y / p.z * f;
	double best = 1e9;

	*inside = p.z > 0 && x > 1 && y > 1 && x < (double)c->width_px - 2 && y < (double)c->height_px - 2;
	for (size_t i = 0; i < b->frame.n; i++)
		best = fmin(best, hypot((double)b->blobs[i].x_px - x, (double)b->blobs[i].y_px - y));
	return best;
}

static void blobs_are_where_the_lens_puts_them(void **state)
{
	struct bench *b = *state;
	const struct bb_camera_config *c = &b->rig.fix.cameras[0];
	const double sd_px = bb_camera_limits(b->cam)->blob_error_px;
	double square = 0;
	int n = 0;

	sim_world_set_head_fn(b->rig.world, sway, NULL);
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	const int64_t k0 = sim_world_reference_after(b->rig.world, c->rate, bb_clock_now_ns(b->rig.clk) - 500 * US + 1);
	for (int64_t k = k0; k < k0 + 600; k++) {
		struct bb_vec3 marker[8];
		const int64_t mid_ns = sim_world_reference_ns(b->rig.world, c->rate, k) + 900 * US;
		assert_int_equal(next(b, 100 * MS), BB_OK);
		const size_t n_markers = sim_world_markers(b->rig.world, mid_ns, marker, 8);
		for (size_t i = 1; i < b->frame.n; i++)
			assert_true(b->blobs[i].y_px >= b->blobs[i - 1].y_px);
		if (b->frame.n < n_markers)
			continue; /* something is hidden, merged or outside */
		for (size_t i = 0; i < n_markers; i++) {
			bool inside;
			const double error_px = project_error(b, marker[i], c, &inside);
			assert_true(!inside || error_px <= 5 * sd_px * sqrt(2) + 1e-3); /* float coordinates */
			square += error_px * error_px / 2;
			n++;
		}
	}
	assert_true(n > 1000);
	const double rms_px = sqrt(square / n);
	print_message("[          ] %d blobs, rms %.4f px, stated %.4f px\n", n, rms_px, sd_px);
	assert_true(fabs(rms_px - sd_px) < 0.1 * sd_px + 1e-4);
}

static void a_viewer_hides_markers_from_behind(void **state)
{
	struct bench *b = *state;
	size_t seen = 0;

	close_camera(b);
	memset(b, 0, sizeof(*b));
	open_camera(b, 2, 1); /* c3 stands behind the viewer */
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	for (int i = 0; i < 20; i++) {
		assert_int_equal(next(b, 100 * MS), BB_OK);
		seen += b->frame.n;
	}
	assert_true(backend->fidelity == 0 ? seen == 5 * 20 : seen < 5 * 20);
}

static void two_close_markers_are_one_blob(void **state)
{
	struct bench *b = *state;
	struct bb_body *body = &b->rig.fix.room.bodies[0];

	body->marker[1] = (struct bb_vec3){ 0.003, 0, 0 };
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	assert_int_equal(next(b, 100 * MS), BB_OK);
	assert_int_equal(b->frame.n, backend->fidelity == 0 ? 5 : 4);
}

/* The frame of number seq; frames before it are skipped. */
static void frame_number(struct bench *b, uint32_t seq)
{
	do
		assert_int_equal(next(b, 100 * MS), BB_OK);
	while (b->frame.seq < seq);
	assert_int_equal(b->frame.seq, seq);
}

static void a_cover_takes_the_blobs_and_only_those(void **state)
{
	struct bench *b = *state;
	struct bench clean = { 0 };

	open_camera(&clean, 0, 1);
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	assert_int_equal(bb_camera_start(clean.cam), BB_OK);
	frame_number(b, 5);
	rig_fault(&b->rig, "camera/c1", "cover", true);
	rig_fault(&b->rig, "camera/c1", "dark", true);
	frame_number(b, 10);
	assert_int_equal(b->frame.n, 0);
	rig_fault(&b->rig, "camera/c1", "cover", false);
	frame_number(b, 12);
	assert_int_equal(b->frame.n, 0);
	rig_fault(&b->rig, "camera/c1", "dark", false);
	frame_number(b, 20); /* bit for bit what it would have been */
	frame_number(&clean, 20);
	assert_int_equal(b->frame.n, clean.frame.n);
	assert_true(b->frame.n > 0);
	assert_memory_equal(b->blobs, clean.blobs, b->frame.n * sizeof(b->blobs[0]));
	assert_int_equal(b->frame.arrived_ns, clean.frame.arrived_ns);
	close_camera(&clean);
}

static void dropped_frames_are_gaps(void **state)
{
	struct bench *b = *state;
	uint32_t last = 0, n = 0;

	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	rig_fault(&b->rig, "camera/c1", "drop percent=30", true);
	while (last < 2000) {
		assert_int_equal(next(b, BB_NS_PER_S), BB_OK);
		assert_true(!n || b->frame.seq > last);
		last = b->frame.seq;
		n++;
	}
	assert_true(n > 1300 && n < 1500); /* 5 sigma about 1400 */
}

static void nobody_reading_loses_the_oldest(void **state)
{
	struct bench *b = *state;

	if (needs_the_sim())
		return;
	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	rig_run(&b->rig, 2 * BB_NS_PER_S);
	assert_int_equal(bb_camera_read(b->cam, &b->frame), BB_OK);
	assert_true(b->frame.seq > 100);
	assert_int_equal(b->frame.seq, sim_camera_dropped(b->model));
}

static void bump_flood_noise_and_freeze_show(void **state)
{
	struct bench *b = *state;
	struct bb_blob before[8];

	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	frame_number(b, 3);
	memcpy(before, b->blobs, sizeof(before));
	rig_fault(&b->rig, "camera/c1", "bump deg=3", true);
	frame_number(b, 6);
	assert_true(b->frame.n == 0 || hypot((double)(b->blobs[0].x_px - before[0].x_px),
	                                     (double)(b->blobs[0].y_px - before[0].y_px)) > 1);
	rig_fault(&b->rig, "camera/c1", "bump deg=3", false);
	rig_fault(&b->rig, "camera/c1", "flood n=20", true);
	frame_number(b, 9);
	assert_true(b->frame.n >= 20);
	rig_fault(&b->rig, "camera/c1", "flood n=80", true);
	frame_number(b, 12);
	assert_true(!backend->driver || b->frame.overflow); /* the wire has room for what the model has not */
	assert_true(!backend->driver || b->frame.n == bb_camera_limits(b->cam)->most_blobs);
	rig_fault(&b->rig, "camera/c1", "flood n=80", false);
	rig_fault(&b->rig, "camera/c1", "flood n=20", false);
	rig_fault(&b->rig, "camera/c1", "noise px=2", true);
	frame_number(b, 15);
	const float noisy = b->blobs[0].x_px;
	frame_number(b, 16);
	assert_true(noisy != b->blobs[0].x_px);
	rig_fault(&b->rig, "camera/c1", "freeze", true);
	frame_number(b, 19);
	memcpy(before, b->blobs, sizeof(before));
	frame_number(b, 22);
	assert_memory_equal(before, b->blobs, b->frame.n * sizeof(before[0]));
}

static void unplugged_is_lost_and_comes_back(void **state)
{
	struct bench *b = *state;

	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	rig_run(&b->rig, 100 * MS);
	rig_fault(&b->rig, "camera/c1", "unplug", true);
	assert_int_equal(bb_camera_read(b->cam, &b->frame), BB_ERR_LOST);
	assert_int_equal(bb_camera_set_exposure(b->cam, MS, 0), BB_ERR_LOST);
	assert_int_equal(bb_camera_device(b->cam)->last_error.status, BB_ERR_LOST);
	const uint64_t steps = bb_clock_steps(b->rig.clk);
	rig_run(&b->rig, 100 * MS);
	assert_int_equal(bb_clock_steps(b->rig.clk), steps); /* an unplugged camera costs nothing */
	rig_fault(&b->rig, "camera/c1", "unplug", false);
	assert_int_equal(next(b, 100 * MS), BB_OK);
}

static void freerun_leaves_the_reference_and_returns(void **state)
{
	struct bench *b = *state;
	const struct bb_rate rate = b->rig.fix.cameras[0].rate;
	int64_t dev_ns[40];

	assert_int_equal(bb_camera_start(b->cam), BB_OK);
	for (uint32_t i = 0; i < 40; i++) {
		if (i == 10 || i == 30)
			rig_fault(&b->rig, "camera/c1", "freerun", i == 10);
		frame_number(b, i);
		dev_ns[i] = b->frame.mid_exposure.ns;
		assert_true(!i || dev_ns[i] > dev_ns[i - 1]);
		assert_true(!i || dev_ns[i] - dev_ns[i - 1] < 2 * bb_rate_period_ns(rate));
	}
	const int64_t jump_ns = dev_ns[12] - dev_ns[8] - 4 * bb_rate_period_ns(rate);
	assert_true(llabs(jump_ns) > 10 * US); /* another phase (of this seed) */
}

/* Seeds until one starts close to the wrap of its 32-bit counter; the stamps go on. */
static void the_counter_wraps_unnoticed(void **state)
{
	struct bench *b = *state;

	(void)state;
	if (backend->fidelity == 0 || !has_clock())
		return; /* an ideal clock does not wrap, and none does not either */
	for (uint64_t seed = 1; seed < 100; seed++) {
		int64_t last_ns = 0;
		close_camera(b);
		memset(b, 0, sizeof(*b));
		open_camera(b, 0, seed);
		if (sim_camera_stamp(b->model, 0).ns < (INT64_C(0x100000000) - 20000000) * US)
			continue;
		assert_int_equal(bb_camera_start(b->cam), BB_OK);
		for (int i = 0; i < 25 * 60; i++) {
			assert_int_equal(next(b, 100 * MS), BB_OK);
			assert_true(!i || b->frame.mid_exposure.ns - last_ns < 20 * MS);
			assert_true(!i || b->frame.mid_exposure.ns > last_ns);
			last_ns = b->frame.mid_exposure.ns;
		}
		assert_true(last_ns > INT64_C(0x100000000) * US);
		return;
	}
	fail_msg("no seed starts near the wrap");
}

static enum bb_status open_again(struct bench *b, const struct bb_camera_config *config, struct bb_camera **cam)
{
	struct bb_open open = rig_open(&b->rig);

	if (backend->driver)
		return bb_camera_open(backend->driver, config, &open, cam);
	open.uri = &b->usb.uri;
	return camera_usb_open_on(&b->usb.host.host, config, &open, cam);
}

static void nonsense_is_refused(void **state)
{
	struct bench *b = *state;
	struct bb_camera_config c = b->rig.fix.cameras[1];
	struct bb_camera *cam;

	c.rate = (struct bb_rate){ 0, 1 };
	assert_int_equal(open_again(b, &c, &cam), BB_ERR_RANGE);
	c = b->rig.fix.cameras[1];
	c.exposure_us = (double)NAN;
	assert_int_equal(open_again(b, &c, &cam), BB_ERR_RANGE);
	c = b->rig.fix.cameras[1];
	c.width_px = INT64_MAX;
	assert_int_equal(open_again(b, &c, &cam), BB_ERR_RANGE);
	assert_int_equal(open_again(b, &b->rig.fix.cameras[0], &cam), BB_ERR_BUSY);
	rig_option(&b->rig, "nois_px", "1");
	b->usb.uri.option[b->usb.uri.n_options] = b->rig.uri.option[0];
	b->usb.uri.n_options++;
	assert_int_equal(open_again(b, &b->rig.fix.cameras[1], &cam), BB_ERR_CONFIG);
	assert_null(cam);
	bb_camera_close(NULL);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(limits_are_said), T(a_stopped_camera_has_no_frames), T(reading_never_moves_time),
		T(frames_come_in_order_on_time), T(a_small_buffer_shows_overflow), T(exposure_is_range_checked),
		T(stamps_are_right_within_limits), T(blobs_are_where_the_lens_puts_them),
		T(a_viewer_hides_markers_from_behind), T(two_close_markers_are_one_blob),
		T(a_cover_takes_the_blobs_and_only_those), T(dropped_frames_are_gaps),
		T(nobody_reading_loses_the_oldest), T(bump_flood_noise_and_freeze_show),
		T(unplugged_is_lost_and_comes_back), T(freerun_leaves_the_reference_and_returns),
		T(the_counter_wraps_unnoticed), T(nonsense_is_refused),
	};
	int failed = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		backend = &backends[i];
		failed += cmocka_run_group_tests_name(backend->name, tests, NULL, NULL);
	}
	return failed;
}
