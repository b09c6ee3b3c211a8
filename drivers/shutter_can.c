/* drivers/shutter_can.c: see drivers/shutter_can.h. The handle, its timer, what comes in and what goes out. */
#include "drivers/bus_can.h"
#include "drivers/shutter_can_impl.h"
#include "hal/options.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define FRAMES_AT_ONCE 512
#define BRISK_NS SC_MS
#define CALM_NS (2 * SC_MS)
#define SILENCE_NS (3 * BB_NS_PER_S)
#define HOLD_NS (8 * BB_NS_PER_S)
#define SINGLE_NS (500 * SC_MS) /* an alarm about single frames ends after that long without another */

static const struct bb_option options[] = {
	BB_OPT_I64(struct sc_options, node, 1, 1, 126, "node id of the emitter; stages follow in chain order"),
	BB_OPT_I64(struct sc_options, master, 127, 1, 127, "node id of this host's heartbeat"),
	BB_OPT_I64(struct sc_options, overflow, SHUT_COUNTER_MOST, 2, SHUT_COUNTER_MOST, "SYNC counter's last value, even"),
	BB_OPT_I64(struct sc_options, heartbeat_ms, 100, 10, 1000, "heartbeat period of the nodes and this host"),
	BB_OPT_I64(struct sc_options, sdo_ms, 20, 2, 1000, "wait for an SDO reply"),
	BB_OPT_I64(struct sc_options, lss_ms, 10, 2, 100, "wait for an LSS reply"),
	BB_OPT_I64(struct sc_options, pdo_type, 254, 1, 255, "TPDO1's transmission: 1 with each SYNC, 254 at each switch"),
	BB_OPT_I64(struct sc_options, watchdog_ms, 100, 20, 1000, "shutters open after that long without an edge"),
	BB_OPT_F64(struct sc_options, stamp_error_us, 100, 0, 10000, "error of this host's receive stamps, at most"),
	{ "lss", BB_OPT_TYPE_BOOL, offsetof(struct sc_options, lss), 0, 1, 0, 1, 1, NULL, false,
	  "give ids to new controllers" },
	BB_OPT_END,
};

static struct shutter_can *own(struct bb_shutter *sh)
{
	return bb_container_of(sh, struct shutter_can, base);
}

static const char *fault_name(enum bb_shutter_can_fault fault)
{
	static const char *const names[BB_CANF_COUNT] = {
#define X(name, text) text,
		BB_SHUTTER_CAN_FAULTS(X)
#undef X
	};
	return names[fault];
}

/* Health */

static bool silent(const struct shutter_can *s)
{
	for (size_t i = 0; i < s->n_nodes; i++)
		if (s->node[i].heard || s->node[i].ready)
			return false;
	return true;
}

static enum bb_health judge(const struct shutter_can *s, int64_t now_ns)
{
	const struct bb_shutter_can_alarm *a = s->alarm;
	const bool held = s->locked && now_ns - s->heard_ns <= HOLD_NS;

	if (s->quarantined)
		return BB_HEALTH_QUARANTINED;
	if (a[BB_CANF_IF_DOWN].active || a[BB_CANF_BUS_OFF].active || a[BB_CANF_SYNC_LATE].active)
		return held ? BB_HEALTH_HOLDOVER : BB_HEALTH_LOST;
	if (silent(s))
		return now_ns - s->open_ns > SILENCE_NS ? BB_HEALTH_LOST : BB_HEALTH_INIT;
	for (int i = 0; i < BB_CANF_COUNT; i++)
		if (a[i].active)
			return BB_HEALTH_DEGRADED;
	if (sc_all_ready(s) && s->locked)
		return BB_HEALTH_OK;
	return s->health == BB_HEALTH_INIT ? BB_HEALTH_INIT : BB_HEALTH_RECOVERING;
}

static void judge_again(struct shutter_can *s, int64_t now_ns)
{
	const enum bb_health health = judge(s, now_ns);

	if (health != s->health)
		bb_device_event(&s->base.dev, BB_EV_HEALTH, now_ns, health, s->health);
	s->health = health;
}

/* Alarms */

