/*
 * tests/camera_contract.h: what every camera back end must do, as checks on an open, stopped camera. Which back end it
 * is, and whether time passes or is waited for, is the business of whoever opens the bench: tests/contract_camera.c for
 * sims and wires, tests/hw_camera.h for a room.
 */
#ifndef BB_TESTS_CAMERA_CONTRACT_H
#define BB_TESTS_CAMERA_CONTRACT_H

#include "hal/camera.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>

#include <cmocka.h>

#define CAMERA_MS INT64_C(1000000)

struct camera_bench {
	struct bb_camera *cam;
	struct bb_clock *clk;
	const struct bb_camera_config *config; /* as it was opened */
	int64_t look_ns;  /* how often somebody looks whether there is a frame */
	uint32_t frames;  /* how many show a rhythm */
	bool lit;         /* three blobs or more are in sight */
	struct bb_camera_frame frame;
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	void *impl;
};

static inline void camera_bench_init(struct camera_bench *t)
{
	t->frame = (struct bb_camera_frame){ .blobs = t->blobs, .cap = BB_ARRAY_LEN(t->blobs) };
}

static inline void camera_pass(struct camera_bench *t, int64_t for_ns)
{
	bb_clock_run_until(t->clk, bb_clock_now_ns(t->clk) + for_ns);
}

static inline enum bb_status camera_next(struct camera_bench *t, int64_t within_ns)
{
	const int64_t end_ns = bb_clock_now_ns(t->clk) + within_ns;

	for (;;) {
		const enum bb_status status = bb_camera_read(t->cam, &t->frame);
		if (status != BB_TIMEOUT || bb_clock_now_ns(t->clk) >= end_ns)
			return status;
		camera_pass(t, t->look_ns);
	}
}

/* Longer than a frame of this camera may ever take. */
static inline int64_t camera_soon_ns(const struct camera_bench *t)
{
	return 2 * bb_rate_period_ns(t->config->rate) + bb_camera_limits(t->cam)->least_latency_ns + 100 * CAMERA_MS;
}

static inline void camera_limits_are_said(struct camera_bench *t)
{
	const struct bb_camera_limits *l = bb_camera_limits(t->cam);
	const double hz = bb_rate_hz(t->config->rate);

	assert_true(l->least_rate_hz <= hz && hz <= l->most_rate_hz);
	assert_true(l->most_blobs > 0 && l->most_blobs <= BB_CAMERA_BLOBS_MAX);
	assert_true(l->least_latency_ns > 0 && l->stamp_error_ns >= 0 && l->blob_error_px >= 0);
}

static inline void camera_stopped_has_no_frames(struct camera_bench *t)
{
	camera_pass(t, 100 * CAMERA_MS);
	assert_int_equal(bb_camera_read(t->cam, &t->frame), BB_TIMEOUT);
	assert_int_equal(t->frame.n, 0);
	assert_int_equal(bb_camera_start(t->cam), BB_OK);
	assert_int_equal(bb_camera_start(t->cam), BB_OK);
	assert_int_equal(camera_next(t, camera_soon_ns(t)), BB_OK);
	assert_int_equal(bb_camera_stop(t->cam), BB_OK);
	camera_pass(t, 100 * CAMERA_MS);
	assert_int_equal(bb_camera_read(t->cam, &t->frame), BB_TIMEOUT);
}

/* One frame after another: is this one's stamp, number and arrival what the limits promise? */
static inline void camera_check_frame(struct camera_bench *t, uint32_t i, int64_t last_dev_ns, int64_t last_arrived_ns)
{
	const struct bb_camera_limits *l = bb_camera_limits(t->cam);
	const int64_t period_ns = bb_rate_period_ns(t->config->rate), dev_ns = t->frame.mid_exposure.ns;

	assert_int_equal(t->frame.seq, i);
	assert_true(t->frame.arrived_ns <= bb_clock_now_ns(t->clk));
	if (!i)
		return;
	assert_true(t->frame.arrived_ns > last_arrived_ns);
	assert_true(llabs(dev_ns - last_dev_ns - period_ns) <= 2 * l->stamp_error_ns + 200 * period_ns / 1000000);
}

