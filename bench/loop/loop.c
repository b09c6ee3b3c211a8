/* bench/loop/loop.c: takes and gives back everything the loop needs, and lets the clock run. */
#include "bench/loop/loop.h"

#include "sync/plan.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "bench/loop/follow.h"
#include "bench/loop/lock.h"
#include "bench/loop/outlets.h"
#include "bench/loop/remote.h"
#include "bench/loop/seeing.h"
#include "bench/loop/tracking.h"

#define DRIFT_HOLD_NS INT64_C(1600000000) /* row K9: named within 2 s, the quarter of a second it looks over included */
#define BARRIER_HALVES 5     /* of a period: time-out of the swap barrier (row N1: silent after 3 T) */
#define SILENCE_PERIODS 3    /* row N8: and then the head is */
#define BARRIER_DROP_AFTER 1 /* or the others would stop again */
#define BARRIER_DRAWN_NS (5 * BB_NS_PER_S) /* all nodes draw in this one process, one after another */
#define BARRIER_LEAST_NS (BB_NS_PER_S / 20)    /* processes: the scheduler alone may keep one for so long */

bool bb_loop_interrupted(const struct bb_frame_loop *l)
{
	return l->options->stop && *l->options->stop;
}

/* Processes draw for real, and for as long as they lately did; one that died is known before. */
int64_t bb_loop_barrier_timeout_ns(const struct bb_frame_loop *l)
{
	if (l->processes && l->usual_ns) {
		const int64_t usual_ns = BARRIER_HALVES * (l->usual_ns > l->frame_ns ? l->usual_ns : l->frame_ns) / 2;
		return usual_ns > BARRIER_LEAST_NS ? usual_ns : BARRIER_LEAST_NS;
	}
	return l->draw_everything ? BARRIER_DRAWN_NS : BARRIER_HALVES * l->frame_ns / 2;
}

int64_t bb_loop_silence_ns(const struct bb_frame_loop *l)
{
	const int64_t most_ns = bb_loop_barrier_timeout_ns(l) + l->frame_ns / 2, usual_ns = SILENCE_PERIODS * l->frame_ns;

	return most_ns > usual_ns ? most_ns : usual_ns;
}

unsigned bb_loop_head(const struct bb_frame_loop *l)
{
	for (unsigned i = 0; i < l->room->n_nodes; i++)
		if (l->room->nodes[i].head)
			return i;
	return 0;
}

void bb_loop_say(struct bb_frame_loop *l, unsigned from, unsigned to, const struct bb_message *m)
{
	const int64_t now_ns = bb_clock_now_ns(l->clk);

	if (from != to) {
		if (bb_link_send(l->rig->link, (uint16_t)from, (uint16_t)to, m, sizeof(*m)) != BB_OK)
			bb_result_count(l->result, "messages_refused", 1);
	} else if (m->kind == BB_MESSAGE_ARRIVE) {
		bb_head_hear(l, from, m, now_ns);
	} else {
		bb_node_hear(&l->nodes[to], m, now_ns);
	}
}

void bb_loop_path_point(struct bb_frame_loop *l, int64_t at_ns, const struct bb_vec3 *truth, const struct bb_vec3 *tracked)
{
	if (l->result->n_path < l->path_cap)
		l->result->path[l->result->n_path++] =
			(struct bb_path_point){ (double)(at_ns - l->scene_start_ns) * 1e-9, *truth, *tracked };
}

struct bb_image *bb_loop_canvas(struct bb_frame_loop *l, const struct bb_screen *screen)
{
	const double scale = l->scene->pictures.scale > 0 ? l->scene->pictures.scale : 1;
	const uint32_t w = (uint32_t)fmax(1, scale * (double)screen->display.width_px);
	const uint32_t h = (uint32_t)fmax(1, scale * (double)screen->display.height_px);

	if (l->canvas.width == w && l->canvas.height == h)
		return &l->canvas;
	bb_image_release(&l->canvas);
	return bb_image_create(w, h, &l->canvas) == BB_OK ? &l->canvas : NULL;
}

/* ---- creation ---- */

