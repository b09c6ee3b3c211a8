/* sim/sim_shutter.c: the shutter chain; the model stands in sim/sim_shutter.h. One timer, on the owner's thread. */
#include "sim/sim_option.h"
#include "sim/sim_shutter.h"
#include "sim/sim.h"

#include <math.h>
#include <string.h>

#define QUEUE 512
#define HISTORY 8
#define WATCHDOG_NS INT64_C(100000000)
#define RESIDUAL_SD_US 15.0
#define RESIDUAL_MOST 2.5 /* in sd: units worse than that do not leave the factory */
#define JITTER_MOST 4.0
#define STEP_NS 1000      /* the controllers count microseconds */
#define LN9 2.1972245773362196 /* 10-90 % time of an exponential over its tau */

struct state { /* what a stage's two shutters have been doing since an edge */
	int64_t at_ns;
	double light[2];      /* at at_ns: left, right */
	uint8_t eye;          /* opening since then; BB_EYE_NONE: both */
};

struct stage {
	int64_t delay_ns;     /* edge to switching, as the controller believes */
	int64_t residual_ns;  /* what it gets wrong */
	int64_t offset_ns;    /* fault */
	uint32_t duty_ppm;
	int64_t swapped, stuck, miss, doubles; /* faults */
	int64_t n, at_ns;     /* next generator edge and when this stage acts on it */
	int64_t extra_ns;     /* a spurious edge under way, or BB_NEVER */
	uint8_t extra_eye;
	uint32_t extra_seq;
	int64_t heard_ns;     /* last edge heard: the watchdog's */
	struct state past[HISTORY];
	uint32_t n_past;
};

struct sim_shutter {
	struct bb_shutter base;
	struct sim_world *world;
	struct bb_timer timer;
	struct sim_rng rng;
	bool ideal, stereo;
	int64_t lost;
	int64_t burst_ns, jitter_ns;
	int64_t base_ppb, rate_ppb; /* of the generator: as configured; added by faults */
	size_t n_stages;            /* with the emitter, which is last */
	struct stage stage[BB_STAGES_MAX + 1];
	struct bb_shutter_edge queue[QUEUE];
	uint32_t head, n_queued;
	uint64_t dropped;
};

static struct sim_shutter *own(struct bb_shutter *sh)
{
	return bb_container_of(sh, struct sim_shutter, base);
}

static uint8_t stage_number(const struct sim_shutter *s, const struct stage *st)
{
	const size_t i = (size_t)(st - s->stage);

	return i + 1 == s->n_stages ? BB_STAGE_EMITTER : (uint8_t)i;
}

/* Optics */

static double follow(const struct sim_shutter *s, const struct stage *st, double light, bool opening, int64_t dt_ns)
{
	const struct bb_shutter_config *config = &s->base.config;
	const struct bb_cell *c = stage_number(s, st) == BB_STAGE_EMITTER ? &config->glasses : &config->cell;
	const double edge_ns = (opening ? c->open_us : c->close_us) * 1000;
	const double left = edge_ns > 0 ? exp(-(double)dt_ns * LN9 / edge_ns) : 0;

	return opening ? 1 - (1 - light) * left : light * left;
}

static double light_at(const struct sim_shutter *s, const struct stage *st, const struct state *from, int eye,
                       int64_t at_ns)
{
	const int64_t dt_ns = at_ns - from->at_ns;
	const double light = from->light[eye];

	if (from->eye == BB_EYE_NONE)
		return follow(s, st, light, true, dt_ns);
	if (from->eye != BB_EYE_LEFT + eye)
		return follow(s, st, light, false, dt_ns);
	const int64_t open_ns = bb_rate_period_ns(s->base.config.rate) / 1000 * st->duty_ppm / 1000;
	if (st->duty_ppm == 1000000 || dt_ns <= open_ns)
		return follow(s, st, light, true, dt_ns);
	return follow(s, st, follow(s, st, light, true, open_ns), false, dt_ns - open_ns);
}

