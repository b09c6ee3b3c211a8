/* drivers/camera_usb.c: see drivers/camera_usb.h. One thread, the owner's; on posix only open and start may wait. */
#include "drivers/camera_usb.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/bus_usb.h"
#include "drivers/camera_usb_time.h"
#include "drivers/trackir_codec.h"
#include "hal/camera_driver.h"

#define MS_NS INT64_C(1000000)
#define OPEN_NS (1000 * MS_NS)       /* set-up at open may take that long */
#define ANSWER_NS (200 * MS_NS)      /* a reply */
#define LOOK_NS (100 * MS_NS)        /* between looks for a camera that is gone */
#define LOOK_MOST_NS (5000 * MS_NS)
#define RESET_NS (2000 * MS_NS)
#define SILENT_NS (250 * MS_NS)      /* more than 30 % loss ever makes */
#define PING_NS (50 * MS_NS)
#define MINUTE_NS (60000 * MS_NS)
#define RESETS_A_MINUTE 3
#define REOPENS_A_MINUTE 5
#define GOOD_FRAMES 3                /* end a fault */
#define DARK_FRAMES 5                /* are a blind camera, */
#define LIT_FRAMES 10                /* and these end it */
#define REJECTS 5                    /* in a row: its counters began again behind our back */
#define TRANSFERS_A_READ 8
#define RELOADS 20

enum stage { GONE, SETUP, READY, RESETTING, QUARANTINED };

struct camera_usb {
	struct bb_camera base;
	struct bb_usb_host libusb, *host;
	struct bb_usb_bus *bus;
	struct bb_usb_match match;
	bool stamped;
	uint8_t threshold;
	enum stage stage;
	bool wanted;                 /* started */
	int64_t exposure_ns, offset_ns;
	size_t step, reloads;        /* of the set-up */
	bool asked;
	int64_t step_by_ns, reset_by_ns, heard_ns, look_ns, look_gap_ns;
	bool cleared, pinged;
	uint32_t good, dark, lit, rejects;
	int64_t reset_at_ns[RESETS_A_MINUTE], reopen_at_ns[REOPENS_A_MINUTE];
	struct camera_usb_time time;
	struct camera_usb_health health;
	struct trackir_stream stream;
	uint8_t buffer[TRACKIR_READ_BYTES];
};

static struct camera_usb *own(struct bb_camera *cam)
{
	return bb_container_of(cam, struct camera_usb, base);
}

static int64_t now_of(const struct camera_usb *c)
{
	return bb_clock_now_ns(c->base.dev.clk);
}

/* Health */

static void set_fault(struct camera_usb *c, enum bb_health health, const char *fault)
{
	if (c->health.fault != fault)
		bb_log(c->base.dev.log, BB_LOG_WARN, BB_BLAME_DEVICE, c->base.dev.id, "%s", fault);
	c->health.health = health;
	c->health.fault = fault;
	c->good = 0;
}

static enum bb_status closed(struct camera_usb *c, const char *op)
{
	const bool quarantined = c->stage == QUARANTINED;

	return bb_device_fail(&c->base.dev, BB_ERR_LOST, op, "%s: %s", quarantined ? "QUARANTINED" : "CAM_GONE",
	                      quarantined ? "too many resets or re-opens a minute; stop and start it"
	                                  : c->host->why);
}

static void close_bus(struct camera_usb *c)
{
	if (c->bus)
		c->bus->ops->close(c->bus);
	c->bus = NULL;
	c->health.partial += c->stream.n > 0;
	c->stream.n = 0;
	c->time.broken = c->time.any;
}

static enum bb_status quarantine(struct camera_usb *c, const char *op)
{
	close_bus(c);
	c->stage = QUARANTINED;
	set_fault(c, BB_HEALTH_QUARANTINED, "QUARANTINED");
	return closed(c, op);
}

static enum bb_status gone(struct camera_usb *c, const char *op)
{
	close_bus(c);
	c->stage = GONE;
	c->look_ns = now_of(c) + LOOK_NS;
	c->look_gap_ns = LOOK_NS;
	snprintf(c->host->why, sizeof(c->host->why), "it left the bus");
	set_fault(c, BB_HEALTH_LOST, "CAM_GONE");
	return closed(c, op);
}

