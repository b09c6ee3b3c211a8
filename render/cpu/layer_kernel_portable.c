/* render/cpu/layer_kernel_portable.c: the samples of layers in C alone. */
#include <stdint.h>
#include <string.h>

#define WIDTH 4
#define NAME "portable"
#define KERNEL bb_layer_kernel_portable

typedef int32_t vi __attribute__((vector_size(4 * WIDTH)));
typedef uint32_t vu __attribute__((vector_size(4 * WIDTH)));

static inline vi gather32(const void *base, vi byte_offset)
{
	vi out = { 0 };

	for (int k = 0; k < WIDTH; k++) {
		int32_t v;
		memcpy(&v, (const char *)base + byte_offset[k], sizeof(v));
		out[k] = v;
	}
	return out;
}

#include "render/cpu/layer_kernel.inc"
