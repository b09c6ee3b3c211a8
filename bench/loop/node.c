/* bench/loop/node.c: a render node: on scene state it selects, streams and draws; on release it presents. */
#include "bench/loop/lock.h"
#include "bench/loop/remote.h"

#include <math.h>
#include <string.h>

#define NEAR_M 0.05
#define FAR_M 60.0
#define NO_FRAME UINT64_MAX /* pictures shown once more: their flips are of no frame */

static struct bb_corners move_corners(const struct bb_pose *by, const struct bb_corners *c)
{
	return (struct bb_corners){ bb_pose_apply(by, c->lower_left), bb_pose_apply(by, c->lower_right),
		                    bb_pose_apply(by, c->upper_left) };
}

/* Does the stage before this screen open for the other eye than the glasses do? */
static bool eyes_swapped(const struct bb_frame_loop *l, uint16_t screen, uint32_t swapped)
{
	for (int i = 0; swapped && i < l->room->chain.n_stages; i++)
		if (swapped >> i & 1 && !strcmp(l->room->chain.stage[i], l->room->walls[l->room->screens[screen].wall].id))
			return l->room->screens[screen].display.stereo == BB_STEREO_DUAL_PROJECTOR;
	return false;
}

static unsigned make_screen(struct bb_node_machine *n, size_t s, const struct bb_message *m, const struct bb_vec3 eye[2],
                            struct bb_vec3 fallback)
{
	const struct bb_frame_loop *l = n->loop;
	const struct bb_corners c = move_corners(&m->navigation, &l->room->screens[n->screens[s]].corners);
	const unsigned other = l->n_eyes > 1 && eyes_swapped(l, n->screens[s], m->swapped);
	unsigned flags = 0;

	for (unsigned e = 0; e < l->n_eyes; e++) {
		struct bb_view *v = &n->views[s * l->n_eyes + e];
		*v = bb_view_make(&c, eye[e ^ other], fallback, NEAR_M, FAR_M);
		flags |= v->flags;
	}
	return flags;
}

static bool same_pose(const struct bb_pose *a, const struct bb_pose *b)
{
	return a->p.x == b->p.x && a->p.y == b->p.y && a->p.z == b->p.z && a->q.w == b->q.w && a->q.x == b->q.x &&
	       a->q.y == b->q.y && a->q.z == b->q.z;
}

static bool same_cause(const struct bb_view_cause *a, const struct bb_view_cause *b)
{
	return same_pose(&a->navigation, &b->navigation) && same_pose(&a->eyes, &b->eyes) && a->depth == b->depth &&
	       a->swapped == b->swapped;
}

/* Views of every screen for every eye; navigation carries the room through the world like a vehicle. */
static void make_views(struct bb_node_machine *n, const struct bb_message *m, struct bb_frame *f)
{
	struct bb_frame_loop *l = n->loop;
	const struct bb_pose eyes = bb_pose_mul(&m->navigation, &m->eyes);
	const struct bb_vec3 fallback = bb_pose_apply(&m->navigation, l->room->neutral);
	struct bb_vec3 eye[2];

	/* A viewer who sits still leaves the views as they are. */
	const struct bb_view_cause cause = { m->navigation, m->eyes, m->depth, m->swapped };
	if (!n->made || !same_cause(&cause, &n->made_for)) {
		n->made_for = cause;
		n->made = true;
		n->view_flags = 0;
		bb_view_eyes(&eyes, l->room->eye_separation_m * (m->depth / (double)BB_WHOLE), &eye[0], &eye[1]);
		if (l->n_eyes == 1)
			eye[0] = eyes.p;
		for (size_t s = 0; s < n->n_screens; s++)
			n->view_flags |= make_screen(n, s, m, eye, fallback);
	}
	if (f)
		f->view_flags |= n->view_flags;
}

static uint64_t brick_bytes(const struct bb_node_machine *n)
{
	return n->stream ? bb_stream_atlas(n->stream)->slot_bytes : 0;
}

/* Bricks that may still be uploaded within the limit that makes a frame late, if it costs what the last one did; one
 * always may, or nothing would ever change. */
