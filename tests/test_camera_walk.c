/*
 * tests/test_camera_walk.c: from marker to pose through rendered pictures (fidelity 2): the cabin's eight cameras, the
 * walk, the viewer's body in the way. Counted are poses of exposures in which four cameras or more have at least three
 * markers in the picture, by the truth: a spot within 2 px of where the lens puts the marker, at least 3 px across
 * (diameter of the disc of its area above the threshold) and at least 100 grey levels at its peak, black being 4.
 * `test_camera_walk 3000 [SEED [option=value ...]]` takes so many exposures and camera options (row_us=: a rolling shutter that
 * the tracker does not know of), roundness= of the finder, and rows_us=: a rolling shutter that stands in the room (make bench-eyes).
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sim/sim.h"
#include "sim/sim_camera.h"
#include "sync/blobs/blobs.h"
#include "sync/track/tracker.h"

#define CAMERAS_MAX 8
#define NEAR_PX 2.0
#define ASTRAY_PX 0.25 /* two markers in one spot, or one that is partly hidden */
#define ACROSS_PX 3.0
#define PEAK 100
#define PI 3.14159265358979323846

static unsigned n_exposures = 100;
static uint64_t seed = 1;
static char **options;
static int n_options;

struct walk {
	struct bb_room *room;
	struct bb_path *path;
	struct bb_clock *clk;
	struct bb_eventlog *log;
	struct sim_world *world;
	struct bb_uri uri;
	struct bb_camera *cam[CAMERAS_MAX];
	struct bb_blob_finder *finder;
	struct bb_tracker *tracker;
	uint8_t *grey;
	/* of spots that are markers' */
	size_t spots, refined, saturated, astray;
	double square_px[2]; /* by whether it is saturated */
	/* of poses */
	size_t exposures, counted, solved, wrong, all;
	double mm2, deg2, worst_mm, sigma_mm2, all_mm2;
};

static void silent(void *ctx, const struct bb_event *events, size_t n)
{
	(void)ctx;
	(void)events;
	(void)n;
}

static void set_option(struct bb_uri *uri, const char *text)
{
	const char *equals = strchr(text, '=');
	const size_t i = uri->n_options++;

	assert_non_null(equals);
	snprintf(uri->option[i].key, sizeof(uri->option[i].key), "%.*s", (int)(equals - text), text);
	snprintf(uri->option[i].value, sizeof(uri->option[i].value), "%s", equals + 1);
}

static void begin(struct walk *w, double rows_us)
{
	double roundness = bb_blobs_usual().least_roundness;
	struct bb_error err = { 0 };

	memset(w, 0, sizeof(*w));
	if (bb_room_load("rooms/cabin.yaml", &w->room, &err) || bb_path_load("scenes/walk.path", &w->path, &err))
		fail_msg("%s", err.text);
	const struct bb_room *r = w->room;
	assert_int_equal(r->n_cameras, CAMERAS_MAX);
	assert_int_equal(bb_clock_virtual_create(&w->clk), BB_OK);
	w->log = calloc(1, sizeof(*w->log));
	w->grey = malloc((size_t)(r->cameras[0].width_px * r->cameras[0].height_px));
	assert_true(w->log && w->grey);
	bb_eventlog_init(w->log, silent, NULL);
	assert_int_equal(sim_world_create(r, w->path, NULL, w->clk, w->log, seed, &w->world), BB_OK);
	snprintf(w->uri.scheme, sizeof(w->uri.scheme), "sim");
	for (int i = 0; i < n_options; i++)
		if (!strncmp(options[i], "roundness=", 10))
			roundness = strtod(options[i] + 10, NULL);
		else if (!strncmp(options[i], "rows_us=", 8))
			rows_us = strtod(options[i] + 8, NULL);
		else
			set_option(&w->uri, options[i]);
	for (size_t i = 0; i < CAMERAS_MAX; i++)
		w->room->cameras[i].row_us = rows_us;
	const struct bb_open open = { .clk = w->clk, .events = w->log, .uri = &w->uri, .seed = seed, .fidelity = 2, .world = w->world };
	for (size_t i = 0; i < CAMERAS_MAX; i++) {
		assert_int_equal(bb_camera_open(&sim_camera_driver, &r->cameras[i], &open, &w->cam[i]), BB_OK);
		assert_true(bb_camera_limits(w->cam[i])->grey);
		assert_int_equal(bb_camera_start(w->cam[i]), BB_OK);
	}
	const struct bb_camera_limits *limits = bb_camera_limits(w->cam[0]);
	struct bb_blobs_config blobs = bb_blobs_above(limits->black, limits->black_noise);
	blobs.least_roundness = roundness;
	assert_int_equal(bb_blob_finder_create(&blobs, r->cameras[0].width_px, r->cameras[0].height_px, &w->finder), BB_OK);
	const struct bb_tracker_config t = { .cameras = r->cameras, .n_cameras = r->n_cameras, .bodies = r->bodies,
		                             .n_bodies = 1, .blob_sigma_px = bb_camera_limits(w->cam[0])->blob_error_px,
		                             .group_ns = 500000, .freeze_ns = 100000000, .room_min = r->min,
		                             .room_max = r->max, .neutral = { r->neutral, BB_QUAT_IDENTITY } };
	assert_int_equal(bb_tracker_create(&t, &w->tracker), BB_OK);
}

