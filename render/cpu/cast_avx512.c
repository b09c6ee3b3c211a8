/* render/cpu/cast_avx512.c: the ray caster for processors with AVX-512 F, DQ and VL (see the Makefile for its flags).
 */
#ifdef __AVX512F__
#include <immintrin.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define WIDTH 16
#define KERNEL bb_cast_tile_avx512
#define KEEP __attribute__((always_inline))
#define NOT_INLINE __attribute__((noinline))

typedef float vf __attribute__((vector_size(4 * WIDTH)));
typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));
typedef __mmask16 vm;

static inline vf all(float v)
{
	return (vf)_mm512_set1_ps(v);
}

static inline vf to_float(vi v)
{
	return (vf)_mm512_cvtepi32_ps((__m512i)v);
}

static inline vi to_int(vf v)
{
	return (vi)_mm512_cvttps_epi32((__m512)v);
}

static inline vf truncated(vf v)
{
	return (vf)_mm512_roundscale_ps((__m512)v, _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC);
}

static inline vf fused(vf a, vf b, vf c)
{
	return (vf)_mm512_fmadd_ps((__m512)a, (__m512)b, (__m512)c);
}

static inline vf pick(vm mask, vf yes, vf no)
{
	return (vf)_mm512_mask_blend_ps(mask, (__m512)no, (__m512)yes);
}

static inline vi pick_int(vm mask, vi yes, vi no)
{
	return (vi)_mm512_mask_blend_epi32(mask, (__m512i)no, (__m512i)yes);
}

static inline vm less(vf a, vf b)
{
	return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_LT_OQ);
}

static inline vm not_less(vf a, vf b)
{
	return _mm512_cmp_ps_mask((__m512)a, (__m512)b, _CMP_GE_OQ);
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
	return (vf)_mm512_min_ps((__m512)a, (__m512)b);
}

static inline vf greatest(vf a, vf b)
{
	return (vf)_mm512_max_ps((__m512)a, (__m512)b);
}

static inline vf rounded_up(vf v)
{
	return (vf)_mm512_roundscale_ps((__m512)v, _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC);
}

static inline unsigned bits(vm mask)
{
	return mask & 15U;
}

static inline unsigned all_bits(vm mask)
{
	return mask;
}

static inline bool any(vm mask)
{
	return mask != 0;
}

static inline unsigned count(vm mask)
{
	return (unsigned)__builtin_popcount(mask);
}

static inline vm ray_mask(int ray)
{
	return (vm)(0x1111U << ray);
}

static inline vf load(const float *from)
{
	return (vf)_mm512_loadu_ps(from);
}

static inline void store(float *to, vf v)
{
	_mm512_storeu_ps(to, (__m512)v);
}

static inline vf four(const float *from)
{
	return (vf)_mm512_broadcast_f32x4(_mm_loadu_ps(from));
}

static inline void store_four(float *to, vf v)
{
	_mm_storeu_ps(to, _mm512_castps512_ps128((__m512)v));
}

static inline void add_four(float *to, vf v)
{
	const __m256 half = _mm256_add_ps(_mm512_castps512_ps256((__m512)v), _mm512_extractf32x8_ps((__m512)v, 1));
	const __m128 sum = _mm_add_ps(_mm256_castps256_ps128(half), _mm256_extractf128_ps(half, 1));

	_mm_storeu_ps(to, _mm_add_ps(_mm_loadu_ps(to), sum));
}

static inline float least_of(vf v)
{
	const __m128 a = _mm512_castps512_ps128((__m512)v), b = _mm_min_ps(a, _mm_movehl_ps(a, a));

	return _mm_cvtss_f32(_mm_min_ss(b, _mm_movehdup_ps(b)));
}

static inline float most_of(vf v)
{
	const __m128 a = _mm512_castps512_ps128((__m512)v), b = _mm_max_ps(a, _mm_movehl_ps(a, a));

	return _mm_cvtss_f32(_mm_max_ss(b, _mm_movehdup_ps(b)));
}

