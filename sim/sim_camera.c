/* sim/sim_camera.c: a tracking camera; the model stands in sim/sim_camera.h. One timer, on the owner's thread. */
#include "sim/sim_camera.h"
#include "sim/camera/camera_impl.h"
#include "sim/sim.h"
#include "sim/sim_option.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define QUEUE 16
#define STALLS_MOST 4 /* a halt cleared and three resets */
#define OWN_RATE_PPM 50.0     /* crystals */
#define DEVICE_CLOCK_PPM 30.0
#define TICK_NS 1000

static struct sim_camera *own(struct bb_camera *cam)
{
	return bb_container_of(cam, struct sim_camera, base);
}

/* Time */

static bool is_free(const struct sim_camera *c)
{
	return c->base.config.sync == BB_SYNC_FREE || c->freerun;
}

static int64_t own_ns(const struct sim_camera *c, int64_t k)
{
	const int64_t ideal_ns = bb_rate_frame_ns(c->base.config.rate, k);

	return c->own_phase_ns + ideal_ns - (int64_t)((__int128)ideal_ns * c->own_ppb / BB_NS_PER_S);
}

/* The first exposure that begins after a time. */
static int64_t start_after(const struct sim_camera *c, int64_t after_ns)
{
	const struct bb_rate rate = c->base.config.rate;

	if (!is_free(c)) {
		int64_t k = sim_world_reference_after(c->world, rate, after_ns + 1 - c->offset_ns);
		return sim_world_reference_ns(c->world, rate, k) + c->offset_ns;
	}
	const int64_t span_ns = after_ns - c->own_phase_ns;
	const int64_t ideal_ns = span_ns + (int64_t)((__int128)span_ns * c->own_ppb / BB_NS_PER_S);
	int64_t k = (int64_t)((__int128)ideal_ns * rate.num / ((__int128)rate.den * BB_NS_PER_S));
	k -= k / 1000000 + 2; /* the inverse is of first order: start below and walk */
	if (k < 0)
		k = 0;
	while (own_ns(c, k) <= after_ns)
		k++;
	return own_ns(c, k);
}

struct bb_dev_ns sim_camera_stamp(const struct bb_camera *cam, int64_t host_ns)
{
	const struct sim_camera *c = (const struct sim_camera *)(const void *)cam; /* base is the first member */
	const int64_t dt_ns = host_ns - c->dev_zero_ns;

	if (c->ideal)
		return (struct bb_dev_ns){ host_ns };
	return (struct bb_dev_ns){ (int64_t)c->dev_start * TICK_NS + dt_ns +
		                   (int64_t)((__int128)dt_ns * c->dev_ppb / BB_NS_PER_S) };
}

/* What the driver makes of the counter: 32 bits on the wire, unwrapped again. */
static int64_t stamp(struct sim_camera *c, int64_t mid_ns)
{
	const struct bb_dev_ns dev = sim_camera_stamp(&c->base, mid_ns);

	return c->ideal ? dev.ns : bb_unwrap32(&c->unwrap, (uint32_t)(dev.ns / TICK_NS)) * TICK_NS;
}

/* Optics */

/* r_d of the radial part for the place t on its scale: tan of the angle, or the angle of a fisheye. */
static double radial(const struct bb_camera_config *c, double t)
{
	const double q = t * t;
	const double odd = c->lens == BB_LENS_FISHEYE ? c->k4 : 0;

	return t + c->k1 * t * q + c->k2 * t * q * q + c->k3 * t * q * q * q + odd * t * q * q * q * q;
}

/* Glass never folds, a polynomial does: from where it no longer grows outwards nothing arrives on the sensor. */
static bool folds(const struct bb_camera_config *c, double t)
{
	double last = 0;

	for (int i = 1; i <= 16; i++) {
		const double next = radial(c, t * i / 16);
		if (next < last || (t > 1e-6 && next == last))
			return true;
		last = next;
	}
	return radial(c, t * 0.999) > last;
}