static void find_pace(struct bb_frame_loop *l)
{
	const struct bb_display_config *d = l->room->n_screens ? &l->room->screens[0].display : NULL;

	l->master_screen = d && l->rig->displays[0] ? 0 : -1;
	l->frame_rate = d ? d->rate : (struct bb_rate){ 60, 1 };
	l->n_eyes = d && d->stereo != BB_STEREO_MONO ? 2 : 1;
	if (d && d->stereo == BB_STEREO_FRAME_SEQUENTIAL)
		l->frame_rate.den *= 2; /* a frame is a left and a right image */
	l->frame_ns = bb_rate_period_ns(l->frame_rate);
	l->refresh_ns = d ? bb_rate_period_ns(d->rate) : l->frame_ns;
}

static enum bb_status create_stream(struct bb_frame_loop *l, struct bb_node_machine *n, struct bb_error *err)
{
	const struct bb_run_options *o = l->options;
	const double mib = o->memory_mib >= 0 ? o->memory_mib : l->scene->memory_mib;
	const int64_t bricks = (o->stream_bricks >= 0 ? o->stream_bricks : l->scene->stream_bricks_per_frame);
	struct bb_stream_config c = { .bricks = l->bricks, .transfer = l->transfer, .gain = (enum bb_gain_method)l->scene->data.gain,
		                      .views_most = (uint32_t)n->n_views, .occlusion = l->scene->data.occlusion,
		                      .no_prediction = !l->scene->data.predict,
		                      .placement = bb_loop_placement(l->scene, l->bricks),
		                      .memory_bytes = (uint64_t)(mib * 1048576),
		                      .bricks_per_frame = (uint32_t)(bricks ? bricks + o->plant_bricks : 0) };

	if (!l->bricks)
		return BB_OK;
	enum bb_status status = bb_stream_create(&c, &n->stream, err);
	if (!status)
		bb_node_fill(n);
	if (!status)
		status = l->draw_everything
				 ? bb_stream_io_start(n->stream, &n->io)
				 : bb_stream_disk_start(n->stream, n->profile.disk_read_ns, n->profile.disk_byte_ns, &n->disk);
	return status;
}

struct bb_placement bb_loop_placement(const struct bb_scene *scene, const struct bb_bricks *bricks)
{
	struct bb_placement p = { .size_m = { 0, 0, 0 }, .pose = { scene->data.centre_m, bb_quat_euler_deg(scene->data.yaw_deg,
		                                                                    scene->data.pitch_deg,
		                                                                    scene->data.roll_deg) } };
	double edge[3] = { 0, 0, 0 }, longest = 0;

	const struct bb_bricks_header *h = bricks ? bb_bricks_header(bricks) : NULL;

	for (int i = 0; h && i < 3; i++) {
		edge[i] = h->grid == BB_BRICK_SPHERICAL ? 1 : h->tree.dim[i] * h->spacing_mm[i];
		longest = fmax(longest, edge[i]);
	}
	if (longest > 0)
		p.size_m = bb_vec3_scale((struct bb_vec3){ edge[0], edge[1], edge[2] }, scene->data.width_m / longest);
	return p;
}

static enum bb_status create_node(struct bb_frame_loop *l, uint16_t index, struct bb_error *err)
{
	struct bb_node_machine *n = &l->nodes[index];
	size_t at = 0;

