/* sim/sim_monitor.c: the monitor's DDC state machine, power and faults; its values are sim/vcp_model.c's. */
#include "sim/sim_monitor.h"

#include "sim/edid_model.h"
#include "sim/sim.h"
#include "sim/sim_option.h"
#include "sim/vcp_model.h"
#include "sim/verb_args.h"

#include <math.h>
#include <string.h>

#define MS INT64_C(1000000)
#define REPLY_WAIT_NS (40 * MS)
#define WRITE_WAIT_NS (50 * MS)
#define BACK_OFF_NS (50 * MS)      /* times the number of the try */
#define MOST_TRIES 10
#define MOST_REQUEST_NS (3300 * MS)  /* ten tries and their back-off */
#define MOST_TRIES_NO_ACK 3        /* a Null may pass, a missing acknowledge seldom does */
#define I2C_BYTE_NS (90 * INT64_C(1000)) /* nine bits at 100 kHz */
#define REPLY_BYTES (6 + 12)             /* of a Get VCP: question and answer with their addresses */
#define FRAGMENT_TEXT 32
#define FRAGMENT_BYTES (7 + 40)
#define EDID_PART 32
#define EDID_READS 4 /* of one that is damaged: the first and three more */
#define WRITES 2     /* of a value that reads back as another */
#define BOOT_NS (2 * BB_NS_PER_S)
#define RESTORE_NS BB_NS_PER_S
#define MAINS_LOOK_NS (100 * MS)
#define WARM_UP_S 600.0
#define COLD_SHARE 0.80

enum ddc { DDC_READY, DDC_NULL, DDC_NO_ACK };
enum stage { STAGE_IDLE, STAGE_UNDER_WAY, STAGE_DONE };

struct sim_monitor {
	struct bb_monitor base;
	struct sim_world *world;
	struct sim_rng rng;
	bool ideal;                /* fidelity 0 */
	double busy_percent;

	const struct sim_edid_model *model;
	uint8_t edid[SIM_EDID_MAX_BYTES];
	size_t edid_bytes, corrupt_at, text_bytes;
	struct vcp_state vcp;
	uint16_t cabled_input;     /* the one that carries a signal */

	enum stage stage;
	struct bb_timer request_timer, mains_timer;
	struct bb_monitor_reply reply;

	bool fed, button_off;
	int64_t since_ns;          /* warmth and lit_ns are as of then */
	double warmth;             /* 0 cold .. 1 warm */
	int64_t lit_ns;            /* time lit since open */
	int64_t ready_ns;          /* Null until then */

	bool fault_standby, fault_silent, fault_busy, fault_unplug, fault_corrupt, fault_ignore_write;
};

static struct sim_monitor *of(struct bb_monitor *m)
{
	return bb_container_of(m, struct sim_monitor, base);
}

static bool lit(const struct sim_monitor *sm)
{
	return sm->fed && !sm->button_off && !sm->fault_standby && sm->vcp.power_mode == 1;
}

/* Light. ------------------------------------------------------------------------------------------------------- */

static double warmth_at(const struct sim_monitor *sm, int64_t at_ns)
{
	const double target = lit(sm) ? 1 : 0;
	const double dt_s = (double)(at_ns - sm->since_ns) * 1e-9;

	return dt_s > 0 ? target + (sm->warmth - target) * exp(-dt_s / WARM_UP_S) : sm->warmth;
}

/* Call before anything that changes lit(). */
static void settle_light(struct sim_monitor *sm, int64_t at_ns)
{
	sm->warmth = warmth_at(sm, at_ns);
	if (lit(sm))
		sm->lit_ns += at_ns - sm->since_ns;
	sm->since_ns = at_ns;
}

static void note_power(struct sim_monitor *sm, bool was_lit, int64_t at_ns)
{
	if (!was_lit && lit(sm) && !sm->ideal)
		sm->ready_ns = at_ns + BOOT_NS;
}

static bool mains(const struct sim_monitor *sm)
{
	return !sm->base.config.outlet[0] || sim_world_fed(sm->world, sm->base.config.outlet);
}

static void look_at_mains(struct sim_monitor *sm, int64_t at_ns)
{
	const bool was = lit(sm), fed = mains(sm);

	if (fed == sm->fed)
		return;
	settle_light(sm, at_ns);
	sm->fed = fed;
	if (fed && sm->vcp.power_mode != 1) /* mains wakes it from every software sleep */
		sm->vcp.power_mode = 1;
	note_power(sm, was, at_ns);
}