bool sim_camera_pixel(const struct bb_camera_config *config, struct bb_vec3 p, double px[2])
{
	if (!(p.z > 0))
		return false;
	const bool fisheye = config->lens == BB_LENS_FISHEYE;
	const double across = hypot(p.x, p.y), along = atan2(p.y, p.x);
	const double t = fisheye ? atan2(across, p.z) : across / p.z;
	if (folds(config, t))
		return false;
	const double rd = radial(config, t);
	double u = rd * cos(along), v = rd * sin(along);
	if (!fisheye) { /* a lens that sits askew on its sensor */
		const double x = p.x / p.z, y = p.y / p.z;
		u += 2 * config->p1 * x * y + config->p2 * (3 * x * x + y * y);
		v += config->p1 * (x * x + 3 * y * y) + 2 * config->p2 * x * y;
	}
	px[0] = config->cx_px + config->fx_px * u;
	px[1] = config->cy_px + config->fy_px * v;
	return true;
}

bool sim_camera_project(const struct bb_camera_config *config, struct bb_vec3 p, struct bb_blob *out)
{
	double px[2];

	if (!(p.z >= SIM_CAMERA_NEAR_M) || bb_vec3_norm(p) > SIM_CAMERA_FAR_M || !sim_camera_pixel(config, p, px))
		return false;
	if (!(px[0] >= -0.5 && px[1] >= -0.5 && px[0] < (double)config->width_px - 0.5 &&
	      px[1] < (double)config->height_px - 0.5))
		return false;
	const double across_px = config->fx_px * SIM_MARKER_DIAMETER_M / p.z;
	*out = (struct bb_blob){ (float)px[0], (float)px[1], (float)(0.78539816339744831 * across_px * across_px) };
	return true;
}

/* Frames */

static struct sim_camera_queued *next_slot(struct sim_camera *c)
{
	if (c->n_queued == QUEUE) {
		c->head = (c->head + 1) % QUEUE;
		c->n_queued--;
		c->dropped++;
	}
	return &c->queue[(c->head + c->n_queued) % QUEUE];
}

static void expose(struct sim_camera *c, int64_t mid_ns)
{
	struct sim_rng r = sim_rng_at(&c->rng, c->seq);
	const bool drop = sim_rng_uniform(&r) * 1e6 < (double)c->drop_ppm;
	const double late = sim_rng_uniform(&r);
	const int64_t least_ns = mid_ns + c->base.limits.least_latency_ns;
	const int64_t arrived_ns = least_ns + (int64_t)(late * (double)c->jitter_ns);
	const uint32_t seq = c->seq++;
	const int64_t dev_ns = stamp(c, mid_ns);

	if (drop)
		return;
	struct sim_camera_queued *q = next_slot(c);
	*q = (struct sim_camera_queued){ .seq = seq, .mid_dev_ns = dev_ns, .stalled = c->stalled > 0 };
	q->arrived_ns = arrived_ns > c->last_arrived_ns ? arrived_ns : c->last_arrived_ns + 1;
	c->last_arrived_ns = q->arrived_ns;
	if (c->frozen) { /* the very same picture, noise and all */
		const struct sim_camera_queued now = *q;
		*q = c->still;
		q->seq = now.seq;
		q->mid_dev_ns = now.mid_dev_ns;
		q->arrived_ns = now.arrived_ns;
		q->stalled = now.stalled;
	} else {
		sim_camera_look(c, mid_ns, &r, q);
		c->still = *q;
	}
	c->n_queued++;
	bb_device_event(&c->base.dev, BB_EV_FRAME, mid_ns, seq, (int64_t)q->n);
}

static int64_t mid_of(const struct sim_camera *c)
{
	return c->start_ns + c->exposure_ns / 2;
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_camera *c = bb_container_of(timer, struct sim_camera, timer);

	(void)now_ns;
	if (c->lost || !c->running)
		return BB_NEVER;
	expose(c, scheduled_ns);
	/* The sensor cannot begin again before it has read out; half a period is when sync comes back at a bad time. */
	c->start_ns = start_after(c, c->start_ns + bb_rate_period_ns(c->base.config.rate) / 2);
	return mid_of(c);
}