static inline vf deep(void)
{
	return (vf){ 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3 };
}

static inline vf only_first(vf v)
{
	return (vf)_mm512_maskz_mov_ps(15, (__m512)v);
}

static inline vf before(vf clear)
{
	const __m512 one = _mm512_set1_ps(1), v = (__m512)clear;
	const __m512 by_one = _mm512_mask_shuffle_f32x4(one, 0xFFF0, v, v, _MM_SHUFFLE(2, 1, 0, 0));
	const __m512 by_two = _mm512_mask_shuffle_f32x4(one, 0xFFF0, by_one, by_one, _MM_SHUFFLE(2, 1, 0, 0));
	const __m512 by_three = _mm512_mask_shuffle_f32x4(one, 0xF000, v, v, _MM_SHUFFLE(0, 0, 0, 0));

	return (vf)_mm512_mul_ps(_mm512_mul_ps(by_one, by_two), by_three);
}

static inline vf product(vf clear)
{
	const __m512 v = (__m512)clear;
	const __m512 pairs = _mm512_mul_ps(v, _mm512_shuffle_f32x4(v, v, _MM_SHUFFLE(2, 3, 0, 1)));

	return (vf)_mm512_mul_ps(pairs, _mm512_shuffle_f32x4(pairs, pairs, _MM_SHUFFLE(1, 0, 3, 2)));
}

static inline vi gather32(const uint8_t *base, vi byte_offset)
{
	return (vi)_mm512_i32gather_epi32((__m512i)byte_offset, base, 1);
}

static inline void deinterleave(__m512i a, __m512i b, vi *low, vi *high)
{
	const __m512i even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
	const __m512i odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);

	*low = (vi)_mm512_permutex2var_epi32(a, even, b);
	*high = (vi)_mm512_permutex2var_epi32(a, odd, b);
}

static inline void gather64(const uint64_t *table, vi index, vi *low, vi *high)
{
	deinterleave(_mm512_i32gather_epi64(_mm512_castsi512_si256((__m512i)index), table, 8),
		     _mm512_i32gather_epi64(_mm512_extracti64x4_epi64((__m512i)index, 1), table, 8), low, high);
}

static inline void gather64_4(const uint8_t *base, vi index, vi *low, vi *high)
{
	deinterleave(_mm512_i32gather_epi64(_mm512_castsi512_si256((__m512i)index), base, 4),
		     _mm512_i32gather_epi64(_mm512_extracti64x4_epi64((__m512i)index, 1), base, 4), low, high);
}

#define PIECES true

static inline vf only(vm mask, vf v) /* 0 in the others */
{
	return (vf)_mm512_maskz_mov_ps(mask, (__m512)v);
}

static inline vf pick_piece(const float *piece, vi index) /* of 32, aligned; index % 32 */
{
	return (vf)_mm512_permutex2var_ps(_mm512_load_ps(piece), (__m512i)index, _mm512_load_ps(piece + 16));
}

#define BOX 1

/* Four rows of four values. */
static inline __m512 plane_f32(const float *at, size_t row)
{
	const __m512 a = _mm512_castps128_ps512(_mm_loadu_ps(at));
	const __m512 b = _mm512_insertf32x4(a, _mm_loadu_ps(at + row), 1);
	const __m512 c = _mm512_insertf32x4(b, _mm_loadu_ps(at + 2 * row), 2);

	return _mm512_insertf32x4(c, _mm_loadu_ps(at + 3 * row), 3);
}

struct box { /* 4^3 values; those of an on lane's cell begin at most two behind the first, on each axis */
	__m512 plane[4];
	int first; /* of its own numbers, x + 4 y + 16 z in the brick */
};