/* Notes one more; true: with it there are more than n in the last minute. */
static bool too_often(int64_t *at_ns, size_t n, int64_t now_ns)
{
	const bool often = at_ns[0] && now_ns - at_ns[0] < MINUTE_NS;

	memmove(at_ns, at_ns + 1, (n - 1) * sizeof(*at_ns));
	at_ns[n - 1] = now_ns > 0 ? now_ns : 1; /* 0 means: none yet */
	return often;
}

/* Wire */

static enum bb_status send(struct camera_usb *c, struct trackir_command command)
{
	size_t n = command.n;

	return c->bus->ops->transfer(c->bus, TRACKIR_ENDPOINT_OUT, command.bytes, &n, now_of(c));
}

static enum bb_status receive(struct camera_usb *c, int64_t deadline_ns, enum trackir_item *item)
{
	size_t n = sizeof(c->buffer);
	const enum bb_status status = c->bus->ops->transfer(c->bus, TRACKIR_ENDPOINT_IN, c->buffer, &n, deadline_ns);

	*item = TRACKIR_NOTHING;
	if (status != BB_OK)
		return status;
	c->heard_ns = now_of(c);
	c->pinged = false;
	*item = trackir_stream_add(&c->stream, c->buffer, n);
	return BB_OK;
}

static enum bb_status send_exposure(struct camera_usb *c)
{
	struct trackir_command pair[2];

	trackir_exposure((uint32_t)(c->exposure_ns / TRACKIR_LINE_NS), pair);
	enum bb_status status = send(c, pair[0]);
	if (status == BB_OK)
		status = send(c, pair[1]);
	if (status == BB_OK && c->stamped)
		status = send(c, trackir_sync_offset((uint32_t)(c->offset_ns / 1000)));
	return status;
}

static enum bb_status send_all(struct camera_usb *c, const struct trackir_command *commands, size_t n)
{
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < n && status == BB_OK; i++)
		status = send(c, commands[i]);
	return status;
}

static enum bb_status send_video(struct camera_usb *c, bool on)
{
	c->heard_ns = now_of(c);
	c->pinged = false;
	if (on)
		return send(c, trackir_video(true));
	return send_all(c, (struct trackir_command[]){ trackir_video(false), trackir_simple(TRACKIR_CMD_STOP) }, 2);
}

/* Set-up: steps that each end with a question, but the last. */

static enum bb_status ask(struct camera_usb *c)
{
	const struct trackir_command first[] = { trackir_simple(TRACKIR_CMD_STOP), trackir_video(false),
		                                 trackir_leds(0, TRACKIR_LED_ALL), trackir_simple(TRACKIR_CMD_FLUSH),
		                                 trackir_simple(TRACKIR_CMD_GET_CONFIG) };
	const struct trackir_command second[] = { trackir_start_set(), trackir_simple(TRACKIR_CMD_FLUSH),
		                                  trackir_simple(TRACKIR_CMD_STOP),
		                                  trackir_simple(TRACKIR_CMD_GET_STATUS) };
	const struct trackir_command reload[] = { trackir_simple(TRACKIR_CMD_RELOAD),
		                                  trackir_simple(TRACKIR_CMD_GET_STATUS) };
	const struct trackir_command last[] = { trackir_threshold(c->threshold),
		                                trackir_leds(TRACKIR_LED_IR, TRACKIR_LED_IR) };
	enum bb_status status;

	switch (c->step) {
	case 0:
		return send_all(c, first, BB_ARRAY_LEN(first));
	case 1:
		return c->reloads ? send_all(c, reload, BB_ARRAY_LEN(reload))
		                  : send_all(c, second, BB_ARRAY_LEN(second));
	default:
		status = send_all(c, last, BB_ARRAY_LEN(last));
		return status == BB_OK ? send_exposure(c) : status;
	}
}

static void set_up_from_start(struct camera_usb *c)
{
	c->stage = SETUP;
	c->step = c->reloads = 0;
	c->asked = false;
	c->health.partial += c->stream.n > 0;
	c->stream.n = 0;
	c->time.broken = c->time.any;
}

