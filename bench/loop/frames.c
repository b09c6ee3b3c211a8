/* bench/loop/frames.c: closes frames: once the last flip is known a frame becomes samples, spans and a row. */
#include "bench/latency.h"
#include "bench/loop/loop.h"

#include <math.h>
#include <stdio.h>

#define HALF_RISE (0.69314718 / 2.19722458) /* of the 10-90 % rise of an exponential: ln 2 / ln 9 */

struct bb_frame *bb_loop_frame(struct bb_frame_loop *l, uint64_t frame)
{
	struct bb_frame *f = &l->frames[frame % BB_FRAMES_RING];

	return f->open && f->frame == frame ? f : NULL;
}

static void sample(struct bb_frame_loop *l, const struct bb_frame *f, enum bb_metric metric, double value, double uncertainty,
                   uint16_t node, enum bb_stage stage)
{
	const struct bb_sample s = { value, uncertainty, f->frame, f->start_ns, node, (uint16_t)stage };

	bb_ledger_sample(l->ledger, metric, &s);
}

static void span(struct bb_frame_loop *l, const struct bb_frame *f, enum bb_stage stage, uint16_t node, int64_t from_ns,
                 int64_t to_ns)
{
	if (from_ns && to_ns >= from_ns)
		bb_ledger_span(l->ledger, f->frame, stage, node, 0, from_ns, to_ns);
}

static void node_spans(struct bb_frame_loop *l, const struct bb_frame *f, uint16_t node)
{
	const struct bb_node_times *t = &f->node[node];

	span(l, f, BB_STAGE_STATE, node, f->tracked_ns, t->received_ns);
	span(l, f, BB_STAGE_SELECT, node, t->received_ns, t->selected_ns);
	span(l, f, BB_STAGE_DRAW, node, t->selected_ns, t->ready_ns);
	if (t->ready_ns && t->released_ns)
		span(l, f, BB_STAGE_BARRIER, node, t->ready_ns, t->released_ns);
}

/* Spread of the instants the nodes were released at; a node that was not released makes the frame incomplete. */
static double swap_skew_us(const struct bb_frame_loop *l, const struct bb_frame *f)
{
	int64_t first_ns = INT64_MAX, last_ns = INT64_MIN;

	for (size_t i = 0; i < l->room->n_nodes; i++) {
		const int64_t at_ns = f->node[i].released_ns;
		if (!(l->drawing_nodes >> i & 1) || !at_ns)
			continue;
		first_ns = at_ns < first_ns ? at_ns : first_ns;
		last_ns = at_ns > last_ns ? at_ns : last_ns;
	}
	return first_ns == INT64_MAX ? (double)NAN : (double)(last_ns - first_ns) * 1e-3;
}

static uint16_t node_of(const struct bb_frame_loop *l, uint16_t screen)
{
	return l->room->screens[screen].node;
}

static void note_unseen(struct bb_frame_loop *l, const struct bb_frame *f, uint16_t screen)
{
	struct bb_black_trigger t = { .kind = BB_BLACK_UNSEEN, .at_ns = f->release_ns, .frame = f->frame, .node = node_of(l, screen) };

	snprintf(t.culprit, sizeof(t.culprit), "display/%s", l->room->screens[screen].id);
	bb_blackbox_trigger(l->blackbox, &t);
}

/* Which screens never showed this frame; a node that missed the barrier has excused its own. Returns the node to blame. */
static uint16_t blame_missing_flips(struct bb_frame_loop *l, const struct bb_frame *f)
{
	uint16_t node = BB_NOBODY;

	for (uint16_t s = 0; s < l->room->n_screens; s++) {
		if (l->flipped[s] >> f->frame % 64 & 1)
			continue;
		node = node_of(l, s);
		if (f->missing_nodes >> node & 1 || !f->node[node].released_ns)
			continue;
		note_unseen(l, f, s);
		bb_watch_bad(l->watch, l->display_slot[s], f->release_ns, BB_HEALTH_DEGRADED, "never showed frame %llu",
		             (unsigned long long)f->frame);
	}
	return node;
}

