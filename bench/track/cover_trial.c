/* bench/track/cover_trial.c: expected errors against a Monte Carlo through the tracker's own lens and triangulation. */
#include <math.h>

#include "bench/stats.h"
#include "bench/track/cover.h"
#include "sim/world.h"
#include "sync/track/lens.h"
#include "sync/track/triangulate.h"

#define TRIES 100000 /* for points that some camera pair can place */

struct point {
	struct bb_vec3 p;
	struct bb_coverage_look look;
};

/* Somewhere in the volume, the viewer facing anywhere. */
static bool draw_point(const struct bb_cover *c, struct sim_rng *rng, struct point *out)
{
	const struct bb_coverage_grid *g = &c->grid;
	const double step = g->step_m;

	for (int i = 0; i < TRIES; i++) {
		out->p.x = g->min.x + step * (double)g->n[0] * sim_rng_uniform(rng);
		out->p.y = g->min.y + step * (double)g->n[1] * sim_rng_uniform(rng);
		out->p.z = g->min.z + step * (double)g->n[2] * sim_rng_uniform(rng);
		const int heading = (int)(sim_rng_u64(rng) % c->config.headings);
		if (!bb_room_contains(c->room, out->p, 0))
			continue;
		bb_coverage_look(c->model, out->p, heading, &out->look);
		if (out->look.placed)
			return true;
	}
	return false;
}

static bool sample(const struct bb_cover *c, const struct bb_lens *lenses, const struct point *at, struct sim_rng *rng,
		   struct bb_vec3 *error)
{
	struct bb_sight sights[BB_COVERAGE_CAMERAS_MAX];
	struct bb_triangulated t;

	for (size_t i = 0; i < at->look.n; i++) {
		const size_t camera = at->look.camera[i];
		const double own_px = c->config.cameras[camera].noise_px;
		const double sigma_px = fmax(c->config.noise_px > 0 ? c->config.noise_px : own_px, 1e-3);
		struct bb_ray ray;
		double px[2];
		if (!bb_lens_project(&lenses[i], at->p, px) ||
		    !bb_lens_ray(&lenses[i], px[0] + sigma_px * sim_rng_normal(rng), px[1] + sigma_px * sim_rng_normal(rng), &ray))
			return false;
		sights[i] = (struct bb_sight){ lenses[i].o, ray.d, ray.sigma_rad * sigma_px };
	}
	if (!bb_triangulate(sights, at->look.n, BB_RAY_ANGLE_MIN_RAD, &t))
		return false;
	*error = bb_vec3_sub(t.p, at->p);
	return true;
}

/* Measured rms error over the expected one. */
static double try_point(const struct bb_cover *c, const struct point *at, size_t n_samples, struct sim_rng *rng,
			size_t *n_refused)
{
	struct bb_lens lenses[BB_COVERAGE_CAMERAS_MAX];
	double sum = 0;
	size_t n = 0;

	for (size_t i = 0; i < at->look.n; i++)
		if (!bb_lens_init(&lenses[i], &c->config.cameras[at->look.camera[i]]))
			return 0;
	for (size_t k = 0; k < n_samples; k++) {
		struct bb_vec3 error;
		if (sample(c, lenses, at, rng, &error)) {
			sum += bb_vec3_dot(error, error);
			n++;
		}
	}
	*n_refused += n_samples - n;
	return n ? sqrt(sum / (double)n) / at->look.error_m : 0;
}

void bb_cover_trial(const struct bb_cover *c, size_t n_points, size_t n_samples, uint64_t seed,
		    struct bb_cover_trial *out)
{
	struct sim_rng rng;
	struct point at;
	double sum = 0, sum2 = 0;

	*out = (struct bb_cover_trial){ .n_samples = n_samples, .least_ratio = HUGE_VAL };
	sim_rng_seed(&rng, seed, "coverage", "trial");
	for (size_t i = 0; i < n_points && draw_point(c, &rng, &at); i++) {
		const double ratio = try_point(c, &at, n_samples, &rng, &out->n_refused);
		out->n_points++;
		out->n_within += fabs(ratio - 1) <= 0.1;
		out->least_ratio = fmin(out->least_ratio, ratio);
		out->most_ratio = fmax(out->most_ratio, ratio);
		out->cameras_mean += (double)at.look.n;
		sum += ratio;
		sum2 += (ratio - 1) * (ratio - 1);
	}
	const double n = fmax(1, (double)out->n_points);
	out->mean_ratio = sum / n;
	out->rms_deviation = sqrt(sum2 / n);
	out->cameras_mean /= n;
}
