#include "bench/solver/walk.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LABELS_MAX (256 * 6)
#define LAGS_MAX 4000
#define DARK_EVERY_S 10.0
#define WRONG_MM 5.0
#define WRONG_DEG 5.0
#define SAME_SIGMAS 6.0 /* a blob so near to its marker's true image is that marker's, whoever else is near */

struct work {
	const struct bb_walk_config *config;
	struct bb_walk *out;
	bool *in_position, *in_angle;
	size_t searching; /* frames since the viewer came into sight again; 0: found */
	bool lost;
	double mm2, deg2, sigma_mm2, sigma_deg2, residual2;
};

double bb_walk_distance2(const double c[6], struct bb_vec3 d)
{
	const double a = c[3] * c[5] - c[4] * c[4], b = c[2] * c[4] - c[1] * c[5], e = c[1] * c[4] - c[2] * c[3];
	const double det = c[0] * a + c[1] * b + c[2] * e;
	const double yy = c[0] * c[5] - c[2] * c[2], yz = c[1] * c[2] - c[0] * c[4], zz = c[0] * c[3] - c[1] * c[1];

	return (a * d.x * d.x + yy * d.y * d.y + zz * d.z * d.z + 2 * (b * d.x * d.y + e * d.x * d.z + yz * d.y * d.z)) /
	       det;
}

struct bb_vec3 bb_walk_turn_deg(struct bb_quat a, struct bb_quat b)
{
	struct bb_quat q = bb_quat_mul(b, bb_quat_conj(a));
	const double sign = q.w < 0 ? -1 : 1;
	const struct bb_vec3 v = { sign * q.x, sign * q.y, sign * q.z };
	const double n = bb_vec3_norm(v);

	return bb_vec3_scale(v, (n > 1e-15 ? 2 * atan2(n, sign * q.w) / n : 2) * 57.29577951308232);
}

/* A label is wrong when the blob stands at another marker's true image and not at its own's. */
static void judge_labels(struct work *w, const struct bb_studio *s, int64_t at_ns)
{
	struct bb_track_label labels[LABELS_MAX];
	const size_t n = bb_tracker_labels(s->tracker, 0, labels, LABELS_MAX);

	for (size_t i = 0; i < n && i < LABELS_MAX; i++) {
		double nearest = HUGE_VAL, own = HUGE_VAL, px[2];
		bool visible;
		for (size_t m = 0; m < s->room->bodies[0].n_markers; m++) {
			if (!bb_studio_marker_px(s, labels[i].camera, m, at_ns, px, &visible))
				continue;
			const double d = hypot(px[0] - labels[i].x_px, px[1] - labels[i].y_px);
			if (m == labels[i].marker)
				own = d; /* where it would be, though the head's rim may just hide it */
			else if (visible)
				nearest = fmin(nearest, d);
		}
		w->out->n_wrong_labels += own > SAME_SIGMAS * s->blob_sigma_px && own > nearest;
	}
	w->out->n_labels += n;
}

static void judge_pose(struct work *w, const struct bb_studio *s, const struct bb_track_solution *sol, size_t seeing)
{
	struct bb_walk *o = w->out;
	const struct bb_vec3 off = bb_vec3_scale(bb_vec3_sub(sol->centroid, bb_studio_centroid(s, sol->at_ns)), 1e3);
	const struct bb_vec3 turn = bb_walk_turn_deg(sim_world_body(s->world, 0, sol->at_ns).q, sol->body.q);
	const double mm = bb_vec3_norm(off), deg = bb_vec3_norm(turn);

	o->n_wrong_poses += mm > WRONG_MM || deg > WRONG_DEG;
	if (seeing < 4)
		return;
	w->in_position[o->n_good] = bb_walk_distance2(sol->covariance_mm2, off) < BB_CHI2_3_95;
	w->in_angle[o->n_good] = bb_walk_distance2(sol->covariance_deg2, turn) < BB_CHI2_3_95;
	o->n_good++;
	o->worst_mm = fmax(o->worst_mm, mm);
	o->worst_deg = fmax(o->worst_deg, deg);
	w->mm2 += mm * mm;
	w->deg2 += deg * deg;
	w->sigma_mm2 += sol->position_sigma_mm * sol->position_sigma_mm;
	w->sigma_deg2 += sol->angle_sigma_deg * sol->angle_sigma_deg;
	w->residual2 += sol->residual_px * sol->residual_px;
}