/* Torn: some screen showed this frame a whole refresh after another, or never. */
static bool torn(struct bb_frame_loop *l, const struct bb_frame *f, uint16_t *node)
{
	const struct bb_display_config *d = &l->room->screens[0].display;
	const int64_t period_ns = bb_rate_period_ns(d->rate);
	/* Without genlock vblanks lie anywhere in a refresh, and a held present adds up to a quarter. */
	const int64_t most_ns = d->genlock ? period_ns / 2 : period_ns * 3 / 2;

	if (l->master_screen < 0)
		return false;
	if (f->n_flips < l->room->n_screens) {
		*node = blame_missing_flips(l, f);
		return true;
	}
	*node = node_of(l, f->last_flip_screen);
	return f->last_flip_ns - f->first_flip_ns > most_ns;
}

/* From a vblank until the middle row is half as bright as it becomes: down or up at half of the picture, or all at once when
 * it is complete (most DLP); then the pixel, exponentially. */
int64_t bb_loop_middle_ns(const struct bb_frame_loop *l, size_t screen)
{
	const struct bb_display_limits *d = bb_display_limits(l->rig->displays[screen]);
	const struct bb_display_config *c = &l->room->screens[screen].display;
	const int64_t rows_ns = c->scan == BB_SCAN_GLOBAL ? 0 : (d->period_ns - d->vblank_ns) / 2;

	return d->vblank_ns + rows_ns + (int64_t)(c->pixel_rise_us * 1e3 * HALF_RISE);
}

/* When the middle row of a screen's image reaches the first eye that can see it. */
static int64_t photon_ns(struct bb_frame_loop *l, uint16_t screen, int64_t flip_ns, int64_t *middle_ns)
{
	const bool sequential = l->room->screens[screen].display.stereo == BB_STEREO_FRAME_SEQUENTIAL;

	*middle_ns = flip_ns + bb_loop_middle_ns(l, screen);
	return sequential ? bb_phase_open_ns(&l->phase, BB_EYE_LEFT, *middle_ns) : *middle_ns;
}

/* The links of bench/latency.h, one after the other; whoever took longest is to blame. */
static bool chain(const struct bb_frame_loop *l, const struct bb_frame *f, const struct bb_node_times *t, int64_t middle_ns,
                  int64_t photon, int32_t link_ns[BB_LINK_COUNT])
{
	/* On the virtual clock nothing of the head's takes time but what the profile says of the solving. */
	const bool modelled = bb_clock_is_virtual(l->clk);
	const int64_t end[BB_LINK_COUNT] = { f->exposed_ns, f->readout_end_ns, f->arrived_ns, f->start_ns, f->read_ns,
		                             modelled ? f->tracked_ns : f->solved_ns, f->tracked_ns, t->received_ns,
		                             t->selected_ns, t->ready_ns, t->released_ns, f->last_flip_ns, middle_ns, photon };
	int64_t from_ns = f->mid_exposure_ns;

	for (int i = 0; i < BB_LINK_COUNT; i++) {
		const int64_t ns = end[i] - from_ns;
		if (!end[i] || ns > INT32_MAX || ns < INT32_MIN)
			return false;
		link_ns[i] = (int32_t)ns;
		from_ns = end[i];
	}
	return true;
}

static enum bb_stage stage_of(int link)
{
	static const enum bb_stage stage[BB_LINK_COUNT] = {
		BB_STAGE_EXPOSE, BB_STAGE_EXPOSE, BB_STAGE_TRANSFER, BB_STAGE_WAIT, BB_STAGE_TRACK, BB_STAGE_TRACK, BB_STAGE_TRACK,
		BB_STAGE_STATE, BB_STAGE_SELECT, BB_STAGE_DRAW, BB_STAGE_BARRIER, BB_STAGE_PRESENT, BB_STAGE_SCANOUT,
		BB_STAGE_SHUTTER,
	};

	return stage[link];
}

static enum bb_stage dearest(const struct bb_frame_row *row)
{
	int64_t spent_ns[BB_STAGE_COUNT] = { 0 }, most_ns = 0;
	enum bb_stage most = BB_STAGE_COUNT;

	for (int i = 0; row->chained && i < BB_LINK_COUNT; i++)
		spent_ns[stage_of(i)] += row->link_ns[i];
	for (int i = 0; i < BB_STAGE_COUNT; i++)
		if (spent_ns[i] > most_ns) {
			most_ns = spent_ns[i];
			most = (enum bb_stage)i;
		}
	return most;
}