static int64_t mains_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	(void)now_ns;
	look_at_mains(bb_container_of(timer, struct sim_monitor, mains_timer), scheduled_ns);
	return scheduled_ns + MAINS_LOOK_NS;
}

double sim_monitor_luminance(struct bb_monitor *m, int64_t at_ns)
{
	struct sim_monitor *sm = of(m);

	look_at_mains(sm, bb_clock_now_ns(m->dev.clk));
	if (!lit(sm))
		return 0;
	return sm->model->peak_cd_m2 * vcp_light(&sm->vcp) * (COLD_SHARE + (1 - COLD_SHARE) * warmth_at(sm, at_ns));
}

bool sim_monitor_value(struct bb_monitor *m, uint8_t code, uint16_t *out)
{
	struct sim_monitor *sm = of(m);
	uint16_t most;

	settle_light(sm, bb_clock_now_ns(m->dev.clk));
	sm->vcp.lit_ns = sm->lit_ns;
	return vcp_get(&sm->vcp, code, out, &most) == BB_OK;
}

/* DDC/CI. ------------------------------------------------------------------------------------------------------ */

/* D6 = 5 is off for good: only mains or a hand brings it back. */
static bool wakes(const struct sim_monitor *sm, const struct bb_monitor_request *r)
{
	return r->kind == BB_MONITOR_SET && r->code == BB_VCP_POWER_MODE && r->value == 1 && !sm->button_off &&
	       !sm->fault_standby && sm->vcp.power_mode != 5;
}

static enum ddc answer(struct sim_monitor *sm, int64_t at_ns)
{
	const struct bb_monitor_request *r = &sm->reply.request;

	look_at_mains(sm, at_ns);
	if (!sm->fed || sm->fault_unplug)
		return DDC_NO_ACK;
	if (r->kind == BB_MONITOR_EDID)
		return DDC_READY; /* a memory chip of its own */
	if (sm->fault_silent)
		return DDC_NO_ACK;
	if (sm->fault_busy || (!lit(sm) && !wakes(sm, r)) || (lit(sm) && at_ns < sm->ready_ns))
		return DDC_NULL;
	if (!sm->ideal && sim_rng_uniform(&sm->rng) * 100 < sm->busy_percent)
		return DDC_NULL;
	return DDC_READY;
}

/* Actions and 02 are written and not read back. */
static bool unread(uint8_t code)
{
	return code == BB_VCP_RESTORE_DEFAULTS || code == BB_VCP_NEW_CONTROL;
}

static bool read_only(const struct sim_monitor *sm, uint8_t code)
{
	struct vcp_state copy = sm->vcp;
	uint16_t current, most;

	return vcp_get(&copy, code, &current, &most) == BB_OK && vcp_set(&copy, code, current) == BB_ERR_UNSUPPORTED;
}

static enum bb_status write_value(struct sim_monitor *sm, uint8_t code, uint16_t value, int64_t at_ns)
{
	const bool was = lit(sm);

	settle_light(sm, at_ns);
	struct vcp_state forgotten = sm->vcp;
	const enum bb_status status = vcp_set(sm->fault_ignore_write ? &forgotten : &sm->vcp, code, value);
	note_power(sm, was, at_ns);
	if (status == BB_OK && code == BB_VCP_RESTORE_DEFAULTS && !sm->ideal)
		sm->ready_ns = at_ns + RESTORE_NS;
	return status;
}

/* The answer itself. Returns what the event log keeps as the value. */
static int64_t perform(struct sim_monitor *sm, int64_t at_ns)
{
	struct bb_monitor_reply *r = &sm->reply;

	switch (r->request.kind) {
	case BB_MONITOR_EDID:
		memcpy(r->edid, sm->edid, sm->edid_bytes);
		r->edid_bytes = sm->edid_bytes;
		if (sm->fault_corrupt)
			r->edid[sm->corrupt_at] ^= 0x5A;
		r->status = sm->fault_corrupt ? BB_ERR_FORMAT : BB_OK;
		return (int64_t)r->edid_bytes;
	case BB_MONITOR_GET:
		settle_light(sm, at_ns);
		sm->vcp.lit_ns = sm->lit_ns;
		r->status = vcp_get(&sm->vcp, r->request.code, &r->current, &r->most);
		return r->current;
	case BB_MONITOR_SET:
		r->status = write_value(sm, r->request.code, r->request.value, at_ns);
		(void)!vcp_get(&sm->vcp, r->request.code, &r->current, &r->most);
		if (r->status == BB_OK && !unread(r->request.code) && r->current != r->request.value)
			r->status = BB_ERR_VERIFY;
		return r->request.value;
	case BB_MONITOR_CAPABILITIES:
		r->text_bytes = vcp_text(sm->model->shown, r->text, sizeof(r->text));
		r->status = BB_OK;
		return (int64_t)r->text_bytes;
	case BB_MONITOR_SAVE: /* hal/monitor.c refuses it */
		break;
	}
	return 0;
}

