/*
 * render/cpu/cast_kernel.h: the ray caster's inner loops, included by cast_portable.c, cast_avx2.c and cast_avx512.c,
 * which define before: KERNEL(name), WIDTH, and for vectors of that many lanes vi gather32(const void *base, vi
 * byte_offset)   32 bits each void gather64(const uint64_t *table, vi index, vi *low, vi *high) bool any(vi mask)
 *
 * A packet of rays goes through the volume brick by brick: all rays that are in the brick of the first ray that is not
 * done take their samples in it together, at whole sample numbers as rays.c says, so that what a brick is (empty,
 * resident, coarse) decides which memory is read and never where. Two voxels along x are one gather of 32 bits.
 */
#include "render/cpu/cast.h"

#include <math.h>
#include <string.h>

#define STORED BB_BRICK_STORED
#define EDGE 16.0F
#define OPAQUE (1.0F / 8192)

typedef float vf __attribute__((vector_size(4 * WIDTH)));

struct lanes {                              /* of a packet, WIDTH rays */
	vf first[3], stride[3], inverse[3]; /* inverse: 1 / stride */
	vi i, n;                            /* the next sample; how many there are */
	vf sum[4];                          /* premultiplied */
};

static inline vf lane_float(vi v)
{
	return __builtin_convertvector(v, vf);
}

static inline vi lane_int(vf v) /* towards zero */
{
	return __builtin_convertvector(v, vi);
}

static inline vf pick(vi mask, vf yes, vf no)
{
	return (vf)((mask & (vi)yes) | (~mask & (vi)no));
}

static inline vi pick_int(vi mask, vi yes, vi no)
{
	return (mask & yes) | (~mask & no);
}

static inline vf least(vf a, vf b)
{
	return pick(a < b, a, b);
}

static inline vf greatest(vf a, vf b)
{
	return pick(a > b, a, b);
}

static inline vf all(float v)
{
	return (vf){ 0 } + v;
}

/* Eight voxels around p in a block of u16 with rows of nx and planes of nx * ny; the result in 0 .. 65535. */
static inline vf trilinear(const uint16_t *block, const vf p[3], int nx, int nxy)
{
	const vi x = lane_int(p[0]), y = lane_int(p[1]), z = lane_int(p[2]);
	const vf fx = p[0] - lane_float(x), fy = p[1] - lane_float(y), fz = p[2] - lane_float(z);
	const vi at = ((z * nxy) + (y * nx) + x) * 2;
	vf row[4];

	for (int k = 0; k < 4; k++) {
		const vi pair = gather32(block + (k & 1 ? nx : 0) + (k & 2 ? nxy : 0), at);
		const vf a = lane_float(pair & 0xFFFF), b = lane_float((vi)((vu)pair >> 16));
		row[k] = a + (b - a) * fx;
	}
	row[0] += (row[1] - row[0]) * fy;
	row[2] += (row[3] - row[2]) * fy;
	return row[0] + (row[2] - row[0]) * fz;
}

struct brick {
	uint32_t at[3], index;
};

static inline vf value_in(const struct bb_cast *c, const struct brick *b, int step, const vf at[3])
{
	const int32_t slot = c->step[step].slot[b->index];
	vf p[3];

	if (slot >= 0) {
		for (int a = 0; a < 3; a++) { /* a voxel of border lies before the brick's first */
			const float from = EDGE * (float)b->at[a] - 1;
			p[a] = at[a] - from;
		}
		return trilinear(c->bricks + (size_t)slot * STORED * STORED * STORED, p, STORED, STORED * STORED);
	}
	for (int a = 0; a < 3; a++) { /* a coarse voxel is the mean of 4: its centre lies at 4 i + 1.5 */
		const vf q = (at[a] - (BB_COARSE_FACTOR - 1) / 2.0F) * (1.0F / BB_COARSE_FACTOR);
		p[a] = least(greatest(q, all(0)), all(c->coarse_most[a]));
	}
	return trilinear(c->step[step].coarse, p, (int)c->coarse_dim[0], (int)(c->coarse_dim[0] * c->coarse_dim[1]));
}

/* Samples i .. end - 1 of the lanes, all in one brick. */
static inline vi walk(const struct bb_cast *c, const struct brick *b, struct lanes *l, vi end)
{
	vf low[3], high[3];
	vi taken = { 0 };

	for (int a = 0; a < 3; a++) {
		low[a] = all(EDGE * (float)b->at[a]);
		high[a] = least(low[a] + EDGE, all(c->most[a]));
	}
	for (vi on = l->i < end; any(on); on = l->i < end) {
		vf at[3];
		vi rg, ba;
		for (int a = 0; a < 3; a++)
			at[a] = least(greatest(l->first[a] + lane_float(l->i) * l->stride[a], low[a]), high[a]);
		vf v = value_in(c, b, 0, at);
		if (c->n_steps == 2)
			v += (value_in(c, b, 1, at) - v) * c->mix;
		gather64(c->table, lane_int(v * ((BB_CAST_TABLE - 1) / 65535.0F) + 0.5F), &rg, &ba);
		/* A half whose bits stand where a float has its own is that float / 2^112. */
		const vf weight = (vf)((vi)((1 - l->sum[3]) * (0x1p112F / BB_CAST_SCALE)) & on);
		l->sum[0] += weight * (vf)((vu)(rg & 0xFFFF) << 13);
		l->sum[1] += weight * (vf)((vu)rg >> 16 << 13);
		l->sum[2] += weight * (vf)((vu)(ba & 0xFFFF) << 13);
		l->sum[3] += weight * (vf)((vu)ba >> 16 << 13);
		taken -= on;
		l->i -= on;
	}
	return taken;
}

