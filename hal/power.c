/*
 * hal/power.c: argument checks, dispatch, and the guard that keeps hal/safety.h's times for every back end: least off
 * and on times, cycles per hour, stagger between outlets of one strip. It counts from commands and from what reading
 * back shows, and when an answer is missing it assumes the worse of "it happened" and "it did not". ns on the device's
 * clock. See hal/device.h for the pattern.
 */
#include "hal/power_driver.h"

#include <math.h>
#include <stdlib.h>

#define HOUR_NS (3600 * BB_NS_PER_S)

static bool complete(const struct bb_power_ops *o)
{
	return o->open && o->close && o->set && o->read;
}

static bool sane(const struct bb_power_config *c)
{
	const struct bb_safety *s = &c->safety;

	return c->n_outlets <= BB_OUTLETS_MAX && s->outlet_least_off_s >= 0 && s->outlet_least_on_s >= 0 &&
	       s->outlet_cycles_per_hour > 0 && s->outlet_stagger_ms >= 0;
}

/* Beyond thirty years a time is "never" and must not overflow. */
static int64_t ns_of(double seconds)
{
	return (int64_t)(fmin(seconds, 1e9) * 1e9);
}

/* What the outlets are doing before anything was commanded. One that does not answer stays unsure. */
static void learn(struct bb_power *p)
{
	for (size_t i = 0; i < p->config.n_outlets; i++) {
		struct bb_outlet_state state = { 0 };
		if (p->ops->read(p, i, &state) == BB_OK && state.known) {
			p->guard[i].on = state.closed;
			p->guard[i].sure = true;
		}
	}
}

enum bb_status bb_power_open(const struct bb_power_driver *driver, const struct bb_power_config *config,
                             const struct bb_open *open, struct bb_power **out)
{
	*out = NULL;
	if (!complete(driver->ops) || driver->handle_bytes < sizeof(struct bb_power))
		return BB_ERR_USAGE;
	if (!sane(config)) /* a strip without ceilings is refused, not run without them */
		return BB_ERR_CONFIG;
	struct bb_power *p = calloc(1, driver->handle_bytes);
	if (!p)
		return BB_ERR_NOMEM;
	bb_device_init(&p->dev, "power", config->id, open);
	p->ops = driver->ops;
	p->config = *config;
	const enum bb_status status = p->ops->open(p, open);
	if (status != BB_OK) {
		free(p);
		return status;
	}
	learn(p);
	*out = p;
	return BB_OK;
}

void bb_power_close(struct bb_power *p)
{
	if (!p)
		return;
	p->ops->close(p);
	free(p);
}

const struct bb_power_limits *bb_power_limits(const struct bb_power *p)
{
	return &p->limits;
}

struct bb_device *bb_power_device(struct bb_power *p)
{
	return &p->dev;
}

/* The latest of some times, with the words for it. */
struct gate {
	int64_t until_ns;
	const char *why;
};

static void no_earlier(struct gate *gate, int64_t until_ns, const char *why)
{
	if (until_ns > gate->until_ns)
		*gate = (struct gate){ until_ns, why };
}

/* The switch-on that has to leave the hour before another may come. Less than one an hour widens the hour. */
static void cycles_gate(const struct bb_power *p, const struct bb_power_guard *g, struct gate *gate)
{
	const double most = p->config.safety.outlet_cycles_per_hour;
	const size_t n = (size_t)fmax(1, fmin(floor(most), BB_POWER_CYCLES_KEPT));
	const int64_t window_ns = most >= 1 ? HOUR_NS : ns_of(3600 / most);

	if (g->n_cycles >= n)
		no_earlier(gate, g->cycle_ns[(g->n_cycles - n) % BB_POWER_CYCLES_KEPT] + window_ns,
		           "most cycles per hour");
}

static struct gate gate_of(const struct bb_power *p, const struct bb_power_guard *g, bool on)
{
	const struct bb_safety *s = &p->config.safety;
	struct gate gate = { INT64_MIN, "" };

