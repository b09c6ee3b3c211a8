/* drivers/shutter_gpio.c: see drivers/shutter_gpio.h. One timer, on the owner's thread; nothing blocks. */
#include "drivers/shutter_gpio.h"

#include "drivers/line.h"
#include "hal/options.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define QUEUE 1024 /* more than any kernel buffers */
#define AT_ONCE 64
#define STAMP_ERROR_NS 50000 /* interrupt latency of an ordinary PC; 4 to 25 us were measured in the guest */
#define LATCH_NS (2 * BB_NS_PER_S) /* the transition gap of hal/safety.h */
#define BACKOFF_NS INT64_C(100000000)
#define BACKOFF_MOST_NS (5 * BB_NS_PER_S)
#define REOPENS_A_MINUTE 5

struct options {
	int64_t line, out;
	bool active_low;
	int bias, api;
	double holdover_ppm;
};

static const struct bb_option option_table[] = {
	{ "line", BB_OPT_TYPE_I64, offsetof(struct options, line), 0, -1, 0, 65535, 1, NULL, true,
	  "the line's offset on its chip" },
	{ "out", BB_OPT_TYPE_I64, offsetof(struct options, out), 0, -1, 0, 65535, 1, NULL, false,
	  "a line that lets the emitter hear the sync" },
	{ "active_low", BB_OPT_TYPE_BOOL, offsetof(struct options, active_low), 0, 0, 0, 1, 1, NULL, false,
	  "low is the left eye" },
	{ "bias", BB_OPT_TYPE_ENUM, offsetof(struct options, bias), 0, 0, 0, 0, 1, "as-is|off|up|down", false,
	  "the chip's pull resistor" },
	{ "api", BB_OPT_TYPE_ENUM, offsetof(struct options, api), 0, 0, 0, 0, 1, "uapi2|gpiod", false,
	  "how to speak to the kernel" },
	{ "holdover_ppm", BB_OPT_TYPE_F64, offsetof(struct options, holdover_ppm), 0, 100, 0.01, 10000, 1, NULL, false,
	  "uncertainty of the rate during a silence" },
	BB_OPT_END,
};

struct shutter_gpio {
	struct bb_shutter base;
	const struct bb_line_opener *opener;
	struct bb_line_request request;
	struct bb_line_bus *bus;   /* NULL while the chip is gone */
	struct bb_edge_lock lock;
	struct bb_timer timer;
	enum bb_health health;
	bool stereo, gate, quarantined;
	int64_t latched_ns;        /* the gate stays open (low) until then */
	int64_t reopen_ns;
	unsigned failures;         /* since it was last open: the back-off's exponent */
	uint64_t seed;
	int64_t reopened_ns[REOPENS_A_MINUTE];
	unsigned n_reopened;
	int64_t offset_ns;
	struct bb_shutter_edge queue[QUEUE];
	uint32_t head, n_queued;
	uint64_t dropped;
};

static struct shutter_gpio *own(struct bb_shutter *sh)
{
	return bb_container_of(sh, struct shutter_gpio, base);
}

static const struct shutter_gpio *look(const struct bb_shutter *sh)
{
	return (const struct shutter_gpio *)(const void *)sh; /* base is the first member */
}

/* ---- what is told ---- */

static void tell(struct shutter_gpio *s, int64_t now_ns)
{
	const struct bb_edge_lock *l = &s->lock;
	const enum bb_health health = s->quarantined ? BB_HEALTH_QUARANTINED : bb_edge_lock_health(l);

	for (int f = 0; f < BB_SYNC_GONE; f++) {
		if (!(l->news & 1u << f))
			continue;
		errno = 0;
		bb_device_fail(&s->base.dev, BB_ERR_IO, "read", "%s %llu: period %.4f ms, jitter %.3f ms, %.1f s of holdover left",
		               bb_sync_fault_text((enum bb_sync_fault)f), (unsigned long long)l->fault[f].n,
		               l->period_ns * 1e-6, bb_edge_lock_jitter_ns(l) * 1e-6,
		               (double)bb_edge_lock_holdover_ns(l, now_ns) * 1e-9);
	}
	s->lock.news = 0;
	if (health != s->health)
		bb_device_event(&s->base.dev, BB_EV_HEALTH, now_ns, health, s->health);
	s->health = health;
}

