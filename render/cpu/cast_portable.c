#include "render/cpu/cast.h"
void bb_cast_row_portable(const struct bb_cast *c, uint32_t row, struct bb_cast_counts *counts)
{ (void)c; (void)row; (void)counts; }
#if 0
/* render/cpu/cast_portable.c: the ray caster in C alone. */
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#define WIDTH 4
#define KERNEL bb_cast_row_portable

typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));

static inline vi gather32(const void *base, vi byte_offset)
{
	vi out;

	for (int k = 0; k < WIDTH; k++) {
		int32_t v;
		memcpy(&v, (const char *)base + byte_offset[k], sizeof(v));
		out[k] = v;
	}
	return out;
}

static inline void gather64(const uint64_t *table, vi index, vi *low, vi *high)
{
	for (int k = 0; k < WIDTH; k++) {
		(*low)[k] = (int32_t)(uint32_t)table[index[k]];
		(*high)[k] = (int32_t)(uint32_t)(table[index[k]] >> 32);
	}
}

static inline bool any(vi mask)
{
	int32_t sum = 0;

	for (int k = 0; k < WIDTH; k++)
		sum |= mask[k];
	return sum != 0;
}

#include "render/cpu/cast_kernel.inc"
#endif
