/*
 * sync/track/solve.c: one closed set: every body warm from its prediction, then cold where that failed, then what the
 * result means for the filter, the solution ring and the cameras' counters.
 */
#include <math.h>
#include <string.h>

#include "sync/track/linalg.h"
#include "sync/track/track.h"

#define WARM_AGE_S 0.25
#define WARM_GATE_PX 20.0
#define PATIENCE 16 /* failed sets before cold starts become rarer */
#define RARER 4
#define DOUBTS 1
#define SWAP_SIGMAS 3.0 /* row K5 */
#define NOISE_PRIOR_DOF 200.0
#define NOISE_SETS 128.0
#define NOISE_LEAST 0.05 /* below, it is not the blobs that decide */
#define NOISE_MOST 16.0
#define NOISE_PRIOR 20.0 /* coordinates, believed of a camera to begin with */
#define NOISE_OBS 240.0  /* half a second of five markers at 120 Hz: so long a distance is about the same */
#define NOISE_OBS_LEAST 8
#define NOISE_WILD 50.0
#define CLEARLY 75.0 /* three more blobs explained */

struct bb_pose bb_track_pose_about(const struct bb_track_body *b, struct bb_vec3 centroid, struct bb_quat q)
{
	return (struct bb_pose){ bb_vec3_sub(centroid, bb_quat_rotate(q, b->centroid)), q };
}

bool bb_track_prior(const struct bb_track_body *b, int64_t at_ns, double max_age_s, struct bb_filter_state *state)
{
	const double dt = b->filter.live ? bb_seconds_between(at_ns, b->filter.at_ns) : -1;

	if (!b->filter.live || !(dt > 0) || dt > max_age_s)
		return false;
	*state = bb_filter_predict(&b->filter, dt);
	return true;
}

void bb_track_set_motion(const struct bb_track_body *b, const struct bb_track_set *set, struct bb_track_candidate *c)
{
	struct bb_filter_state s;
	const bool known = bb_track_prior(b, set->at_ns, WARM_AGE_S, &s);

	c->fit.velocity = known ? s.v : (struct bb_vec3){ 0, 0, 0 };
	c->fit.spin = known ? s.w : (struct bb_vec3){ 0, 0, 0 };
}

static void claim(struct bb_track_set *set, size_t body, const struct bb_track_candidate *c, bool mine)
{
	for (size_t i = 0; i < c->n_obs; i++)
		set->views[c->obs[i].camera].owner[c->obs[i].blob] = (uint8_t)(mine ? body + 1 : 0);
}

static void warm(struct bb_tracker *tr, struct bb_track_set *set, size_t body)
{
	struct bb_track_body *b = &tr->bodies[body];
	struct bb_filter_state s;

	b->found.ok = b->swapped = false;
	if (!bb_track_prior(b, set->at_ns, WARM_AGE_S, &s))
		return;
	const struct bb_track_gate gate = { s.position_sigma_m, s.angle_sigma_rad, WARM_GATE_PX };
	const struct bb_pose start = bb_track_pose_about(b, s.p, s.q);
	bb_track_set_motion(b, set, &b->found);
	bb_track_refine(tr, set, body, &start, &gate, &b->found);
	if (b->found.ok)
		claim(set, body, &b->found, true);
}

/* In the first doubtful set, and in some of those that follow, start over from nothing and take what explains clearly
 * more. */
static void reconsider(struct bb_tracker *tr, struct bb_track_set *set, size_t body)
{
	struct bb_track_body *b = &tr->bodies[body];

	/* In a flood blobs stand around every body: that says nothing. */
	if (!b->found.ok || tr->flooded || !bb_track_doubtful(tr, set, body, &b->found, 1.0 / 3)) {
		b->doubts = 0;
		return;
	}
	if (++b->doubts % PATIENCE != DOUBTS || tr->reconsidered)
		return;
	tr->reconsidered = true;
	claim(set, body, &b->found, false);
	tr->cold.matched = false; /* its blobs are to be matched as well */
	bb_track_swap(&b->found, &tr->aside);
	bb_track_acquire(tr, set, body, &b->found);
	b->swapped = b->found.ok && b->found.score >= tr->aside.score + CLEARLY;
	if (!b->swapped)
		bb_track_swap(&b->found, &tr->aside);
	claim(set, body, &b->found, true);
}

/* What the residuals say of the blobs' noise, as a factor of the configured variance: over the last second or so, and
 * of this set alone when it is clearly worse. The answer must claim to know neither better nor worse than it does. */
static double noise_factor(struct bb_track_body *b)
{
	const struct bb_track_candidate *c = &b->found;
	const double dof = 2.0 * (double)c->n_obs - 6, now = dof > 0 ? c->fit.chi2_own / dof : 0;

	if (!(b->noise_dof > 0)) { /* to begin with the configuration is believed */
		b->noise_dof = b->noise_chi2 = NOISE_PRIOR_DOF;
	}
	const double before = fmax(b->noise_chi2 / b->noise_dof, NOISE_LEAST);
	const double limit = dof > 0 ? before * (1 + 3 * sqrt(2 / dof)) : before;
	b->noise_chi2 += fmax(dof, 0) * fmin(now, limit) - b->noise_chi2 / NOISE_SETS;
	b->noise_dof += fmax(dof, 0) - b->noise_dof / NOISE_SETS;
	return now > limit ? now : before;
}