	n->loop = l;
	n->index = index;
	n->source = bb_eventlog_source(l->events, "node", l->room->nodes[index].id);
	n->quality = 1;
	bb_orphan_init(n);
	n->inbox = (struct bb_timer){ .step = bb_node_inbox, .rank = 3 };
	n->ready = (struct bb_timer){ .step = bb_node_ready, .rank = 3 };
	n->hold = (struct bb_timer){ .step = bb_node_present, .rank = 3 };
	for (size_t i = 0; i < l->room->n_screens; i++)
		n->n_screens += l->room->screens[i].node == index;
	n->screens = calloc(n->n_screens + 1, sizeof(*n->screens));
	n->n_views = n->n_screens * l->n_eyes;
	n->views = calloc(n->n_views + 1, sizeof(*n->views));
	n->target = calloc(n->n_screens + 1, sizeof(*n->target));
	if (!n->screens || !n->views || !n->target)
		return BB_ERR_NOMEM;
	for (uint16_t i = 0; i < l->room->n_screens; i++)
		if (l->room->screens[i].node == index)
			n->screens[at++] = i;
	enum bb_status status = bb_profile_load_for(l->room->path, l->room->nodes[index].profile, &n->profile, err);
	if (status != BB_OK || !n->n_screens)
		return status;
	l->drawing_nodes |= UINT64_C(1) << index;
	if (!bb_remote_plays(l, index))
		return BB_OK;
	return create_stream(l, n, err);
}

/* The walls' box, grown to a metre around the viewer: a single screen has no depth of its own. */
static struct bb_vec3 around(struct bb_vec3 corner, struct bb_vec3 viewer, int sign)
{
	return (struct bb_vec3){ sign * fmax(sign * corner.x, sign * viewer.x + 1),
		                 sign * fmax(sign * corner.y, sign * viewer.y + 1),
		                 sign * fmax(sign * corner.z, sign * viewer.z + 1) };
}

struct bb_tracker_config bb_loop_tracker_config(const struct bb_frame_loop *l)
{
	const struct bb_room *room = l->room;
	double sigma_px = 0.02;
	int64_t period_ns = BB_NS_PER_S;

	for (size_t i = 0; i < room->n_cameras; i++) {
		sigma_px = fmax(sigma_px, bb_camera_limits(l->rig->cameras[i])->blob_error_px);
		if (bb_rate_period_ns(room->cameras[i].rate) < period_ns)
			period_ns = bb_rate_period_ns(room->cameras[i].rate);
	}
	/* Also a camera that lost its trigger (row K10) joins what the others saw in its period: alone it has no depth. */
	return (struct bb_tracker_config){ .cameras = room->cameras, .n_cameras = room->n_cameras,
		                             .bodies = room->bodies, .n_bodies = room->n_bodies,
		                             .blob_sigma_px = sigma_px, .group_ns = period_ns * 3 / 4, .freeze_ns = 100000000,
		                             .room_min = around(room->min, room->neutral, -1),
		                             .room_max = around(room->max, room->neutral, 1),
		                             .neutral = { room->neutral, BB_QUAT_IDENTITY } };
}

static enum bb_status create_tracker(struct bb_frame_loop *l)
{
	if (l->rig->needs[BB_CLASS_CAMERAS] < 0 || !l->room->n_cameras || !l->room->n_bodies)
		return BB_OK;
	const struct bb_tracker_config c = bb_loop_tracker_config(l);
	const struct bb_drift_config drift = { .cameras = c.cameras, .n_cameras = c.n_cameras, .noise_px = c.blob_sigma_px,
		                               .hold_ns = DRIFT_HOLD_NS };
	enum bb_status status = bb_drift_create(&drift, &l->drift);

	l->pose_slot = bb_watch_slot(l->watch, "tracker", l->room->bodies[0].id);
	l->swap_slot = bb_watch_slot(l->watch, "tracker", l->room->bodies[0].id);
	if (status == BB_OK)
		status = bb_labels_create(l);
	return status == BB_OK ? bb_tracker_create(&c, &l->tracker) : status;
}

static enum bb_status start_cameras(struct bb_frame_loop *l)
{
	for (size_t i = 0; i < l->room->n_cameras; i++) {
		if (!l->rig->cameras[i])
			continue;
		bb_timemap_init(&l->camera_map[i], bb_camera_limits(l->rig->cameras[i])->least_latency_ns);
		bb_cameras_begin(l, i);
		const enum bb_status status = bb_camera_start(l->rig->cameras[i]);
		if (status != BB_OK)
			return status;
	}
	return BB_OK;
}

