/* drivers/gamepad_evdev.c: see drivers/gamepad_evdev.h. */
#include "drivers/gamepad_evdev.h"

#include <linux/input.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "drivers/pad_uri.h"
#include "hal/file.h"

#define STEPS 32767
#define EVENTS_AT_ONCE 32
#define MAPPING_BYTES_MAX ((size_t)4 << 20)

static struct bb_gamepad_evdev *of(struct bb_gamepad *g)
{
	return bb_container_of(g, struct bb_gamepad_evdev, base);
}

static struct bb_gamepad_evdev *of_core(struct bb_pad_core *core)
{
	return bb_container_of(core, struct bb_gamepad_evdev, core);
}

/* What the device has, in SDL's order. ------------------------------------------------------------------------- */

static void add_buttons(struct bb_gamepad_evdev *e, unsigned int from, unsigned int to)
{
	for (unsigned int code = from; code < to; code++)
		if (e->n_buttons < BB_ARRAY_LEN(e->button) && e->bus->ops->has(e->bus, EV_KEY, code))
			e->button[e->n_buttons++] = (uint16_t)code;
}

static void learn(struct bb_gamepad_evdev *e)
{
	e->n_buttons = e->n_axes = e->n_hats = 0;
	memset(e->key, 0, sizeof(e->key));
	memset(e->range, 0, sizeof(e->range));
	memset(e->value, 0, sizeof(e->value));
	add_buttons(e, BTN_JOYSTICK, KEY_MAX);
	add_buttons(e, 0, BTN_JOYSTICK);
	for (unsigned int code = 0; code < BB_EVDEV_AXES; code++) {
		if (!e->bus->ops->range(e->bus, code, &e->range[code]) || e->range[code].most <= e->range[code].least)
			continue;
		if (code < ABS_HAT0X || code > ABS_HAT3Y)
			e->axis[e->n_axes++] = (uint16_t)code;
		const int64_t sum = (int64_t)e->range[code].least + e->range[code].most;
		/* Before the first event the kernel says 0, which on an unsigned axis is its end. */
		e->value[code] = e->range[code].value ? e->range[code].value : (int32_t)(sum / 2);
	}
	const int64_t span = (int64_t)e->range[ABS_X].most - e->range[ABS_X].least;
	if (span > 1)
		e->base.limits.axis_step = 2.0 / (double)(span - (span & 1));
}

/* -1..1. An axis of an even number of values has two middles; both are neutral. */
static double axis_value(const struct bb_gamepad_evdev *e, unsigned int code)
{
	const struct bb_input_range *r = &e->range[code];
	const int64_t sum = (int64_t)r->least + r->most, at = 2 * (int64_t)e->value[code] - sum,
		      span = (int64_t)r->most - r->least;

	if (span <= 0 || (span & 1 && (at == 1 || at == -1)))
		return 0;
	const int64_t odd = span & 1; /* distance is counted from the nearer middle */
	const double v = (double)(at > 0 ? at - odd : at + odd) / (double)(span - odd);
	return fmax(-1, fmin(1, v));
}

/* To a sample. ------------------------------------------------------------------------------------------------- */

static int32_t count_of(double v)
{
	return (int32_t)lround(v * STEPS);
}

static void plain_cross(const struct bb_gamepad_evdev *e, struct bb_pad_sample *s)
{
	if (e->range[ABS_HAT0X].most > e->range[ABS_HAT0X].least) {
		s->count[4] = (e->value[ABS_HAT0X] > 0) - (e->value[ABS_HAT0X] < 0);
		s->count[5] = (e->value[ABS_HAT0Y] > 0) - (e->value[ABS_HAT0Y] < 0);
		return;
	}
	/* The kernel's xpad gives a wireless pad's cross as keys: left, right, up, down. */
	s->count[4] = e->key[BTN_TRIGGER_HAPPY2] - e->key[BTN_TRIGGER_HAPPY1];
	s->count[5] = e->key[BTN_TRIGGER_HAPPY4] - e->key[BTN_TRIGGER_HAPPY3];
}

