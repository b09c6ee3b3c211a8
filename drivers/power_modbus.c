/*
 * drivers/power_modbus.c: the class's face of a strip on Modbus, and the thread that does the talking. What both sides
 * touch stands in struct shared, under one lock that is never held during a wait. See drivers/power_modbus.h.
 */
#include "drivers/power_modbus.h"

#include "drivers/modbus_strip.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <time.h>

#define MS INT64_C(1000000)
#define CURRENT_ERROR_A 0.05
#define STRIP_FUSE_A 16.0

struct shared {
	bool stop;
	struct {
		bool asked, on, told;    /* told: a command was given since open */
		int64_t at_ns;
	} ask[BB_OUTLETS_MAX];
	struct bb_outlet_state state[BB_OUTLETS_MAX];
	struct power_modbus_report report;
	bool up;
};

struct power_modbus {
	struct bb_power base;
	struct modbus_map map;
	struct bus_modbus *bus;
	struct modbus_strip strip;   /* the thread's */
	pthread_t thread;
	pthread_mutex_t lock;
	pthread_cond_t wake;
	struct shared shared;        /* under lock */
	bool seen[BB_OUTLETS_MAX], closed[BB_OUTLETS_MAX]; /* contacts the event log knows of */
};

static struct power_modbus *of(struct bb_power *p)
{
	return bb_container_of(p, struct power_modbus, base);
}

const char *power_modbus_fault_text(enum power_modbus_fault fault)
{
	static const char *const text[] = {
#define X(name, word) word,
		POWER_MODBUS_FAULTS(X)
#undef X
	};
	return (size_t)fault < BB_ARRAY_LEN(text) ? text[fault] : "unknown";
}

/* ---- the thread ---- */

static void publish(struct power_modbus *pm)
{
	for (size_t i = 0; i < pm->base.config.n_outlets; i++)
		pm->shared.state[i] = pm->strip.outlet[i].state;
	pm->shared.report = pm->strip.report;
	pm->shared.up = bus_modbus_up(pm->bus) && pm->strip.identified;
}

static void take_asks(struct power_modbus *pm)
{
	for (size_t i = 0; i < pm->base.config.n_outlets; i++) {
		if (!pm->shared.ask[i].asked)
			continue;
		pm->shared.ask[i].asked = false;
		modbus_strip_ask(&pm->strip, i, pm->shared.ask[i].on, pm->shared.ask[i].at_ns);
	}
}

static bool asked(const struct power_modbus *pm)
{
	for (size_t i = 0; i < pm->base.config.n_outlets; i++)
		if (pm->shared.ask[i].asked)
			return true;
	return false;
}

/* Under the lock. Until wake_ns, a command or the end; stop and asks are looked at again by the caller. */
static void wait_until(struct power_modbus *pm, int64_t wake_ns)
{
	const int64_t wait_ns = wake_ns - bb_clock_now_ns(pm->base.dev.clk);

	if (wake_ns == BB_NEVER) {
		pthread_cond_wait(&pm->wake, &pm->lock);
	} else if (wait_ns > 0) {
		const int64_t abs_ns = bb_clock_stopwatch_ns() + wait_ns; /* the same CLOCK_MONOTONIC as the condition's */
		const struct timespec t = { abs_ns / BB_NS_PER_S, abs_ns % BB_NS_PER_S };
		pthread_cond_timedwait(&pm->wake, &pm->lock, &t);
	}
}

static void *talk(void *arg)
{
	struct power_modbus *pm = arg;

	pthread_mutex_lock(&pm->lock);
	while (!pm->shared.stop) {
		take_asks(pm);
		pthread_mutex_unlock(&pm->lock);
		const int64_t wake_ns = modbus_strip_step(&pm->strip);
		pthread_mutex_lock(&pm->lock);
		publish(pm);
		if (!pm->shared.stop && !asked(pm))
			wait_until(pm, wake_ns);
	}
	pthread_mutex_unlock(&pm->lock);
	return NULL;
}

