/*
 * sync/track/tracker.c: memory, sets of frames, and the public face. One thread; times are the caller's host ns.
 */
#include "sync/track/tracker.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sync/track/track.h"

#define FLOOD_BUCKETS 512       /* see bucket_of; the last one is for blobs that are none */
#define GROUP_NS_MAX 1000000000 /* differences within a set must be summable */
#define PREDICT_BACK_S 1.0      /* nobody asks for the pose of a minute ago */

static bool finite3(struct bb_vec3 v)
{
	return isfinite(v.x) && isfinite(v.y) && isfinite(v.z) && fabs(v.x) < 1e6 && fabs(v.y) < 1e6 && fabs(v.z) < 1e6;
}

static bool body_is_usable(const struct bb_body *b)
{
	double most = 0;

	if (b->n_markers < 3 || b->n_markers > BB_TRACK_MARKERS_MAX || !finite3(b->eye_centre))
		return false;
	for (size_t i = 0; i < b->n_markers; i++) {
		if (!finite3(b->marker[i]))
			return false;
		most = fmax(most, bb_vec3_norm(bb_vec3_sub(b->marker[i], b->marker[0])));
	}
	return most > 1e-3;
}

static bool config_is_usable(const struct bb_tracker_config *c)
{
	const struct bb_vec3 size = bb_vec3_sub(c->room_max, c->room_min);

	if (!c->cameras || !c->bodies || c->n_cameras < 1 || c->n_cameras > BB_TRACK_CAMERAS_MAX || c->n_bodies < 1 ||
	    c->n_bodies > BB_BODIES_MAX)
		return false;
	if (!(c->blob_sigma_px >= 1e-5 && c->blob_sigma_px < 100) || c->group_ns < 0 || c->group_ns > GROUP_NS_MAX ||
	    c->freeze_ns < 0)
		return false;
	if (!finite3(c->room_min) || !finite3(c->room_max) || !(size.x > 0 && size.y > 0 && size.z > 0))
		return false;
	for (size_t i = 0; i < c->n_bodies; i++)
		if (!body_is_usable(&c->bodies[i]))
			return false;
	return finite3(c->neutral.p) && isfinite(c->neutral.q.x + c->neutral.q.y + c->neutral.q.z + c->neutral.q.w);
}

static bool take_candidate(struct bb_track_candidate *c, size_t n_cameras)
{
	c->obs = calloc(n_cameras * BB_TRACK_MARKERS_MAX, sizeof(*c->obs));
	return c->obs;
}

static bool take_set(struct bb_track_set *set, size_t n_cameras)
{
	set->views = calloc(n_cameras, sizeof(*set->views));
	for (size_t i = 0; set->views && i < n_cameras; i++) {
		set->views[i].blobs = calloc(BB_CAMERA_BLOBS_MAX, sizeof(struct bb_blob));
		set->views[i].owner = calloc(BB_CAMERA_BLOBS_MAX, 1);
		if (!set->views[i].blobs || !set->views[i].owner)
			return false;
	}
	return set->views;
}

static bool take_cold(struct bb_track_cold *cold, size_t n_cameras)
{
	cold->n = calloc(n_cameras, sizeof(*cold->n));
	cold->index = calloc(n_cameras, sizeof(*cold->index));
	cold->ray = calloc(n_cameras, sizeof(*cold->ray));
	cold->point_of = calloc(n_cameras, sizeof(*cold->point_of));
	for (size_t i = 0; i < BB_TRACK_POINTS; i++) {
		cold->points[i].blob = calloc(n_cameras, sizeof(int16_t));
		if (!cold->points[i].blob)
			return false;
	}
	return cold->n && cold->index && cold->ray && cold->point_of;
}

