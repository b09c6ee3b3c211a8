/*
 * sync/track/associate.c: which blob is which marker, given a pose and how well it is known; and the way from a rough
 * pose to a polished one by narrowing that gate. No state of its own.
 */
#include <math.h>
#include <string.h>

#include "sync/track/track.h"

#define NEAREST 3 /* blobs remembered per marker: nearer ones may belong to another marker */
#define GATE_SIGMAS 4.0
#define MERGE_NOISE 3.0 /* sigmas that noise may bring a blob of two nearer to one of them */
#define BORDER_PX 1.0 /* nearer to the edge of the sensor a blob is cut off */

struct pick {
	double d2;
	uint16_t blob;
	uint8_t marker;
};

static bool on_sensor(const struct bb_lens *lens, const double px[2])
{
	return px[0] > BORDER_PX && px[1] > BORDER_PX && px[0] < lens->width_px - 1 - BORDER_PX &&
	       px[1] < lens->height_px - 1 - BORDER_PX;
}

/* Free blobs in the box about the markers' images: of many blobs only these are held against each marker. */
static size_t blobs_in_reach(const struct bb_track_view *view, size_t body, const double px[][2], const bool *seen,
			     size_t n, double gate_px, uint16_t *out)
{
	float low[2] = { INFINITY, INFINITY }, high[2] = { -INFINITY, -INFINITY };
	size_t found = 0;

	for (size_t m = 0; m < n; m++)
		for (int k = 0; seen[m] && k < 2; k++) {
			low[k] = fminf(low[k], (float)(px[m][k] - gate_px - 0.01));
			high[k] = fmaxf(high[k], (float)(px[m][k] + gate_px + 0.01));
		}
	for (uint16_t i = 0; i < view->n; i++) {
		const struct bb_blob *b = &view->blobs[i];
		if (b->x_px > low[0] && b->x_px < high[0] && b->y_px > low[1] && b->y_px < high[1] &&
		    (!view->owner[i] || view->owner[i] == body + 1))
			out[found++] = i;
	}
	return found;
}

/* The few nearest blobs of a list within the gate, appended sorted by distance to picks. */
static size_t nearest_blobs(const struct bb_track_view *view, const uint16_t *list, size_t n_list, const double px[2],
			    double gate_px, uint8_t marker, struct pick *picks)
{
	size_t n = 0;

	for (size_t k = 0; k < n_list; k++) {
		const uint16_t i = list[k];
		const double dx = (double)view->blobs[i].x_px - px[0], dy = (double)view->blobs[i].y_px - px[1];
		const double d2 = dx * dx + dy * dy;
		if (!(d2 <= gate_px * gate_px))
			continue;
		size_t at = n < NEAREST ? n++ : NEAREST;
		for (; at > 0 && picks[at - 1].d2 > d2; at--)
			if (at < NEAREST)
				picks[at] = picks[at - 1];
		if (at < NEAREST)
			picks[at] = (struct pick){ d2, i, marker };
	}
	return n;
}

/* Two images may have melted into one blob half way between: what one of them finds alone is neither. Farther apart
 * than merge_px the gate itself throws such a blob out. */
static bool may_be_merged(const double px[][2], const bool *seen, const bool *got, size_t n, size_t m, double merge_px)
{
	for (size_t i = 0; i < n; i++) {
		if (i == m || !seen[i] || got[i])
			continue;
		const double dx = px[i][0] - px[m][0], dy = px[i][1] - px[m][1];
		if (dx * dx + dy * dy < merge_px * merge_px)
			return true;
	}
	return false;
}

/* Nearest first, each blob and each marker once. */
static size_t assign(struct pick *picks, size_t n_picks, const struct pick **chosen, bool *got)
{
	size_t n = 0;

	for (;;) {
		const struct pick *best = NULL;
		for (size_t i = 0; i < n_picks; i++)
			if (picks[i].d2 >= 0 && (!best || picks[i].d2 < best->d2))
				best = &picks[i];
		if (!best)
			return n;
		for (size_t i = 0; i < n_picks; i++)
			if (&picks[i] != best && (picks[i].blob == best->blob || picks[i].marker == best->marker))
				picks[i].d2 = -1;
		got[best->marker] = true;
		picks[best - picks].d2 = -1;
		chosen[n++] = best;
	}
}

static struct bb_vec3 moved_to(const struct bb_track_candidate *c, struct bb_vec3 p, struct bb_vec3 pivot, double dt_s)
{
	const struct bb_vec3 v = bb_vec3_add(c->fit.velocity, bb_vec3_cross(c->fit.spin, bb_vec3_sub(p, pivot)));

	return bb_vec3_add(p, bb_vec3_scale(v, dt_s));
}

