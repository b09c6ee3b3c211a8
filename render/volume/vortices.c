/*
 * render/volume/vortices.c: air density around two wings at a high angle of attack, x along the flow, y along the span,
 * z up. "delta": a pair of vortices rolls up over a delta wing and breaks down towards its trailing edge. "wing": a
 * body with leading-edge extensions whose thinner vortices burst over the wing behind them. A core turns as a helix
 * behind the place where it bursts, and that place moves to and fro; all of it slowly.
 */
#include "render/volume/noise.h"
#include "render/volume/volume_private.h"

#include <math.h>

struct shape {
	double apex, tail;         /* of the wing, in 0 .. 1 of x */
	double span;               /* half of it at the tail; 1 is the volume's half width */
	double bursts, burst_long; /* where, and over which length */
	double core, turns;        /* radius for a span of one; turns of the helix over the length */
	double rise, body;         /* of the core for a span of one; radius of a body along x */
	double hurry;              /* turns of the helix through the sequence */
};

static const struct shape delta = { 0.10, 0.82, 0.62, 0.58, 0.22, 0.16, 5, 0.34, 0, 0.8 };
static const struct shape wing = { 0.12, 0.48, 0.40, 0.42, 0.10, 0.16, 9, 0.42, 0.13, 1.1 };

struct core { /* one vortex, where the row meets it */
	double y, z, radius, burst;
	double cosine, sine; /* of the sheet's turn */
};

struct row {
	const struct bb_generated *g;
	const struct shape *shape;
	double y, z, phase, side; /* side: 0 or 1, so that the two are not the same */
	struct bb_noise air, air_fine, burst, burst_fine;
};

static double span_at(const struct shape *s, double x)
{
	return s->span * bb_clamp01((x - s->apex) / (s->tail - s->apex));
}

static struct core core_at(const struct row *w, double x)
{
	const struct shape *s = w->shape;
	const double own = bb_noise_number(w->g->seed, 5 + (uint32_t)w->side);
	const double span = span_at(s, x), behind = x > s->tail ? x - s->tail : 0;
	const double bursts = s->bursts + 0.04 * bb_sin_turns(1.3 * w->phase + own);
	const double turn = s->turns * x - s->hurry * w->phase + own;
	struct core c = { .burst = bb_smooth((x - bursts) / s->burst_long) };

	c.radius = (0.012 + s->core * span) * (1 + 1.1 * c.burst);
	c.y = 0.68 * span + 0.3 * behind;
	c.z = 0.03 + s->rise * span + 0.35 * behind;
	c.cosine = bb_cos_turns(turn);
	c.sine = bb_sin_turns(turn);
	c.y += 0.45 * c.radius * c.burst * c.cosine;
	c.z += 0.45 * c.radius * c.burst * c.sine;
	return c;
}

/* What the vortex takes from the density at (x, y, z): core, rolled-up sheet, and after the burst its eddies. */
static double vortex(struct row *w, double x, double strength)
{
	const struct core c = core_at(w, x);
	const double dy = (w->y - c.y) / c.radius, dz = (w->z - c.z) / c.radius, far2 = dy * dy + dz * dz;
	const double core = 0.62 * (1 - 0.55 * c.burst) / ((1 + far2) * (1 + far2));

	if (far2 > 25 || strength <= 0)
		return strength * core;
	const double far = sqrt(far2), wound = 0.42 * far, cosine = bb_cos_turns(wound), sine = bb_sin_turns(wound);
	const double along =
		far > 0 ? (dy * (c.cosine * cosine - c.sine * sine) + dz * (c.sine * cosine + c.cosine * sine)) / far
			: 0;
	const double sheet = along > 0 ? along * along * along * along * bb_bump(far - 1.8, 1.7) : 0;
	double eddies = 0;
	if (c.burst > 0 && far < 2.8)
		eddies = bb_bump(far, 2.8) * c.burst *
			 (bb_noise_at(&w->burst, x * 26, w->y * 13, w->z * 13) +
			  0.6 * bb_noise_at(&w->burst_fine, x * 52, w->y * 26, w->z * 26));
	return strength * (core + 0.16 * sheet * (1 - 0.6 * c.burst) + 0.14 * eddies);
}