void sc_raise(struct shutter_can *s, enum bb_shutter_can_fault fault, uint32_t detail, int64_t now_ns, const char *fmt,
              ...)
{
	struct bb_shutter_can_alarm *a = &s->alarm[fault];
	char text[80];
	va_list ap;

	a->count++;
	a->detail = detail;
	a->last_ns = now_ns;
	if (!a->active)
		a->raised_ns = now_ns;
	va_start(ap, fmt);
	vsnprintf(text, sizeof(text), fmt, ap);
	va_end(ap);
	(void)bb_device_fail(&s->base.dev, fault == BB_CANF_IF_DOWN || fault == BB_CANF_NODE_LOST ? BB_ERR_LOST : BB_ERR_IO,
	                     "can", "%s %s", fault_name(fault), text);
	if (!a->active)
		bb_log(s->base.dev.log, BB_LOG_WARN, BB_BLAME_DEVICE, s->base.dev.id, "%s %s", fault_name(fault), text);
	a->active = true;
	judge_again(s, now_ns); /* never OK with something wrong, not even until the next look */
}

void sc_clear(struct shutter_can *s, enum bb_shutter_can_fault fault, int64_t now_ns)
{
	struct bb_shutter_can_alarm *a = &s->alarm[fault];

	if (!a->active)
		return;
	a->active = false;
	a->cleared_ns = now_ns;
	bb_log(s->base.dev.log, BB_LOG_INFO, BB_BLAME_DEVICE, s->base.dev.id, "%s is over", fault_name(fault));
}

void sc_send(struct shutter_can *s, const struct bb_can_frame *f, bool state)
{
	if (!bb_can_queue_put(&s->tx, f, state))
		sc_raise(s, BB_CANF_TX_DROP, (uint32_t)s->tx.dropped, bb_clock_now_ns(s->base.dev.clk),
		         "%llu frames, the queue is full", (unsigned long long)s->tx.dropped);
}

/* What comes in */

static void emcy_frame(struct shutter_can *s, struct sc_node *n, const struct bb_can_frame *f)
{
	struct bb_co_emcy e;

	if (bb_co_read_emcy(f, &e) != BB_OK) {
		sc_raise(s, BB_CANF_PROTO, n->id, f->at_ns, "EMCY of %u bytes from node %u", f->n_bytes, n->id);
		return;
	}
	n->emcy = e.code;
	if (!n->ready)
		return; /* it is being configured: what it complains of is known */
	if (e.code) {
		n->failed = true;
		sc_raise(s, BB_CANF_NODE, n->id, f->at_ns, "node %u: emergency %04xh, register %02x", n->id, e.code,
		         e.error_register);
		return;
	}
	n->failed = false;
	for (size_t i = 0; i < s->n_nodes; i++)
		if (s->node[i].failed)
			return;
	sc_clear(s, BB_CANF_NODE, f->at_ns);
}

static void heartbeat_frame(struct shutter_can *s, struct sc_node *n, const struct bb_can_frame *f)
{
	uint8_t state;

	if (bb_co_read_heartbeat(f, &state) == BB_OK)
		sc_node_state(s, n, state, f->at_ns);
	else
		sc_raise(s, BB_CANF_PROTO, n->id, f->at_ns, "bad heartbeat of node %u", n->id);
}

static void node_frame(struct shutter_can *s, struct sc_node *n, enum bb_co_kind kind, const struct bb_can_frame *f)
{
	switch (kind) {
	case BB_CO_EMCY:
		emcy_frame(s, n, f);
		return;
	case BB_CO_TPDO1:
		sc_phase_frame(s, n, f);
		return;
	case BB_CO_TPDO2:
		if (n->position == 0)
			sc_follow_frame(s, f);
		return;
	case BB_CO_SDO_REPLY:
		bb_co_sdo_receive(&n->sdo, f, f->at_ns);
		return;
	case BB_CO_HEARTBEAT:
		heartbeat_frame(s, n, f);
		return;
	default:
		return;
	}
}

