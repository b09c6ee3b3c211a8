/*
 * drivers/monitor_ddc.c: see drivers/monitor_ddc.h. A request has one main question (asked again when it fails) and
 * side questions that find out why it fails; drivers/ddc_line.c gets each to the wire and back, and
 * drivers/ddc_request.c says what its answer leads to.
 */
#include "drivers/monitor_ddc.h"

#include "drivers/bus_i2c.h"
#include "drivers/ddcci_wire.h"
#include "drivers/monitor_ddc_impl.h"

#include <errno.h>
#include <string.h>

#define TRANSFER_NS INT64_C(5000000) /* 41 bytes at 100 kHz are 3.7 ms; what is left is the host's and its adapter's \
				      */
#define MOST_REQUEST_NS \
	INT64_C(6200000000)  /* ten tries at doubled waits with a side question each, and their back-off */
#define SERIAL_MOST 13       /* an EDID's text has no more */
#define CODE_NOBODY_HAS 0x41 /* vertical parallelogram: tubes only */

static struct monitor_ddc *of(struct bb_monitor *m)
{
	return bb_container_of(m, struct monitor_ddc, base);
}

/* ---- the machine ---- */

/* Another than the one in doubt. Every display that speaks MCCS has DF. */
static uint8_t known_code(const struct monitor_ddc *d)
{
	const uint8_t doubted = d->main == ASK_AWAKE ? BB_VCP_POWER_MODE : d->reply.request.code;

	if (d->known_code != doubted)
		return d->known_code;
	return doubted == BB_VCP_VERSION ? BB_VCP_POWER_MODE : BB_VCP_VERSION;
}

static void pose(struct monitor_ddc *d)
{
	const struct bb_monitor_request *r = &d->reply.request;
	struct ddc_question q = { DDC_GET_VCP, r->code, r->value, d->job.patient };

	switch (d->ask) {
	case ASK_WRITE:
		q.what = DDC_SET_VCP;
		break;
	case ASK_FRAGMENT:
		q.what = DDC_FRAGMENT;
		q.value = (uint16_t)d->reply.text_bytes;
		break;
	case ASK_EDID:
		q.what = DDC_MEMORY;
		q.value = (uint16_t)d->job.at;
		break;
	case ASK_KNOWN:
		q.code = known_code(d);
		q.patient = true;
		break;
	case ASK_UNKNOWN:
		q.code = CODE_NOBODY_HAS;
		q.patient = true;
		break;
	case ASK_AWAKE:
	case ASK_PROBE:
		q.code = BB_VCP_POWER_MODE;
		break;
	case ASK_PRESENCE:
	case ASK_PROBE_BUS:
		q.what = DDC_PRESENCE;
		q.value = 0;
		break;
	case ASK_NOTHING:
	case ASK_VALUE:
	case ASK_SETTLE:
	case ASK_VERIFY:
		break;
	}
	ddc_line_ask(&d->line, &q);
	d->posed = true;
}

static bool flaps(struct monitor_ddc *d, int64_t now_ns)
{
	bool often = false;

	for (; d->reopened != d->line.bus->n_reopened; d->reopened++) {
		int64_t *then_ns = &d->reopened_ns[d->reopened % REOPENS_A_MINUTE];
		often |= *then_ns && now_ns - *then_ns < 60 * BB_NS_PER_S;
		*then_ns = now_ns;
	}
	return often;
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct monitor_ddc *d = bb_container_of(timer, struct monitor_ddc, timer);

	(void)scheduled_ns;
	if (d->ask == ASK_NOTHING)
		return BB_NEVER;
	if (d->ask == ASK_SETTLE) {
		d->line.end_ns = now_ns;
		return ddc_finish(d, BB_OK, d->reply.request.value);
	}
	if (!d->posed)
		pose(d);
	const int64_t next_ns = ddc_line_step(&d->line, now_ns);
	if (flaps(d, now_ns))
		return ddc_quarantine(d, DDC_FAULT_FLAPS, "its adapter was plugged in too often a minute");
	return next_ns == BB_NEVER ? ddc_on_answer(d) : next_ns;
}

