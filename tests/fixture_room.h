/*
 * tests/fixture_room.h: a small room built by hand, a rig of clock, log and world around it, and openers of its sims.
 * Header only, because a test links one object of its own.
 */
#ifndef BB_TESTS_FIXTURE_ROOM_H
#define BB_TESTS_FIXTURE_ROOM_H

#include <setjmp.h>
#include <stdarg.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sim/sim.h"

#define MS INT64_C(1000000)
#define US INT64_C(1000)
#define FIX_CAMERAS 4
#define FIX_NODES 3
#define FIX_SCREENS 3

struct fixture_room {
	struct bb_room room;
	struct bb_node nodes[FIX_NODES];
	struct bb_screen screens[FIX_SCREENS];
	struct bb_camera_config cameras[FIX_CAMERAS];
	struct bb_monitor_config monitors[1];
};

static inline struct bb_camera_config fixture_camera(const char *id, struct bb_vec3 at, struct bb_vec3 target)
{
	struct bb_camera_config c = { .width_px = 640, .height_px = 480, .fov_deg = 70, .k1 = -0.12, .k2 = 0.02,
		                      .rate = { 60, 1 }, .sync = BB_SYNC_SHUTTERS, .sync_offset_us = 500,
		                      .exposure_us = 800, .readout_us = 2000, .transfer_us = 1500,
		                      .transfer_jitter_us = 300, .noise_px = 0.05 };
	const struct bb_pose looking = bb_pose_look_at(at, target, (struct bb_vec3){ 0, 1, 0 });
	const struct bb_pose turned = { { 0, 0, 0 }, { 1, 0, 0, 0 } }; /* -Z, +Y up to +Z, +Y down */

	snprintf(c.id, sizeof(c.id), "%s", id);
	snprintf(c.device, sizeof(c.device), "sim:");
	c.pose = bb_pose_mul(&looking, &turned);
	c.fx_px = c.fy_px = (double)c.width_px / 2 / tan(c.fov_deg * 3.14159265358979323846 / 360);
	c.cx_px = ((double)c.width_px - 1) / 2;
	c.cy_px = ((double)c.height_px - 1) / 2;
	return c;
}

static inline struct bb_shutter_config fixture_chain(void)
{
	struct bb_shutter_config c = { .id = "chain", .device = "sim:", .rate = { 120, 1 }, .n_stages = 3,
		                       .stage = { "front", "left", "right" }, .stage_delay_us = 35,
		                       .rate_error_ppm = 12, .jitter_us = 2, .cell = { 1800, 300, 500, 30 },
		                       .glasses = { 1800, 300, 500, 30 },
		                       .emitter_offset_us = 3000 };
	return c;
}

static inline void fixture_displays(struct fixture_room *f)
{
	static const char *const ids[FIX_SCREENS] = { "front", "left", "desk" };

	for (size_t i = 0; i < FIX_SCREENS; i++) {
		struct bb_screen *s = &f->screens[i];
		snprintf(s->id, sizeof(s->id), "%s", ids[i]);
		s->node = (uint16_t)(i < 2 ? i + 1 : 0);
		s->display = (struct bb_display_config){ .rate = { 120, 1 },
			                                 .genlock = i < 2,
			                                 .rate_error_ppm = (double)NAN,
			                                 .width_px = 1400,
			                                 .height_px = 1050 };
		snprintf(s->display.id, sizeof(s->display.id), "%s", ids[i]);
	}
	f->screens[2].display.rate = (struct bb_rate){ 60000, 1001 };
}

static inline void fixture_room_init(struct fixture_room *f)
{
	static const char *const nodes[FIX_NODES] = { "head", "front", "left" };
	const struct bb_vec3 at[FIX_CAMERAS] = {
		{ -1.2, 2.4, -1.2 }, { 1.2, 2.4, -1.2 }, { -1.2, 2.4, 1.2 }, { 1.2, 2.4, 1.2 }
	};
	struct bb_room *r = &f->room;

	memset(f, 0, sizeof(*f));
	snprintf(r->name, sizeof(r->name), "fixture");
	r->neutral = (struct bb_vec3){ 0, 1.6, 0 };
	r->eye_separation_m = 0.063;
	r->has_chain = true;
	r->chain = fixture_chain();
	r->n_nodes = FIX_NODES;
	r->nodes = f->nodes;
	for (size_t i = 0; i < FIX_NODES; i++)
		snprintf(f->nodes[i].id, sizeof(f->nodes[i].id), "%s", nodes[i]);
	f->nodes[0].head = true;
	r->n_cameras = FIX_CAMERAS;
	r->cameras = f->cameras;
	for (size_t i = 0; i < FIX_CAMERAS; i++) {
		char id[BB_ID_MAX];
		snprintf(id, sizeof(id), "c%zu", i + 1);
		f->cameras[i] = fixture_camera(id, at[i], (struct bb_vec3){ 0, 1.5, 0 });
	}
	r->n_screens = FIX_SCREENS;
	r->screens = f->screens;
	fixture_displays(f);
	r->n_monitors = 1;
	r->monitors = f->monitors;
	snprintf(f->monitors[0].id, sizeof(f->monitors[0].id), "front-m");
	r->n_bodies = 1;
	r->bodies[0] = (struct bb_body){ .id = "glasses",
		                         .n_markers = 5,
		                         .eye_centre = { 0.070, 0, 0.01 },
		                         .marker = { { 0, 0, 0 },
		                                     { 0.141, 0.004, -0.008 },
		                                     { 0.070, 0.032, 0.005 },
		                                     { 0.018, 0.025, -0.030 },
		                                     { 0.120, 0.027, -0.034 } } };
	r->link = (struct bb_link_config){ .id = "net", .device = "sim:", .n_nodes = FIX_NODES, .delay_us = 40,
		                           .jitter_us = 10, .loss_ppm = 0 };
}

