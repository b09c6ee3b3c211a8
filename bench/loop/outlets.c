/* bench/loop/outlets.c: see outlets.h. One thread, the loop's. */
#include "bench/loop/outlets.h"

#include <math.h>
#include <stdlib.h>

#include "bench/loop/tracking.h"
#include "bench/track_record/record.h"
#include "bench/track_record/streaming.h"

struct bb_outlets {
	struct bb_recorder *recorder; /* NULL: none */
	struct bb_mocap *mocap;       /* NULL: nobody may listen */
	int32_t number;
	uint32_t pad_seq[BB_RECORD_PADS_MAX];
	bool pad_seen[BB_RECORD_PADS_MAX];
};

static enum bb_status begin_recording(struct bb_frame_loop *l, struct bb_error *err)
{
	struct bb_record_head *head = malloc(sizeof(*head));
	const struct bb_tracker_config c = bb_loop_tracker_config(l);

	if (!head)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the recording");
	bb_record_head_of(head, l->room, &c);
	const enum bb_status status = bb_recorder_create(l->options->record_path, head, &l->outlets->recorder, err);
	free(head);
	return status;
}

static enum bb_status begin_stream(struct bb_frame_loop *l, struct bb_error *err)
{
	struct bb_mocap_config c = *l->options->stream;

	if (bb_clock_is_virtual(l->clk))
		return bb_fail(err, BB_ERR_USAGE, 1766, NULL, "--stream on the virtual clock");
	bb_streaming_model(&c.model, l->room->bodies, l->room->n_bodies, bb_rate_hz(l->frame_rate));
	const enum bb_status status = bb_mocap_open(&c, &l->outlets->mocap, err);
	if (status == BB_OK)
		bb_streaming_print(l->outlets->mocap, &c, stderr);
	return status;
}

enum bb_status bb_outlets_open(struct bb_frame_loop *l, struct bb_error *err)
{
	const struct bb_run_options *o = l->options;
	enum bb_status status = BB_OK;

	if (!o->record_path && !o->stream)
		return BB_OK;
	if (!l->tracker)
		return bb_fail(err, BB_ERR_USAGE, 1766, NULL, "this scene needs no cameras, or the room has none");
	l->outlets = calloc(1, sizeof(*l->outlets));
	if (!l->outlets)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the outlets");
	if (o->record_path)
		status = begin_recording(l, err);
	if (status == BB_OK && o->stream)
		status = begin_stream(l, err);
	return status;
}

enum bb_status bb_outlets_commit(struct bb_frame_loop *l, struct bb_error *err)
{
	struct bb_recorder *r = l->outlets ? l->outlets->recorder : NULL;

	if (!r)
		return BB_OK;
	l->outlets->recorder = NULL;
	return bb_recorder_commit(r, err);
}

void bb_outlets_close(struct bb_frame_loop *l)
{
	if (!l->outlets)
		return;
	bb_recorder_abort(l->outlets->recorder);
	bb_mocap_close(l->outlets->mocap);
	free(l->outlets);
	l->outlets = NULL;
}

/* ---- a turn ---- */

static void record_pose(struct bb_recorder *r, size_t body, const struct bb_track_solution *s, size_t n)
{
	for (size_t i = 0; i < n; i++) {
		const struct bb_record_item item = { .kind = BB_RECORD_POSE, .pose = { (uint16_t)body, s[i] } };
		bb_recorder_put(r, &item);
	}
}

static void record_pads(struct bb_frame_loop *l)
{
	struct bb_outlets *o = l->outlets;

	for (size_t i = 0; i < l->room->n_gamepads && i < BB_RECORD_PADS_MAX; i++) {
		const struct bb_pad *p = &l->pads[i];
		if (!p->seen || (o->pad_seen[i] && p->report.seq == o->pad_seq[i]))
			continue;
		o->pad_seen[i] = true;
		o->pad_seq[i] = p->report.seq;
		const struct bb_record_item item = { .kind = BB_RECORD_PAD, .pad = { (uint16_t)i, p->report } };
		bb_recorder_put(o->recorder, &item);
	}
}

static void record_reads(struct bb_frame_loop *l, size_t n_reads, int64_t now_ns)
{
	struct bb_record_item item = { .kind = BB_RECORD_FRAME };

	for (size_t i = 0; i < n_reads; i++) {
		const struct camera_read *c = &l->reads[i];
		item.frame = (struct bb_record_frame){ .camera = (uint16_t)c->camera, .seq = c->seq, .device_ns = c->device_ns,
			                               .arrived_ns = c->arrived_ns, .mid_ns = c->mid_ns,
			                               .overflow = c->overflow, .given = c->given, .n = c->n, .blobs = c->blobs };
		bb_recorder_put(l->outlets->recorder, &item);
	}
	item.kind = BB_RECORD_SOLVE;
	item.now_ns = now_ns;
	bb_recorder_put(l->outlets->recorder, &item);
}

/* Every body where it was at the newest mid-exposure; with no frame at all, where it should be now. */
static void stream(struct bb_frame_loop *l, size_t n_reads, int64_t now_ns)
{
	struct bb_outlets *o = l->outlets;
	struct mocap_frame f = { .number = o->number++, .mid_exposure_ns = now_ns };

	if (n_reads) {
		f.mid_exposure_ns = l->reads[n_reads - 1].mid_ns;
		f.received_ns = l->reads[n_reads - 1].arrived_ns;
	}
	for (size_t b = 0; b < l->room->n_bodies; b++) {
		const struct bb_track_pose p = bb_tracker_pose(l->tracker, b, f.mid_exposure_ns);
		f.body[b] = (struct mocap_pose){ .valid = !(p.flags & (BB_TRACK_NEVER | BB_TRACK_FROZEN)), .pose = p.body,
			                         .error_m = fmin(p.position_sigma_mm * 1e-3, 1e3) };
	}
	const int64_t turn_ns = bb_clock_now_ns(l->clk);
	const struct bb_mocap_counts before = bb_mocap_counts(o->mocap);
	bb_mocap_step(o->mocap, turn_ns);
	bb_mocap_frame(o->mocap, &f, turn_ns);
	const struct bb_mocap_counts now = bb_mocap_counts(o->mocap);
	bb_result_count(l->result, "natnet_datagrams_sent", now.natnet_sent - before.natnet_sent);
	bb_result_count(l->result, "vrpn_poses_sent", now.vrpn_poses - before.vrpn_poses);
}

void bb_outlets_turn(struct bb_frame_loop *l, size_t n_reads, const struct bb_track_solution *solutions, size_t n,
                     int64_t now_ns)
{
	struct bb_track_solution others[TRACK_SOLUTIONS_MAX];

	if (!l->outlets)
		return;
	if (l->outlets->mocap)
		stream(l, n_reads, now_ns);
	if (!l->outlets->recorder)
		return;
	record_reads(l, n_reads, now_ns);
	record_pose(l->outlets->recorder, 0, solutions, n);
	for (size_t b = 1; b < l->room->n_bodies; b++) {
		const size_t all = bb_tracker_solve(l->tracker, false, b, others, TRACK_SOLUTIONS_MAX);
		record_pose(l->outlets->recorder, b, others, all < TRACK_SOLUTIONS_MAX ? all : TRACK_SOLUTIONS_MAX);
	}
	record_pads(l);
}
