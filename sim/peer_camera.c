/* sim/peer_camera.c: see sim/peer_camera.h. Driven by whoever carries the USB device; one thread. */
#include "sim/peer_camera.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/trackir_wire.h"

#define PEAK 250.0
#define SPOT_PX 40          /* half of the widest spot drawn */
#define REPLIES 8
#define MS_NS 1000000

struct reply {
	uint8_t bytes[16];
	size_t n;
};

struct peer_camera {
	struct sim_usb_device usb;
	struct bb_camera *model;
	struct peer_camera_options options;
	bool absent, streaming, lamps, configured, loaded;
	uint8_t threshold, exposure_high;
	int64_t exposure_ns, offset_ns;
	uint32_t firmware;
	uint32_t counter, clock_us; /* added to the model's: they begin again with each power-up but the first */
	bool restarted, sent;
	struct reply reply[REPLIES];
	size_t n_replies;
	uint32_t stall, cut, damage, drop;
	bool mute;
	size_t n_out, sent_out;     /* the packet under way */
	int64_t out_at_ns;
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	uint8_t out[TRACKIR_READ_BYTES];
	uint16_t lit_from[TRACKIR_HEIGHT_PX], lit_to[TRACKIR_HEIGHT_PX]; /* where a line has light: [from, to) */
	uint8_t sensor[TRACKIR_HEIGHT_PX][TRACKIR_WIDTH_PX];
};

static struct peer_camera *own(struct sim_usb_device *dev)
{
	return bb_container_of(dev, struct peer_camera, usb);
}

/* Pictures to bytes */

static void put16(uint8_t *p, uint32_t v)
{
	p[0] = (uint8_t)(v >> 8);
	p[1] = (uint8_t)v;
}

static void put32(uint8_t *p, uint32_t v)
{
	put16(p, v >> 16);
	put16(p + 2, v & 0xFFFF);
}

/* How much of a unit Gaussian's integral along one axis falls into pixel i. */
static double share(double at, double sd, int i)
{
	const double a = (i - 0.5 - at) / sd, b = (i + 0.5 - at) / sd;

	return 0.5 * (erf(b * 0.70710678118654752) - erf(a * 0.70710678118654752));
}

static int clamp(double v, int most)
{
	return v < 0 ? 0 : v > most ? most : (int)v;
}

static void draw_spot(struct peer_camera *p, const struct bb_blob *b)
{
	const double r = sqrt(fmax((double)b->area_px, 0.8) / 3.14159265358979323846);
	const double sd = fmax(r / sqrt(2 * log(PEAK / p->threshold)), 0.4), reach = fmin(4 * sd, SPOT_PX);
	const double x = (double)b->x_px, y = (double)b->y_px;
	const double scale = PEAK * fmax(2 * 3.14159265358979323846 * sd * sd, 1.5);
	const int x0 = clamp(x - reach, TRACKIR_WIDTH_PX - 1), x1 = clamp(x + reach + 1, TRACKIR_WIDTH_PX - 1);
	const int y0 = clamp(y - reach, TRACKIR_HEIGHT_PX - 1), y1 = clamp(y + reach + 1, TRACKIR_HEIGHT_PX - 1);

	for (int j = y0; j <= y1; j++) {
		const double row = scale * share(y, sd, j);
		if (p->lit_from[j] >= p->lit_to[j] || x0 < p->lit_from[j])
			p->lit_from[j] = (uint16_t)x0;
		if (x1 + 1 > p->lit_to[j])
			p->lit_to[j] = (uint16_t)(x1 + 1);
		for (int i = x0; i <= x1; i++) {
			const double v = p->sensor[j][i] + row * share(x, sd, i) + 0.5;
			p->sensor[j][i] = (uint8_t)(v > 255 ? 255 : v);
		}
	}
}

/* One run of bright points as eight bytes, most significant bit first. */
static void put_stripe(uint8_t *out, uint32_t line, uint32_t first, uint32_t points, uint32_t sum_x, uint32_t sum)
{
	while (sum > 0x7FFF || sum_x > 0xFFFFF) { /* the fields are narrow: a wide stripe is scaled */
		sum >>= 1;
		sum_x >>= 1;
	}
	const uint64_t v = (uint64_t)first << 54 | (uint64_t)line << 45 | (uint64_t)points << 35 |
	                   (uint64_t)sum_x << 15 | sum;
	put32(out, (uint32_t)(v >> 32));
	put32(out + 4, (uint32_t)v);
}

