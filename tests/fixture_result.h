/*
 * tests/fixture_result.h: a made-up run of a five-wall cabin, rich enough for every part of a report: 1200 frames at
 * 120 Hz, node/right late for 20 frames at 3 s, camera/c3 covered from 5 s to 7 s, hostile device names. Deterministic.
 */
#ifndef BB_TESTS_FIXTURE_RESULT_H
#define BB_TESTS_FIXTURE_RESULT_H

#include "bench/result.h"

#include <cairo/cairo.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FIXTURE_HOSTILE "c3<script>alert('x')</script>\x1b[31m\xff"

struct fixture {
	struct bb_room room;
	struct bb_scene scene;
	struct bb_node nodes[6];
	struct bb_wall walls[5];
	struct bb_screen screens[5];
	struct bb_camera_config cameras[8];
	struct bb_run_result *result;
	uint64_t random;
};

struct fixture_options {
	bool faults;          /* late node and covered camera */
	size_t n_frames;
	int64_t extra_draw_ns;
	uint64_t extra_bricks;
	const char *picture_dir; /* NULL: no pictures */
};

static inline double fixture_uniform(struct fixture *x)
{
	x->random = x->random * 6364136223846793005u + 1442695040888963407u;
	return (double)(x->random >> 11) / 9007199254740992.0;
}

static inline double fixture_noise(struct fixture *x)
{
	return fixture_uniform(x) + fixture_uniform(x) + fixture_uniform(x) + fixture_uniform(x) - 2;
}

static inline void fixture_room(struct fixture *x)
{
	static const char *const walls[5] = { "front", "left", "right", "back", "floor" };
	struct bb_room *m = &x->room;

	snprintf(m->path, sizeof(m->path), "rooms/cabin.yaml");
	snprintf(m->name, sizeof(m->name), "immersive-cabin");
	memset(m->sha256, 0x5A, sizeof(m->sha256));
	m->eye_separation_m = 0.063;
	m->size_m = (struct bb_vec3){ 2.4, 2.4, 2.4 };
	m->degraded_max_s = 1;
	m->n_nodes = 6;
	m->nodes = x->nodes;
	m->n_walls = m->n_screens = 5;
	m->walls = x->walls;
	m->screens = x->screens;
	for (size_t i = 0; i < 5; i++) {
		snprintf(x->nodes[i].id, BB_ID_MAX, "%s", walls[i]);
		snprintf(x->nodes[i].profile, BB_ID_MAX, "desktop-gpu");
		snprintf(x->walls[i].id, BB_ID_MAX, "%s", walls[i]);
		snprintf(x->walls[i].node, BB_ID_MAX, "%s", walls[i]);
		x->walls[i].width_px = 1400;
		x->walls[i].height_px = 1050;
		x->walls[i].columns = x->walls[i].rows = 1;
		snprintf(x->screens[i].id, BB_ID_MAX, "%s", walls[i]);
		x->screens[i].wall = x->screens[i].node = (uint16_t)i;
		x->screens[i].display.rate = (struct bb_rate){ 120, 1 };
	}
	snprintf(x->nodes[5].id, BB_ID_MAX, "head");
	x->nodes[5].head = true;
	m->has_chain = true;
	snprintf(m->chain.id, BB_ID_MAX, "chain");
	m->chain.rate = (struct bb_rate){ 120, 1 };
	m->chain.n_stages = 5;
	for (size_t i = 0; i < 5; i++)
		snprintf(m->chain.stage[i], BB_ID_MAX, "%s", walls[i]);
	m->n_cameras = 8;
	m->cameras = x->cameras;
	for (size_t i = 0; i < 8; i++)
		snprintf(x->cameras[i].id, BB_ID_MAX, "c%zu", i + 1);
}

static inline struct bb_budget fixture_budget(enum bb_metric metric, enum bb_stat stat, double limit, double marginal,
                                              const char *file, int line)
{
	return (struct bb_budget){ .metric = metric, .stat = stat, .limit = limit, .marginal = marginal,
		                   .where = { file, line, 3 } };
}