static double angle_deg(struct bb_quat a, struct bb_quat b)
{
	return bb_quat_angle(a, b) * (180 / 3.14159265358979323846);
}

/* Against the world's truth when the light arrives: with prediction as shown, and without. */
static void judge_photon(struct bb_frame_loop *l, const struct bb_frame *f, int64_t photon, struct bb_frame_row *row)
{
	if (!l->world)
		return;
	const struct bb_pose truth = sim_world_head(l->world, photon);
	row->photon_error_mm = bb_vec3_norm(bb_vec3_sub(truth.p, f->eyes.p)) * 1e3;
	row->photon_error_deg = angle_deg(truth.q, f->eyes.q);
	bb_loop_path_point(l, photon, &truth.p, &f->eyes.p);
	if (f->track_flags & BB_TRACK_NEVER)
		return;
	row->unpredicted_mm = bb_vec3_norm(bb_vec3_sub(truth.p, f->unpredicted.p)) * 1e3;
	row->unpredicted_deg = angle_deg(truth.q, f->unpredicted.q);
	row->horizon_ms = (double)(f->photon_ns - f->solved_at_ns) * 1e-6;
	row->pose_sigma_mm = f->pose_sigma_mm;
	sample(l, f, BB_METRIC_PHOTON_ERROR, row->photon_error_mm, 0, BB_NOBODY, BB_STAGE_TRACK);
}

static void head_to_photon(struct bb_frame_loop *l, struct bb_frame *f, struct bb_frame_row *row)
{
	const uint16_t node = node_of(l, f->last_flip_screen);
	const struct bb_node_times *t = &f->node[node];
	int64_t middle_ns;

	if (!f->n_flips || l->master_screen < 0)
		return;
	if (f->flip_ns)
		bb_diode_close(l->diode, f->frame, f->lamp_ns, f->mid_exposure_ns, photon_ns(l, 0, f->flip_ns, &middle_ns));
	const int64_t photon = photon_ns(l, f->last_flip_screen, f->last_flip_ns, &middle_ns);
	span(l, f, BB_STAGE_PRESENT, node, t->released_ns, f->last_flip_ns);
	span(l, f, BB_STAGE_SCANOUT, node, f->last_flip_ns, middle_ns);
	span(l, f, BB_STAGE_SHUTTER, node, middle_ns, photon);
	judge_photon(l, f, photon, row);
	if (!f->mid_exposure_ns)
		return;
	row->chained = chain(l, f, t, middle_ns, photon, row->link_ns);
	row->head_to_photon_ms = (double)(photon - f->mid_exposure_ns) * 1e-6;
	row->pose_age_ms = (double)(f->start_ns - f->mid_exposure_ns) * 1e-6;
	/* The stamps it is made of: a camera's mid-exposure and a display's vblank. */
	const double u_ms = ((double)bb_display_limits(l->rig->displays[f->last_flip_screen])->stamp_error_ns +
	                     (double)l->camera_map[0].uncertainty_ns) * 1e-6; /* as much as can be before the first pair */
	sample(l, f, BB_METRIC_HEAD_TO_PHOTON, row->head_to_photon_ms, u_ms, node, dearest(row));
}

/* One more of a metric that counts: the judge adds the samples up. */
static void count_metric(struct bb_frame_loop *l, const struct bb_frame *f, enum bb_metric metric, uint16_t node,
                         enum bb_stage stage)
{
	sample(l, f, metric, 1, 0, node, stage);
}

static uint16_t swapped_node(const struct bb_frame_loop *l, const struct bb_frame *f)
{
	return l->master_screen < 0 ? BB_NOBODY : node_of(l, f->swapped_screen);
}

