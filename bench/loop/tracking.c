/* bench/loop/tracking.c: camera frames into the tracker, once a frame. */
#include "bench/loop/loop.h"

#include <math.h>
#include <stdlib.h>

#include "bench/loop/outlets.h"
#include "bench/loop/seeing.h"
#include "bench/loop/tracking.h"

/* Everything one camera has to say; false when the pool is full. */
static void read_camera(struct bb_frame_loop *l, size_t cam, size_t *n_reads, int64_t now_ns)
{
	enum bb_status status = BB_OK;

	while (*n_reads < TRACK_READS_MAX) {
		struct bb_camera_frame frame = { .blobs = l->blobs + *n_reads * BB_CAMERA_BLOBS_MAX,
			                         .cap = BB_CAMERA_BLOBS_MAX };
		status = bb_seeing_read(l->seeing, cam, l->rig->cameras[cam], &frame);
		if (status != BB_OK)
			break;
		bb_timemap_add(&l->camera_map[cam], frame.mid_exposure, frame.arrived_ns);
		bb_cameras_frame(l, cam, frame.seq, frame.arrived_ns, now_ns);
		l->reads[*n_reads] = (struct camera_read){ .camera = cam,
			                                   .blobs = frame.blobs,
			                                   .n = frame.n,
			                                   .overflow = frame.overflow,
			                                   .seq = frame.seq,
			                                   .device_ns = frame.mid_exposure.ns,
			                                   .arrived_ns = frame.arrived_ns,
			                                   .mid_ns = bb_timemap_host_ns(&l->camera_map[cam], frame.mid_exposure) };
		++*n_reads;
	}
	bb_cameras_after(l, cam, status, now_ns);
}

static int by_time(const void *a, const void *b)
{
	const struct camera_read *x = a, *y = b;

	if (x->mid_ns != y->mid_ns)
		return x->mid_ns < y->mid_ns ? -1 : 1;
	return x->camera < y->camera ? -1 : x->camera > y->camera;
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
	f->exposed_ns = r->mid_ns + (int64_t)(c->exposure_us / 2 * 1e3);
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
	f->read_ns = bb_clock_now_ns(l->clk);
	qsort(l->reads, n_reads, sizeof(*l->reads), by_time);
	for (size_t i = 0; i < n_reads; i++) {
		l->reads[i].given = bb_drift_weight(l->drift, l->reads[i].camera) > 0; /* a knocked one would pull at the others */
		if (l->reads[i].given)
			bb_tracker_frame(l->tracker, l->reads[i].camera, l->reads[i].mid_ns, l->reads[i].blobs, l->reads[i].n);
		if (l->reads[i].camera == 0)
			bb_ledger_mark(l->ledger, BB_TRACK_STROBE, 0, l->reads[i].mid_ns, 0, 0);
	}
	const size_t n = bb_tracker_solve(l->tracker, true, 0, solutions, TRACK_SOLUTIONS_MAX);
	for (size_t i = 0; i < n && i < TRACK_SOLUTIONS_MAX; i++) {
		bb_eventlog_add(l->events, bb_eventlog_source(l->events, "tracker", l->room->bodies[0].id), BB_EV_POSE,
		                solutions[i].at_ns, solutions[i].n_cameras, llround(solutions[i].centroid.x * 1e9));
		bb_pose_note(l, &solutions[i]);
		judge_solution(l, f, &solutions[i]);
		f->cameras = solutions[i].n_cameras;
		f->solved_sigma_mm = solutions[i].position_sigma_mm;
	}
	bb_labels_look(l, l->reads, n_reads, n ? &solutions[(n < TRACK_SOLUTIONS_MAX ? n : TRACK_SOLUTIONS_MAX) - 1] : NULL, now_ns);
	for (size_t i = 0; i < n_reads; i++)
		bb_cameras_look(l, &l->reads[i], now_ns);
	f->solved_ns = bb_clock_now_ns(l->clk);
	bb_outlets_turn(l, n_reads, solutions, n < TRACK_SOLUTIONS_MAX ? n : TRACK_SOLUTIONS_MAX, now_ns);
	bb_result_count(l->result, "poses_solved", n);
	bb_result_count(l->result, "camera_frames", n_reads);
	if (n_reads)
		note_newest(l, f, &l->reads[n_reads - 1]);
}