static inline void fixture_budgets(struct fixture *x)
{
	const double none = (double)NAN;
	struct bb_budget *b = x->room.budgets;
	size_t n = 0;

	b[n++] = fixture_budget(BB_METRIC_HEAD_TO_PHOTON, BB_STAT_P99, 50, 45, x->room.path, 61);
	b[n++] = fixture_budget(BB_METRIC_SWAP_SKEW, BB_STAT_P99, 500, none, x->room.path, 62);
	b[n++] = fixture_budget(BB_METRIC_PHASE, BB_STAT_MAX_ABS, 300, 10, x->room.path, 63);
	b[n++] = fixture_budget(BB_METRIC_EYE_SWAPS, BB_STAT_MAX, 0, none, x->room.path, 64);
	b[n++] = fixture_budget(BB_METRIC_CROSSTALK, BB_STAT_MAX, 2, none, x->room.path, 65);
	b[n++] = fixture_budget(BB_METRIC_TRACKED, BB_STAT_MIN, 99, none, x->room.path, 66);
	x->room.n_budgets = n;
	b = x->scene.budgets;
	n = 0;
	b[n++] = fixture_budget(BB_METRIC_FRAME, BB_STAT_P99, 8.33, 8, x->scene.path, 12);
	b[n++] = fixture_budget(BB_METRIC_FRAME, BB_STAT_MAX, 16.67, none, x->scene.path, 13);
	b[n++] = fixture_budget(BB_METRIC_POSE_ERROR, BB_STAT_RMS, 0.25, none, x->scene.path, 14);
	b[n++] = fixture_budget(BB_METRIC_SCANOUT_SKEW, BB_STAT_P99, 60, none, x->scene.path, 15);
	x->scene.n_budgets = n;
}

static inline void fixture_scene(struct fixture *x, double duration_s)
{
	struct bb_scene *s = &x->scene;

	snprintf(s->path, sizeof(s->path), "scenes/epi.yaml");
	snprintf(s->name, sizeof(s->name), "epi");
	memset(s->sha256, 0xC3, sizeof(s->sha256));
	snprintf(s->data.file, sizeof(s->data.file), "build/data/example4d.nii.gz");
	snprintf(s->transfer_function, sizeof(s->transfer_function), "scenes/mri.tf");
	snprintf(s->head_path, sizeof(s->head_path), "scenes/walk.path");
	s->data.seconds_per_step = 0.5;
	s->data.loop = BB_LOOP_PING_PONG;
	s->duration_s = duration_s;
	s->memory_mib = 0.5;
	s->stream_bricks_per_frame = 8;
	for (int c = 0; c < BB_CLASS_COUNT; c++)
		s->needs[c] = 1;
	s->needs[BB_CLASS_POWER] = BB_NOT_NEEDED;
}

static inline int64_t fixture_node_spans(struct fixture *x, const struct fixture_options *o, uint64_t frame,
                                         uint16_t node, int64_t begin_ns)
{
	struct bb_ledger *l = x->result->ledger;
	const bool late = o->faults && node == 2 && frame >= 360 && frame < 380;
	int64_t t = begin_ns, next;

	next = t + 120000 + (int64_t)(fixture_uniform(x) * 40000);
	bb_ledger_span(l, frame, BB_STAGE_STATE, node, 0, t, next);
	t = next;
	next = t + 300000 + (int64_t)(fixture_uniform(x) * 200000);
	bb_ledger_span(l, frame, BB_STAGE_SELECT, node, 0, t, next);
	t = next;
	next = t + 5400000 + (int64_t)(fixture_noise(x) * 500000) + (late ? 17300000 : 0) + o->extra_draw_ns;
	bb_ledger_span(l, frame, BB_STAGE_DRAW, node, 0, t, next);
	return next;
}

static inline void fixture_sample(struct fixture *x, enum bb_metric metric, double value, double sigma, uint64_t frame,
                                  int64_t at_ns, uint16_t node, enum bb_stage stage)
{
	const struct bb_sample s = { value, sigma, frame, at_ns, node, (uint16_t)stage };

	bb_ledger_sample(x->result->ledger, metric, &s);
}

