/* sim/sim_power.c: the strip's relays and meter as a state machine on the clock; see sim/sim_power.h. */
#include "sim/sim_power.h"

#include "sim/sim.h"
#include "sim/verb_args.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define RELAY_SETTLE_NS (20 * INT64_C(1000000))
#define METER_STEP_A 0.01
#define METER_OFFSET_A 0.03
#define STRIP_FUSE_A 16.0

struct sim_power;

struct sim_outlet {
	struct bb_timer settle;
	struct sim_power *strip;
	size_t index;
	bool coil, contact;
	enum sim_stick stick;
	int64_t closed_ns;       /* when the contact last closed */
	double current_a;        /* < 0: the configured load */
	double meter_offset_a;
};

struct sim_power {
	struct bb_power base;
	struct sim_world *world;
	int64_t settle_ns;
	bool silent, dropped;
	bool inrush;
	struct sim_outlet outlet[BB_OUTLETS_MAX];
};

static struct sim_power *of(struct bb_power *p)
{
	return bb_container_of(p, struct sim_power, base);
}

static const struct sim_power *const_of(const struct bb_power *p)
{
	return (const struct sim_power *)(const void *)p;
}

static void tell_world(struct sim_power *sp, size_t index)
{
	char name[BB_ID_MAX + 24];

	snprintf(name, sizeof(name), "%s/%lld", sp->base.config.id, (long long)sp->base.config.outlet[index].outlet);
	sim_world_set_fed(sp->world, name, sp->outlet[index].contact);
}

static void set_contact(struct sim_outlet *o, bool closed, int64_t at_ns)
{
	struct sim_power *sp = o->strip;

	if (o->contact == closed)
		return;
	o->contact = closed;
	if (closed)
		o->closed_ns = at_ns;
	bb_device_event(&sp->base.dev, BB_EV_OUTLET, at_ns, sp->base.config.outlet[o->index].outlet, closed);
	tell_world(sp, o->index);
}

/* Where the contact comes to rest. */
static bool rest(const struct sim_outlet *o)
{
	if (o->strip->dropped)
		return false;
	return o->stick == SIM_STICK_NONE ? o->coil : o->stick == SIM_STICK_CLOSED;
}

static int64_t settle_step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_outlet *o = bb_container_of(timer, struct sim_outlet, settle);

	(void)now_ns;
	set_contact(o, rest(o), scheduled_ns);
	return BB_NEVER;
}

/* The coil or the mains changed: the contact follows after the settle time. */
static enum bb_status follow(struct sim_outlet *o)
{
	struct sim_power *sp = o->strip;
	const int64_t now_ns = bb_clock_now_ns(sp->base.dev.clk);

	if (!sp->settle_ns) {
		set_contact(o, rest(o), now_ns);
		return BB_OK;
	}
	return bb_clock_arm(sp->base.dev.clk, &o->settle, now_ns + sp->settle_ns);
}

static enum bb_status sim_set(struct bb_power *p, size_t index, bool on)
{
	struct sim_power *sp = of(p);
	struct sim_outlet *o = &sp->outlet[index];

	if (sp->silent || sp->dropped)
		return bb_device_fail(&p->dev, BB_ERR_IO, "set", "outlet %lld: the strip does not answer",
		                      (long long)p->config.outlet[index].outlet);
	if (o->coil == on)
		return BB_OK;
	o->coil = on;
	return follow(o);
}

double sim_power_current(const struct bb_power *p, size_t index, int64_t at_ns)
{
	const struct sim_power *sp = const_of(p);
	const struct sim_outlet *o = &sp->outlet[index];
	const struct bb_outlet_config *c = &p->config.outlet[index];

	if (!o->contact)
		return 0;
	if (sp->inrush && (double)(at_ns - o->closed_ns) < c->inrush_ms * 1e6)
		return fmax(c->inrush_a, c->load_a);
	return o->current_a >= 0 ? o->current_a : c->load_a;
}

bool sim_power_contact(const struct bb_power *p, size_t index)
{
	return const_of(p)->outlet[index].contact;
}

static enum bb_status sim_read(struct bb_power *p, size_t index, struct bb_outlet_state *out)
{
	struct sim_power *sp = of(p);
	const struct sim_outlet *o = &sp->outlet[index];

	out->at_ns = bb_clock_now_ns(p->dev.clk);
	out->commanded = o->coil;
	if (sp->silent || sp->dropped)
		return BB_OK; /* known stays false: an outlet that does not answer is neither on nor off */
	out->known = true;
	out->closed = o->contact;
	if (o->contact) {
		const double true_a = sim_power_current(p, index, out->at_ns);
		out->current_a = fmax(0, round((true_a + o->meter_offset_a) / METER_STEP_A) * METER_STEP_A);
	}
	return BB_OK;
}

static void sim_close(struct bb_power *p)
{
	struct sim_power *sp = of(p);

	for (size_t i = 0; i < p->config.n_outlets; i++)
		bb_clock_disarm(p->dev.clk, &sp->outlet[i].settle);
	sim_world_unregister(sp->world, sp);
}

static enum bb_status sim_open(struct bb_power *p, const struct bb_open *open)
{
	struct sim_power *sp = of(p);
	struct sim_rng rng;