static const struct state *state_at(const struct stage *st, int64_t at_ns)
{
	const uint32_t held = st->n_past < HISTORY ? st->n_past : HISTORY;

	for (uint32_t i = 1; i < held; i++) {
		const struct state *p = &st->past[(st->n_past - i) % HISTORY];
		if (p->at_ns <= at_ns)
			return p;
	}
	return &st->past[(st->n_past - held) % HISTORY];
}

double sim_shutter_transmission(const struct bb_shutter *sh, uint8_t stage, enum bb_eye eye, int64_t at_ns)
{
	const struct sim_shutter *s = (const struct sim_shutter *)(const void *)sh; /* base is the first member */
	const size_t i = stage == BB_STAGE_EMITTER ? s->n_stages - 1 : stage;

	if (i >= s->n_stages || eye == BB_EYE_NONE)
		return 0;
	const struct state *from = state_at(&s->stage[i], at_ns);
	return light_at(s, &s->stage[i], from, (int)eye - BB_EYE_LEFT, at_ns < from->at_ns ? from->at_ns : at_ns);
}

static void switch_to(struct sim_shutter *s, struct stage *st, uint8_t eye, int64_t at_ns)
{
	const struct state *last = &st->past[(st->n_past - 1) % HISTORY];
	const int64_t from_ns = at_ns > last->at_ns ? at_ns : last->at_ns;
	const struct state next = { from_ns, { light_at(s, st, last, 0, from_ns), light_at(s, st, last, 1, from_ns) },
		                    eye };

	st->past[st->n_past++ % HISTORY] = next;
	if (st->n_past == 2 * HISTORY) /* keeps the ring's phase and never wraps */
		st->n_past = HISTORY;
	bb_device_event(&s->base.dev, BB_EV_EDGE, at_ns, eye, stage_number(s, st));
}

static bool is_open(const struct stage *st)
{
	return st->past[(st->n_past - 1) % HISTORY].eye == BB_EYE_NONE;
}

static void open_all(struct sim_shutter *s, int64_t at_ns)
{
	for (size_t i = 0; i < s->n_stages; i++)
		if (!is_open(&s->stage[i]))
			switch_to(s, &s->stage[i], BB_EYE_NONE, at_ns);
}

/* Edges */

static int64_t jitter_of(const struct sim_shutter *s, int64_t n)
{
	struct sim_rng r = sim_rng_at(&s->rng, (uint64_t)n);
	const double sd_ns = (double)(s->jitter_ns + s->burst_ns);
	const double z = fmin(fmax(sim_rng_normal(&r), -JITTER_MOST), JITTER_MOST);
	const double most_ns = (double)bb_rate_period_ns(s->base.config.rate) / 4; /* edges stay in order */

	return sd_ns > 0 ? (int64_t)fmin(fmax(z * sd_ns, -most_ns), most_ns) : 0;
}

static int64_t edge_ns(const struct sim_shutter *s, const struct stage *st, int64_t n)
{
	return sim_world_sync_ns(s->world, n) + jitter_of(s, n) + st->delay_ns + st->residual_ns + st->offset_ns;
}

/* The first edge this stage acts on after a time; never one it has acted on, whatever moved meanwhile. */
static void aim(struct sim_shutter *s, struct stage *st, int64_t least_n, int64_t after_ns)
{
	st->n = least_n;
	st->at_ns = edge_ns(s, st, st->n);
	while (st->at_ns <= after_ns)
		st->at_ns = edge_ns(s, st, ++st->n);
}

static int64_t wake_ns(const struct sim_shutter *s)
{
	int64_t least_ns = BB_NEVER;

	for (size_t i = 0; i < s->n_stages && s->stereo && !s->lost; i++) {
		const struct stage *st = &s->stage[i];
		const int64_t at_ns = st->extra_ns < st->at_ns ? st->extra_ns : st->at_ns;
		if (at_ns < least_ns)
			least_ns = at_ns;
	}
	return least_ns;
}