/* What an answer does to the set-up. */
static enum bb_status answered(struct camera_usb *c, enum trackir_item item)
{
	if (c->step == 0 && item == TRACKIR_CONFIG) {
		c->step = 1;
		c->asked = false;
	} else if (c->step == 1 && item == TRACKIR_STATUS) {
		if (!c->stream.status.firmware_loaded)
			return bb_device_fail(&c->base.dev, BB_ERR_UNSUPPORTED, "open",
			                      "no firmware in it: load the vendor's with the vendor's tool first");
		c->asked = false;
		if (c->stream.status.config_flag != 1)
			c->step = 2;
		else if (++c->reloads > RELOADS)
			return bb_device_fail(&c->base.dev, BB_ERR_IO, "open", "USB_ERR: it does not take its settings");
	}
	return BB_OK;
}

static enum bb_status set_up_step(struct camera_usb *c, int64_t wait_until_ns)
{
	enum trackir_item item;
	enum bb_status status;

	if (!c->asked) {
		status = ask(c);
		if (status != BB_OK)
			return status;
		c->asked = true;
		c->step_by_ns = now_of(c) + ANSWER_NS;
		if (c->step == 2) {
			c->stage = READY;
			return c->wanted ? send_video(c, true) : BB_OK;
		}
	}
	status = receive(c, wait_until_ns, &item);
	if (status == BB_OK)
		return answered(c, item);
	if (status == BB_TIMEOUT && now_of(c) >= c->step_by_ns)
		return bb_device_fail(&c->base.dev, BB_ERR_IO, "open", "USB_ERR: no answer in set-up step %zu", c->step);
	return status;
}

static enum bb_status set_up(struct camera_usb *c)
{
	enum bb_status status = BB_OK;

	for (int i = 0; i < 64 && c->stage == SETUP && status == BB_OK; i++) /* stale frames may stand before answers */
		status = set_up_step(c, now_of(c));
	return status;
}

/* At open and start: waits, where time is real. */
static enum bb_status set_up_now(struct camera_usb *c)
{
	const int64_t end_ns = now_of(c) + OPEN_NS;
	enum bb_status status;

	do {
		status = set_up_step(c, now_of(c) + 20 * MS_NS);
		if (status == BB_TIMEOUT && bb_clock_is_virtual(c->base.dev.clk))
			return BB_OK; /* read() goes on with it */
	} while (c->stage == SETUP && (status == BB_OK || status == BB_TIMEOUT) && now_of(c) < end_ns);
	if (status == BB_OK || status == BB_TIMEOUT)
		status = c->stage == READY ? BB_OK
		                           : bb_device_fail(&c->base.dev, BB_ERR_LOST, "open", "it does not answer");
	return status;
}

/* Recovery */

static enum bb_status usb_error(struct camera_usb *c, const char *what)
{
	set_fault(c, BB_HEALTH_DEGRADED, "USB_ERR");
	return bb_device_fail(&c->base.dev, BB_ERR_IO, "read", "USB_ERR: %s", what);
}

static enum bb_status go_on_reset(struct camera_usb *c)
{
	const enum bb_status status = c->bus->ops->reset(c->bus);

	if (status == BB_OK)
		set_up_from_start(c);
	else if (status != BB_TIMEOUT || now_of(c) >= c->reset_by_ns)
		return gone(c, "reset");
	return usb_error(c, status == BB_OK ? "was reset" : "is being reset");
}

static enum bb_status reset(struct camera_usb *c)
{
	const int64_t now_ns = now_of(c);

	if (too_often(c->reset_at_ns, RESETS_A_MINUTE, now_ns))
		return quarantine(c, "reset");
	c->health.resets++;
	c->stage = RESETTING;
	c->reset_by_ns = now_ns + RESET_NS;
	return go_on_reset(c);
}

