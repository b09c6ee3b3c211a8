/* sim/peer_shutter.c: see sim/peer_shutter.h. One timer for the whole chain. */
#include "sim/peer_shutter.h"
#include "sim/world.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define RESIDUAL_SD_US 15.0
#define RESIDUAL_MOST 2.5
#define JITTER_MOST 4.0
#define TICK_NS 100
#define VENDOR 0x00626c62u
#define PRODUCT 0x00007368u
#define REVISION 0x00010002u
#define SERIAL 0x20260000u
#define MOST_OBJECTS 40
#define POSITIONS (BB_STAGES_MAX + 1)

struct unit {
	struct sim_co_node co;
	struct sim_chain *chain;
	uint32_t position, line_delay_ns, tick_ns;
	uint32_t delay_ns, duty_ppm, polarity, armed, watchdog_ms;
	uint32_t status, temperature, edges, misses, openings, worst_ns;
	uint32_t subs[2], map[2][6], said[2][6]; /* said: the objects the PDOs map, as last sent */
	uint8_t label[SHUT_LABEL_BYTES + 1], record[SHUT_RECORD_BYTES];
	uint16_t label_bytes, record_bytes;
	int64_t residual_ns;
	int64_t n, at_ns;            /* the next edge and when this unit acts on it; BB_NEVER: it does not */
	int64_t heard_ns;            /* the last edge acted on: the watchdog's */
	int64_t switched_ns, phase_ns;
	bool knows_eye, open;
	int64_t offset;              /* SYNC counter minus edge number, modulo the overflow */
	uint8_t eye, sequence, edge_counter;
	uint32_t latency_ns;
	uint8_t sync_counter;
	int64_t stuck, frozen, miss, flipped; /* faults */
	struct sim_co_object object[MOST_OBJECTS];
	size_t n_objects;
};

struct sim_chain {
	struct bb_timer timer;
	struct bb_clock *clk;
	struct sim_world *world;
	struct bb_eventlog *events;
	uint16_t source;
	const struct bb_shutter_config *config;
	struct bb_rate rate;
	int64_t jitter_ns;
	struct sim_rng rng;
	int64_t edge_n, edge_ns;     /* the emitter's next edge */
	int64_t sent_n, sent_ns;     /* the edge whose SYNC is under way */
	int64_t late_ns, due_ns;     /* fault; when the late SYNC goes, or BB_NEVER */
	int drop;
	int64_t deaf;                /* fault: edges the emitter makes no SYNC of, because it misses them */
	size_t n;
	struct unit unit[POSITIONS];
};

static struct unit *of(struct sim_co_node *n)
{
	return bb_container_of(n, struct unit, co);
}

/* The line */

static int64_t line_ns(const struct sim_chain *c, int64_t n)
{
	struct sim_rng r = sim_rng_at(&c->rng, (uint64_t)n);
	const double z = fmin(fmax(sim_rng_normal(&r), -JITTER_MOST), JITTER_MOST);
	const double most_ns = (double)bb_rate_period_ns(c->rate) / 4;

	return sim_world_sync_ns(c->world, n) +
	       (c->jitter_ns ? (int64_t)fmin(fmax(z * (double)c->jitter_ns, -most_ns), most_ns) : 0);
}

static bool drives(const struct unit *u)
{
	return u->co.state == CO_OPERATIONAL && u->armed && !u->co.dead && !u->stuck;
}

static int64_t watchdog_ns(const struct unit *u)
{
	return u->open || u->co.dead ? BB_NEVER : u->heard_ns + u->watchdog_ms * INT64_C(1000000);
}

static void aim(struct unit *u, int64_t least_n, int64_t after_ns)
{
	u->n = least_n;
	u->at_ns = BB_NEVER;
	if (!drives(u))
		return;
	for (;; u->n++) {
		u->at_ns = line_ns(u->chain, u->n) + u->delay_ns + u->residual_ns;
		if (u->at_ns > after_ns)
			return;
	}
}