/* The thin vortex between the large one and the edge. */
static double second(const struct row *w, double x)
{
	const double span = span_at(w->shape, x), radius = 0.01 + 0.05 * span;
	const double dy = (w->y - 0.92 * span) / radius, dz = (w->z - 0.02 - 0.06 * span) / radius;
	const double u = 1 + dy * dy + dz * dz;

	return x < w->shape->tail ? 0.22 * bb_clamp01(span * 8) / (u * u) : 0;
}

/* Packed below the wing, thin above it. */
static double wing_itself(const struct row *w, double x)
{
	const double span = span_at(w->shape, x), over = x > w->shape->tail ? (x - w->shape->tail) * 6 : 0;
	const double on = bb_smooth((span - w->y) / (0.06 + 0.2 * span)) * bb_smooth(1 - over) * bb_clamp01(span * 10);

	return on * (0.26 * bb_bump(w->z + 0.05, 0.22) - 0.10 * bb_bump(w->z - 0.04, 0.10));
}

static double value_at(struct row *w, double x)
{
	const struct shape *s = w->shape;
	const double strength = bb_smooth((x - s->apex) / 0.08);
	double v = 1 + 0.035 * bb_noise_at(&w->air, x * 4, w->y * 2, w->z * 2) +
		   0.012 * bb_noise_at(&w->air_fine, x * 11, w->y * 5, w->z * 5);

	v += wing_itself(w, x);
	if (strength > 0)
		v -= vortex(w, x, strength) + second(w, x);
	if (s->body > 0) {
		const double nose = bb_smooth((x - 0.02) / 0.25),
			     radius = s->body * nose * (1 - 0.5 * bb_smooth(x - 0.2));
		const double far = sqrt(w->y * w->y + w->z * w->z);
		if (radius > 0 && far < 2 * radius) /* air is packed before it and slides along it; inside is none */
			v = far < radius ? 1.32 : v + 0.32 * bb_bump(far - radius, radius);
	}
	return v > 0.05 ? v : 0.05;
}

static void row_of(const struct bb_generated *g, const struct shape *s, uint32_t step, uint32_t z, uint32_t y,
		   struct row *w)
{
	const double half = g->dim[1] / 2.0, phase = bb_generated_phase(g, step);
	const double across = (y + 0.5 - half) / half;

	*w = (struct row){ .g = g,
			   .shape = s,
			   .y = across < 0 ? -across : across,
			   .z = (z + 0.5 - 0.28 * g->dim[2]) / half,
			   .phase = phase,
			   .side = across < 0 };
	w->air = bb_noise_make(g->seed, 1, 0, phase);
	w->air_fine = bb_noise_make(g->seed, 2, 0, phase * 2);
	w->burst = bb_noise_make(g->seed, 3 + (uint32_t)w->side, 0, phase * 3);
	w->burst_fine = bb_noise_make(g->seed, 5 + (uint32_t)w->side, 0, phase * 5);
}

void bb_delta_row(const struct bb_generated *g, uint32_t step, uint32_t z, uint32_t y, uint32_t x, uint32_t n,
		  double *out)
{
	struct row w;

	row_of(g, &delta, step, z, y, &w);
	for (uint32_t i = 0; i < n; i++)
		out[i] = value_at(&w, (x + i + 0.5) / g->dim[0]);
}

void bb_wing_row(const struct bb_generated *g, uint32_t step, uint32_t z, uint32_t y, uint32_t x, uint32_t n,
		 double *out)
{
	struct row w;

	row_of(g, &wing, step, z, y, &w);
	for (uint32_t i = 0; i < n; i++)
		out[i] = value_at(&w, (x + i + 0.5) / g->dim[0]);
}