static void judge_search(struct work *w, bool possible, bool solved)
{
	if (!possible) {
		w->lost |= !solved;
		w->searching = 0;
		return;
	}
	if (!solved || w->lost) {
		w->out->n_losses += w->searching == 0;
		w->searching++;
		w->lost = true;
	}
	if (!solved)
		return;
	if (w->searching > w->out->most_frames_back)
		w->out->most_frames_back = w->searching;
	w->searching = 0;
	w->lost = false;
}

static bool is_dark(const struct work *w, const struct bb_studio *s, size_t frame)
{
	const double t_s = 1e-9 * (double)(s->period_ns * (int64_t)frame);

	return w->config->dark_s > 0 && t_s > DARK_EVERY_S && fmod(t_s, DARK_EVERY_S) < w->config->dark_s;
}

static void walk_once(struct work *w, struct bb_studio *s)
{
	struct bb_track_solution sol;
	bool solved, dark = false;

	for (size_t i = 0; w->out->n_frames < w->config->n_frames; i++) {
		const bool was = dark;
		dark = is_dark(w, s, i);
		if (was != dark)
			bb_studio_cover(s, dark);
		if (!bb_studio_step(s, &sol, &solved))
			return;
		const int64_t at_ns = solved ? sol.at_ns : s->mid_ns;
		const size_t seeing = dark ? 0 : bb_studio_seeing(s, at_ns);
		w->out->n_frames++;
		w->out->n_possible += seeing >= 2;
		w->out->n_solved += solved;
		judge_search(w, seeing >= 2, solved);
		if (!solved)
			continue;
		judge_labels(w, s, at_ns);
		judge_pose(w, s, &sol, seeing);
	}
}

struct bb_walk_share bb_walk_share_of(const bool *inside, size_t n)
{
	struct bb_walk_share out = { 0 };
	double sum = 0, tau = 1;

	for (size_t i = 0; i < n; i++)
		sum += inside[i];
	out.share = n ? sum / (double)n : 0;
	const double variance = out.share * (1 - out.share);
	for (size_t lag = 1; variance > 0 && lag + 1 < n && lag < LAGS_MAX; lag += 2) {
		double pair = 0;
		for (size_t l = lag; l < lag + 2; l++) {
			double both = 0;
			for (size_t i = 0; i + l < n; i++)
				both += ((double)inside[i] - out.share) * ((double)inside[i + l] - out.share);
			pair += both / (double)n / variance;
		}
		if (pair <= 0)
			break;
		tau += 2 * pair;
	}
	out.n_eff = (double)n / tau;
	const double half = n ? 1.96 * sqrt(variance / out.n_eff) : 1;
	out.low = out.share - half;
	out.high = out.share + half;
	return out;
}

static void conclude(struct work *w, double sigma_px)
{
	struct bb_walk *o = w->out;
	const double n = o->n_good ? (double)o->n_good : 1;

	o->rms_mm = sqrt(w->mm2 / n);
	o->rms_deg = sqrt(w->deg2 / n);
	o->sigma_mm = sqrt(w->sigma_mm2 / n);
	o->sigma_deg = sqrt(w->sigma_deg2 / n);
	o->residual_px = sqrt(w->residual2 / n);
	o->sigma_px = sigma_px;
	o->position = bb_walk_share_of(w->in_position, o->n_good);
	o->angle = bb_walk_share_of(w->in_angle, o->n_good);
}

