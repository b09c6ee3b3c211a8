/*
 * sync/track/match.c: points from the blobs of all cameras without knowing any body: pairs of rays that meet, confirmed
 * by the other cameras. Work is bounded by the number of pair tests, whatever the cameras send.
 */
#include <math.h>
#include <string.h>

#include "sync/track/track.h"
#include "sync/track/triangulate.h"

#define PAIR_TESTS_MAX 200000
#define SURVIVORS_MAX 6000 /* pairs that met and were shown to the other cameras */
#define LOOK_PX_MAX 12.0   /* widest search in a confirming camera */

/* The frame's blobs that nobody owns; of too many the nearest to where the body should be, or else the largest. */
static double preference(const struct bb_blob *blob, const double *near_px)
{
	if (!near_px)
		return -(double)blob->area_px;
	const double dx = (double)blob->x_px - near_px[0], dy = (double)blob->y_px - near_px[1];
	return dx * dx + dy * dy;
}

static void choose_blobs(struct bb_tracker *tr, const struct bb_track_set *set, size_t camera, size_t most,
			 const struct bb_vec3 *near)
{
	const struct bb_track_view *view = &set->views[camera];
	struct bb_track_cold *cold = &tr->cold;
	double rank[BB_TRACK_COLD_BLOBS], px[2];
	const bool aimed = near && bb_lens_project(&tr->lenses[camera], *near, px);
	size_t n = 0;

	for (uint16_t i = 0; view->here && i < view->n; i++) {
		struct bb_ray ray;
		if (view->owner[i])
			continue;
		const double r = preference(&view->blobs[i], aimed ? px : NULL);
		if (n == most && !(r < rank[n - 1]))
			continue;
		if (!bb_lens_ray(&tr->lenses[camera], (double)view->blobs[i].x_px, (double)view->blobs[i].y_px, &ray))
			continue;
		size_t at = n < most ? n++ : n - 1;
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

static size_t pair_tests(const struct bb_tracker *tr, const struct bb_track_set *set, size_t most)
{
	size_t before = 0, tests = 0;

	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		const size_t n = !set->views[i].here ? 0 : set->views[i].n < most ? set->views[i].n : most;
		tests += before * n;
		before += n;
	}
	return tests;
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

static bool in_room(const struct bb_tracker_config *c, struct bb_vec3 p)
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

/* One pair of rays: if they meet, ask the other cameras. Returns whether they met. */
static bool try_pair(struct bb_tracker *tr, const struct bb_track_set *set, size_t i, size_t a, size_t j, size_t b)
{
	struct bb_track_cold *cold = &tr->cold;
	const struct bb_sight sa = sight(tr, i, a), sb = sight(tr, j, b);
	int16_t blob[BB_TRACK_CAMERAS_MAX];
	struct bb_track_point point = { .n_cameras = 0 };
	struct bb_vec3 mid;
	double gap, sigma_m;

	/* Both belong to one strong point already: it would only be found again. */
	if (cold->point_of[i][a] >= 0 && cold->point_of[i][a] == cold->point_of[j][b] &&
	    cold->points[cold->point_of[i][a]].n_cameras > 2)
		return false;
	if (!bb_triangulate_pair(&sa, &sb, BB_RAY_ANGLE_MIN_RAD, &mid, &gap, &sigma_m) || gap > BB_TRACK_GATE ||
	    !in_room(&tr->config, mid))
		return false;
	for (size_t k = 0; k < tr->config.n_cameras; k++)
		blob[k] = (int16_t)(k == i ? (int)a : k == j ? (int)b : look(tr, set, k, mid, sigma_m));
	if (confirm(tr, blob, &point) && in_room(&tr->config, point.p))
		store(tr, &point, blob);
	return true;
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

void bb_track_match(struct bb_tracker *tr, const struct bb_track_set *set, const struct bb_vec3 *near)
{
	struct bb_track_cold *cold = &tr->cold;
	const size_t n = tr->config.n_cameras;
	size_t most = BB_TRACK_COLD_BLOBS, met = 0;

	while (most > 4 && pair_tests(tr, set, most) > PAIR_TESTS_MAX)
		most -= 1 + most / 8;
	for (size_t i = 0; i < n; i++) {
		choose_blobs(tr, set, i, most, near);
		memset(cold->point_of[i], 0xff, sizeof(cold->point_of[i]));
	}
	cold->n_points = 0;
	for (size_t i = 0; i < n; i++)
		for (size_t j = i + 1; j < n; j++)
			for (size_t a = 0; a < cold->n[i]; a++)
				for (size_t b = 0; b < cold->n[j] && met < SURVIVORS_MAX; b++)
					met += try_pair(tr, set, i, a, j, b);
	sort_points(cold);
}
