/* tests/hw_camera.h: the cameras of a room before the camera contract; a part of tests/hw_room.c. */
#ifndef BB_TESTS_HW_CAMERA_H
#define BB_TESTS_HW_CAMERA_H

#include "tests/camera_contract.h"

/* What it sees decides what can be asked of it: in a dark room a buffer is never too small. */
static void camera_sees(struct camera_bench *t)
{
	struct row *row = t->impl;

	assert_int_equal(bb_camera_start(t->cam), BB_OK);
	assert_int_equal(camera_next(t, camera_soon_ns(t)), BB_OK);
	snprintf(row->found, sizeof(row->found), "%zu blobs in sight, stamps good to %.1f us", t->frame.n,
	         (double)bb_camera_limits(t->cam)->stamp_error_ns * 1e-3);
	t->lit = t->frame.n > 2;
	assert_int_equal(bb_camera_stop(t->cam), BB_OK);
	camera_small_buffer_shows_overflow(t);
}

static const struct {
	const char *what;
	void (*check)(struct camera_bench *t);
} camera_checks[] = {
	{ "limits are said", camera_limits_are_said },
	{ "a stopped camera has no frames", camera_stopped_has_no_frames },
	{ "frames come in order, on time", camera_frames_come_in_order_on_time },
	{ "a small buffer shows overflow", camera_sees },
	{ "the exposure is range checked", camera_exposure_is_range_checked },
};

static void run_camera(struct row *row)
{
	struct camera_bench *t = calloc(1, sizeof(*t));
	struct bb_uri uri;
	struct bb_error err = { 0 };
	enum bb_status status = bb_uri_parse(row->device, &uri, NULL, &err);
	const struct bb_backend *b = status == BB_OK ? bb_backend_find(&uri, row->id, &err) : NULL;
	const struct bb_open open = { .clk = row->hw->clk, .uri = &uri, .seed = 1 };

	assert_non_null(t);
	t->clk = row->hw->clk;
	t->config = row->config;
	t->look_ns = CAMERA_MS / 5;
	t->frames = 120;
	t->impl = row;
	camera_bench_init(t);
	if (!b || !b->camera)
		snprintf(row->reason, sizeof(row->reason), "%.150s", b ? "its back end has no cameras" : err.text);
	else if ((status = bb_camera_open(b->camera, t->config, &open, &t->cam)) != BB_OK)
		snprintf(row->reason, sizeof(row->reason), "cannot be opened: %s", bb_status_text(status));
	if (!t->cam) {
		free(t);
		fail_msg("%s", row->reason);
	}
	camera_checks[row->step].check(t);
	bb_camera_close(t->cam);
	free(t);
}

/* How many real ones there are. */
static size_t add_cameras(struct hw *hw)
{
	size_t n = 0;

	for (size_t i = 0; i < hw->room->n_cameras; i++) {
		const struct bb_camera_config *config = &hw->room->cameras[i];
		if (simulated(config->device))
			continue;
		n++;
		for (size_t step = 0; step < BB_ARRAY_LEN(camera_checks); step++) {
			struct row *row = add_row(hw, "camera", config->id, config->device, camera_checks[step].what);
			if (!row)
				return n;
			row->run = run_camera;
			row->config = config;
			row->step = step;
		}
	}
	return n;
}

#endif