static void finish(struct sim_monitor *sm, int64_t at_ns, int64_t value)
{
	struct bb_monitor_reply *r = &sm->reply;

	r->done_ns = at_ns;
	sm->stage = STAGE_DONE;
	bb_device_event(&sm->base.dev, BB_EV_REPLY, at_ns, (int64_t)r->request.kind << 16 | r->request.code,
	                r->status == BB_OK ? value : (int64_t)r->status);
}

/* One try: true when the request is over. */
static bool try_once(struct sim_monitor *sm, int64_t at_ns)
{
	struct bb_monitor_reply *r = &sm->reply;
	const enum ddc ddc = answer(sm, at_ns);
	const uint32_t most = ddc == DDC_NO_ACK ? MOST_TRIES_NO_ACK : sm->base.limits.most_tries;

	r->tries++;
	if (ddc == DDC_READY) {
		const int64_t value = perform(sm, at_ns);
		if ((r->status == BB_ERR_FORMAT && r->tries < EDID_READS) || (r->status == BB_ERR_VERIFY && r->tries < WRITES))
			return false;
		finish(sm, at_ns, value);
		return true;
	}
	if (r->tries < most)
		return false;
	r->status = ddc == DDC_NO_ACK ? BB_ERR_LOST : BB_ERR_BUSY;
	finish(sm, at_ns, 0);
	return true;
}

/* Bytes on the wire with their addresses, and the wait the standard asks for. */
static int64_t try_ns(const struct sim_monitor *sm)
{
	switch (sm->reply.request.kind) {
	case BB_MONITOR_EDID:
		return (int64_t)(sm->edid_bytes / EDID_PART * (3 + EDID_PART)) * I2C_BYTE_NS;
	case BB_MONITOR_GET:
		return REPLY_BYTES * I2C_BYTE_NS + REPLY_WAIT_NS;
	case BB_MONITOR_SET: /* and its read-back; what can only be read is asked for and not written */
		if (read_only(sm, sm->reply.request.code))
			return REPLY_BYTES * I2C_BYTE_NS + REPLY_WAIT_NS;
		return 8 * I2C_BYTE_NS + WRITE_WAIT_NS +
		       (unread(sm->reply.request.code) ? 0 : REPLY_BYTES * I2C_BYTE_NS + REPLY_WAIT_NS);
	case BB_MONITOR_CAPABILITIES: /* the fragments, the one that ends them, and the waits between them */
		return (int64_t)(sm->text_bytes / FRAGMENT_TEXT + 2) *
			       (FRAGMENT_BYTES * I2C_BYTE_NS + REPLY_WAIT_NS + WRITE_WAIT_NS) - WRITE_WAIT_NS;
	case BB_MONITOR_SAVE:
		break;
	}
	return 0;
}

static int64_t request_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_monitor *sm = bb_container_of(timer, struct sim_monitor, request_timer);

	(void)now_ns;
	if (try_once(sm, scheduled_ns))
		return BB_NEVER;
	return scheduled_ns + sm->reply.tries * BACK_OFF_NS + try_ns(sm);
}

static enum bb_status sim_submit(struct bb_monitor *m, const struct bb_monitor_request *request)
{
	struct sim_monitor *sm = of(m);
	const int64_t now_ns = bb_clock_now_ns(m->dev.clk);

	if (sm->stage != STAGE_IDLE)
		return BB_ERR_BUSY;
	if (request->kind != BB_MONITOR_EDID && request->kind != BB_MONITOR_GET && request->kind != BB_MONITOR_SET &&
	    request->kind != BB_MONITOR_CAPABILITIES)
		return BB_ERR_USAGE;
	memset(&sm->reply, 0, sizeof(sm->reply));
	sm->reply.request = *request;
	if (sm->ideal) {
		while (!try_once(sm, now_ns))
			;
		return BB_OK;
	}
	sm->stage = STAGE_UNDER_WAY;
	const enum bb_status status = bb_clock_arm(m->dev.clk, &sm->request_timer, now_ns + try_ns(sm));
	if (status != BB_OK)
		sm->stage = STAGE_IDLE;
	return status;
}