static void take_frame(struct shutter_can *s, const struct bb_can_frame *f, int64_t now_ns)
{
	uint8_t node;

	if (f->error) {
		sc_error_frame(s, f, now_ns);
		return;
	}
	sc_bus_status(s, BB_OK, now_ns);
	const enum bb_co_kind kind = bb_co_kind(f, &node);
	if (f->extended || f->remote)
		return;
	/* SYNC has its window, and fastscan's questions may be answered by all at once. */
	if (kind != BB_CO_LSS_REPLY) {
		const enum bb_can_verdict verdict = bb_can_guard_frame(&s->guard, f->id, f->at_ns);
		if (verdict == BB_CAN_BABBLE_BEGINS)
			sc_raise(s, BB_CANF_BABBLE, f->id, now_ns, "id %03x above %u frames per second", f->id,
			         3 * s->guard.id[f->id].contract_per_s);
		if (verdict != BB_CAN_PASS && kind != BB_CO_SYNC)
			return;
	}
	if (kind == BB_CO_SYNC)
		sc_sync_frame(s, f);
	else if (kind == BB_CO_LSS_REPLY)
		bb_co_lss_receive(&s->lss, f, f->at_ns);
	else if (kind == BB_CO_HEARTBEAT && node == s->opt.master)
		sc_raise(s, BB_CANF_DUP_ID, node, now_ns, "somebody else beats as node %u, which is this host", node);
	else if (node && s->node_of[node])
		node_frame(s, &s->node[s->node_of[node] - 1], kind, f);
}

static void pump(struct shutter_can *s, int64_t now_ns)
{
	enum bb_status status = BB_OK;
	struct bb_can_frame f;

	for (int i = 0; i < FRAMES_AT_ONCE && (status = s->bus->ops->receive(s->bus, &f)) == BB_OK; i++)
		if (f.n_bytes <= 8)
			take_frame(s, &f, now_ns);
	if (status != BB_OK)
		sc_bus_status(s, status, now_ns);
}

static void watch(struct shutter_can *s, int64_t now_ns)
{
	static const enum bb_shutter_can_fault single[] = { BB_CANF_PROTO, BB_CANF_STALE, BB_CANF_DUP_ID };

	for (size_t i = 0; i < BB_ARRAY_LEN(single); i++)
		if (s->alarm[single[i]].active && now_ns - s->alarm[single[i]].last_ns >= SINGLE_NS)
			sc_clear(s, single[i], now_ns);
	if (!bb_can_guard_poll(&s->guard, now_ns))
		sc_clear(s, BB_CANF_BABBLE, now_ns);
	if (s->good >= SC_GOOD_SYNCS)
		sc_clear(s, BB_CANF_SYNC_LATE, now_ns);
	judge_again(s, now_ns);
}

/* Own heartbeat: the newest counts, and a node that misses five opens its shutters. */
static void beat(struct shutter_can *s, int64_t now_ns)
{
	struct bb_can_frame f;

	if (now_ns < s->beat_ns)
		return;
	s->beat_ns = now_ns + s->opt.heartbeat_ms * SC_MS;
	bb_co_heartbeat(&f, (uint8_t)s->opt.master, CO_OPERATIONAL);
	sc_send(s, &f, true);
}

static void work(struct shutter_can *s, int64_t now_ns)
{
	pump(s, now_ns);
	sc_sync_poll(s, now_ns);
	sc_boot_poll(s, now_ns);
	beat(s, now_ns);
	sc_bus_poll(s, now_ns);
	watch(s, now_ns);
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct shutter_can *s = bb_container_of(timer, struct shutter_can, timer);

	(void)scheduled_ns;
	work(s, now_ns);
	return now_ns + (sc_boot_busy(s) || s->tx.n ? BRISK_NS : CALM_NS);
}

/* Ops */

static void promise_rates(struct shutter_can *s)
{
	const uint32_t edges = (uint32_t)ceil(bb_rate_hz(s->base.config.rate)) + 1;
	const uint32_t beats = (uint32_t)(1000 / s->opt.heartbeat_ms) + 1;

	bb_can_guard_contract(&s->guard, CO_SYNC, edges);
	for (size_t i = 0; i < s->n_nodes; i++) {
		const uint32_t id = s->node[i].id;
		bb_can_guard_contract(&s->guard, CO_TPDO1 + id, edges);
		bb_can_guard_contract(&s->guard, CO_TPDO2 + id, edges);
		bb_can_guard_contract(&s->guard, CO_HEARTBEAT + id, beats);
		bb_can_guard_contract(&s->guard, CO_SDO_REPLY + id, 1000);
	}
}