static enum bb_status rearm(struct sim_shutter *s)
{
	const int64_t at_ns = wake_ns(s);

	bb_clock_disarm(s->base.dev.clk, &s->timer);
	return at_ns == BB_NEVER ? BB_OK : bb_clock_arm(s->base.dev.clk, &s->timer, at_ns);
}

/* After a change of delay, rate or jitter: every stage's next edge lies elsewhere. The timer is armed or running, so
 * arming it again needs no memory. */
static void aim_all(struct sim_shutter *s)
{
	const int64_t now_ns = bb_clock_now_ns(s->base.dev.clk);

	for (size_t i = 0; i < s->n_stages && s->stereo; i++)
		aim(s, &s->stage[i], s->stage[i].n, now_ns);
	if (rearm(s) != BB_OK)
		s->lost++;
}

static void report(struct sim_shutter *s, const struct stage *st, uint8_t eye, uint32_t seq, int64_t at_ns)
{
	const int64_t stamp_ns = s->ideal ? at_ns : at_ns - at_ns % STEP_NS;

	if (s->n_queued == QUEUE) {
		s->head = (s->head + 1) % QUEUE;
		s->n_queued--;
		s->dropped++;
	}
	s->queue[(s->head + s->n_queued++) % QUEUE] =
		(struct bb_shutter_edge){ stamp_ns, seq, s->base.config.untagged > 0 ? (uint8_t)BB_EYE_NONE : eye,
			                  stage_number(s, st) };
}

static uint8_t other(uint8_t eye)
{
	return eye == BB_EYE_LEFT ? BB_EYE_RIGHT : BB_EYE_LEFT;
}

static void act(struct sim_shutter *s, struct stage *st)
{
	const int64_t at_ns = st->at_ns, n = st->n;
	const uint8_t true_eye = n % 2 ? BB_EYE_RIGHT : BB_EYE_LEFT;
	const uint8_t eye = st->swapped % 2 ? other(true_eye) : true_eye;

	aim(s, st, n + 1, at_ns);
	if (st->stuck || st->miss) {
		st->miss -= !st->stuck;
		if (at_ns - st->heard_ns < s->base.limits.coast_ns)
			switch_to(s, st, eye, at_ns);
		else if (at_ns - st->heard_ns >= WATCHDOG_NS && !is_open(st))
			switch_to(s, st, BB_EYE_NONE, at_ns);
		return;
	}
	st->heard_ns = at_ns;
	switch_to(s, st, eye, at_ns);
	report(s, st, eye, (uint32_t)n, at_ns);
	if (st->doubles) {
		st->doubles--;
		st->extra_ns = at_ns + (st->at_ns - at_ns) / 4;
		st->extra_eye = other(eye);
		st->extra_seq = (uint32_t)n;
	}
}

static void act_extra(struct sim_shutter *s, struct stage *st)
{
	const int64_t at_ns = st->extra_ns;

	st->extra_ns = BB_NEVER;
	switch_to(s, st, st->extra_eye, at_ns);
	report(s, st, st->extra_eye, st->extra_seq, at_ns);
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_shutter *s = bb_container_of(timer, struct sim_shutter, timer);

	(void)now_ns;
	for (size_t i = 0; i < s->n_stages; i++) {
		if (s->stage[i].extra_ns <= scheduled_ns)
			act_extra(s, &s->stage[i]);
		if (s->stage[i].at_ns <= scheduled_ns)
			act(s, &s->stage[i]);
	}
	return wake_ns(s);
}

/* Ops */

static const struct sim_option options[] = {
	{ "rate_error_ppm", offsetof(struct bb_shutter_config, rate_error_ppm), -1000, 1000 },
	{ "jitter_us", offsetof(struct bb_shutter_config, jitter_us), 0, 1000 },
	{ "stage_delay_us", offsetof(struct bb_shutter_config, stage_delay_us), 0, 1000 },
	{ "coast_s", offsetof(struct bb_shutter_config, coast_s), 0, 3600 },
	{ "untagged", offsetof(struct bb_shutter_config, untagged), 0, 1 },
	{ NULL, 0, 0, 0 },
};

