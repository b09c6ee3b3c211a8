/* render/cpu/cast_portable.c: the ray caster in C alone; the other kernels' vectors can do the same, wider. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define WIDTH 4
#define KERNEL bb_cast_tile_portable
#define KEEP __attribute__((always_inline))
#define NOT_INLINE __attribute__((noinline))

typedef float vf __attribute__((vector_size(4 * WIDTH)));
typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));
typedef vi vm; /* a truth for each lane */

static inline vf all(float v)
{
	return (vf){ 0 } + v;
}

static inline vf to_float(vi v)
{
	return __builtin_convertvector(v, vf);
}

static inline vi to_int(vf v) /* towards zero; what does not fit becomes anything */
{
	vi out = { 0 };

	for (int k = 0; k < WIDTH; k++)
		out[k] = v[k] > -2e9F && v[k] < 2e9F ? (int32_t)v[k] : 0;
	return out;
}

static inline vf truncated(vf v)
{
	return to_float(to_int(v));
}

static inline vf fused(vf a, vf b, vf c) /* a * b + c, rounded once or twice */
{
	return a * b + c;
}

static inline vf pick(vm mask, vf yes, vf no)
{
	return (vf)((mask & (vi)yes) | (~mask & (vi)no));
}

static inline vi pick_int(vm mask, vi yes, vi no)
{
	return (mask & yes) | (~mask & no);
}

static inline vm less(vf a, vf b)
{
	return a < b;
}

static inline vm not_less(vf a, vf b)
{
	return a >= b;
}

static inline vm both(vm a, vm b)
{
	return a & b;
}

static inline vm either(vm a, vm b)
{
	return a | b;
}

static inline vf least(vf a, vf b)
{
	return pick(a < b, a, b);
}

static inline vf greatest(vf a, vf b)
{
	return pick(a > b, a, b);
}

static inline vf rounded_up(vf v) /* of numbers below 2^31; larger ones stay as they are */
{
	const vf down = truncated(v);

	return pick(v < 2e9F, pick(down < v, down + 1, down), v);
}

static inline unsigned bits(vm mask) /* of the first four lanes */
{
	unsigned out = 0;

	for (int k = 0; k < 4; k++)
		out |= mask[k] ? 1U << k : 0;
	return out;
}

static inline unsigned all_bits(vm mask)
{
	return bits(mask);
}

static inline bool any(vm mask)
{
	return bits(mask) != 0;
}

static inline unsigned count(vm mask)
{
	return (unsigned)__builtin_popcount(bits(mask));
}

static inline vm ray_mask(int ray) /* all lanes of a ray */
{
	vm out = { 0 };

	out[ray] = -1;
	return out;
}

static inline vf load(const float *from)
{
	vf out;

	memcpy(&out, from, sizeof(out));
	return out;
}

static inline void store(float *to, vf v)
{
	memcpy(to, &v, sizeof(v));
}

static inline vf four(const float *from) /* of a packet, in all of its lanes */
{
	return load(from);
}

static inline void store_four(float *to, vf v) /* the first ones */
{
	store(to, v);
}

static inline void add_four(float *to, vf v) /* of all of a ray's lanes */
{
	store(to, load(to) + v);
}

static inline float least_of(vf v) /* of the first four lanes */
{
	const float a = v[0] < v[1] ? v[0] : v[1], b = v[2] < v[3] ? v[2] : v[3];

	return a < b ? a : b;
}

static inline float most_of(vf v)
{
	const float a = v[0] > v[1] ? v[0] : v[1], b = v[2] > v[3] ? v[2] : v[3];

	return a > b ? a : b;
}

static inline vf deep(void) /* which of its ray's samples a lane takes */
{
	return (vf){ 0 };
}

static inline vf only_first(vf v) /* of a ray's lanes; 0 in the others */
{
	return v;
}

static inline vf before(vf clear) /* product over the ray's lanes in front of each */
{
	(void)clear;
	return all(1);
}

static inline vf product(vf clear) /* over all of a ray's lanes */
{
	return clear;
}

static inline vi gather32(const uint8_t *base, vi byte_offset)
{
	vi out = { 0 };

	for (int k = 0; k < WIDTH; k++) {
		int32_t v;
		memcpy(&v, base + byte_offset[k], sizeof(v));
		out[k] = v;
	}
	return out;
}

/* 64 bits each, `index` of them behind the base. */
static inline void gather64(const uint64_t *table, vi index, vi *low, vi *high)
{
	for (int k = 0; k < WIDTH; k++) {
		(*low)[k] = (int32_t)(uint32_t)table[index[k]];
		(*high)[k] = (int32_t)(uint32_t)(table[index[k]] >> 32);
	}
}

/* 64 bits each, 4 * index bytes behind the base. */
static inline void gather64_4(const uint8_t *base, vi index, vi *low, vi *high)
{
	for (int k = 0; k < WIDTH; k++) {
		int32_t v[2];
		memcpy(v, base + (ptrdiff_t)index[k] * 4, sizeof(v));
		(*low)[k] = v[0];
		(*high)[k] = v[1];
	}
}

#include "render/cpu/cast_gathers.inc"

static inline unsigned floats_begin(void) /* denormals become zero, where that can be said */
{
	return 0;
}

static inline void floats_end(unsigned state)
{
	(void)state;
}

#include "render/cpu/cast_kernel.inc"