static void plain_sample(const struct bb_gamepad_evdev *e, struct bb_pad_sample *s)
{
	const bool second =
		e->range[ABS_RX].most > e->range[ABS_RX].least && e->range[ABS_RY].most > e->range[ABS_RY].least;

	s->count[0] = count_of(axis_value(e, ABS_X));
	s->count[1] = count_of(axis_value(e, ABS_Y));
	s->count[2] = count_of(axis_value(e, second ? ABS_RX : ABS_Z));
	s->count[3] = count_of(axis_value(e, second ? ABS_RY : ABS_RZ));
	plain_cross(e, s);
	for (size_t i = 0; i < e->n_buttons && i < 32; i++)
		if (e->key[e->button[i]] && (e->button[i] < BTN_TRIGGER_HAPPY1 || e->button[i] > BTN_TRIGGER_HAPPY4))
			s->buttons |= 1u << i;
}

/* x right, y towards the user, z down become x right, y up, z towards the user; turns likewise. */
static void space_sample(const struct bb_gamepad_evdev *e, struct bb_pad_sample *s)
{
	for (unsigned int i = 0; i < 2; i++) {
		s->count[3 * i] = count_of(axis_value(e, 3 * i));
		s->count[3 * i + 1] = -count_of(axis_value(e, 3 * i + 2));
		s->count[3 * i + 2] = count_of(axis_value(e, 3 * i + 1));
	}
	for (size_t i = 0; i < e->n_buttons && i < 32; i++)
		if (e->key[e->button[i]])
			s->buttons |= 1u << i;
}

/* What a binding's source says: 0..1 for a button, a hat bit or half an axis, -1..1 for a whole one. */
static double source_value(const struct bb_gamepad_evdev *e, const struct bb_sdl_binding *b)
{
	if (b->source == BB_SDL_FROM_BUTTON)
		return b->index < e->n_buttons && e->key[e->button[b->index]];
	if (b->source == BB_SDL_FROM_HAT) {
		if (b->index > 3)
			return 0;
		const int32_t x = e->value[ABS_HAT0X + 2 * b->index], y = e->value[ABS_HAT0Y + 2 * b->index];
		return b->hat_bit == 1 ? y < 0 : b->hat_bit == 2 ? x > 0 : b->hat_bit == 4 ? y > 0 : x < 0;
	}
	double v = b->index < e->n_axes ? axis_value(e, e->axis[b->index]) : 0;
	if (b->turned)
		v = -v;
	return b->half ? fmax(0, v * b->half) : v;
}

static void bind_axis(const struct bb_sdl_binding *b, double v, int32_t *count)
{
	const bool whole = b->source == BB_SDL_FROM_AXIS && !b->half;

	if (b->target_half)
		v = (whole ? (v + 1) / 2 : v) * b->target_half;
	else if (!whole) /* a button or half an axis on a whole one: neutral is its lower end */
		v = 2 * v - 1;
	const int32_t c = count_of(v);
	if (!b->target_half || c)
		*count = c;
}

static void mapped_sample(const struct bb_gamepad_evdev *e, struct bb_pad_sample *s)
{
	for (size_t i = 0; i < e->mapping.n; i++) {
		const struct bb_sdl_binding *b = &e->mapping.binding[i];
		const double v = source_value(e, b);
		if (b->target >= BB_SDL_LEFT_X && b->target <= BB_SDL_RIGHT_Y)
			bind_axis(b, v, &s->count[b->target - BB_SDL_LEFT_X]);
		else if (b->target == BB_SDL_LEFT || b->target == BB_SDL_RIGHT)
			s->count[4] += v > 0.5 ? (b->target == BB_SDL_RIGHT ? 1 : -1) : 0;
		else if (b->target == BB_SDL_UP || b->target == BB_SDL_DOWN)
			s->count[5] += v > 0.5 ? (b->target == BB_SDL_DOWN ? 1 : -1) : 0;
		else if (b->target >= BB_SDL_LEFT_TRIGGER)
			s->buttons |= v > 0.5 ? 1u << (11 + b->target - BB_SDL_LEFT_TRIGGER) : 0;
		else if (v > 0.5)
			s->buttons |= 1u << b->target;
	}
	for (size_t i = 4; i < 6; i++) /* two bindings may say the same direction */
		s->count[i] = (s->count[i] > 0) - (s->count[i] < 0);
}

