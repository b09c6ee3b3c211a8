/*
 * tests/fuzz/fuzz.h: what fuzz targets share. A target is fast: nothing is allocated for an input, no clock ticks where
 * the parser needs none, and what outlives an input is put back to where it began.
 */
#ifndef BB_TESTS_FUZZ_H
#define BB_TESTS_FUZZ_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* A broken promise is a find. */
static inline void fuzz_must(bool holds)
{
	if (!holds)
		abort();
}

/* A part of the input as long as it is and not a byte more: it ends where the array does, so that ASan sees whoever
 * reads on. Good until the next call. */
#define FUZZ_PIECE_MOST 32768
static inline uint8_t *fuzz_exact(const uint8_t *data, size_t n)
{
	static _Alignas(16) uint8_t room[FUZZ_PIECE_MOST];

	fuzz_must(n <= sizeof(room));
	if (n)
		memcpy(room + sizeof(room) - n, data, n);
	return room + sizeof(room) - n;
}

/* The input, eaten from its front: zeros when it is used up. */
struct fuzz_input {
	const uint8_t *at;
	size_t left;
};

static inline uint8_t fuzz_byte(struct fuzz_input *in)
{
	if (!in->left)
		return 0;
	in->left--;
	return *in->at++;
}

/* The next n bytes, or as many as there are. */
static inline uint8_t *fuzz_piece(struct fuzz_input *in, size_t n, size_t *n_out)
{
	*n_out = n < in->left ? n : in->left;
	uint8_t *piece = fuzz_exact(in->at, *n_out);
	in->at += *n_out;
	in->left -= *n_out;
	return piece;
}

#endif
