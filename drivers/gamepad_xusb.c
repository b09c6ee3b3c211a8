/* drivers/gamepad_xusb.c: see drivers/gamepad_xusb.h. */
#include "drivers/gamepad_xusb.h"

#include <math.h>

#include "drivers/bus_usb.h"
#include "drivers/pad_uri.h"
#include "drivers/pad_wire.h"

#define PACKET_BYTES_MAX 64
#define ASK_NS INT64_C(1000000000)  /* a pad that says nothing about itself is asked once a second */
#define LED_FIRST 6                 /* "pad n on" */
#define OPEN_NS INT64_C(2000000000) /* the first opening may wait that long; later ones never wait */

static struct bb_gamepad_xusb *of(struct bb_gamepad *g)
{
	return bb_container_of(g, struct bb_gamepad_xusb, base);
}

static struct bb_gamepad_xusb *of_core(struct bb_pad_core *core)
{
	return bb_container_of(core, struct bb_gamepad_xusb, core);
}

static int64_t now_of(const struct bb_gamepad_xusb *x)
{
	return bb_clock_now_ns(x->base.dev.clk);
}

static enum bb_status command(struct bb_gamepad_xusb *x, uint8_t bytes[BB_XUSB_COMMAND_BYTES])
{
	size_t n = BB_XUSB_COMMAND_BYTES;

	return x->bus->ops->transfer(x->bus, x->endpoint, bytes, &n, now_of(x));
}

static enum bb_status ask(struct bb_gamepad_xusb *x)
{
	uint8_t bytes[BB_XUSB_COMMAND_BYTES];

	bb_xusb_encode_inquiry(bytes);
	x->asked = true;
	x->asked_ns = now_of(x);
	return command(x, bytes);
}

static void close_bus(struct bb_gamepad_xusb *x)
{
	x->bus->ops->close(x->bus);
	x->bus = NULL;
}

static enum bb_status source_open(struct bb_pad_core *core)
{
	struct bb_gamepad_xusb *x = of_core(core);
	struct bb_gamepad *g = &x->base;
	const bool first = core->health == BB_HEALTH_INIT;
	enum bb_status status =
		x->host->open(x->host, &x->match, g->dev.clk, now_of(x) + (first ? OPEN_NS : 0), &x->bus);

	if (status == BB_TIMEOUT && !first)
		return status;
	if (status == BB_TIMEOUT)
		status = BB_ERR_LOST;
	if (status != BB_OK) {
		struct bb_error err = { 0 };
		(void)bb_fail(&err, status, status == BB_ERR_LOST ? 1562 : 1563, NULL, "%s: %s", g->config.id,
			      x->host->why);
		if (first)
			bb_log(x->log, BB_LOG_ERROR, BB_BLAME_DEVICE, g->config.id, "%s", err.text);
		return bb_device_fail(&g->dev, status, "open", "%.90s", err.text);
	}
	x->present = x->rumbling = false;
	status = ask(x);
	if (status < 0)
		close_bus(x);
	return status < 0 ? status : BB_OK;
}

static void source_close(struct bb_pad_core *core)
{
	close_bus(of_core(core));
}

/* The ring of light shows which pad this is. */
static void greet(struct bb_gamepad_xusb *x)
{
	uint8_t bytes[BB_XUSB_COMMAND_BYTES];

	if (x->present)
		return;
	x->present = true;
	bb_xusb_encode_led(LED_FIRST + x->slot - 1, bytes);
	(void)command(x, bytes); /* a receiver that is gone tells so at the next read */
}

static enum bb_status take(struct bb_gamepad_xusb *x, const uint8_t *bytes, size_t n, int64_t at_ns)
{
	struct bb_xusb_packet packet = { .battery = NAN };

	switch (bb_xusb_decode(bytes, n, &packet)) {
	case BB_XUSB_SAID_STATE:
		greet(x); /* it was there before we were */
		bb_pad_core_good(&x->core, &packet.sample, at_ns);
		return BB_OK;
	case BB_XUSB_SAID_PRESENT:
		greet(x);
		return BB_OK;
	case BB_XUSB_SAID_ABSENT:
		x->present = false;
		x->asked = false;
		x->asked_ns = now_of(x);
		return BB_SKIPPED;
	case BB_XUSB_SAID_BATTERY:
		bb_pad_core_battery(&x->core, packet.battery);
		return BB_OK;
	case BB_XUSB_SAID_LINK:
		return BB_OK;
	case BB_XUSB_SAID_BAD:
		bb_pad_core_bad(&x->core, "packet %02x of %zu bytes", n ? bytes[0] : 0, n);
		return BB_OK;
	}
	return BB_OK;
}