/* n_cameras is at most 256: no product here can overflow. */
static bool take_memory(struct bb_tracker *tr, size_t n_cameras, size_t n_bodies)
{
	bool ok = take_cold(&tr->cold, n_cameras) && take_candidate(&tr->trial, n_cameras) &&
		  take_candidate(&tr->best, n_cameras) && take_candidate(&tr->rival, n_cameras) &&
		  take_candidate(&tr->aside, n_cameras);

	tr->lenses = calloc(n_cameras, sizeof(*tr->lenses));
	tr->stats = calloc(n_cameras, sizeof(*tr->stats));
	tr->mean_square_px2 = calloc(n_cameras, sizeof(*tr->mean_square_px2));
	tr->bodies = calloc(n_bodies, sizeof(*tr->bodies));
	tr->flood = calloc(BB_TRACK_FLOOD_MAX, sizeof(*tr->flood));
	ok = ok && tr->flood && tr->lenses && tr->stats && tr->mean_square_px2 && tr->bodies;
	for (size_t i = 0; ok && i < n_bodies; i++) {
		tr->bodies[i].noise = calloc(n_cameras, sizeof(struct bb_track_noise));
		ok = tr->bodies[i].noise && take_candidate(&tr->bodies[i].found, n_cameras);
	}
	for (size_t i = 0; ok && i <= BB_TRACK_SETS; i++)
		ok = take_set(&tr->sets[i], n_cameras);
	return ok;
}

static void know_body(struct bb_track_body *b, const struct bb_body *body)
{
	struct bb_vec3 sum = { 0, 0, 0 };

	b->body = body;
	for (size_t i = 0; i < body->n_markers; i++)
		sum = bb_vec3_add(sum, body->marker[i]);
	b->centroid = bb_vec3_scale(sum, 1 / (double)body->n_markers);
	for (size_t i = 0; i < body->n_markers; i++)
		b->radius_m = fmax(b->radius_m, bb_vec3_norm(bb_vec3_sub(body->marker[i], b->centroid)));
}

/* Of two bodies the one with more markers can be told with more certainty: it looks first, and a body that is a part of
 * another does not take its blobs. */
static void order_bodies(struct bb_tracker *tr)
{
	for (size_t i = 0; i < tr->config.n_bodies; i++) {
		size_t at = i;
		for (; at > 0 && tr->bodies[tr->order[at - 1]].body->n_markers < tr->bodies[i].body->n_markers; at--)
			tr->order[at] = tr->order[at - 1];
		tr->order[at] = (uint8_t)i;
	}
}

enum bb_status bb_tracker_create(const struct bb_tracker_config *config, struct bb_tracker **out)
{
	struct bb_tracker *tr;

	if (!out)
		return BB_ERR_USAGE;
	*out = NULL;
	if (!config || !config_is_usable(config))
		return BB_ERR_USAGE;
	tr = calloc(1, sizeof(*tr));
	if (!tr)
		return BB_ERR_NOMEM;
	tr->config = *config;
	tr->config.neutral.q = bb_quat_unit(config->neutral.q);
	if (!take_memory(tr, config->n_cameras, config->n_bodies)) {
		bb_tracker_destroy(tr);
		return BB_ERR_NOMEM;
	}
	for (size_t i = 0; i < config->n_bodies; i++)
		know_body(&tr->bodies[i], &config->bodies[i]);
	order_bodies(tr);
	for (size_t i = 0; i < config->n_cameras; i++)
		if (!bb_lens_init(&tr->lenses[i], &config->cameras[i])) {
			bb_tracker_destroy(tr);
			return BB_ERR_CONFIG;
		}
	*out = tr;
	return BB_OK;
}

static void drop_set(struct bb_track_set *set, size_t n_cameras)
{
	for (size_t i = 0; set->views && i < n_cameras; i++) {
		free(set->views[i].blobs);
		free(set->views[i].owner);
	}
	free(set->views);
}

void bb_tracker_destroy(struct bb_tracker *tr)
{
	if (!tr)
		return;
	for (size_t i = 0; i <= BB_TRACK_SETS; i++)
		drop_set(&tr->sets[i], tr->config.n_cameras);
	for (size_t i = 0; tr->bodies && i < tr->config.n_bodies; i++) {
		free(tr->bodies[i].found.obs);
		free(tr->bodies[i].noise);
	}
	for (size_t i = 0; i < BB_TRACK_POINTS; i++)
		free(tr->cold.points[i].blob);
	free(tr->cold.n);
	free(tr->cold.index);
	free(tr->cold.ray);
	free(tr->cold.point_of);
	free(tr->trial.obs);
	free(tr->best.obs);
	free(tr->rival.obs);
	free(tr->aside.obs);
	free(tr->lenses);
	free(tr->flood);
	free(tr->stats);
	free(tr->mean_square_px2);
	free(tr->bodies);
	free(tr);
}

/* --- frames into sets --- */

static struct bb_track_set *open_set(struct bb_tracker *tr)
{
	return &tr->sets[tr->n_closed];
}

