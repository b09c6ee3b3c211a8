/*
 * sync/track/perspective.c: poses of a body from the blobs of one camera: every labelling of three blobs, ranked by the
 * other blobs of that camera and of a few others. Bounded work, no state.
 */
#include <math.h>

#include "sync/track/p3p.h"
#include "sync/track/rigid.h"
#include "sync/track/track.h"

#define SOLVES_MAX 2000
#define TRIPLES_LEAST 4
#define BLOBS_MAX 10 /* more blobs than this are a flood, not a body */
#define OWN_PX 0.5
#define OTHERS_PX 3.0
#define OTHERS 4         /* other cameras asked */
#define NEAR_SIGMAS 20.0 /* a pose from three pixels carries their noise to the others, magnified */

struct scene { /* what stays the same over all labellings */
	const struct bb_tracker *tr;
	const struct bb_track_set *set;
	const struct bb_track_body *b;
	const struct bb_lens *lens;
	size_t camera, n;
	size_t solves, poses, triples;
	double best;
};

static struct bb_vec3 bearing(const struct scene *s, size_t k)
{
	return s->tr->cold.ray[s->camera][k].d;
}

/* Free blobs of a camera that some marker explains, each once; nearer counts a little more. */
static double explained(const struct scene *s, size_t camera, const struct bb_pose *pose, double gate_px)
{
	const struct bb_track_view *view = &s->set->views[camera];
	const size_t n = s->tr->cold.n[camera];
	uint64_t used = 0;
	double rank = 0;

	for (size_t m = 0; m < s->b->body->n_markers; m++) {
		double px[2], nearest = gate_px * gate_px;
		int best = -1;
		if (!bb_lens_project(&s->tr->lenses[camera], bb_pose_apply(pose, s->b->body->marker[m]), px))
			continue;
		for (size_t k = 0; k < n; k++) {
			const struct bb_blob *blob = &view->blobs[s->tr->cold.index[camera][k]];
			const double dx = (double)blob->x_px - px[0], dy = (double)blob->y_px - px[1];
			if (!(used >> k & 1) && dx * dx + dy * dy < nearest) {
				nearest = dx * dx + dy * dy;
				best = (int)k;
			}
		}
		if (best < 0)
			continue;
		used |= (uint64_t)1 << best;
		rank += 1 - 0.1 * nearest / (gate_px * gate_px);
	}
	return rank;
}

/* What a few other cameras say. They see the depth, which one camera knows worst: a wider gate. */
static double seconded(const struct scene *s, const struct bb_pose *pose)
{
	const double gate_px = NEAR_SIGMAS * s->tr->config.blob_sigma_px + OTHERS_PX;
	double rank = 0;
	size_t asked = 0;

	for (size_t i = 0; i < s->tr->config.n_cameras && asked < OTHERS; i++) {
		if (i == s->camera || !s->tr->cold.n[i] || s->tr->cold.n[i] > BLOBS_MAX)
			continue;
		rank += explained(s, i, pose, gate_px);
		asked++;
	}
	return rank;
}

static void try_labels(struct scene *s, struct bb_track_cold *cold, const size_t k[3], const size_t m[3])
{
	const struct bb_vec3 y[3] = { bearing(s, k[0]), bearing(s, k[1]), bearing(s, k[2]) };
	const struct bb_vec3 x[3] = { s->b->body->marker[m[0]], s->b->body->marker[m[1]], s->b->body->marker[m[2]] };
	double depth[4][3];
	const size_t n = bb_p3p_depths(y, x, depth);

	s->solves++;
	for (size_t i = 0; i < n; i++) {
		struct bb_vec3 room[3];
		struct bb_rigid fit;
		for (int j = 0; j < 3; j++)
			room[j] = bb_vec3_add(s->lens->o, bb_vec3_scale(y[j], depth[i][j]));
		if (!bb_track_in_room(&s->tr->config, room[0]))
			continue;
		s->poses++;
		if (!bb_rigid_fit(x, room, 3, 1e-6, BB_QUAT_IDENTITY, &fit))
			continue;
		const double own =
			explained(s, s->camera, &fit.pose, NEAR_SIGMAS * s->tr->config.blob_sigma_px + OWN_PX);
		if (own < 2.5)
			continue;
		const double rank = own + seconded(s, &fit.pose);
		s->best = fmax(s->best, own);
		if (rank > 3.5)
			bb_track_hypothesis(cold, s->b, &fit.pose, rank);
	}
}

static void all_labels(struct scene *s, struct bb_track_cold *cold, const size_t k[3])
{
	const size_t n = s->b->body->n_markers;
	size_t m[3];

	for (m[0] = 0; m[0] < n; m[0]++)
		for (m[1] = 0; m[1] < n; m[1]++)
			for (m[2] = 0; m[2] < n; m[2]++)
				if (m[0] != m[1] && m[0] != m[2] && m[1] != m[2])
					try_labels(s, cold, k, m);
}

void bb_track_perspective(struct bb_tracker *tr, const struct bb_track_set *set, size_t body, size_t camera)
{
	struct scene s = { .tr = tr,
			   .set = set,
			   .b = &tr->bodies[body],
			   .lens = &tr->lenses[camera],
			   .camera = camera,
			   .n = tr->cold.n[camera] };
	size_t k[3];

	tr->cold.n_poses = 0;
	if (s.n < 3 || s.n > BLOBS_MAX)
		return;
	const double all = (double)(s.n < s.b->body->n_markers ? s.n : s.b->body->n_markers);
	for (k[0] = 0; k[0] + 2 < s.n; k[0]++)
		for (k[1] = k[0] + 1; k[1] + 1 < s.n; k[1]++)
			for (k[2] = k[1] + 1; k[2] < s.n; k[2]++) {
				/* A triple under all labels shows every twin as well, unless noise makes it miss one;
				 * more than a few triples only help against strays. */
				if ((s.best > all - 0.5 && s.triples >= TRIPLES_LEAST) || s.solves > SOLVES_MAX ||
				    tr->counted.last.poses > BB_TRACK_POSES_MAX)
					return;
				const size_t before = s.poses;
				all_labels(&s, &tr->cold, k);
				tr->counted.last.poses += (uint32_t)(s.poses - before);
				s.triples++;
			}
}
