/*
 * sync/track/acquire.c: a body found from nothing: hypotheses from points or from one camera, polished, compared, and
 * refused when two of them explain the pixels about equally well.
 */
#include <math.h>

#include "sync/track/track.h"

#define COLD_GATE_PX 8.0
#define STRANGE 0.2    /* one marker in five that stands beside its place in every camera */
#define AMBIGUOUS 20.0 /* a rival must be worse by this much squared sigma */

/* Polishes the hypotheses; best and best different rival stay in tr->best and tr->rival. */
static void judge(struct bb_tracker *tr, const struct bb_track_set *set, size_t body)
{
	static const struct bb_track_gate gate = { 0.004, 0.05, COLD_GATE_PX };
	const struct bb_track_body *b = &tr->bodies[body];

	for (size_t i = 0; i < tr->cold.n_poses && tr->cold.refines < BB_TRACK_REFINES_MAX; i++) {
		struct bb_track_candidate *c = &tr->trial;
		tr->cold.refines++;
		bb_track_set_motion(b, set, c);
		bb_track_refine(tr, set, body, &tr->cold.pose[i], &gate, c);
		if (!c->ok)
			continue;
		const bool same = tr->best.ok && bb_track_same_pose(b, &c->fit.pose, &tr->best.fit.pose);
		if (!tr->best.ok || c->score > tr->best.score) {
			if (tr->best.ok && !same)
				bb_track_swap(&tr->best, &tr->rival);
			bb_track_swap(&tr->best, c);
		} else if (!same && (!tr->rival.ok || c->score > tr->rival.score)) {
			bb_track_swap(&tr->rival, c);
		}
	}
}

/* Two poses explain the pixels about equally: a recent pose, or the one seat of a desk, may tell; else refuse. */
static bool settle(struct bb_tracker *tr, const struct bb_track_set *set, size_t body)
{
	const struct bb_track_body *b = &tr->bodies[body];
	struct bb_filter_state s;
	struct bb_quat near;

	if (!tr->rival.ok || tr->best.score - tr->rival.score > AMBIGUOUS)
		return true;
	if (bb_track_prior(b, set->at_ns, BB_TRACK_PRIOR_S, &s))
		near = s.q;
	else if (body == 0 && tr->config.n_cameras == 1)
		near = tr->config.neutral.q;
	else
		return false;
	const double best = bb_quat_angle(tr->best.fit.pose.q, near), rival = bb_quat_angle(tr->rival.fit.pose.q, near);
	if (fabs(best - rival) < 0.5)
		return false;
	if (rival < best)
		bb_track_swap(&tr->best, &tr->rival);
	return true;
}

/* The two cameras with the most blobs that are not too many, for poses from one camera alone. */
static void by_perspective(struct bb_tracker *tr, const struct bb_track_set *set, size_t body)
{
	size_t done = BB_TRACK_CAMERAS_MAX;

	for (int round = 0; round < 2 && !tr->best.ok; round++) {
		size_t most = 2, camera = BB_TRACK_CAMERAS_MAX;
		for (size_t i = 0; i < tr->config.n_cameras; i++)
			if (i != done && tr->cold.n[i] > most && tr->cold.n[i] <= 10) {
				most = tr->cold.n[i];
				camera = i;
			}
		if (camera == BB_TRACK_CAMERAS_MAX)
			return;
		bb_track_perspective(tr, set, body, camera);
		judge(tr, set, body);
		done = camera;
	}
}

/* Free blobs to find a body from: without them a cold start need not begin. */
static bool enough_blobs(const struct bb_tracker *tr, const struct bb_track_set *set)
{
	size_t most = 0, all = 0;

	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		size_t n = 0;
		for (size_t k = 0; set->views[i].here && k < set->views[i].n; k++)
			n += !set->views[i].owner[k];
		most = n > most ? n : most;
		all += n;
	}
	return most >= 4 || (most >= 3 && all >= 5);
}

/* Too little to tell a body by when it is not where it was expected: four blobs of one camera leave two equations to
 * judge by, five of three markers four, and three markers of a larger body are three distances, which some three markers
 * of others may have. Nobody is elsewhere a moment later without better proof. */
static bool thin(const struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
		 const struct bb_track_candidate *c)
{
	const struct bb_track_body *b = &tr->bodies[body];
	const bool alone = tr->config.n_bodies == 1;
	struct bb_filter_state s;

	if (bb_track_continues(b, set, &c->fit.pose, BB_TRACK_PRIOR_S))
		return false;
	if (bb_track_prior(b, set->at_ns, BB_TRACK_PRIOR_S, &s) && c->n_obs < 8)
		return true;
	if (c->n_seeing == 1 && c->n_obs < 5 && (!alone || tr->cold.n[c->obs[0].camera] > c->n_obs))
		return true;
	return c->n_markers == 3 && (c->n_obs < 6 || (!alone && b->body->n_markers > 3));
}

void bb_track_acquire(struct bb_tracker *tr, const struct bb_track_set *set, size_t body,
		      struct bb_track_candidate *out)
{
	out->ok = tr->best.ok = tr->rival.ok = false;
	if (!enough_blobs(tr, set))
		return;
	tr->counted.cold_starts++;
	bb_track_match(tr, set);
	bb_track_label(tr, body);
	judge(tr, set, body);
	if (!tr->best.ok)
		by_perspective(tr, set, body);
	if (!tr->best.ok)
		return;
	/* Some markers fit and others stand where none should be: a mirror image or a stranger. */
	if (!settle(tr, set, body) || thin(tr, set, body, &tr->best) || (tr->best.n_markers < tr->bodies[body].body->n_markers &&
				       bb_track_doubtful(tr, set, body, &tr->best, STRANGE))) {
		tr->counted.refused++;
		return;
	}
	bb_track_swap(out, &tr->best);
}
