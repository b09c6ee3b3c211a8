/*
 * hal/hash.h: SHA-256, in one go or piece by piece (files, the event log). Owns the only libcrypto call of the program.
 * No threads of its own.
 */
#ifndef BB_HAL_HASH_H
#define BB_HAL_HASH_H

#include "hal/base.h"

#define BB_HASH_BYTES 32
#define BB_HASH_HEX 65 /* with its NUL */

struct bb_hash { /* zeroed is a valid, finished hash */
	void *ctx;
};

/* false: out of memory. A hash that was begun must be ended by bb_hash_final or bb_hash_final_hex. */
BB_MUST_CHECK bool bb_hash_init(struct bb_hash *h);
void bb_hash_update(struct bb_hash *h, const void *bytes, size_t n);
void bb_hash_final(struct bb_hash *h, uint8_t out[BB_HASH_BYTES]);
void bb_hash_final_hex(struct bb_hash *h, char out[BB_HASH_HEX]);

/* All of it at once; out is zeros when memory is out. */
void bb_hash_bytes(const void *bytes, size_t n, uint8_t out[BB_HASH_BYTES]);
void bb_hash_hex(const uint8_t hash[BB_HASH_BYTES], char out[BB_HASH_HEX]);

#endif
