/* sim/sim_gamepad.c: the pad's report timer, its queue and its faults; see sim/sim_gamepad.h. */
#include "sim/sim_gamepad.h"

#include "sim/sim.h"
#include "sim/sim_option.h"
#include "sim/verb_args.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MS INT64_C(1000000)
#define LEAST_GAP_NS (8 * MS)
#define MOST_GAP_NS (16 * MS)
#define DEAD_ZONE 0.15 /* what a consumer takes for neutral */
#define QUEUE 128 /* reports: more than a second of them */

struct model {
	double steps;          /* from neutral to the end of an analogue axis */
	size_t analogue;       /* axes from there on are a hat: -1, 0, 1 */
	uint32_t buttons;      /* mask */
	bool has_rumble, tells_battery;
};

static const struct model models[] = {
	[BB_PAD_RUMBLEPAD2] = { 127, 4, 0xFFF, true, false }, /* 8 bits an axis */
	[BB_PAD_SPACEMOUSE] = { 350, 6, 0x3, false, true },   /* +-350 counts */
	[BB_PAD_XBOX360] = { 32767, 4, 0x7FF, true, true },
};

struct pad_values { /* what a report says, in the device's own counts */
	int32_t count[BB_PAD_AXES];
	uint32_t buttons;
	float battery;
};

struct sim_gamepad {
	struct bb_gamepad base;
	struct sim_world *world;
	struct sim_rng rng;
	const struct model *model;
	struct sim_pad_script *script;
	struct bb_timer timer;
	float battery;             /* of a script that does not say */

	struct pad_values told;    /* what the hand did at the last report */
	bool held;                 /* plugged in again: nothing moves before it was neutral once */
	uint32_t seq;
	size_t head, n;            /* of the queue */
	struct bb_pad_report queue[QUEUE];

	bool has_rumbled;
	float strong, weak;

	bool fault_silence, fault_unplug, fault_battery;
	float fault_level;
	bool fault_stick[BB_PAD_AXES];
	double stick_value[BB_PAD_AXES], drift[BB_PAD_AXES];
};

static struct sim_gamepad *of(struct bb_gamepad *g)
{
	return bb_container_of(g, struct sim_gamepad, base);
}

static double axis_value(const struct sim_gamepad *sg, size_t i, double scripted)
{
	const double value = (sg->fault_stick[i] ? sg->stick_value[i] : scripted) + sg->drift[i];

	return fmax(-1, fmin(1, value));
}

static struct pad_values values_at(const struct sim_gamepad *sg, int64_t at_ns)
{
	struct sim_pad_state state;
	struct pad_values v = { .battery = sg->battery };

	sim_pad_script_at(sg->script, at_ns - sim_world_scene_start(sg->world), &state);
	for (size_t i = 0; i < BB_PAD_AXES; i++) {
		const double steps = i < sg->model->analogue ? sg->model->steps : 1;
		v.count[i] = (int32_t)lround(axis_value(sg, i, state.axis[i]) * steps);
	}
	v.buttons = state.buttons & sg->model->buttons;
	if (!isnan(state.battery))
		v.battery = (float)state.battery;
	if (sg->fault_battery)
		v.battery = sg->fault_level;
	return v;
}

static bool neutral(const struct pad_values *v)
{
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (v->count[i])
			return false;
	return true;
}

/* The battery rides along in reports but does not cause one. */
static bool same(const struct pad_values *a, const struct pad_values *b)
{
	return !memcmp(a->count, b->count, sizeof(a->count)) && a->buttons == b->buttons;
}

static void report(struct sim_gamepad *sg, const struct pad_values *v, int64_t at_ns)
{
	struct bb_pad_report *r = &sg->queue[(sg->head + sg->n) % QUEUE];

	if (sg->n == QUEUE) /* nobody reads: the oldest is lost, the sequence shows it */
		sg->head = (sg->head + 1) % QUEUE;
	else
		sg->n++;
	*r = (struct bb_pad_report){ .at_ns = at_ns, .seq = sg->seq++, .buttons = v->buttons,
		                      .battery = sg->model->tells_battery ? v->battery : NAN };
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		r->axis[i] = (float)(v->count[i] / (i < sg->model->analogue ? sg->model->steps : 1.0));
	bb_device_event(&sg->base.dev, BB_EV_REPORT, at_ns, r->seq, r->buttons);
}