static enum bb_status begin(struct sim_camera *c)
{
	c->start_ns = start_after(c, bb_clock_now_ns(c->base.dev.clk));
	return bb_clock_arm(c->base.dev.clk, &c->timer, mid_of(c));
}

/* Ops */

#define OPTION(name, member, least, most) { name, offsetof(struct sim_camera, member), least, most }
static const struct sim_option options[] = {
	OPTION("noise_px", base.config.noise_px, 0, 10),
	OPTION("transfer_us", base.config.transfer_us, 0, 1e5),
	OPTION("transfer_jitter_us", base.config.transfer_jitter_us, 0, 1e5),
	OPTION("readout_us", base.config.readout_us, 0, 1e5),
	OPTION("row_us", base.config.row_us, 0, 100),
	OPTION("marker_mm", lamp.marker_mm, 1, 200),
	OPTION("marker_grey", lamp.marker_grey, 0, 1e5),
	OPTION("mirror", lamp.mirror, 0, 1),
	OPTION("psf_px", sensor.psf_px, 0.3, 10),
	OPTION("read_noise", sensor.read_noise, 0, 30),
	OPTION("full_well_e", sensor.full_well_e, 100, 1e6),
	OPTION("black", sensor.black, 0, 100),
	OPTION("sun_grey", sensor.sun_grey, 0, 1e4),
	OPTION("sun_x", sensor.sun_x, 0, 1),
	OPTION("sun_y", sensor.sun_y, 0, 1),
	OPTION("sun_px", sensor.sun_px, 1, 200),
	{ NULL, 0, 0, 0 },
};
static const struct sim_sensor usual_sensor = { .psf_px = 0.8, .read_noise = 1, .full_well_e = 10000, .black = 4,
	                                        .sun_x = 0.3, .sun_y = 0.3, .sun_px = 30 };
static const struct sim_lamp usual_lamp = { .marker_mm = SIM_MARKER_DIAMETER_M * 1e3, .marker_grey = 250 };

static bool in(double value, double least, double most)
{
	return value >= least && value <= most; /* false for NaN */
}

static enum bb_status check_config(struct sim_camera *c)
{
	const struct bb_camera_config *k = &c->base.config;

	if (!k->rate.num || !k->rate.den || !in(bb_rate_hz(k->rate), 1, 1000))
		return bb_device_fail(&c->base.dev, BB_ERR_RANGE, "open", "rate %u/%u", k->rate.num, k->rate.den);
	if (!in(k->exposure_us, 1, 1e6) || !in(k->sync_offset_us, 0, 1e6) || !in(k->readout_us, 0, 1e5) ||
	    !in(k->row_us, 0, 100) || !in(k->transfer_us, 0, 1e5) || !in(k->transfer_jitter_us, 0, 1e5) || !in(k->noise_px, 0, 100) ||
	    k->exposure_us * 1000 >= (double)bb_rate_period_ns(k->rate))
		return bb_device_fail(&c->base.dev, BB_ERR_RANGE, "open", "a time or the noise is out of range");
	if (!in(k->fx_px, 1, 1e6) || !in(k->fy_px, 1, 1e6) || k->width_px < 2 || k->height_px < 2 ||
	    k->width_px > 65536 || k->height_px > 65536 || !isfinite(k->k1 + k->k2 + k->k3 + k->k4 + k->p1 + k->p2 + k->cx_px + k->cy_px))
		return bb_device_fail(&c->base.dev, BB_ERR_RANGE, "open", "the lens or the sensor is out of range");
	return BB_OK;
}

/* What can be had from a picture: the Cramer-Rao bound of a Gaussian spot of 100 levels, whatever its width, in even noise
 * of as much as in its middle. */
static double picture_error_px(const struct sim_sensor *s)
{
	const double peak = 100, per_e = (255 - s->black) / s->full_well_e;

	return 0.79788456080286536 * sqrt(s->read_noise * s->read_noise + 1.0 / 12 + peak * per_e) / peak;
}

