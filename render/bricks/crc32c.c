/*
 * render/bricks/crc32c.c: a brick is checked each time it is read, so the check must cost little beside the copy out of
 * the page cache. One chain of the crc32 instruction is bound by its latency (three cycles for eight bytes); three
 * chains side by side are not (Gopal et al. 2011); folding 512 bits at a time (Gopal et al. 2009, wider) is faster yet.
 */
#include "render/bricks/crc32c.h"
#include "render/bricks/format.h"

#include <pthread.h>
#include <string.h>
#ifdef __x86_64__
#include <immintrin.h>
#endif

#define COPY_PAST_CACHES 2048 /* below that the caches are the better place for it */
#define COPY_PIECE 16384      /* elsewhere: still in the first cache when it is copied */
#define POLYNOMIAL 0x82F63B78u /* 0x1EDC6F41 from its other end */

static uint32_t tables[8][256];

static void make_tables(void)
{
	for (uint32_t i = 0; i < 256; i++) {
		tables[0][i] = i;
		for (int bit = 0; bit < 8; bit++)
			tables[0][i] = tables[0][i] >> 1 ^ (tables[0][i] & 1 ? POLYNOMIAL : 0);
	}
	for (uint32_t t = 1; t < 8; t++)
		for (uint32_t i = 0; i < 256; i++)
			tables[t][i] = tables[t - 1][i] >> 8 ^ tables[0][tables[t - 1][i] & 0xff];
}

static uint32_t by_tables(uint32_t crc, const uint8_t *p, size_t n)
{
	static pthread_once_t once = PTHREAD_ONCE_INIT;

	pthread_once(&once, make_tables);
	for (; n >= 8; n -= 8, p += 8) {
		const uint32_t low = bb_get_u32(p) ^ crc, high = bb_get_u32(p + 4);
		crc = tables[7][low & 0xff] ^ tables[6][low >> 8 & 0xff] ^ tables[5][low >> 16 & 0xff] ^
		      tables[4][low >> 24] ^ tables[3][high & 0xff] ^ tables[2][high >> 8 & 0xff] ^
		      tables[1][high >> 16 & 0xff] ^ tables[0][high >> 24];
	}
	while (n--)
		crc = crc >> 8 ^ tables[0][(crc ^ *p++) & 0xff];
	return crc;
}

#ifdef __x86_64__
#define STREAM_BYTES 512
/* x^(8 n - 33) of the polynomial, from its other end: by it a CRC is multiplied to stand n bytes further on. */
#define ON_BY_ONE 0xdd7e3b0c /* n = STREAM_BYTES */
#define ON_BY_TWO 0x170076fa /* n = 2 * STREAM_BYTES */

#define WITH_INSTRUCTION __attribute__((target("sse4.2,pclmul")))

static inline uint64_t word_at(const uint8_t *p)
{
	uint64_t word;

	memcpy(&word, p, 8);
	return word;
}

WITH_INSTRUCTION static uint32_t move_on(uint32_t crc, uint32_t by)
{
	const __m128i product = _mm_clmulepi64_si128(_mm_cvtsi32_si128((int)crc), _mm_cvtsi32_si128((int)by), 0);

	return (uint32_t)_mm_crc32_u64(0, (uint64_t)_mm_cvtsi128_si64(product));
}

WITH_INSTRUCTION static uint32_t by_instruction(uint32_t crc, const uint8_t *p, size_t n)
{
	for (; n >= 3 * STREAM_BYTES; n -= 3 * STREAM_BYTES, p += 3 * STREAM_BYTES) {
		uint64_t a = crc, b = 0, c = 0;
		for (size_t i = 0; i < STREAM_BYTES; i += 8) {
			a = _mm_crc32_u64(a, word_at(p + i));
			b = _mm_crc32_u64(b, word_at(p + STREAM_BYTES + i));
			c = _mm_crc32_u64(c, word_at(p + 2 * STREAM_BYTES + i));
		}
		crc = move_on((uint32_t)a, ON_BY_TWO) ^ move_on((uint32_t)b, ON_BY_ONE) ^ (uint32_t)c;
	}
	for (; n >= 8; n -= 8, p += 8)
		crc = (uint32_t)_mm_crc32_u64(crc, word_at(p));
	while (n--)
		crc = _mm_crc32_u8(crc, *p++);
	return crc;
}

#define WITH_FOLDING __attribute__((target("avx512f,avx512vl,avx512dq,vpclmulqdq,sse4.2,pclmul")))

/* What a 128-bit lane becomes when it moves on by so many bits: its halves times x^(bits +- 32), from the other end. */
#define FOLD_128 0x14cd00bd6, 0xf20c0dfe
#define FOLD_512 0x9e4addf8, 0x740eef02
#define FOLD_2048 0xb9e02b86, 0xdcb17aa4

WITH_FOLDING static inline __m512i fold(__m512i lane, __m512i by, __m512i onto)
{
	return _mm512_ternarylogic_epi64(_mm512_clmulepi64_epi128(lane, by, 0x00),
					 _mm512_clmulepi64_epi128(lane, by, 0x11), onto, 0x96);
}

