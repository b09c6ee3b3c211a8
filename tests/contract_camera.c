/*
 * tests/contract_camera.c: the camera contract over every back end, with tolerances from its limits; what only the
 * simulated one can be told; and one script on every rung. With BB_KERNEL=1 the shipped driver stands before a camera of
 * this kernel, too (behind vhci): tests/guest/ runs it so.
 */
#include "tests/fixture_room.h"
#include "tests/camera_contract.h"
#include "tests/fidelity.h"
#include "tests/fixture_camera_usb.h"
#include "tests/guest/wire_camera.h"
#include "sim/sim_camera.h"

struct bench;
static const struct backend {
	const char *name;
	const struct bb_camera_driver *driver; /* NULL: by open_over and close_over */
	int fidelity;
	void (*open_over)(struct bench *b, size_t i);
	void (*close_over)(struct bench *b);
	const char *uri;
	bool kernel; /* time is waited for */
} *backend;

struct bench {
	struct camera_bench c;
	struct rig rig;
	struct usb_rig usb;
	struct camera_wire wire;
	struct bb_uri uri;
	struct bb_camera *model; /* whose world the tests ask and change: the camera itself, or what the peer sees by */
};

/* The shipped driver and a camera at the far end of a bus in this process. */
static void open_usb(struct bench *b, size_t i)
{
	const struct peer_camera_options options = { .serial = "C1", .stamped = strstr(backend->uri, "device"),
		                                     .offset_ns = 500 * US };

	usb_rig_open(&b->usb, &b->rig, i, &options, backend->uri, &b->c.cam);
	b->model = b->usb.model;
}

static void close_usb(struct bench *b)
{
	usb_rig_close(&b->usb, b->c.cam);
}

/* The same, with libusb, the kernel's USB stack and vhci between them. The kernel lets go of a port when it comes to it. */
static void open_vhci(struct bench *b, size_t i)
{
	static unsigned port;
	const struct peer_camera_options options = { .serial = "C1", .stamped = true, .offset_ns = 500 * US };
	const struct bb_open open = { .clk = b->rig.clk, .uri = &b->uri, .seed = 1 };
	enum bb_status status = BB_ERR_LOST;

	assert_true(camera_wire_begin(&b->wire, i, b->rig.seed, backend->fidelity, &options, port++ % 8));
	b->model = b->wire.model;
	assert_int_equal(bb_uri_parse(backend->uri, &b->uri, NULL, NULL), BB_OK);
	for (int tries = 0; tries < 100 && status == BB_ERR_LOST; tries++) {
		rig_run(&b->rig, 50 * MS);
		status = bb_camera_open(&bb_camera_usb_driver, &b->rig.fix.cameras[i], &open, &b->c.cam);
	}
	assert_int_equal(status, BB_OK);
}

static void close_vhci(struct bench *b)
{
	bb_camera_close(b->c.cam);
	assert_false(b->wire.failed);
	camera_wire_end(&b->wire);
	rig_run(&b->rig, 300 * MS); /* the kernel sees the cable fall out before the next one comes */
}

static const struct backend backends[] = {
	{ "camera: sim, fidelity 0", &sim_camera_driver, 0, NULL, NULL, NULL, false },
	{ "camera: sim, fidelity 1", &sim_camera_driver, 1, NULL, NULL, NULL, false },
	{ "camera: sim, fidelity 2", &sim_camera_driver, 2, NULL, NULL, NULL, false },
	{ "camera: usb driver and peer, own clock", NULL, 1, open_usb, close_usb,
	  "usb:131d:0157?stamps=device&threshold=40", false },
	{ "camera: usb driver and peer, no clock", NULL, 1, open_usb, close_usb, "usb:131d:0157?threshold=40", false },
	{ "camera: usb driver, libusb, vhci and peer", NULL, 1, open_vhci, close_vhci,
	  "usb:131d:0157?serial=C1&stamps=device&threshold=40", true },
};
#define RUNG_SIM 1
#define RUNG_PEER 3
#define RUNG_KERNEL 5

static bool in_kernel(void)
{
	const char *told = getenv("BB_KERNEL");

	return told && !strcmp(told, "1");
}