/* A pad with an empty battery is as silent as one in a drawer; its dongle does not know the difference. */
static bool mute(const struct sim_gamepad *sg, const struct pad_values *v)
{
	return sg->fault_silence || sg->fault_unplug || v->battery <= 0;
}

/* What a user is told: as the drivers do it, row H1. */
static struct pad_values held_back(struct sim_gamepad *sg, const struct pad_values *hand)
{
	const struct pad_values at_rest = { .battery = hand->battery };
	bool neutral_now = !hand->buttons;

	for (size_t i = 0; i < BB_PAD_AXES; i++) {
		const double steps = i < sg->model->analogue ? sg->model->steps : 1;
		neutral_now &= abs(hand->count[i]) <= (int32_t)(DEAD_ZONE * steps);
	}
	sg->held &= !neutral_now;
	return sg->held ? at_rest : *hand;
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_gamepad *sg = bb_container_of(timer, struct sim_gamepad, timer);
	const struct pad_values hand = values_at(sg, scheduled_ns);

	(void)now_ns;
	if (!mute(sg, &hand) && (!neutral(&hand) || !same(&hand, &sg->told))) {
		const struct pad_values v = held_back(sg, &hand);
		report(sg, &v, scheduled_ns);
		sg->told = hand;
	}
	const double jitter_ns = sim_rng_uniform(&sg->rng) * (double)(MOST_GAP_NS - LEAST_GAP_NS);
	return scheduled_ns + LEAST_GAP_NS + (int64_t)jitter_ns;
}

static enum bb_status sim_read(struct bb_gamepad *g, struct bb_pad_report *reports, size_t cap, size_t *n_out)
{
	struct sim_gamepad *sg = of(g);

	if (sg->fault_unplug)
		return bb_device_fail(&g->dev, BB_ERR_LOST, "read", "the receiver is gone");
	if (!sg->n)
		return BB_TIMEOUT;
	for (; *n_out < cap && sg->n; sg->n--) {
		reports[(*n_out)++] = sg->queue[sg->head];
		sg->head = (sg->head + 1) % QUEUE;
	}
	return BB_OK;
}

static enum bb_status sim_rumble(struct bb_gamepad *g, float strong, float weak)
{
	struct sim_gamepad *sg = of(g);

	if (!sg->model->has_rumble)
		return BB_ERR_UNSUPPORTED;
	if (sg->fault_unplug)
		return bb_device_fail(&g->dev, BB_ERR_LOST, "rumble", "the receiver is gone");
	sg->has_rumbled = true;
	sg->strong = strong;
	sg->weak = weak;
	return BB_OK;
}

bool sim_gamepad_rumble(struct bb_gamepad *g, float *strong, float *weak)
{
	*strong = of(g)->strong;
	*weak = of(g)->weak;
	return of(g)->has_rumbled;
}

static enum bb_status load_script(struct sim_gamepad *sg, const struct bb_open *open)
{
	const struct bb_gamepad_config *c = &sg->base.config;
	struct bb_error err = { 0 };

	if (!c->script[0])
		return sim_pad_script_generate(open->seed, c->id, &sg->script);
	const enum bb_status status = sim_pad_script_load(c->script, &sg->script, &err);
	if (status != BB_OK)
		bb_log(open->log, BB_LOG_ERROR, BB_BLAME_CONFIG, c->id, "%s", err.text);
	return status;
}

static enum bb_status sim_open(struct bb_gamepad *g, const struct bb_open *open)
{
	static const struct sim_option no_options[] = { { NULL, 0, 0, 0 } };
	struct sim_gamepad *sg = of(g);