/* Numbers without gaps, the configured rate, stamps and arrivals that fit the limits through a time map. */
static inline void camera_frames_come_in_order_on_time(struct camera_bench *t)
{
	const struct bb_camera_limits *l = bb_camera_limits(t->cam);
	const int64_t period_ns = bb_rate_period_ns(t->config->rate);
	int64_t first_dev_ns = 0, last_dev_ns = 0, last_arrived_ns = 0;
	struct bb_timemap map;

	bb_timemap_init(&map, l->least_latency_ns);
	assert_int_equal(bb_camera_start(t->cam), BB_OK);
	for (uint32_t i = 0; i < t->frames; i++) {
		assert_int_equal(camera_next(t, camera_soon_ns(t)), BB_OK);
		bb_timemap_add(&map, t->frame.mid_exposure, t->frame.arrived_ns);
		camera_check_frame(t, i, last_dev_ns, last_arrived_ns);
		/* Transfer only delays: host time by the map is never after the arrival less the least latency. */
		assert_true(bb_timemap_host_ns(&map, t->frame.mid_exposure) + l->least_latency_ns <= t->frame.arrived_ns);
		last_dev_ns = t->frame.mid_exposure.ns;
		last_arrived_ns = t->frame.arrived_ns;
		first_dev_ns = i ? first_dev_ns : last_dev_ns;
	}
	const int64_t span_ns = last_dev_ns - first_dev_ns;
	assert_true(llabs(span_ns - (int64_t)(t->frames - 1) * period_ns) <=
	            2 * l->stamp_error_ns + span_ns / 5000); /* 200 ppm: two crystals */
}

static inline void camera_small_buffer_shows_overflow(struct camera_bench *t)
{
	assert_int_equal(bb_camera_read(t->cam, NULL), BB_ERR_USAGE);
	assert_int_equal(bb_camera_start(t->cam), BB_OK);
	t->frame.cap = 2;
	assert_int_equal(camera_next(t, camera_soon_ns(t)), BB_OK);
	if (!t->lit)
		return;
	assert_int_equal(t->frame.n, 2);
	assert_true(t->frame.overflow);
}

/* Leaves the exposure as it was configured. */
static inline void camera_exposure_is_range_checked(struct camera_bench *t)
{
	const int64_t period_ns = bb_rate_period_ns(t->config->rate), was_ns = (int64_t)(t->config->exposure_us * 1000);
	const int64_t before_ns = bb_camera_limits(t->cam)->least_latency_ns;

	assert_int_equal(bb_camera_set_exposure(t->cam, 0, 0), BB_ERR_USAGE);
	assert_int_equal(bb_camera_set_exposure(t->cam, 2 * period_ns, 0), BB_ERR_RANGE);
	assert_int_equal(bb_camera_set_exposure(t->cam, CAMERA_MS, period_ns), BB_ERR_RANGE);
	assert_int_equal(bb_camera_set_exposure(t->cam, was_ns + 2 * CAMERA_MS, 0), BB_OK);
	assert_int_equal(bb_camera_limits(t->cam)->least_latency_ns - before_ns, CAMERA_MS); /* half of it is after the middle */
	assert_int_equal(bb_camera_start(t->cam), BB_OK);
	assert_int_equal(camera_next(t, camera_soon_ns(t)), BB_OK);
	if (bb_camera_set_exposure(t->cam, was_ns, (int64_t)(t->config->sync_offset_us * 1000)) != BB_OK)
		assert_int_equal(bb_camera_set_exposure(t->cam, was_ns, 0), BB_OK); /* one without a sync input */
	assert_int_equal(bb_camera_limits(t->cam)->least_latency_ns, before_ns);
}

#endif
