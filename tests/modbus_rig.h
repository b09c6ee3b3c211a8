/*
 * tests/modbus_rig.h: a power strip on a wire in this process: sim/peer_modbus.c behind a loopback port or a pty, served
 * by a thread of its own, as the driver blocks in libmodbus. What a test does to the peer, it does between lock and
 * unlock. Real time: waits are short here and budgets are asserted at five times their length.
 */
#ifndef BB_TESTS_MODBUS_RIG_H
#define BB_TESTS_MODBUS_RIG_H

#include "drivers/power_modbus.h"
#include "sim/peer_modbus.h"

#include <setjmp.h>
#include <stdarg.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define WIRE_MS INT64_C(1000000)

struct modbus_rig {
	struct bb_clock *clk;
	struct sim_wire *wire;
	struct peer_modbus peer;
	struct peer_modbus_handle handle;
	pthread_t thread;
	pthread_mutex_t lock;
	bool stop;
	char path[96];           /* "tcp://127.0.0.1:40123" or "rtu:/dev/pts/7" */
	char device[256];
	struct bb_uri uri;
	struct bb_open open;
};

static inline void *modbus_rig_serve(void *arg)
{
	struct modbus_rig *r = arg;

	for (bool stop = false; !stop;) {
		sim_wire_wait(r->wire, 10 * WIRE_MS);
		pthread_mutex_lock(&r->lock);
		sim_wire_serve(r->wire);
		stop = r->stop;
		pthread_mutex_unlock(&r->lock);
	}
	return NULL;
}

static inline struct modbus_rig *modbus_rig_create(const struct bb_power_config *config, bool rtu)
{
	struct modbus_rig *r = calloc(1, sizeof(*r));
	struct bb_error err = { 0 };
	char pty[64];
	uint16_t port = 0;

	assert_non_null(r);
	assert_int_equal(bb_clock_posix_create(&r->clk), BB_OK);
	assert_int_equal(sim_wire_create(r->clk, &r->wire), BB_OK);
	peer_modbus_init(&r->peer, config, 1, bb_clock_now_ns(r->clk));
	r->handle = (struct peer_modbus_handle){ &r->peer, r->clk };
	if (rtu) {
		assert_int_equal(sim_wire_pty(r->wire, &peer_modbus_rtu, &r->peer, pty, sizeof(pty), &err), BB_OK);
		snprintf(r->path, sizeof(r->path), "rtu:%s", pty);
	} else {
		const struct sim_wire_listen at = { "127.0.0.1", 0, NULL };
		assert_int_equal(sim_wire_tcp(r->wire, &at, &peer_modbus_tcp, &r->peer, &port, &err), BB_OK);
		snprintf(r->path, sizeof(r->path), "tcp://127.0.0.1:%u", port);
	}
	pthread_mutex_init(&r->lock, NULL);
	assert_int_equal(pthread_create(&r->thread, NULL, modbus_rig_serve, r), 0);
	return r;
}

static inline void modbus_rig_destroy(struct modbus_rig *r)
{
	pthread_mutex_lock(&r->lock);
	r->stop = true;
	pthread_mutex_unlock(&r->lock);
	pthread_join(r->thread, NULL);
	pthread_mutex_destroy(&r->lock);
	sim_wire_destroy(r->wire);
	bb_clock_destroy(r->clk);
	free(r);
}

static inline void modbus_rig_pass(struct modbus_rig *r, int64_t for_ns)
{
	bb_clock_run_until(r->clk, bb_clock_now_ns(r->clk) + for_ns);
}

/* Opens the driver on the peer; options begin with '&' or are "". */
static inline enum bb_status modbus_rig_open(struct modbus_rig *r, const struct bb_power_config *config,
                                             const char *options, struct bb_power **out)
{
	struct bb_error err = { 0 };

	snprintf(r->device, sizeof(r->device), "modbus:%s?unit=1%s", r->path, options);
	assert_int_equal(bb_uri_parse(r->device, &r->uri, NULL, &err), BB_OK);
	r->open = (struct bb_open){ .clk = r->clk, .uri = &r->uri, .seed = 7 };
	return bb_power_open(&power_modbus_driver, config, &r->open, out);
}

/* Sets or clears one of the peer's faults by name: modbus_rig_fault(r, "late", "ms", "300", true). */
static inline void modbus_rig_fault(struct modbus_rig *r, const char *verb, const char *key, const char *value, bool on)
{
	struct sim_fault_args args = { .n = key ? 1 : 0 };
	const struct sim_verb *const tables[] = { peer_modbus_verbs, peer_modbus_power_verbs };

	if (key) {
		snprintf(args.arg[0].key, sizeof(args.arg[0].key), "%s", key);
		snprintf(args.arg[0].value, sizeof(args.arg[0].value), "%s", value);
	}
	for (size_t t = 0; t < BB_ARRAY_LEN(tables); t++)
		for (const struct sim_verb *v = tables[t]; v->name; v++)
			if (!strcmp(v->name, verb)) {
				pthread_mutex_lock(&r->lock);
				const enum bb_status status = v->apply(&r->handle, &args, on, NULL);
				pthread_mutex_unlock(&r->lock);
				assert_int_equal(status, BB_OK);
				return;
			}
	fail_msg("no verb %s", verb);
}

#endif
