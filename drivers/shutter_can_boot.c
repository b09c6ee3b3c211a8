/*
 * drivers/shutter_can_boot.c: finds, checks and configures the controllers, each by its own SDO client, all at the same
 * time; later writes what changed and reads it back. A node that boots or comes back goes through all of it again.
 */
#include "drivers/shutter_can_impl.h"

#include <stdio.h>
#include <string.h>

#define AGAIN_NS (250 * SC_MS)
#define REFUSED_NS BB_NS_PER_S
#define LSS_AFTER_NS (150 * SC_MS)
#define LSS_AGAIN_NS (2 * BB_NS_PER_S)
#define BEATS_GOOD 2
#define MASTER_BEATS 5 /* of the host's heartbeats may be missing before a controller opens */

enum who { ALL, EMITTER, STAGES };
struct op {
	uint16_t index;
	uint8_t sub;
	uint8_t n_bytes;  /* of a number to write; 0: read */
	enum who who;
	uint32_t (*value)(const struct shutter_can *s, const struct sc_node *n);
	bool (*take)(struct shutter_can *s, struct sc_node *n); /* what was read; false: it cannot be right */
};

static bool take_type(struct shutter_can *s, struct sc_node *n)
{
	(void)s;
	return n->sdo.n == 4 && bb_co_u32(n->sdo.bytes, 4) == SHUT_TYPE;
}

static bool take_serial(struct shutter_can *s, struct sc_node *n)
{
	(void)s;
	n->serial = bb_co_u32(n->sdo.bytes, n->sdo.n < 4 ? n->sdo.n : 4);
	return n->sdo.n == 4;
}

/* For people: anything but plain letters becomes a dot. */
static bool take_name(struct shutter_can *s, struct sc_node *n)
{
	size_t i = 0;

	(void)s;
	for (; i < n->sdo.n && i + 1 < sizeof(n->name); i++)
		n->name[i] = (char)(n->sdo.bytes[i] >= 0x20 && n->sdo.bytes[i] < 0x7f ? n->sdo.bytes[i] : '.');
	n->name[i] = '\0';
	return true;
}

static bool take_position(struct shutter_can *s, struct sc_node *n)
{
	const uint32_t at = n->sdo.bytes[0];

	if (n->sdo.n != 1 || at >= s->n_nodes)
		return false;
	for (size_t i = 0; i < s->n_nodes; i++)
		if (&s->node[i] != n && s->node[i].ready && s->node[i].position == (int)at)
			return false;
	n->position = (int)at;
	return true;
}

static bool take_delay(struct shutter_can *s, struct sc_node *n)
{
	(void)s;
	return n->sdo.n == 4 && bb_co_u32(n->sdo.bytes, 4) == n->written.delay_ns;
}

static uint32_t consumer(const struct shutter_can *s, const struct sc_node *n)
{
	(void)n;
	return (uint32_t)s->opt.master << 16 | (uint32_t)(MASTER_BEATS * s->opt.heartbeat_ms);
}

static uint32_t producer(const struct shutter_can *s, const struct sc_node *n)
{
	(void)n;
	return (uint32_t)s->opt.heartbeat_ms;
}

static uint32_t sync_listen(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	(void)n;
	return CO_SYNC;
}

static uint32_t sync_produce(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	(void)n;
	return CO_SYNC | CO_SYNC_PRODUCER;
}

static uint32_t overflow(const struct shutter_can *s, const struct sc_node *n)
{
	(void)n;
	return (uint32_t)s->opt.overflow;
}

static uint32_t pdo1_off(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	return CO_PDO_OFF | (CO_TPDO1 + (uint32_t)n->id);
}

static uint32_t pdo1_on(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	return CO_TPDO1 + (uint32_t)n->id;
}

static uint32_t pdo2_off(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	return CO_PDO_OFF | (CO_TPDO2 + (uint32_t)n->id);
}

static uint32_t pdo2_on(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	return CO_TPDO2 + (uint32_t)n->id;
}

static uint32_t pdo_type(const struct shutter_can *s, const struct sc_node *n)
{
	(void)n;
	return (uint32_t)s->opt.pdo_type;
}

static uint32_t event_type(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	(void)n;
	return 254;
}

static uint32_t zero(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	(void)n;
	return 0;
}

static uint32_t one(const struct shutter_can *s, const struct sc_node *n)
{
	(void)s;
	(void)n;
	return 1;
}

static uint32_t watchdog(const struct shutter_can *s, const struct sc_node *n)
{
	(void)n;
	return (uint32_t)s->opt.watchdog_ms;
}

static uint32_t delay(const struct shutter_can *s, const struct sc_node *n)
{
	return s->want[n->position].delay_ns;
}

static uint32_t duty(const struct shutter_can *s, const struct sc_node *n)
{
	return s->want[n->position].duty_ppm;
}

