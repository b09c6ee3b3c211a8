/*
 * bench/loop/cameras.c: the watch over every camera, rows K1, K3 and K6 to K10 of the fault matrix. Each kind of trouble has
 * a slot of its own, named by its first word, and its own rule for when it is over.
 */
#include "bench/loop/loop.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/tracking.h"

#define FACING 0.35        /* cosine: markers turned further away from a camera are not expected to be seen */
#define IMAGE_MARGIN_PX 12
#define BLIND_FRAMES 5     /* K3, */
#define LIT_FRAMES 10      /* and over */
#define BLOBS_PLAUSIBLE 48 /* K6, */
#define QUIET_FRAMES 30
#define UNUSED_FRAMES 24   /* with four or more blobs that could be a body */
#define DRIFT_NEAR_NS 4000000
#define TRIGGER_SKEW_NS 500000 /* K10, */
#define TRIGGER_NEAR_NS 100000
#define TRIGGER_FRAMES 10
#define GOOD_FRAMES 3
#define SILENT_PERIODS 5   /* K7: within 100 ms at 60 Hz */
#define SHARE_FRAMES 128   /* the share of lost frames looks about so far back */

/* Over once so many frames in a row did not show it (and the watch's own time has passed). */
static void fine(struct bb_frame_loop *l, size_t cam, enum bb_camera_trouble kind, unsigned enough, int64_t now_ns)
{
	struct bb_camera_watch *w = &l->cameras[cam];

	if (w->good[kind] < enough)
		w->good[kind]++;
	if (w->good[kind] == enough)
		bb_watch_good(l->watch, w->slot[kind], now_ns);
}

#define TROUBLE(l, cam, kind, now_ns, health, ...)                                                                   \
	((l)->cameras[cam].good[kind] = 0, bb_watch_bad((l)->watch, (l)->cameras[cam].slot[kind], now_ns, health, __VA_ARGS__))

/* Is a marker where this camera would have to see it, going by the tracked pose? */
static bool expected(const struct bb_camera_config *c, const struct bb_pose *body, struct bb_vec3 marker)
{
	const struct bb_vec3 at = bb_pose_apply(body, marker);
	const struct bb_vec3 p = bb_pose_inverse_apply(&c->pose, at);
	const struct bb_vec3 towards = bb_vec3_unit(bb_vec3_sub(c->pose.p, at), (struct bb_vec3){ 0, 1, 0 });
	const struct bb_vec3 forward = bb_quat_rotate(body->q, (struct bb_vec3){ 0, 0, -1 });

	return p.z >= 0.3 && p.z <= 5 && bb_vec3_dot(forward, towards) >= FACING && bb_camera_sees(c, at, IMAGE_MARGIN_PX);
}

static unsigned markers_expected(const struct bb_frame_loop *l, size_t cam, const struct bb_pose *body)
{
	const struct bb_body *glasses = &l->room->bodies[0];
	unsigned n = 0;

	for (size_t m = 0; m < glasses->n_markers; m++)
		n += expected(&l->room->cameras[cam], body, glasses->marker[m]);
	return n;
}

/* K3, and a picture that stands still. */
static void watch_sight(struct bb_frame_loop *l, const struct camera_read *r, int64_t now_ns)
{
	struct bb_camera_watch *w = &l->cameras[r->camera];
	const struct bb_track_pose pose = bb_tracker_pose(l->tracker, 0, r->mid_ns);
	const bool never = pose.flags & BB_TRACK_NEVER;
	const unsigned n = never ? 0 : markers_expected(l, r->camera, &pose.body);
	const double sigma_px = bb_camera_limits(l->rig->cameras[r->camera])->blob_error_px;
	uint64_t sum = 0;

	for (size_t i = 0; i < r->n; i++) {
		uint64_t bits;
		memcpy(&bits, &r->blobs[i], sizeof(bits)); /* both coordinates */
		sum = sum * UINT64_C(0x9E3779B97F4A7C15) + bits;
	}
	w->same = r->n && sigma_px > 0 && sum == w->sum ? w->same + 1 : 0;
	w->sum = sum;
	if (r->n)
		w->blind = 0;
	else if (n >= 3 || never)
		w->blind++;
	if (w->blind >= BLIND_FRAMES)
		TROUBLE(l, r->camera, BB_CAMERA_SIGHT, now_ns, BB_HEALTH_DEGRADED,
		        "CAM_BLIND: no blobs where %u markers should be seen (covered, dark?)", n);
	else if (w->same >= BLIND_FRAMES)
		TROUBLE(l, r->camera, BB_CAMERA_SIGHT, now_ns, BB_HEALTH_DEGRADED, "CAM_FROZEN: the very same blobs in %u frames",
		        w->same + 1);
	else if (r->n) /* once blind it has to see something to be believed again */
		fine(l, r->camera, BB_CAMERA_SIGHT, LIT_FRAMES, now_ns);
}

