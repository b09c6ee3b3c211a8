/* bench/loop/head.c: the head node: begins frames, tells the nodes, keeps the barrier. */
#include "bench/loop/lock.h"
#include "bench/loop/remote.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WALL_STEP_NS (10 * 1000000) /* more than slewing does in a frame */

/* ---- time in the data ---- */

double bb_loop_steps_at(const struct bb_scene *scene, uint32_t n_steps, double t_s)
{
	const double last = n_steps > 1 ? (double)(n_steps - 1) : 0;
	const double at = scene->data.seconds_per_step > 0 ? t_s / scene->data.seconds_per_step : 0;

	if (last <= 0)
		return 0;
	if (scene->data.loop == BB_LOOP_HOLD)
		return fmin(at, last);
	if (scene->data.loop == BB_LOOP_REPEAT)
		return fmod(at, last);
	const double turn = fmod(at, 2 * last);
	return turn <= last ? turn : 2 * last - turn;
}

/* ---- where and when ---- */

/* The time the middle row of this frame's image should reach an eye if all goes as planned. */
static int64_t planned_photon_ns(const struct bb_frame_loop *l, int64_t start_ns)
{
	if (l->master_screen < 0)
		return start_ns + l->frame_ns;
	const int64_t middle_ns = start_ns + l->refresh_ns + bb_loop_middle_ns(l, (size_t)l->master_screen);

	/* The first eye: with external shutters one of the two is always open. */
	if (l->room->screens[l->master_screen].display.stereo == BB_STEREO_FRAME_SEQUENTIAL)
		return bb_phase_open_ns(&l->phase, BB_EYE_LEFT, middle_ns);
	return middle_ns;
}

/* ---- begin ---- */

static struct bb_frame *open_frame(struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_frame *f = &l->frames[l->n_frames % BB_FRAMES_RING];

	memset(f, 0, sizeof(*f));
	f->frame = l->n_frames++;
	f->open = true;
	f->start_ns = now_ns;
	f->pose_error_mm = f->solved_sigma_mm = (double)NAN;
	f->last_node = BB_NOBODY;
	for (size_t s = 0; s < l->room->n_screens; s++)
		l->flipped[s] &= ~(UINT64_C(1) << f->frame % 64);
	return f;
}

/* Somebody wants it to end: the outputs go to their safe state first. */
bool bb_head_stopped(struct bb_frame_loop *l, int64_t now_ns)
{
	if (!bb_loop_interrupted(l))
		return false;
	bb_eyes_open(l, now_ns);
	l->result->truncated = true;
	l->result->duration_s = (double)(now_ns - l->scene_start_ns) * 1e-9;
	bb_result_fact(l->result, "stopped_by", "signal %d", (int)*l->options->stop);
	return true;
}

/*
 * Row O4: the machine slept, or the loop got no processor: more than three frames late. What was measured by edges and
 * stamps before is worth nothing, and frames that were not drawn are not made up for: the next one is the one for now.
 */
static void watch_gap(struct bb_frame_loop *l, int64_t now_ns)
{
	const int64_t late_ns = now_ns - l->due_ns;

	if (!l->due_ns || late_ns <= 3 * l->frame_ns) {
		bb_watch_good(l->watch, l->node_slot[bb_loop_head(l)], now_ns);
		return;
	}
	bb_watch_bad(l->watch, l->node_slot[bb_loop_head(l)], now_ns, BB_HEALTH_DEGRADED,
	             "GAP %.0f ms: suspended or starved, %lld frames left out", (double)late_ns * 1e-6,
	             (long long)(late_ns / l->frame_ns));
	bb_result_count(l->result, "gaps", 1);
	bb_result_count(l->result, "gap_ms", (uint64_t)(late_ns / 1000000));
	bb_eyes_gap(l, now_ns);
	for (size_t i = 0; i < l->room->n_cameras; i++)
		if (l->rig->cameras[i])
			bb_timemap_init(&l->camera_map[i], bb_camera_limits(l->rig->cameras[i])->least_latency_ns);
}