static void set_limits(struct sim_camera *c)
{
	c->base.limits = (struct bb_camera_limits){
		.least_rate_hz = 1,
		.most_rate_hz = 1000,
		.most_blobs = SIM_CAMERA_BLOBS,
		.least_latency_ns = c->exposure_ns - c->exposure_ns / 2 + c->readout_ns + c->transfer_ns,
		.stamp_error_ns = c->ideal ? 0 : TICK_NS,
		.blob_error_px = c->picture ? picture_error_px(&c->sensor) : c->ideal ? 0 : c->base.config.noise_px,
		.grey = c->picture != NULL,
		.black = c->sensor.black,
		.black_noise = c->sensor.read_noise,
	};
}

static void draw_unit(struct sim_camera *c, const struct bb_open *open)
{
	struct sim_rng *r = &c->rng;
	const int64_t period_ns = bb_rate_period_ns(c->base.config.rate);
	struct bb_vec3 axis;

	sim_rng_seed(r, open->seed, "camera", c->base.dev.id);
	c->own_phase_ns = (int64_t)(sim_rng_uniform(r) * (double)period_ns);
	c->own_ppb = (int64_t)((2 * sim_rng_uniform(r) - 1) * OWN_RATE_PPM * 1000);
	c->dev_ppb = (int64_t)((2 * sim_rng_uniform(r) - 1) * DEVICE_CLOCK_PPM * 1000);
	c->dev_zero_ns = bb_clock_now_ns(c->base.dev.clk);
	c->dev_start = (uint32_t)sim_rng_u64(r);
	if (sim_rng_uniform(r) < 0.25) /* a counter wraps every 71 minutes: let every fourth camera do it soon */
		c->dev_start = UINT32_MAX - c->dev_start % 20000000;
	axis.x = sim_rng_normal(r);
	axis.y = sim_rng_normal(r);
	axis.z = sim_rng_normal(r);
	c->bump_axis = bb_vec3_unit(axis, (struct bb_vec3){ 0, 1, 0 });
	if (c->ideal)
		c->own_ppb = 0;
}

static enum bb_status camera_open(struct bb_camera *cam, const struct bb_open *open)
{
	struct sim_camera *c = own(cam);
	const struct bb_camera_config *k = &cam->config;

	c->world = open->world;
	c->ideal = open->fidelity == 0;
	c->sensor = usual_sensor;
	c->lamp = usual_lamp;
	enum bb_status status = sim_options_read(&cam->dev, open->uri, options, c);
	if (status == BB_OK)
		status = check_config(c);
	if (status != BB_OK)
		return status;
	c->exposure_ns = llround(k->exposure_us * 1000);
	c->offset_ns = llround(k->sync_offset_us * 1000);
	c->readout_ns = llround(k->readout_us * 1000);
	c->transfer_ns = llround(k->transfer_us * 1000);
	c->jitter_ns = c->ideal ? 0 : llround(k->transfer_jitter_us * 1000);
	c->lamp.lamp_ns = c->exposure_ns;
	c->lamp.lamp_m = fmax(bb_vec3_norm(bb_vec3_sub(sim_world_room(c->world)->neutral, k->pose.p)), 1);
	if (open->fidelity >= 2)
		status = sim_picture_create(&c->sensor, k->width_px, k->height_px, &c->picture);
	if (status != BB_OK)
		return status;
	set_limits(c);
	draw_unit(c, open);
	c->timer = (struct bb_timer){ .step = step, .rank = 1 };
	c->queue = calloc(QUEUE, sizeof(*c->queue));
	status = c->queue ? sim_world_register(c->world, "camera", cam->dev.id, c, sim_camera_verbs) : BB_ERR_NOMEM;
	if (status != BB_OK) {
		free(c->queue);
		sim_picture_destroy(c->picture);
	}
	return status;
}

static void camera_close(struct bb_camera *cam)
{
	struct sim_camera *c = own(cam);

	sim_world_unregister(c->world, c);
	bb_clock_disarm(cam->dev.clk, &c->timer);
	free(c->queue);
	sim_picture_destroy(c->picture);
}