	if (!open->world)
		return BB_ERR_USAGE;
	if ((unsigned int)g->config.model >= BB_ARRAY_LEN(models))
		return BB_ERR_CONFIG;
	sg->world = open->world;
	sg->model = &models[g->config.model];
	sg->timer = (struct bb_timer){ .step = step, .rank = 1 };
	sim_rng_seed(&sg->rng, open->seed, "gamepad", g->config.id);
	sg->battery = (float)(0.6 + 0.35 * sim_rng_uniform(&sg->rng));
	g->limits = (struct bb_gamepad_limits){ .most_report_gap_ns = MOST_GAP_NS, .axis_step = 1 / sg->model->steps,
		                                .has_rumble = sg->model->has_rumble,
		                                .has_battery = sg->model->tells_battery };
	enum bb_status status = sim_options_read(&g->dev, open->uri, no_options, sg);
	if (status == BB_OK)
		status = load_script(sg, open);
	if (status == BB_OK)
		status = bb_clock_arm(g->dev.clk, &sg->timer, bb_clock_now_ns(g->dev.clk) + LEAST_GAP_NS);
	if (status == BB_OK)
		status = sim_world_register(sg->world, "gamepad", g->config.id, sg, sim_gamepad_verbs);
	if (status != BB_OK) {
		bb_clock_disarm(g->dev.clk, &sg->timer);
		sim_pad_script_free(sg->script);
	}
	return status;
}

static void sim_close(struct bb_gamepad *g)
{
	struct sim_gamepad *sg = of(g);

	bb_clock_disarm(g->dev.clk, &sg->timer);
	sim_pad_script_free(sg->script);
	sim_world_unregister(sg->world, sg);
}

static const struct bb_gamepad_ops ops = { sim_open, sim_close, sim_read, sim_rumble };
const struct bb_gamepad_driver sim_gamepad_driver = { "sim", sizeof(struct sim_gamepad), &ops };

/* Verbs. ------------------------------------------------------------------------------------------------------- */

static enum bb_status verb_silence(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const enum bb_status status = sim_args_only(args, "", err);

	if (status == BB_OK && device)
		((struct sim_gamepad *)device)->fault_silence = on;
	return status;
}

static enum bb_status verb_unplug(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_gamepad *sg = device;
	const enum bb_status status = sim_args_only(args, "", err);

	if (status != BB_OK || !sg)
		return status;
	sg->fault_unplug = on;
	sg->n = 0; /* the kernel's queue goes with the node */
	sg->told = (struct pad_values){ 0 };
	sg->held = true;
	return BB_OK;
}

static enum bb_status verb_battery(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_gamepad *sg = device;
	double level;
	enum bb_status status = sim_args_only(args, "level", err);

	if (status == BB_OK)
		status = sim_args_real(args, "level", 0.05, 0, 1, &level, err);
	if (status != BB_OK || !sg)
		return status;
	sg->fault_battery = on;
	sg->fault_level = (float)level;
	return BB_OK;
}

static enum bb_status verb_stick_axis(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_gamepad *sg = device;
	long axis;
	double value;
	enum bb_status status = sim_args_only(args, "axis value", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "axis", 1, 1, BB_PAD_AXES, &axis, err);
	if (status == BB_OK)
		status = sim_args_real(args, "value", 1, -1, 1, &value, err);
	if (status != BB_OK || !sg)
		return status;
	sg->fault_stick[axis - 1] = on;
	sg->stick_value[axis - 1] = value;
	return BB_OK;
}

static enum bb_status verb_drift(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_gamepad *sg = device;
	long axis;
	double offset;
	enum bb_status status = sim_args_only(args, "axis offset", err);

	if (status == BB_OK)
		status = sim_args_whole(args, "axis", 1, 1, BB_PAD_AXES, &axis, err);
	if (status == BB_OK)
		status = sim_args_real(args, "offset", 0.1, -1, 1, &offset, err);
	if (status != BB_OK || !sg)
		return status;
	sg->drift[axis - 1] = on ? offset : 0;
	return BB_OK;
}

const struct sim_verb sim_gamepad_verbs[] = {
	{ "silence", "", "no reports although its receiver is alive", "", verb_silence },
	{ "unplug", "", "the receiver is pulled out", "", verb_unplug },
	{ "battery", "[level=N]", "its battery is at that level, 0.05 unless told; at 0 it falls silent", "level=0.05",
	  verb_battery },
	{ "stick_axis", "[axis=N] [value=N]", "an axis (1..6, default 1) is stuck at a value (default 1)",
	  "axis=2 value=0.6", verb_stick_axis },
	{ "drift", "[axis=N] [offset=N]", "an axis (default 1) is off by that much (default 0.1)", "axis=1 offset=0.1",
	  verb_drift },
	{ NULL, NULL, NULL, NULL, NULL },
};