static uint32_t bricks_in_time(const struct bb_node_machine *n)
{
	const struct bb_profile *p = &n->profile;
	const double each_ns = p->per_brick_ns + p->per_byte_ns * (double)brick_bytes(n);
	const double left_ns = n->loop->result->streaming.limit_ms * 1e6 - (double)n->draw_ns -
	                       p->select_per_brick_ns * n->counts.drawn;

	if (!(each_ns > 0) || left_ns / each_ns > 1e9)
		return UINT32_MAX;
	return left_ns > each_ns ? (uint32_t)(left_ns / each_ns) : 1;
}

void bb_node_book(struct bb_node_machine *n, struct bb_frame *f, const struct bb_stream_counts *c, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;
	const struct bb_sample bytes = { .value = (double)c->bytes, .frame = n->frame, .at_ns = now_ns, .node = n->index,
		                         .stage = BB_STAGE_SELECT };

	if (!l->bricks)
		return;
	if (f) {
		f->bricks_wanted += c->drawn;
		f->bricks_missing += c->missing;
		f->bricks_loaded += c->loaded;
		f->bytes += c->bytes;
		f->deficit += c->deficit;
	}
	bb_streaming_frame(n, c, now_ns);
	bb_result_count(l->result, "bricks_wanted", c->drawn);
	bb_result_count(l->result, "bricks_missing", c->missing);
	bb_result_count(l->result, "bricks_loaded", c->loaded);
	bb_result_count(l->result, "bricks_evicted", c->evicted);
	bb_result_count(l->result, "bytes_streamed", c->bytes);
	bb_result_count(l->result, "rays", c->rays);
	bb_result_count(l->result, "samples", c->samples);
	bb_ledger_sample(l->ledger, BB_METRIC_STREAM, &bytes);
}

static struct bb_stream_counts select_bricks(struct bb_node_machine *n, const struct bb_message *m, struct bb_frame *f)
{
	struct bb_frame_loop *l = n->loop;
	const struct bb_display_config *d = &l->room->screens[n->screens[0]].display;

	if (!n->stream)
		return (struct bb_stream_counts){ 0 };
	const double step_ns = l->scene->data.seconds_per_step * 1e9;
	const struct bb_stream_frame frame = { .views = n->views, .n_views = n->n_views, .width_px = (uint32_t)d->width_px,
		                               .height_px = (uint32_t)d->height_px, .step = m->steps,
		                               .step_voxels = l->scene->data.step_voxels / n->quality, .way = m->way, .ahead = m->ahead,
		                               .n_ahead = BB_AHEAD,
		                               .ahead_frames = (uint32_t)(step_ns / (double)l->frame_ns) + 1,
		                               .bricks_most = bricks_in_time(n), .now_ns = bb_clock_now_ns(l->clk) };
	struct bb_stream_counts c = { 0 };

	if (n->disk)
		bb_stream_disk_stall(n->disk, l->world && sim_world_node_stalled(l->world, n->index), frame.now_ns);
	c = bb_stream_frame(n->stream, &frame);
	bb_node_book(n, f, &c, frame.now_ns);
	return c;
}

void bb_node_take_pictures(struct bb_node_machine *n, const struct bb_message *m)
{
	struct bb_frame_loop *l = n->loop;
	const struct bb_vec3 hand = bb_pose_apply(&m->eyes, (struct bb_vec3){ 0.2, -0.3, -0.5 });
	struct bb_vec3 cursor = hand;

	bb_pictures_fade(l->pictures, m->light / (double)BB_WHOLE, l->patch_s);
	if (l->room->n_bodies > 1 && l->tracker) {
		const struct bb_track_pose wand = bb_tracker_pose(l->tracker, 1, m->photon_ns);
		if (!(wand.flags & BB_TRACK_NEVER))
			cursor = wand.body.p;
	}
	cursor = bb_pose_apply(&m->navigation, cursor);
	for (size_t s = 0; s < n->n_screens; s++)
		for (unsigned e = 0; e < l->n_eyes && bb_pictures_wants(l->pictures, l->room->screens[n->screens[s]].wall); e++)
			if (bb_pictures_take(l->pictures, n->screens[s], e, l->n_eyes, &n->views[s * l->n_eyes + e], n->stream,
			                     &cursor, NULL) != BB_OK)
				bb_result_count(l->result, "pictures_failed", 1);
}

