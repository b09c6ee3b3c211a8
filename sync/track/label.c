/*
 * sync/track/label.c: which points are which markers: triples of points whose distances are those of three markers give
 * a pose; the pose is ranked by how many markers then lie on points. One or two cameras' worth of scratch, no state.
 */
#include <math.h>

#include "sync/track/linalg.h"
#include "sync/track/rigid.h"
#include "sync/track/track.h"

#define TOLERANCE_SIGMAS 5.0
#define TOLERANCE_LEAST_M 2e-6
#define FITS_MAX 600    /* triples turned into poses per call, and as many as the set's budget has left */
#define LABEL_POINTS 40 /* strongest points looked at */

bool bb_track_same_pose(const struct bb_track_body *b, const struct bb_pose *x, const struct bb_pose *y)
{
	const struct bb_vec3 d = bb_vec3_sub(bb_pose_apply(x, b->centroid), bb_pose_apply(y, b->centroid));

	return bb_vec3_norm(d) < 0.02 && bb_quat_angle(x->q, y->q) < 0.12;
}

void bb_track_hypothesis(struct bb_track_cold *cold, const struct bb_track_body *b, const struct bb_pose *pose,
			 double rank)
{
	size_t at = cold->n_poses;

	for (size_t i = 0; i < cold->n_poses; i++)
		if (bb_track_same_pose(b, &cold->pose[i], pose)) {
			if (cold->rank[i] >= rank)
				return;
			at = i; /* the better of two like ones moves up from here */
			break;
		}
	if (at == BB_TRACK_HYPOTHESES) {
		if (cold->rank[at - 1] >= rank)
			return;
		at--;
	} else if (at == cold->n_poses) {
		cold->n_poses++;
	}
	for (; at > 0 && cold->rank[at - 1] < rank; at--) {
		cold->pose[at] = cold->pose[at - 1];
		cold->rank[at] = cold->rank[at - 1];
	}
	cold->pose[at] = *pose;
	cold->rank[at] = rank;
}

static bool distance_fits(const struct bb_track_point *p, const struct bb_track_point *q, struct bb_vec3 a,
			  struct bb_vec3 b)
{
	const double want = bb_vec3_norm(bb_vec3_sub(a, b)), have = bb_vec3_norm(bb_vec3_sub(p->p, q->p));
	const double s = sqrt(p->sigma_m * p->sigma_m + q->sigma_m * q->sigma_m);

	return fabs(want - have) < TOLERANCE_SIGMAS * s + TOLERANCE_LEAST_M;
}

/* Markers that lie on points under a pose; cameras count, so that a ghost of two rays does not weigh like a marker. */
static double rank_pose(const struct bb_track_cold *cold, const struct bb_body *body, const struct bb_pose *pose,
			size_t n_points)
{
	double rank = 0;

	for (size_t m = 0; m < body->n_markers; m++) {
		const struct bb_vec3 at = bb_pose_apply(pose, body->marker[m]);
		double best = 0;
		for (size_t i = 0; i < n_points; i++) {
			const struct bb_track_point *p = &cold->points[i];
			/* A pose from three points is off by about their own noise, more beyond them. */
			const double tolerance = 4 * TOLERANCE_SIGMAS * p->sigma_m + 1e-4;
			const double d = bb_vec3_norm(bb_vec3_sub(at, p->p)) / tolerance;
			best = d < 1 ? fmax(best, p->n_cameras - 0.5 * d) : best;
		}
		rank += best;
	}
	return rank;
}

/* One labelled triple. Returns 1 when a pose was computed. */
static size_t try_triple(struct bb_track_cold *cold, const struct bb_track_body *b, const size_t p[3],
			 const size_t m[3], size_t n_points, struct bb_quat hold)
{
	struct bb_vec3 body[3], room[3];
	struct bb_rigid fit;
	double sigma = 0;

	for (int i = 0; i < 3; i++) {
		body[i] = b->body->marker[m[i]];
		room[i] = cold->points[p[i]].p;
		sigma = fmax(sigma, cold->points[p[i]].sigma_m);
	}
	if (!bb_rigid_fit(body, room, 3, sigma, hold, &fit))
		return 0;
	bb_track_hypothesis(cold, b, &fit.pose, rank_pose(cold, b->body, &fit.pose, n_points));
	return 1;
}

/* The third marker of every triple that starts with points p[0], p[1] as markers m[0], m[1]. */
static size_t third(struct bb_track_cold *cold, const struct bb_track_body *b, size_t p[3], size_t m[3],
		    size_t n_points, struct bb_quat hold)
{
	const struct bb_vec3 *marker = b->body->marker;
	const struct bb_track_point *points = cold->points;
	size_t fits = 0;

	for (p[2] = p[1] + 1; p[2] < n_points; p[2]++)
		for (m[2] = 0; m[2] < b->body->n_markers; m[2]++) {
			if (m[2] == m[0] || m[2] == m[1] ||
			    !distance_fits(&points[p[0]], &points[p[2]], marker[m[0]], marker[m[2]]) ||
			    !distance_fits(&points[p[1]], &points[p[2]], marker[m[1]], marker[m[2]]))
				continue;
			fits += try_triple(cold, b, p, m, n_points, hold);
		}
	return fits;
}

void bb_track_label(struct bb_tracker *tr, size_t body)
{
	const struct bb_track_body *b = &tr->bodies[body];
	struct bb_track_cold *cold = &tr->cold;
	const size_t n = cold->n_points < LABEL_POINTS ? cold->n_points : LABEL_POINTS;
	const struct bb_quat hold = b->filter.live ? b->filter.q : tr->config.neutral.q;
	const uint32_t spent = tr->counted.last.poses;
	const size_t most = spent < BB_TRACK_POSES_MAX - FITS_MAX ? FITS_MAX
			    : spent < BB_TRACK_POSES_MAX	  ? BB_TRACK_POSES_MAX - spent
								  : 0;
	size_t fits = 0, p[3], m[3];

	cold->n_poses = 0;
	for (p[0] = 0; p[0] + 2 < n; p[0]++)
		for (p[1] = p[0] + 1; p[1] + 1 < n; p[1]++)
			for (m[0] = 0; m[0] < b->body->n_markers; m[0]++)
				for (m[1] = 0; m[1] < b->body->n_markers && fits < most; m[1]++)
					if (m[0] != m[1] && distance_fits(&cold->points[p[0]], &cold->points[p[1]],
									  b->body->marker[m[0]], b->body->marker[m[1]]))
						fits += third(cold, b, p, m, n, hold);
	tr->counted.last.poses += (uint32_t)fits;
}
