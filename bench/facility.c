#include "bench/facility.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PATROL_NS (BB_NS_PER_S / 2)
#define POLL_NS INT64_C(10000000)

/* What a monitor is asked, in this order; SETTINGS covers one write and one read-back per setting. */
enum step {
	STEP_EDID, STEP_SETTINGS, STEP_INPUT, STEP_HOURS, /* bring-up */
	STEP_PATROL_INPUT, STEP_PATROL_POWER, STEP_PATROL_SETTING, STEP_PATROL_EDID
};

struct monitor {
	struct bb_timer timer;
	struct bb_facility *f;
	struct bb_monitor *dev;
	const struct bb_monitor_config *config;
	size_t slot;
	enum step step;
	size_t setting;
	bool verify, waiting, through;
	unsigned wrong;           /* bits, see judge() */
	char name[16];
	uint32_t hours;
	uint16_t input;
};

struct bb_facility {
	struct bb_rig *rig;
	struct bb_clock *clk;
	struct bb_watch *watch;
	size_t n_monitors, n_through;
	struct monitor *monitors;
	struct bb_timer outlets;
	size_t pdu, outlet;      /* the next to switch on; pdu == n_pdus: all done, on patrol */
	bool outlets_done;
	int64_t inrush_over_ns;
	size_t *power_slot;
	double (*current_a)[BB_OUTLETS_MAX];
};

/* ---- monitors ---- */

static void read_name(struct monitor *m, const struct bb_monitor_reply *r)
{
	/* EDID descriptor FC: 13 bytes of text, ended by a line feed (EDID 1.4 section 3.10.3.4). */
	for (size_t at = 54; at + 18 <= 126 && at + 18 <= r->edid_bytes; at += 18) {
		const uint8_t *d = r->edid + at;
		size_t n = 0;
		if (d[0] || d[1] || d[3] != 0xFC)
			continue;
		while (n < 13 && d[5 + n] >= 0x20 && d[5 + n] < 0x7F)
			n++;
		memcpy(m->name, d + 5, n);
		m->name[n] = '\0';
	}
}

static struct bb_monitor_request request_of(const struct monitor *m)
{
	struct bb_monitor_request q = { BB_MONITOR_GET, 0, 0 };

	switch (m->step) {
	case STEP_EDID:
	case STEP_PATROL_EDID:
		q.kind = BB_MONITOR_EDID;
		break;
	case STEP_PATROL_SETTING:
		q.code = (uint8_t)m->config->setting[m->setting].code;
		q.value = (uint16_t)m->config->setting[m->setting].value;
		break;
	case STEP_SETTINGS:
		q.kind = m->verify ? BB_MONITOR_GET : BB_MONITOR_SET;
		q.code = (uint8_t)m->config->setting[m->setting].code;
		q.value = (uint16_t)m->config->setting[m->setting].value;
		break;
	case STEP_HOURS:
		q.code = BB_VCP_HOURS;
		break;
	case STEP_PATROL_POWER:
		q.code = BB_VCP_POWER_MODE;
		break;
	case STEP_INPUT:
	case STEP_PATROL_INPUT:
		q.code = BB_VCP_INPUT;
		break;
	}
	return q;
}

/* What of a monitor is wrong, one bit each: it is good again only when nothing is. */
enum { WRONG_SILENT = 1, WRONG_EDID = 2, WRONG_INPUT = 4, WRONG_POWER = 8, WRONG_SETTING = 16 };

static unsigned aspect_of(const struct monitor *m, const struct bb_monitor_request *q)
{
	if (q->kind == BB_MONITOR_EDID)
		return WRONG_EDID;
	if (m->step == STEP_SETTINGS || m->step == STEP_PATROL_SETTING)
		return WRONG_SETTING;
	return q->code == BB_VCP_INPUT ? WRONG_INPUT : q->code == BB_VCP_POWER_MODE ? WRONG_POWER : 0;
}

/* It answers, and the answer says what is wrong. */
static bool came_wrong(const struct bb_monitor_reply *r)
{
	return r->status == BB_ERR_VERIFY || (r->status == BB_ERR_FORMAT && r->request.kind == BB_MONITOR_EDID);
}

