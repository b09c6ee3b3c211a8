/*
 * bench/loop/labels.c: what the labels of the newest solutions say beyond the pose: a marker that is not where its body has it
 * (row K5), and a finger on the wand's last one (sync/track/gesture.h).
 */
#include "bench/loop/loop.h"

#include <math.h>
#include <stdlib.h>

#include "bench/loop/tracking.h"
#include "sync/track/lens.h"

#define LABELS_MOST (256 * 6) /* as many cameras as a tracker takes, times a body's markers */
#define ASTRAY_M 0.06    /* a bare spot so near to where a marker belongs is that marker */
#define FIT_SIGMAS 5     /* and one nearer than this would have been used */
#define VIEWS_LEAST 2
#define GOOD_SOLUTIONS 5
#define GRAB_SOLUTIONS 6 /* one a frame: 100 ms at 60 Hz, longer than a glimpse past somebody's arm */

struct bb_labels {
	struct bb_lens *lens;   /* by camera */
	struct bb_grab grab;
	int64_t looked_ns;      /* the newest solution that was looked at */
	unsigned good;          /* solutions in a row without a swap */
	size_t n;
	struct bb_track_label label[LABELS_MOST];
	uint16_t screen;        /* pointed at last; BB_NOBODY: none */
};

enum bb_status bb_labels_create(struct bb_frame_loop *l)
{
	const struct bb_room *room = l->room;
	struct bb_labels *x = calloc(1, sizeof(*x));

	l->labels = x;
	if (!x || !(x->lens = calloc(room->n_cameras + 1, sizeof(*x->lens))))
		return BB_ERR_NOMEM;
	for (size_t i = 0; i < room->n_cameras; i++)
		if (!bb_lens_init(&x->lens[i], &room->cameras[i]))
			return BB_ERR_CONFIG;
	if (room->n_bodies > 1)
		bb_grab_init(&x->grab, (unsigned)room->bodies[1].n_markers - 1, GRAB_SOLUTIONS);
	x->screen = BB_NOBODY;
	return BB_OK;
}

void bb_labels_destroy(struct bb_labels *x)
{
	if (!x)
		return;
	free(x->lens);
	free(x);
}

/* ---- K5 ---- */

static bool is_labelled(const struct bb_labels *x, size_t camera, const struct bb_blob *b)
{
	for (size_t i = 0; i < x->n; i++)
		if (x->label[i].camera == camera && fabs(x->label[i].x_px - (double)b->x_px) < 1e-3 &&
		    fabs(x->label[i].y_px - (double)b->y_px) < 1e-3)
			return true;
	return false;
}

/* A spot nobody claims beside the place of a marker, nearer to it than any other thing the camera should see there. */
static bool bare_beside(const struct bb_frame_loop *l, const struct camera_read *r, struct bb_vec3 marker, double sigma_px)
{
	const struct bb_labels *x = l->labels;
	const struct bb_lens *lens = &x->lens[r->camera];
	double px[2], side[2];
	const struct bb_vec3 right = bb_quat_rotate(l->room->cameras[r->camera].pose.q, (struct bb_vec3){ ASTRAY_M, 0, 0 });

	if (!bb_lens_project(lens, marker, px) || !bb_lens_project(lens, bb_vec3_add(marker, right), side))
		return false;
	const double reach_px = hypot(side[0] - px[0], side[1] - px[1]);
	for (size_t i = 0; i < r->n; i++) {
		const double d = hypot((double)r->blobs[i].x_px - px[0], (double)r->blobs[i].y_px - px[1]);
		if (d < reach_px && d > FIT_SIGMAS * sigma_px && !is_labelled(x, r->camera, &r->blobs[i]))
			return true;
	}
	return false;
}

/* A marker that no camera could label, though several of them that see the body otherwise have a bare spot beside its place:
 * it is out of its place, or something else shines there. Returns its number, from 1; 0: none. */
static unsigned misplaced(const struct bb_frame_loop *l, const struct camera_read *reads, size_t n_reads, const struct bb_pose *pose)
{
	const struct bb_body *body = &l->room->bodies[0];
	uint32_t labelled = 0;

	for (size_t i = 0; i < l->labels->n; i++)
		labelled |= 1u << l->labels->label[i].marker;
	for (unsigned m = 0; m < body->n_markers; m++) {
		unsigned views = 0;
		for (size_t i = 0; !(labelled >> m & 1) && i < n_reads; i++)
			views += bare_beside(l, &reads[i], bb_pose_apply(pose, body->marker[m]),
			                     bb_camera_limits(l->rig->cameras[reads[i].camera])->blob_error_px);
		if (views >= VIEWS_LEAST)
			return m + 1;
	}
	return 0;
}

