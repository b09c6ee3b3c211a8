#include "sync/coverage/place.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "sync/coverage/coverage_private.h"

#define PI 3.14159265358979323846
#define STEEPEST (88 * PI / 180)
#define MOVE_M 0.6 /* the first steps; they halve */
#define TURN_RAD (24 * PI / 180)
#define LEAST_SCALE 0.03
#define LEAST_GAIN 1e-4 /* of what is sought; a smaller one is no step */
#define WEAK_HALF 0.01
#define ALL 0.001

struct place {         /* one camera */
	double way_m;  /* along all rails */
	double heading_rad, elevation_rad;
};

struct cell {          /* what a camera says about one place of the grid */
	uint64_t headings; /* that do not hide it; bit 0 alone when nobody is in the way */
	float info[6];
};

struct search {
	const struct bb_place_config *config;
	struct bb_coverage *cover;
	double way_m; /* length of all rails */
	size_t n_points, n_cameras;
	unsigned n_headings; /* 1 with nobody in the way */
	struct bb_vec3 *point;
	struct place *at, *best;
	struct cell *cell;  /* by camera, then point */
	struct cell *trial; /* of the camera that moves */
	float *base;        /* summed information of the others, by point, heading: 6 */
	double *worth;
	double score;
	unsigned sweeps_left;
	uint64_t n_probes, rng;
};

static uint64_t next_u64(uint64_t *s) /* splitmix64 */
{
	uint64_t z = *s += UINT64_C(0x9E3779B97F4A7C15);

	z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
	z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
	return z ^ (z >> 31);
}

static double uniform(struct search *s)
{
	return (double)(next_u64(&s->rng) >> 11) * 0x1p-53;
}

/* ---- rails and poses ---- */

size_t bb_rails_of_room(const struct bb_room *room, double inset_m, double below_m, struct bb_rail *out, size_t cap)
{
	size_t n = 0;

	for (size_t i = 0; i < room->n_walls && n < cap; i++) {
		const struct bb_corners *c = &room->walls[i].corners;
		const struct bb_vec3 normal = bb_corners_normal(c), up = { 0, -below_m, 0 };
		const struct bb_vec3 right = bb_vec3_unit(bb_vec3_sub(c->lower_right, c->lower_left), (struct bb_vec3){ 1, 0, 0 });
		if (fabs(normal.y) > 0.5)
			continue;
		const struct bb_vec3 off = bb_vec3_add(bb_vec3_scale(normal, inset_m), up), in = bb_vec3_scale(right, inset_m);
		out[n].a = bb_vec3_add(bb_vec3_add(c->upper_left, off), in);
		out[n].b = bb_vec3_add(bb_vec3_sub(bb_corners_at(c, 1, 1), in), off);
		n++;
	}
	return n;
}

/* Looks from a point along a heading about +Y and an elevation, upright. */
static struct bb_pose aim(struct bb_vec3 at, double heading_rad, double elevation_rad)
{
	const struct bb_vec3 ahead = { -sin(heading_rad) * cos(elevation_rad), sin(elevation_rad),
				       -cos(heading_rad) * cos(elevation_rad) };
	const struct bb_pose look = bb_pose_look_at(at, bb_vec3_add(at, ahead), (struct bb_vec3){ 0, 1, 0 });

	/* A camera looks along +Z with y down: half a turn about x. */
	return (struct bb_pose){ at, bb_quat_unit(bb_quat_mul(look.q, (struct bb_quat){ 1, 0, 0, 0 })) };
}

static double length_of(const struct bb_rail *r)
{
	return bb_vec3_norm(bb_vec3_sub(r->b, r->a));
}

static struct bb_vec3 on_rails(const struct search *s, double way_m)
{
	const struct bb_place_config *k = s->config;

	for (size_t i = 0; i < k->n_rails; i++) {
		const double l = length_of(&k->rails[i]);
		if (way_m <= l || i + 1 == k->n_rails)
			return bb_vec3_lerp(k->rails[i].a, k->rails[i].b, l > 0 ? fmin(way_m / l, 1) : 0);
		way_m -= l;
	}
	return k->rails[0].a;
}

/* The place of the way that is nearest to a point. */
static double nearest_way(const struct search *s, struct bb_vec3 p)
{
	double best_m = HUGE_VAL, best = 0, before = 0;

	for (size_t i = 0; i < s->config->n_rails; i++) {
		const struct bb_rail *r = &s->config->rails[i];
		const struct bb_vec3 d = bb_vec3_sub(r->b, r->a);
		const double dd = bb_vec3_dot(d, d);
		const double t = dd > 0 ? fmin(fmax(bb_vec3_dot(bb_vec3_sub(p, r->a), d) / dd, 0), 1) : 0;
		const double off_m = bb_vec3_norm(bb_vec3_sub(p, bb_vec3_lerp(r->a, r->b, t)));
		if (off_m < best_m) {
			best_m = off_m;
			best = before + t * length_of(r);
		}
		before += length_of(r);
	}
	return best;
}

