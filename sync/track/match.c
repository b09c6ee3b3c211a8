/*
 * sync/track/match.c: points from the blobs of all cameras without knowing any body: pairs of rays that meet, confirmed
 * by the other cameras. Work is bounded by the number of pair tests, whatever the cameras send.
 */
#include <math.h>
#include <string.h>

#include "sync/track/track.h"
#include "sync/track/triangulate.h"

#define LOOK_PX_MAX 12.0 /* widest search in a confirming camera */
#define SETTLED 5        /* cameras: a blob of a point that so many confirm is not tried any further */

/* The frame's blobs that nobody owns; of too many the nearest to where the body should be, or else the largest. */
static double preference(const struct bb_blob *blob, const double near_px[][2], size_t n_near)
{
	double best = HUGE_VAL;

	if (!n_near)
		return -(double)blob->area_px;
	for (size_t i = 0; i < n_near; i++) {
		const double dx = (double)blob->x_px - near_px[i][0], dy = (double)blob->y_px - near_px[i][1];
		best = fmin(best, dx * dx + dy * dy);
	}
	return best;
}

/* Where the bodies that this set has not solved should be in a camera's image. */
static size_t lost_px(const struct bb_tracker *tr, const struct bb_track_set *set, size_t camera, double px[][2])
{
	size_t n = 0;

	for (size_t i = 0; i < tr->config.n_bodies; i++) {
		struct bb_filter_state s;
		if (!tr->bodies[i].found.ok && bb_track_prior(&tr->bodies[i], set->at_ns, BB_TRACK_PRIOR_S, &s) &&
		    bb_lens_project(&tr->lenses[camera], s.p, px[n]))
			n++;
	}
	return n;
}

static void choose_blobs(struct bb_tracker *tr, const struct bb_track_set *set, size_t camera)
{
	const struct bb_track_view *view = &set->views[camera];
	struct bb_track_cold *cold = &tr->cold;
	double rank[BB_TRACK_COLD_BLOBS], px[BB_BODIES_MAX][2];
	const size_t n_px = lost_px(tr, set, camera, px);
	size_t n = 0;

	for (uint16_t i = 0; view->here && i < view->n; i++) {
		struct bb_ray ray;
		if (view->owner[i])
			continue;
		const double r = preference(&view->blobs[i], (const double(*)[2])px, n_px);
		if (n == BB_TRACK_COLD_BLOBS && !(r < rank[n - 1]))
			continue;
		if (!bb_lens_ray(&tr->lenses[camera], (double)view->blobs[i].x_px, (double)view->blobs[i].y_px, &ray))
			continue;
		size_t at = n < BB_TRACK_COLD_BLOBS ? n++ : n - 1;
		for (; at > 0 && rank[at - 1] > r; at--) {
			rank[at] = rank[at - 1];
			cold->index[camera][at] = cold->index[camera][at - 1];
			cold->ray[camera][at] = cold->ray[camera][at - 1];
		}
		rank[at] = r;
		cold->index[camera][at] = i;
		cold->ray[camera][at] = ray;
	}
	cold->n[camera] = (uint16_t)n;
}

static struct bb_sight sight(const struct bb_tracker *tr, size_t camera, size_t k)
{
	const struct bb_ray *ray = &tr->cold.ray[camera][k];

	return (struct bb_sight){ tr->lenses[camera].o, ray->d, ray->sigma_rad * tr->config.blob_sigma_px };
}

