/* drivers/gamepad_hid.c: see drivers/gamepad_hid.h. */
#include "drivers/gamepad_hid.h"

#include <stdlib.h>
#include <string.h>

#include "drivers/hid_descriptor.h"
#include "drivers/pad_uri.h"
#include "drivers/pad_wire.h"

#define REPORT_BYTES_MAX 64
#define PART_NS INT64_C(16000000) /* a move whose turn has not come by then stands alone */

static struct bb_gamepad_hid *of(struct bb_gamepad *g)
{
	return bb_container_of(g, struct bb_gamepad_hid, base);
}

static struct bb_gamepad_hid *of_core(struct bb_pad_core *core)
{
	return bb_container_of(core, struct bb_gamepad_hid, core);
}

/* Opening: the bus, then what the device says about itself. ---------------------------------------------------- */

/* The kernel's way: the first output report of seven values carries the rumble, whatever its id. */
static void find_rumble(struct bb_gamepad_hid *hid, const struct bb_hid_layout *l)
{
	hid->base.limits.has_rumble = false;
	for (size_t i = 0; i < l->n_reports && hid->kind != BB_PAD_KIND_SPACE; i++)
		if (l->report[i].way == BB_HID_OUTPUT && l->report[i].bits >= 8u * PAD_WIRE_RUMBLE_BYTES) {
			hid->base.limits.has_rumble = true;
			hid->rumble_id = l->report[i].id;
			return;
		}
}

static enum bb_status check_layout(struct bb_gamepad_hid *hid, const struct bb_hid_layout *l, struct bb_error *err)
{
	uint8_t id;
	const size_t least = bb_pad_kind_report_bytes(hid->kind, &id);
	const struct bb_hid_report *r = bb_hid_layout_report(l, BB_HID_INPUT, id);

	if (!r || bb_hid_report_bytes(r) < least || bb_hid_report_bytes(r) > REPORT_BYTES_MAX)
		return bb_fail(err, BB_ERR_FORMAT, 1561, NULL,
			       "%s: DESC_REJECT input report %u has %zu bytes, want %zu to %d", hid->base.config.id, id,
			       r ? bb_hid_report_bytes(r) : 0, least, REPORT_BYTES_MAX);
	find_rumble(hid, l);
	r = bb_hid_layout_report(l, BB_HID_INPUT, PAD_WIRE_SPACE_BATTERY);
	hid->base.limits.has_battery = hid->kind == BB_PAD_KIND_SPACE && r;
	return BB_OK;
}

static enum bb_status read_layout(struct bb_gamepad_hid *hid, struct bb_error *err)
{
	uint8_t bytes[BB_HID_DESCRIPTOR_BYTES_MAX];
	size_t n = 0;
	enum bb_status status = hid->bus->ops->descriptor(hid->bus, bytes, sizeof(bytes), &n);

	if (status != BB_OK)
		return bb_fail(err, status, 1563, NULL, "%s: it does not give its descriptor", hid->base.config.id);
	struct bb_hid_layout *l = malloc(sizeof(*l));
	if (!l)
		return BB_ERR_NOMEM;
	status = bb_hid_layout_parse(bytes, n, hid->base.config.id, l, err);
	if (status == BB_OK)
		status = check_layout(hid, l, err);
	free(l);
	return status;
}

static enum bb_status source_open(struct bb_pad_core *core)
{
	struct bb_gamepad_hid *hid = of_core(core);
	struct bb_hid_identity found = { 0 };
	struct bb_error err = { 0 };
	enum bb_status status = hid->port.open(hid->port.ctx, &hid->wanted, hid->base.dev.clk, &hid->bus, &found, &err);

	if (status == BB_OK) {
		status = read_layout(hid, &err);
		if (status != BB_OK) {
			hid->bus->ops->close(hid->bus);
			hid->bus = NULL;
		}
	}
	if (status != BB_OK) {
		(void)bb_device_fail(&hid->base.dev, status, "open", "%.90s", err.text);
		/* While it is unplugged "not there" is no news. */
		if (core->health == BB_HEALTH_INIT || status == BB_ERR_FORMAT)
			bb_log(hid->log, BB_LOG_ERROR, BB_BLAME_DEVICE, hid->base.config.id, "%s", err.text);
		return status;
	}
	memcpy(hid->wanted.serial, found.serial, sizeof(found.serial)); /* the same one again, on whatever port */
	hid->state = (struct bb_pad_sample){ 0 };
	hid->has_part = hid->rumbling = false;
	return BB_OK;
}

static void source_close(struct bb_pad_core *core)
{
	struct bb_gamepad_hid *hid = of_core(core);

	hid->bus->ops->close(hid->bus);
	hid->bus = NULL;
}

/* Reading. ----------------------------------------------------------------------------------------------------- */

static void flush_part(struct bb_gamepad_hid *hid)
{
	if (hid->has_part)
		bb_pad_core_good(&hid->core, &hid->state, hid->part_ns);
	hid->has_part = false;
}