static struct place place_towards(const struct search *s, double way_m, struct bb_vec3 target)
{
	const struct bb_vec3 d = bb_vec3_sub(target, on_rails(s, way_m));

	return (struct place){ way_m, atan2(-d.x, -d.z), fmin(fmax(atan2(d.y, hypot(d.x, d.z)), -STEEPEST), STEEPEST) };
}

static struct bb_pose pose_of(const struct search *s, const struct place *p)
{
	return aim(on_rails(s, p->way_m), p->heading_rad, p->elevation_rad);
}

/* ---- what a camera sees of the grid ---- */

static void look(const struct search *s, size_t camera, const struct place *p, struct cell *out)
{
	struct bb_camera_config config = s->config->cover.cameras[camera];
	struct bb_coverage_eye eye;
	struct bb_coverage_sight sight;

	memset(out, 0, s->n_points * sizeof(*out));
	config.pose = pose_of(s, p);
	if (!bb_coverage_eye_init(&eye, &config, s->config->cover.noise_px))
		return;
	for (size_t i = 0; i < s->n_points; i++) {
		if (!bb_coverage_sees(s->cover, &eye, s->point[i], &sight))
			continue;
		for (int k = 0; k < 6; k++)
			out[i].info[k] = (float)sight.info[k];
		if (s->config->body == BB_COVERAGE_NONE)
			out[i].headings = 1;
		else
			for (unsigned h = 0; h < s->n_headings; h++)
				if (!bb_viewer_hides(&s->config->cover.viewer, s->cover->head[h], &sight))
					out[i].headings |= UINT64_C(1) << h;
	}
}

static void look_all(const struct search *s)
{
	for (size_t c = 0; c < s->n_cameras; c++)
		look(s, c, &s->at[c], s->cell + c * s->n_points);
}

static void add(const struct search *s, const struct cell *cells, float *sums)
{
	for (size_t i = 0; i < s->n_points; i++)
		for (unsigned h = 0; cells[i].headings && h < s->n_headings; h++)
			if (cells[i].headings >> h & 1)
				for (int k = 0; k < 6; k++)
					sums[(i * s->n_headings + h) * 6 + (size_t)k] += cells[i].info[k];
}

static void base_without(struct search *s, size_t camera)
{
	memset(s->base, 0, s->n_points * s->n_headings * 6 * sizeof(*s->base));
	for (size_t c = 0; c < s->n_cameras; c++)
		if (c != camera)
			add(s, s->cell + c * s->n_points, s->base);
}

/* ---- what is sought ---- */

static double worth_at(const struct search *s, const struct cell *cell, const float *base)
{
	double sum = 0, least = HUGE_VAL;

	for (unsigned h = 0; h < s->n_headings; h++) {
		double info[6], error_m, worst_m, covariance_m2[6];
		for (int k = 0; k < 6; k++)
			info[k] = (double)base[h * 6 + (unsigned)k] + (cell->headings >> h & 1 ? (double)cell->info[k] : 0);
		const double w = bb_coverage_error(info, &error_m, &worst_m, covariance_m2) ? 1 / error_m : 0;
		sum += w;
		least = fmin(least, w);
	}
	return s->config->body == BB_COVERAGE_WORST ? least : sum / s->n_headings;
}

