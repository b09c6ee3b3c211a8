/* bench/loop/tracking.c: camera frames into the tracker, once a frame, and the watch over every camera. */
#include "bench/loop/loop.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/outlets.h"
#include "bench/loop/tracking.h"

#define FACING 0.35        /* cosine: markers turned further away from a camera are not expected to be seen */
#define IMAGE_MARGIN_PX 12
#define BLIND_FRAMES 5     /* row K3 */
#define BLOBS_PLAUSIBLE 48
#define UNUSED_FRAMES 24 /* with four or more blobs that could be a body */
#define TRIGGER_SKEW_NS 500000 /* row K10 */
#define TRIGGER_FRAMES 10

/* Is a marker where this camera would have to see it, going by the tracked pose? */
static bool expected(const struct bb_camera_config *c, const struct bb_pose *body, struct bb_vec3 marker)
{
	const struct bb_vec3 at = bb_pose_apply(body, marker);
	const struct bb_vec3 p = bb_pose_inverse_apply(&c->pose, at);
	const struct bb_vec3 towards = bb_vec3_unit(bb_vec3_sub(c->pose.p, at), (struct bb_vec3){ 0, 1, 0 });
	const struct bb_vec3 forward = bb_quat_rotate(body->q, (struct bb_vec3){ 0, 0, -1 });

	if (p.z < 0.3 || p.z > 5 || bb_vec3_dot(forward, towards) < FACING)
		return false;
	const double x = c->fx_px * p.x / p.z + c->cx_px, y = c->fy_px * p.y / p.z + c->cy_px;
	return x > IMAGE_MARGIN_PX && y > IMAGE_MARGIN_PX && x < (double)c->width_px - IMAGE_MARGIN_PX &&
	       y < (double)c->height_px - IMAGE_MARGIN_PX;
}

static void watch_blind(struct bb_frame_loop *l, size_t cam, const struct camera_read *r)
{
	const struct bb_body *glasses = &l->room->bodies[0];
	const struct bb_track_pose pose = bb_tracker_pose(l->tracker, 0, r->mid_ns);
	unsigned n = 0;

	for (size_t m = 0; m < glasses->n_markers && !(pose.flags & BB_TRACK_NEVER); m++)
		n += expected(&l->room->cameras[cam], &pose.body, glasses->marker[m]);
	if (r->n)
		l->camera_blind[cam] = 0;
	else if (n >= 3 || pose.flags & BB_TRACK_NEVER)
		l->camera_blind[cam]++;
	if (!l->camera_blind[cam]) /* once blind it has to see something to be believed again */
		bb_watch_good(l->watch, l->camera_slot[cam], r->arrived_ns);
	if (l->camera_blind[cam] >= BLIND_FRAMES)
		bb_watch_bad(l->watch, l->camera_slot[cam], r->arrived_ns, BB_HEALTH_DEGRADED,
		             "blind: no blobs where %u markers should be seen (covered, dark?)", n);
}

/* Rows K6, K9 and a picture that stands still: frames that come but cannot be right. */
static void watch_plausible(struct bb_frame_loop *l, size_t cam, const struct camera_read *r)
{
	const double sigma_px = bb_camera_limits(l->rig->cameras[cam])->blob_error_px;
	const uint64_t used = bb_tracker_camera(l->tracker, cam).used;
	uint64_t sum = 0;

	if (used != l->camera_used[cam])
		l->camera_unused[cam] = 0;
	else if (r->n >= 4)
		l->camera_unused[cam]++;
	l->camera_used[cam] = used;

	for (size_t i = 0; i < r->n; i++) {
		uint64_t bits;
		memcpy(&bits, &r->blobs[i], sizeof(bits)); /* both coordinates */
		sum = sum * UINT64_C(0x9E3779B97F4A7C15) + bits;
	}
	l->camera_same[cam] = r->n && sigma_px > 0 && sum == l->camera_sum[cam] ? l->camera_same[cam] + 1 : 0;
	l->camera_sum[cam] = sum;
	if (r->n > BLOBS_PLAUSIBLE)
		bb_watch_bad(l->watch, l->camera_slot[cam], r->arrived_ns, BB_HEALTH_DEGRADED,
		             "flood: %zu blobs (sun, reflections?)", r->n);
	else if (l->camera_same[cam] >= BLIND_FRAMES)
		bb_watch_bad(l->watch, l->camera_slot[cam], r->arrived_ns, BB_HEALTH_DEGRADED,
		             "frozen: the very same blobs in %u frames", l->camera_same[cam] + 1);
	else if (l->camera_unused[cam] >= UNUSED_FRAMES)
		bb_watch_bad(l->watch, l->camera_slot[cam], r->arrived_ns, BB_HEALTH_DEGRADED,
		             "its blobs fit no body in %u frames: bumped or noisy", l->camera_unused[cam]);
}