/* Mean mid-exposure, summed as differences: stamps are large, differences within a set are not. */
static void date_set(struct bb_tracker *tr, struct bb_track_set *set)
{
	int64_t sum = 0, n = 0;

	for (size_t i = 0; i < tr->config.n_cameras; i++)
		if (set->views[i].here) {
			sum += set->views[i].mid_ns - set->ref_ns;
			n++;
		}
	set->at_ns = set->ref_ns + (n ? sum / n : 0);
}

/* Solves the oldest waiting set and gives its memory to the end of the queue. */
static void solve_oldest(struct bb_tracker *tr)
{
	const struct bb_track_set done = tr->sets[0];

	bb_track_solve_set(tr, &tr->sets[0]);
	memmove(&tr->sets[0], &tr->sets[1], BB_TRACK_SETS * sizeof(done));
	tr->sets[BB_TRACK_SETS] = done;
	tr->n_closed--;
}

static void close_set(struct bb_tracker *tr)
{
	struct bb_track_set *set = open_set(tr);

	if (!tr->open)
		return;
	date_set(tr, set);
	tr->open = false;
	tr->any_closed = true;
	tr->last_ref_ns = set->ref_ns;
	tr->n_closed++;
	/* A caller that never solves still gets every solution it asks for later: the queue cannot overflow. */
	if (tr->n_closed == BB_TRACK_SETS)
		solve_oldest(tr);
}

static void begin_set(struct bb_tracker *tr, int64_t ref_ns)
{
	struct bb_track_set *set = open_set(tr);

	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		set->views[i].here = false;
		set->views[i].n = 0;
	}
	set->ref_ns = set->at_ns = ref_ns;
	set->n_here = 0;
	tr->open = true;
}

/* a - b in ns; far apart is far apart. */
static int64_t apart_ns(int64_t a, int64_t b)
{
	int64_t d;

	if (__builtin_sub_overflow(a, b, &d))
		return a > b ? INT64_MAX : -INT64_MAX;
	return d;
}

/*
 * The set a frame belongs to: the open one, or a new one that closes it; NULL for a late frame. Many late frames in a
 * row mean that the newer time was the mistake (one stamp from the future must not shut the door for ever).
 */
static struct bb_track_set *set_for(struct bb_tracker *tr, size_t camera, int64_t mid_ns)
{
	const int64_t ref_ns = tr->open ? open_set(tr)->ref_ns : tr->last_ref_ns;
	const bool any = tr->open || tr->any_closed;
	const int64_t d = any ? apart_ns(mid_ns, ref_ns) : INT64_MAX;

	if (tr->open && d >= -tr->config.group_ns && d <= tr->config.group_ns) {
		const struct bb_track_view *view = &open_set(tr)->views[camera];
		if (!view->here) {
			tr->late = 0;
			return open_set(tr);
		}
		if (mid_ns <= view->mid_ns)
			return NULL; /* the same frame again */
	} else if (any && d <= tr->config.group_ns) {
		if (++tr->late <= 2 * tr->config.n_cameras + 4)
			return NULL;
	}
	tr->late = 0;
	close_set(tr);
	begin_set(tr, mid_ns);
	return open_set(tr);
}

static bool blob_is_sane(const struct bb_lens *lens, const struct bb_blob *b)
{
	return isfinite(b->x_px) && isfinite(b->y_px) && (double)b->x_px > -0.5 * lens->width_px &&
	       (double)b->y_px > -0.5 * lens->height_px && (double)b->x_px < 1.5 * lens->width_px &&
	       (double)b->y_px < 1.5 * lens->height_px;
}

/* Where the bodies should be in a camera's image. */
static size_t predicted_px(const struct bb_tracker *tr, size_t camera, int64_t mid_ns, double px[][2])
{
	size_t n = 0;

	for (size_t i = 0; i < tr->config.n_bodies; i++) {
		struct bb_filter_state s;
		if (bb_track_prior(&tr->bodies[i], mid_ns, 1.0, &s) && bb_lens_project(&tr->lenses[camera], s.p, px[n]))
			n++;
	}
	return n;
}