/* A transfer failed or never came: the halt is cleared once, then the device is reset. */
static enum bb_status trouble(struct camera_usb *c, const char *what)
{
	c->health.stalls++;
	c->health.partial += c->stream.n > 0;
	c->stream.n = 0;
	c->heard_ns = now_of(c);
	c->pinged = false;
	if (c->cleared)
		return reset(c);
	c->cleared = true;
	const enum bb_status status = c->bus->ops->clear_halt(c->bus, TRACKIR_ENDPOINT_IN);
	if (status == BB_ERR_LOST)
		return gone(c, "clear_halt");
	return status == BB_OK ? usb_error(c, what) : reset(c);
}

/* Somebody may have left its endpoint halted. */
static enum bb_status begin_set_up(struct camera_usb *c)
{
	set_up_from_start(c);
	return c->bus->ops->clear_halt(c->bus, TRACKIR_ENDPOINT_IN);
}

static enum bb_status look(struct camera_usb *c)
{
	const int64_t now_ns = now_of(c);

	if (now_ns < c->look_ns)
		return closed(c, "read");
	const enum bb_status status = c->host->open(c->host, &c->match, c->base.dev.clk, now_ns, &c->bus);
	if (status == BB_TIMEOUT)
		return closed(c, "read");
	if (status == BB_OK) {
		if (too_often(c->reopen_at_ns, REOPENS_A_MINUTE, now_ns))
			return quarantine(c, "open");
		c->health.reopens++;
		set_fault(c, BB_HEALTH_RECOVERING, "CAM_GONE");
		c->cleared = false;
		return begin_set_up(c) == BB_OK ? BB_OK : gone(c, "open");
	}
	c->bus = NULL;
	/* Looking at an empty bus is cheap, and a camera must be back within a second; one that is there and cannot be
	 * opened is asked less and less. */
	c->look_gap_ns = status == BB_ERR_LOST ? LOOK_NS : 2 * c->look_gap_ns;
	if (c->look_gap_ns > LOOK_MOST_NS)
		c->look_gap_ns = LOOK_MOST_NS;
	c->look_ns = now_ns + c->look_gap_ns;
	return closed(c, "read");
}

static enum bb_status set_up_on(struct camera_usb *c)
{
	const enum bb_status status = set_up(c);

	if (status == BB_OK || status == BB_TIMEOUT)
		return c->stage == READY ? BB_OK : BB_TIMEOUT;
	if (status == BB_ERR_LOST)
		return gone(c, "open");
	return status == BB_ERR_UNSUPPORTED ? quarantine(c, "open") : trouble(c, "set-up failed");
}

/* Frames */

static void note_light(struct camera_usb *c, size_t n_blobs)
{
	c->lit = n_blobs ? c->lit + 1 : 0;
	c->dark = n_blobs ? 0 : c->dark + 1;
	if (c->dark == DARK_FRAMES) {
		c->health.blind++;
		set_fault(c, BB_HEALTH_DEGRADED, "CAM_BLIND");
	}
}

static void note_frame(struct camera_usb *c, const struct bb_camera_frame *frame, uint32_t lost)
{
	const bool blind = !strcmp(c->health.fault, "CAM_BLIND");

	c->health.frames++;
	c->health.lost += lost;
	c->good++;
	if (lost) {
		bb_device_fail(&c->base.dev, BB_ERR_IO, "read", "CAM_DROP: %u missing before frame %u", lost,
		               frame->seq);
		c->good = 0;
		if (!*c->health.fault)
			set_fault(c, BB_HEALTH_DEGRADED, "CAM_DROP");
	}
	note_light(c, frame->n);
	if (c->good >= GOOD_FRAMES)
		c->cleared = false;
	if (*c->health.fault && c->good >= GOOD_FRAMES && (!blind || c->lit >= LIT_FRAMES) && c->dark < DARK_FRAMES) {
		c->health.fault = "";
		c->health.health = BB_HEALTH_OK;
	} else if (!*c->health.fault)
		c->health.health = BB_HEALTH_OK;
}

