/* drivers/ddc_request.c: what becomes of a request: retries, side questions, read-backs; see drivers/monitor_ddc.h. */
#include "drivers/ddcci_wire.h"
#include "drivers/edid.h"
#include "drivers/monitor_ddc_impl.h"

#include <string.h>

#define MS INT64_C(1000000)
#define BACK_OFF_NS (50 * MS) /* times the number of the try */
#define MOST_NO_ACK 3         /* a Null may pass, a missing acknowledge seldom does */
#define DOUBT 3               /* that many Nulls or zeros, and it is time to ask why */
#define STUCK_LOOKS 3
#define STUCK_LOOK_NS (10 * MS)
#define STUCK_PROBES 3
#define STUCK_PROBE_NS (5 * BB_NS_PER_S)
#define STANDBY_PROBE_NS (2 * BB_NS_PER_S)
#define PROBE_LEAST_NS (100 * MS)
#define PROBE_MOST_NS (5 * BB_NS_PER_S)
#define EDID_READS 4 /* the first and three more */
#define REWRITES 1

static int64_t retry(struct monitor_ddc *d, int64_t end_ns);

/* ---- what codes are like (MCCS 2.2) ---- */

static bool has_bit(const uint8_t bits[32], uint8_t code)
{
	return bits[code / 8] >> (code % 8) & 1;
}

static void set_bit(uint8_t bits[32], uint8_t code)
{
	bits[code / 8] |= (uint8_t)(1u << (code % 8));
}

/* Never written: the standard gives them no meaning when set. */
bool ddc_read_only(uint8_t code)
{
	static const uint8_t codes[] = { BB_VCP_H_FREQUENCY, BB_VCP_V_FREQUENCY, 0xB2, 0xB6,          BB_VCP_HOURS,
					 BB_VCP_ENABLE_KEY,  BB_VCP_CONTROLLER,  0xC9, BB_VCP_VERSION };

	return memchr(codes, code, sizeof(codes)) != NULL;
}

/* Actions, and 02, which the display sets again when it likes. */
static bool cannot_be_read_back(uint8_t code)
{
	static const uint8_t codes[] = {
		0x01, BB_VCP_NEW_CONTROL, BB_VCP_RESTORE_DEFAULTS, 0x05, 0x06, 0x08, 0x0A, 0x1E, 0x1F, BB_VCP_SETTINGS
	};

	return memchr(codes, code, sizeof(codes)) != NULL;
}

/* Of codes that number states some displays fill the high byte with something of their own. */
static bool same(uint8_t code, uint16_t a, uint16_t b)
{
	const bool state = code == BB_VCP_INPUT || code == BB_VCP_POWER_MODE || code == BB_VCP_COLOR_PRESET;

	return state ? (a & 0xFF) == (b & 0xFF) : a == b;
}

bool ddc_sets_power(const struct monitor_ddc *d, bool on)
{
	const struct bb_monitor_request *r = &d->reply.request;

	return r->kind == BB_MONITOR_SET && r->code == BB_VCP_POWER_MODE && (r->value == 1) == on;
}

/* ---- health ---- */

static enum bb_status status_of(enum ddc_outcome outcome)
{
	switch (outcome) {
	case DDC_GOOD:
		return BB_OK;
	case DDC_EMPTY:
		return BB_ERR_BUSY;
	case DDC_NO_ACK:
		return BB_ERR_LOST;
	case DDC_DAMAGED:
		return BB_ERR_FORMAT;
	case DDC_ZEROS:
	case DDC_BROKEN:
		break;
	}
	return BB_ERR_IO;
}

static void bad(struct monitor_ddc *d, enum bb_health health, enum ddc_fault fault, enum bb_status status,
		const char *what)
{
	const struct ddc_health *h = &d->report.health;
	const bool changed = ddc_health_bad(&d->report.health, health, fault, d->line.end_ns);

	if (!changed && h->fault != fault) /* the words of what stands say more */
		return;
	bb_device_fail(&d->base.dev, status, "ddc", "%s %llu: %s (VCP %02X, try %u)", ddc_fault_text(fault),
		       (unsigned long long)h->count[fault], what, d->line.question.code, d->reply.tries);
	if (!changed)
		return;
	d->probes = 0;
	bb_log(d->log, BB_LOG_WARN, BB_BLAME_DEVICE, d->base.dev.id, "%s: %s", bb_health_text(health),
	       d->base.dev.last_error.detail);
}