static void init_stage(struct sim_shutter *s, size_t i)
{
	const struct bb_shutter_config *c = &s->base.config;
	struct stage *st = &s->stage[i];
	const double z = fmin(fmax(sim_rng_normal(&s->rng), -RESIDUAL_MOST), RESIDUAL_MOST);
	const double us = i + 1 == s->n_stages ? c->emitter_offset_us : (double)(i + 1) * c->stage_delay_us;

	st->delay_ns = llround(us * 1000);
	st->residual_ns = s->ideal ? 0 : llround(z * RESIDUAL_SD_US * 1000);
	st->duty_ppm = 1000000;
	st->extra_ns = BB_NEVER;
	st->past[0] = (struct state){ bb_clock_now_ns(s->base.dev.clk), { 1, 1 }, BB_EYE_NONE };
	st->n_past = 1;
}

static enum bb_status check_config(struct sim_shutter *s)
{
	const struct bb_shutter_config *c = &s->base.config;
	const struct bb_shutter_limits *l = &s->base.limits;
	const int64_t period_ns = c->rate.num && c->rate.den ? bb_rate_period_ns(c->rate) : 0;

	if (c->n_stages < 0 || c->n_stages > BB_STAGES_MAX)
		return bb_device_fail(&s->base.dev, BB_ERR_CONFIG, "open", "%lld stages", (long long)c->n_stages);
	if (period_ns < l->least_period_ns || period_ns > l->most_period_ns)
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "a period of %lld ns", (long long)period_ns);
	if (!(bb_cell_moves(&c->cell) && bb_cell_moves(&c->glasses) && c->jitter_us >= 0 && c->emitter_offset_us >= 0 &&
	      c->stage_delay_us >= 0 && c->jitter_us + c->emitter_offset_us < 1e6 &&
	      c->stage_delay_us < 1e5 && fabs(c->rate_error_ppm) <= 1000))
		return bb_device_fail(&s->base.dev, BB_ERR_RANGE, "open", "a delay or rate error out of range");
	return BB_OK;
}

static enum bb_status shutter_open(struct bb_shutter *sh, const struct bb_open *open)
{
	struct sim_shutter *s = own(sh);
	struct bb_shutter_config *c = &sh->config;

	s->world = open->world;
	s->ideal = open->fidelity == 0;
	enum bb_status status = sim_options_read(&sh->dev, open->uri, options, c);
	sh->limits = (struct bb_shutter_limits){ .least_period_ns = 5000000, .most_period_ns = 25000000,
		                                 .stamp_error_ns = s->ideal ? 0 : STEP_NS,
		                                 .phase_step_ns = s->ideal ? 1 : STEP_NS };
	if (status == BB_OK)
		status = check_config(s);
	if (status != BB_OK)
		return status;
	sh->limits.open_ns = llround(c->cell.open_us * 1000);
	sh->limits.close_ns = llround(c->cell.close_us * 1000);
	sh->limits.n_stages = c->n_stages;
	sh->limits.coast_ns = llround(c->coast_s * 1e9);
	s->n_stages = (size_t)c->n_stages + 1;
	s->jitter_ns = s->ideal ? 0 : llround(c->jitter_us * 1000);
	s->base_ppb = llround(c->rate_error_ppm * 1000);
	sim_rng_seed(&s->rng, open->seed, "shutter", sh->dev.id);
	for (size_t i = 0; i < s->n_stages; i++)
		init_stage(s, i);
	s->timer = (struct bb_timer){ .step = step, .rank = 1 };
	if (sim_world_sync_error_ppb(s->world) != s->base_ppb)
		status = sim_world_set_sync_error(s->world, bb_clock_now_ns(sh->dev.clk), s->base_ppb);
	return status == BB_OK ? sim_world_register(s->world, "shutter", sh->dev.id, s, sim_shutter_verbs) : status;
}