/* Everything one camera has to say; false when the pool is full. */
static void read_camera(struct bb_frame_loop *l, size_t cam, size_t *n_reads, int64_t now_ns)
{
	enum bb_status status = BB_OK;

	while (*n_reads < TRACK_READS_MAX) {
		struct bb_camera_frame frame = { .blobs = l->blobs + *n_reads * BB_CAMERA_BLOBS_MAX,
			                         .cap = BB_CAMERA_BLOBS_MAX };
		status = bb_camera_read(l->rig->cameras[cam], &frame);
		if (status != BB_OK)
			break;
		bb_timemap_add(&l->camera_map[cam], frame.mid_exposure, frame.arrived_ns);
		const uint32_t gap = frame.seq - l->camera_seq[cam] - 1;
		if (l->camera_seen_ns[cam] && gap && gap < 1000) {
			bb_result_count(l->result, l->was_away ? "camera_frames_missed_by_loop" : "camera_frames_dropped", gap);
			if (!l->was_away)
				bb_watch_bad(l->watch, l->camera_slot[cam], frame.arrived_ns, BB_HEALTH_DEGRADED,
				             "dropped %u frames before frame %u", gap, frame.seq);
		}
		l->camera_seq[cam] = frame.seq;
		l->camera_seen_ns[cam] = frame.arrived_ns;
		l->reads[*n_reads] = (struct camera_read){ .camera = cam,
			                                   .blobs = frame.blobs,
			                                   .n = frame.n,
			                                   .arrived_ns = frame.arrived_ns,
			                                   .device_ns = frame.mid_exposure.ns,
			                                   .seq = frame.seq,
			                                   .overflow = frame.overflow,
			                                   .mid_ns = bb_timemap_host_ns(&l->camera_map[cam], frame.mid_exposure) };
		++*n_reads;
	}
	const int64_t period_ns = bb_rate_period_ns(l->room->cameras[cam].rate);
	const int64_t silent_ns = now_ns - l->camera_seen_ns[cam];
	if (status < 0)
		bb_watch_bad(l->watch, l->camera_slot[cam], now_ns, BB_HEALTH_LOST, "gone: %s", bb_status_text(status));
	else if (!l->was_away && silent_ns > 2 * period_ns + 2 * bb_camera_limits(l->rig->cameras[cam])->least_latency_ns)
		bb_watch_bad(l->watch, l->camera_slot[cam], now_ns, BB_HEALTH_LOST, "no frame for %.0f ms",
		             (double)silent_ns * 1e-6);
}

static int by_time(const void *a, const void *b)
{
	const struct camera_read *x = a, *y = b;

	if (x->mid_ns != y->mid_ns)
		return x->mid_ns < y->mid_ns ? -1 : 1;
	return x->camera < y->camera ? -1 : x->camera > y->camera;
}

/* Row K10: cameras that share a trigger keep their place in the chain's period; one that drifts from where it began
 * has lost its cable and exposes by its own clock. */
static void watch_trigger(struct bb_frame_loop *l, const struct camera_read *r)
{
	const struct bb_camera_config *c = &l->room->cameras[r->camera];

	if (c->sync != BB_SYNC_SHUTTERS || !l->rig->shutter || l->phase.emitter.n < 8)
		return;
	const double period_ns = bb_phase_period_ns(&l->phase);
	const double cycles = (double)(r->mid_ns - l->phase.emitter.at_ns) / period_ns;
	const double phase_ns = (cycles - floor(cycles)) * period_ns;
	if (!l->camera_phased[r->camera]) {
		l->camera_phased[r->camera] = true;
		l->camera_phase_ns[r->camera] = phase_ns;
	}
	const double off_ns = remainder(phase_ns - l->camera_phase_ns[r->camera], period_ns);
	l->camera_astray[r->camera] = fabs(off_ns) > TRIGGER_SKEW_NS ? l->camera_astray[r->camera] + 1 : 0;
	if (l->camera_astray[r->camera] >= TRIGGER_FRAMES)
		bb_watch_bad(l->watch, l->camera_slot[r->camera], r->arrived_ns, BB_HEALTH_DEGRADED,
		             "trigger lost: exposes %.2f ms from its place in the sync", off_ns * 1e-6);
}