static void good(struct monitor_ddc *d)
{
	if (ddc_health_good(&d->report.health, d->line.end_ns) && d->report.health.recovered_ns == d->line.end_ns)
		bb_log(d->log, BB_LOG_INFO, BB_BLAME_DEVICE, d->base.dev.id, "answers again");
}

/* An answer of the controller cures what was wrong with answers, not a write that did not take, nor an EDID. */
static void good_answer(struct monitor_ddc *d)
{
	const struct ddc_health *h = &d->report.health;

	if (h->health == BB_HEALTH_DEGRADED && (h->fault == DDC_FAULT_VERIFY || h->fault == DDC_FAULT_EDID))
		return;
	good(d);
}

static void cured(struct monitor_ddc *d, enum ddc_fault fault)
{
	const struct ddc_health *h = &d->report.health;

	if (h->health == BB_HEALTH_DEGRADED && h->fault == fault)
		good(d);
}

/* Not a fault that lasts: the waits are longer from now on. */
static void found_slow(struct monitor_ddc *d)
{
	ddc_gap_stretch(&d->line.gap);
	d->report.health.count[DDC_FAULT_SLOW]++;
	bb_device_fail(&d->base.dev, BB_OK, "ddc", "%s: answers only with waits %d.%d times the standard's",
		       ddc_fault_text(DDC_FAULT_SLOW), d->line.gap.permille / 1000, d->line.gap.permille % 1000 / 100);
	bb_log(d->log, BB_LOG_WARN, BB_BLAME_DEVICE, d->base.dev.id, "%s", d->base.dev.last_error.detail);
}

/* Names a failed exchange. Nulls and zeros may be the display's way; they count against it when they go on. */
static void note_failure(struct monitor_ddc *d, enum ddc_outcome outcome)
{
	switch (outcome) {
	case DDC_EMPTY:
		d->report.health.count[DDC_FAULT_NULL]++;
		if (d->report.health.health == BB_HEALTH_DEGRADED && d->report.health.fault == DDC_FAULT_STANDBY)
			break;
		bb_device_fail(&d->base.dev, BB_ERR_BUSY, "ddc", "NULL %u: an empty reply (VCP %02X)",
			       d->job.empties + 1, d->line.question.code);
		break;
	case DDC_ZEROS:
		bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_ZERO, BB_ERR_IO, "a reply of zeros");
		break;
	case DDC_DAMAGED:
		bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_DATA, BB_ERR_FORMAT, d->line.why);
		break;
	case DDC_NO_ACK:
		bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_NAK, BB_ERR_LOST, "no acknowledge");
		break;
	case DDC_BROKEN:
		bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_EIO, BB_ERR_IO, "the transfer broke off");
		break;
	case DDC_GOOD:
		break;
	}
}

/* ---- idle ---- */

int64_t ddc_next_ask(struct monitor_ddc *d, enum ddc_ask ask, int64_t at_ns)
{
	d->ask = ask;
	d->posed = false;
	return at_ns;
}

int64_t ddc_idle(struct monitor_ddc *d, int64_t at_ns)
{
	const struct ddc_health *h = &d->report.health;
	int64_t wait_ns = PROBE_LEAST_NS;

	if (h->health == BB_HEALTH_QUARANTINED && h->fault == DDC_FAULT_FLAPS)
		return ddc_next_ask(d, ASK_NOTHING, BB_NEVER);
	if (h->health == BB_HEALTH_QUARANTINED)
		return d->probes++ < STUCK_PROBES ? ddc_next_ask(d, ASK_PROBE_BUS, at_ns + STUCK_PROBE_NS)
						  : ddc_next_ask(d, ASK_NOTHING, BB_NEVER);
	if (h->health == BB_HEALTH_RECOVERING)
		return ddc_next_ask(d, ASK_PROBE, at_ns);
	if ((h->health != BB_HEALTH_DEGRADED && h->health != BB_HEALTH_LOST) || h->fault == DDC_FAULT_VERIFY ||
	    h->fault == DDC_FAULT_EDID)
		return ddc_next_ask(d, ASK_NOTHING, BB_NEVER);
	for (unsigned int i = 0; i < d->probes && wait_ns < PROBE_MOST_NS; i++)
		wait_ns *= 2;
	d->probes++;
	if (h->fault == DDC_FAULT_STANDBY)
		wait_ns = STANDBY_PROBE_NS;
	return ddc_next_ask(d, ASK_PROBE, at_ns + (wait_ns < PROBE_MOST_NS ? wait_ns : PROBE_MOST_NS));
}