/* Everything behind the swap of one frame. Returns its head-to-photon time in ms. */
static inline double fixture_show(struct fixture *x, uint64_t frame, int64_t exposed_ns, int64_t release_ns)
{
	struct bb_ledger *l = x->result->ledger;
	const int64_t vblank = (release_ns / 8333333 + 1) * 8333333;

	for (uint16_t node = 0; node < 5; node++) {
		bb_ledger_span(l, frame, BB_STAGE_PRESENT, node, node, release_ns, vblank);
		bb_ledger_span(l, frame, BB_STAGE_SCANOUT, node, node, vblank, vblank + 4000000);
		bb_ledger_mark(l, BB_TRACK_VSYNC, node, vblank, (int32_t)frame, 0);
		bb_ledger_mark(l, BB_TRACK_SHUTTER, node, vblank + 300000, frame & 1 ? 1 : 2,
		               frame & 1 ? 1 : 2);
	}
	bb_ledger_mark(l, BB_TRACK_SHUTTER, 255, vblank + 301000, frame & 1 ? 1 : 2, frame & 1 ? 1 : 2);
	bb_ledger_span(l, frame, BB_STAGE_SHUTTER, 0xFFFF, 0, vblank + 4000000, vblank + 4700000);
	return (double)(vblank + 4700000 - exposed_ns) * 1e-6;
}

static inline void fixture_frame(struct fixture *x, const struct fixture_options *o, uint64_t frame)
{
	struct bb_ledger *l = x->result->ledger;
	const int64_t start = BB_NS_PER_S + bb_rate_frame_ns((struct bb_rate){ 120, 1 }, (int64_t)frame);
	const bool covered = o->faults && frame >= 600 && frame < 840;
	const int64_t age = 6000000 + (int64_t)(fixture_uniform(x) * 8000000);
	const int64_t exposed = start - age - 4200000;
	struct bb_frame_row row = {
		.frame = frame, .start_ns = start, .cameras = covered ? 7 : 8, .late_node = UINT32_MAX
	};
	int64_t ready[5], last = 0;
	size_t slow = 0;

	bb_ledger_span(l, frame, BB_STAGE_EXPOSE, 0xFFFF, 0, exposed, exposed + 3000000);
	bb_ledger_span(l, frame, BB_STAGE_TRANSFER, 0xFFFF, 0, exposed + 3000000, exposed + 4200000);
	bb_ledger_span(l, frame, BB_STAGE_WAIT, 0xFFFF, 0, exposed + 4200000, start);
	bb_ledger_span(l, frame, BB_STAGE_TRACK, 0xFFFF, 0, start, start + 90000);
	bb_ledger_mark(l, BB_TRACK_STROBE, (uint16_t)(frame % 8), exposed, (int32_t)frame, 0);
	for (uint16_t node = 0; node < 5; node++) {
		ready[node] = fixture_node_spans(x, o, frame, node, start + 90000);
		slow = ready[node] > ready[slow] ? node : slow;
		fixture_sample(x, BB_METRIC_FRAME, (double)(ready[node] - start) * 1e-6, 0, frame, ready[node], node,
		               BB_STAGE_DRAW);
	}
	last = ready[slow];
	for (uint16_t node = 0; node < 5; node++)
		bb_ledger_span(l, frame, BB_STAGE_BARRIER, node, 0, ready[node], last + 50000);
	bb_ledger_mark(l, BB_TRACK_BARRIER, (uint16_t)slow, last + 50000, (int32_t)frame, 0);
	row.frame_ms = (double)(last - start) * 1e-6;
	row.head_to_photon_ms = fixture_show(x, frame, exposed, last + 50000);
	row.swap_skew_us = 25 + fixture_uniform(x) * 30;
	row.scanout_skew_us = 15 + fixture_uniform(x) * 20;
	row.phase_us = fixture_noise(x) * 12;
	row.pose_age_ms = (double)age * 1e-6;
	row.pose_error_mm = 0.12 + fabs(fixture_noise(x)) * 0.05 + (covered ? 0.05 : 0);
	row.photon_error_mm = 1.2 + fabs(fixture_noise(x));
	row.bricks_wanted = 40 + (uint32_t)o->extra_bricks;
	row.bricks_loaded = (uint32_t)(8 * fixture_uniform(x));
	row.bytes = (uint64_t)row.bricks_loaded * 8192;
	if (row.frame_ms > 16)
		row.late_node = (uint32_t)slow;
	fixture_sample(x, BB_METRIC_HEAD_TO_PHOTON, row.head_to_photon_ms, 0.05, frame, start, (uint16_t)slow,
	               BB_STAGE_DRAW);
	fixture_sample(x, BB_METRIC_SWAP_SKEW, row.swap_skew_us, 0.5, frame, last, (uint16_t)slow, BB_STAGE_COUNT);
	fixture_sample(x, BB_METRIC_SCANOUT_SKEW, row.scanout_skew_us, 20, frame, last, 0xFFFF, BB_STAGE_COUNT);
	fixture_sample(x, BB_METRIC_PHASE, row.phase_us, 1, frame, last, 0xFFFF, BB_STAGE_SHUTTER);
	fixture_sample(x, BB_METRIC_POSE_ERROR, row.pose_error_mm, 0, frame, start, 0xFFFF, BB_STAGE_COUNT);
	fixture_sample(x, BB_METRIC_TRACKED, 100, 0, frame, start, 0xFFFF, BB_STAGE_COUNT);
	fixture_sample(x, BB_METRIC_EYE_SWAPS, 0, 0, frame, start, 0xFFFF, BB_STAGE_COUNT);
	bb_ledger_row(l, &row);
	bb_result_count(x->result, "frames", 1);
	bb_result_count(x->result, "bricks_wanted", row.bricks_wanted);
	bb_result_count(x->result, "bricks_loaded", row.bricks_loaded);
	bb_result_count(x->result, "bytes_streamed", row.bytes);
	bb_result_count(x->result, "clock_steps", 37);
}