static bool deliver(struct camera_usb *c, struct bb_camera_frame *frame)
{
	const struct trackir_packet *p = &c->stream.packet;
	const struct camera_usb_mark mark = { .stamped = p->stamped,
		                              .counter = p->stamped ? p->counter : p->number,
		                              .mid_us = p->mid_us,
		                              .usb_frame = p->usb_frame,
		                              .arrived_ns = c->bus->arrived_ns };
	uint32_t lost;

	if (p->stamped != c->stamped || !camera_usb_time_add(&c->time, &mark, &lost)) {
		c->health.bad++;
		c->time.broken |= c->time.any && ++c->rejects >= REJECTS;
		return false;
	}
	c->rejects = 0;
	frame->seq = c->time.seq;
	frame->mid_exposure.ns = c->time.stamp_ns;
	frame->arrived_ns = mark.arrived_ns;
	const size_t cap = frame->cap < BB_CAMERA_BLOBS_MAX ? frame->cap : BB_CAMERA_BLOBS_MAX;
	frame->n = trackir_blobs(p, frame->blobs, cap, &frame->overflow);
	note_frame(c, frame, lost);
	bb_device_event(&c->base.dev, BB_EV_FRAME, frame->arrived_ns, frame->seq, (int64_t)frame->n);
	return true;
}

/* A camera that follows a sync input may rightly have nothing to show: it is asked whether it is there. */
static enum bb_status silence(struct camera_usb *c)
{
	if (!c->wanted || now_of(c) - c->heard_ns < (c->pinged ? PING_NS : SILENT_NS))
		return BB_TIMEOUT;
	if (!c->stamped || c->pinged)
		return trouble(c, "no packets");
	const enum bb_status status = send(c, trackir_simple(TRACKIR_CMD_GET_STATUS));
	c->heard_ns = now_of(c);
	c->pinged = true;
	return status == BB_ERR_LOST ? gone(c, "read") : BB_TIMEOUT;
}

static enum bb_status read_ready(struct camera_usb *c, struct bb_camera_frame *frame)
{
	enum trackir_item item;

	for (int i = 0; i < TRANSFERS_A_READ; i++) {
		const uint64_t spoilt = c->stream.n_partial + c->stream.n_bad;
		const enum bb_status status = receive(c, now_of(c), &item);
		if (status == BB_TIMEOUT)
			return silence(c);
		if (status != BB_OK)
			return status == BB_ERR_LOST ? gone(c, "read") : trouble(c, "stalled");
		if (c->stream.n_partial + c->stream.n_bad != spoilt) {
			c->health.partial += c->stream.n_partial;
			c->health.bad += c->stream.n_bad;
			c->stream.n_partial = c->stream.n_bad = 0;
			(void)usb_error(c, "a packet was cut short or damaged");
		}
		if (item == TRACKIR_FRAME && c->wanted && deliver(c, frame))
			return BB_OK;
	}
	return BB_TIMEOUT;
}

static enum bb_status camera_read(struct bb_camera *cam, struct bb_camera_frame *frame)
{
	struct camera_usb *c = own(cam);
	enum bb_status status = BB_OK;

	if (c->stage == QUARANTINED)
		return closed(c, "read");
	if (c->stage == GONE)
		status = look(c);
	else if (c->stage == RESETTING)
		return go_on_reset(c);
	if (status == BB_OK && c->stage == SETUP)
		status = set_up_on(c);
	return status == BB_OK ? read_ready(c, frame) : status;
}

/* Other ops */

static bool in(double value, double least, double most)
{
	return value >= least && value <= most; /* false for NaN */
}

static enum bb_status check_config(struct camera_usb *c)
{
	const struct bb_camera_config *k = &c->base.config;

	if (!k->rate.num || !k->rate.den || !in(bb_rate_hz(k->rate), 1, 1000))
		return bb_device_fail(&c->base.dev, BB_ERR_RANGE, "open", "rate %u/%u", k->rate.num, k->rate.den);
	if (!in(k->exposure_us, 16, 1e6) || !in(k->sync_offset_us, 0, 1e6) || !in(k->readout_us, 0, 1e5) ||
	    !in(k->transfer_us, 0, 1e5) || !in(k->transfer_jitter_us, 0, 1e5) || !in(k->noise_px, 0, 100) ||
	    k->exposure_us * 1000 >= (double)bb_rate_period_ns(k->rate))
		return bb_device_fail(&c->base.dev, BB_ERR_RANGE, "open", "a time or the noise is out of range");
	if (k->width_px < 2 || k->height_px < 2 || k->width_px > TRACKIR_WIDTH_PX || k->height_px > TRACKIR_HEIGHT_PX)
		return bb_device_fail(&c->base.dev, BB_ERR_RANGE, "open", "its sensor has at most %dx%d px",
		                      TRACKIR_WIDTH_PX, TRACKIR_HEIGHT_PX);
	return BB_OK;
}