static void take_slots(struct bb_frame_loop *l)
{
	for (size_t i = 0; i < l->room->n_gamepads; i++)
		if (l->rig->gamepads[i])
			l->gamepad_slot[i] = bb_watch_slot(l->watch, "gamepad", l->room->gamepads[i].id);
	for (size_t i = 0; i < l->room->n_nodes; i++)
		l->node_slot[i] = bb_watch_slot(l->watch, "node", l->room->nodes[i].id);
	for (size_t i = 0; l->processes && i < l->room->n_nodes; i++)
		l->gone_slot[i] = bb_watch_slot(l->watch, "node", l->room->nodes[i].id);
	for (size_t i = 0; i < l->room->n_screens; i++)
		if (l->rig->displays[i])
			l->display_slot[i] = bb_watch_slot(l->watch, "display", l->room->screens[i].id);
	if (l->rig->shutter) {
		l->shutter_slot = bb_watch_slot(l->watch, "shutter", l->room->chain.id);
		l->polarity_slot = bb_watch_slot(l->watch, "shutter", l->room->chain.id);
		l->rhythm_slot = bb_watch_slot(l->watch, "shutter", l->room->chain.id);
		l->eyes.slot = bb_watch_slot(l->watch, "shutter", l->room->chain.id);
		l->eyes.parity_slot = bb_watch_slot(l->watch, "shutter", l->room->chain.id);
	}
}

static bool take_memory(struct bb_frame_loop *l)
{
	const struct bb_room *r = l->room;

	l->nodes = calloc(r->n_nodes, sizeof(*l->nodes));
	l->camera_map = calloc(r->n_cameras + 1, sizeof(*l->camera_map));
	l->cameras = calloc(r->n_cameras + 1, sizeof(*l->cameras));
	l->gamepad_slot = calloc(r->n_gamepads + 1, sizeof(*l->gamepad_slot));
	l->pads = calloc(r->n_gamepads + 1, sizeof(*l->pads));
	l->node_slot = calloc(r->n_nodes + 1, sizeof(*l->node_slot));
	l->flipped = calloc(r->n_screens + 1, sizeof(*l->flipped));
	l->display_slot = calloc(r->n_screens + 1, sizeof(*l->display_slot));
	l->reads = calloc(TRACK_READS_MAX, sizeof(*l->reads));
	l->blobs = calloc(TRACK_READS_MAX, BB_CAMERA_BLOBS_MAX * sizeof(*l->blobs));
	l->result->path = calloc(l->path_cap, sizeof(*l->result->path));
	return l->nodes && l->camera_map && l->cameras &&
	       l->gamepad_slot && l->pads && l->node_slot && l->display_slot && l->flipped && l->reads && l->blobs &&
	       l->result->path;
}

enum bb_status bb_loop_create(struct bb_frame_loop *l, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	find_pace(l);
	l->navigation = BB_POSE_IDENTITY;
	l->path_cap = (size_t)(l->scene->duration_s * bb_rate_hz(l->frame_rate)) + 16;
	if (!take_memory(l))
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the frame loop");
	l->begin = (struct bb_timer){ .step = bb_head_begin, .rank = 3 };
	l->send = (struct bb_timer){ .step = bb_head_send, .rank = 3 };
	l->head_inbox = (struct bb_timer){ .step = bb_head_inbox, .rank = 3 };
	l->deadline = (struct bb_timer){ .step = bb_head_deadline, .rank = 4 };
	bb_streaming_begin(l);
	if (l->rig->shutter) {
		bb_phase_init(&l->phase, l->room->chain.rate, (unsigned)l->room->chain.n_stages);
		bb_polarity_init(&l->polarity, l->room->chain.rate);
	}
	take_slots(l);
	for (uint16_t i = 0; i < l->room->n_nodes && status == BB_OK; i++)
		status = create_node(l, i, err);
	bb_barrier_init(&l->barrier, (unsigned)l->room->n_nodes, bb_loop_barrier_timeout_ns(l), BARRIER_DROP_AFTER);
	bb_straggler_init(&l->straggler, (unsigned)l->room->n_nodes, l->frame_ns);
	if (status == BB_OK)
		status = bb_lock_create(l, err);
	if (status == BB_OK)
		status = bb_follow_create(l, &l->follow);
	if (status == BB_OK)
		status = create_tracker(l);
	if (status == BB_OK && l->tracker)
		status = bb_seeing_create(l->room->cameras, l->rig->cameras, l->room->n_cameras, &l->seeing, err);
	if (status == BB_OK)
		status = bb_crosstalk_create(l->rig, &l->crosstalk);
	if (status == BB_OK)
		status = bb_diode_create(l->rig, l->scene, l->options->seed, &l->diode);
	const struct bb_light_config light = { .room = l->room, .scene = l->scene, .transfer = l->transfer,
		                               .viewer = l->start.p,
		                               .coast_ns = l->rig->shutter ? bb_shutter_limits(l->rig->shutter)->coast_ns : 0,
		                               .drawn = l->draw_everything && !l->processes }; /* others' pixels stay there */
	if (status == BB_OK && l->rig->needs[BB_CLASS_DISPLAYS] >= 0)
		status = bb_light_create(&light, &l->light);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1506, NULL, "%s", bb_status_text(status));
}