/* Posix: every view is really drawn, at the scene's picture scale. */
static void draw_all(struct bb_node_machine *n, uint16_t light)
{
	struct bb_frame_loop *l = n->loop;

	for (size_t v = 0; v < n->n_views; v++) {
		const struct bb_screen *s = &l->room->screens[n->screens[v / l->n_eyes]];
		const struct bb_layer layer = n->stream ? bb_stream_layer(n->stream) : (struct bb_layer){ 0 };
		const struct bb_draw draw = { .view = &n->views[v], .layers = &layer, .n_layers = 1,
			                      .step_voxels = l->scene->data.step_voxels / n->quality };
		struct bb_image *image = bb_loop_canvas(l, s);
		enum bb_status status = BB_ERR_NOMEM;
		if (image && n->stream)
			status = bb_renderer_draw(l->renderer, &draw, image, NULL);
		else if (image)
			status = bb_calibration_draw(&n->views[v], s->id, v % l->n_eyes == 0, NULL, image);
		if (status == BB_OK) {
			bb_patch_draw(l->room, l->scene, n->screens[v / l->n_eyes], l->patch_s, image);
			if (light < BB_WHOLE)
				bb_light_fade(image, light / (double)BB_WHOLE);
			bb_light_pixels(l->light, n->screens[v / l->n_eyes], (unsigned)(v % l->n_eyes), image);
		} else {
			bb_result_count(l->result, "draws_failed", 1);
		}
	}
}

/* What can be seen from where the viewer stands when the scene begins is read during bring-up. */
void bb_node_fill(struct bb_node_machine *n)
{
	const struct bb_message m = { .eyes = n->loop->start, .navigation = BB_POSE_IDENTITY, .depth = BB_WHOLE };
	const struct bb_display_config *d = &n->loop->room->screens[n->screens[0]].display;

	make_views(n, &m, NULL);
	const struct bb_stream_frame frame = { .views = n->views, .n_views = n->n_views, .width_px = (uint32_t)d->width_px,
		                               .height_px = (uint32_t)d->height_px, .bricks_most = UINT32_MAX,
		                               .step_voxels = n->loop->scene->data.step_voxels };
	bb_stream_settle(n->stream, &frame);
}

/* The first draw compiles shaders and fills textures: that belongs to bring-up, not to the scene. */
void bb_node_warm_up(struct bb_node_machine *n)
{
	const struct bb_message m = { .eyes = { n->loop->room->neutral, BB_QUAT_IDENTITY },
		                      .navigation = BB_POSE_IDENTITY, .depth = BB_WHOLE };

	make_views(n, &m, NULL);
	draw_all(n, BB_WHOLE);
}

static int64_t plant_ns(const struct bb_frame_loop *l, const struct bb_node_machine *n, int64_t now_ns)
{
	return l->options->plant_draw_ns + (l->world ? sim_world_node_delay_ns(l->world, n->index, now_ns) : 0);
}

static int64_t dragged_ns(const struct bb_node_machine *n)
{
	const int64_t ppm = n->loop->world ? sim_world_node_drag_ppm(n->loop->world, n->index) : 0;

	return (int64_t)((double)n->draw_ns * (double)ppm * 1e-6);
}