static enum bb_status read_options(struct camera_usb *c, const struct bb_uri *uri)
{
	c->threshold = 96;
	if (!bb_usb_match_read(uri, &c->match))
		return bb_device_fail(&c->base.dev, BB_ERR_CONFIG, "open", "not a USB device: \"%.40s\"", uri->path);
	for (size_t i = 0; i < uri->n_options; i++) {
		const char *key = uri->option[i].key, *value = uri->option[i].value;
		char *end;
		const long number = strtol(value, &end, 10);
		if (!strcmp(key, "serial"))
			continue;
		if (!strcmp(key, "stamps") && (!strcmp(value, "device") || !strcmp(value, "arrival")))
			c->stamped = !strcmp(value, "device");
		else if (!strcmp(key, "threshold") && *value && !*end && number >= TRACKIR_THRESHOLD_LEAST &&
		         number <= TRACKIR_THRESHOLD_MOST)
			c->threshold = (uint8_t)number;
		else
			return bb_device_fail(&c->base.dev, BB_ERR_CONFIG, "open", "option %s=%s", key, value);
	}
	return BB_OK;
}

static void set_limits(struct camera_usb *c)
{
	const struct bb_camera_config *k = &c->base.config;

	c->base.limits = (struct bb_camera_limits){
		.least_rate_hz = 1,
		.most_rate_hz = 1000,
		.most_blobs = BB_CAMERA_BLOBS_MAX,
		.least_latency_ns = c->exposure_ns - c->exposure_ns / 2 + llround(k->readout_us * 1000) +
		                    llround(k->transfer_us * 1000),
		.stamp_error_ns = c->stamped ? 1000 : llround(k->transfer_jitter_us * 1000) + 100000,
		.blob_error_px = hypot(k->noise_px, 0.017 + 0.0002 * c->threshold), /* stripes: as measured */
	};
	c->time.period_ns = bb_rate_period_ns(k->rate);
	c->time.least_latency_ns = c->base.limits.least_latency_ns;
	c->time.jitter_ns = c->base.limits.stamp_error_ns;
}

static enum bb_status open_device(struct camera_usb *c)
{
	enum bb_status status = c->host->open(c->host, &c->match, c->base.dev.clk, now_of(c) + 2 * OPEN_NS, &c->bus);

	if (status == BB_TIMEOUT)
		return bb_device_fail(&c->base.dev, BB_ERR_LOST, "open", "the USB bus does not answer");
	if (status != BB_OK)
		return bb_device_fail(&c->base.dev, status, "open", "%s", c->host->why);
	snprintf(c->health.serial, sizeof(c->health.serial), "%s", c->match.serial);
	status = begin_set_up(c);
	if (status == BB_OK)
		status = set_up_now(c);
	if (status != BB_OK)
		close_bus(c);
	return status;
}

static enum bb_status open_with(struct bb_camera *cam, const struct bb_open *open, struct bb_usb_host *host)
{
	struct camera_usb *c = own(cam);

	c->host = host;
	c->health = (struct camera_usb_health){ .health = BB_HEALTH_INIT, .fault = "" };
	trackir_stream_init(&c->stream);
	enum bb_status status = read_options(c, open->uri);
	if (status == BB_OK)
		status = check_config(c);
	if (status != BB_OK)
		return status;
	c->exposure_ns = llround(cam->config.exposure_us * 1000) / TRACKIR_LINE_NS * TRACKIR_LINE_NS;
	c->offset_ns = c->stamped ? llround(cam->config.sync_offset_us * 1000) : 0;
	set_limits(c);
	status = open_device(c);
	if (status != BB_OK)
		host->close(host);
	return status;
}

static enum bb_status camera_open(struct bb_camera *cam, const struct bb_open *open)
{
	bb_usb_host_init(&own(cam)->libusb);
	return open_with(cam, open, &own(cam)->libusb);
}