void bb_track_pack(const double from[6][6], int at, double scale, double out[6])
{
	for (int r = 0, i = 0; r < 3; r++)
		for (int c = r; c < 3; c++)
			out[i++] = scale * scale * from[at + r][at + c];
}

double bb_track_trace(const double packed[6])
{
	return packed[0] + packed[3] + packed[5];
}

static struct bb_track_solution solution_of(const struct bb_tracker *tr, const struct bb_track_set *set,
					    const struct bb_track_body *b, const double covariance[6][6])
{
	const struct bb_track_candidate *c = &b->found;
	const struct bb_polish *f = &c->fit;
	const double roll = f->roll_held ? BB_DEG_PER_RAD * f->roll_sigma_rad : 0;
	struct bb_track_solution s = {
		.at_ns = set->at_ns,
		.body = f->pose,
		.centroid = bb_pose_apply(&f->pose, b->centroid),
		.residual_px = tr->config.blob_sigma_px * sqrt(f->chi2 / (2 * (double)c->n_obs)),
		.n_markers = c->n_markers,
		.n_cameras = c->n_cameras,
		.n_blobs = (uint16_t)c->n_obs,
		.flags = BB_TRACK_FRESH | (f->roll_held ? BB_TRACK_COLLINEAR : 0u) |
			 (c->n_seeing == 1 ? BB_TRACK_ONE_CAMERA : 0u) | (b->swapped ? BB_TRACK_SWAP : 0u),
	};

	bb_track_pack(covariance, 0, BB_DEG_PER_RAD, s.covariance_deg2);
	bb_track_pack(covariance, 3, 1e3, s.covariance_mm2);
	s.position_sigma_mm = sqrt(bb_track_trace(s.covariance_mm2));
	s.angle_sigma_deg = sqrt(bb_track_trace(s.covariance_deg2) + roll * roll);
	return s;
}

bool bb_track_continues(const struct bb_track_body *b, const struct bb_track_set *set, const struct bb_pose *pose,
			double max_age_s)
{
	struct bb_filter_state s;

	if (!bb_track_prior(b, set->at_ns, max_age_s, &s))
		return false;
	const struct bb_vec3 off = bb_vec3_sub(bb_pose_apply(pose, b->centroid), s.p);
	return bb_vec3_norm(off) < 0.02 + 6 * s.position_sigma_m &&
	       bb_quat_angle(pose->q, s.q) < 0.1 + 6 * s.angle_sigma_rad;
}

static void commit(struct bb_tracker *tr, const struct bb_track_set *set, struct bb_track_body *b)
{
	const struct bb_polish *f = &b->found.fit;
	const struct bb_vec3 centroid = bb_pose_apply(&f->pose, b->centroid);
	const struct bb_vec3 hold = f->roll_held ? f->roll_axis : (struct bb_vec3){ 0, 0, 0 };
	const double more = noise_factor(b);
	struct bb_filter_state s;
	double covariance[6][6];

	for (int r = 0; r < 6; r++)
		for (int c = 0; c < 6; c++)
			covariance[r][c] = more * f->covariance[r][c];
	const double(*cov)[6] = (const double(*)[6])covariance;
	/* A cold start may find the body where the filter did not expect it: then the filter was wrong. */
	if (bb_track_continues(b, set, &f->pose, WARM_AGE_S)) {
		bb_filter_update(&b->filter, set->at_ns, centroid, f->pose.q, cov, hold);
	} else {
		b->swapped |= bb_track_prior(b, set->at_ns, WARM_AGE_S, &s); /* nobody moves like that */
		bb_filter_start(&b->filter, set->at_ns, centroid, f->pose.q, cov);
	}
	b->swapped |= b->found.fit.chi2 > SWAP_SIGMAS * SWAP_SIGMAS * fmax(2.0 * (double)b->found.n_obs - 6, 1);
	tr->counted.swaps += b->swapped;
	b->last = solution_of(tr, set, b, cov);
	b->ring[b->n_solutions++ % BB_TRACK_RING] = b->last;
}

double bb_track_noise(const struct bb_track_body *b, size_t camera)
{
	const struct bb_track_noise *n = &b->noise[camera];

	return n->left > 0 ? sqrt(n->square / n->left) : 1;
}

/* Near and far cameras do not find blobs equally well, nor those whose blobs are saturated. In units of the configured
 * variance. */
static void learn_noise(struct bb_track_noise *n, double square, double left)
{
	if (!(n->left > 0))
		*n = (struct bb_track_noise){ NOISE_PRIOR, NOISE_PRIOR };
	n->square += fmin(square, NOISE_WILD) - n->square / NOISE_OBS;
	n->left += fmax(left, 0) - n->left / NOISE_OBS;
	n->square = fmin(fmax(n->square, NOISE_LEAST * n->left), NOISE_MOST * n->left);
}