static void begin(struct bb_node_machine *n, const struct bb_message *told, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;
	struct bb_frame *f = bb_loop_frame(l, told->frame);

	if (l->world && sim_world_node_dead(l->world, n->index, now_ns))
		return;
	if (l->lock && n->ready.slot)
		return; /* flips at planned times wait for nobody: what is being drawn is drawn to its end */
	const struct bb_message own = bb_orphan_dim(n, told, now_ns), *m = &own;
	n->frame = m->frame;
	n->quality = m->quality ? m->quality / (double)BB_WHOLE : 1;
	l->patch_s = m->scene_s;
	make_views(n, m, f);
	const struct bb_stream_counts c = select_bricks(n, m, f);
	n->draw_ns = bb_profile_draw_ns(&n->profile, n->n_views, c.rays, c.samples, 0, 0);
	n->load_ns = bb_profile_draw_ns(&n->profile, n->n_views, c.rays, c.samples, c.arrived,
	                                 c.arrived * brick_bytes(n)) - n->draw_ns;
	int64_t selected_ns = now_ns + (int64_t)(n->profile.select_per_brick_ns * c.drawn) + n->load_ns;
	int64_t ready_ns = selected_ns + plant_ns(l, n, now_ns) + n->draw_ns + dragged_ns(n);
	if (l->draw_everything) {
		selected_ns = bb_clock_now_ns(l->clk);
		n->load_ns = c.loaded || c.arrived ? selected_ns - now_ns : 0;
		draw_all(n, m->light);
		ready_ns = bb_clock_now_ns(l->clk) + plant_ns(l, n, now_ns);
	}
	if (l->picture_frame)
		bb_node_take_pictures(n, m);
	if (f) {
		f->node[n->index].received_ns = now_ns;
		f->node[n->index].selected_ns = selected_ns;
		f->load_ns = n->load_ns > f->load_ns ? n->load_ns : f->load_ns;
	}
	bb_eventlog_add(l->events, n->source, BB_EV_SELECT, now_ns, c.drawn, (int64_t)c.bytes);
	if (bb_clock_arm(l->clk, &n->ready, ready_ns) != BB_OK)
		bb_clock_stop(l->clk);
}

void bb_node_drawn(struct bb_node_machine *n, struct bb_frame *f, int64_t ready_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;
	struct bb_node_times *t = &f->node[n->index];

	t->ready_ns = ready_ns;
	const bool by_bricks = bb_streaming_ready(n, t->received_ns, t->ready_ns);
	const struct bb_sample s = { .value = (double)(t->ready_ns - t->received_ns) * 1e-6, .frame = n->frame,
		                     .at_ns = now_ns, .node = n->index,
		                     .stage = by_bricks ? BB_STAGE_SELECT : BB_STAGE_DRAW };
	bb_ledger_sample(l->ledger, BB_METRIC_FRAME, &s);
	bb_eventlog_add(l->events, n->source, BB_EV_DRAW, now_ns, (int64_t)n->frame, t->ready_ns - t->selected_ns);
}

int64_t bb_node_ready(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_node_machine *n = bb_container_of(timer, struct bb_node_machine, ready);
	struct bb_frame_loop *l = n->loop;
	struct bb_frame *f = bb_loop_frame(l, n->frame);
	const struct bb_message m = { .kind = BB_MESSAGE_ARRIVE, .frame = n->frame };

	if (f)
		bb_node_drawn(n, f, scheduled_ns, now_ns);
	if (l->lock)
		bb_lock_ready(l, n->index, n->frame, now_ns);
	else if (!bb_remote_only_plays(l))
		bb_loop_say(l, n->index, bb_loop_head(l), &m);
	else if (f)
		bb_remote_drew(n, f);
	return BB_NEVER;
}

/* Frame-sequential: the left image belongs to a vblank at which the glasses open the left eye. */
static uint32_t left_target(const struct bb_frame_loop *l, struct bb_display *d, const struct bb_vblank *v)
{
	const int64_t period_ns = bb_display_limits(d)->period_ns;
	const int64_t middle_ns = v->at_ns + period_ns + period_ns / 2;

	if (bb_remote_only_plays(l)) { /* it sees no shutters; the head said when the left eye is open */
		const int64_t off_ns = l->left_ns - v->at_ns, k = off_ns / period_ns - (off_ns % period_ns < 0);
		return v->seq + 1 + (uint32_t)((k + 1) & 1);
	}
	return bb_phase_eye_at(&l->phase, middle_ns) == BB_EYE_RIGHT ? v->seq + 2 : v->seq + 1;
}

/* Does the screen's last image still wait for the very vblank a new one would aim at? */
static bool still_waits(const struct bb_node_machine *n, size_t s, const struct bb_vblank *v)
{
	const struct bb_screen *screen = &n->loop->room->screens[n->screens[s]];

	return screen->display.stereo != BB_STEREO_FRAME_SEQUENTIAL && n->target[s] == v->seq + 1;
}