static void report(struct shutter_gpio *s, const struct bb_shutter_edge *e)
{
	struct bb_shutter_edge out = *e;

	out.at_ns += s->offset_ns;
	out.stage = BB_STAGE_EMITTER;
	if (s->n_queued == QUEUE) {
		s->head = (s->head + 1) % QUEUE;
		s->n_queued--;
		s->dropped++;
	}
	s->queue[(s->head + s->n_queued++) % QUEUE] = out;
	bb_device_event(&s->base.dev, BB_EV_EDGE, out.at_ns, out.eye, out.stage);
}

/* ---- the emitter's gate ---- */

static bool safe_for_stereo(const struct shutter_gpio *s)
{
	if (!s->stereo || !s->bus || s->health == BB_HEALTH_LOST || s->health == BB_HEALTH_INIT)
		return false;
	if (s->health == BB_HEALTH_RECOVERING && !s->gate)
		return false;
	return !s->lock.fault[BB_SYNC_RATE].set && !bb_edge_lock_off_rate(&s->lock);
}

static void set_gate(struct shutter_gpio *s, bool closed, int64_t now_ns)
{
	if (s->gate == closed)
		return;
	s->gate = closed;
	if (s->bus && s->request.out >= 0 && s->bus->ops->set(s->bus, closed) != BB_OK)
		bb_device_fail(&s->base.dev, BB_ERR_IO, "set", "the emitter's line cannot be set");
	if (!closed)
		bb_device_event(&s->base.dev, BB_EV_EDGE, now_ns, BB_EYE_NONE, BB_STAGE_EMITTER);
}

static void keep_gate(struct shutter_gpio *s, int64_t now_ns)
{
	const bool safe = safe_for_stereo(s);

	if (s->gate && !safe && s->stereo)
		s->latched_ns = now_ns + LATCH_NS;
	set_gate(s, safe && now_ns >= s->latched_ns, now_ns);
}

/* ---- the bus ---- */

/* 100 ms doubled with every failure, at most 5 s, give or take 20 % so that many devices do not knock together. */
static int64_t backoff_ns(const struct shutter_gpio *s)
{
	const unsigned power = s->failures < 6 ? s->failures : 6;
	const int64_t base_ns = BACKOFF_NS << power < BACKOFF_MOST_NS ? BACKOFF_NS << power : BACKOFF_MOST_NS;
	uint64_t z = s->seed + UINT64_C(0x9E3779B97F4A7C15) * (s->failures + 1); /* splitmix64 */

	z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
	z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
	return base_ns + base_ns / 1000 * ((int64_t)((z ^ (z >> 31)) % 401) - 200);
}

static bool too_often(const struct shutter_gpio *s, int64_t now_ns)
{
	return s->n_reopened >= REOPENS_A_MINUTE &&
	       now_ns - s->reopened_ns[s->n_reopened % REOPENS_A_MINUTE] < 60 * BB_NS_PER_S;
}

static void gone(struct shutter_gpio *s, int64_t now_ns)
{
	const int why = errno;

	if (s->request.out >= 0)
		s->bus->ops->set(s->bus, false); /* it may still listen */
	s->bus->ops->close(s->bus);
	s->bus = NULL;
	s->quarantined = too_often(s, now_ns);
	s->failures = 0;
	s->reopen_ns = s->quarantined ? BB_NEVER : now_ns + backoff_ns(s);
	bb_edge_lock_raise(&s->lock, BB_SYNC_GONE, 1, now_ns);
	errno = why;
	bb_device_fail(&s->base.dev, BB_ERR_LOST, "read", "GONE %s: %s; is the chip plugged in?", s->request.chip,
	               strerror(why));
}