/* What a value that came should have been: false and words when it is not. */
static bool as_wanted(struct monitor *m, const struct bb_monitor_reply *r, char *words, size_t cap)
{
	const struct bb_monitor_request *q = &r->request;

	if (r->status == BB_ERR_VERIFY)
		snprintf(words, cap, "VCP %02X was set to %u and acknowledged, but reads back %u", q->code, q->value,
		         r->current);
	else if (r->status == BB_ERR_FORMAT)
		snprintf(words, cap, "EDID is broken (header or checksum)");
	else if (q->kind != BB_MONITOR_GET)
		return true;
	else if (q->code == BB_VCP_INPUT && m->config->input && r->current != m->config->input)
		snprintf(words, cap, "shows input 0x%02X, want 0x%02X", r->current, (unsigned)m->config->input);
	else if (q->code == BB_VCP_POWER_MODE && r->current != 1)
		snprintf(words, cap, "power mode is %u, want 1 (on)", r->current);
	else if (aspect_of(m, q) == WRONG_SETTING && r->current != q->value)
		snprintf(words, cap, "VCP %02X reads %u, want %u", q->code, r->current, q->value);
	else
		return true;
	return false;
}

static void note_value(struct monitor *m, const struct bb_monitor_reply *r)
{
	if (r->request.kind == BB_MONITOR_EDID)
		read_name(m, r);
	if (r->request.kind == BB_MONITOR_GET && r->request.code == BB_VCP_INPUT)
		m->input = r->current;
	if (r->request.kind == BB_MONITOR_GET && r->request.code == BB_VCP_HOURS)
		m->hours = r->current;
}

/* Is the reply what it should be? Tells the watch either way. */
static void judge(struct monitor *m, const struct bb_monitor_reply *r, int64_t now_ns)
{
	struct bb_watch *w = m->f->watch;
	const struct bb_monitor_request *q = &r->request;
	char words[96];

	if (r->status == BB_ERR_UNSUPPORTED && q->code == BB_VCP_HOURS)
		return;
	if (r->status != BB_OK && !came_wrong(r)) {
		const bool standby = r->status == BB_ERR_BUSY;
		const char *named = bb_monitor_device(m->dev)->last_error.detail; /* the driver's own word for it */
		m->wrong |= WRONG_SILENT;
		bb_watch_bad(w, m->slot, now_ns, standby ? BB_HEALTH_DEGRADED : BB_HEALTH_LOST,
		             standby ? "answers EDID but not VCP %02X: in standby or off (%s)" : "VCP %02X: %s", q->code,
		             named[0] ? named : bb_status_text(r->status));
		return;
	}
	note_value(m, r);
	if (q->kind != BB_MONITOR_EDID)
		m->wrong &= ~(unsigned)WRONG_SILENT; /* EDID answers even in standby */
	if (as_wanted(m, r, words, sizeof(words))) {
		m->wrong &= ~aspect_of(m, q);
	} else {
		m->wrong |= aspect_of(m, q);
		bb_watch_bad(w, m->slot, now_ns, BB_HEALTH_DEGRADED, "%s", words);
	}
	if (!m->wrong)
		bb_watch_good(w, m->slot, now_ns);
}

static void advance(struct monitor *m)
{
	switch (m->step) {
	case STEP_EDID:
		m->step = m->config->n_settings ? STEP_SETTINGS : STEP_INPUT;
		break;
	case STEP_SETTINGS:
		m->verify = !m->verify;
		if (!m->verify && ++m->setting == m->config->n_settings) {
			m->step = STEP_INPUT;
			m->setting = 0;
		}
		break;
	case STEP_INPUT:
		m->step = STEP_HOURS;
		break;
	case STEP_HOURS:
	case STEP_PATROL_EDID:
		m->step = STEP_PATROL_INPUT;
		break;
	case STEP_PATROL_POWER:
		m->step = m->config->n_settings ? STEP_PATROL_SETTING : STEP_PATROL_EDID;
		break;
	case STEP_PATROL_SETTING:
		m->setting = (m->setting + 1) % m->config->n_settings;
		m->step = STEP_PATROL_EDID;
		break;
	case STEP_PATROL_INPUT:
		m->step = STEP_PATROL_POWER;
		break;
	}
}