void bb_loop_destroy(struct bb_frame_loop *l)
{
	bb_clock_disarm(l->clk, &l->begin);
	bb_clock_disarm(l->clk, &l->send);
	bb_clock_disarm(l->clk, &l->head_inbox);
	bb_clock_disarm(l->clk, &l->deadline);
	bb_clock_disarm(l->clk, &l->beat);
	bb_clock_disarm(l->clk, &l->look_after);
	bb_lock_destroy(l);
	bb_follow_destroy(l->follow);
	bb_clock_disarm(l->clk, &l->eyes.watch);
	for (size_t i = 0; l->nodes && i < l->room->n_nodes; i++) {
		struct bb_node_machine *n = &l->nodes[i];
		bb_clock_disarm(l->clk, &n->inbox);
		bb_clock_disarm(l->clk, &n->ready);
		bb_clock_disarm(l->clk, &n->hold);
		bb_clock_disarm(l->clk, &n->orphan.watch);
		bb_stream_io_stop(n->io);
		bb_stream_disk_stop(n->disk);
		bb_stream_destroy(n->stream);
		free(n->screens);
		free(n->views);
		free(n->target);
	}
	bb_outlets_close(l);
	bb_tracker_destroy(l->tracker);
	bb_drift_destroy(l->drift);
	bb_labels_destroy(l->labels);
	bb_seeing_destroy(l->seeing);
	bb_crosstalk_destroy(l->crosstalk);
	bb_diode_destroy(l->diode);
	bb_image_release(&l->canvas);
	bb_light_destroy(l->light);
	free(l->nodes);
	free(l->camera_map);
	free(l->cameras);
	free(l->gamepad_slot);
	free(l->pads);
	free(l->node_slot);
	free(l->display_slot);
	free(l->flipped);
	free(l->reads);
	free(l->blobs);
}

/* ---- running ---- */

/* A phase the hardware has fixed is measured instead of set. */
static enum bb_status set_phase(struct bb_shutter *sh, uint8_t stage, double delay_us, double duty)
{
	const enum bb_status status =
		bb_shutter_set_phase(sh, stage, (int64_t)(delay_us * 1e3), (uint32_t)(duty * 1e6));

	return status == BB_ERR_UNSUPPORTED ? BB_OK : status;
}

/* As the room says, which is what `blackburst phase` plans: shutters before projectors, and the glasses. */
static enum bb_status start_shutters(struct bb_frame_loop *l)
{
	const struct bb_plan_timing t = bb_plan_configured(&l->room->chain);
	const double hz = bb_rate_hz(l->room->chain.rate) * 1e-6;
	enum bb_status status = BB_OK;

	if (!l->rig->shutter)
		return BB_OK;
	l->phase.planned_ns = (int64_t)((t.shutter_at_us - t.glasses_at_us) * 1e3);
	for (uint8_t i = 0; i < l->room->chain.n_stages && status == BB_OK; i++)
		status = set_phase(l->rig->shutter, i, t.shutter_at_us, t.shutter_open_us * hz);
	if (status == BB_OK)
		status = set_phase(l->rig->shutter, BB_STAGE_EMITTER, t.glasses_at_us, t.glasses_open_us * hz);
	if (status == BB_OK)
		status = bb_shutter_set_mode(l->rig->shutter, BB_SHUTTER_STEREO);
	return status;
}