static enum bb_status refuse(struct shutter_can *s, struct bb_error *err, const char *what)
{
	struct bb_error own_error = { 0 };

	if (!err)
		err = &own_error;
	(void)bb_fail(err, BB_ERR_CONFIG, 1534, NULL, "%s", what);
	bb_log(s->base.dev.log, BB_LOG_ERROR, BB_BLAME_CONFIG, s->base.dev.id, "%s", err->text);
	return bb_device_fail(&s->base.dev, BB_ERR_CONFIG, "open", "%s", what);
}

static enum bb_status read_options(struct shutter_can *s, const struct bb_uri *uri)
{
	struct bb_error err = { 0 };

	bb_options_defaults(options, &s->opt);
	for (size_t i = 0; uri && i < uri->n_options; i++)
		if (bb_options_set(options, &s->opt, uri->option[i].key, uri->option[i].value, NULL, &err) != BB_OK)
			return refuse(s, &err, "a bad option");
	const struct bb_shutter_config *c = &s->base.config;
	if (c->n_stages < 0 || c->n_stages > BB_STAGES_MAX)
		return refuse(s, NULL, "more stages than a chain has");
	if (s->opt.node + c->n_stages > CO_NODE_MOST ||
	    (s->opt.master >= s->opt.node && s->opt.master <= s->opt.node + c->n_stages))
		return refuse(s, NULL, "the node ids do not fit");
	if (s->opt.overflow % 2)
		return refuse(s, NULL, "the SYNC counter carries the eye: overflow is even");
	return BB_OK;
}

static enum bb_status check_config(struct shutter_can *s)
{
	const struct bb_shutter_config *c = &s->base.config;
	struct bb_shutter_limits *l = &s->base.limits;
	const int64_t period_ns = c->rate.num && c->rate.den ? bb_rate_period_ns(c->rate) : 0;

	*l = (struct bb_shutter_limits){ .least_period_ns = 5000000, .most_period_ns = 25000000, .phase_step_ns = 1000,
	                                 .n_stages = s->base.config.n_stages };
	if (period_ns < l->least_period_ns || period_ns > l->most_period_ns)
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "a period of %lld ns", (long long)period_ns);
	if (!(bb_cell_moves(&c->cell) && bb_cell_moves(&c->glasses) && c->emitter_offset_us >= 0 &&
	      c->emitter_offset_us * 1000 < (double)period_ns && c->stage_delay_us >= 0 &&
	      c->stage_delay_us * 1000 * (double)(c->n_stages + 1) < (double)period_ns))
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "a delay out of range");
	l->stamp_error_ns = llround(s->opt.stamp_error_us * 1000);
	l->open_ns = llround(c->cell.open_us * 1000);
	l->close_ns = llround(c->cell.close_us * 1000);
	s->period_ns = (double)period_ns;
	return BB_OK;
}

/* As the chain is wired: a stage switches when it hears the edge. */
static void default_phases(struct shutter_can *s)
{
	for (size_t i = 0; i < s->n_nodes; i++) {
		const double us = i ? (double)i * s->base.config.stage_delay_us : s->base.config.emitter_offset_us;
		s->want[i] = (struct sc_wanted){ (uint32_t)llround(us * 1000), 1000000, 0 };
	}
}

static enum bb_status prepare(struct shutter_can *s, const struct bb_open *open)
{
	enum bb_status status = read_options(s, open->uri);

	if (status == BB_OK)
		status = check_config(s);
	if (status != BB_OK)
		return status;
	s->n_nodes = (size_t)s->base.config.n_stages + 1;
	s->random = open->seed;
	s->open_ns = bb_clock_now_ns(s->base.dev.clk);
	s->restart_ns = s->down_ns = s->busy_ns = BB_NEVER;
	for (size_t i = 0; i < BB_ARRAY_LEN(s->restarts_ns); i++)
		s->restarts_ns[i] = INT64_MIN;
	default_phases(s);
	sc_boot_init(s);
	return BB_OK;
}