static int64_t wake_ns(const struct sim_chain *c)
{
	int64_t least_ns = c->edge_ns < c->due_ns ? c->edge_ns : c->due_ns;

	for (size_t i = 0; i < c->n; i++) {
		if (c->unit[i].at_ns < least_ns)
			least_ns = c->unit[i].at_ns;
		if (watchdog_ns(&c->unit[i]) < least_ns)
			least_ns = watchdog_ns(&c->unit[i]);
	}
	return least_ns;
}

static void rearm(struct sim_chain *c)
{
	bb_clock_disarm(c->clk, &c->timer);
	if (bb_clock_arm(c->clk, &c->timer, wake_ns(c)) != BB_OK)
		c->edge_ns = BB_NEVER;
}

static void open_eyes(struct unit *u, int64_t at_ns)
{
	if (u->open)
		return;
	u->open = true;
	u->eye = BB_EYE_NONE;
	bb_eventlog_add(u->chain->events, u->chain->source, BB_EV_EDGE, at_ns, BB_EYE_NONE, (int64_t)u->position);
}

/* Acts on edge u->n. */
static void switch_eye(struct unit *u)
{
	const int64_t at_ns = u->at_ns, n = u->n;

	aim(u, n + 1, at_ns);
	if (u->miss) {
		u->miss--;
		return;
	}
	u->heard_ns = at_ns;
	if (!u->knows_eye || !u->co.overflow) {
		u->misses++;
		return;
	}
	const int64_t before_counter = (n + u->offset) % u->co.overflow; /* counter - 1 */
	const bool right = before_counter % 2 != 0;
	u->eye = right != ((u->polarity ^ u->flipped) % 2 != 0) ? BB_EYE_RIGHT : BB_EYE_LEFT;
	u->open = false;
	u->edges++;
	u->switched_ns = at_ns;
	u->phase_ns = (at_ns - line_ns(u->chain, n) + TICK_NS / 2) / TICK_NS * TICK_NS;
	if (!u->frozen)
		u->edge_counter = (uint8_t)(before_counter + 1);
	bb_eventlog_add(u->chain->events, u->chain->source, BB_EV_EDGE, at_ns, u->eye, (int64_t)u->position);
	sim_co_event(&u->co, 0);
}

static void send_sync(struct sim_chain *c, int64_t at_ns)
{
	struct unit *u = &c->unit[0];

	c->due_ns = BB_NEVER;
	if (c->drop > 0) {
		c->drop--;
		return;
	}
	if (u->co.overflow) /* sim_co_send_sync counts on from here: the counter is the edge's, whatever was dropped */
		u->co.counter = (uint8_t)(c->sent_n % u->co.overflow);
	sim_co_send_sync(&u->co, at_ns);
}

static void line_edge(struct sim_chain *c)
{
	const int64_t at_ns = c->edge_ns;

	c->sent_n = c->edge_n;
	c->sent_ns = at_ns;
	c->edge_ns = line_ns(c, ++c->edge_n);
	if (c->unit[0].stuck || c->unit[0].co.dead)
		return;
	if (c->deaf) {
		c->deaf--;
		return;
	}
	if (c->late_ns)
		c->due_ns = at_ns + c->late_ns;
	else
		send_sync(c, at_ns);
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_chain *c = bb_container_of(timer, struct sim_chain, timer);

	(void)now_ns;
	if (c->due_ns <= scheduled_ns)
		send_sync(c, scheduled_ns);
	if (c->edge_ns <= scheduled_ns)
		line_edge(c);
	for (size_t i = 0; i < c->n; i++) {
		struct unit *u = &c->unit[i];
		if (u->at_ns <= scheduled_ns)
			switch_eye(u);
		if (watchdog_ns(u) <= scheduled_ns) {
			u->openings++;
			open_eyes(u, scheduled_ns);
			sim_co_emcy(&u->co, CO_EMCY_NO_LINE, 0x81);
		}
	}
	if (timer->slot) {
		rearm(c);
		return BB_NEVER;
	}
	return wake_ns(c);
}

/* What the node tells */

static void on_sent(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns)
{
	struct sim_co_node *n = bb_container_of(port, struct sim_co_node, port);
	struct unit *u = of(n);

	if (!(n->sync_cob & CO_SYNC_PRODUCER) || f->id != (n->sync_cob & 0x7ff) || !f->n_bytes)
		return;
	u->latency_ns = (uint32_t)((at_ns - u->chain->sent_ns + TICK_NS / 2) / TICK_NS * TICK_NS);
	u->sync_counter = f->bytes[0];
	sim_co_event(n, 1);
}

