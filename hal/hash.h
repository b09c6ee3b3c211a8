/*
 * hal/hash.h: SHA-256, in one go or piece by piece (files, the event log); SipHash-2-4 with 128 bits to seal packets;
 * random bytes for secrets. Owns the only libcrypto calls of the program. No threads of its own.
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

/* A sender's mark under bytes (Aumasson and Bernstein, "SipHash: a fast short-input PRF"): whoever lacks the key cannot
 * make it. One thread at a time. */
#define BB_SEAL_KEY_BYTES 16
#define BB_SEAL_BYTES 16
struct bb_seal;
BB_MUST_CHECK bool bb_seal_create(const uint8_t key[BB_SEAL_KEY_BYTES], struct bb_seal **out);
void bb_seal_destroy(struct bb_seal *s); /* NULL is allowed */
BB_MUST_CHECK bool bb_seal_make(struct bb_seal *s, const void *bytes, size_t n, uint8_t out[BB_SEAL_BYTES]);
/* Takes the same time wherever the two differ. */
BB_MUST_CHECK bool bb_seal_holds(struct bb_seal *s, const void *bytes, size_t n, const uint8_t mark[BB_SEAL_BYTES]);

/* From the kernel's generator, for keys and session numbers only: nothing a run depends on may be random. */
BB_MUST_CHECK bool bb_random_secret(void *out, size_t n);

#endif