static void finish_packet(struct bb_gamepad_evdev *e, int64_t at_ns)
{
	struct bb_pad_sample s = { 0 };

	if (e->mapping.n)
		mapped_sample(e, &s);
	else if (e->base.config.model == BB_PAD_SPACEMOUSE)
		space_sample(e, &s);
	else
		plain_sample(e, &s);
	bb_pad_core_good(&e->core, &s, at_ns);
}

/* The bus. ----------------------------------------------------------------------------------------------------- */

static enum bb_status find_mapping(struct bb_gamepad_evdev *e, const struct bb_input_identity *id, struct bb_error *err)
{
	char *text = NULL;
	size_t n = 0;

	if (!e->mapping_file[0] || e->mapping.n)
		return BB_OK;
	enum bb_status status = bb_file_read(e->mapping_file, MAPPING_BYTES_MAX, &text, &n, err);
	if (status == BB_OK)
		status = bb_sdl_mapping_find(text, n, e->mapping_file, id, &e->mapping, err);
	free(text);
	return status;
}

static enum bb_status source_open(struct bb_pad_core *core)
{
	struct bb_gamepad_evdev *e = of_core(core);
	struct bb_input_identity found = { 0 };
	struct bb_error err = { 0 };
	enum bb_status status = e->port.open(e->port.ctx, &e->wanted, e->base.dev.clk, &e->bus, &found, &err);

	if (status == BB_OK) {
		status = find_mapping(e, &found, &err);
		if (status != BB_OK)
			e->bus->ops->close(e->bus);
	}
	if (status != BB_OK) {
		e->bus = NULL;
		if (core->health == BB_HEALTH_INIT)
			bb_log(e->log, BB_LOG_ERROR, BB_BLAME_DEVICE, e->base.config.id, "%s", err.text);
		return bb_device_fail(&e->base.dev, status, "open", "%.90s", err.text);
	}
	/* The same one again on whatever node; a path without a serial is looked for as the device that stood there. */
	e->wanted = found;
	e->wanted.path[0] = '\0';
	e->base.limits.has_rumble = e->bus->ops->has(e->bus, EV_FF, FF_RUMBLE);
	e->rumbling = false;
	learn(e);
	return BB_OK;
}

static void source_close(struct bb_pad_core *core)
{
	of_core(core)->bus->ops->close(of_core(core)->bus);
	of_core(core)->bus = NULL;
}

static void take(struct bb_gamepad_evdev *e, const struct bb_input_event *ev)
{
	if (ev->type == EV_KEY && ev->code < BB_EVDEV_CODES)
		e->key[ev->code] = ev->value != 0;
	else if (ev->type == EV_ABS && ev->code < BB_EVDEV_AXES)
		e->value[ev->code] = ev->value;
	else if (ev->type == EV_SYN && ev->code == SYN_REPORT)
		finish_packet(e, ev->at_ns);
}

static enum bb_status source_pull(struct bb_pad_core *core)
{
	struct bb_gamepad_evdev *e = of_core(core);
	struct bb_input_event events[EVENTS_AT_ONCE];
	size_t n = 0;
	const enum bb_status status = e->bus->ops->read(e->bus, events, EVENTS_AT_ONCE, &n);

	for (size_t i = 0; i < n && i < EVENTS_AT_ONCE; i++)
		take(e, &events[i]);
	return status;
}

static const struct bb_pad_source source = { source_open, source_close, source_pull };