/* How far from the nearest prediction, in sixteenths of an octave of its square: the upper bits of a float. */
static uint16_t bucket_of(const struct bb_blob *b, const float px[][2], size_t n)
{
	float d2 = 4e6F;
	uint32_t bits;

	for (size_t i = 0; i < n; i++) {
		const float dx = b->x_px - px[i][0], dy = b->y_px - px[i][1], at = dx * dx + dy * dy;
		d2 = at < d2 ? at : d2;
	}
	d2 += 1;
	memcpy(&bits, &d2, sizeof(bits));
	return (uint16_t)((bits >> 19) - (127u << 4));
}

/* More blobs than fit: those nearest to the predictions, found by counting distances; without a prediction the first.
 */
static void keep_nearest(const struct bb_tracker *tr, size_t camera, struct bb_track_view *view,
			 const struct bb_blob *blobs, size_t n)
{
	double at_px[BB_BODIES_MAX][2];
	float px[BB_BODIES_MAX][2];
	const size_t n_px = predicted_px(tr, camera, view->mid_ns, at_px);
	size_t count[FLOOD_BUCKETS] = { 0 }, limit = 0, sum = 0;
	uint16_t *bucket = tr->flood;

	for (size_t i = 0; i < n_px; i++)
		for (int k = 0; k < 2; k++)
			px[i][k] = (float)at_px[i][k];
	for (size_t i = 0; i < n; i++) {
		const bool sane = blob_is_sane(&tr->lenses[camera], &blobs[i]);
		bucket[i] = sane ? bucket_of(&blobs[i], (const float(*)[2])px, n_px) : FLOOD_BUCKETS - 1;
		count[bucket[i]]++;
	}
	while (limit < FLOOD_BUCKETS - 1 && sum + count[limit] <= BB_CAMERA_BLOBS_MAX)
		sum += count[limit++];
	/* the full buckets, then what still fits of the first that does not; the last is not for keeping */
	for (size_t i = 0; i < n && view->n < BB_CAMERA_BLOBS_MAX; i++)
		if (bucket[i] < limit)
			view->blobs[view->n++] = blobs[i];
	for (size_t i = 0; i < n && view->n < BB_CAMERA_BLOBS_MAX && limit < FLOOD_BUCKETS - 1; i++)
		if (bucket[i] == limit)
			view->blobs[view->n++] = blobs[i];
}

void bb_tracker_frame(struct bb_tracker *tr, size_t camera, int64_t mid_exposure_ns, const struct bb_blob *blobs,
		      size_t n)
{
	if (!tr || camera >= tr->config.n_cameras || (n && !blobs))
		return;
	tr->stats[camera].frames++;
	struct bb_track_set *set = set_for(tr, camera, mid_exposure_ns);
	if (!set)
		return;
	struct bb_track_view *view = &set->views[camera];
	view->here = true;
	view->mid_ns = mid_exposure_ns;
	view->n = 0;
	set->n_here++;
	view->flooded = n >= BB_CAMERA_BLOBS_MAX;
	tr->stats[camera].floods += view->flooded;
	if (n > BB_CAMERA_BLOBS_MAX) {
		keep_nearest(tr, camera, view, blobs, n < BB_TRACK_FLOOD_MAX ? n : BB_TRACK_FLOOD_MAX);
		return;
	}
	for (size_t i = 0; i < n; i++)
		if (blob_is_sane(&tr->lenses[camera], &blobs[i]))
			view->blobs[view->n++] = blobs[i];
}

size_t bb_tracker_solve(struct bb_tracker *tr, bool flush, size_t body, struct bb_track_solution *out, size_t cap)
{
	if (!tr || body >= tr->config.n_bodies)
		return 0;
	if (tr->open && (flush || open_set(tr)->n_here == tr->config.n_cameras))
		close_set(tr);
	/* The open set stands behind the closed ones: it moves down with them. */
	while (tr->n_closed)
		solve_oldest(tr);
	struct bb_track_body *b = &tr->bodies[body];
	const uint64_t n = b->n_solutions - b->n_told;
	uint64_t copy = n < BB_TRACK_RING ? n : BB_TRACK_RING;
	if (!out)
		cap = 0;
	if (copy > cap)
		copy = cap;
	for (uint64_t i = 0; i < copy; i++)
		out[i] = b->ring[(b->n_solutions - copy + i) % BB_TRACK_RING];
	b->n_told = b->n_solutions;
	return (size_t)n;
}

static struct bb_track_pose pose_never(const struct bb_tracker *tr, size_t body)
{
	struct bb_track_pose out = { .flags = BB_TRACK_NEVER };