int64_t ddc_finish(struct monitor_ddc *d, enum bb_status status, int64_t value)
{
	struct bb_monitor_reply *r = &d->reply;

	r->status = status;
	r->done_ns = d->line.end_ns;
	if (d->job.most_tries > r->tries)
		r->tries = d->job.most_tries;
	d->stage = STAGE_DONE;
	d->report.requests++;
	d->report.tries[r->tries <= MONITOR_DDC_MOST_TRIES ? r->tries : MONITOR_DDC_MOST_TRIES]++;
	bb_device_event(&d->base.dev, BB_EV_REPLY, r->done_ns, (int64_t)r->request.kind << 16 | r->request.code,
			status == BB_OK ? value : (int64_t)status);
	return ddc_idle(d, r->done_ns);
}

/* ---- answers to side questions ---- */

int64_t ddc_quarantine(struct monitor_ddc *d, enum ddc_fault fault, const char *what)
{
	bad(d, BB_HEALTH_QUARANTINED, fault, BB_ERR_IO, what);
	return d->stage == STAGE_UNDER_WAY ? ddc_finish(d, BB_ERR_IO, 0) : ddc_idle(d, d->line.end_ns);
}

static int64_t on_presence(struct monitor_ddc *d, enum ddc_outcome outcome)
{
	const bool wire_bad = outcome == DDC_BROKEN || outcome == DDC_ZEROS;

	if (wire_bad && ++d->job.looks >= STUCK_LOOKS)
		return ddc_quarantine(d, DDC_FAULT_STUCK, "no address can be reached, the wire is held low");
	if (wire_bad)
		return ddc_next_ask(d, ASK_PRESENCE, d->line.end_ns + STUCK_LOOK_NS);
	d->job.looks = 0;
	if (outcome == DDC_GOOD && d->job.failure == DDC_EMPTY)
		bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_STANDBY, BB_ERR_BUSY, "EDID answers, VCP does not: asleep or off");
	else if (outcome == DDC_GOOD && d->job.failure == DDC_NO_ACK)
		bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_STANDBY, BB_ERR_LOST,
		    "EDID answers, the DDC controller does not acknowledge: off, or it hangs");
	else if (outcome == DDC_NO_ACK && d->job.failure == DDC_NO_ACK)
		bad(d, BB_HEALTH_LOST, DDC_FAULT_NAK, BB_ERR_LOST, "nothing acknowledges: cable or mains");
	return retry(d, d->line.end_ns);
}

static bool could_be_unsupported(const struct monitor_ddc *d)
{
	const enum bb_monitor_request_kind kind = d->reply.request.kind;

	if (d->main == ASK_AWAKE || d->main == ASK_WRITE)
		return false;
	return kind == BB_MONITOR_CAPABILITIES ? !d->reply.text_bytes : !has_bit(d->answered, d->reply.request.code);
}

/* By Nulls or zeros, and the display answers other questions: next time one such reply is enough. */
static int64_t unsupported(struct monitor_ddc *d)
{
	if (d->reply.request.kind != BB_MONITOR_CAPABILITIES)
		set_bit(d->refused, d->reply.request.code);
	return ddc_finish(d, BB_ERR_UNSUPPORTED, 0);
}

static int64_t on_known(struct monitor_ddc *d, enum ddc_outcome outcome)
{
	if (outcome != DDC_GOOD)
		return ddc_next_ask(d, ASK_PRESENCE, d->line.end_ns);
	d->job.awake = true;
	if (!d->line.vcp.supported && d->report.null_means == DDC_NULL_UNKNOWN)
		d->report.null_means = DDC_NULL_BUSY;
	if (d->job.failure == DDC_ZEROS)
		return could_be_unsupported(d) ? unsupported(d) : retry(d, d->line.end_ns);
	if (d->report.null_means == DDC_NULL_UNSUPPORTED && could_be_unsupported(d))
		return unsupported(d);
	d->job.perhaps_slow = true;
	return retry(d, d->line.end_ns);
}

