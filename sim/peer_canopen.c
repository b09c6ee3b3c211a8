/* sim/peer_canopen.c: see sim/peer_canopen.h. NMT, heartbeat, SYNC, PDOs, EMCY. */
#include "sim/peer_canopen.h"

#include <string.h>

#define INHIBIT_NS INT64_C(100000) /* unit of 1800h:03 */

void sim_co_send(struct sim_co_node *n, uint32_t id, const uint8_t *bytes, size_t n_bytes)
{
	struct bb_can_frame f = { .id = id, .n_bytes = (uint8_t)n_bytes };

	if (n->dead)
		return;
	memcpy(f.bytes, bytes, n_bytes);
	(void)sim_can_send(&n->port, &f); /* a full mailbox loses it, as in a small controller */
}

static bool has_id(const struct sim_co_node *n)
{
	return n->id >= 1 && n->id <= CO_NODE_MOST;
}

/* Time */

static int64_t pdo_ns(const struct sim_co_pdo *p)
{
	return p->wanted ? p->sent_ns + p->inhibit * INHIBIT_NS : BB_NEVER;
}

static int64_t wake_ns(const struct sim_co_node *n)
{
	int64_t at_ns = BB_NEVER;

	if (n->dead || !has_id(n))
		return BB_NEVER;
	if (n->producer && n->beat_ns < at_ns)
		at_ns = n->beat_ns;
	if (n->consumer && !n->master_lost && n->master_ns < at_ns)
		at_ns = n->master_ns;
	for (int i = 0; i < 2; i++)
		if (pdo_ns(&n->pdo[i]) < at_ns)
			at_ns = pdo_ns(&n->pdo[i]);
	return at_ns;
}

void sim_co_rearm(struct sim_co_node *n)
{
	const int64_t at_ns = wake_ns(n);

	bb_clock_disarm(n->clk, &n->timer);
	if (at_ns != BB_NEVER && bb_clock_arm(n->clk, &n->timer, at_ns) != BB_OK)
		n->dead = true;
}

static void beat(struct sim_co_node *n)
{
	if (!n->no_heartbeat)
		sim_co_send(n, CO_HEARTBEAT + n->id, &n->state, 1);
}

static void set_state(struct sim_co_node *n, uint8_t state, int64_t at_ns)
{
	if (n->state == state)
		return;
	n->state = state;
	if (n->hooks->state)
		n->hooks->state(n, state, at_ns);
}

void sim_co_emcy(struct sim_co_node *n, uint16_t code, uint8_t error_register)
{
	const uint8_t bytes[8] = { (uint8_t)code, (uint8_t)(code >> 8), error_register, 0, 0, 0, 0, 0 };

	n->error_register = error_register;
	if (code) {
		memmove(n->history + 1, n->history, 3 * sizeof(n->history[0]));
		n->history[0] = code;
		n->n_history += n->n_history < 4;
	}
	if (has_id(n))
		sim_co_send(n, CO_EMCY + n->id, bytes, 8);
}

static void send_pdo(struct sim_co_node *n, unsigned i, int64_t at_ns)
{
	struct sim_co_pdo *p = &n->pdo[i];
	uint8_t bytes[8] = { 0 };

	p->wanted = false;
	p->sent_ns = at_ns;
	p->heard = 0;
	if (n->hooks->fill)
		sim_co_send(n, p->cob & 0x7ff, bytes, n->hooks->fill(n, i, bytes));
}

static bool may_send(const struct sim_co_node *n, const struct sim_co_pdo *p)
{
	return n->state == CO_OPERATIONAL && !(p->cob & CO_PDO_OFF);
}

void sim_co_event(struct sim_co_node *n, unsigned i)
{
	struct sim_co_pdo *p = &n->pdo[i];
	const int64_t now_ns = bb_clock_now_ns(n->clk);

	if (!may_send(n, p) || p->type < 254)
		return;
	p->wanted = true;
	if (pdo_ns(p) <= now_ns)
		send_pdo(n, i, now_ns);
	else
		sim_co_rearm(n);
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_co_node *n = bb_container_of(timer, struct sim_co_node, timer);

	(void)now_ns;
	if (n->producer && scheduled_ns >= n->beat_ns) {
		beat(n);
		n->beat_ns = scheduled_ns + n->producer * INT64_C(1000000);
	}
	if (n->consumer && !n->master_lost && scheduled_ns >= n->master_ns) {
		n->master_lost = true;
		sim_co_emcy(n, CO_EMCY_HEARTBEAT, 0x11);
		if (n->state == CO_OPERATIONAL)
			set_state(n, CO_PREOP, scheduled_ns);
	}
	for (unsigned i = 0; i < 2; i++)
		if (pdo_ns(&n->pdo[i]) <= scheduled_ns)
			send_pdo(n, i, scheduled_ns);
	return timer->slot ? BB_NEVER : wake_ns(n);
}

/* Frames */