/* Row N4: somebody set the wall clock. Nothing here reads it; a person who compares logs should know. */
static void watch_wall(struct bb_frame_loop *l, int64_t now_ns)
{
	int64_t ahead_ns;

	if (!bb_clock_wall_ahead_ns(l->clk, &ahead_ns))
		return;
	const int64_t step_ns = ahead_ns - l->wall_ahead_ns;
	if (l->wall_known && llabs(step_ns) > WALL_STEP_NS) {
		bb_watch_warn(l->watch, l->node_slot[bb_loop_head(l)], now_ns,
		              "CLOCK_STEP %+.3f s: somebody set the wall clock, which times nothing here", (double)step_ns * 1e-9);
		bb_result_count(l->result, "wall_clock_set", 1);
	}
	l->wall_ahead_ns = ahead_ns;
	l->wall_known = true;
}

/* The patch goes by the time of the frame, or by that of what the cameras saw last: a lamp that is lit in every other half of
 * its period, as a patch would be. */
static void follow_patch(struct bb_frame_loop *l, struct bb_frame *f)
{
	const bool cameras = l->scene->patch.follows == BB_FOLLOWS_CAMERAS;
	const double hz = l->scene->patch.hz;
	const int64_t at_ns = cameras ? f->mid_exposure_ns : f->start_ns;

	if (at_ns)
		l->patch_s = (double)(at_ns - l->scene_start_ns) * 1e-9;
	if (!l->diode)
		return;
	f->lamp_ns = l->scene_start_ns + llround((floor(l->patch_s * hz - 0.5) + 0.5) / hz * 1e9);
	bb_diode_frame(l->diode, f->frame, bb_patch_is_high(l->scene, l->patch_s), f->start_ns);
}

int64_t bb_head_begin(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = bb_container_of(timer, struct bb_frame_loop, begin);
	const struct bb_node_machine *head = &l->nodes[bb_loop_head(l)];

	if (now_ns >= l->end_ns || bb_head_stopped(l, now_ns)) {
		bb_clock_stop(l->clk);
		return BB_NEVER;
	}
	if (l->world && sim_world_node_suspended(l->world, (uint16_t)bb_loop_head(l)))
		return scheduled_ns + l->frame_ns; /* so that it wakes in phase */
	for (size_t i = 0; i < l->room->n_nodes; i++)
		bb_node_flips(l, &l->nodes[i]);
	if (l->n_frames >= 3)
		bb_frames_close(l, l->n_frames - 2);
	watch_gap(l, now_ns);
	watch_wall(l, now_ns);
	struct bb_frame *f = open_frame(l, now_ns);
	bb_remote_woke(l, scheduled_ns, now_ns);
	l->was_away = !l->turn_ns || now_ns - l->turn_ns > 3 * l->frame_ns;
	l->turn_ns = now_ns;
	bb_shutters_read(l, f, scheduled_ns);
	bb_track_read(l, f, scheduled_ns);
	bb_pads_read(l, scheduled_ns);
	follow_patch(l, f);
	bb_eyes_step(l, f, scheduled_ns);

	const double t_s = (double)(now_ns - l->scene_start_ns) * 1e-9;
	/* A picture belongs to the frame that is on show at its time: the last one for a time at the very end. */
	l->picture_frame = l->pictures && bb_pictures_due(l->pictures, t_s + (double)l->frame_ns * 1e-9);
	const uint32_t n_steps = l->bricks ? bb_bricks_header(l->bricks)->tree.n_steps : 1;
	l->steps = bb_loop_steps_at(l->scene, n_steps, t_s);
	const double soon = bb_loop_steps_at(l->scene, n_steps, t_s + 1e-3 * l->scene->data.seconds_per_step);
	/* From the last step to the first is on, too. */
	l->way = soon > l->steps ? 1 : soon < l->steps ? (l->scene->data.loop == BB_LOOP_REPEAT ? 1 : -1) : 0;
	for (int i = 0; i < BB_AHEAD; i++)
		l->ahead[i] = bb_loop_steps_at(l->scene, n_steps, t_s + (i + 1) * l->scene->data.seconds_per_step);
	f->photon_ns = planned_photon_ns(l, now_ns);
	bb_pose_predict(l, f, scheduled_ns);
	const int64_t cost_ns = l->tracker && !l->draw_everything ? (int64_t)head->profile.track_ns : 0;
	if (bb_clock_arm(l->clk, &l->send, bb_clock_now_ns(l->clk) + cost_ns) != BB_OK)
		bb_clock_stop(l->clk);
	if (l->options->progress)
		l->options->progress(l->options->progress_ctx,
		                     (double)(now_ns - l->scene_start_ns) / (double)(l->end_ns - l->scene_start_ns),
		                     "frames");
	return BB_NEVER;
}