static int64_t on_unknown(struct monitor_ddc *d, enum ddc_outcome outcome)
{
	if (outcome == DDC_GOOD)
		d->report.null_means = DDC_NULL_BUSY;
	else if (outcome == DDC_EMPTY && !d->job.strange++)
		return ddc_next_ask(d, ASK_UNKNOWN, d->line.end_ns); /* once may be chance; it is learned for good */
	else if (outcome == DDC_EMPTY)
		d->report.null_means = DDC_NULL_UNSUPPORTED;
	if (d->report.null_means == DDC_NULL_UNSUPPORTED && could_be_unsupported(d))
		return unsupported(d);
	return retry(d, d->line.end_ns);
}

static int64_t on_probe(struct monitor_ddc *d, enum ddc_outcome outcome)
{
	const enum bb_health health = d->report.health.health;

	if (outcome == DDC_GOOD && d->ask == ASK_PROBE)
		good_answer(d);
	else if (outcome == DDC_GOOD || (outcome == DDC_NO_ACK && d->ask == ASK_PROBE_BUS))
		good(d); /* the wire works again */
	else if (health == BB_HEALTH_RECOVERING)
		note_failure(d, outcome);
	return ddc_idle(d, d->line.end_ns);
}

/* ---- answers to main questions ---- */

static int64_t give_up(struct monitor_ddc *d)
{
	return ddc_finish(d, status_of(d->job.failure), 0);
}

static int64_t retry(struct monitor_ddc *d, int64_t end_ns)
{
	if (d->reply.tries >= MONITOR_DDC_MOST_TRIES)
		return give_up(d);
	return ddc_next_ask(d, d->main, end_ns + BACK_OFF_NS * d->reply.tries++);
}

/* Told to sleep, it answers no more: that is the read-back. */
static int64_t fell_asleep(struct monitor_ddc *d)
{
	bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_STANDBY, BB_OK, "sleeps as told");
	return ddc_finish(d, BB_OK, d->reply.request.value);
}

static int64_t on_empty(struct monitor_ddc *d)
{
	struct monitor_ddc_report *r = &d->report;

	d->job.empties++;
	if (d->main == ASK_VERIFY && ddc_sets_power(d, false) && d->job.empties == 2)
		return fell_asleep(d);
	if (d->job.empties >= DOUBT) /* before blaming the display: it may only be slow */
		d->job.patient = true;
	/* A busy display may say Null to the side question as well: ask it every other time. */
	if (d->job.empties >= DOUBT && (d->job.empties - DOUBT) % 2 == 0 && !d->job.awake)
		return ddc_next_ask(d, ASK_KNOWN, d->line.end_ns);
	if (d->job.empties > DOUBT && d->job.awake && r->null_means == DDC_NULL_UNKNOWN)
		return ddc_next_ask(d, ASK_UNKNOWN, d->line.end_ns);
	return retry(d, d->line.end_ns);
}

static int64_t on_failure(struct monitor_ddc *d, enum ddc_outcome outcome)
{
	d->job.failure = outcome;
	if ((outcome == DDC_EMPTY || outcome == DDC_ZEROS) && has_bit(d->refused, d->line.question.code) &&
	    d->line.question.what == DDC_GET_VCP && could_be_unsupported(d))
		return ddc_finish(d, BB_ERR_UNSUPPORTED, 0);
	note_failure(d, outcome);
	if (outcome == DDC_EMPTY || outcome == DDC_DAMAGED)
		ddc_gap_note(&d->line.gap, false);
	switch (outcome) {
	case DDC_EMPTY:
		return on_empty(d);
	case DDC_ZEROS:
		if (++d->job.zeros == DOUBT)
			return ddc_next_ask(d, ASK_KNOWN, d->line.end_ns);
		return d->job.zeros == 1 ? ddc_next_ask(d, ASK_PRESENCE, d->line.end_ns) : retry(d, d->line.end_ns);
	case DDC_NO_ACK:
		if (++d->job.no_acks >= MOST_NO_ACK)
			return d->main == ASK_VERIFY && ddc_sets_power(d, false) ? fell_asleep(d) : give_up(d);
		return d->job.no_acks == 2 ? ddc_next_ask(d, ASK_PRESENCE, d->line.end_ns) : retry(d, d->line.end_ns);
	case DDC_BROKEN:
		return ddc_next_ask(d, ASK_PRESENCE, d->line.end_ns);
	case DDC_DAMAGED:
		if (d->reply.tries == DOUBT)
			d->job.patient = d->job.perhaps_slow = true;
		return retry(d, d->line.end_ns);
	case DDC_GOOD:
		break;
	}
	return BB_NEVER;
}