static uint32_t polarity(const struct shutter_can *s, const struct sc_node *n)
{
	return s->want[n->position].polarity;
}

/* The last three make light change, so they come when everything else is in order. */
static const struct op ops[] = {
	{ CO_OD_TYPE, 0, 0, ALL, NULL, take_type },
	{ CO_OD_IDENTITY, 4, 0, ALL, NULL, take_serial },
	{ CO_OD_NAME, 0, 0, ALL, NULL, take_name },
	{ SHUT_OD_CHAIN, 1, 0, ALL, NULL, take_position },
	{ SHUT_OD_DRIVE, 4, 1, ALL, zero, NULL },
	{ SHUT_OD_LABEL, 0, 0, STAGES, NULL, NULL }, /* written: see begin() */
	{ CO_OD_CONSUMER, 1, 4, ALL, consumer, NULL },
	{ CO_OD_PRODUCER, 0, 2, ALL, producer, NULL },
	{ CO_OD_SYNC, 0, 4, ALL, sync_listen, NULL },
	{ CO_OD_OVERFLOW, 0, 1, ALL, overflow, NULL },
	{ CO_OD_TPDO1, 1, 4, ALL, pdo1_off, NULL },
	{ CO_OD_TPDO1, 2, 1, ALL, pdo_type, NULL },
	{ CO_OD_TPDO1, 3, 2, ALL, zero, NULL },
	{ CO_OD_TPDO1, 1, 4, ALL, pdo1_on, NULL },
	{ CO_OD_TPDO2, 1, 4, EMITTER, pdo2_off, NULL },
	{ CO_OD_TPDO2, 2, 1, EMITTER, event_type, NULL },
	{ CO_OD_TPDO2, 3, 2, EMITTER, zero, NULL },
	{ CO_OD_TPDO2, 1, 4, EMITTER, pdo2_on, NULL },
	{ SHUT_OD_DRIVE, 5, 2, ALL, watchdog, NULL },
	{ SHUT_OD_DRIVE, 2, 4, ALL, duty, NULL },
	{ SHUT_OD_DRIVE, 3, 1, ALL, polarity, NULL },
	{ SHUT_OD_DRIVE, 1, 4, ALL, delay, NULL },
	{ SHUT_OD_DRIVE, 1, 0, ALL, NULL, take_delay },
	{ SHUT_OD_DRIVE, 4, 1, ALL, one, NULL },
	{ CO_OD_SYNC, 0, 4, EMITTER, sync_produce, NULL },
};
#define STEPS ((int)BB_ARRAY_LEN(ops))

static bool concerns(const struct op *o, const struct sc_node *n)
{
	return o->who == ALL || (o->who == EMITTER) == (n->position == 0);
}

/* SYNC begins when all that are there can take its counter: a length they do not expect is an emergency. */
static bool must_wait(const struct shutter_can *s, const struct op *o, int64_t now_ns)
{
	if (o->value != sync_produce || now_ns - s->open_ns > BB_NS_PER_S)
		return false;
	for (size_t i = 0; i < s->n_nodes; i++) {
		const struct sc_node *n = &s->node[i];
		if (n->heard && !n->ready && !n->failed && n->position != 0)
			return true;
	}
	return false;
}

static void begin(struct shutter_can *s, struct sc_node *n, const struct op *o, int64_t now_ns)
{
	uint8_t bytes[4];

	if (o->index == SHUT_OD_LABEL) {
		const char *label = s->base.config.stage[n->position - 1];
		bb_co_sdo_start_write(&n->sdo, o->index, o->sub, (const uint8_t *)label, strlen(label), now_ns);
		return;
	}
	if (!o->n_bytes) {
		bb_co_sdo_start_read(&n->sdo, o->index, o->sub, now_ns);
		return;
	}
	n->asked = o->value(s, n);
	bb_co_put_u32(bytes, n->asked, o->n_bytes);
	bb_co_sdo_start_write(&n->sdo, o->index, o->sub, bytes, o->n_bytes, now_ns);
}

static void note_written(struct sc_node *n, const struct op *o)
{
	if (o->value == delay)
		n->written.delay_ns = n->asked;
	else if (o->value == duty)
		n->written.duty_ppm = n->asked;
	else if (o->value == polarity)
		n->written.polarity = n->asked;
}

static void fail_node(struct shutter_can *s, struct sc_node *n, int64_t now_ns, const char *why)
{
	n->failed = true;
	n->step = 0;
	n->again_ns = now_ns + REFUSED_NS;
	sc_raise(s, BB_CANF_NODE, n->id, now_ns, "node %u, object %04xh:%02x: %s", n->id, n->sdo.index, n->sdo.sub, why);
}

bool sc_all_ready(const struct shutter_can *s)
{
	for (size_t i = 0; i < s->n_nodes; i++)
		if (!s->node[i].ready)
			return false;
	return true;
}