static enum bb_status gone(struct sim_camera *c, const char *op)
{
	return bb_device_fail(&c->base.dev, BB_ERR_LOST, op, "no answer on the bus");
}

static enum bb_status quarantined(struct sim_camera *c)
{
	return bb_device_fail(&c->base.dev, BB_ERR_LOST, "read", "QUARANTINED: too many resets; stop and start it");
}

static enum bb_status camera_start(struct bb_camera *cam)
{
	struct sim_camera *c = own(cam);

	if (c->lost)
		return gone(c, "start");
	c->stalls = 0;
	if (c->running)
		return BB_OK;
	c->running = true;
	return begin(c);
}

static enum bb_status camera_stop(struct bb_camera *cam)
{
	struct sim_camera *c = own(cam);

	if (c->lost)
		return gone(c, "stop");
	c->running = false;
	c->n_queued = 0;
	bb_clock_disarm(cam->dev.clk, &c->timer);
	return BB_OK;
}

/* Drawn when it is fetched: what nobody reads costs nothing. */
static void deliver(struct sim_camera *c, const struct sim_camera_queued *q, struct bb_camera_frame *frame)
{
	if (c->picture && frame->grey) {
		struct sim_rng noise = q->noise;
		sim_picture_draw(c->picture, q->light, q->n_lights, q->sun, &noise, frame->grey);
		frame->has_grey = true;
		return;
	}
	frame->n = q->n < frame->cap ? q->n : frame->cap;
	frame->overflow = q->overflow || q->n > frame->cap;
	memcpy(frame->blobs, q->blob, frame->n * sizeof(*q->blob));
}

static struct sim_camera_queued *arrived(struct sim_camera *c)
{
	struct sim_camera_queued *q = &c->queue[c->head];

	return c->n_queued && q->arrived_ns <= bb_clock_now_ns(c->base.dev.clk) ? q : NULL;
}

/* As drivers/camera_usb.c treats it (row K8): what came of a frame is thrown away, the endpoint cleared and, three times,
 * the device reset; then it is left alone until somebody starts it by hand. */
static void throw_stalled(struct sim_camera *c)
{
	for (struct sim_camera_queued *q; c->stalls <= STALLS_MOST && (q = arrived(c)) && q->stalled; c->n_queued--) {
		(void)bb_device_fail(&c->base.dev, BB_ERR_IO, "read", "USB_ERR: stalled, frame %u is lost", q->seq);
		c->head = (c->head + 1) % QUEUE;
		c->stalls++;
	}
}

static enum bb_status camera_read(struct bb_camera *cam, struct bb_camera_frame *frame)
{
	struct sim_camera *c = own(cam);

	if (c->lost)
		return gone(c, "read");
	throw_stalled(c);
	if (c->stalls > STALLS_MOST)
		return quarantined(c);
	const struct sim_camera_queued *q = arrived(c);
	if (!q)
		return BB_TIMEOUT;
	c->stalls = 0;
	frame->seq = q->seq;
	frame->mid_exposure = (struct bb_dev_ns){ q->mid_dev_ns };
	frame->arrived_ns = q->arrived_ns;
	deliver(c, q, frame);
	c->head = (c->head + 1) % QUEUE;
	c->n_queued--;
	return BB_OK;
}

static enum bb_status camera_set_exposure(struct bb_camera *cam, int64_t exposure_ns, int64_t offset_ns)
{
	struct sim_camera *c = own(cam);
	const int64_t period_ns = bb_rate_period_ns(cam->config.rate);

	if (c->lost)
		return gone(c, "set_exposure");
	if (exposure_ns < 1000 || exposure_ns >= period_ns || offset_ns >= period_ns)
		return BB_ERR_RANGE;
	c->exposure_ns = exposure_ns;
	c->offset_ns = offset_ns;
	set_limits(c);
	return c->running ? begin(c) : BB_OK;
}