static void watch_flood(struct bb_frame_loop *l, const struct camera_read *r, int64_t now_ns)
{
	if (r->n > BLOBS_PLAUSIBLE || r->overflow)
		TROUBLE(l, r->camera, BB_CAMERA_FLOOD, now_ns, BB_HEALTH_DEGRADED, "BLOB_FLOOD: %zu%s blobs (sun, reflections?)",
		        r->n, r->overflow ? " and more" : "");
	else
		fine(l, r->camera, BB_CAMERA_FLOOD, QUIET_FRAMES, now_ns);
}

/* K9: knocked, by the distances of its blobs from where a tracked body's markers should be; or so far that they fit nothing.
 * Its frames are kept from the tracker until they fit again. */
static void watch_place(struct bb_frame_loop *l, const struct camera_read *r, int64_t now_ns)
{
	struct bb_camera_watch *w = &l->cameras[r->camera];
	const struct bb_track_pose pose = bb_tracker_pose(l->tracker, 0, r->mid_ns);
	const uint64_t used = bb_tracker_camera(l->tracker, r->camera).used;

	if (pose.flags & BB_TRACK_FRESH && llabs(r->mid_ns - pose.solved_ns) < DRIFT_NEAR_NS) /* that was no prediction */
		bb_drift_frame(l->drift, r->camera, r->mid_ns, &pose.body, &l->room->bodies[0], r->blobs, r->n);
	struct bb_drift_state d = bb_drift_state(l->drift, r->camera);
	if (d.drifted && d.settled) {
		bb_drift_forgive(l->drift, r->camera);
		d.drifted = false;
		w->drift_px = 0;
		w->unused = 0;
	}
	if (used != w->used)
		w->unused = 0;
	else if (r->n >= 4)
		w->unused++;
	w->used = used;
	if (!d.drifted && w->unused < UNUSED_FRAMES) {
		fine(l, r->camera, BB_CAMERA_PLACE, GOOD_FRAMES, now_ns);
		return;
	}
	TROUBLE(l, r->camera, BB_CAMERA_PLACE, now_ns, BB_HEALTH_DEGRADED,
	        "CALIB_DRIFT: its blobs fit no body in %u frames (bumped, noisy?)", w->unused);
	if (!d.drifted || !(d.rms_px > w->drift_px))
		return;
	w->drift_px = d.rms_px;
	bb_watch_say(l->watch, w->slot[BB_CAMERA_PLACE], "CALIB_DRIFT", "CALIB_DRIFT %.2f px, usually %.2f: bumped? Its weight is 0",
	             d.rms_px, d.baseline_px);
}

/* K10: cameras that share a trigger keep their place in the chain's period; one that drifts from where it began has lost
 * its cable and exposes by its own clock. Its stamps are still right, so its frames are. */
