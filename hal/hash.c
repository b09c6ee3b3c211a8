#include "hal/hash.h"

#include <openssl/core_names.h>
#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

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

/* ---- marks ---- */

struct bb_seal {
	EVP_MAC *mac;
	EVP_MAC_CTX *ctx;
	uint8_t key[BB_SEAL_KEY_BYTES];
};

bool bb_seal_create(const uint8_t key[BB_SEAL_KEY_BYTES], struct bb_seal **out)
{
	struct bb_seal *s = calloc(1, sizeof(*s));

	*out = NULL;
	if (!s)
		return false;
	memcpy(s->key, key, sizeof(s->key));
	s->mac = EVP_MAC_fetch(NULL, "SIPHASH", NULL);
	s->ctx = s->mac ? EVP_MAC_CTX_new(s->mac) : NULL;
	if (!s->ctx) {
		bb_seal_destroy(s);
		return false;
	}
	*out = s;
	return true;
}

void bb_seal_destroy(struct bb_seal *s)
{
	if (!s)
		return;
	EVP_MAC_CTX_free(s->ctx);
	EVP_MAC_free(s->mac);
	OPENSSL_cleanse(s->key, sizeof(s->key));
	free(s);
}

bool bb_seal_make(struct bb_seal *s, const void *bytes, size_t n, uint8_t out[BB_SEAL_BYTES])
{
	size_t size = BB_SEAL_BYTES, made = 0;
	const OSSL_PARAM params[] = { OSSL_PARAM_construct_size_t(OSSL_MAC_PARAM_SIZE, &size), OSSL_PARAM_construct_end() };

	return EVP_MAC_init(s->ctx, s->key, sizeof(s->key), params) == 1 && EVP_MAC_update(s->ctx, bytes, n) == 1 &&
	       EVP_MAC_final(s->ctx, out, &made, BB_SEAL_BYTES) == 1 && made == BB_SEAL_BYTES;
}

bool bb_seal_holds(struct bb_seal *s, const void *bytes, size_t n, const uint8_t mark[BB_SEAL_BYTES])
{
	uint8_t own[BB_SEAL_BYTES];

	return bb_seal_make(s, bytes, n, own) && CRYPTO_memcmp(own, mark, BB_SEAL_BYTES) == 0;
}

bool bb_random_secret(void *out, size_t n)
{
	return n <= 256 && getrandom(out, n, 0) == (ssize_t)n;
}