static void heard_sync(struct sim_co_node *n, uint8_t counter, int64_t at_ns)
{
	n->counter = counter;
	if (n->state != CO_OPERATIONAL && n->state != CO_PREOP)
		return;
	if (n->hooks->sync)
		n->hooks->sync(n, counter, at_ns);
	for (unsigned i = 0; i < 2; i++) {
		struct sim_co_pdo *p = &n->pdo[i];
		if (may_send(n, p) && p->type >= 1 && p->type <= 240 && ++p->heard >= p->type)
			send_pdo(n, i, at_ns);
	}
}

static void sync_frame(struct sim_co_node *n, const struct bb_can_frame *f, int64_t at_ns)
{
	if (f->n_bytes != (n->overflow ? 1 : 0)) {
		if (!n->sync_length_wrong)
			sim_co_emcy(n, CO_EMCY_SYNC_LENGTH, 0x11);
		n->sync_length_wrong = true;
		return;
	}
	if (n->sync_length_wrong)
		sim_co_emcy(n, CO_EMCY_NONE, 0);
	n->sync_length_wrong = false;
	heard_sync(n, n->overflow ? f->bytes[0] : 0, at_ns);
}

void sim_co_send_sync(struct sim_co_node *n, int64_t at_ns)
{
	uint8_t counter = 0;

	if (n->dead || !has_id(n) || !(n->sync_cob & CO_SYNC_PRODUCER))
		return;
	if (n->overflow)
		counter = (uint8_t)(n->counter % n->overflow + 1);
	sim_co_send(n, n->sync_cob & 0x7ff, &counter, n->overflow ? 1 : 0);
	heard_sync(n, counter, at_ns);
}

static void nmt_frame(struct sim_co_node *n, const struct bb_can_frame *f, int64_t at_ns)
{
	if (f->n_bytes != 2 || (f->bytes[1] && f->bytes[1] != n->id))
		return;
	switch (f->bytes[0]) {
	case CO_NMT_START:
		set_state(n, CO_OPERATIONAL, at_ns);
		break;
	case CO_NMT_STOP:
		set_state(n, CO_STOPPED, at_ns);
		break;
	case CO_NMT_PREOP:
		set_state(n, CO_PREOP, at_ns);
		break;
	case CO_NMT_RESET_NODE:
	case CO_NMT_RESET_COMM:
		sim_co_reset(n, at_ns);
		break;
	default:
		break;
	}
}

static void heartbeat_frame(struct sim_co_node *n, uint8_t from, int64_t at_ns)
{
	if (!n->consumer || from != (n->consumer >> 16 & 0x7f))
		return;
	if (n->master_lost)
		sim_co_emcy(n, CO_EMCY_NONE, 0);
	n->master_lost = false;
	n->master_ns = at_ns + (n->consumer & 0xffff) * INT64_C(1000000);
	sim_co_rearm(n);
}

static void on_frame(struct sim_can_port *port, const struct bb_can_frame *f, int64_t at_ns)
{
	struct sim_co_node *n = bb_container_of(port, struct sim_co_node, port);

	if (n->dead || f->extended || f->remote || f->error)
		return;
	if (f->id == CO_LSS_REQUEST) {
		sim_co_lss_frame(n, f);
		return;
	}
	if (!has_id(n))
		return;
	if (f->id == CO_NMT)
		nmt_frame(n, f, at_ns);
	else if (f->id == (n->sync_cob & 0x7ff) && !(n->sync_cob & CO_SYNC_PRODUCER))
		sync_frame(n, f, at_ns);
	else if (f->id == (uint32_t)CO_SDO_REQUEST + n->id && n->state != CO_STOPPED)
		sim_co_sdo_frame(n, f);
	else if (f->id > CO_HEARTBEAT && f->id <= CO_HEARTBEAT + CO_NODE_MOST && f->n_bytes == 1)
		heartbeat_frame(n, (uint8_t)(f->id - CO_HEARTBEAT), at_ns);
}

static void on_back(struct sim_can_port *port, int64_t at_ns)
{
	struct sim_co_node *n = bb_container_of(port, struct sim_co_node, port);

	(void)at_ns;
	sim_co_emcy(n, CO_EMCY_BUS_OFF, 0x11);
	sim_co_emcy(n, CO_EMCY_NONE, 0);
}

/* Objects of every node */

static void number(struct sim_co_node *n, uint16_t index, uint8_t sub, uint8_t access, uint8_t width, uint32_t *value,
                   uint32_t most)
{
	n->comm[n->n_comm++] = (struct sim_co_object){ .index = index, .sub = sub, .access = access, .width = width,
		                                       .most = most, .value = value };
}

