/*
 * tests/sim_rig.h: a clock, a bare room, a world and an event log, for tests of one simulated device. The log keeps the
 * last events where a test can read them.
 */
#ifndef BB_TESTS_SIM_RIG_H
#define BB_TESTS_SIM_RIG_H

#include "sim/sim.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#define RIG_MS INT64_C(1000000)
#define RIG_S BB_NS_PER_S

struct rig {
	struct bb_clock *clk;
	struct bb_room room;
	struct bb_screen screen;
	struct bb_node node;
	struct sim_world *world;
	struct bb_eventlog *events;
	struct bb_uri uri;
	struct bb_open open;
	void (*on_event)(void *ctx, const struct bb_event *e); /* set before rig_drain */
	void *ctx;
};

static inline void rig_sink(void *ctx, const struct bb_event *events, size_t n)
{
	struct rig *rig = ctx;

	for (size_t i = 0; rig->on_event && i < n; i++)
		rig->on_event(rig->ctx, &events[i]);
}

/* The clock becomes the rig's. */
static inline struct rig *rig_create_on(struct bb_clock *clk, uint64_t seed, int fidelity)
{
	struct rig *rig = calloc(1, sizeof(*rig));

	assert_non_null(rig);
	rig->clk = clk;
	rig->events = calloc(1, sizeof(*rig->events));
	assert_non_null(rig->events);
	bb_eventlog_init(rig->events, rig_sink, rig);
	strcpy(rig->node.id, "head");
	rig->node.head = true;
	strcpy(rig->screen.id, "front");
	rig->screen.corners = (struct bb_corners){ { -1, 0, -1 }, { 1, 0, -1 }, { -1, 2, -1 } };
	strcpy(rig->screen.display.id, "front");
	rig->screen.display.rate = (struct bb_rate){ 60, 1 };
	rig->screen.display.width_px = 1920;
	rig->screen.display.height_px = 1080;
	rig->room = (struct bb_room){ .n_nodes = 1, .nodes = &rig->node, .n_screens = 1, .screens = &rig->screen,
		                      .eye_separation_m = 0.063, .neutral = { 0, 1.7, 0 }, .degraded_max_s = 1 };
	assert_int_equal(sim_world_create(&rig->room, NULL, NULL, rig->clk, rig->events, seed, &rig->world), BB_OK);
	strcpy(rig->uri.scheme, "sim");
	rig->open = (struct bb_open){ .clk = rig->clk, .events = rig->events, .uri = &rig->uri, .seed = seed,
		                      .fidelity = fidelity, .world = rig->world };
	return rig;
}

static inline struct rig *rig_create(uint64_t seed, int fidelity)
{
	struct bb_clock *clk;

	assert_int_equal(bb_clock_virtual_create(&clk), BB_OK);
	return rig_create_on(clk, seed, fidelity);
}

static inline void rig_destroy(struct rig *rig)
{
	sim_world_destroy(rig->world);
	bb_clock_destroy(rig->clk);
	free(rig->events);
	free(rig);
}

static inline int64_t rig_now(const struct rig *rig)
{
	return bb_clock_now_ns(rig->clk);
}

static inline void rig_pass(struct rig *rig, int64_t for_ns)
{
	bb_clock_run_until(rig->clk, bb_clock_now_ns(rig->clk) + for_ns);
}

/* Sets or clears a fault as the fault machinery would: "outlet=2 state=on". */
static inline enum bb_status rig_fault(struct rig *rig, const char *class_name, const char *id, const char *verb,
                                       const char *args, bool on)
{
	struct sim_fault_args a = { 0 };
	const struct sim_verb *v = NULL;
	void *device = sim_world_find(rig->world, class_name, id, &v);
	char copy[160], *save = NULL;

	assert_non_null(device);
	assert_true(strlen(args) < sizeof(copy));
	strcpy(copy, args);
	for (char *word = strtok_r(copy, " ", &save); word; word = strtok_r(NULL, " ", &save)) {
		char *eq = strchr(word, '=');
		assert_non_null(eq);
		*eq = '\0';
		assert_true(a.n < SIM_FAULT_ARGS_MAX && strlen(word) < 24 && strlen(eq + 1) < 40);
		strcpy(a.arg[a.n].key, word);
		strcpy(a.arg[a.n++].value, eq + 1);
	}
	for (; v->name; v++)
		if (!strcmp(v->name, verb)) {
			const enum bb_status checked = v->apply(NULL, &a, on, NULL);
			return checked != BB_OK ? checked : v->apply(device, &a, on, NULL);
		}
	fail_msg("no verb %s", verb);
	return BB_ERR_INTERNAL;
}

/* Every verb of a table must accept its own example, set and cleared, and refuse an unknown argument. */
static inline void rig_check_verbs(struct rig *rig, const char *class_name, const char *id, const struct sim_verb *v)
{
	for (; v->name; v++) {
		assert_non_null(v->args);
		assert_non_null(v->meaning);
		assert_int_equal(rig_fault(rig, class_name, id, v->name, v->example, true), BB_OK);
		assert_int_equal(rig_fault(rig, class_name, id, v->name, v->example, false), BB_OK);
		assert_int_equal(rig_fault(rig, class_name, id, v->name, "nonsense=1", true), BB_ERR_CONFIG);
	}
}

#endif