static void open_camera(struct bench *b, size_t i, uint64_t seed)
{
	memset(b, 0, sizeof(*b));
	fixture_room_init(&b->rig.fix);
	if (backend->kernel)
		assert_int_equal(bb_clock_posix_create(&b->rig.clk), BB_OK);
	rig_world(&b->rig, seed, backend->fidelity);
	const struct bb_open open = rig_open(&b->rig);
	b->c.clk = b->rig.clk;
	b->c.config = &b->rig.fix.cameras[i];
	b->c.look_ns = backend->kernel ? CAMERA_WIRE_LOOK_NS : 100 * US;
	b->c.frames = backend->kernel ? 120 : 600;
	b->c.lit = true;
	camera_bench_init(&b->c);
	if (backend->open_over) {
		backend->open_over(b, i);
		return;
	}
	assert_int_equal(bb_camera_open(backend->driver, &b->rig.fix.cameras[i], &open, &b->c.cam), BB_OK);
	b->model = b->c.cam;
}

static void close_camera(struct bench *b)
{
	if (backend->close_over)
		backend->close_over(b);
	else
		bb_camera_close(b->c.cam);
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

#define SHARED(name)                                                                                                  \
	static void name(void **state)                                                                                \
	{                                                                                                             \
		camera_##name(&((struct bench *)*state)->c);                                                          \
	}

SHARED(limits_are_said)
SHARED(stopped_has_no_frames)
SHARED(frames_come_in_order_on_time)
SHARED(small_buffer_shows_overflow)
SHARED(exposure_is_range_checked)

static void reading_never_moves_time(void **state)
{
	struct bench *b = *state;

	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	const int64_t now_ns = bb_clock_now_ns(b->rig.clk);
	for (int i = 0; i < 100; i++)
		assert_int_equal(bb_camera_read(b->c.cam, &b->c.frame), BB_TIMEOUT);
	assert_int_equal(bb_clock_now_ns(b->rig.clk), now_ns);
	assert_int_equal(b->c.frame.n, 0);
}

/* What follows needs the simulated world. */

static void stamps_are_right_within_limits(void **state)
{
	struct bench *b = *state;
	const struct bb_camera_config *c = &b->rig.fix.cameras[0];
	const int64_t error_ns = bb_camera_limits(b->c.cam)->stamp_error_ns;

	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	const int64_t k0 = sim_world_reference_after(b->rig.world, c->rate, bb_clock_now_ns(b->rig.clk) - 500 * US + 1);
	for (int64_t k = k0; k < k0 + 100; k++) {
		assert_int_equal(camera_next(&b->c, 100 * MS), BB_OK);
		const int64_t mid_ns = sim_world_reference_ns(b->rig.world, c->rate, k) + 500 * US + 400 * US;
		const int64_t dev_ns = has_clock() ? sim_camera_stamp(b->model, mid_ns).ns : mid_ns;
		assert_true(llabs(b->c.frame.mid_exposure.ns - dev_ns) <= error_ns);
		const int64_t least_ns = mid_ns + bb_camera_limits(b->c.cam)->least_latency_ns;
		assert_true(b->c.frame.arrived_ns >= least_ns && b->c.frame.arrived_ns <= least_ns + 300 * US);
		if (backend->fidelity == 0)
			assert_int_equal(b->c.frame.arrived_ns, least_ns);
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
	for (size_t i = 0; i < b->c.frame.n; i++)
		best = fmin(best, hypot((double)b->c.blobs[i].x_px - x, (double)b->c.blobs[i].y_px - y));
	return best;
}

static void blobs_are_where_the_lens_puts_them(void **state)
{
	struct bench *b = *state;
	const struct bb_camera_config *c = &b->rig.fix.cameras[0];
	const double sd_px = bb_camera_limits(b->c.cam)->blob_error_px;
	double square = 0;
	int n = 0;

	sim_world_set_head_fn(b->rig.world, sway, NULL);
	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	const int64_t k0 = sim_world_reference_after(b->rig.world, c->rate, bb_clock_now_ns(b->rig.clk) - 500 * US + 1);
	for (int64_t k = k0; k < k0 + 600; k++) {
		struct bb_vec3 marker[8];
		const int64_t mid_ns = sim_world_reference_ns(b->rig.world, c->rate, k) + 900 * US;
		assert_int_equal(camera_next(&b->c, 100 * MS), BB_OK);
		const size_t n_markers = sim_world_markers(b->rig.world, mid_ns, marker, 8);
		for (size_t i = 1; i < b->c.frame.n; i++)
			assert_true(b->c.blobs[i].y_px >= b->c.blobs[i - 1].y_px);
		if (b->c.frame.n < n_markers)
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
	open_camera(b, 2, 1); /* c3 stands behind the viewer */
	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	for (int i = 0; i < 20; i++) {
		assert_int_equal(camera_next(&b->c, 100 * MS), BB_OK);
		seen += b->c.frame.n;
	}
	assert_true(backend->fidelity == 0 ? seen == 5 * 20 : seen < 5 * 20);
}

static void two_close_markers_are_one_blob(void **state)
{
	struct bench *b = *state;
	struct bb_body *body = &b->rig.fix.room.bodies[0];

	body->marker[1] = (struct bb_vec3){ 0.003, 0, 0 };
	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	assert_int_equal(camera_next(&b->c, 100 * MS), BB_OK);
	assert_int_equal(b->c.frame.n, backend->fidelity == 0 ? 5 : 4);
}

/* The frame of number seq; frames before it are skipped. */
static void frame_number(struct bench *b, uint32_t seq)
{
	do
		assert_int_equal(camera_next(&b->c, 100 * MS), BB_OK);
	while (b->c.frame.seq < seq);
	assert_int_equal(b->c.frame.seq, seq);
}

static void a_cover_takes_the_blobs_and_only_those(void **state)
{
	struct bench *b = *state;
	static struct bench clean;

	open_camera(&clean, 0, 1);
	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	assert_int_equal(bb_camera_start(clean.c.cam), BB_OK);
	frame_number(b, 5);
	rig_fault(&b->rig, "camera/c1", "cover", true);
	rig_fault(&b->rig, "camera/c1", "dark", true);
	frame_number(b, 10);
	assert_int_equal(b->c.frame.n, 0);
	rig_fault(&b->rig, "camera/c1", "cover", false);
	frame_number(b, 12);
	assert_int_equal(b->c.frame.n, 0);
	rig_fault(&b->rig, "camera/c1", "dark", false);
	frame_number(b, 20); /* bit for bit what it would have been */
	frame_number(&clean, 20);
	assert_int_equal(b->c.frame.n, clean.c.frame.n);
	assert_true(b->c.frame.n > 0);
	assert_memory_equal(b->c.blobs, clean.c.blobs, b->c.frame.n * sizeof(b->c.blobs[0]));
	assert_int_equal(b->c.frame.arrived_ns, clean.c.frame.arrived_ns);
	close_camera(&clean);
}

static void dropped_frames_are_gaps(void **state)
{
	struct bench *b = *state;
	uint32_t last = 0, n = 0;

	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	rig_fault(&b->rig, "camera/c1", "drop percent=30", true);
	while (last < 2000) {
		assert_int_equal(camera_next(&b->c, BB_NS_PER_S), BB_OK);
		assert_true(!n || b->c.frame.seq > last);
		last = b->c.frame.seq;
		n++;
	}
	assert_true(n > 1300 && n < 1500); /* 5 sigma about 1400 */
}

static void nobody_reading_loses_the_oldest(void **state)
{
	struct bench *b = *state;

	if (needs_the_sim())
		return;
	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	rig_run(&b->rig, 2 * BB_NS_PER_S);
	assert_int_equal(bb_camera_read(b->c.cam, &b->c.frame), BB_OK);
	assert_true(b->c.frame.seq > 100);
	assert_int_equal(b->c.frame.seq, sim_camera_dropped(b->model));
}

static void bump_flood_noise_and_freeze_show(void **state)
{
	struct bench *b = *state;
	struct bb_blob before[8];

	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	frame_number(b, 3);
	memcpy(before, b->c.blobs, sizeof(before));
	rig_fault(&b->rig, "camera/c1", "bump deg=3", true);
	frame_number(b, 6);
	assert_true(b->c.frame.n == 0 || hypot((double)(b->c.blobs[0].x_px - before[0].x_px),
	                                     (double)(b->c.blobs[0].y_px - before[0].y_px)) > 1);
	rig_fault(&b->rig, "camera/c1", "bump deg=3", false);
	rig_fault(&b->rig, "camera/c1", "flood n=20", true);
	frame_number(b, 9);
	assert_true(b->c.frame.n >= 20);
	rig_fault(&b->rig, "camera/c1", "flood n=80", true);
	frame_number(b, 12);
	assert_true(!backend->driver || b->c.frame.overflow); /* the wire has room for what the model has not */
	const size_t most = bb_camera_limits(b->c.cam)->most_blobs; /* and spots that overlap are one */
	assert_true(!backend->driver || (b->c.frame.n > most * 3 / 4 && b->c.frame.n <= most));
	rig_fault(&b->rig, "camera/c1", "flood n=80", false);
	rig_fault(&b->rig, "camera/c1", "flood n=20", false);
	rig_fault(&b->rig, "camera/c1", "noise px=2", true);
	frame_number(b, 15);
	const float noisy = b->c.blobs[0].x_px;
	frame_number(b, 16);
	assert_true(noisy != b->c.blobs[0].x_px);
	rig_fault(&b->rig, "camera/c1", "freeze", true);
	frame_number(b, 19);
	memcpy(before, b->c.blobs, sizeof(before));
	frame_number(b, 22);
	assert_memory_equal(before, b->c.blobs, b->c.frame.n * sizeof(before[0]));
}

static void unplugged_is_lost_and_comes_back(void **state)
{
	struct bench *b = *state;

	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	rig_run(&b->rig, 100 * MS);
	rig_fault(&b->rig, "camera/c1", "unplug", true);
	assert_int_equal(bb_camera_read(b->c.cam, &b->c.frame), BB_ERR_LOST);
	assert_int_equal(bb_camera_set_exposure(b->c.cam, MS, 0), BB_ERR_LOST);
	assert_int_equal(bb_camera_device(b->c.cam)->last_error.status, BB_ERR_LOST);
	const uint64_t steps = bb_clock_steps(b->rig.clk);
	rig_run(&b->rig, 100 * MS);
	assert_int_equal(bb_clock_steps(b->rig.clk), steps); /* an unplugged camera costs nothing */
	rig_fault(&b->rig, "camera/c1", "unplug", false);
	assert_int_equal(camera_next(&b->c, 100 * MS), BB_OK);
}

static void freerun_leaves_the_reference_and_returns(void **state)
{
	struct bench *b = *state;
	const struct bb_rate rate = b->rig.fix.cameras[0].rate;
	int64_t dev_ns[40];

	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	for (uint32_t i = 0; i < 40; i++) {
		if (i == 10 || i == 30)
			rig_fault(&b->rig, "camera/c1", "freerun", i == 10);
		frame_number(b, i);
		dev_ns[i] = b->c.frame.mid_exposure.ns;
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
		open_camera(b, 0, seed);
		if (sim_camera_stamp(b->model, 0).ns < (INT64_C(0x100000000) - 20000000) * US)
			continue;
		assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
		for (int i = 0; i < 25 * 60; i++) {
			assert_int_equal(camera_next(&b->c, 100 * MS), BB_OK);
			assert_true(!i || b->c.frame.mid_exposure.ns - last_ns < 20 * MS);
			assert_true(!i || b->c.frame.mid_exposure.ns > last_ns);
			last_ns = b->c.frame.mid_exposure.ns;
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

/* One script on every rung. What happens does so when a frame has been seen, so that the next one shows it everywhere. */

#define SCRIPT_FRAMES 75
#define SCRIPT_BLOBS 8

struct sight {
	size_t n;
	struct bb_blob blob[SCRIPT_BLOBS];
};

struct rung {
	const struct backend *backend;
	struct fid_log log;
	struct sight sight[SCRIPT_FRAMES];
	double error_px; /* as its limits say */
};

static const struct {
	uint32_t after;
	const char *fault;
	bool on;
} script[] = {
	{ 29, "cover", true }, { 44, "cover", false }, { 59, "flood n=4", true }, { 64, "flood n=4", false },
};

static void set_fault(struct bench *b, const char *verb_and_args, bool on)
{
	if (backend->kernel)
		camera_wire_fault(&b->wire, verb_and_args, on);
	else
		rig_fault(&b->rig, "camera/c1", verb_and_args, on);
}

static void note_frame(struct bench *b, struct rung *r, int64_t first_dev_ns, int64_t first_arrived_ns)
{
	const struct bb_camera_frame *f = &b->c.frame;
	const int64_t looks_ns = backend->kernel ? CAMERA_WIRE_LOOK_NS + b->c.look_ns : 0;
	struct sight *s = &r->sight[f->seq];

	fid_note(&r->log, first_arrived_ns + f->mid_exposure.ns - first_dev_ns,
	         2 * bb_camera_limits(b->c.cam)->stamp_error_ns, "frame %u has %zu blobs", f->seq, f->n);
	fid_note(&r->log, f->arrived_ns, llround(b->c.config->transfer_jitter_us * 1000) + looks_ns, "frame %u is here",
	         f->seq);
	s->n = f->n < SCRIPT_BLOBS ? f->n : SCRIPT_BLOBS;
	memcpy(s->blob, f->blobs, s->n * sizeof(*s->blob));
}

static void watch_frames(struct bench *b, struct rung *r)
{
	int64_t first_dev_ns = 0, first_arrived_ns = 0;

	assert_int_equal(bb_camera_start(b->c.cam), BB_OK);
	for (uint32_t i = 0; i < SCRIPT_FRAMES; i++) {
		assert_int_equal(camera_next(&b->c, camera_soon_ns(&b->c)), BB_OK);
		if (!i) {
			first_dev_ns = b->c.frame.mid_exposure.ns;
			first_arrived_ns = b->c.frame.arrived_ns;
		}
		assert_int_equal(b->c.frame.seq, i);
		note_frame(b, r, first_dev_ns, first_arrived_ns);
		for (size_t k = 0; k < BB_ARRAY_LEN(script); k++)
			if (script[k].after == i)
				set_fault(b, script[k].fault, script[k].on);
	}
}

/* Pulled out for half a second. Rows K7: seen within 100 ms, back within a second with its numbers and stamps going on. */
static void watch_replug(struct bench *b, struct rung *r)
{
	const bool wire = !backend->driver;
	const struct bb_camera_frame before = b->c.frame;
	size_t least = SIZE_MAX, most = 0;

	set_fault(b, "unplug", true);
	assert_int_equal(camera_next(&b->c, BB_NS_PER_S), BB_ERR_LOST);
	fid_note(&r->log, bb_clock_now_ns(b->rig.clk), wire ? 100 * MS : 0, "gone");
	rig_run(&b->rig, 500 * MS);
	assert_int_equal(bb_camera_read(b->c.cam, &b->c.frame), BB_ERR_LOST);
	set_fault(b, "unplug", false);
	for (int64_t end_ns = bb_clock_now_ns(b->rig.clk) + 3 * BB_NS_PER_S; bb_clock_now_ns(b->rig.clk) < end_ns;) {
		if (bb_camera_read(b->c.cam, &b->c.frame) == BB_OK)
			break;
		rig_run(&b->rig, b->c.look_ns);
	}
	assert_true(b->c.frame.seq > before.seq && b->c.frame.mid_exposure.ns > before.mid_exposure.ns);
	fid_note(&r->log, bb_clock_now_ns(b->rig.clk), wire ? BB_NS_PER_S : camera_soon_ns(&b->c), "back");
	for (uint32_t i = 0, seq = b->c.frame.seq; i < 20; i++) {
		assert_int_equal(camera_next(&b->c, camera_soon_ns(&b->c)), BB_OK);
		assert_int_equal(b->c.frame.seq, seq + 1 + i);
		least = b->c.frame.n < least ? b->c.frame.n : least;
		most = b->c.frame.n > most ? b->c.frame.n : most;
	}
	fid_note(&r->log, bb_clock_now_ns(b->rig.clk), wire ? BB_NS_PER_S : camera_soon_ns(&b->c),
	         "20 frames more, %zu to %zu blobs", least, most);
}

static void play_rung(struct rung *r)
{
	struct bench *b = calloc(1, sizeof(*b));

	assert_non_null(b);
	backend = r->backend;
	open_camera(b, 0, 1);
	r->error_px = bb_camera_limits(b->c.cam)->blob_error_px;
	watch_frames(b, r);
	watch_replug(b, r);
	close_camera(b);
	free(b);
}

/* How far blobs of one rung are from those of another: both saw the same head with the same noise. */
static double apart_px(const struct rung *a, const struct rung *b)
{
	double worst = 0;

	for (size_t i = 0; i < SCRIPT_FRAMES; i++)
		for (size_t k = 0; k < a->sight[i].n && a->sight[i].n < SCRIPT_BLOBS; k++) {
			double best = (double)INFINITY;
			for (size_t m = 0; m < b->sight[i].n; m++)
				best = fmin(best, hypot((double)(a->sight[i].blob[k].x_px - b->sight[i].blob[m].x_px),
				                        (double)(a->sight[i].blob[k].y_px - b->sight[i].blob[m].y_px)));
			worst = fmax(worst, best);
		}
	return worst;
}

static void every_rung_tells_the_same(void **state)
{
	static struct rung rungs[] = {
		{ .backend = &backends[RUNG_SIM], .log = { .rung = "sim" } },
		{ .backend = &backends[RUNG_PEER], .log = { .rung = "driver + peer" } },
		{ .backend = &backends[RUNG_KERNEL], .log = { .rung = "driver + kernel (vhci)" } },
	};
	const struct fid_log *logs[BB_ARRAY_LEN(rungs)];
	const size_t n = in_kernel() ? 3 : 2;

	(void)state;
	for (size_t i = 0; i < n; i++) {
		play_rung(&rungs[i]);
		logs[i] = &rungs[i].log;
	}
	const int differ = fid_table("camera", logs, n);
	for (size_t i = 1; i < n; i++) {
		const double px = apart_px(&rungs[0], &rungs[i]);
		printf("fidelity camera         %-44s blobs at most %.4f px from the sim's, stated %.4f px (sd)\n",
		       logs[i]->rung, px, rungs[i].error_px);
		assert_true(px <= 5 * rungs[i].error_px);
	}
	assert_int_equal(differ, 0);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
#define SHARED_TESTS                                                                                                  \
	T(limits_are_said), T(stopped_has_no_frames), T(frames_come_in_order_on_time), T(small_buffer_shows_overflow), \
		T(exposure_is_range_checked)

int main(void)
{
	const struct CMUnitTest shared[] = { SHARED_TESTS };
	const struct CMUnitTest all[] = {
		SHARED_TESTS, T(reading_never_moves_time),
		T(stamps_are_right_within_limits), T(blobs_are_where_the_lens_puts_them),
		T(a_viewer_hides_markers_from_behind), T(two_close_markers_are_one_blob),
		T(a_cover_takes_the_blobs_and_only_those), T(dropped_frames_are_gaps),
		T(nobody_reading_loses_the_oldest), T(bump_flood_noise_and_freeze_show),
		T(unplugged_is_lost_and_comes_back), T(freerun_leaves_the_reference_and_returns),
		T(the_counter_wraps_unnoticed), T(nonsense_is_refused),
	};
	const struct CMUnitTest rungs[] = { cmocka_unit_test(every_rung_tells_the_same) };
	int failed = 0;

	for (size_t i = 0; i < BB_ARRAY_LEN(backends); i++) {
		backend = &backends[i];
		if (backend->kernel != in_kernel()) /* the guest need not do what the host does */
			continue;
		failed += backend->kernel ? cmocka_run_group_tests_name(backend->name, shared, NULL, NULL)
		                          : cmocka_run_group_tests_name(backend->name, all, NULL, NULL);
	}
	return failed + cmocka_run_group_tests_name("camera: one script", rungs, NULL, NULL);
}