static enum bb_status sim_poll(struct bb_monitor *m, struct bb_monitor_reply *reply)
{
	struct sim_monitor *sm = of(m);

	if (sm->stage != STAGE_DONE)
		return BB_TIMEOUT;
	*reply = sm->reply;
	sm->stage = STAGE_IDLE;
	return BB_OK;
}

/* Opening. ----------------------------------------------------------------------------------------------------- */

static const struct sim_option options[] = {
	{ "busy_percent", offsetof(struct sim_monitor, busy_percent), 0, 100 }, /* of the tries meet a Null */
	{ NULL, 0, 0, 0 },
};

static enum bb_status make_edid(struct sim_monitor *sm, struct bb_cvt *timing)
{
	const struct bb_monitor_config *c = &sm->base.config;
	struct sim_rng rng;

	sm->model = sim_edid_model(c->edid);
	/* A serial belongs to the thing, not to the run. */
	sim_rng_seed(&rng, 0, "edid", c->id);
	struct sim_edid_spec spec = { .model = sm->model, .width_px = sm->model->width_px,
		                      .height_px = sm->model->height_px,
		                      .rate = { (uint32_t)sm->model->rate_hz, 1 },
		                      .serial = (uint32_t)(sim_rng_u64(&rng) % 10000000) };
	if (c->width_px > 0 && c->width_px < 65536)
		spec.width_px = (int)c->width_px;
	if (c->height_px > 0 && c->height_px < 65536)
		spec.height_px = (int)c->height_px;
	if (c->rate.num && c->rate.den)
		spec.rate = c->rate;
	if (sim_edid_make(&spec, sm->edid, &sm->edid_bytes) != BB_OK ||
	    bb_cvt_rb(spec.width_px, spec.height_px, spec.rate, timing) != BB_OK)
		return bb_device_fail(&sm->base.dev, BB_ERR_CONFIG, "open", "%d x %d at %.3f Hz fits no EDID timing",
		                      spec.width_px, spec.height_px, bb_rate_hz(spec.rate));
	sm->corrupt_at = 8 + sim_rng_u64(&rng) % 100;
	return BB_OK;
}

static enum bb_status start(struct sim_monitor *sm)
{
	struct bb_clock *clk = sm->base.dev.clk;
	const int64_t now_ns = bb_clock_now_ns(clk);

	sm->since_ns = now_ns;
	sm->ready_ns = now_ns;
	sm->fed = mains(sm);
	sm->warmth = sm->fed ? 1 : 0; /* a room that is on has been on for a while */
	/* The world does not call back when mains go; a monitor on an outlet has to look. */
	if (!sm->ideal && sm->base.config.outlet[0])
		return bb_clock_arm(clk, &sm->mains_timer, now_ns + MAINS_LOOK_NS);
	return BB_OK;
}

static enum bb_status sim_open(struct bb_monitor *m, const struct bb_open *open)
{
	struct sim_monitor *sm = of(m);
	struct bb_cvt timing;

	if (!open->world)
		return BB_ERR_USAGE;
	sm->world = open->world;
	sm->ideal = open->fidelity <= 0;
	sm->busy_percent = 2;
	sm->request_timer = (struct bb_timer){ .step = request_step, .rank = 1 };
	sm->mains_timer = (struct bb_timer){ .step = mains_step, .rank = 1 };
	sim_rng_seed(&sm->rng, open->seed, "monitor", m->config.id);
	enum bb_status status = sim_options_read(&m->dev, open->uri, options, sm);
	if (status == BB_OK)
		status = make_edid(sm, &timing);
	if (status != BB_OK) {
		bb_log(open->log, BB_LOG_ERROR, BB_BLAME_CONFIG, m->config.id, "%s", m->dev.last_error.detail);
		return status;
	}
	m->limits = (struct bb_monitor_limits){ .most_tries = MOST_TRIES };
	if (!sm->ideal)
		m->limits = (struct bb_monitor_limits){ .reply_wait_ns = REPLY_WAIT_NS,
			                                .write_wait_ns = WRITE_WAIT_NS,
			                                .transfer_ns = FRAGMENT_BYTES * I2C_BYTE_NS,
			                                .most_request_ns = MOST_REQUEST_NS,
			                                .most_tries = MOST_TRIES };
	sm->cabled_input = m->config.input > 0 && m->config.input < 256 ? (uint16_t)m->config.input : VCP_INPUT_DP1;
	vcp_init(&sm->vcp, sm->cabled_input, bb_cvt_line_hz(&timing), bb_cvt_rate_hz(&timing),
	         500 + (uint32_t)(sim_rng_u64(&sm->rng) % 15000));
	sm->text_bytes = vcp_text(sm->model->shown, sm->reply.text, sizeof(sm->reply.text));
	status = start(sm);
	if (status == BB_OK)
		status = sim_world_register(sm->world, "monitor", m->config.id, sm, sim_monitor_verbs);
	if (status != BB_OK)
		bb_clock_disarm(m->dev.clk, &sm->mains_timer);
	return status;
}