static void pump(struct shutter_gpio *s, int64_t now_ns)
{
	struct bb_line_event events[AT_ONCE];
	struct bb_shutter_edge edge;
	enum bb_status status = BB_OK;
	size_t n;

	for (int turn = 0; s->bus && turn < 32; turn++) { /* a chip gone mad does not hold the frame loop */
		status = s->bus->ops->read(s->bus, events, AT_ONCE, &n);
		if (status != BB_OK)
			break;
		for (size_t i = 0; i < n; i++)
			if (bb_edge_lock_event(&s->lock, &events[i], now_ns, &edge) && s->stereo)
				report(s, &edge);
	}
	if (status < 0)
		gone(s, now_ns);
}

static void try_again(struct shutter_gpio *s, int64_t now_ns)
{
	struct bb_error err = { 0 };

	if (s->opener->open(s->opener->ctx, &s->request, s->base.dev.clk, &s->bus, &err) != BB_OK) {
		s->failures++;
		s->reopen_ns = now_ns + backoff_ns(s);
		bb_device_fail(&s->base.dev, BB_ERR_LOST, "reopen", "%.90s", err.text);
		return;
	}
	s->failures = 0;
	s->reopened_ns[s->n_reopened++ % REOPENS_A_MINUTE] = now_ns;
	s->gate = false; /* as the line begins */
	bb_edge_lock_reopened(&s->lock);
	bb_edge_lock_clear(&s->lock, BB_SYNC_GONE, now_ns);
}

static int64_t wake_ns(const struct shutter_gpio *s)
{
	int64_t at_ns = bb_edge_lock_wake_ns(&s->lock);

	if (!s->bus && s->reopen_ns < at_ns)
		at_ns = s->reopen_ns;
	if (s->bus && s->stereo && !s->gate && safe_for_stereo(s) && s->latched_ns < at_ns)
		at_ns = s->latched_ns;
	if (s->bus && at_ns == BB_NEVER) /* lost: look whether anything came */
		at_ns = bb_clock_now_ns(s->base.dev.clk) + BACKOFF_NS;
	return at_ns;
}

/* Everything this device does at a time: takes what came, notices what did not, knocks, sets the gate. */
static void turn(struct shutter_gpio *s, int64_t now_ns)
{
	if (!s->bus && now_ns >= s->reopen_ns)
		try_again(s, now_ns);
	pump(s, now_ns);
	bb_edge_lock_pass(&s->lock, now_ns);
	tell(s, now_ns);
	keep_gate(s, now_ns);
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct shutter_gpio *s = bb_container_of(timer, struct shutter_gpio, timer);

	(void)scheduled_ns;
	turn(s, now_ns);
	return wake_ns(s);
}

/* ---- ops ---- */

static enum bb_status bad(struct bb_shutter *sh, const struct bb_open *open, enum bb_status status,
                          const struct bb_error *err)
{
	const int why = errno;

	bb_log(open->log, BB_LOG_ERROR, status == BB_ERR_CONFIG ? BB_BLAME_CONFIG : BB_BLAME_DEVICE, sh->dev.id, "%s",
	       err->text);
	errno = why;
	return bb_device_fail(&sh->dev, status, "open", "%.90s", err->text);
}

static enum bb_status read_uri(struct options *o, struct bb_line_request *r, const struct bb_uri *uri,
                               struct bb_error *err)
{
	bb_options_defaults(option_table, o);
	for (size_t i = 0; i < uri->n_options; i++) {
		const enum bb_status status =
			bb_options_set(option_table, o, uri->option[i].key, uri->option[i].value, NULL, err);
		if (status != BB_OK)
			return status;
	}
	if (o->line < 0 || uri->path[0] != '/')
		return bb_fail(err, BB_ERR_CONFIG, 1543, NULL, "'%s:%s' names no %s", uri->scheme, uri->path,
		               o->line < 0 ? "line" : "chip");
	if (o->out == o->line)
		return bb_fail(err, BB_ERR_CONFIG, 1543, NULL, "line and out are both %lld", (long long)o->line);
	memcpy(r->chip, uri->path, sizeof(r->chip));
	r->line = (uint32_t)o->line;
	r->out = (int32_t)o->out;
	r->active_low = o->active_low;
	r->bias = (unsigned)o->bias;
	return BB_OK;
}