/* Nothing came. An endpoint that stalled is cleared once a read; a pad nobody heard of is asked for. */
static enum bb_status quiet(struct bb_gamepad_xusb *x, enum bb_status status)
{
	if (status == BB_ERR_IO) {
		bb_pad_core_bad(&x->core, "its endpoint stalled");
		status = x->bus->ops->clear_halt(x->bus, (uint8_t)(0x80 | x->endpoint));
		return status == BB_ERR_LOST ? status : BB_TIMEOUT;
	}
	if (status != BB_TIMEOUT || x->present)
		return status;
	if (now_of(x) - x->asked_ns >= ASK_NS && ask(x) == BB_ERR_LOST)
		return BB_ERR_LOST;
	return x->core.off ? BB_SKIPPED : BB_TIMEOUT;
}

static enum bb_status source_pull(struct bb_pad_core *core)
{
	struct bb_gamepad_xusb *x = of_core(core);
	uint8_t bytes[PACKET_BYTES_MAX];
	size_t n = sizeof(bytes);
	const enum bb_status status =
		x->bus->ops->transfer(x->bus, (uint8_t)(0x80 | x->endpoint), bytes, &n, now_of(x));

	if (status != BB_OK)
		return quiet(x, status);
	return take(x, bytes, n < sizeof(bytes) ? n : sizeof(bytes), x->bus->arrived_ns);
}

static const struct bb_pad_source source = { source_open, source_close, source_pull };

static enum bb_status xusb_read(struct bb_gamepad *g, struct bb_pad_report *reports, size_t cap, size_t *n_out)
{
	return bb_pad_core_read(&of(g)->core, reports, cap, n_out);
}

static enum bb_status xusb_rumble(struct bb_gamepad *g, float strong, float weak)
{
	struct bb_gamepad_xusb *x = of(g);
	uint8_t bytes[BB_XUSB_COMMAND_BYTES];
	enum bb_status status = bb_pad_core_ready(&x->core, "rumble");

	if (status != BB_OK)
		return status;
	bb_xusb_encode_rumble(strong, weak, bytes);
	x->rumbling = bytes[5] || bytes[6];
	status = command(x, bytes);
	if (status == BB_ERR_LOST)
		return bb_pad_core_gone(&x->core, "rumble");
	return status >= 0 ? BB_OK : bb_device_fail(&g->dev, status, "rumble", "the receiver refused the packet");
}

enum bb_status bb_gamepad_xusb_open_on(struct bb_gamepad *g, const struct bb_open *open, struct bb_usb_host *host)
{
	struct bb_gamepad_xusb *x = of(g);
	struct bb_pad_uri uri;
	const enum bb_status status = bb_pad_uri_read(&g->dev, open, &uri);

	if (status != BB_OK)
		return status;
	if (!uri.has_identity || uri.vendor != PAD_WIRE_VENDOR_MICROSOFT ||
	    (uri.product != PAD_WIRE_XBOX_RECEIVER && uri.product != PAD_WIRE_XBOX_RECEIVER_OLD &&
	     uri.product != PAD_WIRE_XBOX_RECEIVER_CLONE))
		return bb_pad_uri_fail(&g->dev, open, "names no Xbox 360 wireless receiver: usb:045e:0719?slot=1");
	x->host = host;
	x->log = open->log;
	x->slot = (unsigned int)uri.slot;
	x->endpoint = (uint8_t)(2 * x->slot - 1);
	x->match = (struct bb_usb_match){ .vendor = uri.vendor,
					  .product = uri.product,
					  .interface = (uint8_t)(2 * (x->slot - 1)) };
	_Static_assert(sizeof(x->match.serial) == sizeof(uri.serial), "one length of serial numbers");
	for (size_t i = 0; i < sizeof(uri.serial); i++)
		x->match.serial[i] = uri.serial[i];
	g->limits.has_rumble = g->limits.has_battery = true;
	bb_pad_core_init(&x->core, g, &source, bb_xusb_steps, open->seed, uri.gap_ns);
	const enum bb_status opened = bb_pad_core_start(&x->core);
	if (opened != BB_OK)
		host->close(host);
	return opened;
}

static enum bb_status xusb_open(struct bb_gamepad *g, const struct bb_open *open)
{
	bb_usb_host_init(&of(g)->real);
	return bb_gamepad_xusb_open_on(g, open, &of(g)->real);
}

/* A motor that runs must not run on when nobody can stop it. */
static void xusb_close(struct bb_gamepad *g)
{
	if (of(g)->rumbling)
		(void)xusb_rumble(g, 0, 0);
	bb_pad_core_stop(&of(g)->core);
	of(g)->host->close(of(g)->host);
}

const struct bb_pad_core *bb_gamepad_xusb_core(const struct bb_gamepad *g)
{
	return &((const struct bb_gamepad_xusb *)(const void *)((const char *)g -
								offsetof(struct bb_gamepad_xusb, base)))
			->core;
}

const struct bb_gamepad_ops bb_gamepad_xusb_ops = { xusb_open, xusb_close, xusb_read, xusb_rumble };
const struct bb_gamepad_driver bb_gamepad_xusb_driver = { "usb", sizeof(struct bb_gamepad_xusb), &bb_gamepad_xusb_ops };