/* ---- the class's calls ---- */

static enum ddc_ask first_ask(const struct monitor_ddc *d, const struct bb_monitor_request *r)
{
	const struct ddc_health *h = &d->report.health;

	switch (r->kind) {
	case BB_MONITOR_EDID:
		return ASK_EDID;
	case BB_MONITOR_CAPABILITIES:
		return ASK_FRAGMENT;
	case BB_MONITOR_SET:
		if (ddc_read_only(r->code))
			return ASK_VALUE;
		/* No storm of writes at a display that sleeps; but the write that wakes it has to go out. */
		if (h->fault == DDC_FAULT_STANDBY && h->health == BB_HEALTH_DEGRADED && !ddc_sets_power(d, true))
			return ASK_AWAKE;
		return ASK_WRITE;
	case BB_MONITOR_GET:
	case BB_MONITOR_SAVE:
		break;
	}
	return ASK_VALUE;
}

static enum bb_status ddc_submit(struct bb_monitor *m, const struct bb_monitor_request *request)
{
	struct monitor_ddc *d = of(m);
	const int64_t now_ns = bb_clock_now_ns(m->dev.clk);

	if (d->stage != STAGE_IDLE)
		return BB_ERR_BUSY;
	if (request->kind == BB_MONITOR_SAVE) /* hal/monitor.c refuses it; nothing here could do it */
		return BB_ERR_REFUSED;
	if ((unsigned int)request->kind > BB_MONITOR_SAVE)
		return BB_ERR_USAGE;
	memset(&d->reply, 0, offsetof(struct bb_monitor_reply, edid));
	memset(&d->job, 0, sizeof(d->job));
	d->reply.request = *request;
	d->reply.tries = 1;
	if (d->report.health.health == BB_HEALTH_QUARANTINED) {
		d->reply.status = BB_ERR_IO; /* its own probes look after the bus */
		d->reply.done_ns = now_ns;
		d->stage = STAGE_DONE;
		return BB_OK;
	}
	/* A probe under way is dropped: the display forgets it, and its wait still stands. */
	d->main = first_ask(d, request);
	const enum bb_status status = bb_clock_arm(m->dev.clk, &d->timer, ddc_next_ask(d, d->main, now_ns));
	if (status == BB_OK)
		d->stage = STAGE_UNDER_WAY;
	return status;
}

static enum bb_status ddc_poll(struct bb_monitor *m, struct bb_monitor_reply *reply)
{
	struct monitor_ddc *d = of(m);

	/* On the virtual clock the last transfer may still be on the wire. */
	if (d->stage != STAGE_DONE || bb_clock_now_ns(m->dev.clk) < d->reply.done_ns)
		return BB_TIMEOUT;
	/* A room has hundreds of monitors, and most replies are two numbers. */
	memcpy(reply, &d->reply, offsetof(struct bb_monitor_reply, edid));
	memcpy(reply->edid, d->reply.edid, d->reply.edid_bytes);
	if (d->reply.text_bytes)
		memcpy(reply->text, d->reply.text, d->reply.text_bytes);
	d->stage = STAGE_IDLE;
	return BB_OK;
}

const struct monitor_ddc_report *monitor_ddc_report(struct bb_monitor *m)
{
	struct monitor_ddc *d = of(m);

	d->report.gap = d->line.gap;
	d->report.doubled_source = d->line.doubled;
	d->report.transfers = d->line.transfers;
	return &d->report;
}

void monitor_ddc_release(struct bb_monitor *m)
{
	struct monitor_ddc *d = of(m);

	if (d->report.health.health != BB_HEALTH_QUARANTINED)
		return;
	d->report.health.health = BB_HEALTH_RECOVERING;
	d->report.health.n_good = 0;
	d->probes = 0;
	memset(d->reopened_ns, 0, sizeof(d->reopened_ns));
	/* The timer has been armed before, so this cannot need memory; if it did, the next request asks. */
	if (bb_clock_arm(m->dev.clk, &d->timer, ddc_idle(d, bb_clock_now_ns(m->dev.clk))) != BB_OK)
		d->ask = ASK_NOTHING;
}