	if (g->on == on && g->sure)
		return gate; /* no contact moves */
	if (on && p->any_on)
		no_earlier(&gate, p->last_on_ns + ns_of(s->outlet_stagger_ms / 1e3), "stagger between outlets");
	if (g->on == on)
		return gate; /* said again because the answer was missing: its times were kept the first time */
	if (g->switched)
		no_earlier(&gate,
		           g->at_ns + p->limits.settle_ns + ns_of(on ? s->outlet_least_off_s : s->outlet_least_on_s),
		           on ? "least off time" : "least on time");
	if (on)
		cycles_gate(p, g, &gate);
	return gate;
}

int64_t bb_power_wait_ns(const struct bb_power *p, size_t index, bool on)
{
	if (index >= p->config.n_outlets)
		return 0;
	const struct gate gate = gate_of(p, &p->guard[index], on);
	const int64_t now_ns = bb_clock_now_ns(p->dev.clk);
	return gate.until_ns > now_ns ? gate.until_ns - now_ns : 0;
}

static void count_cycle(struct bb_power_guard *g, int64_t at_ns)
{
	g->cycle_ns[g->n_cycles++ % BB_POWER_CYCLES_KEPT] = at_ns;
}

/* A command is going out. Whether or not it is acknowledged, it may move the contact now. */
static void note_command(struct bb_power *p, struct bb_power_guard *g, bool on, int64_t now_ns)
{
	if (g->on == on && g->sure)
		return;
	if (g->on != on) {
		g->before_switched = g->switched;
		g->before_ns = g->at_ns;
		if (on)
			count_cycle(g, now_ns);
	} else if (on && g->n_cycles) {
		g->cycle_ns[(g->n_cycles - 1) % BB_POWER_CYCLES_KEPT] = now_ns;
	}
	g->on = on;
	g->switched = true;
	g->at_ns = now_ns;
	if (on) {
		p->any_on = true;
		p->last_on_ns = now_ns;
	}
}

enum bb_status bb_power_set(struct bb_power *p, size_t index, bool on)
{
	if (index >= p->config.n_outlets)
		return BB_ERR_USAGE;
	struct bb_power_guard *g = &p->guard[index];
	const int64_t now_ns = bb_clock_now_ns(p->dev.clk);
	const struct gate gate = gate_of(p, g, on);

	p->dev.ops++;
	if (gate.until_ns > now_ns)
		return bb_device_fail(&p->dev, BB_ERR_REFUSED, "set", "outlet %lld %s: wait %.3f s more (%s)",
		                      (long long)p->config.outlet[index].outlet, on ? "on" : "off",
		                      (double)(gate.until_ns - now_ns) / 1e9, gate.why);
	note_command(p, g, on, now_ns);
	const enum bb_status status = p->ops->set(p, index, on);
	g->sure = status == BB_OK;
	return status;
}

/* The contact is not where the guard thought. */
static void note_read(struct bb_power *p, struct bb_power_guard *g, const struct bb_outlet_state *state)
{
	const bool settling = g->switched && state->at_ns - g->at_ns <= p->limits.settle_ns;

	if (settling)
		return;
	if (state->closed == g->on) {
		g->sure = true;
		return;
	}
	if (g->sure) { /* it moved by itself: its times count from now, when it was seen */
		g->switched = true;
		g->at_ns = state->at_ns;
		if (state->closed)
			count_cycle(g, state->at_ns);
	} else { /* the command was lost: the state before it still holds */
		g->switched = g->before_switched;
		g->at_ns = g->before_ns;
	}
	g->on = state->closed;
	g->sure = true;
}

enum bb_status bb_power_read(struct bb_power *p, size_t index, struct bb_outlet_state *out)
{
	if (!out)
		return BB_ERR_USAGE;
	*out = (struct bb_outlet_state){ 0 };
	if (index >= p->config.n_outlets)
		return BB_ERR_USAGE;
	p->dev.ops++;
	const enum bb_status status = p->ops->read(p, index, out);
	if (status == BB_OK && out->known)
		note_read(p, &p->guard[index], out);
	return status;
}