static void camera_close(struct bb_camera *cam)
{
	struct camera_usb *c = own(cam);

	if (c->bus && c->stage == READY) {
		(void)send_video(c, false); /* as good as it goes: the lamps need not burn */
		(void)send(c, trackir_leds(0, TRACKIR_LED_ALL));
	}
	close_bus(c);
	c->host->close(c->host);
}

static enum bb_status camera_start(struct bb_camera *cam)
{
	struct camera_usb *c = own(cam);
	enum bb_status status = BB_OK;

	if (c->stage == QUARANTINED) {
		memset(c->reset_at_ns, 0, sizeof(c->reset_at_ns));
		memset(c->reopen_at_ns, 0, sizeof(c->reopen_at_ns));
		c->cleared = false;
		set_fault(c, BB_HEALTH_RECOVERING, "CAM_GONE");
		status = open_device(c);
		if (status != BB_OK)
			return gone(c, "start");
	}
	if (c->stage == GONE)
		return closed(c, "start");
	if (c->wanted)
		return BB_OK;
	if (c->stage == READY)
		status = send_video(c, true);
	if (status == BB_ERR_LOST)
		return gone(c, "start");
	c->wanted = status == BB_OK;
	return status;
}

static enum bb_status camera_stop(struct bb_camera *cam)
{
	struct camera_usb *c = own(cam);

	c->wanted = false;
	if (c->stage == GONE || c->stage == QUARANTINED)
		return closed(c, "stop");
	const enum bb_status status = c->stage == READY ? send_video(c, false) : BB_OK;
	return status == BB_ERR_LOST ? gone(c, "stop") : status;
}

static enum bb_status camera_set_exposure(struct bb_camera *cam, int64_t exposure_ns, int64_t offset_ns)
{
	struct camera_usb *c = own(cam);
	const int64_t period_ns = bb_rate_period_ns(cam->config.rate), lines = exposure_ns / TRACKIR_LINE_NS;

	if (c->stage == GONE || c->stage == QUARANTINED)
		return closed(c, "set_exposure");
	if (lines < 1 || lines > 0xFFFF || exposure_ns >= period_ns || offset_ns >= period_ns)
		return BB_ERR_RANGE;
	if (offset_ns && !c->stamped)
		return bb_device_fail(&cam->dev, BB_ERR_UNSUPPORTED, "set_exposure", "it has no sync input");
	c->exposure_ns = lines * TRACKIR_LINE_NS;
	c->offset_ns = offset_ns;
	set_limits(c);
	const enum bb_status status = c->stage == READY ? send_exposure(c) : BB_OK;
	return status == BB_ERR_LOST ? gone(c, "set_exposure") : status;
}

static const struct bb_camera_ops ops = { camera_open,  camera_close, camera_start,
	                                  camera_stop,  camera_read,  camera_set_exposure };
const struct bb_camera_driver bb_camera_usb_driver = { "usb", sizeof(struct camera_usb), &ops };

/* Through bb_camera_open like any other, with the host behind the struct it is given. */
struct open_on {
	struct bb_open open;
	struct bb_usb_host *host;
};

static enum bb_status camera_open_on(struct bb_camera *cam, const struct bb_open *open)
{
	const struct open_on *on = (const struct open_on *)(const void *)open; /* open is the first member */

	return open_with(cam, open, on->host);
}

enum bb_status camera_usb_open_on(struct bb_usb_host *host, const struct bb_camera_config *config,
                                  const struct bb_open *open, struct bb_camera **out)
{
	static const struct bb_camera_ops on_ops = { camera_open_on, camera_close, camera_start,
		                                     camera_stop,    camera_read,  camera_set_exposure };
	static const struct bb_camera_driver driver = { "usb", sizeof(struct camera_usb), &on_ops };
	const struct open_on on = { *open, host };

	return bb_camera_open(&driver, config, &on.open, out);
}

const struct camera_usb_health *camera_usb_health(const struct bb_camera *cam)
{
	return &((const struct camera_usb *)(const void *)cam)->health; /* base is the first member */
}
