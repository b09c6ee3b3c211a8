#include "render/bricks/values.h"
#include "render/half.h"

#include <lz4.h>
#include <string.h>
#include <zstd.h>

#define ZSTD_LEVEL 3
#define WORTH_A 16 /* part of the bytes that packing must save */

/* In double: a float has no place for the fractions of 65535 parts, and what is near a half would go the wrong way. */
static double part_of(const struct bb_bricks_header *h, float v)
{
	const double span = h->most - h->least, part = span > 0 ? ((double)v - h->least) / span : 0;

	return part > 0 ? (part < 1 ? part : 1) : 0;
}

void bb_values_store(const struct bb_bricks_header *h, const float *v, size_t n, uint8_t *out)
{
	switch (h->type) {
	case BB_BRICK_U8:
		for (size_t i = 0; i < n; i++)
			out[i] = (uint8_t)(part_of(h, v[i]) * 255 + 0.5);
		return;
	case BB_BRICK_U16:
	case BB_BRICK_F16:
		for (size_t i = 0; i < n; i++) {
			const double part = part_of(h, v[i]);
			const uint16_t q =
				h->type == BB_BRICK_F16 ? bb_to_half((float)part) : (uint16_t)(part * 65535 + 0.5);
			out[2 * i] = (uint8_t)(q & 0xff);
			out[2 * i + 1] = (uint8_t)(q >> 8);
		}
		return;
	case BB_BRICK_F32:
	case BB_BRICK_TYPES:
		memcpy(out, v, n * sizeof(float)); /* little-endian hosts only, as the sanity test of the build says */
	}
}

void bb_values_load(const struct bb_bricks_header *h, const uint8_t *bytes, size_t n, float *out)
{
	const double span = h->most - h->least;

	switch (h->type) {
	case BB_BRICK_U8:
		for (size_t i = 0; i < n; i++)
			out[i] = (float)(h->least + bytes[i] * span / 255);
		return;
	case BB_BRICK_U16:
	case BB_BRICK_F16:
		for (size_t i = 0; i < n; i++) {
			const uint16_t q = (uint16_t)(bytes[2 * i] | bytes[2 * i + 1] << 8);
			out[i] = (float)(h->least +
					 span * (h->type == BB_BRICK_F16 ? (double)bb_from_half(q) : q / 65535.0));
		}
		return;
	case BB_BRICK_F32:
	case BB_BRICK_TYPES:
		memcpy(out, bytes, n * sizeof(float));
	}
}

size_t bb_values_packed_cap(enum bb_brick_codec codec, size_t n)
{
	return codec == BB_BRICK_LZ4    ? (size_t)LZ4_compressBound((int)n)
	       : codec == BB_BRICK_ZSTD ? ZSTD_compressBound(n)
					: n;
}

static size_t pack(enum bb_brick_codec codec, const uint8_t *from, size_t n, uint8_t *out, size_t cap)
{
	if (codec == BB_BRICK_LZ4) {
		const int packed = LZ4_compress_default((const char *)from, (char *)out, (int)n, (int)cap);
		return packed > 0 ? (size_t)packed : 0;
	}
	const size_t packed = ZSTD_compress(out, cap, from, n, ZSTD_LEVEL);
	return ZSTD_isError(packed) ? 0 : packed;
}

size_t bb_values_pack(enum bb_brick_codec codec, const uint8_t *from, size_t n, uint8_t *out)
{
	const size_t packed = codec == BB_BRICK_PLAIN ? n : pack(codec, from, n, out, bb_values_packed_cap(codec, n));

	if (packed < n - n / WORTH_A)
		return packed;
	memcpy(out, from, n);
	return n;
}

bool bb_unpacker_init(struct bb_unpacker *u, enum bb_brick_codec codec)
{
	*u = (struct bb_unpacker){ codec, NULL };
	if (codec != BB_BRICK_ZSTD)
		return true;
	u->zstd = ZSTD_createDCtx();
	return u->zstd != NULL;
}

void bb_unpacker_fini(struct bb_unpacker *u)
{
	ZSTD_freeDCtx(u->zstd);
	u->zstd = NULL;
}

uint64_t bb_unpacker_bytes(const struct bb_unpacker *u)
{
	return u->zstd ? ZSTD_sizeof_DCtx(u->zstd) : 0;
}

bool bb_values_unpack(const struct bb_unpacker *u, const uint8_t *from, size_t n, uint8_t *out, size_t n_out)
{
	if (u->codec == BB_BRICK_ZSTD)
		return ZSTD_decompressDCtx(u->zstd, out, n_out, from, n) == n_out;
	return n <= INT32_MAX && LZ4_decompress_safe((const char *)from, (char *)out, (int)n, (int)n_out) == (int)n_out;
}
