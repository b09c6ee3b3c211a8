#include "bench/solver/cost.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bench/stats.h"
#include "hal/clock.h"
#include "bench/file.h"
#include "sim/sim_camera.h"
#include "sim/world.h"

#define NOISE_PX 0.05
#define CAMERAS_MAX 72
#define CLUTTER_MAX 100000
#define WARM_UP 40
#define APART_M 0.001
#define WRONG_M 0.005
#define TWO_PI 6.283185307179586

struct hall { /* the cameras, bodies and frames of one measurement */
	const struct bb_cost_config *config;
	struct bb_camera_config *cameras;
	struct bb_body bodies[BB_BODIES_MAX];
	struct bb_vec3 low, high; /* box around the room */
	struct sim_rng rng;
	struct bb_blob *blobs; /* of all cameras, config->n_clutter + markers each */
	size_t *n, cap;
	int64_t period_ns;
	bool first_solved; /* the first body, which the timed call asks for */
	struct bb_track_solution first;
};

static bool apart(const double *distances, size_t n, double d)
{
	for (size_t i = 0; i < n; i++)
		if (fabs(distances[i] - d) < APART_M)
			return false;
	return d > 0.03 && d < 0.2;
}

void bb_cost_bodies(struct bb_body *bodies, size_t n)
{
	static const size_t n_markers[4] = { 5, 4, 6, 3 };
	double distances[BB_BODIES_MAX * 15];
	struct sim_rng rng;
	size_t n_distances = 0;

	sim_rng_seed(&rng, 11, "cost", "bodies");
	for (size_t b = 0; b < n; b++) {
		struct bb_body *body = &bodies[b];
		*body = (struct bb_body){ .n_markers = n_markers[b % 4], .eye_centre = { 0.07, 0, 0.02 } };
		bb_text_format(body->id, sizeof(body->id), "body%zu", b);
		for (size_t m = 1; m < body->n_markers;) {
			const struct bb_vec3 at = { 0.16 * sim_rng_uniform(&rng), 0.06 * sim_rng_uniform(&rng),
						    0.1 * sim_rng_uniform(&rng) };
			size_t fit = 0;
			for (; fit < m; fit++) {
				const double d = bb_vec3_norm(bb_vec3_sub(at, body->marker[fit]));
				if (!apart(distances, n_distances + fit, d))
					break;
				distances[n_distances + fit] = d;
			}
			if (fit < m)
				continue;
			body->marker[m++] = at;
			n_distances += fit;
		}
	}
}

/* Evenly along the rectangle of the room's own cameras, looking at a point two thirds of the way to the middle. */
static void hang(struct hall *h, const struct bb_room *room)
{
	struct bb_vec3 low = room->cameras[0].pose.p, high = low;
	const size_t n = h->config->n_cameras;

	for (size_t i = 1; i < room->n_cameras; i++) {
		const struct bb_vec3 p = room->cameras[i].pose.p;
		low = (struct bb_vec3){ fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z) };
		high = (struct bb_vec3){ fmax(high.x, p.x), fmax(high.y, p.y), fmax(high.z, p.z) };
	}
	const double width = high.x - low.x, depth = high.z - low.z;
	for (size_t i = 0; i < n; i++) {
		double s = 2 * (width + depth) * ((double)i + 0.5) / (double)n;
		struct bb_vec3 at = low;
		if (s < width)
			at.x += s;
		else if ((s -= width) < depth)
			at = (struct bb_vec3){ high.x, low.y, low.z + s };
		else if ((s -= depth) < width)
			at = (struct bb_vec3){ high.x - s, low.y, high.z };
		else
			at.z = high.z - (s - width);
		const struct bb_vec3 target = { at.x / 3, 1.2, at.z / 3 };
		const struct bb_pose look = bb_pose_look_at(at, target, (struct bb_vec3){ 0, 1, 0 });
		h->cameras[i] = room->cameras[0];
		bb_text_format(h->cameras[i].id, sizeof(h->cameras[i].id), "c%zu", i + 1);
		/* look_at has -Z ahead and +Y up, a camera +Z ahead and +Y down: half a turn about x */
		h->cameras[i].pose = (struct bb_pose){ at, bb_quat_mul(look.q, (struct bb_quat){ 1, 0, 0, 0 }) };
	}
}

static struct bb_pose pose_at(const struct hall *h, size_t body, double t)
{
	const double k = (double)body, w = TWO_PI;
	const double x = 0.5 * (h->low.x + h->high.x) + 0.3 * (h->high.x - h->low.x) * sin(w * (0.05 * t + 0.61803 * k));
	const double z = 0.5 * (h->low.z + h->high.z) + 0.3 * (h->high.z - h->low.z) * sin(w * (0.07 * t + 0.41421 * k));