static void watch_trigger(struct bb_frame_loop *l, const struct camera_read *r, int64_t now_ns)
{
	struct bb_camera_watch *w = &l->cameras[r->camera];

	if (l->room->cameras[r->camera].sync != BB_SYNC_SHUTTERS || !l->rig->shutter || l->phase.emitter.n < 8)
		return;
	const double period_ns = bb_phase_period_ns(&l->phase);
	const double cycles = (double)(r->mid_ns - l->phase.emitter.at_ns) / period_ns;
	const double phase_ns = (cycles - floor(cycles)) * period_ns;
	if (!w->phased) {
		w->phased = true;
		w->phase_ns = phase_ns;
	}
	const double off_ns = remainder(phase_ns - w->phase_ns, period_ns);
	w->astray = fabs(off_ns) > TRIGGER_SKEW_NS ? w->astray + 1 : 0;
	if (w->astray >= TRIGGER_FRAMES)
		TROUBLE(l, r->camera, BB_CAMERA_TRIGGER, now_ns, BB_HEALTH_DEGRADED,
		        "TRIG_LOST: exposes %.2f ms from its place in the sync", off_ns * 1e-6);
	else if (fabs(off_ns) < TRIGGER_NEAR_NS)
		fine(l, r->camera, BB_CAMERA_TRIGGER, TRIGGER_FRAMES, now_ns);
}

void bb_cameras_look(struct bb_frame_loop *l, const struct camera_read *r, int64_t now_ns)
{
	watch_sight(l, r, now_ns);
	watch_flood(l, r, now_ns);
	watch_place(l, r, now_ns);
	watch_trigger(l, r, now_ns);
}

/* K1. A gap of a thousand is no loss but another counter. */
void bb_cameras_frame(struct bb_frame_loop *l, size_t cam, uint32_t seq, int64_t arrived_ns, int64_t now_ns)
{
	struct bb_camera_watch *w = &l->cameras[cam];
	const uint32_t gap = seq - w->seq - 1;
	const bool lost = w->seen_ns && gap && gap < 1000;

	w->seq = seq;
	w->seen_ns = arrived_ns;
	if (lost)
		bb_result_count(l->result, l->was_away ? "camera_frames_missed_by_loop" : "camera_frames_dropped", gap);
	for (uint32_t i = 0; i <= (lost && !l->was_away ? gap : 0); i++)
		w->lost_share += ((i > 0) - w->lost_share) / SHARE_FRAMES;
	if (!lost || l->was_away) {
		fine(l, cam, BB_CAMERA_FRAMES, GOOD_FRAMES, now_ns);
		return;
	}
	TROUBLE(l, cam, BB_CAMERA_FRAMES, now_ns, BB_HEALTH_DEGRADED, "CAM_DROP");
	bb_watch_say(l->watch, w->slot[BB_CAMERA_FRAMES], "CAM_DROP", "CAM_DROP %.1f %%: %u missing before frame %u",
	             w->lost_share * 100, gap, seq);
}

/* K7, K8: a driver that goes on after a fault of its bus has named it meanwhile. */
void bb_cameras_after(struct bb_frame_loop *l, size_t cam, enum bb_status status, int64_t now_ns)
{
	struct bb_camera_watch *w = &l->cameras[cam];
	struct bb_camera *c = l->rig->cameras[cam];
	const struct bb_device *dev = bb_camera_device(c);
	const int64_t silent_ns = now_ns - w->seen_ns, period_ns = bb_rate_period_ns(l->room->cameras[cam].rate);
	const char *detail = dev->last_error.detail;
	const bool named = !strncmp(detail, "QUARANTINED", 11) || !strncmp(detail, "CAM_GONE", 8);

	if (dev->failures != w->failures && !strncmp(detail, "USB_ERR", 7))
		TROUBLE(l, cam, BB_CAMERA_FRAMES, now_ns, BB_HEALTH_DEGRADED, "%s", detail);
	w->failures = dev->failures;
	if (status < 0)
		TROUBLE(l, cam, BB_CAMERA_FRAMES, now_ns, BB_HEALTH_LOST, "%s%s", named ? "" : "CAM_GONE: ",
		        named ? detail : bb_status_text(status));
	else if (!l->was_away && silent_ns > SILENT_PERIODS * period_ns + bb_camera_limits(c)->least_latency_ns)
		TROUBLE(l, cam, BB_CAMERA_FRAMES, now_ns, BB_HEALTH_LOST, "CAM_GONE: no frame for %.0f ms", (double)silent_ns * 1e-6);
}

void bb_cameras_begin(struct bb_frame_loop *l, size_t cam)
{
	for (size_t k = 0; k < BB_CAMERA_TROUBLES; k++)
		l->cameras[cam].slot[k] = bb_watch_slot(l->watch, "camera", l->room->cameras[cam].id);
}