static void on_sync(struct sim_co_node *n, uint8_t counter, int64_t at_ns)
{
	struct unit *u = of(n);
	const struct sim_chain *c = u->chain;

	(void)at_ns;
	if (!counter || !n->overflow || counter > n->overflow)
		return;
	/* SYNC belongs to the line's last edge: a controller sees both. */
	const int64_t offset = (counter - 1 - c->sent_n % n->overflow + n->overflow) % n->overflow;
	u->misses += u->knows_eye && offset != u->offset;
	u->offset = offset;
	u->knows_eye = true;
}

static void on_state(struct sim_co_node *n, uint8_t state, int64_t at_ns)
{
	struct unit *u = of(n);

	if (state != CO_OPERATIONAL) {
		open_eyes(u, at_ns);
		u->at_ns = BB_NEVER;
	} else {
		const int64_t first = sim_world_reference_after(u->chain->world, sim_world_sync_rate(u->chain->world),
		                                                at_ns);
		aim(u, first > u->n ? first : u->n, at_ns);
		u->heard_ns = at_ns;
	}
	rearm(u->chain);
}

static uint32_t on_check(struct sim_co_node *n, const struct sim_co_object *o, uint32_t value)
{
	const struct unit *u = of(n);

	if (o->value == &u->delay_ns && value >= bb_rate_period_ns(u->chain->rate))
		return CO_ABORT_TOO_HIGH;
	if (o->value == &n->overflow && value % 2)
		return CO_ABORT_VALUE;
	if (o->value == &n->sync_cob && value & CO_SYNC_PRODUCER && u->position)
		return CO_ABORT_VALUE; /* only the emitter sees the generator itself */
	return 0;
}

static void on_wrote(struct sim_co_node *n, const struct sim_co_object *o)
{
	struct unit *u = of(n);

	if (o->value == &n->overflow)
		u->knows_eye = false;
	if (o->index != SHUT_OD_DRIVE)
		return;
	aim(u, u->n, bb_clock_now_ns(n->clk));
	if (!u->armed)
		open_eyes(u, bb_clock_now_ns(n->clk));
	rearm(u->chain);
}

static void put(uint8_t *bytes, uint32_t value)
{
	for (int i = 0; i < 4; i++)
		bytes[i] = (uint8_t)(value >> (8 * i));
}

static void on_reading(struct sim_co_node *n, const struct sim_co_object *o)
{
	struct unit *u = of(n);

	u->status = u->open ? (u->openings && u->stuck ? 2 : 0) : 1;
	if (o->bytes != u->record)
		return;
	put(u->record, u->edges);
	put(u->record + 4, u->misses);
	put(u->record + 8, u->openings);
	put(u->record + 12, (uint32_t)(n->port.tx_errors + n->port.rx_errors));
	put(u->record + 16, u->worst_ns);
	put(u->record + 20, 0);
}

/* CRC-8 with polynomial 2F over the id and the payload, by table of nibbles' worth of shifts. */
static uint8_t crc(uint32_t id, const uint8_t *bytes, size_t n)
{
	uint32_t reg = SHUT_CRC_START;

	for (size_t i = 0; i < n + 2; i++) {
		reg ^= i == 0 ? id & 0xff : i == 1 ? id >> 8 & 0xff : bytes[i - 2];
		for (int k = 0; k < 8; k++) {
			reg <<= 1;
			if (reg & 0x100)
				reg ^= 0x100 | SHUT_CRC_POLYNOMIAL;
		}
	}
	return (uint8_t)reg;
}