enum bb_status bb_walk_measure(const struct bb_walk_config *config, struct bb_walk *out, struct bb_error *err)
{
	struct work w = { .config = config, .out = out };
	enum bb_status status = BB_OK;
	double sigma_px = 0;

	*out = (struct bb_walk){ 0 };
	w.in_position = calloc(config->n_frames + 1, sizeof(*w.in_position));
	w.in_angle = calloc(config->n_frames + 1, sizeof(*w.in_angle));
	if (!w.in_position || !w.in_angle)
		status = bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu frames", config->n_frames);
	for (uint64_t lap = 0; !status && out->n_frames < config->n_frames; lap++) {
		const struct bb_studio_config c = { config->room, config->path, config->fidelity, config->seed + lap };
		struct bb_studio studio;
		const size_t before = out->n_frames;
		status = bb_studio_open(&c, &studio, err);
		if (status)
			break;
		w.lost = false;
		w.searching = 0;
		walk_once(&w, &studio);
		sigma_px = studio.blob_sigma_px;
		bb_studio_close(&studio);
		if (out->n_frames == before)
			status = bb_fail(err, BB_ERR_CONFIG, 1720, NULL, "%s: it is over before the first exposure",
					 config->path);
	}
	conclude(&w, sigma_px);
	free(w.in_position);
	free(w.in_angle);
	return status;
}

static void print_share(const char *what, const struct bb_walk_share *s, FILE *f)
{
	fprintf(f, "  %-9s %.2f %% within the 95 %% ellipsoid (%.2f to %.2f, %.0f independent frames)\n", what,
		100 * s->share, 100 * s->low, 100 * s->high, s->n_eff);
}

void bb_walk_print(const struct bb_walk *w, FILE *f)
{
	fprintf(f, "%zu frames, %zu with two cameras that see three markers, %zu solved, %zu by four cameras or more\n",
		w->n_frames, w->n_possible, w->n_solved, w->n_good);
	fprintf(f, "  position  %.3f mm rms (stated %.3f), worst %.2f\n", w->rms_mm, w->sigma_mm, w->worst_mm);
	fprintf(f, "  angle     %.3f deg rms (stated %.3f), worst %.2f\n", w->rms_deg, w->sigma_deg, w->worst_deg);
	print_share("position", &w->position, f);
	print_share("angle", &w->angle, f);
	fprintf(f, "  residuals %.3f px rms per axis; blobs are said to be good to %.3f\n", w->residual_px, w->sigma_px);
	fprintf(f, "  labels    %zu, wrong %zu; poses off by more than %.0f mm or deg: %zu\n", w->n_labels,
		w->n_wrong_labels, WRONG_MM, w->n_wrong_poses);
	fprintf(f, "  losses    %zu, found again after at most %zu frames\n", w->n_losses, w->most_frames_back);
}

static json_t *share_json(const struct bb_walk_share *s)
{
	return json_pack("{s:f, s:f, s:f, s:f}", "share", s->share, "low", s->low, "high", s->high, "n_eff", s->n_eff);
}

json_t *bb_walk_json(const struct bb_walk *w)
{
	return json_pack("{s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:o, s:o}",
			 "frames", (json_int_t)w->n_frames, "possible", (json_int_t)w->n_possible, "solved",
			 (json_int_t)w->n_solved, "four_cameras", (json_int_t)w->n_good, "labels",
			 (json_int_t)w->n_labels, "wrong_labels", (json_int_t)w->n_wrong_labels, "wrong_poses",
			 (json_int_t)w->n_wrong_poses, "losses", (json_int_t)w->n_losses, "most_frames_back",
			 (json_int_t)w->most_frames_back, "rms_mm", w->rms_mm, "worst_mm", w->worst_mm, "stated_mm",
			 w->sigma_mm, "rms_deg", w->rms_deg, "worst_deg", w->worst_deg, "stated_deg", w->sigma_deg,
			 "residual_px", w->residual_px, "blob_sigma_px", w->sigma_px, "position",
			 share_json(&w->position), "angle", share_json(&w->angle));
}