static enum bb_status present_screen(struct bb_node_machine *n, size_t s, uint64_t frame, const struct bb_vblank *v)
{
	struct bb_frame_loop *l = n->loop;
	struct bb_display *d = l->rig->displays[n->screens[s]];

	if (l->room->screens[n->screens[s]].display.stereo == BB_STEREO_FRAME_SEQUENTIAL) {
		const uint32_t left = left_target(l, d, v);
		const enum bb_status status = bb_display_present(d, frame, BB_EYE_LEFT, left);
		n->target[s] = left + 1;
		return status == BB_OK ? bb_display_present(d, frame, BB_EYE_RIGHT, left + 1) : status;
	}
	n->target[s] = v->seq + 1;
	return bb_display_present(d, frame, BB_EYE_NONE, v->seq + 1);
}

static void present(struct bb_node_machine *n, uint64_t frame, int64_t now_ns)
{
	struct bb_frame_loop *l = n->loop;

	for (size_t s = 0; s < n->n_screens; s++) {
		struct bb_display *d = l->rig->displays[n->screens[s]];
		struct bb_vblank v;
		if (!d)
			continue;
		enum bb_status status = bb_display_vblank(d, &v);
		if (status == BB_OK && still_waits(n, s, &v))
			bb_result_count(l->result, "frames_left_out", 1);
		else if (status == BB_OK)
			status = present_screen(n, s, frame, &v);
		bb_light_screen(l->light, n->screens[s], status >= 0 || status == BB_ERR_BUSY ? n->orphan.light : 0);
		if (status >= 0)
			continue;
		bb_result_count(l->result, "presents_refused", 1);
		bb_watch_bad(l->watch, l->display_slot[n->screens[s]], now_ns,
		             status == BB_ERR_BUSY ? BB_HEALTH_DEGRADED : BB_HEALTH_LOST, "present refused: %s",
		             bb_status_text(status));
	}
}

/*
 * Without genlock a display's vblank drifts through the instant of release. Just after it has, queueing behind the
 * waiting image would cost a refresh for ever: so a node whose last flip is due within a quarter of a refresh presents
 * right after it, and later than that (a release that jumped) the screen leaves this frame out. 0: present now.
 */
static int64_t hold_until_ns(const struct bb_node_machine *n, int64_t now_ns)
{
	const struct bb_frame_loop *l = n->loop;
	int64_t until_ns = 0;

	for (size_t s = 0; s < n->n_screens; s++) {
		struct bb_display *d = l->rig->displays[n->screens[s]];
		struct bb_vblank v;
		if (!d || bb_display_vblank(d, &v) != BB_OK || !still_waits(n, s, &v))
			continue;
		const int64_t period_ns = bb_display_limits(d)->period_ns, due_ns = v.at_ns + period_ns + VBLANK_GUARD_NS;
		if (due_ns - now_ns < period_ns / 4 && due_ns > until_ns)
			until_ns = due_ns;
	}
	return until_ns;
}

static bool alternates(const struct bb_node_machine *n)
{
	for (size_t s = 0; s < n->n_screens; s++)
		if (n->loop->room->screens[n->screens[s]].display.stereo == BB_STEREO_FRAME_SEQUENTIAL)
			return true;
	return false;
}

void bb_node_show_again(struct bb_node_machine *n, const struct bb_message *m, bool anew, int64_t now_ns)
{
	if (anew && n->loop->draw_everything)
		draw_all(n, m->light);
	if (anew || alternates(n))
		present(n, NO_FRAME, now_ns);
}

int64_t bb_node_present(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_node_machine *n = bb_container_of(timer, struct bb_node_machine, hold);

	(void)scheduled_ns;
	present(n, n->frame, now_ns);
	return BB_NEVER;
}

static void hear_release(struct bb_node_machine *n, const struct bb_message *m, int64_t now_ns)
{
	struct bb_frame *f = bb_loop_frame(n->loop, m->frame);

	if (f)
		f->node[n->index].released_ns = now_ns;
	if (f && bb_remote_only_plays(n->loop))
		bb_remote_released(n, f);
	if (n->frame != m->frame || !f || !f->node[n->index].ready_ns)
		return; /* nothing to show: late, or it never heard of this frame */
	const int64_t hold_ns = hold_until_ns(n, now_ns);
	if (!hold_ns)
		present(n, n->frame, now_ns);
	else if (bb_clock_arm(n->loop->clk, &n->hold, hold_ns) != BB_OK)
		bb_clock_stop(n->loop->clk);
}