static bool any(const struct shutter_can *s, size_t member)
{
	for (size_t i = 0; i < s->n_nodes; i++)
		if (*(const bool *)((const char *)&s->node[i] + member))
			return true;
	return false;
}

static void become_ready(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	struct bb_can_frame f;

	n->ready = true;
	n->failed = n->counted = false;
	n->emcy = 0;
	n->beat_ns = now_ns;
	n->parameter = 0;
	if (!any(s, offsetof(struct sc_node, failed)))
		sc_clear(s, BB_CANF_NODE, now_ns);
	if (s->stereo) {
		bb_co_nmt(&f, CO_NMT_START, n->id);
		sc_send(s, &f, false);
	}
}

/* What the last transfer of the configuration brought. */
static void end(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	const struct op *o = &ops[n->step];
	const enum bb_status status = n->sdo.status;

	n->sdo.status = BB_SKIPPED;
	if (status == BB_ERR_LOST) { /* not there (yet) */
		n->step = 0;
		n->heard = false;
		n->again_ns = now_ns + AGAIN_NS;
		return;
	}
	n->heard = true;
	if (status != BB_OK) {
		fail_node(s, n, now_ns, bb_co_abort_text(n->sdo.abort));
		return;
	}
	if (o->take && !o->take(s, n)) {
		fail_node(s, n, now_ns, "not what belongs here");
		return;
	}
	note_written(n, o);
	n->step++;
}

static void configure(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	if (n->sdo.status != BB_SKIPPED)
		end(s, n, now_ns);
	if (n->ready || now_ns < n->again_ns)
		return;
	while (n->step < STEPS && n->step > 3 && !concerns(&ops[n->step], n))
		n->step++;
	if (n->step == STEPS) {
		become_ready(s, n, now_ns);
		return;
	}
	if (!must_wait(s, &ops[n->step], now_ns))
		begin(s, n, &ops[n->step], now_ns);
}

/* Later changes: one parameter at a time, written and read back. */

static uint32_t *parameter_of(struct sc_wanted *w, int i)
{
	return i == 0 ? &w->delay_ns : i == 1 ? &w->duty_ppm : &w->polarity;
}

static void begin_parameter(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	static const size_t n_bytes[3] = { 4, 4, 1 };
	struct sc_wanted *want = &s->want[n->position];
	uint8_t bytes[4];

	if (now_ns < n->again_ns)
		return;
	for (int i = 0; i < 3; i++) {
		if (*parameter_of(want, i) == *parameter_of(&n->written, i))
			continue;
		n->parameter = i + 1;
		n->verifying = false;
		n->asked = *parameter_of(want, i);
		bb_co_put_u32(bytes, n->asked, n_bytes[i]);
		bb_co_sdo_start_write(&n->sdo, SHUT_OD_DRIVE, (uint8_t)(i + 1), bytes, n_bytes[i], now_ns);
		return;
	}
}

static void end_parameter(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	const enum bb_status status = n->sdo.status;
	const int i = n->parameter - 1;

	n->sdo.status = BB_SKIPPED;
	n->parameter = 0;
	if (status == BB_OK && !n->verifying) {
		n->parameter = i + 1;
		n->verifying = true;
		bb_co_sdo_start_read(&n->sdo, SHUT_OD_DRIVE, (uint8_t)(i + 1), now_ns);
		return;
	}
	if (status == BB_OK && bb_co_u32(n->sdo.bytes, n->sdo.n < 4 ? n->sdo.n : 4) == n->asked) {
		*parameter_of(&n->written, i) = n->asked;
		if (n->failed && !n->emcy) {
			n->failed = false;
			sc_clear(s, BB_CANF_NODE, now_ns);
		}
		return;
	}
	n->again_ns = now_ns + AGAIN_NS;
	sc_raise(s, BB_CANF_NODE, n->id, now_ns, "node %u does not take %04xh:%02x: %s", n->id, SHUT_OD_DRIVE, i + 1,
	         status == BB_OK ? "reads back another value" : bb_co_abort_text(n->sdo.abort));
	n->failed = true;
}

void sc_boot_restart(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	(void)s;
	n->ready = n->failed = n->counted = false;
	n->step = n->beats = n->parameter = 0;
	n->again_ns = now_ns;
	n->sdo.status = BB_SKIPPED;
	n->sdo.has_frame = false;
}

static void lose(struct shutter_can *s, struct sc_node *n, int64_t now_ns, const char *why)
{
	struct bb_can_frame f;

	sc_raise(s, BB_CANF_NODE_LOST, n->id, now_ns, "node %u (%s): %s", n->id,
	         n->position > 0 ? s->base.config.stage[n->position - 1] : "emitter", why);
	sc_boot_restart(s, n, now_ns);
	n->lost = true;
	n->heard = false;
	n->again_ns = now_ns + AGAIN_NS;
	bb_co_nmt(&f, CO_NMT_PREOP, n->id); /* should it still hear: both eyes open */
	sc_send(s, &f, false);
}