static inline __attribute__((always_inline)) struct box box_at(const uint8_t *brick, __m128 low, uint32_t stored)
{
	const __m128i most = _mm_set1_epi32((int)stored - 4);
	const __m128i from = _mm_max_epi32(_mm_min_epi32(_mm_cvttps_epi32(low), most), _mm_setzero_si128());
	const uint32_t x = (uint32_t)_mm_cvtsi128_si32(from), y = (uint32_t)_mm_extract_epi32(from, 1);
	const uint32_t z = (uint32_t)_mm_extract_epi32(from, 2);
	const size_t row = stored, plane = (size_t)stored * stored;
	const float *f = (const float *)(const void *)brick + z * plane + y * row + x;

	return (struct box){ { plane_f32(f, row), plane_f32(f + plane, row), plane_f32(f + 2 * plane, row),
			       plane_f32(f + 3 * plane, row) },
			     (int)(z * 16 + y * 4 + x) };
}

/* Two times four corners, of cells whose numbers in the brick are `in`. */
static inline __attribute__((always_inline)) void look_up(const struct box *b, __m512i in, __m512 corner[8])
{
	const __m512i first = _mm512_sub_epi32(in, _mm512_set1_epi32(b->first));
	const __mmask16 third = _mm512_test_epi32_mask(first, _mm512_set1_epi32(32));
	static const int to[4] = { 0, 1, 4, 5 };

	for (int k = 0; k < 4; k++) {
		const __m512i i = _mm512_add_epi32(first, _mm512_set1_epi32(to[k]));
		const __m512 front = _mm512_permutex2var_ps(b->plane[0], i, b->plane[1]);
		const __m512 back = _mm512_permutex2var_ps(b->plane[1], i, b->plane[2]);
		corner[k] = _mm512_mask_permutexvar_ps(front, third, i, b->plane[2]);
		corner[k + 4] = _mm512_mask_permutexvar_ps(back, third, i, b->plane[3]);
	}
}

/* Two boxes: the lanes' second half lies too far ahead and has one of its own. */
static inline __attribute__((always_inline)) void boxes_at(unsigned boxes, const uint8_t *brick, const float low[4],
							   const float along[4], float at, float each, uint32_t stored,
							   struct box out[2])
{
	const __m128 by = _mm_loadu_ps(along);
	/* The least of the first and the last of a ray's lanes. */
	const __m128 p = _mm_fmadd_ps(_mm_set1_ps(at), by, _mm_loadu_ps(low));
	const __m128 back = _mm_min_ps(_mm_setzero_ps(), _mm_mul_ps(by, _mm_set1_ps(each * (boxes == 1 ? 3 : 1))));
	const __m128 from = _mm_add_ps(p, back);

	out[0] = box_at(brick, from, stored);
	if (boxes == 2)
		out[1] = box_at(brick, _mm_fmadd_ps(_mm_set1_ps(2 * each), by, from), stored);
}

/*
 * The corners of all lanes' cells out of 4^3 voxels in four registers: a few loads, and permutations, which are many
 * times as fast as gathers.
 */
static inline __attribute__((always_inline)) void box_corners(unsigned boxes, const struct box box[2],
							      const vf whole[3], vf corner[8])
{
	const __m512i in = (__m512i)to_int(fused(whole[2], all(16), fused(whole[1], all(4), whole[0])));
	__m512 out[8], ahead[8];

	look_up(&box[0], in, out);
	if (boxes == 2)
		look_up(&box[1], in, ahead);
	for (int k = 0; k < 8; k++)
		corner[k] = (vf)(boxes == 2 ? _mm512_mask_blend_ps(0xFF00, out[k], ahead[k]) : out[k]);
}

static inline unsigned floats_begin(void)
{
	const unsigned state = _mm_getcsr();

	_mm_setcsr(state | 0x8040); /* flush to zero, denormals are zero */
	return state;
}

static inline void floats_end(unsigned state)
{
	_mm_setcsr(state);
}

#include "render/cpu/cast_kernel.inc"
#else
#include "render/cpu/cast.h"

void bb_cast_tile_avx512(const struct bb_cast *c, uint32_t tile, struct bb_cast_counts *counts)
{
	bb_cast_tile_portable(c, tile, counts);
}
#endif