static void end(struct walk *w)
{
	bb_tracker_destroy(w->tracker);
	bb_blob_finder_destroy(w->finder);
	for (size_t i = 0; i < CAMERAS_MAX; i++)
		bb_camera_close(w->cam[i]);
	sim_world_destroy(w->world);
	bb_clock_destroy(w->clk);
	bb_path_free(w->path);
	bb_room_free(w->room);
	free(w->grey);
	free(w->log);
}

/* How many of the glasses' markers this camera has in its picture, as the head of this file says. */
static unsigned markers_shown(struct walk *w, size_t camera, int64_t mid_ns, const struct bb_spot *spot, size_t n)
{
	const struct bb_camera_config *c = &w->room->cameras[camera];
	const struct bb_body *glasses = &w->room->bodies[0];
	const struct bb_pose body = sim_world_body(w->world, 0, mid_ns);
	unsigned shown = 0;

	for (size_t m = 0; m < glasses->n_markers; m++) {
		const struct bb_vec3 at = bb_pose_inverse_apply(&c->pose, bb_pose_apply(&body, glasses->marker[m]));
		double px[2];
		if (!sim_camera_pixel(c, at, px))
			continue;
		for (size_t i = 0; i < n; i++) {
			const double dx = spot[i].x_px - px[0], dy = spot[i].y_px - px[1], across = 2 * sqrt(spot[i].area_px / PI);
			if (hypot(dx, dy) > NEAR_PX || across < ACROSS_PX || spot[i].peak < PEAK)
				continue;
			const int k = spot[i].flags & BB_SPOT_SATURATED;
			shown++;
			w->spots++;
			w->refined += spot[i].flags & BB_SPOT_REFINED ? 1 : 0;
			w->saturated += (size_t)k;
			w->square_px[k] += hypot(dx, dy) < ASTRAY_PX ? dx * dx + dy * dy : 0;
			w->astray += hypot(dx, dy) >= ASTRAY_PX;
			break;
		}
	}
	return shown;
}

static bool expose_all(struct walk *w, int64_t mid_ns)
{
	unsigned seeing = 0;

	for (size_t i = 0; i < CAMERAS_MAX; i++) {
		struct bb_spot spot[BB_CAMERA_BLOBS_MAX];
		struct bb_blob blob[BB_CAMERA_BLOBS_MAX];
		struct bb_camera_frame frame = { .blobs = blob, .cap = BB_CAMERA_BLOBS_MAX, .grey = w->grey };
		assert_int_equal(bb_camera_read(w->cam[i], &frame), BB_OK);
		assert_true(frame.has_grey && !frame.n);
		const struct bb_blobs_found found = bb_blobs_find(w->finder, w->grey, (size_t)w->room->cameras[i].width_px,
		                                                  spot, BB_CAMERA_BLOBS_MAX);
		for (size_t k = 0; k < found.n; k++)
			blob[k] = bb_spot_blob(&spot[k]);
		seeing += markers_shown(w, i, mid_ns, spot, found.n) >= 3;
		bb_tracker_frame(w->tracker, i, mid_ns, blob, found.n);
	}
	return seeing >= 4;
}