/* Of a marker, when its row exposes. */
static bool image_of(const struct bb_lens *lens, const struct bb_track_candidate *c, struct bb_vec3 p, struct bb_vec3 pivot,
		     double dt_s, double px[2])
{
	if (!bb_lens_project(lens, moved_to(c, p, pivot, dt_s), px))
		return false;
	if (!(lens->row_s > 0))
		return true;
	return bb_lens_project(lens, moved_to(c, p, pivot, dt_s + bb_lens_row_s(lens, px[1])), px);
}

static void associate_camera(const struct bb_tracker *tr, const struct bb_track_set *set, size_t camera, size_t body,
			     const struct bb_vec3 *markers, struct bb_vec3 pivot, const struct bb_track_gate *gate,
			     struct bb_track_candidate *c)
{
	const struct bb_track_view *view = &set->views[camera];
	const struct bb_lens *lens = &tr->lenses[camera];
	const struct bb_track_body *b = &tr->bodies[body];
	const size_t n = b->body->n_markers;
	const double dt_s = bb_seconds_between(view->mid_ns, set->at_ns), depth = bb_lens_depth(lens, pivot);
	struct pick picks[BB_TRACK_MARKERS_MAX * NEAREST];
	const struct pick *chosen[BB_TRACK_MARKERS_MAX];
	double px[BB_TRACK_MARKERS_MAX][2];
	bool seen[BB_TRACK_MARKERS_MAX], got[BB_TRACK_MARKERS_MAX] = { false };
	uint16_t list[BB_CAMERA_BLOBS_MAX];
	size_t n_picks = 0;

	if (!(depth > 0.01) || !view->n)
		return;
	const double scale = fmax(lens->fx_px, lens->fy_px) / depth, arm = b->radius_m * gate->angle_sigma_rad;
	const double metric = gate->position_sigma_m * gate->position_sigma_m + arm * arm;
	/* Noisier blobs than configured must not be cut to what was expected: what is left would look like that. */
	const double worse = bb_track_noise(b, camera), sigma_px = tr->config.blob_sigma_px * fmax(1, worse);
	const double wide = GATE_SIGMAS * sqrt(sigma_px * sigma_px + scale * scale * metric);
	const double gate_px = fmax(BB_TRACK_GATE * sigma_px, fmin(wide, gate->most_px));
	const double merge_px = 2 * (BB_TRACK_GATE + MERGE_NOISE) * tr->config.blob_sigma_px;
	for (size_t m = 0; m < n; m++)
		seen[m] = image_of(lens, c, markers[m], pivot, dt_s, px[m]) && on_sensor(lens, px[m]);
	const size_t n_list = blobs_in_reach(view, body, (const double(*)[2])px, seen, n, gate_px, list);
	for (size_t m = 0; m < n; m++)
		if (seen[m])
			n_picks += nearest_blobs(view, list, n_list, px[m], gate_px, (uint8_t)m, picks + n_picks);
	const size_t n_chosen = assign(picks, n_picks, chosen, got);
	for (size_t i = 0; i < n_chosen; i++) {
		const struct bb_blob *blob = &view->blobs[chosen[i]->blob];
		if (may_be_merged((const double(*)[2])px, seen, got, n, chosen[i]->marker, merge_px)) {
			c->merged++;
			continue;
		}
		c->obs[c->n_obs++] = (struct bb_track_obs){ (uint16_t)camera, chosen[i]->blob,    chosen[i]->marker,
							    (float)(dt_s + bb_lens_row_s(lens, (double)blob->y_px)),
							    (double)blob->x_px, (double)blob->y_px, worse };
	}
}

size_t bb_track_associate(const struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
			  const struct bb_pose *pose, const struct bb_track_gate *gate, struct bb_track_candidate *c)
{
	const struct bb_track_body *b = &tr->bodies[body];
	const struct bb_vec3 pivot = bb_pose_apply(pose, b->centroid);
	struct bb_vec3 markers[BB_TRACK_MARKERS_MAX];

	c->n_obs = 0;
	c->merged = 0;
	for (size_t m = 0; m < b->body->n_markers; m++)
		markers[m] = bb_pose_apply(pose, b->body->marker[m]);
	for (size_t i = 0; i < tr->config.n_cameras; i++)
		if (set->views[i].here)
			associate_camera(tr, set, i, body, markers, pivot, gate, c);
	return c->n_obs;
}

/* Counts markers and cameras; enough when the pixels outnumber the unknowns and no mirror twin can hide. */
static bool enough(struct bb_track_candidate *c)
{
	unsigned seen = 0, in_camera = 0, most = 0;

	c->n_markers = c->n_cameras = c->n_seeing = 0;
	for (size_t i = 0; i < c->n_obs; i++) {
		seen |= 1u << c->obs[i].marker;
		in_camera = i && c->obs[i].camera == c->obs[i - 1].camera ? in_camera + 1 : 1;
		c->n_seeing = (uint16_t)(c->n_seeing + (in_camera == 1));
		c->n_cameras = (uint16_t)(c->n_cameras + (in_camera == 3));
		most = in_camera > most ? in_camera : most;
	}
	for (; seen; seen &= seen - 1)
		c->n_markers++;
	return c->n_markers >= 3 && (c->n_seeing >= 2 ? c->n_obs >= 5 : most >= 4);
}