/* Two heartbeats and a configuration, in either order, and it counts again. */
static void found_again(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	if (++n->beats < BEATS_GOOD)
		return;
	if (!n->ready) {
		if (!n->step && !bb_co_sdo_busy(&n->sdo))
			n->again_ns = now_ns;
		return;
	}
	n->lost = false;
	if (!any(s, offsetof(struct sc_node, lost)))
		sc_clear(s, BB_CANF_NODE_LOST, now_ns);
}

void sc_node_state(struct shutter_can *s, struct sc_node *n, uint8_t state, int64_t now_ns)
{
	struct bb_can_frame f;

	n->state = state;
	n->beat_ns = now_ns;
	if (state == CO_BOOT_UP) {
		if (n->ready)
			lose(s, n, now_ns, "started anew");
		sc_boot_restart(s, n, now_ns);
		n->heard = true;
		return;
	}
	if (n->lost)
		found_again(s, n, now_ns);
	if (!n->ready || (s->stereo ? state == CO_OPERATIONAL : state == CO_PREOP))
		return;
	bb_co_nmt(&f, s->stereo ? CO_NMT_START : CO_NMT_PREOP, n->id);
	sc_send(s, &f, false);
}

static void poll_node(struct shutter_can *s, struct sc_node *n, int64_t now_ns)
{
	const bool deaf = s->off || s->down_ns != BB_NEVER; /* silence is ours then */
	struct bb_can_frame f;

	bb_co_sdo_poll(&n->sdo, now_ns);
	if (!bb_co_sdo_busy(&n->sdo)) {
		if (!n->ready)
			configure(s, n, now_ns);
		else if (n->parameter)
			end_parameter(s, n, now_ns);
		if (n->ready && !bb_co_sdo_busy(&n->sdo))
			begin_parameter(s, n, now_ns);
	}
	if (bb_co_sdo_take(&n->sdo, &f))
		sc_send(s, &f, true);
	if (n->ready && !deaf && now_ns - n->beat_ns > s->opt.heartbeat_ms * SC_MS * 3 / 2)
		lose(s, n, now_ns, "no heartbeat");
}

/* New controllers have no id: find them one by one and hand out the ids nobody answers to. */
static void poll_lss(struct shutter_can *s, int64_t now_ns)
{
	struct bb_can_frame f;
	size_t i = 0;

	if (!s->opt.lss)
		return;
	if (s->lss.status != BB_TIMEOUT) {
		if (s->lss.status == BB_SKIPPED || now_ns < s->lss_next_ns) {
			if (now_ns < s->lss_next_ns)
				return;
		}
		while (i < s->n_nodes && (s->node[i].heard || s->node[i].ready))
			i++;
		if (i == s->n_nodes)
			return;
		bb_co_lss_start(&s->lss, s->node[i].id, now_ns);
	}
	bb_co_lss_poll(&s->lss, now_ns);
	if (s->lss.status != BB_TIMEOUT) {
		s->lss_next_ns = now_ns + (s->lss.status == BB_OK ? 20 * SC_MS : LSS_AGAIN_NS);
		for (i = 0; s->lss.status == BB_OK && i < s->n_nodes; i++)
			if (s->node[i].id == s->lss.node) {
				s->node[i].heard = true; /* unless it stays silent: then it is asked again */
				s->node[i].again_ns = now_ns;
			}
	}
	if (bb_co_lss_take(&s->lss, &f))
		sc_send(s, &f, false);
}

void sc_boot_init(struct shutter_can *s)
{
	for (size_t i = 0; i < s->n_nodes; i++) {
		struct sc_node *n = &s->node[i];
		n->id = (uint8_t)((size_t)s->opt.node + i);
		n->position = -1;
		bb_co_sdo_init(&n->sdo, n->id, s->opt.sdo_ms * SC_MS);
		s->node_of[n->id] = (uint8_t)(i + 1);
	}
	bb_co_lss_init(&s->lss, s->opt.lss_ms * SC_MS);
	s->lss_next_ns = s->open_ns + LSS_AFTER_NS;
}

void sc_boot_poll(struct shutter_can *s, int64_t now_ns)
{
	for (size_t i = 0; i < s->n_nodes; i++)
		poll_node(s, &s->node[i], now_ns);
	poll_lss(s, now_ns);
}

bool sc_boot_busy(const struct shutter_can *s)
{
	if (s->lss.status == BB_TIMEOUT)
		return true;
	for (size_t i = 0; i < s->n_nodes; i++)
		if (bb_co_sdo_busy(&s->node[i].sdo))
			return true;
	return false;
}