/* Clock, event log (all bytes kept) and world. */
struct rig {
	struct fixture_room fix;
	struct bb_clock *clk;
	struct bb_eventlog *log;
	struct bb_event *event;
	size_t n_events, cap_events;
	struct sim_world *world;
	struct bb_uri uri;
	uint64_t seed;
	int fidelity;
};

static inline void rig_sink(void *ctx, const struct bb_event *events, size_t n)
{
	struct rig *r = ctx;

	if (r->n_events + n > r->cap_events) {
		r->cap_events = 2 * (r->n_events + n);
		r->event = realloc(r->event, r->cap_events * sizeof(*r->event));
		assert_non_null(r->event);
	}
	memcpy(&r->event[r->n_events], events, n * sizeof(*events));
	r->n_events += n;
}

static inline void rig_world(struct rig *r, uint64_t seed, int fidelity)
{
	if (!r->clk) /* a test may have brought its own */
		assert_int_equal(bb_clock_virtual_create(&r->clk), BB_OK);
	r->log = malloc(sizeof(*r->log));
	assert_non_null(r->log);
	bb_eventlog_init(r->log, rig_sink, r);
	r->seed = seed;
	r->fidelity = fidelity;
	snprintf(r->uri.scheme, sizeof(r->uri.scheme), "sim");
	assert_int_equal(sim_world_create(&r->fix.room, NULL, NULL, r->clk, r->log, seed, &r->world), BB_OK);
}

static inline void rig_init(struct rig *r, uint64_t seed, int fidelity)
{
	memset(r, 0, sizeof(*r));
	fixture_room_init(&r->fix);
	rig_world(r, seed, fidelity);
}

static inline void rig_done(struct rig *r)
{
	sim_world_destroy(r->world);
	bb_clock_destroy(r->clk);
	free(r->log);
	free(r->event);
}

static inline struct bb_open rig_open(struct rig *r)
{
	return (struct bb_open){ .clk = r->clk, .events = r->log, .uri = &r->uri, .seed = r->seed,
		                 .fidelity = r->fidelity, .world = r->world };
}

static inline void rig_run(struct rig *r, int64_t for_ns)
{
	bb_clock_run_until(r->clk, bb_clock_now_ns(r->clk) + for_ns);
}

static inline void rig_option(struct rig *r, const char *key, const char *value)
{
	const size_t i = r->uri.n_options++;

	snprintf(r->uri.option[i].key, sizeof(r->uri.option[i].key), "%s", key);
	snprintf(r->uri.option[i].value, sizeof(r->uri.option[i].value), "%s", value);
}

/* Set (or clear) a fault now, by its text after "at TIME CLASS/ID ". */
static inline void rig_fault(struct rig *r, const char *target, const char *verb_and_args, bool on)
{
	const struct sim_verb *verbs = NULL;
	struct sim_fault f;
	struct bb_error err = { 0 };
	char text[160];

	snprintf(text, sizeof(text), "at 0s %s %s", target, verb_and_args);
	if (sim_fault_parse(text, &f, NULL, &err) != BB_OK)
		fail_msg("%s", err.text);
	void *device = sim_world_find(r->world, f.class_name, f.id, &verbs);
	assert_non_null(device);
	for (; verbs->name; verbs++)
		if (!strcmp(verbs->name, f.verb)) {
			assert_int_equal(verbs->apply(device, &f.args, on, &err), BB_OK);
			return;
		}
	fail_msg("no verb %s", f.verb);
}

static inline struct bb_camera *rig_camera(struct rig *r, size_t i)
{
	const struct bb_open open = rig_open(r);
	struct bb_camera *cam = NULL;

	assert_int_equal(bb_camera_open(&sim_camera_driver, &r->fix.cameras[i], &open, &cam), BB_OK);
	return cam;
}

static inline struct bb_shutter *rig_shutter(struct rig *r)
{
	const struct bb_open open = rig_open(r);
	struct bb_shutter *sh = NULL;

	assert_int_equal(bb_shutter_open(&sim_shutter_driver, &r->fix.room.chain, &open, &sh), BB_OK);
	return sh;
}

static inline struct bb_display *rig_display(struct rig *r, size_t i)
{
	const struct bb_open open = rig_open(r);
	struct bb_display *d = NULL;

	assert_int_equal(bb_display_open(&sim_display_driver, &r->fix.screens[i].display, &open, &d), BB_OK);
	return d;
}

static inline struct bb_link *rig_link(struct rig *r)
{
	const struct bb_open open = rig_open(r);
	struct bb_link *l = NULL;

	assert_int_equal(bb_link_open(&sim_link_driver, &r->fix.room.link, &open, &l), BB_OK);
	return l;
}

#endif
