/*
 * bench/loop/pose.c: from the tracker's solutions to the pose of a frame's pictures, and whether there is one (row K4).
 */
#include "bench/loop/loop.h"

void bb_pose_begin(struct bb_frame_loop *l)
{
	const struct bb_steady_config usual = bb_steady_usual((struct bb_pose){ l->room->neutral, BB_QUAT_IDENTITY });

	bb_steady_init(&l->steady, &usual);
	l->pose_ns = l->scene_start_ns;
}

void bb_pose_note(struct bb_frame_loop *l, const struct bb_track_solution *s)
{
	const struct bb_pose eyes = { bb_pose_apply(&s->body, l->room->bodies[0].eye_centre), s->body.q };

	(void)bb_steady_note(&l->steady, s->at_ns, &eyes);
	l->pose_ns = s->at_ns;
}

/* How old the newest solution may be at the begin of a frame while one comes of every exposure. */
static int64_t usual_age_ns(const struct bb_frame_loop *l)
{
	int64_t least_ns = INT64_MAX;

	for (size_t i = 0; i < l->room->n_cameras; i++) {
		const struct bb_camera_config *c = &l->room->cameras[i];
		const int64_t ns = bb_camera_limits(l->rig->cameras[i])->least_latency_ns + bb_rate_period_ns(c->rate) * 3 / 2 +
		                   (int64_t)(c->transfer_jitter_us * 1e3);
		least_ns = ns < least_ns ? ns : least_ns;
	}
	return least_ns;
}

static void watch_pose(struct bb_frame_loop *l, const struct bb_steady_pose *p, int64_t now_ns)
{
	const int64_t age_ns = now_ns - l->pose_ns;
	const double age_ms = (double)age_ns * 1e-6;

	if (age_ns <= usual_age_ns(l) && p->state == BB_STEADY_FOLLOW) {
		bb_watch_good(l->watch, l->pose_slot, now_ns);
		return;
	}
	if (l->was_away && age_ns <= usual_age_ns(l))
		return;
	if (p->state == BB_STEADY_NEUTRAL)
		bb_watch_bad(l->watch, l->pose_slot, now_ns, BB_HEALTH_LOST, "POSE_LOST %.0f ms: the pictures are for the middle of the room",
		             age_ms);
	else if (p->state == BB_STEADY_DECAY)
		bb_watch_bad(l->watch, l->pose_slot, now_ns, BB_HEALTH_HOLDOVER, "POSE_LOST %.0f ms: held, nothing is predicted any more",
		             age_ms);
	else
		bb_watch_bad(l->watch, l->pose_slot, now_ns, BB_HEALTH_DEGRADED, "POSE_LOST %.0f ms: predicted", age_ms);
}

/* Predicted to the photon; and, for comparison, as the newest solution left it. */
void bb_pose_predict(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns)
{
	f->eyes = f->unpredicted = (struct bb_pose){ l->room->neutral, BB_QUAT_IDENTITY };
	f->track_flags = BB_TRACK_NEVER;
	if (!l->tracker)
		return;
	const struct bb_track_pose pose = bb_tracker_pose(l->tracker, 0, f->photon_ns);
	const struct bb_steady_pose steady = bb_steady_step(&l->steady, &pose, f->photon_ns);
	f->eyes = steady.eyes;
	f->unpredicted = bb_tracker_pose(l->tracker, 0, pose.solved_ns).eyes;
	f->pose_sigma_mm = steady.position_sigma_mm;
	f->solved_at_ns = pose.solved_ns;
	f->track_flags = pose.flags;
	f->pose_state = steady.state;
	const bool tracked = steady.state == BB_STEADY_FOLLOW || steady.state == BB_STEADY_BLEND;
	const struct bb_sample s = { .value = tracked ? 100 : 0, .frame = f->frame, .at_ns = f->start_ns, .node = BB_NOBODY,
		                     .stage = BB_STAGE_TRACK };
	bb_ledger_sample(l->ledger, BB_METRIC_TRACKED, &s);
	watch_pose(l, &steady, now_ns);
}