static int64_t monitor_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct monitor *m = bb_container_of(timer, struct monitor, timer);
	struct bb_monitor_reply reply;
	(void)scheduled_ns;

	if (!m->waiting) {
		const struct bb_monitor_request q = request_of(m);
		const enum bb_status status = bb_monitor_submit(m->dev, &q);
		if (status == BB_ERR_BUSY)
			return now_ns + POLL_NS;
		m->waiting = status == BB_OK;
		if (!m->waiting) { /* gone: keep knocking, slowly */
			bb_watch_bad(m->f->watch, m->slot, now_ns, BB_HEALTH_LOST, "cannot be asked: %s",
			             bb_status_text(status));
			m->f->n_through += !m->through;
			m->through = true;
			return now_ns + PATROL_NS;
		}
		return now_ns + POLL_NS;
	}
	if (bb_monitor_poll(m->dev, &reply) != BB_OK)
		return now_ns + POLL_NS;
	m->waiting = false;
	judge(m, &reply, now_ns);
	advance(m);
	if (m->step < STEP_PATROL_INPUT)
		return now_ns;
	m->f->n_through += !m->through;
	m->through = true;
	return now_ns + PATROL_NS;
}

static enum bb_status start_monitors(struct bb_facility *f, int64_t now_ns)
{
	for (size_t i = 0; i < f->n_monitors; i++)
		if (f->monitors[i].dev) {
			const enum bb_status status = bb_clock_arm(f->clk, &f->monitors[i].timer, now_ns);
			if (status != BB_OK)
				return status;
		}
	return BB_OK;
}

/* ---- outlets ---- */

/* Beyond half again of the load the room file states. No stated load: no judgement. */
static bool draws_too_much(const struct bb_outlet_config *c, const struct bb_outlet_state *s)
{
	return s->closed && c->load_a > 0 && s->current_a > 1.5 * c->load_a + 0.5;
}

static void read_outlet(struct bb_facility *f, size_t pdu, size_t outlet, int64_t now_ns, bool *all_good)
{
	struct bb_outlet_state s;
	const struct bb_power_config *c = &f->rig->room->pdus[pdu];
	const enum bb_status status = bb_power_read(f->rig->pdus[pdu], outlet, &s);
	const char *name = c->outlet[outlet].name;

	f->current_a[pdu][outlet] = s.current_a;
	if (status == BB_OK && s.known && s.closed == s.commanded && now_ns > f->inrush_over_ns &&
	    draws_too_much(&c->outlet[outlet], &s)) {
		*all_good = false;
		bb_watch_bad(f->watch, f->power_slot[pdu], now_ns, BB_HEALTH_DEGRADED, "outlet %d (%s) draws %.1f A, want %.1f",
		             (int)c->outlet[outlet].outlet, name, s.current_a, c->outlet[outlet].load_a);
		return;
	}
	if (status == BB_OK && s.known && s.closed == s.commanded)
		return;
	*all_good = false;
	if (status != BB_OK || !s.known)
		bb_watch_bad(f->watch, f->power_slot[pdu], now_ns, BB_HEALTH_LOST, "outlet %d (%s): no read-back",
		             (int)c->outlet[outlet].outlet, name);
	else
		bb_watch_bad(f->watch, f->power_slot[pdu], now_ns, BB_HEALTH_DEGRADED,
		             "outlet %d (%s): relay stuck, commanded %s, contact reads %s", (int)c->outlet[outlet].outlet,
		             name, s.commanded ? "on" : "off", s.closed ? "on" : "off");
}

static void patrol_outlets(struct bb_facility *f, int64_t now_ns)
{
	for (size_t p = 0; p < f->rig->room->n_pdus; p++) {
		bool good = true;
		if (!f->rig->pdus[p])
			continue;
		for (size_t o = 0; o < f->rig->room->pdus[p].n_outlets; o++)
			read_outlet(f, p, o, now_ns, &good);
		if (good)
			bb_watch_good(f->watch, f->power_slot[p], now_ns);
	}
}