int64_t bb_head_send(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = bb_container_of(timer, struct bb_frame_loop, send);
	struct bb_frame *f = bb_loop_frame(l, l->n_frames - 1);
	const unsigned head = bb_loop_head(l);
	struct bb_message m = { .kind = BB_MESSAGE_STATE,
		                      .frame = f->frame,
		                      .photon_ns = f->photon_ns,
		                      .silence_ns = bb_loop_silence_ns(l),
		                      .eyes = f->eyes,
		                      .navigation = l->navigation,
		                      .scene_s = l->patch_s,
		                      .steps = l->steps,
		                      .way = (int16_t)l->way,
		                      .swapped = l->eyes.swapped,
		                      .depth = (uint16_t)lround(BB_WHOLE * l->eyes.out.depth),
		                      .light = (uint16_t)lround(BB_WHOLE * l->eyes.out.light * l->options->dim) };
	memcpy(m.ahead, l->ahead, sizeof(m.ahead));
	(void)scheduled_ns;

	f->tracked_ns = now_ns;
	if (l->processes)
		l->barrier.timeout_ns = bb_loop_barrier_timeout_ns(l);
	l->usual_ns -= l->usual_ns / 8;
	bb_barrier_open(&l->barrier, f->frame, l->drawing_nodes, now_ns);
	if (!l->lock && bb_clock_arm(l->clk, &l->deadline, l->barrier.deadline_ns) != BB_OK)
		bb_clock_stop(l->clk);
	for (unsigned i = 0; i < l->room->n_nodes; i++) {
		if (!(l->drawing_nodes >> i & 1))
			continue;
		m.quality = (uint16_t)lround(l->straggler.node[i].quality * BB_WHOLE);
		bb_loop_say(l, head, i, &m);
	}
	if (l->lock)
		bb_lock_begun(l, f, now_ns);
	return BB_NEVER;
}

/* ---- barrier ---- */

/* May a frame begin at this vblank? Frame-sequential ones begin where the next vblank is the left eye's; while nobody
 * knows whose it is, two refreshes after the last one all the same, since two pictures are shown. */
static bool begins_here(const struct bb_frame_loop *l, int64_t vblank_ns, int64_t period_ns)
{
	if (l->room->screens[l->master_screen].display.stereo != BB_STEREO_FRAME_SEQUENTIAL)
		return true;
	const enum bb_eye eye = bb_phase_eye_at(&l->phase, vblank_ns + period_ns + period_ns / 2);
	return eye == BB_EYE_NONE ? !l->turn_ns || vblank_ns - l->turn_ns > period_ns * 5 / 4 : eye == BB_EYE_LEFT;
}