/* The cold blob of a camera nearest to a pixel, -1 when none is within the gate. */
static int look(const struct bb_tracker *tr, const struct bb_track_set *set, size_t camera, struct bb_vec3 p,
		double sigma_m)
{
	const struct bb_lens *lens = &tr->lenses[camera];
	double px[2];
	int best = -1;

	if (!tr->cold.n[camera] || !bb_lens_project(lens, p, px))
		return -1;
	const double s = sigma_m * lens->fx_px / bb_lens_depth(lens, p), sigma = tr->config.blob_sigma_px;
	double gate = fmin(BB_TRACK_GATE * sqrt(sigma * sigma + s * s), fmax(LOOK_PX_MAX, BB_TRACK_GATE * sigma));
	gate *= gate;
	for (int k = 0; k < tr->cold.n[camera]; k++) {
		const struct bb_blob *b = &set->views[camera].blobs[tr->cold.index[camera][k]];
		const double dx = (double)b->x_px - px[0], dy = (double)b->y_px - px[1];
		if (dx * dx + dy * dy < gate) {
			gate = dx * dx + dy * dy;
			best = k;
		}
	}
	return best;
}

/* Keeps what the refined point itself confirms; false when less than two cameras do. */
static bool confirm(const struct bb_tracker *tr, int16_t *blob, struct bb_track_point *point)
{
	struct bb_sight sights[BB_TRACK_CAMERAS_MAX];
	uint16_t camera[BB_TRACK_CAMERAS_MAX];
	struct bb_triangulated t;

	for (;;) {
		size_t n = 0, worst = 0;
		double most = -1;
		for (size_t i = 0; i < tr->config.n_cameras; i++)
			if (blob[i] >= 0) {
				camera[n] = (uint16_t)i;
				sights[n++] = sight(tr, i, (size_t)blob[i]);
			}
		if (!bb_triangulate(sights, n, BB_RAY_ANGLE_MIN_RAD, &t))
			return false;
		for (size_t k = 0; k < n; k++) {
			const struct bb_vec3 v = bb_vec3_sub(t.p, sights[k].o), off = bb_vec3_cross(v, sights[k].d);
			const double r2 =
				bb_vec3_dot(off, off) / (bb_vec3_dot(v, v) * sights[k].sigma_rad * sights[k].sigma_rad);
			if (r2 > most) {
				most = r2;
				worst = k;
			}
		}
		if (most < BB_TRACK_GATE * BB_TRACK_GATE) {
			point->p = t.p;
			point->sigma_m = t.sigma_m;
			point->n_cameras = (uint16_t)n;
			return true;
		}
		if (n < 3)
			return false;
		blob[camera[worst]] = -1;
	}
}

bool bb_track_in_room(const struct bb_tracker_config *c, struct bb_vec3 p)
{
	return p.x > c->room_min.x - 0.7 && p.y > c->room_min.y - 0.7 && p.z > c->room_min.z - 0.7 &&
	       p.x < c->room_max.x + 0.7 && p.y < c->room_max.y + 0.7 && p.z < c->room_max.z + 0.7;
}

static bool same_blobs(const int16_t *a, const int16_t *b, size_t n)
{
	return !memcmp(a, b, n * sizeof(*a));
}

/* Stores a point: in a free place, or instead of the weakest when it is stronger. */
static void store(struct bb_tracker *tr, const struct bb_track_point *point, const int16_t *blob)
{
	struct bb_track_cold *cold = &tr->cold;
	const size_t n_cameras = tr->config.n_cameras;
	size_t at = cold->n_points;

	for (size_t i = 0; i < cold->n_points; i++)
		if (same_blobs(cold->points[i].blob, blob, n_cameras))
			return;
	if (at == BB_TRACK_POINTS) {
		at = 0;
		for (size_t i = 1; i < BB_TRACK_POINTS; i++)
			if (cold->points[i].n_cameras < cold->points[at].n_cameras)
				at = i;
		if (cold->points[at].n_cameras >= point->n_cameras)
			return;
		for (size_t c = 0; c < n_cameras; c++)
			for (size_t k = 0; k < cold->n[c]; k++)
				if (cold->point_of[c][k] == (int16_t)at)
					cold->point_of[c][k] = -1;
	} else {
		cold->n_points++;
	}
	int16_t *keep = cold->points[at].blob;
	cold->points[at] = *point;
	cold->points[at].blob = keep;
	memcpy(keep, blob, n_cameras * sizeof(*blob));
	for (size_t c = 0; c < n_cameras; c++) {
		if (blob[c] < 0)
			continue;
		int16_t *owner = &cold->point_of[c][blob[c]];
		if (*owner < 0 || cold->points[*owner].n_cameras < point->n_cameras)
			*owner = (int16_t)at;
	}
}