static void shutter_close(struct bb_shutter *sh)
{
	struct sim_shutter *s = own(sh);

	sim_world_unregister(s->world, s);
	bb_clock_disarm(sh->dev.clk, &s->timer);
	open_all(s, bb_clock_now_ns(sh->dev.clk));
}

static enum bb_status gone(struct sim_shutter *s, const char *op)
{
	return bb_device_fail(&s->base.dev, BB_ERR_LOST, op, "the chain does not answer");
}

static enum bb_status shutter_read(struct bb_shutter *sh, struct bb_shutter_edge *edges, size_t cap, size_t *n_out)
{
	struct sim_shutter *s = own(sh);

	if (s->lost)
		return gone(s, "read");
	for (; *n_out < cap && s->n_queued; s->n_queued--) {
		edges[(*n_out)++] = s->queue[s->head];
		s->head = (s->head + 1) % QUEUE;
	}
	return *n_out ? BB_OK : BB_TIMEOUT;
}

static enum bb_status shutter_set_phase(struct bb_shutter *sh, uint8_t stage, int64_t delay_ns, uint32_t duty_ppm)
{
	struct sim_shutter *s = own(sh);
	struct stage *st = &s->stage[stage == BB_STAGE_EMITTER ? s->n_stages - 1 : stage];
	const int64_t step_ns = sh->limits.phase_step_ns;

	if (s->lost)
		return gone(s, "set_phase");
	st->delay_ns = (delay_ns + step_ns / 2) / step_ns * step_ns;
	st->duty_ppm = duty_ppm;
	aim_all(s);
	return BB_OK;
}

static enum bb_status shutter_set_mode(struct bb_shutter *sh, enum bb_shutter_mode mode)
{
	struct sim_shutter *s = own(sh);
	const int64_t now_ns = bb_clock_now_ns(sh->dev.clk);
	const bool stereo = mode == BB_SHUTTER_STEREO;

	if (s->lost)
		return gone(s, "set_mode");
	if (stereo == s->stereo)
		return BB_OK;
	s->stereo = stereo;
	for (size_t i = 0; i < s->n_stages && stereo; i++) {
		struct stage *st = &s->stage[i];
		const int64_t first = sim_world_reference_after(s->world, sim_world_sync_rate(s->world), now_ns);
		aim(s, st, first > st->n ? first : st->n, now_ns);
		st->extra_ns = BB_NEVER;
		st->heard_ns = now_ns;
	}
	if (!stereo)
		open_all(s, now_ns);
	return rearm(s);
}

static const struct bb_shutter_ops ops = { shutter_open, shutter_close, shutter_read, shutter_set_phase,
	                                   shutter_set_mode };
const struct bb_shutter_driver sim_shutter_driver = { "sim", sizeof(struct sim_shutter), &ops };

uint64_t sim_shutter_dropped(const struct bb_shutter *sh)
{
	return ((const struct sim_shutter *)(const void *)sh)->dropped;
}

/* Verbs. Sums, so that faults may overlap and end in any order. */

static bool chosen(const struct sim_shutter *s, size_t i, const char *stage)
{
	if (!stage)
		return true;
	return i + 1 == s->n_stages ? !strcmp(stage, "emitter") : !strcmp(stage, s->base.config.stage[i]);
}

/* Adds to one counter of the chosen stages. A count that is used up early has nothing left to take back. */
static void add(struct sim_shutter *s, const char *stage, size_t member, int64_t amount)
{
	for (size_t i = 0; i < s->n_stages; i++) {
		int64_t *value = (int64_t *)(void *)((char *)&s->stage[i] + member);
		if (chosen(s, i, stage))
			*value += amount;
		if (member != offsetof(struct stage, offset_ns) && *value < 0)
			*value = 0;
	}
}

static enum bb_status counted(struct sim_shutter *s, const struct sim_fault_args *args, size_t member, bool on,
                              struct bb_error *err)
{
	double n;
	const enum bb_status status = sim_fault_range(args, "n", 1, 1, 1e6, &n, err);