/* Signals are for the thread that runs the program. */
static int start_thread(struct power_modbus *pm)
{
	sigset_t all, before;

	sigfillset(&all);
	pthread_sigmask(SIG_SETMASK, &all, &before);
	const int why = pthread_create(&pm->thread, NULL, talk, pm);
	pthread_sigmask(SIG_SETMASK, &before, NULL);
	return why;
}

static void init_lock(struct power_modbus *pm)
{
	pthread_condattr_t monotonic;

	pthread_mutex_init(&pm->lock, NULL);
	pthread_condattr_init(&monotonic);
	pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
	pthread_cond_init(&pm->wake, &monotonic);
	pthread_condattr_destroy(&monotonic);
}

/* ---- ops ---- */

/* Connects, asks who it is and reads everything once, on the opener's thread: bring-up may wait. */
static enum bb_status first_contact(struct power_modbus *pm)
{
	const int64_t end_ns = bb_clock_now_ns(pm->base.dev.clk) + 3 * pm->strip.pace.most_ns;

	for (;;) {
		const int64_t wake_ns = modbus_strip_step(&pm->strip);
		const struct power_modbus_report *r = &pm->strip.report;
		if (r->health == BB_HEALTH_QUARANTINED)
			return BB_OK; /* it opens, refuses every write, and says why */
		if (!bus_modbus_up(pm->bus))
			return bb_device_fail(&pm->base.dev, BB_ERR_LOST, "open", "%s: %s",
			                      power_modbus_fault_text(r->fault), r->text);
		if (pm->strip.identified && wake_ns > bb_clock_now_ns(pm->base.dev.clk))
			return BB_OK;
		if (bb_clock_now_ns(pm->base.dev.clk) > end_ns)
			return bb_device_fail(&pm->base.dev, BB_ERR_IO, "open", "%s: %s", power_modbus_fault_text(r->fault),
			                      r->text);
	}
}

static enum bb_status open_link(struct power_modbus *pm, const struct bb_open *open)
{
	struct bus_modbus_config link;
	struct bb_error err = { 0 };
	enum bb_status status = modbus_map_read(open->uri, &pm->base.config, &pm->map, &err);

	if (status == BB_OK)
		status = modbus_map_link(open->uri, &pm->base.config, &pm->map, &link, &err);
	if (status != BB_OK) {
		bb_log(open->log, BB_LOG_ERROR, BB_BLAME_CONFIG, pm->base.config.id, "%s", err.text);
		return bb_device_fail(&pm->base.dev, status, "open", "%s", err.text);
	}
	return bus_modbus_create(&link, open->clk, &pm->bus);
}

static enum bb_status modbus_open(struct bb_power *p, const struct bb_open *open)
{
	struct power_modbus *pm = of(p);
	uint64_t seed = open->seed + 1;

	if (bb_clock_is_virtual(open->clk))
		return bb_device_fail(&p->dev, BB_ERR_UNSUPPORTED, "open", "a real wire needs the posix clock");
	enum bb_status status = open_link(pm, open);
	if (status != BB_OK)
		return status;
	for (const char *c = p->config.id; *c; c++)
		seed = seed * 31 + (uint64_t)*c;
	modbus_strip_init(&pm->strip, &p->config, &pm->map, pm->bus, open->clk, seed);
	p->limits = (struct bb_power_limits){ .settle_ns = pm->map.relay_ms * MS + 3 * pm->map.timeout_most_ms * MS,
		                              .current_error_a = CURRENT_ERROR_A,
		                              .most_total_a = STRIP_FUSE_A };
	status = first_contact(pm);
	if (status == BB_OK) {
		init_lock(pm);
		publish(pm);
		if (start_thread(pm) == 0)
			return BB_OK;
		pthread_cond_destroy(&pm->wake);
		pthread_mutex_destroy(&pm->lock);
		status = BB_ERR_NOMEM;
	}
	bb_log(open->log, BB_LOG_ERROR, BB_BLAME_DEVICE, p->config.id, "%s", p->dev.last_error.detail);
	bus_modbus_destroy(pm->bus);
	return status;
}