void bb_node_note_flip(struct bb_frame_loop *l, uint16_t screen, const struct bb_flip *flip)
{
	struct bb_frame *f = bb_loop_frame(l, flip->frame);
	const int64_t period_ns = bb_display_limits(l->rig->displays[screen])->period_ns;
	const enum bb_eye shown = bb_phase_eye_at(&l->phase, flip->at_ns + period_ns / 2);

	if (!f)
		return;
	if (flip->eye != BB_EYE_NONE && l->rig->shutter && shown != BB_EYE_NONE && shown != flip->eye) {
		f->eyes_swapped = true;
		f->swapped_screen = screen;
	}
	if ((int32_t)(flip->seq - flip->target_seq) > 0) {
		f->late_flips++;
		f->late_screen = screen;
		bb_watch_bad(l->watch, l->display_slot[screen], flip->at_ns, BB_HEALTH_DEGRADED,
		             "frame %llu flipped %u vblanks late", (unsigned long long)flip->frame,
		             flip->seq - flip->target_seq);
	} else {
		bb_watch_good(l->watch, l->display_slot[screen], flip->at_ns);
	}
	if (flip->eye == BB_EYE_RIGHT)
		return; /* a frame becomes visible with its first eye */
	l->flipped[screen] |= UINT64_C(1) << flip->frame % 64;
	f->flip_ns = screen ? f->flip_ns : flip->at_ns;
	if (!f->n_flips || flip->at_ns < f->first_flip_ns)
		f->first_flip_ns = flip->at_ns;
	if (!f->n_flips || flip->at_ns > f->last_flip_ns) {
		f->last_flip_ns = flip->at_ns;
		f->last_flip_screen = screen;
	}
	f->n_flips++;
}

void bb_node_flips(struct bb_frame_loop *l, struct bb_node_machine *n)
{
	struct bb_flip flips[8];
	size_t count;

	for (size_t s = 0; s < n->n_screens; s++) {
		struct bb_display *d = l->rig->displays[n->screens[s]];
		while (d && bb_display_flips(d, flips, BB_ARRAY_LEN(flips), &count) == BB_OK)
			for (size_t i = 0; i < count; i++) {
				if (bb_remote_only_plays(l)) {
					bb_remote_flipped(n, n->screens[s], &flips[i]);
					continue;
				}
				bb_node_note_flip(l, n->screens[s], &flips[i]);
				bb_crosstalk_flip(l->crosstalk, n->screens[s], &flips[i]);
				bb_diode_flip(l->diode, n->screens[s], &flips[i]);
				if (!s)
					bb_ledger_mark(l->ledger, BB_TRACK_VSYNC, n->screens[s], flips[i].at_ns,
					               (int32_t)flips[i].seq, flips[i].eye);
			}
	}
}

void bb_node_hear(struct bb_node_machine *n, const struct bb_message *m, int64_t now_ns)
{
	bb_orphan_heard(n, m, now_ns);
	if (m->kind == BB_MESSAGE_STATE)
		begin(n, m, now_ns);
	else if (m->kind == BB_MESSAGE_RELEASE)
		hear_release(n, m, now_ns);
}

int64_t bb_node_inbox(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_node_machine *n = bb_container_of(timer, struct bb_node_machine, inbox);
	struct bb_link_message packet;
	struct bb_message m;
	(void)scheduled_ns;

	while (bb_link_receive(n->loop->rig->link, n->index, &packet) == BB_OK) {
		if (bb_remote_hear(n->loop, &packet, now_ns) || bb_lock_hear(n->loop, n->index, &packet, now_ns) ||
		    packet.n_bytes != sizeof(m))
			continue;
		memcpy(&m, packet.bytes, sizeof(m));
		bb_node_hear(n, &m, now_ns);
	}
	return BB_NEVER;
}