static void list_objects(struct sim_co_node *n)
{
	n->n_comm = 0;
	n->n_subs[0] = 1;
	n->n_subs[1] = 4;
	n->n_subs[2] = n->n_subs[3] = 3;
	number(n, CO_OD_TYPE, 0, SIM_CO_RO, 4, &n->type, UINT32_MAX);
	number(n, CO_OD_ERROR, 0, SIM_CO_RO, 1, &n->error_register, 255);
	number(n, CO_OD_HISTORY, 0, SIM_CO_RW, 1, &n->n_history, 0); /* writing 0 clears it */
	for (uint8_t i = 0; i < 4; i++)
		number(n, CO_OD_HISTORY, (uint8_t)(i + 1), SIM_CO_RO, 4, &n->history[i], UINT32_MAX);
	number(n, CO_OD_SYNC, 0, SIM_CO_RW, 4, &n->sync_cob, UINT32_MAX);
	number(n, CO_OD_SYNC_PERIOD, 0, SIM_CO_RO, 4, &n->sync_period, UINT32_MAX);
	n->comm[n->n_comm++] = (struct sim_co_object){ .index = CO_OD_NAME, .access = SIM_CO_RO,
		                                       .bytes = (uint8_t *)n->name, .cap = sizeof(n->name),
		                                       .n = &n->name_bytes };
	number(n, CO_OD_EMCY, 0, SIM_CO_RO, 4, &n->emcy_cob, UINT32_MAX);
	number(n, CO_OD_CONSUMER, 0, SIM_CO_RO, 1, &n->n_subs[0], 1);
	number(n, CO_OD_CONSUMER, 1, SIM_CO_RW, 4, &n->consumer, UINT32_C(0x7fffff));
	number(n, CO_OD_PRODUCER, 0, SIM_CO_RW, 2, &n->producer, 65535);
	number(n, CO_OD_IDENTITY, 0, SIM_CO_RO, 1, &n->n_subs[1], 4);
	for (uint8_t i = 0; i < 4; i++)
		number(n, CO_OD_IDENTITY, (uint8_t)(i + 1), SIM_CO_RO, 4, &n->identity[i], UINT32_MAX);
	number(n, CO_OD_OVERFLOW, 0, SIM_CO_RW, 1, &n->overflow, SHUT_COUNTER_MOST);
	for (uint8_t i = 0; i < 2; i++) {
		const uint16_t index = (uint16_t)(CO_OD_TPDO1 + i);
		number(n, index, 0, SIM_CO_RO, 1, &n->n_subs[2 + i], 3);
		number(n, index, 1, SIM_CO_RW, 4, &n->pdo[i].cob, UINT32_MAX);
		number(n, index, 2, SIM_CO_RW, 1, &n->pdo[i].type, 255);
		number(n, index, 3, SIM_CO_RW, 2, &n->pdo[i].inhibit, 65535);
	}
}

void sim_co_reset(struct sim_co_node *n, int64_t at_ns)
{
	const uint8_t boot = CO_BOOT_UP;

	n->id = n->pending_id;
	n->sync_cob = CO_SYNC;
	n->emcy_cob = CO_EMCY + (uint32_t)n->id;
	n->consumer = n->producer = n->overflow = 0;
	n->error_register = n->n_history = 0;
	n->master_lost = n->sync_length_wrong = false;
	n->counter = 0;
	memset(n->pdo, 0, sizeof(n->pdo));
	n->pdo[0].cob = CO_PDO_OFF | (CO_TPDO1 + (uint32_t)n->id);
	n->pdo[1].cob = CO_PDO_OFF | (CO_TPDO2 + (uint32_t)n->id);
	n->pdo[0].type = n->pdo[1].type = 254;
	memset(&n->sdo, 0, sizeof(n->sdo));
	memset(&n->lss, 0, sizeof(n->lss));
	n->state = CO_BOOT_UP;
	set_state(n, CO_PREOP, at_ns);
	if (has_id(n))
		sim_co_send(n, CO_HEARTBEAT + n->id, &boot, 1);
	sim_co_rearm(n);
}

enum bb_status sim_co_start(struct sim_co_node *n, struct sim_can *can, struct bb_clock *clk)
{
	n->clk = clk;
	n->timer = (struct bb_timer){ .step = step, .rank = 1 };
	n->port.frame = on_frame;
	n->port.back = on_back;
	n->pending_id = n->stored_id;
	n->name_bytes = (uint16_t)strlen(n->name);
	list_objects(n);
	if (n->n_comm > SIM_CO_COMM_OBJECTS)
		return BB_ERR_INTERNAL;
	sim_can_attach(can, &n->port);
	sim_co_reset(n, bb_clock_now_ns(clk));
	return BB_OK;
}

void sim_co_end(struct sim_co_node *n)
{
	if (!n->clk)
		return;
	bb_clock_disarm(n->clk, &n->timer);
	sim_can_detach(&n->port);
}

void sim_co_power(struct sim_co_node *n, bool on)
{
	if (n->dead == !on)
		return;
	n->dead = !on;
	n->pending_id = n->stored_id;
	if (on)
		sim_co_reset(n, bb_clock_now_ns(n->clk));
	else {
		n->port.n_box = 0;
		bb_clock_disarm(n->clk, &n->timer);
	}
}