static size_t scan_line(struct peer_camera *p, uint32_t line, uint8_t *out, size_t room)
{
	const uint8_t *row = p->sensor[line];
	size_t n = 0;

	for (uint32_t i = p->lit_from[line]; i < p->lit_to[line]; i++) {
		uint32_t sum = 0, sum_x = 0, points = 0;
		while (i + points < TRACKIR_WIDTH_PX && row[i + points] >= p->threshold) {
			const uint32_t weight = row[i + points] - p->threshold + 1u;
			sum += weight;
			sum_x += weight * points++;
		}
		if (!points)
			continue;
		if (n + 8 > room)
			return n;
		put_stripe(out + n, line, i, points, sum_x, sum);
		n += 8;
		i += points;
	}
	return n;
}

static size_t expose(struct peer_camera *p, const struct bb_camera_frame *f, uint8_t *out, size_t room)
{
	uint32_t top = TRACKIR_HEIGHT_PX, bottom = 0;
	size_t n = 0;

	for (size_t i = 0; i < f->n; i++) {
		const double y = (double)f->blobs[i].y_px;
		const uint32_t low = (uint32_t)clamp(y - SPOT_PX, TRACKIR_HEIGHT_PX - 1);
		const uint32_t high = (uint32_t)clamp(y + SPOT_PX + 1, TRACKIR_HEIGHT_PX - 1);
		top = low < top ? low : top;
		bottom = high > bottom ? high : bottom;
		if (p->threshold < PEAK) /* no spot is brighter than that; a width would be no number */
			draw_spot(p, &f->blobs[i]);
	}
	for (uint32_t line = top; line <= bottom; line++) {
		if (!p->lit_to[line])
			continue;
		n += scan_line(p, line, out + n, room - n);
		memset(p->sensor[line], 0, TRACKIR_WIDTH_PX);
		p->lit_from[line] = p->lit_to[line] = 0;
	}
	return n;
}

static void encode(struct peer_camera *p, const struct bb_camera_frame *f)
{
	const uint32_t model_us = (uint32_t)(f->mid_exposure.ns / 1000);

	if (p->restarted) {
		p->counter = 0u - f->seq;
		p->clock_us = 20000u - model_us;
		p->restarted = false;
	}
	p->sent = true;
	const uint32_t number = f->seq + p->counter;
	const uint8_t kind = p->options.stamped ? TRACKIR_KIND_STAMPED : TRACKIR_KIND_LONG;
	uint8_t *out = p->out;
	size_t n = 4;

	out[0] = (uint8_t)number;
	out[1] = TRACKIR_TYPE_PACKET;
	out[2] = kind;
	out[3] = (uint8_t)(out[0] ^ out[1] ^ out[2] ^ TRACKIR_XOR);
	if (p->options.stamped) {
		put32(out + 4, number);
		put32(out + 8, model_us + p->clock_us);
		put16(out + 12, (uint32_t)(f->arrived_ns / MS_NS) & 0x7FF);
		put16(out + 14, 0);
		n += TRACKIR_STAMP_BYTES;
	}
	n += expose(p, f, out + n, sizeof(p->out) - n - 4);
	put32(out + n, (uint32_t)(n - 4));
	p->n_out = n + 4;
	p->sent_out = 0;
	p->out_at_ns = f->arrived_ns;
}

static void spoil(struct peer_camera *p)
{
	if (p->cut) {
		p->cut--;
		p->n_out = p->n_out > 12 ? p->n_out - 6 : 6;
	} else if (p->damage) {
		p->damage--;
		p->out[p->n_out - 1] ^= 0x40;
	}
}

/* Looks at the model: is it there, has it seen something? */
static void pump(struct peer_camera *p)
{
	struct bb_camera_frame f = { .blobs = p->blobs, .cap = BB_CAMERA_BLOBS_MAX };

	while (p->sent_out == p->n_out) {
		const enum bb_status status = bb_camera_read(p->model, &f);
		if (status == BB_ERR_LOST && !p->absent) {
			p->absent = true;
			sim_usb_reset(&p->usb);
		}
		if (status != BB_ERR_LOST && p->absent) { /* plugged in again: it has been without power */
			p->absent = false;
			(void)!bb_camera_stop(p->model);
			return;
		}
		if (status != BB_OK)
			return;
		if (!p->streaming || p->mute)
			continue;
		if (p->drop) {
			p->drop--;
			continue;
		}
		encode(p, &f);
		spoil(p);
	}
}

/* Commands */

static void answer(struct peer_camera *p, const uint8_t *bytes, size_t n)
{
	if (p->n_replies == REPLIES || p->mute)
		return;
	memcpy(p->reply[p->n_replies].bytes, bytes, n);
	p->reply[p->n_replies++].n = n;
}