	if (status == BB_OK && s)
		add(s, sim_fault_arg(args, "stage"), member, on ? llround(n) : -llround(n));
	return status;
}

static enum bb_status verb_miss(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return counted(device, args, offsetof(struct stage, miss), on, err);
}

static enum bb_status verb_double(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	return counted(device, args, offsetof(struct stage, doubles), on, err);
}

static enum bb_status verb_flip(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	const char *stage = sim_fault_arg(args, "stage");

	(void)err;
	if (device)
		add(device, stage ? stage : "emitter", offsetof(struct stage, swapped), on ? 1 : -1);
	return BB_OK;
}

static enum bb_status verb_stuck(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	(void)err;
	if (device)
		add(device, sim_fault_arg(args, "stage"), offsetof(struct stage, stuck), on ? 1 : -1);
	return BB_OK;
}

static enum bb_status verb_offset(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_shutter *s = device;
	double us;
	const enum bb_status status = sim_fault_range(args, "us", SIM_FAULT_REQUIRED, -100000, 100000, &us, err);

	if (!sim_fault_arg(args, "stage"))
		return bb_fail(err, BB_ERR_CONFIG, 1605, args->where, "stage=ID is missing");
	if (status == BB_OK && s) {
		add(s, sim_fault_arg(args, "stage"), offsetof(struct stage, offset_ns),
		    llround(on ? us * 1e3 : us * -1e3));
		aim_all(s);
	}
	return status;
}

static enum bb_status verb_jitter(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_shutter *s = device;
	double us;
	const enum bb_status status = sim_fault_range(args, "us", SIM_FAULT_REQUIRED, 0, 2000, &us, err);

	if (status == BB_OK && s) {
		s->burst_ns += llround(on ? us * 1e3 : us * -1e3);
		aim_all(s);
	}
	return status;
}

static enum bb_status verb_rate(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_shutter *s = device;
	double hz;
	enum bb_status status = sim_fault_range(args, "hz", SIM_FAULT_REQUIRED, 40, 200, &hz, err);

	if (status != BB_OK || !s)
		return status;
	const int64_t ppb = llround((hz / bb_rate_hz(sim_world_sync_rate(s->world)) - 1) * 1e9);
	s->rate_ppb += on ? ppb : -ppb;
	status = sim_world_set_sync_error(s->world, bb_clock_now_ns(s->base.dev.clk), s->base_ppb + s->rate_ppb);
	aim_all(s);
	return status;
}

static enum bb_status verb_unplug(void *device, const struct sim_fault_args *args, bool on, struct bb_error *err)
{
	struct sim_shutter *s = device;

	(void)args;
	(void)err;
	if (!s)
		return BB_OK;
	s->lost += on ? 1 : -1;
	s->n_queued = 0;
	if (on)
		open_all(s, bb_clock_now_ns(s->base.dev.clk));
	aim_all(s);
	return BB_OK;
}

const struct sim_verb sim_shutter_verbs[] = {
	{ "miss", "[stage=ID] [n=N]", "n sync edges do not arrive (at one stage, or at all)", "n=3", verb_miss },
	{ "double", "[stage=ID] [n=N]", "after n edges a spurious one, a quarter period late, to the other eye", "n=2",
	  verb_double },
	{ "flip_polarity", "[stage=ID]", "the eyes are swapped at one stage; without stage: in the glasses", "",
	  verb_flip },
	{ "stuck", "[stage=ID]", "the sync line stops toggling; after 100 ms the shutters open", "", verb_stuck },
	{ "stage_offset", "stage=ID us=N", "a stage switches that much late", "stage=emitter us=900", verb_offset },
	{ "jitter_burst", "us=N", "that much more jitter of the sync (standard deviation)", "us=200", verb_jitter },
	{ "rate", "hz=N", "the sync generator runs at another rate, and all that is locked to it", "hz=119",
	  verb_rate },
	{ "unplug", "", "the chain is gone; the shutters open", "", verb_unplug },
	{ NULL, NULL, NULL, NULL, NULL },
};