static bool settled(const struct bb_track_cold *cold, size_t camera, size_t k)
{
	const int16_t point = cold->point_of[camera][k];

	return point >= 0 && cold->points[point].n_cameras >= SETTLED;
}

/* Rays that pass each other by more than their noise at the far end of the room: told without a division, which is
 * what nearly all pairs of a flood come to. */
static inline bool pass_by(const struct bb_ray *a, const struct bb_ray *b, struct bb_vec3 base, double most2)
{
	const struct bb_vec3 n = bb_vec3_cross(a->d, b->d);
	const double apart = bb_vec3_dot(base, n);

	return apart * apart > most2 * (a->sigma_rad * a->sigma_rad + b->sigma_rad * b->sigma_rad) * bb_vec3_dot(n, n);
}

/* One pair of rays: if they meet, ask the other cameras. */
static void try_pair(struct bb_tracker *tr, const struct bb_track_set *set, size_t i, size_t a, size_t j, size_t b)
{
	struct bb_track_cold *cold = &tr->cold;
	const struct bb_sight sa = sight(tr, i, a), sb = sight(tr, j, b);
	int16_t blob[BB_TRACK_CAMERAS_MAX];
	struct bb_track_point point = { .n_cameras = 0 };
	struct bb_vec3 mid;
	double gap, sigma_m;

	if (!bb_triangulate_pair(&sa, &sb, BB_RAY_ANGLE_MIN_RAD, &mid, &gap, &sigma_m) || gap > BB_TRACK_GATE ||
	    !bb_track_in_room(&tr->config, mid))
		return;
	/* Both belong to one point already: it would only be found again. */
	if (cold->point_of[i][a] >= 0 && cold->point_of[i][a] == cold->point_of[j][b] &&
	    cold->points[cold->point_of[i][a]].n_cameras > 2)
		return;
	tr->counted.last.points++;
	for (size_t k = 0; k < tr->config.n_cameras; k++)
		blob[k] = (int16_t)(k == i ? (int)a : k == j ? (int)b : look(tr, set, k, mid, sigma_m));
	cold->looks += (uint32_t)tr->config.n_cameras;
	if (confirm(tr, blob, &point) && bb_track_in_room(&tr->config, point.p))
		store(tr, &point, blob);
}

static void sort_points(struct bb_track_cold *cold)
{
	/* Insertion keeps the order of equals: the same blobs give the same labels on every machine. */
	for (size_t i = 1; i < cold->n_points; i++) {
		const struct bb_track_point p = cold->points[i];
		size_t at = i;
		for (; at > 0 && cold->points[at - 1].n_cameras < p.n_cameras; at--)
			cold->points[at] = cold->points[at - 1];
		cold->points[at] = p;
	}
}

/* The pairs of two cameras' blobs of which one has rank r and the other that or a better one. false: the set's budget
 * is spent. */
static bool try_rank(struct bb_tracker *tr, const struct bb_track_set *set, size_t i, size_t j, size_t r)
{
	const struct bb_track_cold *cold = &tr->cold;
	const struct bb_vec3 base = bb_vec3_sub(tr->lenses[j].o, tr->lenses[i].o);
	const double most = BB_TRACK_GATE * cold->reach_m * tr->config.blob_sigma_px;
	const size_t n_i = r < cold->n[i] ? r + 1 : cold->n[i], n_j = r < cold->n[j] ? r : cold->n[j];

	if (tr->counted.last.pairs >= BB_TRACK_PAIRS_MAX || cold->looks >= BB_TRACK_LOOKS_MAX)
		return false;
	for (size_t a = 0; r < cold->n[j] && a < n_i; a++) {
		if (settled(cold, i, a) || settled(cold, j, r))
			continue;
		tr->counted.last.pairs++;
		if (!pass_by(&cold->ray[i][a], &cold->ray[j][r], base, most * most))
			try_pair(tr, set, i, a, j, r);
	}
	for (size_t b = 0; r < cold->n[i] && b < n_j; b++) {
		if (settled(cold, i, r) || settled(cold, j, b))
			continue;
		tr->counted.last.pairs++;
		if (!pass_by(&cold->ray[i][r], &cold->ray[j][b], base, most * most))
			try_pair(tr, set, i, r, j, b);
	}
	return true;
}

