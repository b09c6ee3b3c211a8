/*
 * render/bricks/values.h: voxels as a brick file stores them: f32 as they are, the smaller types as parts of the data's
 * range; and packed by a codec or not. Any thread.
 */
#ifndef BB_RENDER_BRICKS_VALUES_H
#define BB_RENDER_BRICKS_VALUES_H

#include "render/bricks/format.h"

/* n values to bytes and back; a stored value is within half a quantum (f16: half a unit of its last place) of its own.
 */
void bb_values_store(const struct bb_bricks_header *h, const float *v, size_t n, uint8_t *out);
void bb_values_load(const struct bb_bricks_header *h, const uint8_t *bytes, size_t n, float *out);

/*
 * At most so many bytes; how many they became (0: the codec failed or is not in this build). n: they are as they were,
 * because packing would have saved less than a sixteenth: that is read faster than it is unpacked.
 */
size_t bb_values_packed_cap(enum bb_brick_codec codec, size_t n);
size_t bb_values_pack(enum bb_brick_codec codec, const uint8_t *from, size_t n, uint8_t *out);

/* What unpacking needs besides its input and output: memory for zstd, nothing for the others. One thread at a time. */
struct bb_unpacker {
	enum bb_brick_codec codec;
	void *zstd;
};
BB_MUST_CHECK bool bb_unpacker_init(struct bb_unpacker *u, enum bb_brick_codec codec); /* false: no memory */
void bb_unpacker_fini(struct bb_unpacker *u);                                           /* zeros are allowed */
uint64_t bb_unpacker_bytes(const struct bb_unpacker *u);
/* Exactly n_out bytes, or false; of a codec that packs, and what it has packed. Allocates nothing. */
bool bb_values_unpack(const struct bb_unpacker *u, const uint8_t *from, size_t n, uint8_t *out, size_t n_out);

#endif