static size_t on_fill(struct sim_co_node *n, unsigned pdo, uint8_t bytes[8])
{
	struct unit *u = of(n);
	uint32_t *said = u->said[pdo] + 1;

	if (pdo) {
		said[0] = bytes[0] = u->sync_counter;
		put(bytes + 1, said[1] = u->latency_ns);
		said[2] = bytes[5] = crc(n->pdo[pdo].cob & 0x7ff, bytes, 5);
		return SHUT_FOLLOW_BYTES;
	}
	said[0] = bytes[0] = u->edge_counter ? u->edge_counter : 1;
	said[1] = bytes[1] = (uint8_t)(u->eye | (u->stuck ? 0 : SHUT_FLAG_LINE));
	put(bytes + 2, said[2] = (uint32_t)(u->phase_ns > 0 ? u->phase_ns : 0));
	said[3] = bytes[6] = u->sequence++;
	said[4] = bytes[7] = crc(n->pdo[pdo].cob & 0x7ff, bytes, 7);
	return SHUT_PHASE_BYTES;
}

static const struct sim_co_hooks hooks = { .check = on_check, .wrote = on_wrote, .reading = on_reading,
	                                   .state = on_state, .sync = on_sync, .fill = on_fill };

/* Objects */

static void number(struct unit *u, uint16_t index, uint8_t sub, uint8_t access, uint8_t width, uint32_t *value,
                   uint32_t least, uint32_t most)
{
	u->object[u->n_objects++] = (struct sim_co_object){ .index = index, .sub = sub, .access = access,
		                                            .width = width, .least = least, .most = most,
		                                            .value = value };
}

static void list_mapping(struct unit *u)
{
	static const uint32_t phase[6] = { 5, 0x20200108, 0x20200208, 0x20200320, 0x20200408, 0x20200508 };
	static const uint32_t follow[6] = { 3, 0x20210108, 0x20210220, 0x20210308, 0, 0 };

	memcpy(u->map[0], phase, sizeof(phase));
	memcpy(u->map[1], follow, sizeof(follow));
	for (uint16_t k = 0; k < 2; k++)
		for (uint32_t i = 0; i <= u->map[k][0]; i++)
			number(u, (uint16_t)(CO_OD_TPDO1_MAP + k), (uint8_t)i, SIM_CO_RO, i ? 4 : 1, &u->map[k][i], 0, UINT32_MAX);
}

static void list_said(struct unit *u)
{
	static const uint8_t width[2][6] = { { 1, 1, 1, 4, 1, 1 }, { 1, 1, 4, 1, 0, 0 } };

	for (uint16_t k = 0; k < 2; k++) {
		u->said[k][0] = u->map[k][0];
		for (uint32_t i = 0; i <= u->map[k][0]; i++)
			number(u, (uint16_t)(SHUT_OD_PHASE + k), (uint8_t)i, SIM_CO_RO, width[k][i], &u->said[k][i], 0,
			       UINT32_MAX);
	}
}

static void list_objects(struct unit *u)
{
	u->subs[0] = 3;
	u->subs[1] = 5;
	u->n_objects = 0;
	u->object[u->n_objects++] = (struct sim_co_object){ .index = SHUT_OD_LABEL, .access = SIM_CO_RW,
		                                            .bytes = u->label, .cap = SHUT_LABEL_BYTES,
		                                            .n = &u->label_bytes };
	number(u, SHUT_OD_CHAIN, 0, SIM_CO_RO, 1, &u->subs[0], 0, 3);
	number(u, SHUT_OD_CHAIN, 1, SIM_CO_RO, 1, &u->position, 0, 255);
	number(u, SHUT_OD_CHAIN, 2, SIM_CO_RO, 4, &u->line_delay_ns, 0, UINT32_MAX);
	number(u, SHUT_OD_CHAIN, 3, SIM_CO_RO, 4, &u->tick_ns, 0, UINT32_MAX);
	number(u, SHUT_OD_DRIVE, 0, SIM_CO_RO, 1, &u->subs[1], 0, 5);
	number(u, SHUT_OD_DRIVE, 1, SIM_CO_RW, 4, &u->delay_ns, 0, UINT32_MAX);
	number(u, SHUT_OD_DRIVE, 2, SIM_CO_RW, 4, &u->duty_ppm, 0, 1000000);
	number(u, SHUT_OD_DRIVE, 3, SIM_CO_RW, 1, &u->polarity, 0, 1);
	number(u, SHUT_OD_DRIVE, 4, SIM_CO_RW, 1, &u->armed, 0, 1);
	number(u, SHUT_OD_DRIVE, 5, SIM_CO_RW, 2, &u->watchdog_ms, 20, 1000);
	number(u, SHUT_OD_STATUS, 0, SIM_CO_RO, 1, &u->subs[0], 0, 3);
	number(u, SHUT_OD_STATUS, 1, SIM_CO_RO, 1, &u->status, 0, 255);
	number(u, SHUT_OD_STATUS, 2, SIM_CO_RO, 2, &u->temperature, 0, UINT16_MAX);
	number(u, SHUT_OD_STATUS, 3, SIM_CO_RO, 4, &u->edges, 0, UINT32_MAX);
	u->record_bytes = SHUT_RECORD_BYTES;
	u->object[u->n_objects++] = (struct sim_co_object){ .index = SHUT_OD_RECORD, .access = SIM_CO_RO,
		                                            .bytes = u->record, .cap = SHUT_RECORD_BYTES,
		                                            .n = &u->record_bytes };
	list_mapping(u);
	list_said(u);
	u->co.app = u->object;
	u->co.n_app = u->n_objects;
}