static void try_all(struct bb_tracker *tr, const struct bb_track_set *set)
{
	const size_t n = tr->config.n_cameras;
	size_t ranks = 0;

	for (size_t i = 0; i < n; i++)
		ranks = tr->cold.n[i] > ranks ? tr->cold.n[i] : ranks;
	for (size_t r = 0; r < ranks; r++)
		for (size_t i = 0; i < n; i++)
			for (size_t j = i + 1; j < n; j++)
				if (!try_rank(tr, set, i, j, r))
					return;
}

/* From any lens to the farthest corner of the room. */
static double reach(const struct bb_tracker *tr)
{
	const struct bb_vec3 low = tr->config.room_min, high = tr->config.room_max;
	double most = 0;

	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		const struct bb_vec3 o = tr->lenses[i].o;
		const struct bb_vec3 d = { fmax(o.x - low.x, high.x - o.x) + 1, fmax(o.y - low.y, high.y - o.y) + 1,
					   fmax(o.z - low.z, high.z - o.z) + 1 };
		most = fmax(most, bb_vec3_norm(d));
	}
	return most;
}

void bb_track_match(struct bb_tracker *tr, const struct bb_track_set *set)
{
	struct bb_track_cold *cold = &tr->cold;

	if (cold->matched) {
		bb_track_match_again(tr, set);
		return;
	}
	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		choose_blobs(tr, set, i);
		memset(cold->point_of[i], 0xff, sizeof(cold->point_of[i]));
	}
	cold->matched = true;
	cold->n_points = 0;
	cold->reach_m = reach(tr);
	try_all(tr, set);
	sort_points(cold);
}

/* The cold lists without what has an owner by now; where each blob went. */
static void drop_owned(struct bb_track_cold *cold, const struct bb_track_view *view, size_t camera,
		       int16_t to[BB_TRACK_COLD_BLOBS])
{
	uint16_t n = 0;

	for (size_t k = 0; k < cold->n[camera]; k++) {
		to[k] = -1;
		if (view->owner[cold->index[camera][k]])
			continue;
		cold->index[camera][n] = cold->index[camera][k];
		cold->ray[camera][n] = cold->ray[camera][k];
		to[k] = (int16_t)n++;
	}
	cold->n[camera] = n;
}

void bb_track_match_again(struct bb_tracker *tr, const struct bb_track_set *set)
{
	struct bb_track_cold *cold = &tr->cold;
	uint16_t was[BB_TRACK_POINTS] = { 0 };
	size_t n = 0;

	for (size_t p = 0; p < cold->n_points; p++)
		was[p] = cold->points[p].n_cameras;
	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		int16_t to[BB_TRACK_COLD_BLOBS];
		drop_owned(cold, &set->views[i], i, to);
		for (size_t p = 0; p < cold->n_points; p++) {
			int16_t *blob = &cold->points[p].blob[i];
			if (*blob >= 0 && to[*blob] < 0)
				cold->points[p].n_cameras--;
			*blob = *blob < 0 ? *blob : to[*blob];
		}
	}
	/* A point that has lost half of its cameras was the other body's; swapping keeps every blob list somebody's. */
	for (size_t p = 0; p < cold->n_points; p++) {
		if (cold->points[p].n_cameras < 2 || 2 * cold->points[p].n_cameras < was[p])
			continue;
		const struct bb_track_point keep = cold->points[n];
		cold->points[n++] = cold->points[p];
		cold->points[p] = keep;
	}
	cold->n_points = n;
}
