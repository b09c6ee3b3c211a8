/* sim/peer_pads.c: the hand, the timer and the queue of every peer; its faults are in peer_pads_verbs.c. */
#include "sim/peer_pads_impl.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MS INT64_C(1000000)
#define LEAST_GAP_NS (8 * MS)
#define MOST_GAP_NS (16 * MS)

static const struct peer_model *model_of(enum sim_peer_kind kind)
{
	switch (kind) {
	case SIM_PEER_RUMBLEPAD2_WIRED:
		return &sim_peer_rumblepad_wired;
	case SIM_PEER_RUMBLEPAD2_WIRELESS:
		return &sim_peer_rumblepad_wireless;
	case SIM_PEER_SPACENAVIGATOR:
		return &sim_peer_spacenavigator;
	case SIM_PEER_SPACEMOUSE_WIRELESS:
		return &sim_peer_spacemouse;
	case SIM_PEER_XBOX_PAD:
		return &sim_peer_xbox;
	case SIM_PEER_KINDS:
		break;
	}
	return NULL;
}

static int64_t now_of(const struct sim_peer_pad *p)
{
	return bb_clock_now_ns(p->clk);
}

static void tell(struct sim_peer_pad *p)
{
	if (p->listener)
		p->listener(p->listener_ctx);
}

void sim_peer_pad_send(struct sim_peer_pad *p, const uint8_t *bytes, size_t n)
{
	if (p->fault_unplug || p->n == SIM_PEER_QUEUE || n > SIM_PEER_PACKET_BYTES)
		return;
	struct peer_packet *to = &p->queue[(p->head + p->n++) % SIM_PEER_QUEUE];
	*to = (struct peer_packet){ .at_ns = now_of(p), .n = n };
	memcpy(to->bytes, bytes, n);
	tell(p);
}

/* Radio and plug do to packets what they do: cut them short, mix up ids, replace them by noise. */
void sim_peer_emit(struct sim_peer_pad *p, const uint8_t *bytes, size_t n)
{
	uint8_t changed[SIM_PEER_PACKET_BYTES];

	if (p->fault_silence || n > sizeof(changed))
		return;
	memcpy(changed, bytes, n);
	if (p->fault_id)
		changed[0] = 0;
	if (p->fault_short && n > 1)
		n = 1 + (size_t)(sim_rng_u64(&p->noise) % (n < 6 ? n - 1 : 4));
	if (p->garbage_share > 0 && sim_rng_uniform(&p->noise) < p->garbage_share) {
		n = 1 + (size_t)(sim_rng_u64(&p->noise) % 5); /* shorter than any report with axes */
		for (size_t i = 0; i < n; i++)
			changed[i] =
				(uint8_t)(sim_rng_u64(&p->noise) & 2); /* no id there is: 0 or 2, too short for 2 */
	}
	sim_peer_pad_send(p, changed, n);
}

/* The hand. ---------------------------------------------------------------------------------------------------- */

static int64_t script_ns(const struct sim_peer_pad *p, int64_t at_ns)
{
	return at_ns - (p->world ? sim_world_scene_start(p->world) : 0);
}

static struct peer_values values_at(struct sim_peer_pad *p, int64_t at_ns)
{
	struct peer_values v = { .battery = p->battery };
	struct sim_pad_state state;

	sim_pad_script_at(p->script, script_ns(p, at_ns), &state);
	for (size_t i = 0; i < BB_PAD_AXES; i++) {
		double value = (p->fault_stick[i] ? p->stick_value[i] : state.axis[i]) + p->drift[i];
		if (p->shake[i] > 0)
			value += p->shake[i] * (2 * sim_rng_uniform(&p->noise) - 1);
		v.count[i] = (int32_t)lround(fmax(-1, fmin(1, value)) * p->model->steps[i]);
	}
	v.buttons = state.buttons & p->model->buttons;
	if (!isnan(state.battery))
		v.battery = state.battery;
	if (p->fault_battery)
		v.battery = p->fault_level;
	return v;
}

static bool neutral(const struct peer_values *v)
{
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (v->count[i])
			return false;
	return true;
}

static bool same(const struct peer_values *a, const struct peer_values *b)
{
	return !memcmp(a->count, b->count, sizeof(a->count)) && a->buttons == b->buttons;
}

static void play(struct sim_peer_pad *p, int64_t at_ns)
{
	const struct peer_values v = values_at(p, at_ns);

	if (p->fault_unplug || p->fault_off || v.battery <= 0)
		return;
	if (p->model->send_battery && at_ns >= p->battery_due_ns) {
		p->battery_due_ns = at_ns + p->model->battery_every_ns;
		p->model->send_battery(p, v.battery);
	}
	if (neutral(&v) && same(&v, &p->told))
		return;
	p->model->send(p, &v);
	p->told = v;
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_peer_pad *p = bb_container_of(timer, struct sim_peer_pad, timer);

	(void)now_ns;
	play(p, scheduled_ns);
	return scheduled_ns + LEAST_GAP_NS + (int64_t)(sim_rng_uniform(&p->rng) * (double)(MOST_GAP_NS - LEAST_GAP_NS));
}

void sim_peer_pad_truth(const struct sim_peer_pad *p, struct sim_pad_state *out)
{
	sim_pad_script_at(p->script, script_ns(p, now_of(p)), out);
}