static int64_t on_value(struct monitor_ddc *d)
{
	struct bb_monitor_reply *r = &d->reply;

	if (r->request.kind == BB_MONITOR_SET) /* a code that only can be read */
		return ddc_finish(d, BB_ERR_UNSUPPORTED, 0);
	if (!d->line.vcp.supported)
		return ddc_finish(d, BB_ERR_UNSUPPORTED, 0);
	r->current = d->line.vcp.current;
	r->most = d->line.vcp.most;
	return ddc_finish(d, BB_OK, r->current);
}

static int64_t on_verify(struct monitor_ddc *d)
{
	struct bb_monitor_reply *r = &d->reply;
	const struct ddcci_vcp *v = &d->line.vcp;

	r->current = v->current;
	r->most = v->most;
	if (!v->supported)
		return ddc_finish(d, BB_ERR_UNSUPPORTED, 0);
	if (same(v->code, v->current, r->request.value)) {
		cured(d, DDC_FAULT_VERIFY);
		return ddc_finish(d, BB_OK, r->request.value);
	}
	if (v->most && r->request.value > v->most)
		return ddc_finish(d, BB_ERR_RANGE, 0);
	if (d->job.rewrites++ < REWRITES && r->tries < MONITOR_DDC_MOST_TRIES) {
		r->tries++;
		d->main = ASK_WRITE;
		return ddc_next_ask(d, ASK_WRITE, d->line.end_ns);
	}
	bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_VERIFY, BB_ERR_VERIFY, "acknowledged, but reads back as something else");
	return ddc_finish(d, BB_ERR_VERIFY, 0);
}

static int64_t on_written(struct monitor_ddc *d)
{
	const struct bb_monitor_request *q = &d->reply.request;

	if (cannot_be_read_back(q->code))
		return ddc_next_ask(d, ASK_SETTLE, d->line.quiet_ns);
	d->main = ASK_VERIFY;
	return ddc_next_ask(d, ASK_VERIFY, d->line.quiet_ns);
}

static int64_t on_fragment(struct monitor_ddc *d)
{
	struct bb_monitor_reply *r = &d->reply;
	size_t n = d->line.fragment.n;

	if (n > sizeof(r->text) - r->text_bytes)
		n = sizeof(r->text) - r->text_bytes;
	if (!n) /* the end, or all there is room for */
		return ddc_finish(d, BB_OK, (int64_t)r->text_bytes);
	memcpy(r->text + r->text_bytes, d->line.fragment.text, n);
	r->text_bytes += n;
	d->job.most_tries = r->tries > d->job.most_tries ? r->tries : d->job.most_tries;
	d->job.empties = d->job.zeros = d->job.no_acks = 0;
	r->tries = 1;
	return ddc_next_ask(d, ASK_FRAGMENT, d->line.quiet_ns);
}

/* ---- EDID ---- */

/* How many to read; one without a header tells nothing about others. */
static size_t edid_blocks(const struct monitor_ddc *d)
{
	const uint8_t *b = d->reply.edid;

	if (d->job.at < EDID_BLOCK_BYTES || b[0] != 0x00 || b[1] != 0xFF)
		return 1;
	return 1 + (b[126] < EDID_MOST_BLOCKS ? b[126] : EDID_MOST_BLOCKS - 1);
}

/* Maker, product, serial, date: who it is. What was learned of another display is not true of this one. */
static void note_identity(struct monitor_ddc *d)
{
	const uint8_t *was = d->report.good_edid, *is = d->reply.edid;

	if (!d->report.good_edid_bytes || !memcmp(was + 8, is + 8, 10))
		return;
	bb_log(d->log, BB_LOG_WARN, BB_BLAME_DEVICE, d->base.dev.id,
	       "another display is on this bus: product %02X%02X where %02X%02X was", is[11], is[10], was[11], was[10]);
	memset(d->answered, 0, sizeof(d->answered));
	memset(d->refused, 0, sizeof(d->refused));
	d->known_code = BB_VCP_VERSION;
	d->report.null_means = DDC_NULL_UNKNOWN;
	d->line.doubled = false;
	ddc_gap_init(&d->line.gap);
}

