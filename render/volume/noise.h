/*
 * render/volume/noise.h: what the generated volumes are made of. Only + - * / sqrt, conversions and integer hashes are
 * used, which IEEE 754 defines to the last bit, so every machine makes the same bytes (with -ffp-contract=off, as the
 * Makefile has it). Pure functions, but for the cell that a lattice remembers: one lattice per thread.
 */
#ifndef BB_RENDER_VOLUME_NOISE_H
#define BB_RENDER_VOLUME_NOISE_H

#include <stdbool.h>
#include <stdint.h>

/* 3-D value noise of period one that changes over time: between two random lattices, the next one for each unit. */
struct bb_noise {
	uint32_t seed;
	int32_t around; /* z repeats after so many units, as an angle does; 0: never */
	int32_t time;   /* the lattice before now, and how far it is to the next */
	double part;
	bool known; /* corners are those of the cell at x, y, z */
	int32_t x, y, z;
	double corner[8];
};

struct bb_noise bb_noise_make(uint32_t seed, uint32_t which, int32_t around, double time);
/* -1 .. 1, smooth. Walking in small steps is cheap: corners are made once a cell. |x|, |y|, |z| below 2^31. */
double bb_noise_at(struct bb_noise *n, double x, double y, double z);
/* A number in 0 .. 1 for each k of a seed. */
double bb_noise_number(uint32_t seed, uint32_t k);

static inline int32_t bb_floor(double v)
{
	const int32_t i = (int32_t)v;

	return i - (v < i);
}

static inline double bb_clamp01(double v)
{
	return v > 0 ? (v < 1 ? v : 1) : 0;
}

/* 0 from 0 on down, 1 from 1 on up. */
static inline double bb_smooth(double t)
{
	const double c = bb_clamp01(t);

	return c * c * (3 - 2 * c);
}

static inline double bb_mix(double a, double b, double t)
{
	return a + (b - a) * t;
}

/* 1 in the middle, 0 from `width` on, smooth at both. */
static inline double bb_bump(double distance, double width)
{
	const double u = distance / width;
	const double v = 1 - u * u;

	return v > 0 ? v * v : 0;
}

/* Sine of an angle in turns, to 6e-8. */
static inline double bb_sin_turns(double turns)
{
	double t = turns - bb_floor(turns + 0.5);

	t = t > 0.25 ? 0.5 - t : t < -0.25 ? -0.5 - t : t;
	const double a = t * 6.283185307179586, s = a * a;
	return a * (1 + s * (-1.0 / 6 + s * (1.0 / 120 + s * (-1.0 / 5040 + s * (1.0 / 362880 - s / 39916800)))));
}

static inline double bb_cos_turns(double turns)
{
	return bb_sin_turns(turns + 0.25);
}

#endif