static int ascending(const void *a, const void *b)
{
	const double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

static double score_with(struct search *s, const struct cell *cells)
{
	const size_t n = s->n_points, tenth = (n + 9) / 10, half = (n + 1) / 2;
	double sum = 0, weak = 0, weaker = 0;

	for (size_t i = 0; i < n; i++)
		s->worth[i] = worth_at(s, &cells[i], s->base + i * s->n_headings * 6);
	qsort(s->worth, n, sizeof(*s->worth), ascending);
	for (size_t i = 0; i < n; i++) {
		sum += s->worth[i];
		weak += i < tenth ? s->worth[i] : 0;
		weaker += i < half ? s->worth[i] : 0;
	}
	s->n_probes++;
	return weak / (double)tenth + WEAK_HALF * weaker / (double)half + ALL * sum / (double)n;
}

/* ---- the search ---- */

/* Is a camera at this place far enough from the others among the first n? */
static bool has_room(const struct search *s, size_t n, size_t camera, double way_m)
{
	const struct bb_vec3 p = on_rails(s, way_m);

	for (size_t c = 0; c < n; c++)
		if (c != camera && bb_vec3_norm(bb_vec3_sub(p, on_rails(s, s->at[c].way_m))) < s->config->apart_m)
			return false;
	return true;
}

static bool probe(struct search *s, size_t camera, struct place p)
{
	p.elevation_rad = fmin(fmax(p.elevation_rad, -STEEPEST), STEEPEST);
	p.way_m = fmod(p.way_m + s->way_m, s->way_m); /* round the room, where the rails close */
	if (fabs(p.way_m - s->at[camera].way_m) > 1e-9 && !has_room(s, s->n_cameras, camera, p.way_m))
		return false;
	look(s, camera, &p, s->trial);
	const double score = score_with(s, s->trial);
	if (!(score > s->score * (1 + LEAST_GAIN)))
		return false;
	s->score = score;
	s->at[camera] = p;
	memcpy(s->cell + camera * s->n_points, s->trial, s->n_points * sizeof(*s->trial));
	return true;
}

/* The point it looks at stays where it is when a camera moves: else every move would waste its turn. */
static struct place moved(const struct search *s, const struct place *p, double by_m)
{
	const struct bb_pose pose = pose_of(s, p);
	const struct bb_vec3 target = bb_pose_apply(&pose, (struct bb_vec3){ 0, 0, 1.5 });
	const double way_m = fmod(p->way_m + by_m + s->way_m, s->way_m);

	return place_towards(s, way_m, target);
}

static bool improve_camera(struct search *s, size_t camera, double scale)
{
	static const double side[2] = { 1, -1 };
	bool any = false;

	base_without(s, camera);
	for (int i = 0; i < 2; i++)
		if (probe(s, camera, moved(s, &s->at[camera], side[i] * scale * MOVE_M))) {
			any = true;
			break;
		}
	for (int axis = 0; axis < 2; axis++)
		for (int i = 0; i < 2; i++) {
			struct place p = s->at[camera];
			*(axis ? &p.elevation_rad : &p.heading_rad) += side[i] * scale * TURN_RAD;
			if (probe(s, camera, p)) {
				any = true;
				break;
			}
		}
	return any;
}

/* Until no camera gains by any step, however small, or no sweep is left. */
static void climb(struct search *s, double scale)
{
	while (s->sweeps_left && scale >= LEAST_SCALE) {
		bool any = false;
		s->sweeps_left--;
		for (size_t c = 0; c < s->n_cameras; c++)
			any |= improve_camera(s, c, scale);
		if (!any)
			scale /= 2;
	}
}

static struct place anywhere(struct search *s, double way_m)
{
	const struct bb_place_config *k = s->config;
	const struct bb_vec3 target = { k->min.x + (k->max.x - k->min.x) * (0.2 + 0.6 * uniform(s)),
					k->min.y + (k->max.y - k->min.y) * uniform(s),
					k->min.z + (k->max.z - k->min.z) * (0.2 + 0.6 * uniform(s)) };

	return place_towards(s, fmod(way_m, s->way_m), target);
}

/* Takes one camera from where it is and hangs it anywhere: whatever that costs, the climb after it may earn more. */
static void kick(struct search *s)
{
	const size_t camera = (size_t)(next_u64(&s->rng) % s->n_cameras);
	struct place p;
	int tries = 0;

	do
		p = anywhere(s, uniform(s) * s->way_m);
	while (!has_room(s, s->n_cameras, camera, p.way_m) && ++tries < 100);
	base_without(s, camera);
	s->at[camera] = p;
	look(s, camera, &p, s->cell + camera * s->n_points);
	s->score = score_with(s, s->cell + camera * s->n_points);
}

/* A climb, then kicks, each climbed from, as long as sweeps last; what was best stays. */
static void seek(struct search *s)
{
	climb(s, 1);
	double best = s->score;
	memcpy(s->best, s->at, s->n_cameras * sizeof(*s->best));
	while (s->sweeps_left) {
		kick(s);
		climb(s, 0.5);
		if (s->score > best) {
			best = s->score;
			memcpy(s->best, s->at, s->n_cameras * sizeof(*s->best));
			continue;
		}
		memcpy(s->at, s->best, s->n_cameras * sizeof(*s->best));
		look_all(s);
		s->score = best;
	}
	s->score = best;
	memcpy(s->at, s->best, s->n_cameras * sizeof(*s->best));
}

/* ---- begin and end ---- */

/* The next place along the way that is far enough from the cameras before this one: those that were added all begin as the
 * first. As it was when there is none. */
static double make_room(const struct search *s, size_t camera, double way_m)
{
	const size_t steps = 4 * s->n_cameras;

	if (has_room(s, camera, camera, way_m))
		return way_m;
	for (size_t i = 1; i < steps; i++) {
		const double at_m = fmod(way_m + (double)i / (double)steps * s->way_m, s->way_m);
		if (has_room(s, camera, camera, at_m))
			return at_m;
	}
	return way_m;
}

static void begin_anywhere(struct search *s, unsigned index)
{
	const struct bb_place_config *k = s->config;
	const double shift = uniform(s);

	for (size_t c = 0; c < s->n_cameras; c++) {
		const struct bb_pose *own = &k->cover.cameras[c].pose;
		if (index == 0)
			s->at[c] = place_towards(s, make_room(s, c, nearest_way(s, own->p)),
						 bb_pose_apply(own, (struct bb_vec3){ 0, 0, 1.5 }));
		else
			s->at[c] = anywhere(s, ((double)c + shift) / (double)s->n_cameras * s->way_m);
	}
}

static size_t fill_points(struct search *s, const struct bb_coverage_grid *g)
{
	size_t n = 0;

	for (size_t y = 0; y < g->n[1]; y++)
		for (size_t z = 0; z < g->n[2]; z++)
			for (size_t x = 0; x < g->n[0]; x++) {
				const struct bb_vec3 p = bb_coverage_centre(g, x, y, z);
				if (bb_room_contains(s->config->cover.room, p, 0))
					s->point[n++] = p;
			}
	return n;
}

static enum bb_status prepare(struct search *s)
{
	const struct bb_place_config *k = s->config;
	struct bb_coverage_grid g;
	size_t bad;

	for (size_t i = 0; i < k->n_rails; i++)
		s->way_m += length_of(&k->rails[i]);
	s->n_cameras = k->cover.n_cameras;
	if (!s->n_cameras || !k->n_rails || k->n_rails > BB_RAILS_MAX || !isfinite(s->way_m) || !(s->way_m > 0) ||
	    !bb_coverage_grid_over(k->min, k->max, k->step_m, &g) || g.n[0] * g.n[1] * g.n[2] > BB_PLACE_GRID_MAX)
		return BB_ERR_CONFIG;
	const enum bb_status status = bb_coverage_create(&k->cover, &s->cover, &bad);
	if (status)
		return status;
	s->n_headings = k->body == BB_COVERAGE_NONE ? 1 : k->cover.headings;
	const size_t n = g.n[0] * g.n[1] * g.n[2];
	s->point = calloc(n, sizeof(*s->point));
	s->at = calloc(s->n_cameras, sizeof(*s->at));
	s->best = calloc(s->n_cameras, sizeof(*s->best));
	s->cell = calloc(n * s->n_cameras, sizeof(*s->cell));
	s->trial = calloc(n, sizeof(*s->trial));
	s->base = calloc(n * s->n_headings * 6, sizeof(*s->base));
	s->worth = calloc(n, sizeof(*s->worth));
	if (!s->point || !s->at || !s->best || !s->cell || !s->trial || !s->base || !s->worth)
		return BB_ERR_NOMEM;
	s->n_points = fill_points(s, &g);
	return s->n_points ? BB_OK : BB_ERR_CONFIG;
}

static void finish(struct search *s)
{
	bb_coverage_destroy(s->cover);
	free(s->point);
	free(s->at);
	free(s->best);
	free(s->cell);
	free(s->trial);
	free(s->base);
	free(s->worth);
}

enum bb_status bb_place_try(const struct bb_place_config *config, unsigned index, struct bb_placed *out)
{
	struct search s = { .config = config, .sweeps_left = config->sweeps, .rng = config->seed * 1000003u + index };
	const enum bb_status status = prepare(&s);

	*out = (struct bb_placed){ 0 };
	if (status) {
		finish(&s);
		return status;
	}
	begin_anywhere(&s, index);
	look_all(&s);
	base_without(&s, 0);
	out->begun = s.score = score_with(&s, s.cell);
	seek(&s);
	out->reached = s.score;
	out->n_probes = s.n_probes;
	out->apart = true;
	for (size_t c = 0; c < s.n_cameras; c++)
		out->apart &= has_room(&s, c, c, s.at[c].way_m);
	for (size_t c = 0; c < s.n_cameras; c++)
		out->pose[c] = pose_of(&s, &s.at[c]);
	finish(&s);
	return BB_OK;
}