int64_t bb_head_next_begin_ns(const struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_vblank v;

	if (l->master_screen < 0 || bb_display_vblank(l->rig->displays[l->master_screen], &v) != BB_OK) {
		const int64_t n = (now_ns - l->scene_start_ns) / l->frame_ns + 1;
		return l->scene_start_ns + bb_rate_frame_ns(l->frame_rate, n);
	}
	const int64_t period_ns = bb_display_limits(l->rig->displays[l->master_screen])->period_ns;
	int64_t at_ns = v.at_ns;
	do
		at_ns += period_ns;
	while (at_ns + VBLANK_GUARD_NS <= now_ns || !begins_here(l, at_ns, period_ns));
	return at_ns + VBLANK_GUARD_NS;
}

/* Found by name at the first arrival, as the order of the log's sources is part of it. */
static uint16_t barrier_source(struct bb_frame_loop *l)
{
	if (!l->barrier_source)
		l->barrier_source = bb_eventlog_source(l->events, "barrier", "swap");
	return l->barrier_source;
}

static void blame_late_node(struct bb_frame_loop *l, const struct bb_frame *f, uint64_t waited, int64_t now_ns)
{
	for (unsigned i = 0; i < l->room->n_nodes; i++) {
		const bool missing = f->missing_nodes >> i & 1;
		if (missing || (f->late && i == f->last_node))
			bb_watch_bad(l->watch, l->node_slot[i], now_ns, missing ? BB_HEALTH_LOST : BB_HEALTH_DEGRADED,
			             missing ? "frame %llu: did not come to the swap barrier"
			                     : "frame %llu: came last and too late to the swap barrier",
			             (unsigned long long)f->frame);
		else if ((l->drawing_nodes & waited) >> i & 1)
			bb_watch_good(l->watch, l->node_slot[i], now_ns);
	}
}

static void note_late(struct bb_frame_loop *l, const struct bb_frame *f, int64_t now_ns)
{
	const unsigned missing = f->missing_nodes ? (unsigned)__builtin_ctzll(f->missing_nodes) : f->last_node;
	struct bb_black_trigger t = { .kind = BB_BLACK_LATE, .at_ns = now_ns, .frame = f->frame, .node = (uint16_t)missing,
		                      .missing = f->missing_nodes,
		                      .all_missing = l->drawing_nodes && f->missing_nodes == l->drawing_nodes };

	if ((!f->late && !f->missing_nodes) || missing >= l->room->n_nodes)
		return;
	const struct bb_node_times *n = &f->node[missing];
	t.unheard = !n->received_ns;
	if (n->ready_ns) {
		t.state_ns = n->received_ns - f->tracked_ns;
		t.load_ns = l->nodes[missing].load_ns;
		t.select_ns = n->selected_ns - n->received_ns - t.load_ns;
		t.draw_ns = n->ready_ns - n->selected_ns;
	}
	bb_blackbox_trigger(l->blackbox, &t);
}

/* Who is too slow draws coarser from the next frame on. */
static void judge_stragglers(struct bb_frame_loop *l, const struct bb_frame *f, uint64_t waited, int64_t now_ns)
{
	for (unsigned i = 0; i < l->room->n_nodes; i++) {
		const struct bb_node_times *t = &f->node[i];
		if ((l->drawing_nodes & waited) >> i & 1 && t->received_ns)
			bb_straggler_note(&l->straggler, i, (t->ready_ns ? t->ready_ns : now_ns) - t->received_ns);
	}
	const struct bb_straggler_verdict v = bb_straggler_decide(&l->straggler);
	struct bb_node_machine *n = &l->nodes[v.node];
	const double quality = l->straggler.node[v.node].quality;
	if (v.change == BB_STRAGGLER_LOWER && !n->coarse)
		n->coarse = 1 + bb_watch_warn(l->watch, l->node_slot[v.node], now_ns,
		                              "STRAGGLER: frame %llu took %.1f ms of %.1f; it draws %.0f %% of its samples",
		                              (unsigned long long)f->frame,
		                              (double)(f->node[v.node].ready_ns - f->node[v.node].received_ns) * 1e-6,
		                              (double)l->straggler.refresh_ns * 1e-6, quality * 100);
	if (v.change == BB_STRAGGLER_RAISE && n->coarse && quality >= 1) {
		bb_watch_over(l->watch, n->coarse - 1, now_ns);
		n->coarse = 0;
	}
	if (v.change == BB_STRAGGLER_LOWER)
		bb_result_count(l->result, "qualities_lowered", 1);
}

