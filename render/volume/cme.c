/*
 * render/volume/cme.c: a volume that looks like a coronal mass ejection: a bright core and three torn shells that leave
 * it towards one side, growing and fading. Only + - * / sqrt and integer hashes are used, which IEEE 754 defines to
 * the last bit, so every machine makes the same bytes.
 */
#include "render/volume/noise.h"
#include "render/volume/volume_private.h"

#include <math.h>

#define CME_EDGE_MOST 1024 /* as bb_volume_generate refuses more */

struct point {
	double x, y, z;
};

static const struct point towards = { 0.6, 0.64, 0.48 }; /* where it flies; a unit vector */

static uint32_t hash(uint32_t seed, int32_t x, int32_t y, int32_t z)
{
	uint32_t h = (uint32_t)x * 0x8DA6B343u ^ (uint32_t)y * 0xD8163841u ^ (uint32_t)z * 0xCB1AB31Fu ^
		     (seed - 1) * 0x9E3779B1u; /* the first seed is as if there were none */

	h = (h ^ h >> 15) * 0x2C1B3C6Du;
	h = (h ^ h >> 12) * 0x297A2D39u;
	return h ^ h >> 15;
}

static double lattice(uint32_t seed, int32_t x, int32_t y, int32_t z)
{
	return (double)hash(seed, x, y, z) / 4294967295.0;
}

/* Value noise in 0..1 with a period of one unit. */
static double noise(uint32_t seed, struct point p)
{
	const double fx = floor(p.x), fy = floor(p.y), fz = floor(p.z);
	const int32_t x = (int32_t)fx, y = (int32_t)fy, z = (int32_t)fz;
	const double tx = bb_smooth(p.x - fx), ty = bb_smooth(p.y - fy), tz = bb_smooth(p.z - fz);
	double plane[2];

	for (int k = 0; k < 2; k++) {
		const double a = bb_mix(lattice(seed, x, y, z + k), lattice(seed, x + 1, y, z + k), tx);
		const double b = bb_mix(lattice(seed, x, y + 1, z + k), lattice(seed, x + 1, y + 1, z + k), tx);
		plane[k] = bb_mix(a, b, ty);
	}
	return bb_mix(plane[0], plane[1], tz);
}

/* One shell of the three at phase 0..1 of the flight. */
static double shell(int k, double r, double phase)
{
	const double radius = 0.30 - 0.07 * k + (0.62 - 0.14 * k) * phase;
	const double width = 0.07 + 0.05 * phase;

	return bb_bump(r - radius, width) * (1 - 0.15 * k) * (1 - 0.4 * phase);
}

static double value_at(uint32_t seed, struct point p, double phase)
{
	const double r = sqrt(p.x * p.x + p.y * p.y + p.z * p.z);
	const double along = r > 0 ? (p.x * towards.x + p.y * towards.y + p.z * towards.z) / r : 0;
	const double side = along > -0.6 ? (along + 0.6) / 1.6 : 0; /* the far side stays dark */
	const double core = bb_bump(r, 0.24 - 0.04 * phase);

	if (r > 1.05)
		return 0;
	/* The noise flies with the shells. */
	const double out = r > 0 ? phase * 0.62 / r : 0;
	const struct point q = { p.x * (1 - 0.5 * out) * 5 + 17, p.y * (1 - 0.5 * out) * 5 + 31,
				 p.z * (1 - 0.5 * out) * 5 + 47 };
	const struct point fine = { q.x * 2.5, q.y * 2.5, q.z * 2.5 };
	const double torn = 0.65 * noise(seed, q) + 0.35 * noise(seed, fine);
	double clear = 1 - core; /* how much of the background still shows */

	for (int k = 0; k < 3; k++)
		clear *= 1 - shell(k, r, phase) * bb_smooth(side) * (0.3 + 0.7 * bb_smooth(torn));
	clear *= 1 - 0.12 * torn * bb_bump(r, 1.0); /* haze */
	return 1 - clear;
}

void bb_cme_row(const struct bb_generated *g, uint32_t step, uint32_t z, uint32_t y, uint32_t x, uint32_t n,
		double *out)
{
	const double phase = bb_generated_phase(g, step);
	double middle[3], half[3];

	for (int a = 0; a < 3; a++) {
		half[a] = (double)g->dim[a] / 2;
		middle[a] = ((double)g->dim[a] - 1) / 2;
	}
	const double py = ((double)y - middle[1]) / half[1], pz = ((double)z - middle[2]) / half[2];
	for (uint32_t i = 0; i < n; i++)
		out[i] = value_at(g->seed, (struct point){ ((double)(x + i) - middle[0]) / half[0], py, pz }, phase);
}

void bb_volume_fill_cme(struct bb_volume *v)
{
	uint16_t *out = v->voxels;
	const struct bb_generated g = { { v->dim[0], v->dim[1], v->dim[2] }, v->n_steps, 1 };
	double row[CME_EDGE_MOST];

	v->least = 0;
	v->most = 1;
	for (uint32_t s = 0; s < v->n_steps; s++)
		for (uint32_t z = 0; z < v->dim[2]; z++)
			for (uint32_t y = 0; y < v->dim[1]; y++) {
				bb_cme_row(&g, s, z, y, 0, v->dim[0], row);
				for (uint32_t x = 0; x < v->dim[0]; x++)
					*out++ = (uint16_t)(row[x] * 65535 + 0.5);
			}
}