static enum bb_status evdev_read(struct bb_gamepad *g, struct bb_pad_report *reports, size_t cap, size_t *n_out)
{
	return bb_pad_core_read(&of(g)->core, reports, cap, n_out);
}

static enum bb_status evdev_rumble(struct bb_gamepad *g, float strong, float weak)
{
	struct bb_gamepad_evdev *e = of(g);

	if (!g->limits.has_rumble)
		return BB_ERR_UNSUPPORTED;
	enum bb_status status = bb_pad_core_ready(&e->core, "rumble");
	if (status != BB_OK)
		return status;
	e->rumbling = strong > 0 || weak > 0;
	status = e->bus->ops->rumble(e->bus, (uint16_t)lroundf(strong * 65535), (uint16_t)lroundf(weak * 65535));
	if (status == BB_ERR_LOST)
		return bb_pad_core_gone(&e->core, "rumble");
	return status == BB_OK ? status : bb_device_fail(&g->dev, status, "rumble", "the kernel refused the effect");
}

enum bb_status bb_gamepad_evdev_open_on(struct bb_gamepad *g, const struct bb_open *open,
					const struct bb_input_port *port)
{
	static const int32_t pad_steps[BB_PAD_AXES] = { STEPS, STEPS, STEPS, STEPS, 1, 1 };
	static const int32_t space_steps[BB_PAD_AXES] = { STEPS, STEPS, STEPS, STEPS, STEPS, STEPS };
	struct bb_gamepad_evdev *e = of(g);
	struct bb_pad_uri uri;
	const enum bb_status status = bb_pad_uri_read(&g->dev, open, &uri);

	if (status != BB_OK)
		return status;
	if (!uri.has_identity && (uri.path[0] != '/' || strlen(uri.path) >= sizeof(e->wanted.path)))
		return bb_pad_uri_fail(&g->dev, open,
				       "names no input device: evdev:/dev/input/event3 or evdev:046d:c219");
	e->port = *port;
	e->log = open->log;
	e->wanted = (struct bb_input_identity){ .vendor = uri.vendor, .product = uri.product };
	if (!uri.has_identity)
		memcpy(e->wanted.path, uri.path, strlen(uri.path) + 1);
	memcpy(e->wanted.serial, uri.serial, sizeof(e->wanted.serial));
	memcpy(e->mapping_file, uri.mapping, sizeof(e->mapping_file));
	const bool space = g->config.model == BB_PAD_SPACEMOUSE && !uri.mapping[0];
	bb_pad_core_init(&e->core, g, &source, space ? space_steps : pad_steps, open->seed, BB_NEVER);
	return bb_pad_core_start(&e->core);
}

static enum bb_status open_node(void *ctx, const struct bb_input_identity *wanted, struct bb_clock *clk,
				struct bb_input_bus **out, struct bb_input_identity *found, struct bb_error *err)
{
	(void)ctx;
	return bb_bus_input_open(wanted, clk, out, found, err);
}

static enum bb_status evdev_open(struct bb_gamepad *g, const struct bb_open *open)
{
	return bb_gamepad_evdev_open_on(g, open, &(struct bb_input_port){ open_node, NULL });
}

/* A motor that runs must not run on when nobody can stop it. */
static void evdev_close(struct bb_gamepad *g)
{
	if (of(g)->rumbling)
		(void)evdev_rumble(g, 0, 0);
	bb_pad_core_stop(&of(g)->core);
}

const struct bb_pad_core *bb_gamepad_evdev_core(const struct bb_gamepad *g)
{
	return &((const struct bb_gamepad_evdev *)(const void *)((const char *)g -
								 offsetof(struct bb_gamepad_evdev, base)))
			->core;
}

const struct bb_gamepad_ops bb_gamepad_evdev_ops = { evdev_open, evdev_close, evdev_read, evdev_rumble };
const struct bb_gamepad_driver bb_gamepad_evdev_driver = { "evdev", sizeof(struct bb_gamepad_evdev),
							   &bb_gamepad_evdev_ops };