static inline void fixture_device(struct bb_run_result *r, const char *class_name, const char *id, int fidelity,
                                  uint64_t events, const char *note)
{
	struct bb_device_result *d = &r->devices[r->n_devices++];

	snprintf(d->class_name, sizeof(d->class_name), "%s", class_name);
	snprintf(d->id, sizeof(d->id), "%s", id);
	snprintf(d->backend, sizeof(d->backend), "sim");
	snprintf(d->health, sizeof(d->health), "OK");
	snprintf(d->note, sizeof(d->note), "%s", note);
	d->fidelity = fidelity;
	d->events = events;
	d->ops = events * 2;
}

static inline void fixture_devices(struct fixture *x, const struct fixture_options *o)
{
	struct bb_run_result *r = x->result;
	char id[BB_ID_MAX];

	r->devices = calloc(40, sizeof(*r->devices));
	fixture_device(r, "shutter", "chain", 1, 7200, "5 stages, emitter 3d-vision");
	for (int i = 1; i <= 8; i++) {
		snprintf(id, sizeof(id), "c%d", i);
		fixture_device(r, "camera", id, 1, 600, i == 3 ? FIXTURE_HOSTILE : "640 x 480, 60 Hz, serial 0017");
	}
	for (size_t i = 0; i < 5; i++)
		fixture_device(r, "display", x->walls[i].id, 1, 2400, "1400 x 1050, 120 Hz");
	for (size_t i = 0; i < 5; i++) {
		snprintf(id, sizeof(id), "%s-m", x->walls[i].id);
		fixture_device(r, "monitor", id, 1, 44, "BNQ 1234, 5120 h");
	}
	fixture_device(r, "power", "pdu1", BB_NOT_NEEDED, 0, "");
	fixture_device(r, "gamepad", "pad", 1, 240, "RumblePad 2, battery 80 %");
	if (!o->faults)
		return;
	r->devices[3].longest_bad_s = r->devices[3].bad_s = 2.05;
	r->incidents = calloc(2, sizeof(*r->incidents));
	r->n_incidents = 1;
	snprintf(r->incidents[0].culprit, sizeof(r->incidents[0].culprit), "camera/c3");
	snprintf(r->incidents[0].what, sizeof(r->incidents[0].what), "no marker seen while 7 other cameras see five");
	snprintf(r->incidents[0].state, sizeof(r->incidents[0].state), "DEGRADED");
	r->incidents[0].from_ns = 5100000000;
	r->incidents[0].to_ns = 7150000000;
	r->faults = calloc(2, sizeof(*r->faults));
	r->n_faults = 2;
	snprintf(r->faults[0].text, sizeof(r->faults[0].text), "at 3s node/right late frames=1 for 20 frames");
	r->faults[0].set_ns = 3000000000;
	r->faults[0].detected_ns = 3025000000;
	snprintf(r->faults[0].detected_by, sizeof(r->faults[0].detected_by), "barrier");
	snprintf(r->faults[1].text, sizeof(r->faults[1].text), "at 5s camera/c3 cover for 2s");
	r->faults[1].set_ns = 5000000000;
	r->faults[1].detected_ns = 5100000000;
	snprintf(r->faults[1].detected_by, sizeof(r->faults[1].detected_by), "camera/c3");
}

