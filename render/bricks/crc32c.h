/*
 * render/bricks/crc32c.h: the ways to a CRC-32C; bb_crc32c (format.h) takes the fastest this processor has. And a
 * copy that makes one on its way. Stateless, any thread.
 */
#ifndef BB_RENDER_BRICKS_CRC32C_H
#define BB_RENDER_BRICKS_CRC32C_H

#include "hal/base.h"

enum bb_crc32c_way {
	BB_CRC32C_TABLES,      /* eight tables of 256, any processor */
	BB_CRC32C_INSTRUCTION, /* three streams of the crc32 instruction, and pclmulqdq to join them */
	BB_CRC32C_FOLDED,      /* four 512-bit accumulators folded by vpclmulqdq */
	BB_CRC32C_WAYS
};

bool bb_crc32c_has(enum bb_crc32c_way way);
const char *bb_crc32c_text(enum bb_crc32c_way way);
/* As bb_crc32c, in a way this processor has. */
uint32_t bb_crc32c_by(enum bb_crc32c_way way, uint32_t crc, const void *bytes, size_t n);

/*
 * A copy and its CRC in one pass. Large ones go past the caches where the processor can: a brick is not looked at again
 * soon, and the slot it goes to need not be fetched first. They are in order for other threads after bb_crc32c_copied.
 */
uint32_t bb_crc32c_copy(uint32_t crc, void *to, const void *from, size_t n);
void bb_crc32c_copied(void);

#endif