/* ---- opening and closing ---- */

static void start(struct monitor_ddc *d, struct bb_i2c_bus *bus, const struct bb_open *open)
{
	d->line.bus = bus;
	d->log = open->log;
	d->timer = (struct bb_timer){ .step = step, .rank = 1 };
	d->known_code = BB_VCP_VERSION;
	ddc_gap_init(&d->line.gap);
	d->base.limits = (struct bb_monitor_limits){ .reply_wait_ns = DDCCI_REPLY_WAIT_NS,
						     .write_wait_ns = DDCCI_WRITE_WAIT_NS,
						     .transfer_ns = TRANSFER_NS,
						     .most_request_ns = MOST_REQUEST_NS,
						     .most_tries = MONITOR_DDC_MOST_TRIES };
}

static enum bb_status read_options(struct bb_device *dev, const struct bb_uri *uri, struct bus_i2c_options *out)
{
	*out = (struct bus_i2c_options){ uri ? uri->path : "", "", false };
	for (size_t i = 0; uri && i < uri->n_options; i++) {
		const char *key = uri->option[i].key, *value = uri->option[i].value;
		if (!strcmp(key, "serial") && value[0] && strlen(value) <= SERIAL_MOST)
			out->serial = value;
		else if (!strcmp(key, "io") && !strcmp(value, "plain"))
			out->plain = true;
		else if (strcmp(key, "io") || strcmp(value, "rdwr"))
			return bb_device_fail(dev, BB_ERR_CONFIG, "open",
					      "i2c: knows serial=TEXT, io=rdwr and io=plain, not %s=%s", key, value);
	}
	if (!out->path[0] == !out->serial[0])
		return bb_device_fail(
			dev, BB_ERR_CONFIG, "open",
			"an i2c: device names a bus, i2c:/dev/i2c-4, or a monitor, i2c:?serial=SIM0001234");
	return BB_OK;
}

static enum bb_status ddc_open(struct bb_monitor *m, const struct bb_open *open)
{
	struct bb_i2c_bus *bus;
	struct bus_i2c_options options;
	enum bb_status status = read_options(&m->dev, open->uri, &options);

	if (status == BB_OK)
		status = bus_i2c_open(&options, m->dev.clk, &bus);
	else
		return status;
	if (status == BB_ERR_REFUSED)
		return bb_device_fail(&m->dev, status, "open", "%.40s: no permission: is the user in group i2c?",
				      open->uri->path);
	if (status != BB_OK)
		return bb_device_fail(&m->dev, status, "open", "%.40s: %s: is i2c-dev loaded, the bus there?",
				      open->uri->path, strerror(errno));
	start(of(m), bus, open);
	return BB_OK;
}

static void ddc_close(struct bb_monitor *m)
{
	struct monitor_ddc *d = of(m);

	bb_clock_disarm(m->dev.clk, &d->timer);
	d->line.bus->ops->close(d->line.bus);
}

static const struct bb_monitor_ops ops = { ddc_open, ddc_close, ddc_submit, ddc_poll };
const struct bb_monitor_driver monitor_ddc_driver = { "i2c", sizeof(struct monitor_ddc), &ops };

struct open_on {
	struct bb_open open;
	struct bb_i2c_bus *bus;
};

static enum bb_status ddc_open_on(struct bb_monitor *m, const struct bb_open *open)
{
	start(of(m), ((const struct open_on *)(const void *)open)->bus, open);
	return BB_OK;
}

enum bb_status monitor_ddc_open_on(struct bb_i2c_bus *bus, const struct bb_monitor_config *config,
				   const struct bb_open *open, struct bb_monitor **out)
{
	static const struct bb_monitor_ops ops_on = { ddc_open_on, ddc_close, ddc_submit, ddc_poll };
	static const struct bb_monitor_driver driver_on = { "i2c", sizeof(struct monitor_ddc), &ops_on };
	const struct open_on o = { *open, bus };
	const enum bb_status status = bb_monitor_open(&driver_on, config, &o.open, out);

	if (status != BB_OK)
		bus->ops->close(bus);
	return status;
}