static enum bb_status check_config(struct bb_shutter *sh)
{
	const struct bb_shutter_config *c = &sh->config;
	const struct bb_shutter_limits *l = &sh->limits;
	const int64_t period_ns = c->rate.num && c->rate.den ? bb_rate_period_ns(c->rate) : 0;

	if (c->n_stages < 0 || c->n_stages > BB_STAGES_MAX)
		return bb_device_fail(&sh->dev, BB_ERR_CONFIG, "open", "%lld stages", (long long)c->n_stages);
	if (period_ns < l->least_period_ns || period_ns > l->most_period_ns)
		return bb_device_fail(&sh->dev, BB_ERR_RANGE, "open", "a period of %lld ns", (long long)period_ns);
	if (!(bb_cell_moves(&c->cell) && bb_cell_moves(&c->glasses) && c->emitter_offset_us >= 0 &&
	      c->emitter_offset_us < 1e6))
		return bb_device_fail(&sh->dev, BB_ERR_RANGE, "open", "a delay out of range");
	return BB_OK;
}

static enum bb_status open_on(struct bb_shutter *sh, const struct bb_open *open, const struct bb_line_opener *opener)
{
	struct shutter_gpio *s = own(sh);
	struct bb_error err = { 0 };
	struct options o;

	sh->limits = (struct bb_shutter_limits){ .least_period_ns = 5000000, .most_period_ns = 25000000,
		                                 .stamp_error_ns = STAMP_ERROR_NS };
	enum bb_status status = check_config(sh);
	if (status != BB_OK)
		return status;
	sh->limits.open_ns = llround(sh->config.cell.open_us * 1000);
	sh->limits.close_ns = llround(sh->config.cell.close_us * 1000);
	status = read_uri(&o, &s->request, open->uri, &err);
	if (status != BB_OK)
		return bad(sh, open, status, &err);
	s->request.n_buffer = 4 * (uint32_t)ceil(bb_rate_hz(sh->config.rate)); /* 4 s of edges */
	s->opener = opener ? opener : o.api ? &bb_line_gpiod : &bb_line_uapi2;
	s->offset_ns = llround(sh->config.emitter_offset_us * 1000);
	s->seed = open->seed;
	s->reopen_ns = BB_NEVER;
	s->timer = (struct bb_timer){ .step = step, .rank = 1 };
	status = s->opener->open(s->opener->ctx, &s->request, open->clk, &s->bus, &err);
	if (status != BB_OK)
		return bad(sh, open, status, &err);
	bb_edge_lock_init(&s->lock, sh->config.rate, o.holdover_ppm, bb_clock_now_ns(open->clk));
	status = bb_clock_arm(open->clk, &s->timer, wake_ns(s));
	if (status != BB_OK)
		s->bus->ops->close(s->bus);
	return status;
}

static enum bb_status gpio_open(struct bb_shutter *sh, const struct bb_open *open)
{
	return open_on(sh, open, NULL);
}

static enum bb_status gpio_open_given(struct bb_shutter *sh, const struct bb_open *open)
{
	return open_on(sh, open, open->world);
}

static void gpio_close(struct bb_shutter *sh)
{
	struct shutter_gpio *s = own(sh);

	bb_clock_disarm(sh->dev.clk, &s->timer);
	s->gate = true; /* whatever it is: low now, and recorded */
	set_gate(s, false, bb_clock_now_ns(sh->dev.clk));
	if (s->bus)
		s->bus->ops->close(s->bus);
}