void bb_head_note_release(struct bb_frame_loop *l, const struct bb_release *r, uint64_t waited, int64_t now_ns)
{
	struct bb_frame *f = bb_loop_frame(l, r->frame);

	if (f) {
		f->release_ns = now_ns;
		f->last_node = r->last;
		f->missing_nodes = r->missing;
		f->late = now_ns > f->start_ns + l->refresh_ns;
		blame_late_node(l, f, waited, now_ns);
		note_late(l, f, now_ns);
	}
	/* In one process that draws for real, one node's time is all nodes' time. */
	if (f && (l->processes || !l->draw_everything))
		judge_stragglers(l, f, waited, now_ns);
	bb_eventlog_add(l->events, barrier_source(l), BB_EV_RELEASE, now_ns, (int64_t)r->frame, (int64_t)r->missing);
	bb_ledger_mark(l->ledger, BB_TRACK_BARRIER, (uint16_t)bb_loop_head(l), now_ns, (int32_t)r->frame, 0);
}

void bb_head_begin_next(struct bb_frame_loop *l, int64_t now_ns)
{
	l->due_ns = bb_head_next_begin_ns(l, now_ns);
	if (bb_clock_arm(l->clk, &l->begin, l->due_ns) != BB_OK)
		bb_clock_stop(l->clk);
}

void bb_head_step_barrier(struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_release r;

	if (l->lock || !bb_barrier_step(&l->barrier, now_ns, &r))
		return;
	const struct bb_message m = { .kind = BB_MESSAGE_RELEASE, .frame = r.frame };
	bb_clock_disarm(l->clk, &l->deadline);
	bb_head_note_release(l, &r, ~l->barrier.dropped, now_ns);
	for (unsigned i = 0; i < l->room->n_nodes; i++)
		if (l->drawing_nodes >> i & 1)
			bb_loop_say(l, bb_loop_head(l), i, &m);
	bb_head_begin_next(l, now_ns);
}

int64_t bb_head_deadline(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	(void)scheduled_ns;
	bb_head_step_barrier(bb_container_of(timer, struct bb_frame_loop, deadline), now_ns);
	return BB_NEVER;
}

void bb_head_hear(struct bb_frame_loop *l, unsigned from, const struct bb_message *m, int64_t now_ns)
{
	if (m->kind != BB_MESSAGE_ARRIVE)
		return;
	bb_eventlog_add(l->events, barrier_source(l), BB_EV_ARRIVE, now_ns,
	                (int64_t)m->frame, from);
	bb_barrier_arrive(&l->barrier, from, m->frame, now_ns);
	bb_head_step_barrier(l, now_ns);
}

int64_t bb_head_inbox(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct bb_frame_loop *l = bb_container_of(timer, struct bb_frame_loop, head_inbox);
	struct bb_link_message packet;
	struct bb_message m;
	(void)scheduled_ns;

	while (bb_link_receive(l->rig->link, (uint16_t)bb_loop_head(l), &packet) == BB_OK) {
		if (bb_remote_hear(l, &packet, now_ns) || bb_lock_hear(l, bb_loop_head(l), &packet, now_ns) ||
		    packet.n_bytes != sizeof(m))
			continue;
		memcpy(&m, packet.bytes, sizeof(m));
		if (m.kind == BB_MESSAGE_ARRIVE)
			bb_head_hear(l, packet.from, &m, now_ns);
		else
			bb_node_hear(&l->nodes[bb_loop_head(l)], &m, now_ns);
	}
	return BB_NEVER;
}