static void answer_status(struct peer_camera *p)
{
	const uint8_t sum_high = (uint8_t)(p->firmware >> 8), sum_low = (uint8_t)p->firmware;
	const uint8_t bytes[7] = { 0x07, TRACKIR_TYPE_STATUS, 0, p->loaded, sum_high, sum_low, p->configured ? 2 : 1 };

	answer(p, bytes, sizeof(bytes));
}

static void set_exposure(struct peer_camera *p)
{
	if (p->exposure_ns > 0)
		(void)!bb_camera_set_exposure(p->model, p->exposure_ns, p->offset_ns);
}

static int write_register(struct peer_camera *p, const uint8_t *b, size_t n)
{
	if (n != 6 || b[1] != TRACKIR_REGISTER_SENSOR)
		return SIM_USB_STALL;
	if (b[2] == TRACKIR_EXPOSURE_HIGH) {
		p->exposure_high = b[3];
	} else if (b[2] == TRACKIR_EXPOSURE_LOW) { /* the low byte makes it so */
		p->exposure_ns = (int64_t)(p->exposure_high << 8 | b[3]) * TRACKIR_LINE_NS;
		set_exposure(p);
	} else
		return SIM_USB_STALL;
	return (int)n;
}

static int upload(struct peer_camera *p, const uint8_t *b, size_t n)
{
	if (n < 2 || b[1] > 60 || n != 2u + b[1])
		return SIM_USB_STALL;
	for (size_t i = 2; i < n; i++)
		p->firmware = ((p->firmware + b[i]) ^ (uint32_t)b[i] << 4) & 0xFFFF;
	p->loaded = true;
	return (int)n;
}

static int video(struct peer_camera *p, const uint8_t *b, size_t n)
{
	if (n != 2 || b[1] > 1)
		return SIM_USB_STALL;
	p->streaming = b[1] == 0 && p->loaded;
	if (p->streaming)
		return bb_camera_start(p->model) == BB_OK ? 2 : SIM_USB_STALL;
	p->sent_out = p->n_out = 0;
	(void)!bb_camera_stop(p->model);
	return 2;
}

/* A command it does not know, or of a wrong length, halts the endpoint's transfer. */
static int command(struct peer_camera *p, const uint8_t *b, size_t n)
{
	switch (b[0]) {
	case TRACKIR_CMD_LEDS:
		if (n != 3)
			return SIM_USB_STALL;
		if (b[2] & TRACKIR_LED_IR)
			p->lamps = (b[1] & TRACKIR_LED_IR) != 0;
		return 3;
	case TRACKIR_CMD_FLUSH:
		p->sent_out = p->n_out = 0;
		return n == 1 ? 1 : SIM_USB_STALL;
	case TRACKIR_CMD_STOP:
		p->streaming = false;
		return n == 1 ? 1 : SIM_USB_STALL;
	case TRACKIR_CMD_VIDEO:
		return video(p, b, n);
	case TRACKIR_CMD_THRESHOLD:
		if (n != 4 || b[1] < TRACKIR_THRESHOLD_LEAST || b[1] > TRACKIR_THRESHOLD_MOST)
			return SIM_USB_STALL;
		p->threshold = b[1];
		return 4;
	case TRACKIR_CMD_GET_CONFIG:
		answer(p, (const uint8_t[]){ 0x14, TRACKIR_TYPE_CONFIG, 1, 0 }, 4);
		return n == 1 ? 1 : SIM_USB_STALL;
	case TRACKIR_CMD_GET_STATUS:
		answer_status(p);
		return n == 1 ? 1 : SIM_USB_STALL;
	case TRACKIR_CMD_RELOAD:
		p->configured = true;
		return n == 1 ? 1 : SIM_USB_STALL;
	case TRACKIR_CMD_SET:
		return n == 5 ? 5 : SIM_USB_STALL;
	case TRACKIR_CMD_REGISTER:
		return write_register(p, b, n);
	case TRACKIR_CMD_FPGA_INIT:
		p->firmware = 0;
		p->loaded = false;
		return n == 1 ? 1 : SIM_USB_STALL;
	case TRACKIR_CMD_FIRMWARE:
		return upload(p, b, n);
	case TRACKIR_CMD_SYNC_OFFSET:
		if (n != 5 || !p->options.stamped)
			return SIM_USB_STALL;
		p->offset_ns = (int64_t)((uint32_t)b[1] << 24 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 8 | b[4]) * 1000;
		set_exposure(p);
		return 5;
	default:
		return SIM_USB_STALL;
	}
}

/* The USB device */

static int dev_out(struct sim_usb_device *dev, uint8_t endpoint, const uint8_t *bytes, size_t n)
{
	if (endpoint != TRACKIR_ENDPOINT_OUT)
		return SIM_USB_STALL;
	return n ? command(own(dev), bytes, n) : 0;
}