static enum bb_status start_links(struct bb_frame_loop *l)
{
	const unsigned head = bb_loop_head(l);
	enum bb_status status = bb_link_notify(l->rig->link, (uint16_t)head, &l->head_inbox);

	for (uint16_t i = 0; i < l->room->n_nodes && status == BB_OK; i++)
		if (i != head && bb_remote_plays(l, i))
			status = bb_link_notify(l->rig->link, i, &l->nodes[i].inbox);
	return status;
}

/* Counting metrics start at 0, so that "none in the whole run" is a measurement and not a missing one. */
static void start_counts(struct bb_frame_loop *l)
{
	const struct bb_sample none = { .at_ns = l->scene_start_ns, .node = BB_NOBODY, .stage = BB_STAGE_COUNT };

	bb_ledger_sample(l->ledger, BB_METRIC_LATE_FRAMES, &none);
	if (l->master_screen >= 0)
		bb_ledger_sample(l->ledger, BB_METRIC_TORN_FRAMES, &none);
	if (l->rig->shutter)
		bb_ledger_sample(l->ledger, BB_METRIC_EYE_SWAPS, &none);
	if (l->light)
		bb_ledger_sample(l->ledger, BB_METRIC_FLASHES, &none);
}

enum bb_status bb_loop_run(struct bb_frame_loop *l, struct bb_error *err)
{
	const double duration_s = l->options->duration_s > 0 ? l->options->duration_s : l->scene->duration_s;
	/* A quarter of a second for edges, camera clocks and pose to settle before the scene's time 0. */
	const int64_t settle_ns = BB_NS_PER_S / 4;
	enum bb_status status = start_shutters(l);

	for (size_t i = 0; l->draw_everything && i < l->room->n_nodes; i++)
		if (bb_remote_plays(l, i))
			bb_node_warm_up(&l->nodes[i]);
	if (status == BB_OK)
		status = start_cameras(l);
	if (status == BB_OK)
		status = start_links(l);
	l->scene_start_ns = bb_clock_now_ns(l->clk) + settle_ns;
	l->end_ns = l->scene_start_ns + (int64_t)(duration_s * 1e9);
	if (l->world)
		sim_world_set_scene_start(l->world, l->scene_start_ns);
	if (status == BB_OK && l->processes)
		status = bb_remote_start(l);
	if (status == BB_OK && l->world)
		status = sim_faults_start(l->world);
	for (size_t i = 0; i < l->room->n_cameras; i++)
		l->cameras[i].seen_ns = l->scene_start_ns;
	bb_pose_begin(l);
	start_counts(l);
	bb_clock_run_until(l->clk, l->scene_start_ns);
	bb_eyes_init(l);
	bb_shutters_feed(l, l->scene_start_ns); /* where to begin depends on whose eye is when */
	bb_light_skip(l->light, l->scene_start_ns);
	if (status == BB_OK)
		status = bb_clock_arm(l->clk, &l->begin, bb_head_next_begin_ns(l, l->scene_start_ns));
	if (status != BB_OK)
		return bb_fail(err, status, 1503, NULL, "starting the scene: %s", bb_status_text(status));
	/* The loop stops the clock itself at its first frame past the end. */
	bb_clock_run_until(l->clk, l->end_ns + 60 * BB_NS_PER_S);
	bb_remote_end(l);
	l->result->truncated = bb_loop_interrupted(l);
	bb_lock_prove(l);
	/* The last frames' flips would come after the end: they are let go, not judged. */
	for (size_t i = 0; i < l->room->n_nodes; i++)
		bb_node_flips(l, &l->nodes[i]);
	if (l->n_frames > 2)
		bb_frames_close(l, l->n_frames - 2);
	if (l->processes)
		bb_remote_tell(l);
	return BB_OK;
}