static void close_frame(struct bb_frame_loop *l, struct bb_frame *f)
{
	struct bb_frame_row row = { .frame = f->frame, .start_ns = f->start_ns, .head_to_photon_ms = (double)NAN, .frame_ms = (double)NAN,
		                    .scanout_skew_us = (double)NAN, .phase_us = (double)NAN, .pose_age_ms = (double)NAN,
		                    .pose_error_mm = f->pose_error_mm, .photon_error_mm = (double)NAN, .unpredicted_mm = (double)NAN,
		                    .photon_error_deg = (double)NAN, .unpredicted_deg = (double)NAN, .horizon_ms = (double)NAN,
		                    .pose_sigma_mm = (double)NAN, .solved_sigma_mm = f->solved_sigma_mm, .cameras = f->cameras,
		                    .bricks_wanted = f->bricks_wanted, .bricks_missing = f->bricks_missing,
		                    .bricks_loaded = f->bricks_loaded, .late_node = UINT32_MAX, .bytes = f->bytes,
		                    .deficit = f->deficit, .upload_ms = l->bricks ? (double)f->load_ns * 1e-6 : (double)NAN };
	uint16_t torn_node = BB_NOBODY;
	int64_t offset_ns;
	unsigned stage;

	f->open = false;
	if (!f->release_ns)
		return; /* the scene ended under it */
	span(l, f, BB_STAGE_EXPOSE, BB_NOBODY, f->mid_exposure_ns, f->readout_end_ns);
	span(l, f, BB_STAGE_TRANSFER, BB_NOBODY, f->readout_end_ns, f->arrived_ns);
	span(l, f, BB_STAGE_WAIT, BB_NOBODY, f->arrived_ns, f->start_ns);
	span(l, f, BB_STAGE_TRACK, BB_NOBODY, f->start_ns, f->tracked_ns);
	for (uint16_t i = 0; i < l->room->n_nodes; i++) {
		const struct bb_node_times *t = &f->node[i];
		if (!(l->drawing_nodes >> i & 1))
			continue;
		node_spans(l, f, i);
		if (t->ready_ns && !((double)(t->ready_ns - t->received_ns) * 1e-6 <= row.frame_ms))
			row.frame_ms = (double)(t->ready_ns - t->received_ns) * 1e-6;
	}
	row.swap_skew_us = swap_skew_us(l, f);
	if (isfinite(row.swap_skew_us))
		sample(l, f, BB_METRIC_SWAP_SKEW, row.swap_skew_us, 0, (uint16_t)f->last_node, BB_STAGE_BARRIER);
	if (f->n_flips > 1) {
		row.scanout_skew_us = (double)(f->last_flip_ns - f->first_flip_ns) * 1e-3;
		sample(l, f, BB_METRIC_SCANOUT_SKEW, row.scanout_skew_us, 0, node_of(l, f->last_flip_screen),
		       BB_STAGE_PRESENT);
	}
	head_to_photon(l, f, &row);
	if (l->rig->shutter && bb_phase_worst(&l->phase, &offset_ns, &stage))
		row.phase_us = (double)offset_ns * 1e-3;
	if (torn(l, f, &torn_node)) {
		row.flags |= BB_FRAME_TORN;
		count_metric(l, f, BB_METRIC_TORN_FRAMES, torn_node, BB_STAGE_PRESENT);
	}
	if (f->late) {
		row.late_node = f->last_node;
		count_metric(l, f, BB_METRIC_LATE_FRAMES, (uint16_t)f->last_node, BB_STAGE_DRAW);
	}
	if (f->eyes_swapped) {
		row.flags |= BB_FRAME_EYES_SWAPPED;
		count_metric(l, f, BB_METRIC_EYE_SWAPS, swapped_node(l, f), BB_STAGE_SHUTTER);
	}
	row.flags |= f->track_flags & (BB_TRACK_FROZEN | BB_TRACK_NEVER) ? BB_FRAME_POSE_OLD : 0;
	row.flags |= f->mono ? BB_FRAME_MONO : 0;
	row.flags |= f->view_flags ? BB_FRAME_VIEW_CLAMPED : 0;
	bb_result_count(l->result, "frames", 1);
	bb_result_count(l->result, "flips", f->n_flips);
	bb_result_count(l->result, "views_clamped", f->view_flags ? 1 : 0);
	bb_ledger_row(l->ledger, &row);
}

void bb_frames_close(struct bb_frame_loop *l, uint64_t before)
{
	for (; l->closed < before && l->closed < l->n_frames; l->closed++) {
		struct bb_frame *f = bb_loop_frame(l, l->closed);
		if (f)
			close_frame(l, f);
	}
}