	/* Only bodies[0] has a neutral; the others are put there too, and the flag says what that is worth. */
	out.eyes = tr->config.neutral;
	out.body.q = tr->config.neutral.q;
	out.body.p = bb_vec3_sub(out.eyes.p, bb_quat_rotate(out.body.q, tr->config.bodies[body].eye_centre));
	out.position_sigma_mm = 1e6;
	out.angle_sigma_deg = 180;
	for (int i = 0; i < 6; i++) {
		const bool diagonal = i == 0 || i == 3 || i == 5;
		out.covariance_mm2[i] = diagonal ? 1e12 / 3 : 0;
		out.covariance_deg2[i] = diagonal ? 180.0 * 180 / 3 : 0;
	}
	return out;
}

/* Of the eyes: the centroid's shift plus a turn of the arm from there, J = [-[arm]x, 1]. */
static void tell_doubt(const struct bb_filter_state *s, struct bb_vec3 arm, struct bb_track_pose *out)
{
	const double j[3][6] = { { 0, arm.z, -arm.y, 1, 0, 0 },
				 { -arm.z, 0, arm.x, 0, 1, 0 },
				 { arm.y, -arm.x, 0, 0, 0, 1 } };

	out->position_sigma_mm = 1e3 * s->position_sigma_m;
	out->angle_sigma_deg = BB_DEG_PER_RAD * s->angle_sigma_rad;
	bb_track_pack(s->covariance, 0, BB_DEG_PER_RAD, out->covariance_deg2);
	for (int r = 0, i = 0; r < 3; r++)
		for (int c = r; c < 3; c++, i++)
			for (int a = 0; a < 6; a++)
				for (int b = 0; b < 6; b++)
					out->covariance_mm2[i] += 1e6 * j[r][a] * s->covariance[a][b] * j[c][b];
}

struct bb_track_pose bb_tracker_pose(const struct bb_tracker *tr, size_t body, int64_t at_ns)
{
	if (!tr || body >= tr->config.n_bodies)
		return (struct bb_track_pose){ .body = BB_POSE_IDENTITY,
					       .eyes = BB_POSE_IDENTITY,
					       .flags = BB_TRACK_NEVER };
	const struct bb_track_body *b = &tr->bodies[body];
	if (!b->filter.live)
		return pose_never(tr, body);
	const double age = bb_seconds_between(at_ns, b->filter.at_ns), most = 1e-9 * (double)tr->config.freeze_ns;
	const bool frozen = age > most;
	const struct bb_filter_state s = bb_filter_predict(&b->filter, frozen ? most : fmax(age, -PREDICT_BACK_S));
	struct bb_track_pose out = { .body = bb_track_pose_about(b, s.p, s.q), .solved_ns = b->filter.at_ns };

	out.eyes = (struct bb_pose){ bb_pose_apply(&out.body, b->body->eye_centre), s.q };
	/* A frozen head goes on walking: the doubt grows though the pose does not. */
	const struct bb_filter_state doubt = frozen ? bb_filter_predict(&b->filter, fmin(age, 10)) : s;
	tell_doubt(&doubt, bb_vec3_sub(out.eyes.p, s.p), &out);
	out.flags = frozen ? BB_TRACK_FROZEN : b->fresh ? BB_TRACK_FRESH : BB_TRACK_PREDICTED;
	out.flags |= b->last.flags & (BB_TRACK_COLLINEAR | BB_TRACK_ONE_CAMERA);
	return out;
}

struct bb_track_camera_stats bb_tracker_camera(const struct bb_tracker *tr, size_t camera)
{
	if (!tr || camera >= tr->config.n_cameras)
		return (struct bb_track_camera_stats){ 0 };
	return tr->stats[camera];
}

struct bb_track_stats bb_tracker_stats(const struct bb_tracker *tr)
{
	return tr ? tr->counted : (struct bb_track_stats){ 0 };
}

size_t bb_tracker_labels(const struct bb_tracker *tr, size_t body, struct bb_track_label *out, size_t cap)
{
	if (!tr || body >= tr->config.n_bodies || !tr->bodies[body].fresh)
		return 0;
	const struct bb_track_candidate *c = &tr->bodies[body].found;
	for (size_t i = 0; out && i < c->n_obs && i < cap; i++)
		out[i] = (struct bb_track_label){ c->obs[i].camera, c->obs[i].marker, c->obs[i].x_px, c->obs[i].y_px };
	return c->n_obs;
}