static int take_reply(struct peer_camera *p, uint8_t *bytes, size_t cap)
{
	const size_t n = p->reply[0].n < cap ? p->reply[0].n : cap;

	memcpy(bytes, p->reply[0].bytes, n);
	memmove(p->reply, p->reply + 1, --p->n_replies * sizeof(*p->reply));
	return (int)n;
}

static int dev_in(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap)
{
	struct peer_camera *p = own(dev);
	const size_t most = p->options.most_in_bytes;

	if (endpoint != TRACKIR_ENDPOINT_IN)
		return SIM_USB_STALL;
	if (p->stall) {
		p->stall--;
		sim_usb_halt(dev, endpoint, true);
		return SIM_USB_STALL;
	}
	if (p->n_replies && p->sent_out == p->n_out)
		return take_reply(p, bytes, cap);
	pump(p);
	if (p->absent)
		return SIM_USB_GONE;
	size_t n = p->n_out - p->sent_out;
	if (!n)
		return SIM_USB_NAK;
	if (n > cap)
		n = cap;
	if (most && n > most)
		n = most;
	memcpy(bytes, p->out + p->sent_out, n);
	p->sent_out += n;
	dev->in_at_ns = p->out_at_ns;
	return (int)n;
}

static void dev_reset(struct sim_usb_device *dev)
{
	struct peer_camera *p = own(dev);

	p->restarted = p->sent;
	p->streaming = p->lamps = false;
	p->threshold = 96;
	p->n_replies = p->n_out = p->sent_out = 0;
	p->exposure_ns = 0;
	p->offset_ns = p->options.offset_ns;
	p->configured = !p->options.needs_reload;
	(void)!bb_camera_stop(p->model);
}

static bool dev_present(struct sim_usb_device *dev)
{
	struct peer_camera *p = own(dev);

	pump(p);
	return !p->absent;
}

static const struct sim_usb_ops ops = { sim_usb_no_control, dev_in, dev_out, dev_reset, dev_present };

static const uint8_t device_descriptor[18] = { 18, 1, 0x00, 0x02, 0xFF, 0, 0, 64, TRACKIR_VENDOR & 0xFF,
	                                       TRACKIR_VENDOR >> 8, TRACKIR_TIR5 & 0xFF, TRACKIR_TIR5 >> 8, 0x00,
	                                       0x01, 1, 2, 3, 1 };
static const uint8_t config_descriptor[32] = {
	9, 2, 32, 0, 1, 1, 0, 0x80, 250,                     /* one interface, 500 mA */
	9, 4, 0,  0, 2, 0xFF, 0xFF, 0xFF, 0,                 /* vendor class, two endpoints */
	7, 5, TRACKIR_ENDPOINT_OUT, 2, 0x00, 0x02, 0,        /* bulk, 512 bytes */
	7, 5, TRACKIR_ENDPOINT_IN, 2, 0x00, 0x02, 0,
};

enum bb_status peer_camera_create(struct bb_camera *model, const struct peer_camera_options *options,
                                  struct peer_camera **out)
{
	struct peer_camera *p = calloc(1, sizeof(*p));

	*out = p;
	if (!p)
		return BB_ERR_NOMEM;
	p->model = model;
	p->options = *options;
	p->counter = options->counter;
	p->clock_us = options->clock_us;
	p->loaded = !options->no_firmware;
	p->usb = (struct sim_usb_device){ .ops = &ops,
		                          .speed = SIM_USB_HIGH,
		                          .device = device_descriptor,
		                          .config = config_descriptor,
		                          .n_config = sizeof(config_descriptor),
		                          .string = { NULL, "blackburst", "simulated IR camera", options->serial } };
	dev_reset(&p->usb);
	return BB_OK;
}

void peer_camera_destroy(struct peer_camera *p)
{
	free(p);
}

struct sim_usb_device *peer_camera_usb(struct peer_camera *p)
{
	return &p->usb;
}

bool peer_camera_streams(const struct peer_camera *p)
{
	return p->streaming;
}

uint16_t peer_camera_firmware_sum(const struct peer_camera *p)
{
	return (uint16_t)p->firmware;
}

bool peer_camera_lamps(const struct peer_camera *p)
{
	return p->lamps;
}

void peer_camera_world_stall(struct peer_camera *p, uint32_t times)
{
	p->stall = times;
}

void peer_camera_world_cut(struct peer_camera *p, uint32_t packets)
{
	p->cut = packets;
}

void peer_camera_world_damage(struct peer_camera *p, uint32_t packets)
{
	p->damage = packets;
}

void peer_camera_world_drop(struct peer_camera *p, uint32_t frames)
{
	p->drop = frames;
}

void peer_camera_world_mute(struct peer_camera *p, bool mute)
{
	p->mute = mute;
}
