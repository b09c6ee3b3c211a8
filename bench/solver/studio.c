#include "bench/solver/studio.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/seeing.h"
#include "hal/scene.h"
#include "sim/sim.h"
#include "sim/sim_camera.h"

#define SETTLE_NS BB_NS_PER_S

struct bb_studio_private {
	struct bb_path *path;
	struct bb_clock *clk;
	struct bb_eventlog events;
	struct bb_rig rig;
	struct bb_seeing *seeing; /* NULL: the cameras find their blobs themselves */
	struct bb_timemap *maps;
	struct bb_blob *blobs;
};

static enum bb_status check_room(const struct bb_room *room, struct bb_error *err)
{
	if (!room->n_cameras || !room->n_bodies)
		return bb_fail(err, BB_ERR_CONFIG, 1720, NULL, "%s: it has %s", room->path,
			       room->n_cameras ? "no bodies" : "no cameras");
	for (size_t i = 1; i < room->n_cameras; i++)
		if (bb_rate_period_ns(room->cameras[i].rate) != bb_rate_period_ns(room->cameras[0].rate))
			return bb_fail(err, BB_ERR_CONFIG, 1720, NULL, "%s: its cameras differ in rate", room->path);
	return BB_OK;
}

static enum bb_status open_cameras(const struct bb_studio_config *c, struct bb_studio *s, struct bb_error *err)
{
	int needs[BB_CLASS_COUNT];
	const struct bb_open open = {
		.clk = s->own->clk, .events = &s->own->events, .seed = c->seed, .world = s->world
	};

	for (int i = 0; i < BB_CLASS_COUNT; i++)
		needs[i] = i == BB_CLASS_CAMERAS ? c->fidelity : -1;
	return bb_rig_open(&s->own->rig, s->room, needs, &open, err);
}

/* As the run's loop makes its tracker. */
static enum bb_status make_tracker(struct bb_studio *s, struct bb_error *err)
{
	const struct bb_room *room = s->room;
	const struct bb_vec3 around = { 1, 1, 1 };

	s->blob_sigma_px = 0.02;
	for (size_t i = 0; i < room->n_cameras; i++)
		s->blob_sigma_px =
			fmax(s->blob_sigma_px, bb_camera_limits(s->own->rig.cameras[i])->blob_error_px);
	const struct bb_tracker_config config = { .cameras = room->cameras,
						  .n_cameras = room->n_cameras,
						  .bodies = room->bodies,
						  .n_bodies = room->n_bodies,
						  .blob_sigma_px = s->blob_sigma_px,
						  .group_ns = 500000,
						  .freeze_ns = 100000000,
						  .room_min = bb_vec3_sub(room->min, around),
						  .room_max = bb_vec3_add(room->max, around),
						  .neutral = { room->neutral, BB_QUAT_IDENTITY } };
	const enum bb_status status = bb_tracker_create(&config, &s->tracker);
	return status ? bb_fail(err, status, 1720, NULL, "%s: %s", room->path, bb_status_text(status)) : BB_OK;
}

static enum bb_status start(struct bb_studio *s, struct bb_error *err)
{
	struct bb_studio_private *own = s->own;

	const enum bb_status seeing =
		bb_seeing_create(s->room->cameras, own->rig.cameras, s->room->n_cameras, &own->seeing, err);
	if (seeing)
		return seeing;
	own->maps = calloc(s->room->n_cameras, sizeof(*own->maps));
	own->blobs = calloc(BB_CAMERA_BLOBS_MAX, sizeof(*own->blobs));
	if (!own->maps || !own->blobs)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "time maps");
	for (size_t i = 0; i < s->room->n_cameras; i++) {
		struct bb_camera *cam = own->rig.cameras[i];
		bb_timemap_init(&own->maps[i], bb_camera_limits(cam)->least_latency_ns);
		const enum bb_status status = bb_camera_start(cam);
		if (status)
			return bb_fail(err, status, 1720, NULL, "camera/%s: %s", s->room->cameras[i].id,
				       bb_status_text(status));
	}
	return BB_OK;
}

/* Every frame that has arrived goes to the tracker; returns how many. */
static size_t read_frames(struct bb_studio *s)
{
	struct bb_studio_private *own = s->own;
	size_t n = 0;

	for (size_t i = 0; i < s->room->n_cameras; i++)
		for (;; n++) {
			struct bb_camera_frame frame = { .blobs = own->blobs, .cap = BB_CAMERA_BLOBS_MAX };
			if (bb_seeing_read(own->seeing, i, own->rig.cameras[i], &frame) != BB_OK)
				break;
			bb_timemap_add(&own->maps[i], frame.mid_exposure, frame.arrived_ns);
			s->mid_ns = bb_timemap_host_ns(&own->maps[i], frame.mid_exposure);
			bb_tracker_frame(s->tracker, i, s->mid_ns, frame.blobs, frame.n);
		}
	return n;
}

/* Steps fall shortly after arrivals: none splits a set, and what is done between two acts on the next exposure. */
static void settle(struct bb_studio *s)
{
	const int64_t slice_ns = s->period_ns / 16;
	int64_t at_ns = 0;

	while (at_ns < s->start_ns) {
		at_ns += slice_ns;
		bb_clock_run_until(s->own->clk, at_ns);
		if (read_frames(s) && at_ns > s->start_ns - 2 * s->period_ns)
			break;
	}
	bb_clock_run_until(s->own->clk, at_ns + slice_ns);
	read_frames(s);
	bb_tracker_solve(s->tracker, true, 0, NULL, 0);
}

