/*
 * render/volume/shock.c: gas density around a planar shock that runs along x from a light gas into a heavy one whose
 * boundary is randomly perturbed; the perturbation grows, the shock comes back from the far wall and stirs it again
 * (the Richtmyer-Meshkov instability with re-shock). What no wave has reached is exactly constant.
 */
#include "render/volume/noise.h"
#include "render/volume/volume_private.h"

/* Along x in 0 .. 1, times in 0 .. 1 of the sequence. */
#define BOUNDARY 0.35 /* where it is at first */
#define SHOCK_AT 0.05
#define SHOCK_SPEED 1.5 /* in both gases */
#define HIT ((BOUNDARY - SHOCK_AT) / SHOCK_SPEED)
#define DRIFT 0.35 /* of the boundary after the hit */
#define WALL (HIT + (1 - BOUNDARY) / SHOCK_SPEED)
#define BACK_SPEED 1.8
#define AGAIN (WALL + (1 - BOUNDARY - DRIFT * (WALL - HIT)) / (BACK_SPEED + DRIFT)) /* the second hit */
#define LIGHT 1.0
#define HEAVY 3.3
#define SHARP 0.004 /* half the width of a front */

struct row {
	double phase;
	double boundary, width; /* of this row */
	double shock, mirrored, back;
	double y, z;
	struct bb_noise eddies[2], waves;
};

static double front(double x, double at)
{
	return bb_smooth((x - at) / (2 * SHARP) + 0.5);
}

static double grown(double phase)
{
	const double once = phase > HIT ? 0.010 + 0.055 * (phase - HIT) : 0.016;

	return phase > AGAIN ? once + 0.30 * (phase - AGAIN) : once;
}

static double value_at(struct row *w, double x)
{
	double from_it = x - w->boundary;
	const double near = w->phase > HIT ? bb_bump(from_it, 0.05 + 3 * grown(w->phase)) : 0;

	if (near > 0)
		from_it += near * grown(w->phase) *
			   (0.55 * bb_noise_at(&w->eddies[0], x * 60, w->y * 7, w->z * 7) +
			    0.35 * bb_noise_at(&w->eddies[1], x * 120, w->y * 14, w->z * 14));
	const double heavy = bb_smooth(from_it / (2 * w->width) + 0.5);
	double v = bb_mix(LIGHT, HEAVY, heavy);
	const double passed = 1 - front(x, w->shock);
	v *= 1 + passed * bb_mix(0.86, 0.72, heavy);
	if (w->phase > HIT) {
		v *= 1 + 0.24 * front(x, w->mirrored) * (1 - heavy); /* thrown back by the heavy gas */
		v *= 1 + 0.03 * passed * bb_bump(from_it, 0.22) * bb_noise_at(&w->waves, x * 18, w->y * 3, w->z * 3);
	}
	if (w->phase > WALL)
		v *= 1 + 0.55 * front(x, w->back);
	return v;
}

static struct row row_of(const struct bb_generated *g, uint32_t step, uint32_t z, uint32_t y)
{
	const double phase = bb_generated_phase(g, step), wide = g->dim[1] > g->dim[2] ? g->dim[1] : g->dim[2];
	struct row w = { .phase = phase, .y = (y + 0.5) / wide, .z = (z + 0.5) / wide };
	double uneven = 0;

	for (uint32_t k = 0; k < 3; k++) {
		const double scale = 1 << k;
		struct bb_noise n = bb_noise_make(g->seed, k, 0, 0);
		uneven += bb_noise_at(&n, 0.5, w.y * 4 * scale, w.z * 4 * scale) / scale;
	}
	const double since = phase > HIT ? phase - HIT : 0, until = phase < AGAIN ? since : AGAIN - HIT;
	w.boundary = BOUNDARY + DRIFT * until + 1.6 * grown(phase) * uneven;
	w.width = 0.006 + 0.025 * since;
	w.shock = SHOCK_AT + SHOCK_SPEED * phase + (since > 0 ? 0.02 * uneven / (1 + 12 * since) : 0);
	w.mirrored = BOUNDARY - 0.45 * since;
	w.back = 1 - BACK_SPEED * (phase - WALL) + (phase > AGAIN ? 0.03 * uneven : 0);
	w.waves = bb_noise_make(g->seed, 8, 0, phase * 4);
	for (uint32_t k = 0; k < 2; k++)
		w.eddies[k] = bb_noise_make(g->seed, 6 + k, 0, phase * 3 * (k + 1));
	return w;
}

void bb_shock_row(const struct bb_generated *g, uint32_t step, uint32_t z, uint32_t y, uint32_t x, uint32_t n,
		  double *out)
{
	struct row w = row_of(g, step, z, y);

	for (uint32_t i = 0; i < n; i++)
		out[i] = value_at(&w, (x + i + 0.5) / g->dim[0]);
}