static void modbus_close_strip(struct bb_power *p)
{
	struct power_modbus *pm = of(p);

	pthread_mutex_lock(&pm->lock);
	pm->shared.stop = true;
	pthread_cond_signal(&pm->wake);
	pthread_mutex_unlock(&pm->lock);
	pthread_join(pm->thread, NULL); /* at most one exchange away */
	pthread_cond_destroy(&pm->wake);
	pthread_mutex_destroy(&pm->lock);
	bus_modbus_destroy(pm->bus);
}

static void note_error(struct power_modbus *pm, const char *op, const struct power_modbus_report *r)
{
	errno = 0;
	if (r->fault != POWER_MODBUS_FINE)
		bb_device_fail(&pm->base.dev, BB_ERR_IO, op, "%s: %s", power_modbus_fault_text(r->fault), r->text);
}

static enum bb_status modbus_set(struct bb_power *p, size_t index, bool on)
{
	struct power_modbus *pm = of(p);
	const long long outlet = (long long)p->config.outlet[index].outlet;

	if (pm->map.id_at < 0)
		return bb_device_fail(&p->dev, BB_ERR_REFUSED, "set", "outlet %lld: read only, the URI names no identity (id_at, id)",
		                      outlet);
	pthread_mutex_lock(&pm->lock);
	const struct power_modbus_report report = pm->shared.report;
	const bool up = pm->shared.up, banned = report.health == BB_HEALTH_QUARANTINED;
	if (up && !banned) {
		pm->shared.ask[index].asked = pm->shared.ask[index].told = true;
		pm->shared.ask[index].on = on;
		pm->shared.ask[index].at_ns = bb_clock_now_ns(p->dev.clk);
		pthread_cond_signal(&pm->wake);
	}
	pthread_mutex_unlock(&pm->lock);
	if (banned)
		return bb_device_fail(&p->dev, BB_ERR_REFUSED, "set", "%s: %s", power_modbus_fault_text(report.fault),
		                      report.text);
	return up ? BB_OK : bb_device_fail(&p->dev, BB_ERR_IO, "set", "%s: %s", power_modbus_fault_text(report.fault),
	                                   report.text);
}

static enum bb_status modbus_read(struct bb_power *p, size_t index, struct bb_outlet_state *out)
{
	struct power_modbus *pm = of(p);

	pthread_mutex_lock(&pm->lock);
	const struct power_modbus_report report = pm->shared.report;
	*out = pm->shared.state[index];
	if (pm->shared.ask[index].told)
		out->commanded = pm->shared.ask[index].on;
	pthread_mutex_unlock(&pm->lock);
	note_error(pm, "read", &report);
	if (!out->known) {
		out->closed = false;
		out->current_a = 0;
		out->at_ns = bb_clock_now_ns(p->dev.clk);
	} else if (!pm->seen[index] || pm->closed[index] != out->closed) {
		if (pm->seen[index])
			bb_device_event(&p->dev, BB_EV_OUTLET, out->at_ns, p->config.outlet[index].outlet, out->closed);
		pm->seen[index] = true;
		pm->closed[index] = out->closed;
	}
	return BB_OK;
}

void power_modbus_report(struct bb_power *p, struct power_modbus_report *out)
{
	struct power_modbus *pm = of(p);

	pthread_mutex_lock(&pm->lock);
	*out = pm->shared.report;
	pthread_mutex_unlock(&pm->lock);
}

static const struct bb_power_ops ops = { modbus_open, modbus_close_strip, modbus_set, modbus_read };
const struct bb_power_driver power_modbus_driver = { "modbus", sizeof(struct power_modbus), &ops };