/* One outlet a step, the safety stagger apart; then patrol for ever. */
static int64_t outlets_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_facility *f = bb_container_of(timer, struct bb_facility, outlets);
	const struct bb_room *room = f->rig->room;
	(void)scheduled_ns;

	while (f->pdu < room->n_pdus && (!f->rig->pdus[f->pdu] || f->outlet == room->pdus[f->pdu].n_outlets)) {
		f->pdu++;
		f->outlet = 0;
	}
	if (f->pdu < room->n_pdus) {
		const enum bb_status status = bb_power_set(f->rig->pdus[f->pdu], f->outlet, true);
		if (status != BB_OK)
			bb_watch_bad(f->watch, f->power_slot[f->pdu], now_ns, BB_HEALTH_LOST, "outlet %d refuses: %s",
			             (int)room->pdus[f->pdu].outlet[f->outlet].outlet, bb_status_text(status));
		f->outlet++;
		return now_ns + (int64_t)(room->safety.outlet_stagger_ms * 1e6);
	}
	if (!f->outlets_done) {
		f->outlets_done = true;
		f->inrush_over_ns = now_ns + 2 * BB_NS_PER_S;
		if (start_monitors(f, now_ns) != BB_OK)
			return BB_NEVER;
	}
	patrol_outlets(f, now_ns);
	return now_ns + PATROL_NS;
}

/* ---- life ---- */

enum bb_status bb_facility_create(struct bb_rig *rig, struct bb_clock *clk, struct bb_watch *watch,
                                  struct bb_facility **out)
{
	const struct bb_room *room = rig->room;
	struct bb_facility *f = calloc(1, sizeof(*f));

	*out = NULL;
	if (!f)
		return BB_ERR_NOMEM;
	f->rig = rig;
	f->clk = clk;
	f->watch = watch;
	f->monitors = calloc(room->n_monitors + 1, sizeof(*f->monitors));
	f->power_slot = calloc(room->n_pdus + 1, sizeof(*f->power_slot));
	f->current_a = calloc(room->n_pdus + 1, sizeof(*f->current_a));
	if (!f->monitors || !f->power_slot || !f->current_a) {
		bb_facility_destroy(f);
		return BB_ERR_NOMEM;
	}
	f->n_monitors = room->n_monitors;
	for (size_t i = 0; i < room->n_monitors; i++) {
		struct monitor *m = &f->monitors[i];
		m->f = f;
		m->dev = rig->monitors[i];
		m->config = &room->monitors[i];
		m->timer.step = monitor_step;
		m->timer.rank = 3;
		if (m->dev)
			m->slot = bb_watch_slot(watch, "monitor", m->config->id);
		else
			m->through = ++f->n_through;
	}
	for (size_t i = 0; i < room->n_pdus; i++)
		if (rig->pdus[i])
			f->power_slot[i] = bb_watch_slot(watch, "power", room->pdus[i].id);
	f->outlets.step = outlets_step;
	f->outlets.rank = 3;
	*out = f;
	return BB_OK;
}

void bb_facility_destroy(struct bb_facility *f)
{
	if (!f)
		return;
	bb_clock_disarm(f->clk, &f->outlets);
	for (size_t i = 0; i < f->n_monitors; i++)
		bb_clock_disarm(f->clk, &f->monitors[i].timer);
	free(f->monitors);
	free(f->power_slot);
	free(f->current_a);
	free(f);
}

enum bb_status bb_facility_start(struct bb_facility *f)
{
	return bb_clock_arm(f->clk, &f->outlets, bb_clock_now_ns(f->clk));
}

bool bb_facility_ready(const struct bb_facility *f)
{
	return f->outlets_done && f->n_through == f->n_monitors;
}

void bb_facility_monitor_note(const struct bb_facility *f, size_t monitor, char *buf, size_t cap)
{
	const struct monitor *m = &f->monitors[monitor];

	snprintf(buf, cap, "%s, %u h, input 0x%02X", m->name[0] ? m->name : "no EDID name", m->hours, m->input);
}

void bb_facility_power_note(const struct bb_facility *f, size_t pdu, char *buf, size_t cap)
{
	double total = 0;

	for (size_t o = 0; o < f->rig->room->pdus[pdu].n_outlets; o++)
		total += f->current_a[pdu][o];
	snprintf(buf, cap, "%zu outlets, %.1f A", f->rig->room->pdus[pdu].n_outlets, total);
}