/* A glow that looks a little like a volume, shifted between the eyes. */
static inline void fixture_png(const char *path, int wall, double shift)
{
	const int w = 350, h = 262;
	cairo_surface_t *surface = cairo_image_surface_create(CAIRO_FORMAT_RGB24, w, h);
	cairo_t *c = cairo_create(surface);

	cairo_set_source_rgb(c, 0, 0, 0);
	cairo_paint(c);
	for (int i = 0; i < 9; i++) {
		const double x = w / 2.0 + 60 * sin(i * 1.7 + wall) + shift, y = h / 2.0 + 45 * cos(i * 2.3 + wall);
		cairo_pattern_t *p = cairo_pattern_create_radial(x, y, 2, x, y, 70);
		cairo_pattern_add_color_stop_rgba(p, 0, 0.9, 0.75 - 0.05 * i, 0.5, 0.55);
		cairo_pattern_add_color_stop_rgba(p, 1, 0.3, 0.2, 0.5, 0);
		cairo_set_source(c, p);
		cairo_paint(c);
		cairo_pattern_destroy(p);
	}
	cairo_surface_write_to_png(surface, path);
	cairo_destroy(c);
	cairo_surface_destroy(surface);
}

static inline void fixture_pictures(struct fixture *x, const char *dir)
{
	struct bb_run_result *r = x->result;

	r->pictures = calloc(30, sizeof(*r->pictures));
	for (int k = 0; k < 30; k++) {
		struct bb_picture_result *p = &r->pictures[r->n_pictures++];
		const int wall = k / 2 % 5;
		char path[1024];
		snprintf(p->wall, sizeof(p->wall), "%s", x->walls[wall].id);
		snprintf(p->eye, sizeof(p->eye), "%s", k % 2 ? "right" : "left");
		p->at_s = 5.0 * (k / 10);
		snprintf(p->file, sizeof(p->file), "%s-%s-%04.0f.png", p->wall, p->eye, p->at_s * 1000);
		p->width = 350;
		p->height = 262;
		p->psnr_db = 36.4 + wall * 0.7 + k / 10;
		p->rays = 91700;
		p->samples = 5200000;
		snprintf(path, sizeof(path), "%s/%s", dir, p->file);
		fixture_png(path, wall, k % 2 ? 7 : -7);
	}
}

static inline void fixture_facts(struct bb_run_result *r)
{
	bb_result_fact(r, "revision", "73e85e8");
	bb_result_fact(r, "machine", "Xeon E5-2680 v4, 2 cores, AVX2");
	bb_result_fact(r, "compiler", "gcc 12.2.0 -O2");
	bb_result_fact(r, "gl", "llvmpipe (LLVM 15.0.6, 256 bits), OSMesa");
	bb_result_fact(r, "cost_profile_sha256", "%064d", 7);
}

static inline void fixture_free(struct fixture *x)
{
	if (x)
		bb_run_result_free(x->result);
	free(x);
}

static inline struct fixture *fixture_create(const struct fixture_options *o)
{
	struct fixture *x = calloc(1, sizeof(*x));

	x->random = 7;
	fixture_room(x);
	fixture_scene(x, (double)o->n_frames / 120);
	fixture_budgets(x);
	x->result = calloc(1, sizeof(*x->result));
	x->result->room = &x->room;
	x->result->scene = &x->scene;
	x->result->seed = 7;
	snprintf(x->result->clock, sizeof(x->result->clock), "virtual");
	memset(x->result->event_log_sha256, 'a', 64);
	x->result->n_events = 48211;
	x->result->duration_s = x->scene.duration_s;
	x->result->scene_start_s = 1;
	x->result->wall_time_s = 3.2;
	if (bb_ledger_create(o->n_frames, x->room.n_nodes, &x->result->ledger) != BB_OK)
		abort();
	for (uint64_t frame = 0; frame < o->n_frames; frame++)
		fixture_frame(x, o, frame);
	fixture_devices(x, o);
	fixture_facts(x->result);
	if (o->picture_dir)
		fixture_pictures(x, o->picture_dir);
	return x;
}

#endif