	return (struct bb_pose){ { x, 1.3 + 0.3 * sin(w * (0.11 * t + 0.3 * k)), z },
				 bb_quat_euler_deg(360 * (0.03 * t + 0.23 * k), 15 * sin(w * 0.3 * t + k),
						   8 * sin(w * 0.4 * t)) };
}

static size_t see(struct hall *h, size_t camera, double t, size_t clutter, struct bb_blob *out)
{
	const struct bb_camera_config *c = &h->cameras[camera];
	size_t n = 0;

	for (size_t b = 0; b < h->config->n_bodies; b++) {
		const struct bb_pose pose = pose_at(h, b, t);
		for (size_t m = 0; m < h->bodies[b].n_markers; m++) {
			const struct bb_vec3 at = bb_pose_apply(&pose, h->bodies[b].marker[m]);
			if (!sim_camera_project(c, bb_pose_inverse_apply(&c->pose, at), &out[n]))
				continue;
			out[n].x_px += (float)(NOISE_PX * sim_rng_normal(&h->rng));
			out[n].y_px += (float)(NOISE_PX * sim_rng_normal(&h->rng));
			n++;
		}
	}
	for (size_t i = 0; i < clutter; i++)
		out[n++] = (struct bb_blob){ (float)(sim_rng_uniform(&h->rng) * (double)c->width_px),
					     (float)(sim_rng_uniform(&h->rng) * (double)c->height_px),
					     (float)(2 + 20 * sim_rng_uniform(&h->rng)) };
	for (size_t i = n; i > 1; i--) { /* no order that could help */
		const size_t k = (size_t)(sim_rng_uniform(&h->rng) * (double)i);
		const struct bb_blob keep = out[i - 1];
		out[i - 1] = out[k];
		out[k] = keep;
	}
	return n;
}

static size_t expose(struct hall *h, double t, size_t clutter)
{
	size_t all = 0;

	for (size_t i = 0; i < h->config->n_cameras; i++)
		all += h->n[i] = see(h, i, t, clutter, h->blobs + i * h->cap);
	return all;
}

/* Takes the exposed frames in and solves them; returns us. */
static double solve(struct hall *h, struct bb_tracker *tr, int64_t at_ns)
{
	const int64_t from_ns = bb_clock_cpu_ns();

	for (size_t i = 0; i < h->config->n_cameras; i++)
		bb_tracker_frame(tr, i, at_ns, h->blobs + i * h->cap, h->n[i]);
	h->first_solved = bb_tracker_solve(tr, true, 0, &h->first, 1) > 0;
	return 1e-3 * (double)(bb_clock_cpu_ns() - from_ns);
}

static enum bb_status make_tracker(const struct hall *h, struct bb_tracker **out, struct bb_error *err)
{
	const struct bb_tracker_config c = { .cameras = h->cameras,
					     .n_cameras = h->config->n_cameras,
					     .bodies = h->bodies,
					     .n_bodies = h->config->n_bodies,
					     .blob_sigma_px = NOISE_PX,
					     .group_ns = 500000,
					     .freeze_ns = 100000000,
					     .room_min = h->low,
					     .room_max = h->high,
					     .neutral = { { 0, 1.6, 0 }, BB_QUAT_IDENTITY } };
	const enum bb_status status = bb_tracker_create(&c, out);

	return status ? bb_fail(err, status, 1702, NULL, "a tracker of %zu cameras", c.n_cameras) : BB_OK;
}

/* Bodies solved in the newest set; counts poses that are wrong. */
static size_t judge(const struct hall *h, struct bb_tracker *tr, double t, uint64_t *wrong)
{
	size_t solved = 0;

	for (size_t b = 0; b < h->config->n_bodies; b++) {
		struct bb_track_solution s = h->first;
		const struct bb_pose truth = pose_at(h, b, t);
		if (b ? !bb_tracker_solve(tr, false, b, &s, 1) : !h->first_solved)
			continue;
		solved++;
		const struct bb_vec3 centroid = bb_pose_apply(&truth, bb_pose_inverse_apply(&s.body, s.centroid));
		*wrong += bb_vec3_norm(bb_vec3_sub(s.centroid, centroid)) > WRONG_M + 6e-3 * s.position_sigma_mm;
	}
	return solved;
}

static enum bb_status warm(struct hall *h, struct bb_cost *out, struct bb_error *err)
{
	const size_t n = h->config->n_sets;
	double *us = calloc(n + 1, sizeof(*us));
	struct bb_tracker *tr = NULL;
	size_t solved = 0, blobs = 0;
	enum bb_status status = us ? make_tracker(h, &tr, err) : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu sets", n);