static bool polish_once(const struct bb_tracker *tr, size_t body, struct bb_track_candidate *c, double huber_px,
			int steps)
{
	const struct bb_track_body *b = &tr->bodies[body];

	c->fit.lenses = tr->lenses;
	c->fit.markers = b->body->marker;
	c->fit.centroid = b->centroid;
	c->fit.obs = c->obs;
	c->fit.n_obs = c->n_obs;
	c->fit.sigma_px = tr->config.blob_sigma_px;
	c->fit.huber_px = huber_px;
	return bb_polish_run(&c->fit, steps);
}

static bool plausible(const struct bb_tracker *tr, size_t body, const struct bb_track_candidate *c)
{
	const struct bb_vec3 p = bb_pose_apply(&c->fit.pose, tr->bodies[body].centroid);
	const struct bb_vec3 low = tr->config.room_min, high = tr->config.room_max;
	const double(*cov)[6] = (const double(*)[6])c->fit.covariance;
	const double turn = cov[0][0] + cov[1][1] + cov[2][2], var = cov[3][3] + cov[4][4] + cov[5][5];
	const double margin = 0.5;

	if (!(p.x > low.x - margin && p.y > low.y - margin && p.z > low.z - margin && p.x < high.x + margin &&
	      p.y < high.y + margin && p.z < high.z + margin))
		return false;
	return var < 0.05 * 0.05 && turn < 0.2 * 0.2;
}

void bb_track_refine(const struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
		     const struct bb_pose *start, const struct bb_track_gate *gate, struct bb_track_candidate *c)
{
	static const struct bb_track_gate exact = { 0, 0, 0 };
	const double sigma_px = tr->config.blob_sigma_px;
	struct bb_track_gate g = *gate;

	c->ok = false;
	c->fit.pose = *start;
	/* Narrowing: what a wrong blob pulls in one round, the next round's gate throws out. */
	for (int round = 0; round < 2; round++) {
		bb_track_associate(tr, set, body, &c->fit.pose, &g, c);
		if (!enough(c) || !polish_once(tr, body, c, 3 * sigma_px, 6))
			return;
		if (g.most_px <= 4 * BB_TRACK_GATE * sigma_px)
			break;
		g = (struct bb_track_gate){ 0.25 * g.position_sigma_m, 0.25 * g.angle_sigma_rad, 0.25 * g.most_px };
	}
	bb_track_associate(tr, set, body, &c->fit.pose, &exact, c);
	if (!enough(c) || !polish_once(tr, body, c, 0, 8) || !plausible(tr, body, c))
		return;
	c->score = BB_TRACK_GATE * BB_TRACK_GATE * (double)c->n_obs - c->fit.chi2;
	c->ok = c->score > 0;
}

/* Blobs within the body's outline in one camera that belong to no other body. */
static size_t blobs_around(const struct bb_tracker *tr, const struct bb_track_view *view, size_t camera, size_t body,
			   struct bb_vec3 centre)
{
	const struct bb_lens *lens = &tr->lenses[camera];
	double px[2];
	size_t n = 0;

	if (!view->here || !bb_lens_project(lens, centre, px))
		return 0;
	const double reach = 2 + 1.1 * tr->bodies[body].radius_m * lens->fx_px / bb_lens_depth(lens, centre);
	for (size_t k = 0; k < view->n; k++) {
		const double dx = (double)view->blobs[k].x_px - px[0], dy = (double)view->blobs[k].y_px - px[1];
		n += (!view->owner[k] || view->owner[k] == body + 1) && dx * dx + dy * dy < reach * reach;
	}
	return n;
}

bool bb_track_doubtful(const struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
		       const struct bb_track_candidate *c, double share)
{
	const struct bb_vec3 centre = bb_pose_apply(&c->fit.pose, tr->bodies[body].centroid);
	size_t odd = 0, cameras = 0, next = 0;

	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		const size_t around = blobs_around(tr, &set->views[i], i, body, centre);
		size_t mine = 0;
		for (; next < c->n_obs && c->obs[next].camera == i; next++)
			mine++;
		odd += around > mine ? around - mine : 0;
		cameras += around > mine;
	}
	odd -= odd < c->merged ? odd : c->merged;
	return odd >= 2 && (double)odd > share * (double)c->n_obs && (cameras > 1 || tr->config.n_cameras == 1);
}