static int64_t edid_done(struct monitor_ddc *d)
{
	struct bb_monitor_reply *r = &d->reply;
	const int block = edid_bad_block(r->edid, d->job.at);

	r->edid_bytes = d->job.at;
	if (block < 0) {
		note_identity(d);
		memcpy(d->report.good_edid, r->edid, r->edid_bytes);
		d->report.good_edid_bytes = r->edid_bytes;
		cured(d, DDC_FAULT_EDID);
		return ddc_finish(d, BB_OK, (int64_t)r->edid_bytes);
	}
	bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_EDID, BB_ERR_FORMAT, block ? "an extension block" : "block 0");
	d->job.at = 0;
	if (++d->job.reads < EDID_READS)
		return retry(d, d->line.end_ns);
	/* As the display gives it; the last good one stands in the report. */
	return ddc_finish(d, BB_ERR_FORMAT, 0);
}

static int64_t on_edid(struct monitor_ddc *d)
{
	struct bb_monitor_reply *r = &d->reply;

	memcpy(r->edid + d->job.at, d->line.bytes, DDC_MEMORY_BYTES);
	d->job.at += DDC_MEMORY_BYTES;
	d->job.no_acks = 0;
	if (d->job.at < edid_blocks(d) * EDID_BLOCK_BYTES)
		return ddc_next_ask(d, ASK_EDID, d->line.end_ns);
	return edid_done(d);
}

/* An extension that cannot be reached is left out, and said to be bad. */
static int64_t edid_failed(struct monitor_ddc *d, enum ddc_outcome outcome)
{
	if (outcome == DDC_NO_ACK && d->job.at >= EDID_BLOCK_BYTES && d->job.no_acks + 1 >= MOST_NO_ACK) {
		d->reply.edid_bytes = d->job.at / EDID_BLOCK_BYTES * EDID_BLOCK_BYTES;
		bad(d, BB_HEALTH_DEGRADED, DDC_FAULT_EDID, BB_ERR_FORMAT, "an extension cannot be read");
		return ddc_finish(d, BB_ERR_FORMAT, 0);
	}
	return on_failure(d, outcome);
}

/* ---- which answer it is ---- */

static int64_t on_main(struct monitor_ddc *d)
{
	const bool controller = d->ask != ASK_EDID;

	if (controller && d->ask != ASK_WRITE) {
		good_answer(d);
		if (d->job.perhaps_slow && !d->line.gap.slow)
			found_slow(d);
		else if (d->reply.tries == 1)
			ddc_gap_note(&d->line.gap, true);
	}
	switch (d->ask) {
	case ASK_VALUE:
		return on_value(d);
	case ASK_AWAKE:
		d->main = ASK_WRITE;
		return ddc_next_ask(d, ASK_WRITE, d->line.quiet_ns);
	case ASK_WRITE:
		return on_written(d);
	case ASK_VERIFY:
		return on_verify(d);
	case ASK_FRAGMENT:
		return on_fragment(d);
	default:
		return on_edid(d);
	}
}

static void note_codes(struct monitor_ddc *d)
{
	const struct ddcci_vcp *v = &d->line.vcp;

	if (d->line.question.what != DDC_GET_VCP || d->line.outcome != DDC_GOOD)
		return;
	if (v->supported) {
		set_bit(d->answered, v->code);
		d->known_code = v->code;
	} else {
		d->report.null_means = DDC_NULL_BUSY; /* it has another way to say "unsupported" */
	}
}

int64_t ddc_on_answer(struct monitor_ddc *d)
{
	const enum ddc_outcome outcome = d->line.outcome;

	note_codes(d);
	switch (d->ask) {
	case ASK_KNOWN:
		return on_known(d, outcome);
	case ASK_UNKNOWN:
		return on_unknown(d, outcome);
	case ASK_PRESENCE:
		return on_presence(d, outcome);
	case ASK_PROBE:
	case ASK_PROBE_BUS:
		return on_probe(d, outcome);
	case ASK_EDID:
		return outcome == DDC_GOOD ? on_main(d) : edid_failed(d, outcome);
	default:
		return outcome == DDC_GOOD ? on_main(d) : on_failure(d, outcome);
	}
}
