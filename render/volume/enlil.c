/*
 * render/volume/enlil.c: something like the ENLIL model's solar wind: density times the square of the distance, on a
 * grid of r (0.1 to 1.7 astronomical units), theta and phi (all the way round). Slow dense wind along a wavy current
 * sheet, compressed where fast wind runs into it, all wound up by the Sun's rotation as Parker (1958) says; and two
 * mass ejections (cones, after Zhao, Plunkett and Liu 2002), each a sheath with a sharp front, a cavity and a core.
 *
 * A parcel of wind flies straight out, so what is at (r, phi) now left the Sun a while ago from where it had turned to:
 * every pattern is a function of that source longitude and, slowly, of that time.
 */
#include "render/volume/noise.h"
#include "render/volume/volume_private.h"

#include <math.h>

#define R_FROM 0.1
#define R_TO 1.7
#define THETA_FROM 0.5235987755982988 /* 30 degrees from the poles, where the model ends */
#define THETA_TO 2.6179938779914944
#define TURN 6.283185307179586
#define DAYS 5.0           /* of the whole sequence */
#define ROTATION_DAYS 27.3 /* of the Sun, seen from Earth */
#define WIND_AU_DAY 0.23   /* 400 km/s */

const double bb_enlil_extent[6] = { R_FROM, R_TO, THETA_FROM, THETA_TO, 0, TURN };

struct cone { /* of a mass ejection, for one row: theta and phi are fixed */
	double front, thick, along, core;
};

struct row {
	double latitude, turns; /* phi */
	double phase;           /* 0 .. 1 through the sequence */
	double shift[3];        /* of the sheet's and the streams' longitudes, in turns */
	struct bb_noise torn[3];
	struct cone cone[2];
};

static struct cone cone_of(const struct bb_generated *g, const struct row *w, uint32_t k)
{
	const double launch = 0.02 + 0.28 * k + 0.08 * bb_noise_number(g->seed, 10 + k);
	const double latitude = 0.5 * (bb_noise_number(g->seed, 20 + k) - 0.5);
	const double turns = bb_noise_number(g->seed, 30) + 0.37 * k;
	const double speed = 2.6 - 0.9 * k; /* a whole sequence's way, in astronomical units */
	const double wide = 0.36 - 0.12 * k;
	const double cosine =
		bb_sin_turns(latitude / TURN) * bb_sin_turns(w->latitude / TURN) +
		bb_cos_turns(latitude / TURN) * bb_cos_turns(w->latitude / TURN) * bb_cos_turns(w->turns - turns);
	struct bb_noise dent = bb_noise_make(g->seed, 40 + k, 16, 0);
	const double way = speed * (w->phase - launch) * (1 - 0.2 * (w->phase - launch));
	struct cone c = { .along = way > 0 ? bb_bump(1 - cosine, wide) : 0 };

	if (c.along <= 0)
		return c;
	const double uneven = 1 + 0.09 * bb_noise_at(&dent, 0.5, w->latitude * 3, w->turns * 16);
	c.front = R_FROM + way * (0.72 + 0.28 * c.along) * uneven;
	c.thick = 0.03 + 0.07 * c.front;
	c.core = bb_bump(1 - cosine, wide * 0.3);
	return c;
}

/* Factor of the density at r. */
static double ejected(const struct cone *c, double r)
{
	const double inside = c->front - r; /* behind the front */
	const double fades = 1 / (0.55 + 0.45 * c->front);

	if (c->along <= 0 || inside < -0.012 || inside > c->thick + 0.5)
		return 1;
	const double sheath = bb_smooth((inside + 0.012) / 0.024) * bb_bump(inside > 0 ? inside : 0, c->thick);
	const double cavity = bb_bump(inside - c->thick - 0.20, 0.26);
	const double core = bb_bump(inside - c->thick - 0.24, 0.07) * c->core;
	return (1 + 5.5 * c->along * fades * sheath) * (1 - 0.75 * c->along * cavity) + 5 * fades * core;
}

/* What runs into the slow wind ahead: a steep front, a slope behind it, thin wind after that. */
static double streams(const struct row *w, double source, double r)
{
	const double grown = (r - R_FROM) / (R_TO - R_FROM);
	const double in_sector = 2 * source + w->shift[2];
	const double at = in_sector - bb_floor(in_sector) - 0.5;
	const double packed = at > 0 ? bb_bump(at, 0.03) : bb_bump(at, 0.11);
	const double thin = bb_bump(at + 0.27, 0.2);

	return 1 + grown * bb_bump(w->latitude, 1.2) * (2.1 * packed - 0.5 * thin);
}

static double value_at(struct row *w, double r)
{
	const double left = w->phase * DAYS - (r - R_FROM) / WIND_AU_DAY; /* when it left the Sun, in days */
	const double source = w->turns - left / ROTATION_DAYS;
	const double sheet = 0.30 * bb_sin_turns(source + w->shift[0]) + 0.13 * bb_sin_turns(2 * source + w->shift[1]);
	const double slow = bb_bump(w->latitude - sheet, 0.5);
	double torn = 0;

	for (int k = 0; k < 3; k++) {
		const double scale = 1 << k;
		torn += bb_noise_at(&w->torn[k], left * 0.45 * scale, w->latitude * 4 * scale, source * 14 * scale) /
			scale;
	}
	double v = (2.3 + 4.4 * slow) * streams(w, source, r) * (1 + 0.16 * torn);
	for (int k = 0; k < 2; k++)
		v *= ejected(&w->cone[k], r);
	return v / (1 + v / 40); /* no density is without end */
}

void bb_enlil_row(const struct bb_generated *g, uint32_t step, uint32_t z, uint32_t y, uint32_t x, uint32_t n,
		  double *out)
{
	struct row w = { .latitude = THETA_FROM + (y + 0.5) / g->dim[1] * (THETA_TO - THETA_FROM) - TURN / 4,
			 .turns = (z + 0.5) / g->dim[2],
			 .phase = bb_generated_phase(g, step) };

	w.latitude = -w.latitude; /* theta begins at the north pole */
	for (uint32_t k = 0; k < 3; k++) {
		w.shift[k] = bb_noise_number(g->seed, k);
		w.torn[k] = bb_noise_make(g->seed, k, 14 << k, 0);
	}
	for (uint32_t k = 0; k < 2; k++)
		w.cone[k] = cone_of(g, &w, k);
	for (uint32_t i = 0; i < n; i++)
		out[i] = value_at(&w, R_FROM + (x + i + 0.5) / g->dim[0] * (R_TO - R_FROM));
}
