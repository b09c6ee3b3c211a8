/* render/cpu/cast_avx2.c: the ray caster for processors with AVX2 and FMA (see the Makefile for its flags). */
#ifdef __AVX2__
#include <immintrin.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define WIDTH 8
#define KERNEL bb_cast_tile_avx2
#define KEEP __attribute__((always_inline))
#define NOT_INLINE __attribute__((noinline))

typedef float vf __attribute__((vector_size(4 * WIDTH)));
typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));
typedef __m256 vm; /* a sign for each lane */

static inline vf all(float v)
{
	return (vf)_mm256_set1_ps(v);
}

static inline vf to_float(vi v)
{
	return (vf)_mm256_cvtepi32_ps((__m256i)v);
}

static inline vi to_int(vf v)
{
	return (vi)_mm256_cvttps_epi32((__m256)v);
}

static inline vf truncated(vf v)
{
	return (vf)_mm256_round_ps((__m256)v, _MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC);
}

static inline vf fused(vf a, vf b, vf c)
{
	return (vf)_mm256_fmadd_ps((__m256)a, (__m256)b, (__m256)c);
}

static inline vf pick(vm mask, vf yes, vf no)
{
	return (vf)_mm256_blendv_ps((__m256)no, (__m256)yes, mask);
}

static inline vi pick_int(vm mask, vi yes, vi no)
{
	return (vi)_mm256_blendv_epi8((__m256i)no, (__m256i)yes, _mm256_castps_si256(mask));
}

static inline vm less(vf a, vf b)
{
	return _mm256_cmp_ps((__m256)a, (__m256)b, _CMP_LT_OQ);
}

static inline vm not_less(vf a, vf b)
{
	return _mm256_cmp_ps((__m256)a, (__m256)b, _CMP_GE_OQ);
}

static inline vm both(vm a, vm b)
{
	return _mm256_and_ps(a, b);
}

static inline vm either(vm a, vm b)
{
	return _mm256_or_ps(a, b);
}

static inline vf least(vf a, vf b)
{
	return (vf)_mm256_min_ps((__m256)a, (__m256)b);
}

static inline vf greatest(vf a, vf b)
{
	return (vf)_mm256_max_ps((__m256)a, (__m256)b);
}

static inline vf rounded_up(vf v)
{
	return (vf)_mm256_round_ps((__m256)v, _MM_FROUND_TO_POS_INF | _MM_FROUND_NO_EXC);
}

static inline unsigned bits(vm mask)
{
	return (unsigned)_mm256_movemask_ps(mask) & 15U;
}

static inline unsigned all_bits(vm mask)
{
	return (unsigned)_mm256_movemask_ps(mask);
}

static inline bool any(vm mask)
{
	return _mm256_movemask_ps(mask) != 0;
}

static inline unsigned count(vm mask)
{
	return (unsigned)__builtin_popcount((unsigned)_mm256_movemask_ps(mask));
}

static inline vm ray_mask(int ray)
{
	const __m256i lane = _mm256_setr_epi32(0, 1, 2, 3, 0, 1, 2, 3);

	return _mm256_castsi256_ps(_mm256_cmpeq_epi32(lane, _mm256_set1_epi32(ray)));
}

static inline vf load(const float *from)
{
	return (vf)_mm256_loadu_ps(from);
}

static inline void store(float *to, vf v)
{
	_mm256_storeu_ps(to, (__m256)v);
}

static inline vf four(const float *from)
{
	return (vf)_mm256_broadcast_ps((const __m128 *)(const void *)from);
}

static inline void store_four(float *to, vf v)
{
	_mm_storeu_ps(to, _mm256_castps256_ps128((__m256)v));
}

static inline void add_four(float *to, vf v)
{
	const __m128 sum = _mm_add_ps(_mm256_castps256_ps128((__m256)v), _mm256_extractf128_ps((__m256)v, 1));

	_mm_storeu_ps(to, _mm_add_ps(_mm_loadu_ps(to), sum));
}

static inline float least_of(vf v)
{
	const __m128 a = _mm256_castps256_ps128((__m256)v), b = _mm_min_ps(a, _mm_movehl_ps(a, a));

	return _mm_cvtss_f32(_mm_min_ss(b, _mm_movehdup_ps(b)));
}

static inline float most_of(vf v)
{
	const __m128 a = _mm256_castps256_ps128((__m256)v), b = _mm_max_ps(a, _mm_movehl_ps(a, a));

	return _mm_cvtss_f32(_mm_max_ss(b, _mm_movehdup_ps(b)));
}

static inline vf deep(void)
{
	return (vf){ 0, 0, 0, 0, 1, 1, 1, 1 };
}

static inline vf only_first(vf v)
{
	return (vf)_mm256_blend_ps(_mm256_setzero_ps(), (__m256)v, 15);
}

static inline vf before(vf clear)
{
	return (vf)_mm256_insertf128_ps(_mm256_set1_ps(1), _mm256_castps256_ps128((__m256)clear), 1);
}

static inline vf product(vf clear)
{
	return (vf)_mm256_mul_ps((__m256)clear, _mm256_permute2f128_ps((__m256)clear, (__m256)clear, 1));
}

static inline vi gather32(const uint8_t *base, vi byte_offset)
{
	return (vi)_mm256_i32gather_epi32((const int *)(const void *)base, (__m256i)byte_offset, 1);
}

static inline void deinterleave(__m256i a, __m256i b, vi *low, vi *high)
{
	const __m256 p = _mm256_castsi256_ps(a), q = _mm256_castsi256_ps(b);
	const __m256i even = _mm256_castps_si256(_mm256_shuffle_ps(p, q, _MM_SHUFFLE(2, 0, 2, 0)));
	const __m256i odd = _mm256_castps_si256(_mm256_shuffle_ps(p, q, _MM_SHUFFLE(3, 1, 3, 1)));

	*low = (vi)_mm256_permute4x64_epi64(even, _MM_SHUFFLE(3, 1, 2, 0));
	*high = (vi)_mm256_permute4x64_epi64(odd, _MM_SHUFFLE(3, 1, 2, 0));
}

static inline void gather64(const uint64_t *table, vi index, vi *low, vi *high)
{
	const long long *base = (const long long *)table;

	deinterleave(_mm256_i32gather_epi64(base, _mm256_castsi256_si128((__m256i)index), 8),
		     _mm256_i32gather_epi64(base, _mm256_extracti128_si256((__m256i)index, 1), 8), low, high);
}

static inline void gather64_4(const uint8_t *from, vi index, vi *low, vi *high)
{
	const long long *base = (const long long *)(const void *)from;

	deinterleave(_mm256_i32gather_epi64(base, _mm256_castsi256_si128((__m256i)index), 4),
		     _mm256_i32gather_epi64(base, _mm256_extracti128_si256((__m256i)index, 1), 4), low, high);
}

#include "render/cpu/cast_gathers.inc"

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

void bb_cast_tile_avx2(const struct bb_cast *c, uint32_t tile, struct bb_cast_counts *counts)
{
	bb_cast_tile_portable(c, tile, counts);
}
#endif