static enum bb_status begin(struct shutter_can *s, struct bb_can_bus *bus)
{
	struct bb_can_frame f;

	s->bus = bus;
	bb_can_guard_init(&s->guard, bus->bitrate);
	promise_rates(s);
	bb_co_nmt(&f, CO_NMT_PREOP, 0); /* whatever ran before: open, and listening */
	sc_send(s, &f, false);
	s->timer = (struct bb_timer){ .step = step, .rank = 1 };
	return bb_clock_arm(s->base.dev.clk, &s->timer, s->open_ns);
}

static enum bb_status can_open(struct bb_shutter *sh, const struct bb_open *open)
{
	struct shutter_can *s = own(sh);
	struct bb_error err = { 0 };
	struct bb_can_bus *bus = NULL;
	enum bb_status status = prepare(s, open);

	if (status != BB_OK)
		return status;
	status = bb_can_bus_open(open->uri ? open->uri->path : "", sh->dev.clk, &bus, &err);
	if (status != BB_OK) {
		bb_log(sh->dev.log, BB_LOG_ERROR, BB_BLAME_HOST, sh->dev.id, "%s", err.text);
		return bb_device_fail(&sh->dev, status, "open", "%.90s", err.text);
	}
	status = begin(s, bus);
	if (status != BB_OK)
		bus->ops->close(bus);
	return status;
}

static void can_close(struct bb_shutter *sh)
{
	struct shutter_can *s = own(sh);
	struct bb_can_frame f;

	bb_clock_disarm(sh->dev.clk, &s->timer);
	s->tx.n = 0; /* nothing that waits matters now */
	bb_co_nmt(&f, CO_NMT_PREOP, 0);
	sc_send(s, &f, false);
	(void)bb_can_queue_flush(&s->tx, s->bus); /* should it not get out: they open without heartbeats of ours */
	s->bus->ops->close(s->bus);
}

static bool gone(const struct shutter_can *s)
{
	return s->health == BB_HEALTH_LOST || s->health == BB_HEALTH_QUARANTINED;
}

static enum bb_status can_read(struct bb_shutter *sh, struct bb_shutter_edge *edges, size_t cap, size_t *n_out)
{
	struct shutter_can *s = own(sh);

	pump(s, bb_clock_now_ns(sh->dev.clk));
	for (; *n_out < cap && s->n_edges; s->n_edges--) {
		edges[(*n_out)++] = s->edge[s->head];
		s->head = (s->head + 1) % SC_EDGES;
	}
	if (*n_out)
		return BB_OK;
	return gone(s) ? BB_ERR_LOST : BB_TIMEOUT; /* last_error names what was found */
}

static enum bb_status can_set_phase(struct bb_shutter *sh, uint8_t stage, int64_t delay_ns, uint32_t duty_ppm)
{
	struct shutter_can *s = own(sh);
	const size_t position = stage == BB_STAGE_EMITTER ? 0 : stage + 1u;
	const int64_t step_ns = sh->limits.phase_step_ns;
	int64_t rounded_ns = (delay_ns + step_ns / 2) / step_ns * step_ns;

	if (gone(s))
		return BB_ERR_LOST;
	if (rounded_ns >= bb_rate_period_ns(sh->config.rate))
		rounded_ns -= step_ns;
	s->want[position].delay_ns = (uint32_t)rounded_ns;
	s->want[position].duty_ppm = duty_ppm;
	const int64_t now_ns = bb_clock_now_ns(sh->dev.clk);
	sc_boot_poll(s, now_ns);
	sc_bus_poll(s, now_ns);
	return BB_OK;
}

static enum bb_status can_set_mode(struct bb_shutter *sh, enum bb_shutter_mode mode)
{
	struct shutter_can *s = own(sh);
	const bool stereo = mode == BB_SHUTTER_STEREO;
	struct bb_can_frame f;