static void judge(struct walk *w, int64_t mid_ns, bool counts)
{
	const struct bb_body *glasses = &w->room->bodies[0];
	const struct bb_pose truth = sim_world_body(w->world, 0, mid_ns);
	struct bb_track_solution s;
	struct bb_vec3 sum = { 0, 0, 0 };

	w->exposures++;
	w->counted += counts;
	if (bb_tracker_solve(w->tracker, true, 0, &s, 1) != 1)
		return;
	for (size_t m = 0; m < glasses->n_markers; m++)
		sum = bb_vec3_add(sum, bb_vec3_scale(bb_pose_apply(&truth, glasses->marker[m]), 1 / (double)glasses->n_markers));
	const double mm = 1e3 * bb_vec3_norm(bb_vec3_sub(s.centroid, sum)), deg = bb_quat_angle(s.body.q, truth.q) * 180 / PI;
	w->all++;
	w->all_mm2 += mm * mm;
	w->wrong += mm > 10 || deg > 10;
	if (!counts)
		return;
	w->solved++;
	w->mm2 += mm * mm;
	w->deg2 += deg * deg;
	w->sigma_mm2 += s.position_sigma_mm * s.position_sigma_mm;
	w->worst_mm = fmax(w->worst_mm, mm);
}

/* Returns its rms over the stated sigma. */
static double follow(double rows_us)
{
	struct walk w;

	begin(&w, rows_us);
	const struct bb_camera_config *c = &w.room->cameras[0];
	const int64_t first = sim_world_reference_after(w.world, c->rate, 0);
	for (unsigned i = 0; i < n_exposures; i++) {
		const int64_t start_ns = sim_world_reference_ns(w.world, c->rate, first + i) + llround(c->sync_offset_us * 1e3);
		const int64_t mid_ns = start_ns + llround(c->exposure_us * 1e3) / 2;
		bb_clock_run_until(w.clk, start_ns + 8000000); /* all have arrived, and the next has not begun */
		judge(&w, mid_ns, expose_all(&w, mid_ns));
	}
	const double mm = sqrt(w.mm2 / (double)w.solved), deg = sqrt(w.deg2 / (double)w.solved);
	const double sigma_mm = sqrt(w.sigma_mm2 / (double)w.solved);
	const size_t clear = w.spots - w.saturated;
	printf("[ note ] %zu exposures of %d cameras, seed %llu: %.3f mm rms (sigma %.3f, worst %.2f), %.3f deg rms in %zu of %zu "
	       "that count; all %zu poses %.3f mm rms, %zu wrong\n", w.exposures, CAMERAS_MAX, (unsigned long long)seed, mm,
	       sigma_mm, w.worst_mm, deg, w.solved, w.counted, w.all, sqrt(w.all_mm2 / (double)w.all), w.wrong);
	printf("[ note ] %zu markers' spots: %.4f px rms each axis, %.1f %% refined; %.1f %% saturated, those %.4f px; %.1f %% astray "
	       "(merged or partly hidden)\n", w.spots,
	       sqrt(w.square_px[0] / (double)(2 * clear)), 100.0 * (double)w.refined / (double)w.spots,
	       100.0 * (double)w.saturated / (double)w.spots, sqrt(w.square_px[1] / (double)(2 * (w.saturated ? w.saturated : 1))),
	       100.0 * (double)w.astray / (double)w.spots);
	assert_true(w.counted * 4 > w.exposures * 3); /* or the figure says little */
	assert_int_equal(w.solved, w.counted);
	assert_int_equal(w.wrong, 0);
	assert_true(mm < 0.3 && deg < 0.2);
	end(&w);
	return mm / sigma_mm;
}

static void the_walk_is_followed_in_pictures(void **state)
{
	(void)state;
	follow(0);
}

static void a_rolling_shutter_that_the_room_names_costs_nothing(void **state)
{
	(void)state;
	assert_true(follow(15) < 2.5); /* the first pose knows of no velocity */
}

int main(int argc, char **argv)
{
	const struct CMUnitTest tests[] = { cmocka_unit_test(the_walk_is_followed_in_pictures),
		                            cmocka_unit_test(a_rolling_shutter_that_the_room_names_costs_nothing) };

	if (argc > 1)
		n_exposures = (unsigned)strtoul(argv[1], NULL, 10);
	if (argc > 2)
		seed = strtoull(argv[2], NULL, 10);
	options = argv + 3;
	n_options = argc > 3 ? argc - 3 : 0;
	if (argc > 1)
		cmocka_set_test_filter("the_walk*");
	return cmocka_run_group_tests(tests, NULL, NULL);
}