static void watch_labels(struct bb_frame_loop *l, const struct camera_read *reads, size_t n_reads,
                         const struct bb_track_solution *s, int64_t now_ns)
{
	struct bb_labels *x = l->labels;
	size_t from = n_reads;

	if (s->at_ns <= x->looked_ns)
		return;
	x->looked_ns = s->at_ns;
	x->n = bb_tracker_labels(l->tracker, 0, x->label, LABELS_MOST);
	if (x->n > LABELS_MOST)
		x->n = LABELS_MOST;
	while (from && reads[from - 1].mid_ns > s->at_ns - bb_rate_period_ns(l->room->cameras[reads[from - 1].camera].rate) / 2)
		from--;
	const unsigned marker = x->n ? misplaced(l, reads + from, n_reads - from, &s->body) : 0;
	if (!marker && !(s->flags & BB_TRACK_SWAP)) {
		if (x->good < GOOD_SOLUTIONS)
			x->good++;
		if (x->good == GOOD_SOLUTIONS)
			bb_watch_good(l->watch, l->swap_slot, now_ns);
		return;
	}
	x->good = 0;
	if (marker)
		bb_watch_bad(l->watch, l->swap_slot, now_ns, BB_HEALTH_DEGRADED,
		             "MARKER_SWAP: marker %u of %s is not where it belongs; the others go on without it", marker,
		             l->room->bodies[0].id);
	else
		bb_watch_bad(l->watch, l->swap_slot, now_ns, BB_HEALTH_DEGRADED,
		             "MARKER_SWAP: the labels of %s were contradicted by %.2f px and looked for anew", l->room->bodies[0].id,
		             s->residual_px);
}

/* ---- the wand ---- */

enum gesture { GESTURE_POINTS = 1, GESTURE_TAKES, GESTURE_LETS_GO };

static void note_gesture(struct bb_frame_loop *l, enum gesture what, const struct bb_pointing *p, int64_t at_ns)
{
	const int64_t where = p->hit ? (int64_t)(p->screen + 1) << 32 | llround(fmax(p->x_px, 0)) << 16 | llround(fmax(p->y_px, 0)) : 0;

	bb_eventlog_add(l->events, bb_eventlog_source(l->events, "gesture", l->room->bodies[1].id), BB_EV_GESTURE, at_ns, what, where);
	bb_result_count(l->result, what == GESTURE_POINTS ? "gestures_points" : what == GESTURE_TAKES ? "gestures_takes" : "gestures_lets_go", 1);
}

static void read_wand(struct bb_frame_loop *l, int64_t now_ns)
{
	struct bb_labels *x = l->labels;
	const struct bb_track_pose pose = bb_tracker_pose(l->tracker, 1, now_ns);
	uint32_t labelled = 0;

	if (pose.flags & BB_TRACK_NEVER)
		return;
	const struct bb_pointing p = bb_gesture_point(l->room, &pose.body);
	const uint16_t screen = p.hit && !(pose.flags & BB_TRACK_FROZEN) ? p.screen : BB_NOBODY;
	if (screen != x->screen)
		note_gesture(l, GESTURE_POINTS, &p, now_ns);
	x->screen = screen;
	x->n = pose.flags & BB_TRACK_FRESH ? bb_tracker_labels(l->tracker, 1, x->label, LABELS_MOST) : 0;
	for (size_t i = 0; i < x->n && i < LABELS_MOST; i++)
		labelled |= 1u << x->label[i].marker;
	const enum bb_grab_change c = x->n ? bb_grab_solution(&x->grab, pose.solved_ns, labelled) : bb_grab_wait(&x->grab, now_ns);
	if (c != BB_GRAB_NONE)
		note_gesture(l, c == BB_GRAB_TAKEN ? GESTURE_TAKES : GESTURE_LETS_GO, &p, now_ns);
}

void bb_labels_look(struct bb_frame_loop *l, const struct camera_read *reads, size_t n_reads, const struct bb_track_solution *newest,
                    int64_t now_ns)
{
	if (newest)
		watch_labels(l, reads, n_reads, newest, now_ns);
	if (l->room->n_bodies > 1)
		read_wand(l, now_ns);
}
