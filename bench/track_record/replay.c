/* bench/track_record/replay.c: see replay.h. */
#include "bench/track_record/replay.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/loop/tracking.h"
#include "hal/hash.h"

#define EXPECTED_MAX (BB_BODIES_MAX * TRACK_SOLUTIONS_MAX)

struct work {
	const struct bb_replay_config *c;
	struct bb_replay *out;
	struct bb_record_reader *reader;
	const struct bb_record_head *head;
	struct bb_tracker *tracker; /* NULL: the file is only read */
	struct bb_clock *clk;       /* NULL: as fast as it goes */
	struct bb_file csv;
	size_t n_expected, at;      /* what the tracker said at the last solve; how much of it the recording has told */
	struct bb_record_pose expected[EXPECTED_MAX];
};

/* ---- CSV ---- */

void bb_poses_csv_head(FILE *out)
{
	fputs("body,at_ns,x_m,y_m,z_m,qx_1,qy_1,qz_1,qw_1,position_sigma_mm,angle_sigma_deg,residual_px,markers_count,"
	      "cameras_count,flags\n",
	      out);
}

void bb_poses_csv_row(FILE *out, const char *body, const struct bb_track_solution *s)
{
	const struct bb_pose *p = &s->body;

	bb_put_csv(out, body);
	fprintf(out, ",%lld,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.9f,%.6g,%.6g,%.6g,%u,%u,%u\n", (long long)s->at_ns, p->p.x, p->p.y,
	        p->p.z, p->q.x, p->q.y, p->q.z, p->q.w, s->position_sigma_mm, s->angle_sigma_deg, s->residual_px, s->n_markers,
	        s->n_cameras, s->flags);
}

static void keep(struct work *w, const struct bb_record_pose *p)
{
	if (w->csv.out)
		bb_poses_csv_row(w->csv.out, w->head->body[p->body].id, &p->solution);
}

/* ---- the tracker, once more ---- */

/* Bits, not values: what went through a file must be as it was, zeros with their signs. */
static bool same_bits(double a, double b)
{
	return a == b && signbit(a) == signbit(b);
}

static bool same_pose(const struct bb_pose *a, const struct bb_pose *b)
{
	return same_bits(a->p.x, b->p.x) && same_bits(a->p.y, b->p.y) && same_bits(a->p.z, b->p.z) && same_bits(a->q.x, b->q.x) &&
	       same_bits(a->q.y, b->q.y) && same_bits(a->q.z, b->q.z) && same_bits(a->q.w, b->q.w);
}

static bool same(const struct bb_record_pose *a, const struct bb_record_pose *b)
{
	const struct bb_track_solution *x = &a->solution, *y = &b->solution;

	return a->body == b->body && x->at_ns == y->at_ns && x->flags == y->flags && x->n_markers == y->n_markers &&
	       x->n_cameras == y->n_cameras && same_pose(&x->body, &y->body) &&
	       same_bits(x->position_sigma_mm, y->position_sigma_mm) && same_bits(x->angle_sigma_deg, y->angle_sigma_deg) &&
	       same_bits(x->residual_px, y->residual_px);
}

/* As bench/loop/outlets.c does it in the run. */
static void solve(struct work *w)
{
	struct bb_track_solution s[TRACK_SOLUTIONS_MAX];

	w->n_expected = w->at = 0;
	for (size_t b = 0; b < w->head->n_bodies; b++) {
		const size_t all = bb_tracker_solve(w->tracker, b == 0, b, s, TRACK_SOLUTIONS_MAX);
		for (size_t i = 0; i < all && i < TRACK_SOLUTIONS_MAX; i++) {
			w->expected[w->n_expected] = (struct bb_record_pose){ (uint16_t)b, s[i] };
			keep(w, &w->expected[w->n_expected++]);
		}
	}
	w->out->poses_replayed += w->n_expected;
}

static void wait_for(struct work *w, int64_t now_ns)
{
	if (w->clk)
		bb_clock_run_until(w->clk, (int64_t)fmin(fmax((double)(now_ns - w->out->first_ns) / w->c->speed, 0), 9e18));
}