WITH_FOLDING static inline __m128i fold_lane(__m128i lane, __m128i onto)
{
	const __m128i by = _mm_set_epi64x(FOLD_128);

	return _mm_xor_si128(_mm_xor_si128(_mm_clmulepi64_si128(lane, by, 0x00), _mm_clmulepi64_si128(lane, by, 0x11)),
			     onto);
}

/* 64 bytes; where there is a `to`, to memory past the caches. */
WITH_FOLDING static inline __m512i take(const uint8_t *from, uint8_t *to, size_t at)
{
	const __m512i v = _mm512_loadu_si512(from + at);

	if (to)
		_mm512_stream_si512((void *)(to + at), v);
	return v;
}

/* n >= 256; `to` stands on a multiple of 64, or is NULL. */
WITH_FOLDING static inline __attribute__((always_inline)) uint32_t fold_all(uint32_t crc, const uint8_t *p, size_t n,
									    uint8_t *to)
{
	const __m512i far = _mm512_broadcast_i64x2(_mm_set_epi64x(FOLD_2048)),
		      near = _mm512_broadcast_i64x2(_mm_set_epi64x(FOLD_512));
	__m512i a = take(p, to, 0), b = take(p, to, 64), c = take(p, to, 128), d = take(p, to, 192);
	size_t at = 256;

	a = _mm512_xor_si512(a, _mm512_zextsi128_si512(_mm_cvtsi32_si128((int)crc)));
	for (; n - at >= 256; at += 256) {
		a = fold(a, far, take(p, to, at));
		b = fold(b, far, take(p, to, at + 64));
		c = fold(c, far, take(p, to, at + 128));
		d = fold(d, far, take(p, to, at + 192));
	}
	d = fold(fold(fold(a, near, b), near, c), near, d);
	for (; n - at >= 64; at += 64)
		d = fold(d, near, take(p, to, at));
	__m128i lane = fold_lane(_mm512_extracti64x2_epi64(d, 0), _mm512_extracti64x2_epi64(d, 1));
	lane = fold_lane(lane, _mm512_extracti64x2_epi64(d, 2));
	lane = fold_lane(lane, _mm512_extracti64x2_epi64(d, 3));
	/* What is left is 16 bytes with the same remainder. */
	const uint64_t low = _mm_crc32_u64(0, (uint64_t)_mm_cvtsi128_si64(lane));
	crc = (uint32_t)_mm_crc32_u64(low, (uint64_t)_mm_extract_epi64(lane, 1));
	if (to)
		memcpy(to + at, p + at, n - at);
	return by_instruction(crc, p + at, n - at);
}

WITH_FOLDING static uint32_t by_folding(uint32_t crc, const uint8_t *p, size_t n)
{
	return fold_all(crc, p, n, NULL);
}

WITH_FOLDING static uint32_t copy_by_folding(uint32_t crc, uint8_t *to, const uint8_t *p, size_t n)
{
	const size_t head = -(uintptr_t)to & 63;

	memcpy(to, p, head);
	crc = by_instruction(crc, p, head);
	return fold_all(crc, p + head, n - head, to + head);
}
#endif

bool bb_crc32c_has(enum bb_crc32c_way way)
{
#ifdef __x86_64__
	const bool instruction = __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("pclmul");

	if (way == BB_CRC32C_INSTRUCTION)
		return instruction;
	if (way == BB_CRC32C_FOLDED)
		return instruction && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq") &&
		       __builtin_cpu_supports("vpclmulqdq");
#endif
	return way == BB_CRC32C_TABLES;
}

const char *bb_crc32c_text(enum bb_crc32c_way way)
{
	static const char *const text[BB_CRC32C_WAYS] = { "eight tables", "three streams of crc32", "vpclmulqdq" };

	return text[way];
}

uint32_t bb_crc32c_by(enum bb_crc32c_way way, uint32_t crc, const void *bytes, size_t n)
{
#ifdef __x86_64__
	if (way == BB_CRC32C_FOLDED && n >= 256)
		return ~by_folding(~crc, bytes, n);
	if (way != BB_CRC32C_TABLES)
		return ~by_instruction(~crc, bytes, n);
#endif
	(void)way;
	return ~by_tables(~crc, bytes, n);
}

uint32_t bb_crc32c(uint32_t crc, const void *bytes, size_t n)
{
	enum bb_crc32c_way way = BB_CRC32C_FOLDED;

	while (way > BB_CRC32C_TABLES && !bb_crc32c_has(way))
		way--;
	return bb_crc32c_by(way, crc, bytes, n);
}

uint32_t bb_crc32c_copy(uint32_t crc, void *to, const void *from, size_t n)
{
#ifdef __x86_64__
	if (n >= COPY_PAST_CACHES && bb_crc32c_has(BB_CRC32C_FOLDED))
		return ~copy_by_folding(~crc, to, from, n);
#endif
	for (size_t at = 0, part; at < n; at += part) {
		part = n - at < COPY_PIECE ? n - at : COPY_PIECE;
		crc = bb_crc32c(crc, (const uint8_t *)from + at, part);
		memcpy((uint8_t *)to + at, (const uint8_t *)from + at, part);
	}
	return crc;
}

void bb_crc32c_copied(void)
{
#ifdef __x86_64__
	_mm_sfence();
#endif
}