static enum bb_status open_world(const struct bb_studio_config *c, struct bb_studio *s, struct bb_error *err)
{
	struct bb_studio_private *own = s->own;
	enum bb_status status = bb_path_load(c->path, &own->path, err);

	if (status)
		return status;
	bb_eventlog_init(&own->events, NULL, NULL);
	status = bb_clock_virtual_create(&own->clk);
	if (!status)
		status = sim_world_create(s->room, own->path, NULL, own->clk, &own->events, c->seed, &s->world);
	if (status)
		return bb_fail(err, status, 1702, NULL, "the simulated world");
	s->duration_ns = bb_path_duration_ns(own->path);
	s->period_ns = bb_rate_period_ns(s->room->cameras[0].rate);
	s->start_ns = SETTLE_NS;
	sim_world_set_scene_start(s->world, s->start_ns);
	return BB_OK;
}

enum bb_status bb_studio_open(const struct bb_studio_config *config, struct bb_studio *out, struct bb_error *err)
{
	struct bb_room *room;
	const enum bb_status status = bb_room_load(config->room, &room, err);

	*out = (struct bb_studio){ 0 };
	return status ? status : bb_studio_open_room(config, room, out, err);
}

enum bb_status bb_studio_open_room(const struct bb_studio_config *config, struct bb_room *room, struct bb_studio *out,
				   struct bb_error *err)
{
	*out = (struct bb_studio){ .room = room, .own = calloc(1, sizeof(*out->own)) };
	if (!out->own) {
		bb_room_free(room);
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "a studio");
	}
	enum bb_status status = check_room(room, err);
	if (!status)
		status = open_world(config, out, err);
	if (!status)
		status = open_cameras(config, out, err);
	if (!status)
		status = make_tracker(out, err);
	if (!status)
		status = start(out, err);
	if (status)
		bb_studio_close(out);
	else
		settle(out);
	return status;
}

void bb_studio_close(struct bb_studio *s)
{
	struct bb_studio_private *own = s->own;

	if (!own)
		return;
	bb_tracker_destroy(s->tracker);
	bb_seeing_destroy(own->seeing);
	bb_rig_close(&own->rig);
	sim_world_destroy(s->world);
	bb_clock_destroy(own->clk);
	bb_path_free(own->path);
	bb_room_free(s->room);
	free(own->maps);
	free(own->blobs);
	free(own);
	*s = (struct bb_studio){ 0 };
}

bool bb_studio_step(struct bb_studio *s, struct bb_track_solution *solution, bool *solved)
{
	const int64_t now_ns = bb_clock_now_ns(s->own->clk);

	*solved = false;
	if (now_ns - s->start_ns > s->duration_ns)
		return false;
	bb_clock_run_until(s->own->clk, now_ns + s->period_ns);
	read_frames(s);
	const int64_t from_ns = bb_clock_stopwatch_ns();
	*solved = bb_tracker_solve(s->tracker, true, 0, solution, 1) > 0;
	s->solve_ns = bb_clock_stopwatch_ns() - from_ns;
	return true;
}

void bb_studio_cover(struct bb_studio *s, bool on)
{
	const struct sim_fault_args none = { .n = 0 };

	for (size_t i = 0; i < s->room->n_cameras; i++) {
		const struct sim_verb *verb = NULL;
		void *device = sim_world_find(s->world, "camera", s->room->cameras[i].id, &verb);
		for (; device && verb && verb->name && strcmp(verb->name, "cover"); verb++)
			;
		if (device && verb && verb->name)
			(void)!verb->apply(device, &none, on, NULL);
	}
}

bool bb_studio_marker_px(const struct bb_studio *s, size_t camera, size_t marker, int64_t at_ns, double px[2],
			bool *visible)
{
	const struct bb_camera_config *c = &s->room->cameras[camera];
	const struct bb_pose body = sim_world_body(s->world, 0, at_ns);
	const struct bb_vec3 at = bb_pose_apply(&body, s->room->bodies[0].marker[marker]);
	struct bb_blob blob;

	if (!sim_camera_project(c, bb_pose_inverse_apply(&c->pose, at), &blob))
		return false;
	*visible = sim_world_visible(s->world, c->pose.p, at, at_ns);
	px[0] = (double)blob.x_px;
	px[1] = (double)blob.y_px;
	return true;
}

size_t bb_studio_seeing(const struct bb_studio *s, int64_t at_ns)
{
	size_t cameras = 0;
	double px[2];

	for (size_t i = 0; i < s->room->n_cameras; i++) {
		size_t markers = 0;
		bool visible;
		for (size_t m = 0; m < s->room->bodies[0].n_markers; m++)
			markers += bb_studio_marker_px(s, i, m, at_ns, px, &visible) && visible;
		cameras += markers >= 3;
	}
	return cameras;
}

struct bb_vec3 bb_studio_centroid(const struct bb_studio *s, int64_t at_ns)
{
	const struct bb_body *b = &s->room->bodies[0];
	const struct bb_pose pose = sim_world_body(s->world, 0, at_ns);
	struct bb_vec3 sum = { 0, 0, 0 };

	for (size_t m = 0; m < b->n_markers; m++)
		sum = bb_vec3_add(sum, b->marker[m]);
	return bb_pose_apply(&pose, bb_vec3_scale(sum, 1 / (double)b->n_markers));
}