static void take(struct bb_gamepad_hid *hid, const uint8_t *report, size_t n, int64_t at_ns)
{
	struct bb_pad_sample next = hid->state;
	float battery = 0;

	switch (bb_pad_decode(hid->kind, report, n, &next, &battery)) {
	case BB_PAD_SAID_PART:
		flush_part(hid);
		hid->state = next;
		hid->has_part = true;
		hid->part_ns = at_ns;
		break;
	case BB_PAD_SAID_STATE:
		hid->has_part = false;
		hid->state = next;
		bb_pad_core_good(&hid->core, &next, at_ns);
		break;
	case BB_PAD_SAID_BATTERY:
		bb_pad_core_battery(&hid->core, battery);
		break;
	case BB_PAD_SAID_NOTHING:
		break;
	case BB_PAD_SAID_BAD:
		bb_pad_core_bad(&hid->core, "report id %u of %zu bytes", n ? report[0] : 0, n);
		break;
	}
}

static enum bb_status source_pull(struct bb_pad_core *core)
{
	struct bb_gamepad_hid *hid = of_core(core);
	uint8_t report[REPORT_BYTES_MAX];
	int64_t at_ns = 0;
	size_t n = 0;
	const enum bb_status status = hid->bus->ops->read(hid->bus, report, sizeof(report), &n, &at_ns);

	if (status == BB_TIMEOUT && hid->has_part && bb_clock_now_ns(hid->base.dev.clk) - hid->part_ns > PART_NS)
		flush_part(hid);
	if (status == BB_OK)
		take(hid, report, n < sizeof(report) ? n : sizeof(report), at_ns);
	return status;
}

static const struct bb_pad_source source = { source_open, source_close, source_pull };

static enum bb_status hid_read_reports(struct bb_gamepad *g, struct bb_pad_report *reports, size_t cap, size_t *n_out)
{
	return bb_pad_core_read(&of(g)->core, reports, cap, n_out);
}

static enum bb_status hid_rumble(struct bb_gamepad *g, float strong, float weak)
{
	struct bb_gamepad_hid *hid = of(g);
	uint8_t report[BB_PAD_RUMBLE_BYTES];

	if (!g->limits.has_rumble)
		return BB_ERR_UNSUPPORTED;
	enum bb_status status = bb_pad_core_ready(&hid->core, "rumble");
	if (status != BB_OK)
		return status;
	bb_pad_encode_rumble(hid->kind, hid->rumble_id, strong, weak, report);
	status = hid->bus->ops->write(hid->bus, report, sizeof(report));
	if (status == BB_ERR_LOST)
		return bb_pad_core_gone(&hid->core, "rumble");
	if (status != BB_OK)
		return bb_device_fail(&g->dev, status, "rumble", "the pad refused the report");
	hid->rumbling = strong > 0 || weak > 0;
	return BB_OK;
}

enum bb_status bb_gamepad_hid_open_on(struct bb_gamepad *g, const struct bb_open *open, const struct bb_hid_port *port)
{
	struct bb_gamepad_hid *hid = of(g);
	struct bb_pad_uri uri;
	enum bb_status status = bb_pad_uri_read(&g->dev, open, &uri);

	if (status != BB_OK)
		return status;
	if (!uri.has_identity || !bb_pad_kind_of(uri.vendor, uri.product, &hid->kind))
		return bb_pad_uri_fail(&g->dev, open, "names no RumblePad 2 and no SpaceMouse: hid:046d:c219");
	hid->port = *port;
	hid->log = open->log;
	hid->wanted = (struct bb_hid_identity){ .vendor = uri.vendor, .product = uri.product };
	memcpy(hid->wanted.serial, uri.serial, sizeof(hid->wanted.serial));
	bb_pad_core_init(&hid->core, g, &source, bb_pad_kind_steps(hid->kind), open->seed, uri.gap_ns);
	return bb_pad_core_start(&hid->core);
}

static enum bb_status open_node(void *ctx, const struct bb_hid_identity *wanted, struct bb_clock *clk,
				struct bb_hid_bus **out, struct bb_hid_identity *found, struct bb_error *err)
{
	(void)ctx;
	return bb_bus_hid_open(wanted, clk, out, found, err);
}

static enum bb_status hid_open_real(struct bb_gamepad *g, const struct bb_open *open)
{
	return bb_gamepad_hid_open_on(g, open, &(struct bb_hid_port){ open_node, NULL });
}

/* A motor that runs must not run on when nobody can stop it. */
static void hid_close_pad(struct bb_gamepad *g)
{
	if (of(g)->rumbling)
		(void)hid_rumble(g, 0, 0);
	bb_pad_core_stop(&of(g)->core);
}

const struct bb_pad_core *bb_gamepad_hid_core(const struct bb_gamepad *g)
{
	return &((const struct bb_gamepad_hid *)(const void *)((const char *)g - offsetof(struct bb_gamepad_hid, base)))
			->core;
}

const struct bb_gamepad_ops bb_gamepad_hid_ops = { hid_open_real, hid_close_pad, hid_read_reports, hid_rumble };
const struct bb_gamepad_driver bb_gamepad_hid_driver = { "hid", sizeof(struct bb_gamepad_hid), &bb_gamepad_hid_ops };
