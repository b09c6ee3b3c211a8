#include "render/volume/noise.h"

static uint32_t scramble(uint32_t h)
{
	h = (h ^ h >> 15) * 0x2C1B3C6Du;
	h = (h ^ h >> 12) * 0x297A2D39u;
	return h ^ h >> 15;
}

static double lattice(const struct bb_noise *n, int32_t x, int32_t y, int32_t z, int32_t time)
{
	const uint32_t h = (uint32_t)x * 0x8DA6B343u ^ (uint32_t)y * 0xD8163841u ^ (uint32_t)z * 0xCB1AB31Fu ^
			   (uint32_t)time * 0x165667B1u ^ n->seed;

	return (double)scramble(h) / 4294967295.0;
}

double bb_noise_number(uint32_t seed, uint32_t k)
{
	return (double)scramble(scramble(seed ^ 0x9E3779B9u) + k * 0x85EBCA77u) / 4294967295.0;
}

struct bb_noise bb_noise_make(uint32_t seed, uint32_t which, int32_t around, double time)
{
	const int32_t before = bb_floor(time);

	return (struct bb_noise){ .seed = scramble(scramble(seed) + which * 0x9E3779B1u),
				  .around = around,
				  .time = before,
				  .part = bb_smooth(time - before) };
}

static void enter(struct bb_noise *n, int32_t x, int32_t y, int32_t z)
{
	for (int k = 0; k < 8; k++) {
		int32_t cz = z + (k >> 2);
		if (n->around) {
			cz %= n->around;
			cz += cz < 0 ? n->around : 0;
		}
		const int32_t cx = x + (k & 1), cy = y + (k >> 1 & 1);
		n->corner[k] = bb_mix(lattice(n, cx, cy, cz, n->time), lattice(n, cx, cy, cz, n->time + 1), n->part);
	}
	n->x = x;
	n->y = y;
	n->z = z;
	n->known = true;
}

double bb_noise_at(struct bb_noise *n, double x, double y, double z)
{
	const int32_t ix = bb_floor(x), iy = bb_floor(y), iz = bb_floor(z);
	const double tx = bb_smooth(x - ix), ty = bb_smooth(y - iy), tz = bb_smooth(z - iz);
	const double *c = n->corner;

	if (!n->known || ix != n->x || iy != n->y || iz != n->z)
		enter(n, ix, iy, iz);
	const double low = bb_mix(bb_mix(c[0], c[1], tx), bb_mix(c[2], c[3], tx), ty);
	const double high = bb_mix(bb_mix(c[4], c[5], tx), bb_mix(c[6], c[7], tx), ty);
	return 2 * bb_mix(low, high, tz) - 1;
}