	if (gone(s) && stereo)
		return BB_ERR_LOST;
	if (stereo == s->stereo)
		return BB_OK;
	s->stereo = stereo;
	for (size_t i = 0; i < s->n_nodes; i++)
		s->node[i].counted = false;
	bb_co_nmt(&f, stereo ? CO_NMT_START : CO_NMT_PREOP, 0);
	if (!stereo || sc_all_ready(s)) /* one frame, so that all begin with the same edge */
		sc_send(s, &f, false);
	else
		for (size_t i = 0; i < s->n_nodes; i++)
			if (s->node[i].ready) {
				bb_co_nmt(&f, CO_NMT_START, s->node[i].id);
				sc_send(s, &f, false);
			}
	if (!stereo)
		s->n_edges = s->head = 0;
	sc_bus_poll(s, bb_clock_now_ns(sh->dev.clk));
	return BB_OK;
}

static const struct bb_shutter_ops ops = { can_open, can_close, can_read, can_set_phase, can_set_mode };
const struct bb_shutter_driver bb_shutter_can_driver = { "can", sizeof(struct shutter_can), &ops };

/* A bus that is open already comes in place of the world, which real back ends have none of. */
static enum bb_status open_on(struct bb_shutter *sh, const struct bb_open *open)
{
	const enum bb_status status = prepare(own(sh), open);

	return status == BB_OK ? begin(own(sh), open->world) : status;
}

enum bb_status bb_shutter_can_open_on(struct bb_can_bus *bus, const struct bb_shutter_config *config,
                                      const struct bb_open *open, struct bb_shutter **out)
{
	static const struct bb_shutter_ops on_ops = { open_on, can_close, can_read, can_set_phase, can_set_mode };
	static const struct bb_shutter_driver driver = { "can", sizeof(struct shutter_can), &on_ops };
	struct bb_open with_bus = *open;

	with_bus.world = bus;
	const enum bb_status status = bb_shutter_open(&driver, config, &with_bus, out);
	if (status != BB_OK)
		bus->ops->close(bus);
	return status;
}

/* What it knows */

static const struct shutter_can *own_const(const struct bb_shutter *sh)
{
	return (const struct shutter_can *)(const void *)sh; /* base is the first member */
}

struct bb_shutter_can_alarm bb_shutter_can_alarm(const struct bb_shutter *sh, enum bb_shutter_can_fault fault)
{
	struct bb_shutter_can_alarm a = own_const(sh)->alarm[fault];

	a.name = fault_name(fault);
	return a;
}

struct bb_shutter_can_status bb_shutter_can_status(const struct bb_shutter *sh)
{
	const struct shutter_can *s = own_const(sh);
	const struct sc_sync *y = &s->sync[s->sync_at];
	struct bb_shutter_can_status out = { .health = s->health, .ready = sc_all_ready(s), .tx_stopped = s->off,
		                             .tx_errors = s->tx_errors, .rx_errors = s->rx_errors,
		                             .period_ns = s->period_ns, .syncs = s->syncs, .phases = s->phases,
		                             .freewheeled = s->freewheeled, .sync_ns = y->edge_ns,
		                             .sync_seq = y->seq };

	for (size_t i = 0; i < BB_ARRAY_LEN(s->restarts_ns); i++)
		out.restarts += s->restarts_ns[i] > bb_clock_now_ns(sh->dev.clk) - 60 * BB_NS_PER_S;
	for (size_t i = 0; i < s->n_nodes; i++)
		out.n_ready += s->node[i].ready;
	return out;
}

bool bb_shutter_can_node(const struct bb_shutter *sh, size_t i, struct bb_shutter_can_node *out)
{
	const struct shutter_can *s = own_const(sh);

	if (i >= s->n_nodes)
		return false;
	const struct sc_node *n = &s->node[i];
	*out = (struct bb_shutter_can_node){ .id = n->id, .state = n->state, .ready = n->ready, .lost = n->lost,
		                             .position = n->position, .serial = n->serial, .emcy = n->emcy,
		                             .phases = n->phases };
	memcpy(out->name, n->name, sizeof(out->name));
	return true;
}