static void sim_close(struct bb_monitor *m)
{
	struct sim_monitor *sm = of(m);

	bb_clock_disarm(m->dev.clk, &sm->request_timer);
	bb_clock_disarm(m->dev.clk, &sm->mains_timer);
	sim_world_unregister(sm->world, sm);
}

static const struct bb_monitor_ops ops = { sim_open, sim_close, sim_submit, sim_poll };
const struct bb_monitor_driver sim_monitor_driver = { "sim", sizeof(struct sim_monitor), &ops };

/* Verbs. ------------------------------------------------------------------------------------------------------- */

static int64_t now_of(const struct sim_monitor *sm)
{
	return bb_clock_now_ns(sm->base.dev.clk);
}

/* Sets a flag that may change lit(). */
static void set_power_flag(struct sim_monitor *sm, bool *flag, bool on)
{
	const bool was = lit(sm);

	settle_light(sm, now_of(sm));
	*flag = on;
	note_power(sm, was, now_of(sm));
}

static enum bb_status verb_off(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_monitor *sm = device;
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && sm)
		set_power_flag(sm, &sm->button_off, on);
	return status;
}

static enum bb_status verb_standby(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_monitor *sm = device;
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && sm)
		set_power_flag(sm, &sm->fault_standby, on);
	return status;
}

static enum bb_status verb_silent(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		((struct sim_monitor *)device)->fault_silent = on;
	return status;
}

static enum bb_status verb_busy(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		((struct sim_monitor *)device)->fault_busy = on;
	return status;
}

static enum bb_status verb_unplug(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		((struct sim_monitor *)device)->fault_unplug = on;
	return status;
}

static enum bb_status verb_corrupt_edid(void *device, const struct sim_fault_args *args, bool on,
                                        struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		((struct sim_monitor *)device)->fault_corrupt = on;
	return status;
}

static enum bb_status verb_ignore_write(void *device, const struct sim_fault_args *args, bool on,
                                        struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		((struct sim_monitor *)device)->fault_ignore_write = on;
	return status;
}

static enum bb_status verb_input(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return vcp_fault_input(device ? &((struct sim_monitor *)device)->vcp : NULL, args, on, err);
}

static enum bb_status verb_drift(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return vcp_fault_drift(device ? &((struct sim_monitor *)device)->vcp : NULL, args, on, err);
}

const struct sim_verb sim_monitor_verbs[] = {
	{ "input", "[value=CODE]", "someone pressed the button: it shows that input (VCP 60) instead of its own",
	  "value=0x11", verb_input },
	{ "off", "", "someone switched it off: dark, answers EDID but no VCP", "", verb_off },
	{ "standby", "", "it fell asleep: dark, answers EDID but no VCP", "", verb_standby },
	{ "silent", "", "its DDC controller hangs: no acknowledge; EDID still answers", "", verb_silent },
	{ "busy", "", "it answers every VCP request with Null", "", verb_busy },
	{ "drift", "[luminance=N]", "its brightness (VCP 10) moved, to 20 unless told", "luminance=35", verb_drift },
	{ "unplug", "", "its cable is out: nothing answers", "", verb_unplug },
	{ "corrupt_edid", "", "one byte of its EDID reads wrong", "", verb_corrupt_edid },
	{ "ignore_write", "", "it acknowledges a write and does not apply it", "", verb_ignore_write },
	{ NULL, NULL, NULL, NULL, NULL },
};