static void init_unit(struct sim_chain *c, size_t i, const struct sim_chain_config *config)
{
	struct unit *u = &c->unit[i];
	const double us = i ? (double)i * config->chain->stage_delay_us : config->chain->emitter_offset_us;

	u->chain = c;
	u->position = (uint32_t)i;
	u->line_delay_ns = (uint32_t)llround((double)i * config->chain->stage_delay_us * 1000);
	u->tick_ns = TICK_NS;
	u->delay_ns = (uint32_t)llround(us * 1000);
	u->duty_ppm = config->duty_ppm;
	u->watchdog_ms = config->watchdog_ms;
	u->temperature = 312;
	u->switched_ns = -1;
	u->open = true;
	u->at_ns = BB_NEVER;
	u->co.hooks = &hooks;
	u->co.type = SHUT_TYPE;
	u->co.stored_id = config->node == CO_NODE_NONE ? CO_NODE_NONE : (uint8_t)(config->node + i);
	u->co.identity[0] = VENDOR;
	u->co.identity[1] = PRODUCT;
	u->co.identity[2] = REVISION;
	/* Serials in no order, as units come out of boxes. */
	u->co.identity[3] = SERIAL + (uint32_t)(i * 0x9e37 % 0xfff1);
	snprintf(u->co.name, sizeof(u->co.name), i ? "shutter stage, 10 MHz" : "shutter emitter, 10 MHz");
	list_objects(u);
}

/* The draws of sim_shutter.c: stages first, the glasses last. */
static void draw_residuals(struct sim_chain *c, bool ideal)
{
	for (size_t i = 0; i < c->n; i++) {
		const double z = fmin(fmax(sim_rng_normal(&c->rng), -RESIDUAL_MOST), RESIDUAL_MOST);
		struct unit *u = &c->unit[i + 1 == c->n ? 0 : i + 1];
		u->residual_ns = ideal ? 0 : llround(z * RESIDUAL_SD_US * 1000);
	}
}

enum bb_status sim_chain_create(const struct sim_chain_config *config, struct sim_can *can, struct sim_world *world,
                                struct bb_eventlog *events, struct sim_chain **out)
{
	const struct bb_shutter_config *cfg = config->chain;
	enum bb_status status = BB_OK;