static void take(struct work *w, const struct bb_record_item *item)
{
	struct bb_replay *out = w->out;

	switch (item->kind) {
	case BB_RECORD_FRAME:
		out->frames++;
		out->blobs += item->frame.n;
		if (w->tracker && item->frame.given)
			bb_tracker_frame(w->tracker, item->frame.camera, item->frame.mid_ns, item->frame.blobs, item->frame.n);
		break;
	case BB_RECORD_SOLVE:
		if (!out->solves++)
			out->first_ns = item->now_ns;
		out->last_ns = item->now_ns;
		wait_for(w, item->now_ns);
		if (w->tracker)
			solve(w);
		break;
	case BB_RECORD_POSE:
		out->poses_recorded++;
		if (!w->tracker)
			keep(w, &item->pose);
		else if (w->at < w->n_expected)
			out->same += same(&w->expected[w->at++], &item->pose);
		break;
	case BB_RECORD_PAD:
		out->pad_reports++;
		break;
	case BB_RECORD_END:
		break;
	}
}

/* ---- the same room ---- */

static enum bb_status check_room(const struct work *w, struct bb_error *err)
{
	const struct bb_room *room = w->c->room;
	const struct bb_where where = { w->c->path, 0, 0 };
	char sum[BB_HASH_HEX];

	bb_hash_hex(room->sha256, sum);
	if (!w->head->has_tracker)
		return bb_fail(err, BB_ERR_CONFIG, 1764, &where, "it holds poses only: nothing to track again");
	if (w->head->n_cameras != room->n_cameras || w->head->n_bodies != room->n_bodies)
		return bb_fail(err, BB_ERR_CONFIG, 1764, &where, "%zu cameras and %zu bodies, but %s has %zu and %zu",
		               w->head->n_cameras, w->head->n_bodies, room->name, room->n_cameras, room->n_bodies);
	if (!w->c->any_room && strcmp(sum, w->head->sha256) != 0)
		return bb_fail(err, BB_ERR_CONFIG, 1764, &where, "it is of '%s' with SHA-256 %.12s..., this file has %.12s...",
		               w->head->room, w->head->sha256, sum);
	return BB_OK;
}

static enum bb_status make_tracker(struct work *w, struct bb_error *err)
{
	const struct bb_record_head *h = w->head;
	enum bb_status status = check_room(w, err);
	const struct bb_tracker_config c = { .cameras = w->c->room->cameras, .n_cameras = w->c->room->n_cameras,
		                             .bodies = w->c->room->bodies, .n_bodies = w->c->room->n_bodies,
		                             .blob_sigma_px = h->sigma_px, .group_ns = h->group_ns,
		                             .freeze_ns = h->freeze_ns, .room_min = h->room_min,
		                             .room_max = h->room_max, .neutral = h->neutral };

	if (status != BB_OK)
		return status;
	status = bb_tracker_create(&c, &w->tracker);
	return status == BB_OK ? BB_OK : bb_fail(err, status, 1764, NULL, "no tracker can be made as it says");
}

/* ---- all of it ---- */

static enum bb_status play(struct work *w, struct bb_error *err)
{
	struct bb_record_item item = { .kind = BB_RECORD_FRAME };
	enum bb_status status = BB_OK;

	while (status == BB_OK && item.kind != BB_RECORD_END) {
		status = bb_record_next(w->reader, &item, err);
		if (status == BB_OK)
			take(w, &item);
	}
	w->out->truncated = status != BB_OK && err->number == 1763;
	return w->out->truncated ? BB_OK : status;
}

static enum bb_status run(struct work *w, struct bb_error *err)
{
	enum bb_status status = bb_record_open(w->c->path, &w->reader, err);

	if (status != BB_OK)
		return status;
	w->head = bb_record_head(w->reader);
	snprintf(w->out->room, sizeof(w->out->room), "%s", w->head->room);
	if (w->c->room)
		status = make_tracker(w, err);
	if (status == BB_OK && w->c->speed > 0)
		status = bb_clock_posix_create(&w->clk);
	if (status == BB_OK && w->c->csv)
		status = bb_file_begin(&w->csv, w->c->csv, err);
	if (status != BB_OK)
		return status;
	if (w->c->csv)
		bb_poses_csv_head(w->csv.out);
	status = play(w, err);
	if (w->c->csv && status == BB_OK) {
		struct bb_error own = { 0 }; /* that it was cut stands in err already */
		status = bb_file_commit(&w->csv, &own);
		if (status != BB_OK)
			*err = own;
	}
	return status;
}

enum bb_status bb_replay_run(const struct bb_replay_config *config, struct bb_replay *out, struct bb_error *err)
{
	struct work *w = calloc(1, sizeof(*w));

	*out = (struct bb_replay){ 0 };
	if (!w)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the replay");
	w->c = config;
	w->out = out;
	const enum bb_status status = run(w, err);
	bb_file_abort(&w->csv);
	bb_tracker_destroy(w->tracker);
	bb_clock_destroy(w->clk);
	bb_record_close(w->reader);
	free(w);
	return status;
}
