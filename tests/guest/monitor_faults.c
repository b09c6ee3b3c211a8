/*
 * tests/guest/monitor_faults.c: the fault rows of a monitor (D1-D9) on the kernel's i2c bus, and those of its adapter:
 * each injected at the far end while a frame loop of 120 Hz runs in the driver's thread; found within its budget, named,
 * recovered from, and no frame held up by one period. Prints the fault table and one JSON line; exit 1 when a row fails.
 */
#include "tests/fault_table.h"
#include "tests/guest/monitor_stage.h"

#define FRAME_NS (RIG_S / 120)
#define FRAMES_MOST 200000

struct frames {
	struct bb_timer timer;
	int64_t worst_ns; /* since it was set to 0 */
	size_t n;
	int64_t late_ns[FRAMES_MOST];
};

static int64_t frame(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct frames *f = bb_container_of(timer, struct frames, timer);
	const int64_t late_ns = now_ns - scheduled_ns;

	f->worst_ns = late_ns > f->worst_ns ? late_ns : f->worst_ns;
	if (f->n < FRAMES_MOST)
		f->late_ns[f->n++] = late_ns;
	return scheduled_ns + FRAME_NS;
}

enum place { ON_MONITOR, ON_WIRE, ON_ADAPTER, CABLE };

static const struct row {
	const char *name, *verb, *injected;
	enum place place;
	enum ddc_fault fault;
	double budget_ms;
	enum bb_monitor_request_kind kind;
	enum bb_status status; /* of the request that meets it */
	const char *quirk;     /* of the display, meanwhile */
} rows[] = {
	{ "D1", "silent", "controller silent", ON_MONITOR, DDC_FAULT_NAK, 50, BB_MONITOR_GET, BB_ERR_LOST, NULL },
	{ "D1", "bus_error", "bus error", ON_WIRE, DDC_FAULT_EIO, 50, BB_MONITOR_GET, BB_ERR_IO, NULL },
	{ "D1", "unplug", "video cable out", ON_MONITOR, DDC_FAULT_NAK, 50, BB_MONITOR_GET, BB_ERR_LOST, NULL },
	{ "D2", "bad_checksum", "wrong checksum", ON_WIRE, DDC_FAULT_DATA, 50, BB_MONITOR_GET, BB_ERR_FORMAT, NULL },
	{ "D2", "wrong_opcode", "wrong opcode", ON_WIRE, DDC_FAULT_DATA, 50, BB_MONITOR_GET, BB_ERR_FORMAT, NULL },
	{ "D2", "stale", "answer before the last", ON_WIRE, DDC_FAULT_DATA, 50, BB_MONITOR_GET, BB_OK, NULL },
	{ "D3", "busy", "Null to everything", ON_MONITOR, DDC_FAULT_NULL, 50, BB_MONITOR_GET, BB_ERR_BUSY, NULL },
	{ "D4", "zero", "zeros", ON_WIRE, DDC_FAULT_ZERO, 50, BB_MONITOR_GET, BB_ERR_IO, NULL },
	{ "D5", "slow", "answers after 65 ms", ON_WIRE, DDC_FAULT_SLOW, 1000, BB_MONITOR_GET, BB_OK, NULL },
	{ "D6", "standby", "asleep", ON_MONITOR, DDC_FAULT_STANDBY, 1000, BB_MONITOR_GET, BB_ERR_BUSY, NULL },
	{ "D6", "off", "off, no acknowledge", ON_MONITOR, DDC_FAULT_STANDBY, 1000, BB_MONITOR_GET, BB_ERR_LOST,
	  "no_ack_asleep" },
	{ "D7", "stuck", "SDA held low", ON_WIRE, DDC_FAULT_STUCK, 100, BB_MONITOR_GET, BB_ERR_IO, NULL },
	{ "D8", "ignore_write", "write not applied", ON_MONITOR, DDC_FAULT_VERIFY, 500, BB_MONITOR_SET, BB_ERR_VERIFY, NULL },
	{ "D9", "corrupt_edid", "EDID damaged", ON_MONITOR, DDC_FAULT_EDID, 100, BB_MONITOR_EDID, BB_ERR_FORMAT, NULL },
	{ "", "mute", "adapter mute (2 s a try)", ON_ADAPTER, DDC_FAULT_EIO, 2100, BB_MONITOR_GET, BB_ERR_IO, NULL },
	{ "", "pulled", "adapter pulled out", CABLE, DDC_FAULT_NAK, 100, BB_MONITOR_GET, BB_ERR_LOST, NULL },
};

static void inject(struct stage *s, const struct row *r, bool on)
{
	struct usb_monitor *u = &s->farm->monitor[0].usb;

	if (r->place == CABLE && on)
		farm_unplug(s->farm, 0);
	else if (r->place == CABLE)
		NEED(farm_plug(s->farm, 0));
	farm_lock(s->farm);
	if (r->place == ON_ADAPTER)
		peer_i2c_tiny_usb_world_mute(u->adapter, on);
	else if (r->place != CABLE)
		NEED(rig_fault(s->rig, r->place == ON_WIRE ? "ddc" : "monitor", "m1", r->verb, "", on) == BB_OK);
	if (r->quirk)
		NEED(rig_fault(s->rig, "ddc", "m1", r->quirk, "", on) == BB_OK);
	farm_unlock(s->farm);
}