	*out = NULL;
	if (cfg->n_stages < 0 || cfg->n_stages > BB_STAGES_MAX || !cfg->rate.num || !cfg->rate.den)
		return BB_ERR_CONFIG;
	if (config->node != CO_NODE_NONE && (config->node < 1 || config->node + cfg->n_stages > CO_NODE_MOST - 1))
		return BB_ERR_RANGE;
	struct sim_chain *c = calloc(1, sizeof(*c));
	if (!c)
		return BB_ERR_NOMEM;
	c->clk = sim_world_clock(world);
	c->world = world;
	c->events = events;
	c->source = bb_eventlog_source(events, "chain", cfg->id);
	c->config = cfg;
	c->rate = cfg->rate;
	c->jitter_ns = config->fidelity ? llround(cfg->jitter_us * 1000) : 0;
	c->n = (size_t)cfg->n_stages + 1;
	c->due_ns = BB_NEVER;
	sim_rng_seed(&c->rng, config->seed, "shutter", cfg->id);
	for (size_t i = 0; i < c->n; i++)
		init_unit(c, i, config);
	draw_residuals(c, !config->fidelity);
	const int64_t ppb = llround(cfg->rate_error_ppm * 1000), now_ns = bb_clock_now_ns(c->clk);
	if (sim_world_sync_error_ppb(world) != ppb)
		status = sim_world_set_sync_error(world, now_ns, ppb);
	c->edge_n = sim_world_reference_after(world, sim_world_sync_rate(world), now_ns) + 1;
	c->edge_ns = line_ns(c, c->edge_n);
	c->timer = (struct bb_timer){ .step = step, .rank = 1 };
	for (size_t i = 0; i < c->n && status == BB_OK; i++) {
		status = sim_co_start(&c->unit[i].co, can, c->clk);
		c->unit[i].co.port.sent = on_sent;
	}
	rearm(c);
	if (status != BB_OK) {
		sim_chain_destroy(c);
		return status;
	}
	*out = c;
	return BB_OK;
}

void sim_chain_destroy(struct sim_chain *c)
{
	if (!c)
		return;
	for (size_t i = 0; i < c->n; i++)
		sim_co_end(&c->unit[i].co);
	bb_clock_disarm(c->clk, &c->timer);
	free(c);
}

struct sim_co_node *sim_chain_node(struct sim_chain *c, size_t position)
{
	return &c->unit[position].co;
}

size_t sim_chain_positions(const struct sim_chain *c)
{
	return c->n;
}

const char *sim_chain_stage(const struct sim_chain *c, size_t position)
{
	return position ? c->config->stage[position - 1] : "emitter";
}

bool sim_chain_is_open(const struct sim_chain *c, size_t position)
{
	return c->unit[position].open;
}

const char *sim_chain_label(const struct sim_chain *c, size_t position)
{
	return (const char *)c->unit[position].label;
}

enum bb_eye sim_chain_eye(const struct sim_chain *c, size_t position)
{
	return (enum bb_eye)c->unit[position].eye;
}

int64_t sim_chain_switched_ns(const struct sim_chain *c, size_t position)
{
	return c->unit[position].switched_ns;
}

void sim_chain_stuck(struct sim_chain *c, size_t position, bool on)
{
	struct unit *u = &c->unit[position];

	u->stuck += on ? 1 : -1;
	aim(u, u->n, bb_clock_now_ns(c->clk));
	if (!on)
		sim_co_emcy(&u->co, CO_EMCY_NONE, 0);
	rearm(c);
}

void sim_chain_late_sync(struct sim_chain *c, int64_t by_ns)
{
	c->late_ns = by_ns;
}

void sim_chain_drop_sync(struct sim_chain *c, int n)
{
	c->drop = n;
}

void sim_chain_freeze(struct sim_chain *c, size_t position, bool on)
{
	c->unit[position].frozen += on ? 1 : -1;
}

void sim_chain_power(struct sim_chain *c, size_t position, bool on)
{
	struct unit *u = &c->unit[position];

	sim_co_power(&u->co, on);
	if (!on) {
		u->at_ns = BB_NEVER;
		open_eyes(u, bb_clock_now_ns(c->clk)); /* without power they are clear */
	}
	rearm(c);
}

void sim_chain_miss(struct sim_chain *c, size_t position, int64_t n)
{
	int64_t *const left[] = { &c->unit[position].miss, position ? NULL : &c->deaf };

	for (size_t i = 0; i < BB_ARRAY_LEN(left); i++)
		if (left[i])
			*left[i] = *left[i] + n > 0 ? *left[i] + n : 0;
}

void sim_chain_flip(struct sim_chain *c, size_t position, bool on)
{
	c->unit[position].flipped += on ? 1 : -1;
}

void sim_chain_offset(struct sim_chain *c, size_t position, int64_t by_ns)
{
	struct unit *u = &c->unit[position];

	u->residual_ns += by_ns;
	aim(u, u->n, bb_clock_now_ns(c->clk));
	rearm(c);
}