	for (size_t i = 0; !status && i < n + WARM_UP; i++) {
		const double t = 1e-9 * (double)(h->period_ns * (int64_t)i);
		const size_t seen = expose(h, t, i < WARM_UP ? 0 : h->config->n_clutter);
		const double took_us = solve(h, tr, h->period_ns * (int64_t)i);
		const size_t now = judge(h, tr, t, &out->wrong);
		if (i < WARM_UP)
			continue;
		us[i - WARM_UP] = took_us;
		solved += now;
		blobs += seen;
		out->most_us = fmax(out->most_us, took_us);
	}
	if (!status) {
		bb_stats_sort(us, n);
		out->median_us = bb_stats_nearest_rank(us, n, 0.5);
		out->p99_us = bb_stats_nearest_rank(us, n, 0.99);
		out->solved = (double)solved / (double)(n * h->config->n_bodies);
		out->blobs = (double)blobs / (double)(n * h->config->n_cameras);
		out->floods = bb_tracker_stats(tr).floods;
		out->work = bb_tracker_stats(tr).most;
	}
	bb_tracker_destroy(tr);
	free(us);
	return status;
}

static void most_work(struct bb_track_work *most, const struct bb_track_work *w)
{
	most->pairs = w->pairs > most->pairs ? w->pairs : most->pairs;
	most->points = w->points > most->points ? w->points : most->points;
	most->poses = w->poses > most->poses ? w->poses : most->poses;
}

static enum bb_status cold(struct hall *h, struct bb_cost *out, struct bb_error *err)
{
	const size_t n = h->config->n_cold;
	double *us = calloc(n + 1, sizeof(*us));
	size_t solved = 0;
	enum bb_status status = us ? BB_OK : bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu starts", n);

	for (size_t i = 0; !status && i < n; i++) {
		struct bb_tracker *tr;
		const double t = 1.7 * (double)i;
		status = make_tracker(h, &tr, err);
		if (status)
			break;
		expose(h, t, h->config->n_clutter);
		us[i] = solve(h, tr, 0);
		solved += judge(h, tr, t, &out->wrong);
		const struct bb_track_stats stats = bb_tracker_stats(tr);
		most_work(&out->cold_work, &stats.most);
		bb_tracker_destroy(tr);
	}
	bb_stats_sort(us, us ? n : 0);
	out->cold_median_us = bb_stats_nearest_rank(us, us ? n : 0, 0.5);
	out->cold_most_us = us && n ? us[n - 1] : BB_UNKNOWN;
	out->cold_solved = n ? (double)solved / (double)(n * h->config->n_bodies) : BB_UNKNOWN;
	free(us);
	return status;
}

static enum bb_status check(const struct bb_cost_config *c, const struct bb_room *room, struct bb_error *err)
{
	if (!room->n_cameras)
		return bb_fail(err, BB_ERR_CONFIG, 1720, NULL, "%s: it has no cameras", room->path);
	if (c->n_cameras < 1 || c->n_cameras > CAMERAS_MAX || c->n_bodies < 1 || c->n_bodies > BB_BODIES_MAX ||
	    c->n_clutter > CLUTTER_MAX)
		return bb_fail(err, BB_ERR_USAGE, 1721, NULL, "%zu cameras, %zu bodies, %zu blobs", c->n_cameras,
			       c->n_bodies, c->n_clutter);
	return BB_OK;
}

static enum bb_status furnish(struct hall *h, const struct bb_room *room, struct bb_error *err)
{
	const size_t n = h->config->n_cameras;

	h->cap = h->config->n_clutter + BB_BODIES_MAX * 6;
	h->cameras = calloc(n, sizeof(*h->cameras));
	h->blobs = calloc(n * h->cap, sizeof(*h->blobs));
	h->n = calloc(n, sizeof(*h->n));
	if (!h->cameras || !h->blobs || !h->n)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "frames of %zu cameras", n);
	h->low = room->min;
	h->high = room->max;
	h->period_ns = bb_rate_period_ns(room->cameras[0].rate);
	bb_cost_bodies(h->bodies, h->config->n_bodies);
	if (n == room->n_cameras)
		memcpy(h->cameras, room->cameras, n * sizeof(*h->cameras));
	else
		hang(h, room);
	sim_rng_seed(&h->rng, h->config->seed, "cost", "hall");
	return BB_OK;
}

enum bb_status bb_cost_measure(const struct bb_cost_config *config, struct bb_cost *out, struct bb_error *err)
{
	struct hall h = { .config = config };
	struct bb_room *room = NULL;
	enum bb_status status = bb_room_load(config->room, &room, err);

	*out = (struct bb_cost){ .n_cameras = config->n_cameras,
				 .n_bodies = config->n_bodies,
				 .n_clutter = config->n_clutter };
	if (!status)
		status = check(config, room, err);
	if (!status)
		status = furnish(&h, room, err);
	if (!status) {
		out->period_us = 1e-3 * (double)h.period_ns;
		status = warm(&h, out, err);
	}
	if (!status)
		status = cold(&h, out, err);
	free(h.cameras);
	free(h.blobs);
	free(h.n);
	bb_room_free(room);
	return status;
}