static struct bb_vec3 centroid(const struct bb_body *body, const struct bb_pose *pose)
{
	struct bb_vec3 sum = { 0, 0, 0 };

	for (size_t m = 0; m < body->n_markers; m++)
		sum = bb_vec3_add(sum, body->marker[m]);
	return bb_pose_apply(pose, bb_vec3_scale(sum, 1.0 / (double)body->n_markers));
}

/* Against the world's truth, where the figure is defined: four or more cameras with three or more markers. */
static void judge_solution(struct bb_frame_loop *l, struct bb_frame *f, const struct bb_track_solution *s)
{
	if (!l->world || s->n_cameras < 4 || l->rig->needs[BB_CLASS_CAMERAS] < 0)
		return;
	const struct bb_pose truth = sim_world_body(l->world, 0, s->at_ns);
	const struct bb_vec3 off = bb_vec3_sub(s->centroid, centroid(&l->room->bodies[0], &truth));
	const struct bb_sample error = { .value = bb_vec3_norm(off) * 1e3, .frame = f->frame, .at_ns = s->at_ns,
		                         .node = BB_NOBODY, .stage = BB_STAGE_TRACK };
	const struct bb_sample angle = { .value = bb_quat_angle(s->body.q, truth.q) * (180 / 3.14159265358979323846),
		                         .frame = f->frame, .at_ns = s->at_ns, .node = BB_NOBODY,
		                         .stage = BB_STAGE_TRACK };

	f->pose_error_mm = error.value;
	bb_ledger_sample(l->ledger, BB_METRIC_POSE_ERROR, &error);
	bb_ledger_sample(l->ledger, BB_METRIC_POSE_ANGLE, &angle);
}

static void note_newest(struct bb_frame_loop *l, struct bb_frame *f, const struct camera_read *r)
{
	const struct bb_camera_config *c = &l->room->cameras[r->camera];

	f->mid_exposure_ns = r->mid_ns;
	f->readout_end_ns = r->mid_ns + (int64_t)((c->exposure_us / 2 + c->readout_us) * 1e3);
	f->arrived_ns = r->arrived_ns;
}

void bb_track_read(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns)
{
	struct bb_track_solution solutions[TRACK_SOLUTIONS_MAX];
	size_t n_reads = 0;

	if (!l->tracker)
		return;
	for (size_t i = 0; i < l->room->n_cameras; i++)
		read_camera(l, i, &n_reads, now_ns);
	qsort(l->reads, n_reads, sizeof(*l->reads), by_time);
	for (size_t i = 0; i < n_reads; i++) {
		bb_tracker_frame(l->tracker, l->reads[i].camera, l->reads[i].mid_ns, l->reads[i].blobs, l->reads[i].n);
		if (l->reads[i].camera == 0)
			bb_ledger_mark(l->ledger, BB_TRACK_STROBE, 0, l->reads[i].mid_ns, 0, 0);
	}
	const size_t n = bb_tracker_solve(l->tracker, true, 0, solutions, TRACK_SOLUTIONS_MAX);
	for (size_t i = 0; i < n && i < TRACK_SOLUTIONS_MAX; i++) {
		bb_eventlog_add(l->events, bb_eventlog_source(l->events, "tracker", l->room->bodies[0].id), BB_EV_POSE,
		                solutions[i].at_ns, solutions[i].n_cameras, llround(solutions[i].centroid.x * 1e9));
		judge_solution(l, f, &solutions[i]);
		f->cameras = solutions[i].n_cameras;
	}
	bb_outlets_turn(l, n_reads, solutions, n < TRACK_SOLUTIONS_MAX ? n : TRACK_SOLUTIONS_MAX, now_ns);
	for (size_t i = 0; i < n_reads; i++) {
		watch_blind(l, l->reads[i].camera, &l->reads[i]);
		watch_plausible(l, l->reads[i].camera, &l->reads[i]);
		watch_trigger(l, &l->reads[i]);
	}
	bb_result_count(l->result, "poses_solved", n);
	bb_result_count(l->result, "camera_frames", n_reads);
	if (n_reads)
		note_newest(l, f, &l->reads[n_reads - 1]);
}