static const struct bb_camera_ops ops = { camera_open,  camera_close, camera_start,
	                                  camera_stop,  camera_read,  camera_set_exposure };
const struct bb_camera_driver sim_camera_driver = { "sim", sizeof(struct sim_camera), &ops };

uint64_t sim_camera_dropped(const struct bb_camera *cam)
{
	return ((const struct sim_camera *)(const void *)cam)->dropped;
}

/* Verbs. Sums in integers, so that faults may overlap and end in any order without a trace. */

static enum bb_status amount(struct sim_camera *c, const struct sim_fault_args *args, const char *key, double most,
                             double scale, int64_t *sum, bool on, struct bb_error *err)
{
	double value;
	const enum bb_status status = sim_fault_range(args, key, SIM_FAULT_REQUIRED, 0, most, &value, err);

	if (status == BB_OK && c)
		*sum += on ? llround(value * scale) : -llround(value * scale);
	return status;
}

static enum bb_status verb_cover(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	(void)args;
	(void)err;
	if (c)
		c->covered += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status verb_drop(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	return amount(c, args, "percent", 100, 1e4, c ? &c->drop_ppm : NULL, on, err);
}

static enum bb_status verb_noise(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	return amount(c, args, "px", 100, 1e9, c ? &c->noise_npx : NULL, on, err);
}

static enum bb_status verb_bump(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	return amount(c, args, "deg", 180, 1e9, c ? &c->bump_ndeg : NULL, on, err);
}

static enum bb_status verb_flood(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	return amount(c, args, "n", 10000, 1, c ? &c->flood : NULL, on, err);
}

static enum bb_status verb_sun(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	return amount(c, args, "grey", 10000, 1e3, c ? &c->sun_mgrey : NULL, on, err);
}

static enum bb_status verb_mirror(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	return amount(c, args, "percent", 100, 1e4, c ? &c->mirror_ppm : NULL, on, err);
}

static enum bb_status verb_unplug(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	(void)args;
	(void)err;
	if (!c)
		return BB_OK;
	c->lost += on ? 1 : -1;
	c->n_queued = 0;
	bb_clock_disarm(c->base.dev.clk, &c->timer);
	return c->lost || !c->running ? BB_OK : begin(c);
}

static enum bb_status verb_freerun(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	(void)args;
	(void)err;
	if (c)
		c->freerun += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status verb_stall(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	(void)args;
	(void)err;
	if (c)
		c->stalled += on ? 1 : -1;
	return BB_OK;
}

static enum bb_status verb_freeze(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_camera *c = device;

	(void)args;
	(void)err;
	if (c)
		c->frozen += on ? 1 : -1;
	return BB_OK;
}

const struct sim_verb sim_camera_verbs[] = {
	{ "cover", "", "something hangs over the lens: frames without blobs", "", verb_cover },
	{ "dark", "", "its lamps are dead: frames without blobs", "", verb_cover },
	{ "drop", "percent=N", "that share of the frames is lost in transfer", "percent=30", verb_drop },
	{ "noise", "px=N", "blob centres scatter by that much more (standard deviation)", "px=1.5", verb_noise },
	{ "bump", "deg=N", "someone knocked it: it looks that far elsewhere", "deg=2", verb_bump },
	{ "flood", "n=N", "that many stray blobs in each frame", "n=20", verb_flood },
	{ "sun", "grey=N", "a patch of sun in its picture, that many grey levels in the middle", "grey=400", verb_sun },
	{ "mirror", "percent=N", "the floor is polished: so much of the markers' light comes from below", "percent=20",
	  verb_mirror },
	{ "unplug", "", "it is gone from the bus", "", verb_unplug },
	{ "freerun", "", "its sync cable is out: it exposes by its own clock", "", verb_freerun },
	{ "freeze", "", "the picture stands still while frames keep coming", "", verb_freeze },
	{ "stall", "", "its transfers stall: what comes of a frame is thrown away; five in a row and it is left alone", "", verb_stall },
	{ NULL, NULL, NULL, NULL, NULL },
};