	if (!open->world)
		return BB_ERR_USAGE;
	sp->world = open->world;
	sim_rng_seed(&rng, open->seed, "power", p->config.id);
	sp->settle_ns = open->fidelity > 0 ? RELAY_SETTLE_NS : 0;
	sp->inrush = open->fidelity > 0;
	p->limits = (struct bb_power_limits){ .settle_ns = sp->settle_ns,
		                              .current_error_a = METER_OFFSET_A + METER_STEP_A,
		                              .most_total_a = STRIP_FUSE_A };
	for (size_t i = 0; i < p->config.n_outlets; i++) {
		sp->outlet[i] = (struct sim_outlet){
			.settle = { .step = settle_step, .rank = 0 },
			.strip = sp,
			.index = i,
			.coil = true,
			.contact = true,
			.closed_ns = bb_clock_now_ns(p->dev.clk) - BB_NS_PER_S * 3600, /* long past its inrush */
			.current_a = -1,
			.meter_offset_a = open->fidelity > 0 ? (2 * sim_rng_uniform(&rng) - 1) * METER_OFFSET_A : 0,
		};
		tell_world(sp, i);
	}
	return sim_world_register(sp->world, "power", p->config.id, sp, sim_power_verbs);
}

static const struct bb_power_ops ops = { sim_open, sim_close, sim_set, sim_read };
const struct bb_power_driver sim_power_driver = { "sim", sizeof(struct sim_power), &ops };

void sim_power_world_stick(struct bb_power *p, size_t index, enum sim_stick stick)
{
	struct sim_outlet *o = &of(p)->outlet[index];

	o->stick = stick;
	bb_clock_disarm(p->dev.clk, &o->settle);
	if (stick != SIM_STICK_NONE)
		set_contact(o, rest(o), bb_clock_now_ns(p->dev.clk));
	else if (follow(o) != BB_OK) /* no memory for a timer: at once, then */
		set_contact(o, rest(o), bb_clock_now_ns(p->dev.clk));
}

void sim_power_world_silence(struct bb_power *p, bool silent)
{
	of(p)->silent = silent;
}

void sim_power_world_drop(struct bb_power *p, bool dropped)
{
	struct sim_power *sp = of(p);

	sp->dropped = dropped;
	for (size_t i = 0; i < p->config.n_outlets; i++) {
		struct sim_outlet *o = &sp->outlet[i];
		bb_clock_disarm(p->dev.clk, &o->settle);
		if (dropped || follow(o) != BB_OK)
			set_contact(o, rest(o), bb_clock_now_ns(p->dev.clk));
	}
}

void sim_power_world_current(struct bb_power *p, size_t index, double current_a)
{
	of(p)->outlet[index].current_a = current_a;
}

/* Verbs. ------------------------------------------------------------------------------------------------------- */

/* The index of "outlet=N"; with device NULL only its form is checked. */
static enum bb_status outlet_index(struct sim_power *sp, const struct sim_fault_args *args, size_t *index,
                                   struct bb_error *err)
{
	long number;
	enum bb_status status = sim_args_need(args, "outlet", err);

	*index = 0;
	if (status == BB_OK)
		status = sim_args_whole(args, "outlet", 0, 0, 65535, &number, err);
	if (status != BB_OK || !sp)
		return status;
	for (size_t i = 0; i < sp->base.config.n_outlets; i++)
		if (sp->base.config.outlet[i].outlet == number) {
			*index = i;
			return BB_OK;
		}
	return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "power/%s has no outlet %ld", sp->base.config.id, number);
}

static enum bb_status verb_stick(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_power *sp = device;
	size_t index;
	const char *state = sim_fault_arg(args, "state");
	enum bb_status status = sim_args_only(args, "outlet state", err);

	if (status == BB_OK)
		status = outlet_index(sp, args, &index, err);
	if (status != BB_OK)
		return status;
	if (state && strcmp(state, "on") && strcmp(state, "off"))
		return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "state=%s: want on or off", state);
	const enum sim_stick stuck = state && !strcmp(state, "on") ? SIM_STICK_CLOSED : SIM_STICK_OPEN;
	if (sp)
		sim_power_world_stick(&sp->base, index, on ? stuck : SIM_STICK_NONE);
	return BB_OK;
}

static enum bb_status verb_timeout(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		sim_power_world_silence(&((struct sim_power *)device)->base, on);
	return status;
}

static enum bb_status verb_drop(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		sim_power_world_drop(&((struct sim_power *)device)->base, on);
	return status;
}

static enum bb_status verb_current(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_power *sp = device;
	size_t index;
	double a = 0;
	enum bb_status status = sim_args_only(args, "outlet a", err);

	if (status == BB_OK)
		status = outlet_index(sp, args, &index, err);
	if (status == BB_OK)
		status = sim_args_need(args, "a", err);
	if (status == BB_OK)
		status = sim_args_real(args, "a", 0, 0, 1000, &a, err);
	if (status == BB_OK && sp)
		sim_power_world_current(&sp->base, index, on ? a : -1);
	return status;
}

const struct sim_verb sim_power_verbs[] = {
	{ "stick", "outlet=N [state=off|on]", "the relay goes to that state at once (default off) and obeys nothing",
	  "outlet=1", verb_stick },
	{ "timeout", "", "the strip does not answer: the state of its outlets is unknown", "", verb_timeout },
	{ "drop", "", "no mains at the strip: every outlet dark, no answer", "", verb_drop },
	{ "current", "outlet=N a=X", "the outlet's load draws X amperes", "outlet=1 a=0.05", verb_current },
	{ NULL, NULL, NULL, NULL, NULL },
};