/* The wire. ---------------------------------------------------------------------------------------------------- */

enum bb_status sim_peer_pad_take(struct sim_peer_pad *p, uint8_t *bytes, size_t cap, size_t *n_out, int64_t *at_ns)
{
	*n_out = 0;
	if (p->fault_unplug)
		return BB_ERR_LOST;
	if (!p->n)
		return BB_TIMEOUT;
	const struct peer_packet *from = &p->queue[p->head];
	*n_out = from->n < cap ? from->n : cap;
	memcpy(bytes, from->bytes, *n_out);
	*at_ns = from->at_ns;
	p->head = (p->head + 1) % SIM_PEER_QUEUE;
	p->n--;
	return BB_OK;
}

enum bb_status sim_peer_pad_give(struct sim_peer_pad *p, const uint8_t *bytes, size_t n)
{
	if (p->fault_unplug)
		return BB_ERR_LOST;
	return p->model->give(p, bytes, n);
}

void sim_peer_pad_unplug(struct sim_peer_pad *p, bool on)
{
	if (p->fault_unplug == on)
		return;
	p->fault_unplug = on;
	p->generation += on;
	p->n = 0; /* the kernel's queue goes with the node */
	p->told = (struct peer_values){ 0 };
	p->battery_due_ns = now_of(p);
	p->strong = p->weak = 0;
	if (!on)
		p->model->joined(p);
	tell(p);
}

const uint8_t *sim_peer_pad_descriptor(const struct sim_peer_pad *p, size_t *n_out)
{
	/* Collections without end, then a range of usages no table holds. */
	static const uint8_t hostile[] = {
		0x05, 0x01, 0x09, 0x04, 0xA1, 0x01, 0xA1, 0x00, 0xA1, 0x00, 0x19, 0x00, 0x2B,
		0xFF, 0xFF, 0xFF, 0x7F, 0x97, 0xFF, 0xFF, 0xFF, 0x7F, 0x75, 0x20, 0x81, 0x02
	};

	if (!p->fault_descriptor)
		return sim_peer_hid_descriptor(p->kind, n_out);
	*n_out = sizeof(hostile);
	return hostile;
}

bool sim_peer_pad_plugged(const struct sim_peer_pad *p)
{
	return !p->fault_unplug;
}

uint32_t sim_peer_pad_generation(const struct sim_peer_pad *p)
{
	return p->generation;
}

void sim_peer_pad_listen(struct sim_peer_pad *p, void (*fn)(void *ctx), void *ctx)
{
	p->listener = fn;
	p->listener_ctx = ctx;
}

enum sim_peer_kind sim_peer_pad_kind(const struct sim_peer_pad *p)
{
	return p->kind;
}

const char *sim_peer_pad_serial(const struct sim_peer_pad *p)
{
	return p->id;
}

bool sim_peer_pad_rumble(const struct sim_peer_pad *p, float *strong, float *weak)
{
	*strong = p->strong;
	*weak = p->weak;
	return p->has_rumbled;
}

int sim_peer_pad_led(const struct sim_peer_pad *p)
{
	return p->led;
}

/* Life. -------------------------------------------------------------------------------------------------------- */

static enum bb_status begin(struct sim_peer_pad *p, const struct sim_peer_config *c)
{
	enum bb_status status;

	if (c->script && c->script[0])
		status = sim_pad_script_load(c->script, &p->script, NULL);
	else
		status = sim_pad_script_generate(c->seed, p->id, &p->script);
	if (status == BB_OK)
		status = bb_clock_arm(p->clk, &p->timer, now_of(p) + LEAST_GAP_NS);
	if (status == BB_OK && p->world)
		status = sim_world_register(p->world, "gamepad", p->id, p, sim_peer_pad_verbs);
	return status;
}

enum bb_status sim_peer_pad_create(const struct sim_peer_config *c, struct sim_peer_pad **out)
{
	const struct peer_model *model = model_of(c->kind);
	struct sim_peer_pad *p;

	*out = NULL;
	if (!model)
		return BB_ERR_USAGE;
	if (!(p = calloc(1, sizeof(*p))))
		return BB_ERR_NOMEM;
	p->kind = c->kind;
	p->model = model;
	snprintf(p->id, sizeof(p->id), "%s", c->id);
	p->clk = c->clk;
	p->world = c->world;
	p->led = -1;
	p->timer = (struct bb_timer){ .step = step, .rank = 1 };
	/* The same class name as the simulated gamepad draws from: both report at the same instants. */
	sim_rng_seed(&p->rng, c->seed, "gamepad", p->id);
	sim_rng_seed(&p->noise, c->seed, "gamepad-wire", p->id);
	p->battery = 0.6 + 0.35 * sim_rng_uniform(&p->rng);
	const enum bb_status status = begin(p, c);
	if (status != BB_OK) {
		bb_clock_disarm(p->clk, &p->timer);
		sim_pad_script_free(p->script);
		free(p);
		return status;
	}
	p->battery_due_ns = now_of(p);
	sim_peer_usb_init(p);
	p->model->joined(p);
	*out = p;
	return BB_OK;
}

void sim_peer_pad_destroy(struct sim_peer_pad *p)
{
	if (!p)
		return;
	bb_clock_disarm(p->clk, &p->timer);
	if (p->world)
		sim_world_unregister(p->world, p);
	sim_pad_script_free(p->script);
	free(p);
}