static enum bb_status gpio_read(struct bb_shutter *sh, struct bb_shutter_edge *edges, size_t cap, size_t *n_out)
{
	struct shutter_gpio *s = own(sh);
	const int64_t now_ns = bb_clock_now_ns(sh->dev.clk);

	turn(s, now_ns);
	if (bb_clock_arm(sh->dev.clk, &s->timer, wake_ns(s)) != BB_OK)
		return BB_ERR_NOMEM;
	while (*n_out < cap && s->n_queued && s->queue[s->head].at_ns <= now_ns) {
		edges[(*n_out)++] = s->queue[s->head];
		s->head = (s->head + 1) % QUEUE;
		s->n_queued--;
	}
	if (*n_out)
		return BB_OK;
	return !s->bus || s->lock.lost ? BB_ERR_LOST : BB_TIMEOUT;
}

static enum bb_status gpio_set_phase(struct bb_shutter *sh, uint8_t stage, int64_t delay_ns, uint32_t duty_ppm)
{
	const struct shutter_gpio *s = own(sh);

	if (!s->bus)
		return BB_ERR_LOST;
	if (stage == BB_STAGE_EMITTER && delay_ns == s->offset_ns && duty_ppm == 1000000)
		return BB_OK; /* as it is */
	errno = 0;
	return bb_device_fail(&sh->dev, BB_ERR_UNSUPPORTED, "set_phase", "a sync line has no phase to set");
}

static enum bb_status gpio_set_mode(struct bb_shutter *sh, enum bb_shutter_mode mode)
{
	struct shutter_gpio *s = own(sh);
	const int64_t now_ns = bb_clock_now_ns(sh->dev.clk);

	if (mode == BB_SHUTTER_OPEN && s->quarantined) { /* the manual act that ends it */
		s->quarantined = false;
		s->n_reopened = 0;
		s->reopen_ns = now_ns;
	}
	if (!s->bus && mode == BB_SHUTTER_STEREO)
		return BB_ERR_LOST;
	turn(s, now_ns); /* what came before belongs to the old mode */
	s->stereo = mode == BB_SHUTTER_STEREO;
	keep_gate(s, now_ns);
	if (!s->stereo)
		s->n_queued = 0;
	return bb_clock_arm(sh->dev.clk, &s->timer, wake_ns(s));
}

static const struct bb_shutter_ops ops = { gpio_open, gpio_close, gpio_read, gpio_set_phase, gpio_set_mode };
const struct bb_shutter_driver bb_shutter_gpio_driver = { "gpio", sizeof(struct shutter_gpio), &ops };

enum bb_status bb_shutter_gpio_open_on(const struct bb_line_opener *opener, const struct bb_shutter_config *config,
                                       const struct bb_open *open, struct bb_shutter **out)
{
	static const struct bb_shutter_ops given = { gpio_open_given, gpio_close, gpio_read, gpio_set_phase,
		                                     gpio_set_mode };
	static const struct bb_shutter_driver driver = { "gpio", sizeof(struct shutter_gpio), &given };
	union { /* world is how an open() of ours gets what no URI says; it is not written to */
		const struct bb_line_opener *opener;
		void *world;
	} via = { opener };
	struct bb_open with = *open;

	with.world = via.world;
	return bb_shutter_open(&driver, config, &with, out);
}

const struct bb_edge_lock *bb_shutter_gpio_lock(const struct bb_shutter *sh)
{
	return &look(sh)->lock;
}

enum bb_health bb_shutter_gpio_health(const struct bb_shutter *sh)
{
	return look(sh)->health;
}

bool bb_shutter_gpio_gate(const struct bb_shutter *sh)
{
	return look(sh)->gate;
}

uint64_t bb_shutter_gpio_dropped(const struct bb_shutter *sh)
{
	return look(sh)->dropped;
}

int bb_shutter_gpio_fd(const struct bb_shutter *sh)
{
	return look(sh)->bus ? look(sh)->bus->fd : -1;
}
