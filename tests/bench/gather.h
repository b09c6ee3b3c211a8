/*
 * tests/bench/gather.h: what this machine's registers allow: 64-bit gathers a second from a table in the nearest cache
 * (a sample of single precision takes four for its voxels, in pairs, and one for its colour), and samples a second when
 * nothing is read at all. One thread.
 */
#ifndef BB_TESTS_BENCH_GATHER_H
#define BB_TESTS_BENCH_GATHER_H

#include <stdint.h>

#include "hal/clock.h"

struct gather_rate {
	double gathers_per_s, samples_per_s;
};

#ifdef __x86_64__
#include <immintrin.h>

#define GATHER_N 4000000
#define GATHER_TABLE 2048 /* entries of 8 bytes */

__attribute__((target("avx512f,avx512dq,fma"))) static inline double gather_loop(const uint64_t *table)
{
	const __m256i mask = _mm256_set1_epi32(GATHER_TABLE - 1), times = _mm256_set1_epi32(1664525);
	const int64_t begin_ns = bb_clock_stopwatch_ns();
	__m512i sum = _mm512_setzero_si512();
	__m256i at[4];

	for (int k = 0; k < 4; k++)
		at[k] = _mm256_setr_epi32(k, 77 + k, 154, 231, 308 * k, 385, 462, 539);
	for (int i = 0; i < GATHER_N; i += 32)
		for (int k = 0; k < 4; k++) {
			at[k] = _mm256_add_epi32(_mm256_mullo_epi32(at[k], times), mask);
			const __m256i index = _mm256_and_si256(_mm256_srli_epi32(at[k], 8), mask);
			sum = _mm512_add_epi64(sum, _mm512_i32gather_epi64(index, table, 8));
		}
	volatile long long sink = _mm512_reduce_add_epi64(sum);
	(void)sink;
	return GATHER_N / ((double)(bb_clock_stopwatch_ns() - begin_ns) / 1e9);
}

/* A position, its cell, seven blends and a colour, of sixteen samples at a time. */
__attribute__((target("avx512f,avx512dq,fma"))) static inline double arithmetic_loop(void)
{
	const int64_t begin_ns = bb_clock_stopwatch_ns();
	const __m512 stride = _mm512_set1_ps(0.37F), one = _mm512_set1_ps(1);
	__m512 sum = _mm512_setzero_ps(), clear = one, t = _mm512_setzero_ps();

	for (int i = 0; i < GATHER_N; i++) {
		__m512 part[3], v[8];
		__m512i in = _mm512_setzero_si512();
		for (int a = 0; a < 3; a++) {
			const __m512 p = _mm512_fmadd_ps(t, stride, _mm512_set1_ps((float)a));
			const __m512 whole = _mm512_roundscale_ps(p, 11);
			part[a] = _mm512_sub_ps(p, whole);
			in = _mm512_add_epi32(_mm512_mullo_epi32(in, _mm512_set1_epi32(34)),
					      _mm512_cvttps_epi32(whole));
		}
		for (int k = 0; k < 8; k++)
			v[k] = _mm512_castsi512_ps(_mm512_and_si512(in, _mm512_set1_epi32(0x3F000000 + k)));
		for (int k = 0; k < 7; k++)
			v[k] = _mm512_fmadd_ps(_mm512_sub_ps(v[k + 1], v[k]), part[k % 3], v[k]);
		const __m512 weight = _mm512_mul_ps(clear, v[6]);
		for (int k = 0; k < 3; k++)
			sum = _mm512_fmadd_ps(weight, v[k], sum);
		clear = _mm512_max_ps(_mm512_sub_ps(clear, weight), one);
		t = _mm512_add_ps(t, one);
	}
	volatile float sink = _mm512_reduce_add_ps(sum);
	(void)sink;
	return 16.0 * GATHER_N / ((double)(bb_clock_stopwatch_ns() - begin_ns) / 1e9);
}

static inline struct gather_rate gather_rate(void)
{
	static uint64_t table[GATHER_TABLE];
	struct gather_rate best = { 0 };

	if (!__builtin_cpu_supports("avx512dq"))
		return best;
	for (int k = 0; k < 5; k++) {
		const double g = gather_loop(table), a = arithmetic_loop();
		best.gathers_per_s = g > best.gathers_per_s ? g : best.gathers_per_s;
		best.samples_per_s = a > best.samples_per_s ? a : best.samples_per_s;
	}
	return best;
}
#else
static inline struct gather_rate gather_rate(void)
{
	return (struct gather_rate){ 0 };
}
#endif

#endif