/* Where the lanes' next samples lie, in bricks. */
static inline void bricks_of(const struct bb_cast *c, const struct lanes *l, vi at[3])
{
	for (int a = 0; a < 3; a++) {
		const vf p = l->first[a] + lane_float(l->i) * l->stride[a];
		at[a] = lane_int(least(greatest(p, all(0)), all(c->most[a])) * (1 / EDGE));
		at[a] = pick_int(at[a] < (int)c->grid[a], at[a], (vi){ 0 } + ((int)c->grid[a] - 1));
	}
}

/* The first sample beyond brick b, per lane. The outermost bricks reach out to the box's own sides. */
static inline vi end_of(const struct bb_cast *c, const struct lanes *l, const struct brick *b)
{
	vf last = all(1e9F);

	for (int a = 0; a < 3; a++) {
		const bool first = b->at[a] == 0, outermost = b->at[a] + 1 == c->grid[a];
		const float low = first ? -EDGE : EDGE * (float)b->at[a];
		const float high = EDGE * (float)(b->at[a] + 1 + outermost);
		const vi ahead = l->stride[a] > 0;
		last = least(last, (pick(ahead, all(high), all(low)) - l->first[a]) * l->inverse[a]);
	}
	const vi whole = lane_int(last), up = whole - (lane_float(whole) < last);
	const vi next = l->i + 1, end = pick_int(up > next, up, next);
	return pick_int(end < l->n, end, l->n);
}

static uint64_t draw_lanes(const struct bb_cast *c, struct lanes *l)
{
	vi samples = { 0 };
	uint64_t sum = 0;

	for (vi active = l->i < l->n; any(active); active = l->i < l->n) {
		vi at[3];
		int lead = 0;
		bricks_of(c, l, at);
		while (!active[lead])
			lead++;
		struct brick b = { .at = { (uint32_t)at[0][lead], (uint32_t)at[1][lead], (uint32_t)at[2][lead] } };
		b.index = (b.at[2] * c->grid[1] + b.at[1]) * c->grid[0] + b.at[0];
		const vi here = active & (at[0] == at[0][lead]) & (at[1] == at[1][lead]) & (at[2] == at[2][lead]);
		const vi end = pick_int(here, end_of(c, l, &b), l->i);
		if (c->empty[b.index])
			l->i = end;
		else
			samples += walk(c, &b, l, end);
		l->i = pick_int(l->sum[3] > 1 - OPAQUE, l->n, l->i);
	}
	for (int k = 0; k < WIDTH; k++)
		sum += (uint64_t)(uint32_t)samples[k];
	return sum;
}

static inline void set_ray(struct lanes *l, int k, const struct bb_ray *r)
{
	const double first[3] = { r->first.x, r->first.y, r->first.z },
		     stride[3] = { r->stride.x, r->stride.y, r->stride.z };

	for (int a = 0; a < 3; a++) {
		const double s = fabs(stride[a]) < 1e-9 ? 1e-9 : stride[a];
		l->first[a][k] = (float)first[a];
		l->stride[a][k] = (float)s;
		l->inverse[a][k] = (float)(1 / s);
	}
	l->n[k] = (int)r->n;
}

static inline uint8_t level(float v)
{
	return (uint8_t)(v < 1 ? v * 255 + 0.5F : 255);
}

void KERNEL(const struct bb_cast *c, uint32_t row, struct bb_cast_counts *counts)
{
	const uint32_t width = c->image->width, height = c->image->height;

	for (uint32_t x0 = 0; x0 < width; x0 += BB_CAST_SIDE)
		for (int part = 0; part < BB_CAST_PACKET / WIDTH; part++) {
			struct lanes l;
			memset(&l, 0, sizeof(l));
			for (int k = 0; k < WIDTH; k++) {
				const uint32_t pixel = (uint32_t)(part * WIDTH + k), x = x0 + pixel % BB_CAST_SIDE;
				const uint32_t y = row * BB_CAST_SIDE + pixel / BB_CAST_SIDE;
				if (x >= width || y >= height)
					continue;
				const struct bb_ray ray = bb_rays_at(c->rays, x, y);
				set_ray(&l, k, &ray);
				counts->rays += ray.n > 0;
			}
			counts->samples += draw_lanes(c, &l);
			for (int k = 0; k < WIDTH; k++) {
				const uint32_t pixel = (uint32_t)(part * WIDTH + k), x = x0 + pixel % BB_CAST_SIDE;
				const uint32_t y = row * BB_CAST_SIDE + pixel / BB_CAST_SIDE;
				if (x >= width || y >= height)
					continue;
				uint8_t *px = c->image->rgba + ((size_t)y * width + x) * 4;
				for (int a = 0; a < 4; a++)
					px[a] = level(l.sum[a][k]);
			}
		}
}
