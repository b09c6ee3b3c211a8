/*
 * render/volume/cme.c: a volume that looks like a coronal mass ejection: a bright core and three torn shells that leave
 * it towards one side, growing and fading. Only + - * / sqrt and integer hashes are used, which IEEE 754 defines to
 * the last bit, so every machine makes the same bytes.
 */
#include "render/volume/volume_private.h"

#include <math.h>

#define CME_EDGE_MOST 1024 /* as bb_volume_generate refuses more */

struct point {
	double x, y, z;
};

static const struct point towards = { 0.6, 0.64, 0.48 }; /* where it flies; a unit vector */

static uint32_t hash(int32_t x, int32_t y, int32_t z)
{
	uint32_t h = (uint32_t)x * 0x8DA6B343u ^ (uint32_t)y * 0xD8163841u ^ (uint32_t)z * 0xCB1AB31Fu;

	h = (h ^ h >> 15) * 0x2C1B3C6Du;
	h = (h ^ h >> 12) * 0x297A2D39u;
	return h ^ h >> 15;
}

static double lattice(int32_t x, int32_t y, int32_t z)
{
	return (double)hash(x, y, z) / 4294967295.0;
}

static double smooth(double t)
{
	return t * t * (3 - 2 * t);
}

static double mix(double a, double b, double t)
{
	return a + (b - a) * t;
}

/* Value noise in 0..1 with a period of one unit. */
static double noise(struct point p)
{
	const double fx = floor(p.x), fy = floor(p.y), fz = floor(p.z);
	const int32_t x = (int32_t)fx, y = (int32_t)fy, z = (int32_t)fz;
	const double tx = smooth(p.x - fx), ty = smooth(p.y - fy), tz = smooth(p.z - fz);
	double plane[2];

	for (int k = 0; k < 2; k++) {
		const double a = mix(lattice(x, y, z + k), lattice(x + 1, y, z + k), tx);
		const double b = mix(lattice(x, y + 1, z + k), lattice(x + 1, y + 1, z + k), tx);
		plane[k] = mix(a, b, ty);
	}
	return mix(plane[0], plane[1], tz);
}

/* 1 in the middle, 0 from `width` on, smooth at both. */
static double bump(double distance, double width)
{
	const double u = distance / width;
	const double v = 1 - u * u;

	return v > 0 ? v * v : 0;
}

/* One shell of the three at phase 0..1 of the flight. */
static double shell(int k, double r, double phase)
{
	const double radius = 0.30 - 0.07 * k + (0.62 - 0.14 * k) * phase;
	const double width = 0.07 + 0.05 * phase;

	return bump(r - radius, width) * (1 - 0.15 * k) * (1 - 0.4 * phase);
}

static double value_at(struct point p, double phase)
{
	const double r = sqrt(p.x * p.x + p.y * p.y + p.z * p.z);
	const double along = r > 0 ? (p.x * towards.x + p.y * towards.y + p.z * towards.z) / r : 0;
	const double side = along > -0.6 ? (along + 0.6) / 1.6 : 0; /* the far side stays dark */
	const double core = bump(r, 0.24 - 0.04 * phase);

	if (r > 1.05)
		return 0;
	/* The noise flies with the shells. */
	const double out = r > 0 ? phase * 0.62 / r : 0;
	const struct point q = { p.x * (1 - 0.5 * out) * 5 + 17, p.y * (1 - 0.5 * out) * 5 + 31,
				 p.z * (1 - 0.5 * out) * 5 + 47 };
	const struct point fine = { q.x * 2.5, q.y * 2.5, q.z * 2.5 };
	const double torn = 0.65 * noise(q) + 0.35 * noise(fine);
	double clear = 1 - core; /* how much of the background still shows */

	for (int k = 0; k < 3; k++)
		clear *= 1 - shell(k, r, phase) * smooth(side) * (0.3 + 0.7 * smooth(torn));
	clear *= 1 - 0.12 * torn * bump(r, 1.0); /* haze */
	return 1 - clear;
}

void bb_cme_row(const uint32_t dim[3], uint32_t n_steps, uint32_t step, uint32_t z, uint32_t y, uint32_t x, uint32_t n,
		double *out)
{
	const double phase = n_steps > 1 ? (double)step / ((double)n_steps - 1) : 0;
	double middle[3], half[3];

	for (int a = 0; a < 3; a++) {
		half[a] = (double)dim[a] / 2;
		middle[a] = ((double)dim[a] - 1) / 2;
	}
	const double py = ((double)y - middle[1]) / half[1], pz = ((double)z - middle[2]) / half[2];
	for (uint32_t i = 0; i < n; i++)
		out[i] = value_at((struct point){ ((double)(x + i) - middle[0]) / half[0], py, pz }, phase);
}

void bb_volume_fill_cme(struct bb_volume *v)
{
	uint16_t *out = v->voxels;
	double row[CME_EDGE_MOST];

	v->least = 0;
	v->most = 1;
	for (uint32_t s = 0; s < v->n_steps; s++)
		for (uint32_t z = 0; z < v->dim[2]; z++)
			for (uint32_t y = 0; y < v->dim[1]; y++) {
				bb_cme_row(v->dim, v->n_steps, s, z, y, 0, v->dim[0], row);
				for (uint32_t x = 0; x < v->dim[0]; x++)
					*out++ = (uint16_t)(row[x] * 65535 + 0.5);
			}
}