/* What one camera gave to a solved body. obs are sorted by camera; from is where this camera's begin. */
static size_t count_camera(struct bb_tracker *tr, const struct bb_track_set *set, struct bb_track_body *b,
			   size_t camera, size_t from)
{
	const struct bb_track_candidate *c = &b->found;
	const struct bb_lens *lens = &tr->lenses[camera];
	struct bb_track_camera_stats *stats = &tr->stats[camera];
	const double var = tr->config.blob_sigma_px * tr->config.blob_sigma_px;
	size_t expected = 0, used = 0;
	double px[2];

	for (size_t m = 0; set->views[camera].here && m < b->body->n_markers; m++)
		expected += bb_lens_project(lens, bb_pose_apply(&c->fit.pose, b->body->marker[m]), px) && px[0] > 0 &&
			    px[1] > 0 && px[0] < lens->width_px - 1 && px[1] < lens->height_px - 1;
	for (; from + used < c->n_obs && c->obs[from + used].camera == camera; used++) {
		const struct bb_track_obs *o = &c->obs[from + used];
		double square_px2, left;
		if (!bb_polish_residual(&c->fit, o, &square_px2, &left))
			continue;
		if (c->n_obs >= NOISE_OBS_LEAST)
			learn_noise(&b->noise[camera], square_px2 / var, left);
		tr->mean_square_px2[camera] += (square_px2 / 2 - tr->mean_square_px2[camera]) / 64;
	}
	stats->used += used;
	stats->missing += expected > used ? expected - used : 0;
	stats->residual_px = sqrt(tr->mean_square_px2[camera]);
	return from + used;
}

static void count(struct bb_tracker *tr, const struct bb_track_set *set)
{
	for (size_t i = 0; i < tr->config.n_cameras; i++)
		for (size_t k = 0; set->views[i].here && k < set->views[i].n; k++)
			tr->stats[i].stray += !set->views[i].owner[k];
	for (size_t body = 0; body < tr->config.n_bodies; body++) {
		size_t from = 0;
		for (size_t i = 0; tr->bodies[body].found.ok && i < tr->config.n_cameras; i++)
			from = count_camera(tr, set, &tr->bodies[body], i, from);
	}
}

static void cold(struct bb_tracker *tr, struct bb_track_set *set, size_t body)
{
	struct bb_track_body *b = &tr->bodies[body];

	/* A body that is not there must not cost a cold start a set for ever. */
	if (b->failures > PATIENCE && b->failures % RARER)
		return;
	bb_track_acquire(tr, set, body, &b->found);
	if (b->found.ok)
		claim(set, body, &b->found, true);
}

static void begin(struct bb_tracker *tr, struct bb_track_set *set)
{
	tr->flooded = false;
	for (size_t i = 0; i < tr->config.n_cameras; i++) {
		memset(set->views[i].owner, 0, BB_CAMERA_BLOBS_MAX);
		tr->flooded |= set->views[i].here && set->views[i].flooded;
	}
	tr->cold.matched = tr->reconsidered = false;
	tr->cold.refines = tr->cold.looks = 0;
	tr->counted.last = (struct bb_track_work){ 0 };
	tr->counted.sets++;
	tr->counted.floods += tr->flooded;
}

static void count_work(struct bb_tracker *tr)
{
	const struct bb_track_work *last = &tr->counted.last;
	struct bb_track_work *most = &tr->counted.most;

	/* What a set may cost must not always be spent on the same body. */
	tr->turn += last->pairs >= BB_TRACK_PAIRS_MAX || last->poses >= BB_TRACK_POSES_MAX ||
		    tr->cold.looks >= BB_TRACK_LOOKS_MAX || tr->cold.refines >= BB_TRACK_REFINES_MAX;
	most->pairs = last->pairs > most->pairs ? last->pairs : most->pairs;
	most->points = last->points > most->points ? last->points : most->points;
	most->poses = last->poses > most->poses ? last->poses : most->poses;
}

void bb_track_solve_set(struct bb_tracker *tr, struct bb_track_set *set)
{
	const size_t n = tr->config.n_bodies;

	begin(tr, set);
	for (size_t i = 0; i < n; i++)
		warm(tr, set, i);
	for (size_t k = 0; k < n; k++) {
		const size_t i = tr->order[(tr->turn + k) % n];
		if (!tr->bodies[i].found.ok)
			cold(tr, set, i);
	}
	for (size_t i = 0; i < n; i++) {
		struct bb_track_body *b = &tr->bodies[i];
		reconsider(tr, set, i);
		b->fresh = b->found.ok;
		b->failures = b->found.ok ? 0 : b->failures + 1;
		if (b->found.ok)
			commit(tr, set, b);
	}
	count(tr, set);
	count_work(tr);
}