static double ms_since(struct stage *s, int64_t start_ns)
{
	return (double)(rig_now(s->rig) - start_ns) * 1e-6;
}

/* Injected before the request that meets it; -1: not found. */
static double find(struct stage *s, struct bb_monitor *m, const struct row *r, struct bb_monitor_reply *reply)
{
	const uint8_t code = r->kind == BB_MONITOR_SET ? BB_VCP_CONTRAST : r->kind == BB_MONITOR_GET ? BB_VCP_RED_GAIN : 0;
	const struct bb_monitor_request q = { r->kind, code, 31 };
	const uint64_t before = monitor_ddc_report(m)->health.count[r->fault];
	const int64_t start_ns = rig_now(s->rig);
	double found_ms = -1;

	NEED(bb_monitor_submit(m, &q) == BB_OK);
	while (bb_monitor_poll(m, reply) == BB_TIMEOUT) {
		if (found_ms < 0 && monitor_ddc_report(m)->health.count[r->fault] > before)
			found_ms = ms_since(s, start_ns);
		NEED(ms_since(s, start_ns) < 60e3);
		rig_pass(s->rig, RIG_MS);
	}
	if (found_ms < 0 && monitor_ddc_report(m)->health.count[r->fault] > before)
		found_ms = (double)(reply->done_ns - start_ns) * 1e-6;
	return found_ms;
}

/* What a write or the EDID told is cured by the same only; all else by the driver's own probes. */
static double recover(struct stage *s, struct bb_monitor *m, const struct row *r)
{
	const int64_t start_ns = rig_now(s->rig);

	if (r->kind != BB_MONITOR_GET)
		(void)stage_ask(s, m, r->kind, r->kind == BB_MONITOR_SET ? BB_VCP_CONTRAST : 0, 31);
	while (monitor_ddc_report(m)->health.health != BB_HEALTH_OK) {
		if (ms_since(s, start_ns) > 15e3)
			return -1;
		rig_pass(s->rig, RIG_MS);
	}
	return ms_since(s, start_ns);
}

static bool play(struct stage *s, struct frames *f, const struct row *r)
{
	struct bb_monitor_reply reply = { 0 };
	char bus[64];

	while (!farm_bus("m1", bus, sizeof(bus)))
		rig_pass(s->rig, 10 * RIG_MS);
	rig_pass(s->rig, 150 * RIG_MS); /* whoever asked before keeps its waits, and this one does not know of it */
	struct bb_monitor *m = stage_open_bus(s, bus);
	const uint64_t early = stage_counts(s, 0).too_early;

	for (int i = 0; i < 3; i++) /* what stale needs, and rest after the row before */
		NEED(stage_ask(s, m, BB_MONITOR_GET, i & 1 ? BB_VCP_LUMINANCE : BB_VCP_GREEN_GAIN, 0).status == BB_OK);
	rig_pass(s->rig, 200 * RIG_MS);
	f->worst_ns = 0;
	inject(s, r, true);
	if (r->place == CABLE) /* the kernel needs a while to see that it is gone */
		rig_pass(s->rig, 50 * RIG_MS);
	const int64_t start_ns = rig_now(s->rig);
	const double found_ms = find(s, m, r, &reply);
	rig_pass(s->rig, RIG_S);
	inject(s, r, false);
	const double well_ms = recover(s, m, r);
	const double frame_ms = (double)f->worst_ns * 1e-6;
	const bool fine = found_ms >= 0 && found_ms <= r->budget_ms && well_ms >= 0 && reply.status == r->status &&
			  (double)FRAME_NS * 1e-6 > frame_ms &&
			  stage_counts(s, 0).too_early == early;
	fault_row(r->name, r->injected, ddc_fault_text(r->fault), (int64_t)(found_ms * 1e6), (int64_t)(r->budget_ms * 1e6),
		  (int64_t)(well_ms * 1e6));
	if (!fine)
		printf("FAILS: %s (%s), the request: %s after %.0f ms, worst frame %.3f ms late\n", r->injected,
		       bb_monitor_device(m)->last_error.detail, bb_status_text(reply.status),
		       (double)(reply.done_ns - start_ns) * 1e-6, frame_ms);
	bb_monitor_close(m);
	return fine;
}

int main(void)
{
	static struct frames f = { .timer = { .step = frame, .rank = 3 } };
	struct stage s = { 0 };
	unsigned int failed = 0;

	stage_begin(&s);
	stage_add(&s, "m1", "S27A850D");
	NEED(farm_plug(s.farm, 0));
	NEED(bb_clock_arm(s.rig->clk, &f.timer, rig_now(s.rig)) == BB_OK);
	for (size_t i = 0; i < BB_ARRAY_LEN(rows); i++)
		failed += !play(&s, &f, &rows[i]);
	failed += stage_counts(&s, 0).saves != 0;
	bb_clock_disarm(s.rig->clk, &f.timer);
	stage_end(&s);
	printf("{\"test\":\"monitor_faults\",\"rows\":%zu,\"failed\":%u,\"frames\":%zu", BB_ARRAY_LEN(rows), failed, f.n);
	print_latency("frame_late", f.late_ns, f.n);
	printf("}\n");
	return failed != 0;
}
