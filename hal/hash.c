#include "hal/hash.h"

#include <openssl/evp.h>
#include <string.h>

bool bb_hash_init(struct bb_hash *h)
{
	h->ctx = EVP_MD_CTX_new();
	if (h->ctx && EVP_DigestInit_ex(h->ctx, EVP_sha256(), NULL) == 1)
		return true;
	EVP_MD_CTX_free(h->ctx);
	h->ctx = NULL;
	return false;
}

void bb_hash_update(struct bb_hash *h, const void *bytes, size_t n)
{
	if (h->ctx && n)
		EVP_DigestUpdate(h->ctx, bytes, n);
}

void bb_hash_final(struct bb_hash *h, uint8_t out[BB_HASH_BYTES])
{
	memset(out, 0, BB_HASH_BYTES);
	if (h->ctx)
		EVP_DigestFinal_ex(h->ctx, out, NULL);
	EVP_MD_CTX_free(h->ctx);
	h->ctx = NULL;
}

void bb_hash_hex(const uint8_t hash[BB_HASH_BYTES], char out[BB_HASH_HEX])
{
	static const char digit[] = "0123456789abcdef";

	for (size_t i = 0; i < BB_HASH_BYTES; i++) {
		out[2 * i] = digit[hash[i] >> 4];
		out[2 * i + 1] = digit[hash[i] & 15];
	}
	out[BB_HASH_HEX - 1] = '\0';
}

void bb_hash_final_hex(struct bb_hash *h, char out[BB_HASH_HEX])
{
	uint8_t hash[BB_HASH_BYTES];

	bb_hash_final(h, hash);
	bb_hash_hex(hash, out);
}

void bb_hash_bytes(const void *bytes, size_t n, uint8_t out[BB_HASH_BYTES])
{
	struct bb_hash h;

	memset(out, 0, BB_HASH_BYTES);
	if (!bb_hash_init(&h))
		return;
	bb_hash_update(&h, bytes, n);
	bb_hash_final(&h, out);
}
